"""HEIC and AVIF photos, read with pillow-heif and Pillow (extra ``heif``)."""

from importlib import import_module
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio
from numpy.typing import NDArray

from mpsnet_core.errors import FormatError, InputError
from mpsnet_core.io.file_kinds import AVIF, TRANSFER, file_head
from mpsnet_core.io.image import MAX_PIXELS
from mpsnet_core.io.opening import DAMAGED

# A file's colour properties are within this many bytes.
PROPERTIES = 65_536


class HeifReader:
    """A file's first picture, upright, behind those methods of OpenImageIO's readers that this package uses.

    kind: what the file is. Raises InputError if the libraries are not installed, FormatError if it is damaged or too
    large.
    """

    def __init__(self, path: Path, kind: str) -> None:
        try:
            heif, pillow, turn = map(import_module, ("pillow_heif", "PIL.Image", "PIL.ImageOps"))
        except ModuleNotFoundError:
            raise InputError(
                f"{path} is {kind}, which needs pillow-heif: pip install '.[heif]' in a copy of the repository, or "
                "convert it to a PNG or TIFF"
            ) from None
        try:
            with path.open("rb") as file:
                is_avif = kind == AVIF
                image = (
                    pillow.open(file, formats=[kind]) if is_avif else heif.open_heif(file, convert_hdr_to_8bit=False)
                )
                _check_size(path, *image.size)
                self._values = np.atleast_3d(np.asarray(turn.exif_transpose(image) if is_avif else image))
        except InputError:
            raise
        except DAMAGED as error:
            raise FormatError(f"{path} is damaged or cut short ({error}); copy or export it again") from None
        height, width, channels = self._values.shape
        self._spec = oiio.ImageSpec(width, height, channels, str(self._values.dtype))
        self._spec.attribute("oiio:UnassociatedAlpha", 1)
        if profile := image.info.get("icc_profile"):
            size = oiio.TypeDesc(f"uint8[{len(profile)}]")
            self._spec.attribute("ICCProfile", size, np.frombuffer(profile, np.uint8))
        _, found, colour = file_head(path, PROPERTIES).partition(b"colrnclx")
        if found and len(colour) > 4:
            self._spec.attribute(TRANSFER, int.from_bytes(colour[2:4], "big"))

    def spec(self) -> Any:
        """The size, the channels and what the file states of its colours."""
        return self._spec

    def seek_subimage(self, subimage: int, _: int) -> bool:
        """Whether there is such a picture: the first alone is read."""
        return subimage == 0

    def read_image(self, _: int, __: int, first: int, end: int, kind: Any) -> NDArray[Any]:
        """(H, W, end - first) stored values."""
        return self._values[..., first:end]

    def format_name(self) -> str:
        """As for OpenImageIO's readers."""
        return "heif"

    def geterror(self) -> str:
        """No error: they are raised."""
        return ""

    def close(self) -> None:
        """Nothing is open."""


def _check_size(path: Path, width: int, height: int) -> None:
    if not 0 < width * height <= MAX_PIXELS:
        most = f"{MAX_PIXELS // 10**6} megapixels"
        raise FormatError(f"{path} claims to be {width} x {height}, more than this program reads ({most})")
