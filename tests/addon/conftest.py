"""Blender as pip's bpy module, with the add-on registered; every test gets a factory scene of its own."""

from collections.abc import Iterator
from pathlib import Path

import pytest

bpy = pytest.importorskip("bpy", reason="bpy is not installed")

import blender_addon


@pytest.fixture(scope="session", autouse=True)
def registered() -> Iterator[None]:
    blender_addon.register()
    yield
    blender_addon.unregister()


@pytest.fixture(autouse=True)
def scene() -> "bpy.types.Scene":
    """An empty factory scene."""
    bpy.ops.wm.read_homefile(use_factory_startup=True, use_empty=True)
    bpy.context.scene.render.threads_mode = "AUTO"
    return bpy.context.scene


@pytest.fixture
def sphere(scene: "bpy.types.Scene") -> "bpy.types.Object":
    """A matte white unit sphere with UVs, selected and active."""
    bpy.ops.mesh.primitive_uv_sphere_add(segments=128, ring_count=64)
    bpy.ops.object.shade_smooth()
    obj = bpy.context.object
    obj.data.materials.append(matte())
    return obj


def matte() -> "bpy.types.Material":
    """A white Principled BSDF without gloss: the core's Lambertian model in Blender."""
    material = bpy.data.materials.new("Matte")
    if bpy.app.version < (5, 0):
        material.use_nodes = True
    shader = next(node for node in material.node_tree.nodes if node.type == "BSDF_PRINCIPLED")
    shader.inputs["Base Color"].default_value = (0.8, 0.8, 0.8, 1)
    shader.inputs["Specular IOR Level"].default_value = 0
    return material


@pytest.fixture
def photographed(sphere: "bpy.types.Object", tmp_path: Path) -> "bpy.types.Object":
    """The sphere with a rig and its photo, 96 x 96."""
    bpy.ops.mps.add_rig()
    bpy.ops.mps.render_photo(width=96, height=96, samples=64, output=str(tmp_path / "photo.exr"))
    return sphere


@pytest.fixture
def estimated(photographed: "bpy.types.Object", tmp_path: Path) -> "bpy.types.Object":
    """The sphere with rig, photo and estimated normals."""
    bpy.ops.mps.estimate(model="LAMBERTIAN", output=str(tmp_path / "normals.png"))
    return photographed
