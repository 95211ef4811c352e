"""Images for display: normals and errors in colour, contact sheets of titled tiles."""

from collections.abc import Callable, Sequence
from pathlib import Path

import numpy as np
import OpenImageIO as oiio

from mpsnet_core.arrays.mask_regions import bounding_box, dilated
from mpsnet_core.arrays.types import F32, Bools, Floats
from mpsnet_core.io.image import linear_to_srgb

BACKGROUND = 0.13
TITLE_HEIGHT = 30
GAP = 10
MARGIN = 8  # pixels around an object that images are cropped to
# Large images are exposed by about so many of their pixels.
WHITE_PIXELS = 4_000_000
OUTLINE_COLOUR = (1.0, 0.55, 0.1)
LEGEND_STEP = 150
SCALE_WIDTH = 90
ERROR_SCALES = (1.0, 2.0, 5.0, 10.0, 20.0, 45.0, 90.0)  # degrees


def font() -> str:
    """The font file that ships with OpenImageIO; "" if there is none, for the one that it finds.

    By itself, OpenImageIO looks in ``$OpenImageIO_ROOT``, which may be another installation without fonts.
    """
    file = Path(oiio.__file__).parent / "share/fonts/OpenImageIO/DroidSans.ttf"
    return str(file) if file.is_file() else ""


def photo_picture(image: F32, mask: Bools | None = None) -> F32:
    """(H, W, 3) display values of a linear image, exposed so that its 99.5th percentile is white."""
    return linear_to_srgb(image / _white(image, mask)).astype(np.float32)


def _white(image: Floats, mask: Bools | None) -> np.float32:
    """The 99.5th percentile, of every few rows and columns of large images."""
    step = max(1, round((image.shape[0] * image.shape[1] / WHITE_PIXELS) ** 0.5))
    seen = image[::step, ::step]
    if mask is not None and mask[::step, ::step].any():
        seen = seen[mask[::step, ::step]]
    return np.float32(max(float(np.percentile(seen.astype(np.float32), 99.5)), 1e-12))


def mask_bands(image: Floats, mask: Bools) -> Callable[[slice], F32]:
    """Display values (h, W, 3) of some rows of a linear image: dim grey outside the mask, its outline in orange."""
    white = _white(image, mask if mask.any() else None)
    outline = dilated(mask, max(1, round(max(mask.shape) / 600))) & ~mask

    def band(rows: slice) -> F32:
        picture = linear_to_srgb(image[rows].astype(np.float32) / white).astype(np.float32)
        dim = np.float32(0.35) * picture.mean(axis=-1, keepdims=True)
        picture = np.where(mask[rows][..., None], picture, dim)
        picture[outline[rows]] = OUTLINE_COLOUR
        return picture

    return band


def on_background(colours: F32, mask: Bools) -> F32:
    """The colours (H, W, 3) inside the mask, dark grey outside."""
    return np.where(mask[..., None], colours, np.float32(BACKGROUND))


def error_picture(error: Floats, mask: Bools, highest: float) -> F32:
    """(H, W, 3) angular errors in colour, from black at 0° to bright at `highest` degrees, on dark grey."""
    return on_background(_inferno(np.clip(error / highest, 0, 1)), mask)


def colour_scale(highest: float, height: int) -> F32:
    """(height, SCALE_WIDTH, 3) the colour bar of :func:`error_picture`, labelled in degrees."""
    bar = SCALE_WIDTH // 3
    canvas = np.full((height, SCALE_WIDTH, 3), BACKGROUND, np.float32)
    canvas[:, :bar] = _inferno(np.repeat(np.linspace(1, 0, height)[:, None], bar, axis=1))
    steps = 5
    for step in range(steps + 1):
        y = round((1 - step / steps) * (height - 1))
        label = f"{highest * step / steps:.3g}°"
        _write(canvas, label, bar + 6, min(max(y + 6, 14), height - 4), 15)
    return canvas


