"""Which photos a command line means, and what their results are called."""

import os
import sys
from pathlib import Path

import pytest
from bad_input import SPHERE, Bench, gets_one_clear_sentence

from mpsnet_core.errors import InputError
from mpsnet_core.io.frames import expand_images, numbering, output_files

NAMES = ["b.TIF", "frame_0001.png", "frame_01.png", "frame_0002.png", "frame_0010.png", "frame_a.png"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in [*NAMES, "notes.txt", ".hidden.png", "._b.TIF", "Thumbs.db", "desktop.ini"]:
        (tmp_path / name).touch()
    (tmp_path / "folder.png").mkdir()
    return tmp_path


@pytest.mark.parametrize(
    ("given", "meant"),
    [
        (["frame_0002.png", "frame_0001.png"], ["frame_0002.png", "frame_0001.png"]),
        (["frame_####.png"], ["frame_0001.png", "frame_0002.png", "frame_0010.png"]),
        (["frame_##.*"], ["frame_01.png"]),
        (["frame_?.png"], ["frame_a.png"]),
        (["*.*"], NAMES),
        ([""], NAMES),
        (["b.TIF", "frame_0##1.png"], ["b.TIF", "frame_0001.png"]),
    ],
)
def test_files_folders_and_patterns(folder: Path, given: list[str], meant: list[str]) -> None:
    assert [path.name for path in expand_images([folder / name for name in given])] == meant


def test_brackets_in_a_name_are_not_a_pattern(tmp_path: Path) -> None:
    for name in ("shot[1]_01.png", "shot1_01.png", "take#1.png", "take01.png"):
        (tmp_path / name).touch()
    assert [path.name for path in expand_images([tmp_path / "shot[1]_##.png"])] == ["shot[1]_01.png"]
    assert [path.name for path in expand_images([tmp_path / "take#1.png"])] == ["take#1.png"]


def test_one_photo_goes_to_the_file_that_is_named(tmp_path: Path) -> None:
    assert output_files([tmp_path / "a.png"], tmp_path / "n.exr", ".exr") == [tmp_path / "n.exr"]


@pytest.mark.parametrize("photos", [["a.png"], ["a.png", "b.exr"]])
def test_a_folder_gets_a_file_for_each_photo(tmp_path: Path, photos: list[str]) -> None:
    files = output_files([tmp_path / name for name in photos], tmp_path / "out", ".tif")
    assert files == [tmp_path / "out" / f"{Path(name).stem}_normals.tif" for name in photos]
    assert not (tmp_path / "out").exists()  # made with the first result


def test_results_of_an_earlier_run_are_no_photos(tmp_path: Path) -> None:
    for name in ("a.png", "a_normals.png", "b.png"):
        (tmp_path / name).touch()
    assert [photo.name for photo in expand_images([tmp_path])] == ["a.png", "b.png"]
    assert [photo.name for photo in expand_images([tmp_path / "*.png"])] == ["a.png", "b.png"]
    assert [photo.name for photo in expand_images([tmp_path / "?_normals.png"])] == ["a_normals.png"]
    # Named outright, it is meant.
    assert [photo.name for photo in expand_images([tmp_path / "a_normals.png"])] == ["a_normals.png"]


def test_frames_without_zeros_before_their_numbers_are_in_order(tmp_path: Path) -> None:
    for number in (1, 10, 9, 100, 2):
        (tmp_path / f"take2_{number}.png").touch()
    names = [path.name for path in expand_images([tmp_path])]
    assert names == [f"take2_{number}.png" for number in (1, 2, 9, 10, 100)]


@pytest.mark.parametrize(
    ("names", "numbers"),
    [
        (["a_0001.png", "a_0002.png"], (1, 2)),
        (["a9.png", "a10.png"], (9, 10)),
        (["shot3_07_v2.png", "shot3_08_v2.png"], (7, 8)),
        (["shot1_01.png", "shot2_02.png"], None),
        (["a_1.png", "b_2.png"], None),
        (["a_1.png", "a_01.png"], None),
        (["a_1.png", "a_.png"], None),
        (["shot2_07.png"], (7,)),  # of a sequence whose other frames are not there yet
        (["a.png"], None),
    ],
)
def test_names_that_differ_in_one_number_are_a_sequence(names: list[str], numbers: tuple[int, ...] | None) -> None:
    found = numbering([Path(name) for name in names])
    assert (found and found.numbers) == numbers


@pytest.mark.parametrize(
    ("numbers", "words"),
    [
        ([1, 2, 3], ""),
        ([6, 8, 9], "7"),
        ([8, 1, 2], "3 to 7"),
        ([1, 2, 4, 6, 8, 10, 12, 14], "3, 5, 7, 9, 11, and more"),
        ([20, 10, 40, 30], ""),
        ([10, 20, 40, 50, 90], "30, 60 to 80"),
        ([10, 20, 35, 51], "30, 45"),
    ],
)
def test_missing_numbers_are_named(numbers: list[int], words: str) -> None:
    found = numbering([Path(f"frame_{number:04d}.png") for number in numbers])
    assert found is not None and found.gaps == words


def test_results_of_a_sequence_have_their_number_behind_all_other_digits(tmp_path: Path) -> None:
    """Blender takes a file's last digits for the number of its frame."""
    files = output_files([tmp_path / f"shot2_{number:02d}_v3.png" for number in (7, 8)], tmp_path / "out", ".png")
    assert [file.name for file in files] == ["shot2_v3_07_normals.png", "shot2_v3_08_normals.png"]


@pytest.mark.skipif(sys.platform == "win32", reason="there is no /dev/null")
def test_a_device_is_no_folder_for_one_photo() -> None:
    with pytest.raises(InputError, match=r"/dev/null: it is .*device"):
        output_files([Path("photo.png")], "/dev/null")


def two(b: Bench) -> list[Path]:
    for name in ("a", "b"):
        (b / name).mkdir()
    return [b.photo("a/same.exr"), b.photo("b/same.exr")]


test_a_bad_output_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("a name that is no UTF-8", lambda b: b.estimate(output=os.fsdecode(b"\xf6.png")), "\\udcf6.png: its name is"),
        ("another format than its name", lambda b: b.estimate(format="exr"), "out.png ends in"),
        ("over the photo", lambda b: b.estimate(b.photo("out.png", kind="uint16")), "out.png…choose another output"),
        (lambda b: b.estimate(b.photo("a.png"), b.photo("a_normals.png"), output=""), "overwrite…a_normals"),
        ("confidence over the normals", lambda b: b.estimate(confidence=b / "out.png"), "out.png, another result"),
        (
            "confidence of several",
            lambda b: b.estimate(b.photo("a.exr"), b.photo("b.exr"), output="out", confidence=b / "c.png"),
            "--confidence takes one photo",
        ),
        ("one file for several photos", lambda b: b.estimate(b.photo("a.exr"), b.photo("b.exr")), "out.png is one"),
    ]
)


test_a_bad_photo_list_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("a pattern that matches nothing", lambda b: b.estimate(b / "frame_####.png"), "frame_####.png"),
        ("a folder without images", lambda b: ((b / "shots").mkdir(), b.estimate(b / "shots")), "shots holds no"),
        ("a pattern of other programs", lambda b: b.estimate(b / "f_%04d.png"), "f_%04d.png does not exist"),
        ("a pattern of Houdini's", lambda b: b.estimate(b / "f_$F3.png"), "numbered frames are …f_###.png"),
        ("two of the same name", lambda b: b.estimate(*two(b), output="out"), "same_normals.png"),
        (
            "bad frames alone",
            lambda b: b.estimate(*(b.photo(name, 0 * SPHERE.image) for name in ("a.exr", "b.exr")), output="out"),
            "all 2 that were tried failed; the first: …a.exr…black inside the mask",
        ),
    ]
)
