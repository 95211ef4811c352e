"""Normal maps with a unit vector for every pixel, and their encodings in files."""

import re
from dataclasses import InitVar, dataclass, field
from typing import ClassVar

import numpy as np

from mpsnet_core.arrays.resampling import grid_step
from mpsnet_core.arrays.row_bands import FEW_ROWS, bands, on_all_cores
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.defaults import Convention
from mpsnet_core.errors import FormatError, GeometryError
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.image_reading import image_description, read_channel
from mpsnet_core.io.marks import made
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.shown import Shown
from mpsnet_core.scene.normal_encoding import SAMPLED, encode, read_vectors, write_vectors

# The fraction of a map's normals that must face the camera (camera space) or outwards (tangent and object space).
OUTWARDS_SHARE = 0.9
# Vectors within this distance of the median of those that are not of unit length are background.
BACKGROUND = 0.1
_EXPECTED = "expected error {:.2f} degrees"


@dataclass(frozen=True, eq=False, repr=False)
class NormalMap(Shown):
    """Surface normals in camera space (x right, y up, z towards the camera).

    Raises
    ------
    GeometryError
        If the shapes do not agree, the mask is empty, or a value inside it is not finite.

    Examples
    --------
    >>> vectors = np.array([[[0, 0, 2], [1, 0, 0]]], np.float32)
    >>> NormalMap(vectors, np.array([[True, False]])).vectors.tolist()
    [[[0.0, 0.0, 1.0], [0.0, 0.0, 0.0]]]
    """

    array_name: ClassVar[str] = "vectors"

    vectors: F32
    """(H, W, 3) float32 or float16. The normals, normalised here to unit length inside the mask, set to zero
    outside."""
    mask: Bools
    """(H, W) bool. The pixels that have a normal."""
    confidence: F32 = field(default_factory=lambda: np.ones((), np.float32))
    """(H, W) of the same type. Confidence from 0 to 1, set to zero outside the mask; 1 inside it by default."""
    in_place: InitVar[bool] = False
    """Whether to overwrite the given arrays rather than copy them."""

    def __post_init__(self, in_place: bool) -> None:
        vectors, mask = np.asarray(self.vectors), np.asarray(self.mask, bool)
        if vectors.dtype != np.float16:
            vectors = vectors.astype(np.float32, copy=False)
        if vectors.shape != (*mask.shape, 3) or mask.ndim != 2:
            raise GeometryError(f"normals of shape {vectors.shape} do not fit a mask of shape {mask.shape}")
        if not mask.any():
            raise GeometryError("the normal map's mask is empty; there is nothing to work on")
        confidence = np.asarray(self.confidence)
        if confidence.shape not in ((), mask.shape):
            raise GeometryError(f"a confidence of shape {confidence.shape} does not fit a mask of shape {mask.shape}")
        unit, trust = vectors, confidence
        if not in_place:
            unit, trust = np.empty_like(vectors), np.empty(mask.shape, vectors.dtype)
        confidence = np.broadcast_to(confidence, mask.shape)

        def write(rows: slice) -> None:
            with np.errstate(invalid="ignore"):  # infinite vectors are rejected below
                unit[rows] = np.where(mask[rows, :, None], normalised(vectors[rows].astype(np.float32)), 0)
            trust[rows] = np.where(mask[rows], np.clip(confidence[rows], 0, 1), 0)
            if not (np.isfinite(unit[rows]).all() and np.isfinite(trust[rows]).all()):
                raise GeometryError("normals or their confidence are not finite somewhere inside the mask")

        on_all_cores(write, bands(len(mask), FEW_ROWS))
        object.__setattr__(self, "vectors", unit)
        object.__setattr__(self, "mask", mask)
        object.__setattr__(self, "confidence", trust)

    def facts(self) -> str:
        trust = self.confidence.sum(dtype=np.float64) / self.mask.sum()
        return f"{self.mask.sum():,} normals, mean confidence {trust:.2f}"

    @property
    def expected_error(self) -> float:
        """Root mean square of the expected error in degrees; 0 where the confidence is 1."""
        # Outside the mask the confidence is 0.
        doubts = (1 - self.confidence[rows] for rows in bands(len(self.mask)))
        squared = sum(float(np.square(doubt, dtype=np.float32).sum()) for doubt in doubts)
        return 90 * float(np.sqrt(max(squared - np.count_nonzero(~self.mask), 0) / np.count_nonzero(self.mask)))

    def picture(self, step: int = 1) -> F32:
        from mpsnet_core.scene.pictures import on_background

        return on_background(encode(self.vectors[::step, ::step]), self.mask[::step, ::step])


