"""The verb evaluate: how good the models are."""

import argparse
from typing import Any

from mpsnet_core.cli.arguments import Verbs
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.errors import InputError


def add_verbs(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    parser = verbs.add_parser("evaluate", help="measure models against known normals")
    tests = parser.add_subparsers(metavar="TEST", required=True)
    diligent = tests.add_parser("diligent", parents=[common], help="the DiLiGenT photographs, multiplexed")
    diligent.add_argument("folder", help="DiLiGenT's pmsData folder; objects that are absent are named and skipped")
    diligent.add_argument("--lights", action="append", metavar="A,B,C", help="lights giving R, G, B; may be repeated")
    diligent.add_argument("--protocol", action="append", help="separated, published or white; may be repeated")
    diligent.add_argument("--model", action="append", help="may be repeated; the default model unless given")
    diligent.add_argument("--json", metavar="FILE", help="write the rows as JSON")
    diligent.add_argument("-o", "--output", metavar="REPORT", help="write an HTML report with pictures")
    diligent.set_defaults(verb=_evaluate_diligent)


def _evaluate_diligent(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.estimate.shelf import DEFAULT_MODEL
    from mpsnet_core.evaluation.diligent import PROTOCOLS, PUBLISHED_LIGHTS, evaluate_diligent
    from mpsnet_core.evaluation.report import html_figure, report_path, text_table, write_html_report
    from mpsnet_core.files import writable_path, write_json

    if options.json:
        writable_path(options.json)
    if options.output:
        report_path(options.output)
    skipped: list[str] = []
    results = evaluate_diligent(
        options.folder,
        lights=[_triple(text) for text in options.lights] if options.lights else PUBLISHED_LIGHTS,
        protocols=options.protocol or list(PROTOCOLS),
        models=options.model or [DEFAULT_MODEL],
        skipped=skipped,
        progress=reporter.progress,
    )
    # One at a time: what a result holds (photo, normals, truth) would add up to gigabytes.
    rows, figures = [], []
    for result in results:
        rows.append(result.row())
        if options.output:
            figures.append(html_figure(result))
    if options.json:
        write_json(options.json, {"rows": rows, "skipped": skipped})
    if options.output:
        write_html_report(options.output, rows, figures, skipped)
    table = "mean angular error in degrees\n" + text_table(rows)
    return {"rows": rows, "skipped": skipped, "text": "\n".join([table, *skipped])}


def _triple(text: str) -> tuple[int, int, int]:
    try:
        first, second, third = (int(number) for number in text.split(","))
    except ValueError:
        raise InputError(f"--lights {text} is not three numbers; write them like 48,1,96") from None
    return first, second, third
