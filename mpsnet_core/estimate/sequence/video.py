"""Videos as a source of frames, decoded one at a time by FFmpeg through PyAV (extra ``video``).

Without PyAV, another program may decode videos: Blender does for its extension. Its frames have a constant rate, so a
frame is repeated where the video pauses, and the last one up to the duration in the header. That program does not
report a video's transfer curve.
"""

import json
import logging
import os
import weakref
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.capture.open import Source
from mpsnet_core.defaults import ENCODINGS
from mpsnet_core.errors import FileError, FormatError, InputError, check_choice
from mpsnet_core.estimate.sequence.source import Frame, Masks
from mpsnet_core.io.child_process import ChildEnded, ChildProcess, child_environment
from mpsnet_core.io.files import VIDEO_DECODER, checked_bits, existing_file, file_suffix
from mpsnet_core.io.frames import RESULT, results_folder
from mpsnet_core.io.image import MAX_PIXELS, Image, srgb_to_linear
from mpsnet_core.io.image_encoding import UNKNOWN_TRANSFER, Encoding, transfer_is_linear
from mpsnet_core.io.image_reading import read_image
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.provenance import fingerprint

if TYPE_CHECKING:
    from av import VideoFrame
    from av.container import InputContainer
    from av.video.stream import VideoStream


# --- decode videos by another program: Blender, which has FFmpeg, does so for its extension, which has no PyAV --------
# An environment variable holds the program's command (:data:`mpsnet_core.io.files.VIDEO_DECODER`); the video's path is
# appended to it. The protocol is that of :mod:`mpsnet_core.io.child_process`::
#
# {"result": {"width": 1920, "height": 1080, "frame_rate": 25.0, "count": 250}} first; upright {"frame": 7} a request;
# numbers from 1 {"result": {"file": "/tmp/frame.tif"}} exists until the next request {"error": "a sentence"} instead of
# either
#
# The program ends when its input ends.


# Enough for Blender's start, or for seeking in a long video.
ANSWER_SECONDS = 120.0


class VideoDecoder:
    """A program that decodes the video at `path`. It ends when this object is garbage collected.

    Attributes `width`, `height`, `frame_rate` and `count` are as in :class:`Video`. Raises FormatError if the program
    cannot decode the video.
    """

    def __init__(self, path: Path) -> None:
        self._path = path
        command = [*json.loads(os.environ[VIDEO_DECODER]), str(path.resolve())]
        self._child = ChildProcess(command, child_environment())
        weakref.finalize(self, self._child.close)
        header = self._answer()
        self.width, self.height, self.count = (int(header[name]) for name in ("width", "height", "count"))
        self.frame_rate = float(header["frame_rate"])

    def read(self, number: int, encoding: Encoding) -> Image:
        """Read the pixels of a frame. Not thread-safe."""
        self._child.send({"frame": number})
        return read_image(self._answer()["file"], encoding=encoding)

    def _answer(self) -> Mapping[str, Any]:
        try:
            message = self._child.receive(ANSWER_SECONDS)
        except ChildEnded as end:
            raise FormatError(f"{self._path} cannot be decoded ({end}); convert it, to H.264 for instance") from None
        if "error" in message:
            raise FormatError(message["error"])
        return dict(message["result"])


log = logging.getLogger(__name__)

# Allow only files that contain the video itself. FFmpeg's playlists refer to other files and to URLs.
_OPEN = {"protocol_whitelist": "file", "format_whitelist": "avi,matroska,webm,mov,mp4,m4a,3gp,3g2,mj2,mpegts,mxf"}

# Matrix coefficients by their codes in ITU-T H.273.
_UNKNOWN, _BT709 = 2, 1
# If the matrix is not stated, images below this height use BT.601, others BT.709.
_HD_HEIGHT = 720

# Flags of FFmpeg's scaler (swscale.h): bilinear, full chroma interpolation, accurate rounding. Without them the
# subsampled chroma of most videos makes colours up to 2.4 of 255 darker, most of all green.
_EXACT = 0x2 | 0x2000 | 0x4000 | 0x40000

# Share of the frames in the header that may be missing, because its duration is rounded.
_SHORT = 0.02


