"""The work of ``bake``: the textures of normal maps, of one pose or of each frame of a sequence."""

from functools import lru_cache
from pathlib import Path

from mpsnet_core.bake import texture_files
from mpsnet_core.bake.bake import bake_texture_sets
from mpsnet_core.bake.base_maps import blend_detail, one_base_map
from mpsnet_core.bake.inputs import BakeInputs, ViewInputs, ViewReader, frame_inputs
from mpsnet_core.bake.operations import Bake, FramesBaked, TexturesBaked
from mpsnet_core.bake.projection import FEATHER
from mpsnet_core.bake.settings import BakeSettings
from mpsnet_core.bake.texture_files import TextureTarget
from mpsnet_core.bake.view_agreement import matched_views
from mpsnet_core.errors import Batch, SettingsError
from mpsnet_core.io import files as disk
from mpsnet_core.io.frames import is_folder_or_pattern, results_folder
from mpsnet_core.io.provenance import is_up_to_date, operation_facts, provenance_line
from mpsnet_core.progress import Progress, part
from mpsnet_core.scene.texture import write_texture
from mpsnet_core.scene.texture_names import split_by
from mpsnet_core.scene.texture_sets import texture_sets


def bake_maps(options: Bake, progress: Progress) -> TexturesBaked | FramesBaked:
    """Write the textures of one pose, or a texture for each frame of a sequence."""
    views = list(map(_camera_and_normals, options.view))
    sequence = any(is_folder_or_pattern(normals) for _, normals in views)
    # Levelled views agree in their low frequencies: feathering leaves no seam.
    baking = texture_files.bake_settings(options, FEATHER if options.level_scale() and not options.agreed else 0.0)
    for what, files, none in (("confidence maps", options.confidence, ""), ("albedos", options.albedo, ", or none")):
        if files and len(files) != len(views):
            raise SettingsError(f"there are {len(views)} views but {len(files)} {what}; give one a view{none}")
    target = texture_files.texture_target(options, sequence=sequence)
    return (_bake_frames if sequence else _bake_pose)(options, views, target, baking, progress)


def _camera_and_normals(view: str) -> tuple[str, str]:
    # File names may contain equals signs: split at the one that follows the name of an existing camera file.
    words = view.split("=")
    starts = ["=".join(words[:count]) for count in range(1, len(words))]
    camera = next(filter(disk.is_file, starts), words[0])
    normals = view[len(camera) + 1 :]
    if not (camera and normals):
        raise SettingsError(f"--view {view} is not CAMERA=NORMALS; give a camera file, =, a normal map")
    return camera, normals


def _bake_pose(
    options: Bake, views: list[tuple[str, str]], target: TextureTarget, baking: BakeSettings, progress: Progress
) -> TexturesBaked:
    maps = [tuple(map(Path, files)) or (None,) * len(views) for files in (options.confidence, options.albedo)]
    inputs = [
        ViewInputs(Path(camera), Path(normals), confidence, albedo)
        for (camera, normals), confidence, albedo in zip(views, *maps, strict=True)
    ]
    progress(0.0, "reading the mesh")
    files = BakeInputs(tuple(map(Path, options.mesh)), tuple(inputs)).files
    plan = texture_files.planned(options, target, [*files, *_onto_files(options)])
    maps_in_photos = plan.base_maps.in_photos()
    reader = ViewReader(options.level_scale(), maps_in_photos, options.normals_convention, options.agreed)
    seen, _ = reader.read(inputs, plan.meshes, part(progress, 0.05, 0.15))
    if options.albedo and len(seen) > 1:
        seen = matched_views(seen, plan.meshes, baking.feather)
    baked = bake_texture_sets(plan.meshes, seen, plan.texture_sets, baking, progress=part(progress, 0.15, 1.0))
    with disk.write_transaction():
        written = [one for _, one, _ in texture_files.write_textures(plan, baked)]
        shares = texture_files.checked_shares(options, written)
    return TexturesBaked(target.output, written, *shares, text=texture_files.format_textures(options, target, written))


def _onto_files(options: Bake) -> list[Path]:
    return [Path(options.onto)] if options.onto else []


