"""The door to image files. What is read was written by OpenImageIO directly; what is written is read by it directly."""

import os
import struct
import zlib
from collections.abc import Callable
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
import pytest
from bad_input import SPHERE, Bench, cut, gets_one_clear_sentence
from png_chunks import png_chunk, with_chunks
from synthetic import listing, named, write_file, write_parts

from mpsnet_core import InputError, SettingsError, write_image
from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.io.image_reading import image_layers, read_data, read_image, read_mask, read_size

# IEC 61966-2-1 by hand: stored value, linear value.
SRGB = {0.0: 0.0, 0.04: 0.04 / 12.92, 0.5: 0.2140411, 0.735357: 0.5, 1.0: 1.0}


@pytest.fixture
def colours() -> np.ndarray:
    return np.random.default_rng(7).random((5, 9, 3)).astype(np.float32)


def as_linear(stored: np.ndarray) -> np.ndarray:
    grid = np.linspace(0, 1, 4097)
    return np.interp(stored, grid, [v / 12.92 if v <= 0.04045 else ((v + 0.055) / 1.055) ** 2.4 for v in grid])


@pytest.mark.parametrize(
    ("suffix", "kind", "linear", "tolerance"),
    [
        (".png", "uint8", False, 0.5 / 255),
        (".png", "uint16", False, 0.5 / 65535),
        (".tif", "uint8", False, 0.5 / 255),
        (".tif", "uint16", False, 0.5 / 65535),
        (".tif", "float", True, 0),
        (".exr", "half", True, 2**-12),
        (".exr", "float", True, 0),
    ],
)
def test_every_kind_of_file_is_read_linear(
    tmp_path: Path, colours: np.ndarray, suffix: str, kind: str, linear: bool, tolerance: float
) -> None:
    image = read_image(write_file(tmp_path / f"photo{suffix}", colours, kind))
    assert image.pixels.dtype == np.float32
    assert image.alpha is None
    # The sRGB curve is at most 2.4 times as steep as the identity.
    expected, slope = (colours, 1) if linear else (as_linear(colours), 2.4)
    np.testing.assert_allclose(image.pixels, expected, rtol=0, atol=slope * tolerance + 1e-6)
    assert image.clip == (np.inf if kind in ("half", "float") else 1.0)


@pytest.mark.parametrize(("stored", "linear"), SRGB.items())
def test_the_srgb_curve_is_undone(tmp_path: Path, stored: float, linear: float) -> None:
    image = read_image(write_file(tmp_path / "photo.png", np.full((2, 2, 3), stored), "uint16"))
    assert image.pixels == pytest.approx(np.full((2, 2, 3), linear), abs=3e-5)
    assert linear_to_srgb(np.array(linear)) == pytest.approx(stored, abs=1e-5)


def test_a_file_that_says_it_is_linear_is_left_alone(tmp_path: Path) -> None:
    path = write_file(tmp_path / "photo.png", np.full((2, 2, 3), 0.5), "uint16", oiio__ColorSpace="linear")
    assert read_image(path).pixels == pytest.approx(np.full((2, 2, 3), 0.5), abs=1e-4)


@pytest.mark.parametrize(
    ("gamma", "linear"),
    [
        (55_556, 0.3**1.8),  # of a Mac before 2009
        (45_455, 0.0732389),  # stands for sRGB
        (1, 0.0732389),  # no display has it
    ],
)
def test_values_have_the_gamma_of_a_png(tmp_path: Path, gamma: int, linear: float) -> None:
    """A chunk gAMA of 100,000 over the gamma, and none of sRGB."""
    path = write_file(tmp_path / "photo.png", np.full((2, 2, 3), 0.3), "uint16", oiio__ColorSpace="unknown")
    assert b"sRGB" not in path.read_bytes()
    with_chunks(path, png_chunk(b"gAMA", struct.pack(">I", gamma)))
    assert read_image(path).pixels == pytest.approx(np.full((2, 2, 3), linear), abs=1e-4)


