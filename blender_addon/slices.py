"""Long work in slices, between which a live window goes on."""

from collections.abc import Generator

# Work of which each step is short enough for a live window to wait for; close() ends it early. It yields whether the
# next step is a long one, before which the window is drawn.
Slices = Generator[bool, None, None]


def give_up(slices: list[Slices]) -> None:
    """Let what was begun take away what it has made."""
    for one in slices:
        one.close()
    slices.clear()
