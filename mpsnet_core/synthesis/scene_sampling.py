"""Draw recipes from a seed. All probability distributions of scene parameters are here.

The ranges are deliberately wider than the MPS-Net paper's (slant 30°, tilts 120° apart, MERL materials). Its errors on
photographs came from other rigs, perspective, soft shadows, and painted, dirty and metallic surfaces.
"""

import math
from collections.abc import Sequence
from dataclasses import replace
from functools import lru_cache
from typing import Any, Literal

import numpy as np

from mpsnet_core.arrays.types import F64
from mpsnet_core.errors import SettingsError
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.rig import direction_from_angles
from mpsnet_core.synthesis.job import SampleJob
from mpsnet_core.synthesis.random_sampling import choice, direction, generator, log_uniform, new_seed, rotation, uniform
from mpsnet_core.synthesis.reflectance import material_names
from mpsnet_core.synthesis.reflectance.lambertian_error import measured_errors
from mpsnet_core.synthesis.scene_description import Bump, Colour, Dirt, Material, Paint, Pattern, SceneDescription
from mpsnet_core.synthesis.shapes import draw_shape, mesh_files
from mpsnet_core.synthesis.shapes.shape import turn_about

# Relative frequency of each kind of shape among those that a job requests. Meshes from files are most frequent, if
# there are any. The largest errors on photographs are in hollows and in wide shadows that one part casts on another.
SHAPE_SHARES = {"blobs": 3, "drapery": 1.5, "reliefs": 1, "groups": 1.5, "hollows": 3, "meshes": 6, "scene": 2}

SENSOR_WIDTH = 36.0  # mm
ORTHOGRAPHIC_SHARE = 0.3
FOCAL_LENGTH = (35.0, 200.0)  # mm
MARGIN = (0.62, 1.1)  # half the image width, in radii of the object's bounding sphere
SHIFT = 0.06  # largest offset of the object's centre from the image centre, as a share of the width
ORTHOGRAPHIC_DISTANCE = 10.0

SLANT = (20.0, 60.0)  # degrees, of the rig
SLANT_SPREAD, TILT_SPREAD = 4.0, 8.0  # degrees, standard deviation of each light about its nominal direction
TILT_REACH = 30.0  # degrees, largest deviation of a light's tilt
# Any other rig: each light's slant in degrees, and the least volume that the three directions span. Rigs of three lamps
# on one side of an object, as people set them up, have volumes from 0.1 on; those around the camera 0.3 to 1.
ANY_SLANT, LEAST_VOLUME = (4.0, 65.0), 0.08
SHARP_LIGHT_SHARE = 0.4
SHARP_LIGHT, SOFT_LIGHT = (0.0, 1.0), (1.0, 20.0)  # degrees, angular diameter
# Shares of the samples with no, one, two and three bounces between surfaces, limited by the job's maximum.
BOUNCE_SHARES = (0.2, 0.55, 0.15, 0.1)
BOUNCE_SHARES_IN_HOLLOWS = (0.05, 0.3, 0.35, 0.3)

# Slants and tilts in degrees of the paper's own rig, and of the four triples of DiLiGenT's lights that it is evaluated
# on. They are few and all counter-clockwise: the paper's network knows the rig from the initial normals only.
PUBLISHED_RIGS = (
    ((30, 30, 30), (90, 210, 330)),
    ((42, 26, 42), (145, 262, 35)),  # 48, 1, 96
    ((26, 43, 43), (95, 211, 328)),  # 8, 41, 89
    ((34, 30, 28), (315, 58, 201)),  # 73, 72, 27
    ((22, 19, 27), (145, 278, 26)),  # 22, 50, 78
)
PUBLISHED_SPREAD = 2.0  # degrees, standard deviation of slants and tilts about these
# Largest error of equation 2, in degrees, on the measured materials of the style "paper". The paper's table 1 has 8.3
# degrees for a single pixel. On all of MERL, with its metals and strong colours, no network with three lights comes
# near that.
PUBLISHED_ERROR = 15.0

