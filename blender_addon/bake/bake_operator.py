"""Shared by the bake operators: the objects to bake onto, the files, and the assignment of results."""

from collections.abc import Callable, Mapping, Sequence
from pathlib import Path
from typing import Any

import bpy
from mathutils import Matrix

from mpsnet_core.bake.map_list import write_map_list
from mpsnet_core.bake.operations import WrittenTexture
from mpsnet_core.bake.presets import PRESETS, check_preset
from mpsnet_core.errors import InputError, Note
from mpsnet_core.operation import Operation, from_facts
from mpsnet_core.scene.texture_names import albedo_file

from ..appearance.shader_graph import normal_inputs, uses_nodes
from ..child_process.core_process import Work
from ..image_records import Provenance, images_of, remember, remembered
from ..images import load_frames
from ..operators.core_run import RunsCore
from ..outputs import output_path, overruled_format, requested_folder
from ..scene.mesh_file import BegunMesh, slot_labels
from ..scene.objects import by_session_uid, check_in_scene, find_object, target_of
from ..scene.surfaces import mesh_stamp
from ..settings.declared import BoolSetting, StringSetting, options_of
from .assign_textures import assign_albedo, assign_textures, mark_assets
from .base_maps import base_map_files, maps_before_bake, store_base_map
from .coverage import coverage_folder, store_coverage
from .gltf_export import export_notes
from .texture_sets import (
    SPLITS,
    AssignedTexture,
    BakeTarget,
    Part,
    files_for,
    load_textures,
    refuse_other_projects,
    refuse_shared,
    refuse_to_overwrite_other_objects,
    texture_of,
    with_tokens,
)

_NO_SHADER = "no shader with a Normal input reaches its active Material Output"
# Seen fraction below which a note is given; a single photo sees about a third of an object.
_HARDLY_SEEN = 0.1
# A texture is not overwritten, unless the user says so, by one of which less than this fraction of what it saw is seen.
_KEPT = 0.6
# Stored with a texture: the fraction of the surface that was seen.
SEEN = "seen"


