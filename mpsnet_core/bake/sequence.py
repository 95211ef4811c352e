"""Sequences: a texture for each frame. Existing textures of the same files and settings are kept."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path

from mpsnet_core.bake.bake import bake_texture_sets
from mpsnet_core.bake.base_maps import blend_detail
from mpsnet_core.bake.inputs import BakeInputs, ViewReader
from mpsnet_core.bake.settings import BakeSettings
from mpsnet_core.bake.texture_files import TextureTarget
from mpsnet_core.batch import Batch
from mpsnet_core.io.files import check_own
from mpsnet_core.io.provenance import is_up_to_date, provenance_line
from mpsnet_core.progress import Progress, part
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.texture import write_texture
from mpsnet_core.scene.texture_sets import texture_sets


@dataclass(frozen=True)
class Outcome:
    """The result of a sequence."""

    made: int
    """Number of textures made now."""
    existing: int
    """Number of textures that existed already."""
    seen: float | None
    """Mean fraction of the surface that some view saw in the textures made now; None if none was made."""
    filled: float | None
    """Mean fraction that was filled; None without filling."""
    failed: dict[Path, str]
    """Why frames failed, by their textures, although the others were made."""


def bake_sequence(
    frames: Mapping[Path, BakeInputs],
    reader: ViewReader,
    baking: BakeSettings,
    target: TextureTarget,
    *,
    read_mesh: Callable[[Path], Mesh],
    settings_fingerprint: str,
    progress: Progress,
) -> Outcome:
    """Bake and write the textures of frames, each with one mesh.

    frames: inputs by texture file, in order. reader: has at most one base map, which applies to every frame.
    settings_fingerprint: of all settings that change the textures.

    Raises InputError if a texture cannot be written, or the first few frames cannot be read or baked.
    """
    base_map = reader.base_maps[0] if reader.base_maps else None
    mesh_of = lru_cache(maxsize=1)(read_mesh)
    # A share of the base map's relief estimated per frame would flicker: the first frame's applies to all.
    first, shares = next(iter(frames.values())), None
    made, seen, filled, batch = 0, 0.0, 0.0, Batch[Path]()
    for number, (output, inputs) in enumerate(frames.items()):
        ends = number / len(frames), (number + 1) / len(frames)
        step = part(progress, *ends, f"{output.name}, {len(frames)} in all")
        step(0.0, "")
        sources = [inputs, first] if base_map is not None and base_map.shown == "auto" else [inputs]
        line = provenance_line(
            "texture", settings_fingerprint, *(fact for source in sources for fact in source.facts())
        )
        if is_up_to_date(output, line):
            batch.succeeded += 1
            continue
        check_own(output)
        texture = None
        with batch.one(output):
            mesh = mesh_of(inputs.meshes[0])
            if base_map is not None and shares is None and inputs is not first:
                _, shares = reader.read(first.views, [read_mesh(first.meshes[0])], part(step, 0.0, 0.0))
            views, shares = reader.read(inputs.views, [mesh], part(step, 0.0, 0.1), shares)
            baked = bake_texture_sets([mesh], views, texture_sets([mesh]), baking, progress=part(step, 0.1, 1.0))
            ((_, texture),) = baked
            if base_map is not None:
                texture = blend_detail(texture, base_map.vectors)
        if texture is None:
            continue
        write_texture(output, texture, convention=target.convention, bits=target.bits, description=line)
        made += 1
        seen += texture.seen_fraction
        filled += texture.filled_fraction or 0.0
    batch.check_any()
    progress(1.0, "done")
    of_frames = [round(share / made, 4) if made else None for share in (seen, filled)]
    existing = len(frames) - made - len(batch.errors)
    return Outcome(made, existing, of_frames[0], of_frames[1] if baking.fill else None, batch.failed())
