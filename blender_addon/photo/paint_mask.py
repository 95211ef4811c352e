"""Painting of the mask: an image of the photo, bright on the object and dark elsewhere, for any brush.

Opaque pixels above half brightness are the object: white adds to it, black or an eraser removes from it. The next
estimate reads the current state of the image.
"""

from collections.abc import Sequence
from pathlib import Path
from typing import Any

import bpy
import numpy as np
from numpy.typing import NDArray

from mpsnet_core.capture.operations import FindMask

from ..images import image_file, paint_grey, pixels_of
from ..operators.core_run import RunsCore
from ..operators.show_image import show_image
from .options import painted_mask, reading

# Ranges of values outside the object and on it, below and above one half.
_OUTSIDE, _INSIDE = (0.02, 0.4), (0.6, 0.95)


class MPS_OT_paint_mask(RunsCore, bpy.types.Operator):
    """Open the photo's mask in an Image Editor to paint on it: white adds to the object, black takes away.

    The next estimate uses it as it is painted then. Press again to see what it comes to"""

    bl_label = "Paint Mask"
    requires = "photo"

    def prepare(self, context: Any, folder: Path) -> tuple[FindMask, Sequence[Path]]:
        scene = context.scene
        estimate = scene.mps.estimate
        photo = image_file(scene.mps.photo.image, "photo", "render or open one first")
        there = Path(bpy.app.tempdir)  # a temporary file; the image itself is packed into the .blend file
        self._mask, self._shown = there / "mpsnet_mask.png", there / "mpsnet_mask_shown.png"
        options = reading(estimate, painted=painted_mask(estimate, folder))
        operation = FindMask(image=str(photo), output=str(self._mask), overlay=str(self._shown), **options)
        return operation, [self._mask, self._shown]

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        estimate = self.rig("its mask is not painted").estimate
        mask, shown = _values(self._mask) > 0.5, _values(self._shown)
        picture = np.where(mask, np.interp(shown, (0, 1), _INSIDE), np.interp(shown, (0, 1), _OUTSIDE))
        image = estimate.painted_mask
        if image is None or tuple(image.size) != mask.shape[::-1]:
            image = bpy.data.images.new("MPS Painted Mask", *mask.shape[::-1], alpha=True, is_data=True)
        paint_grey(image, picture)
        image.update()
        image.pack()
        estimate.painted_mask, estimate.mask = image, "PAINTED"
        self.made(image)
        show_image(context, image, "PAINT")


def _values(file: Path) -> NDArray[np.float32]:
    """(H, W) the mean of an image's colours, bottom row first. Removes the file."""
    image = bpy.data.images.load(str(file), check_existing=False)
    try:
        image.colorspace_settings.is_data = True  # values as stored in the file
        pixels = pixels_of(image)
    finally:
        bpy.data.images.remove(image)
        file.unlink()
    values: NDArray[np.float32] = pixels[..., :3].mean(axis=-1)
    return values
