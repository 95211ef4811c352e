"""Light rigs: the three lights and how their colours mix into the camera's channels; rig files."""

import re
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any, TypeVar

import numpy as np
from numpy.typing import ArrayLike

from mpsnet_core.arrays.sizes import finite_array
from mpsnet_core.arrays.types import F32, F64, Floats
from mpsnet_core.errors import FormatError, GeometryError, SettingsError
from mpsnet_core.io.files import atomic_write, check_small, existing_file, prefix_errors, read_json, write_json
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.camera import Camera

RIG_FORMAT = "mpsnet-rig"
RIG_VERSION = 1

# If the smallest singular value is below this, the inverse amplifies camera noise more than fifty times. Three lights
# with tilts 120° apart reach it at a slant of 0.94°.
MIN_SINGULAR_VALUE = 0.02

LIGHT_NAMES = ("first", "second", "third")

# Limits of lengths and mixing weights in rig files: their squares and inverses stay finite.
MAX_VALUE = 1e12
MIN_MIXING = 1e-6
MAX_ANGLE = 360.0

MAX_LOBE = 100
# A light with a lobe lights nothing behind it; this lower limit keeps divisions by its brightness finite.
MIN_LOBE_COSINE = 0.01


@dataclass(frozen=True, eq=False)
class NearLights:
    """Point lights near the object: their direction and irradiance vary over it.

    Raises
    ------
    GeometryError
        If a value is not finite, a light is at the target or the lobe is below 0.

    Notes
    -----
    The falloff is equation 2.5 of Quéau et al., "LED-based Photometric Stereo: Modeling, Calibration and Numerical
    Solution", Journal of Mathematical Imaging and Vision 60, 2018.
    """

    positions: F64
    """(3, 3) float64. A light per row, in camera space (the scene has negative z), in the unit of the camera's pose and
    the mesh."""
    target: F64
    """(3,) float64. The point that the lights face. The rig's directions and mixing are valid there."""
    lobe: float = 0.0
    """Angular falloff around the axis to the target, as a power of the cosine: 0 for an isotropic bulb, 1 for a disc or
    a bare LED chip, more for LEDs with a lens."""

    def __post_init__(self) -> None:
        positions = finite_array(self.positions, (3, 3), "light positions", MAX_VALUE)
        target = finite_array(self.target, (3,), "the lights' target", MAX_VALUE)
        for name, place in zip(LIGHT_NAMES, positions, strict=True):
            if np.linalg.norm(place - target) < 1e-9:
                raise GeometryError(f"the {name} light stands in the target; move one of them")
        if isinstance(self.lobe, bool) or not isinstance(self.lobe, int | float) or not 0 <= self.lobe <= MAX_LOBE:
            raise GeometryError(f"the lights' lobe is a number from 0 (all round) to {MAX_LOBE}, not {self.lobe!r}")
        positions.flags.writeable = target.flags.writeable = False
        object.__setattr__(self, "positions", positions)
        object.__setattr__(self, "target", target)

    def lights_at(self, points: Floats) -> F64:
        """(..., 3, 3) for points (..., 3) in camera space: per row a light's unit direction times its brightness.

        The brightness follows the inverse-square law and the lobe. It is 1 at the target.
        """
        towards = self.positions - np.asarray(points, np.float64)[..., None, :]
        distance = np.linalg.norm(towards, axis=-1)
        axes = self.positions - self.target
        reach = np.linalg.norm(axes, axis=-1)
        brightness = (reach / distance) ** 2
        if self.lobe:
            cosine = np.einsum("...ki,ki->...k", towards, axes) / (distance * reach)
            brightness *= np.maximum(cosine, MIN_LOBE_COSINE) ** self.lobe
        return towards * (brightness / distance)[..., None]


