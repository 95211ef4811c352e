"""Flat materials against surfaces that are known by formula, and against plain crops, which have seams."""

import json
from dataclasses import replace

import numpy as np
import pytest
from flat_weave import Weave
from swatches import leather, photographed, woven
from synthetic import CROSSTALK, degrees_between

from mpsnet_core import Camera, Capture, InputError, MakeMaterial, NormalMap, estimate_normals, read_image, write_image
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.cli import main
from mpsnet_core.io.image_reading import read_channel
from mpsnet_core.relief.material.flatten import (
    estimated_albedo,
    flatten_albedo,
    flatten_normals,
    normals_of,
    periodic_height,
)
from mpsnet_core.relief.material.material import crop_to_filled_part, flat_material
from mpsnet_core.relief.material.material_files import normals_by_photo
from mpsnet_core.scene.normal_encoding import read_vectors
from mpsnet_core.scene.rig import LightRig, published_rig, write_rig

# --- laid flat --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("axis", [(1.0, 0.0), (0.6, -0.8)])
def test_a_tilt_of_the_photo_is_taken_out(axis):
    """The weave's normals turned by 7° about an axis in the picture."""
    weave = Weave()
    x, y = axis
    angle = np.radians(7)
    turn = np.array([[0, 0, y], [0, 0, -x], [-y, x, 0]])
    turn = np.eye(3) + np.sin(angle) * turn + (1 - np.cos(angle)) * turn @ turn
    gradients, tilt = flatten_normals((weave.normals @ turn.T).astype(np.float32), 0)
    assert tilt == pytest.approx(7, abs=0.2)
    assert degrees_between(normals_of(gradients), weave.normals).mean() < 0.3


def test_slow_bend_is_taken_out_and_detail_stays():
    weave = Weave()
    rows, columns = np.linspace(-1, 1, 260)[:, None], np.linspace(-1, 1, 330)
    bend = np.stack([0.3 * columns**3 + 0.2 * rows, 0.25 * rows**2 * columns], axis=-1)
    bent = normals_of((weave.gradients + bend).astype(np.float32))
    assert degrees_between(bent, weave.normals).mean() > 7
    gradients, _ = flatten_normals(bent, 4)
    assert degrees_between(normals_of(gradients), weave.normals).mean() < 1
    untouched, _ = flatten_normals(weave.normals.astype(np.float32), 4)
    assert degrees_between(normals_of(untouched), weave.normals).mean() < 0.3


# --- albedo -----------------------------------------------------------------------------------------------------------


