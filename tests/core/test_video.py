"""Videos that the test encodes itself, without loss: every frame comes out, in order, with the values that went in."""

import json
import re
import struct
from collections.abc import Callable, Sequence
from fractions import Fraction
from importlib.util import find_spec
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from synthetic import Sphere, listing, write_file

from mpsnet_core import InputError, read_normals
from mpsnet_core.capture.open import Source
from mpsnet_core.estimate.sequence.source import Frame, Masks
from mpsnet_core.estimate.sequence.video import read_video_header, video_frames, video_outputs
from mpsnet_core.io.frames import is_video
from mpsnet_core.io.image import srgb_to_linear

if find_spec("av") is None:
    pytest.skip("needs PyAV (the extra video)", allow_module_level=True)
import av

HEIGHT, WIDTH = 24, 40


def clip(
    path: Path,
    frames: Sequence[np.ndarray],
    codec: str = "ffv1",
    kind: str = "bgr0",
    *,
    times: Sequence[int] | None = None,
    **context: Any,
) -> Path:
    """Encode (H, W, 3 or 4) uint8 or uint16 frames at 24 a second, or at `times` in 24ths of a second."""
    given = {("uint8", 3): "rgb24", ("uint16", 3): "rgb48le", ("uint8", 4): "rgba", ("uint16", 4): "rgba64le"}
    pictures = []
    for number, values in enumerate(frames):
        picture = av.VideoFrame.from_ndarray(values, format=given[values.dtype.name, values.shape[2]])
        pictures.append(picture.reformat(format=kind))
        if times is not None:
            pictures[-1].pts, pictures[-1].time_base = times[number], Fraction(1, 24)
    return encoded(path, pictures, codec, **context)


def encoded(path: Path, pictures: Sequence[av.VideoFrame], codec: str = "ffv1", **context: Any) -> Path:
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=24)
        stream.width, stream.height = pictures[0].width, pictures[0].height
        stream.pix_fmt = pictures[0].format.name
        for name, value in context.items():
            setattr(stream.codec_context, name, value)
        for picture in pictures:
            container.mux(stream.encode(picture))
        container.mux(stream.encode(None))
    return path


def noise(count: int, depth: type = np.uint8, channels: int = 3) -> list[np.ndarray]:
    random = np.random.default_rng(4)
    return list(random.integers(0, np.iinfo(depth).max + 1, (count, HEIGHT, WIDTH, channels), depth))


def decoded(path: Path, encoding: Any = "auto") -> list[Frame]:
    video = read_video_header(path, encoding=encoding)
    like = Source(path, None)
    outputs = video_outputs(path, path.parent, ".png")
    return list(video_frames(video, outputs, masks=Masks(), like=like, encoding=encoding))


@pytest.mark.parametrize(
    ("name", "codec", "kind", "depth"),
    [
        ("a.mkv", "ffv1", "bgr0", np.uint8),
        ("a.avi", "rawvideo", "bgr24", np.uint8),
        ("a.mov", "png", "rgb24", np.uint8),
        ("a.mkv", "ffv1", "gbrp16le", np.uint16),
    ],
)
def test_every_frame_comes_out_in_order(tmp_path, name: str, codec: str, kind: str, depth: type[np.unsignedinteger]):
    given = noise(7, depth)
    path = clip(tmp_path / name, given, codec, kind)
    assert is_video(path)
    video = read_video_header(path)
    assert (video.width, video.height, video.frame_rate, video.count) == (WIDTH, HEIGHT, 24, 7)
    frames = decoded(path)
    assert [frame.number for frame in frames] == [1, 2, 3, 4, 5, 6, 7]
    assert frames[6].output.name == "a_000007_normals.png"
    for frame, values in zip(frames, given, strict=True):
        image = frame.source.photo()
        expected = srgb_to_linear(values / np.iinfo(depth).max)
        np.testing.assert_allclose(image.pixels, expected, atol=2e-6 if depth is np.uint8 else 4e-5)
        assert (image.alpha, image.clip) == (None, 1.0)


