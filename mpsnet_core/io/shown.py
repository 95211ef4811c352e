"""How results look in a notebook: a line of facts, a picture, and the array inside."""

import sys
from typing import Any, ClassVar

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.types import F32

# Longest side of a notebook's picture, in pixels.
LONGEST = 640


class Shown:
    """A result of an array for each pixel. A subclass names that array and has facts and a picture of it."""

    array_name: ClassVar[str]
    """The field that ``np.asarray`` takes."""

    def facts(self) -> str:
        """What a line says of it besides its size."""
        raise NotImplementedError

    def picture(self, step: int = 1) -> F32:
        """(h, w, 3) sRGB values to look at, of every `step`-th pixel along each side."""
        raise NotImplementedError

    @property
    def shape(self) -> tuple[int, ...]:
        """The shape of its array: height, width, and channels if it has any."""
        return getattr(self, self.array_name).shape

    def __array__(self, dtype: Any = None, copy: bool | None = None) -> NDArray[Any]:
        # Matplotlib takes arrays alone, and would clip what is no colour: it gets the picture.
        shown_by_matplotlib = sys._getframe(1).f_globals.get("__name__", "").startswith("matplotlib.")
        values = self.picture() if shown_by_matplotlib else getattr(self, self.array_name)
        return np.array(values, dtype) if copy else np.asarray(values, dtype)

    def __repr__(self) -> str:
        height, width = self.shape[:2]
        return f"<{type(self).__name__} {width} x {height}: {self.facts()}>"

    def _repr_png_(self) -> bytes:
        from mpsnet_core.io.image_writing import png_bytes

        return png_bytes(self.picture(-(-max(self.shape[:2]) // LONGEST)))
