"""The report of a bake: what the views see of the surface and where they disagree, as one self-contained HTML page."""

import html
import os
from collections.abc import Sequence

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.evaluation.pictures import BACKGROUND, colour_scale, error_picture, legend
from mpsnet_core.evaluation.report import HEAD, data_url, report_path
from mpsnet_core.evaluation.tables import text_table
from mpsnet_core.files import written_whole
from mpsnet_core.normals import encode
from mpsnet_core.surface.agreement import ViewAgreement
from mpsnet_core.surface.texture import Texture

PICTURE = 900  # pixels on a side, at most
SCALES = (1.0, 2.0, 5.0, 10.0, 20.0, 45.0, 90.0)  # degrees
# Seen by none, by one view, two, ...; the last colour stands for all above.
COUNTS = (
    (0.20, 0.36, 0.66),
    (0.55, 0.13, 0.13),
    (0.84, 0.42, 0.13),
    (0.93, 0.75, 0.25),
    (0.62, 0.80, 0.42),
    (0.3, 0.7, 0.6),
)

_STYLE = """<style>.maps{display:flex;flex-wrap:wrap;gap:1.5em;align-items:flex-start}figure{margin:0;max-width:620px}
figcaption{margin:.2em 0 .5em}p{max-width:60em;line-height:1.4}</style>
"""


def write_bake_report(
    path: str | os.PathLike[str],
    title: str,
    texture: Texture,
    views: Sequence[ViewAgreement],
    notes: Sequence[str] = (),
) -> None:
    """Write the page: the texture, how many views see each texel, how far they lie apart, and a line for each view.

    Raises InputError where no report can be put there.
    """
    path = report_path(path)
    with written_whole(path) as unfinished, unfinished.open("w", encoding="utf-8") as page:
        page.write(HEAD.format(title=html.escape(title)) + _STYLE)
        page.writelines(f"<p>{html.escape(note)}</p>\n" for note in notes)
        page.write("<div class='maps'>\n")
        for words, pictures in _maps(texture):
            images = "".join(f"<img alt='{html.escape(words)}' src='{data_url(picture)}'>" for picture in pictures)
            page.write(f"<figure><figcaption>{html.escape(words)}</figcaption>{images}</figure>\n")
        page.write(f"</div>\n<h2>The views</h2>\n<pre>{html.escape(view_table(views))}</pre>\n{_EXPLAINED}</html>\n")


_EXPLAINED = """<p><b>seen</b>: share of the surface that the view sees. <b>apart</b>: mean angle in degrees between the
view's normals and the mean of the others, as they were estimated, and levelled. <b>levelling</b>: mean angle that the
view was turned by. A view that stays apart from the others after levelling has a wrong camera, mask or light.</p>
"""


def view_table(views: Sequence[ViewAgreement]) -> str:
    """A line for each view, as text."""

    def angle(value: float) -> str:
        return f"{value:.2f}" if np.isfinite(value) else "-"

    lines = [[v.name, f"{v.seen:.1%}", angle(v.before), angle(v.after), angle(v.level)] for v in views]
    return text_table(["view", "seen", "apart", "apart, levelled", "levelling"], lines, 1)


def _maps(texture: Texture) -> list[tuple[str, list[NDArray[np.float32]]]]:
    step = -(-len(texture.vectors) // PICTURE)
    few = (slice(step // 2, None, step), slice(step // 2, None, step))
    covered = texture.covered[few]
    colours = np.where(covered[..., None], encode(texture.vectors[few]), np.float32(BACKGROUND))
    maps = [(f"the texture, {texture.space} space", [colours.astype(np.float32)])]
    if texture.views is not None:
        maps.append(("how many views see it", [_counts_picture(texture.views[few], covered)]))
    if texture.views is not None and texture.spread is not None:
        shared = texture.views[few] > 1
        spread = texture.spread[few]
        high = float(np.percentile(spread[shared], 98)) if shared.any() else 0.0
        highest = next(scale for scale in SCALES if scale >= min(high, SCALES[-1]))
        picture = error_picture(spread.astype(np.float64), shared, highest)
        scale = colour_scale(highest, len(picture))
        maps.append(("how far the views' normals lie apart", [np.concatenate([picture, scale], axis=1)]))
    return maps


def _counts_picture(views: NDArray[np.uint16], covered: NDArray[np.bool_]) -> NDArray[np.float32]:
    """(H, W, 3) a colour for each number of views, and below it what they mean."""
    palette = np.array(COUNTS, np.float32)
    picture = np.where(covered[..., None], palette[np.minimum(views, len(palette) - 1)], np.float32(BACKGROUND))
    words = ["none", *map(str, range(1, len(palette) - 1)), f"{len(palette) - 1} or more"]
    meaning = legend(list(zip(COUNTS, words, strict=True)), PICTURE)
    wide = max(picture.shape[1], meaning.shape[1])
    pad = [
        np.pad(part, [(0, 0), (0, wide - part.shape[1]), (0, 0)], constant_values=BACKGROUND)
        for part in (picture, np.full((8, 1, 3), BACKGROUND, np.float32), meaning)
    ]
    return np.concatenate(pad)
