"""Samples: a view under each of three white lights, with its true normals; one EXR file each."""

import json
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
import OpenImageIO as oiio

from mpsnet_core.arrays.types import F32, I32, Bools
from mpsnet_core.arrays.unit_vectors import dot, normalised
from mpsnet_core.errors import FileError, FormatError, InputError
from mpsnet_core.io.files import MAX_TEXT_BYTES, atomic_write, existing_file
from mpsnet_core.io.image_input import channel_names, image_attribute, image_input, pending_error, silence_libraries
from mpsnet_core.io.image_reading import MAX_VALUE
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.rig import LightRig
from mpsnet_core.synthesis.scene_description import SceneDescription, scene_from_data

SAMPLE_VERSION = 1
METADATA = "mpsnet:sample"
MAX_SIDE = 8192
# Channels in file order. Light is stored as half floats (precision 0.05%), geometry as floats.
_CHANNELS = (
    *(f"light{k}.{c}" for k in (1, 2, 3) for c in "RGB"),
    *(f"normal.{c}" for c in "XYZ"),
    "depth.Z",
    "alpha.A",
    "material.V",
    *(f"lit{k}.V" for k in (1, 2, 3)),
)
_FLOATS = {"normal.X", "normal.Y", "normal.Z", "depth.Z"}
_HALF_MAX = 65504.0
# OpenImageIO adds the current time to every EXR without a date. A fixed date makes files reproducible.
_NO_DATE = "1970:01:01 00:00:00"


@dataclass(frozen=True, eq=False)
class Sample:
    """One view under each of three white lights, H x W pixels, row 0 on top."""

    lights: F32
    """(3, H, W, 3) float32. Linear RGB radiance under each light alone; 1 for a white matt surface facing the light.
    Premultiplied with alpha: the background is black."""
    normals: F32
    """(H, W, 3) float32. True unit normals in camera space (x right, y up, z towards the camera), bump included; zero
    outside alpha."""
    depth: F32
    """(H, W) float32. Distance in front of the camera along its axis, in radii of the object's bounding sphere; 0
    outside alpha."""
    alpha: F32
    """(H, W) float32. Coverage of the pixel by the object, 0 to 1."""
    material: I32
    """(H, W) int32. Index of the material with the largest weight; -1 outside alpha."""
    lit: F32
    """(3, H, W) float32. Share of each light that reaches the pixel, 0 to 1; 0 in attached and cast shadow."""
    recipe: SceneDescription
    """Description of the scene."""
    renderer: str
    """For example "synthesis" or "Cycles 4.5.15"."""

    @property
    def mask(self) -> Bools:
        """(H, W) pixels that the object covers completely."""
        return self.alpha > 0.99

    @property
    def lit_fractions(self) -> tuple[float, float, float, float]:
        """Shares of the mask's pixels that no, one, two and three lights reach by at least half."""
        count = (self.lit >= 0.5).sum(axis=0)[self.mask]
        shares = np.bincount(count, minlength=4) / max(1, len(count))
        return tuple(float(share) for share in shares)  # type: ignore[return-value]


def write_sample(path: AnyPath, sample: Sample) -> None:
    """Write a sample as one multi-layer EXR, atomically.

    Layers are light1, light2, light3 (R, G, B), normal (X, Y, Z), depth (Z), alpha (A), material and lit1 to lit3 (V).
    The recipe, with rig and camera, is JSON in the attribute "mpsnet:sample". The same sample gives the same bytes.

    Raises InputError if a value is not finite, FileError if the file cannot be written.
    """
    path = Path(path)
    if not all(np.isfinite(values).all() for values in (sample.lights, sample.normals, sample.depth, sample.lit)):
        raise InputError(f"cannot write {path}: the picture holds values that are not finite; render it again")
    planes = [
        *np.minimum(sample.lights, _HALF_MAX).transpose(0, 3, 1, 2).reshape(9, *sample.alpha.shape),
        *sample.normals.transpose(2, 0, 1),
        sample.depth,
        sample.alpha,
        sample.material,
        *sample.lit,
    ]
    pixels = np.ascontiguousarray(np.stack(planes, axis=-1), np.float32)
    height, width, count = pixels.shape
    spec = oiio.ImageSpec(width, height, count, "float")
    spec.channelnames = _CHANNELS
    spec.channelformats = tuple(oiio.TypeFloat if name in _FLOATS else oiio.TypeHalf for name in _CHANNELS)
    spec.attribute("compression", "zip:2")  # as small as zip:4 in two thirds of the time
    spec.attribute("DateTime", _NO_DATE)
    spec.attribute("oiio:ColorSpace", "raw")
    about = {"version": SAMPLE_VERSION, "renderer": sample.renderer, "lit_fractions": sample.lit_fractions}
    spec.attribute(METADATA, json.dumps({**about, "recipe": sample.recipe.data()}))
    with atomic_write(path) as unfinished:
        target = oiio.ImageOutput.create(str(unfinished))
        assert target is not None
        done = closed = False
        try:
            done = target.open(str(unfinished), spec) and target.write_image(pixels)
        finally:  # Windows cannot remove open files
            closed = target.close()
        if not (closed and done):
            reason = pending_error(target) or pending_error(oiio)
            raise FileError(f"cannot write {path} ({reason}); is the disk full?")


