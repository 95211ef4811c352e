"""Files of heights on a mesh's UVs, from those of a normal texture, a single one or UDIM tiles."""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mpsnet_core.arrays.rasterize import texel_coordinates, triangle_of_texel
from mpsnet_core.arrays.types import F32
from mpsnet_core.errors import SettingsError
from mpsnet_core.io.files import check_no_overwrite, writable_image, write_transaction
from mpsnet_core.io.image_reading import read_size
from mpsnet_core.operation import Result
from mpsnet_core.progress import Progress, part
from mpsnet_core.relief.displacement.displacement import Displacement, displacement
from mpsnet_core.relief.displacement.height_constraints import object_normals
from mpsnet_core.relief.displacement.uv_layout import tiles_of
from mpsnet_core.relief.height_files import HeightFacts, HeightScale, height_files, write_height
from mpsnet_core.relief.operations import Integrate
from mpsnet_core.scene.mesh import Mesh, read_mesh
from mpsnet_core.scene.normal_encoding import write_vectors
from mpsnet_core.scene.normal_map import read_normals
from mpsnet_core.scene.texture_names import check_one_texture, split_by, texture_files
from mpsnet_core.scene.texture_sets import TextureSet, texture_sets

log = logging.getLogger(__name__)

# If normals contradict one another on a larger fraction of the surface, texture and mesh do not fit. In photos, around
# eyes and nostrils, it is a few hundredths.
DOUBTFUL = 0.3


@dataclass(frozen=True)
class HeightsOnUVs(Result):
    """Heights on a mesh's UVs."""

    outputs: list[str]
    """The files of heights, of their scales, and of the normals in object space."""
    tiles: list[int]
    """Numbers of the UDIM tiles."""
    unit: str
    """Name of the mesh's unit."""
    height: HeightFacts
    """The lowest and the highest height, the files' scale, and the step at the seams."""


def write_displacement(options: Integrate, progress: Progress) -> HeightsOnUVs:
    """Integrate a normal texture to heights on the mesh that it was baked onto, and write them.

    Raises InputError if a file cannot be read or written, a value is out of range, or texture and mesh do not fit.
    """
    assert options.uvs and options.height
    unit = options.unit or "unit"
    tiled = _checked_names(options, options.height)
    progress(0.0, "reading the mesh")
    mesh, base_mesh = read_mesh(options.uvs), read_mesh(options.base) if options.base else None
    chosen = texture_sets([mesh], tiles=tiled)
    if tiled:
        chosen = _with_texels(chosen, options.normals, mesh)
    names = options.normals, options.height, options.object_space
    normals, outputs, turned = (_files(name, chosen, tiled) for name in names)
    taken = [*normals, Path(options.uvs), *([Path(options.base)] if options.base else [])]
    files = _checked(outputs, turned, options.height_bits, taken)
    tiles = tiles_of(chosen)
    progress(0.05, f"reading {Path(options.normals).name}")
    vectors = tiles.joined(read_normals(file, convention=options.convention).vectors for file in normals)
    laid = tiles.mesh(mesh) if tiled else mesh
    base = tiles.mesh(base_mesh) if tiled and base_mesh else base_mesh
    how = {name: getattr(options, name) for name in ("space", "scale", "mean", "margin")}
    found = displacement(vectors, laid, base=base, **how, progress=part(progress, 0.1, 0.9))
    progress(0.9, f"writing {Path(options.height).name}")
    with write_transaction():
        parts = dict(zip(outputs, tiles.parted(found.values), strict=True))
        means = _write_heights(parts, found, options.height_bits, unit)
        if turned:
            _write_normals(dict(zip(turned, tiles.parted(object_normals(vectors, laid, options.margin)), strict=True)))
    inside = found.values[found.covered]
    lowest, highest = float(inside.min()), float(inside.max())
    baked = f"in {options.space} space and {options.convention}"
    _warn_of_misfit(found, highest - lowest, mesh, unit, baked)
    return HeightsOnUVs(
        [str(file) for file in files],
        [texture_set.tile for texture_set in chosen if texture_set.tile],
        unit,
        means.facts(lowest, highest, found.seam_step),
        text=f"{options.height}: heights from {lowest:.4g} to {highest:.4g} {unit}; {means}; {means.displace_words}",
    )


