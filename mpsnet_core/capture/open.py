"""The one way from files to captures: photos are read, corrected, undistorted and masked; doubts are reported."""

import logging
import os
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import suppress
from dataclasses import dataclass, field, replace
from pathlib import Path

import numpy as np
from numpy.typing import ArrayLike

from mpsnet_core.arrays.resampling import chosen_pixels
from mpsnet_core.arrays.sizes import check_same_size
from mpsnet_core.arrays.types import F32, Bools
from mpsnet_core.capture import transfer
from mpsnet_core.capture.capture import Capture, checked_white, depth_within, doubts
from mpsnet_core.capture.decode import AS_STATED, Correction, PhotoReadOptions, corrected, undistorted_photo
from mpsnet_core.capture.masks import MaskNotes, mask_of
from mpsnet_core.defaults import MASK
from mpsnet_core.errors import GeometryError, InputError, Note, SettingsError
from mpsnet_core.io.files import prefix_errors, resolved
from mpsnet_core.io.frames import expand_images
from mpsnet_core.io.from_files import takes_files
from mpsnet_core.io.image import Image
from mpsnet_core.io.image_encoding import Encoding, otherwise_encoded
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.scene.camera import Camera, camera_for
from mpsnet_core.scene.photogrammetry.posed_photo import Lens, undistorted_mask
from mpsnet_core.scene.rays import RayScene, depth_of_mesh, mesh_mask
from mpsnet_core.scene.rig import LightRig
from mpsnet_core.scene.rig_check import warn_of_wrong_rig

# --- sources: photos that have not been opened yet, with all that is known about them ---------------------------------


MESH = "mesh"  # the mask of a posed view: where its camera sees the mesh


@dataclass(frozen=True, eq=False)
class Source:
    """A photo to open: a still, a frame, a posed view or a material."""

    photo: Path | Callable[[], Image]
    """Its file, or a function that returns its pixels as read, such as those of a video's frame."""
    rig: LightRig | None
    """The lights, in camera space; None if they are unknown. There is then a mask, but no capture."""
    mask: AnyPath | Callable[[Image], Bools] = MASK
    """The mask as in :func:`mpsnet_core.read_capture`, :data:`MESH`, or a function that finds the mask (H, W) in the
    photo."""
    name: str = ""
    """Name of the photo in messages; its path by default."""
    camera: Camera | float | None = None
    """The camera, the focal length of its lens in mm on a sensor 36 mm wide, or None. A camera of the same aspect ratio
    is scaled to the photo's size."""
    lens: Lens | None = None
    """The distortion to remove; None if there is none."""
    depth: F32 | float | None = None
    """(H, W) or a number. Distance of the surface in front of the camera, as in :func:`mpsnet_core.read_capture`."""
    scene: RayScene | None = None
    """The object's mesh in the camera's world, in place of the depth."""
    white: Sequence[AnyPath] = ()
    """Photos of the same pose under white light, as in :func:`mpsnet_core.read_capture`."""
    white_light: ArrayLike | None = None
    """What lit the white photos, as in :func:`mpsnet_core.read_capture`."""

    def __str__(self) -> str:
        return self.name or str(self.photo)

    @property
    def file_name(self) -> str:
        """The name of the file, or of the frame."""
        return self.photo.name if isinstance(self.photo, Path) else self.name


log = logging.getLogger(__name__)


def open_captures(sources: Iterable[Source], options: PhotoReadOptions = AS_STATED) -> Iterator[Capture]:
    """The captures of one set of photos, in order: see :class:`PhotoSet`.

    Raises InputError if one cannot be read, or its photo, mask, camera, depth and white photo do not match.
    """
    photos = PhotoSet([*sources], options)
    return map(photos.open, photos.sources)


