"""The commands superpose, mask and check: from their options to files."""

from dataclasses import replace
from pathlib import Path

from mpsnet_core.capture.open import Source
from mpsnet_core.capture.operations import Check, FindMask, MaskFound, PhotoChecked, PhotoMade, Superpose
from mpsnet_core.capture.photo_check import check_photo, worst
from mpsnet_core.capture.superpose import added_up, read_shots, stacked
from mpsnet_core.errors import SettingsError
from mpsnet_core.io.files import (
    check_no_overwrite,
    checked_bits,
    prefix_errors,
    writable_image,
    writable_path,
    write_json,
    write_transaction,
)
from mpsnet_core.io.frames import expand_images, in_order_of_lights
from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.io.image_writing import write_mask, write_photo, write_picture_bands
from mpsnet_core.progress import Progress
from mpsnet_core.scene.pictures import mask_bands
from mpsnet_core.scene.rig import has_mixing, read_rig


def superpose_photos(options: Superpose, progress: Progress) -> PhotoMade:
    """Write the photo, and the one under white light if requested."""
    files = expand_images(options.image)
    if options.channels:
        files = in_order_of_lights(files)
    if options.white and not options.channels:
        raise SettingsError("--white goes with --channels; the photo of coloured lights shows no colours of its own")
    check_no_overwrite(files, [options.output, *([options.white] if options.white else [])])
    is_png = options.channels and Path(options.output).suffix.lower() == ".png"
    # A sum of lights can be above 1, which only float files hold.
    bits = checked_bits(Path(options.output), None if is_png else 32)
    progress(0.0, "combining the photos")
    shots = read_shots(files, options.encoding, grey=options.channels)
    photo = stacked(shots) if options.channels else added_up(shots)
    if is_png:
        encoded = linear_to_srgb(photo.pixels / max(1.0, float(photo.pixels.max())))
        photo = replace(photo, pixels=encoded)
    with write_transaction():
        write_photo(options.output, photo, bits=bits, linear=not is_png)
        if options.white:
            write_photo(options.white, added_up(shots), bits=checked_bits(Path(options.white), 32), linear=True)
    progress(1.0, "done")
    if not options.channels:
        return PhotoMade(options.output, text=f"{options.output}: {len(files)} photo(s), added up")
    red, green, blue = (file.name for file in files)
    return PhotoMade(options.output, text=f"{options.output}: red is {red}, green {green}, blue {blue}")


def find_mask(options: FindMask, progress: Progress) -> MaskFound:
    """Write the mask, and the overlay if requested."""
    outputs = [options.output, *([options.overlay] if options.overlay else [])]
    for output in outputs:
        writable_image(output)
    check_no_overwrite(options.inputs(options.image, mask=options.mask), outputs)
    progress(0.0, f"reading {Path(options.image).name}")
    image, mask, _ = options.photo_and_mask(Source(Path(options.image), None, options.mask), progress)
    progress(0.8, f"writing {Path(options.output).name}")
    with write_transaction():
        write_mask(options.output, mask)
        if options.overlay:
            height, width = mask.shape
            write_picture_bands(options.overlay, (height, width, 3), mask_bands(image.pixels, mask))
    progress(1.0, "done")
    share = float(mask.mean())
    text = f"{options.output}: the object covers {share:.1%} of the photo"
    return MaskFound(options.output, options.overlay, round(share, 4), text=text)


def check(options: Check, progress: Progress) -> PhotoChecked:
    """Check the photo, and write the findings if requested."""
    if options.json:
        writable_path(options.json)
        check_no_overwrite(options.inputs(options.image, options.rig, mask=options.mask), [options.json])
    rig = read_rig(options.rig) if options.rig else None
    progress(0.0, f"reading {Path(options.image).name}")
    image, mask, evidence = options.photo_and_mask(Source(Path(options.image), rig, options.mask), progress)
    progress(0.6, "checking the photo")
    with prefix_errors(options.image):
        findings = check_photo(image, mask, rig, evidence, mixing_stated=not options.rig or has_mixing(options.rig))
    lines = [f"{one.level:5}  {one.item:8}  {one.sentence}" for one in findings]
    result = PhotoChecked(worst(findings), findings, text="\n".join(lines))
    if options.json:
        write_json(options.json, result.metrics("level", "findings"))
    progress(1.0, "done")
    return result
