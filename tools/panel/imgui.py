"""The way between Dear ImGui and Strata: events in, draw lists out. Nothing here knows what a panel shows.

imgui-bundle is the optional extra `ui`; it is imported when a panel is opened, and nothing else needs it.
"""

from __future__ import annotations

import ctypes
import os
from collections.abc import Callable
from typing import Any

import numpy as np

from backends.window import Event
from common.view.draw_lists import FONT, VERTEX, Command, DrawList, TextureUpdate

FIRST_ATLAS = 1 << 15
"""Numbers of the textures that later hold glyphs, when the first has become too small: far from those of pictures."""

SETTLING = 3
"""Frames after the last event until nothing changes any more: hovering is seen in one, shown in the next."""

LONGEST_FRAME_S = 0.1

_MODIFIERS = {"SHIFT": "mod_shift", "CONTROL": "mod_ctrl", "ALT": "mod_alt", "SUPER": "mod_super"}

_PLAIN = (
    "TAB",
    "HOME",
    "END",
    "INSERT",
    "DELETE",
    "BACKSPACE",
    "SPACE",
    "ENTER",
    "ESCAPE",
    "PAGE_UP",
    "PAGE_DOWN",
)

_KEYS = {
    **{name: name.lower() for name in (*_PLAIN, *"ACVXYZ")},
    **{name: f"{name.lower()}_arrow" for name in ("LEFT", "RIGHT", "UP", "DOWN")},
    "KP_ENTER": "keypad_enter",
}
"""GLFW's names of the keys that widgets know -> ImGui's."""


def load() -> Any:
    """Return the module `imgui`, or None where the package is not installed or cannot be loaded."""
    before = os.environ.get("PYGLFW_LIBRARY")
    try:
        # First, so that it finds the library it came with: the bundle would have it take the bundle's own, which it
        # names in the environment.
        import glfw  # noqa: F401
        from imgui_bundle import imgui
    except ImportError:
        return None
    finally:
        if before is None:
            os.environ.pop("PYGLFW_LIBRARY", None)
        else:
            os.environ["PYGLFW_LIBRARY"] = before
    return imgui


