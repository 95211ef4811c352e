"""Long work in slices, between which the window stays responsive."""

from collections.abc import Generator

# A generator whose steps are short enough not to block the window; close() ends it early. It yields whether the next
# step is a long one, before which the window is redrawn.
Slices = Generator[bool, None, None]


def close_slices(slices: list[Slices]) -> None:
    """Close unfinished slices, which lets them clean up."""
    for one in slices:
        one.close()
    slices.clear()
