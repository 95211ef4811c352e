"""Three lights that are fixed in the world while the camera moves."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from mpsnet_core.arrays.types import F64
from mpsnet_core.errors import FormatError, GeometryError
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.rig import LIGHT_NAMES, LightRig, NearLights, near_rig, rig_data, write_rig_data


@dataclass(frozen=True, eq=False)
class WorldLights:
    """Three lights in the world space of mesh and cameras.

    Raises
    ------
    GeometryError
        If the directions are not three finite vectors, or one is zero.
    """

    directions: F64
    """(3, 3) float64. Per row a vector from the surface to a light, in world space; in rig order."""
    mixing: F64 = field(default_factory=lambda: np.eye(3))
    """(3, 3) float64. The mixing matrix, as in :class:`LightRig`."""
    near: NearLights | None = None
    """The positions of the lights, if they are near, and their target, in world space."""
    is_ground_truth: bool = False
    """Whether directions and mixing are known exactly, as in :class:`LightRig`."""

    def __post_init__(self) -> None:
        try:
            directions = np.array(self.directions, np.float64)
        except (TypeError, ValueError, OverflowError):
            directions = np.empty(0)
        if directions.shape != (3, 3) or not np.isfinite(directions).all() or not directions.any(axis=1).all():
            raise GeometryError("lights in the world are three directions of three finite numbers, none of them zero")
        object.__setattr__(self, "directions", directions)

    def seen_by(self, camera: Camera) -> LightRig:
        """The lights in the camera's space. Raises GeometryError if one is behind the object, seen by the camera."""
        if self.near is None:
            return LightRig(self.directions @ camera.rotation, self.mixing, is_ground_truth=self.is_ground_truth)
        places = np.vstack([self.near.positions, self.near.target]) - camera.world_from_camera[:3, 3]
        *positions, target = places @ camera.rotation
        return near_rig(positions, target, self.mixing, self.near.lobe, is_ground_truth=self.is_ground_truth)


def in_world(rig: LightRig, camera: Camera) -> WorldLights:
    """A rig from the space of `camera` in world space: the inverse of :meth:`WorldLights.seen_by`."""
    directions = rig.directions @ camera.rotation.T
    if rig.near is None:
        return WorldLights(directions, rig.mixing, is_ground_truth=rig.is_ground_truth)
    places = np.vstack([rig.near.positions, rig.near.target]) @ camera.rotation.T + camera.world_from_camera[:3, 3]
    return WorldLights(directions, rig.mixing, NearLights(places[:3], places[3], rig.near.lobe), rig.is_ground_truth)


def read_world_lights(path: AnyPath) -> WorldLights:
    """Read a rig file whose lights have a "direction": [x, y, z] or a "position" in world space.

    Raises FileError if the file is missing, FormatError if it is malformed or has other lights.
    """
    if Path(path).suffix.lower() == ".lp":
        raise FormatError(
            f"{path}: the lights of an .lp file are relative to the camera; for lights in the world give a rig .json"
        )
    with rig_data(path) as (data, is_near):
        key, mixing = "position" if is_near else "direction", data.get("mixing", np.eye(3))
        exact = data.get("exact", False)
        lights = np.array([_three(light, key, name) for light, name in zip(data["lights"], LIGHT_NAMES, strict=True)])
        if not is_near:
            return WorldLights(lights, mixing, is_ground_truth=exact)
        near = NearLights(lights, data["target"], data.get("lobe", 0.0))
        return WorldLights(near.positions - near.target, mixing, near, exact)


def write_world_lights(path: AnyPath, lights: WorldLights) -> None:
    """Write a rig file with lights in world space atomically."""
    distant = [{"direction": direction.tolist()} for direction in lights.directions]
    write_rig_data(path, distant, lights.near, lights.mixing, lights.is_ground_truth)


def _three(light: Any, key: str, name: str) -> list[float]:
    given = light.get(key) if isinstance(light, dict) and set(light) == {key} else None
    if not isinstance(given, list) or [type(x) in (int, float) for x in given] != [True] * 3:
        raise FormatError(f'the {name} light stands in the world, where it needs "{key}" [x, y, z], and nothing else')
    return given
