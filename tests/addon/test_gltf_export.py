"""Textures that arrive in glTF as they left: what Blender exports, shaded here by glTF's own rules, against the shape.

Every preset, space, convention, depth and format, and UDIM tiles: right within two levels, left out, or refused.
"""

import itertools
import json
import struct
from pathlib import Path
from urllib.parse import unquote

import bpy
import numpy as np
import pytest
from mathutils import Vector
from mathutils.bvhtree import BVHTree

from blender_addon.settings.record import notes_of
from mpsnet_core import read_image

from .rendering import activate, array_of, shader_of
from .test_presets import EXPECTED, SIDE, seen

__all__ = ["seen"]
LIGHT = np.array((0.7, -0.6, 0.4)) / np.linalg.norm((0.7, -0.6, 0.4))
DEPTHS = [("PNG", "8"), ("PNG", "16"), ("TIFF", "16"), ("EXR", "32")]
TYPES = {5120: np.int8, 5121: np.uint8, 5122: np.int16, 5123: np.uint16, 5125: np.uint32, 5126: np.float32}
WIDTHS = {"SCALAR": 1, "VEC2": 2, "VEC3": 3, "VEC4": 4}


class Glb:
    """The primitives of a glTF file, in one file or with others beside it."""

    def __init__(self, path: Path) -> None:
        self.folder, data = path.parent, path.read_bytes()
        if path.suffix == ".gltf":
            self.scene = json.loads(data)
            self.binary = (self.folder / self.scene["buffers"][0]["uri"]).read_bytes()
            return
        length = struct.unpack("<I", data[12:16])[0]
        self.scene, self.binary = json.loads(data[20 : 20 + length]), data[28 + length :]

    def view(self, number: int) -> bytes:
        view = self.scene["bufferViews"][number]
        start = view.get("byteOffset", 0)
        return self.binary[start : start + view["byteLength"]]

    def accessor(self, number: int) -> np.ndarray:
        told = self.scene["accessors"][number]
        values = np.frombuffer(
            self.view(told["bufferView"]), TYPES[told["componentType"]], offset=told.get("byteOffset", 0)
        )
        return values[: told["count"] * WIDTHS[told["type"]]].reshape(told["count"], -1)

    def picture(self, material: dict) -> np.ndarray | None:
        """(H, W, 3) levels from 0 to 1 of a material's normal texture."""
        if "normalTexture" not in material:
            return None
        image = self.scene["images"][self.scene["textures"][material["normalTexture"]["index"]]["source"]]
        file = self.folder / unquote(image.get("uri", f"exported.{image['mimeType'].removeprefix('image/')}"))
        if "uri" not in image:
            file.write_bytes(self.view(image["bufferView"]))
        return read_image(file, encoding="linear").pixels

    def shaded(self, per_triangle: int = 3) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
        """Places (N, 3), their geometric normals, and the normals that a renderer of glTF shades with, all z up."""
        weights = np.random.default_rng(0).dirichlet((2, 2, 2), per_triangle)
        found: list[np.ndarray] = []
        for primitive in (one for mesh in self.scene["meshes"] for one in mesh["primitives"]):
            has = {name: self.accessor(number) for name, number in primitive["attributes"].items()}
            material = self.scene["materials"][primitive["material"]]
            triangles = self.accessor(primitive["indices"]).reshape(-1, 3)

            def mean(values: np.ndarray, triangles: np.ndarray = triangles) -> np.ndarray:
                return np.einsum("kc,tcd->tkd", weights, values[triangles]).reshape(-1, values.shape[1])

            points, normals = mean(has["POSITION"]), mean(has["NORMAL"])
            normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            geometric, picture = normals, self.picture(material)
            if picture is not None:
                uv = mean(has[f"TEXCOORD_{material['normalTexture'].get('texCoord', 0)}"])
                height, width = picture.shape[:2]
                at = (uv % 1 * (width, height)).astype(int) % (width, height)
                tangents = mean(has["TANGENT"])
                sign, along = (
                    np.sign(tangents[:, 3:]),
                    tangents[:, :3] / np.linalg.norm(tangents[:, :3], axis=1, keepdims=True),
                )
                x, y, z = (2 * picture[at[:, 1], at[:, 0]].astype(np.float64) - 1).T[..., None]
                normals = x * along + y * sign * np.cross(normals, along) + z * normals
                normals /= np.linalg.norm(normals, axis=1, keepdims=True)
            found.append(np.stack([one[:, [0, 2, 1]] * (1, -1, 1) for one in (points, geometric, normals)]))
        return tuple(np.concatenate(found, axis=1))


def true_normals(detailed: "bpy.types.Object", points: np.ndarray) -> np.ndarray:
    """The smooth normals of the detailed object at its places nearest to `points`."""
    mesh = detailed.data
    tree = BVHTree.FromPolygons([v.co for v in mesh.vertices], [tuple(p.vertices) for p in mesh.polygons])
    found = []
    for point in points:
        place, _, number, _ = tree.find_nearest(Vector(point))
        corners = [mesh.vertices[v] for v in mesh.polygons[number].vertices]
        a, b, c = (np.array(corner.co) for corner in corners)
        u, v = np.linalg.lstsq(np.stack([b - a, c - a], 1), np.array(place) - a, rcond=None)[0]
        found.append(
            (1 - u - v) * np.array(corners[0].normal)
            + u * np.array(corners[1].normal)
            + v * np.array(corners[2].normal)
        )
    return np.array(found) / np.linalg.norm(found, axis=1, keepdims=True)


