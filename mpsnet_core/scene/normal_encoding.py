"""How the numbers of a file stand for normals: the one place where vectors become colours, and colours vectors.

Of the levels of 8 bits, 0 to 255, none is in the middle. Two conventions are in use: byte 128 is zero, n = (v - 128) /
127, or 127.5 is, n = (v - 127.5) / 127.5, which rounds to 127 or 128. They differ by 0.22 degrees for each of x and y,
which integration adds up. Files are written with the former, in 16 bits accordingly with 32768, because in all programs
a flat area is then the same colour, without a step towards its neighbours. Which one a file has is found out.
"""

import logging
from dataclasses import dataclass
from typing import Literal

import numpy as np

from mpsnet_core.arrays.resampling import grid_step
from mpsnet_core.arrays.row_bands import FEW_ROWS, bands, on_all_cores
from mpsnet_core.arrays.types import F32, F64, Bools, Floats
from mpsnet_core.defaults import Convention
from mpsnet_core.errors import Choices
from mpsnet_core.io.files import stored_levels
from mpsnet_core.io.image_reading import read_data
from mpsnet_core.io.image_writing import write_bands
from mpsnet_core.io.marks import made
from mpsnet_core.io.opening import AnyPath

log = logging.getLogger(__name__)

# The sign of y in the green channel.
_GREEN = Choices("convention", {"opengl": 1, "directx": -1})
SAMPLED = 1 << 18  # pixels of a large map that are examined
# The highest level of 8 bits, the same if they are the upper ones of 16, and of 16 bits.
_BYTE, _UPPER_BYTE, _WORD = 255.0, 65535 / 256, 65535.0
# Fraction of the levels by which float32 may round, and half floats.
_ROUNDED, _ROUNDED_TO_HALF = 2e-7, 2.6e-4
# Horizontal length from which on a normal's own length shows which level is zero.
_STEEP = 0.18
# The zero is known if its standard error, and its distance from the next possible one, are below these levels.
_KNOWN, _NEAR = 0.09, 0.15
# The mean of the slopes is this close to a possible zero, in levels, only if it is that zero: a tile has no mean slope.
_MEAN = 0.06
# A flat area makes a level more frequent than its neighbours by this factor.
_SPIKE = 1.2
# Fraction of pixels that have to fit a way to store normals other than as colours 0.5 + 0.5 n.
_MOST = 0.95


def encode(vectors: Floats, convention: Convention = "opengl", levels: int | None = None) -> F32:
    """Vectors (..., 3) as colours from 0 to 1. For DirectX, green is -y.

    levels: the highest level of a file of integers, 255 or 65535, for colours whose level 128 or 32768 is zero; None
    for 0.5 + 0.5 n.
    """
    signed = np.asarray(vectors, np.float32) * _signs(convention)
    if levels is None:
        return (0.5 + 0.5 * signed).astype(np.float32)
    half = levels // 2
    return ((half + 1 + half * signed) / np.float32(levels)).astype(np.float32)


def write_vectors(
    path: AnyPath,
    vectors: Floats,
    *,
    convention: Convention = "opengl",
    bits: int | None = None,
    description: str | None = None,
    mask: Bools | None = None,
) -> None:
    """Write unit vectors (H, W, 3) as colours, as described above; float files hold 0.5 + 0.5 n. The write is atomic.

    mask: (H, W), the file's alpha; None for none. The rest, and the errors, as for
    :func:`mpsnet_core.scene.normal_map.write_normals`.
    """
    levels = stored_levels(path, bits)
    height, width = vectors.shape[:2]

    def colours(rows: slice) -> F32:
        band = encode(vectors[rows], convention, levels)
        return band if mask is None else np.concatenate([band, mask[rows, :, None]], axis=-1)

    channels = 3 if mask is None else 4
    told = description or made("normal map")
    write_bands(path, (height, width, channels), colours, bits=bits, description=told)


def read_vectors(path: AnyPath, convention: Convention = "opengl") -> tuple[F32, F32 | None]:
    """The vectors (H, W, 3) of a normal map, and its alpha (H, W), None if it has none.

    The vectors have about unit length where the file holds normals, any length elsewhere, and may be not finite. A note
    says which level is zero in a file of 8 bits, and how z was found if the file does not hold it: maps with two
    channels (BC5), with x in alpha (DXT5nm), or with z from 0 to 1. An alpha that holds other data is left out.

    Raises FileError or FormatError if the file cannot be read.
    """
    colours, alpha = read_data(path, pair=True)
    storage = _storage_of(colours, alpha)
    storage.decode(colours, alpha, convention)
    if storage.note:
        log.info("%s: %s", path, storage.note)
    if alpha is None or storage.x_in_alpha:
        return colours, None
    if not _is_cover(alpha):
        log.info("%s: its alpha is not a mask but other data, such as heights, and is ignored", path)
        return colours, None
    return colours, alpha


def _is_cover(alpha: Floats) -> bool:
    """Whether an alpha (H, W) says where there are normals: most of it says yes or no."""
    step = grid_step(alpha.size, SAMPLED)
    return bool((np.abs(alpha[::step, ::step] - 0.5) > 0.48).mean() > 0.5)


