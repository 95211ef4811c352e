"""Sequences of frames: in order, resumed after any end without gap or duplicate, what is missing or broken named."""

import json
import os
import subprocess
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic import degrees_between, listing, named, shaded_sphere, write_file, write_parts

from mpsnet_core import Capture, NormalMap, read_normals, write_rig
from mpsnet_core.capture.open import PhotoSet, Source
from mpsnet_core.errors import Cancelled, InputError
from mpsnet_core.estimate.estimator import Estimator
from mpsnet_core.estimate.sequence.run import Outcome, estimate_sequence
from mpsnet_core.estimate.sequence.source import Frame, Masks, frame_masks, photo_frames
from mpsnet_core.io.image_reading import image_description
from mpsnet_core.progress import Progress

SPHERE = shaded_sphere(48)
LAMBERTIAN = Estimator("lambertian")
LIKE = Source(Path(), SPHERE.rig)


def picture(number: int) -> np.ndarray:
    """A noisy sphere, other noise each frame."""
    noise = np.random.default_rng(number).normal(0, 0.02, SPHERE.image.shape)
    return np.where(SPHERE.mask[..., None], np.clip(0.6 * SPHERE.image + 0.1 + noise, 0, 1), 0)


def shots(folder: Path, numbers: range | list[int], kind: str = "uint8") -> list[Path]:
    folder.mkdir(exist_ok=True)
    return [
        write_file(folder / f"frame_{number:04d}.png", np.dstack([picture(number), SPHERE.mask]), kind)
        for number in numbers
    ]


def take(frame: Frame) -> Capture:
    return PhotoSet().open(frame.source)


def run(photos: list[Path], out: Path, smooth: int = 0, recipe: str = "recipe", **options: Any) -> Outcome:
    outputs = [out / f"{photo.stem}_normals.png" for photo in photos]
    frames = photo_frames(photos, outputs, masks=options.pop("masks", Masks()), like=LIKE, reach=smooth)
    options = {"take": take, "estimator": LAMBERTIAN, **options}
    return estimate_sequence(frames, recipe=recipe, smooth=smooth, count=len(photos), **options)


def contents(folder: Path) -> dict[str, bytes]:
    return {name: (folder / name).read_bytes() for name in listing(folder)}


# --- in order, and ahead ----------------------------------------------------------------------------------------------


def test_frames_are_made_in_the_order_of_their_numbers(tmp_path: Path) -> None:
    photos = shots(tmp_path / "shots", [3, 1, 2, 10])
    seen = []

    def watched(capture: Capture, progress: Progress) -> NormalMap:
        seen.append(next(number for number in (1, 2, 3, 10) if np.allclose(capture.image, wanted[number], atol=1e-6)))
        return LAMBERTIAN(capture, progress)

    wanted = {number: take(frame).image for number, frame in zip((1, 2, 3, 10), frames_of(photos), strict=True)}
    outcome = run(photos, tmp_path / "out", estimator=watched)
    assert seen == [1, 2, 3, 10]
    assert (outcome.made, outcome.there, outcome.pixels) == (4, 0, 4 * SPHERE.mask.sum())


def frames_of(photos: list[Path]) -> list[Frame]:
    return photo_frames(photos, photos, masks=Masks(), like=LIKE)


def test_each_result_is_what_the_estimator_gives_alone(tmp_path: Path) -> None:
    photos = shots(tmp_path / "shots", range(1, 5), "uint16")
    run(photos, tmp_path / "out")
    for photo, frame in zip(photos, frames_of(photos), strict=True):
        alone = LAMBERTIAN(take(frame))
        found = read_normals(tmp_path / "out" / f"{photo.stem}_normals.png")
        np.testing.assert_array_equal(found.mask, alone.mask)
        assert degrees_between(found.vectors, alone.vectors)[alone.mask].max() < 0.01


