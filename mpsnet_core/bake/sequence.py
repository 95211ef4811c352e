"""Sequences: a texture for each frame; those that exist already, of the same files and settings, are kept."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from mpsnet_core.bake.bake import bake_texture_sets
from mpsnet_core.bake.detail_blending import blend_detail
from mpsnet_core.bake.inputs import BakeInputs, ViewReader
from mpsnet_core.bake.settings import Baking
from mpsnet_core.bake.texture import write_texture
from mpsnet_core.bake.texture_files import TextureTarget
from mpsnet_core.bake.texture_sets import texture_sets
from mpsnet_core.errors import InputError
from mpsnet_core.io.provenance import is_up_to_date, provenance_line
from mpsnet_core.progress import Progress, part
from mpsnet_core.scene.mesh import read_mesh


@dataclass(frozen=True)
class Outcome:
    """What became of a sequence.

    made, there: how many textures were made now, and before. seen: the share of the surface that some view saw, mean
    over those made now, None where none was. filled: likewise the share that was filled, None unless it was to be.
    """

    made: int
    there: int
    seen: float | None
    filled: float | None


def bake_sequence(
    frames: Mapping[Path, BakeInputs],
    reader: ViewReader,
    baking: Baking,
    target: TextureTarget,
    *,
    recipe: str,
    progress: Progress,
) -> Outcome:
    """Bake the textures of frames, each with one mesh, and write them.

    frames: by their textures' files, in their order. reader: with one present map at most, which goes beneath each
    texture. recipe: text that changes with every setting that makes other textures.

    Raises InputError where a frame cannot be read or baked; those before it are written.
    """
    base_map = reader.base_maps[0] if reader.base_maps else None
    mesh_of = lru_cache(maxsize=1)(read_mesh)
    # A share of the present map's relief that was found anew for each frame would flicker: all have the first one's.
    first, shares = next(iter(frames.values())), None
    made, seen, filled = 0, 0.0, 0.0
    for number, (output, inputs) in enumerate(frames.items()):
        ends = number / len(frames), (number + 1) / len(frames)
        step = part(progress, *ends, f"{output.name}, {len(frames)} in all")
        step(0.0, "")
        sources = [inputs, first] if base_map is not None and base_map.shown == "auto" else [inputs]
        line = provenance_line("texture", recipe, *(fact for source in sources for fact in source.facts()))
        if is_up_to_date(output, line):
            continue
        mesh = mesh_of(inputs.meshes[0])
        try:
            if base_map is not None and shares is None and inputs is not first:
                _, shares = reader.read(first.views, [read_mesh(first.meshes[0])], part(step, 0.0, 0.0))
            views, shares = reader.read(inputs.views, [mesh], part(step, 0.0, 0.1), shares)
            baked = bake_texture_sets([mesh], views, texture_sets([mesh]), baking, progress=part(step, 0.1, 1.0))
            ((_, texture),) = baked
            if base_map is not None:
                texture = blend_detail(texture, base_map.vectors)
        except InputError as error:
            if not made:
                raise
            done = f"{made} texture{'s were' if made > 1 else ' was'} made"
            raise type(error)(f"{error}; {done}; run the same command again to continue") from None
        write_texture(output, texture, convention=target.convention, bits=target.bits, description=line)
        made += 1
        seen += texture.seen_fraction
        filled += texture.filled_fraction or 0.0
    progress(1.0, "done")
    of_frames = [round(share / made, 4) if made else None for share in (seen, filled)]
    return Outcome(made, len(frames) - made, of_frames[0], of_frames[1] if baking.fill else None)
