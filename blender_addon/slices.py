"""Long work in slices, between which a live window goes on."""

from collections.abc import Generator

# Work of which each step is short enough for a live window to wait for; close() ends it early. It yields whether the
# next step is a long one, before which the window is drawn.
Slices = Generator[bool, None, None]