# --- going on ---------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("smooth", [0, 2])
def test_what_is_missing_is_made_with_the_same_bytes(tmp_path: Path, smooth: int) -> None:
    photos = shots(tmp_path / "shots", range(1, 12))
    run(photos, tmp_path / "out", smooth)
    whole = contents(tmp_path / "out")
    for name in ("frame_0001_normals.png", "frame_0005_normals.png", "frame_0011_normals.png"):
        (tmp_path / "out" / name).unlink()
    (tmp_path / "out" / "frame_0008_normals.png").write_bytes(b"not ours")
    outcome = run(photos, tmp_path / "out", smooth)
    assert (outcome.made, outcome.there) == (4, 7)
    assert contents(tmp_path / "out") == whole


@pytest.mark.parametrize("suffix", [".png", ".tif", ".exr"])
@pytest.mark.parametrize("share", [0.5, 0.99])
def test_a_result_that_was_cut_short_is_made_again(tmp_path: Path, suffix: str, share: float) -> None:
    photos = shots(tmp_path / "shots", range(1, 4))
    outputs = [tmp_path / "out" / f"{photo.stem}{suffix}" for photo in photos]

    def again() -> Outcome:
        frames = photo_frames(photos, outputs, masks=Masks(), like=LIKE)
        return estimate_sequence(frames, take, LAMBERTIAN, recipe="")

    again()
    whole = read_normals(outputs[1]).vectors
    data = outputs[1].read_bytes()
    outputs[1].write_bytes(data[: int(share * len(data))])
    assert image_description(outputs[1])  # it still says what it was made of
    assert (again().made, again().made) == (1, 0)
    np.testing.assert_array_equal(read_normals(outputs[1]).vectors, whole)


def test_a_photo_that_changed_is_made_again_with_those_it_counts_for(tmp_path: Path) -> None:
    photos = shots(tmp_path / "shots", range(1, 10))
    for smooth, again in ((0, 1), (2, 5)):
        run(photos, tmp_path / "out", smooth)
        before = photos[4].stat()
        write_file(photos[4], np.dstack([picture(77 + smooth), SPHERE.mask]), "uint8")
        os.utime(photos[4], ns=(before.st_atime_ns, before.st_mtime_ns))  # its content tells
        outcome = run(photos, tmp_path / "out", smooth)
        assert (outcome.made, outcome.there) == (again, 9 - again)


# --- what goes wrong on the way ---------------------------------------------------------------------------------------


