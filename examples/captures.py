"""Normals of things that somebody photographed: lights from a mirror ball, then owl and cat from one shot each.

    python examples/captures.py FOLDER

FOLDER holds chrome/chrome.0.png to chrome.11.png, a mirror ball under twelve lights, one each, and owl and cat
likewise, with a mask each (owl/owl.mask.png): the University of Washington's course photographs, which are not part of
this project. The lights' directions come from the ball. Three of an object's photos become the channels of one shot, as
if its lights had been red, green and blue; the twelve lights make four such shots that share no light.

There is no truth to compare with. What can be told is how well estimates from different lights agree (the mean angle
between two of them), and how far they are from what all twelve lights say by least squares, light by light.

Leaves output/captures.png (the shot, normals by equation 2, by the default network, by twelve lights) and
output/captures_normals.png (the normals alone).
"""

import sys
from itertools import combinations
from pathlib import Path

import numpy as np

from mpsnet_core import Capture, InputError, LightRig, NormalMap, angular_error, estimate_normals, read_image, read_mask
from mpsnet_core.arrays.statistics import rank_correlation
from mpsnet_core.calibrate.lights import find_lights
from mpsnet_core.calibrate.photos import BallPhotos, read_sightings
from mpsnet_core.capture.decode import PhotoReadOptions
from mpsnet_core.io.image_writing import write_picture
from mpsnet_core.scene.pictures import contact_sheet, cropped, photo_picture
from mpsnet_core.scene.rig import angles_of

OUTPUT = Path(__file__).resolve().parent / "output"
OBJECTS = ("owl", "cat")
MODELS = ("lambertian", "multiscale")
LIGHTS = 12
# The files carry no such note, but their values are linear, see `tell_encoding`.
ENCODING = "linear"


