"""Pictures of what goes wrong, beside the same without the fault, for the documentation's page of symptoms.

Needs no file and no Blender. Leaves them in examples/output/symptoms.

    python examples/symptoms.py
"""

from pathlib import Path

import numpy as np
from numpy.typing import NDArray

from mpsnet_core import Capture, LightRig, NormalMap, estimate_normals, published_rig, relit
from mpsnet_core.io.image_writing import write_picture
from mpsnet_core.scene.normal_encoding import encode
from mpsnet_core.scene.pictures import on_background, photo_picture

OUTPUT = Path(__file__).resolve().parent / "output" / "symptoms"
SIDE = 256
LIGHT = (-0.6, 0.5, 0.62)  # of the relit pictures

Array = NDArray[np.float64]


def dome() -> tuple[Array, NDArray[np.bool_]]:
    """True normals (SIDE, SIDE, 3) of a dome with rings and pimples, and where it is."""
    y, x = np.mgrid[1 : -1 : SIDE * 1j, -1 : 1 : SIDE * 1j]
    radius = np.hypot(x, y)
    mask = radius < 0.92
    height = 0.55 * np.sqrt(np.clip(1 - radius**2, 0, None)) + 0.012 * np.cos(28 * radius)
    for angle in np.arange(0, 2 * np.pi, np.pi / 4):
        away = np.hypot(x - 0.55 * np.cos(angle), y - 0.55 * np.sin(angle))
        height += 0.05 * np.exp(-((away / 0.09) ** 2))
    down, across = np.gradient(height, 2 / (SIDE - 1))
    vectors = np.dstack([-across, down, np.ones_like(across)])
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True), mask


def photo_of(normals: Array, rig: LightRig) -> Array:
    """(SIDE, SIDE, 3) linear photo of a white matt surface."""
    return np.clip(normals @ rig.directions.T, 0, None)


def estimated(photo: Array, mask: NDArray[np.bool_], rig: LightRig) -> NormalMap:
    return estimate_normals(Capture(photo.astype(np.float32), mask, rig), "lambertian")


def relit_picture(normals: NormalMap) -> NDArray[np.float32]:
    picture = relit(normals, LIGHT)
    return on_background(picture[..., :3], normals.mask)


def main() -> None:
    OUTPUT.mkdir(parents=True, exist_ok=True)
    truth, mask = dome()
    rig = published_rig()
    right = NormalMap(truth, mask)
    photo = photo_of(truth, rig) * mask[..., None]

    leaning = NormalMap(truth @ turned_about_x(18).T, mask)
    side = np.where((np.mgrid[:SIDE, :SIDE][1] // 32 % 2)[..., None] > 0, [1.0, 0.25, 0.2], [0.25, 0.5, 1.0])
    painted = photo * side
    glossy = photo + 0.8 * mask[..., None] * np.clip(truth @ halfway(rig).T, 0, None) ** 60
    flipped = NormalMap(truth * [1, -1, 1], mask)
    colours = encode(truth)
    as_colour = NormalMap(unit(2 * colours**2.2 - 1), mask)
    steps = NormalMap(unit(np.round(truth * 8) / 8), mask)
    pairs = {
        "leaning": (right.picture(), leaning.picture()),
        "flat": (right.picture(), estimated(photo + 0.5, mask, rig).picture()),
        "stains": (photo_picture(painted, mask), estimated(painted, mask, rig).picture()),
        "highlights": (photo_picture(glossy, mask), estimated(glossy, mask, rig).picture()),
        "green": (relit_picture(right), relit_picture(flipped)),
        "colour_space": (relit_picture(right), relit_picture(as_colour)),
        "steps": (relit_picture(right), relit_picture(steps)),
    }
    for name, (before, after) in pairs.items():
        write_picture(OUTPUT / f"{name}.png", np.concatenate([before, after], axis=1))
    print(f"pictures: {OUTPUT}")


def turned_about_x(degrees: float) -> Array:
    sine, cosine = np.sin(np.radians(degrees)), np.cos(np.radians(degrees))
    return np.array([[1, 0, 0], [0, cosine, -sine], [0, sine, cosine]])


def halfway(rig: LightRig) -> Array:
    """(3, 3) where a mirror's normal would point for each light."""
    return unit(rig.directions + np.array([0, 0, 1]))


def unit(vectors: Array) -> Array:
    return vectors / np.linalg.norm(vectors, axis=-1, keepdims=True)


if __name__ == "__main__":
    main()
