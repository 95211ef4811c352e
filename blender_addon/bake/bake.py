"""The bake: normals seen by the camera become a texture on the target's UVs, and its material wears it."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any, Literal, TypedDict

import bpy
from bpy.props import StringProperty
from mathutils import Matrix

from mpsnet_core.bake.map_list import write_map_list
from mpsnet_core.bake.operations import Bake
from mpsnet_core.bake.presets import PRESETS
from mpsnet_core.bake.texture_names import albedo_file
from mpsnet_core.errors import GeometryError, InputError, SettingsError

from ..child_process.core_process import Work
from ..operators.core_run import RunsCore
from ..outputs import (
    FORMATS,
    frame_pattern,
    image_file,
    load_frames,
    output_frames,
    output_path,
    overruled_format,
    picture_size,
    remembered,
    requested_folder,
)
from ..photo.camera import cameras_place, chosen_camera, lacks_camera, write_photo_camera
from ..provenance import Provenance, chosen, rounded, stamp
from ..rig.light_rig import rig_camera
from ..rig.several_rigs import all_rigs
from ..scene.mesh_file import BegunMesh, begin_mesh, slot_labels
from ..scene.objects import by_session_uid, find_object
from ..settings.bake import BakeSettings
from ..settings.declared import as_typed, take_given
from .assign_textures import assign_albedo, assign_textures, mark_assets
from .coverage import coverage_folder, store_coverage
from .existing_maps import Part, base_maps, present_maps, store_base_map
from .moving_target import CAMERAS, MESHES, Moving
from .texture_owners import FRAME, files_for, refuse_anothers
from .texture_sets import (
    SPLITS,
    AssignedTexture,
    BakeTarget,
    load_textures,
    refuse_shared,
    texture_of,
    with_tokens,
)

NO_CAMERA = "Where was the photo taken from? Press Align Photo in the step Photo, or choose the camera there"
BITS = {".png": 16, ".tif": 16, ".tiff": 16, ".exr": 32}


class Detail(TypedDict, total=False):
    strength: float
    fill: bool
    onto: str
    onto_convention: Literal["opengl", "directx"]
    onto_shown: Literal["auto", "yes", "no"]


class Sampling(TypedDict):
    size: int
    samples: int
    padding: Literal["nearest", "push-pull", "none"]
    margin: int | None
    space: Literal["tangent", "object"]
    convention: Literal["opengl", "directx"]


class BakesOnto(RunsCore):
    """What the operators share that bake: the objects that get textures, and the settings of the step Bake."""

    target: StringProperty(
        name="Target",
        description="Name of the mesh object that gets the texture. Empty: the panel's target, else the active object",
        options={"SKIP_SAVE"},
    )

    _coloured = False  # whether the albedo is baked as well

    def _prepared(self, context: Any, folder: Path) -> tuple[Work, Sequence[Path]]:
        settings = context.scene.mps.bake
        before = settings.target
        try:
            prepared = super()._prepared(context, folder)
            refuse_anothers(self.result_owners())
            return prepared
        except BaseException:
            settings.target = before  # one that is refused would be refused ever after
            raise

    def result_owners(self) -> dict[Path, list[Any]]:
        """What will be written, and the objects that it is for, as :func:`.texture_owners.refuse_anothers` takes it."""
        textures = files_for(self._bake_target, self._output)
        return {**textures, **{albedo_file(file): owners for file, owners in textures.items() if self._coloured}}

    def baked_object(self, context: Any) -> Any:
        """The object to bake onto. Raises InputError where there is none, or it is another file's."""
        settings = context.scene.mps.bake
        if self.target:
            settings.target = find_object(context.scene, self.target)
        target = settings.target or context.view_layer.objects.active  # `--command` has no context.object
        if target is None:
            raise InputError("there is no target to bake onto; choose a mesh object")
        _refuse_linked(target)
        return target

    def bake_targets(self, context: Any) -> list[Any]:
        """The objects to bake onto. Raises InputError where there is none, or one cannot wear a texture."""
        settings = context.scene.mps.bake
        if settings.objects == "ACTIVE":
            return [self.baked_object(context)]
        selected = sorted(context.view_layer.objects.selected, key=lambda obj: obj.name)
        targets = [obj for obj in selected if obj.type == "MESH"]
        if not targets:
            raise InputError("no mesh object is selected to bake onto; select some, or bake onto the target alone")
        for target in targets:
            _refuse_linked(target)
        refuse_shared(targets, settings.split)
        return targets

    def detail(self, settings: Any, targets: Sequence[Any], folder: Path) -> Detail:
        """The core's options for the photo's detail and the normal maps that it goes on top of."""
        options: Detail = {"strength": as_typed(settings.strength), "fill": settings.fill}
        self._bases = base_maps(targets, self._bake_target, self._output)
        if not settings.onto:
            return options
        options["onto_shown"] = settings.onto_shown.lower()
        if settings.onto_file:
            file, convention = bpy.path.abspath(settings.onto_file), settings.onto_convention
            return {**options, "onto": file, "onto_convention": convention.lower()}
        maps = present_maps(targets, self._bake_target, self._output)
        if list(maps) == [(None, None)]:
            one: Any = maps[None, None]
            return {**options, "onto": str(one.file), "onto_convention": one.convention.lower()}
        write_map_list(folder / "maps.json", [one.listed(part) for part, one in maps.items()])
        return {**options, "onto": str(folder / "maps.json")}

    def write_meshes(
        self, context: Any, folder: Path, targets: Sequence[Any], turn: Matrix | None = None
    ) -> tuple[str, ...]:
        """Write the objects' mesh files and remember what they are; returns their paths."""
        context.view_layer.update()
        uv_map, paths, self._bake_target = context.scene.mps.bake.uv_map, [], []
        for number, target in enumerate(targets):
            path = folder / f"mesh_{number}.npz"
            begun = begin_mesh(path, target, context.evaluated_depsgraph_get(), uv_map, turn)
            self.later(begun.slices)
            self._bake_target.append(_bake_target(target, begun))
            paths.append(str(path))
        return tuple(paths)

    def texture_file(self, context: Any, targets: Sequence[Any]) -> Path:
        """Where the texture goes, with tokens in its name where there are several; a folder gets the preset's name."""
        bake = context.scene.mps.bake
        active = context.view_layer.objects.active
        name = (active if active in targets else targets[0]).name
        # The token's signs cannot stand in a file's name until the core takes them out again.
        name = texture_name(bake, "splits" if SPLITS[bake.split] else name)
        path = output_path(bake.output, name, bake.file_format)
        if SPLITS[bake.split] and requested_folder(bake.output) is not None:
            path = path.with_name(path.name.replace("splits", SPLITS[bake.split]))
        self._notes = overruled_format(path, bake)
        return with_tokens(path, bake.split, bake.tiles)

    def assign_result(self, scene: Any, result: dict[str, Any]) -> None:
        """Load the core's textures and put them on the objects that they are for."""
        there = [(one, by_session_uid(bpy.data.objects, one.uid)) for one in self._bake_target]
        if not any(target for _, target in there):
            raise InputError(f"the target is gone; its texture is in {self._output}")
        images = load_textures(result["outputs"], self._bake_target[0].name)
        coverage = self._beside(result, "coverage")
        for part, image in images.items():
            self.made(image)
            store_coverage(image, coverage[part])
            if part in self._bases:
                store_base_map(image, self._bases[part])
        scene.mps.bake.image = next(iter(images.values()))
        bake = scene.mps.bake
        worn = _worn(there, images)
        sentences = assign_textures(worn, bake.space, bake.convention)
        for sentence in [*sentences, *self._assign_albedo(there, result)]:
            self.report({"INFO"}, sentence)
        mark_assets(worn, bake.mark_asset)

    def _assign_albedo(self, there: Sequence[tuple[BakeTarget, Any]], result: dict[str, Any]) -> list[str]:
        """Load the albedos and put them on the objects that they are for; returns what there is to say."""
        images = self._beside(result, "albedo")
        for image in images.values():
            self.made(image)
        names = [f'The albedo is baked too: image "{image.name}"' for image in images.values()]
        return [*names, *assign_albedo(_worn(there, images))]

    def _beside(self, result: dict[str, Any], what: str) -> dict[Part, Any]:
        """The pictures "coverage" or "albedo" that were written beside the textures, as :func:`load_textures` does."""
        pictures = [
            {**one, "output": one[what], "tiles": one.get(f"{what}_tiles")} for one in result["outputs"] if what in one
        ]
        return load_textures(pictures, self._bake_target[0].name, what.title())

    def written(self, result: dict[str, Any]) -> str:
        """What was written where, in words."""
        count = len(result["outputs"])
        one = f"Texture written to {result['outputs'][0]['output']}"
        return one if count == 1 else f"{count} textures written to {self._output}"

    def remarks(self, result: dict[str, Any]) -> Sequence[str]:
        if "seen" not in result:  # of a sequence whose textures were all there
            return ()
        filled = f", {result['filled']:.0%} filled" if "filled" in result else ""
        return [f"{result['seen']:.0%} of the surface seen{filled}"]