Z = (0.0, 0.0, 1.0)
UPRIGHT_ELEVATION, UPRIGHT_ROLL = (-10.0, 55.0), 8.0  # degrees
FRONT_TURN = 40.0  # degrees

# Materials of whole objects: plain matt ones such as plaster, clay and unglazed stone; satin paint; dark engraved
# metal; or several materials of any kind.
FINISH_SHARES = {"plain": 0.33, "satin": 0.12, "metal": 0.07, "mixed": 0.48}
PLAIN_ROUGHNESS, PLAIN_SPECULAR, PLAIN_BRIGHTNESS = (0.7, 1.0), (0.0, 0.5), (0.12, 0.9)
LAMBERTIAN_SHARE = 0.5  # share of the plain materials without any gloss
SATIN_ROUGHNESS = (0.25, 0.6)
METAL_ROUGHNESS, DARK_METAL = (0.15, 0.5), (0.05, 0.35)
ENGRAVED_SHARE = 0.8

MATERIAL_COUNT_SHARES = (0.22, 0.26, 0.2, 0.15, 0.1, 0.07)  # for 1 to 6
HELD_OUT = 5  # every fifth measured material is for validation
MEASURED_SHARE = 0.6  # share of measured materials, if the job has any
TINT_SHARE, TINT = 0.3, (0.3, 1.0)  # share of measured materials that are tinted, and range of the tint
PATTERN_SHARES = {"parts": 0.25, "noise": 0.3, "voronoi": 0.2, "stripes": 0.25}
PATTERN_SCALE = (0.7, 8.0)
HARD_EDGE_SHARE = 0.45
SOFTNESS, WARP = (0.1, 1.0), (0.0, 0.6)
PAINT_SHARE, PAINT_AMOUNT, PAINT_SCALE = 0.5, (0.1, 0.7), (0.5, 6.0)
DIRT_SHARE, DIRT_AMOUNT, DIRT_SCALE = 0.25, (0.05, 0.5), (1.0, 8.0)
BUMP_SHARE, BUMP_SLOPE, BUMP_SCALE = 0.35, (0.03, 0.3), (8.0, 60.0)

ONE_TONE_SHARE = 0.4  # share of samples whose materials have one hue and differ in brightness only
GREY_SHARE = 0.35  # share of grey among the colours
# Share of natural tones among the other colours, as of skin, wood, clay, leather and brass: orange, rarely saturated.
NATURAL_SHARE, NATURAL_HUE, NATURAL_SPREAD, NATURAL_SATURATION = 0.5, 0.08, 0.04, (0.1, 0.6)
BRIGHTNESS = (0.04, 0.9)
ROUGHNESS = {(0.6, 1.0): 0.5, (0.25, 0.6): 0.35, (0.06, 0.25): 0.15}  # range, share
METAL_SHARE, METAL_BRIGHTNESS = 0.15, (0.05, 0.9)
SPECULAR, IOR = (0.2, 0.8), (1.3, 1.7)
SHEEN_SHARE, COAT_SHARE, SUBSURFACE_SHARE = 0.1, 0.15, 0.1
SUBSURFACE_RADIUS = (0.1, 1.0)  # Blender's parameter; light spreads about a twelfth of it


