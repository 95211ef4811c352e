"""Heights from normals where one thing hides another: what the fast and the bilateral method make of a ring.

    python examples/integrate.py [--size 512] [--lean 72]

A ring leans back, so that its near side hides some of its far side. Between the two depth steps by up to a third of the
picture's width, and what normals tell of that they tell only where the ring is seen all the way round.

Prints how far either method's heights are off, and leaves output/integrate.png: normals, the true heights and both
methods' (the brighter, the nearer), and below them the heights along the line that the pictures show.
"""

import argparse
from itertools import pairwise
from pathlib import Path

import numpy as np

from mpsnet_core import NormalMap
from mpsnet_core.arrays.mask_regions import dilated
from mpsnet_core.io.image_writing import write_picture
from mpsnet_core.relief.integration.integrate import METHODS, integrate
from mpsnet_core.scene.pictures import contact_sheet, cropped, legend

OUTPUT = Path(__file__).resolve().parent / "output"
WIDE, THICK = 0.68, 0.28  # the ring's radius and its own; the picture shows -1 to 1
COLOURS = {"true": (0.75, 0.75, 0.75), "fast": (1.0, 0.55, 0.1), "bilateral": (0.3, 0.75, 1.0)}
GROUND = 0.13


def main() -> None:
    parser = argparse.ArgumentParser(description="Compare the two ways to integrate normals.")
    parser.add_argument("--size", type=int, default=512)
    parser.add_argument("--lean", type=float, default=72.0, help="degrees")
    options = parser.parse_args()
    normals, true = ring(options.size, np.radians(options.lean))
    mask = normals.mask
    heights = {"true": true}
    for method in METHODS:
        found = integrate(normals, method=method).values
        heights[method] = found + np.median((true - found)[mask])
        off = np.abs(heights[method] - true)[mask]
        print(
            f"{method}: off by {off.mean():.1f} pixels on average, steps and all; by {np.median(off):.2f} in the middle"
        )
    column = options.size // 2
    pictures = [normals.picture(), *(height_picture(values, true, mask) for values in heights.values())]
    for picture in pictures[1:]:
        picture[:, column] = (1.0, 0.2, 0.2)
    titles = ["normals", "true heights", *METHODS]
    pictures = contact_sheet(list(zip(titles, cropped(pictures, mask), strict=True)), 2, tile_height=260)
    chart = profiles({name: values[mask[:, column], column] for name, values in heights.items()}, pictures.shape[1])
    OUTPUT.mkdir(exist_ok=True)
    write_picture(OUTPUT / "integrate.png", np.concatenate([pictures, chart]))
    print(f"picture: {OUTPUT / 'integrate.png'}")


def ring(size: int, lean: float) -> tuple[NormalMap, np.ndarray]:
    """The leaning ring's normals and heights in pixels, orthographically, by rays that step towards it."""
    x = (np.arange(size) + 0.5) / size * 2 - 1
    x, y = np.meshgrid(x, -x)
    turn = np.array([[1, 0, 0], [0, np.cos(lean), -np.sin(lean)], [0, np.sin(lean), np.cos(lean)]])
    places = np.stack([x, y, np.full_like(x, 1.5)], axis=-1) @ turn  # in the ring's own frame
    for _ in range(300):
        beyond = np.hypot(np.hypot(places[..., 0], places[..., 1]) - WIDE, places[..., 2]) - THICK
        places -= np.minimum(beyond, 1)[..., None] * turn[2]
    met = np.abs(beyond) < 1e-6
    radius = np.hypot(places[..., 0], places[..., 1])[..., None]
    core = np.concatenate([places[..., :2] / radius * WIDE, np.zeros_like(radius)], axis=-1)
    vectors = (places - core) @ turn.T
    mask = met & (vectors[..., 2] > 0)
    return NormalMap(vectors, mask), np.where(mask, (places @ turn.T)[..., 2], 0) * size / 2


def height_picture(values: np.ndarray, true: np.ndarray, mask: np.ndarray) -> np.ndarray:
    """(H, W, 3) the nearer, the brighter; black and white are the truth's farthest and nearest."""
    low, high = true[mask].min(), true[mask].max()
    grey = np.clip((values - low) / (high - low), 0, 1) * 0.85 + 0.15
    return np.repeat(np.where(mask, grey, GROUND)[..., None], 3, axis=-1).astype(np.float32)


def profiles(lines: dict[str, np.ndarray], width: int, height: int = 320) -> np.ndarray:
    """(H, width, 3) heights (N,) along a line as curves in colours, with a legend above; the first one is wide."""
    low, high = min(line.min() for line in lines.values()), max(line.max() for line in lines.values())
    chart = np.full((height, width, 3), GROUND, np.float32)
    for number, (name, line) in enumerate(lines.items()):
        values = line[np.linspace(0, len(line) - 1, width - 40).astype(int)]
        rows = np.round(height - 20 - (values - low) / (high - low) * (height - 40)).astype(int)
        drawn = np.zeros((height, width), bool)
        for column, (one, other) in enumerate(pairwise(rows)):
            drawn[min(one, other) : max(one, other) + 1, column + 20] = True
        chart[dilated(drawn, 1 if number else 4)] = COLOURS[name]
    return np.concatenate([legend([(colour, name) for name, colour in COLOURS.items()], width), chart])


if __name__ == "__main__":
    main()
