"""The operations ``integrate`` (products of a normal map) and ``material`` (a seamless material from a photo)."""

import logging
from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal, TypeVar

from mpsnet_core.capture.operations import HasLens, HasViewpoint, ReadsPhotos
from mpsnet_core.defaults import (
    BEND,
    CONVENTIONS,
    CURVATURE_RADIUS,
    FACES,
    MARGIN,
    MAX_BEND,
    MAX_BUMPS,
    MAX_FACES,
    MAX_MATERIAL_SIZE,
    MAX_OVERLAP,
    MAX_TEXTURE_SIZE,
    MIN_MATERIAL_SIZE,
    MIN_OVERLAP,
    OVERLAP,
)
from mpsnet_core.errors import SettingsError
from mpsnet_core.estimate.operations import RunsModel
from mpsnet_core.estimate.registry import LAMBERTIAN_GREY_WORLD
from mpsnet_core.operation import Operation, Result, option, settings
from mpsnet_core.progress import Progress, part, silent

if TYPE_CHECKING:
    import numpy as np
    from numpy.typing import NDArray

    from mpsnet_core.capture.capture import Capture
    from mpsnet_core.relief.displacement.displacement_files import HeightsOnUVs
    from mpsnet_core.relief.height_files import HeightFacts
    from mpsnet_core.relief.products import CurvatureFacts, MeshFacts, OcclusionFacts, Product, RelitFacts, Surface
    from mpsnet_core.scene.camera import Camera
    from mpsnet_core.scene.normal_map import NormalMap

log = logging.getLogger(__name__)

T = TypeVar("T", bound="np.generic")

# Options that apply to a photo's normal map only.
_OF_PHOTOS = ("camera", "focal", "pixel_size", "distance", "method", "mesh", "curvature", "occlusion", "relit")
# Options that have no effect without another one.
_NEEDED = {
    "height_bits": "height",
    **dict.fromkeys(("faces", "open", "up"), "mesh"),
    **dict.fromkeys(("curvature_radius", "curvature_range"), "curvature"),
    "occlusion_reach": "occlusion",
    **dict.fromkeys(("light", "albedo", "turntable"), "relit"),
    **dict.fromkeys(("space", "base", "object_space", "scale", "mean", "margin"), "uvs"),
}
_ONE_SCALE = "give one of --width, --pixel-size or --ruler"


@dataclass(frozen=True)
class SurfaceMade(Result):
    """The products of a photo's normals.

    outputs: the files. unit: name of the unit of all values. height, curvature, occlusion, relit, mesh: the facts of
    each requested product.
    """

    outputs: list[str]
    unit: str
    height: "HeightFacts | None" = None
    curvature: "CurvatureFacts | None" = None
    occlusion: "OcclusionFacts | None" = None
    relit: "RelitFacts | None" = None
    mesh: "MeshFacts | None" = None


@dataclass(frozen=True)
class HasScale(HasLens):
    """A photo's camera and unit."""

    heading: ClassVar[str] = "the photo's camera, and the unit"

    pixel_size: float | None = option(
        default=None, metavar="S", help="size of a pixel in an orthographic view, in place of a camera file", unset="1"
    )
    distance: float | None = option(
        default=None,
        help="mean distance from the camera to the visible surface, in the unit of the heights: it sets a perspective "
        "camera's scale, and where an orthographic camera's mesh stands",
        unset="1 for a perspective camera",
    )
    unit: str | None = option(default=None, help="name of the unit of these lengths, such as mm")