@pytest.mark.parametrize(
    ("transfer", "gamma", "linear"), [(8, 45_455, 0.3), (13, 100_000, 0.0732389), (2, 55_556, 0.3**1.8)]
)
def test_values_have_the_transfer_of_a_png(tmp_path: Path, transfer: int, gamma: int, linear: float) -> None:
    """A chunk cICP, by the numbers of H.273: it overrides gAMA, unless it is 2, unknown."""
    path = write_file(tmp_path / "photo.png", np.full((2, 2, 3), 0.3), "uint16", oiio__ColorSpace="unknown")
    with_chunks(path, png_chunk(b"gAMA", struct.pack(">I", gamma)), png_chunk(b"cICP", bytes((9, transfer, 0, 1))))
    image = read_image(path)
    assert image.pixels == pytest.approx(np.full((2, 2, 3), linear), abs=1e-4) and not image.assumed


def test_a_png_that_was_cropped_out_of_a_page_is_read_whole(tmp_path: Path, colours: np.ndarray) -> None:
    """ImageMagick and GIMP note where in the page it was, in a chunk oFFs."""
    path = with_chunks(
        write_file(tmp_path / "photo.png", colours, "uint16"), png_chunk(b"oFFs", struct.pack(">iiB", 3, 2, 0))
    )
    assert read_image(path, encoding="linear").pixels == pytest.approx(colours, abs=1e-4)


def colour_profile(*curves: bytes) -> np.ndarray:
    """A profile of the three curves alone, red, green and blue (ICC.1:2022, 7.2 and 7.3)."""
    table, start = struct.pack(">I", len(curves)), 128 + 4 + 12 * len(curves)
    for name, curve in zip((b"rTRC", b"gTRC", b"bTRC"), curves, strict=False):
        table += struct.pack(">4sII", name, start, len(curve))
        start += len(curve)
    head = struct.pack(">I4xI12s12x4s88x", start, 0x02400000, b"mntrRGB XYZ ", b"acsp")
    return np.frombuffer(head + table + b"".join(curves), np.uint8)


def curv(*numbers: int) -> bytes:
    return struct.pack(f">4s4xI{len(numbers)}H", b"curv", len(numbers), *numbers).ljust(16, b"\0")


def para(kind: int, *numbers: float) -> bytes:
    return struct.pack(f">4s4xHH{len(numbers)}i", b"para", kind, 0, *(round(65536 * number) for number in numbers))


def write_profiled(path: Path, profile: np.ndarray, kind: str = "uint16") -> Path:
    """A file of the stored values 0.02, 0.3 and 0.8 with a colour profile."""
    spec = oiio.ImageSpec(3, 2, 3, kind)
    spec.attribute("ICCProfile", oiio.TypeDesc(f"uint8[{len(profile)}]"), profile)
    target = oiio.ImageOutput.create(str(path))
    stored = np.tile(np.float32([0.02, 0.3, 0.8])[None, :, None], (2, 1, 3))
    assert target.open(str(path), spec) and target.write_image(stored) and target.close()
    return path


@pytest.mark.parametrize(
    ("curve", "linear"),
    [
        (curv(), [0.02, 0.3, 0.8]),  # of a raw converter's linear TIFF
        (para(0, 1.0), [0.02, 0.3, 0.8]),
        (curv(461), [0.02**1.8008, 0.3**1.8008, 0.8**1.8008]),  # ProPhoto RGB
        (curv(563), [0.02**2.19922, 0.3**2.19922, 0.8**2.19922]),  # Adobe RGB (1998)
        (curv(0, 16384, 65535), [0.01, 0.15, 0.25 + 0.6 * 0.75]),
        (para(3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045), [0.0015480, 0.0732389, 0.6038273]),  # sRGB
        (para(1, 2.0, 2.0, -0.5), [0.0, 0.01, 1.0]),
        (para(1, 2.0, 1.25, -0.25), [0.0, 0.125**2, 0.75**2]),
        (para(2, 2.0, 0.9, -0.09, 0.1), [0.1, 0.18**2 + 0.1, 0.63**2 + 0.1]),
        (para(4, 2.0, 0.8, 0.1, 0.5, 0.1, 0.15, 0.01), [0.02, 0.34**2 + 0.15, 0.74**2 + 0.15]),
    ],
)
def test_values_have_the_curve_of_the_colour_profile(tmp_path: Path, curve: bytes, linear: list[float]) -> None:
    path = write_profiled(tmp_path / "photo.tif", colour_profile(curve, curve, curve))
    image = read_image(path)
    assert image.pixels[0, :, 1] == pytest.approx(linear, abs=1e-4) and not image.assumed
    assert read_image(path, encoding="srgb").pixels[0, 1] == pytest.approx([0.0732389] * 3, 1e-3)


