"""The verb mask: where the object is, shown before it is used."""

import argparse
from pathlib import Path
from typing import Any

from mpsnet_core.cli.arguments import Help, Verbs, add_reading, parse_correction, read_files
from mpsnet_core.cli.reporter import Reporter
from mpsnet_core.errors import InputError


def add_verbs(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    parser = verbs.add_parser(
        "mask", parents=[common], formatter_class=Help, help="find the object in a photo, and show it"
    )
    parser.add_argument("image", help="photo")
    parser.add_argument(
        "--mask",
        default="auto",
        help="auto: before a dark or plain background; background:FILE, a photo of the scene without the object; "
        "threshold:0.05, alpha, or a mask file to look at; alpha-or-all is what `estimate` does unless told",
    )
    add_reading(parser)
    parser.add_argument("--overlay", metavar="FILE", help="also write the photo with the mask drawn over it")
    parser.add_argument("-o", "--output", required=True, help="mask file, white on the object: .png, .tif or .exr")
    parser.set_defaults(verb=_mask)


def _mask(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    from mpsnet_core.capture.correction import corrected
    from mpsnet_core.capture.masks import find_mask
    from mpsnet_core.io.files import writable_path, written_together
    from mpsnet_core.io.frames import check_apart
    from mpsnet_core.io.images import checked_bits, read_image, write_image
    from mpsnet_core.scene.pictures import mask_picture

    outputs = [options.output, *([options.overlay] if options.overlay else [])]
    for number, output in enumerate(outputs):
        checked_bits(writable_path(output))
        check_apart([options.image, *read_files(options), *outputs[:number]], [output])
    reporter.progress(0.0, f"reading {Path(options.image).name}")
    image = read_image(options.image, encoding=options.encoding, layer=options.layer)
    correction = parse_correction(options)
    reporter.progress(0.4, "looking for the object")
    try:
        if correction is not None:
            image = corrected(image, correction)
        choice = None if options.mask == "alpha-or-all" else options.mask
        mask = find_mask(image, choice, encoding=options.encoding, layer=options.layer, correction=correction)
    except InputError as error:
        raise InputError(f"{options.image}: {error}") from None
    if mask.shape != image.pixels.shape[:2]:
        sizes = [f"{array.shape[1]} x {array.shape[0]}" for array in (mask, image.pixels)]
        raise InputError(f"{options.mask} is {sizes[0]} but {options.image} is {sizes[1]}; they must be the same size")
    reporter.progress(0.8, f"writing {Path(options.output).name}")
    with written_together():
        write_image(options.output, mask, bits=None if Path(options.output).suffix.lower() == ".exr" else 8)
        if options.overlay:
            write_image(options.overlay, mask_picture(image.pixels, mask), color_space="sRGB")
    reporter.progress(1.0, "done")
    share = float(mask.mean())
    return {
        "output": options.output,
        "overlay": options.overlay,
        "share": round(share, 4),
        "text": f"{options.output}: the object covers {share:.1%} of the photo",
    }
