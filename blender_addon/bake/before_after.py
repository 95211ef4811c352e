"""Before / After: in the viewport, an object's photo, its plain mesh, and the mesh with its texture, side by side.

Everything is drawn over the viewport by a shader of its own, so nothing in the scene changes and nothing is stored.
"""

from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any

import blf
import bpy
import gpu
import numpy as np
from bpy.app.translations import pgettext_iface as iface
from gpu_extras import presets
from gpu_extras.batch import batch_for_shader
from mathutils import Matrix, Vector
from numpy.typing import NDArray

from mpsnet_core.arrays.unit_vectors import normalised
from mpsnet_core.errors import InputError
from mpsnet_core.io.files import temporary_folder
from mpsnet_core.scene.camera import Camera, read_camera
from mpsnet_core.scene.mesh import Mesh, read_mesh

from ..appearance.nodes import ALBEDO_NODE, TEXTURE_NODE, UV_NODE, find_node, trees_of
from ..image_records import remembered
from ..operators.progress import redraw_panels
from ..operators.reporting import ReportingOperator
from ..photo.camera import back_to_photo, lacks_photo_camera, write_photo_camera
from ..photo.markers import OPEN, draw_line, draw_text
from ..photo.places import Place, seen_at
from ..scene.mesh_file import begin_mesh
from ..scene.objects import target_of
from . import relight

_gpu: Any = gpu  # the type stubs of both lack arguments
_draw_picture: Any = presets.draw_texture_2d

PARTS = ("Photo", "Mesh", "Mesh with Texture")
KEYS = "Move the mouse: light.  Drag: dividers.  Esc: end"
# Of the viewport beside its bars: the share of the pictures' column.
_COLUMN = 0.2
# The lamp is at the horizon where the mouse is this share of the viewport's height from its middle.
_REACH, _LOWEST = 0.45, 0.25
_FILLED = 0.95  # the share of the room beside the pictures' column that the object fills at most
_TEXT = 14, 10  # sizes of a text, the second where the first does not fit
_FINER = 2  # pixels of what is drawn for each pixel of the viewport, along each side
_BACKGROUND = (0.045, 0.045, 0.05, 1.0)

_VERTEX = """
void main() {
  gl_Position = seen * vec4(place, 1.0);
  at = place; way = normal; across = first; along = second; out_of = third; on_texture = uv; on_photo = shot;
}
"""
_FRAGMENT = """
void main() {
  float here = gl_FragCoord.x / ends.z;
  if (here < ends.x) {
    vec3 taken = on_photo.z > 0.0 ? texture(photo, on_photo.xy).rgb * ends.w : vec3(0.01);
    colour = vec4(pow(clamp(taken, 0.0, 1.0), vec3(1.0 / 2.2)), 1.0);
    return;
  }
  vec3 n = way, paint = vec3(0.3);
  if (here > ends.y) {
    vec3 t = texture(normals, on_texture).xyz * 2.0 - 1.0;
    n = across * t.x + along * t.y + out_of * t.z;
    paint = texture(albedo, on_texture).rgb;
  }
  n = normalize(n);
  vec3 eye = normalize(viewer.xyz - at * viewer.w);
  float lit = max(dot(n, lamp.xyz), 0.0), shine = pow(max(dot(n, normalize(lamp.xyz + eye)), 0.0), 30.0);
  vec3 seen_light = paint * (0.05 + 0.05 * max(dot(n, eye), 0.0) + 1.15 * lit) + 0.06 * shine * lit;
  colour = vec4(pow(clamp(seen_light, 0.0, 1.0), vec3(1.0 / 2.2)), 1.0);
}
"""
_ATTRIBUTES = {
    **dict.fromkeys(("place", "normal", "first", "second", "third"), "VEC3"),
    **{"uv": "VEC2", "shot": "VEC3"},
}


def draw_results() -> None:
    """Draw the photo and the normals of the scene in a column at the left of the viewport, as far as they are there."""
    mps = bpy.context.scene.mps
    left, low, right, high = free_place(bpy.context.area)
    scale = bpy.context.preferences.system.ui_scale
    gap = 8 * scale
    width = _COLUMN * (right - left) - 2 * gap
    top = high - 8 * gap  # below the viewport's own text
    for label, image in (("Photo", mps.photo.image), ("Normals", mps.estimate.image)):
        if image is None or image.source == "TILED" or not all(image.size):
            continue
        height = min(width * image.size[1] / image.size[0], (high - low) / 2 - 8 * gap)
        across = height * image.size[0] / image.size[1]
        with suppress(RuntimeError, ValueError):  # its file is gone
            texture = _gpu.texture.from_image(image)
            gpu.state.blend_set("ALPHA")
            linear = not image.colorspace_settings.is_data
            corner = (left + gap, top - height)
            _draw_picture(texture, corner, across, height, is_scene_linear_with_rec709_srgb_target=linear)
            gpu.state.blend_set("NONE")
            draw_text((left + gap, top - height - 14 * scale), iface(label), OPEN)
            top -= height + 3 * gap