class BakeOperator(RunsCore):
    """Base of the bake operators: the objects that get textures, and the settings of the step Bake."""

    target: StringSetting(
        "Target", "Name of the mesh object that gets the texture. Empty: the panel's target, else the active object"
    )

    anyway: BoolSetting(
        "Bake Anyway", "Write the texture even if the photo sees much less of the object than that of the texture there"
    )

    _coloured = False  # whether the albedo is baked as well
    _frames = range(0)  # of the timeline, if a sequence is baked

    def _prepared(self, context: Any, folder: Path) -> tuple[Work, Sequence[Path]]:
        settings = context.scene.mps.bake
        before = settings.target, settings.baked
        try:
            prepared = super()._prepared(context, folder)
            owners = self.result_owners()
            refuse_to_overwrite_other_objects(owners)
            if not bpy.app.background:  # a script that runs again intends to overwrite its results
                refuse_other_projects(owners)
            return prepared
        except BaseException:
            settings.target, settings.baked = before  # a rejected one would be rejected ever after
            raise

    def result_owners(self) -> dict[Path, list[Any]]:
        """The files to write with their objects, for :func:`.texture_sets.refuse_to_overwrite_other_objects`."""
        textures = files_for(self._bake_targets, self._output)
        return {**textures, **{albedo_file(file): owners for file, owners in textures.items() if self._coloured}}

    def baked_object(self, context: Any) -> Any:
        """The object to bake onto. Raises InputError if there is none, or it is linked from another file."""
        settings = context.scene.mps.bake
        if self.target:
            settings.target = find_object(context.scene, self.target)
        target = target_of(context)
        if target is None:
            raise InputError("there is no target to bake onto; choose a mesh object")
        check_in_scene(context.scene, target, "target")
        if settings.assign:
            check_shows_normals(target)
        settings.baked = target
        return target

    def baked_objects(self, context: Any) -> list[Any]:
        """The objects to bake onto. Raises InputError if there are none, or one cannot get a texture."""
        settings = context.scene.mps.bake
        if settings.objects == "ACTIVE":
            return [self.baked_object(context)]
        selected = sorted(context.view_layer.objects.selected, key=lambda obj: obj.name)
        targets = [obj for obj in selected if obj.type == "MESH"]
        if not targets:
            raise InputError("no mesh object is selected to bake onto; select some, or bake onto the target alone")
        if settings.assign:
            for target in targets:
                check_shows_normals(target)
            refuse_shared(targets, settings.split)
        return targets

    def texture_options(
        self, operation: type[Operation], settings: Any, targets: Sequence[Any], folder: Path
    ) -> dict[str, Any]:
        """The core's options for the texture, its coverage and the base maps that it goes on top of."""
        if settings.preset != "CUSTOM":
            check_preset(settings.preset.lower(), settings.space.lower(), settings.convention.lower())
        options = options_of(operation, settings, without=("preset",))
        options |= {"size": str(settings.size), "level": low_frequencies(self), "output": str(self._output)}
        options["coverage"] = None if self._frames else coverage_folder()
        there = images_of(files_for(self._bake_targets, self._output))
        if not self.anyway and (before := max((float(remembered(one, SEEN) or 0) for one in there), default=0)):
            options["least_seen"] = round(_KEPT * before, 3)
        if settings.padding != "NEAREST":
            del options["margin"]
        self._bases = maps_before_bake(targets, self._bake_targets, self._output)
        if not settings.onto:
            return {name: value for name, value in options.items() if not name.startswith("onto")}
        if settings.onto_file:
            return options
        maps = base_map_files(targets, self._bake_targets, self._output)
        if not (maps[0].object or maps[0].material):  # the one of all
            return {**options, "onto": str(maps[0].file), "onto_convention": maps[0].convention}
        write_map_list(folder / "maps.json", maps)
        return {**options, "onto": str(folder / "maps.json")}

    def write_meshes(
        self, context: Any, folder: Path, targets: Sequence[Any], motion: Callable[[Any], Matrix | None]
    ) -> tuple[str, ...]:
        """Write the objects' mesh files, and remember the objects. Returns the paths.

        motion: for an object, the motion from Blender's world to where the cameras saw it; None if there is none.
        """
        uv_map, paths, self._bake_targets = context.scene.mps.bake.uv_map, [], []
        for number, target in enumerate(targets):
            path = folder / f"mesh_{number}.npz"
            begun = self.write_mesh(context, path, target, uv_map, motion(target))
            self._bake_targets.append(bake_target(target, begun))
            paths.append(str(path))
        return tuple(paths)

    def texture_file(self, context: Any, targets: Sequence[Any]) -> Path:
        """The texture's file, with tokens in its name if there are several. In a folder, it gets the preset's name."""
        bake = context.scene.mps.bake
        active = context.view_layer.objects.active
        name = (active if active in targets else targets[0]).name
        # "<" and ">" are not allowed in file names; tokens are added after the path is checked.
        name = texture_name(bake, "splits" if SPLITS[bake.split] else name)
        given = getattr(self, "output", bake.output)
        path = output_path(given, name, bake.file_format)
        if SPLITS[bake.split] and requested_folder(given) is not None:
            path = path.with_name(path.name.replace("splits", SPLITS[bake.split]))
        self._notes = overruled_format(path, bake)
        return with_tokens(path, bake.split, bake.tiles)

    def assign_result(self, scene: Any, result: dict[str, Any]) -> None:
        """Load the core's textures and assign them to their objects, unless the files alone are wanted."""
        if not scene.mps.bake.assign:
            return
        existing = [(one, by_session_uid(bpy.data.objects, one.uid)) for one in self._bake_targets]
        if not any(target for _, target in existing):
            raise InputError(f"the target is gone; its texture is in {self._output}")
        bake, name = scene.mps.bake, self._bake_targets[0].name
        written = [from_facts(WrittenTexture, facts) for facts in result.get("outputs", ())]
        images, coverage, albedos = (load_textures(written, name, what) for what in ("", "coverage", "albedo"))
        if self._frames:
            images = {(None, None): load_frames(Path(result["first_output"]), f"MPS {name} Frames")}
        for image in (*images.values(), *albedos.values()):
            self.made(image)
        for part, image in images.items():
            if part in coverage:
                store_coverage(image, coverage[part])
                remember(image, SEEN, str(result["seen"]))
            if part in self._bases:
                store_base_map(image, self._bases[part])
        bake.image = next(iter(images.values()))
        assigned = _assigned(existing, images)
        sentences = assign_textures(assigned, bake.space, bake.convention, self._frames)
        sentences += [f'The albedo is baked too: image "{image.name}"' for image in albedos.values()]
        for sentence in [*sentences, *assign_albedo(_assigned(existing, albedos))]:
            self.tell(sentence)
        unshown = [*_without_normal(assigned), *_of_modifiers(self._bake_targets)]
        mixed = bake.tiles and any(len({*one.target.material_slots.keys()}) > 1 for one in assigned)
        for note in [*unshown, *export_notes(bake.space, bake.convention, mixed=mixed)]:
            self.note(note)
        mark_assets(assigned, bake.mark_asset)

    def written(self, result: dict[str, Any]) -> str:
        """A sentence on the files that were written."""
        if self._frames:
            return f"{result['count']} textures are in {self._output}, {result['made']} made now"
        count = len(result["outputs"])
        one = f"Texture written to {result['outputs'][0]['output']}"
        return one if count == 1 else f"{count} textures written to {self._output}"

    def remarks(self, result: dict[str, Any]) -> Sequence[Note]:
        if "seen" not in result:  # a sequence whose textures all existed
            return ()
        seen, filled = 100 * result["seen"], 100 * result.get("filled", 0)
        if result["seen"] < _HARDLY_SEEN:
            moved = "%.0f%% of the surface seen, %.0f%% filled; was the object or the camera moved since the photo?"
            return [Note(moved, seen, filled, level="look")]
        words = "%.0f%% of the surface seen, %.0f%% filled" if "filled" in result else "%.0f%% of the surface seen"
        return [Note(words, *(seen, filled)[: words.count("%.0f")])]


