"""Detail on top of an existing map, and detail alone, against Blender's own bake of the geometry that has it all.

A smooth ball is the low-poly. Its existing map is Blender's bake of a ball with large relief, the views are Cycles
renders of balls with fine relief, and the reference is Blender's bake of a ball with both.
"""

from pathlib import Path

import bpy
import numpy as np
from mathutils import Matrix, Vector
from synthetic import degrees_between

from mpsnet_core import NormalMap, View, read_base_map, read_mesh, write_camera, write_normals
from mpsnet_core.arrays.rasterize import texel_coordinates, triangle_of_texel
from mpsnet_core.cli import main

from .rendering import activate, array_of, save_png, set_up_cycles, simplified, with_materials
from .test_bake_against_blender import SIDES, blenders_bake, core_mesh, normal_view

SIZE = 320
FLAT = np.array([0, 0, 1.0])
# Higher than the large relief: where Blender's rays start.
EXTRUSION = 0.04


def ball(large: bool, fine: bool, phase: float = 0.0) -> "bpy.types.Object":
    """A smooth ball, about 2 across, with large relief, fine relief, both or neither. phase: of the large waves."""
    bpy.ops.mesh.primitive_ico_sphere_add(subdivisions=7)
    obj = bpy.context.object
    points = array_of(obj.data.vertices, "co", 3).astype(np.float64)
    x, y, z = points.T
    height = large * 0.02 * np.sin(9 * x + phase) * np.sin(10 * y + 1) * np.cos(9 * z)
    height = height + fine * 0.006 * np.sin(43 * x + 3) * np.sin(39 * y) * np.sin(45 * z + 1)
    obj.data.vertices.foreach_set("co", (0.95 * points * (1 + height)[:, None]).astype(np.float32).ravel())
    obj.data.update()
    obj.data.polygons.foreach_set("use_smooth", [True] * len(obj.data.polygons))
    with_materials(obj)
    return obj


def low_poly() -> "bpy.types.Object":
    smooth = ball(False, False)
    low = simplified(smooth, 5000)
    bpy.data.objects.remove(smooth)
    with_materials(low)
    return low


def bent(view: View, degrees: float, seed: int) -> View:
    """The view with its normals turned by a smooth field, `degrees` of it on average, as estimates err."""
    rng = np.random.default_rng(seed)
    y, x = np.mgrid[: view.camera.height, : view.camera.width] / view.camera.height
    waves = [np.sin(2 * np.pi * (rng.normal(0, 0.6) * x + rng.normal(0, 0.6) * y) + rng.uniform(0, 6)) for _ in "xyz"]
    field = np.stack(waves, -1)
    wrong = np.zeros_like(view.normals.vectors)
    for _ in range(10):  # in small steps, each a turn to first order
        turned = np.radians(degrees) * field / 10
        wrong = view.normals.vectors if not wrong.any() else wrong
        wrong = wrong + np.cross(turned, wrong)
    scale = degrees / degrees_between(wrong, view.normals.vectors)[view.normals.mask].mean()
    wrong = view.normals.vectors + scale * (wrong - view.normals.vectors)
    result = View(view.camera, NormalMap(wrong, view.normals.mask))
    error = degrees_between(result.normals.vectors, view.normals.vectors)[view.normals.mask]
    assert 0.9 * degrees < error.mean() < 1.1 * degrees
    return result


def photographed(obj: "bpy.types.Object", folder: Path, wrong_by: float = 0.0) -> list[str]:
    """The --view options of the object's normals as Cycles sees them from all sides."""
    options = []
    for number, side in enumerate(SIDES):
        view = normal_view(side, obj, folder / "view.exr", "ORTHO")
        if wrong_by:
            view = bent(view, wrong_by, number)
        write_camera(folder / f"camera_{number}.json", view.camera)
        write_normals(folder / f"normals_{number}.exr", view.normals)
        options += ["--view", f"{folder / f'camera_{number}.json'}={folder / f'normals_{number}.exr'}"]
    return options


def baked(low: "bpy.types.Object", views: list[str], folder: Path, *arguments: str) -> np.ndarray:
    """(S, S, 3) what the command line bakes."""
    core_mesh(low, folder / "mesh.npz")
    out = folder / "baked.png"
    good = ["bake", "--mesh", str(folder / "mesh.npz"), *views, "--size", str(SIZE), "-o", str(out)]
    assert main([*good, *arguments]) == 0
    return read_base_map(out)


def covered(folder: Path) -> np.ndarray:
    """(S, S) the texels on the low-poly's islands, once it was baked onto."""
    return triangle_of_texel(texel_coordinates(read_mesh(folder / "mesh.npz").uvs, SIZE), SIZE) >= 0


def test_each_of_two_objects_is_the_bake_of_its_own_map_and_the_detail(scene, tmp_path):
    """The photos show the relief of the first one's map, and on the second one the detail alone."""
    set_up_cycles(512)  # the objects are less than half as large in the views
    seen, references = [], []
    for number, phase in enumerate((0.0, 2.0)):
        low, large, both = low_poly(), ball(True, False, phase), ball(True, True, phase)
        present = blenders_bake(large, low, SIZE, "TANGENT", EXTRUSION)
        save_png(tmp_path / f"was_ball_{number}.png", 0.5 + 0.5 * present)
        references.append(blenders_bake(both, low, SIZE, "TANGENT", EXTRUSION))
        seen.append(both if number == 0 else ball(False, True))
        place = Matrix.LocRotScale(Vector((1.0 * number - 0.5, 0.1 * number, 0)), None, Vector([0.45] * 3))
        low.matrix_world = seen[-1].matrix_world = place
        bpy.context.view_layer.update()
        core_mesh(low, tmp_path / f"ball_{number}.npz")
    activate(*seen)
    bpy.ops.object.join()
    with_materials(seen[0])
    meshes = [word for number in range(2) for word in ("--mesh", str(tmp_path / f"ball_{number}.npz"))]
    command = ["bake", *meshes, *photographed(seen[0], tmp_path), "--size", str(SIZE)]
    for shown in ("auto", "no"):
        texture = str(tmp_path / f"{shown}_<OBJECT>.png")
        onto = ["--onto", str(tmp_path / "was_<OBJECT>.png"), "--onto-shown", shown]
        assert main([*command, *onto, "-o", texture]) == 0
        for number, reference in enumerate(references):
            mesh = read_mesh(tmp_path / f"ball_{number}.npz")
            there = triangle_of_texel(texel_coordinates(mesh.uvs, SIZE), SIZE) >= 0
            found = read_base_map(tmp_path / f"{shown}_ball_{number}.png")
            error = degrees_between(found, reference)[there & reference.any(axis=-1)]
            print(f"{shown}, ball {number}: {error.mean():.2f}° from Blender's bake of both")
            assert (error.mean() < 1.2) == (shown == "auto" or number == 1)


def test_detail_only_is_right_where_the_estimates_are_bent(scene, tmp_path):
    set_up_cycles(SIZE)
    low, fine = low_poly(), ball(False, True)
    reference = blenders_bake(fine, low, SIZE, "TANGENT", EXTRUSION)
    views = photographed(fine, tmp_path, wrong_by=8.0)
    detail_only, plain = baked(low, views, tmp_path, "--level", "0.03"), baked(low, views, tmp_path)
    there = covered(tmp_path)
    error, plain = degrees_between(detail_only, reference)[there], degrees_between(plain, reference)[there]
    print(f"detail only {error.mean():.2f}° from Blender's bake, as estimated {plain.mean():.2f}°")
    assert error.mean() < 1
    assert plain.mean() > 5
