"""Decode videos by another program: Blender, which has FFmpeg, does so for its extension, which has no PyAV.

An environment variable holds the program's command (:data:`mpsnet_core.io.files.VIDEO_DECODER`); the video's path is
appended to it. The protocol is that of :mod:`mpsnet_core.io.child_process`::

    {"result": {"width": 1920, "height": 1080, "frame_rate": 25.0, "count": 250}}    first; upright
    {"frame": 7}                                                                     a request; numbers from 1
    {"result": {"file": "/tmp/frame.tif"}}                                           exists until the next request
    {"error": "a sentence"}                                                          instead of either

The program ends when its input ends.
"""

import json
import os
import weakref
from collections.abc import Mapping
from pathlib import Path
from typing import Any

from mpsnet_core.errors import FormatError
from mpsnet_core.io.child_process import ChildEnded, ChildProcess, child_environment
from mpsnet_core.io.files import VIDEO_DECODER
from mpsnet_core.io.image import Image
from mpsnet_core.io.image_encoding import Encoding
from mpsnet_core.io.image_reading import read_image

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