def free_place(area: Any) -> tuple[float, float, float, float]:
    """Left, lower, right and upper end of a viewport between its bars, in pixels of its main region."""
    window = next(region for region in area.regions if region.type == "WINDOW")
    left, low, right, high = 0, 0, window.width, window.height
    for region in area.regions:
        if region.type == "WINDOW" or min(region.width, region.height) <= 1:
            continue
        if region.alignment == "LEFT":
            left = max(left, region.x + region.width - window.x)
        elif region.alignment == "RIGHT":
            right = min(right, region.x - window.x)
        elif region.alignment == "TOP":
            high = min(high, region.y - window.y)
    return left, low, right, high


def room(area: Any) -> tuple[float, float, float, float]:
    """As :func:`free_place`, beside the pictures' column."""
    left, low, right, high = free_place(area)
    return left + _COLUMN * (right - left), low, right, high


def textures_of(obj: Any) -> dict[str, Any]:
    """The images of an object's baked normals, "normals", and colours, "albedo", as far as its materials show them."""
    trees = trees_of(obj) if obj is not None else []
    names = (("normals", TEXTURE_NODE), ("albedo", ALBEDO_NODE))
    found = {what: [node.image for tree in trees if (node := find_node(tree, name))] for what, name in names}
    return {what: next(filter(None, images)) for what, images in found.items() if any(images)}


def corners_of(mesh: Mesh, texture: Any) -> dict[str, NDArray[np.float32]]:
    """What the shader needs at the corners (3 T,) of a mesh's triangles, in world space.

    "first", "second" and "third" are the axes that the texture's red, green and blue stand for. texture: the image.
    """
    turn = mesh.normals_to_world
    normals, tangents = mesh.corner_normals.reshape(-1, 3), mesh.tangents.reshape(-1, 4)
    if remembered(texture, "space") == "OBJECT":
        axes = [np.broadcast_to(axis, normals.shape) @ turn for axis in np.eye(3)]
    else:
        pose = mesh.world_from_object[:3, :3]
        second = np.cross(normals, tangents[:, :3]) * tangents[:, 3:]
        axes = [normalised(tangents[:, :3] @ pose.T), normalised(second @ pose.T), normalised(normals @ turn)]
    if remembered(texture, "convention") == "DIRECTX":
        axes[1] = -axes[1]
    named = dict(zip(("first", "second", "third"), axes, strict=True))
    place = mesh.world_vertices[mesh.triangles].reshape(-1, 3)
    return {"place": place, "normal": normalised(normals @ turn), **named, "uv": mesh.uvs.reshape(-1, 2)}


def in_photo(camera: Camera, places: NDArray[np.floating[Any]], normals: NDArray[np.floating[Any]]) -> NDArray[Any]:
    """(N, 3) where a photo shows places in world space, from 0 to 1 with y up, and how much they face its camera."""
    seen = np.c_[places, np.ones(len(places))] @ camera.projection_rows().T
    pixels = seen[:, :2] / np.where(abs(seen[:, 2:]) > 1e-12, seen[:, 2:], 1)
    eye, axis = camera.world_from_camera[:3, 3], camera.world_from_camera[:3, 2]
    towards = axis if camera.projection == "orthographic" else eye - places
    across, up = (pixels / (camera.width, camera.height)).T
    return np.stack([across, 1 - up, (normals * towards).sum(axis=-1)], axis=-1)


def _shader() -> Any:
    interface = _gpu.types.GPUStageInterfaceInfo("mps_before_after")
    for kind, name in (
        *(("VEC3", name) for name in ("at", "way", "across", "along", "out_of", "on_photo")),
        ("VEC2", "on_texture"),
    ):
        interface.smooth(kind, name)
    info = _gpu.types.GPUShaderCreateInfo()
    info.push_constant("MAT4", "seen")
    for name in ("lamp", "viewer", "ends"):
        info.push_constant("VEC4", name)
    for slot, name in enumerate(("photo", "normals", "albedo")):
        info.sampler(slot, "FLOAT_2D", name)
    for slot, (name, kind) in enumerate(_ATTRIBUTES.items()):
        info.vertex_in(slot, kind, name)
    info.vertex_out(interface)
    info.fragment_out(0, "VEC4", "colour")
    info.vertex_source(_VERTEX)
    info.fragment_source(_FRAGMENT)
    return _gpu.shader.create_from_info(info)


