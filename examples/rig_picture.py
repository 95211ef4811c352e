"""How three LEDs, the camera and the object stand, drawn by Blender for the documentation and the panel's help.

Leaves rig.png in examples/output.

    python examples/rig_picture.py
"""

from itertools import pairwise
from math import cos, radians, sin
from pathlib import Path

import bpy
from mathutils import Vector

OUTPUT = Path(__file__).resolve().parent / "output" / "rig.png"
SIZE = 1000, 520
OBJECT, CAMERA = Vector((0.0, 0.0, 1.6)), Vector((0.0, -4.4, 1.6))
# As the camera sees them: each lamp's name, colour and direction around the camera's axis.
LAMPS = {"red": ((1.0, 0.05, 0.03), 90), "green": ((0.05, 1.0, 0.08), 210), "blue": ((0.05, 0.2, 1.0), 330)}
SLANT, REACH = radians(35), 3.0
VIEW, VIEWED = Vector((6.6, -7.0, 4.0)), Vector((-0.1, -1.65, 1.62))
VIEWED_RIGHT = (VIEWED - VIEW).cross(Vector((0, 0, 1))).normalized()
GREY, DARK, INK = (0.7, 0.7, 0.7), (0.012, 0.012, 0.014), (0.9, 0.9, 0.9)


def material(colour: tuple[float, ...], emitted: float = 0.0, opacity: float = 1.0) -> bpy.types.Material:
    made = bpy.data.materials.new("part")
    made.use_nodes = True
    shader = made.node_tree.nodes["Principled BSDF"]
    shader.inputs["Base Color"].default_value = (*colour, 1)
    shader.inputs["Roughness"].default_value = 0.6
    shader.inputs["Emission Color"].default_value = (*colour, 1)
    shader.inputs["Emission Strength"].default_value = emitted
    shader.inputs["Alpha"].default_value = opacity
    return made


def painted(colour: tuple[float, ...], **more: float) -> bpy.types.Object:
    """The object that was just added, in one colour; parts that glow cast no light of their own."""
    part = bpy.context.object
    part.data.materials.append(material(colour, **more))
    if more:
        part.visible_diffuse = part.visible_glossy = part.visible_shadow = False
    return part


def rod(start: Vector, end: Vector, radius: float, colour: tuple[float, ...], wide: float = 1.0, **more: float) -> None:
    """A cylinder between two points; a cone whose end is `wide` times as thick, if that is given."""
    along = end - start
    bpy.ops.mesh.primitive_cone_add(
        vertices=48, radius1=radius, radius2=radius * wide, depth=along.length, location=(start + end) / 2
    )
    painted(colour, **more).rotation_euler = along.to_track_quat("Z", "Y").to_euler()


def dashed(start: Vector, end: Vector, dashes: int = 22) -> None:
    step = (end - start) / (2 * dashes - 1)
    for dash in range(dashes):
        rod(start + 2 * dash * step, start + (2 * dash + 1) * step, 0.011, INK, emitted=1.0)


def arc() -> None:
    """The angle between a lamp and the camera's axis."""
    steps = [SLANT * step / 16 for step in range(17)]
    places = [OBJECT + 2.1 * Vector((0, -cos(angle), sin(angle))) for angle in steps]
    for start, end in pairwise(places):
        rod(start, end, 0.011, INK, emitted=1.0)
    label("20\N{DEGREE SIGN} to 45\N{DEGREE SIGN}", OBJECT + Vector((0, -1.22, 0.36)), 0.16)


def label(text: str, place: Vector, size: float = 0.2, align: str = "CENTER") -> None:
    bpy.ops.object.text_add(location=place)
    text_object = painted(INK, emitted=1.0)
    text_object.data.body, text_object.data.size, text_object.data.align_x = text, size, align
    text_object.rotation_euler = bpy.context.scene.camera.rotation_euler


