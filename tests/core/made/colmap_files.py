"""Models as COLMAP writes them."""

import struct
from pathlib import Path

from photogrammetry_scene import QUATERNION

SIZE = (640, 480)

TRANSLATION = (0.3, -0.2, 6.0)

TEXT_CAMERAS = """# Camera list with one line of data per camera:
#   CAMERA_ID, MODEL, WIDTH, HEIGHT, PARAMS[]
# Number of cameras: 2
3 SIMPLE_RADIAL 640 480 500 321.5 238.25 -0.12
1 PINHOLE 64 48 50 60 32 24
"""

# The second photo has no points: its second line is empty.
TEXT_IMAGES = """# Image list with two lines of data per image:
#   IMAGE_ID, QW, QX, QY, QZ, TX, TY, TZ, CAMERA_ID, NAME
#   POINTS2D[] as (X, Y, POINT3D_ID)
# Number of images: 3, mean observations per image: 1
7 0.8 0.2 -0.4 0.4 0.3 -0.2 6 3 lit/b 2.jpg
2362.39 248.498 58396 1784.7 268.254 59027 1784.7 268.254 -1
4 1 0 0 0 0 0 0 1 lit/c.jpg

5 0 1 0 0 0 0 0 1 a.jpg
1.0 2.0 -1
"""


def write_text(folder: Path, cameras: str = TEXT_CAMERAS, images: str = TEXT_IMAGES) -> Path:
    (folder / "cameras.txt").write_text(cameras, encoding="utf-8")
    (folder / "images.txt").write_text(images, encoding="utf-8")
    return folder


def binary_cameras(*cameras: tuple[int, int, int, int, tuple[float, ...]]) -> bytes:
    packed = b"".join(struct.pack(f"<IiQQ{len(p)}d", i, m, w, h, *p) for i, m, w, h, p in cameras)
    return struct.pack("<Q", len(cameras)) + packed


def binary_images(*names: str, camera: int = 3, pose: tuple[float, ...] = (*QUATERNION, *TRANSLATION)) -> bytes:
    data = struct.pack("<Q", len(names))
    for number, name in enumerate(names):
        data += struct.pack("<I7dI", number + 1, *pose, camera) + name.encode() + b"\0"
        points = [(2362.39, 248.498, 5), (1784.7, 268.254, 2**64 - 1)][:number]
        data += struct.pack("<Q", len(points)) + b"".join(struct.pack("<ddQ", *point) for point in points)
    return data


def write_binary(folder: Path, cameras: bytes | None = None, images: bytes | None = None) -> Path:
    good = binary_cameras((3, 0, *SIZE, (500.0, 321.5, 238.25)))
    (folder / "cameras.bin").write_bytes(good if cameras is None else cameras)
    (folder / "images.bin").write_bytes(binary_images("b.jpg", "a.jpg") if images is None else images)
    return folder