@dataclass(frozen=True, eq=False)
class LightRig:
    """Three lights in camera space, distant or near (:func:`near_rig`), and the mixing of their colours.

    Raises
    ------
    GeometryError
        If a direction is zero or behind the object, the three are (nearly) coplanar, or the mixing matrix is singular.

    Examples
    --------
    >>> rig = LightRig(np.array([[0, 1, 1], [1, -1, 1], [-1, -1, 1]]))
    >>> rig.tilts.tolist()
    [90.0, 315.0, 225.0]
    """

    directions: F64
    """(3, 3) float64. Per row a vector from the surface to a light, normalised here; in rig order: the lights of camera
    channels R, G, B. For near lights, the directions at the target."""
    mixing: F64 = field(default_factory=lambda: np.eye(3))
    """(3, 3) float64. The mixing matrix: rows are the camera's channels, columns the lights in rig order. The identity
    (no crosstalk) by default. For near lights, the mixing at the target."""
    near: "NearLights | None" = None
    """The positions of the lights, if they are near."""
    is_ground_truth: bool = False
    """Whether directions and mixing are known exactly, as those of a render are. The default network then trusts
    them."""

    def __post_init__(self) -> None:
        directions = finite_array(self.directions, (3, 3), "light directions", MAX_VALUE)
        length = np.linalg.norm(directions, axis=1)
        for name, size, vector in zip(LIGHT_NAMES, length, directions, strict=True):
            if size < 1e-9:
                raise GeometryError(f"the {name} light's direction is the zero vector; give where the light stands")
            if vector[2] <= 0:
                raise GeometryError(
                    f"the {name} light is behind the object (z = {vector[2]:.3g}); directions point from the surface "
                    "to the light, with z towards the camera"
                )
        directions /= length[:, None]
        if np.linalg.svd(directions, compute_uv=False)[-1] < MIN_SINGULAR_VALUE:
            raise GeometryError(
                "the three light directions lie (nearly) in one plane, so they do not determine a normal; move one "
                "light out of the plane of the other two"
            )
        mixing = _invertible(self.mixing)
        directions.flags.writeable = False
        if self.near is not None:
            axes = self.near.positions - self.near.target
            if np.linalg.norm(axes / np.linalg.norm(axes, axis=1, keepdims=True) - directions, axis=1).max() > 1e-6:
                raise GeometryError("the rig's directions are not those from its target to its lights; leave them out")
        object.__setattr__(self, "directions", directions)
        object.__setattr__(self, "mixing", mixing)

    def lights_at(self, points: Floats) -> F64:
        """(..., 3, 3) as :meth:`NearLights.lights_at` for points (..., 3) in camera space; for distant lights the
        directions (3, 3), which are the same everywhere."""
        return self.directions if self.near is None else self.near.lights_at(points)

    def unmixed(self, image: Floats) -> F32:
        """(..., 3) the contribution of each light: the inverse of the mixing matrix applied to the image.

        Inverts ``c = M s`` of the image formation for a grey surface; exact for any surface without crosstalk.
        """
        if np.array_equal(self.mixing, np.eye(3)):
            return image.astype(np.float32, copy=False)
        return image @ np.linalg.inv(self.mixing).T.astype(np.float32)

    @property
    def slants(self) -> F64:
        """(3,) angles from +z in degrees."""
        return angles_of(self.directions)[0]

    @property
    def tilts(self) -> F64:
        """(3,) angles from +x towards +y in degrees, 0 to 360."""
        return angles_of(self.directions)[1]


def _invertible(mixing: ArrayLike) -> F64:
    """A read-only copy of a mixing matrix. Raises GeometryError if it has no inverse."""
    matrix = finite_array(mixing, (3, 3), "the mixing matrix", MAX_VALUE)
    singular = np.linalg.svd(matrix, compute_uv=False)
    if not MIN_MIXING <= singular[0] <= 1 / MIN_MIXING:
        raise GeometryError(f"the mixing matrix is of the size {singular[0]:.3g}; scale its entries to about 1")
    if singular[-1] <= MIN_SINGULAR_VALUE * singular[0]:
        raise GeometryError(
            "the mixing matrix cannot be inverted: two lights look the same to the camera; measure it again or "
            "leave it out"
        )
    matrix.flags.writeable = False
    return matrix