def scaled_error_bands(error: Floats, mask: Bools) -> tuple[tuple[int, int, int], Callable[[slice], F32]]:
    """:func:`error_picture` with a colour bar on the right, which ends at the first of `ERROR_SCALES` that exceeds
    nearly all errors: the picture's shape, and a function that makes some of its rows."""
    high = float(np.percentile(error[mask], 98, overwrite_input=True)) if mask.any() else 0.0
    highest = next(scale for scale in ERROR_SCALES if scale >= min(high, ERROR_SCALES[-1]))
    bar = colour_scale(highest, len(error))

    def band(rows: slice) -> F32:
        return np.concatenate([error_picture(error[rows], mask[rows], highest), bar[rows]], axis=1)

    return (error.shape[0], error.shape[1] + SCALE_WIDTH, 3), band


def legend(entries: Sequence[tuple[tuple[float, float, float], str]], width: int) -> F32:
    """(H, width, 3) a row of labelled swatches."""
    canvas = np.full((TITLE_HEIGHT, width, 3), BACKGROUND, np.float32)
    for number, (colour, label) in enumerate(entries):
        left = GAP + number * LEGEND_STEP
        canvas[4:22, left : left + 18] = colour
        _write(canvas, label, left + 26, 19, 15)
    return canvas


def contact_sheet(tiles: Sequence[tuple[str, F32]], columns: int, tile_height: int = 320) -> F32:
    """(H, W, 3) the tiles (title, image) in rows, each scaled to `tile_height` with its title above."""
    shown = [(title, scaled(picture, tile_height / picture.shape[0])) for title, picture in tiles]
    rows = [shown[start : start + columns] for start in range(0, len(shown), columns)]
    widths = [max(row[c][1].shape[1] for row in rows if c < len(row)) for c in range(min(columns, len(shown)))]
    height = len(rows) * (tile_height + TITLE_HEIGHT + GAP) + GAP
    canvas = np.full((height, sum(widths) + GAP * (len(widths) + 1), 3), BACKGROUND, np.float32)
    for r, row in enumerate(rows):
        top = GAP + r * (tile_height + TITLE_HEIGHT + GAP)
        left = GAP
        for width, (title, picture) in zip(widths, row, strict=False):
            _write(canvas, title, left, top + 20, 17)
            canvas[top + TITLE_HEIGHT : top + TITLE_HEIGHT + tile_height, left : left + picture.shape[1]] = picture
            left += width + GAP
    return canvas


def cropped(pictures: Sequence[F32], mask: Bools) -> list[F32]:
    """The images cropped to the mask's bounding box and a margin."""
    box = bounding_box(mask, MARGIN)
    return [picture[box] for picture in pictures]


def _inferno(values: Floats) -> F32:
    source = oiio.ImageBuf(np.ascontiguousarray(values[..., None], dtype=np.float32))
    # OpenImageIO's colour maps are linear.
    linear = oiio.ImageBufAlgo.color_map(source, 0, "inferno").get_pixels(oiio.FLOAT)
    return linear_to_srgb(np.asarray(linear)).astype(np.float32)


def scaled(picture: F32, factor: float) -> F32:
    """The picture (H, W, 3) with sides `factor` times as long, and its values limited to between 0 and 1."""
    height, width = (max(1, round(side * factor)) for side in picture.shape[:2])
    source = oiio.ImageBuf(np.ascontiguousarray(picture, dtype=np.float32))
    resized = oiio.ImageBufAlgo.resize(source, roi=oiio.ROI(0, width, 0, height, 0, 1, 0, 3))
    return np.clip(np.asarray(resized.get_pixels(oiio.FLOAT), np.float32), 0, 1)


def _write(canvas: F32, text: str, x: int, y: int, size: int) -> None:
    # Copy only the text line's rows of the canvas to the library and back.
    top = max(y - size, 0)
    line = canvas[top : y + size // 2]
    buffer = oiio.ImageBuf(np.ascontiguousarray(line))
    oiio.ImageBufAlgo.render_text(buffer, x, y - top, text, size, font(), (0.92, 0.92, 0.92))
    line[...] = buffer.get_pixels(oiio.FLOAT)
