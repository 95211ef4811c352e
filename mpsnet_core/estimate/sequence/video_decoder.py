"""Videos that another program decodes: Blender, which has FFmpeg, does so for its extension, which has no PyAV.

The program's command stands in the environment (:data:`mpsnet_core.io.files.VIDEO_DECODER`); the video is added at its
end. Its protocol is that of :mod:`mpsnet_core.io.child_process`::

    {"result": {"width": 1920, "height": 1080, "frame_rate": 25.0, "count": 250}}    first; upright
    {"frame": 7}                                                                     a request; numbers from 1
    {"result": {"file": "/tmp/frame.tif"}}                                           there until the next request
    {"error": "a sentence"}                                                          in place of either

It ends at the end of its input.
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

# Blender's start, and the search for a frame in a long video.
ANSWER_SECONDS = 120.0


class VideoDecoder:
    """A program that decodes the video at `path`, which ends when nobody holds this any more.

    Attributes `width`, `height`, `frame_rate` and `count` are those of :class:`Video`. Raises FormatError where the
    program cannot decode the video.
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
        """The pixels of a frame. Called by one thread at a time."""
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
