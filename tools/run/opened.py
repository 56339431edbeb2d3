"""What `chapters.open` adds to a renderer of any chapter: its frames, and the renderer itself, show themselves.

    frame.show()           # the picture: below the notebook's cell, else in the system's viewer
    frame.show("depth")    # any output, in the colours that show it best
    frame                  # at the end of a cell: picture, time and work

Chapters know nothing of it: a frame of theirs is inside, and what a renderer is asked for, its chapter does.
"""

from __future__ import annotations

from functools import cache
from html import escape
from typing import TYPE_CHECKING, Any

import numpy as np

import chapters
from chapters import studies
from common.errors import StaleFrameError
from common.images import frame_pictures
from common.settings import flat, knobs
from common.view.camera import exposure
from tools.run.shown import Bundle, Figures, Picture, Table, figures
from tools.run.views import stored_as
from tools.window.stop import nodes_of

if TYPE_CHECKING:
    from backends.contract import Frame, Renderer
    from chapters import Which
    from common.view.camera import View
else:
    Renderer = object  # what is inherited at run time is the chapter's renderer

BACKEND_NAMES = {"vulkan": "Vulkan", "gl": "OpenGL"}


class ShownFrame:
    """A frame as `backends.contract.Frame` says, that also shows itself."""

    def __init__(self, frame: Frame, renderer: OpenedRenderer, view: View) -> None:
        self._frame, self._renderer, self._view = frame, renderer, view
        self.index = frame.index
        self.cpu_ms = frame.cpu_ms
        self.reset = frame.reset

    def image(self, name: str) -> np.ndarray:
        """Wait for the frame and return an output as (H, W) or (H, W, C), row 0 on top: numbers to compute with.

        Raises StaleFrameError when the frame is gone or `name` was not in `outputs`.
        """
        return self._frame.image(name)

    @property
    def timings(self) -> Figures[float]:
        """GPU milliseconds by pass name, in the order of the frame."""
        return Figures(self._frame.timings, "Time on the GPU", ("pass", "ms"))

    @property
    def work(self) -> Figures[int]:
        """Counters of what was done and of what was skipped."""
        return Figures(self._frame.work, "Work", ("counter", "count"))

    def picture(self, name: str | None = None) -> Picture:
        """Return output `name` (None: the first of the renderer's) as a picture that outlives the frame.

        Depth becomes distance, ids get hues, light is coded for a screen at the view's exposure; the caption says how.
        Raises StaleFrameError as `image` does.
        """
        renderer = self._renderer
        wanted = renderer.outputs[0] if name is None and renderer.outputs else name or "color"
        values = self.image(wanted)
        stored = stored_as(renderer.settings) if "view" in knobs(renderer.settings) else "light"
        if wanted == "color_linear" and stored == "light":
            values = values * np.float32(exposure(self._view.ev100))
        form = format_of(renderer, wanted, values)
        pixels, mapping = frame_pictures.picture_of(
            values, wanted.rpartition("/")[2], form, self._view, stored
        )
        caption = renderer.spoken() if wanted == "color" else f"{renderer.spoken()}, {wanted}: {mapping}"
        return Picture(pixels, caption, f"{chapters.file_name(renderer.which)}-{wanted.replace('/', '-')}")

    def show(self, name: str | None = None) -> None:
        """Show output `name` (None: the picture) below the notebook's cell, else in the system's viewer.

        Where there is no display either, a sentence says in which file it is. Raises StaleFrameError as `image` does.
        """
        self.picture(name).show()

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Bundle:
        """A frame whose images are gone still has its time and work."""
        try:
            bundle = self.picture()._repr_mimebundle_()
        except StaleFrameError as error:
            bundle = {"text/html": f"<p>{escape(str(error))}</p>"}
        table = figures({f"frame {self.index}": self}).html()
        more = f"<details><summary>Time and work</summary>{table}</details>"
        return bundle | {"text/html": bundle["text/html"] + more, "text/plain": repr(self)}

    def __repr__(self) -> str:
        return f"<frame {self.index} of {self._renderer.spoken()}>"


class OpenedRenderer(Renderer):
    """What `showing` puts in front of a chapter's renderer; all else of it is as `backends.contract.Renderer` says."""

    which: Which
    """What was opened: a chapter, a study or a fork."""
    outputs: tuple[str, ...]

    def render(self, view: View, time: float = 0.0) -> ShownFrame:
        """Enqueue one frame of `view` at `time` seconds; nothing is waited for."""
        return ShownFrame(super().render(view, time), self, view)  # type: ignore[safe-super]

    def spoken(self) -> str:
        """Return what is drawn, in a few words."""
        width, height = self.size
        return f"{studies.spoken(self.which)}, {self.scene.name}, {width}x{height}"

    def table(self) -> Table:
        """Return what draws what on which device, the settings that are not the default, and each feature's path."""
        told, plain = self.capabilities, flat(type(self.settings)())
        changed = [
            f"{name}={value}" for name, value in flat(self.settings).items() if value != plain.get(name)
        ]
        rows = [
            ("lesson", chapters.title_of(self.which)),
            ("device", f"{told.device} ({told.driver}), {BACKEND_NAMES[told.backend]}"),
            ("outputs", ", ".join(self.outputs)),
            ("passes", ", ".join(one.name for one in nodes_of(self))),
            ("settings", ", ".join(changed) or "as they are by default"),
            *((choice.feature, f"{choice.path}: {choice.reason}") for choice in self.plan.choices),
        ]
        return Table(self.spoken(), ("what", "here"), tuple(row for row in rows if row[1]))

    def _repr_mimebundle_(self, include: Any = None, exclude: Any = None) -> Bundle:
        return self.table()._repr_mimebundle_()

    def __repr__(self) -> str:
        return f"<renderer of {self.spoken()}>"


@cache
def showing(kind: type, which: Which) -> type:
    """Return the class of renderers `kind` of the chapter `which`, with frames that show themselves."""
    return type(kind.__name__, (OpenedRenderer, kind), {"which": which, "__module__": kind.__module__})


def format_of(renderer: OpenedRenderer, name: str, values: np.ndarray) -> str:
    """Return the format of an output, by which its numbers are understood; of "pass/resource" the declared one."""
    from tools.frames.frame import described

    one, slash, resource = name.partition("/")
    if slash:
        for made in nodes_of(renderer):
            for access in made.writes:
                if (made.name, access.resource) == (one, resource):
                    return described(access, (access, one), renderer).format
    return {"depth": "d32f", "instance_id": "r32ui"}.get(name, "")