def read_sample(path: AnyPath) -> Sample:
    """Read and check a sample.

    Parameters
    ----------
    path
        A multi-layer EXR that ``mpsnet synthesize`` or Blender made.

    Returns
    -------
    Sample
        With normalised normals; light and `lit` have the precision of half floats.

    Raises
    ------
    FileError
        If there is no such file.
    FormatError
        If the file is truncated, damaged or no sample.
    """
    with _opened(path) as (source, path):
        data, recipe = _description(source, path)
        values = _pixels(source, 0, source.spec().height, path)
        order = [channel_names(source.spec(), path).index(name) for name in _CHANNELS]
    if not (np.abs(values) <= MAX_VALUE).all():
        raise _damaged(path, "values that are not finite")
    # Planar in memory, viewed as (H, W, 3): computations on it are several times faster.
    planes = np.stack([values[..., number] for number in order])
    lights = planes[:9].reshape(3, 3, *planes.shape[1:]).transpose(0, 2, 3, 1)
    normals, (depth, alpha, material), lit = planes[9:12].transpose(1, 2, 0), planes[12:15], planes[15:]
    length = np.sqrt(dot(normals, normals))
    for fault, found in {
        "an alpha outside 0 to 1": _outside_unit(alpha),
        "shares of light outside 0 to 1": _outside_unit(lit),
        "materials that are no numbers": (material != np.rint(material)).any() or material.min() < -1,
        "normals that are not of unit length": ((np.abs(length - 1) > 0.05) & (alpha > 0.99)).any(),
    }.items():
        if found:
            raise _damaged(path, fault)
    normals = np.where((alpha > 0)[..., None], normalised(normals), np.float32(0))
    alpha, lit, material = np.clip(alpha, 0, 1), np.clip(lit, 0, 1), material.astype(np.int32)
    return Sample(lights, normals, depth, alpha, material, lit, recipe, data["renderer"])


def read_sample_data(path: AnyPath) -> dict[str, Any]:
    """Read a sample's metadata only: "version", "renderer", "lit_fractions" and "recipe" (plain data).

    Also reads the last row of pixels, which truncated files lack. Raises FormatError if the file is truncated or no
    sample.
    """
    with _opened(path) as (source, path):
        data, _ = _description(source, path)
        height = source.spec().height
        _pixels(source, height - 1, height, path)
    return data


@contextmanager
def _opened(path: AnyPath) -> Iterator[tuple[Any, Path]]:
    """The open file, after checking that it is one image with a sample's channels and an acceptable size."""
    path = existing_file(path, "sample")
    source = image_input(path)
    if source is None:
        raise FormatError(f"{path} is not a sample, or its header is cut short; delete it and make it again")
    try:
        spec = source.spec()
        placed = (spec.x, spec.y, spec.full_width, spec.full_height) == (0, 0, spec.width, spec.height)
        if source.format_name() != "openexr" or sorted(channel_names(spec, path)) != sorted(_CHANNELS) or not placed:
            raise FormatError(f"{path} is no sample: it lacks a sample's layers; give one that this program made")
        if max(spec.width, spec.height, spec.tile_width, spec.tile_height) > MAX_SIDE or spec.depth > 1:
            raise FormatError(
                f"sample {path} states a size of {spec.width} x {spec.height}, more than {MAX_SIDE} pixels a side; "
                "make it again, smaller"
            )
        yield source, path
    finally:
        source.close()


def _description(source: Any, path: Path) -> tuple[dict[str, Any], SceneDescription]:
    """The metadata and its recipe, after checking that they are complete and match the image."""
    text = image_attribute(source.spec(), METADATA, str)
    if text is None or len(text) > MAX_TEXT_BYTES:
        raise FormatError(f"{path} is no sample: it has no description; give one that this program made")
    try:
        data = json.loads(text)
        version, renderer = data["version"], data["renderer"]
        known = isinstance(version, int) and isinstance(renderer, str) and isinstance(data["recipe"], dict)
        shares = [float(share) for share in data["lit_fractions"]]
        known = known and len(shares) == 4 and all(0 <= share <= 1 for share in shares)
    except (KeyError, TypeError, ValueError, OverflowError, RecursionError):
        known = False
    if not known:
        raise FormatError(f"sample {path} is damaged: its description cannot be read; delete it and make it again")
    if not 1 <= version <= SAMPLE_VERSION:
        raise FormatError(f"sample {path} has version {version}, above {SAMPLE_VERSION}; update this program")
    try:
        recipe = scene_from_data(data["recipe"])
        rig = LightRig(recipe.light_directions)
    except InputError as error:
        raise FormatError(f"sample {path}: {error}; delete it and make it again") from None
    spec, camera = source.spec(), recipe.camera
    turns = np.allclose(recipe.rotation @ recipe.rotation.T, np.eye(3), atol=1e-4)
    lit = np.allclose(rig.directions, recipe.light_directions, atol=1e-4) and (recipe.light_sizes >= 0).all()
    if not (turns and lit and (camera.width, camera.height) == (spec.width, spec.height)):
        raise FormatError(f"sample {path} is damaged: its recipe does not fit it; delete it and make it again")
    return data, recipe


def _pixels(source: Any, begin: int, end: int, path: Path) -> F32:
    """Rows `begin` to `end` - 1 of all channels, (rows, W, C)."""
    with silence_libraries():
        values = source.read_scanlines(begin, end, 0, 0, len(_CHANNELS), oiio.FLOAT)
    reason = pending_error(source)
    if values is None or reason:
        raise FormatError(f"sample {path} is damaged ({reason or 'no pixels'}); delete it and make it again")
    return np.asarray(values, np.float32).reshape(end - begin, source.spec().width, len(_CHANNELS))


def _damaged(path: Path, fault: str) -> FormatError:
    return FormatError(f"sample {path} is damaged: it holds {fault}; delete it and make it again")


def _outside_unit(values: F32) -> bool:
    # Half floats and denoisers cause small deviations.
    return bool(values.min() < -0.001 or values.max() > 1.001)
