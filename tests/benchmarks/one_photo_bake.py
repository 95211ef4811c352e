"""Where a bake of one photo loses accuracy: its texture against Cycles' own selected-to-active bake of the geometry.

    PYTHONPATH=.:tests/core/made python tests/benchmarks/one_photo_bake.py MESH... [--faces 3000] [--photo 512]

Needs pip's bpy. Each mesh (.obj or .ply) is photographed by the add-on's rig in a slightly glossy brown, and decimated
to `--faces`. The texels that the photo sees are compared, mean and median in degrees, of: the photo's true normals,
which only the projection can spoil; the estimate alone; with large shapes of the mesh (Detail Only); the default, where
they agree; and true normals and the default by the camera that `mpsnet align` finds, without a start, in place of the
true one. The first line is the estimate's error in the photo.
"""

import argparse
import tempfile
from dataclasses import replace
from pathlib import Path

import bpy
import numpy as np
from quiet import quiet

import blender_addon
from mpsnet_core import Camera, Mesh, NormalMap, View, bake_normals, correct_low_frequencies, read_camera, read_normals
from mpsnet_core.cli import main as mpsnet
from mpsnet_core.scene.rays import RayScene, mesh_hits
from tests.addon.rendering import activate, detailed_object, principled, set_up_cycles, simplified, with_materials
from tests.addon.test_bake_against_blender import blenders_bake, mesh_of

SIZE = 1024


def detailed(file: Path, folder: Path) -> "bpy.types.Object":
    if file.suffix == ".obj":
        return detailed_object(file)
    bpy.ops.wm.ply_import(filepath=str(file))
    written = write_obj(bpy.context.object, folder)
    bpy.data.objects.remove(bpy.context.object)
    return detailed_object(written)


def write_obj(mesh: "bpy.types.Object", folder: Path) -> Path:
    file = folder / "mesh.obj"
    activate(mesh)
    bpy.ops.wm.obj_export(
        filepath=str(file),
        export_selected_objects=True,
        export_triangulated_mesh=True,
        forward_axis="Y",
        up_axis="Z",
    )
    return file


def true_normals(mesh: Mesh, camera: Camera) -> NormalMap:
    row, column = np.indices((camera.height, camera.width)).reshape(2, -1)
    seen = mesh_hits(mesh, camera, RayScene.of(mesh), np.stack([column, row], axis=1) + 0.5)
    vectors, mask = np.zeros((camera.height * camera.width, 3), np.float32), np.zeros(len(row), bool)
    vectors[seen.hit], mask[seen.hit] = seen.in_camera(seen.at(mesh.corner_normals)), True
    return NormalMap(vectors.reshape(camera.height, -1, 3), mask.reshape(camera.height, -1))


def degrees(one: np.ndarray, other: np.ndarray, where: np.ndarray) -> str:
    apart = np.degrees(np.arccos(np.clip((one * other).sum(axis=-1)[where], -1, 1)))
    return f"{apart.mean():.2f}° mean, {np.median(apart):.2f}° median"


def measure(file: Path, faces: int, photo: int, folder: Path) -> None:
    with quiet():
        bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
        full = detailed(file, folder)
        low = simplified(full, faces)
        with_materials(low)
        full.data.materials.clear()
        full.data.materials.append(principled("Brown", (0.6, 0.5, 0.4), **{"Specular IOR Level": 0.3}))
        if not full.data.uv_layers:
            full.data.uv_layers.new()
        mesh, geometry = mesh_of(low), mesh_of(full)
        low.hide_render = True
        written = write_obj(low, folder)
        activate(full)
        bpy.ops.mps.add_rig(projection="PERSPECTIVE", focal_length=60)
        bpy.context.scene.mps.rig.target.rotation_euler.rotate_axis("Y", 0.3)
        bpy.ops.mps.render_photo(width=photo, height=photo, samples=16, output=str(folder / "photo.exr"))
        set_up_cycles(photo)
        reference = blenders_bake(full, low, SIZE, "TANGENT", 0.05)
        true, found = folder / "photo.camera.json", folder / "found.json"
        run_on_photo("align", folder, found, "--mesh", written)
        for one in (true, found):
            run_on_photo("estimate", folder, one.with_suffix(".exr"), "--camera", one)
    (camera, normals), (aligned, again) = (
        (read_camera(one), read_normals(one.with_suffix(".exr"))) for one in (true, found)
    )
    truth, alone = true_normals(geometry, camera), replace(normals, confidence=np.ones((), np.float32))
    print(f"{file.name}, {len(geometry.triangles)} faces onto {len(mesh.triangles)}")
    print(f"  in the photo: {degrees(normals.vectors, truth.vectors, truth.mask & normals.mask)}")
    detail, default = (correct_low_frequencies(normals, camera, mesh, agreed=agreed) for agreed in (False, True))
    for name, *view in (
        ("true normals", camera, truth),
        ("estimate alone", camera, alone),
        ("detail only", camera, replace(detail, confidence=np.ones((), np.float32))),
        ("default", camera, default),
        ("true normals, aligned", aligned, truth),
        ("default, aligned", aligned, correct_low_frequencies(again, aligned, mesh, agreed=True)),
    ):
        texture = bake_normals(mesh, [View(*view)], size=SIZE, margin=0)
        print(f"  {name}: {degrees(texture.vectors, reference, texture.seen & reference.any(axis=-1))}", flush=True)


def run_on_photo(command: str, folder: Path, output: Path, *options: str | Path) -> None:
    given = command, folder / "photo.exr", "--rig", folder / "photo.rig.json", "--overwrite", "-o", output, *options
    assert mpsnet([*map(str, given)]) == 0


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("mesh", nargs="+", type=Path)
    parser.add_argument("--faces", type=int, default=3000)
    parser.add_argument("--photo", type=int, default=512)
    arguments = parser.parse_args()
    blender_addon.register()
    with tempfile.TemporaryDirectory() as folder:
        for file in arguments.mesh:
            measure(file, arguments.faces, arguments.photo, Path(folder))


if __name__ == "__main__":
    main()
