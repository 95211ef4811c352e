"""What a second photo, under white light, is worth: a painted blob's normals from one photo and from two.

Needs no file and no Blender. Leaves its picture in examples/output.

    python examples/white_photo.py
"""

from dataclasses import replace
from pathlib import Path

import numpy as np

from mpsnet_core import estimate_normals, write_image
from mpsnet_core.arrays.unit_vectors import angular_error
from mpsnet_core.learning.evaluation.colour import COLOURINGS, ROUGHNESS
from mpsnet_core.learning.evaluation.scenes import HELD_OUT_BLOB, held_out_blob, ideal_photograph, published_view
from mpsnet_core.scene.pictures import normals_picture, photo_picture
from mpsnet_core.synthesis.recipe import Material
from mpsnet_core.synthesis.reflectance import load_reflectance
from mpsnet_core.synthesis.shading.synthesise import synthesise

OUTPUT = Path(__file__).resolve().parent / "output"
SIDE = 256


def main() -> None:
    colours, pattern = COLOURINGS["hard cells"]
    materials = tuple(Material(base_color=colour, roughness=ROUGHNESS) for colour in colours)
    recipe = published_view(HELD_OUT_BLOB, materials, SIDE, pattern=pattern)
    sample = synthesise(recipe, held_out_blob(), [load_reflectance(material) for material in materials])
    both = ideal_photograph(sample, "published", white=True)
    assert both.white is not None

    pictures = [photo_picture(both.image, both.mask), photo_picture(both.white, both.mask)]
    for name, capture in (("one photo", replace(both, white=None)), ("with the white photo", both)):
        normals = estimate_normals(capture)
        pictures.append(normals_picture(normals))
        error = angular_error(normals.vectors, sample.normals)[both.mask]
        print(f"{name}: {error.mean():.1f} degrees off")
    OUTPUT.mkdir(exist_ok=True)
    write_image(OUTPUT / "white_photo.png", np.concatenate(pictures, axis=1), bits=8, color_space="sRGB")
    print(f"picture: {OUTPUT / 'white_photo.png'}")


if __name__ == "__main__":
    main()