def _plain(*colour: float) -> Any:
    """A texture of one colour."""
    return _gpu.types.GPUTexture((1, 1), format="RGBA32F", data=_gpu.types.Buffer("FLOAT", 4, [*colour, 1.0]))


@dataclass(frozen=True)
class View:
    """Where a viewport showed an object at first. All are in pixels of its main region, which bars cover in part."""

    middle: Vector
    """The middle of what was to be seen of the object."""
    extent: Vector
    """Width and height of that."""
    size: Vector
    """Width and height of the region."""

    @classmethod
    def of(cls, area: Any, ends: Sequence[Vector]) -> "View":
        """Where a viewport shows what has these corners in world space."""
        window = next(region for region in area.regions if region.type == "WINDOW")
        size, view = (window.width, window.height), area.spaces.active.region_3d.perspective_matrix
        seen = [seen_at(end, view, size) for end in ends]
        places = np.clip([place for place in seen if place is not None] or [(0, 0), size], 0, size)
        low, high = places.min(axis=0), places.max(axis=0)
        return cls(Vector((low + high) / 2), Vector(np.maximum(high - low, 1)), Vector(size))

    def scale(self, area: Any) -> float:
        """How much smaller the object is drawn so that it fits into the room: 1 where it does."""
        left, low, right, high = room(area)
        return min(1.0, _FILLED * (right - left) / self.extent.x, _FILLED * (high - low) / self.extent.y)

    def in_room(self, area: Any) -> Matrix:
        """(4, 4) moves the object into the middle of the room, in clip space."""
        (left, low, right, high), scale = room(area), self.scale(area)
        moved = Vector((left + right, low + high)) - 2 * scale * self.middle
        across, up = (by / side + scale - 1 for by, side in zip(moved, self.size, strict=True))
        return Matrix.Translation((across, up, 0)) @ Matrix.Diagonal((scale, scale, 1, 1))

    def dividers(self, area: Any) -> list[float]:
        """Where the object's second quarter begins and ends, from 0 to 1 across the room."""
        left, _, right, _ = room(area)
        return [0.5 - self.scale(area) * self.extent.x / 4 / (right - left), 0.5]


