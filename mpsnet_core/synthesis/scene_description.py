"""Complete descriptions of a sample's scene, as plain data for both renderers."""

from dataclasses import asdict, dataclass, field, fields
from typing import Any, Literal

import numpy as np

from mpsnet_core.arrays.types import F64
from mpsnet_core.errors import FormatError, InputError
from mpsnet_core.scene.camera import Camera, camera_data, camera_from_data
from mpsnet_core.synthesis.field_limits import with_tuples

SCENE_VERSION = 1

Colour = tuple[float, float, float]


@dataclass(frozen=True)
class Material:
    """A material of the surface."""

    kind: Literal["principled", "merl", "fit"] = "principled"
    """"principled" (the parameters below are those of Blender's Principled BSDF), "merl" (a measured ``.binary`` file)
    or "fit" (a neural fit to MERL)."""
    source: str = ""
    """For "merl" the file name, for "fit" the name of the material; empty for "principled"."""
    tint: Colour = (1.0, 1.0, 1.0)
    """Factor of the reflectance of "merl" and "fit", per channel."""
    base_color: Colour = (0.8, 0.8, 0.8)
    """"Base Color", linear RGB."""
    roughness: float = 0.5
    """"Roughness", 0 to 1."""
    metallic: float = 0.0
    """"Metallic", 0 to 1."""
    specular: float = 0.5
    """"Specular IOR Level"; 0.5 is a dielectric with `ior`."""
    ior: float = 1.5
    """"IOR", the index of refraction."""
    sheen: float = 0.0
    """"Sheen Weight"."""
    sheen_roughness: float = 0.5
    """"Sheen Roughness", 0 to 1."""
    coat: float = 0.0
    """"Coat Weight"."""
    coat_roughness: float = 0.03
    """"Coat Roughness", 0 to 1."""
    subsurface: float = 0.0
    """"Subsurface Weight"."""
    subsurface_radius: float = 0.05
    """"Subsurface Radius", the same for all channels, in units of length (the object's bounding sphere has radius
    1)."""


@dataclass(frozen=True)
class Pattern:
    """Distribution of the materials over the surface, as a function of the position in object space."""

    kind: Literal["parts", "noise", "voronoi", "stripes"] = "parts"
    """"parts" (part p of the shape has material p modulo their number), "noise" (bands of a noise field), "voronoi"
    (cells of random materials), "stripes" (alternating along `direction`)."""
    scale: float = 2.0
    """Noise features, cells or stripes per unit of length; the object's bounding sphere has radius 1."""
    softness: float = 0.0
    """0 for hard edges; else the share of a band or cell in which neighbours blend, up to 1."""
    warp: float = 0.0
    """Amplitude of the noise that distorts the pattern, in units of 1 / scale."""
    direction: Colour = (1.0, 0.0, 0.0)
    """Unit vector across the stripes, in object space."""
    seed: int = 0
    """Seed of the noise and the cells."""


@dataclass(frozen=True)
class Paint:
    """Smooth variation of colour within each material: base colours times 1 + amount · noise per channel."""

    amount: float = 0.0
    """Factor on the noise, 0 to 1."""
    hue: float = 0.0
    """0 varies brightness only, 1 varies each channel independently."""
    scale: float = 1.0
    """Features per unit of length."""
    seed: int = 0
    """Seed of the noise."""


@dataclass(frozen=True)
class Dirt:
    """A matt layer of one colour over parts of the surface, with soft edges."""

    amount: float = 0.0
    """Share of the surface that it covers."""
    color: Colour = (0.2, 0.15, 0.1)
    """Its colour, linear RGB."""
    scale: float = 3.0
    """Patches per unit of length."""
    seed: int = 0
    """Seed of the noise."""


@dataclass(frozen=True)
class Bump:
    """Bump map: fine relief by noise, which changes shading normals and true normals, but not geometry."""

    height: float = 0.0
    """Amplitude in units of the object's radius."""
    scale: float = 20.0
    """Features per unit of length."""
    seed: int = 0
    """Seed of the noise."""


@dataclass(frozen=True)
class SceneDescription:
    """Complete description of the scene of sample `number` of a job."""

    seed: int
    """Seed of the job."""
    number: int
    """Number of the sample."""
    shape: dict[str, Any]
    """Description for :func:`mpsnet_core.synthesis.shapes.build_shape`, plain JSON."""
    rotation: F64
    """(3, 3) float64. From object space to world space, whose axes are the camera's."""
    camera: Camera
    """On the z axis, looking along -z, with a square image."""
    light_directions: F64
    """(3, 3) float64. Unit vectors from the origin to the three lights, one per row. Lights are white, distant, and of
    irradiance pi: a white matt surface facing one has radiance 1."""
    light_sizes: F64
    """(3,) float64. Angular diameters of the lights in degrees, 0 for a point at infinity."""
    materials: tuple[Material, ...]
    """The materials of the surface."""
    pattern: Pattern = field(default_factory=Pattern)
    """Distribution of the materials over the surface."""
    paint: Paint = field(default_factory=Paint)
    """Variation of colour within each material."""
    dirt: Dirt = field(default_factory=Dirt)
    """Matt layer over parts of the surface."""
    bump: Bump = field(default_factory=Bump)
    """Fine relief."""
    bounces: int = 0
    """Maximum number of bounces between surfaces; 0 for direct light only."""

    def data(self) -> dict[str, Any]:
        """The recipe as plain JSON data, for :func:`scene_from_data`."""
        return {"version": SCENE_VERSION, **{one.name: _plain(getattr(self, one.name)) for one in fields(self)}}


def scene_from_data(data: dict[str, Any]) -> SceneDescription:
    """A scene from :meth:`SceneDescription.data`, also after a JSON round trip. Raises FormatError if it is invalid."""
    try:
        if data["version"] > SCENE_VERSION:
            raise FormatError(f"the recipe is of version {data['version']}, this program reads up to {SCENE_VERSION}")
        return SceneDescription(
            seed=int(data["seed"]),
            number=int(data["number"]),
            shape=dict(data["shape"]),
            rotation=np.array(data["rotation"], np.float64).reshape(3, 3),
            camera=camera_from_data(data["camera"]),
            light_directions=np.array(data["light_directions"], np.float64).reshape(3, 3),
            light_sizes=np.array(data["light_sizes"], np.float64).reshape(3),
            materials=tuple(Material(**with_tuples(entry)) for entry in data["materials"]),
            pattern=Pattern(**with_tuples(data["pattern"])),
            paint=Paint(**with_tuples(data["paint"])),
            dirt=Dirt(**with_tuples(data["dirt"])),
            bump=Bump(**with_tuples(data["bump"])),
            bounces=int(data["bounces"]),
        )
    except InputError:
        raise
    except KeyError as error:
        raise FormatError(f"its recipe is not known to this program: it lacks {error}; make it again") from None
    except (TypeError, ValueError, AttributeError, OverflowError):
        raise FormatError("its recipe is not known to this program; make it again") from None


def _plain(value: Any) -> Any:
    """A field's value as JSON data."""
    if isinstance(value, tuple):
        return [asdict(material) for material in value]
    if isinstance(value, Camera):
        return camera_data(value)
    if isinstance(value, np.ndarray):
        return value.tolist()
    return asdict(value) if isinstance(value, Pattern | Paint | Dirt | Bump) else value
