"""A photo is read alike wherever it comes in: the same file gives the same pixels and the same note everywhere."""

import contextlib
import logging
import shutil
from collections.abc import Callable, Iterator
from dataclasses import dataclass
from importlib.util import find_spec
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from dng import mosaic, write_dng
from mesh_file import write_mesh
from surface_shapes import sphere_mesh
from synthetic import shaded_sphere, write_file

from mpsnet_core import (
    Align,
    BakeViews,
    CalibrateMixing,
    Capture,
    Check,
    Estimate,
    MakeMaterial,
    Superpose,
    WriteCameras,
)
from mpsnet_core.capture.open import read_capture
from mpsnet_core.errors import InputError
from mpsnet_core.io.image import Image, linear_to_srgb, srgb_to_linear
from mpsnet_core.scene.camera import Camera, write_camera
from mpsnet_core.scene.rig import read_rig, write_rig

SIDE = 96
# Not square, and not symmetric: a photo that is turned differs.
SPHERE = shaded_sphere(SIDE)
LIGHT = np.pad(0.9 * SPHERE.image, ((0, 0), (0, 40), (0, 0)))


def tagged(path: Path, values: np.ndarray, kind: str, space: str = "unknown", orientation: int = 1) -> Path:
    """A file whose stored values are `values` as shown upright."""
    stored = {1: values, 3: values[::-1, ::-1], 6: np.rot90(values)}[orientation]
    spec = oiio.ImageSpec(stored.shape[1], stored.shape[0], 3, kind)
    for name, value in (("oiio:ColorSpace", space), ("Orientation", orientation), ("Compression", "jpeg:100")):
        if name != "Compression" or path.suffix == ".jpg":
            spec.attribute(name, value)
    target = oiio.ImageOutput.create(str(path))
    assert target.open(str(path), spec) and target.write_image(np.ascontiguousarray(stored, np.float32))
    assert target.close()
    return path


def raw(folder: Path) -> Path:
    return write_dng(folder / "photo_1.dng", np.rint(65535 * mosaic(LIGHT)))


KINDS: dict[str, tuple[Callable[[Path], Path], str, float]] = {
    "linear PNG that says nothing": (
        lambda folder: tagged(folder / "photo_1.png", LIGHT, "uint16"), "READ AS LINEAR", 1e-3,
    ),
    "sRGB TIFF that says nothing": (
        lambda folder: tagged(folder / "photo_1.tif", linear_to_srgb(LIGHT), "uint8"), "read as sRGB", 0.01,
    ),
    "PNG that says sRGB": (
        lambda folder: tagged(folder / "photo_1.png", linear_to_srgb(LIGHT), "uint16", "sRGB"), "read as sRGB", 1e-3,
    ),
    "turned JPEG": (
        lambda folder: tagged(folder / "photo_1.jpg", linear_to_srgb(LIGHT), "uint8", "sRGB", 6), "read as sRGB", 0.01,
    ),
    "JPEG upside down": (
        lambda folder: tagged(folder / "photo_1.jpg", linear_to_srgb(LIGHT), "uint8", "sRGB", 3), "read as sRGB", 0.01,
    ),
    "EXR": (lambda folder: write_file(folder / "photo_1.exr", LIGHT, "float"), "read as linear", 1e-6),
    **({"camera raw": (raw, "read as camera raw", 0.01)} if find_spec("rawpy") else {}),
}  # fmt: skip


@dataclass
class Desk:
    """A folder with a photo and what each workflow needs besides."""

    folder: Path
    photo: Path

    def __truediv__(self, name: str) -> Path:
        return self.folder / name

    @property
    def rig(self) -> str:
        return str(self / "rig.json")

    @property
    def mask(self) -> str:
        return str(self / "mask.png")

    @property
    def shots(self) -> Path:
        """A folder with a copy of the photo."""
        (self / "shots").mkdir()
        shutil.copy(self.photo, self / "shots")
        return self / "shots"


