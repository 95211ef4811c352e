"""Measured materials: MERL's files, and neural fits to them."""

import numpy as np

from mpsnet_core.arrays.types import F32, Bools, Floats, Indices
from mpsnet_core.errors import FormatError, InputError
from mpsnet_core.io.files import existing_file
from mpsnet_core.io.npz import read_arrays
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.synthesis.reflectance.hemisphere import AboveSurface, rusinkiewicz_angles

# Weights and biases of three layers, (materials, inputs, outputs) and (materials, outputs).
_LAYERS = {"fc1": (6, 21), "b1": (21,), "fc2": (21, 21), "b2": (21,), "fc3": (21, 3), "b3": (3,)}
_MAX_BYTES = 64 << 20
# exp(11) / sr is far above any material of the database, and below the largest half float.
_MAX_EXPONENT = 11.0


class MerlFit(AboveSurface):
    """One material's fit, called as a :class:`~mpsnet_core.synthesis.reflectance.Reflectance`.

    Parameters
    ----------
    *layers
        Weights and biases of three layers in turn, from half vector and difference vector (azimuth of the half vector
        0) to 21, 21 and RGB. ReLU between layers; the output is exp(x) - 1, at least 0.

    Notes
    -----
    Reciprocal by construction, like the table that it fits. Paint multiplies the reflectance.
    """

    def __init__(self, *layers: F32) -> None:
        self._layers = layers

    def _evaluate(self, normals: Floats, lights: Floats, views: Floats, paint: Floats | None) -> Floats:
        theta_half, theta_difference, phi_difference = rusinkiewicz_angles(normals, lights, views)
        azimuth = np.where(phi_difference < 0, phi_difference + np.float32(np.pi), phi_difference)
        off_half = np.sin(theta_difference)
        inputs = np.zeros((len(normals), 6), np.float32)
        inputs[:, 0] = np.sin(theta_half)
        inputs[:, 2] = np.cos(theta_half)
        inputs[:, 3] = off_half * np.cos(azimuth)
        inputs[:, 4] = off_half * np.sin(azimuth)
        inputs[:, 5] = np.cos(theta_difference)
        fc1, b1, fc2, b2, fc3, b3 = self._layers
        hidden = np.maximum(inputs @ fc1 + b1, 0)
        hidden = np.maximum(hidden @ fc2 + b2, 0)
        result: F32 = np.maximum(np.expm1(np.minimum(hidden @ fc3 + b3, np.float32(_MAX_EXPONENT))), 0)
        return result if paint is None else result * paint


def read_fits(path: AnyPath) -> dict[str, MerlFit]:
    """Read a file of fits to MERL: reflectance by material name, in the file's order.

    The file is an ``.npz`` with "names" (M,) and, for each material, "fc1" (M, 6, 21), "b1" (M, 21), "fc2" (M, 21, 21),
    "b2" (M, 21), "fc3" (M, 21, 3) and "b3" (M, 3). Raises FileError if it is missing, FormatError if it is damaged or
    no such file.
    """
    path = existing_file(path, "file of fits to MERL")
    try:
        arrays = read_arrays(path, _MAX_BYTES)
        names, layers = arrays["names"], [arrays[key] for key in _LAYERS]
    except InputError as error:
        raise FormatError(f"{path} is not a file of fits to MERL: {error}") from None
    except KeyError as error:
        raise FormatError(f"{path} is not a file of fits to MERL: it lacks {error}; choose an .npz of them") from None
    if names.ndim != 1 or names.dtype.kind != "U" or len(set(names.tolist())) != len(names) or not len(names):
        raise FormatError(f'{path} is not a file of fits to MERL: its "names" are not a list of distinct names')
    for (key, shape), layer in zip(_LAYERS.items(), layers, strict=True):
        if layer.shape != (len(names), *shape):
            expected = " by ".join(map(str, (len(names), *shape)))
            raise FormatError(f'{path} is no file of fits to MERL: its "{key}" is {layer.shape}, not {expected}')
        if layer.dtype.kind != "f" or not np.isfinite(layer).all():
            raise FormatError(f'{path} is damaged: its "{key}" holds values that are not finite; fetch it again')
    layers = [layer.astype(np.float32) for layer in layers]
    return {str(name): MerlFit(*(layer[m] for layer in layers)) for m, name in enumerate(names)}


# --- MERL: measured isotropic reflectance from the database's ``.binary`` files ---------------------------------------
# Matusik, Pfister, Brand and McMillan, "A Data-Driven Reflectance Model", SIGGRAPH 2003.


