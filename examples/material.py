"""Flat materials from photos: cloth and leather, made up here, become textures that repeat without a seam.

Needs no file and no Blender. Leaves what `mpsnet material` writes in examples/output/material, and a contact sheet in
examples/output/material.png: for each material the photo, its normals and height, three by three tiles under a new
light, and from nearby where four tiles meet, beside the photo's own pixels laid side by side as they are.

    python examples/material.py
"""

from pathlib import Path

import numpy as np
from swatches import Swatch, leather, photographed, woven

from mpsnet_core import Capture, NormalMap, angular_error, estimate_normals, published_rig, write_image, write_rig
from mpsnet_core.estimate.registry import DEFAULT_MODEL
from mpsnet_core.io.image_writing import write_picture
from mpsnet_core.relief.material.material import Material, flat_material
from mpsnet_core.relief.material.material_files import PREVIEW_LIGHT, repeated_picture, write_material
from mpsnet_core.relief.material.tiling import measure_seam
from mpsnet_core.relief.relight import relit
from mpsnet_core.scene.normal_encoding import encode
from mpsnet_core.scene.pictures import contact_sheet, photo_picture

OUTPUT = Path(__file__).resolve().parent / "output"
PIXEL_MM = 0.1
SHAPE = 760, 920
# Not square to the camera, as photos are.
TILT = 0.06, -0.04
MODEL = "lambertian-grey-world"


def main() -> None:
    OUTPUT.mkdir(exist_ok=True)
    folder = OUTPUT / "material"
    folder.mkdir(exist_ok=True)
    rig = published_rig()
    write_rig(folder / "rig.json", rig)
    swatches = {
        "cloth": woven(SHAPE, PIXEL_MM, seed=3, thread_mm=3.4, turn=1.5),
        "leather": leather(SHAPE, PIXEL_MM, seed=6, grain_mm=5.0),
    }
    tiles = []
    for name, swatch in swatches.items():
        photo = photographed(swatch, rig, tilt=TILT, noise=0.004)
        write_image(folder / f"{name}.exr", photo)
        capture = Capture(photo, np.ones(SHAPE, bool), rig)
        normals = estimate_normals(capture, MODEL)
        material = flat_material(capture, normals, PIXEL_MM)
        write_material(folder, name, material)
        tell(name, swatch, capture, normals, material)
        tiles += pictures(name, photo, normals, material)
    write_picture(OUTPUT / "material.png", contact_sheet(tiles, columns=6))
    print(f"contact sheet: {OUTPUT / 'material.png'}")


def tell(name: str, swatch: Swatch, capture: Capture, normals: NormalMap, material: Material) -> None:
    """How right and how seamless it is, in words."""
    rows, columns = material.height.shape
    network = estimate_normals(capture, DEFAULT_MODEL)
    errors = [float(angular_error(found.vectors, swatch.normals).mean()) for found in (normals, network)]
    spread = [float(heights.std()) for heights in (material.height, swatch.height)]
    print(f"{name}: a tile of {material.width_mm:.1f} x {material.height_mm:.1f} mm ({columns} x {rows})")
    print(f"  normals wrong by {errors[0]:.1f}°, {DEFAULT_MODEL}'s by {errors[1]:.1f}° (with the photo's tilt)")
    print(f"  spread of the heights {spread[0]:.3f} mm, truth {spread[1]:.3f} mm")
    print(f"  mean albedo {means(material.albedo)}, truth {means(swatch.albedo)}")
    plain = measure_seam(normals.vectors[:rows, :columns], np.zeros((rows, columns), bool))
    for what, seam in (("joined", material.seam), ("cut out plainly", plain)):
        mean, worst = seam.border
        print(f"  step across the border, {what}: {mean:.2f} of those within, 95th percentile {worst:.2f}")


def means(albedo: np.ndarray) -> str:
    return " ".join(f"{value:.2f}" for value in albedo.mean(axis=(0, 1)))


def pictures(name: str, photo: np.ndarray, normals: NormalMap, material: Material) -> list[tuple[str, np.ndarray]]:
    """Titled tiles: photo, normals, height, the material repeated, and two ways to repeat it from nearby."""
    low, high = material.height.min(), material.height.max()
    height = np.repeat(((material.height - low) / (high - low))[..., None], 3, axis=-1)
    rows, columns = material.height.shape
    plain = normals.vectors[:rows, :columns]
    plain_albedo = photo / np.maximum(normals.vectors @ published_rig().directions.T, 0.1)
    return [
        (f"{name}: the one photo", photo_picture(photo)),
        ("seamless normals", encode(material.normals)),
        (f"height, {high - low:.2f} mm from black to white", height),
        ("3 x 3 tiles under a new light", repeated_picture(material)),
        ("where four tiles meet", corner(material.normals, material.albedo)),
        ("the photo's own pixels, side by side", corner(plain, plain_albedo[:rows, :columns])),
    ]


def corner(vectors: np.ndarray, albedo: np.ndarray) -> np.ndarray:
    """The middle of a picture of two by two tiles, relit: their corner, and half a tile around it."""
    rows, columns = vectors.shape[0] // 2, vectors.shape[1] // 2
    vectors, albedo = (np.roll(values, (rows, columns), axis=(0, 1)) for values in (vectors, albedo))
    near = slice(rows // 2, rows + rows // 2), slice(columns // 2, columns + columns // 2)
    bright = 0.9 * albedo / np.percentile(albedo, 99)
    return relit(NormalMap(vectors, np.ones(vectors.shape[:2], bool)), PREVIEW_LIGHT, albedo=bright)[near][..., :3]


if __name__ == "__main__":
    main()