def patches(shape):
    """(H, W, 3) an albedo of coloured patches."""
    rows, columns = np.indices(shape)
    chosen = (rows // 40 + columns // 50) % 3
    return np.array([(0.7, 0.4, 0.2), (0.3, 0.5, 0.25), (0.2, 0.25, 0.6)])[chosen]


def test_with_the_true_normals_the_albedo_is_true():
    weave = Weave()
    truth = patches(weave.shape)
    found = estimated_albedo(weave.capture(truth), weave.normals.astype(np.float32))
    assert np.abs(found - truth).max() < 1e-3
    grey = estimated_albedo(weave.capture(truth), weave.normals.astype(np.float32), grey=True)
    assert (grey == grey[..., :1]).all()


def test_mixing_is_undone():
    """Crosstalk spreads each light over all channels; of a grey material it can be undone."""
    weave = Weave()
    rig = LightRig(published_rig().directions, CROSSTALK)
    found = estimated_albedo(weave.capture(0.5, rig), weave.normals.astype(np.float32))
    assert np.abs(found - 0.5).max() < 1e-3


def test_what_a_light_does_not_reach_has_the_colour_of_the_whole():
    """Steep weave: attached shadows in each channel, and some pixels are saturated, too."""
    weave = Weave(amplitude_mm=1.6)
    colour = np.array([0.6, 0.4, 0.2])
    assert (weave.normals @ published_rig().directions.T < 0).any()
    capture = weave.capture(colour)
    clipped = np.zeros(capture.image.shape, bool)
    clipped[100:110, 100:110, 0] = True
    spoilt = replace(capture, image=np.where(clipped, 5, capture.image), clipped=clipped)
    found = estimated_albedo(spoilt, weave.normals.astype(np.float32))
    lit = (weave.normals @ published_rig().directions.T > 0.05).any(axis=-1)
    assert np.abs(found / colour - 1)[lit].max() < 0.05


def test_slow_changes_of_brightness_are_evened_out():
    truth = patches((260, 330)).astype(np.float32)
    fall_off = np.exp(0.5 * np.linspace(-1, 1, 330) - 0.4 * np.linspace(-1, 1, 260)[:, None] ** 2)[..., None]
    found = flatten_albedo((truth * fall_off).astype(np.float32), 4)
    ratio = found / flatten_albedo(truth, 4)
    assert np.ptp(ratio, axis=(0, 1)).max() < 0.02
    assert np.exp(np.log(found).mean(axis=(0, 1))) == pytest.approx(
        np.exp(np.log(truth * fall_off).mean(axis=(0, 1))), rel=1e-3
    )


# --- height -----------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("shape", [(64, 96), (63, 95)])
def test_heights_of_known_waves_are_exact_in_millimetres(shape):
    """A sum of waves that fit the tile; its slopes by formula; pixels that are not square."""
    pitch = 0.3, 0.2
    rows, columns = np.indices(shape) + 0.5
    height, gradients = np.zeros(shape), np.zeros((*shape, 2))
    for across, down, size, phase in [(3, 0, 1.0, 0.2), (2, -5, 0.4, 1.1), (0, 7, 0.2, 0.7), (11, 9, 0.1, 2.0)]:
        place = 2 * np.pi * (across * columns / shape[1] + down * rows / shape[0]) + phase
        height += size * np.sin(place)
        lengths = np.array([across / (shape[1] * pitch[0]), down / (shape[0] * pitch[1])])
        gradients += 2 * np.pi * size * np.cos(place)[..., None] * lengths
    assert np.abs(periodic_height((gradients + 0.3).astype(np.float32), pitch) - height).max() < 1e-4


# --- the whole --------------------------------------------------------------------------------------------------------


@pytest.mark.parametrize("degrees", [0.0, 2.0])
def test_a_weaves_tile_has_its_normals_heights_and_size(degrees):
    """A tilted photo by the image formation, normals by equation 2; truth by formula."""
    weave = Weave(degrees=degrees)
    capture = weave.capture(0.6)
    material = flat_material(capture, estimate_normals(capture, "lambertian"), weave.pixel_mm)
    assert np.abs(material.albedo - 0.6).max() < 0.03
    # Heights: as high, and everywhere a place of the weave, whose mean height is 0.
    assert material.height.std() == pytest.approx(weave.height.std(), rel=0.03)
    assert np.ptp(material.height) == pytest.approx(np.ptp(weave.height), rel=0.05)
    # The tile's sides are whole numbers of periods, in millimetres.
    for length, step in ((material.width_mm, material.tiling.right), (material.height_mm, material.tiling.down)):
        assert length == pytest.approx(np.linalg.norm(step) * weave.pixel_mm)
        periods = weave.axes @ step / weave.period
        assert np.abs(periods - np.round(periods)).max() < 0.02
    # Normals and heights say the same: normals from heights by central differences, which wrap.
    rows, columns = material.height.shape
    pitch = material.width_mm / columns, material.height_mm / rows
    gradients = [(np.roll(material.height, -1, a) - np.roll(material.height, 1, a)) / 2 for a in (1, 0)]
    from_height = normals_of(np.stack([gradients[0] / pitch[0], gradients[1] / pitch[1]], axis=-1).astype(np.float32))
    assert degrees_between(from_height, material.normals).mean() < 1
    steepness = np.degrees(np.arccos(weave.normals[..., 2])).mean()
    assert np.degrees(np.arccos(material.normals[..., 2])).mean() == pytest.approx(steepness, rel=0.05)
    # A convex place of the weave is its top.
    assert np.corrcoef(material.curvature.ravel(), material.height.ravel())[0, 1] > 0.9


def steps(values, axis):
    """(mean across the tile's border, mean over all other lines) of the change to the next pixel along an axis."""
    change = np.abs(np.roll(values, -1, axis) - values)
    change = change.reshape(*values.shape[:2], -1).mean(axis=(1 - axis, 2))
    return change[-1], change[:-1].mean()


MAPS = ("normals", "height", "albedo", "curvature")


@pytest.mark.parametrize("make", [leather, woven])
def test_a_material_that_does_not_fit_its_frame_repeats_without_a_seam(make):
    swatch = make((300, 360), 0.2, seed=4)
    photo = photographed(swatch, published_rig(), tilt=(0.05, -0.03), noise=0.003)
    capture = Capture(photo, np.ones((300, 360), bool), published_rig())
    normals = estimate_normals(capture, "lambertian-grey-world")
    material = flat_material(capture, normals, 0.2)
    for name in MAPS:
        for axis in (0, 1):
            across, within = steps(getattr(material, name), axis)
            assert across < 1.3 * within, (name, axis, across / within)
    assert max(material.seam.border) < 1.3 and max(material.seam.cut) < 1.3
    # The test can see seams: the same pixels, cut out of the photo as they are.
    rows, columns = material.height.shape
    plain = normals.vectors[:rows, :columns]
    assert all(np.divide(*steps(plain, axis)) > 1.6 for axis in (0, 1))


def test_the_size_asked_for_changes_pixels_and_not_the_material():
    weave = Weave(degrees=1.0)
    capture = weave.capture(patches(weave.shape))
    found = [flat_material(capture, weave.normal_map(), weave.pixel_mm, size=size) for size in (None, 128, 512)]
    for material in found[1:]:
        assert material.height.shape == material.normals.shape[:2] == material.albedo.shape[:2]
        assert material.height.shape[0] == material.height.shape[1]
        assert (material.width_mm, material.height_mm) == (found[0].width_mm, found[0].height_mm)
        assert material.height.std() == pytest.approx(found[0].height.std(), rel=0.03)
    assert [material.height.shape[0] for material in found[1:]] == [128, 512]


@pytest.mark.parametrize("side", [64, 90, 120, 160])
@pytest.mark.parametrize("overlap", [0.05, 0.2])
def test_of_a_small_photo_all_is_used_or_it_is_refused(side, overlap):
    values = np.random.default_rng(3).normal(size=(side, side, 3)).astype(np.float32) * np.float32(0.1)
    values[..., 2] = 1
    vectors = values / np.linalg.norm(values, axis=-1, keepdims=True)
    rig, whole = published_rig(), np.ones((side, side), bool)
    capture = Capture(0.5 * vectors @ rig.directions.T.astype(np.float32), whole, rig)
    if round(overlap * side / (1 + overlap)) < 5:
        with pytest.raises(InputError, match="choose a larger overlap, size or photo"):
            flat_material(capture, NormalMap(vectors, whole), 0.2, overlap=overlap)
        return
    material = flat_material(capture, NormalMap(vectors, whole), 0.2, overlap=overlap, bend=0)
    assert side - 2 <= len(material.height) * (1 + overlap) <= side


def test_a_part_of_the_photo_keeps_its_place_under_the_camera():
    weave = Weave()
    camera = Camera("perspective", 330, 260, np.array([500.0, 500.0]))
    part = crop_to_filled_part(weave.capture(camera=camera), (30, 20, 200, 100))
    assert part.image.shape == (100, 200, 3)
    rays, _ = np.split(camera.points(np.ones((260, 330))), [2], axis=-1)
    cut, _ = np.split(part.camera.points(np.ones((100, 200))), [2], axis=-1)
    assert np.allclose(cut, rays[20:120, 30:230])


# --- the command line -------------------------------------------------------------------------------------------------


@pytest.fixture
def photo(tmp_path):
    weave = Weave()
    write_image(tmp_path / "weave.exr", weave.capture(0.6).image)
    write_rig(tmp_path / "rig.json", published_rig())
    return weave


def run(folder, *arguments):
    given = ["--rig", folder / "rig.json", "--model", "lambertian", *arguments]
    return main(["material", str(folder / "weave.exr"), *map(str, given)])


def test_the_files_say_what_they_measure(photo, tmp_path):
    assert run(tmp_path, "--model", "auto", "--width", "66mm", "-o", tmp_path / "out") == 0
    told = json.loads((tmp_path / "out" / "weave_material.json").read_text())
    files = {what: tmp_path / "out" / name for what, name in told["files"].items()}
    assert {file.name for file in (tmp_path / "out").iterdir()} == {
        "weave_material.json",
        *(file.name for file in files.values()),
    }
    grey, exact = read_channel(files["height"]), read_channel(files["height_mm"])
    black, white = told["height_of_black_mm"], told["height_of_white_mm"]
    assert np.abs(black + grey * (white - black) - exact).max() < 1e-4 * (white - black)
    assert np.ptp(exact) == pytest.approx(np.ptp(photo.height), rel=0.05)
    assert told["width_mm"] == pytest.approx(told["pixels"][0] * photo.pixel_mm, rel=0.01)
    normals = normalised(read_vectors(files["normal"])[0])
    gradients = np.gradient(exact, told["height_mm"] / told["pixels"][1], told["width_mm"] / told["pixels"][0])
    vectors = np.stack([-gradients[1], gradients[0], np.ones_like(exact)], axis=-1)
    assert degrees_between(normals, vectors)[1:-1, 1:-1].mean() < 1
    assert read_image(files["albedo"]).pixels.mean() == pytest.approx(0.6, abs=0.02)
    # The preview is three by three of the same.
    preview = read_image(files["preview"]).pixels
    high, wide = preview.shape[0] // 3, preview.shape[1] // 3
    assert np.array_equal(preview[:high, :wide], preview[high : 2 * high, 2 * wide :])


def test_all_three_ways_to_tell_the_size_tell_the_same(photo, tmp_path):
    ways = {"a": ("--width", "6.6cm"), "b": ("--pixel-size", "0.2mm"), "c": ("--ruler", "10,20,40,60=0.01m")}
    for name, way in ways.items():
        assert run(tmp_path, *way, "--size", "64", "--name", name, "-o", tmp_path) == 0
    told = [json.loads((tmp_path / f"{name}_material.json").read_text()) for name in ways]
    assert told[0]["width_mm"] == pytest.approx(told[1]["width_mm"]) == pytest.approx(told[2]["width_mm"])


def test_made_again_it_takes_the_place_of_its_own_pictures_and_of_no_others(photo, tmp_path, capfd):
    made = ["--width", "66mm", "-o", tmp_path / "out"]
    assert run(tmp_path, *made, "--size", "64") == 0 == run(tmp_path, *made, "--size", "80")
    assert read_image(tmp_path / "out" / "weave_albedo.png").pixels.shape == (80, 80, 3)
    (tmp_path / "out" / "mine_albedo.png").write_bytes(b"painted")
    (tmp_path / "out" / "notes_material.json").write_text('{"format": "notes"}')
    capfd.readouterr()
    for name, foreign in (("mine", "mine_albedo.png"), ("notes", "notes_material.json")):
        before = (tmp_path / "out" / foreign).read_bytes()
        assert run(tmp_path, *made, "--name", name) == 2
        (line,) = capfd.readouterr().err.splitlines()
        assert f"the result would overwrite {tmp_path / 'out' / foreign}, which" in line
        assert (tmp_path / "out" / foreign).read_bytes() == before
        assert len(list((tmp_path / "out").glob(f"{name}_*"))) == 1


BAD = {
    "no scale": ([], "no option states the material's size; give one of --width, --pixel-size or --ruler"),
    "two scales": (["--width", "1m", "--pixel-size", "1mm"], "several options state the material's size"),
    "no unit": (["--width", "120"], "'120' is not a length; give a number and its unit"),
    "ruler of three": (["--ruler", "1,2,3=5mm"], "--ruler 1,2,3=5mm is not x1,y1,x2,y2=50mm"),
    "ruler beyond the photo": (["--ruler", "1,1,5000,1=5mm"], "its places are outside the photo, which is 330"),
    "crop of halves": (["--width", "1m", "--crop", "1.5,0,99,99"], "--crop 1.5,0,99,99 is not of whole pixels"),
    "crop outside": (["--width", "1m", "--crop", "300,0,100,100"], "weave.exr: the crop of 100 x 100 pixels"),
    "crop too small": (["--width", "1m", "--crop", "0,0,63,200"], "63 x 200 pixels are too few for a material"),
    "overlap of few pixels": (
        ["--width", "1m", "--size", "64", "--overlap", "0.05"],
        "borders that overlap by 0.05 of the tile are joined over 3 pixels, and need 5; choose a larger overlap",
    ),
    "name with a folder": (["--width", "1m", "--name", "a/b"], "--name a/b is not a file name; give the folder"),
}


@pytest.mark.parametrize(("arguments", "words"), BAD.values(), ids=BAD)
def test_bad_input_gets_one_clear_sentence(photo, tmp_path, capfd, arguments, words):
    assert run(tmp_path, *arguments, "-o", tmp_path / "out") == 2
    (line,) = capfd.readouterr().err.splitlines()
    assert line.startswith("mpsnet: ") and words in line
    assert not (tmp_path / "out").exists()


def test_a_photo_that_is_not_filled_or_too_small_is_refused(tmp_path, capfd):
    weave = Weave()
    image = weave.capture(0.6).image
    write_rig(tmp_path / "rig.json", published_rig())
    seen = np.ones((260, 330, 1), np.float32)
    seen[:130] = 0
    write_image(tmp_path / "weave.exr", np.concatenate([image, seen], axis=-1))
    assert run(tmp_path, "--width", "66mm", "-o", tmp_path / "out") == 2
    assert "weave.exr: a flat material fills the photo, but 50.0% of it is transparent" in capfd.readouterr().err
    assert run(tmp_path, "--width", "66mm", "--crop", "0,130,330,130", "-o", tmp_path / "out") == 0
    write_image(tmp_path / "weave.exr", image[:50])
    assert run(tmp_path, "--width", "66mm", "-o", tmp_path / "small") == 2
    assert "330 x 50 pixels are too few for a material; take 64 or more" in capfd.readouterr().err


@pytest.mark.parametrize("make", [leather, woven])
@pytest.mark.parametrize("shine", [0.0, 0.25])
def test_the_model_of_materials_is_the_better_one_for_what_the_photo_shows(make, shine):
    """Brown, matt or with a sheen (Blinn and Phong), which no model is told."""
    swatch, rig = make((100, 120), 0.2, seed=4), published_rig()
    photo = photographed(replace(swatch, albedo=swatch.albedo * np.float32([0.6, 0.35, 0.2])), rig, noise=0.002)
    half = normalised(rig.directions + np.array([0, 0, 1]))
    light = np.maximum(swatch.normals @ rig.directions.T, 0)
    sheen = shine * np.maximum(swatch.normals @ half.T, 0) ** 20 * light
    capture = Capture((photo + sheen @ rig.mixing.T).astype(np.float32), np.ones(photo.shape[:2], bool), rig)
    options = MakeMaterial(image="swatch.exr", rig="rig.json", output="out")
    assert options.model == "auto"
    chosen, *others = (
        degrees_between(normals.vectors, swatch.normals).mean()
        for normals in (
            normals_by_photo(options, capture),
            *(estimate_normals(capture, model) for model in ("lambertian-grey-world", "multiscale")),
        )
    )
    assert chosen == min(others), others
    assert others[1] < 0.6 * others[0] if shine else others[0] < others[1]