@dataclass(frozen=True)
class Video:
    """A video's header."""

    path: Path
    """The file."""
    width: int
    """Width as stored, before rotation."""
    height: int
    """Height as stored, before rotation."""
    frame_rate: float
    """Average number of frames per second."""
    count: int
    """Approximate number of frames, 0 if unknown."""
    decoder: VideoDecoder | None = None
    """The program that decodes it; None for PyAV."""


def read_video_header(path: AnyPath, *, encoding: Encoding = "auto") -> Video:
    """Read a video's header, and report the transfer curve that is assumed for its values.

    Raises FileError if the file is missing or PyAV is not installed, FormatError if the file is damaged or too large,
    or has a transfer curve that "auto" does not invert.
    """
    path = existing_file(path, "video")
    check_choice("encoding", encoding, ENCODINGS)
    if not _has_pyav() and VIDEO_DECODER in os.environ:
        decoder = VideoDecoder(path)
        _check_size(path, decoder.width, decoder.height)
        curve = _curve(path, UNKNOWN_TRANSFER, encoding)
        log.info("video read as %s%s", curve, ", as requested" if encoding != "auto" else "")
        return Video(path, decoder.width, decoder.height, decoder.frame_rate, decoder.count, decoder)
    with _opened(path) as container:
        stream = container.streams.video[0]
        codec = stream.codec_context
        curve = _curve(path, codec.color_trc, encoding)
        rate = float(stream.average_rate or stream.guessed_rate or 0)
        seconds = (container.duration or 0) / 1e6
        if stream.duration and stream.time_base:
            seconds = float(stream.duration * stream.time_base)
        log.info("video read as %s%s", curve, ", as requested" if encoding != "auto" else "")
        if codec.pix_fmt and ("420" in codec.pix_fmt or "422" in codec.pix_fmt or codec.pix_fmt in ("nv12", "p010le")):
            words = "the video stores colour at half its resolution (%s), and each light is one colour, so the normals "
            log.info(words + "are as coarse; record 4:4:4 video or frames if you can", codec.pix_fmt)
        aspect = stream.sample_aspect_ratio
        if aspect and aspect != 1:
            words = "the video's pixels are not square (%s:%s), and the normals are those of the stored picture; "
            log.warning(words + "convert it to square pixels", aspect.numerator, aspect.denominator)
        return Video(path, codec.width, codec.height, rate, stream.frames or round(seconds * rate))


def video_outputs(video: Path, folder: AnyPath, kind: str | None) -> Callable[[int], Path]:
    """Files for the normals of a video's frames, by number from 1: NAME_000001_normals in `folder`.

    kind: file type such as "png", the default. Raises InputError if `folder` is unusable.
    """
    target = results_folder(folder, f"{video} is a video")
    suffix = file_suffix(kind or "png")
    checked_bits(Path(f"normals{suffix}"))
    return lambda number: target / f"{video.stem}_{number:06d}{RESULT}{suffix}"


def video_frames(
    video: Video,
    outputs: Callable[[int], Path],
    *,
    masks: Masks,
    like: Source,
    reach: int = 0,
    encoding: Encoding = "auto",
) -> Iterator[Frame]:
    """All frames that FFmpeg decodes, in presentation order, regardless of their timestamps; numbered from 1.

    Values are converted to full-range RGB by the video's matrix, rotated upright, and linearised by `encoding`. "auto"
    assumes sRGB, which is close to BT.709, unless the video states that it is linear.

    like, reach: as in `photo_frames`. The latter matters for masks only, because all frames are from the same file.

    A truncated or damaged video ends where it becomes unreadable, with a warning. Raises FormatError if nothing can be
    read, or the frame size changes.
    """
    stamp = fingerprint(video.path)

    def frame(number: int, read: Callable[[], Image]) -> Frame:
        made_from = "\n".join([stamp, str(number), *masks.mask_identity(number, reach)])
        source = replace(like, photo=read, mask=masks.of(number), name=f"{video.path.name}, frame {number}")
        return Frame(number, source, outputs(number), made_from)

    if video.decoder is not None:
        curve = _curve(video.path, UNKNOWN_TRANSFER, encoding)
        for number in range(1, video.count + 1):
            yield frame(number, partial(video.decoder.read, number, "linear" if curve == "linear" else "srgb"))
        return
    with _opened(video.path) as container:
        stream = container.streams.video[0]
        linear = _curve(video.path, stream.codec_context.color_trc, encoding) == "linear"
        number, damage = 0, ""
        decoded = _decoded(container, stream)
        while True:
            try:
                picture = next(decoded, None)
            except FormatError as error:
                picture, damage = None, f" ({error})"
            if picture is None:
                break
            number += 1
            if (picture.width, picture.height) != (video.width, video.height):
                words = f"{video.path}: frame {number} is {picture.width} x {picture.height}, not {video.width} x "
                raise FormatError(f"{words}{video.height}; cut the video where its size changes")
            yield frame(number, partial(_image, picture, linear, f"{video.path.name}, frame {number}"))
    if number == 0:
        raise FormatError(f"{video.path} holds no frame that can be read{damage}; copy or export it again")
    if damage or video.count - number > max(2, _SHORT * video.count):
        promised = f" of about {video.count}" if video.count else ""
        log.warning("%s ends after %d%s frames%s: is it cut short or damaged?", video.path, number, promised, damage)