def cut_short(photo: Path) -> bytes:
    """Cut a photo in half, and return it whole."""
    whole = photo.read_bytes()
    photo.write_bytes(whole[: len(whole) // 2])
    return whole


@pytest.mark.parametrize(("smooth", "before"), [(0, 5), (1, 4)])
def test_a_broken_frame_is_named_and_what_was_made_is_kept(tmp_path: Path, smooth: int, before: int) -> None:
    photos = shots(tmp_path / "shots", range(1, 9))
    whole = cut_short(photos[5])
    words = rf"frame_0006\.png is damaged or cut.*; {before} frames were made; run the same command again to continue"
    with pytest.raises(InputError, match=words):
        run(photos, tmp_path / "out", smooth)
    assert listing(tmp_path / "out") == [f"frame_{number:04d}_normals.png" for number in range(1, before + 1)]
    photos[5].write_bytes(whole)
    outcome = run(photos, tmp_path / "out", smooth)
    assert outcome.made + outcome.there == 8 and outcome.there <= before


@pytest.mark.parametrize("numbered", [True, False])
def test_broken_photos_are_named_and_all_others_made(tmp_path: Path, mpsnet, rig: Path, numbered: bool) -> None:
    photos = shots(tmp_path / "shots", range(1, 8))
    if not numbered:
        photos = [photo.rename(photo.with_name(f"{name}.png")) for photo, name in zip(photos, "abcdefg", strict=True)]
    whole = {photo: cut_short(photo) for photo in (photos[0], photos[4])}
    command = ["estimate", tmp_path / "shots", "--rig", rig, "--model", "lambertian", "-o", tmp_path / "out"]
    done = mpsnet(*command)
    assert done.returncode == 2 and done.stdout.endswith("5 made, 2 failed\n")
    assert [sentence.partition(" is damaged")[0] for sentence in sentences(done)] == [*map(str, whole)]
    made = [f"{photo.stem}_normals.png" for photo in photos if photo not in whole]
    assert listing(tmp_path / "out") == made

    done = mpsnet(*command, "--progress", "json")
    told = json.loads(done.stdout.splitlines()[-1])["result"]
    assert done.returncode == 2 and (told["made"], told["there"], len(told["failed"])) == (0, 5, 2)
    if numbered:
        assert (Path(told["first_output"]).name, told["first"], told["last"], told["count"]) == (made[0], 2, 7, 5)
    else:
        assert [Path(output).name for output in told["outputs"]] == made

    for photo, content in whole.items():
        photo.write_bytes(content)
    told = result(mpsnet(*command, "--progress", "json"))
    assert (told["made"], told["there"], told.get("failed")) == (2, 5, None)


def test_a_mask_that_fits_no_photo_ends_the_run_soon(tmp_path: Path, mpsnet, rig: Path) -> None:
    shots(tmp_path / "shots", range(1, 8))
    command = ["estimate", tmp_path / "shots", "--rig", rig, "--model", "lambertian", "-o", tmp_path / "out"]
    small = write_file(tmp_path / "small.png", SPHERE.mask[:20], "uint8")
    for mask in (small, tmp_path / "none.png"):
        done = mpsnet(*command, "--mask", mask)
        assert done.returncode == 2 and done.stderr.count("\n") == 1
        assert done.stderr.startswith("mpsnet: all 3 that were tried failed; the first: frame_0001.png: ")
        assert not (tmp_path / "out").exists()


def test_a_cancelled_run_keeps_what_was_estimated(tmp_path: Path) -> None:
    photos = shots(tmp_path / "shots", range(1, 9))

    def stop(fraction: float, message: str) -> None:
        if fraction >= 0.5:
            raise Cancelled

    with pytest.raises(Cancelled):
        run(photos, tmp_path / "out", progress=stop)
    assert listing(tmp_path / "out") == [f"frame_{number:04d}_normals.png" for number in range(1, 5)]
    assert run(photos, tmp_path / "out").there == 4


# --- masks by number --------------------------------------------------------------------------------------------------


def test_masks_go_with_frames_by_their_numbers(tmp_path: Path) -> None:
    photos = shots(tmp_path / "shots", [9, 10, 11])
    (tmp_path / "masks").mkdir()
    halves = {number: SPHERE.mask & (np.arange(48) > number * 2) for number in (8, 9, 10, 11)}
    for number, half in halves.items():
        write_file(tmp_path / "masks" / f"m{number}.png", half, "uint8")
    for given in (tmp_path / "masks", tmp_path / "masks" / "m*.png"):
        run(photos, tmp_path / "out", masks=frame_masks(str(given)))
        for number in (9, 10, 11):
            found = read_normals(tmp_path / "out" / f"frame_{number:04d}_normals.png")
            np.testing.assert_array_equal(found.mask, halves[number])
    os.utime(tmp_path / "masks" / "m9.png", ns=(1, 1))  # which makes it no other mask
    write_file(tmp_path / "masks" / "m10.png", halves[9], "uint8")
    assert run(photos, tmp_path / "out", masks=frame_masks(str(given))).made == 1


# --- the command ------------------------------------------------------------------------------------------------------


@pytest.fixture
def rig(tmp_path: Path) -> Path:
    write_rig(tmp_path / "rig.json", SPHERE.rig)
    return tmp_path / "rig.json"


def sentences(done: "subprocess.CompletedProcess[str]") -> list[str]:
    """What went wrong: the lines on stderr that are no notes."""
    return [line.removeprefix("mpsnet: ") for line in done.stderr.splitlines() if line.startswith("mpsnet: ")]


def result(done: "subprocess.CompletedProcess[str]") -> dict[str, Any]:
    assert (done.returncode, done.stderr) == (0, "")
    return json.loads(done.stdout.splitlines()[-1])["result"]


def test_results_in_the_photos_folder_are_no_photos(tmp_path: Path, mpsnet, rig: Path) -> None:
    """Whatever they are called: they say what they are."""
    photos = shots(tmp_path, [1, 2])
    command = ["estimate", "--rig", rig, "--model", "lambertian"]
    mpsnet(*command, photos[0], "-o", tmp_path / "relief.png", "--confidence", tmp_path / "sure.exr")
    mpsnet("mask", photos[0], "-o", tmp_path / "cut.png", "--overlay", tmp_path / "shown.tif")
    made = ["--height", tmp_path / "h.tif", "--curvature", tmp_path / "c.png", "--relit", tmp_path / "r.png"]
    mpsnet("integrate", tmp_path / "relief.png", *made)
    mpsnet("superpose", photos[1], "-o", tmp_path / "third.exr")  # a photo
    told = result(mpsnet(*command, tmp_path, "-o", tmp_path / "out", "--progress", "json"))
    assert told["made"] == 3 and not told.get("failed")
    [note] = [note for note in told["notes"] if "results of this program" in note]
    assert note.startswith("8 file(s)") and "c.png, cut.png" in note


def test_missing_frames_are_named_and_the_others_made(tmp_path: Path, mpsnet, rig: Path) -> None:
    shots(tmp_path / "shots", [1, 2, 3, 7, 9, 10])
    command = ["estimate", tmp_path / "shots", "--rig", rig, "--model", "lambertian", "-o", tmp_path / "out"]
    told = result(mpsnet(*command, "--smooth", "1", "--progress", "json"))
    assert "frame(s) 4 to 6, 8 missing; the others are estimated" in told["notes"]
    assert (told["first"], told["count"], told["made"], told["there"]) == (1, 6, 6, 0)
    assert told["pattern"] == "frame_####_normals.png"
    assert told["folder"] == str(tmp_path / "out")
    again = result(mpsnet(*command, "--smooth", "1", "--progress", "json"))
    assert (again["made"], again["there"]) == (0, 6)


def test_an_object_that_was_found_is_looked_for_in_every_frame(tmp_path: Path, mpsnet, rig: Path) -> None:
    """Also where it hardly differs from its background; where it is gone the frame is left out, not taken whole."""
    sphere, noise = shaded_sphere(120, albedo=[0.2] * 3), np.random.default_rng(1).normal(size=(200, 200, 3))
    for number, (level, well) in enumerate(((0.003, 8000), (0.15, 300), (0.15, 1e9)), 1):
        light = np.full(noise.shape, level)
        if number < 3:
            light[40:160, 40:160][sphere.mask] = sphere.image[sphere.mask]
        write_file(tmp_path / f"frame_{number}.png", (light + noise * np.sqrt(light / well)).clip(0, 1), "uint16")
    outputs = [tmp_path / "out" / f"frame_{number}_normals.png" for number in (1, 2, 3)]
    command = ["estimate", tmp_path / "frame_#.png", "--rig", rig, "--model", "lambertian", "--encoding", "linear"]
    told = result(mpsnet(*command, "--progress", "json", "-o", tmp_path / "out"))
    assert [output.exists() for output in outputs] == [True, True, False]
    assert [read_normals(one).mask.mean() < 0.4 for one in outputs[:2]] == [True, True]
    assert any("frame_3.png: no object stands out" in note for note in told["notes"])
    # Photos that are no sequence are each on their own.
    for number in (1, 2):
        (tmp_path / f"frame_{number}.png").rename(tmp_path / f"{'ab'[number - 1]}.png")
    mpsnet(command[0], tmp_path / "a.png", tmp_path / "b.png", *command[2:], "-o", tmp_path / "apart")
    masks = [read_normals(tmp_path / "apart" / f"{name}_normals.png").mask for name in "ab"]
    assert masks[0].mean() < 0.4 and masks[1].all()


@pytest.mark.parametrize("smooth", ["0", "2"])
def test_frames_without_an_object_are_left_out_and_the_others_made(tmp_path, mpsnet, rig: Path, smooth: str) -> None:
    """As if they were missing: at the beginning, within, and where an earlier run made something of it."""
    photos = shots(tmp_path / "shots", range(1, 8))
    command = ["estimate", tmp_path / "shots", "--rig", rig, "--model", "lambertian", "--smooth", smooth]
    result(mpsnet(*command, "--progress", "json", "-o", tmp_path / "out"))
    for number in (1, 4, 5):
        write_file(photos[number - 1], np.dstack([picture(number), 0 * SPHERE.mask]), "uint8")
    told = result(mpsnet(*command, "--progress", "json", "-o", tmp_path / "out"))
    made = [f"frame_{number:04d}_normals.png" for number in (2, 3, 6, 7)]
    assert listing(tmp_path / "out") == made
    assert (told["first"], told["last"], told["count"], told["left_out"]) == (2, 7, 4, 3)
    assert told["first_output"] == str(tmp_path / "out" / made[0])
    named = [note.partition(":")[0] for note in told["notes"] if note.endswith("; this frame is left out")]
    assert named == [f"frame_000{number}.png" for number in (1, 4, 5)]
    again = mpsnet(*command, "-o", tmp_path / "out")
    assert again.stdout.endswith("0 made, 4 there already, 3 left out\n")
    for number in (1, 4, 5):
        photos[number - 1].unlink()
    mpsnet(*command, "-o", tmp_path / "missing")
    assert listing(tmp_path / "missing") == made
    for name in made:
        without, missing = (read_normals(tmp_path / folder / name) for folder in ("out", "missing"))
        np.testing.assert_array_equal(without.vectors, missing.vectors)


def test_an_empty_frame_costs_no_file_of_somebody_elses_and_a_wrong_mask_none_at_all(tmp_path, mpsnet, rig: Path):
    photos = shots(tmp_path / "shots", range(1, 4))
    command = ["estimate", tmp_path / "shots", "--rig", rig, "--model", "lambertian", "-o", tmp_path / "out"]
    mpsnet(*command)
    write_file(photos[0], np.dstack([picture(1), 0 * SPHERE.mask]), "uint8")
    write_file(tmp_path / "out" / "frame_0001_normals.png", np.full((8, 8, 3), 0.5), "uint8")  # as retouched
    before = {file: (tmp_path / "out" / file).read_bytes() for file in listing(tmp_path / "out")}
    black = write_file(tmp_path / "black.png", 0 * SPHERE.mask, "uint8")
    assert mpsnet(*command, "--mask", black).returncode == 2
    mpsnet(*command)
    assert {file: (tmp_path / "out" / file).read_bytes() for file in listing(tmp_path / "out")} == before


def test_settings_and_files_that_matter_make_frames_again(tmp_path: Path, mpsnet, rig: Path) -> None:
    shots(tmp_path / "shots", [1, 2])
    command = ["estimate", tmp_path / "shots", "--rig", rig, "-o", tmp_path / "out", "--progress", "json"]

    def made(*options: str) -> int:
        return result(mpsnet(*command, *options))["made"]

    assert made("--model", "lambertian") == 2
    assert made("--model", "lambertian", "--threads", "1") == 0
    assert made("--model", "lambertian-grey-world") == 2
    assert made("--model", "lambertian-grey-world", "--encoding", "linear") == 2
    rig.write_text(rig.read_text().replace("\n}", ',\n  "mixing": [[1, 0.1, 0], [0, 1, 0], [0, 0, 1]]\n}'))
    assert made("--model", "lambertian-grey-world", "--encoding", "linear") == 2


@pytest.mark.parametrize("name", ["normals", "png", "alpha"])
def test_a_relative_output_that_is_not_there_yet_is_gone_on_from(tmp_path, monkeypatch, mpsnet, rig: Path, name: str):
    """Its name may also be the value of an option, which must not be taken for a file once the folder is there."""
    monkeypatch.chdir(tmp_path)
    shots(tmp_path / "shots", [1, 2])
    command = ["estimate", "shots", "--rig", rig, "--model", "lambertian", "--mask", "alpha"]
    command += ["-o", name, "--progress", "json"]
    assert [result(mpsnet(*command))["made"] for _ in range(2)] == [2, 0]


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["a.png", "b.png", "--smooth", "1"], "--smooth takes the frames of one sequence"),
        (["a.png", "b.png", "--mask", "masks"], "masks takes the frames of one sequence"),
        (["s_1.png", "s_2.png", "--mask", "masks"], "masks has no mask for frame 1; add it, or give one mask for all"),
        (["s_1.png", "s_2.png", "--confidence", "c.png"], "--confidence takes one photo at a time"),
    ],
)
def test_what_a_sequence_cannot_be_asked(tmp_path, monkeypatch, mpsnet, rig: Path, arguments: list[str], words: str):
    monkeypatch.chdir(tmp_path)
    for name in ("a.png", "b.png", "s_1.png", "s_2.png"):
        write_file(tmp_path / name, picture(1), "uint8")
    (tmp_path / "masks").mkdir()
    for name in ("m_2.png", "m_3.png"):
        write_file(tmp_path / "masks" / name, SPHERE.mask, "uint8")
    done = mpsnet("estimate", *arguments, "--rig", rig, "-o", tmp_path / "out")
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1 and words in done.stderr, done.stderr
    assert not (tmp_path / "out").exists()


