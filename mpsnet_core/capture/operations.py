"""Operations of captures: superpose photos, find masks, check photos."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from functools import cache, partial
from pathlib import Path
from pkgutil import resolve_name
from typing import TYPE_CHECKING, Any, ClassVar

from mpsnet_core.defaults import MASK, MAX_FOCAL, MIN_FOCAL
from mpsnet_core.errors import NOTE_LEVELS, GeometryError, Note, SettingsError
from mpsnet_core.operation import Operation, Result, option, optional, output_option
from mpsnet_core.progress import Progress, silent
from mpsnet_core.scene.operations import ReadsPictures, TakesMesh

if TYPE_CHECKING:
    from mpsnet_core.arrays.types import Bools
    from mpsnet_core.capture.decode import PhotoReadOptions
    from mpsnet_core.capture.open import Source
    from mpsnet_core.capture.photo_check import Finding
    from mpsnet_core.io.image import Image
    from mpsnet_core.scene.camera import Camera


@dataclass(frozen=True)
class ReadsPhotos(ReadsPictures):
    """How photos are read: their encoding and layer, dark frame and flat field."""

    heading: ClassVar[str] = "how photos are read"

    layer: str | None = optional("layer of a multi-layer EXR")
    dark: str | None = optional(
        "photo with the three lights off, to subtract; several (a folder or pattern) are averaged",
        path="file",
        provenance="files",
    )
    flat: str | None = optional(
        "photo of an even white card in the object's place, to correct vignetting and uneven light; "
        "several (a folder or pattern) are averaged; not for near lights",
        path="file",
        provenance="files",
    )
    flat_smooth: int = option(
        default=0, metavar="PIXELS", help="smooth out the card's grain where it is finer than this many pixels"
    )

    def inputs(self, *given: str | None, mask: str | None = None) -> list[Path]:
        """The files that are read, which no result may overwrite: those given, dark frame, flat field and a mask's."""
        from mpsnet_core.capture.masks import mask_source
        from mpsnet_core.io.frames import expand_file_options

        return expand_file_options((*given, self.dark, self.flat, mask and mask_source(mask)))

    def read_options(self) -> "PhotoReadOptions":
        """How photos are read, with dark frame and flat field if given.

        Raises SettingsError if there is no flat field to smooth, and the errors of `read_correction`.
        """
        from mpsnet_core.capture.decode import PhotoReadOptions, read_correction

        if self.flat_smooth and self.flat is None:
            raise SettingsError("--flat-smooth smooths the flat field; give --flat, or leave it out")
        correction = None
        if self.dark is not None or self.flat is not None:
            correction = read_correction(
                self.dark, self.flat, encoding=self.encoding, layer=self.layer, smooth=self.flat_smooth
            )
        return PhotoReadOptions(self.encoding, self.layer, correction)

    def photo_and_mask(self, source: "Source", progress: Progress) -> "tuple[Image, Bools, float | None]":
        """A corrected photo, the object's mask (H, W), and the evidence against the usual encoding if it states none.

        Raises InputError if a file cannot be read, no object is found, or the mask has another size.
        """
        from mpsnet_core.capture.open import PhotoSet

        photos = PhotoSet([source], self.read_options())
        progress(0.1, "looking for the object")
        masked = photos.masked(source)
        if not masked.mask.any():
            raise GeometryError(f"{source}: the mask is empty; choose another mask or threshold")
        return masked.image, masked.mask, photos.encoding_evidence