@pytest.mark.parametrize(
    ("curve", "linear", "clip"),
    [
        (para(3, 2.4, 1 / 1.055, 0.055 / 1.055, 1 / 12.92, 0.04045), [0.0015480, 0.0732389, 0.6038273], np.inf),  # sRGB
        (curv(563), [0.02**2.19922, 0.3**2.19922, 0.8**2.19922], 1),  # Adobe RGB (1998)
        (curv(), [0.02, 0.3, 0.8], np.inf),
        (b"none", [0.02, 0.3, 0.8], np.inf),
    ],
)
def test_float_files_have_the_curve_of_their_colour_profile(tmp_path, curve: bytes, linear: list[float], clip: float):
    """As darktable and RawTherapee write them; without curves they are linear."""
    image = read_image(write_profiled(tmp_path / "photo.tif", colour_profile(curve, curve, curve), "float"))
    assert image.pixels[0, :, 1] == pytest.approx(linear, abs=1e-4) and image.clip == clip and not image.assumed


@pytest.mark.parametrize(
    "profile",
    [
        colour_profile(),  # a printer's has other tags
        colour_profile(para(0, 1.0), para(0, 1.0), para(7, 1.0)),
        colour_profile(para(0, 1.0), para(0, 1.0), para(4, 9e3, 3e4)),
        colour_profile(*[para(3, 3e4, 3e4, 3e4, 3e4, -3e4)] * 3),
        colour_profile(*[curv(*[1] * 9)[:20]] * 3),
        colour_profile(*[curv()] * 3)[:150],
    ],
)
def test_a_colour_profile_without_curves_or_a_damaged_one_counts_as_none(tmp_path: Path, profile: np.ndarray) -> None:
    image = read_image(write_profiled(tmp_path / "photo.tif", profile))
    assert image.pixels[0, 1] == pytest.approx([0.0732389] * 3, 1e-3) and image.assumed


@pytest.mark.parametrize(
    ("suffix", "kind", "attributes", "premultiplied"),
    [
        (".png", "uint16", {"oiio__UnassociatedAlpha": 1}, False),
        (".tif", "float", {"oiio__UnassociatedAlpha": 1}, False),
        (".tif", "float", {}, True),
        (".exr", "float", {}, True),
    ],
)
def test_colour_comes_without_alpha_multiplied_into_it(
    tmp_path: Path, suffix: str, kind: str, attributes: dict[str, int], premultiplied: bool
) -> None:
    colour, alpha = np.float32([0.8, 0.6, 0.4]), np.float32([[0, 0.004, 0.25, 1]])
    stored = np.dstack([*(alpha * c if premultiplied else np.full_like(alpha, c) for c in colour), alpha])
    image = read_image(write_file(tmp_path / f"photo{suffix}", stored, kind, **attributes), encoding="linear")
    np.testing.assert_allclose(image.alpha, alpha, atol=1e-4)
    np.testing.assert_allclose(image.pixels[0, 1:], np.tile(colour, (3, 1)), atol=1e-4)
    assert np.isfinite(image.pixels).all()


