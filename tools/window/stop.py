"""A window's frame stopped after one of its passes: what that pass wrote first, in place of the finished picture."""

from __future__ import annotations

import time as clock
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from numpy.typing import NDArray

from common import images
from common.errors import StrataError
from common.images.frame_pictures import picture_of
from common.view.draw_lists import VERTEX, Command, DrawList, TextureUpdate
from tools.run.views import stored_as

if TYPE_CHECKING:
    from backends.contract import Frame, Renderer
    from common.view.camera import View

TEXTURE = 1
"""The number of the picture's texture, beside those of the panel's glyphs."""


def nodes_of(renderer: Renderer) -> Sequence[Any]:
    """Return the passes of a frame with what they read and write: where there is a graph, under its names."""
    return getattr(renderer, "nodes", renderer.passes)


class Stop:
    """After which pass the window stops, "" for none, and the picture of what that pass wrote.

    The frame is drawn to its end all the same, by a renderer that was opened with `inspect=True`; its pictures come
    over the CPU, which is slow and shows every number there is. Where there is a frame graph, any `resource` of it can
    be chosen while the renderer runs (`follow`).
    """

    def __init__(self) -> None:
        self.after = ""
        self.resource = ""
        """What of a frame graph is shown; "" for nothing, and before there are graphs."""
        self.due = False  # another pass was chosen since the last look
        self.told = ""
        """What is seen, in words."""
        self.picture: NDArray[np.uint8] | None = None
        self._fresh = False  # the texture does not hold the picture yet

    def choose(self, name: str) -> None:
        """Stop after pass `name` from the next frame on."""
        self.after, self.due, self.resource = name, True, ""
        self.picture, self.told = None, ""

    def follow(self, renderer: Any, resource: str) -> None:
        """Show a resource of the frame graph of `renderer` from the next frame on, "" for the finished picture.

        Raises GraphError, with nothing changed, where no pass draws it.
        """
        key = renderer.show_resource(resource or None)
        self.choose(key.partition("/")[0])
        self.resource = resource

    def look(self, renderer: Renderer, frame: Frame, view: View) -> None:
        """Take the picture of a frame; a pass that it does not have leaves the finished picture."""
        self.due, self.picture, self.told = False, None, ""
        if not self.after:
            return
        if self.resource:
            name = self.resource
            key = next((key for key in renderer.inspection.names if key.endswith(f"/{name}")), "")
            if not key:
                self.told = f"no pass of this frame draws {name}"
                return
            format_ = renderer.graph.resources[renderer.graph.names[name]].format
        else:
            made = next((one for one in renderer.passes if one.name == self.after), None)
            if made is None:
                self.told = f"this frame has no pass {self.after}"
                return
            name, format_ = made.writes[0].resource, made.writes[0].format
            key = f"{made.name}/{name}"
        kind = stored_as(renderer.settings)
        self.picture, mapping = picture_of(frame.image(key), name, format_ or "", view, kind)
        self.told = f"{name} ({format_}): {mapping}"
        self._fresh = True

    def under(self, drawn: DrawList | None, size: tuple[int, int]) -> DrawList | None:
        """Return `drawn` (None: nothing) with the picture below it, over a window of `size` pixels."""
        if self.picture is None:
            return drawn
        fresh, self._fresh = self._fresh, False
        return laid_below(drawn, size, TEXTURE, self.picture, fresh)


def laid_below(
    drawn: DrawList | None,
    size: tuple[int, int],
    texture: int,
    picture: NDArray[np.uint8],
    fresh: bool,
    share: float = 1.0,
) -> DrawList:
    """Return `drawn` (None: nothing) with a picture below it, over a window of `size` pixels.

    The picture is texture number `texture`, which gets its pixels where they are `fresh`. Only the left `share` of the
    picture is shown, over the same part of the window.
    """
    over = drawn or DrawList((float(size[0]), float(size[1])))
    left, top = over.origin
    right, bottom = left + share * over.extent[0], top + over.extent[1]
    quad = np.zeros(4, VERTEX)
    quad["position"] = [(left, top), (right, top), (right, bottom), (left, bottom)]
    quad["uv"] = [(0, 0), (share, 0), (share, 1), (0, 1)]
    quad["color"] = 255
    # Its triangles lie behind all others in the arrays and before them in the order: no other command moves.
    first = Command((left, top, right, bottom), texture, len(over.indices), 6, len(over.vertices))
    updates = over.updates
    if fresh:
        height, width = picture.shape[:2]
        opaque = np.full((height, width, 1), 255, np.uint8)
        pixels = np.concatenate([picture, opaque], axis=-1)
        updates = (*updates, TextureUpdate(texture, (width, height), pixels))
    return replace(
        over,
        vertices=np.concatenate([over.vertices, quad]),
        indices=np.concatenate([over.indices, np.array([0, 1, 2, 0, 2, 3], np.uint32)]),
        commands=(first, *over.commands),
        updates=updates,
    )


def written(picture: NDArray[np.uint8], name: str) -> str:
    """Write a picture to out/, under a name that begins with `name`; return what to say about it."""
    path = Path("out") / f"{name}-{clock.strftime('%Y%m%d-%H%M%S')}.png"
    try:
        path.parent.mkdir(exist_ok=True)
        images.write_image(path, picture)
    except (OSError, StrataError) as error:
        return str(error)
    return f"wrote {path}"