def _worn(there: Sequence[tuple[BakeTarget, Any]], images: Mapping[Part, Any]) -> list[AssignedTexture]:
    """What those objects wear of the images that are still there."""
    return [found for one, target in there if target and (found := texture_of(one, target, images))]


def _bake_target(target: Any, begun: BegunMesh) -> BakeTarget:
    return BakeTarget(target.session_uid, target.name, begun.uv_map, tuple(slot_labels(target)), begun.used)


def targets_place(settings: Any) -> Provenance:
    """Where the target stands, as an ingredient of a bake; none where it is not chosen in the panel."""
    if settings.target is None or settings.objects != "ACTIVE":
        return {}
    return {"Target's place": rounded(settings.target.matrix_world, 4)}


def sampling(settings: Any) -> Sampling:
    """The core's options for size, samples, padding, space and convention."""
    return {
        "size": settings.size,
        "samples": int(settings.samples),
        "padding": settings.padding.lower().replace("_", "-"),
        "margin": settings.margin if settings.padding == "NEAREST" else None,
        "space": settings.space.lower(),
        "convention": settings.convention.lower(),
    }


def level(settings: Any) -> str:
    """The core's option for the size from which on the mesh counts in place of the photo."""
    return f"{settings.level_scale:g}" if settings.level else "off"