class Interface:
    """One ImGui context: a `backends.window.Listener` whose frames are draw lists. `scale` enlarges everything."""

    def __init__(self, imgui: Any, scale: float = 1.0) -> None:
        self.imgui = imgui
        self.visible = True
        self._context = imgui.create_context()
        imgui.set_current_context(self._context)
        io = imgui.get_io()
        io.set_ini_filename("")  # it leaves no file behind
        io.set_log_filename("")
        flags = imgui.BackendFlags_
        io.backend_flags |= flags.renderer_has_textures | flags.renderer_has_vtx_offset
        io.config_input_text_cursor_blink = (
            False  # nothing changes by itself, and so nothing is drawn by itself
        )
        io.config_windows_move_from_title_bar_only = True
        style = imgui.get_style()
        imgui.style_colors_dark()
        style.hover_flags_for_tooltip_mouse = (
            imgui.HoveredFlags_.none
        )  # at once: a delay would need frames of its own
        style.window_rounding = style.frame_rounding = 4.0
        style.scale_all_sizes(scale)
        style.font_scale_dpi = scale
        self._areas: list[tuple[float, float, float, float]] = []
        self._wants_keys = False
        self._settling = SETTLING
        self._textures: dict[int, int] = {}  # ImGui's number of a texture -> ours

    # --- what the user does ---

    def event(self, event: Event) -> None:
        """Note what the user did, for the next frame."""
        imgui = self.imgui
        imgui.set_current_context(self._context)
        io = imgui.get_io()
        self._settling = SETTLING
        if event.kind == "move":
            io.add_mouse_pos_event(event.x, event.y)
        elif event.kind == "button" and event.button < 3:
            io.add_mouse_button_event(event.button, event.down)
        elif event.kind == "scroll":
            io.add_mouse_wheel_event(event.x, event.y)
        elif event.kind == "text":
            io.add_input_character(ord(event.name))
        elif event.kind == "focus":
            io.add_focus_event(event.down)
        elif event.kind == "key":
            modifier = _MODIFIERS.get(event.name.partition("_")[2])
            if modifier is not None:
                io.add_key_event(getattr(imgui.Key, modifier), event.down)
            if event.name in _KEYS:
                io.add_key_event(getattr(imgui.Key, _KEYS[event.name]), event.down)

    def takes_mouse(self, x: float, y: float) -> bool:
        """Whether one of the windows of the last frame lies at the pixel (x, y)."""
        return self.visible and any(
            left <= x < right and top <= y < bottom for left, top, right, bottom in self._areas
        )

    def takes_keys(self) -> bool:
        """Whether something was being typed or dragged in the last frame."""
        return self.visible and self._wants_keys

    @property
    def restless(self) -> bool:
        """Whether the next frame may differ from the last, without anything new to show."""
        if self._settling > 0:
            return True
        self.imgui.set_current_context(self._context)
        return bool(self.imgui.get_current_context().input_events_queue.size())

    def stir(self) -> None:
        """Have some frames drawn although nobody did anything: a window that is new finds its size in its second."""
        self._settling = SETTLING

    # --- what is drawn ---

    def frame(self, size: tuple[int, int], dt: float, build: Callable[[], None]) -> DrawList:
        """Return the list that the widgets of `build` make on a window of (width, height) pixels.

        Textures are part of the list: whoever gets it must take them over, drawn or not.
        """
        imgui = self.imgui
        imgui.set_current_context(self._context)
        io = imgui.get_io()
        io.display_size = (float(size[0]), float(size[1]))
        io.delta_time = min(max(dt, 1e-4), LONGEST_FRAME_S)
        imgui.new_frame()
        build()
        imgui.render()
        self._settling = max(self._settling - 1, 0)
        self._wants_keys = io.want_capture_keyboard
        no_mouse = imgui.WindowFlags_.no_mouse_inputs
        self._areas = [
            (one.pos.x, one.pos.y, one.pos.x + one.size.x, one.pos.y + one.size.y)
            for one in imgui.get_current_context().windows
            if one.active and not one.hidden and not one.flags & no_mouse
        ]
        return self._taken(imgui.get_draw_data())

    def _taken(self, data: Any) -> DrawList:
        """Return ImGui's draw data as a record of its own."""
        updates, dropped = self._textures_of(data)
        vertices, indices, commands = [], [], []
        vertex = index = 0
        for one in data.cmd_lists:
            vertices.append(_copied(one.vtx_buffer, VERTEX))
            indices.append(_copied(one.idx_buffer, np.dtype(np.uint32)))
            for command in one.cmd_buffer:
                if not command.elem_count:
                    continue
                clip = command.clip_rect
                commands.append(
                    Command(
                        (clip.x, clip.y, clip.z, clip.w),
                        command.get_tex_id() - 1,
                        index + command.idx_offset,
                        command.elem_count,
                        vertex + command.vtx_offset,
                    )
                )
            vertex += len(vertices[-1])
            index += len(indices[-1])
        return DrawList(
            (data.display_size.x, data.display_size.y),
            np.concatenate(vertices) if vertices else np.zeros(0, VERTEX),
            np.concatenate(indices) if indices else np.zeros(0, np.uint32),
            tuple(commands),
            updates,
            dropped,
            (data.display_pos.x, data.display_pos.y),
        )

    def _textures_of(self, data: Any) -> tuple[tuple[TextureUpdate, ...], tuple[int, ...]]:
        """Return the glyphs that came and the textures that went, and tell ImGui that they are taken care of."""
        status = self.imgui.ImTextureStatus
        updates: list[TextureUpdate] = []
        dropped = []
        for texture in data.textures:
            number = self._textures.get(texture.unique_id)
            size = (texture.width, texture.height)
            if texture.status == status.want_create:
                number = FONT if not self._textures else FIRST_ATLAS + len(self._textures)
                self._textures[texture.unique_id] = number
                updates.append(TextureUpdate(number, size, _pixels(texture).copy()))
                # ImGui's 0 is no texture, ours is that of the glyphs.
                texture.set_tex_id(number + 1)
                texture.set_status(status.ok)
            elif texture.status == status.want_updates and number is not None:
                pixels = _pixels(texture)
                for part in texture.updates:
                    cut = pixels[part.y : part.y + part.h, part.x : part.x + part.w].copy()
                    updates.append(TextureUpdate(number, size, cut, part.x, part.y))
                texture.set_status(status.ok)
            elif texture.status == status.want_destroy and texture.unused_frames > 0 and number is not None:
                dropped.append(number)
                texture.set_tex_id(0)
                texture.set_status(status.destroyed)
        return tuple(updates), tuple(dropped)

    def close(self) -> None:
        """Free the context; a second time does nothing."""
        if self._context is not None:
            self.imgui.set_current_context(self._context)
            status = self.imgui.ImTextureStatus
            for texture in self.imgui.get_platform_io().textures:
                texture.set_tex_id(0)
                texture.set_status(status.destroyed)
            self.imgui.destroy_context(self._context)
            self._context = None


def _copied(buffer: Any, dtype: np.dtype[Any]) -> np.ndarray:
    """Return one of ImGui's arrays, which it uses again in the next frame."""
    size = buffer.size() * dtype.itemsize
    if not size:
        return np.zeros(0, dtype)
    return np.frombuffer((ctypes.c_char * size).from_address(buffer.data_address()), dtype).copy()


def _pixels(texture: Any) -> np.ndarray:
    """Return a texture of ImGui's as (H, W, 4), still in its memory; of one byte a pixel it is the opacity of white."""
    pixels = texture.get_pixels_array().reshape(texture.height, texture.width, texture.bytes_per_pixel)
    if texture.bytes_per_pixel == 1:
        return np.concatenate([np.full((*pixels.shape[:2], 3), 255, np.uint8), pixels], -1)
    found: np.ndarray = pixels
    return found