@takes_files
def read_capture(
    path: AnyPath,
    rig: LightRig,
    *,
    mask: AnyPath = MASK,
    encoding: Encoding = "auto",
    layer: str | None = None,
    camera: Camera | float | None = None,
    depth: F32 | float | None = None,
    correction: Correction | None = None,
    white: AnyPath | Sequence[AnyPath] = (),
    white_light: ArrayLike | None = None,
) -> Capture:
    """Read a photo as a capture.

    Parameters
    ----------
    path : str or path
        The photo.
    rig : LightRig
        The lights, in camera space.
    mask : str or path
        A mask file, or a keyword of :func:`find_mask`. By default the photo's alpha if it has any, else the object that
        stands out clearly from its background, else the whole photo.
    encoding, layer : str, optional
        As in :func:`read_image`, with one exception: if neither `encoding` nor the file states the encoding, and the
        shading shows that values are linear (:mod:`mpsnet_core.capture.transfer`), they are read as linear.
    camera : Camera or float, optional
        The camera, or the focal length of its lens in mm on a sensor 36 mm wide. A camera of another size with the same
        aspect ratio is scaled.
    depth : (H, W) array or float, optional
        Distance of the surface in front of the camera, infinity where unknown. By default that of the lights' target.
    correction : Correction, optional
        Dark frame and flat field, also applied to the white photo.
    white : str, path or sequence of them, optional
        A photo of the same pose under white light, or several to add up, one for each light turned white.
    white_light : (3,) array, optional
        Direction from the surface to the one lamp that lit the white photo, in camera space. By default the rig's
        lights, turned white, lit it.

    Raises
    ------
    InputError
        If a file is missing or damaged, or photo, mask, camera, depth and white photo do not match.
    """
    several = [white] if isinstance(white, str | os.PathLike) else white
    source = Source(Path(path), rig, mask, camera=camera, depth=depth, white=several, white_light=white_light)
    return next(open_captures([source], PhotoReadOptions(encoding, layer, correction)))


@dataclass(frozen=True, eq=False)
class MaskedPhoto:
    """A photo as it becomes a capture: corrected, without distortion and with its mask."""

    image: Image
    """The corrected and undistorted photo."""
    mask: Bools
    """(H, W). The pixels of the object."""
    camera: Camera | None
    """Its pinhole camera, scaled to the photo's size; None if unknown."""


