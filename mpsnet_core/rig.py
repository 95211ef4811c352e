"""LightRig: the three lights and how their colours mix into the camera's channels; rig files."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from mpsnet_core.errors import InputError
from mpsnet_core.files import existing_file, read_json, write_json

RIG_FORMAT = "mpsnet-rig"
RIG_VERSION = 1

# Below this smallest singular value the inverse amplifies camera noise more than fifty times. Three lights 120° apart
# reach it at a slant of 0.94°.
MIN_SINGULAR_VALUE = 0.02

LIGHT_NAMES = ("first", "second", "third")


def _matrix(value: ArrayLike, what: str) -> NDArray[np.float64]:
    try:
        matrix = np.array(value, dtype=np.float64)
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"{what} must be three rows of three numbers") from None
    if matrix.shape != (3, 3):
        raise InputError(f"{what} must be three rows of three numbers, not an array of shape {matrix.shape}")
    if not np.isfinite(matrix).all():
        raise InputError(f"{what} holds a value that is not finite; every entry must be a number")
    return matrix


@dataclass(frozen=True)
class LightRig:
    """Three distant lights in camera space and the mixing of their colours.

    directions: (3, 3) float64, a unit vector a row, from the surface to the light; normalised here. Rows in rig
        order: the lights of camera channels R, G, B.
    mixing: (3, 3) float64, the mixing matrix M: rows are the camera's channels, columns the lights in rig order;
        identity for a rig without crosstalk.

    Raises InputError where a direction is zero or behind the object, where the three lie (nearly) in one plane, or
    where the mixing matrix cannot be inverted.
    """

    directions: NDArray[np.float64]
    mixing: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        directions = _matrix(self.directions, "light directions")
        length = np.linalg.norm(directions, axis=1)
        for name, size, vector in zip(LIGHT_NAMES, length, directions, strict=True):
            if size < 1e-9:
                raise InputError(f"the {name} light's direction is the zero vector; give where the light stands")
            if vector[2] <= 0:
                raise InputError(
                    f"the {name} light is behind the object (z = {vector[2]:.3g}); directions point from the surface "
                    "to the light, with z towards the camera"
                )
        directions /= length[:, None]
        if np.linalg.svd(directions, compute_uv=False)[-1] < MIN_SINGULAR_VALUE:
            raise InputError(
                "the three light directions lie (nearly) in one plane, so no normal can be told from them; move one "
                "light out of the plane of the other two"
            )
        mixing = _matrix(self.mixing, "the mixing matrix")
        singular = np.linalg.svd(mixing, compute_uv=False)
        if singular[-1] <= MIN_SINGULAR_VALUE * singular[0]:
            raise InputError(
                "the mixing matrix cannot be inverted: two lights look the same to the camera; measure it again or "
                "leave it out"
            )
        directions.flags.writeable = False
        mixing.flags.writeable = False
        object.__setattr__(self, "directions", directions)
        object.__setattr__(self, "mixing", mixing)

    @property
    def slants(self) -> NDArray[np.float64]:
        """(3,) angles from +z in degrees."""
        flat = np.hypot(self.directions[:, 0], self.directions[:, 1])
        return np.degrees(np.arctan2(flat, self.directions[:, 2]))

    @property
    def tilts(self) -> NDArray[np.float64]:
        """(3,) angles from +x towards +y in degrees, 0 to 360."""
        return np.degrees(np.arctan2(self.directions[:, 1], self.directions[:, 0])) % 360.0


def direction_from_angles(slant: ArrayLike, tilt: ArrayLike) -> NDArray[np.float64]:
    """Unit vector(s), shape (..., 3), of light(s) at `slant` from +z and `tilt` from +x towards +y, in degrees."""
    slant, tilt = np.radians(np.asarray(slant, float)), np.radians(np.asarray(tilt, float))
    return np.stack([np.sin(slant) * np.cos(tilt), np.sin(slant) * np.sin(tilt), np.cos(slant)], axis=-1)


def published_rig(slant: float = 30.0, first_tilt: float = 90.0) -> LightRig:
    """The rig of the MPS-Net paper: slant 30°, tilts 120° apart.

    The paper gives no absolute tilt; we put the first (red) light straight above the camera.
    """
    return LightRig(direction_from_angles([slant] * 3, first_tilt + np.array([0.0, 120.0, 240.0])))


def read_rig(path: str | os.PathLike[str]) -> LightRig:
    """Read a rig file: our JSON, or an ``.lp`` file with exactly three lights.

    Raises InputError where the file is missing, malformed, or holds lights from which no normal can be told.
    """
    path = Path(path)
    try:
        if path.suffix.lower() == ".lp":
            return LightRig(_lp_directions(path))
        data = read_json(path, RIG_FORMAT, RIG_VERSION, ("lights", "mixing"))
        lights = data.get("lights")
        if not isinstance(lights, list) or len(lights) != 3:
            raise InputError('"lights" must be a list of three lights')
        directions = [_json_direction(light, name) for light, name in zip(lights, LIGHT_NAMES, strict=True)]
        return LightRig(np.array(directions), data.get("mixing", np.eye(3)))
    except InputError as error:
        message = str(error)
        raise InputError(message if str(path) in message else f"rig file {path}: {message}") from None


def _json_direction(light: Any, name: str) -> NDArray[np.float64]:
    light = light if isinstance(light, dict) else {}
    if ("direction" in light) == ("slant" in light and "tilt" in light):
        raise InputError(f'the {name} light needs either "direction" [x, y, z] or "slant" and "tilt" in degrees')
    try:
        if "direction" in light:
            direction = np.array(light["direction"], dtype=np.float64)
        else:
            direction = direction_from_angles(float(light["slant"]), float(light["tilt"]))
    except (TypeError, ValueError, OverflowError):
        raise InputError(f"the {name} light holds something that is not a number") from None
    if direction.shape != (3,):
        raise InputError(f"the {name} light's direction needs three numbers")
    return direction


def _lp_directions(path: Path) -> NDArray[np.float64]:
    """The ``.lp`` format of reflectance transformation imaging: a count, then "name x y z" a line."""
    text = existing_file(path, "rig file").read_text(encoding="utf-8", errors="replace")
    lines = [line.split() for line in text.splitlines() if line.strip()]
    try:
        count = int(lines[0][0])
        directions = np.array([[float(x), float(y), float(z)] for *_, x, y, z in lines[1:]])
    except (IndexError, ValueError):
        raise InputError('not an .lp file: the first line is the count, then a line "name x y z" a light') from None
    if len(directions) != count:
        raise InputError(f"the first line says {count} lights but {len(lines) - 1} lines follow; mend the count")
    if count != 3:
        raise InputError(f"it holds {count} lights, a rig has three; keep the lines of the red, green and blue light")
    return directions


def write_rig(path: str | os.PathLike[str], rig: LightRig) -> None:
    """Write a JSON rig file, whole or not at all."""
    lights: Sequence[dict[str, float]] = [
        {"slant": float(slant), "tilt": float(tilt)} for slant, tilt in zip(rig.slants, rig.tilts, strict=True)
    ]
    write_json(path, {"format": RIG_FORMAT, "version": RIG_VERSION, "lights": lights, "mixing": rig.mixing.tolist()})
