"""Products of a photo's normal map: for each its file, its computation and its description."""

import re
from abc import ABC, abstractmethod
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TypeAlias

import numpy as np
from numpy.typing import NDArray

from mpsnet_core.errors import FileError, SettingsError
from mpsnet_core.io.files import writable_image
from mpsnet_core.io.image_writing import write_image, write_picture
from mpsnet_core.io.marks import made
from mpsnet_core.progress import Progress
from mpsnet_core.relief.curvature import check_curvature, curvature, curvature_picture, curvature_range
from mpsnet_core.relief.height_files import HeightFacts, height_files, write_height
from mpsnet_core.relief.height_map import HeightMap
from mpsnet_core.relief.height_names import height_names
from mpsnet_core.relief.occlusion import check_reach
from mpsnet_core.relief.relight import relit, turntable_sheet, turntable_tilts
from mpsnet_core.relief.surface_mesh import Up, check_surface_mesh, surface_mesh, writable_mesh, write_surface_mesh
from mpsnet_core.scene.camera import Camera
from mpsnet_core.scene.normal_map import NormalMap
from mpsnet_core.scene.rig import direction_from_angles, slant_and_tilt


@dataclass(frozen=True)
class Surface:
    """Inputs of the products, None where no requested product needs them.

    normals: of the whole photo. unit: name of the camera's unit. heights: in that unit. occlusion: (H, W). albedo:
    (H, W, 3), linear.
    """

    normals: NormalMap | None
    camera: Camera
    unit: str
    heights: HeightMap | None
    occlusion: NDArray[np.float32] | None
    albedo: NDArray[np.float32] | None


@dataclass(frozen=True)
class CurvatureFacts:
    """Facts of a curvature image. range: the curvature that is white."""

    range: float


@dataclass(frozen=True)
class OcclusionFacts:
    """Facts of an occlusion image. mean: mean fraction of ambient light that reaches the surface."""

    mean: float


@dataclass(frozen=True)
class RelitFacts:
    """Facts of relit images. tilts: of the lights, in degrees."""

    tilts: list[float]


@dataclass(frozen=True)
class MeshFacts:
    """Facts of a mesh: its vertex and face counts, and the axis that points up."""

    vertices: int
    faces: int
    up: Up


Facts: TypeAlias = HeightFacts | CurvatureFacts | OcclusionFacts | RelitFacts | MeshFacts


@dataclass(frozen=True)
class Made:
    """Files that were written, with a description and facts."""

    files: list[Path]
    words: str
    facts: Facts


@dataclass(frozen=True)
class Product(ABC):
    """Something computed from a surface, written to `path`."""

    path: Path

    @abstractmethod
    def files(self) -> list[Path]:
        """The files that it writes. Raises InputError if it cannot be made or written."""

    @abstractmethod
    def make(self, surface: Surface, progress: Progress) -> Made:
        """Compute and write it. Raises InputError if that fails."""


@dataclass(frozen=True)
class HeightPicture(Product):
    """The heights, their scale and their mask. bits: see :func:`write_height`."""

    bits: int | None

    def files(self) -> list[Path]:
        return height_files(self.path, self.bits)

    def make(self, surface: Surface, progress: Progress) -> Made:
        heights = surface.heights
        assert heights is not None
        progress(0.0, f"writing {self.path.name}")
        scale = write_height(self.path, heights, bits=self.bits, unit=surface.unit)
        inside = heights.values[heights.mask]
        facts = scale.facts(float(inside.min()), float(inside.max()))
        from_camera = "; height 0 is at the camera" if heights.camera.projection == "perspective" else ""
        files = height_names(self.path)
        return Made(files[:2] if heights.mask.all() else files, f"{scale}{from_camera}; {scale.displace_words}", facts)


@dataclass(frozen=True)
class CurvaturePicture(Product):
    """Curvature: edges bright, creases dark. radius: in pixels. range: curvature that is white, None for automatic."""

    radius: int
    range: float | None

    def files(self) -> list[Path]:
        check_curvature(self.radius, self.range)
        return _picture(self.path)

    def make(self, surface: Surface, progress: Progress) -> Made:
        normals, unit = surface.normals, surface.unit
        assert normals is not None
        depth = None if surface.heights is None else -surface.heights.values
        values = curvature(normals, surface.camera, depth, radius=self.radius, progress=progress)
        limit = self.range or curvature_range(values, normals.mask)
        if self.path.suffix.lower() == ".exr":
            words = f"the sum of both curvatures in 1 / {unit}, above 0 where convex"
            write_image(self.path, values, description=f"{made('curvature')}: {words}")
        else:
            words = f"flat is 0.5, white is convex by {limit:.6g} / {unit} (the sum of both curvatures), black concave"
            told = f"{made('curvature map')}: {words}"
            write_image(self.path, curvature_picture(values, limit), bits=16, description=told)
        return Made([self.path], words, CurvatureFacts(limit))


