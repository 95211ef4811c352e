"""Verbs that make and show training samples: synthesize, make, work, show."""

import argparse
from pathlib import Path
from typing import Any

from mpsnet_core.cli.arguments import Help, Verbs
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.errors import InputError
from mpsnet_core.io.files import resolved

# So many of the files that `show` skips are named; all are counted.
NAMED = 10


def add_verbs(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    _add_synthesize(
        verbs.add_parser("synthesize", parents=[common], formatter_class=Help, help="training samples without Blender")
    )
    make = verbs.add_parser(
        "make", parents=[common], formatter_class=Help, help="go on with a folder's training samples"
    )
    make.add_argument("folder", help="folder that a job of samples was begun in")
    make.add_argument(
        "--blender", default="", metavar="PROGRAM", help="Blender that renders; this Python's bpy without"
    )
    make.add_argument("--addon", default="", metavar="MODULE", help="the extension in it, unless always enabled there")
    _add_workers(make)
    make.set_defaults(verb=_make)
    _add_show(verbs.add_parser("show", parents=[common], formatter_class=Help, help="samples or photos as a picture"))
    work = verbs.add_parser("work", parents=[common])  # without help it is not listed: only the farm calls it
    work.add_argument("folder")
    work.set_defaults(verb=_work)


def _add_workers(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--processes", type=int, default=0, help="on this machine, 0 for as many as it has cores")
    parser.add_argument("--cluster", default="", metavar="ADDRESS", help="of a Dask scheduler, whose workers do it")
    parser.add_argument(
        "--cluster-trusted",
        action="store_true",
        help="the address needs no tls://: whoever is in the network may run code",
    )


# --- synthesize, make, work -------------------------------------------------------------------------------------------


def _add_synthesize(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("--count", type=int, required=True, help="how many samples the folder shall hold")
    parser.add_argument("--seed", type=int, default=0, help="what everything is drawn from")
    parser.add_argument("--size", type=int, default=256, help="side of a sample in pixels")
    parser.add_argument(
        "--shapes",
        metavar="KIND,...",
        help="of blobs, drapery, reliefs, composites, groups, meshes; meshes where --meshes is given, else all others",
    )
    parser.add_argument("--meshes", default="", metavar="FOLDER", help="mesh files to take shapes from")
    parser.add_argument(
        "--merl", default="", metavar="PATH", help="measured materials: a folder of MERL .binary files, or .npz of fits"
    )
    parser.add_argument(
        "--merl-part",
        default="all",
        metavar="PART",
        help="all, or training (four in five of the measured materials) or validation (the fifth that was left out)",
    )
    parser.add_argument("--views", type=int, default=1, help="samples in a row that show the same shape")
    parser.add_argument("--bounces", type=int, default=1, help="of light between surfaces: 0 to 3")
    parser.add_argument("--supersampling", type=int, default=1, help="rays along a pixel's side")
    _add_workers(parser)
    parser.add_argument("-o", "--output", required=True, metavar="FOLDER", help="new, or begun by the same command")
    parser.set_defaults(verb=_synthesize)


def _synthesize(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.synthesis.job import SampleJob
    from mpsnet_core.synthesis.reflectance import material_names
    from mpsnet_core.synthesis.shapes import mesh_files

    if options.shapes is not None:
        shapes = tuple(name.strip() for name in options.shapes.split(",") if name.strip())
    else:
        shapes = ("meshes",) if options.meshes else SampleJob.shapes
    job = SampleJob(
        renderer="synthesis",
        count=options.count,
        seed=options.seed,
        size=options.size,
        shapes=shapes,
        # Workers may stand elsewhere.
        meshes=str(resolved(options.meshes)) if options.meshes else "",
        merl=str(resolved(options.merl)) if options.merl else "",
        merl_part=options.merl_part,
        views=options.views,
        bounces=options.bounces,
        supersampling=options.supersampling,
    )
    # What is missing is told before anything is begun.
    if job.meshes:
        mesh_files(job.meshes)
    if job.merl:
        material_names(job.merl)
    return _farmed(options.output, job, options, reporter)


def _make(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.synthesis.job import read_job

    job = read_job(options.folder)
    if options.blender and job.renderer != "cycles":
        raise InputError(f"the samples of {options.folder} are made without Blender; leave --blender out")
    return _farmed(options.folder, job, options, reporter)


def _farmed(folder: str, job: Any, options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.synthesis.farm.run import SYNTHESIS_COMMAND, blender_command, make_samples
    from mpsnet_core.synthesis.job import CONTACT_SHEET

    command = SYNTHESIS_COMMAND if job.renderer == "synthesis" else blender_command(options.blender, options.addon)
    harvest = make_samples(
        folder,
        job,
        command,
        processes=options.processes,
        cluster=options.cluster,
        cluster_trusted=options.cluster_trusted,
        progress=reporter.progress,
    )
    facts = f"{harvest.made} made, {harvest.there} there already"
    if harvest.failed:
        number, sentence = min(harvest.failed.items())
        count = len(harvest.failed)
        raise InputError(f"{folder}: {count} of {job.count} samples failed, {facts}; sample {number}: {sentence}")
    return {
        "output": folder,
        "made": harvest.made,
        "there": harvest.there,
        "contact_sheet": str(Path(folder) / CONTACT_SHEET),
        "text": f"{folder}: {facts}",
    }


def _work(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.synthesis.farm.work import serve
    from mpsnet_core.synthesis.make import make_sample

    serve(options.folder, make_sample)
    return {}


# --- show -------------------------------------------------------------------------------------------------------------


def _add_show(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("path", nargs="+", help="a sample, a folder of samples, or a photo")
    parser.add_argument("--count", type=int, default=8, help="how many of a folder's samples, evenly spread")
    parser.add_argument("-o", "--output", help="picture: .png or .tif; unless given beside what it shows")
    parser.set_defaults(verb=_show)


def _show(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.io.files import writable_path
    from mpsnet_core.io.frames import check_apart
    from mpsnet_core.io.images import checked_bits
    from mpsnet_core.progress import part
    from mpsnet_core.synthesis.contact_sheet import folder_samples, is_sample, show, summarise, write_sheet
    from mpsnet_core.synthesis.job import CONTACT_SHEET

    if options.count < 1:
        raise InputError(f"--count {options.count} shows nothing; choose 1 or more")
    paths = [Path(path) for path in options.path]
    first = paths[0]
    beside = first / CONTACT_SHEET if first.is_dir() else first.with_name(f"{first.stem}_sheet.png")
    output = writable_path(options.output or beside)
    checked_bits(output, 8)
    check_apart(paths, [output])
    reporter.progress(0.0, "reading")
    samples: list[Path] = []
    photos: list[Path] = []
    for path in paths:
        if path.is_dir():
            samples += folder_samples(path)
        else:
            (samples if is_sample(path) else photos).append(path)
    summary = summarise(samples, part(reporter.progress, 0.0, 0.8))
    if len(paths) == 1 and summary.skipped and not summary.count:
        raise InputError(summary.skipped[0])
    write_sheet(output, show(samples, photos, options.count))
    reporter.progress(1.0, "done")
    skipped = [f"skipped {len(summary.skipped)} file(s)", *summary.skipped[:NAMED]] if summary.skipped else []
    told = [str(summary)] if samples else []
    return {
        "output": str(output),
        "samples": summary.count,
        "renderers": summary.renderers,
        "mean_shares": summary.mean_shares,
        "samples_with": summary.samples_with,
        "skipped": summary.skipped,
        "text": "\n".join([*told, *skipped, str(output)]),
    }
