"""What images state on how they were made: software, command, settings, inputs; and nothing that differs by run."""

import hashlib
import json

import OpenImageIO as oiio
import pytest
from synthetic import shaded_sphere

from mpsnet_core import Estimate, FindMask, Superpose, published_rig, write_rig
from mpsnet_core.io.image_writing import write_image, write_mask


def stated(path):
    return json.loads(oiio.ImageBuf(str(path)).spec().getattribute("mpsnet:made"))


@pytest.mark.parametrize("suffix", [".png", ".exr"])
def test_an_image_states_its_making_and_two_runs_write_the_same_bytes(tmp_path, suffix):
    written = []
    for name in ("first", "second"):
        folder = tmp_path / name
        folder.mkdir()
        write_image(folder / "photo.exr", shaded_sphere(32).image)
        write_rig(folder / "rig.json", published_rig())
        made = folder / f"normals{suffix}"
        for _ in range(2):  # the second time in its own place
            Estimate(
                image=folder / "photo.exr",
                rig=folder / "rig.json",
                model="lambertian",
                mask="threshold:0.01",
                encoding="linear",
                output=made,
            ).run()
            written.append(made.read_bytes())
    assert len(set(written)) == 1
    told = stated(made)
    assert told["software"].startswith("mpsnet ") and told["command"] == "estimate"
    assert told["settings"] == {"model": "lambertian", "encoding": "linear"}
    hashes = {
        f"{file.name} {hashlib.blake2b(file.read_bytes()).hexdigest()[:32]}"
        for file in (folder / "photo.exr", folder / "rig.json")
    }
    assert set(told["inputs"]) == hashes
    write_image(folder / "plain.png", shaded_sphere(8).image)
    assert not oiio.ImageBuf(str(folder / "plain.png")).spec().getattribute("mpsnet:made")


def test_a_frame_states_no_other_frames(tmp_path):
    write_rig(tmp_path / "rig.json", published_rig())
    for number in (1, 2):
        write_image(tmp_path / f"photo_{number}.exr", shaded_sphere(32).image)
    Estimate(
        image=tmp_path / "photo_#.exr", rig=tmp_path / "rig.json", model="lambertian", output=tmp_path / "normals"
    ).run()
    frames = sorted((tmp_path / "normals").iterdir())
    assert len(frames) == 2 and stated(frames[0]) == stated(frames[1]) and "inputs" not in stated(frames[0])


def test_no_image_states_a_folder(tmp_path):
    for name in ("a", "b", "c"):
        write_image(tmp_path / f"{name}.exr", shaded_sphere(32).image)
    write_mask(tmp_path / "mask.png", shaded_sphere(32).mask)
    photos = [tmp_path / f"{name}.exr" for name in ("a", "b", "c")]
    Superpose(image=photos, output=tmp_path / "one.exr", encoding="linear").run()
    FindMask(image=photos[0], mask=tmp_path / "mask.png", output=tmp_path / "found.png").run()
    for name in ("one.exr", "found.png"):
        told = oiio.ImageBuf(str(tmp_path / name)).spec().getattribute("mpsnet:made")
        assert json.loads(told)["settings"] and str(tmp_path) not in told
