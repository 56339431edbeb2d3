"""A window on OpenGL: its context, the picture in it, and the user interface over the picture.

with open_window((1280, 720), "title") as window, Screen(window) as screen:
    with open_renderer(device=screen.device, presents=True) as renderer:
        renderer.render(view)
        screen.show(renderer)
"""

from __future__ import annotations

from collections.abc import Iterable

import numpy as np

from backends.contract import Renderer
from backends.gl.context import Context
from backends.gl.readback import read_image
from backends.gl.window.draw_lists import DrawLists
from backends.gl.window.present import present
from backends.window import Window
from common.view.draw_lists import DrawList


class Screen:
    """What stands between a window of `present.open_window` and a renderer on OpenGL.

    `device` is for the renderer, which must be closed before this is. Raises UnsupportedError where the display has no
    OpenGL 4.5.
    """

    takes_lists = True  # a window's codes are those of a user interface: 8-bit sRGB

    def __init__(
        self, window: Window, *, validate: bool = False, without: Iterable[str] = (), vsync: bool = True
    ) -> None:
        import glfw

        self._window = window
        self.device = Context(validate, without, window.handle)
        glfw.swap_interval(int(vsync))
        self._draws: DrawLists | None = None
        self._list: DrawList | None = None

    def lay(self, drawn: DrawList | None) -> None:
        """Draw a user interface over whatever is shown from now on; None takes it away. Each list is given once."""
        self._list = drawn
        if drawn is None:
            return
        self.device.make_current()
        if self._draws is None:
            self._draws = DrawLists(self.device)
        self._draws.update(drawn)

    def show(self, renderer: Renderer) -> bool:
        """Show the renderer's last picture in the window, again if need be; return whether that happened."""
        size = self._window.size
        if 0 in size:
            return False
        self.device.make_current()
        picture = renderer.present_source
        if self._draws is not None and self._list is not None:
            picture = self._draws.over(picture, self._list, size)
        present(self.device, picture, self._window.handle, size)
        return True

    def picture(self, renderer: Renderer) -> np.ndarray:
        """Return the renderer's last picture, without what lies over it: (H, W, 4) uint8. Waits for it."""
        self.device.make_current()
        return read_image(self.device, renderer.present_source.colors[0].image)

    def close(self) -> None:
        """Free everything; a second time does nothing."""
        if self._draws is not None:
            self.device.make_current()
            self._draws.close()
            self._draws = None
        self.device.close()

    def __enter__(self) -> Screen:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()