def slant_and_tilt(option: str, given: str) -> tuple[float, float]:
    """Slant and tilt in degrees from the text of an option, "45,135". Raises SettingsError if it is malformed.

    >>> slant_and_tilt("--light", "45,135")
    (45.0, 135.0)
    """
    try:
        slant, tilt = map(float, given.split(","))
    except ValueError:
        slant = tilt = float("nan")
    if not (0 <= slant <= 90 and abs(tilt) <= 360):
        raise SettingsError(f"{option} {given} is not known; give slant (0 to 90) and tilt in degrees, as 45,135")
    return slant, tilt


def direction_from_angles(slant: ArrayLike, tilt: ArrayLike) -> F64:
    """Unit vector(s), shape (..., 3), of light(s) at `slant` from +z and `tilt` from +x towards +y, in degrees."""
    slant, tilt = np.radians(np.asarray(slant, float)), np.radians(np.asarray(tilt, float))
    return np.stack([np.sin(slant) * np.cos(tilt), np.sin(slant) * np.sin(tilt), np.cos(slant)], axis=-1)


def angles_of(directions: ArrayLike) -> tuple[F64, F64]:
    """Slants and tilts (0 to 360) in degrees, each (...), of directions (..., 3)."""
    x, y, z = np.moveaxis(np.asarray(directions, np.float64), -1, 0)
    return np.degrees(np.arctan2(np.hypot(x, y), z)), np.degrees(np.arctan2(y, x)) % 360.0


def published_rig(slant: float = 30.0, first_tilt: float = 90.0) -> LightRig:
    """The rig of the MPS-Net paper: slant 30°, tilts 120° apart.

    Parameters
    ----------
    slant : float, optional
        Angle from +z in degrees.
    first_tilt : float, optional
        Angle of the first (red) light from +x towards +y in degrees. The paper has no absolute tilt; 90 is straight
        above the camera.

    Examples
    --------
    >>> published_rig().tilts.round(6).tolist()
    [90.0, 210.0, 330.0]
    """
    return LightRig(direction_from_angles([slant] * 3, first_tilt + np.array([0.0, 120.0, 240.0])))


def near_rig(
    positions: ArrayLike,
    target: ArrayLike,
    mixing: ArrayLike | None = None,
    lobe: float = 0.0,
    *,
    is_ground_truth: bool = False,
) -> LightRig:
    """A rig of near lights.

    Parameters
    ----------
    positions, target, lobe
        See :class:`NearLights`.
    mixing : (3, 3) array_like, optional
        The mixing matrix at the target; the identity by default.
    is_ground_truth : bool, optional
        See :class:`LightRig`.

    Raises
    ------
    GeometryError
        As for :class:`NearLights` and :class:`LightRig`.
    """
    near = NearLights(positions, target, lobe)  # type: ignore[arg-type]  # which it converts
    mixed = np.eye(3) if mixing is None else mixing
    return LightRig(near.positions - near.target, mixed, near, is_ground_truth)  # type: ignore[arg-type]


def read_rig(path: AnyPath) -> LightRig:
    """Read a rig file: JSON as :func:`write_rig` writes it, or an ``.lp`` file with exactly three lights.

    Raises
    ------
    FileError
        If the file is missing.
    FormatError
        If it is malformed.
    GeometryError
        If its lights do not determine a normal.
    """
    path = Path(path)
    if path.suffix.lower() == ".lp":
        directions = read_lp(path)[1]
        with prefix_errors(f"rig file {path}"):
            return _lp_rig(directions, path.name)
    return _rig_of_file(path, LightRig)


def has_mixing(path: AnyPath) -> bool:
    """Whether a rig file has a mixing matrix; .lp files do not. Raises as :func:`read_rig` does."""
    if Path(path).suffix.lower() == ".lp":
        return False
    with rig_data(path) as (data, _):
        return "mixing" in data or data.get("exact", False) is True