class TestLayers:
    """Multi-layer files as Blender writes them: 4.5 one part with full channel names, 5.x a part for each pass."""

    @pytest.fixture
    def passes(self) -> dict[str, np.ndarray]:
        values = np.random.default_rng(3).random((4, 6, 7)).astype(np.float32)
        values[..., 3] = 1
        return {
            **named("ViewLayer.Combined.", "RGBA", values[..., :4]),
            **named("ViewLayer.Normal.", "XYZ", values[..., 4:]),
        }

    @pytest.fixture(params=["one part", "a part for each pass"])
    def file(self, request: pytest.FixtureRequest, tmp_path: Path, passes: dict[str, np.ndarray]) -> Path:
        if request.param == "one part":
            parts = [(None, passes)]
        else:
            names = ["ViewLayer.Combined", "ViewLayer.Normal"]
            parts = [(name, {k: v for k, v in passes.items() if k.startswith(name)}) for name in names]
        return write_parts(tmp_path / "render.exr", parts)

    def test_combined_is_what_a_photo_is_taken_from(self, file: Path, passes: dict[str, np.ndarray]) -> None:
        image = read_image(file)
        expected = np.stack([passes[f"ViewLayer.Combined.{c}"] for c in "RGB"], axis=-1)
        np.testing.assert_allclose(image.pixels, expected, rtol=1e-6)
        np.testing.assert_array_equal(image.alpha, np.ones((4, 6)))

    @pytest.mark.parametrize("name", ["Normal", "ViewLayer.Normal"])
    def test_a_layer_is_read_by_its_full_or_last_name(self, file: Path, passes: dict[str, np.ndarray], name: str):
        values, alpha = read_data(file, name)
        np.testing.assert_array_equal(values, np.stack([passes[f"ViewLayer.Normal.{c}"] for c in "XYZ"], axis=-1))
        assert alpha is None

    def test_parts_whose_channels_carry_no_layer_are_known_by_the_parts_name(self, tmp_path: Path) -> None:
        left, right = np.random.default_rng(4).random((2, 3, 5, 3)).astype(np.float32)
        path = write_parts(
            tmp_path / "stereo.exr", [("left", named("", "RGB", left)), ("right", named("", "RGB", right))], "half"
        )
        assert image_layers(path) == ["", "right"]
        np.testing.assert_allclose(read_image(path).pixels, left, atol=1e-3)
        np.testing.assert_allclose(read_image(path, layer="right").pixels, right, atol=1e-3)


def test_colour_is_read_where_a_position_lies_beside_it(tmp_path: Path, colours: np.ndarray) -> None:
    path = write_parts(tmp_path / "render.exr", [(None, named("", "RGB", colours) | named("", "XYZ", 0 * colours))])
    np.testing.assert_array_equal(read_image(path).pixels, colours)


class TestMasks:
    @pytest.mark.parametrize("kind", ["grey", "colour", "alpha", "grey with flat alpha"])
    def test_bright_or_opaque_is_the_object(self, tmp_path: Path, kind: str) -> None:
        expected = np.zeros((4, 5), bool)
        expected[1:3, 2:] = True
        flat = np.ones((4, 5), np.float32)
        channels = {
            "grey": [expected],
            "colour": [expected, 0 * flat, 0 * flat],
            "alpha": [flat, flat, flat, expected],
            "grey with flat alpha": [expected, flat],
        }[kind]
        values = np.stack(channels, axis=-1)
        assert (read_mask(write_file(tmp_path / "mask.png", values, "uint8")) == expected).all()

    @pytest.mark.parametrize(("kind", "label"), [("uint8", 1), ("uint16", 1), ("uint8", 15), ("uint16", 255)])
    def test_labels_of_0_and_one_other_are_read(self, tmp_path: Path, kind: str, label: int) -> None:
        expected = np.arange(20).reshape(4, 5) % 3 == 0
        stored = label * expected / np.iinfo(kind).max
        assert (read_mask(write_file(tmp_path / "mask.png", stored, kind)) == expected).all()

    def test_alpha_decides_though_a_pixel_of_it_is_not_a_number(self, tmp_path: Path) -> None:
        values = np.ones((4, 5, 4), np.float32)
        values[:2, :, 3], values[0, 0, 3] = 0, np.nan
        assert (read_mask(write_file(tmp_path / "mask.exr", values, "float")) == (np.arange(4) > 1)[:, None]).all()

    @pytest.mark.parametrize("dark", [[0, 0], [100, 100], [0, 1, 2]])
    def test_what_is_dark_and_no_label_is_no_object(self, tmp_path: Path, dark: list[int]) -> None:
        assert not read_mask(write_file(tmp_path / "mask.png", np.array([dark]) / 255, "uint8")).any()


