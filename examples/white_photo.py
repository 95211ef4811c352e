"""What a second photo, under white light, is worth: a painted blob's normals from one photo and from two.

Needs no file and no Blender. Leaves its picture in examples/output.

    python examples/white_photo.py
"""

from pathlib import Path

import numpy as np

from mpsnet_core import estimate_normals
from mpsnet_core.arrays.unit_vectors import angular_error
from mpsnet_core.io.image_writing import write_picture
from mpsnet_core.learning.evaluation.colour import painted_blob
from mpsnet_core.scene.pictures import photo_picture

OUTPUT = Path(__file__).resolve().parent / "output"
SIDE = 256


def main() -> None:
    alone, both = (painted_blob("hard cells", "published", SIDE, white=white) for white in (False, True))
    assert both.capture.white is not None
    mask = both.capture.mask
    pictures = [photo_picture(photo, mask) for photo in (both.capture.image, both.capture.white)]
    for name, case in (("one photo", alone), ("with the white photo", both)):
        normals = estimate_normals(case.capture)
        pictures.append(normals.picture())
        error = angular_error(normals.vectors, case.truth)[case.scored]
        print(f"{name}: {error.mean():.1f} degrees off")
    OUTPUT.mkdir(exist_ok=True)
    write_picture(OUTPUT / "white_photo.png", np.concatenate(pictures, axis=1))
    print(f"picture: {OUTPUT / 'white_photo.png'}")


if __name__ == "__main__":
    main()