@dataclass(frozen=True)
class MakesProducts(Operation):
    """The products of a photo's normals."""

    heading: ClassVar[str] = "what to make, at least one"

    height: str | None = option(
        default=None,
        metavar="FILE",
        help="height map: .exr with float heights, or .png or .tif with 16 bits; FILE.json holds the heights of "
        "black and white",
        provenance="none",
    )
    height_bits: int | None = option(default=None, metavar="BITS", help="32 writes float heights into .tif")
    mesh: str | None = option(
        default=None,
        metavar=".ply|.glb|.obj",
        help="make a mesh of the surface, where the photo's camera saw it, with the photo's UVs",
        provenance="none",
    )
    faces: int = option(
        default=FACES,
        low=1,
        high=MAX_FACES,
        help="how many faces the mesh may have at most; they are smaller where the surface bends",
    )
    open: float | None = option(
        default=None,
        metavar="ANGLE",
        help="leave out faces whose normals are further than this from the line of sight, such as 85",
    )
    up: Literal["y", "z"] | None = option(
        default=None,
        choices={"y": "", "z": ""},
        help="axis that points up in the camera's world, for .glb and .obj",
        unset="z with a camera file, else y",
    )
    curvature: str | None = option(
        default=None,
        metavar="FILE",
        help="curvature map: edges are bright, creases dark",
        provenance="none",
    )
    curvature_radius: int = option(
        default=CURVATURE_RADIUS, metavar="PIXELS", help="the broadest shapes that the curvature map shows"
    )
    curvature_range: float | None = option(
        default=None,
        metavar="C",
        help="curvature per unit that is white; .exr holds the sum of both principal curvatures",
    )
    occlusion: str | None = option(
        default=None,
        metavar="FILE",
        help="ambient occlusion map: white where the surface is fully open to light",
        provenance="none",
    )
    occlusion_reach: int | None = option(
        default=None, metavar="PIXELS", help="how far the ambient occlusion reaches", unset="everywhere"
    )
    relit: str | None = option(
        default=None,
        metavar="FILE",
        help="image of the surface under a white light, with the ambient occlusion if that is made",
        provenance="none",
    )
    light: str = option(
        default="45,135", metavar="SLANT,TILT", help="direction of that light, in degrees", numbers=True
    )
    albedo: str | None = option(
        default=None, metavar="PHOTO", help="the surface's colour for --relit", unset="light grey", provenance="files"
    )
    turntable: int | None = option(
        default=None,
        metavar="N",
        help="move the light around in N steps: on one sheet, or as frames if FILE has ####",
    )


@dataclass(frozen=True)
class DisplacesMesh(Operation):
    """How the heights of a texture on a mesh's UVs are computed."""

    heading: ClassVar[str] = "heights on a mesh's UVs, from a baked normal texture"

    uvs: str | None = option(
        default=None,
        metavar="MESH",
        help="mesh that the texture was baked onto; needs --height. For tiles, both names hold <UDIM>",
        provenance="content",
    )
    space: Literal["tangent", "object"] = option(
        default="tangent",
        choices={"tangent": "to the surface, by MikkTSpace", "object": "to the object"},
        help="what the texture's normals are relative to",
    )
    base: str | None = option(
        default=None,
        metavar="MESH",
        help="mesh to displace, if it is the same one subdivided",
        provenance="content",
    )
    object_space: str | None = option(
        default=None,
        metavar="FILE",
        help="also write the texture in object space, which shades the displaced surface",
        path="file",
        provenance="none",
    )
    scale: float = option(
        default=0.0,
        low=0,
        high=MAX_BUMPS,
        help="broadest bumps that heights on UVs keep, as a fraction of the object's size: broader shapes are "
        "left to the mesh, because estimated normals err most there. 0 keeps all",
    )
    mean: float | None = option(default=None, help="mean of the heights", unset="the surface stays where it is")
    margin: int = option(
        default=MARGIN,
        low=0,
        high=MAX_TEXTURE_SIZE,
        help="pixels by which the heights extend beyond the UV islands",
    )


