"""The verb views: a photo for each camera, baked into one texture."""

import argparse
import contextlib
import logging
import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from mpsnet_core.capture.operations import files_read
from mpsnet_core.cli.arguments import (
    Help,
    Verbs,
    add_level,
    add_meshes,
    add_network,
    add_reading,
    add_texture,
    level_scale,
    parse_baking,
    parse_correction,
    parse_estimator,
)
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.cli.sheets import format_textures, planned, seen_share, textures_result, write_textures
from mpsnet_core.cli.textures import add_detail, add_preset, note_base_shares, settle

if TYPE_CHECKING:
    from mpsnet_core.bake.view_agreement import ViewAgreement
    from mpsnet_core.scene.camera import Camera
    from mpsnet_core.scene.rig import LightRig

log = logging.getLogger(__name__)

# Degrees. Estimates of one surface differ by less, whatever the network.
MOST_APART = 20.0


def add_verbs(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    parser = verbs.add_parser(
        "views", parents=[common], formatter_class=Help, help="posed photos from all around to one texture"
    )
    add_meshes(parser)
    parser.add_argument(
        "--cameras",
        required=True,
        help="from photogrammetry (COLMAP folder, Metashape .xml, Meshroom .sfm), or a folder of NAME.camera.json",
    )
    parser.add_argument(
        "--photos",
        metavar="FOLDER",
        help="the photos, one for each camera; only the add-on's file names them itself",
    )
    parser.add_argument("--rig", required=True, help="rig file (.json; .lp with three lights that go with the camera)")
    parser.add_argument(
        "--lights-in",
        default="camera",
        choices=("camera", "world"),
        help="camera: the lights go with it (or the object turns); world: they stand still, the rig file has "
        "directions along the mesh's axes, or positions in its world",
    )
    parser.add_argument(
        "--mask",
        default="mesh",
        help="mesh (where the camera sees it), a folder of masks named as the photos, or as in estimate",
    )
    add_reading(parser)
    add_level(parser, "on")
    add_detail(parser)
    add_texture(parser)
    add_preset(parser)
    parser.add_argument(
        "--keep", metavar="FOLDER", help="keep each view's normals there; the next run goes on from them"
    )
    parser.add_argument(
        "--report", metavar="FILE", help="write an HTML page: coverage, disagreement, a line for each view"
    )
    parser.add_argument("--json", metavar="FILE", help="write the same figures as JSON")
    add_network(parser)
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        help="texture file: .png, .tif or .exr; with <UDIM>, <MATERIAL> or <OBJECT> in its name one for each tile, "
        "material or object; a folder with --preset",
    )
    parser.set_defaults(verb=_views)


