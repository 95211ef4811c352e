"""Neural fits to MERL: a small network for each material of the database, in one ``.npz`` file.

Sztrajman, Rainer, Ritschel and Weyrich, "Neural BRDF Representation and Importance Sampling", Computer Graphics Forum
2021. These are fits to MERL, not MERL.
"""

import os

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import FormatError, InputError
from mpsnet_core.io.files import existing_file
from mpsnet_core.io.npz import read_arrays
from mpsnet_core.synthesis.reflectance.hemisphere import AboveSurface, Floats, rusinkiewicz_angles

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

    def __init__(self, *layers: NDArray[np.float32]) -> None:
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
        result: NDArray[np.float32] = np.maximum(np.expm1(np.minimum(hidden @ fc3 + b3, np.float32(_MAX_EXPONENT))), 0)
        return result if paint is None else result * paint


def read_fits(path: str | os.PathLike[str]) -> dict[str, MerlFit]:
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
            raise FormatError(
                f'{path} is not a file of fits to MERL: its "{key}" is {layer.shape}, expected {expected}'
            )
        if layer.dtype.kind != "f" or not np.isfinite(layer).all():
            raise FormatError(f'{path} is damaged: its "{key}" holds values that are not finite; fetch it again')
    layers = [layer.astype(np.float32) for layer in layers]
    return {str(name): MerlFit(*(layer[m] for layer in layers)) for m, name in enumerate(names)}