@dataclass(frozen=True)
class Integrate(DisplacesMesh, MakesProducts, HasScale):
    """Make heights, a mesh, curvature and more from a normal map."""

    command: ClassVar[str] = "integrate"

    normals: str = option(
        positional=True,
        help="normal map in camera space, as `mpsnet estimate` writes it; or with --uvs a texture",
        provenance="files",
    )
    convention: Literal["opengl", "directx"] = option(
        default="opengl", choices=CONVENTIONS, help="which way the green channel of the normal map points"
    )
    method: Literal["fast", "bilateral"] = option(
        default="fast",
        choices={
            "fast": "one surface without gaps: for one object, reliefs, cloth",
            "bilateral": "the surface breaks where one object occludes another; takes several times as long",
        },
        help="whether the surface may break",
    )

    def run(self, progress: Progress = silent) -> "SurfaceMade | HeightsOnUVs":
        """Write the requested products, or the heights on a mesh's UVs."""
        self._check_together()
        if self.uvs is None:
            return self._of_photo(progress)
        if self.height is None:
            raise SettingsError("--uvs makes heights; name their file with --height")
        from mpsnet_core.relief.displacement.displacement_files import BakedNormals, HeightTarget, write_displacement

        return write_displacement(
            BakedNormals(self.normals, self.uvs, self.space, self.convention),
            HeightTarget(self.height, self.object_space, self.height_bits, self.unit or "unit"),
            base=self.base,
            scale=self.scale,
            mean=self.mean,
            margin=self.margin,
            progress=progress,
        )

    def _check_together(self) -> None:
        """Raise SettingsError if an option is set that has no effect with the others."""
        given = {
            setting.name: setting.flags[-1]
            for setting in settings(type(self))
            if getattr(self, setting.name) != setting.default
        }
        for name in _OF_PHOTOS if self.uvs else ():
            if name in given:
                raise SettingsError(f"{given[name]} goes with a photo's normals, not with --uvs; leave it out")
        for name, needed in _NEEDED.items():
            if name in given and not getattr(self, needed):
                raise SettingsError(
                    f"{given[name]} goes with --{needed}, which is not given; leave it out, or give both"
                )

    def _of_photo(self, progress: Progress) -> SurfaceMade:
        from mpsnet_core.io.files import write_transaction
        from mpsnet_core.relief.surface_mesh import NoFaceError

        products = self._products()
        progress(0.0, f"reading {Path(self.normals).name}")
        surface = self._surface(part(progress, 0.05, 0.75))
        outputs: list[str] = []
        facts: dict[str, Any] = {}
        lines, no_mesh = [], None
        with write_transaction():
            for number, (name, product) in enumerate(products.items()):
                first, last = (0.75 + 0.25 * (number + end) / len(products) for end in (0, 1))
                try:
                    made = product.make(surface, part(progress, first, last))
                except NoFaceError as error:  # not known before; the other products are kept
                    no_mesh = error
                    continue
                outputs += map(str, made.files)
                facts[name] = made.facts
                lines.append(f"{product.path}: {made.words}")
        if no_mesh is not None:
            raise no_mesh
        progress(1.0, "done")
        return SurfaceMade(outputs, surface.unit, **facts, text="\n".join(lines))

    def _products(self) -> "dict[str, Product]":
        """The requested products by option. Raises InputError if there are none, or one cannot be made or written."""
        from mpsnet_core.io.files import check_no_overwrite
        from mpsnet_core.io.frames import is_folder_or_pattern
        from mpsnet_core.relief.products import (
            CurvaturePicture,
            HeightPicture,
            MeshFile,
            OcclusionPicture,
            RelitPicture,
        )
        from mpsnet_core.scene.texture_names import check_one_texture

        for file in (self.normals, self.height or ""):
            check_one_texture(file)
        up = self.up or ("z" if self.camera else "y")
        kinds: dict[str, Callable[[Path], Product]] = {
            "height": lambda path: HeightPicture(path, self.height_bits),
            "curvature": lambda path: CurvaturePicture(path, self.curvature_radius, self.curvature_range),
            "occlusion": lambda path: OcclusionPicture(path, self.occlusion_reach),
            "relit": lambda path: RelitPicture(path, self.light, self.turntable),
            "mesh": lambda path: MeshFile(path, self.faces, self.open, up, self.distance),
        }
        requested = {name: kind(Path(file)) for name, kind in kinds.items() if (file := getattr(self, name))}
        if not requested:
            wanted = ", ".join(f"--{name}" for name in kinds)
            raise SettingsError(f"nothing is requested; give at least one of {wanted} with a file")
        if is_folder_or_pattern(self.normals):
            raise SettingsError(f"{self.normals} matches several normal maps; integrate them one by one")
        taken = [Path(file) for file in (self.normals, self.camera, self.albedo) if file]
        for product in requested.values():
            files = product.files()
            check_no_overwrite(taken, files)
            taken += files
        return requested

    def _read_normals(self) -> "NormalMap":
        from mpsnet_core.io.files import prefix_errors
        from mpsnet_core.relief.surface_mesh import check_has_faces
        from mpsnet_core.scene.normal_directions import check_directions
        from mpsnet_core.scene.normal_map import read_normals

        normals = read_normals(self.normals, convention=self.convention)
        check_directions(normals, self.normals)
        if self.mesh:
            with prefix_errors(self.normals):
                check_has_faces(normals.mask)
        return normals

    def _surface(self, progress: Progress) -> "Surface":
        """The inputs that the requested products need."""
        from mpsnet_core.io.image_reading import read_image
        from mpsnet_core.relief.height_map import HeightMap
        from mpsnet_core.relief.integration.integrate import grained_box, integrate
        from mpsnet_core.relief.occlusion import ambient_occlusion
        from mpsnet_core.relief.products import Surface
        from mpsnet_core.relief.sizes import check_size
        from mpsnet_core.scene.camera import pixel_camera

        normals = self._read_normals()
        height, width = normals.mask.shape
        given = self._camera(height, width)
        camera = given or pixel_camera(width, height)
        if self.distance is not None and not 0 < self.distance < float("inf"):
            raise SettingsError(f"--distance {self.distance:g} cannot be used; give a number above 0")
        if self.distance is not None and not (self.camera or self.focal or self.mesh):
            raise SettingsError("--distance goes with --camera, --focal or --mesh; give one, or leave it out")
        albedo = read_image(self.albedo).pixels if self.relit and self.albedo else None
        if albedo is not None:
            check_size("albedo", albedo.shape, normals)
        kept = normals if self.curvature or self.relit or self.mesh else None
        heights = occlusion = None
        bent = self.curvature and camera.projection == "perspective"
        if self.height or self.mesh or self.occlusion or bent:
            if camera.projection == "perspective" and self.distance is None:
                log.info("--distance is not given: the mean distance from the camera counts as 1 [no-distance]")
            to_occlusion = 0.5 if self.occlusion else 1.0
            box = grained_box(normals.mask) if kept is None else (slice(0, height), slice(0, width))
            if kept is None:
                normals = _cropped(normals, box)  # the rest is released: a large photo's takes much memory
            heights = integrate(
                normals,
                camera.cropped(box[1].start, box[0].start, *normals.mask.shape[::-1]),
                method=self.method,
                distance=self.distance if camera.projection == "perspective" else None,
                progress=part(progress, 0.0, to_occlusion),
            )
            if self.occlusion:
                occlusion = ambient_occlusion(
                    heights, normals, reach=self.occlusion_reach, progress=part(progress, to_occlusion, 1.0)
                )
                occlusion = _placed(occlusion, box, (height, width), 1)
            del normals
            values = _placed(heights.values, box, (height, width), 0)
            heights = HeightMap(values, _placed(heights.mask, box, (height, width), 0), camera)
        return Surface(kept, camera, self.unit or ("unit" if given else "pixel"), heights, occlusion, albedo)

    def _camera(self, height: int, width: int) -> "Camera | None":
        """The camera of a photo of that size, None if the options define none."""
        import numpy as np

        from mpsnet_core.io.files import prefix_errors
        from mpsnet_core.scene.camera import Camera, camera_for

        lens = self.lens()
        if self.pixel_size is None or lens is not None:
            if self.pixel_size is not None:
                raise SettingsError("--pixel-size, --camera and --focal define the same camera; give one of them")
            with prefix_errors(self.normals):
                return camera_for(lens, width, height)
        if not 0 < self.pixel_size < float("inf"):
            raise SettingsError(f"--pixel-size {self.pixel_size:g} cannot be used; give a number above 0")
        return Camera("orthographic", width, height, np.full(2, 1 / self.pixel_size))


