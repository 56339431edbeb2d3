"""Fills memory with impossible values before its first use in a frame: a tool that finds missing writes.

A pass that reads memory which no pass of this frame wrote mostly gets the values of the previous frame. The picture
looks right until another resource uses the texture. With poison it looks wrong at once: NaN spreads through every
result, and an integer of all ones is no valid index. Depth is 0 or 1, as on Vulkan.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any

import numpy as np

from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.resources import FORMATS, Buffer, Image

from ..types import Barrier

_ONES = np.full(4, 0xFFFFFFFF, np.uint32)


class Poison:
    """The fills before one step: all resources whose life in the frame begins there."""

    def __init__(
        self, context: Context, planned: Sequence[Barrier], objects: Mapping[str, Image | Buffer], choice: str
    ) -> None:
        self._context = context
        new = [barrier.resource for barrier in planned if barrier.discard]
        self._fills = [self._fill(objects[name], choice) for name in new]

    @staticmethod
    def _fill(resource: Image | Buffer, choice: str) -> tuple[Any, ...]:
        if isinstance(resource, Buffer):
            kind = (gl.GL_R32UI, gl.GL_RED_INTEGER, gl.GL_UNSIGNED_INT)
            return ("glClearNamedBufferData", resource.handle, *kind, gl.pointer(_ONES))
        described = FORMATS[resource.format]
        value = np.full(4, np.nan, np.float32)
        if described.pixels == gl.GL_DEPTH_COMPONENT:
            value = np.full(4, float(choice.removeprefix("depth ")), np.float32)
        whole_number = resource.format.endswith("ui")
        component = described.component if whole_number else gl.GL_FLOAT
        data = gl.pointer(_ONES if whole_number else value)
        return ("glClearTexImage", resource.handle, 0, described.pixels, component, data)

    def record(self) -> None:
        """Record the fills, after a barrier that orders earlier shader stores before them."""
        fn = self._context.fn
        if self._fills:
            fn.glMemoryBarrier(gl.GL_ALL_BARRIER_BITS)
        for call, *arguments in self._fills:
            getattr(fn, call)(*arguments)
