"""Pick Points: pairs of points in the photo and on the mesh, clicked side by side, for Align Photo."""

import time
from collections.abc import Sequence
from contextlib import suppress
from dataclasses import dataclass, field
from typing import Any, Literal

import bpy
import numpy as np
from mathutils import Matrix, Vector

from mpsnet_core.errors import InputError, Note
from mpsnet_core.estimate.alignment.points import MIN_PAIRS

from ..images import picture_size
from ..operators.progress import redraw_panels
from ..operators.reporting import ReportingOperator
from ..operators.show_image import image_editor
from ..scene.camera import scene_camera
from ..settings.messages import in_blender
from .align import MPS_OT_align_photo, mesh_of_photo
from .camera import chosen_camera, take_pairs_along
from .markers import OPEN, colour_of, draw_line, draw_marker, draw_text
from .places import Place, mesh_point, photo_pixel, photo_place, seen_at

# In pixels at UI scale 1: distance at which the mouse grabs a marker, and width of the column of the viewport's own
# gizmos at the right, which stay usable.
_GRAB, _BUTTONS = 12.0, 110.0
_KEYS = "Drag: move.  X: delete.  Backspace: take the last back.  Esc: end"
_HIDDEN = 0.3  # alpha of a marker whose point the mesh occludes
# How long the points are left alone before the photo is aligned by them.
_REST_SECONDS = 0.7
_ENDS, _DELETES = {"ESC", "RET", "NUMPAD_ENTER"}, {"X", "DEL"}

Side = Literal["pixel", "point"]


