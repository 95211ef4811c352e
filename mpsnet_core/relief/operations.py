"""The operations ``integrate`` (products of a normal map) and ``material`` (a seamless material from a photo)."""

from dataclasses import dataclass
from pkgutil import resolve_name
from typing import ClassVar, Literal

from mpsnet_core import defaults
from mpsnet_core.capture.operations import HasLens, HasViewpoint, ReadsPhotos
from mpsnet_core.errors import SettingsError
from mpsnet_core.estimate.operations import RunsModel
from mpsnet_core.operation import Operation, Result, convention_option, option, optional, output_option, settings
from mpsnet_core.progress import Progress, silent

# The work is imported when it is done, and takes the operation.
_HERE = "mpsnet_core.relief"

# Options that apply to a photo's normal map only.
_OF_PHOTOS = ("camera", "focal", "pixel_size", "distance", "method", "mesh", "curvature", "occlusion", "relit")
# Options that have no effect without another one.
_NEEDED = {
    "height_bits": "height",
    **dict.fromkeys(("faces", "open", "up"), "mesh"),
    **dict.fromkeys(("curvature_radius", "curvature_range"), "curvature"),
    "occlusion_reach": "occlusion",
    **dict.fromkeys(("light", "albedo"), "relit"),
    **dict.fromkeys(("space", "base", "object_space", "scale", "mean", "margin"), "uvs"),
}


@dataclass(frozen=True)
class HasScale(HasLens):
    """A photo's camera and unit."""

    heading: ClassVar[str] = "the photo's camera, and the unit"

    pixel_size: float | None = optional(
        "size of a pixel in an orthographic view, in place of a camera file", metavar="S", unset="1"
    )
    distance: float | None = optional(
        "mean distance from the camera to the visible surface, in the unit of the heights: it sets a perspective "
        "camera's scale, and where an orthographic camera's mesh stands",
        unset="1 for a perspective camera",
    )
    unit: str | None = optional("name of the unit of these lengths, such as mm")


@dataclass(frozen=True)
class MakesProducts(Operation):
    """The products of a photo's normals."""

    heading: ClassVar[str] = "what to make, at least one"

    height: str | None = output_option(
        "height map: .exr with float heights, or .png or .tif with 16 bits; FILE.json holds the heights of "
        "black and white"
    )
    height_bits: int | None = optional("32 writes float heights into .tif", metavar="BITS")
    mesh: str | None = output_option(
        "make a mesh of the surface, where the photo's camera saw it, with the photo's UVs", metavar=".ply|.glb|.obj"
    )
    faces: int = option(
        default=defaults.FACES,
        low=1,
        high=defaults.MAX_FACES,
        help="how many faces the mesh may have at most; they are smaller where the surface bends",
    )
    open: float | None = optional(
        "leave out faces whose normals are further than this from the line of sight, such as 85", metavar="ANGLE"
    )
    up: Literal["y", "z"] | None = optional(
        "axis that points up in the camera's world, for .glb and .obj",
        choices={"y": "", "z": ""},
        unset="z with a camera file, else y",
    )
    curvature: str | None = output_option("curvature map: edges are bright, creases dark")
    curvature_radius: int = option(
        default=defaults.CURVATURE_RADIUS, metavar="PIXELS", help="the broadest shapes that the curvature map shows"
    )
    curvature_range: float | None = optional(
        "curvature per unit that is white; .exr holds the sum of both principal curvatures", metavar="C"
    )
    occlusion: str | None = output_option("ambient occlusion map: white where the surface is fully open to light")
    occlusion_reach: int | None = optional(
        "how far the ambient occlusion reaches", metavar="PIXELS", unset="everywhere"
    )
    relit: str | None = output_option(
        "image of the surface under a white light, with the ambient occlusion if that is made"
    )
    light: str = option(default="45,135", metavar="SLANT,TILT", help="direction of that light in degrees", numbers=True)
    albedo: str | None = optional(
        "the surface's colour for --relit", metavar="PHOTO", unset="light grey", provenance="files"
    )