def _views(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core import __version__
    from mpsnet_core.bake.bake import bake_texture_sets
    from mpsnet_core.bake.feather import FEATHER
    from mpsnet_core.bake.multi_view import KeptView, KeptViews, Photography, posed_photos, sources_of
    from mpsnet_core.bake.report import texture_maps, view_table, write_bake_report
    from mpsnet_core.bake.view_agreement import agreement, table_rows
    from mpsnet_core.estimate.registry import DEFAULT_MODEL
    from mpsnet_core.io.files import (
        ensure_folder,
        files_within,
        remove_abandoned,
        writable_path,
        write_json,
        written_together,
    )
    from mpsnet_core.io.frames import check_apart
    from mpsnet_core.io.html_page import page_path
    from mpsnet_core.io.images import checked_bits
    from mpsnet_core.io.provenance import identity
    from mpsnet_core.progress import part
    from mpsnet_core.scene.joined_mesh import join_meshes
    from mpsnet_core.scene.normal_map import check_convention
    from mpsnet_core.scene.rays import RayScene
    from mpsnet_core.scene.rig import read_rig
    from mpsnet_core.scene.world_lights import read_world_lights

    # All that can be known beforehand is asked before the long work.
    settle(options)
    check_convention(options.convention)
    checked_bits(writable_path(options.output), options.bits)
    baking = parse_baking(options, FEATHER)
    level = level_scale(options.level)
    if options.report:
        page_path(options.report)
    if options.json:
        writable_path(options.json)
    outputs = [file for file in (options.output, options.report, options.json) if file]
    inputs = [Path(options.rig), *files_within(options.cameras), *files_read(options)]
    for number, file in enumerate(outputs):
        check_apart([*inputs, *outputs[:number]], [file])
    if options.lights_in == "world":
        rig_of = read_world_lights(options.rig).seen_by
    else:
        rig = read_rig(options.rig)

        def rig_of(camera: "Camera") -> "LightRig":
            return rig

    photography = Photography(rig_of, options.mask, options.encoding, options.layer, parse_correction(options))
    model = options.model or DEFAULT_MODEL
    views = posed_photos(options.cameras, options.photos)
    check_apart([view.photo for view in views], outputs)
    reporter.progress(0.0, "reading the mesh")
    plan = planned(options, [*inputs, *(view.photo for view in views), *map(Path, outputs[1:])])
    mesh = join_meshes(plan.meshes)
    others = [__version__, model, *map(identity, (model, options.dark, options.flat)), str(options.flat_smooth)]
    sources = sources_of(views, photography, mesh, others)
    scene = RayScene(mesh.world_vertices, mesh.triangles)
    estimator = parse_estimator(options)
    with contextlib.ExitStack() as stack:
        if options.keep:
            folder = ensure_folder(options.keep, "normals of the views")
            remove_abandoned(folder)
        else:
            folder = Path(stack.enter_context(tempfile.TemporaryDirectory(prefix="mpsnet-views-")))
        kept = [KeptView(folder, view.name) for view in views]
        stored = KeptViews(kept, [view.camera for view in views], mesh, scene, level, plan.base_maps.in_photos())
        agreed = agreement(mesh, scene, FEATHER)
        known = 0
        for number, (view, source) in enumerate(zip(views, sources, strict=True)):
            step = part(reporter.progress, 0.02 + 0.7 * number / len(views), 0.02 + 0.7 * (number + 1) / len(views))
            step(0.0, f"view {number + 1} of {len(views)}: {view.name}")
            if kept[number].is_of(source):
                known += 1
            else:
                told = part(step, 0.1, 0.8, f"view {number + 1} of {len(views)}: {view.name}")
                kept[number].write(estimator(photography.capture(view, scene), told), source)
            estimated, correct_low_frequencies, angle = stored.both(number)
            agreed.add(view.name, estimated, correct_low_frequencies, angle)
            del estimated, correct_low_frequencies
        note_base_shares(stored.shares)
        baked = bake_texture_sets(plan.meshes, stored, plan.sheets, baking, progress=part(reporter.progress, 0.72, 1.0))
        table = agreed.views()
        _note_doubts(table)
        how = f"levelled at {level:g} of the mesh's size" if level else "not levelled"
        summary = f"{len(views)} view(s) by {estimator.name}, {how}" + (f"; {known} kept from before" if known else "")
        made, maps = [], []
        with written_together():
            for one, texture in write_textures(plan, baked, options):
                made.append(one)
                if options.report:
                    maps += texture_maps(texture, one.sheet.named)
                del texture
            facts = f"{options.size} x {options.size}, {options.space} space, {options.convention}"
            text = format_textures(made, facts)
            figures = {
                "views": table_rows(table),
                "seen": round(seen_share(made), 4),
                "level": level,
                "model": estimator.name,
            }
            if options.report:
                write_bake_report(options.report, Path(options.output).name, maps, table, [text, summary])
            if options.json:
                write_json(options.json, figures)
    return {
        "output": options.output,
        **textures_result(made),
        **figures,
        "text": "\n".join([view_table(table), summary, text]),
    }


def _note_doubts(table: "Sequence[ViewAgreement]") -> None:
    """Tell of views that depart from the others, or from the mesh, by more than estimates do."""
    for view in table:
        if max(np.nan_to_num(view.before), view.level) > MOST_APART:
            log.warning(
                "view %s is %.0f° apart from the others and was levelled by %.0f°: do rig, camera and mesh belong "
                "together, and did the lights go with what was said?",
                view.name,
                np.nan_to_num(view.before),
                view.level,
            )
