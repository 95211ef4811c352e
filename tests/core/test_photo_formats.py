"""Formats beyond PNG, JPEG, TIFF and EXR; what a file says of itself; and files that are named for what they are."""

import io
import struct
import sys
from collections.abc import Callable
from pathlib import Path

import numpy as np
import OpenImageIO as oiio
import pytest
from png_chunks import png_chunk, with_chunks
from synthetic import shaded_sphere, write_file

from mpsnet_core import FormatError, InputError, read_capture, read_image
from mpsnet_core.io.image import linear_to_srgb, srgb_to_linear
from mpsnet_core.io.image_reading import read_orientation, read_size

PIXELS = np.random.default_rng(3).random((6, 9, 3)).astype(np.float32)


@pytest.mark.parametrize(
    ("suffix", "kind", "how", "assumed"),
    [
        (".webp", "uint8", {"Compression": "lossless:9"}, None),
        (".bmp", "uint8", {}, "srgb"),
        (".tga", "uint8", {}, "srgb"),
        (".tga", "uint8", {"Compression": "rle"}, "srgb"),
        (".hdr", "float", {}, None),
    ],
)
def test_the_image_librarys_other_formats_are_read(
    tmp_path: Path, suffix: str, kind: str, how: dict[str, str], assumed: str | None
) -> None:
    image = read_image(write_file(tmp_path / f"photo{suffix}", PIXELS, kind, **how))
    expected = PIXELS if kind == "float" else srgb_to_linear(np.rint(255 * PIXELS) / 255)
    np.testing.assert_allclose(image.pixels, expected, atol=0.005 if kind == "float" else 1e-6)
    assert image.assumed == assumed and image.clip == (np.inf if kind == "float" else 1)


@pytest.mark.parametrize("suffix", [".webp", ".bmp", ".tga"])
def test_colours_are_not_divided_by_an_alpha_that_does_not_multiply_them(tmp_path: Path, suffix: str) -> None:
    from PIL import Image

    values = np.full((4, 4, 4), (200, 100, 50, 128), np.uint8)
    how = {"lossless": True, "exact": True} if suffix == ".webp" else {}
    Image.fromarray(values).save(tmp_path / f"photo{suffix}", **how)
    image = read_image(tmp_path / f"photo{suffix}")
    assert image.pixels[0, 0] == pytest.approx(srgb_to_linear(np.array([200, 100, 50]) / 255), abs=1e-4)
    assert image.alpha is not None and image.alpha[0, 0] == pytest.approx(128 / 255)


@pytest.mark.parametrize("suffix", [".bmp", ".tga"])
def test_a_fourth_byte_that_is_unused_is_no_alpha(tmp_path: Path, suffix: str) -> None:
    rows = np.full((4, 4, 4), (50, 100, 200, 0), np.uint8).tobytes()  # blue first
    head = struct.pack("<BBBHHBHHHHBB", 0, 0, 2, 0, 0, 0, 0, 0, 4, 4, 32, 8)
    if suffix == ".bmp":
        head = b"BM" + struct.pack("<IHHI", 54 + 64, 0, 0, 54)
        head += struct.pack("<IiiHHIIiiII", 40, 4, 4, 1, 32, 0, 64, 0, 0, 0, 0)
    (tmp_path / f"photo{suffix}").write_bytes(head + rows)
    image = read_image(tmp_path / f"photo{suffix}")
    assert image.alpha is None
    assert image.pixels[0, 0] == pytest.approx(srgb_to_linear(np.array([200, 100, 50]) / 255), abs=1e-4)


def test_a_radiance_picture_is_what_its_header_says_was_exposed(tmp_path: Path) -> None:
    lines = b"#?RADIANCE\nFORMAT=32-bit_rle_rgbe\nEXPOSURE= 2\nEXPOSURE=4\nCOLORCORR=1 2 0.5\nEXPOSURE=none\n\n"
    stored = bytes([128, 128, 128, 129] * 2)  # 1, 1, 1, of which a half level is lost
    (tmp_path / "photo.hdr").write_bytes(lines + b"-Y 1 +X 2\n" + stored)
    assert read_image(tmp_path / "photo.hdr").pixels[0, 0] == pytest.approx([1 / 8, 1 / 16, 1 / 4], rel=0.01)


