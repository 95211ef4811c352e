"""A material as files: its textures, a JSON file with their scales, and a preview of it repeated."""

import os
from dataclasses import asdict
from pathlib import Path
from typing import Any

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.io.files import check_own, ensure_folder, write_json, write_transaction
from mpsnet_core.io.image import linear_to_srgb
from mpsnet_core.io.image_writing import write_image, write_picture
from mpsnet_core.io.marks import made
from mpsnet_core.relief.curvature import curvature_picture, curvature_range
from mpsnet_core.relief.material.material import Material
from mpsnet_core.relief.material.resampling import resampled
from mpsnet_core.relief.relight import relit
from mpsnet_core.scene.normal_encoding import Convention, write_vectors
from mpsnet_core.scene.normal_map import NormalMap

MATERIAL_FORMAT = "mpsnet-material"
MATERIAL_VERSION = 1
PICTURES = {
    "normal": ".png",
    "height": ".png",
    "height_mm": ".exr",
    "curvature": ".png",
    "albedo": ".png",
    "preview": ".png",
}
REPEATS = 3
PREVIEW_SIDE = 1536
# From the upper left at a low angle, which shows the relief and any seam.
PREVIEW_LIGHT = (-0.6, 0.6, 0.6)


def material_files(folder: str | os.PathLike[str], name: str) -> dict[str, Path]:
    """The files that :func:`write_material` writes, by content: the PICTURES, and "material".

    Raises FileError if one of them exists and this program did not make it.
    """
    names = {what: f"{what}{suffix}" for what, suffix in PICTURES.items()} | {"material": "material.json"}
    files = {what: Path(folder) / f"{name}_{ending}" for what, ending in names.items()}
    for file in files.values():
        check_own(file, derived=True, json_format=MATERIAL_FORMAT)
    return files


def write_material(
    folder: str | os.PathLike[str], name: str, material: Material, *, convention: Convention = "opengl"
) -> dict[str, Path]:
    """Write a material into a folder, which is created if needed. Either all files are written, or none.

    Parameters
    ----------
    folder : str or PathLike
        Folder of the files.
    name : str
        Prefix of the file names.
    material : Material
        The tile.
    convention : {"opengl", "directx"}
        Whether green in the normal map points up or down.

    Returns
    -------
    dict of str to Path
        The files of :func:`material_files`. normal: 16 bits. height: 16 bits from black, the lowest, to
        white, the highest. height_mm: float, millimetres. curvature: grey where flat, lighter where convex, over the
        range that the JSON file states. albedo: sRGB. preview: 3 x 3 tiles under a low light. material: JSON.

    Raises
    ------
    FileError
        If the folder cannot be created or written, or another file would be overwritten.
    """
    files = material_files(ensure_folder(folder, "material"), name)
    mask = np.ones(material.height.shape, bool)
    low, high = float(material.height.min()), float(material.height.max())
    bend = curvature_range(material.curvature, mask)
    description = {**_description(material, low, high, bend), "convention": convention}
    with write_transaction():
        write_json(files["material"], {**description, "files": {what: files[what].name for what in PICTURES}})
        write_vectors(files["normal"], material.normals, convention=convention)
        told = made("material")
        write_image(files["height"], (material.height - low) / max(high - low, 1e-9), description=told)
        write_image(files["height_mm"], material.height, description=told)
        write_image(files["curvature"], curvature_picture(material.curvature, bend), bits=8, description=told)
        write_picture(files["albedo"], linear_to_srgb(material.albedo))
        write_picture(files["preview"], repeated_picture(material))
    return files


def repeated_picture(material: Material) -> NDArray[np.float32]:
    """(H, W, 3) sRGB values: the tile repeated `REPEATS` times each way, reduced to its size and relit."""
    bright = max(float(np.percentile(material.albedo[::4, ::4], 99)), 1e-6)
    normals = NormalMap(material.normals, np.ones(material.height.shape, bool))
    tile = relit(normals, PREVIEW_LIGHT, albedo=material.albedo * np.float32(0.9 / bright))
    side = PREVIEW_SIDE / REPEATS / max(material.width_mm, material.height_mm)
    width, height = (max(1, round(side * length)) for length in (material.width_mm, material.height_mm))
    rows, columns = material.height.shape
    small = resampled(tile[..., :3], np.diag([columns / width, rows / height, 1.0]), (height, width), repeated=True)
    return np.clip(np.tile(small, (REPEATS, REPEATS, 1)), 0, 1)


def _description(material: Material, low: float, high: float, bend: float) -> dict[str, Any]:
    rows, columns = material.height.shape
    return {
        "format": MATERIAL_FORMAT,
        "version": MATERIAL_VERSION,
        "width_mm": material.width_mm,
        "height_mm": material.height_mm,
        "pixels": [columns, rows],
        "height_of_black_mm": low,
        "height_of_white_mm": high,
        "curvature_of_white_per_mm": bend,
        "photo": {
            "step_right": material.tiling.right.tolist(),
            "step_down": material.tiling.down.tolist(),
            "alike": list(material.tiling.correlation),
            "tilt_degrees": material.tilt,
        },
        "seam": asdict(material.seam),
    }