def alone(desk: Desk) -> None:
    Estimate(image=(str(desk.photo),), rig=desk.rig, mask=desk.mask, output=str(desk / "n.png")).run()


def in_a_folder(desk: Desk) -> None:
    """Beside a photo that says how it is meant."""
    tagged(desk.shots / "zoo.png", linear_to_srgb(LIGHT), "uint8", "sRGB")
    Estimate(image=(str(desk / "shots"),), rig=desk.rig, mask=desk.mask, output=str(desk / "out")).run()


def as_a_frame(desk: Desk) -> None:
    """Of two that are alike."""
    shutil.copy(desk.photo, desk.shots / desk.photo.name.replace("1", "2"))
    Estimate(image=(str(desk / "shots"),), rig=desk.rig, mask=desk.mask, smooth=1, output=str(desk / "out")).run()


def as_a_view(desk: Desk) -> None:
    pose = np.eye(4)
    pose[2, 3] = 5
    camera = Camera("perspective", LIGHT.shape[1], SIDE, (400, 400), world_from_camera=pose)
    write_camera(desk.shots / "photo_1.camera.json", camera)
    write_mesh(desk / "mesh.npz", sphere_mesh(24, 12))
    given = {"cameras": str(desk / "shots"), "photos": str(desk / "shots"), "mesh": (str(desk / "mesh.npz"),)}
    BakeViews(**given, rig=desk.rig, mask=desk.mask, model="lambertian", size=16, output=str(desk / "t.png")).run()


def as_a_material(desk: Desk) -> None:
    MakeMaterial(image=str(desk.photo), rig=desk.rig, pixel_size="0.1mm", output=str(desk / "material")).run()


def as_a_calibration_photo(desk: Desk) -> None:
    circle = (f"{SIDE / 2},{SIDE / 2},{SIDE / 2 - 1}",)
    CalibrateMixing(photo=(str(desk.photo),), rig=desk.rig, circle=circle, output=str(desk / "found.json")).run()


def to_be_aligned(desk: Desk) -> None:
    write_mesh(desk / "mesh.npz", sphere_mesh(24, 12))
    mesh, output = str(desk / "mesh.npz"), str(desk / "found.camera.json")
    Align(image=str(desk.photo), mesh=mesh, rig=desk.rig, mask=desk.mask, model="lambertian", output=output).run()


def to_be_checked(desk: Desk) -> None:
    Check(image=str(desk.photo), rig=desk.rig, mask=desk.mask).run()


def from_python(desk: Desk) -> None:
    read_capture(desk.photo, read_rig(desk.rig), mask=desk.mask)


WAYS = (
    alone, in_a_folder, as_a_frame, as_a_view, as_a_material, as_a_calibration_photo, to_be_aligned, to_be_checked,
)  # fmt: skip


class Enough(InputError):
    """The photo is open, and the work that begins then takes its time."""


@pytest.fixture
def opened(monkeypatch: pytest.MonkeyPatch) -> Iterator[list[np.ndarray]]:
    """The pixels of the first photo that becomes a capture, or is measured; nothing is done with it then."""
    seen: list[np.ndarray] = []

    def note(image: Image | Capture, *_: object, **__: object) -> None:
        seen.append(np.array(image.image if isinstance(image, Capture) else image.pixels))
        raise Enough("enough")

    monkeypatch.setattr(Capture, "__post_init__", note)
    monkeypatch.setattr("mpsnet_core.calibrate.mixing.mixing_from_ball", note)
    monkeypatch.setattr("mpsnet_core.capture.commands.check_photo", note)
    yield seen