def draw_scene(job: SampleJob, number: int) -> SceneDescription:
    """The recipe of sample `number` of `job`. It is the same on every machine and in any order.

    Raises FileError or FormatError if the job's folder of meshes or its measured materials cannot be read.
    """
    rng = generator(job.seed, 1, number)
    shape = _draw_shape(job, number // job.views)
    if job.style != "photographs":
        return _paper_scene(job, number, rng, shape)
    finish = choice(rng, list(FINISH_SHARES), list(FINISH_SHARES.values()))
    count = choice(rng, range(1, 7), MATERIAL_COUNT_SHARES) if finish == "mixed" else 1
    return SceneDescription(
        seed=job.seed,
        number=number,
        shape=shape,
        rotation=_rotation(rng, shape["pose"]),
        camera=_camera(rng, job.size),
        light_directions=_any_directions(rng) if job.rigs == "any" else _light_directions(rng),
        light_sizes=np.full(3, _light_size(rng)),
        materials=() if shape["kind"] == "scene" else _materials(rng, finish, count, _measured(job)),
        pattern=_pattern(rng, count),
        paint=_paint(rng, PAINT_SHARE if finish in ("mixed", "metal") else 0.0),
        dirt=_dirt(rng, DIRT_SHARE if finish in ("mixed", "metal") else 0.0),
        bump=_bump(rng, ENGRAVED_SHARE if finish == "metal" else BUMP_SHARE),
        bounces=_bounces(rng, job, BOUNCE_SHARES_IN_HOLLOWS if shape["kind"] == "hollows" else BOUNCE_SHARES),
    )


def _paper_scene(job: SampleJob, number: int, rng: np.random.Generator, shape: dict[str, Any]) -> SceneDescription:
    """A recipe like the MPS-Net paper's samples: two to six measured materials in a pattern, under point lights."""
    measured = _measured(job)
    if job.style == "paper":
        errors = measured_errors(job.merl)
        measured = [one for one in measured if errors[one[1]] <= PUBLISHED_ERROR]
    if not measured:
        raise SettingsError(f"no material of {job.merl} is as the paper's: matt enough and of weak colour; take more")
    count = choice(rng, range(2, 7), MATERIAL_COUNT_SHARES[1:])
    chosen = [choice(rng, measured) for _ in range(count)]
    pattern = _pattern(rng, count)
    if pattern.kind == "parts":  # a shape with one part would have one material
        pattern = replace(pattern, kind="noise")
    return SceneDescription(
        seed=job.seed,
        number=number,
        shape=shape,
        rotation=_rotation(rng, shape["pose"]),
        camera=_camera(rng, job.size),
        light_directions=_published_directions(rng, PUBLISHED_RIGS[: 1 if job.style == "paper-one-rig" else None]),
        light_sizes=np.zeros(3),
        materials=tuple(Material(kind=kind, source=source) for kind, source in chosen),
        pattern=pattern,
        bounces=_bounces(rng, job, BOUNCE_SHARES),
    )


def _draw_shape(job: SampleJob, number: int) -> dict[str, Any]:
    rng = generator(job.seed, 0, number)
    kind = choice(rng, job.shapes, [SHAPE_SHARES[name] for name in job.shapes])
    if kind == "scene":
        return {"kind": "scene", "pose": "upright"}
    return draw_shape(rng, kind, mesh_files(job.meshes) if kind == "meshes" else ())


def _bounces(rng: np.random.Generator, job: SampleJob, shares: Sequence[float]) -> int:
    return min(job.bounces, choice(rng, range(4), shares))


# --- poses, camera and lights -----------------------------------------------------------------------------------------


def _rotation(rng: np.random.Generator, pose: str) -> F64:
    if pose not in ("upright", "front"):
        return rotation(rng)
    spin = turn_about(Z, uniform(rng, 0, 360)).T
    if pose == "upright":  # the object's z is up in the image, seen from slightly below to well above
        roll = turn_about(Z, uniform(rng, -UPRIGHT_ROLL, UPRIGHT_ROLL)).T
        return roll @ turn_about((1, 0, 0), uniform(rng, *UPRIGHT_ELEVATION) - 90).T @ spin
    # "front": the object's z towards the camera
    tilt = uniform(rng, 0, 2 * math.pi)
    lean: F64 = turn_about((math.cos(tilt), math.sin(tilt), 0), FRONT_TURN * math.sqrt(rng.random())).T
    return lean @ spin


def _camera(rng: np.random.Generator, size: int) -> Camera:
    orthographic = rng.random() < ORTHOGRAPHIC_SHARE
    length, margin = log_uniform(rng, *FOCAL_LENGTH), log_uniform(rng, *MARGIN)
    centre = size * (0.5 + SHIFT * (2 * rng.random(2) - 1))
    pose = np.eye(4)
    if orthographic:
        pose[2, 3] = ORTHOGRAPHIC_DISTANCE
        return Camera("orthographic", size, size, np.full(2, size / (2 * margin)), centre, pose)
    pose[2, 3] = margin / math.sin(math.atan(SENSOR_WIDTH / 2 / length))
    return Camera("perspective", size, size, np.full(2, size * length / SENSOR_WIDTH), centre, pose)


def _light_directions(rng: np.random.Generator) -> F64:
    slants = np.clip(uniform(rng, *SLANT) + SLANT_SPREAD * rng.normal(size=3), *SLANT)
    handed = 1 if rng.random() < 0.5 else -1
    strays = np.clip(TILT_SPREAD * rng.normal(size=3), -TILT_REACH, TILT_REACH)
    return direction_from_angles(slants, 360 * rng.random() + handed * np.array([0, 120, 240]) + strays)


def _any_directions(rng: np.random.Generator) -> F64:
    while True:
        directions = direction_from_angles(rng.uniform(*ANY_SLANT, 3), rng.uniform(0, 360, 3))
        if abs(np.linalg.det(directions)) > LEAST_VOLUME:
            return directions


def _published_directions(rng: np.random.Generator, rigs: Sequence[Any]) -> F64:
    slants, tilts = np.array(choice(rng, rigs)) + PUBLISHED_SPREAD * np.clip(rng.normal(size=(2, 3)), -2, 2)
    return direction_from_angles(slants, tilts)


def _light_size(rng: np.random.Generator) -> float:
    sharp = rng.random() < SHARP_LIGHT_SHARE
    return uniform(rng, *SHARP_LIGHT) if sharp else log_uniform(rng, *SOFT_LIGHT)


# --- materials --------------------------------------------------------------------------------------------------------

_names = lru_cache(maxsize=8)(material_names)


def _measured(job: SampleJob) -> list[tuple[Literal["merl", "fit"], str]]:
    names = _names(job.merl) if job.merl else []
    if job.merl_part == "all":
        return names
    held_out = set(names[::HELD_OUT])
    return [name for name in names if (name in held_out) == (job.merl_part == "validation")]


def _materials(
    rng: np.random.Generator, finish: str, count: int, measured: list[tuple[Literal["merl", "fit"], str]]
) -> tuple[Material, ...]:
    if finish != "mixed":
        return (_uniform_material(rng, finish),)
    tone = _colour(rng, BRIGHTNESS) if rng.random() < ONE_TONE_SHARE else None
    materials = []
    for _ in range(count):
        if measured and rng.random() < MEASURED_SHARE:
            kind, source = measured[int(rng.integers(len(measured)))]
            tint = _colour(rng, TINT) if rng.random() < TINT_SHARE else (1.0, 1.0, 1.0)
            materials.append(Material(kind=kind, source=source, tint=tint))
        else:
            materials.append(_principled(rng, tone))
    return tuple(materials)


def _uniform_material(rng: np.random.Generator, finish: str) -> Material:
    """The material of a plain, satin or metal object."""
    if finish == "plain":
        return Material(
            base_color=_colour(rng, PLAIN_BRIGHTNESS),
            roughness=uniform(rng, *PLAIN_ROUGHNESS),
            specular=uniform(rng, *PLAIN_SPECULAR) * (rng.random() >= LAMBERTIAN_SHARE),
        )
    if finish == "satin":
        coated = rng.random() < 0.5
        return Material(
            base_color=_colour(rng, BRIGHTNESS),
            roughness=uniform(rng, *SATIN_ROUGHNESS),
            specular=uniform(rng, *SPECULAR),
            coat=uniform(rng, 0.2, 1.0) * coated,
            coat_roughness=uniform(rng, 0.1, 0.4),
        )
    return Material(base_color=_colour(rng, DARK_METAL), roughness=uniform(rng, *METAL_ROUGHNESS), metallic=1.0)


def _principled(rng: np.random.Generator, tone: Colour | None) -> Material:
    metal = rng.random() < METAL_SHARE
    brightness = METAL_BRIGHTNESS if metal else BRIGHTNESS
    if tone is None:
        color = _colour(rng, brightness)
    else:
        scale = log_uniform(rng, *brightness) / max(tone)
        color = (tone[0] * scale, tone[1] * scale, tone[2] * scale)
    roughness = uniform(rng, *choice(rng, list(ROUGHNESS), list(ROUGHNESS.values())))
    sheen, coat, subsurface = rng.random(3) < (SHEEN_SHARE, COAT_SHARE, SUBSURFACE_SHARE)
    return Material(
        base_color=color,
        roughness=roughness,
        metallic=float(metal),
        specular=uniform(rng, *SPECULAR),
        ior=uniform(rng, *IOR),
        sheen=uniform(rng, 0.2, 1.0) * bool(sheen),
        sheen_roughness=uniform(rng, 0.2, 0.8),
        coat=uniform(rng, 0.3, 1.0) * bool(coat),
        coat_roughness=uniform(rng, 0.02, 0.3),
        subsurface=uniform(rng, 0.2, 1.0) * bool(subsurface),
        subsurface_radius=log_uniform(rng, *SUBSURFACE_RADIUS),
    )


def _colour(rng: np.random.Generator, brightness: tuple[float, float]) -> Colour:
    """A linear colour, grey, natural or of any hue and saturation, whose brightest channel is within `brightness`."""
    value = log_uniform(rng, *brightness)
    saturation, hue = 0.0 if rng.random() < GREY_SHARE else rng.random(), rng.random()
    if rng.random() < NATURAL_SHARE and saturation:
        low, high = NATURAL_SATURATION
        saturation, hue = low + (high - low) * saturation, NATURAL_HUE + NATURAL_SPREAD * float(rng.normal())
    hexagon = np.abs((6 * hue + np.array([0, 4, 2])) % 6 - 3) - 1  # HSV, red at 0
    red, green, blue = value * (1 - saturation * (1 - np.clip(hexagon, 0, 1)))
    return float(red), float(green), float(blue)


def _pattern(rng: np.random.Generator, count: int) -> Pattern:
    kind = choice(rng, list(PATTERN_SHARES), list(PATTERN_SHARES.values()))
    hard = rng.random() < HARD_EDGE_SHARE
    x, y, z = direction(rng).tolist()
    return Pattern(
        kind="parts" if count == 1 else kind,  # type: ignore[arg-type]
        scale=log_uniform(rng, *PATTERN_SCALE),
        softness=uniform(rng, *SOFTNESS) * (not hard),
        warp=uniform(rng, *WARP),
        direction=(x, y, z),
        seed=new_seed(rng),
    )


def _paint(rng: np.random.Generator, share: float) -> Paint:
    painted, coloured = rng.random(2) < (share, 0.5)
    return Paint(
        amount=uniform(rng, *PAINT_AMOUNT) * bool(painted),
        hue=rng.random() * bool(coloured),
        scale=log_uniform(rng, *PAINT_SCALE),
        seed=new_seed(rng),
    )


def _dirt(rng: np.random.Generator, share: float) -> Dirt:
    dirty = rng.random() < share
    return Dirt(
        amount=uniform(rng, *DIRT_AMOUNT) * dirty,
        color=_colour(rng, (0.03, 0.4)),
        scale=log_uniform(rng, *DIRT_SCALE),
        seed=new_seed(rng),
    )


def _bump(rng: np.random.Generator, share: float) -> Bump:
    bumpy = rng.random() < share
    slope, scale = log_uniform(rng, *BUMP_SLOPE), log_uniform(rng, *BUMP_SCALE)
    return Bump(height=slope / scale * bumpy, scale=scale, seed=new_seed(rng))