@pytest.mark.parametrize("option", ["--dark", "--flat", "--mask"])
@pytest.mark.parametrize("several", [False, True], ids=["one photo", "frames"])
def test_a_layer_is_taken_of_every_photo(tmp_path: Path, mpsnet, rig: Path, option: str, several: bool) -> None:
    """Of the dark frame, flat field and background too, where they have more than one; B would spoil the normals."""
    (tmp_path / "shots").mkdir()
    wide = ((16, 16), (16, 16), (0, 0))
    photo, normals, lit = np.pad(SPHERE.image, wide), np.pad(SPHERE.normals, wide), np.pad(SPHERE.lit, 16)
    ones, given = np.ones(photo.shape), f"{'background:' * (option == '--mask')}{tmp_path / 'with.exr'}"
    background = {"--dark": 0.05 * ones, "--flat": 0.5 * ones, "--mask": 0 * ones}[option]
    spoilt = ones * np.linspace(0.1, 1, 80)[:, None, None]
    for name, values in (("with", background), ("shots/frame_1", photo + background * (option == "--dark"))):
        layers = {**named("A.", "RGB", values), **named("B.", "RGB", spoilt)}
        write_parts(tmp_path / f"{name}.exr", [(None, layers)])
    photos = tmp_path / "shots" if several else tmp_path / "shots" / "frame_1.exr"
    command = ["estimate", photos, "--rig", rig, "--model", "lambertian", "--layer", "A", option, given]
    told = result(mpsnet(*command, "-o", tmp_path / "normals.exr", "--progress", "json"))
    assert told["outputs"] == [str(tmp_path / "normals.exr")]
    found = read_normals(tmp_path / "normals.exr")
    assert np.median(degrees_between(found.vectors, normals)[lit]) < 0.1
    write_file(tmp_path / "with.exr", background, "float")
    result(mpsnet(*command, "-o", tmp_path / "again.exr", "--progress", "json"))
    np.testing.assert_array_equal(read_normals(tmp_path / "again.exr").vectors, found.vectors)