@dataclass(eq=False)
class _Picking:
    """The state while points are picked: the photo's editor, and what is drawn."""

    window: Any
    """The window in which the button was pressed."""
    editor: int
    """Pointer of the photo's editor, an area."""
    was: tuple[Any, str] | None
    """Image and mode that the editor showed before; None if it was created for this."""
    half: dict[Side, Sequence[float]] = field(default_factory=dict)
    """The first point of an incomplete pair, by its side."""
    dragged: tuple[int, Side] | None = None
    """Index and side of the point that is dragged."""
    pressed: bool = False
    """Whether the mouse button is held down on a marker."""
    fitted: bool = False
    """Whether the editor shows the whole photo."""
    hint: str = ""
    """Why the last click set nothing."""
    shown: Any = None
    """What was drawn last."""
    seen: Any = None
    """The pairs as they were a moment ago."""
    solved: Any = None
    """The pairs that the photo was last aligned with."""
    still_since: float = 0.0
    """When they were last changed, in seconds of a monotonic clock."""
    timer: Any = None
    """Asks now and then whether the points are at rest."""
    handles: list[tuple[Any, Any]] = field(default_factory=list)
    """Kinds of spaces, and what is drawn in them."""

    def area(self) -> Any:
        """The photo's editor; None if it was closed."""
        return next((area for area in self.window.screen.areas if area.as_pointer() == self.editor), None)

    def begin(self) -> None:
        for space, draw in ((bpy.types.SpaceImageEditor, self._draw_photo), (bpy.types.SpaceView3D, self._draw_mesh)):
            self.handles.append((space, space.draw_handler_add(draw, (), "WINDOW", "POST_PIXEL")))
        _running.append(self)

    def leave(self, *, restore: bool = True) -> None:
        """Remove what is drawn, and restore the window unless it is being closed. Further calls do nothing."""
        if self not in _running:
            return
        _running.remove(self)
        if self.timer is not None:
            bpy.context.window_manager.event_timer_remove(self.timer)
        for space, handle in self.handles:
            space.draw_handler_remove(handle, "WINDOW")
        for workspace in bpy.data.workspaces:  # it may have moved to another one
            workspace.status_text_set(None)
        if restore:
            self._restore_area()
            _redraw(self.window)

    def _restore_area(self) -> None:
        area = self.area()
        if area is None or area.type != "IMAGE_EDITOR":
            return
        if self.was is None:
            with bpy.context.temp_override(window=self.window, area=area), suppress(RuntimeError):
                bpy.ops.screen.area_close()
            return
        image, mode = self.was
        space = area.spaces.active
        with suppress(ReferenceError):
            space.image, space.ui_mode = image, mode

    def fit(self) -> None:
        """Show the whole photo, once Blender has laid out its editor."""
        area = self.area()
        region = area and _window_region(area)
        if self.fitted or region is None or region.width <= 1:
            return
        self.fitted = True
        with bpy.context.temp_override(window=self.window, area=area, region=region), suppress(RuntimeError):
            bpy.ops.image.view_all(fit_view=True)

    # Mouse input.

    def press(self, context: Any, spot: "_Spot") -> bool:
        """Grab a marker, or set a point. Returns whether the click was used."""
        number = spot.marker(_pairs(context))
        if number is not None:
            self.dragged = number, spot.side
            return True
        found = spot.found(context)
        if found is None:
            self.hint = Note("No photo there" if spot.side == "pixel" else "No mesh there")
            return not spot.among_buttons(context)
        self.hint = ""
        self.half[spot.side] = found
        if len(self.half) == 2:
            pair = _pairs(context).add()
            pair.pixel, pair.point = self.half["pixel"], self.half["point"]
            self.half.clear()
        return True

    def drag(self, context: Any, spot: "_Spot | None") -> None:
        number, side = self.dragged or (0, "pixel")
        pairs = _pairs(context)
        found = spot.found(context) if spot and spot.side == side and number < len(pairs) else None
        if found is not None:
            setattr(pairs[number], side, found)
            pairs[number].residual = -1.0

    def undo_pick(self, context: Any) -> None:
        pairs = _pairs(context)
        if self.half:
            self.half.clear()
        elif len(pairs):
            pairs.remove(len(pairs) - 1)

    def align(self, context: Any) -> None:
        """Align the photo by the pairs, once there are enough and they have been at rest for a moment.

        So neither the fourth pair nor a point that was dragged needs a button.
        """
        pairs = [(tuple(pair.pixel), tuple(pair.point)) for pair in _pairs(context)]
        now = time.monotonic()
        if self.solved is None:  # those that were there before
            self.solved = pairs if any(pair.residual >= 0 for pair in _pairs(context)) else []
        if self.dragged or self.seen != pairs:
            self.seen, self.still_since = pairs, now
        waits = len(pairs) < MIN_PAIRS or pairs == self.solved or self.half or context.window_manager.mps.running
        if not waits and now - self.still_since >= _REST_SECONDS:
            self.solved = pairs
            with suppress(RuntimeError):  # the panel says why
                bpy.ops.mps.align_photo("INVOKE_DEFAULT")

    def message(self, context: Any) -> str:
        """A sentence on what to do next."""
        number = len(_pairs(context)) + 1
        next_is = Note("click in the photo, then on the mesh")
        if self.half:
            next_is = Note("the same place on the mesh" if "pixel" in self.half else "the same place in the photo")
        hint = f"{in_blender(self.hint)}. " if self.hint else ""
        return f"{hint}{in_blender(Note('Pair %d: %s', number, next_is))}"

    def show(self, context: Any) -> None:
        """Redraw if something has changed, by whatever means."""
        pairs = [(tuple(pair.pixel), tuple(pair.point), pair.residual) for pair in _pairs(context)]
        text = self.message(context)
        if self.shown == (pairs, dict(self.half), text):
            return
        self.shown = pairs, dict(self.half), text
        context.workspace.status_text_set(f"{text}.    {in_blender(_KEYS)}")
        _redraw(self.window)

    # Drawing.

    def _draw_photo(self) -> None:
        context = bpy.context
        photo = context.scene.mps.photo.image
        if photo is None or context.space_data.image != photo:
            return
        size = picture_size(photo)
        to_region = context.region.view2d.view_to_region
        seen = _projection(context.scene, photo, size)
        for number, pair in enumerate(photo.mps.pairs):
            place, colour = to_region(*photo_place(pair.pixel, size), clip=False), colour_of(pair.residual, size)
            off = f"  {pair.residual:.1f} px" if pair.residual >= 0 else ""
            if off and seen is not None:
                x, y, w = seen @ [*pair.point, 1]
                if w:
                    end = to_region(*photo_place((x / w, y / w), size), clip=False)
                    draw_line([place, end], colour)
            draw_marker(place, f"{number + 1}{off}", colour)
        if "pixel" in self.half:
            place = to_region(*photo_place(self.half["pixel"], size), clip=False)
            draw_marker(place, f"{len(photo.mps.pairs) + 1}", OPEN)
        else:
            self._draw_message(context)

    def _draw_mesh(self) -> None:
        context = bpy.context
        photo, region_data = context.scene.mps.photo.image, context.region_data
        target = mesh_of_photo(context)
        if photo is None or target is None or region_data is None:
            return
        view, size = region_data.perspective_matrix, (context.region.width, context.region.height)
        depsgraph, least = context.evaluated_depsgraph_get(), max(target.dimensions) / 50
        markers = [
            (pair.point, f"{number + 1}", colour_of(pair.residual, picture_size(photo)))
            for number, pair in enumerate(photo.mps.pairs)
        ]
        if "point" in self.half:
            markers.append((self.half["point"], f"{len(markers) + 1}", OPEN))
        for point, text, colour in markers:
            place = seen_at(point, view, size)
            if place is None:
                continue
            front = mesh_point(target, depsgraph, view, size, place)
            hidden = front is not None and (front - Vector(point)).length > least
            draw_marker(place, text, colour, _HIDDEN if hidden else 1.0)
        if "pixel" in self.half:
            self._draw_message(context)

    def _draw_message(self, context: Any) -> None:
        scale = context.preferences.system.ui_scale
        left = 20 * scale
        for region in context.area.regions:
            if region.type == "TOOLS" and region.alignment == "LEFT" and region.width > 1:
                left += region.width
        draw_text((left, 20 * scale), self.message(context), OPEN)