class MPS_OT_bake(BakesOnto, BakeSettings, bpy.types.Operator):
    """Bake the estimated normals into a texture on the target's UV map and give its material a Normal Map node"""

    bl_idname = "mps.bake"
    bl_label = "Bake Texture"

    @classmethod
    def lacks(cls, context: Any) -> str:
        scene = context.scene
        if scene.mps.estimate.image is None:
            return "Estimate the normals first"
        return NO_CAMERA if lacks_camera(scene, scene.mps.estimate.image) else ""

    @classmethod
    def provenance(cls, context: Any) -> Provenance:
        settings = context.scene.mps.bake
        every = all_rigs(context.scene) if settings.all_rigs else [context.scene.mps]
        stamps = ", ".join(stamp(one.estimate.image) for one in every)
        return {
            "Normals": stamps,
            **chosen(BakeSettings, settings, without=("output", "mark_asset")),
            **targets_place(settings),
            **cameras_place(context.scene, context.scene.mps.estimate.image),
        }

    def prepare(self, context: Any, folder: Path) -> tuple[Bake, Sequence[Path]]:
        scene = context.scene
        take_given(self, BakeSettings, scene.mps.bake)
        normals_image = scene.mps.estimate.image
        normals = image_file(normals_image, "normal map", "estimate the normals first")
        self._frames = range(0)
        if normals_image.source == "SEQUENCE":
            target = self._bake_target_of_frames(context)
            estimate = scene.mps.estimate
            self._frames = range(estimate.first_frame, estimate.last_frame + 1)
            normals = frame_pattern(normals)
            self._output = output_frames(self.output, texture_name(self, target.name))
            suffix = f".{FORMATS[self.file_format]}"
            targets = [target]
            mesh, camera = self._write_place(context, folder, target, normals_image)
            meshes: tuple[str, ...] = (mesh,)
        else:
            targets = self.bake_targets(context)
            self._output = self.texture_file(context, targets)
            suffix = self._output.suffix.lower()
            meshes = self.write_meshes(context, folder, targets)
            camera = str(folder / "camera.json")
            self._write_camera(scene, folder / "camera.json", normals_image)
        photo = normals_image.mps.photo
        if photo is not None and photo.mps.poor and chosen_camera(scene, normals_image) is not None:
            self._notes = [*self._notes, f"the mesh fits the photo poorly ({photo.mps.fit}); look at Align Photo"]
        others = self._other_rigs(scene) if self.all_rigs else []
        albedos = self._albedos([scene.mps, *others])
        self._coloured = bool(albedos)
        operation = Bake(
            mesh=meshes,
            view=(f"{camera}={normals}", *self._other_views(scene, others, folder)),
            albedo=albedos,
            **sampling(self),
            bits=bits(self, suffix),
            level=level(self),
            **self.detail(self, targets, folder),
            coverage=None if self._frames else coverage_folder(),
            format=suffix[1:] if self._frames else None,
            output=str(self._output),
        )
        return operation, [self._output / "frames" if self._frames else self._output]

    def result_owners(self) -> dict[Path, list[Any]]:
        if not self._frames:
            return super().result_owners()
        frames = self._output / f"{self._output.name}_{FRAME}.{FORMATS[self.file_format]}"
        return {frames: [by_session_uid(bpy.data.objects, self._bake_target[0].uid)]}

    def _bake_target_of_frames(self, context: Any) -> Any:
        if self.objects == "SELECTED" or self.split != "ONE" or self.tiles:
            raise SettingsError(
                "a sequence is baked onto the target alone and into one texture a frame; set Objects to Target, "
                "Textures to One for All, and switch UDIM Tiles off"
            )
        return self.baked_object(context)

    def _write_camera(self, scene: Any, path: Path, normals_image: Any) -> None:
        """Write the camera that the normals were taken with, or that of the rig as it stands."""
        if not write_photo_camera(path, scene, normals_image):
            write_photo_camera(path, scene, normals_image, rig_camera(scene))

    def _write_place(self, context: Any, folder: Path, target: Any, normals_image: Any) -> tuple[str, str]:
        """Write mesh and camera for a sequence: as they stand, or for each frame where they shall move along."""
        scene, camera = context.scene, "camera.json"
        if not self.animated:
            context.view_layer.update()
            begun = begin_mesh(folder / "mesh.npz", target, context.evaluated_depsgraph_get(), self.uv_map)
        else:
            place = Moving(folder, scene.session_uid, target.session_uid, self.uv_map)
            seen_by = chosen_camera(scene, normals_image)
            if seen_by is None and remembered(normals_image, "camera") is None:
                seen_by = rig_camera(scene)
            if seen_by is not None:
                camera = CAMERAS
                place = replace(place, camera=seen_by.session_uid, size=picture_size(normals_image))
            begun = place.begin(self._frames)
        self.later(begun.slices)
        self._bake_target = [_bake_target(target, begun)]
        if camera != CAMERAS:
            self._write_camera(scene, folder / camera, normals_image)
        return str(folder / (MESHES if self.animated else "mesh.npz")), str(folder / camera)

    def _other_rigs(self, scene: Any) -> list[Any]:
        """The scene's rigs that are not chosen and have normals."""
        if self._frames:
            raise SettingsError("sequences are baked for one rig at a time; switch All Rigs off")
        others = [one for one in all_rigs(scene) if one != scene.mps and one.estimate.image is not None]
        if any(one.estimate.image.source == "SEQUENCE" for one in others):
            raise SettingsError("one of the rigs has a sequence, which is baked on its own; switch All Rigs off")
        return others

    def _other_views(self, scene: Any, rigs: Sequence[Any], folder: Path) -> list[str]:
        """The normals and cameras of further rigs, as the core takes them."""
        views = []
        for number, one in enumerate(rigs):
            image = one.estimate.image
            camera = folder / f"camera_{number}.json"
            if lacks_camera(scene, image):
                raise GeometryError(
                    f'nobody knows the camera of the normals "{image.name}"; choose their rig and press Align Photo'
                )
            if not write_photo_camera(camera, scene, image, one.rig.camera):
                raise GeometryError(f'the camera of the normals "{image.name}" is gone; estimate them again')
            views.append(f"{camera}={image_file(image, 'normal map', 'estimate the normals again')}")
        return views

    def _albedos(self, rigs: Sequence[Any]) -> tuple[str, ...]:
        """The albedos of the rigs' photos, where all of them have one."""
        images = [one.estimate.albedo_image for one in rigs]
        if self._frames or None in images:
            return ()
        return tuple(str(image_file(image, "albedo", "estimate the normals again")) for image in images)

    def finish(self, context: Any, result: dict[str, Any]) -> None:
        scene = self.scene(f"its texture is in {self._output}")
        turned = "; DirectX, so the material turns its green round for Blender" if self.convention == "DIRECTX" else ""
        if self._frames:
            self._assign_frames(scene, Path(result["first_output"]))
            counts = f"{result['count']} textures are in {self._output}, {result['made']} made now"
            self.report({"INFO"}, f"{counts}{turned}")
            return
        self.assign_result(scene, result)
        self.report({"INFO"}, f"{self.written(result)}{turned}")

    def _assign_frames(self, scene: Any, first: Path) -> None:
        """Load a sequence of textures and put it on the target."""
        (onto,) = self._bake_target
        target = by_session_uid(bpy.data.objects, onto.uid)
        if target is None:
            raise InputError(f"the target is gone; its textures are in {self._output}")
        image = load_frames(first, f"MPS {target.name} Frames")
        self.made(image)
        scene.mps.bake.image = image
        if (None, None) in self._bases:
            store_base_map(image, self._bases[None, None])
        worn = [AssignedTexture(target, (image,), onto.uv_map)]
        for sentence in assign_textures(worn, self.space, self.convention, self._frames):
            self.report({"INFO"}, sentence)
        mark_assets(worn, self.mark_asset)


def texture_name(settings: Any, name: str) -> str:
    """What a texture for an object of that name is called that is given none: as the preset wants it."""
    preset = PRESETS["blender" if settings.preset == "CUSTOM" else settings.preset.lower()]
    return preset.stem(name)


def bits(settings: Any, suffix: str) -> int:
    """Bits a channel for a file with that ending."""
    return BITS[suffix] if settings.bits == "AUTO" else int(settings.bits)


def _refuse_linked(target: Any) -> None:
    """What another file holds cannot be given a material. A linked material can: a copy of it is worn."""
    for datablock, what in ((target, "object"), (target.data, "mesh")):
        if datablock is not None and datablock.library is not None:
            raise InputError(
                f'the {what} "{datablock.name}" is linked from {datablock.library.filepath}; make it local first'
            )


register, unregister = bpy.utils.register_classes_factory((MPS_OT_bake,))