@pytest.mark.parametrize("given", ["", "frame_####.png"], ids=["folder", "pattern"])
def test_one_frame_of_a_folder_or_pattern_is_a_sequence(tmp_path: Path, mpsnet, rig: Path, given: str) -> None:
    shots(tmp_path / "shots", [7])
    (tmp_path / "masks").mkdir()
    half = SPHERE.mask & (np.arange(48) > 20)
    for number, mask in ((7, half), (8, SPHERE.mask)):
        write_file(tmp_path / "masks" / f"m{number}.png", mask, "uint8")
    command = ["estimate", tmp_path / "shots" / given, "--rig", rig, "--model", "lambertian", "--progress", "json"]
    command += ["--mask", tmp_path / "masks", "--smooth", "1", "-o"]
    for made in (1, 0):
        told = result(mpsnet(*command, tmp_path / "out"))
        assert (told["made"], told["first"], told["count"]) == (made, 7, 1)
        assert told["first_output"] == str(tmp_path / "out" / "frame_0007_normals.png")
    np.testing.assert_array_equal(read_normals(Path(told["first_output"])).mask, half)
    told = result(mpsnet(*command, tmp_path / "normals.exr"))  # a file, too, as of one photo
    assert (told["made"], told["outputs"]) == (1, [str(tmp_path / "normals.exr")])
    np.testing.assert_array_equal(read_normals(tmp_path / "normals.exr").mask, half)
