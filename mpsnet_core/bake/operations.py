"""The operations ``bake`` and ``views``: from normal maps, or posed photos, to textures on a mesh's UVs."""

import contextlib
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING, Any, ClassVar, Literal

from mpsnet_core.bake.presets import PRESETS, check_preset
from mpsnet_core.capture.operations import ReadsPhotos
from mpsnet_core.defaults import CONVENTIONS, LEVEL_SCALE, MARGIN, MAX_STRENGTH, MAX_TEXTURE_SIZE, TEXTURE_SIZE
from mpsnet_core.errors import GeometryError, SettingsError
from mpsnet_core.estimate.operations import RunsModel
from mpsnet_core.operation import Result, option
from mpsnet_core.progress import Progress, part, silent
from mpsnet_core.scene.operations import TakesMesh

if TYPE_CHECKING:
    from mpsnet_core.bake.inputs import BakeInputs
    from mpsnet_core.bake.multi_view import ViewCaptureSettings
    from mpsnet_core.bake.settings import BakeSettings
    from mpsnet_core.bake.texture_files import BakePlan, TextureTarget
    from mpsnet_core.bake.view_agreement import ViewAgreement
    from mpsnet_core.bake.written_texture import WrittenTexture
    from mpsnet_core.scene.camera import Camera
    from mpsnet_core.scene.rig import LightRig
    from mpsnet_core.scene.texture import Texture
    from mpsnet_core.scene.texture_sets import TextureSet
    from mpsnet_core.scene.view_photos import ViewPhoto

