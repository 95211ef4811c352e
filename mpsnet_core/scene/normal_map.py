"""NormalMap: a unit vector for every pixel; its encodings in files; the angular error."""

import os
from dataclasses import InitVar, dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.arrays.row_bands import bands
from mpsnet_core.errors import InputError, check_choice
from mpsnet_core.io.images import read_channel, read_data, write_bands

Convention = Literal["opengl", "directx"]
CONVENTIONS: tuple[Convention, ...] = ("opengl", "directx")
# The share of a map's normals that must face outwards, or the camera, for the map to be of the space it is taken for.
OUTWARDS_SHARE = 0.9


@dataclass(frozen=True)
class NormalMap:
    """Surface normals in camera space (x right, y up, z towards the camera).

    vectors: (H, W, 3) float32, or float16 where they are given so; unit length inside the mask, zero outside;
        normalised here.
    mask: (H, W) bool.
    confidence: (H, W) of the same type, in 0 to 1, zero outside the mask; 1 inside it unless given.
    in_place: normalise the arrays as they are given, rather than copies.

    Raises InputError where the shapes do not agree or the mask is empty.
    """

    vectors: NDArray[np.float32]
    mask: NDArray[np.bool_]
    confidence: NDArray[np.float32] = field(default_factory=lambda: np.ones((), np.float32))
    in_place: InitVar[bool] = False

    def __post_init__(self, in_place: bool) -> None:
        vectors, mask = np.asarray(self.vectors), np.asarray(self.mask, bool)
        if vectors.dtype != np.float16:
            vectors = vectors.astype(np.float32, copy=False)
        if vectors.shape != (*mask.shape, 3) or mask.ndim != 2:
            raise InputError(f"normals of shape {vectors.shape} do not fit a mask of shape {mask.shape}")
        if not mask.any():
            raise InputError("the normal map's mask is empty; there is nothing to work on")
        confidence = np.asarray(self.confidence)
        if confidence.shape not in ((), mask.shape):
            raise InputError(f"a confidence of shape {confidence.shape} does not fit a mask of shape {mask.shape}")
        unit, trust = vectors, confidence
        if not in_place:
            unit, trust = np.empty_like(vectors), np.empty(mask.shape, vectors.dtype)
        confidence = np.broadcast_to(confidence, mask.shape)
        for rows in bands(len(mask)):
            unit[rows] = np.where(mask[rows, :, None], normalised(vectors[rows].astype(np.float32)), 0)
            trust[rows] = np.where(mask[rows], np.clip(confidence[rows], 0, 1), 0)
        object.__setattr__(self, "vectors", unit)
        object.__setattr__(self, "mask", mask)
        object.__setattr__(self, "confidence", trust)


def normalised(vectors: NDArray[Any]) -> NDArray[Any]:
    """Vectors (..., 3) brought to unit length; those without a direction become +z, never NaN."""
    length = np.sqrt(np.einsum("...i,...i->...", vectors, vectors))
    unit = vectors / np.maximum(length, vectors.dtype.type(1e-12))[..., None]
    unit[length <= 1e-12] = (0, 0, 1)
    return unit


def angular_error(estimate: NDArray[Any], truth: NDArray[Any]) -> NDArray[np.float64]:
    """Angle in degrees between unit vectors (..., 3); accurate near 0° and 180°, where arccos is not."""
    a, b = np.asarray(estimate, np.float64), np.asarray(truth, np.float64)
    return np.degrees(2 * np.arctan2(np.linalg.norm(a - b, axis=-1), np.linalg.norm(a + b, axis=-1)))


def encode(vectors: NDArray[Any], convention: Convention = "opengl") -> NDArray[np.float32]:
    """Vectors (..., 3) as colours 0.5 + 0.5 n; green down for DirectX."""
    return (0.5 + 0.5 * np.asarray(vectors, np.float32) * _signs(convention)).astype(np.float32)


def decode(colours: NDArray[Any], convention: Convention = "opengl") -> NDArray[np.float32]:
    """Colours (..., 3) back to unit vectors; the inverse of :func:`encode`."""
    return normalised((np.asarray(colours, np.float32) * 2 - 1) * _signs(convention))


def check_convention(convention: str) -> None:
    """Raises InputError where `convention` is neither "opengl" nor "directx"."""
    check_choice("convention", convention, CONVENTIONS)


def _signs(convention: Convention) -> NDArray[np.float32]:
    check_convention(convention)
    return np.array([1, 1 if convention == "opengl" else -1, 1], dtype=np.float32)


def write_normals(
    path: str | os.PathLike[str],
    normals: NormalMap,
    *,
    convention: Convention = "opengl",
    bits: int | None = None,
    description: str | None = None,
) -> None:
    """Write camera-space normals as colours with the mask as alpha: PNG or TIFF (16 bits) or EXR (float).

    description: a line of text to be kept in the file, see :func:`mpsnet_core.io.images.write_image`.
    """
    height, width = normals.mask.shape

    def colours(rows: slice) -> NDArray[np.float32]:
        return np.concatenate([encode(normals.vectors[rows], convention), normals.mask[rows, :, None]], axis=-1)

    write_bands(path, (height, width, 4), colours, bits=bits, description=description)


def read_normals(
    path: str | os.PathLike[str],
    *,
    convention: Convention = "opengl",
    confidence: str | os.PathLike[str] | None = None,
) -> NormalMap:
    """Read camera-space normals written by :func:`write_normals`, or any such map.

    Without alpha the mask is where the colours decode to a vector of about unit length. confidence: a map of the same
    size, 0 to 1, in a file of its own; 1 everywhere unless given.

    Raises InputError where the file is not a normal map, or the confidence is of another size.
    """
    colours, alpha = read_data(path)
    length = np.linalg.norm(colours * 2 - 1, axis=-1)
    unit = np.abs(length - 1) < 0.1
    mask = unit if alpha is None else alpha > 0.5
    if not np.isfinite(colours[mask]).all():
        raise InputError(f"{path} holds values that are not finite inside its mask; estimate the normals again")
    if alpha is not None and not mask.any():
        raise InputError(f"{path} holds no normals: its mask is empty; estimate them again")
    if not mask.any() or unit[mask].mean() < 0.5:
        raise InputError(f"{path} is not a normal map: its colours are not unit vectors 0.5 + 0.5 n; choose another")
    if confidence is None:
        return NormalMap(decode(colours, convention), mask)
    return NormalMap(decode(colours, convention), mask, read_channel(confidence))