def test_a_webp_stands_upright(tmp_path: Path) -> None:
    plain = write_file(tmp_path / "plain.webp", PIXELS, "uint8", Compression="lossless:9")
    exif = b"II*\0" + struct.pack("<IHHHIII", 8, 1, 274, 3, 1, 6, 0)
    body = plain.read_bytes()[12:]
    size = (PIXELS.shape[1] - 1).to_bytes(3, "little") + (PIXELS.shape[0] - 1).to_bytes(3, "little")
    chunks = (
        b"VP8X" + struct.pack("<I4s", 10, b"\x08\0\0\0") + size + body + b"EXIF" + struct.pack("<I", len(exif)) + exif
    )
    turned = tmp_path / "turned.webp"
    turned.write_bytes(b"RIFF" + struct.pack("<I", 4 + len(chunks)) + b"WEBP" + chunks)
    np.testing.assert_array_equal(read_image(turned).pixels, np.rot90(read_image(plain).pixels, -1))
    assert read_size(turned) == PIXELS.shape[1::-1] and read_orientation(turned) == 6


@pytest.mark.parametrize("name", ["photo.heic", "photo.jpg"])
@pytest.mark.parametrize("kind", ["HEIC", "AVIF"])
def test_photos_of_phones_are_read_by_an_extra_or_named(tmp_path, monkeypatch, name: str, kind: str) -> None:
    heif = pytest.importorskip("pillow_heif")
    from PIL import Image

    flat = np.full((32, 48, 3), (200, 100, 50), np.uint8)
    file = tmp_path / name
    if kind == "HEIC":
        heif.from_pillow(Image.fromarray(flat)).save(file, quality=100, chroma=444)
    else:
        Image.fromarray(flat).save(file, format="AVIF", quality=100, subsampling="4:4:4")
    image = read_image(file)
    np.testing.assert_allclose(image.pixels, srgb_to_linear(flat / 255), atol=0.02)
    assert image.assumed is None and read_size(file) == (32, 48)
    for share in (0.3, 0.7):
        (tmp_path / "cut.heic").write_bytes(file.read_bytes()[: int(share * file.stat().st_size)])
        with pytest.raises(FormatError, match=r"cut\.heic"):
            read_image(tmp_path / "cut.heic")
    monkeypatch.setitem(sys.modules, "pillow_heif", None)
    with pytest.raises(InputError, match=rf"{name} is {kind}, which needs pillow-heif: .*\[heif\].* or convert it"):
        read_image(file)


@pytest.mark.parametrize(
    ("start", "kind"),
    [
        (b"\xff\x0a", "JPEG XL"),
        (b"\0\0\0\x0cJXL \r\n\x87\n", "JPEG XL"),
        (b"\0\0\0\x0cjP  \r\n\x87\n", "JPEG 2000"),
        (b"8BPS\0\1", "Photoshop"),
        (b"GIF89a", "GIF"),
    ],
)
@pytest.mark.parametrize("suffix", [".jpg", ".tga"])
def test_other_files_are_named_for_what_they_are(tmp_path: Path, start: bytes, kind: str, suffix: str) -> None:
    (tmp_path / f"photo{suffix}").write_bytes(start + bytes(100))
    with pytest.raises(FormatError, match=rf"photo.* cannot be read as an image \(it is .*{kind}.*\); save it as PNG"):
        read_image(tmp_path / f"photo{suffix}")