def _assigned(existing: Sequence[tuple[BakeTarget, Any]], images: Mapping[Part, Any]) -> list[AssignedTexture]:
    """The textures of the objects that still exist."""
    return [found for one, target in existing if target and (found := texture_of(one, target, images))]


def bake_target(target: Any, begun: BegunMesh) -> BakeTarget:
    """The data of an object, as its mesh file is started, that is needed when the textures are ready."""
    return BakeTarget(target.session_uid, target.name, begun.uv_map, tuple(slot_labels(target)), begun.used)


def low_frequencies(settings: Any) -> str:
    """The core's option for the size above which shapes come from the mesh instead of the photo."""
    if settings.level:
        return f"{settings.level_scale:g}"
    return "auto" if getattr(settings, "agreed", False) else "off"


def target_provenance(settings: Any) -> Provenance:
    """The target's mesh as provenance of a bake; empty if no target is known."""
    target = known_target(settings)
    if target is None:
        return {}
    return {**({"Target": target.data.name} if settings.target else {}), "Mesh": mesh_stamp(target)}


def known_target(settings: Any) -> Any:
    """The one object that a bake is onto: the panel's target, else the one that the last bake was made for; None if
    there are several, or it is unknown."""
    if settings.objects != "ACTIVE":
        return None
    target = settings.target or settings.baked
    return target if target is not None and target.type == "MESH" else None


def texture_name(settings: Any, name: str) -> str:
    """The default name of an object's texture, by the preset's convention."""
    preset = PRESETS["blender" if settings.preset == "CUSTOM" else settings.preset.lower()]
    return preset.stem(name)


def _without_normal(assigned: Sequence[AssignedTexture]) -> list[Note]:
    """A sentence for each material, or shader in a group, that cannot take a normal map."""
    sentences = []
    for material in dict.fromkeys(slot.material for one in assigned for slot in one.target.material_slots):
        found, closed = normal_inputs(material)
        if not found and not closed:
            words = 'Material "%s" does not show the texture: %s'
            sentences.append(Note(words, material.name, _NO_SHADER, level="look"))
        sentences += [Note(sentence, level="look") for sentence in closed]
    return sentences


def _of_modifiers(onto: Sequence[BakeTarget]) -> list[Note]:
    """A sentence for each material that comes from a modifier instead of a slot, and so gets no texture."""
    return [
        Note('Material "%s" of "%s" comes from a modifier and does not show the texture', name, one.name, level="look")
        for one in onto
        for name in sorted(one.used - set(one.labels))
    ]


def check_shows_normals(target: Any) -> None:
    """Raise InputError, before the work, if an object is linked or none of its materials can take a normal map.

    Missing materials are created later, and linked ones are copied.
    """
    for datablock, what in ((target, "object"), (target.data, "mesh")):
        if datablock is not None and datablock.library is not None:
            raise InputError(
                f'the {what} "{datablock.name}" is linked from {datablock.library.filepath}; make it local first'
            )
    materials = [slot.material for slot in target.material_slots]
    if not materials or not all(material and uses_nodes(material) for material in materials):
        return
    taken = [normal_inputs(material) for material in materials]
    if not any(found for found, _ in taken):
        closed = [sentence for _, sentences in taken for sentence in sentences]
        raise InputError(
            closed[0] if closed else f'no material of "{target.name}" can show a normal map: {_NO_SHADER}; link one'
        )