def _image(picture: "VideoFrame", linear: bool, name: str) -> Image:
    """A decoded frame as linear pixels, upright."""
    import av

    parts = picture.format.components
    deep, alpha = any(part.bits > 8 for part in parts), any(part.is_alpha for part in parts)
    matrix = int(picture.colorspace)
    if matrix == _UNKNOWN and picture.height >= _HD_HEIGHT:
        matrix = _BT709
    # Planar formats for deep colour: FFmpeg's conversion of subsampled chroma to rgb48le is wrong at odd widths.
    kind = {(False, False): "rgb24", (True, False): "gbrp16le", (False, True): "rgba", (True, True): "gbrap16le"}
    try:
        values: NDArray[Any] = picture.to_ndarray(format=kind[deep, alpha], src_colorspace=matrix, interpolation=_EXACT)
    except (av.FFmpegError, OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FormatError(f"{name}: its colours cannot be converted to RGB ({reason}); convert the video") from None
    values = np.rot90(values, round(picture.rotation / 90))
    steps = np.linspace(0, 1, 65536 if deep else 256)
    curve = (steps if linear else srgb_to_linear(steps)).astype(np.float32)
    cover = values[..., 3].astype(np.float32) / np.float32(len(steps) - 1) if alpha else None
    return Image(curve[values[..., :3]], cover, 1.0)


def _curve(path: Path, transfer: int, encoding: Encoding) -> str:
    """The transfer curve that is assumed for a video's values, "linear" or "sRGB"."""
    if encoding != "auto":
        return "linear" if encoding == "linear" else "sRGB"
    return "linear" if transfer_is_linear(path, transfer) else "sRGB"


def _check_size(path: Path, width: int, height: int) -> None:
    if width * height > MAX_PIXELS or width * height == 0:
        raise FormatError(f"{path} is {width} x {height}, above {MAX_PIXELS // 10**6} megapixels; scale it down")


def _has_pyav() -> bool:
    try:
        import av  # noqa: F401
    except ImportError:
        return False
    return True


def _opened(path: Path) -> "InputContainer":
    """The video's container, to be closed after use."""
    if not _has_pyav():
        raise FileError(f"{path} is a video, which needs PyAV: pip install '.[video]' in a copy of the repository")
    import av

    try:
        container = av.open(f"file:{path}", options=dict(_OPEN))
    except (av.FFmpegError, OSError, ValueError) as error:
        reason = getattr(error, "strerror", None) or str(error)
        raise FormatError(f"{path} cannot be read as a video ({reason}); check that it is complete") from None
    try:
        if not container.streams.video:
            raise FormatError(f"{path} holds no pictures, only sound or text; choose another")
        codec = container.streams.video[0].codec_context
        if codec is None:
            raise FormatError(f"{path} uses a codec that this FFmpeg does not have; convert it, to H.264 for instance")
        _check_size(path, codec.width, codec.height)
        codec.options = {"max_pixels": str(MAX_PIXELS)}  # a frame's own header may state another size
    except InputError:
        container.close()
        raise
    return container


def _decoded(container: "InputContainer", stream: "VideoStream") -> Iterator["VideoFrame"]:
    import av

    stream.thread_type = "AUTO"
    try:
        yield from container.decode(stream)
    except (av.FFmpegError, OSError, ValueError) as error:
        raise FormatError(getattr(error, "strerror", None) or str(error)) from None