def _checked_names(options: Integrate, height: str) -> bool:
    """Whether the files are of UDIM tiles. Raises SettingsError if only some are, or `object_space` is not needed."""
    if options.object_space and options.space == "object":
        raise SettingsError(f"{options.normals} is in object space already; leave --object-space out")
    tiled = _tiled(options.normals, height)
    return _tiled(options.normals, options.object_space) if options.object_space else tiled


def _tiled(normals: str, height: str) -> bool:
    """Whether texture and heights are of UDIM tiles. Raises SettingsError if only one of them is."""
    normals_tiled, height_tiled = ("tile" in split_by(name) for name in (normals, height))
    if normals_tiled != height_tiled:
        has, lacks = (normals, height) if normals_tiled else (height, normals)
        raise SettingsError(f"{has} means a file for each UDIM tile, and {lacks} one for all; put <UDIM> into both")
    if not normals_tiled:
        check_one_texture(normals)
        check_one_texture(height)
    return normals_tiled


def _files(name: str | None, chosen: Sequence[TextureSet], tiled: bool) -> list[Path]:
    if not name:
        return []
    return texture_files(name, chosen) if tiled else [Path(name)]


def _with_texels(chosen: list[TextureSet], normals: str, mesh: Mesh) -> list[TextureSet]:
    """The tiles, except those that a bake writes no texture for: the file is missing, no texel lies on their UVs."""
    textures = texture_files(normals, chosen)
    first = next((file for file in textures if file.is_file()), None)
    shape = read_size(first) if first else None
    if shape is None:
        return chosen

    def has_texels(texture_set: TextureSet) -> bool:
        size = shape[1], shape[0]
        corners = texel_coordinates(mesh.uvs[texture_set.parts[0]] - np.array(texture_set.corner, float), size)
        return bool((triangle_of_texel(corners, size) >= 0).any())

    both = zip(chosen, textures, strict=True)
    return [texture_set for texture_set, file in both if file.is_file() or has_texels(texture_set)]


def _write_heights(parts: Mapping[Path, F32], found: Displacement, bits: int | None, unit: str) -> HeightScale:
    """Write each file's part of the heights, all with one scale. Returns the scale."""
    ends = float(found.values.min()), float(found.values.max())
    for file, values in parts.items():
        heights = replace(found, values=values).as_height_map()
        means = write_height(file, heights, bits=bits, unit=unit, on_uvs=True, ends=ends)
    return means


def _write_normals(parts: Mapping[Path, F32]) -> None:
    for file, vectors in parts.items():
        write_vectors(file, vectors)


def _checked(outputs: Sequence[Path], turned: Sequence[Path], bits: int | None, taken: Sequence[Path]) -> list[Path]:
    """The files of heights and scales, and `turned`. Raises InputError if they cannot be written, or are `taken`."""
    files: list[Path] = []
    for output in outputs:
        written = height_files(output, bits)
        check_no_overwrite(taken, written)
        files += written[:2]
    check_no_overwrite([*taken, *files], map(writable_image, turned))
    return [*files, *turned]


def _warn_of_misfit(found: Displacement, span: float, mesh: Mesh, unit: str, baked: str) -> None:
    """Warn if the texture seems to belong to another mesh, or to be `baked` differently. span: of the heights."""
    across = float(np.linalg.norm(np.ptp(mesh.world_vertices, axis=0)))
    misfits = []
    if span > across:
        misfits.append(f"the heights span {span:.3g} {unit}, and the whole mesh {across:.3g}")
    if found.contradicted > DOUBTFUL:
        misfits.append(f"its normals contradict each other on {found.contradicted:.0%} of the surface, left flat")
    if misfits:
        log.warning("%s; was the texture baked onto this mesh, %s (--space, --convention)?", "; ".join(misfits), baked)