def _bake_frames(
    options: Bake, views: list[tuple[str, str]], target: TextureTarget, baking: BakeSettings, progress: Progress
) -> FramesBaked:
    """Bake and write a texture for each frame. Existing textures of the same files and settings are kept.

    Raises InputError if a texture cannot be written, or the first few frames cannot be read or baked.
    """
    frames = _frames(options, views, target)
    read = {file for _, inputs in frames.values() for file in inputs.files}
    disk.check_no_overwrite(read.union(_onto_files(options)), [file for file, _ in frames.values()])
    folder = results_folder(target.output, "a sequence is baked", "textures")
    disk.remove_abandoned(disk.ensure_folder(folder, "textures"))
    level, batch = options.level_scale(), Batch[Path]()
    base_map = one_base_map(options.onto, options.onto_convention, options.onto_shown) if options.onto else None
    reader = ViewReader(level, [base_map] if base_map else [], options.normals_convention, options.agreed)
    how = f"{level}{' where they agree' if options.agreed else ''}"
    settings = operation_facts(options, convention=target.convention, bits=str(target.bits), level=how)
    mesh_of = lru_cache(maxsize=1)(options.read_mesh)
    # A share of the base map's relief estimated per frame would flicker: the first frame's applies to all.
    first, shares = next(iter(frames.values()))[1], None
    seen, filled = list[float](), list[float]()
    for number, (output, inputs) in enumerate(frames.values()):
        step = part(progress, number / len(frames), (number + 1) / len(frames), f"{output.name}, {len(frames)} in all")
        step(0.0, "")
        sources = [inputs, first] if base_map is not None and base_map.shown == "auto" else [inputs]
        line = provenance_line("texture", settings, *(fact for source in sources for fact in source.facts()))
        if is_up_to_date(output, line):
            batch.succeeded += 1
            continue
        disk.check_own(output)
        texture = None
        with batch.one(output):
            mesh = mesh_of(inputs.meshes[0])
            if base_map is not None and shares is None and inputs is not first:
                _, shares = reader.read(first.views, [options.read_mesh(first.meshes[0])], part(step, 0.0, 0.0))
            seen_by, shares = reader.read(inputs.views, [mesh], part(step, 0.0, 0.1), shares)
            baked = bake_texture_sets([mesh], seen_by, texture_sets([mesh]), baking, progress=part(step, 0.1, 1.0))
            ((_, texture),) = baked
            if base_map is not None:
                texture = blend_detail(texture, base_map.vectors)
        if texture is None:
            continue
        write_texture(output, texture, convention=target.convention, bits=target.bits, description=line)
        seen.append(texture.seen_fraction)
        filled.append(texture.filled_fraction or 0.0)
    batch.check_any()
    progress(1.0, "done")
    failed, made = batch.failed(), len(seen)
    existing = len(frames) - made - len(failed)
    textures = {number: str(file) for number, (file, _) in frames.items() if file not in failed}
    means = [round(sum(shares) / made, 4) if made else None for shares in (seen, filled)]
    counts = [f"{made} made", f"{existing} there already" * bool(existing), f"{len(failed)} failed" * bool(failed)]
    return FramesBaked(
        target.output,
        textures[min(textures)],
        *(min(textures), max(textures), len(textures), made, existing, means[0]),
        means[1] if baking.fill else None,
        text=f"{output.parent}: textures of {len(frames)} frames, {', '.join(filter(None, counts))}",
        failed=[*failed.values()] or None,
    )


def _frames(options: Bake, views: list[tuple[str, str]], target: TextureTarget) -> dict[int, tuple[Path, BakeInputs]]:
    """Each frame's texture file and inputs, by number."""
    if len(options.mesh) > 1 or split_by(target.output):
        raise SettingsError(
            "a sequence is baked onto one mesh and into one texture per frame; give one --mesh, and leave "
            "<UDIM>, <MATERIAL> and <OBJECT> out of --output"
        )
    for name in ("confidence", "albedo", "coverage", "least_seen"):
        if getattr(options, name):
            raise SettingsError(f"--{name.replace('_', '-')} is for a single pose; leave it out for a sequence")
    inputs = frame_inputs(options.mesh[0], views)
    disk.checked_bits(Path(f"texture{target.suffix}"), target.bits)
    digits = max(4, len(str(max(inputs))))
    return {number: (target.frame(number, digits), inputs[number]) for number in sorted(inputs)}