@dataclass(eq=False)
class _Comparison:
    """What is drawn over one viewport."""

    area: int
    """Pointer of the viewport, an area."""
    shader: Any
    """The shader."""
    batch: Any
    """The mesh."""
    textures: dict[str, Any]
    """The shader's textures by name, without "photo" if it is unknown where that was taken from."""
    titles: Sequence[str]
    """What stands over the parts."""
    ends: Sequence[Vector]
    """The corners of the object's box in world space."""
    mouse: tuple[float, float] = (-0.5, 0.5)
    """From -1 to 1, from the middle of the room; the lamp is there."""
    view: View | None = None
    """Where the viewport showed the object; known once it is drawn: before, the matrix is of an earlier view."""
    dividers: list[float] = field(default_factory=list)
    """Between the parts, from 0 to 1 across the room that the viewport has for them."""
    dragged: int | None = None
    """Number of the divider that is dragged."""
    handle: Any = None
    """Of what draws it."""
    canvas: Any = None
    """Where the mesh is drawn first, with its depth."""

    def begin(self) -> None:
        self.handle = bpy.types.SpaceView3D.draw_handler_add(self.draw, (), "WINDOW", "POST_PIXEL")
        relight.pause()
        _running.append(self)

    def leave(self) -> None:
        """Draw no more. Further calls do nothing."""
        if self in _running:
            _running.remove(self)
            bpy.types.SpaceView3D.draw_handler_remove(self.handle, "WINDOW")
            relight.resume()
            for workspace in bpy.data.workspaces:  # it may have moved to another one
                workspace.status_text_set(None)

    def lamp(self, towards_viewer: NDArray[np.float64]) -> NDArray[np.float64]:
        """(3,) direction to the lamp. towards_viewer: (3, 3) axes of the viewport in columns."""
        across, up = self.mouse
        out = np.sqrt(max(1 - across**2 - up**2, _LOWEST**2))
        return np.asarray(towards_viewer @ normalised(np.array([across, up, out])))

    def draw(self) -> None:
        context = bpy.context
        if context.area is None or context.area.as_pointer() != self.area:
            return
        region, view = context.region, context.region_data
        if self.view is None:
            self.view = View.of(context.area, self.ends)
            self.dividers = self.view.dividers(context.area)[0 if "photo" in self.textures else 1 :]
        size = _FINER * region.width, _FINER * region.height
        if self.canvas is None or (self.canvas.width, self.canvas.height) != size:
            self.canvas = _gpu.types.GPUOffScreen(*size)
        inverse = view.view_matrix.inverted()
        viewer = (*inverse.translation, 1) if view.is_perspective else (*inverse.col[2][:3], 0)
        with self.canvas.bind():
            _gpu.state.active_framebuffer_get().clear(color=_BACKGROUND, depth=1.0)
            gpu.state.depth_test_set("LESS")
            gpu.state.depth_mask_set(True)
            gpu.state.blend_set("NONE")
            shader, ends = self.shader, [at / region.width for at in self._ends(context.area)]
            shader.bind()
            shader.uniform_float("seen", self.view.in_room(context.area) @ view.perspective_matrix)
            shader.uniform_float("lamp", (*self.lamp(np.array(inverse.to_3x3())), 0))
            # From the viewer: an orthographic one is at infinity.
            shader.uniform_float("viewer", viewer)
            first = ends[1] if "photo" in self.textures else -1.0
            shader.uniform_float("ends", (first, ends[-2], size[0], 1.0))
            for name in ("photo", "normals", "albedo"):
                shader.uniform_sampler(name, self.textures.get(name) or self.textures["normals"])
            self.batch.draw(shader)
            gpu.state.depth_test_set("NONE")
            gpu.state.depth_mask_set(False)
        _draw_picture(self.canvas.texture_color, (0, 0), region.width, region.height)
        self._draw_titles(context)
        draw_results()

    def _ends(self, area: Any) -> list[float]:
        """Where the parts begin and end, in pixels of the viewport's main region."""
        left, _, right, _ = room(area)
        return [left + (right - left) * at for at in (0, *self.dividers, 1)]

    def _draw_titles(self, context: Any) -> None:
        scale, ends = context.preferences.system.ui_scale, self._ends(context.area)
        _, low, _, high = room(context.area)
        for end in ends[1:-1]:
            draw_line([(end, low), (end, high)], OPEN)
        for title, start, end in zip(self.titles, ends, ends[1:], strict=False):
            _draw_between(title, start, end, high - 26 * scale)
        _draw_between(iface(KEYS), free_place(context.area)[0], ends[1], low + 14 * scale)  # the status bar tells, too


_running: list[_Comparison] = []


def comparing() -> bool:
    """Whether a viewport shows the comparison."""
    return bool(_running)


class MPS_OT_before_after(ReportingOperator, bpy.types.Operator):
    """See the photo, the mesh, and the mesh with its texture side by side in the viewport, lit from the mouse.

    Drag the dividers. Esc or a right click ends it; the scene stays as it is"""

    bl_idname = "mps.before_after"
    bl_label = "Before / After"
    bl_options = {"REGISTER"}

    @classmethod
    def lacks(cls, context: Any) -> str:
        texture = textures_of(target_of(context)).get("normals")
        if texture is None:
            return "Bake a texture onto the target first"
        return "A texture of UDIM tiles is not compared; Relight shows it" if texture.source == "TILED" else ""

    def act(self, context: Any) -> None:
        raise InputError("the comparison is drawn in a window; a script has nothing to look at")

    def invoke(self, context: Any, event: bpy.types.Event) -> set[Any]:
        if comparing():
            _running[0].leave()
            redraw_panels(context.window_manager)
            return {"FINISHED"}
        return self.start_modal(context, self._start)

    def _start(self, context: Any) -> None:
        areas = [one for one in (context.area, *context.window.screen.areas) if one is not None]
        area = next((one for one in areas if one.type == "VIEW_3D"), None)
        if area is None:
            raise InputError("there is no 3D viewport in this window; open one")
        target = target_of(context)
        self._comparison = _comparison(context, area, target)
        self._comparison.begin()
        context.window_manager.modal_handler_add(self)
        context.workspace.status_text_set(iface(KEYS))
        redraw_panels(context.window_manager)
        area.tag_redraw()

    def modal(self, context: Any, event: bpy.types.Event) -> set[Any]:
        mine = self._comparison
        area = next((one for one in context.window.screen.areas if one.as_pointer() == mine.area), None)
        ends = event.type in {"ESC", "RIGHTMOUSE"} and event.value == "PRESS"
        if mine not in _running or area is None or area.type != "VIEW_3D" or ends:
            mine.leave()
            redraw_panels(context.window_manager)
            if area is not None:
                area.tag_redraw()
            return {"FINISHED"} if ends else {"FINISHED", "PASS_THROUGH"}
        place = _within(area, event)
        if event.type == "LEFTMOUSE" and event.value == "RELEASE" and mine.dragged is not None:
            mine.dragged = None
            return {"RUNNING_MODAL"}
        if place is None or not mine.dividers or event.type not in {"MOUSEMOVE", "LEFTMOUSE"}:
            return {"PASS_THROUGH"}
        if event.type == "LEFTMOUSE" and event.value == "PRESS":
            mine.dragged = int(np.argmin([abs(place[0] - at) for at in mine.dividers]))
        if mine.dragged is None:
            left, low, right, high = room(area)
            reach = _REACH * min(right - left, high - low)
            mine.mouse = (place[0] - 0.5) * (right - left) / reach, (place[1] - 0.5) * (high - low) / reach
        else:
            mine.dividers[mine.dragged] = min(max(place[0], 0), 1)
            mine.dividers.sort()
        area.tag_redraw()
        return {"RUNNING_MODAL"}

    def cancel(self, context: Any) -> None:
        """Also called by Blender if another file is opened or the window is closed."""
        self._comparison.leave()