def _cropped(normals: "NormalMap", box: tuple[slice, slice]) -> "NormalMap":
    """A copy of a part of the normals. Their confidence is the mask, which takes no memory of its own."""
    from mpsnet_core.scene.normal_map import NormalMap

    mask = normals.mask[box].copy()
    return NormalMap(normals.vectors[box].copy(), mask, mask, in_place=True)  # type: ignore[arg-type]


def _placed(values: "NDArray[T]", box: tuple[slice, slice], shape: tuple[int, int], outside: float) -> "NDArray[T]":
    """The values of a part of an image of `shape`, and `outside` around it."""
    import numpy as np

    whole = np.full(shape, outside, values.dtype)
    whole[box] = values
    return whole


@dataclass(frozen=True)
class MaterialMade(Result):
    """The textures of a flat material.

    files: by content. width_mm, height_mm: size of the tile. relief_mm: depth of its relief. seam: the step of the
    normals across the tile's border, divided by that between other neighbours.
    """

    files: dict[str, str]
    width_mm: float
    height_mm: float
    relief_mm: float
    seam: float


@dataclass(frozen=True)
class MeasuresPhoto(Operation):
    """The scale of the photo."""

    heading: ClassVar[str] = "its size, one of these"

    width: str | None = option(
        default=None, metavar="LENGTH", help="what the photo's whole width measures: 120mm, 12cm, 4.5in", numbers=True
    )
    pixel_size: str | None = option(
        default=None, metavar="LENGTH", help="in place of --width, what a pixel measures: 0.05mm", numbers=True
    )
    ruler: str | None = option(
        default=None,
        metavar="X1,Y1,X2,Y2=LENGTH",
        help="in place of --width, the distance between two places in pixels: 120,80,1620,95=50mm",
    )

    def _scale(self) -> tuple[float, float | None]:
        """A length in millimetres, and in pixels of the photo; None for the photo's width, which is not yet known."""
        from mpsnet_core.relief.material.scale import millimetres, parse_ruler

        if sum(given is not None for given in (self.width, self.pixel_size, self.ruler)) > 1:
            raise SettingsError(f"several options state the material's size; {_ONE_SCALE}")
        if self.width is not None:
            return millimetres(self.width), None
        if self.pixel_size is not None:
            return millimetres(self.pixel_size), 1.0
        if self.ruler is not None:
            ruler = parse_ruler(self.ruler)
            return ruler.length_mm, ruler.pixels
        raise SettingsError(f"no option states the material's size; {_ONE_SCALE}")