@dataclass(frozen=True)
class TakesLightPhotos(ReadsPhotos):
    """Photos under three coloured lights, or three photos under one white light each."""

    per_light: bool = option(
        default=False,
        help="each photo shows one white light: three photos of an object that did not move, in the order red, green, "
        "blue, as `superpose --channels` takes them",
    )
    mask: str = option(default=MASK, help="where the object is, as in `estimate`")
    json: str | None = output_option("write the results as JSON")
    output: str = option(help="rig file to write: .json", path="file", provenance="none")

    def photos(self, given: Sequence[str], *inputs: str) -> list[Path]:
        """The photos' files, after checking that the results can be written and overwrite no input."""
        from mpsnet_core.io.files import check_no_overwrite, writable_path
        from mpsnet_core.io.frames import expand_images

        files = expand_images(given)
        outputs = [writable_path(path) for path in (self.output, self.json) if path]
        check_no_overwrite([*files, *self.inputs(*inputs, mask=self.mask)], outputs)
        return files

    def sources(self, files: Sequence[Path], mask: str) -> "list[Source]":
        """The photos, or the one photo whose channels they are.

        Raises SettingsError if something cannot go with photos of one light each.
        """
        from mpsnet_core.capture.open import Source
        from mpsnet_core.capture.superpose import as_channels
        from mpsnet_core.io.frames import in_order_of_lights

        if not self.per_light:
            return [Source(file, None, mask) for file in files]
        if self.dark or self.flat or self.layer:
            raise SettingsError("--per-light takes the photos as they are; leave --dark, --flat and --layer out")
        lit = in_order_of_lights(files)
        return [Source(cache(partial(as_channels, lit, encoding=self.encoding)), None, mask, name=str(lit[0]))]


@dataclass(frozen=True)
class HasLens(Operation):
    """The camera or lens of a photo."""

    heading: ClassVar[str] = "the photo's camera"

    camera: str | None = optional(
        "camera file, for perspective and for near lights; without it or a focal length, the camera is "
        "assumed far away",
        provenance="content",
    )
    focal: float | None = optional(
        "35 mm equivalent focal length of the real camera, in millimetres", metavar="MM", low=MIN_FOCAL, high=MAX_FOCAL
    )

    def lens(self) -> "Camera | float | None":
        """Camera or focal length, None if neither is given.

        Raises SettingsError if both are set, and the errors of :func:`mpsnet_core.scene.camera.read_camera`.
        """
        from mpsnet_core.scene.camera import read_camera

        if self.camera and self.focal is not None:
            raise SettingsError("--camera and --focal both define the lens; give one of them")
        return read_camera(self.camera) if self.camera else self.focal


@dataclass(frozen=True)
class HasViewpoint(TakesMesh, HasLens):
    """The viewpoint of a photo: camera or lens, and the distance of the object."""

    heading: ClassVar[str] = "the photo's camera"

    mesh: str | None = optional(
        "the object's mesh in the camera's world, for the distance of each pixel from near lights", provenance="content"
    )
    distance: float | None = optional(
        "distance from the camera to the object, in the unit of a rig file with near lights"
    )

    def source(self, photo: str | Path, rig: str | None, mask: str = MASK) -> "Source":
        """A photo with its rig file, and what the options say of its viewpoint.

        Raises SettingsError if both of a pair are set, or a mesh without a camera; InputError if a file cannot be read,
        or the camera does not see the mesh.
        """
        from mpsnet_core.capture.open import Source
        from mpsnet_core.io.files import prefix_errors
        from mpsnet_core.scene.camera import Camera
        from mpsnet_core.scene.rays import RayScene, depth_of_mesh
        from mpsnet_core.scene.rig import read_rig

        if self.mesh and self.distance is not None:
            raise SettingsError("--mesh and --distance both define how far the object is; give one of them")
        lens = self.lens()
        source = Source(Path(photo), read_rig(rig) if rig else None, mask, camera=lens, depth=self.distance)
        if not self.mesh:
            return source
        if not isinstance(lens, Camera):
            raise SettingsError("--mesh needs --camera, which states where the mesh was seen from; give it")
        mesh = self.read_mesh(self.mesh, shape_only=True)
        with prefix_errors(f"camera {self.camera}"):
            return replace(source, depth=depth_of_mesh(lens, RayScene.of(mesh)))


@dataclass(frozen=True)
class PhotoMade(Result):
    """The combined photo."""

    output: str
    """File of the photo."""


