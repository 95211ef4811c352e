"""Texture files: where and how they are written, the meshes of each, and a record of what was written."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np

from mpsnet_core.arrays.rasterize import extend_to_nearest
from mpsnet_core.bake.base_maps import BaseMaps, base_map_files, blend_detail, check_blending
from mpsnet_core.bake.operations import Bake, BakesDetail, BakeViews, WrittenTexture
from mpsnet_core.bake.presets import PRESETS, preset_output
from mpsnet_core.bake.settings import BakeSettings
from mpsnet_core.defaults import MARGIN, Convention
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.estimate.albedo import write_albedo
from mpsnet_core.io import files as disk
from mpsnet_core.io.image_writing import write_mask
from mpsnet_core.scene.mesh import Labels, Mesh
from mpsnet_core.scene.texture import Texture, write_texture
from mpsnet_core.scene.texture_names import albedo_file, split_by, texture_files, tile_patterns
from mpsnet_core.scene.texture_sets import TextureSet, texture_sets

# Value of filled texels in the image of the coverage; seen ones are 1, all others 0.
FILLED = 0.5
# Up to this many textures are listed one by one; of more, the first and the last.
LISTED = 12


@dataclass(frozen=True)
class TextureTarget:
    """Where and how textures are written."""

    output: str
    """A file name, with the tokens of :mod:`mpsnet_core.scene.texture_names` if there are several; the folder of a
    sequence."""
    convention: Convention
    """Which way the green channel points."""
    bits: int | None
    """Bits per channel; None for the suffix's default."""
    suffix: str
    """Suffix of a sequence's files."""

    def frame(self, number: int, digits: int) -> Path:
        """The file of a frame of a sequence."""
        folder = Path(self.output)
        return folder / f"{folder.name}_{number:0{digits}d}{self.suffix}"


def texture_target(options: Bake | BakeViews, *, sequence: bool = False) -> TextureTarget:
    """The target of textures, completed from the preset if there is one.

    With a preset, an output folder becomes the preset's file in it. sequence: the output is a folder of frames, whose
    names are fixed.

    Raises InputError if the options do not fit one another or the output's suffix, the output cannot be written, or
    several meshes share a texture and the output is a folder: no preset has a file name for it.
    """
    if options.onto:
        check_blending(options.space)
    elif options.onto_convention != "opengl" or options.onto_shown != "auto":
        raise SettingsError("--onto-convention and --onto-shown describe the map of --onto; give that, too")
    ending, output = getattr(options, "format", None), options.output
    suffix = disk.file_suffix(ending) if ending else None
    if options.preset is None:
        if suffix and not sequence:
            disk.check_ending(Path(output), suffix)
        target = TextureTarget(output, options.convention or "opengl", options.bits, suffix or ".png")
    else:
        wanted = PRESETS[options.preset]
        if not sequence:
            output = _preset_file(options, suffix)
        # The preset's bits apply to its own format alone.
        bits = wanted.bits if options.bits is None and suffix in (None, wanted.suffix) else options.bits
        target = TextureTarget(output, options.convention or wanted.convention, bits, suffix or wanted.suffix)
    if not sequence:
        disk.writable_image(target.output, target.bits)
    return target


def _preset_file(options: Bake | BakeViews, suffix: str | None) -> str:
    wanted, output = PRESETS[options.preset or ""], options.output
    folder = output.endswith(("/", "\\"))
    if len(options.mesh) > 1 and (folder or Path(output).is_dir()):
        raise SettingsError(
            f"a preset names a texture after its mesh, and {len(options.mesh)} share this one; give its file "
            f"with --output, such as {output.rstrip('/')}/{wanted.stem('name')}{wanted.suffix}"
        )
    target = preset_output(wanted, output, Path(options.mesh[0]).stem, suffix)
    if folder:
        disk.ensure_folder(target.parent, "texture")
    return str(target)


def bake_settings(options: BakesDetail, feather: float) -> BakeSettings:
    """How the textures are baked.

    Raises SettingsError if an option is out of range, or a margin is given that the padding does not use.
    """
    if options.margin is not None and options.padding in ("push-pull", "none"):
        raise SettingsError(f"--margin goes with --padding nearest, not with {options.padding}; leave it out")
    margin, size = MARGIN if options.margin is None else options.margin, options.texture_size()
    how = options.samples, feather, options.strength, options.fill
    return BakeSettings(size, options.space, margin, options.padding, *how)


@dataclass(frozen=True)
class BakePlan:
    """Textures to bake for meshes."""

    target: TextureTarget
    """Where and how they are written."""
    meshes: Sequence[Mesh]
    """The meshes."""
    texture_sets: Sequence[TextureSet]
    """Each texture's texture set."""
    files: Sequence[Path]
    """Each texture's file."""
    albedos: Sequence[Path]
    """Files of the views' colours, if they have any."""
    patterns: Sequence[Path]
    """The files with <UDIM> in place of the tile number."""
    base_maps: BaseMaps
    """The maps that the detail is added to."""
    coverage: Path | None
    """Folder for coverage maps; None for none."""