@pytest.mark.parametrize("way", WAYS, ids=lambda way: way.__name__)
@pytest.mark.parametrize("kind", KINDS)
def test_the_same_file_gives_the_same_pixels_and_the_same_note(
    tmp_path: Path, opened: list[np.ndarray], caplog: pytest.LogCaptureFixture, kind: str, way: Callable[[Desk], None]
) -> None:
    write, words, tolerance = KINDS[kind]
    write_rig(tmp_path / "rig.json", SPHERE.rig)
    write_file(tmp_path / "mask.png", np.pad(SPHERE.mask, ((0, 0), (0, 40))), "uint8")
    caplog.set_level(logging.INFO, "mpsnet_core")
    desk = Desk(tmp_path, write(tmp_path))
    with contextlib.suppress(InputError):
        from_python(desk)
    expected = opened.pop()
    assert np.abs(expected - LIGHT).mean() < tolerance
    caplog.clear()
    with contextlib.suppress(InputError):
        way(desk)
    np.testing.assert_array_equal(opened[0], expected)
    told = [record.getMessage() for record in caplog.records if "transfer-curve" in record.getMessage()]
    assert any(words in record.getMessage() for record in caplog.records)
    assert [note.split()[0] for note in told] == [f"photo_1{KINDS[kind][0](tmp_path).suffix}"] * (
        words == "READ AS LINEAR"
    )


def channels(desk: Desk, suffix: str) -> str:
    """Each light's photo is grey."""
    grey = [tagged(desk / f"{k}.png", LIGHT[..., [k] * 3], "uint16") for k in range(3)]
    Superpose(image=tuple(map(str, grey)), channels=True, output=str(desk / f"sum{suffix}")).run()
    return f"sum{suffix}"


def added_up(desk: Desk, suffix: str) -> str:
    apart = [tagged(desk / f"{k}.png", LIGHT * np.eye(3)[k], "uint16") for k in range(3)]
    Superpose(image=tuple(map(str, apart)), output=str(desk / f"sum{suffix}")).run()
    return f"sum{suffix}"


def without_lens(desk: Desk, suffix: str) -> str:
    """By a lens that hardly distorts."""
    tagged(desk / "photo.png", LIGHT, "uint16")
    height, width = LIGHT.shape[:2]
    (desk / "cameras.txt").write_text(f"1 OPENCV {width} {height} 400 400 {width / 2} {height / 2} 1e-7 0 0 0\n")
    (desk / "images.txt").write_text("1 1 0 0 0 0 0 5 1 photo.png\n\n")
    WriteCameras(cameras=str(desk.folder), photos=str(desk.folder), output=str(desk / "out")).run()
    return "out/photo.exr"


@pytest.mark.parametrize(
    ("made", "suffix"),
    [(channels, ".exr"), (channels, ".png"), (added_up, ".exr"), (added_up, ".tif"), (without_lens, "")],
)
def test_what_photos_do_not_state_is_not_stated_by_what_is_made_of_them(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, made: Callable[[Desk, str], str], suffix: str
) -> None:
    """They hold linear values, and were read as sRGB. The rig tells, which only the next step knows."""
    photo = tmp_path / made(Desk(tmp_path, tmp_path), suffix)
    write_file(tmp_path / "mask.png", np.pad(SPHERE.mask, ((0, 0), (0, 40))), "uint8")
    caplog.clear()
    found = read_capture(photo, SPHERE.rig, mask=tmp_path / "mask.png").image
    assert "READ AS LINEAR" in caplog.text
    inside = np.pad(SPHERE.mask, ((0, 0), (0, 40)))
    inside &= ~np.pad(~inside, 3)[6:, 6:] & ~np.pad(~inside, 3)[:-6, :-6]  # a lens blurs the outline
    assert np.abs(found - LIGHT)[inside].max() < 0.002
    for encoding, expected in (("linear", LIGHT), ("srgb", srgb_to_linear(LIGHT))):
        stated = read_capture(photo, SPHERE.rig, mask=tmp_path / "mask.png", encoding=encoding).image
        assert np.abs(stated - expected)[inside].max() < 0.002
