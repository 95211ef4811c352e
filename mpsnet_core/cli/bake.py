"""The verb bake: normal maps to a texture on a mesh's UVs, or a sequence of them to a sequence of textures."""

import argparse
import logging
from collections.abc import Iterator, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpsnet_core.cli.arguments import Help, Verbs, add_level, add_meshes, add_texture, level_scale, parse_baking
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.cli.sheets import format_textures, planned, textures_result, write_textures
from mpsnet_core.cli.textures import add_detail, add_preset, note_base_shares, parse_base_map, settle
from mpsnet_core.errors import InputError
from mpsnet_core.progress import Progress, part

if TYPE_CHECKING:
    from mpsnet_core.bake.bake import View
    from mpsnet_core.bake.base_detail_removal import BaseMap
    from mpsnet_core.bake.settings import Baking
    from mpsnet_core.bake.texture import Texture
    from mpsnet_core.bake.texture_sets import TextureSet
    from mpsnet_core.scene.mesh import Mesh

log = logging.getLogger(__name__)

# Options that change nothing in the texels, or stand for files that count by what they are at the time.
NOT_IN_RECIPE = ("albedo", "confidence", "mesh", "onto", "output", "preset", "progress", "verb", "view")


def add_verbs(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    parser = verbs.add_parser(
        "bake", parents=[common], formatter_class=Help, help="normal maps to a texture on a mesh's UVs"
    )
    add_meshes(parser)
    parser.add_argument(
        "--view",
        required=True,
        action="append",
        metavar="CAMERA=NORMALS",
        help="camera file and its normal map; normals/frame_####.png for a sequence",
    )
    add_texture(parser)
    add_preset(parser)
    parser.add_argument("--normals-convention", default="opengl", help="of the normal maps that are read")
    parser.add_argument(
        "--confidence", action="append", metavar="FILE", help="confidence map of a view, in the views' order"
    )
    parser.add_argument(
        "--albedo",
        action="append",
        metavar="FILE",
        help="albedo of a view (of estimate --albedo), in the views' order: baked as well, to TEXTURE_albedo",
    )
    add_level(parser, None)
    add_detail(parser)
    parser.add_argument("--format", help="png (unless given), tif or exr, where the output is a folder")
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        help="texture file: .png, .tif or .exr; with <UDIM>, <MATERIAL> or <OBJECT> in its name one for each tile, "
        "material or object; a folder for a sequence, or with --preset",
    )
    parser.set_defaults(verb=_bake)


@dataclass(frozen=True)
class _Job:
    """Normal maps to bake. views: camera file and normal map each. confidences, albedos: of each view, or None.
    onto: the present map."""

    output: Path
    meshes: tuple[Path, ...]
    views: tuple[tuple[Path, Path], ...]
    confidences: tuple[str | None, ...]
    albedos: tuple[str | None, ...]
    onto: str | None

    @property
    def files(self) -> list[Path]:
        others = map(Path, filter(None, (*self.confidences, *self.albedos, self.onto)))
        return [*self.meshes, *(file for view in self.views for file in view), *others]