_running: list[_Picking] = []


def picking() -> bool:
    """Whether points are being picked."""
    return bool(_running)


@dataclass(frozen=True)
class _Spot:
    """A position under the mouse for one point of a pair."""

    side: Side
    """In the photo ("pixel") or in a viewport ("point")."""
    area: Any
    """The editor."""
    region: Any
    """Its region."""
    at: Place
    """In the region's pixels."""

    @property
    def view(self) -> Matrix:
        return (self.region.data or self.area.spaces.active.region_3d).perspective_matrix

    @property
    def size(self) -> tuple[int, int]:
        return self.region.width, self.region.height

    def found(self, context: Any) -> Sequence[float] | None:
        """The photo's pixel or the point on the mesh; None if there is neither."""
        if self.side == "point":
            depsgraph = context.evaluated_depsgraph_get()
            return mesh_point(mesh_of_photo(context), depsgraph, self.view, self.size, self.at)
        size = picture_size(context.scene.mps.photo.image)
        pixel = photo_pixel(self.region.view2d.region_to_view(*self.at), size)
        return pixel if all(0 <= at <= length for at, length in zip(pixel, size, strict=True)) else None

    def marker(self, pairs: Any) -> int | None:
        """Index of the pair whose marker is nearest, None if none is near."""
        near = [(self._distance(pair), number) for number, pair in enumerate(pairs)]
        distance, number = min(near, default=(np.inf, 0))
        return number if distance <= _GRAB * bpy.context.preferences.system.ui_scale else None

    def _distance(self, pair: Any) -> float:
        if self.side == "point":
            place = seen_at(pair.point, self.view, self.size)
        else:
            size = picture_size(self.area.spaces.active.image)
            place = self.region.view2d.view_to_region(*photo_place(pair.pixel, size), clip=False)
        return np.inf if place is None else float(np.hypot(place[0] - self.at[0], place[1] - self.at[1]))

    def among_buttons(self, context: Any) -> bool:
        """Whether the viewport's navigation gizmos may be here."""
        sidebar = next((region.width for region in self.area.regions if region.type == "UI"), 0)
        right = self.region.width - sidebar - _BUTTONS * context.preferences.system.ui_scale
        return self.side == "point" and self.at[0] > right


def _spot(context: Any, event: Any) -> _Spot | None:
    """The position under the mouse; None where clicks are not handled, as in a sidebar."""
    photo = context.scene.mps.photo.image
    for area in context.window.screen.areas:
        regions = [region for region in area.regions if _contains(region, event)]
        if {region.type for region in regions} != {"WINDOW"}:  # sidebars overlap the window region
            continue
        region = regions[0]
        at = event.mouse_x - region.x, event.mouse_y - region.y
        if area.type == "VIEW_3D":
            return _Spot("point", area, region, at)
        if area.type == "IMAGE_EDITOR" and area.spaces.active.image == photo:
            return _Spot("pixel", area, region, at)
    return None


def _contains(region: Any, event: Any) -> bool:
    across, up = event.mouse_x - region.x, event.mouse_y - region.y
    return 0 <= across < region.width > 1 and 0 <= up < region.height > 1