class TestWriting:
    @pytest.mark.parametrize(
        ("name", "bits", "stored"),
        [
            ("a.png", None, "uint16"),
            ("a.png", 8, "uint8"),
            ("a.tif", None, "uint16"),
            ("a.tiff", 32, "float"),
            ("a.exr", None, "float"),
            ("a.exr", 16, "half"),
        ],
    )
    def test_bits_are_what_was_asked_for(self, tmp_path, colours: np.ndarray, name: str, bits: int | None, stored: str):
        write_image(tmp_path / name, colours, bits=bits)
        buffer = oiio.ImageBuf(str(tmp_path / name))
        assert str(buffer.nativespec().format) == stored
        tolerance = {"uint8": 0.5 / 255, "uint16": 0.5 / 65535, "half": 2**-12, "float": 0}[stored]
        np.testing.assert_allclose(buffer.get_pixels(oiio.FLOAT), colours, rtol=0, atol=tolerance + 1e-7)
        assert listing(tmp_path) == [name]

    @pytest.mark.parametrize(("suffix", "stored"), [(".png", 0.5), (".tif", 0.5), (".exr", 0.125)])
    def test_alpha_is_stored_as_the_format_defines_it(self, tmp_path: Path, suffix: str, stored: float) -> None:
        path = tmp_path / f"a{suffix}"
        write_image(path, np.tile(np.float32([0.5, 0.5, 0.5, 0.25]), (2, 2, 1)))
        unassociated = oiio.ImageSpec()
        unassociated.attribute("oiio:UnassociatedAlpha", 1)
        raw = oiio.ImageInput.open(str(path), unassociated).read_image(oiio.FLOAT)
        assert raw[0, 0] == pytest.approx([stored] * 3 + [0.25], abs=1e-4)
        assert read_image(path, encoding="linear").pixels[0, 0] == pytest.approx([0.5] * 3, abs=1e-4)

    @pytest.mark.parametrize("shape", [(), (4,), (2, 2, 2, 2), (0, 4), (4, 0, 3), (2, 2, 0), (2, 2, 5)])
    def test_what_is_no_image_is_refused(self, tmp_path: Path, shape: tuple[int, ...]) -> None:
        with pytest.raises(SettingsError, match="is not an image"):
            write_image(tmp_path / "a.png", np.zeros(shape))
        assert not any(tmp_path.iterdir())


SIDES = {"top": np.s_[0], "bottom": np.s_[-1], "left": np.s_[:, 0], "right": np.s_[:, -1]}


@pytest.mark.parametrize(
    ("orientation", "first_row", "first_column"),
    [
        (1, "top", "left"),
        (2, "top", "right"),
        (3, "bottom", "right"),
        (4, "bottom", "left"),
        (5, "left", "top"),
        (6, "right", "top"),
        (7, "right", "bottom"),
        (8, "left", "bottom"),
    ],
)
def test_a_photo_stands_as_viewers_show_it(tmp_path: Path, orientation: int, first_row: str, first_column: str) -> None:
    """Where the stored first row and column are to be seen, in the words of the EXIF standard."""
    values = np.zeros((4, 6, 3))
    values[0, :, 0], values[:, 0, 1] = 1, 1
    path = write_file(tmp_path / "photo.tif", values, "float", Orientation=orientation)
    pixels = read_image(path).pixels
    assert read_size(path) == pixels.shape[:2]
    assert pixels[..., 0][SIDES[first_row]].all() and pixels[..., 0].sum() == 6
    assert pixels[..., 1][SIDES[first_column]].all() and pixels[..., 1].sum() == 4


@pytest.mark.parametrize(("aspect", "warnings"), [(2.0, 1), (0.5, 1), (1.0, 0), (1.001, 0)])
def test_pixels_that_are_not_square_are_warned_of(tmp_path, caplog, aspect: float, warnings: int) -> None:
    read_image(write_file(tmp_path / "photo.exr", np.ones((2, 3, 3)), "half", PixelAspectRatio=aspect))
    assert len([record for record in caplog.records if "not square" in record.message]) == warnings


