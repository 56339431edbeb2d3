"""The glMemoryBarrier calls of a frame: after shader stores, and nowhere else.

OpenGL orders its own commands: the results of draws and copies are visible to all later commands, so most barriers of
Vulkan have no counterpart here. Only shader *stores* (to images and storage buffers) are incoherent. A later use sees a
store only after a barrier with the bit of that use. And a store may overtake earlier uses of the same memory, unless a
barrier with the bit of stores is between them (OpenGL 4.5, section 7.13.2: stores "will not execute until all memory
accesses initiated prior to the barrier complete").

A barrier applies to all memory, not to one resource. So a barrier for one resource often makes others redundant.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

from backends.contract import Pass
from backends.gl import api as gl
from backends.gl.resources import Buffer, Image

from ..types import Graph, Step

_IMAGE_BITS: dict[str, int] = {
    "color": gl.GL_FRAMEBUFFER_BARRIER_BIT,
    "depth": gl.GL_FRAMEBUFFER_BARRIER_BIT,
    "sampled": gl.GL_TEXTURE_FETCH_BARRIER_BIT,
    "storage": gl.GL_SHADER_IMAGE_ACCESS_BARRIER_BIT,
    # Copies read pixels, or blit to a window.
    "copy": gl.GL_TEXTURE_UPDATE_BARRIER_BIT | gl.GL_FRAMEBUFFER_BARRIER_BIT,
}
_BUFFER_BITS: dict[str, int] = {
    "storage": gl.GL_SHADER_STORAGE_BARRIER_BIT,
    "uniform": gl.GL_UNIFORM_BARRIER_BIT,
    "indirect": gl.GL_COMMAND_BARRIER_BIT,
    "copy": gl.GL_BUFFER_UPDATE_BARRIER_BIT,
}


@dataclass
class _Memory:
    """The bits of all barriers since the last store to an object, and since its last use; None: there was none."""

    stored: int | None = None
    used: int | None = None


@dataclass(frozen=True)
class _Use:
    object_id: int
    bits: int
    stores: bool


def memory_barriers(
    graph: Graph, passes: Mapping[str, Pass], in_slot: Sequence[Mapping[str, Image | Buffer]]
) -> list[int]:
    """Return for each step the bits of the barrier before it, 0 for none.

    `passes` are by the names of the steps; `in_slot` has the objects of the resources by slot. Barriers depend on
    objects: two transients may share an object, and the next frame uses it again.
    """
    frames = [[_uses(step, passes[step.name], resources) for step in graph.steps] for resources in in_slot]
    barriers = [0] * len(graph.steps)
    memory: dict[int, _Memory] = {}
    while True:
        before = [*barriers]
        for frame in (*frames, *frames):  # twice each: a frame also follows the other slot's frame
            for number, uses in enumerate(frame):
                _wait(memory, barriers[number])
                for use in uses:
                    barriers[number] |= _missing(memory.setdefault(use.object_id, _Memory()), use)
                _wait(memory, barriers[number])
                for use in uses:
                    _note(memory[use.object_id], use)
        if barriers == before:
            return barriers


def _uses(step: Step, gpu_pass: Any, resources: Mapping[str, Image | Buffer]) -> list[_Use]:
    """Return the uses of objects in a step; in a step of kind "copy" all are copies."""
    names = (*step.reads, *step.writes)
    copies = step.kind == "copy"
    ways = ["copy"] * len(names) if copies else [access.use for access in (*gpu_pass.reads, *gpu_pass.writes)]
    uses = []
    for number, (name, use) in enumerate(zip(names, ways, strict=True)):
        resource = resources.get(name)  # None: parts of several buffers, which have no common object
        bits = (_IMAGE_BITS if isinstance(resource, Image) else _BUFFER_BITS)[use]
        uses.append(_Use(id(resource), bits, use == "storage" and number >= len(step.reads)))
    return uses


def _wait(memory: Mapping[int, _Memory], bits: int) -> None:
    for known in memory.values():
        if known.stored is not None:
            known.stored |= bits
        if known.used is not None:
            known.used |= bits


def _missing(memory: _Memory, use: _Use) -> int:
    since = memory.used if use.stores else memory.stored
    return 0 if since is None else use.bits & ~since


def _note(memory: _Memory, use: _Use) -> None:
    memory.used = 0
    if use.stores:
        memory.stored = 0
