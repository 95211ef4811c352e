"""Scenes as AliceVision writes them."""

import json
from pathlib import Path
from typing import Any

import numpy as np
from photogrammetry_scene import TURN

CENTRE = np.array([0.3, -0.2, -6.0])

SIZE = (4092, 2048)

# One camera, of 1000 pixels across and 2000 down and the principal point 26 left of and 16 below the middle, in the
# words of each version of the file: compatibilityData/scene_v*.json of AliceVision's sources has it so.
WORDS: dict[str, dict[str, Any]] = {
    "1.2.0": {"pxFocalLength": ["1000", "2000"], "principalPoint": ["2020", "1040"]},
    "1.2.1": {"pxFocalLength": ["1000", "2000"], "principalPoint": ["-26", "16"]},
    "1.2.2": {"focalLength": "8.7976539589442808", "pixelRatio": "0.5", "principalPoint": ["-26", "16"]},
    "1.2.3": {"focalLength": "8.7976539589442808", "pixelRatio": "0.5", "principalPoint": ["-26", "16"]},
    "1.2.4": {"focalLength": "8.7976539589442808", "pixelRatio": "0.5", "principalPoint": ["-26", "16"]},
    "1.2.5": {"focalLength": "8.7976539589442808", "pixelRatio": "2", "principalPoint": ["-26", "16"]},
    "1.2.8": {"focalLength": "8.7976539589442808", "pixelRatio": "2", "principalPoint": ["-26", "16"]},
    "1.2.11": {"focalLength": "17.595307917888562", "pixelRatio": "2", "principalPoint": ["-26", "16"]},
    "1.2.14": {"focalLength": "17.595307917888562", "pixelRatio": "2", "principalPoint": ["-26", "16"]},
}

# Coefficients k1, k2, k3, t1, t2 as far as a type has them; types as old files and as newer ones call them.
COEFFICIENTS = [-0.1, 0.05, -0.001, 0.004, -0.002]

TYPES = {"radial1": ("radialk1", 1), "radial3": ("radialk3", 3), "brown": ("brown", 5)}


def scene(version: str = "1.2.8", kind: str = "pinhole", **intrinsic: Any) -> dict[str, Any]:
    """Views 11 and 12 share a pose and an intrinsic, view 13 has no pose."""
    bend, count = TYPES.get(kind, ("none", 0))
    described = {"type": kind}
    if tuple(map(int, version.split("."))) >= (1, 2, 8):
        described = {"type": "pinhole", "distortionType": bend, "undistortionType": "none"}
    return {
        "version": version.split("."),
        "featuresFolders": ["../features"],
        "views": [
            {"viewId": "12", "poseId": "7", "intrinsicId": "5", "path": "/photos/b.jpg", "metadata": {"Make": "x"}},
            {"viewId": "11", "poseId": "7", "intrinsicId": "5", "path": "/photos/a.jpg", "width": "4092"},
            {"viewId": "13", "poseId": "13", "intrinsicId": "5", "path": "/photos/not posed.jpg"},
        ],
        "intrinsics": [
            {"intrinsicId": "5", "width": str(SIZE[0]), "height": str(SIZE[1]), "sensorWidth": "36"}
            | {"distortionParams": [str(value) for value in COEFFICIENTS[:count]] or "", "locked": "0"}
            | (described | WORDS.get(version, {}) | intrinsic)
        ],
        "poses": [
            {
                "poseId": "7",
                # World to camera, column by column.
                "pose": {
                    "transform": {
                        "rotation": [repr(number) for number in TURN.T.ravel().tolist()],
                        "center": [repr(number) for number in CENTRE.tolist()],
                    },
                    "locked": "0",
                },
            }
        ],
    }


def write(folder: Path, data: object, name: str = "cameras.sfm") -> Path:
    (folder / name).write_text(json.dumps(data), encoding="utf-8")
    return folder / name