@dataclass(frozen=True)
class OcclusionPicture(Product):
    """Ambient occlusion. reach: greatest distance of occluders in pixels, None for no limit."""

    reach: int | None

    def files(self) -> list[Path]:
        check_reach(self.reach)
        return _picture(self.path)

    def make(self, surface: Surface, progress: Progress) -> Made:
        assert surface.occlusion is not None and surface.heights is not None
        write_image(self.path, surface.occlusion, description=made("ambient occlusion"))
        mean = float(surface.occlusion[surface.heights.mask].mean())
        return Made([self.path], f"on the mean {mean:.1%} of the light comes in", OcclusionFacts(round(mean, 4)))


@dataclass(frozen=True)
class RelitPicture(Product):
    """The surface under a white light.

    light: "SLANT,TILT" in degrees. turntable: number of lights around, None for a single image.
    """

    light: str
    turntable: int | None

    def files(self) -> list[Path]:
        """One image or, if the name has a run of #, a frame for each light of the turntable."""
        slant_and_tilt("--light", self.light)
        count = 1 if self.turntable is None else len(turntable_tilts(self.turntable, 0))
        if self.path.suffix.lower() == ".exr":
            raise FileError(f"cannot write {self.path}: a relit picture is for the screen; use .png or .tif")
        if "#" not in self.path.name:
            return _picture(self.path)
        if self.turntable is None:
            raise SettingsError(
                f"{self.path} stands for frames, and there is one light; give --turntable, or a name without #"
            )
        head, run, tail = re.split("(#+)", self.path.name, maxsplit=1)
        names = [f"{head}{number:0{len(run)}d}{tail}" for number in range(1, count + 1)]
        return [file for name in names for file in _picture(self.path.with_name(name))]

    def make(self, surface: Surface, progress: Progress) -> Made:
        slant, tilt = slant_and_tilt("--light", self.light)
        normals, occlusion, albedo = surface.normals, surface.occlusion, surface.albedo
        assert normals is not None
        files = self.files()
        tilts = [tilt] if self.turntable is None else turntable_tilts(self.turntable, tilt)
        if len(tilts) > 1 and len(files) == 1:
            progress(0.0, f"making {files[0].name}")
            sheet = turntable_sheet(normals, slant, tilts, occlusion=occlusion, albedo=albedo)
            write_picture(files[0], sheet)
        else:
            for number, (file, angle) in enumerate(zip(files, tilts, strict=True)):
                progress(number / len(files), f"making {file.name}")
                direction = direction_from_angles(slant, angle)
                picture = relit(normals, direction, occlusion=occlusion, albedo=albedo)
                write_picture(file, picture)
        around = f"{len(tilts)} lights around from" if len(tilts) > 1 else "a white light at"
        return Made(files, f"{around} slant {slant:g}°, tilt {tilt:g}°", RelitFacts(tilts))


@dataclass(frozen=True)
class MeshFile(Product):
    """The surface as a mesh.

    faces, open_from: see :func:`surface_mesh`. up: axis that points up in the camera's world. distance: of the mesh
    from an orthographic camera, None to keep its heights.
    """

    faces: int
    open_from: float | None
    up: Up
    distance: float | None

    def files(self) -> list[Path]:
        check_surface_mesh(self.faces, self.open_from)
        return [writable_mesh(self.path)]

    def make(self, surface: Surface, progress: Progress) -> Made:
        heights, normals = surface.heights, surface.normals
        assert heights is not None and normals is not None
        if surface.camera.projection == "orthographic" and self.distance is not None:
            heights = replace(heights, values=heights.values - self.distance)
        mesh = surface_mesh(heights, normals, faces=self.faces, open_from=self.open_from, progress=progress)
        progress(0.9, f"writing {self.path.name}")
        write_surface_mesh(self.path, mesh, up=self.up)
        facts = MeshFacts(len(mesh.vertices), len(mesh.triangles), self.up)
        count = "1 face" if facts.faces == 1 else f"{facts.faces} faces"
        return Made([self.path], f"{count}, in {surface.unit}", facts)


def _picture(path: Path) -> list[Path]:
    writable_image(path)
    return [path]