# Half angle (spaced by its square root, dense near the highlight), difference angle, difference azimuth (0 to pi).
BINS = (90, 90, 180)
SCALE = np.array([1.00, 1.15, 1.66]) / 1500
_HEADER_BYTES = 12
_FILE_BYTES = _HEADER_BYTES + 3 * 8 * BINS[0] * BINS[1] * BINS[2]


class MerlTable(AboveSurface):
    """A measured reflectance, called as a :class:`~mpsnet_core.synthesis.reflectance.Reflectance`.

    Parameters
    ----------
    values : (90, 90, 180, 3) float32
        In 1/sr at the bins' centres, over half angle, difference angle and difference azimuth.

    Notes
    -----
    Trilinear interpolation between bin centres. Reciprocal by construction: the file has half of the azimuths, and in
    the other half light and viewer are swapped. Paint multiplies the reflectance.
    """

    def __init__(self, values: F32) -> None:
        # The azimuth is periodic: pad one bin at either end, so neighbours are always one step apart.
        self._rows = np.concatenate([values[:, :, -1:], values, values[:, :, :1]], axis=2).reshape(-1, 3)

    def _evaluate(self, normals: Floats, lights: Floats, views: Floats, paint: Floats | None) -> Floats:
        theta_half, theta_difference, phi_difference = rusinkiewicz_angles(normals, lights, views)
        quarter = np.float32(np.pi / 2)
        half, half_share = _between(np.sqrt(theta_half / quarter) * BINS[0] - 0.5, BINS[0])
        difference, difference_share = _between(theta_difference / quarter * BINS[1] - 0.5, BINS[1])
        azimuth = np.where(phi_difference < 0, phi_difference + np.float32(np.pi), phi_difference)
        turn, turn_share = _between(azimuth * np.float32(BINS[2] / np.pi) + 0.5, BINS[2] + 2)
        turns = BINS[2] + 2
        corner = (half * BINS[1] + difference) * turns + turn
        result = np.zeros((len(normals), 3), np.float32)
        for half_step, half_weight in ((0, 1 - half_share), (BINS[1] * turns, half_share)):
            for step, weight in ((0, 1 - difference_share), (turns, difference_share)):
                both = half_weight * weight
                first = corner + (half_step + step)
                result += (both * (1 - turn_share))[:, None] * np.take(self._rows, first, axis=0)
                result += (both * turn_share)[:, None] * np.take(self._rows, first + 1, axis=0)
        return result if paint is None else result * paint


def _between(position: Floats, count: int) -> tuple[Indices, Floats]:
    # The bin below a position, and the weight of the next one. The outermost bins extend beyond their centres.
    position = np.clip(position, 0, count - 1)
    below = np.minimum(position.astype(np.intp), count - 2)
    return below, position - below


def read_merl(path: AnyPath) -> MerlTable:
    """Read a ``.binary`` file of the MERL database. It takes 17 MB of memory.

    Negative values mark directions that were not measured, most of them below the surface. They get the value of the
    nearest smaller difference angle that was measured, because interpolation at their neighbours uses them.

    Raises FileError if the file is missing, FormatError if it has another size or type, or no measured value.
    """
    path = existing_file(path, "MERL file")
    size = path.stat().st_size
    if size != _FILE_BYTES:
        raise FormatError(f"{path} has {size} bytes, a MERL .binary file has {_FILE_BYTES}; fetch it again")
    with path.open("rb") as file:
        bins = tuple(int(count) for count in np.frombuffer(file.read(_HEADER_BYTES), "<i4"))
        if bins != BINS:
            raise FormatError(f"{path} is not a MERL .binary file: it begins with {bins}, not {BINS}; choose another")
        values = np.empty((*BINS, 3), np.float32)
        for channel in range(3):
            plane = np.frombuffer(file.read((_FILE_BYTES - _HEADER_BYTES) // 3), "<f8").reshape(BINS)
            values[..., channel] = plane * SCALE[channel]
    measured: Bools = np.all(np.isfinite(values) & (values >= 0), axis=-1)
    if not measured.any():
        raise FormatError(f"{path} holds no measured sample, all are negative; fetch it again")
    return MerlTable(_filled(values, measured))


def _filled(values: F32, measured: Bools) -> F32:
    # Fill along the difference angle. A half angle and azimuth without measurements takes the smaller half angle's.
    for axis in (1, 0):
        steps = np.arange(BINS[axis]).reshape([-1 if a == axis else 1 for a in range(3)])
        last = np.maximum.accumulate(np.where(measured, steps, 0), axis=axis)
        values = np.take_along_axis(values, last[..., None], axis=axis)
        measured = np.take_along_axis(measured, last, axis=axis)
    return np.where(measured[..., None], values, np.float32(0))
