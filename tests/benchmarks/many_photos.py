"""What many large photos cost beside their estimates, and the peak memory: 40 of 24 megapixels onto 8192 x 8192 texels.

    PYTHONPATH=tests/core/made python tests/benchmarks/many_photos.py [--megapixels 24] [--size 8192]

Estimating all of them takes long and shows nothing that one does not: a sphere looks the same from all sides, so one
photo of it is estimated, as `mpsnet views` does it, and its normals on disk are those of every other view. What the
bake takes is measured with few views, but more than memory holds, so that each is read as often as with many. From
there it goes on in a straight line, a part for the texture and a part for each view. All of it is processor time, which
what else the machine does changes less. Memory is that of the whole process, and does not depend on the number of
views.
"""

import argparse
import os
import sys
import tempfile
import time
from collections.abc import Callable
from pathlib import Path

import numpy as np
from memory import peak
from surface_shapes import sphere_mesh, upright

from mpsnet_core.bake.bake import bake_normals
from mpsnet_core.bake.feather import FEATHER
from mpsnet_core.bake.inputs import ViewReader
from mpsnet_core.bake.multi_view import CachedView, CachedViews
from mpsnet_core.bake.view_agreement import agreement
from mpsnet_core.capture.open import PhotoSet
from mpsnet_core.capture.sources import Source
from mpsnet_core.defaults import LEVEL_SCALE
from mpsnet_core.estimate.estimator import Estimator
from mpsnet_core.io.image import Image
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.mesh import Mesh
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.rays import RayScene
from mpsnet_core.scene.rig import published_rig
from mpsnet_core.scene.texture import write_texture

# So many photos, of which so many views are baked instead.
PHOTOS, FEW, MORE = 40, 3, 5


def camera_at(azimuth: float, width: int, height: int) -> Camera:
    """Beside the sphere, which almost fills the image's height."""
    pose = np.eye(4)
    pose[:3, :3] = upright((np.cos(azimuth), np.sin(azimuth), 0))
    pose[:3, 3] = 8 * pose[:3, 2]
    return Camera("perspective", width, height, [3.6 * height] * 2, None, pose)


def photo(width: int, height: int) -> Image:
    """A sphere with waves under the published rig, as such a camera sees it."""
    x, y = (np.arange(width) + 0.5 - width / 2) / height * 2.2, (height / 2 - np.arange(height) - 0.5) / height * 2.2
    pixels, mask, rig = np.zeros((height, width, 3), np.float32), np.zeros((height, width), bool), published_rig()
    for row in range(height):
        squared = x**2 + y[row] ** 2
        mask[row] = squared < 1
        normals = np.stack([x, np.full_like(x, y[row]), np.sqrt(np.maximum(1 - squared, 0))], axis=1)
        normals[:, :2] += 0.1 * np.sin(40 * np.stack([x, x + y[row]], axis=1))
        normals /= np.linalg.norm(normals, axis=1, keepdims=True)
        pixels[row] = 0.8 * np.maximum(normals @ rig.directions.T, 0)
    return Image(pixels, mask.astype(np.float32), np.inf)


def seconds(work: Callable[[], object]) -> float:
    """Of processor time."""
    start = time.process_time()
    work()
    return time.process_time() - start


def linked(folder: Path, name: str, first: CachedView) -> CachedView:
    """A view whose files are those of the first."""
    kept = CachedView(folder, name)
    for own, same in ((kept.normals, first.normals), (kept.confidence, first.confidence)):
        os.link(same, own)
    return kept


def bake_seconds(mesh: Mesh, kept: list[CachedView], cameras: list[Camera], size: int, file: Path) -> float:
    def bake() -> None:
        views = CachedViews(kept, cameras, mesh, RayScene.of(mesh), ViewReader(LEVEL_SCALE))
        write_texture(file, bake_normals(mesh, views, size=size, feather=FEATHER))

    return seconds(bake)


def main() -> int:
    parser = argparse.ArgumentParser(description=__doc__, formatter_class=argparse.RawDescriptionHelpFormatter)
    parser.add_argument("--megapixels", type=float, default=24)
    parser.add_argument("--size", type=int, default=8192)
    options = parser.parse_args()
    width = round((options.megapixels * 1e6 * 1.5) ** 0.5)
    height = round(width / 1.5)
    mesh = sphere_mesh(320, 160)
    cameras = [camera_at(2 * np.pi * number / MORE, width, height) for number in range(MORE)]
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        first = CachedView(folder, "0")
        estimator, rig = Estimator(), published_rig()
        captured = [PhotoSet().open(Source(lambda: photo(width, height), rig, camera=cameras[0]))]
        print(f"{width} x {height} pixels, {captured[0].mask.mean():.0%} object", flush=True)
        estimated = list[NormalMap]()
        alone = seconds(lambda: estimated.append(estimator(captured[0])))
        print(f"the estimate alone: {alone:.1f} s of processor time; {peak():.0f} MB at most", flush=True)
        kept = [first]
        beside = seconds(lambda: first.write(captured.pop(), estimated.pop(), "benchmark"))
        kept += [linked(folder, str(number), first) for number in range(1, MORE)]
        scene = RayScene.of(mesh)
        agreed, stored = (
            agreement(mesh, scene, FEATHER),
            CachedViews(kept, cameras, mesh, scene, ViewReader(LEVEL_SCALE)),
        )
        beside += seconds(lambda: agreed.add("0", *stored.both(0)))
        print(f"writing it, reading it again and comparing it: {beside:.1f} s; {peak():.0f} MB at most", flush=True)
        texture = folder / "texture.png"
        taken = [bake_seconds(mesh, kept[:count], cameras[:count], options.size, texture) for count in (FEW, MORE)]
    each = (taken[1] - taken[0]) / (MORE - FEW)
    once = taken[0] - FEW * each
    rest = once + PHOTOS * (each + beside)
    share = PHOTOS * alone / (PHOTOS * alone + rest)
    print(
        f"the bake: {once:.1f} s for the texture and {each:.1f} s for each view; {peak():.0f} MB at most\n"
        f"{PHOTOS} photos: {PHOTOS * alone:.0f} s of estimates and {rest:.0f} s of all else: "
        f"{share:.0%} of the speed of what the estimates alone take"
    )
    return int(share < 0.8)


if __name__ == "__main__":
    sys.exit(main())