def stating_the_error(normals: NormalMap) -> str:
    """The description of normals whose confidence is that of a network: what error is expected of them."""
    return f"{made('normal map')}, {_EXPECTED.format(normals.expected_error)}"


@takes_files
def write_normals(
    path: AnyPath,
    normals: NormalMap,
    *,
    convention: Convention = "opengl",
    bits: int | None = None,
    description: str | None = None,
) -> None:
    """Write camera-space normals as colours with the mask as alpha. The write is atomic.

    0 is the level 128 of 8 bits, 32768 of 16; float files hold 0.5 + 0.5 n.

    Parameters
    ----------
    path : path-like
        A .png, .tif or .exr file.
    normals : NormalMap
    convention : {"opengl", "directx"}, optional
        Whether green is y or -y.
    bits, description : optional
        See :func:`mpsnet_core.write_image`.

    Raises
    ------
    FileError
        If the file cannot be written.
    SettingsError
        If the format cannot hold `bits`, or the convention is unknown.
    """
    write_vectors(path, normals.vectors, convention=convention, bits=bits, description=description, mask=normals.mask)


def read_normals(path: AnyPath, *, convention: Convention = "opengl", confidence: AnyPath | None = None) -> NormalMap:
    """Read camera-space normals written by :func:`write_normals`, or any such map.

    Which level is 0 in a file of 8 bits, and how z is stored, is detected: see
    :func:`mpsnet_core.scene.normal_encoding.read_vectors`.

    Parameters
    ----------
    path : path-like
        Without an alpha channel the mask is where the colours decode to a vector of about unit length.
    convention : {"opengl", "directx"}, optional
        Whether green is y or -y.
    confidence : path-like, optional
        A separate file with a map of the same size, 0 to 1. By default the expected error that the file's description
        states, as an even confidence, or 1.

    Raises
    ------
    FileError, FormatError
        If a file is missing, cannot be read as an image, or is not a normal map.
    GeometryError
        If the confidence map has another size.
    """
    vectors, alpha = read_vectors(path, convention)
    unit, finite = np.empty(vectors.shape[:2], bool), np.empty(vectors.shape[:2], bool)

    def measured(rows: slice) -> None:
        x, y, z = np.moveaxis(vectors[rows], -1, 0)
        squared = x * x + y * y + z * z
        finite[rows] = np.isfinite(squared)
        unit[rows] = np.abs(np.sqrt(squared) - 1) < 0.1

    on_all_cores(measured, bands(len(vectors), FEW_ROWS))
    has_mask = alpha is not None
    mask = unit if alpha is None else alpha > 0.5
    del alpha  # the normals of a large photo take much memory
    if not finite[mask].all():
        raise FormatError(f"{path} holds values that are not finite inside its mask; estimate the normals again")
    if has_mask and not mask.any():
        raise FormatError(f"{path} holds no normals: its mask is empty; estimate them again")
    if not (unit[mask].mean() >= 0.5 if has_mask else _are_unit(vectors, unit)):
        raise FormatError(f"{path} is not a normal map: its colours are not unit vectors 0.5 + 0.5 n; choose another")
    if confidence is None:
        stated = re.search(_EXPECTED.format(0.0).replace("0.00", r"(\d{1,2}\.\d\d)"), image_description(path))
        trust = np.full(mask.shape, 1 - float(stated[1]) / 90 if stated else 1, np.float32)
    else:
        trust = read_channel(confidence)
    return NormalMap(vectors, mask, trust, in_place=True)


def _are_unit(vectors: F32, unit: Bools) -> bool:
    """Whether most vectors, except a background of one colour, have unit length. In a photo, some do by chance."""
    step = grid_step(unit.size, SAMPLED)
    some = vectors[::step, ::step][~unit[::step, ::step]]
    some = some[np.isfinite(some).all(axis=-1)]
    background = np.median(some, axis=0) if len(some) else np.zeros(3)
    others = sum(
        np.count_nonzero((np.abs(vectors[rows] - background).max(axis=-1) >= BACKGROUND) & ~unit[rows])  # not NaN
        for rows in bands(len(vectors))
    )
    return bool(np.count_nonzero(unit) > others)
