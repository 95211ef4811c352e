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

    from mpsnet_core.bake.multi_view import CAMERA_SUFFIX, posed_photos
    from mpsnet_core.errors import InputError
    from mpsnet_core.io.files import ensure_folder, written_together
    from mpsnet_core.io.frames import check_apart
    from mpsnet_core.io.images import read_image, write_image
    from mpsnet_core.scene.camera import write_camera
    from mpsnet_core.scene.photogrammetry import undistorted, undistorted_mask

    views = posed_photos(options.cameras, options.photos)
    folder = ensure_folder(options.output, "cameras")
    check_apart([view.photo for view in views], [folder / f"{view.name}.exr" for view in views])
    straightened = 0
    for number, view in enumerate(views):
        reporter.progress(number / len(views), view.name)
        camera = folder / f"{view.name}{CAMERA_SUFFIX}"
        if view.lens is None or view.lens.is_identity:
            write_camera(camera, view.camera)
            continue
        try:
            image = read_image(view.photo, encoding=options.encoding)
            pixels = undistorted(image.pixels, view.camera, view.lens)
            shown = np.ones(image.pixels.shape[:2], bool) if image.alpha is None else image.alpha > 0.5
            alpha = undistorted_mask(shown, view.camera, view.lens)
        except InputError as error:
            raise InputError(f"{view.photo}: {error}") from None
        stored = np.concatenate([pixels, alpha[..., None]], axis=-1)
        with written_together():
            write_camera(camera, view.camera)
            write_image(folder / f"{view.name}.exr", stored, bits=16, color_space="lin_rec709_scene")
        straightened += 1
    reporter.progress(1.0, "done")
    told = f", {straightened} photo(s) without their lens" if straightened else ", whose lenses bend nothing"
    return {
        "folder": str(folder),
        "cameras": [f"{view.name}{CAMERA_SUFFIX}" for view in views],
        "photos": straightened,
        "text": f"{folder}: {len(views)} camera(s){told}",
    }
