"""What the panel shows of a file that is wrong: the compiler's words, with every caret below its character."""

from __future__ import annotations

from typing import Any

RED = 0xFF6E6EFF
"""As ImGui packs colours: 0xAABBGGRR."""


def show_error(imgui: Any, text: str, size: tuple[int, int], scale: float) -> None:
    """Show `text` over the lower edge of a window of (width, height) pixels; it scrolls where it is longer.

    Nothing is wrapped: ImGui's font gives every character the same width, and a caret stands where it belongs.
    """
    margin, width, height = 10.0 * scale, float(size[0]), float(size[1])
    imgui.set_next_window_pos((margin, height - margin), imgui.Cond_.always, (0.0, 1.0))
    imgui.set_next_window_size_constraints((0.0, 0.0), (max(width - 2 * margin, 80.0), max(height / 2, 80.0)))
    imgui.set_next_window_bg_alpha(0.9)
    flags = imgui.WindowFlags_
    kept = flags.always_auto_resize | flags.no_saved_settings | flags.no_collapse | flags.horizontal_scrollbar
    open_, _ = imgui.begin(
        "The picture is that of the last good files", None, kept | flags.no_focus_on_appearing
    )
    if open_:
        first, _, rest = text.partition("\n")
        imgui.push_style_color(imgui.Col_.text, RED)
        imgui.text_unformatted(first)
        imgui.pop_style_color()
        if rest:
            imgui.text_unformatted(rest)
    imgui.end()
