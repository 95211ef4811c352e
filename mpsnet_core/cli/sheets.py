"""Which textures a verb that bakes makes of which meshes, where they go, and what became of them."""

import argparse
import logging
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mpsnet_core.errors import InputError

if TYPE_CHECKING:
    from mpsnet_core.bake.existing_maps import BaseMaps
    from mpsnet_core.bake.texture import Texture
    from mpsnet_core.bake.texture_sets import TextureSet
    from mpsnet_core.scene.mesh import Mesh

log = logging.getLogger(__name__)

# So many textures are listed one by one; of more, the first and the last.
LISTED = 12


@dataclass(frozen=True)
class Plan:
    """Textures to be made of meshes: a sheet and a file for each.

    patterns: the files with <UDIM> in place of the tile's number. presents: the maps that go beneath them.
    """

    meshes: "Sequence[Mesh]"
    sheets: "Sequence[TextureSet]"
    files: Sequence[Path]
    patterns: Sequence[Path]
    base_maps: "BaseMaps"


@dataclass(frozen=True)
class Made:
    """A texture that was written. pattern: see :class:`Plan`. seen, covered: how many texels a view saw, and all.
    albedo: the file of the colours, where the views have them."""

    file: Path
    pattern: Path
    sheet: "TextureSet"
    seen: int
    covered: int
    albedo: Path | None = None


def planned(options: argparse.Namespace, taken: Sequence[Path]) -> Plan:
    """The textures that --mesh, --output and --onto ask for; meshes are read.

    taken: what no texture may overwrite.

    Raises InputError where a mesh cannot be read, no texture has a present map, or a texture has no place.
    """
    from mpsnet_core.bake.existing_maps import BaseMaps, maps_beneath
    from mpsnet_core.bake.texture_names import split_by, texture_files, tile_patterns
    from mpsnet_core.bake.texture_sets import sheets
    from mpsnet_core.io.files import writable_path
    from mpsnet_core.io.frames import check_apart
    from mpsnet_core.scene.mesh import read_mesh

    by = split_by(options.output)
    meshes = [read_mesh(file) for file in options.mesh]
    if "object" in by:
        meshes = [_named(mesh, Path(file).stem) for mesh, file in zip(meshes, options.mesh, strict=True)]
    if "material" in by and not any(mesh.materials for mesh in meshes):
        raise InputError(f"{' and '.join(options.mesh)}: there are no materials; leave <MATERIAL> out of --output")
    chosen = sheets(meshes, tiles="tile" in by, materials="material" in by, objects="object" in by)
    files = texture_files(options.output, chosen)
    beneath = maps_beneath(options.onto, options.onto_convention, chosen) if options.onto else [None] * len(chosen)
    coloured = map(albedo_file, files) if getattr(options, "albedo", None) else ()
    check_apart([*taken, *(one.file for one in beneath if one)], map(writable_path, [*files, *coloured]))
    base_maps = BaseMaps(beneath, chosen, meshes, options.onto_shown)
    return Plan(meshes, chosen, files, tile_patterns(options.output, chosen), base_maps)


def albedo_file(texture: Path) -> Path:
    """Where the albedo goes that is baked beside a normal texture: NAME_albedo."""
    return texture.with_name(f"{texture.stem}_albedo{texture.suffix}")


def _named(mesh: "Mesh", name: str) -> "Mesh":
    """The mesh, as an object of that name where its file tells none."""
    from mpsnet_core.scene.mesh_labels import Labels

    return mesh if mesh.objects else replace(mesh, objects=Labels((name,), np.zeros(len(mesh.triangles), np.int32)))


def write_textures(
    plan: Plan, baked: "Iterable[tuple[TextureSet, Texture]]", options: argparse.Namespace
) -> "Iterable[tuple[Made, Texture]]":
    """Write textures one by one, as they are baked; gives each with what was made of it.

    Raises InputError where one cannot be baked or written.
    """
    from mpsnet_core.bake.detail_blending import blend_detail
    from mpsnet_core.bake.texture import write_texture
    from mpsnet_core.estimate.albedo import write_albedo

    for sheet, texture in baked:
        place = plan.sheets.index(sheet)
        beneath = plan.base_maps.beneath(sheet)
        if beneath is not None:
            texture = blend_detail(texture, beneath)
        write_texture(plan.files[place], texture, convention=options.convention, bits=options.bits)
        albedo = None
        if texture.colours is not None:
            albedo = albedo_file(plan.files[place])
            write_albedo(albedo, texture.colours[..., :3], bits=options.bits)
        seen, covered = int(texture.seen.sum()), int(texture.covered.sum())
        yield Made(plan.files[place], plan.patterns[place], sheet, seen, covered, albedo), texture
        del texture


def textures_result(made: Sequence[Made]) -> dict[str, Any]:
    """What became of the textures as plain data: each one's file, what it is of, and the share of it that was seen.

    tiles, albedo_tiles: the file's name for all tiles, with <UDIM> in it.
    """
    outputs = []
    for one in made:
        shows = {what: getattr(one.sheet, what) for what in ("tile", "material", "object")}
        known = {what: value for what, value in shows.items() if value is not None}
        if one.sheet.tile is not None:
            known["tiles"] = str(one.pattern)
        if one.albedo is not None:
            known["albedo"] = str(one.albedo)
            if one.sheet.tile is not None:
                known["albedo_tiles"] = str(albedo_file(one.pattern))
        outputs.append({"output": str(one.file), **known, "seen": round(one.seen / one.covered, 4)})
    return {"outputs": outputs, "seen": round(seen_share(made), 4)}


def seen_share(made: Sequence[Made]) -> float:
    """The share of all the textures' surface that some view saw."""
    return sum(one.seen for one in made) / sum(one.covered for one in made)


def format_textures(made: Sequence[Made], facts: str) -> str:
    """A line for each texture: where it is, what it is, how much of it was seen. facts: what is true of all."""
    lines = [
        f"{one.file}: {facts}, {one.seen / one.covered:.1%} of its surface seen"
        + (f"; albedo in {one.albedo.name}" if one.albedo is not None else "")
        for one in made
    ]
    if len(lines) > LISTED:
        lines = [lines[0], f"... {len(lines) - 2} more ...", lines[-1]]
    return "\n".join(lines)
