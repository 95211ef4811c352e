"""Frames that Blender decodes for the core where PyAV is not installed: those that PyAV encoded, in order and value."""

import json
import sys
from fractions import Fraction

import numpy as np
import pytest

from blender_addon.child_process.core_process import blender_command
from mpsnet_core.capture.open import Source
from mpsnet_core.errors import InputError
from mpsnet_core.estimate.sequence.source import Masks
from mpsnet_core.estimate.sequence.video import read_video_header, video_frames, video_outputs
from mpsnet_core.io.files import VIDEO_DECODER

av = pytest.importorskip("av")

HEIGHT, WIDTH = 24, 40
FORMATS = {("uint8", 3): "rgb24", ("uint16", 3): "rgb48le", ("uint8", 4): "rgba"}


@pytest.fixture
def header(monkeypatch):
    """Reads a video's header where there is no PyAV."""

    def read(path, encoding="auto"):
        monkeypatch.setenv(VIDEO_DECODER, json.dumps(blender_command("decode")))
        monkeypatch.setitem(sys.modules, "av", None)
        return read_video_header(path, encoding=encoding)

    return read


def clip(path, frames, codec, kind, rate):
    """Encode (H, W, 3 or 4) frames without loss."""
    with av.open(str(path), "w") as container:
        stream = container.add_stream(codec, rate=rate)
        stream.height, stream.width, stream.pix_fmt = HEIGHT, WIDTH, kind
        for values in frames:
            picture = av.VideoFrame.from_ndarray(values, format=FORMATS[values.dtype.name, values.shape[2]])
            container.mux(stream.encode(picture.reformat(format=kind)))
        container.mux(stream.encode(None))
    return path


@pytest.mark.parametrize(
    ("name", "codec", "kind", "depth", "rate", "error"),
    [
        ("a.mkv", "ffv1", "bgr0", np.uint8, Fraction(30000, 1001), 2e-5),
        ("a.mkv", "ffv1", "gbrp16le", np.uint16, Fraction(25), 6e-4),
        ("a.mov", "png", "rgba", np.uint8, Fraction(24), 4e-3),
    ],
    ids=["8 bits at an odd rate", "16 bits", "alpha"],
)
def test_every_frame_comes_out_in_order(header, tmp_path, name, codec, kind, depth, rate, error):
    random, most = np.random.default_rng(4), np.iinfo(depth).max
    given = list(random.integers(0, most + 1, (40, HEIGHT, WIDTH, 4 if kind == "rgba" else 3), depth))
    video = header(clip(tmp_path / name, given, codec, kind, rate), "linear")
    assert (video.width, video.height, video.count) == (WIDTH, HEIGHT, 40)
    assert video.frame_rate == pytest.approx(float(rate), rel=1e-6)
    outputs = video_outputs(video.path, tmp_path, ".png")
    frames = list(video_frames(video, outputs, masks=Masks(), like=Source(video.path, None), encoding="linear"))
    assert [frame.number for frame in frames] == list(range(1, 41))
    for frame, values in zip(frames, given, strict=True):
        image, expected = frame.source.photo(), values / most
        cover = expected[..., 3] if kind == "rgba" else np.ones((HEIGHT, WIDTH))
        # A premultiplied value holds no colour where nothing covers.
        np.testing.assert_allclose(image.pixels * cover[..., None], expected[..., :3] * cover[..., None], atol=error)
        assert (image.alpha is None) == (kind != "rgba") and image.clip == 1.0
        if image.alpha is not None:
            np.testing.assert_allclose(image.alpha, cover, atol=1e-5)


def test_what_is_no_video_gets_one_sentence(header, tmp_path):
    (tmp_path / "x.mkv").write_text("no video")
    with pytest.raises(InputError, match=r"x\.mkv cannot be read as a video"):
        header(tmp_path / "x.mkv")


@pytest.mark.parametrize("text", ["ffconcat version 1.0\nfile real.mkv\n", "#EXTM3U\n#EXTINF:1,\nreal.mkv\n"])
def test_a_playlist_by_a_videos_name_opens_no_other_file(header, tmp_path, text):
    clip(tmp_path / "real.mkv", [np.zeros((HEIGHT, WIDTH, 3), np.uint8)] * 4, "ffv1", "bgr0", 25)
    (tmp_path / "list.mkv").write_text(text)
    with pytest.raises(InputError, match=r"list\.mkv cannot be read as a video"):
        header(tmp_path / "list.mkv")