def _draw_between(text: str, start: float, end: float, height: float) -> None:
    """Draw a text in the middle between two places, smaller where it would not fit; not at all where that would not."""
    for size in _TEXT:
        blf.size(0, size * bpy.context.preferences.system.ui_scale)
        width = blf.dimensions(0, text)[0]
        if width < end - start:
            draw_text(((start + end - width) / 2, height), text, OPEN, size=size)
            return


def _within(area: Any, event: Any) -> Place | None:
    """The mouse from 0 to 1 across a viewport's room; None outside of the viewport, as in the sidebar."""
    window = next(region for region in area.regions if region.type == "WINDOW")
    left, low, right, high = free_place(area)
    x, y, start = event.mouse_x - window.x, event.mouse_y - window.y, room(area)[0]
    inside = left <= x < right and low <= y < high
    return ((x - start) / (right - start), (y - low) / (high - low)) if inside else None


def _comparison(context: Any, area: Any, target: Any) -> _Comparison:
    """The comparison of an object in a viewport. Raises InputError if its mesh cannot be read."""
    images, photo = textures_of(target), context.scene.mps.photo.image
    with temporary_folder() as folder:
        depsgraph = context.evaluated_depsgraph_get()
        uv_map = next((node.uv_map for tree in trees_of(target) if (node := find_node(tree, UV_NODE))), "")
        begin_mesh(folder / "mesh.npz", target, depsgraph, uv_map).whole()
        corners = corners_of(read_mesh(folder / "mesh.npz"), images["normals"])
        corners["shot"] = np.zeros_like(corners["place"])
        taken = photo is not None and photo.source != "TILED" and not lacks_photo_camera(context.scene, photo)
        if taken and write_photo_camera(folder / "camera.json", context.scene, photo):
            images["photo"] = photo
            stood = np.array(back_to_photo(photo, target) or np.eye(4))
            places = corners["place"] @ stood[:3, :3].T + stood[:3, 3]
            camera = read_camera(folder / "camera.json")
            corners["shot"] = in_photo(camera, places, corners["normal"] @ np.linalg.inv(stood[:3, :3]))
    try:
        textures = {what: _gpu.texture.from_image(image) for what, image in images.items()}
    except RuntimeError as error:
        raise InputError(f"Blender cannot show a texture: {error}") from None
    textures.setdefault("albedo", _plain(0.3, 0.3, 0.3))
    shader = _shader()
    batch: dict[str, Any] = {name: values.astype(np.float32) for name, values in corners.items()}
    photo_title, plain, textured = map(iface, PARTS)
    titles = [photo_title, f"{plain}, {len(target.data.polygons):,} {iface('Faces')}", textured]
    return _Comparison(
        area.as_pointer(),
        shader,
        batch_for_shader(shader, "TRIS", batch),
        textures,
        titles if "photo" in textures else titles[1:],
        [target.matrix_world @ Vector(corner) for corner in target.bound_box],
    )


def unregister() -> None:
    for one in list(_running):
        one.leave()
