"""The operations ``bake`` and ``views``: from normal maps, or posed photos, to textures on a mesh's UVs."""

import re
from dataclasses import dataclass
from pkgutil import resolve_name
from typing import Any, ClassVar, Literal

from mpsnet_core import defaults
from mpsnet_core.bake.presets import PRESETS, check_preset
from mpsnet_core.capture.operations import ReadsPhotos
from mpsnet_core.errors import SettingsError
from mpsnet_core.estimate.operations import RunsModel
from mpsnet_core.operation import Result, convention_option, option, optional, output_option
from mpsnet_core.progress import Progress, silent
from mpsnet_core.scene.operations import TakesMesh

LEVEL = (
    "take large shapes from the mesh, and from the photos only detail smaller than about twice SCALE (a fraction of "
    f"the mesh's size; on means {defaults.LEVEL_SCALE:g}). auto: take them as far as the mesh agrees with the "
    "estimate, within the error that the estimate expects of itself"
)


@dataclass(frozen=True)
class MakesTextures(TakesMesh):
    """The meshes to bake onto, and the textures."""

    heading: ClassVar[str] = "the textures"

    mesh: tuple[str, ...] = option(
        help="mesh with UVs: .obj, .ply, .glb, or the add-on's .npz; several meshes occlude one another",
        provenance="none",  # recorded per texture
    )
    size: str = option(
        default=f"{defaults.TEXTURE_SIZE}",
        metavar="SIDE|WIDTHxHEIGHT",
        help="size of the texture in pixels",
        numbers=True,
    )
    space: Literal["tangent", "object"] = option(
        default="tangent",
        choices={
            "tangent": "to the surface, by MikkTSpace: the object may move, bend and be reused",
            "object": "to the object: for objects that do not bend",
        },
        help="what the texture's normals are relative to",
    )
    # its value with the preset is recorded
    convention: Literal["opengl", "directx"] | None = optional(
        "which way the texture's green channel points",
        choices=defaults.CONVENTIONS,
        unset="opengl, or the preset's",
        provenance="none",
    )
    samples: int = option(
        default=1,
        metavar="N",
        choices={
            1: "one, at the pixel's centre",
            2: "four per pixel: takes about four times as long",
            4: "sixteen per pixel: takes about sixteen times as long",
        },
        help="points on the surface that each pixel averages; more take longer but smooth jagged edges",
    )
    padding: Literal["nearest", "push-pull", "none"] = option(
        default="nearest",
        choices={
            "nearest": "extend the islands by the margin",
            "push-pull": "fill the whole texture smoothly",
            "none": "leave flat normals",
        },
        help="how to fill the texture beyond the UV islands, which mipmaps blend into the islands' borders",
    )
    margin: int | None = optional(
        "pixels by which the texture extends beyond the UV islands",
        low=0,
        high=defaults.MAX_TEXTURE_SIZE,
        unset=f"{defaults.MARGIN}",
    )
    # their value with the preset is recorded
    bits: int | None = optional(
        "bits per channel of the texture",
        choices={8: "PNG and TIFF", 16: "all formats", 32: "TIFF and OpenEXR"},
        unset="16 bits, 32 in OpenEXR; or the preset's",
        provenance="none",
    )
    preset: str | None = optional(
        "convention, bit depth, format and automatic file name that a program expects; you can change each",
        metavar="NAME",
        provenance="none",
        choices={
            name: f"written as {preset.stem('NAME')}{preset.suffix}, {preset.bits} bits per channel"
            for name, preset in PRESETS.items()
        },
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.preset is not None:
            check_preset(self.preset, self.space, self.convention or PRESETS[self.preset].convention)

    def texture_size(self) -> tuple[int, int]:
        """Width and height of the texture. Raises SettingsError if they are not whole numbers."""
        found = re.fullmatch(r"(\d{1,9})(?:[x,](\d{1,9}))?", self.size.replace(" ", "").lower())
        if found is None:
            raise SettingsError(f"--size {self.size} is not a size in pixels; give a whole number, or WIDTHxHEIGHT")
        return int(found[1]), int(found[2] or found[1])


@dataclass(frozen=True)
class BakesDetail(MakesTextures):
    """How the photos' detail is used: its strength, and a normal map that it goes on top of."""

    heading: ClassVar[str] = "the photos' detail"

    # the parsed scale is recorded
    level: str | None = optional(
        LEVEL, metavar="auto|on|off|SCALE", unset="auto, or on with an existing map", provenance="none", numbers=True
    )
    strength: float = option(
        default=1.0,
        low=0,
        high=defaults.MAX_STRENGTH,
        help="fraction of the photos' relief that is added to the object's own surface: 1 as it is, 0 none",
    )
    fill: bool = option(
        default=False,
        help="fill what no view sees: the relief around it goes on smoothly along the surface, across UV seams",
    )
    coverage: str | None = output_option(
        "folder for maps of what the views saw, named like the textures: white where seen, grey where filled, "
        "else black",
        metavar="FOLDER",
        path="folder",
    )
    least_seen: float = option(
        default=0.0,
        low=0,
        high=1,
        help="write nothing if the views see less than this fraction of the surface",
        provenance="none",
    )
    onto: str | None = optional(
        "normal map (tangent space, same UVs) to add the detail to; <OBJECT>, <MATERIAL> and <UDIM> in "
        "its name stand for those of each texture; or a .json file that lists several maps",
        metavar="MAP",
        path="file",
        provenance="files",
    )
    onto_convention: Literal["opengl", "directx"] = convention_option(default="opengl", of="the existing map")
    onto_shown: Literal["auto", "yes", "no"] = option(
        default="auto",
        choices={
            "auto": "compare the photos' normals with the map",
            "yes": "the map was made from the same object",
            "no": "the map was sculpted or painted",
        },
        help="whether the photos already show the existing map's relief, which is then not added twice",
    )

    @property
    def _level(self) -> str:
        return str(self.level or ("on" if self.onto else "auto"))

    @property
    def agreed(self) -> bool:
        """Whether the levelling takes from the mesh only what agrees with the views."""
        return self._level == "auto"

    def level_scale(self) -> float:
        """The levelling's scale as a fraction of the mesh's size, 0 for none. Raises SettingsError if it is invalid."""
        # The photo shows the base map's large shapes, too; they must not be added to it again.
        text = self._level
        if text in ("auto", "on", "off"):
            return 0.0 if text == "off" else defaults.LEVEL_SCALE
        try:
            scale = float(text)
        except ValueError:
            scale = 0.0
        if not defaults.MIN_LEVEL_SCALE <= scale <= defaults.MAX_LEVEL_SCALE:
            known = f"auto, on, off, or a scale from {defaults.MIN_LEVEL_SCALE:g} to {defaults.MAX_LEVEL_SCALE:g}"
            raise SettingsError(f"--level {text} is not known; give {known}")
        return scale


@dataclass(frozen=True)
class WrittenTexture:
    """A texture that was written: its files and texture set, and what the views saw of it."""

    output: str
    """File of the texture."""
    seen: float
    """Fraction of its surface that some view saw."""
    filled: float | None
    """Fraction of its surface that was filled; None without filling."""
    texels: int
    """Number of texels with surface under them."""
    tile: int | None
    """Number of its UDIM tile; None if textures are not split by tiles."""
    material: str | None
    """Its material; None if textures are not split by materials."""
    object: str | None
    """Its object; None if textures are not split by objects."""
    albedo: str | None
    """File of the colours, if the views have any."""
    coverage: str | None
    """File of the coverage map, if requested."""
    tiles: str | None
    """File name of all tiles, with <UDIM>."""
    albedo_tiles: str | None
    """File name of all tiles of the albedo, with <UDIM>."""
    coverage_tiles: str | None
    """File name of all tiles of the coverage map, with <UDIM>."""


@dataclass(frozen=True)
class TexturesBaked(Result):
    """The textures of one pose."""

    output: str
    """The texture's file, or its name with tokens."""
    outputs: list[WrittenTexture]
    """Each texture's files and texture set, and what the views saw of it."""
    seen: float
    """Fraction of the surface that some view saw."""
    filled: float | None
    """Fraction of the surface that was filled; None without filling."""


@dataclass(frozen=True)
class FramesBaked(Result):
    """The textures of a sequence."""

    folder: str
    """Folder of the textures."""
    first_output: str
    """File of the first texture."""
    first: int
    """First frame number."""
    last: int
    """Last frame number."""
    count: int
    """Number of textures."""
    made: int
    """Number of textures made now."""
    there: int
    """Number of textures that existed already."""
    seen: float | None
    """Fraction of the surface that some view saw; None if no texture was made now."""
    filled: float | None
    """Fraction that was filled; None without filling."""


@dataclass(frozen=True)
class Bake(BakesDetail):
    """Bake normal maps into a texture on a mesh's UVs."""

    command: ClassVar[str] = "bake"

    view: tuple[str, ...] = option(
        metavar="CAMERA=NORMALS",
        help="camera file and its normal map; normals/frame_####.png for a sequence",
        provenance="none",  # recorded per texture
    )
    normals_convention: Literal["opengl", "directx"] = convention_option(
        default="opengl", of="the normal maps that are read"
    )
    confidence: tuple[str, ...] = option(
        default=(), metavar="FILE", help="confidence map of each view, in the order of the views", provenance="none"
    )
    albedo: tuple[str, ...] = option(
        default=(),
        metavar="FILE",
        help="albedo of each view (from estimate --albedo), in the order of the views: also baked, to "
        "TEXTURE_albedo, with colours matched where views overlap",
        provenance="none",
    )
    format: str | None = optional("png, tif or exr, for a folder", unset="png", provenance="none")
    output: str = option(
        help="texture to write: .png, .tif or .exr; <UDIM>, <MATERIAL> or <OBJECT> in its name writes one for "
        "each tile, material or object; a folder for a sequence, or to take the name from a preset",
        path="file",
        provenance="none",
    )

    def run(self, progress: Progress = silent) -> TexturesBaked | FramesBaked:
        """Write the textures of one pose, or a texture for each frame of a sequence."""
        return resolve_name("mpsnet_core.bake.bake_maps:bake_maps")(self, progress)


@dataclass(frozen=True)
class ViewsBaked(TexturesBaked):
    """The textures of posed photos."""

    views: list[dict[str, Any]]
    """For each view, the fraction of the surface that it sees, its angle to the other views, and the gain of its
    colours."""
    level: float
    """Scale of the low-frequency correction, 0 for none."""
    model: str
    """Name of the model that estimated the normals."""


@dataclass(frozen=True)
class BakeViews(RunsModel, ReadsPhotos, BakesDetail):
    """Bake posed photos from all around into one texture."""

    command: ClassVar[str] = "views"

    cameras: str = option(
        help="cameras from photogrammetry: a COLMAP folder, Metashape's .xml, Meshroom's .sfm or a folder of "
        "NAME.camera.json",
        path="file",
        provenance="value",
    )
    photos: str | None = optional(
        "folder of these cameras' photos",
        metavar="FOLDER",
        unset="the photos that the add-on's file of cameras names",
        path="folder",
    )
    rig: str = option(help="rig file (.json, or .lp with three lights that move with the camera)", provenance="content")
    lights_in: Literal["camera", "world"] = option(
        default="camera",
        choices={
            "camera": "the lights are fixed to the camera, or the object stood on a turntable",
            "world": "only the camera moved; a rig file gives directions along the mesh's axes, or positions "
            "in its world",
        },
        help="whether the lights moved with the camera or stood still in the world",
    )
    mask: str = option(
        default="mesh",
        help="mesh (where the camera sees it), a folder of masks named like the photos, or as for `mpsnet estimate`",
    )
    white: tuple[str, ...] = option(
        default=(),
        metavar="FOLDER",
        help="folder of photos of the same poses under white light (the three lights turned white), named "
        "like the photos or NAME_white: also bakes the surface's colour, to TEXTURE_albedo, matched where "
        "views overlap; photos from three folders, one for each light, are added up",
        path="folder",
        provenance="none",  # recorded per view
    )
    passes: Literal[1, 3] | None = optional(
        "passes of the network over each photo",
        choices={
            1: "takes a sixth to half of the time",
            3: "averages the results for the scene rotated and mirrored, and estimates a second time without the "
            "albedo",
        },
        unset="3 for the default model",
        provenance="none",
    )
    level: str | None = option(default="on", metavar="auto|on|off|SCALE", help=LEVEL, numbers=True)
    keep: str | None = output_option(
        "folder for each view's normals and albedo; the next run reuses them",
        metavar="FOLDER",
        unset="they are not kept",
        path="folder",
    )
    report: str | None = output_option(
        "write an HTML page that shows which views cover what and how much they disagree"
    )
    json: str | None = output_option("write the same figures as JSON")
    output: str = option(
        help="texture to write: .png, .tif or .exr; <UDIM>, <MATERIAL> or <OBJECT> in its name writes one for "
        "each tile, material or object; a folder to take the name from a preset",
        path="file",
        provenance="none",
    )

    def run(self, progress: Progress = silent) -> ViewsBaked:
        """Write the textures, and report and figures if requested."""
        return resolve_name("mpsnet_core.bake.multi_view:bake_views")(self, progress)
