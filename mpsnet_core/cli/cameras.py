"""The verb cameras: what photogrammetry found, as camera files of ours, and photos without their lens."""

import argparse
from typing import Any

from mpsnet_core.cli.arguments import Help, Verbs
from mpsnet_core.cli.reporter import Reporter


def add_verbs(verbs: Verbs, common: argparse.ArgumentParser) -> None:
    parser = verbs.add_parser(
        "cameras",
        parents=[common],
        formatter_class=Help,
        help="cameras of photogrammetry as camera files, and photos without their lens's distortion",
    )
    parser.add_argument("cameras", help="a COLMAP folder, Metashape's .xml or Meshroom's .sfm")
    parser.add_argument("--photos", required=True, metavar="FOLDER", help="the photos, one for each camera")
    parser.add_argument("--encoding", default="auto", help="auto, linear or srgb: how the photos' values are meant")
    parser.add_argument(
        "-o",
        "--output",
        required=True,
        metavar="FOLDER",
        help="folder for NAME.camera.json, and where a lens bends the picture NAME.exr without that",
    )
    parser.set_defaults(verb=_cameras)


def _cameras(options: argparse.Namespace, reporter: Reporter) -> dict[str, Any]:
    import numpy as np

    from mpsnet_core.camera import write_camera
    from mpsnet_core.errors import InputError
    from mpsnet_core.files import made_folder
    from mpsnet_core.frames import check_apart
    from mpsnet_core.images import read_image, write_image
    from mpsnet_core.photogrammetry import undistorted, undistorted_mask
    from mpsnet_core.views import CAMERA_SUFFIX, posed_photos

    views = posed_photos(options.cameras, options.photos)
    folder = made_folder(options.output, "cameras")
    check_apart([view.photo for view in views], [folder / f"{view.name}.exr" for view in views])
    straightened = 0
    for number, view in enumerate(views):
        reporter.progress(number / len(views), view.name)
        if view.lens is not None and not view.lens.is_identity:
            try:
                image = read_image(view.photo, encoding=options.encoding)
                pixels = undistorted(image.pixels, view.camera, view.lens)
                shown = np.ones(image.pixels.shape[:2], bool) if image.alpha is None else image.alpha > 0.5
                alpha = undistorted_mask(shown, view.camera, view.lens)
            except InputError as error:
                raise InputError(f"{view.photo}: {error}") from None
            stored = np.concatenate([pixels, alpha[..., None]], axis=-1)
            write_image(folder / f"{view.name}.exr", stored, bits=16, color_space="lin_rec709_scene")
            straightened += 1
        write_camera(folder / f"{view.name}{CAMERA_SUFFIX}", view.camera)  # last: no camera goes without its photo
    reporter.progress(1.0, "done")
    told = f", {straightened} photo(s) without their lens" if straightened else ", whose lenses bend nothing"
    return {
        "folder": str(folder),
        "cameras": [f"{view.name}{CAMERA_SUFFIX}" for view in views],
        "photos": straightened,
        "text": f"{folder}: {len(views)} camera(s){told}",
    }