def planned(options: Bake | BakeViews, target: TextureTarget, protected_paths: Sequence[Path]) -> BakePlan:
    """Read the meshes, and plan the textures of the target.

    protected_paths: files that no texture may overwrite.

    Raises InputError if a mesh cannot be read, no texture has a base map, or a texture cannot be written.
    """
    by = split_by(target.output)
    meshes = [options.read_mesh(file) for file in options.mesh]
    if "object" in by:
        meshes = [_named(mesh, Path(file).stem) for mesh, file in zip(meshes, options.mesh, strict=True)]
    if "material" in by and not any(mesh.materials for mesh in meshes):
        raise SettingsError(f"{' and '.join(options.mesh)}: there are no materials; leave <MATERIAL> out of --output")
    chosen = texture_sets(meshes, tiles="tile" in by, materials="material" in by, objects="object" in by)
    files = texture_files(target.output, chosen)
    onto, coloured = options.onto, options.albedo if isinstance(options, Bake) else options.white
    base_files = base_map_files(onto, options.onto_convention, chosen) if onto else [None] * len(chosen)
    albedos = texture_files(albedo_file(Path(target.output)), chosen)
    folder = disk.ensure_folder(options.coverage, "coverage") if options.coverage else None
    seen = [folder / file.name for file in files] if folder else ()
    written = map(disk.writable_path, [*files, *(albedos if coloured else ()), *seen])
    disk.check_no_overwrite([*protected_paths, *(present.file for present in base_files if present)], written)
    disk.check_no_overwrite(files, seen)
    base_maps = BaseMaps(base_files, chosen, meshes, options.onto_shown)
    return BakePlan(target, meshes, chosen, files, albedos, tile_patterns(target.output, chosen), base_maps, folder)


def _named(mesh: Mesh, name: str) -> Mesh:
    """The mesh, as an object of that name if its file has no objects."""
    return mesh if mesh.objects else replace(mesh, objects=Labels((name,), np.zeros(len(mesh.triangles), np.int32)))


def write_textures(
    plan: BakePlan, baked: Iterable[tuple[TextureSet, Texture]]
) -> Iterator[tuple[TextureSet, WrittenTexture, Texture]]:
    """Write textures one by one, as they are baked. Yields each texture's set, the record of it, and the texture.

    Raises InputError if one cannot be baked or written.
    """
    target = plan.target
    for texture_set, texture in baked:
        place = plan.texture_sets.index(texture_set)
        file, tiled, pattern = plan.files[place], texture_set.tile is not None, plan.patterns[place]
        base_map = plan.base_maps.vectors_for(texture_set)
        if base_map is not None:
            texture = blend_detail(texture, base_map)
        write_texture(file, texture, convention=target.convention, bits=target.bits)
        albedo = None
        if texture.colours is not None:
            albedo = plan.albedos[place]
            write_albedo(albedo, texture.colours[..., :3], bits=target.bits)
        coverage = plan.coverage / file.name if plan.coverage else None
        if coverage is not None:
            write_coverage(coverage, texture)
        share = texture.filled_fraction
        filled, texels = None if share is None else round(share, 4), int(texture.covered.sum())
        parts = texture_set.tile, texture_set.material, texture_set.object
        of_all = pattern, albedo and albedo_file(pattern), coverage and coverage.with_name(pattern.name)
        paths = (albedo, coverage, *(of_all if tiled else (None,) * 3))
        names = [str(one) if one else None for one in paths]
        written = WrittenTexture(str(file), round(texture.seen_fraction, 4), filled, texels, *parts, *names)
        yield texture_set, written, texture
        del texture


def write_coverage(path: Path, texture: Texture) -> None:
    """Write a texture's coverage, dilated by one texel beyond the islands. Raises FileError."""
    seen = texture.seen.astype(np.float32)
    if texture.filled is not None:
        seen[texture.filled] = FILLED
    around = extend_to_nearest(seen[..., None], texture.covered, 1)[..., 0]
    write_mask(path, around)


def checked_shares(options: BakesDetail, written: Sequence[WrittenTexture]) -> tuple[float, float | None]:
    """The fractions of all textures' surface that some view saw and that were filled, None without filling.

    Raises GeometryError if too little was seen.
    """
    texels = sum(texture.texels for texture in written)
    seen = round(sum(texture.seen * texture.texels for texture in written) / texels, 4)
    filled = [texture.filled * texture.texels for texture in written if texture.filled is not None]
    if seen < options.least_seen:
        raise GeometryError(
            f"the views see only {seen:.0%} of the surface, less than {options.least_seen:.0%} (--least-seen): "
            "nothing is written; was the object or a camera moved, or its mesh or mask changed? [less-seen]"
        )
    return seen, round(sum(filled) / texels, 4) if filled else None


def format_textures(options: BakesDetail, target: TextureTarget, written: Sequence[WrittenTexture]) -> str:
    """A line for each texture: its file, its properties and what was seen of it."""
    width, height = options.texture_size()
    facts = f"{width} x {height}, {options.space} space, {target.convention}"
    lines = [
        f"{texture.output}: {facts}, {texture.seen:.1%} of its surface seen"
        + (f", {texture.filled:.1%} filled" if texture.filled is not None else "")
        + (f"; albedo in {Path(texture.albedo).name}" if texture.albedo is not None else "")
        for texture in written
    ]
    if len(lines) > LISTED:
        lines = [lines[0], f"... {len(lines) - 2} more ...", lines[-1]]
    return "\n".join(lines)