@contextmanager
def rig_data(path: AnyPath) -> Iterator[tuple[dict[str, Any], bool]]:
    """The JSON of a rig file with three "lights", and whether they are near, which a "target" marks.

    Errors in the with block name the file. Raises FileError if it is missing, FormatError if it is malformed.
    """
    data = read_json(path, RIG_FORMAT, RIG_VERSION, ("lights", "mixing", "target", "lobe", "exact"))
    with prefix_errors(f"rig file {path}"):
        lights = data.get("lights")
        if not isinstance(lights, list) or len(lights) != 3:
            raise FormatError('"lights" must be a list of three lights')
        near = any(isinstance(light, dict) and "position" in light for light in lights)
        if near and "target" not in data:
            raise FormatError('lights with a position need a "target" [x, y, z], the point that they face; add it')
        for key in ("target", "lobe"):
            if key in data and not near:
                raise FormatError(f'"{key}" is for lights with a "position" each; leave it out')
        if not isinstance(data.get("exact", False), bool):
            raise FormatError('"exact" is true or false: whether lights and mixing are known exactly')
        yield data, near


_Lights = TypeVar("_Lights", "LightRig", "WorldLights")


def _rig_of_file(path: AnyPath, kind: type[_Lights]) -> _Lights:
    with rig_data(path) as (data, is_near):
        named, mixing = list(zip(data["lights"], LIGHT_NAMES, strict=True)), data.get("mixing", np.eye(3))
        exact = data.get("exact", False)
        if not is_near:
            directions = [_json_direction(light, name, kind is WorldLights) for light, name in named]
            return kind(np.array(directions), mixing, is_ground_truth=exact)
        positions = np.array([_json_position(light, name) for light, name in named])
        near = NearLights(positions, data["target"], data.get("lobe", 0.0))
        return kind(near.positions - near.target, mixing, near, exact)


def _json_position(light: Any, name: str) -> F64:
    if not isinstance(light, dict) or set(light) != {"position"}:
        raise FormatError(f'the {name} light needs a "position" [x, y, z] and nothing else, as the others have one')
    return finite_array(light["position"], (3,), f"the {name} light's position", MAX_VALUE)


def _json_direction(light: Any, name: str, in_world: bool) -> F64:
    given = set(light) if isinstance(light, dict) else set()
    if given == {"direction"}:
        return finite_array(light["direction"], (3,), f"the {name} light's direction", MAX_VALUE)
    if in_world:
        raise FormatError(f'the {name} light stands in the world, where it needs a "direction" [x, y, z] alone')
    if given != {"slant", "tilt"}:
        raise FormatError(
            f'the {name} light needs either "direction" [x, y, z] or "slant" and "tilt" in degrees, and nothing else'
        )
    angles = finite_array([light["slant"], light["tilt"]], (2,), f"the {name} light's slant and tilt", MAX_ANGLE)
    return direction_from_angles(*angles)


def write_lp(path: AnyPath, directions: ArrayLike, names: Sequence[str]) -> None:
    """Write directions (N, 3) in the ``.lp`` format of reflectance transformation imaging (RTI), atomically.

    The file has a count, then lines "name x y z": x right, y up, z towards the camera. names: of the photos.
    """
    rows = np.asarray(directions, np.float64)
    lines = [f"{name} {x:.6f} {y:.6f} {z:.6f}" for name, (x, y, z) in zip(names, rows, strict=True)]
    with atomic_write(path) as unfinished:
        unfinished.write_text("\n".join([str(len(lines)), *lines]) + "\n", encoding="utf-8")


def read_lp(path: AnyPath) -> tuple[list[str], F64]:
    """Read the ``.lp`` format of reflectance transformation imaging: a count, then "name x y z" on each line.

    The numbers may have decimal commas. A line that may mean something else is refused.

    Returns the names and the directions (N, 3). Raises FileError if it is missing, FormatError if it is malformed.
    """
    file = existing_file(Path(path), "rig file")
    check_small(file, "not an .lp file")
    text = file.read_text(encoding="utf-8-sig", errors="replace")
    numbered = [(number, line.split()) for number, line in enumerate(text.splitlines(), 1) if line.strip()]
    (_, head), *lines = numbered or [(1, [""])]
    with prefix_errors(f"rig file {path}"):
        if not re.fullmatch("[0-9]{1,9}", head[0]):
            raise FormatError('not an .lp file: the first line is the count, then a line "name x y z" a light')
        lights = [_lp_light(number, words) for number, words in lines]
        if len(lights) != int(head[0]):
            raise FormatError(f"the first line states {head[0]} lights but {len(lights)} lines follow; correct it")
    return [name for name, _ in lights], np.array([direction for _, direction in lights]).reshape(-1, 3)


