"""What this program writes into its images of what they are, so that results are never taken for photos."""

from mpsnet_core import __version__

# Who made a file, as images and JSON files state it.
SOFTWARE = "mpsnet"
BY = f" by {SOFTWARE} "


def made(what: str) -> str:
    """The description of an image that is no photo: what it is, and that this program made it."""
    return f"{what}{BY}{__version__}"


def says_made(description: str) -> bool:
    """Whether an image's description says so; that of heights is JSON."""
    return BY in description or f'"{SOFTWARE}-' in description