class Judge:
    """How far an export of the baked object is from the detailed one, in levels of 255 under one lamp."""

    def __init__(self, low: "bpy.types.Object", folder: Path) -> None:
        self.low, self.folder = low, folder / "export"  # files beside would overwrite the baked ones
        self.folder.mkdir()

    def levels(self, **options: object) -> tuple[float, float]:
        """Of the export with its normal map, and of the same without."""
        activate(self.low)
        file = self.folder / ("exported.gltf" if options.get("export_format") == "GLTF_SEPARATE" else "exported.glb")
        bpy.ops.export_scene.gltf(filepath=str(file), use_selection=True, export_tangents=True, **options)
        points, geometric, normals = Glb(file).shaded()
        towards = np.array(SIDE) / np.linalg.norm(SIDE)
        seen = np.flatnonzero(geometric @ towards > 0.6)[::3]
        truth = true_normals(bpy.data.objects["Detailed"], points[seen])

        def apart(one: np.ndarray) -> float:
            lit = [np.clip(vectors @ LIGHT, 0, 1) for vectors in (one[seen], truth)]
            return 255 * float(np.abs(lit[0] - lit[1]).mean())

        return apart(normals), apart(geometric)


def notes() -> str:
    return "".join(notes_of(bpy.context.scene, "bake"))


def test_each_texture_is_right_in_gltf_or_left_out_and_said_so(seen, tmp_path):
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    bpy.ops.wm.read_factory_settings()  # disables add-ons in Blender; pip's bpy leaves this one registered
    bpy.ops.wm.open_mainfile(filepath=str(tmp_path / "scene.blend"))
    judge = Judge(bpy.data.objects["Old Oak"], tmp_path)
    for preset in EXPECTED:
        bpy.ops.mps.bake(preset=preset, size=1024)
        mapped, plain = judge.levels()
        print(preset, round(mapped, 2), round(plain, 2))
        assert mapped < 2 and plain > 3 * mapped, preset
    for space, convention, (kind, bits) in itertools.product(("TANGENT", "OBJECT"), ("OPENGL", "DIRECTX"), DEPTHS):
        cell = dict(space=space, convention=convention, file_format=kind, bits=bits)
        bpy.ops.mps.bake(preset="CUSTOM", size=1024, **cell)
        mapped, plain = judge.levels()
        print(cell, round(mapped, 2), round(plain, 2))
        if space == "OBJECT":
            assert mapped == pytest.approx(plain, abs=0.2), cell
        else:
            assert mapped < 2 and plain > 3 * mapped, cell
        assert ("glTF" in notes()) == (space == "OBJECT" or convention == "DIRECTX"), cell


@pytest.mark.parametrize("space", ["TANGENT", "OBJECT"])
def test_a_texture_is_turned_however_it_is_exported(seen, tmp_path, space):
    """Files beside, the original's file, other formats; two materials with one image; a node group; UDIM tiles."""
    bpy.ops.wm.save_as_mainfile(filepath=str(tmp_path / "scene.blend"))
    judge = Judge(seen, tmp_path)

    def check(what: str, **options: object) -> None:
        mapped, plain = judge.levels(**options)
        print(what, round(mapped, 2), round(plain, 2))
        assert mapped == pytest.approx(plain, abs=0.2) if space == "OBJECT" else mapped < 2 < plain / 3, what

    seen.data.materials.append(seen.data.materials[0].copy())
    for face in seen.data.polygons:
        face.material_index = face.index % 2
    bpy.ops.mps.bake(preset="UNREAL", space=space, size=1024)
    check("two materials")
    check("files beside", export_format="GLTF_SEPARATE")
    check("the original", export_format="GLTF_SEPARATE", export_keep_originals=True)
    check("jpeg", export_image_format="JPEG", export_image_quality=100, export_jpeg_quality=100)
    bpy.ops.mps.make_node_group()
    (group,) = bpy.data.node_groups
    for material in seen.data.materials:
        tree = material.node_tree
        node = tree.nodes.new("ShaderNodeGroup")
        node.node_tree = group
        tree.links.new(node.outputs["Normal"], shader_of(tree).inputs["Normal"])
    check("node group")

    seen.data.materials.pop(index=1)
    uvs = array_of(seen.data.uv_layers[0].uv, "vector", 2)
    uvs[:, 0] *= 2
    for face in seen.data.polygons:  # a face that lies in two tiles goes where its middle is
        corners = slice(face.loop_start, face.loop_start + face.loop_total)
        tile = uvs[corners, 0].mean() // 1
        uvs[corners, 0] = np.clip(uvs[corners, 0], tile + 1e-4, tile + 1 - 1e-4)
    seen.data.uv_layers[0].uv.foreach_set("vector", uvs.ravel())
    bpy.ops.mps.bake(tiles=True, size=1024, output=f"{tmp_path}/tiles/")
    assert len(list((tmp_path / "tiles").iterdir())) == 2
    check("tiles")
    seen.data.materials.append(seen.data.materials[0].copy())
    bpy.ops.mps.bake(size=32, output=f"{tmp_path}/tiles/")
    assert "several materials" in notes()  # the exporter shows those of one alone


@pytest.mark.parametrize("wrong", [{"space": "OBJECT"}, {"convention": "DIRECTX"}])
def test_the_preset_gltf_refuses_what_gltf_cannot_show(estimated, tmp_path, wrong):
    with pytest.raises(RuntimeError, match="glTF shows textures in"):
        bpy.ops.mps.bake(preset="GLTF", size=32, output=str(tmp_path / "t.png"), **wrong)
    assert not (tmp_path / "t.png").exists()
