"""Sources of frames: numbered photos and their masks."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from mpsnet_core.capture.masks import mask_identity, mask_source
from mpsnet_core.capture.open import Source
from mpsnet_core.defaults import MASK
from mpsnet_core.errors import FileError, SettingsError
from mpsnet_core.io.frames import expand_images, is_folder_or_pattern, numbering
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.provenance import fingerprint


@dataclass(frozen=True)
class Masks:
    """The masks of a sequence: one choice for all frames, or a file for each."""

    given: str = MASK
    """Mask of all frames, as in :func:`mpsnet_core.read_capture`."""
    by_number: Mapping[int, Path] = field(default_factory=dict)
    """Mask file of each frame, by frame number; empty if one mask is for all."""

    def of(self, number: int) -> AnyPath:
        """The mask of a frame. Raises FileError if masks are per frame and this one is missing."""
        if not self.by_number:
            return self.given
        if number not in self.by_number:
            raise FileError(f"{self.given} has no mask for frame {number}; add it, or give one mask for all")
        return self.by_number[number]

    def mask_identity(self, number: int, span: int) -> list[str]:
        """Text that changes with the mask of a frame, or of frames within `span` numbers of it."""
        if not self.by_number:
            return [mask_identity(self.given)]
        near = range(number - span, number + span + 1)
        return [fingerprint(self.by_number[other]) for other in near if other in self.by_number]


@dataclass(frozen=True)
class Frame:
    """A photo of a sequence."""

    number: int
    """Position in time."""
    source: Source
    """The photo. It is opened in the frames' order, and a video's at most once."""
    output: Path
    """File for its normals."""
    made_from: str
    """Text that changes with any file that its normals depend on."""


def photo_frames(
    photos: Sequence[Path], outputs: Sequence[Path], *, masks: Masks, like: Source, reach: int = 0
) -> list[Frame]:
    """Frames from photo files: in the order of their numbers, or as given if they have none.

    outputs: files for the normals of each photo. masks: of the frames. like: a frame with all that the frames share.
    reach: number of frames before and after a frame that its normals depend on, too.

    Raises FileError if a photo or a mask is missing.
    """
    numbered = numbering(photos)
    numbers = numbered.numbers if numbered else range(1, len(photos) + 1)
    span = reach * (numbered.step if numbered else 1)
    order = sorted(range(len(photos)), key=numbers.__getitem__)
    frames = []
    for place, index in enumerate(order):
        near = order[max(place - reach, 0) : place + reach + 1]
        prints = [fingerprint(photos[other]) for other in near if abs(numbers[other] - numbers[index]) <= span]
        source = replace(like, photo=photos[index], mask=masks.of(numbers[index]), name=photos[index].name)
        made_from = "\n".join([*prints, *masks.mask_identity(numbers[index], span)])
        frames.append(Frame(numbers[index], source, outputs[index], made_from))
    return frames


def frame_masks(mask: str) -> Masks:
    """The masks that `mask` names. A folder or a pattern (mask_####.png) has one numbered file per frame; anything else
    applies to all frames.

    Raises SettingsError if the files of a folder or pattern are not numbered.
    """
    if mask_source(mask) != mask or not is_folder_or_pattern(mask):
        return Masks(mask)
    files = expand_images([mask])
    numbered = numbering(files)
    numbers = numbered.numbers if numbered else [_last_number(file) for file in files]
    by_number = {number: file for number, file in zip(numbers, files, strict=True) if number is not None}
    if len(by_number) < len(files):
        raise SettingsError(f"the masks of {mask} are not numbered like frames; name them mask_0001.png and so on")
    return Masks(mask, by_number)


def _last_number(file: Path) -> int | None:
    digits = re.findall("[0-9]+", file.stem)
    return int(digits[-1]) if digits else None