def test_a_layer_of_too_many_channels_is_not_read(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    """All channels between the first and the last of a layer's colours are read at once."""
    monkeypatch.setattr("mpsnet_core.io.image_reading.MAX_LAYER_VALUES", 1000)
    photo = write_file(tmp_path / "c.exr", np.zeros((16, 16, 4)), "half")
    with pytest.raises(InputError, match="has 4 channels in a layer of 16 x 16"):
        read_image(photo)


def turned_bit(b: Bench, byte: int) -> Path:
    """A PNG whose head says something else than its checksum."""
    data = bytearray(b.photo("photo.png", kind="uint8").read_bytes())
    data[byte] ^= 4
    return b.bytes("photo.png", bytes(data))


def in_lab(b: Bench) -> Path:
    """A TIFF whose photometric interpretation (262) is CIE L*a*b* (8), not RGB (2)."""
    data = b.photo("photo.tif", kind="uint8").read_bytes()
    rgb, lab = (struct.pack("<HHIHH", 262, 3, 1, meaning, 0) for meaning in (2, 8))
    assert rgb in data
    return b.bytes("photo.tif", data.replace(rgb, lab))


def gif(b: Bench, name: str) -> Path:
    """One black pixel."""
    head = b"GIF89a" + bytes((1, 0, 1, 0, 0x80, 0, 0)) + bytes(6)
    return b.bytes(name, head + b"," + bytes((0, 0, 0, 0, 1, 0, 1, 0, 0, 2, 2, 0x44, 1, 0)) + b";")


def latin_named(b: Bench) -> Path:
    """A photo whose name was written by a system that does not know UTF-8."""
    return b.photo("photo.png", kind="uint8").rename(b / os.fsdecode(b"gr\xf6sse.png"))


def huge_tiles(b: Bench) -> Path:
    """A small EXR whose tiles claim to be larger."""
    spec = oiio.ImageSpec(16, 16, 3, "half")
    spec.tile_width = spec.tile_height = 64
    target = oiio.ImageOutput.create(str(b / "tiles.exr"))
    assert target.open(str(b / "tiles.exr"), spec) and target.write_image(np.zeros((16, 16, 3), np.float32))
    target.close()
    data = bytearray((b / "tiles.exr").read_bytes())
    struct.pack_into("<II", data, data.index(b"tiledesc\0") + 13, 16384, 16384)
    return b.bytes("tiles.exr", bytes(data))


def huge_jpeg(b: Bench, before: bytes = b"") -> Path:
    """The head of a progressive JPEG, behind a comment and other bytes that libjpeg passes over."""
    frame = struct.pack(">HHBHHB", 0xFFC2, 17, 8, 40_000, 40_000, 3) + bytes((1, 17, 0, 2, 17, 0, 3, 17, 0))
    return b.bytes("p.jpg", b"\xff\xd8" + struct.pack(">HH", 0xFFFE, 5) + b"abc" + before + frame)


def huge_png(width: int, height: int) -> bytes:
    header = struct.pack(">IIBBBBB", width, height, 8, 2, 0, 0, 0)
    parts = png_chunk(b"IHDR", header) + png_chunk(b"IDAT", zlib.compress(b"")) + png_chunk(b"IEND", b"")
    return b"\x89PNG\r\n\x1a\n" + parts


def huge_exr(b: Bench) -> Path:
    """An EXR whose header says it is 100000 x 100000."""
    data = b.photo("huge.exr").read_bytes()
    small, huge = struct.pack("<4i", 0, 0, 15, 15), struct.pack("<4i", 0, 0, 99999, 99999)
    assert small in data
    return b.bytes("huge.exr", data.replace(small, huge))


def within(limit: str, value: int, work: Callable[[], Any]) -> None:
    """Do the work under a smaller limit, as reaching the real one would take gigabytes."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(f"mpsnet_core.io.image_reading.{limit}", value)
        work()


test_a_bad_image_gets_one_clear_sentence = gets_one_clear_sentence(
    [
        ("another kind of picture", lambda b: read_image(gif(b, "p.png")), "it is a GIF…save it as PNG"),
        ("a TIFF in Lab", lambda b: read_image(in_lab(b)), "photo.tif is in Lab colours…export it as RGB"),
        (
            "a PNG in HDR",
            lambda b: read_image(
                with_chunks(b.photo("p.png", kind="uint16"), png_chunk(b"cICP", bytes((9, 16, 0, 1))))
            ),
            "p.png follows the PQ (HDR) curve…convert it to BT.709 or sRGB",
        ),
        ("a PNG with a bit of its head turned", lambda b: read_image(turned_bit(b, 24)), "photo.png cannot be read as"),
        (lambda b: read_image(b.replaced(b.photo(), b"chlist", b"chlis\x80")), "photo.exr cannot be read as an image"),
        ("missing", lambda b: read_image(b / "photo.png"), "photo.png does not exist; check the path"),
        ("a folder", lambda b: read_image(b.folder), "is a folder, not a file; name a file in it"),
        ("not an image", lambda b: read_image(b.text("photo.png", "hello")), "photo.png cannot be read as an image"),
        ("PNG cut short", lambda b: read_image(cut(b.photo("p.png", kind="uint16"))), "damaged or cut short"),
        ("JPEG cut short", lambda b: read_image(cut(b.photo("p.jpg", kind="uint8"), 0.95)), "p.jpg is damaged or cut"),
        (
            "progressive JPEG cut short",
            lambda b: read_image(cut(write_file(b / "p.jpg", SPHERE.image, "uint8", jpeg__progressive=1), 0.99)),
            "p.jpg is damaged or cut short",
        ),
        ("TIFF cut short", lambda b: read_image(cut(b.photo("p.tif", kind="uint16"))), "p.tif"),
        ("EXR cut short", lambda b: read_image(cut(b.photo("p.exr"))), "p.exr is damaged or cut short"),
        ("grey", lambda b: read_image(b.photo("p.png", SPHERE.mask, "uint8")), "p.png has 1 channel"),
        ("a name that is not UTF-8", lambda b: read_image(latin_named(b)), "its name is not valid UTF-8; rename it"),
        (
            "unknown layer",
            lambda b: read_image(write_parts(b / "l.exr", [(None, named("A.", "RGB", SPHERE.image))]), layer="B"),
            "l.exr has no layer 'B'; it has A",
        ),
        (
            "several layers",
            lambda b: read_image(
                write_parts(b / "l.exr", [(None, named("A.", "RGB", SPHERE.image) | named("B.", "RGB", SPHERE.image))])
            ),
            "l.exr has several layers; name one of A, B",
        ),
        ("unknown encoding", lambda b: read_image(b.photo(), encoding="log"), "encoding 'log' is not known"),
        (lambda b: read_image(b.bytes("p.png", huge_png(100_000, 100_000))), "p.png…100000"),
        (lambda b: within("MAX_PIXELS", 255, lambda: read_image(b.photo())), "photo.exr claims to be 16 x 16"),
        ("tiles of 268 megapixels", lambda b: read_image(huge_tiles(b)), "tiles.exr claims…no tiles above"),
        *(
            (f"a progressive JPEG of 1600 megapixels{name}", lambda b, what=what: read_image(huge_jpeg(b, what)), said)
            for name, what, said in (
                ("", b"", "p.jpg claims to be 40000 x 40000"),
                (", fill bytes", b"\xff\xff", "p.jpg claims to be 40000 x 40000"),
                (", bytes that are no marker", b"abc", "p.jpg claims to be 40000 x 40000"),
                (", a marker without a segment", b"\xff\xd0", "p.jpg claims to be 40000 x 40000"),
                (", far behind", bytes(200_000), "p.jpg is damaged"),
            )
        ),
        ("an EXR header of 10^10 pixels", lambda b: read_image(huge_exr(b)), "huge.exr"),
        (lambda b: read_image(write_file(b / "c.exr", np.zeros((2, 2, 1100)), "half")), "c.exr…1100 channels"),
        (lambda b: read_image(b.replaced(b.photo("c.exr"), b"B\0\2\0\0\0", b"\xe4\0\2\0\0\0")), "c.exr names a"),
        ("no suffix", lambda b: write_image(b / "out", SPHERE.image), "out…its name has no ending; use .png"),
    ]
)