def _signs(convention: Convention) -> F32:
    return np.array([1, _GREEN[convention], 1], dtype=np.float32)


@dataclass(frozen=True)
class _Storage:
    """How a file stores normals."""

    z: Literal["alike", "from 0", "none"] = "alike"
    """How blue holds z: "alike", as red holds x; "from 0", from 0 to 1; "none", not at all."""
    x_in_alpha: bool = False
    """Whether x is in alpha, not in red."""
    levels: float | None = None
    """The highest level, see _BYTE; None for floats."""
    zeros: tuple[float, float, float] = (0.5, 0.5, 0.5)
    """The levels of x = 0, y = 0 and z = 0."""
    flat: tuple[int | None, int | None] = (None, None)
    """Levels of x and y that are 0 as well, as a flat area has them."""
    signed: bool = False
    """Whether floats hold the normal's components themselves, from -1 to 1."""

    def decode(self, colours: F32, alpha: Floats | None, convention: Convention) -> None:
        """Turn colours into vectors in place, as a copy of a large photo's normals takes much memory."""
        signs = _signs(convention)

        def decoded(rows: slice) -> None:
            band = colours[rows]
            if self.x_in_alpha and alpha is not None:
                band[..., 0] = alpha[rows]
            blue = band[..., 2].copy() if self.z == "from 0" else None
            if not self.signed:
                self._scale(band)
            if blue is not None:
                band[..., 2] = blue
            elif self.z == "none":
                band[..., 2] = np.sqrt(np.maximum(1 - band[..., 0] ** 2 - band[..., 1] ** 2, 0))
            band *= signs

        on_all_cores(decoded, bands(len(colours), FEW_ROWS))

    def _scale(self, band: F32) -> None:
        top = self.levels or 1
        band *= np.float32(top)
        flat = [None if level is None else np.abs(band[..., n] - level) < 0.5 for n, level in enumerate(self.flat)]
        band -= np.array(self.zeros, np.float32)
        band /= np.float32(top - self.zeros[2])
        for number, where in enumerate(flat):
            if where is not None:
                band[..., number][where] = 0

    @property
    def note(self) -> str:
        """What a user should know about it; "" for a file that holds what it should."""
        words = []
        if self.x_in_alpha:
            words.append("x is in alpha, y in green (DXT5nm), and z is made from them")
        elif self.z == "none":
            words.append("it has two channels (BC5), and z is made from them")
        elif self.z == "from 0":
            words.append("blue holds z from 0 to 1")
        if self.signed:
            words.append("it holds values from -1 to 1, and not colours")
        if self.levels in (_BYTE, _UPPER_BYTE):
            x, y = self.zeros[:2]
            zeros = f"{x:g} is zero" if x == y else f"{x:g} is zero in red and {y:g} in green"
            flat = sorted({level for level in self.flat if level is not None and level not in (x, y)})
            words.append(f"8 bits, where {zeros}" + "".join(f", and so is {level} in flat areas" for level in flat))
        return "; ".join(words)


def _storage_of(colours: F32, alpha: Floats | None) -> _Storage:
    """How a file with these colours (H, W, 3) and alpha (H, W) stores normals."""
    step = grid_step(colours[..., 0].size, SAMPLED)
    some = colours[::step, ::step].reshape(-1, 3).astype(np.float64)
    clear = None if alpha is None else alpha[::step, ::step].reshape(-1).astype(np.float64)
    # Black and white are background.
    used = np.isfinite(some).all(axis=-1) & ~(some == 0).all(axis=-1) & ~(some == 1).all(axis=-1)
    some, clear = some[used], None if clear is None else clear[used]
    if not len(some):
        return _Storage()
    x_in_alpha, z = _channels(some, clear)
    if x_in_alpha and clear is not None:
        some[:, 0] = clear
    levels = _levels(some)
    if levels is None:
        return _Storage(z, x_in_alpha, signed=_unit(some) > _MOST and _unit(2 * some - 1) < 1 - _MOST)
    if levels == _WORD:
        return _Storage(z, x_in_alpha, levels, (32768, 32768, 32768))
    stored = np.rint((some[_are_unit(2 * some - 1)] if z == "alike" else some) * levels)
    x, y = _zeros_by_length(stored) if z == "alike" else (None, None)
    (x_guess, x_flat), (y_guess, y_flat) = _flat_areas(stored[:, 0]), _flat_areas(stored[:, 1])
    x, y = (x if x is not None else x_guess), (y if y is not None else y_guess)
    x, y = (x if x is not None else y), (y if y is not None else x)
    x, y = (128.0 if zero is None else zero for zero in (x, y))
    return _Storage(z, x_in_alpha, levels, (x, y, x), (x_flat, y_flat))


def _are_unit(vectors: F64, tolerance: float = 0.05) -> Bools:
    return np.asarray(np.abs(np.linalg.norm(vectors, axis=-1) - 1) < tolerance)


