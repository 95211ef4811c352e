"""What this program writes into its images of what they are, so that results are never taken for photos."""

from typing import Literal

from mpsnet_core import __version__

ENCODINGS: tuple[Literal["srgb", "linear"], ...] = ("srgb", "linear")

# Who made a file, as images and JSON files state it.
SOFTWARE = "mpsnet"
BY = f" by {SOFTWARE} "
_ASSUMED = "linear values, of photos that state no encoding and were read as "


def made(what: str) -> str:
    """The description of an image that is no photo: what it is, and that this program made it."""
    return f"{what}{BY}{__version__}"


def curve_assumed(encoding: Literal["srgb", "linear"] | None) -> str | None:
    """The description of a photo that was made of others whose files did not state their encoding; None if they did."""
    return encoding and f"{_ASSUMED}{encoding}"


def assumed_curve(description: str) -> Literal["srgb", "linear"] | None:
    """The encoding that was assumed, by an image's description; None if none was."""
    return {curve_assumed(one): one for one in ENCODINGS}.get(description)


def says_made(description: str) -> bool:
    """Whether an image's description says so; that of heights is JSON."""
    return BY in description or f'"{SOFTWARE}-' in description
