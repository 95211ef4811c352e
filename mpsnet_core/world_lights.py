"""WorldLights: three lights that stand in the world while the camera goes round, as each camera sees them."""

import os
from dataclasses import dataclass, field
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.camera import Camera
from mpsnet_core.errors import InputError
from mpsnet_core.files import read_json
from mpsnet_core.rig import LIGHT_NAMES, RIG_FORMAT, RIG_VERSION, LightRig


@dataclass(frozen=True)
class WorldLights:
    """Three distant lights in the world that mesh and cameras share.

    directions: (3, 3), a vector a row from the surface to the light, along the world's axes; in rig order.
    mixing: (3, 3) as in :class:`LightRig`.

    Raises InputError where a direction is no vector.
    """

    directions: NDArray[np.float64]
    mixing: NDArray[np.float64] = field(default_factory=lambda: np.eye(3))

    def __post_init__(self) -> None:
        try:
            directions = np.array(self.directions, np.float64)
        except (TypeError, ValueError, OverflowError):
            directions = np.empty(0)
        if directions.shape != (3, 3) or not np.isfinite(directions).all() or not directions.any(axis=1).all():
            raise InputError("lights in the world are three directions of three finite numbers, none of them zero")
        object.__setattr__(self, "directions", directions)

    def seen_by(self, camera: Camera) -> LightRig:
        """The lights in the camera's space. Raises InputError where one is behind the object as this camera sees it."""
        return LightRig(self.directions @ camera.rotation, self.mixing)


def read_world_lights(path: str | os.PathLike[str]) -> WorldLights:
    """Read a rig file whose lights are "direction": [x, y, z] along the world's axes.

    Raises InputError where the file is missing, malformed, or gives a light otherwise.
    """
    data = read_json(path, RIG_FORMAT, RIG_VERSION, ("lights", "mixing"))
    lights = data.get("lights")
    try:
        if not isinstance(lights, list) or len(lights) != 3:
            raise InputError('"lights" must be a list of three lights')
        directions = [_direction(light, name) for light, name in zip(lights, LIGHT_NAMES, strict=True)]
        return WorldLights(np.array(directions), data.get("mixing", np.eye(3)))
    except InputError as error:
        raise InputError(f"rig file {path}: {error}") from None


def _direction(light: Any, name: str) -> list[float]:
    given = light.get("direction") if isinstance(light, dict) else None
    if not isinstance(given, list) or len(given) != 3 or not all(isinstance(x, int | float) for x in given):
        raise InputError(f'the {name} light stands in the world, where it needs "direction" [x, y, z], and no angles')
    return [float(x) for x in given]
