"""Verbs that take photos: estimate, superpose; and models."""

import argparse
import json
from pathlib import Path
from typing import TYPE_CHECKING, Any

from mpsnet_core.cli.arguments import (
    Help,
    Verbs,
    add_network,
    add_reading,
    add_viewpoint,
    parse_correction,
    parse_estimator,
    parse_viewpoint,
    read_files,
    slant_and_tilt,
)
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.errors import InputError

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray


def add_verbs(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    _add_estimate(
        verbs.add_parser("estimate", parents=[common], formatter_class=Help, help="photo to camera-space normal map")
    )
    superpose = verbs.add_parser("superpose", parents=[common], help="photos that show one light each become one photo")
    _add_superpose(superpose)
    models = verbs.add_parser("models", parents=[common], help="list the models that can be asked for by name")
    models.add_argument("model", nargs="?", help="name or .onnx file of a network, to read its card")
    models.set_defaults(verb=_models)


# --- estimate ---------------------------------------------------------------------------------------------------------


def _add_estimate(parser: argparse.ArgumentParser) -> None:
    parser.add_argument(
        "image", nargs="+", help="photo(s), a folder of them, a pattern (frame_####.png, *.tif), or a video"
    )
    parser.add_argument("--rig", required=True, help="rig file (.json, or .lp with three lights)")
    parser.add_argument(
        "--mask",
        help="mask file, alpha, none, auto, alpha-or-auto (auto where the photo has no alpha), background:FILE (the "
        "scene without the object) or threshold:0.05, for frames also a folder or pattern of masks by their numbers; "
        "without it alpha, where the photo has it, else the whole photo; `mpsnet mask` shows what comes of it",
    )
    add_network(parser)
    parser.add_argument(
        "--passes",
        type=int,
        choices=(1, 3),
        help="of the network: 3 averages the answers on the scene turned and mirrored. Unless given, the default model "
        "takes 3 for one photo and 1 for each of several or of a video",
    )
    add_viewpoint(parser)
    add_reading(parser)
    parser.add_argument(
        "--white",
        action="append",
        metavar="PHOTO",
        help="second photo, of the same pose under white light, which tells the colour of the surface; repeated, the "
        "photos are added up: one for each of the lights, turned white (one still photo only)",
    )
    parser.add_argument(
        "--albedo", metavar="FILE", help="also write the surface's colour without light and shadow; with --white"
    )
    parser.add_argument(
        "--white-light",
        metavar="rig|SLANT,TILT",
        help="what lit the white photo, for --albedo: the rig's three lights turned white (rig, unless given), or one "
        "light in this direction in degrees",
    )
    parser.add_argument("--convention", default="opengl", help="opengl (green up) or directx (green down)")
    parser.add_argument("--confidence", metavar="FILE", help="also write the confidence map (one photo only)")
    parser.add_argument("--format", default="png", help="png, tif or exr, where the output is a folder")
    parser.add_argument(
        "--smooth", type=int, default=0, metavar="N", help="frames before and behind that each is averaged with"
    )
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        help="image file, or a folder where there are several; frames that it holds already are not made again",
    )
    parser.set_defaults(verb=_estimate)