@dataclass(frozen=True)
class Superpose(ReadsPictures):
    """Combine photos of one light each into one photo."""

    command: ClassVar[str] = "superpose"

    image: tuple[str, ...] = option(positional=True, help="photos of an object that did not move, one for each light")
    channels: bool = option(
        default=False,
        help="make the red, green and blue channels from three photos, each under one white light, in the "
        "rig's order; photos of a folder or pattern are sorted by number",
    )
    white: str | None = option(
        default=None,
        metavar="FILE",
        help="with --channels, also write the photos' sum, which shows the colours: the --white photo of estimate",
    )
    output: str = option(help="the photo under all lights: .exr or float .tif; with --channels also .png (sRGB)")

    def run(self, progress: Progress = silent) -> PhotoMade:
        """Write the photo, and the one under white light if requested."""
        return resolve_name("mpsnet_core.capture.commands:superpose_photos")(self, progress)


@dataclass(frozen=True)
class MaskFound(Result):
    """The mask of a photo."""

    output: str
    """File of the mask."""
    overlay: str | None
    """File of the photo with the mask drawn over it, if requested."""
    share: float
    """Share of the photo that the mask covers."""


@dataclass(frozen=True)
class FindMask(ReadsPhotos):
    """Find the object in a photo, and show it."""

    command: ClassVar[str] = "mask"

    image: str = option(positional=True, help="photo")
    mask: str = option(
        default=MASK,
        help="how to find the object: alpha, auto (in front of a dark or plain background), alpha-or-auto "
        "(alpha, else what stands out clearly, else the whole photo), background:FILE (a photo without the "
        "object), threshold:0.05, or a mask file to show",
    )
    overlay: str | None = optional("also write the photo with the mask drawn over it", metavar="FILE")
    output: str = option(help="mask file, white on the object: .png, .tif or .exr")

    def run(self, progress: Progress = silent) -> MaskFound:
        """Write the mask, and the overlay if requested."""
        return resolve_name("mpsnet_core.capture.commands:find_mask")(self, progress)


@dataclass(frozen=True)
class PhotoChecked(Result):
    """Findings of the check."""

    level: str
    """Level of the worst finding: "good", "watch" or "bad"."""
    findings: "list[Finding]"
    """One finding for each item."""

    def facts(self) -> dict[str, Any]:
        """The result as plain data, and the findings as notes."""
        levels = dict(zip(("good", "watch", "bad"), NOTE_LEVELS, strict=True))
        told = [Note("%s: %s", one.item, one.sentence, level=levels[one.level]) for one in self.findings]
        return {**super().facts(), "told": [note.facts() for note in told]}


@dataclass(frozen=True)
class Check(ReadsPhotos):
    """Check a photo and its lights, and say how to improve them.

    It checks the exposure, clipping, whether the channels show different lights, the lights' directions and order, how
    much of the object all three lights reach, and the focus. Each is "good", "watch" or "bad". A bad photo
    raises no error.

    Examples
    --------
    >>> import tempfile
    >>> import numpy as np
    >>> from mpsnet_core import Check, write_image
    >>> light = np.random.default_rng(0).uniform(0.2, 0.7, (64, 64, 3))
    >>> with tempfile.TemporaryDirectory() as folder:
    ...     write_image(f"{folder}/photo.png", light * [1, 1, 0.01])
    ...     result = Check(image=f"{folder}/photo.png", mask="none", encoding="linear").run()
    >>> result.level, result.findings[0].item
    ('bad', 'exposure')
    >>> print(result.findings[0].sentence)
    the blue channel reaches only 0.7% of full scale; make the blue light brighter, or check that it is on
    """

    command: ClassVar[str] = "check"

    image: str = option(positional=True, help="photo")
    rig: str | None = optional(
        "rig file (.json, or .lp with three lights)", unset="the lights are not checked", path="file"
    )
    mask: str = option(default=MASK, help="where the object is, as in `mask`")
    json: str | None = output_option("write the findings as JSON")

    def run(self, progress: Progress = silent) -> PhotoChecked:
        """Check the photo, and write the findings if requested."""
        return resolve_name("mpsnet_core.capture.commands:check")(self, progress)