def _window_region(area: Any) -> Any:
    return next((region for region in area.regions if region.type == "WINDOW"), None)


def _pairs(context: Any) -> Any:
    return context.scene.mps.photo.image.mps.pairs


def _projection(scene: Any, photo: Any, size: tuple[int, int]) -> Any:
    """The projection matrix (3, 4) from world to pixels of the photo's camera; None if it is unknown."""
    camera = chosen_camera(scene, photo)
    with suppress(InputError):  # an unsupported type of camera
        return scene_camera(camera, scene, size).projection_rows() if camera else None
    return None


def _redraw(window: Any) -> None:
    for area in window.screen.areas:
        if area.type in {"VIEW_3D", "IMAGE_EDITOR"}:
            area.tag_redraw()


class MPS_OT_pick_points(ReportingOperator, bpy.types.Operator):
    """Click 4 to 12 places in the photo and the same places on the mesh; from four on, the photo is aligned by them.

    The photo opens beside the viewport. Drag a marker to move it, X deletes the one under the mouse, Backspace takes
    the last one back, Esc ends"""

    bl_label = "Pick Points"

    @classmethod
    def lacks(cls, context: Any) -> str:
        return MPS_OT_align_photo.lacks(context)

    def act(self, context: Any) -> None:
        raise InputError("points are picked with the mouse; a script adds them to scene.mps.photo.image.mps.pairs")

    def invoke(self, context: Any, event: bpy.types.Event) -> set[Any]:
        if picking():
            _running[0].leave()
            return {"FINISHED"}
        return self.start_modal(context, self._start)

    def _start(self, context: Any) -> None:
        window, photo = context.window, context.scene.mps.photo.image
        take_pairs_along(photo, mesh_of_photo(context))
        before = {area.as_pointer() for area in window.screen.areas}
        area = image_editor(context)
        space = area.spaces.active
        was = (space.image, space.ui_mode) if area.as_pointer() in before else None
        space.image, space.ui_mode = photo, "VIEW"
        space.uv_editor.show_uv = False  # the photo has no UVs
        self._picking = _Picking(window, area.as_pointer(), was)
        self._picking.begin()
        self._picking.timer = context.window_manager.event_timer_add(_REST_SECONDS / 4, window=window)
        self._picking.show(context)
        context.window_manager.modal_handler_add(self)
        redraw_panels(context.window_manager)

    def modal(self, context: Any, event: bpy.types.Event) -> set[Any]:
        mine = self._picking
        if mine not in _running:
            return {"FINISHED", "PASS_THROUGH"}
        if self.lacks(context) or (event.type in _ENDS and event.value == "PRESS"):
            mine.leave()
            redraw_panels(context.window_manager)
            return {"FINISHED"}
        mine.fit()
        if event.type == "TIMER":
            mine.align(context)
        used = self._use(context, event)
        mine.show(context)
        return {"RUNNING_MODAL"} if used else {"PASS_THROUGH"}

    def _use(self, context: Any, event: bpy.types.Event) -> bool:
        """Handle a key or mouse event. Returns whether it was consumed."""
        mine, pressed = self._picking, event.value in {"PRESS", "DOUBLE_CLICK"}
        if event.type == "MOUSEMOVE" and mine.dragged:
            mine.drag(context, _spot(context, event))
            return True
        if event.type == "LEFTMOUSE" and event.value == "RELEASE":
            dragged, mine.dragged, mine.pressed = mine.pressed, None, False
            return dragged
        takes_back = event.type == "Z" and (event.ctrl or event.oskey) and not event.shift
        if pressed and (takes_back or event.type == "BACK_SPACE"):
            mine.undo_pick(context)
            return True
        spot = _spot(context, event) if pressed and event.type in {"LEFTMOUSE", *_DELETES} else None
        if spot is None or event.alt or event.ctrl or event.oskey or event.shift:
            return False
        if event.type == "LEFTMOUSE":
            mine.pressed = mine.press(context, spot)
            return mine.pressed
        number = spot.marker(_pairs(context))
        if number is not None:
            _pairs(context).remove(number)
        return True

    def cancel(self, context: Any) -> None:
        """Also called by Blender if another file is opened or the window is closed."""
        self._picking.leave(restore=False)


def unregister() -> None:
    for one in list(_running):
        one.leave()