@dataclass(frozen=True)
class MakeMaterial(MeasuresPhoto, RunsModel, HasViewpoint, ReadsPhotos):
    """Make seamless textures from a photo of cloth, leather or bark."""

    command: ClassVar[str] = "material"

    image: str = option(
        positional=True, help="photo of a flat material that fills the photo, or its --crop", provenance="files"
    )
    rig: str = option(help="rig file (.json, or .lp with three lights)", provenance="content")
    # On cloth and leather, matt and lit by all three lights, equation 2 recovers more than networks trained on whole
    # objects.
    model: str = option(
        default=LAMBERTIAN_GREY_WORLD,
        help="model that estimates the normals, by name or as an .onnx file",
    )
    crop: str | None = option(
        default=None, metavar="X,Y,W,H", help="the part of the photo to use, from its upper left corner", numbers=True
    )
    size: int | None = option(
        default=None,
        low=MIN_MATERIAL_SIZE,
        high=MAX_MATERIAL_SIZE,
        help="width and height of the textures in pixels",
        unset="the photo's own resolution",
    )
    overlap: float = option(
        default=OVERLAP,
        low=MIN_OVERLAP,
        high=MAX_OVERLAP,
        help="fraction of the tile over which its borders blend: more hides the seam better but leaves a smaller tile",
    )
    bend: int = option(
        default=BEND,
        low=0,
        high=MAX_BEND,
        help="how many half waves across the photo to remove as bends of the material and uneven light. 0: "
        "only the tilt of the photo",
    )
    grey: bool = option(default=False, help="make the albedo grey, for lights of unknown strengths")
    convention: Literal["opengl", "directx"] = option(
        default="opengl", choices=CONVENTIONS, help="which way the green channel of the normals points"
    )
    name: str | None = option(default=None, help="prefix of the file names", unset="the photo's name")
    output: str = option(metavar="FOLDER", help="folder for the textures", path="folder", provenance="none")

    def run(self, progress: Progress = silent) -> MaterialMade:
        """Write the material's textures into the folder."""
        from mpsnet_core.io.files import check_no_overwrite, creatable_folder
        from mpsnet_core.relief.material.material import check_material, flat_material
        from mpsnet_core.relief.material.material_files import material_files, write_material
        from mpsnet_core.relief.material.scale import parse_crop

        check_material(self.size, self.overlap, self.bend)
        crop = parse_crop(self.crop) if self.crop else None
        length_mm, pixels = self._scale()
        name = self._checked_name()
        folder = creatable_folder(self.output, "material")
        inputs = self.inputs(self.image, self.rig, self.camera, self.mesh)
        check_no_overwrite(inputs, material_files(folder, name).values())
        estimator = self.estimator()
        progress(0.0, f"reading {Path(self.image).name}")
        capture, pixel_mm = self._capture(length_mm, pixels, crop)
        material = flat_material(
            capture,
            estimator(capture, part(progress, 0.05, 0.5)),
            pixel_mm,
            size=self.size,
            overlap=self.overlap,
            bend=self.bend,
            grey=self.grey,
            progress=part(progress, 0.5, 0.85),
        )
        progress(0.85, f"writing {folder.name}")
        files = write_material(folder, name, material, convention=self.convention)
        progress(1.0, "done")
        rows, columns = material.height.shape
        deep, seam = float(material.height.max()) - float(material.height.min()), material.seam.border[0]
        size = f"{material.width_mm:.4g} x {material.height_mm:.4g} mm"
        return MaterialMade(
            {what: str(file) for what, file in files.items()},
            material.width_mm,
            material.height_mm,
            deep,
            seam,
            text=f"{folder}: {name}, a tile of {size} ({columns} x {rows}), {deep:.3g} mm deep; "
            f"{_repeats(material.tiling.correlation)}; seam {seam:.2f}, where 1 is none",
        )

    def _checked_name(self) -> str:
        """The prefix of the file names. Raises SettingsError if name or folder is invalid."""
        from mpsnet_core.io.files import IMAGE_SUFFIXES

        name = Path(self.image).stem if self.name is None else self.name
        if Path(name).name != name:
            raise SettingsError(f"--name {name} is not a file name; give the folder with -o")
        if Path(self.output).suffix.lower() in IMAGE_SUFFIXES:
            raise SettingsError(f"--output {self.output} looks like an image file; give a folder for all of them")
        return name

    def _capture(
        self, length_mm: float, pixels: float | None, crop: tuple[int, int, int, int] | None
    ) -> "tuple[Capture, float]":
        """The part of the photo to use, and the size of a pixel in millimetres."""
        from mpsnet_core.capture.masks import ALPHA_OR_NONE
        from mpsnet_core.capture.open import open_captures
        from mpsnet_core.io.files import prefix_errors
        from mpsnet_core.relief.material.material import crop_to_filled_part
        from mpsnet_core.relief.material.scale import parse_ruler

        [capture] = open_captures([self.source(self.image, self.rig, ALPHA_OR_NONE)], self.read_options())
        with prefix_errors(self.image):
            height, width = capture.mask.shape
            if self.ruler:
                parse_ruler(self.ruler).check_within(height, width)
            return crop_to_filled_part(capture, crop), length_mm / (pixels or width)


def _repeats(correlation: tuple[float | None, float | None]) -> str:
    repeats = [f"{share:.0%} alike {way}" for share, way in zip(correlation, ("across", "down"), strict=True) if share]
    return f"it repeats in the photo, {' and '.join(repeats)}" if repeats else "nothing in the photo repeats"
