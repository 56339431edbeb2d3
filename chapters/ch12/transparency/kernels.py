"""The memory of layers on a backend and its bindings, as passes see them; `vulkan.py` and `gl.py` implement them."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from typing import Any, Literal, NamedTuple

import numpy as np
from numpy.typing import NDArray

from ..frames.commands import DrawGroup, SceneBinding
from ..pipelines.description import Built

KINDS: Mapping[str, tuple[str, ...]] = {
    "clear": ("words",),
    "sums": ("words", "sums", "told"),
    "count": ("words",),
    "fill": ("words", "keys", "colors"),
    "resolve": ("words", "keys", "colors"),
}
"""The buffers of each kind of pipeline, in the order of their bindings (`pool.glsl`)."""

DRAWING = ("count", "fill")
"""The kinds that draw. Their buffers have a set of their own behind those of the scene."""

RESOLVED = ("color_hdr", "layer_sums", "layer_weights")
"""The images of the resolve, behind its buffers, by the names of the graph."""

IN_SLOT: Mapping[str, Literal["readback"]] = {"told": "readback"}
"""The buffers that exist once for each slot, with their memory."""

TOLD_WORDS = 4


class Bound(NamedTuple):
    """What `make_bindings` binds: a pipeline of each kind, and the names of the resolve's images in the graph."""

    pipelines: Mapping[str, Built]
    images: tuple[str, ...]
    lists: bool


class Kernels:
    """The buffers of layers on a backend: what both APIs have in common."""

    def __init__(self, backend: Any) -> None:
        self._backend = backend
        self.buffer_bytes = min(int(backend.device.capabilities.limits["maxStorageBufferRange"]), 1 << 30)
        """The largest buffer that shaders see."""

    def why_not(self) -> str:
        """Return what the device lacks for lists, or ""."""
        raise NotImplementedError

    def make_buffers(self, sizes: Mapping[str, int]) -> None:
        """Create buffers of these sizes in bytes; earlier ones are freed after the last frame that uses them."""
        raise NotImplementedError

    def make_bindings(self, bound: Bound) -> None:
        """Create the bindings of all pipelines, for the buffers and the images that there are now."""
        raise NotImplementedError

    def bind(self, commands: Any, kind: str, pipeline: Built) -> None:
        """Bind a compute pipeline with what its kind reads and writes."""
        raise NotImplementedError

    def draw(self, commands: Any, kind: str, groups: Sequence[DrawGroup], scene: SceneBinding) -> None:
        """Record draws of the scene that also bind the buffers of a kind."""
        raise NotImplementedError

    def finish(self, commands: Any, slot: int) -> None:
        """Make counters visible to the CPU, and bind again what the kernels replaced."""
        raise NotImplementedError

    def told(self, slot: int) -> NDArray[np.uint32]:
        """Return the counters that the last frame of a slot wrote."""
        raise NotImplementedError

    def close(self) -> None:
        """Free buffers and bindings."""
        raise NotImplementedError