def _unit(vectors: F64) -> float:
    """The fraction of vectors (N, 3) that have about unit length."""
    return float(_are_unit(vectors).mean())


def _channels(some: F64, alpha: F64 | None) -> tuple[bool, Literal["alike", "from 0", "none"]]:
    """Whether x is in alpha, and how blue holds z, from a sample of colours (N, 3) and alpha (N)."""
    red, green, blue = some.T
    alike = _are_unit(2 * some - 1)
    copied = bool(np.abs(blue - green).max() < 1e-3)
    is_grey = copied and np.abs(red - green).max() < 1e-3
    even = [value[0] if np.ptp(value) < 1e-3 else np.nan for value in (red, blue)]
    black, white, in_middle = even[1] < 1e-3, even[1] > 0.999, abs(even[1] - 0.5) < 0.003
    fits_not = alike.mean() < _MOST
    # Blue of a gentle map is white, too. A texture that is black there would point inwards everywhere.
    steep = white and _horizontal(red, green).max() > 0.03
    if _are_horizontal(red, green) and not is_grey and (black or steep or (fits_not and (in_middle or copied))):
        return False, "none"
    no_x, no_z = is_grey or not np.isnan(even[0]), copied or black or white or in_middle
    if alpha is not None and fits_not and no_x and no_z and _are_horizontal(alpha, green):
        return True, "none"
    # To the byte: in a reduced map normals are averaged, and shorter.
    from_0 = _are_unit(np.stack([2 * red - 1, 2 * green - 1, blue], axis=-1), 0.012) & ~alike
    likely = fits_not and from_0.sum() > 0.6 * (~alike).sum() and np.ptp(blue[from_0]) > 0.1  # more than a background
    return False, "from 0" if likely else "alike"


def _horizontal(x: F64, y: F64) -> F64:
    """Squared lengths of (x, y), which are given as colours."""
    return (2 * x - 1) ** 2 + (2 * y - 1) ** 2


def _are_horizontal(x: F64, y: F64) -> bool:
    """Whether colours are x and y of unit vectors, most of which have some z, too."""
    squared = _horizontal(x, y)
    return bool((squared < 1.02).mean() > _MOST and (squared < 0.9).mean() > 0.5)


def _levels(some: F64) -> float | None:
    """The highest level of the integer file that such values come from, even if converted since; None for floats."""
    if some.min() < 0 or some.max() > 1:
        return None
    in_half = (some == some.astype(np.float16)).all()
    for levels in (_BYTE,) if in_half else (_BYTE, _UPPER_BYTE, _WORD):
        off = np.abs(some * levels - np.rint(some * levels)).max()
        if off <= levels * (_ROUNDED_TO_HALF if in_half else _ROUNDED):
            return levels
    return None


def _zeros_by_length(stored: F64) -> tuple[float | None, float | None]:
    """The levels of x = 0 and y = 0, of 127, 127.5 and 128, by levels (N, 3); None for one that cannot be known.

    Steep normals have the same length all around the right zero only. Their levels lie on a sphere, whose centre is
    found to a fraction of a level, as rounding is all that scatters them.
    """
    around = stored - 127.5
    length = np.linalg.norm(around, axis=-1)
    steep = np.hypot(around[:, 0], around[:, 1]) > _STEEP * length
    around, length = around[steep], length[steep]
    if len(around) < 100:
        return None, None
    design = np.column_stack([np.ones(len(around)), around / length[:, None]])
    expected, wanted = np.diag([1.0, 4.0, 4.0, 4.0]), design.T @ (length - 127.5)  # zeros differ by half a level
    centre = np.linalg.solve(design.T @ design + expected, wanted)
    spread = max(float(np.std(length - 127.5 - design @ centre)), 0.3)
    errors = spread * np.sqrt(np.diag(np.linalg.inv(design.T @ design + spread**2 * expected)))
    errors *= spread / 0.3  # what more than rounding has changed, as JPEG does, is alike in neighbours

    def zero(offset: float, error: float) -> float | None:
        nearest = min((-0.5, 0.0, 0.5), key=lambda one: abs(one - offset))
        return 127.5 + nearest if error < _KNOWN and abs(offset - nearest) < _NEAR else None

    return zero(centre[1], errors[1]), zero(centre[2], errors[2])


def _flat_areas(stored: F64) -> tuple[float | None, int | None]:
    """The zero of x or y by its most frequent levels or their mean, None if unknown; that of flat areas or None."""
    before, low, high, after = (np.count_nonzero(stored == level) for level in (126, 127, 128, 129))

    def far_above(count: int, others: int) -> bool:
        return bool(count > _SPIKE * others + 4 * np.sqrt(count))  # not by chance

    for level, count, others in ((127, low, max(before, high)), (128, high, max(low, after))):
        if far_above(count, others):
            return float(level), level
    if far_above(min(low, high), max(before, after)):
        return 127.5, None
    mean = float(stored.mean()) if len(stored) else 0.0
    return next((zero for zero in (128.0, 127.5, 127.0) if abs(mean - zero) < _MEAN), None), None
