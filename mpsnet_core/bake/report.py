"""The report of a bake: what the views see of the surface and where they disagree, as a self-contained HTML page."""

import html
from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from mpsnet_core.arrays.types import F32
from mpsnet_core.bake.view_agreement import ViewAgreement
from mpsnet_core.io.files import atomic_write
from mpsnet_core.io.html_page import HEAD, data_url, page_path
from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.io.opening import AnyPath
from mpsnet_core.io.text_table import text_table
from mpsnet_core.scene.normal_encoding import encode
from mpsnet_core.scene.pictures import on_background, scaled_error_bands
from mpsnet_core.scene.texture import Texture

PICTURE = 1024  # pixels on a side, at most
# Colours of texels seen by no view, by one, by two, ...; the last one is for all higher counts.
COUNTS = ("#335ca8", "#8c2121", "#d66b21", "#edbf40", "#9ecc6b", "#4db399")

_STYLE = """<style>.maps{display:flex;flex-wrap:wrap;gap:1.5em;align-items:flex-start}
figure{margin:0;max-width:620px}figcaption{margin:.2em 0 .5em}p{max-width:60em;line-height:1.4}
i{display:inline-block;width:.9em;height:.9em;margin:0 .4em 0 1em;vertical-align:-.1em}</style>
"""


_COUNTED = ("none", *map(str, range(1, len(COUNTS) - 1)), f"{len(COUNTS) - 1} or more")
_KEY = "".join(f"<i style='background:{colour}'></i>{words}" for colour, words in zip(COUNTS, _COUNTED, strict=True))
_EXPLAINED = """<p><b>area seen</b>: share of the surface's area that the view sees. <b>apart</b>: mean angle in degrees
between the view's normals and the mean of the others, as they were estimated, and levelled. <b>levelling</b>: mean
angle that the view was turned by. A view that stays apart from the others after levelling has a wrong camera, mask or
light. <b>colour gain</b>: what red, green and blue of its albedo were multiplied by to match the others.</p>
"""


def view_table(views: Sequence[ViewAgreement]) -> str:
    """A text table with a line for each view."""

    def angle(value: float) -> str:
        return f"{value:.2f}" if np.isfinite(value) else "-"

    names = ["view", "area seen", "apart (°)", "apart, levelled (°)", "levelling (°)"]
    lines = [[v.name, f"{v.seen:.1%}", angle(v.before), angle(v.after), angle(v.level)] for v in views]
    if any(v.gain is not None for v in views):
        names.append("colour gain")
        lines = [[*line, " ".join(f"{one:.2f}" for one in v.gain or ())] for line, v in zip(lines, views, strict=True)]
    return text_table(names, lines, 1)


@dataclass(frozen=True)
class TextureMap:
    """An image of the texture for the report."""

    words: str
    """What it shows."""
    picture: F32
    """(H, W, 3). Its pixels, 0 to 1."""
    key: str = ""
    """Its colour key, as HTML."""


def texture_maps(texture: Texture, name: str = "") -> list[TextureMap]:
    """Images of the texture, of the number of views of each texel, and of their spread, if known.

    They have at most `PICTURE` texels a side. name: the texture set's name, if there are several.
    """
    step = -(-len(texture.vectors) // PICTURE)
    few = (slice(step // 2, None, step), slice(step // 2, None, step))
    covered = texture.covered[few]

    beyond = "has the mesh's own normals" if texture.filled is None else "is filled where its island is seen"
    words = f"the texture{name and f' of {name}'}, {texture.space} space; what no view sees {beyond}"
    maps = [TextureMap(words, on_background(encode(texture.vectors[few]), covered))]
    if texture.colours is not None:
        colours = on_background(linear_to_srgb(texture.colours[few][..., :3]), covered)
        maps.append(TextureMap("the albedo; what no view sees is filled from its surroundings", colours))
    if texture.views is not None and texture.spread is not None:
        palette = np.array([list(bytes.fromhex(colour[1:])) for colour in COUNTS], np.float32) / np.float32(255)
        counts = on_background(palette[np.minimum(texture.views[few], len(palette) - 1)], covered)
        maps.append(TextureMap("how many views see it:", counts, _KEY))
        shared, spread = texture.views[few] > 1, texture.spread[few].astype(np.float64)
        _, spread_bands = scaled_error_bands(spread, shared)
        maps.append(TextureMap("how much the baked views differ where several see it (°)", spread_bands(np.s_[:])))
    return maps


def write_bake_report(
    path: AnyPath, title: str, maps: Sequence[TextureMap], views: Sequence[ViewAgreement], notes: Sequence[str] = ()
) -> None:
    """Write the page: the textures' maps, and a line for each view.

    Raises InputError if it cannot be written there.
    """
    path = page_path(path)
    with atomic_write(path) as unfinished, unfinished.open("w", encoding="utf-8") as page:
        page.write(HEAD.format(title=html.escape(title)) + _STYLE)
        page.writelines(f"<p>{html.escape(note)}</p>\n" for note in notes)
        page.write("<div class='maps'>\n")
        for shown in maps:
            image = f"<img alt='{html.escape(shown.words)}' src='{data_url(shown.picture)}'>"
            page.write(f"<figure><figcaption>{html.escape(shown.words)}{shown.key}</figcaption>{image}</figure>\n")
        page.write(f"</div>\n<h2>The views</h2>\n<pre>{html.escape(view_table(views))}</pre>\n{_EXPLAINED}</html>\n")