@dataclass
class PhotoSet:
    """Photos that belong together, such as the frames of a sequence: what they do not state is decided once."""

    sources: Sequence[Source] = ()
    """The photos, as far as they are known. The set is opened one by one, in any order."""
    options: PhotoReadOptions = AS_STATED
    """How to read them. `assumed` is set if their shading shows it."""
    moving: bool = False
    """Whether they are frames of one sequence. Once the object was found in one, it is searched for in all others: none
    is then taken as a whole."""
    encoding_evidence: float | None = None
    """Evidence that files without a stated encoding have another than the usual one, None as long as none was opened;
    see :func:`mpsnet_core.capture.transfer.evidence_for_linear`."""
    _found: bool = False
    _reported: set[object] = field(default_factory=set)

    def open(self, source: Source) -> Capture:
        """A photo as a capture. Logs what is doubtful about it; a doubt that several photos share, once.

        Raises InputError if it cannot be read, or its photo, mask, camera, depth and white photo do not match.
        """
        photo = self.masked(source)
        assert source.rig is not None
        image = photo.image
        with prefix_errors(source):
            depth = _depth(source, photo)
            capture = Capture(image.pixels, photo.mask, source.rig, photo.camera, image.clip, depth, image.clipped)
        if source.white:
            capture = self._with_white(capture, source, image)
        which = "" if self._alone else f"{source}: "
        for level, kind, words in doubts(capture):
            if self._first_report(kind):
                log.log(level, Note("%s: %s", str(source), words) if which else words)
        if self._first_report("rig"):
            warn_of_wrong_rig(capture.image, capture.mask, capture.rig, which)
        return capture

    def masked(self, source: Source) -> MaskedPhoto:
        """A photo with its mask, before it becomes a capture. Raises InputError if either cannot be read."""
        image = self._read(source)
        has_alpha = image.alpha is not None
        # Of several photos, report on the first with alpha and on the first without; the others look alike.
        notes: MaskNotes = "all" if self._alone else "none" if has_alpha in self._reported else "doubts"
        photo = self._masked_photo(source, image, notes)
        if image.assumed:
            evidence, first = self._encoding_evidence(source, image, photo), self.encoding_evidence is None
            if first:
                self.encoding_evidence = self._decide_encoding(source, image, evidence)
            others = self.options.assumed == transfer.other_encoding(image.assumed)
            limit = transfer.CLOSE if first else transfer.DECIDED
            if max(evidence, self.encoding_evidence or 0) > limit and self._first_report("transfer"):
                transfer.warn_of_transfer_curve(source.file_name, image.assumed, decided=others)
            if others:
                # A mask found by brightness depends on the curve: find it again, but report it once.
                photo = self._masked_photo(source, otherwise_encoded(image), "none")
        self._reported.add(has_alpha)
        found = self.moving and source.mask == MASK and not has_alpha and not photo.mask.all()
        self._found = self._found or found
        return photo

    @property
    def _alone(self) -> bool:
        return len(self.sources) == 1

    def _first_report(self, kind: object) -> bool:
        """Whether something of this kind is reported for the first time."""
        known = kind in self._reported
        self._reported.add(kind)
        return not known

    def _read(self, source: Source) -> Image:
        return self.options.photo(source.photo) if isinstance(source.photo, Path) else source.photo()

    def _masked_photo(self, source: Source, image: Image, notes: MaskNotes) -> MaskedPhoto:
        rig, correction = source.rig, self.options.correction
        choice = "auto" if self._found and image.alpha is None else source.mask
        with prefix_errors(source):
            if rig is not None and rig.near is not None and correction is not None and correction.gain is not None:
                raise SettingsError(
                    "the rig's lights are near the object, and the flat field contains their fall-off too; leave the "
                    "flat field out, or give the lights as directions"
                )
            height, width, _ = image.pixels.shape
            camera = camera_for(source.camera, width, height)
            image = corrected(image, correction)
            if callable(choice):
                mask = choice(image)
            else:
                mask = mask_of(image, "none" if choice == MESH else choice, self.options, notes)
            check_same_size("the mask", mask.shape, "the photo", (height, width))
            if source.lens is not None and camera is not None:
                mask, image = undistorted_mask(mask, camera, source.lens), undistorted_photo(image, camera, source.lens)
            if choice == MESH and camera is not None and source.scene is not None:
                mask = mask & mesh_mask(camera, source.scene)
                if not mask.any():
                    raise GeometryError("its camera does not see the mesh; do cameras and mesh share one world?")
        return MaskedPhoto(image, mask, camera)

    def _encoding_evidence(self, source: Source, image: Image, photo: MaskedPhoto) -> float:
        """The evidence, by the shading, that a photo as read has the other encoding than the one that is assumed."""
        if source.rig is None:
            return 0.0
        pixels = image.pixels if source.lens is None else photo.image.pixels
        for_linear = transfer.evidence_for_linear(pixels, photo.mask, source.rig, as_srgb=image.assumed == "srgb")
        return for_linear if image.assumed == "srgb" else -for_linear

    def _decide_encoding(self, source: Source, image: Image, evidence: float) -> float:
        """The evidence by which the photos of the whole set are read: the clearest of those looked at.

        They are the same whichever photo, the `source`, is opened first. image, evidence: of this one.
        """
        found = [0.0]
        for other in transfer.photos_to_examine(self.sources) or [source]:
            if other is source:
                found.append(evidence)
                continue
            with suppress(InputError):  # reported when it is opened
                seen = self._read(other)
                if seen.assumed == image.assumed:
                    found.append(self._encoding_evidence(other, seen, self._masked_photo(other, seen, "none")))
        clearest = max(found, key=abs)
        # Dark frame and flat field were read as usual, so the photos stay that, too.
        if image.assumed and clearest > transfer.DECIDED and self.options.correction is None:
            self.options = replace(self.options, assumed=transfer.other_encoding(image.assumed))
        return clearest

    def _with_white(self, capture: Capture, source: Source, photo: Image) -> Capture:
        """The capture with the sum of its white photos. Raises InputError, which names the one that does not match."""
        files = expand_images(source.white)
        total, clipped = np.zeros(capture.image.shape, np.float32), np.zeros(capture.image.shape, bool)
        for file in files:
            if isinstance(source.photo, Path) and resolved(file) == resolved(source.photo):
                raise _white_is_the_photo(file)
            image = self.options.companion(file, photo)
            with prefix_errors(file):
                image = corrected(image, self.options.correction)
                if source.lens is not None and capture.camera is not None:
                    image = undistorted_photo(image, capture.camera, source.lens)
                total += checked_white(image.pixels, None, capture.mask)
            clipped |= image.saturated
        if np.array_equal(total.astype(capture.image.dtype), capture.image):
            raise _white_is_the_photo(files[0])
        light = None if source.white_light is None else np.asarray(source.white_light, np.float64)
        return replace(capture, white=total, white_clipped=clipped if clipped.any() else None, white_light=light)


def _depth(source: Source, photo: MaskedPhoto) -> F32 | None:
    """(H, W) the depth that near lights need, at every pixel of the mask; None for distant ones."""
    assert source.rig is not None
    depth = source.depth
    if source.scene is not None:
        depth = None if source.rig.near is None or photo.camera is None else depth_of_mesh(photo.camera, source.scene)
    elif isinstance(depth, np.ndarray) and depth.shape != photo.mask.shape and photo.camera is not source.camera:
        depth = depth[np.ix_(*chosen_pixels(*photo.mask.shape, *depth.shape))]  # of the camera before it was scaled
    return depth_within(photo.mask, depth, source.rig) if photo.mask.any() else None  # Capture rejects an empty mask


def _white_is_the_photo(path: AnyPath) -> SettingsError:
    return SettingsError(f"{path}: the white photo is the photo itself; give the one under white light")
