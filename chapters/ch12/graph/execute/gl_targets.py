"""The attachments of a pass from the frame graph: any number of colour targets, with load and store operations."""

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
    """The framebuffer of one step; `begin` and `end` avoid needless reads and writes of memory on tiled GPUs."""

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
        """Begin drawing: invalidate attachments with undefined contents, clear those with a clear value."""
        self._invalidate(self._before)
        commands.begin_rendering(self._rendering)

    def end(self) -> None:
        """Invalidate attachments that are not needed afterwards."""
        self._invalidate(self._after)

    def _invalidate(self, points: Any) -> None:
        if points is not None:
            handle = self._rendering.target.handle
            self._context.fn.glInvalidateNamedFramebufferData(handle, len(points), points)


def _points(chosen: Iterable[int]) -> Any:
    """Return attachment points as an array for OpenGL; None if there are none."""
    points = [*chosen]
    return gl.ffi.new("GLenum[]", points) if points else None


class Framebuffers:
    """Framebuffers by their attachments: passes that draw to the same images share a framebuffer."""

    def __init__(self, context: Context) -> None:
        self._context = context
        self._framebuffers: dict[tuple[int, ...], Framebuffer] = {}

    def get(self, step: Step, resources: Mapping[str, Image | Buffer]) -> Framebuffer:
        """Return the framebuffer of a step's attachments, created at first use."""
        colors = [_image(target, resources) for target in step.colors]
        depth = None if step.depth is None else _image(step.depth, resources)
        key = (*(image.handle for image in colors), 0 if depth is None else depth.handle)
        if key not in self._framebuffers:
            self._framebuffers[key] = create_framebuffer(self._context, colors, depth, step.name)
        return self._framebuffers[key]

    def close(self) -> None:
        """Free the framebuffers; their images stay."""
        for framebuffer in self._framebuffers.values():
            destroy_framebuffer(self._context, framebuffer)
        self._framebuffers = {}


def _image(target: Attachment, resources: Mapping[str, Image | Buffer]) -> Image:
    image = resources[target.resource]
    assert isinstance(image, Image), target.resource
    return image
