"""What a pass draws to, as the frame graph says: any number of colour targets, and how each begins and ends."""

from __future__ import annotations

from collections.abc import Iterable, Mapping
from typing import Any

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.resources import Buffer, Image
from backends.gl.targets import Framebuffer, create_framebuffer, destroy_framebuffer

from ...frames.gl_commands import Commands, Rendering
from ..types import Attachment, Step


class Targets:
    """The framebuffer of one step; a tiled GPU reads and writes no more of its memory than `begin` and `end` say."""

    def __init__(self, context: Context, framebuffer: Framebuffer, step: Step) -> None:
        self._context = context
        self._rendering = Rendering(
            framebuffer,
            [target.clear if target.load == "clear" else None for target in step.colors],
            step.depth.clear[0] if step.depth and step.depth.load == "clear" and step.depth.clear else None,
        )
        points = [(gl.GL_COLOR_ATTACHMENT0 + number, target) for number, target in enumerate(step.colors)]
        points += [(gl.GL_DEPTH_ATTACHMENT, step.depth)] if step.depth else []
        self._before = _points(point for point, target in points if target.load == "discard")
        self._after = _points(point for point, target in points if target.store == "discard")

    def begin(self, commands: Commands) -> None:
        """Begin drawing: give up what nobody wants of before, clear what has a value."""
        self._give_up(self._before)
        commands.begin_rendering(self._rendering)

    def end(self) -> None:
        """Give up what nobody wants afterwards."""
        self._give_up(self._after)

    def _give_up(self, points: Any) -> None:
        if points is not None:
            handle = self._rendering.target.handle
            self._context.fn.glInvalidateNamedFramebufferData(handle, len(points), points)


def _points(chosen: Iterable[int]) -> Any:
    """Return attachment points as OpenGL's calls take them, None for none."""
    points = [*chosen]
    return gl.ffi.new("GLenum[]", points) if points else None


class Framebuffers:
    """Framebuffers by what is attached to them: passes that draw to the same images share one."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._made: dict[tuple[int, ...], Framebuffer] = {}

    def get(self, step: Step, held: Mapping[str, Image | Buffer]) -> Framebuffer:
        """Return the framebuffer of a step's targets, made when they are first asked for."""
        colors = [_image(target, held) for target in step.colors]
        depth = None if step.depth is None else _image(step.depth, held)
        key = (*(image.handle for image in colors), 0 if depth is None else depth.handle)
        if key not in self._made:
            self._made[key] = create_framebuffer(self._context, colors, depth, step.name)
        return self._made[key]

    def close(self) -> None:
        """Free them; their images live on."""
        for framebuffer in self._made.values():
            destroy_framebuffer(self._context, framebuffer)
        self._made = {}


def _image(target: Attachment, held: Mapping[str, Image | Buffer]) -> Image:
    image = held[target.resource]
    assert isinstance(image, Image), target.resource
    return image