def _lp_light(number: int, words: Sequence[str]) -> tuple[str, list[float]]:
    """Name and direction of a light, from a line of an .lp file: a name of any number of words, and three numbers.

    The numbers may have decimal commas. Raises FormatError, which names the line, if it may mean something else.
    """
    values = [_lp_number(word) for word in words]
    direction = [value for value in values[-3:] if value is not None]
    # Beside a light's direction, some programs write further columns, such as its intensity.
    if len(words) < 4 or len(direction) < 3 or (len(words) > 4 and None not in values[1:-3]):
        raise FormatError(f'line {number} is "{" ".join(words)}" where "name x y z" of one light is needed; correct it')
    return " ".join(words[:-3]), direction


def _lp_number(word: str) -> float | None:
    try:
        number = float(word if "." in word else word.replace(",", "."))
    except ValueError:
        return None
    return number if np.isfinite(number) else None


def _lp_rig(directions: F64, file_name: str) -> LightRig:
    if len(directions) != 3:
        raise FormatError(
            f"it holds {len(directions)} lights, a rig has three; keep the lines of the red, green and blue light, or "
            f"choose them: mpsnet calibrate lights {file_name} --lights 1,2,3 -o rig.json"
        )
    return LightRig(directions)


@takes_files
def write_rig(path: AnyPath, rig: LightRig) -> None:
    """Write a JSON rig file atomically.

    Raises
    ------
    FileError
        If the file cannot be written.
    """
    angles = zip(rig.slants, rig.tilts, strict=True)
    distant = [{"slant": float(slant), "tilt": float(tilt)} for slant, tilt in angles]
    write_rig_data(path, distant, rig.near, rig.mixing, rig.is_ground_truth)


def write_rig_data(
    path: AnyPath, distant: list[dict[str, Any]], near: NearLights | None, mixing: F64, is_ground_truth: bool
) -> None:
    """Write a JSON rig file atomically, with the lights `near`, or `distant` if that is None."""
    data: dict[str, Any] = {"format": RIG_FORMAT, "version": RIG_VERSION, "lights": distant}
    if near is not None:
        data["lights"] = [{"position": position.tolist()} for position in near.positions]
        data |= {"target": near.target.tolist(), "lobe": near.lobe}
    if is_ground_truth or not np.array_equal(mixing, np.eye(3)):  # otherwise it is a default, not a measurement
        data["mixing"] = np.asarray(mixing).tolist()
    write_json(path, {**data, **({"exact": True} if is_ground_truth else {})})


# ----------------------------------------------------------------------------------------------------------------------
# Three lights that are fixed in the world while the camera moves.


@dataclass(frozen=True, eq=False)
class WorldLights:
    """Three lights in the world space of mesh and cameras.

    Raises
    ------
    GeometryError
        If the directions are not three finite vectors, one is zero, or the mixing matrix is singular.
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
        directions = finite_array(self.directions, (3, 3), "the directions of lights in the world", MAX_VALUE)
        if not directions.any(axis=1).all():
            raise GeometryError("a light in the world has the direction zero; give where it stands")
        object.__setattr__(self, "directions", directions)
        object.__setattr__(self, "mixing", _invertible(self.mixing))

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
        raise FormatError(f"{path}: an .lp file's lights are relative to the camera; lights in the world need a .json")
    return _rig_of_file(path, WorldLights)


def write_world_lights(path: AnyPath, lights: WorldLights) -> None:
    """Write a rig file with lights in world space atomically."""
    distant = [{"direction": direction.tolist()} for direction in lights.directions]
    write_rig_data(path, distant, lights.near, lights.mixing, lights.is_ground_truth)
