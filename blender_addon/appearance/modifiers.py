"""Modifiers that the add-on adds to objects. They are found again by name, so a step can be run any number of times."""

from typing import Any

import bpy

# The modifiers of `mps.displace`. Textures are baked onto the object without them, and heights refer to that.
SUBDIVISION, DISPLACE, TRIAL, FACES = "MPS Subdivision", "MPS Displace", "MPS Trial", "MPS Faces"
SMOOTHNESS = "MPS Smoothness"
_KINDS = {**dict.fromkeys((SUBDIVISION, TRIAL, FACES), "SUBSURF"), DISPLACE: "DISPLACE", SMOOTHNESS: "WEIGHTED_NORMAL"}


def find_modifier(obj: Any, name: str) -> Any:
    """The object's modifier of that name, None if there is none. One of another type is ignored."""
    found = obj.modifiers.get(name)
    return found if found is not None and found.type == _KINDS[name] else None


def subdivide(target: Any, kind: str, levels: int, rendered: int, name: str = SUBDIVISION) -> None:
    """Add a Subdivision modifier to the object, or update that of an earlier run; none for 0 levels.

    levels, rendered: levels in the viewport and in renders.
    """
    if not levels:
        remove_modifier(target, name)
        return
    modifier = find_modifier(target, name)
    if modifier is None:
        modifier = _new_modifier(target, name)
        if find_modifier(target, DISPLACE):  # it displaces the subdivided vertices, so it must come after
            target.modifiers.move(len(target.modifiers) - 1, target.modifiers.find(DISPLACE))
    modifier.subdivision_type = kind
    modifier.levels, modifier.render_levels = levels, rendered
    # The texture was baked onto the unsmoothed UVs.
    modifier.uv_smooth = "NONE"
    modifier.use_custom_normals = False


def keep_smoothness(target: Any, kept: bool) -> None:
    """Make the object's subdivision keep the shading normals of the mesh before it, or compute new ones.

    Cycles shows no light from behind the shading normals, whatever the normal map says: flat-shaded facets have black
    edges near the terminator.
    """
    subdivision = find_modifier(target, SUBDIVISION)
    if subdivision is not None:
        subdivision.use_custom_normals = kept
    # Only custom normals pass through a subdivision. These are equal to Blender's own.
    if subdivision is None or not kept or target.data.has_custom_normals:
        remove_modifier(target, SMOOTHNESS)
        return
    modifier = find_modifier(target, SMOOTHNESS) or _new_modifier(target, SMOOTHNESS)
    modifier.mode, modifier.weight, modifier.keep_sharp = "CORNER_ANGLE", 50, True
    own, after = target.modifiers.find(SMOOTHNESS), target.modifiers.find(SUBDIVISION)
    target.modifiers.move(own, after - (own < after))


def move_by_modifier(target: Any, image: Any, uv_map: str, strength: float, midlevel: float) -> None:
    """Add a Displace modifier with the heights after all others, or update that of an earlier run.

    strength, midlevel: of the heights, in object space.
    """
    modifier = find_modifier(target, DISPLACE) or _new_modifier(target, DISPLACE)
    texture = modifier.texture
    # A duplicate of the object shares the texture.
    if texture is None or texture.type != "IMAGE" or texture.users > 1:
        texture = modifier.texture = bpy.data.textures.new(f"MPS {target.name} Height", "IMAGE")
    texture.image, texture.extension = image, "EXTEND"
    texture.use_clamp = False  # heights go below 0
    modifier.texture_coords, modifier.uv_layer = "UV", uv_map
    modifier.direction, modifier.space = "NORMAL", "LOCAL"
    modifier.strength, modifier.mid_level = strength, midlevel


def remove_modifier(target: Any, name: str) -> None:
    """Remove the object's modifier of that name, if any."""
    modifier = find_modifier(target, name)
    if modifier is not None:
        target.modifiers.remove(modifier)


def _new_modifier(target: Any, name: str) -> Any:
    """A modifier of that name after all others. One of another type is renamed."""
    if name in target.modifiers:
        target.modifiers[name].name = "Modifier"
    return target.modifiers.new(name, _KINDS[name])