def _estimate(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.capture.capture import read_capture
    from mpsnet_core.estimate.albedo import albedo_from_white, write_albedo
    from mpsnet_core.estimate.sequence.video import is_video
    from mpsnet_core.io.files import ensure_folder, writable_path, written_together
    from mpsnet_core.io.frames import check_apart, expand_images, is_several, output_files
    from mpsnet_core.io.images import checked_bits, write_image
    from mpsnet_core.progress import part
    from mpsnet_core.scene.normal_map import check_convention, write_normals
    from mpsnet_core.scene.rig import read_rig

    check_convention(options.convention)
    if options.albedo and not options.white:
        raise InputError("--albedo is made from a photo under white light; give it with --white")
    if options.white_light and not options.albedo:
        raise InputError("--white-light tells what lit the photo that --albedo is made from; give both, or neither")
    white_light = _white_light(options.white_light or "rig")
    rig = read_rig(options.rig)
    photos = expand_images(options.image)
    # A folder or a pattern is a sequence, be there one frame in it so far; but only one photo's confidence is written.
    sequence = any(map(is_several, options.image)) and not options.confidence
    if sequence or len(photos) > 1 or is_video(photos[0]):
        from mpsnet_core.cli.sequence import estimate_frames

        return estimate_frames(options, photos, rig, reporter)
    if options.smooth:
        raise InputError("--smooth takes the frames of a sequence, and there is one photo; leave it out")
    [photo], [output] = photos, output_files(photos, options.output, f".{options.format.lstrip('.')}")
    inputs = [photo, options.rig, *read_files(options)]
    check_apart(inputs, [output])
    outputs = [output]
    for other in filter(None, (options.confidence, options.albedo)):
        checked_bits(writable_path(other))
        check_apart([*inputs, *outputs], [other])
        outputs.append(Path(other))
    correction, (camera, depth) = parse_correction(options), parse_viewpoint(options)
    estimator = parse_estimator(options, passes=options.passes)
    reporter.progress(0.0, f"reading {photo.name}")
    capture = read_capture(
        photo,
        rig,
        mask=options.mask,
        encoding=options.encoding,
        layer=options.layer,
        camera=camera,
        depth=depth,
        correction=correction,
        white=options.white,
    )
    normals = estimator(capture, part(reporter.progress, 0.1, 0.9))
    reporter.progress(0.9, f"writing {output.name}")
    ensure_folder(output.parent, "normals")
    with written_together():
        write_normals(output, normals, convention=options.convention)
        if options.confidence:
            write_image(options.confidence, normals.confidence)
        if options.albedo:
            write_albedo(options.albedo, albedo_from_white(capture, normals, white_light), capture.mask)
    reporter.progress(1.0, "done")
    return {
        "outputs": [str(output)],
        "pixels": int(normals.mask.sum()),
        **({"albedo": options.albedo} if options.albedo else {}),
        "text": f"{output}: normals by {estimator.name}" + (f"\n{options.albedo}: albedo" if options.albedo else ""),
    }


def _white_light(given: str) -> "NDArray[np.float64] | None":
    """(3,) the direction of the white photo's one light, None where it was the rig's lights."""
    from mpsnet_core.scene.rig import direction_from_angles

    return None if given == "rig" else direction_from_angles(*slant_and_tilt("--white-light", given))


# --- superpose --------------------------------------------------------------------------------------------------------


def _add_superpose(parser: argparse.ArgumentParser) -> None:
    parser.add_argument("image", nargs="+", help="photos of a thing that did not move, one for each light")
    parser.add_argument("--encoding", default="auto", help="auto, linear or srgb: how the photos' values are meant")
    parser.add_argument(
        "--channels",
        action="store_true",
        help="of three photos, each under one white light in the rig's order, make the red, green and blue channel",
    )
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        help="the photo under all lights: .exr, or a float .tif; with --channels also .png (sRGB, 16 bits)",
    )
    parser.set_defaults(verb=_superpose)


def _superpose(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    import numpy as np

    from mpsnet_core.capture.superpose import as_channels, superpose
    from mpsnet_core.io.frames import check_apart
    from mpsnet_core.io.image import linear_to_srgb
    from mpsnet_core.io.images import checked_bits, write_image

    check_apart(options.image, [options.output])
    is_png = options.channels and Path(options.output).suffix.lower() == ".png"
    # A sum of light can be above 1, which only float files hold.
    bits = checked_bits(Path(options.output), None if is_png else 32)
    reporter.progress(0.0, "putting the photos together")
    if options.channels:
        pixels, alpha = as_channels(options.image, encoding=options.encoding)
    else:
        pixels, alpha = superpose(options.image, encoding=options.encoding)
    if is_png:
        pixels = linear_to_srgb(pixels / max(1.0, float(pixels.max())))
    planes = [pixels] if alpha is None else [pixels, alpha[..., None]]
    space = "sRGB" if is_png else "lin_rec709_scene"
    write_image(options.output, np.concatenate(planes, axis=-1), bits=bits, color_space=space)
    reporter.progress(1.0, "done")
    done = "a channel each" if options.channels else "added up"
    return {"output": options.output, "text": f"{options.output}: {len(options.image)} photo(s), {done}"}


# --- models -----------------------------------------------------------------------------------------------------------


def _models(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.estimate.registry import registered_models

    if options.model:
        return _card(options.model)
    entries = registered_models()
    width = max(len(entry.name) for entry in entries)
    lists: dict[bool, list[str]] = {False: [], True: ["", "to compare with, and for scripts:"]}
    for entry in entries:
        lists[entry.comparison].append(f"{entry.name.ljust(width)}  {entry.title}")
    told = [{"name": entry.name, "title": entry.title, "comparison": entry.comparison} for entry in entries]
    return {"models": told, "text": "\n".join(lists[False] + lists[True])}


def _card(model: str) -> dict[str, Any]:
    from mpsnet_core.estimate.onnx_model import OnnxModel
    from mpsnet_core.estimate.registry import find_network

    network = OnnxModel(find_network(model).path, threads=1)
    told = {"card": json.loads(network.card.to_json()), "training": network.record}
    return {**told, "text": json.dumps(told, indent=2)}
