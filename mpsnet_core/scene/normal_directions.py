"""Whether a normal map is in camera space, and its red and green channels point the right way."""

import logging

from mpsnet_core.arrays.orientation import blocks_of, is_round, orientation_measures, probabilities
from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.errors import GeometryError
from mpsnet_core.scene.normal_map import OUTWARDS_SHARE, NormalMap

log = logging.getLogger(__name__)

# A map is wrong if its probability is below WRONG, and another one and the same turned by 180° have one above SURE.
WRONG, SURE = 0.005, 0.8
GREEN = "its green channel points the other way: set the convention of these normals, opengl or directx"
# What is wrong with a map that fits when turned by each of `mpsnet_core.arrays.orientation.TURNS`.
WORDS = (
    "",
    "its red channel points the other way: invert it",
    GREEN,
    "its red and green channels point the other way: invert both",
    "its red and green channels are exchanged, and one of them points the other way",
    "its red and green channels are exchanged, and one of them points the other way",
    "its red and green channels are exchanged",
    "its red and green channels are exchanged, and both point the other way",
)
# The same turned by 180°, by number; only the outline of a round object tells which. Then the likelier one is named.
TURNED_BY_180 = (3, 2, 1, 0, 5, 4, 7, 6)
LIKELIER = (0, 2, 2, 0, 4, 4, 6, 6)


def check_directions(normals: NormalMap, name: str, *, warned: bool = False) -> None:
    """Check the normals of a map that is said to be in camera space.

    Logs a warning if the map fits a surface only with red or green inverted or exchanged. name: of the map, for
    messages. warned: whether another map of the same sequence showed whether that is so.

    Raises GeometryError if many normals point away from the camera.
    """
    if (normals.vectors[normals.mask, 2] >= 0).mean() < OUTWARDS_SHARE:
        raise GeometryError(
            f"{name} is not in camera space: many of its normals point away from the camera; give a photo's normals, "
            "or for a texture its mesh with --uvs"
        )
    words = "" if warned else wrong_directions(normals)
    if words:
        log.warning("%s fits no surface as it is: %s [normal-directions]", name, words)


def wrong_directions(normals: NormalMap) -> str:
    """What is wrong with the red and green channels of a map in camera space; empty unless that is sure."""
    blocks = blocks_of(normals.vectors, normals.mask)
    if blocks is None:
        return ""
    measures = orientation_measures(normalised(blocks.values), blocks.whole, blocks.outline)
    shares = probabilities(measures)
    best = int(shares.argmax())
    if shares[0] >= WRONG or shares[best] + shares[TURNED_BY_180[best]] <= SURE or not measures[best, 1]:
        return ""
    return WORDS[best if is_round(measures[best]) else LIKELIER[best]]