@pytest.mark.parametrize(("curve", "encoding", "linear"), [(8, "auto", True), (1, "auto", False), (1, "linear", True)])
def test_values_follow_the_curve_that_the_video_states(tmp_path: Path, curve: int, encoding: str, linear: bool) -> None:
    given = noise(1)
    path = clip(tmp_path / "a.mkv", given, color_trc=curve)
    values = given[0] / 255
    pixels = decoded(path, encoding)[0].source.photo().pixels
    np.testing.assert_allclose(pixels, values if linear else srgb_to_linear(values), atol=2e-6)


def test_ten_bits_are_kept(tmp_path: Path) -> None:
    """A ramp in steps of 10 bits of luma has more than 256 values, the ones that BT.709's limited range gives."""
    grey = av.VideoFrame(1024, 16, "yuv444p10le")
    luma = np.clip(np.arange(1024), 64, 940).astype("<u2")
    for plane, row in zip(grey.planes, (luma, np.full(1024, 512, "<u2"), np.full(1024, 512, "<u2")), strict=True):
        values = np.zeros((16, plane.line_size // 2), "<u2")
        values[:, :1024] = row
        plane.update(values)
    ramp = encoded(tmp_path / "ramp.mkv", [grey], colorspace=1, color_range=1)
    pixels = decoded(ramp, "linear")[0].source.photo().pixels
    np.testing.assert_allclose(pixels[8], np.repeat((luma[:, None] - 64.0) / 876, 3, axis=1), atol=1.2 / 255)
    assert len(np.unique(pixels[8, :, 1])) > 800


@pytest.mark.parametrize(("matrix", "red"), [(1, 0.2126), (5, 0.299)], ids=["BT.709", "BT.601"])
def test_colours_follow_the_matrix_that_the_video_states(tmp_path: Path, matrix: int, red: float) -> None:
    """A pure red, whose luma is the matrix's own weight of red."""
    blue = {1: 0.0722, 5: 0.114}[matrix]
    codes = (16 + 219 * red, 128 + 224 * -red / (2 * (1 - blue)), 128 + 224 / 2)
    picture = av.VideoFrame(WIDTH, HEIGHT, "yuv444p")
    for plane, code in zip(picture.planes, codes, strict=True):
        plane.update(np.full((HEIGHT, plane.line_size), round(code), np.uint8))
    path = encoded(tmp_path / "red.mkv", [picture], colorspace=matrix, color_range=1)
    np.testing.assert_allclose(decoded(path, "linear")[0].source.photo().pixels[12, 20], [1, 0, 0], atol=0.02)


@pytest.mark.parametrize("size", [(24, 32), (25, 33)], ids=["even", "odd"])
@pytest.mark.parametrize("kind", ["yuv420p", "yuv420p10le", "yuva420p10le"])
def test_half_size_colour_keeps_its_values(tmp_path: Path, kind: str, size: tuple[int, int]) -> None:
    """Plain colours by BT.709, whose formulas round nothing."""
    scale, stored = (4, np.dtype("<u2")) if "10" in kind else (1, np.dtype(np.uint8))
    codes = np.random.default_rng(5).integers((60, 108, 108), (180, 148, 148), (40, 3))  # all of them colours
    luma, blue, red = ((codes - (16, 128, 128)) / (219, 224, 224)).T
    colours = np.stack([luma + 1.5748 * red, luma - 0.187324 * blue - 0.468124 * red, luma + 1.8556 * blue], axis=-1)
    pictures = []
    for values in codes:
        picture = av.VideoFrame(size[1], size[0], kind)
        for plane, code in zip(picture.planes, (*values, 255), strict=False):
            plane.update(np.full((plane.height, plane.line_size // stored.itemsize), scale * code, stored))
        pictures.append(picture)
    frames = decoded(encoded(tmp_path / "plain.mkv", pictures, colorspace=1, color_range=1), "linear")
    for frame, colour in zip(frames, colours, strict=True):
        np.testing.assert_allclose(frame.source.photo().pixels - colour, 0, atol=0.9 / 255)


def test_alpha_comes_with_the_frame(tmp_path: Path) -> None:
    given = noise(2, channels=4)
    frames = decoded(clip(tmp_path / "a.mov", given, "png", "rgba"))
    alpha = frames[1].source.photo().alpha
    assert alpha is not None
    np.testing.assert_allclose(alpha, given[1][..., 3] / 255, atol=1e-6)


# Where a point (x, y) of the stored picture goes, y down, after ISO/IEC 14496-12: x' = a x + c y, y' = b x + d y.
TURNS = {"as it is": (1, 0, 0, 1, 0), "90° clockwise": (0, 1, -1, 0, -1), "half round": (-1, 0, 0, -1, 2),
         "90° counter-clockwise": (0, -1, 1, 0, 1)}  # fmt: skip


@pytest.mark.parametrize("turn", TURNS)
def test_a_phone_held_upright(tmp_path: Path, turn: str) -> None:
    """The matrix in an MP4's track header, written by hand, says how a player turns the picture."""
    given = noise(1)
    path = clip(tmp_path / "a.mov", given, "png", "rgb24")
    *corner, quarter_turns = TURNS[turn]
    a, b, c, d = (value << 16 for value in corner)
    data = bytearray(path.read_bytes())
    matrix = data.index(b"tkhd") + 4 + 4 + 5 * 4 + 8 + 8
    assert struct.unpack_from(">9i", data, matrix) == (1 << 16, 0, 0, 0, 1 << 16, 0, 0, 0, 1 << 30)
    struct.pack_into(">9i", data, matrix, a, b, 0, c, d, 0, 0, 0, 1 << 30)
    path.write_bytes(data)
    pixels = decoded(path, "linear")[0].source.photo().pixels
    np.testing.assert_allclose(pixels, np.rot90(given[0] / 255, quarter_turns), atol=1e-6)


def test_a_video_that_is_cut_short_keeps_what_it_gives(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    given = noise(30)
    path = clip(tmp_path / "a.mkv", given)
    path.write_bytes(path.read_bytes()[: path.stat().st_size // 2])
    frames = decoded(path)
    assert 8 <= len(frames) <= 16
    for frame, values in zip(frames[:-1], given, strict=False):
        np.testing.assert_allclose(frame.source.photo().pixels, srgb_to_linear(values / 255), atol=2e-6)
    assert f"a.mkv ends after {len(frames)} of about 30 frames: is it cut short or damaged?" in caplog.text


def test_pixels_that_are_not_square_are_noted(tmp_path: Path, caplog: pytest.LogCaptureFixture) -> None:
    """As of HDV and of anamorphic lenses."""
    read_video_header(clip(tmp_path / "hdv.mov", noise(1), "png", "rgb24", sample_aspect_ratio=Fraction(4, 3)))
    assert "pixels are not square (4:3)" in caplog.text
    caplog.clear()
    read_video_header(clip(tmp_path / "square.mov", noise(1), "png", "rgb24"))
    assert "square" not in caplog.text


PLAYLIST = "#EXTM3U\n#EXT-X-TARGETDURATION:1\n#EXTINF:1,\na.mkv\n#EXT-X-ENDLIST\n"

BAD: dict[str, tuple[Callable[[Path], Any], str]] = {
    "missing": (lambda path: None, "video .*x.mkv does not exist; check the path"),
    "a playlist": (lambda path: path.write_text(PLAYLIST), "x.mkv cannot be read as a video"),
    "a list of files": (
        lambda path: path.write_text("ffconcat version 1.0\nfile a.mkv\n"),
        "x.mkv cannot be read as a video",
    ),
    "a header alone": (
        lambda path: path.write_bytes(clip(path.with_name("y.mkv"), noise(3)).read_bytes()[:700]),
        "x.mkv",
    ),
    "HLG": (
        lambda path: clip(path, noise(1), color_trc=18),
        r"x.mkv follows the HLG \(HDR\) curve.*set the encoding to sRGB",
    ),
    "PQ": (lambda path: clip(path, noise(1), color_trc=16), r"x.mkv follows the PQ \(HDR\) curve"),
}


@pytest.mark.parametrize("kind", BAD)
def test_bad_videos_get_one_sentence(tmp_path: Path, kind: str, capfd: pytest.CaptureFixture[str]) -> None:
    clip(tmp_path / "a.mkv", noise(1))
    spoil, words = BAD[kind]
    spoil(tmp_path / "x.mkv")
    with pytest.raises(InputError, match=words) as caught:
        decoded(tmp_path / "x.mkv")
    assert "\n" not in str(caught.value) and len(str(caught.value)) < 400 + len(str(tmp_path))
    assert capfd.readouterr().err == ""


def test_colours_that_cannot_be_converted_get_one_sentence(tmp_path: Path) -> None:
    ictcp = 14
    [frame] = decoded(clip(tmp_path / "a.mkv", noise(1), kind="yuv444p", colorspace=ictcp))
    with pytest.raises(InputError, match=r"^a\.mkv, frame 1: its colours cannot be converted to RGB \(.*\); convert"):
        frame.source.photo()


def test_a_size_beyond_reason_is_refused_before_memory_is_asked_for(tmp_path, monkeypatch) -> None:
    path = clip(tmp_path / "a.mkv", noise(1))
    monkeypatch.setattr("mpsnet_core.estimate.sequence.video.MAX_PIXELS", WIDTH * HEIGHT - 1)
    with pytest.raises(InputError, match=r"a\.mkv is 40 x 24, above"):
        decoded(path)


# --- the command ------------------------------------------------------------------------------------------------------


def spheres(sphere: Sphere, count: int) -> list[np.ndarray]:
    """The sphere, a little brighter each frame, in 16 bits."""
    return [np.rint(np.clip(sphere.image * (0.5 + 0.05 * k), 0, 1) * 65535).astype(np.uint16) for k in range(count)]


def test_a_video_becomes_numbered_normal_maps(tmp_path: Path, mpsnet, rig_file: Path, sphere: Sphere) -> None:
    path = clip(tmp_path / "turn.mkv", spheres(sphere, 5), "ffv1", "gbrp16le", color_trc=8)
    mask = write_file(tmp_path / "mask.png", sphere.mask, "uint8")
    command = ["estimate", path, "--rig", rig_file, "--model", "lambertian", "--mask", mask, "-o", tmp_path / "out"]
    done = mpsnet(*command, "--progress", "json")
    assert (done.returncode, done.stderr) == (0, "")
    lines = [json.loads(line) for line in done.stdout.splitlines()]
    told = [line["progress"] for line in lines[:-1]]
    assert told == sorted(told) and told[-1] == 1
    result = lines[-1]["result"]
    assert listing(tmp_path / "out") == [f"turn_{number:06d}_normals.png" for number in range(1, 6)]
    assert (result["first"], result["count"], result["frame_rate"]) == (1, 5, 24)
    assert result["pattern"] == "turn_######_normals.png"
    assert result["first_output"] == str(tmp_path / "out" / "turn_000001_normals.png")
    normals = read_normals(tmp_path / "out" / "turn_000003_normals.png")
    np.testing.assert_allclose(normals.vectors[sphere.lit], sphere.normals[sphere.lit], atol=2e-3)
    again = mpsnet(*command)
    assert again.stdout.endswith("0 made, 5 there already\n")


@pytest.mark.parametrize(
    ("arguments", "words"),
    [
        (["--layer", "B"], "turn.mkv is a video, which has no layers; leave --layer out"),
        (["--confidence", "c.png"], "--confidence takes one photo at a time"),
        (["-o", "out.png"], "out.png is one file, but .*turn.mkv is a video; give a folder"),
    ],
)
def test_options_that_do_not_go_with_a_video(tmp_path, mpsnet, rig_file, sphere, arguments: list[str], words: str):
    path = clip(tmp_path / "turn.mkv", spheres(sphere, 1), "ffv1", "gbrp16le", color_trc=8)
    done = mpsnet("estimate", path, "--rig", rig_file, "-o", tmp_path / "out", *arguments)
    assert done.returncode == 2
    assert len(done.stderr.splitlines()) == 1
    assert re.search(words, done.stderr), done.stderr
    assert not (tmp_path / "out").exists()