def test_of_a_tiffs_pages_the_largest_is_read(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    caplog.set_level("INFO")
    path, pages = tmp_path / "photo.tif", (PIXELS[:3, :4], PIXELS, PIXELS[:2, :2])
    specs = [oiio.ImageSpec(page.shape[1], page.shape[0], 3, "float") for page in pages]
    target = oiio.ImageOutput.create(str(path))
    for number, (spec, page) in enumerate(zip(specs, pages, strict=True)):
        mode = "AppendSubimage" if number else "Create"
        assert target.open(str(path), spec, mode) and target.write_image(np.ascontiguousarray(page))
    target.close()
    np.testing.assert_array_equal(read_image(path).pixels, PIXELS)
    assert "the largest is read, 9 x 6" in caplog.text and read_size(path) == (6, 9)


LONG_TEXT = png_chunk(b"tEXt", b"Comment\0" + b"sRGB cICP gAMA " * 9000)


@pytest.mark.parametrize("comment", [b"", LONG_TEXT, 3 * LONG_TEXT])
def test_what_a_png_says_is_what_its_chunks_say_wherever_they_stand(tmp_path: Path, comment: bytes) -> None:
    def read(*chunks: bytes) -> tuple[float, str | None]:
        path = write_file(tmp_path / "p.png", np.full((2, 2, 3), 0.3), "uint16", oiio__ColorSpace="unknown")
        image = read_image(with_chunks(path, comment, *chunks))
        return float(image.pixels[0, 0, 0]), image.assumed

    srgb = pytest.approx(0.0732389, abs=1e-4)
    assert read() == (srgb, "srgb")
    assert read(png_chunk(b"sRGB", b"\0")) == (srgb, None)
    assert read(png_chunk(b"cICP", bytes((9, 8, 0, 1)))) == (pytest.approx(0.3, abs=1e-4), None)
    assert read(png_chunk(b"gAMA", struct.pack(">I", 25_000))) == (pytest.approx(0.3**4, abs=1e-4), None)
    with pytest.raises(FormatError, match="PQ"):
        read(png_chunk(b"cICP", bytes((9, 16, 0, 1))))


def test_float_values_with_the_srgb_curve_are_recognised(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """As an editor exports them without a profile; what is linear stays so, and EXR is linear by definition."""
    sphere = shaded_sphere(160)
    for name, values, expected in (
        ("curve.tif", linear_to_srgb(sphere.image), sphere.image),
        ("plain.tif", sphere.image, sphere.image),
        ("plain.exr", linear_to_srgb(sphere.image), linear_to_srgb(sphere.image)),
    ):
        caplog.clear()
        photo = write_file(tmp_path / name, values, "float")
        capture = read_capture(photo, sphere.rig, mask="threshold:0.02")
        np.testing.assert_allclose(capture.image, expected, atol=1e-5)
        assert ("READ AS sRGB" in caplog.text) == (name == "curve.tif")


def test_hostile_structures_end(tmp_path: Path) -> None:
    """Directories that lead to themselves, chunks without end."""
    from mpsnet_core.io.file_kinds import png_chunks, tiff_directories

    loop = b"II*\0" + struct.pack("<IHHHIII", 8, 1, 330, 4, 1, 8, 8)
    assert len(list(tiff_directories(io.BytesIO(loop)))) == 1
    assert len(list(tiff_directories(io.BytesIO(b"MM\0*" + b"\xff" * 60)))) <= 1
    (tmp_path / "p.png").write_bytes(b"\x89PNG\r\n\x1a\n" + b"\xff\xff\xff\xfftEXt")
    assert list(png_chunks(tmp_path / "p.png")) == [b"tEXt"]


def palette(folder: Path, suffix: str) -> Path:
    from PIL import Image

    Image.fromarray(np.rint(255 * PIXELS).astype(np.uint8)).convert("P").save(folder / f"photo{suffix}")
    return folder / f"photo{suffix}"


def multiplied(folder: Path, suffix: str) -> Path:
    y, x = np.mgrid[-40:40, -40:40]
    alpha = np.clip((30 - np.hypot(x, y)) / 10 + 0.5, 0, 1)[..., None]
    colours = 0.8 * np.ones((80, 80, 3)) * (alpha if suffix == ".png" else 1)
    return write_file(folder / "photo.png", np.dstack([colours, alpha]), "uint8", oiio__UnassociatedAlpha=1)


def with_a_table(folder: Path, suffix: str) -> Path:
    """A TIFF that states its curve by TIFF 6.0's TransferFunction."""
    tags = [(256, 4, 1, 1), (257, 4, 1, 1), (258, 3, 1, 8), (259, 3, 1, 1), (262, 3, 1, 2), (273, 4, 1, 8)]
    tags += [(277, 3, 1, 3), (278, 4, 1, 1), (279, 4, 1, 3)]
    tags += [(301, 3, 256, 12 + 2 + 12 * 10 + 4)] if suffix == ".tif" else []
    directory = struct.pack("<H", len(tags)) + b"".join(struct.pack("<HHII", *tag) for tag in tags) + bytes(4)
    table = struct.pack("<256H", *(257 * level for level in range(256)))
    (folder / "photo.tif").write_bytes(b"II*\0" + struct.pack("<I", 12) + bytes([9, 99, 199, 0]) + directory + table)
    return folder / "photo.tif"


@pytest.mark.parametrize(
    ("write", "suffix", "words"),
    [
        (with_a_table, ".tif", "states its curve by a table"),
        (with_a_table, "none", ""),
        *((palette, suffix, "has a palette") for suffix in (".png", ".bmp", ".tga", ".tif")),
        (multiplied, ".png", "look multiplied by its alpha"),
        (multiplied, "straight", ""),
    ],
)
def test_what_makes_a_files_values_doubtful_is_said(
    tmp_path: Path, caplog: pytest.LogCaptureFixture, write: Callable[[Path, str], Path], suffix: str, words: str
) -> None:
    read_image(write(tmp_path, suffix))
    told = [record.getMessage() for record in caplog.records if record.levelname == "WARNING"]
    assert len(told) == bool(words) and all(words in line for line in told)
