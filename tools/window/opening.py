"""What a window opens: the screen of a backend, and a renderer, anew for every change of settings."""

from __future__ import annotations

from collections.abc import Callable, Mapping
from typing import TYPE_CHECKING, Any

from backends.window import Window
from common.errors import StrataError
from common.files.shader_files import refreshed
from common.view.inputs import Inputs
from tools.window.keys import BINDINGS

if TYPE_CHECKING:
    from backends.contract import Renderer


def open_window(backend: str, size: tuple[int, int], title: str) -> Window:
    """Open a window for a renderer on "vulkan" or "gl"."""
    inputs = Inputs(bindings=BINDINGS)
    if backend == "gl":
        from backends.gl.window import present

        return present.open_window(size, title, inputs=inputs)
    from backends.vulkan.window.screen import loader_address

    return Window(size, title, "vulkan", inputs=inputs, loader=loader_address())


def open_screen(backend: str, window: Window, display: Any = None, **options: Any) -> Any:
    """Return the backend's `Screen`: a device for renderers, and what brings their pictures into the window.

    `display` is a `Display` of the renderer's own on Vulkan; OpenGL has no choice of surfaces.
    """
    if backend == "gl":
        from backends.gl.window.screen import Screen as OnGl

        return OnGl(window, **options)
    from backends.vulkan.window.screen import Screen as OnVulkan

    return OnVulkan(window, display=display, **options)


class Refused(Exception):
    """A renderer could not be opened with other settings; `renderer` is one with the old ones."""

    def __init__(self, reason: str, renderer: Renderer) -> None:
        super().__init__(reason)
        self.renderer = renderer


class Opened:
    """The renderer of a window, opened anew for other settings. The device stays, and so do the shaders in memory."""

    def __init__(
        self, open_renderer: Callable[..., Renderer], size: tuple[int, int], options: Mapping[str, Any]
    ) -> None:
        self._open, self._options = open_renderer, dict(options)
        self.renderer = open_renderer(size=size, **self._options)

    def reopen(self, settings: Any, **options: Any) -> Renderer:
        """Return a renderer with other settings, of the same size; raise Refused where there can be none.

        `options` are other arguments of the renderer from now on.
        """
        others, self._options = self._options, {**self._options, **options}
        size, before = self.renderer.size, self.renderer.settings
        self.renderer.close()  # first: two of them may not fit into memory
        try:
            with refreshed(
                ()
            ):  # files that are read only for a renderer which cannot be are read again next time
                self.renderer = self._open(size=size, **self._options, settings=settings)
        except StrataError as error:
            self._options = others
            self.renderer = self._open(size=size, **self._options, settings=before)
            raise Refused(str(error), self.renderer) from None
        return self.renderer

    def renew(self) -> Renderer:
        """Return a renderer with the same settings; where there can be none, an error, and the old one stays."""
        made = self._open(size=self.renderer.size, **{**self._options, "settings": self.renderer.settings})
        self.renderer.close()
        self.renderer = made
        return made

    def close(self) -> None:
        """Close the renderer."""
        self.renderer.close()