def _bake(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.io.files import writable_path, written_together
    from mpsnet_core.io.frames import is_several
    from mpsnet_core.io.images import checked_bits
    from mpsnet_core.scene.normal_map import check_convention

    views = []
    for view in options.view:
        camera, equals, normals = view.partition("=")
        if not (camera and equals and normals):
            raise InputError(f"--view {view} is not CAMERA=NORMALS; give a camera file, an equals sign, a normal map")
        views.append((camera, normals))
    sequence = any(is_several(normals) for _, normals in views)
    settle(options, sequence=sequence)
    check_convention(options.convention)
    check_convention(options.normals_convention)
    level_scale(options.level)
    confidences = options.confidence or [None] * len(views)
    if len(confidences) != len(views):
        raise InputError(f"there are {len(views)} views but {len(confidences)} confidence maps; give one for each view")
    albedos = options.albedo or [None] * len(views)
    if len(albedos) != len(views):
        raise InputError(f"there are {len(views)} views but {len(albedos)} albedos; give one for each view, or none")
    _parse_baking(options)
    if sequence:
        return _bake_frames(options, views, reporter)
    checked_bits(writable_path(options.output), options.bits)
    job = _Job(
        Path(options.output),
        tuple(map(Path, options.mesh)),
        tuple((Path(camera), Path(normals)) for camera, normals in views),
        tuple(confidences),
        tuple(albedos),
        options.onto,
    )
    reporter.progress(0.0, "reading the mesh")
    plan = planned(options, job.files)
    seen, _ = _views(job, plan.meshes, plan.base_maps.in_photos(), options, part(reporter.progress, 0.05, 0.15))
    baked = _baked(seen, plan.meshes, plan.sheets, options, part(reporter.progress, 0.15, 1.0))
    with written_together():
        made = [one for one, _ in write_textures(plan, baked, options)]
    return {"output": options.output, **textures_result(made), "text": format_textures(made, _facts(options))}


def _views(
    job: _Job,
    meshes: "Sequence[Mesh]",
    base_maps: "Sequence[BaseMap]",
    options: argparse.Namespace,
    progress: Progress,
    known: Sequence[Sequence[float]] | None = None,
) -> "tuple[list[View], list[Sequence[float]]]":
    """The views as they are baked, and for each the shares of the present maps' relief that were taken out of it.

    known: these shares, where they have been found before.
    """
    from mpsnet_core.bake.bake import View
    from mpsnet_core.bake.base_detail_removal import remove_base_details
    from mpsnet_core.bake.low_frequency_correction import correct_low_frequencies
    from mpsnet_core.estimate.albedo import read_albedo
    from mpsnet_core.scene.camera import read_camera
    from mpsnet_core.scene.joined_mesh import join_meshes
    from mpsnet_core.scene.normal_map import read_normals
    from mpsnet_core.scene.rays import RayScene

    level = level_scale(options.level)
    whole = join_meshes(meshes)
    scene = RayScene(whole.world_vertices, whole.triangles) if level or base_maps else None
    views, shares = list[View](), list[Sequence[float]]()
    given = zip(job.views, job.confidences, job.albedos, strict=True)
    for number, ((camera, normals), confidence, albedo) in enumerate(given):
        progress(number / len(job.views), f"reading {normals.name}")
        try:
            normal_map = read_normals(normals, convention=options.normals_convention, confidence=confidence)
            view = View(read_camera(camera), normal_map, None if albedo is None else read_albedo(albedo))
            if base_maps and scene is not None:
                before = None if known is None else known[number]
                normal_map, found = remove_base_details(view.normals, view.camera, whole, scene, base_maps, before)
                view = replace(view, normals=normal_map)
                shares.append(found)
            if level and scene is not None:
                view = replace(
                    view, normals=correct_low_frequencies(view.normals, view.camera, whole, scene, scale=level)
                )
            views.append(view)
        except InputError as error:
            raise InputError(f"view {camera}={normals}: {error}") from None
    if known is None:
        note_base_shares(shares)
    return views, shares


def _baked(
    views: "Sequence[View]",
    meshes: "Sequence[Mesh]",
    sheets: "Sequence[TextureSet]",
    options: argparse.Namespace,
    progress: Progress,
) -> "Iterator[tuple[TextureSet, Texture]]":
    from mpsnet_core.bake.bake import bake_texture_sets

    return bake_texture_sets(meshes, views, sheets, _parse_baking(options), progress=progress)


def _parse_baking(options: argparse.Namespace) -> "Baking":
    from mpsnet_core.bake.feather import FEATHER

    # Views that are levelled are meant to leave no seam.
    return parse_baking(options, FEATHER if level_scale(options.level) else 0.0)


def _facts(options: argparse.Namespace) -> str:
    return f"{options.size} x {options.size}, {options.space} space, {options.convention}"


# --- sequences --------------------------------------------------------------------------------------------------------


def _bake_frames(options: argparse.Namespace, views: Sequence[tuple[str, str]], reporter: Reporter) -> dict[str, Any]:
    """A texture for each frame. What is there already, made of the same files and settings, is not made again."""
    from mpsnet_core.bake.detail_blending import blend_detail
    from mpsnet_core.bake.texture import write_texture
    from mpsnet_core.bake.texture_names import split_by
    from mpsnet_core.bake.texture_sets import sheets
    from mpsnet_core.io.files import ensure_folder, remove_abandoned
    from mpsnet_core.io.frames import check_apart, results_folder
    from mpsnet_core.io.provenance import is_up_to_date
    from mpsnet_core.scene.mesh import read_mesh

    if len(options.mesh) > 1 or split_by(options.output):
        raise InputError(
            "a sequence is baked onto one mesh and into one texture a frame; give one --mesh, and leave <UDIM>, "
            "<MATERIAL> and <OBJECT> out of --output"
        )
    if options.confidence:
        raise InputError("--confidence takes one normal map a view; leave it out for a sequence")
    if options.albedo:
        raise InputError("--albedo is of one still photo a view; leave it out for a sequence")
    jobs = _jobs(options, views)
    check_apart({file for job in jobs.values() for file in job.files}, [job.output for job in jobs.values()])
    folder = results_folder(options.output, "a sequence is baked", "textures")
    remove_abandoned(ensure_folder(folder, "textures"))
    present = parse_base_map(options)
    base_maps = [] if present is None else [present]
    made, seen, mesh, mesh_file = 0, 0.0, None, None
    # A share that was found anew for each frame would flicker: all have that of the first one.
    first_job, shares = next(iter(jobs.values())), None
    for number, job in enumerate(jobs.values()):
        step = part(
            reporter.progress, number / len(jobs), (number + 1) / len(jobs), f"{job.output.name}, {len(jobs)} in all"
        )
        step(0.0, "")
        line = _line(job, first_job, options)
        if is_up_to_date(job.output, line):
            continue
        if mesh is None or job.meshes[0] != mesh_file:
            mesh, mesh_file = read_mesh(job.meshes[0]), job.meshes[0]
        try:
            if present is not None and shares is None and job is not first_job:
                _, shares = _views(
                    first_job, [read_mesh(first_job.meshes[0])], base_maps, options, part(step, 0.0, 0.0)
                )
            frame, shares = _views(job, [mesh], base_maps, options, part(step, 0.0, 0.1), shares)
            ((_, texture),) = _baked(frame, [mesh], sheets([mesh]), options, part(step, 0.1, 1.0))
            if present is not None:
                texture = blend_detail(texture, present.vectors)
        except InputError as error:
            if not made:
                raise
            done = f"{made} texture{'s were' if made > 1 else ' was'} made"
            raise InputError(f"{error}; {done}, and the same command goes on from there") from None
        write_texture(job.output, texture, convention=options.convention, bits=options.bits, description=line)
        made += 1
        seen += texture.seen_fraction
    reporter.progress(1.0, "done")
    numbers = sorted(jobs)
    first = jobs[numbers[0]].output
    told = f"{made} made" + (f", {len(jobs) - made} there already" if made < len(jobs) else "")
    return {
        "folder": options.output,
        "first_output": str(first),
        "first": numbers[0],
        "last": numbers[-1],
        "count": len(jobs),
        "made": made,
        "there": len(jobs) - made,
        "seen": round(seen / made, 4) if made else None,
        "text": f"{first.parent}: textures of {len(jobs)} frames, {told}",
    }


def _jobs(options: argparse.Namespace, views: Sequence[tuple[str, str]]) -> dict[int, _Job]:
    """The textures of a sequence by the numbers of its frames; what has no number is the same for all frames."""
    from mpsnet_core.io.images import checked_bits

    meshes = _by_number(options.mesh[0], "mesh")
    pairs = [(_by_number(camera, "camera"), _by_number(normals, "normal map")) for camera, normals in views]
    numbered = [files for pair in pairs for files in pair if isinstance(files, dict)]
    numbers = sorted(set.intersection(*map(set, numbered)))
    if isinstance(meshes, dict):
        numbers = [number for number in numbers if number in meshes]
    if not numbers:
        raise InputError("no number is common to the frames of all views and meshes; check the patterns")
    left_out = max(map(len, numbered)) - len(numbers)
    if left_out:
        log.warning("%d frame(s) are left out: not every view or mesh has their number", left_out)
    target, digits = Path(options.output), max(4, len(str(numbers[-1])))
    checked_bits(Path(f"texture.{options.format.lstrip('.')}"), options.bits)
    return {
        number: _Job(
            target / f"{target.name}_{number:0{digits}d}.{options.format.lstrip('.')}",
            (_file_of(meshes, number),),
            tuple((_file_of(cameras, number), _file_of(normals, number)) for cameras, normals in pairs),
            (None,) * len(pairs),
            (None,) * len(pairs),
            options.onto,
        )
        for number in numbers
    }


def _by_number(given: str, what: str) -> Path | dict[int, Path]:
    """A file, or the files of a folder or a pattern by the numbers in their names."""
    from mpsnet_core.io.frames import is_several, matching_files, numbering

    if not is_several(given):
        return Path(given)
    files = matching_files(given, what)
    numbered = numbering(files)
    if numbered is None:
        raise InputError(f"the {what}s of {given} are no sequence: their names must differ in one number alone")
    return dict(zip(numbered.numbers, files, strict=True))


def _file_of(files: Path | dict[int, Path], number: int) -> Path:
    return files[number] if isinstance(files, dict) else files


def _line(job: _Job, first: _Job, options: argparse.Namespace) -> str:
    """The line that a texture keeps: what made it of what. first: the frame that tells what is shown of --onto."""
    from mpsnet_core.io.provenance import content, identity, provenance_line

    facts = [f"{name}: {value!r}" for name, value in sorted(vars(options).items()) if name not in NOT_IN_RECIPE]
    # Meshes and cameras by what they hold: Blender writes them anew for every run.
    for one in (job, first) if options.onto and options.onto_shown == "auto" else (job,):
        facts += map(content, [*one.meshes, *(camera for camera, _ in one.views)])
        facts += map(identity, [*(normals for _, normals in one.views), one.onto])
    return provenance_line("texture", "\n".join(facts))
