"""What filling in a camera's mosaic costs: normals from raw files by LibRaw's methods, relief and paint apart.

PYTHONPATH=tests/core/made python tests/benchmarks/demosaicing.py

A matt ball under three lights of one colour each is seen through a Bayer mosaic with a sensor's noise: once with
ripples in its normals every 9 pixels, once smooth with painted squares of 20 pixels that reflect a third of the rest.
The angle is that between equation 2 on the filled-in photo and on the photo as it was before the mosaic, where all
lights reach. The lens blurs by a Gaussian of 0.8 pixels. Needs rawpy (pip install '.[raw]').
"""

import tempfile
from pathlib import Path

import numpy as np
from dng import filled_in, mosaic, write_dng
from synthetic import degrees_between, shaded_sphere

from mpsnet_core.arrays.gaussian import gaussian

SIDE, FINE = 256, 3
METHODS = ("LINEAR", "AHD", "DCB", "PPG", "VNG", "DHT", "AAHD")


def scene(what: str) -> tuple[np.ndarray, np.ndarray]:
    """(SIDE, SIDE, 3) the light on the sensor and (SIDE, SIDE) where all three lights reach."""
    sphere = shaded_sphere(SIDE * FINE)
    y, x = np.mgrid[: SIDE * FINE, : SIDE * FINE] / FINE
    normals, albedo = sphere.normals, 0.8
    if what == "relief":
        x, y = x * 2 * np.pi / 9, y * 2 * np.pi / 9
        normals = normals + 0.18 * np.stack([np.cos(x + 0.3 * y), np.cos(0.9 * y - 0.4 * x), 0 * x], axis=-1)
        normals /= np.linalg.norm(normals, axis=-1, keepdims=True)
    else:
        x, y = x + 0.3 * y, y - 0.3 * x
        albedo = 0.8 * np.where((x // 20 + y // 20) % 2, 1, 0.35)[..., None]
    light = np.maximum(normals @ sphere.rig.directions.T, 0) * sphere.mask[..., None] * albedo
    image = light.reshape(SIDE, FINE, SIDE, FINE, 3).mean(axis=(1, 3))
    lit = np.lib.stride_tricks.sliding_window_view(np.pad((image > 0.02).all(axis=-1), 4), (9, 9)).all(axis=(2, 3))
    return image, lit


def main() -> None:
    rng, lights = np.random.default_rng(0), np.linalg.inv(shaded_sphere(8).rig.directions).T
    print("method   " + "".join(f"{what:>10}" for what in ("relief", "paint")))
    photos = {}
    with tempfile.TemporaryDirectory() as folder:
        for what in ("relief", "paint"):
            image, lit = scene(what)
            image = gaussian(image, 0.8, (0, 1))
            sites = mosaic(image)
            sites = sites + rng.normal(size=sites.shape) * np.sqrt(sites / 20000 + 0.0003**2)
            path = Path(folder) / f"{what}.dng"
            write_dng(path, np.rint(np.clip(512 + sites * 15871, 0, 16383)), black=512, white=16383)
            photos[what] = path, image @ lights, lit
        for method in METHODS:
            errors = []
            for path, truth, lit in photos.values():
                errors.append(degrees_between(filled_in(path, method) @ lights, truth)[lit].mean())
            print(f"{method:9}" + "".join(f"{error:9.2f}°" for error in errors))


if __name__ == "__main__":
    main()
