"""The modifiers that the add-on gives objects: found again by their names, so that a step can be run any number of
times."""

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import bpy

# What `mps.displace` gives an object. Textures are baked onto the object without them, and heights are of that.
SUBDIVISION, DISPLACE, TRIAL, FACES = "MPS Subdivision", "MPS Displace", "MPS Trial", "MPS Faces"
SMOOTHNESS = "MPS Smoothness"
_KINDS = {
    **dict.fromkeys((SUBDIVISION, TRIAL, FACES), "SUBSURF"),
    DISPLACE: "DISPLACE",
    SMOOTHNESS: "WEIGHTED_NORMAL",
}


def find_modifier(obj: Any, name: str) -> Any:
    """The object's modifier of that name, None where there is none; one of another kind has the name by chance."""
    found = obj.modifiers.get(name)
    return found if found is not None and found.type == _KINDS[name] else None


def subdivide(target: Any, kind: str, levels: int, rendered: int, name: str = SUBDIVISION) -> None:
    """Give the object a Subdivision modifier, or the one of an earlier run these settings; none for no levels.

    levels, rendered: in the viewport and in renders.
    """
    if not levels:
        remove_modifier(target, name)
        return
    modifier = find_modifier(target, name)
    if modifier is None:
        modifier = _new_modifier(target, name)
        if find_modifier(target, DISPLACE):  # which moves the vertices that there are by then
            target.modifiers.move(len(target.modifiers) - 1, target.modifiers.find(DISPLACE))
    modifier.subdivision_type = kind
    modifier.levels, modifier.render_levels = levels, rendered
    # The texture was baked onto the UVs as they are.
    modifier.uv_smooth = "NONE"
    modifier.use_custom_normals = False


def keep_smoothness(target: Any, kept: bool) -> None:
    """Have the object's subdivision keep the shading normals that the mesh has before it, or make new ones.

    Cycles shows no light from behind the shading normals, whatever the normal map says: on facets that are shaded flat
    their edges are black near the terminator.
    """
    subdivision = find_modifier(target, SUBDIVISION)
    if subdivision is not None:
        subdivision.use_custom_normals = kept
    # Only normals of its own pass through a subdivision. These are as Blender makes them without.
    if subdivision is None or not kept or target.data.has_custom_normals:
        remove_modifier(target, SMOOTHNESS)
        return
    modifier = find_modifier(target, SMOOTHNESS) or _new_modifier(target, SMOOTHNESS)
    modifier.mode, modifier.weight, modifier.keep_sharp = "CORNER_ANGLE", 50, True
    own, after = target.modifiers.find(SMOOTHNESS), target.modifiers.find(SUBDIVISION)
    target.modifiers.move(own, after - (own < after))


@contextmanager
def subdivided(target: Any, kind: str, levels: int) -> Iterator[None]:
    """Within, the object is subdivided by one more modifier."""
    subdivide(target, kind, levels, levels, TRIAL)
    try:
        yield
    finally:
        remove_modifier(target, TRIAL)


def move_by_modifier(target: Any, image: Any, uv_map: str, strength: float, midlevel: float) -> None:
    """Give the object a Displace modifier after all others, or the one of an earlier run these heights.

    strength, midlevel: the heights' in the object's own units.
    """
    modifier = find_modifier(target, DISPLACE) or _new_modifier(target, DISPLACE)
    texture = modifier.texture
    # A duplicate of the object has the same texture.
    if texture is None or texture.type != "IMAGE" or texture.users > 1:
        texture = modifier.texture = bpy.data.textures.new(f"MPS {target.name} Height", "IMAGE")
    texture.image, texture.extension = image, "EXTEND"
    texture.use_clamp = False  # heights go below 0
    modifier.texture_coords, modifier.uv_layer = "UV", uv_map
    modifier.direction, modifier.space = "NORMAL", "LOCAL"
    modifier.strength, modifier.mid_level = strength, midlevel


def remove_modifier(target: Any, name: str) -> None:
    """Take a modifier off the object, where it has one of that name."""
    modifier = find_modifier(target, name)
    if modifier is not None:
        target.modifiers.remove(modifier)


def _new_modifier(target: Any, name: str) -> Any:
    """A modifier of that name after all others; one of another kind is renamed."""
    if name in target.modifiers:
        target.modifiers[name].name = "Modifier"
    return target.modifiers.new(name, _KINDS[name])