LEVEL = (
    "take large shapes from the mesh, and from the photos only detail smaller than about twice SCALE (a fraction of "
    f"the mesh's size; on means {LEVEL_SCALE:g}). auto: take them as far as the mesh agrees with the estimate, within "
    "the error that the estimate expects of itself"
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
        default=f"{TEXTURE_SIZE}", metavar="SIDE|WIDTHxHEIGHT", help="size of the texture in pixels", numbers=True
    )
    space: Literal["tangent", "object"] = option(
        default="tangent",
        choices={
            "tangent": "to the surface, by MikkTSpace: the object may move, bend and be reused",
            "object": "to the object: for objects that do not bend",
        },
        help="what the texture's normals are relative to",
    )
    convention: Literal["opengl", "directx"] | None = option(
        default=None,
        choices=CONVENTIONS,
        help="which way the texture's green channel points",
        unset="opengl, or the preset's",
        provenance="none",  # its value with the preset is recorded
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
    margin: int | None = option(
        default=None,
        low=0,
        high=MAX_TEXTURE_SIZE,
        help="pixels by which the texture extends beyond the UV islands",
        unset=f"{MARGIN}",
    )
    bits: int | None = option(
        default=None,
        choices={8: "PNG and TIFF", 16: "all formats", 32: "TIFF and OpenEXR"},
        help="bits per channel of the texture",
        unset="16 bits, 32 in OpenEXR; or the preset's",
        provenance="none",  # their value with the preset is recorded
    )
    preset: str | None = option(
        default=None,
        metavar="NAME",
        choices={
            name: f"written as {preset.stem('NAME')}{preset.suffix}, {preset.bits} bits per channel"
            for name, preset in PRESETS.items()
        },
        help="convention, bit depth, format and automatic file name that a program expects; you can change each",
        provenance="none",
    )

    def __post_init__(self) -> None:
        super().__post_init__()
        if self.preset is not None:
            check_preset(self.preset, self.space, self.convention or PRESETS[self.preset].convention)

    def texture_words(self, target: "TextureTarget") -> str:
        """The properties that all textures share, as text for the report."""
        width, height = self.texture_size()
        return f"{width} x {height}, {self.space} space, {target.convention}"

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

    level: str | None = option(
        default=None,
        metavar="auto|on|off|SCALE",
        help=LEVEL,
        unset="auto, or on with an existing map",
        provenance="none",  # the parsed scale is recorded
        numbers=True,
    )
    strength: float = option(
        default=1.0,
        low=0,
        high=MAX_STRENGTH,
        help="fraction of the photos' relief that is added to the object's own surface: 1 as it is, 0 none",
    )
    fill: bool = option(
        default=False, help="fill what no view sees, by continuing the relief around it smoothly along the surface"
    )
    coverage: str | None = option(
        default=None,
        metavar="FOLDER",
        help="folder for maps of what the views saw, named like the textures: white where seen, grey where filled, "
        "else black",
        path="folder",
        provenance="none",
    )
    least_seen: float = option(
        default=0.0,
        low=0,
        high=1,
        help="write nothing if the views see less than this fraction of the surface",
        provenance="none",
    )
    onto: str | None = option(
        default=None,
        metavar="MAP",
        help="normal map (tangent space, same UVs) to add the detail to; <OBJECT>, <MATERIAL> and <UDIM> in "
        "its name stand for those of each texture; or a .json file that lists several maps",
        path="file",
        provenance="files",
    )
    onto_convention: Literal["opengl", "directx"] = option(
        default="opengl", choices=CONVENTIONS, help="which way the green channel of the existing map points"
    )
    onto_shown: Literal["auto", "yes", "no"] = option(
        default="auto",
        choices={
            "auto": "compare the photos' normals with the map",
            "yes": "the map was made from the same object",
            "no": "the map was sculpted or painted",
        },
        help="whether the photos already show the existing map's relief, which is then not added twice",
    )

    def check_onto(self) -> None:
        """Raise SettingsError if the detail cannot go on top of the existing map, or its options lack the map."""
        from mpsnet_core.bake.detail_blending import check_blending

        if self.onto:
            check_blending(self.space)
        elif self.onto_convention != "opengl" or self.onto_shown != "auto":
            raise SettingsError(
                "--onto-convention and --onto-shown describe the map of --onto; give it, or leave them out"
            )

    def shares(self, written: "Sequence[WrittenTexture]") -> tuple[float, float | None]:
        """The fractions of the surface that were seen and filled. Raises GeometryError if too little was seen."""
        from mpsnet_core.bake.texture_files import shares_of

        seen, filled = shares_of(written)
        if seen < self.least_seen:
            raise GeometryError(
                f"the views see only {seen:.0%} of the surface, less than {self.least_seen:.0%} (--least-seen): "
                "nothing is written; was the object or a camera moved, or its mesh or mask changed? [less-seen]"
            )
        return seen, filled

    def level_scale(self) -> float:
        """The levelling's scale as a fraction of the mesh's size, 0 for none. Raises SettingsError if it is invalid."""
        from mpsnet_core.bake.low_frequency_correction import parse_scale

        # The photo shows the base map's large shapes, too; they must not be added to it again.
        return parse_scale(self.level or ("on" if self.onto else "auto"))

    @property
    def agreed(self) -> bool:
        """Whether the levelling takes from the mesh only what agrees with the views."""
        return (self.level or ("on" if self.onto else "auto")) == "auto"

    def baking(self, feather: float) -> "BakeSettings":
        """How the textures are baked.

        Raises SettingsError if an option is out of range, or a margin is given that the padding does not use.
        """
        from mpsnet_core.bake.settings import BakeSettings

        if self.margin is not None and self.padding in ("push-pull", "none"):
            raise SettingsError(f"--margin goes with --padding nearest, not with {self.padding}; leave it out")
        return BakeSettings(
            size=self.texture_size(),
            space=self.space,
            margin=MARGIN if self.margin is None else self.margin,
            padding=self.padding,
            samples=self.samples,
            feather=feather,
            strength=self.strength,
            fill=self.fill,
        )

    def planned(
        self, target: "TextureTarget", protected_paths: "Sequence[Path]", *, albedo: bool = False
    ) -> "BakePlan":
        """The textures to bake, see :func:`mpsnet_core.bake.texture_files.planned`."""
        from mpsnet_core.bake.texture_files import planned

        return planned(
            target,
            self.mesh,
            protected_paths,
            self.read_mesh,
            onto=self.onto,
            onto_convention=self.onto_convention,
            onto_shown=self.onto_shown,
            albedo=albedo,
            coverage=self.coverage,
        )


@dataclass(frozen=True)
class TexturesBaked(Result):
    """The textures of one pose."""

    output: str
    """The texture's file, or its name with tokens."""
    outputs: "list[WrittenTexture]"
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
    normals_convention: Literal["opengl", "directx"] = option(
        default="opengl",
        choices=CONVENTIONS,
        help="which way the green channel of the normal maps that are read points",
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
    format: str | None = option(
        default=None, help="png, tif or exr, if the output is a folder", unset="png", provenance="none"
    )
    output: str = option(
        help="texture to write: .png, .tif or .exr; <UDIM>, <MATERIAL> or <OBJECT> in its name writes one for "
        "each tile, material or object; a folder for a sequence, or to take the name from a preset",
        path="file",
        provenance="none",
    )

    def run(self, progress: Progress = silent) -> TexturesBaked | FramesBaked:
        """Write the textures of one pose, or a texture for each frame of a sequence."""
        from mpsnet_core.bake.texture_files import texture_target
        from mpsnet_core.io.frames import is_folder_or_pattern

        views = self._views()
        sequence = any(is_folder_or_pattern(normals) for _, normals in views)
        self.check_onto()
        baking = self._baking()
        for what, files, none in (("confidence maps", self.confidence, ""), ("albedos", self.albedo, ", or none")):
            if files and len(files) != len(views):
                raise SettingsError(
                    f"there are {len(views)} views but {len(files)} {what}; give one for each view{none}"
                )
        target = texture_target(
            self.output,
            self.mesh,
            preset=self.preset,
            ending=self.format,
            convention=self.convention,
            bits=self.bits,
            sequence=sequence,
        )
        if sequence:
            return self._sequence(views, target, baking, progress)
        return self._pose(views, target, baking, progress)

    def _views(self) -> list[tuple[str, str]]:
        """Camera and normal map of each view."""
        from mpsnet_core.io.files import is_file

        views = []
        for view in self.view:
            # File names may contain equals signs: split at the one that follows the name of an existing camera file.
            words = view.split("=")
            starts = ["=".join(words[:count]) for count in range(1, len(words))]
            camera = next(filter(is_file, starts), words[0])
            normals = view[len(camera) + 1 :]
            if not (camera and normals):
                raise SettingsError(
                    f"--view {view} is not CAMERA=NORMALS; give a camera file, an equals sign, a normal map"
                )
            views.append((camera, normals))
        return views

    def _baking(self) -> "BakeSettings":
        from mpsnet_core.bake.feather import FEATHER

        # Levelled views agree in their low frequencies: feathering leaves no seam.
        return self.baking(FEATHER if self.level_scale() and not self.agreed else 0.0)

    def _pose(
        self, views: list[tuple[str, str]], target: "TextureTarget", baking: "BakeSettings", progress: Progress
    ) -> TexturesBaked:
        from mpsnet_core.bake.bake import bake_texture_sets
        from mpsnet_core.bake.colour_matching import matched_views
        from mpsnet_core.bake.inputs import BakeInputs, ViewInputs, ViewReader
        from mpsnet_core.bake.texture_files import format_textures, write_textures
        from mpsnet_core.io.files import writable_image, write_transaction

        writable_image(target.output, target.bits)
        maps = [tuple(map(Path, files)) or (None,) * len(views) for files in (self.confidence, self.albedo)]
        inputs = BakeInputs(
            tuple(map(Path, self.mesh)),
            tuple(
                ViewInputs(Path(camera), Path(normals), confidence, albedo)
                for (camera, normals), confidence, albedo in zip(views, *maps, strict=True)
            ),
        )
        progress(0.0, "reading the mesh")
        plan = self.planned(target, [*inputs.files, *self._onto_files()], albedo=bool(self.albedo))
        reader = ViewReader(self.level_scale(), plan.base_maps.in_photos(), self.normals_convention, self.agreed)
        seen, _ = reader.read(inputs.views, plan.meshes, part(progress, 0.05, 0.15))
        if self.albedo and len(seen) > 1:
            seen = matched_views(seen, plan.meshes, baking.feather)
        baked = bake_texture_sets(plan.meshes, seen, plan.texture_sets, baking, progress=part(progress, 0.15, 1.0))
        with write_transaction():
            written = [one for _, one, _ in write_textures(plan, baked)]
            shares = self.shares(written)
        text = format_textures(written, self.texture_words(target))
        return TexturesBaked(target.output, written, *shares, text=text)

    def _sequence(
        self, views: list[tuple[str, str]], target: "TextureTarget", baking: "BakeSettings", progress: Progress
    ) -> FramesBaked:
        from mpsnet_core.bake.base_maps import one_base_map
        from mpsnet_core.bake.inputs import ViewReader
        from mpsnet_core.bake.sequence import bake_sequence
        from mpsnet_core.io.files import check_no_overwrite, ensure_folder, remove_abandoned
        from mpsnet_core.io.frames import results_folder
        from mpsnet_core.io.provenance import operation_facts

        frames, numbers = self._frames(views, target)
        check_no_overwrite({*(file for one in frames.values() for file in one.files), *self._onto_files()}, frames)
        remove_abandoned(ensure_folder(results_folder(target.output, "a sequence is baked", "textures"), "textures"))
        level, how = self.level_scale(), " where they agree" if self.agreed else ""
        base_maps = [one_base_map(self.onto, self.onto_convention, self.onto_shown)] if self.onto else []
        outcome = bake_sequence(
            frames,
            ViewReader(level, base_maps, self.normals_convention, self.agreed),
            baking,
            target,
            read_mesh=self.read_mesh,
            settings_fingerprint=operation_facts(
                self,
                convention=target.convention,
                bits=str(target.bits),
                level=f"{level}{how}",
            ),
            progress=progress,
        )
        textures = {number: file for number, file in zip(numbers, frames, strict=True) if file not in outcome.failed}
        first, last = min(textures), max(textures)
        output = textures[first]
        existing = f", {outcome.existing} there already" if outcome.existing else ""
        failed = f", {len(outcome.failed)} failed" if outcome.failed else ""
        return FramesBaked(
            target.output,
            str(output),
            first,
            last,
            len(textures),
            outcome.made,
            outcome.existing,
            outcome.seen,
            outcome.filled,
            text=f"{output.parent}: textures of {len(frames)} frames, {outcome.made} made{existing}{failed}",
            failed=[*outcome.failed.values()] or None,
        )

    def _frames(
        self, views: list[tuple[str, str]], target: "TextureTarget"
    ) -> "tuple[dict[Path, BakeInputs], list[int]]":
        """The inputs of each frame's texture, by its file, and the frames' numbers."""
        from mpsnet_core.bake.inputs import frame_inputs
        from mpsnet_core.io.files import checked_bits
        from mpsnet_core.scene.texture_names import split_by

        if len(self.mesh) > 1 or split_by(target.output):
            raise SettingsError(
                "a sequence is baked onto one mesh and into one texture per frame; give one --mesh, and leave "
                "<UDIM>, <MATERIAL> and <OBJECT> out of --output"
            )
        if self.confidence:
            raise SettingsError("--confidence takes one normal map per view; leave it out for a sequence")
        if self.albedo:
            raise SettingsError("--albedo takes one still photo per view; leave it out for a sequence")
        for name in ("coverage", "least_seen"):
            if getattr(self, name):
                raise SettingsError(f"--{name.replace('_', '-')} is for a single pose; leave it out for a sequence")
        inputs = frame_inputs(self.mesh[0], views)
        checked_bits(Path(f"texture{target.suffix}"), target.bits)
        numbers = sorted(inputs)
        digits = max(4, len(str(numbers[-1])))
        return {target.frame(number, digits): inputs[number] for number in numbers}, numbers

    def _onto_files(self) -> list[Path]:
        return [Path(self.onto)] if self.onto else []


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
    )
    photos: str | None = option(
        default=None,
        metavar="FOLDER",
        help="folder of these cameras' photos",
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
    passes: Literal[1, 3] | None = option(
        default=None,
        choices={
            1: "takes a sixth to half of the time",
            3: "averages the results for the scene rotated and mirrored, and estimates a second time without the "
            "albedo",
        },
        help="passes of the network over each photo",
        unset="3 for the default model",
        provenance="none",
    )
    level: str | None = option(default="on", metavar="auto|on|off|SCALE", help=LEVEL, numbers=True)
    keep: str | None = option(
        default=None,
        metavar="FOLDER",
        help="folder for each view's normals and albedo; the next run reuses them",
        unset="they are not kept",
        path="folder",
        provenance="none",
    )
    report: str | None = option(
        default=None,
        metavar="FILE",
        help="write an HTML page that shows which views cover what and how much they disagree",
        provenance="none",
    )
    json: str | None = option(default=None, metavar="FILE", help="write the same figures as JSON", provenance="none")
    output: str = option(
        help="texture to write: .png, .tif or .exr; <UDIM>, <MATERIAL> or <OBJECT> in its name writes one for "
        "each tile, material or object; a folder to take the name from a preset",
        path="file",
        provenance="none",
    )

    def run(self, progress: Progress = silent) -> ViewsBaked:
        """Write the textures, and report and figures if requested."""
        from mpsnet_core.bake.bake import bake_texture_sets
        from mpsnet_core.bake.base_detail_removal import log_shares
        from mpsnet_core.bake.colour_matching import colour_gains
        from mpsnet_core.bake.feather import FEATHER
        from mpsnet_core.bake.inputs import ViewReader
        from mpsnet_core.bake.multi_view import CachedView, CachedViews, estimate_views, sources_of
        from mpsnet_core.bake.view_agreement import agreement, warn_of_doubts
        from mpsnet_core.io.files import check_no_overwrite
        from mpsnet_core.io.provenance import operation_facts
        from mpsnet_core.scene.joined_mesh import join_meshes
        from mpsnet_core.scene.rays import RayScene
        from mpsnet_core.scene.view_photos import posed_photos

        # Check as much as possible before the long work.
        baking, level, target = self.baking(FEATHER), self.level_scale(), self._target()
        inputs, outputs = self._files(target)
        photography = self._photography()
        views = posed_photos(self.cameras, self.photos, layer=self.layer)
        photos = [photo for view in views for photo in (view.photo, *photography.white_of(view))]
        check_no_overwrite(photos, outputs)
        kept_files = self._kept_files(views)
        check_no_overwrite([*inputs, *photos, *outputs], kept_files)
        progress(0.0, "reading the mesh")
        protected_paths = [*inputs, *photos, *map(Path, outputs[1:]), *kept_files]
        plan = self.planned(target, protected_paths, albedo=bool(self.white))
        mesh = join_meshes(plan.meshes)
        settings_fingerprint = operation_facts(self, RunsModel, ReadsPhotos, **self.model_facts(self.passes))
        sources = sources_of(views, photography, mesh, settings_fingerprint)
        scene = RayScene.of(mesh)
        estimator = self.estimator(self.passes)
        with contextlib.ExitStack() as stack:
            folder = self._folder(stack)
            kept = [CachedView(folder, view.name, bool(self.white)) for view in views]
            reader = ViewReader(level, plan.base_maps.in_photos(), agreed=self.agreed)
            stored = CachedViews(kept, [view.camera for view in views], mesh, scene, reader)
            agreed = agreement(mesh, scene, FEATHER)
            known = estimate_views(
                views, sources, photography, estimator, stored, agreed, progress=part(progress, 0.02, 0.72)
            )
            log_shares(stored.shares)
            if self.white:
                stored.gains = colour_gains(agreed.colours)
            baked = bake_texture_sets(
                plan.meshes, stored, plan.texture_sets, baking, progress=part(progress, 0.72, 1.0)
            )
            table = agreed.views(stored.gains.tolist() if self.white else None)
            warn_of_doubts(table)
            how = f"levelled at {level:g} of the mesh's size" if level else "not levelled"
            before = f"; {known} kept from before" if known else ""
            summary = f"{len(views)} view(s) by {estimator.name}, {how}{before}"
            return self._written(plan, baked, table, estimator.name, summary)

    def _target(self) -> "TextureTarget":
        from mpsnet_core.bake.texture_files import texture_target
        from mpsnet_core.io.files import writable_image

        self.check_onto()
        target = texture_target(self.output, self.mesh, preset=self.preset, convention=self.convention, bits=self.bits)
        writable_image(target.output, target.bits)
        return target

    def _files(self, target: "TextureTarget") -> tuple[list[Path], list[str]]:
        """The files that are read, except photos, and those that are written. Raises InputError if one would overwrite
        another, or its folder cannot be written."""
        from mpsnet_core.io.files import check_no_overwrite, writable_path
        from mpsnet_core.io.html_page import page_path
        from mpsnet_core.scene.view_photos import camera_files

        if self.report:
            page_path(self.report)
        if self.json:
            writable_path(self.json)
        outputs = [file for file in (target.output, self.report, self.json) if file]
        mask = None if self.mask == "mesh" else self.mask
        inputs = [*camera_files(self.cameras), *self.inputs(self.rig, *self.mesh, self.onto, mask=mask)]
        check_no_overwrite(inputs, outputs)
        return inputs, outputs

    def _photography(self) -> "ViewCaptureSettings":
        from mpsnet_core.bake.multi_view import ViewCaptureSettings
        from mpsnet_core.scene.rig import read_rig
        from mpsnet_core.scene.world_lights import read_world_lights

        if self.lights_in == "world":
            rig_of = read_world_lights(self.rig).seen_by
        else:
            rig = read_rig(self.rig)

            def rig_of(camera: "Camera") -> "LightRig":
                return rig

        return ViewCaptureSettings(rig_of, self.mask, self.read_options(), self.white)

    def _kept_files(self, views: "Sequence[ViewPhoto]") -> list[Path]:
        """The files that keep the views. Raises FileError if one exists that this program did not make."""
        from mpsnet_core.bake.multi_view import CachedView
        from mpsnet_core.io.files import check_own

        kept = [CachedView(Path(self.keep), view.name, bool(self.white)) for view in views] if self.keep else []
        files = [file for view in kept for file in view.files]
        for file in files:
            check_own(file)
        return files

    def _folder(self, stack: contextlib.ExitStack) -> Path:
        """The folder of the views' normals: the one to keep them in, or a temporary one until the stack closes."""
        from mpsnet_core.io.files import ensure_folder, remove_abandoned, temporary_folder

        if not self.keep:
            return stack.enter_context(temporary_folder())
        folder = ensure_folder(self.keep, "normals of the views")
        remove_abandoned(folder)
        return folder

    def _written(
        self,
        plan: "BakePlan",
        baked: "Iterable[tuple[TextureSet, Texture]]",
        table: "Sequence[ViewAgreement]",
        model: str,
        summary: str,
    ) -> ViewsBaked:
        """Write textures, report and figures: all of them or none."""
        from mpsnet_core.bake.report import texture_maps, view_table, write_bake_report
        from mpsnet_core.bake.texture_files import format_textures, write_textures
        from mpsnet_core.bake.view_agreement import table_rows
        from mpsnet_core.io.files import write_json, write_transaction

        written, maps = [], []
        with write_transaction():
            for texture_set, one, texture in write_textures(plan, baked):
                written.append(one)
                if self.report:
                    maps += texture_maps(texture, texture_set.named)
                del texture
            text = format_textures(written, self.texture_words(plan.target))
            result = ViewsBaked(
                plan.target.output,
                written,
                *self.shares(written),
                table_rows(table),
                self.level_scale(),
                model,
                text="\n".join([view_table(table), summary, text]),
            )
            if self.report:
                write_bake_report(self.report, Path(plan.target.output).name, maps, table, [text, summary])
            if self.json:
                write_json(self.json, result.metrics("views", "seen", "filled", "level", "model"))
        return result
