"""Where frames come from: numbered photos, and the masks that go with them."""

import os
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path

from mpsnet_core.capture.masks import mask_identity, mask_source
from mpsnet_core.defaults import MASK
from mpsnet_core.errors import FileError, SettingsError
from mpsnet_core.io.frames import expand_images, is_several, numbering
from mpsnet_core.io.image import Image
from mpsnet_core.io.image_encoding import Encoding
from mpsnet_core.io.image_reading import read_image
from mpsnet_core.io.provenance import identity


@dataclass(frozen=True)
class Masks:
    """The masks of a sequence. given: of all frames, as in `read_capture`, unless there are files `by_number`."""

    given: str = MASK
    by_number: Mapping[int, Path] = field(default_factory=dict)

    def of(self, number: int) -> str | os.PathLike[str]:
        """The mask of a frame. Raises FileError where the frames have masks of their own and this one has none."""
        if not self.by_number:
            return self.given
        if number not in self.by_number:
            raise FileError(f"{self.given} has no mask for frame {number}; add it, or give one mask for all")
        return self.by_number[number]

    def mask_identity(self, number: int, span: int) -> list[str]:
        """Text that changes when a mask of a frame or of those within `span` numbers of it does."""
        if not self.by_number:
            return [mask_identity(self.given)]
        near = range(number - span, number + span + 1)
        return [identity(self.by_number[other]) for other in near if other in self.by_number]


@dataclass(frozen=True)
class Frame:
    """A picture of a sequence that has not been read yet.

    number: its place in time. name: for people. output: where its normals go. mask: as in `read_capture`.
    made_from: text that changes when any file changes that its normals are made from.
    read: returns its pixels; called in the frames' order, at most once.
    """

    number: int
    name: str
    output: Path
    made_from: str
    read: Callable[[], Image]
    mask: str | os.PathLike[str] = MASK


def photo_frames(
    photos: Sequence[Path],
    outputs: Sequence[Path],
    *,
    masks: Masks,
    reach: int = 0,
    encoding: Encoding = "auto",
    layer: str | None = None,
) -> Iterator[Frame]:
    """The frames that lie in files of their own: in the order of their numbers, as given where they have none.

    outputs: where each photo's normals go. masks: of the frames, by their numbers or one for all. reach: on how many
        frames before and behind it a frame's normals depend, too. encoding, layer: as in `read_image`.

    Raises FileError where a photo or a mask is missing.
    """
    numbered = numbering(photos)
    numbers = numbered.numbers if numbered else range(1, len(photos) + 1)
    span = reach * (numbered.step if numbered else 1)
    order = sorted(range(len(photos)), key=numbers.__getitem__)
    for place, index in enumerate(order):
        near = order[max(place - reach, 0) : place + reach + 1]
        photo_identities = [identity(photos[other]) for other in near if abs(numbers[other] - numbers[index]) <= span]
        yield Frame(
            numbers[index],
            photos[index].name,
            outputs[index],
            "\n".join([*photo_identities, *masks.mask_identity(numbers[index], span)]),
            partial(read_image, photos[index], encoding=encoding, layer=layer),
            masks.of(numbers[index]),
        )


def frame_masks(mask: str) -> Masks:
    """The masks that `mask` names: a folder or a pattern (mask_####.png) has one for each frame by its number, anything
    else is for all frames alike.

    Raises SettingsError where a folder's or a pattern's files are not numbered.
    """
    if mask_source(mask) != mask or not is_several(mask):
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