def main() -> None:
    if len(sys.argv) != 2:
        raise SystemExit("give the folder that holds chrome, owl and cat: python examples/captures.py FOLDER")
    folder = Path(sys.argv[1])
    OUTPUT.mkdir(exist_ok=True)
    try:
        directions = light_directions(folder / "chrome")
        triples = disjoint_triples(directions)
        tiles, normals_alone = [], []
        for name in OBJECTS:
            shown, estimates = estimated(folder / name, directions, triples)
            tiles += shown
            normals_alone += estimates
    except InputError as error:
        raise SystemExit(f"captures: {error}") from None
    columns = 2 + len(MODELS)
    write_picture(OUTPUT / "captures.png", contact_sheet(tiles, columns))
    write_picture(OUTPUT / "captures_normals.png", contact_sheet(normals_alone, len(normals_alone) // len(OBJECTS)))
    print(f"picture sheet: {OUTPUT / 'captures.png'}")


def light_directions(folder: Path) -> np.ndarray:
    """(12, 3) by the mirror ball."""
    photos = BallPhotos(
        [folder / f"chrome.{number}.png" for number in range(LIGHTS)], options=PhotoReadOptions(ENCODING)
    )
    found = find_lights(read_sightings(photos))
    circle = found.sightings[0].ball.circle
    print(f"the ball is at {circle.x:.1f},{circle.y:.1f} with radius {circle.radius:.1f} pixels")
    slants, tilts = angles_of(found.directions)
    for number, (slant, tilt, unsure) in enumerate(zip(slants, tilts, found.uncertainties, strict=True)):
        print(f"light {number:2d}: slant {slant:5.1f}°, tilt {tilt:5.1f}°, ± {unsure:.1f}°")
    return found.directions


def disjoint_triples(directions: np.ndarray) -> list[tuple[int, int, int]]:
    """Four triples that share no light, each as far from one plane as can be for the worst of them.

    Volumes are those that the three directions span; the search takes the worst-placed lights first.
    """
    volume = {three: abs(np.linalg.det(directions[list(three)])) for three in combinations(range(LIGHTS), 3)}

    def split(left: frozenset[int], floor: float) -> list[tuple[int, int, int]] | None:
        if not left:
            return []
        first = min(left)
        for pair in combinations(sorted(left - {first}), 2):
            three = (first, *pair)
            if volume[three] >= floor:
                rest = split(left - set(three), floor)
                if rest is not None:
                    return [three, *rest]
        return None

    for floor in sorted(volume.values(), reverse=True):
        found = split(frozenset(range(LIGHTS)), floor)
        if found is not None:
            return found
    raise AssertionError("any twelve lights can be split into four triples")


def estimated(
    folder: Path, directions: np.ndarray, triples: list[tuple[int, int, int]]
) -> tuple[list[tuple[str, np.ndarray]], list[tuple[str, np.ndarray]]]:
    """Titled tiles of one object: its first shot and normals, and the normals alone. Prints how well shots agree."""
    name = folder.name
    mask = read_mask(folder / f"{name}.mask.png")
    tell_encoding(folder, directions, mask)
    photos = [read_image(folder / f"{name}.{number}.png", encoding=ENCODING) for number in range(LIGHTS)]
    white = np.stack([photo.pixels.mean(axis=-1) for photo in photos])
    captures = [
        Capture(np.moveaxis(white[list(three)], 0, -1), mask, LightRig(directions[list(three)]), clip=photos[0].clip)
        for three in triples
    ]
    reference, _ = by_twelve_lights(white, directions, mask)
    tiles = [(f"{name}, one shot", photo_picture(captures[0].image, mask))]
    for model in MODELS:
        normals = [estimate_normals(capture, model) for capture in captures]
        apart = disagreement(normals)
        errors = [angular_error(one.vectors, reference.vectors)[mask] for one in normals]
        sure = [rank_correlation(one.confidence[mask], error) for one, error in zip(normals, errors, strict=True)]
        print(
            f"{name}, {model}: shots under different lights differ by {apart:.1f}°, from twelve lights by "
            f"{np.mean(errors):.1f}°, rank correlation of confidence with that {np.mean(sure):.2f}"
        )
        tiles.append((f"{model}, shots differ by {apart:.1f}°", normals[0].picture()))
    tiles.append(("twelve lights", reference.picture()))
    tiles = list(zip([title for title, _ in tiles], cropped([tile for _, tile in tiles], mask), strict=True))
    return tiles, [(f"{name}, {title}", tile) for title, tile in tiles[1:]]


def by_twelve_lights(white: np.ndarray, directions: np.ndarray, mask: np.ndarray) -> tuple[NormalMap, float]:
    """Lambertian normals by least squares over the lights that reach a pixel, and what share stays unexplained (rms).

    white: (12, H, W). A light reaches a pixel where it is brighter than a tenth of the pixel's brightest.
    """
    values = white[:, mask]
    weight = ((values > 0.1 * values.max(axis=0)) & (values < 0.99)).astype(float)
    left = np.einsum("kp,ki,kj->pij", weight, directions, directions) + 1e-6 * np.eye(3)
    scaled = np.linalg.solve(left, np.einsum("kp,kp,ki->pi", weight, values, directions)[..., None])[..., 0]
    error = weight * (scaled @ directions.T - values.T).T
    vectors = np.zeros((*mask.shape, 3), np.float32)
    vectors[mask] = scaled
    unexplained = np.sqrt((error**2).sum() / weight.sum()) / (weight * values).sum() * weight.sum()
    return NormalMap(vectors, mask), float(unexplained)


def tell_encoding(folder: Path, directions: np.ndarray, mask: np.ndarray) -> None:
    """The files do not say how their values are meant; what a matt surface under twelve lights fits better does."""
    for encoding in ("linear", "srgb"):
        photos = [read_image(folder / f"{folder.name}.{k}.png", encoding=encoding).pixels for k in range(LIGHTS)]
        _, unexplained = by_twelve_lights(np.stack([photo.mean(axis=-1) for photo in photos]), directions, mask)
        print(f"{folder.name}, values taken as {encoding}: twelve lights leave {unexplained:.0%} unexplained")


def disagreement(normals: list[NormalMap]) -> float:
    """The mean angle between two of the estimates, in degrees, over pairs and pixels."""
    mask = normals[0].mask
    pairs = [angular_error(a.vectors, b.vectors)[mask].mean() for a, b in combinations(normals, 2)]
    return float(np.mean(pairs))


if __name__ == "__main__":
    main()
