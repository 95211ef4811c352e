"""Which photos a command line means, and what their results are called."""

from pathlib import Path

import pytest

from mpsnet_core.frames import expand_images, output_files

NAMES = ["b.TIF", "frame_0001.png", "frame_0002.png", "frame_0010.png", "frame_a.png", "frame_01.png"]


@pytest.fixture
def folder(tmp_path: Path) -> Path:
    for name in [*NAMES, "notes.txt", ".hidden.png"]:
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
        (["*.*"], sorted(NAMES)),
        ([""], sorted(NAMES)),
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
    assert output_files([tmp_path / "a.png"], tmp_path / "n.exr", ".png") == [tmp_path / "n.exr"]


@pytest.mark.parametrize("photos", [["a.png"], ["a.png", "b.exr"]])
def test_a_folder_gets_a_file_for_each_photo(tmp_path: Path, photos: list[str]) -> None:
    files = output_files([tmp_path / name for name in photos], tmp_path / "out", ".tif")
    assert files == [tmp_path / "out" / f"{Path(name).stem}_normals.tif" for name in photos]
    assert not (tmp_path / "out").exists()  # made with the first result


def test_results_of_an_earlier_run_are_no_photos(tmp_path: Path) -> None:
    for name in ("a.png", "a_normals.png", "b.png"):
        (tmp_path / name).touch()
    assert [photo.name for photo in expand_images([tmp_path])] == ["a.png", "b.png"]
    # Named outright, it is meant.
    assert [photo.name for photo in expand_images([tmp_path / "a_normals.png"])] == ["a_normals.png"]