def lamp(name: str, colour: tuple[float, float, float], tilt: float) -> None:
    """An LED on its stand, and the light that it throws on the object."""
    around = radians(tilt)
    place = OBJECT + REACH * Vector((sin(SLANT) * cos(around), -cos(SLANT), sin(SLANT) * sin(around)))
    towards = (OBJECT - place).normalized()
    rod(place - 0.22 * towards, place, 0.13, DARK, 1.25)
    rod(place, place + 0.02 * towards, 0.14, colour, emitted=8.0)
    rod(place + 0.03 * towards, OBJECT - 0.55 * towards, 0.13, colour, 4.2, emitted=0.35, opacity=0.07)
    foot = place - 0.12 * towards
    rod(foot, Vector((foot.x, foot.y, 0)), 0.022, GREY)
    bpy.ops.object.light_add(type="SPOT", location=place + 0.05 * towards)
    spot = bpy.context.object
    spot.rotation_euler = towards.to_track_quat("-Z", "Y").to_euler()
    spot.data.energy, spot.data.color, spot.data.spot_size, spot.data.shadow_soft_size = 150, colour, radians(22), 0.05
    side = -1 if cos(around) < 0 else 1
    label(name, place + 0.27 * side * VIEWED_RIGHT + Vector((0, 0, -0.06)), align="RIGHT" if side < 0 else "LEFT")


def room() -> None:
    """The object on its plinth before black cloth, and the camera on a tripod."""
    bpy.ops.mesh.primitive_plane_add(size=30)
    painted((0.09, 0.09, 0.1))
    bpy.ops.mesh.primitive_plane_add(size=3.4, location=(0, 2.4, 1.7), rotation=(radians(90), 0, 0))
    painted(DARK)
    rod(Vector((0, 0, 0)), OBJECT - Vector((0, 0, 0.6)), 0.3, (0.2, 0.2, 0.2))
    bpy.ops.mesh.primitive_monkey_add(size=1.15, location=OBJECT)
    statue = painted((0.8, 0.8, 0.8))
    statue.modifiers.new("smooth", "SUBSURF").render_levels = 2
    bpy.ops.object.shade_smooth()
    bpy.ops.mesh.primitive_cube_add(location=CAMERA)
    body = painted((0.05, 0.05, 0.055))
    body.scale = 0.22, 0.11, 0.15
    rod(CAMERA, CAMERA + Vector((0, 0.36, 0)), 0.11, (0.08, 0.08, 0.085))
    for angle in (90, 210, 330):
        foot = Vector((CAMERA.x + 0.55 * cos(radians(angle)), CAMERA.y + 0.55 * sin(radians(angle)), 0))
        rod(CAMERA - Vector((0, 0, 0.12)), foot, 0.022, GREY)


def main() -> None:
    bpy.ops.wm.read_factory_settings(use_empty=True)
    scene = bpy.context.scene
    bpy.ops.object.camera_add(location=VIEW)
    scene.camera = bpy.context.object
    scene.camera.data.lens = 38
    scene.camera.rotation_euler = (VIEWED - VIEW).to_track_quat("-Z", "Y").to_euler()
    room()
    for name, (colour, tilt) in LAMPS.items():
        lamp(name, colour, tilt)
    dashed(CAMERA + Vector((0, 0.4, 0)), OBJECT - Vector((0, 0.75, 0)))
    arc()
    label("camera", CAMERA + Vector((0, 0, 0.3)))
    label("object, before black cloth", OBJECT + Vector((0, 0.2, 0.72)), align="LEFT")
    bpy.ops.object.light_add(type="AREA", location=(4, -6, 7))
    fill = bpy.context.object
    fill.data.energy, fill.data.size = 260, 5
    fill.rotation_euler = (Vector((0, -1.5, 0)) - fill.location).to_track_quat("-Z", "Y").to_euler()
    scene.render.engine, scene.cycles.samples, scene.cycles.use_denoising = "CYCLES", 32, True
    scene.render.resolution_x, scene.render.resolution_y = SIZE
    scene.view_settings.view_transform = "Standard"
    scene.render.filepath = str(OUTPUT)
    bpy.ops.render.render(write_still=True)


if __name__ == "__main__":
    main()
