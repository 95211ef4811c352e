"""Bands of rows, which keep intermediate arrays small for images of any size."""

# A multiple of what TIFF and EXR files compress together.
ROWS = 256


def bands(height: int, rows: int = ROWS) -> list[slice]:
    """Slices of `rows` rows that cover an image of `height` rows from top to bottom."""
    return [slice(top, min(top + rows, height)) for top in range(0, height, rows)]
