"""Objects of a scene by session UID, by name and by visibility in a render, and settings that change for a while."""

from collections.abc import Collection, Iterator
from contextlib import contextmanager
from typing import Any

import bpy

from mpsnet_core.errors import InputError


@contextmanager
def temporarily(*settings: tuple[Any, str, Any]) -> Iterator[None]:
    """Within the with block, settings have other values: each is an owner, a name and a value."""
    changed = []
    try:
        for owner, name, value in settings:
            before = getattr(owner, name)
            if before != value:  # setting a property, even to its own value, redraws what it belongs to
                changed.append((owner, name, before))
                setattr(owner, name, value)
        yield
    finally:
        for owner, name, before in changed:
            setattr(owner, name, before)


def by_session_uid(datablocks: Any, session_uid: int) -> Any:
    """The data-block with this session UID, even if it was renamed; None if it was removed."""
    return next((one for one in datablocks if one.session_uid == session_uid), None)


def find_object(scene: Any, name: str) -> Any:
    """The scene's object of that name. Raises InputError if there is none."""
    target = scene.objects.get(name)
    if target is None:
        raise InputError(f'there is no object "{name}" in the scene; check its name')
    return target


def check_in_scene(scene: Any, obj: Any, what: str) -> None:
    """Raise InputError if an object in a setting is not in the scene: settings keep deleted objects alive."""
    if scene not in obj.users_scene:
        raise InputError(f'the {what} "{obj.name}" was deleted, or is in another scene; choose one of this scene')


def refuse_linked_scene(scene: Any) -> None:
    """Raise InputError if a scene is linked from another file, and so cannot get objects."""
    if scene.library is not None:
        raise InputError(f'the scene "{scene.name}" is linked from {scene.library.filepath}; make it local first')


def refuse_unselectable(obj: Any) -> None:
    """Raise InputError if Blender does not let an object be selected."""
    if obj.hide_select or not obj.visible_get():
        raise InputError(f'"{obj.name}" is hidden or not selectable; show it first')


def remove_object(obj: Any) -> None:
    """Remove an object from the file, and its data unless something else uses them."""
    data = obj.data
    bpy.data.objects.remove(obj)
    if data is not None and not data.users:
        bpy.data.batch_remove([data])


def select(layer: Any, objects: Collection[Any], active: Any) -> None:
    """Let these objects of a view layer be selected alone, and one be the active one."""
    for one in layer.objects:
        one.select_set(one in objects)
    layer.objects.active = active


def target_of(context: Any) -> Any:
    """The object to work on: the target of the step Bake, else the active object; None if there is none."""
    return context.scene.mps.bake.target or context.view_layer.objects.active  # `--command` has no context.object


def view_layer(scene: Any) -> Any:
    """The view layer in use; for a scene that is not shown, the first one."""
    return bpy.context.view_layer if scene == bpy.context.scene else scene.view_layers[0]


def rendered(layer: Any, special: str = "") -> Iterator[Any]:
    """Objects of a view layer that its render shows, except lights and Grease Pencil, which is not lit.

    special: the parent collection that is holdout or indirect only in the view layer, which a photo does not support.
    """
    if layer.collection.hide_render:
        return
    if layer.holdout or layer.indirect_only:
        special = layer.collection.name
    # A collection in an excluded one may be included again.
    for obj in () if layer.exclude else layer.collection.objects:
        if obj.type in {"LIGHT", "GREASEPENCIL"} or obj.hide_render:
            continue
        if special:
            raise InputError(
                f'"{obj.name}" is in the collection "{special}", which this view layer shows as holdout or indirect '
                "only; switch that off or exclude the collection"
            )
        yield obj
    for child in layer.children:
        yield from rendered(child, special)