@dataclass(frozen=True)
class DisplacesMesh(Operation):
    """How the heights of a texture on a mesh's UVs are computed."""

    heading: ClassVar[str] = "heights on a mesh's UVs, from a baked normal texture"

    uvs: str | None = optional(
        "mesh that the texture was baked onto; needs --height. For tiles, both names hold <UDIM>",
        metavar="MESH",
        provenance="content",
    )
    space: Literal["tangent", "object"] = option(
        default="tangent",
        choices={"tangent": "to the surface, by MikkTSpace", "object": "to the object"},
        help="what the texture's normals are relative to",
    )
    base: str | None = optional(
        "mesh to displace, if it is the same one subdivided", metavar="MESH", provenance="content"
    )
    object_space: str | None = output_option(
        "also write the texture in object space, which shades the displaced surface", path="file"
    )
    scale: float = option(
        default=0.0,
        low=0,
        high=defaults.MAX_BUMPS,
        help="broadest bumps that heights on UVs keep, as a fraction of the object's size: broader shapes are "
        "left to the mesh, because estimated normals err most there. 0 keeps all",
    )
    mean: float | None = optional("mean of the heights", unset="the surface stays where it is")
    margin: int = option(
        default=defaults.MARGIN,
        low=0,
        high=defaults.MAX_TEXTURE_SIZE,
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
    convention: Literal["opengl", "directx"] = convention_option(default="opengl", of="the normal map")
    method: Literal["fast", "bilateral"] = option(
        default="fast",
        choices={
            "fast": "one surface without gaps: for one object, reliefs, cloth",
            "bilateral": "the surface breaks where one object occludes another; takes several times as long",
        },
        help="whether the surface may break",
    )

    def run(self, progress: Progress = silent) -> Result:
        """Write the requested products, or the heights on a mesh's UVs."""
        self._check_together()
        if self.uvs and not self.height:
            raise SettingsError("--uvs makes heights; name their file with --height")
        work = "displacement.displacement_files:write_displacement" if self.uvs else "products:make_products"
        return resolve_name(f"{_HERE}.{work}")(self, progress)

    def _check_together(self) -> None:
        """Raise SettingsError if an option is set that has no effect with the others."""
        own = settings(type(self))
        given = {one.name: one.flags[-1] for one in own if getattr(self, one.name) != one.default}
        for name in _OF_PHOTOS if self.uvs else ():
            if name in given:
                raise SettingsError(f"{given[name]} goes with a photo's normals, not with --uvs; leave it out")
        for name, needed in _NEEDED.items():
            if name in given and not getattr(self, needed):
                raise SettingsError(f"{given[name]} goes with --{needed}, which is not given; give both, or neither")


@dataclass(frozen=True)
class MeasuresPhoto(Operation):
    """The scale of the photo."""

    heading: ClassVar[str] = "its size, one of these"

    width: str | None = optional(
        "what the photo's whole width measures: 120mm, 12cm, 4.5in", metavar="LENGTH", numbers=True
    )
    pixel_size: str | None = optional(
        "in place of --width, what a pixel measures: 0.05mm", metavar="LENGTH", numbers=True
    )
    ruler: str | None = optional(
        "in place of --width, the distance between two places in pixels: 120,80,1620,95=50mm",
        metavar="X1,Y1,X2,Y2=LENGTH",
    )


@dataclass(frozen=True)
class MakeMaterial(MeasuresPhoto, RunsModel, HasViewpoint, ReadsPhotos):
    """Make seamless textures from a photo of cloth, leather or bark."""

    command: ClassVar[str] = "material"

    image: str = option(
        positional=True, help="photo of a flat material that fills the photo, or its --crop", provenance="files"
    )
    rig: str = option(help="rig file (.json, or .lp with three lights)", provenance="content")
    model: str = option(
        default=defaults.BY_PHOTO,
        help="model that estimates the normals, by name or as an .onnx file; auto: lambertian-grey-world where the "
        "photo shows a matt material, the default network where it shows a glossy one",
    )
    crop: str | None = optional(
        "the part of the photo to use, from its upper left corner", metavar="X,Y,W,H", numbers=True
    )
    size: int | None = optional(
        "width and height of the textures in pixels",
        low=defaults.MIN_MATERIAL_SIZE,
        high=defaults.MAX_MATERIAL_SIZE,
        unset="the photo's own resolution",
    )
    overlap: float = option(
        default=defaults.OVERLAP,
        low=defaults.MIN_OVERLAP,
        high=defaults.MAX_OVERLAP,
        help="fraction of the tile over which its borders blend: more hides the seam better but leaves a smaller tile",
    )
    bend: int = option(
        default=defaults.BEND,
        low=0,
        high=defaults.MAX_BEND,
        help="how many half waves across the photo to remove as bends of the material and uneven light. 0: "
        "only the tilt of the photo",
    )
    grey: bool = option(default=False, help="make the albedo grey, for lights of unknown strengths")
    convention: Literal["opengl", "directx"] = convention_option(default="opengl", of="the normals")
    name: str | None = optional("prefix of the file names", unset="the photo's name")
    output: str = option(metavar="FOLDER", help="folder for the textures", path="folder", provenance="none")

    def run(self, progress: Progress = silent) -> Result:
        """Write the material's textures into the folder."""
        return resolve_name(f"{_HERE}.material.material_files:make_material")(self, progress)
