"""Where a frame needs glMemoryBarrier: behind what shaders store, and nowhere else.

OpenGL keeps its own commands in order: what a draw left in a target, or a copy in a buffer, is there for all that comes
later, and Vulkan's barriers for those have no counterpart here. Only what shaders *store* (to images and storage
buffers) goes past this order. Such a store is seen by a later use of a kind only behind a barrier with the bit of that
kind; and a store may run ahead of earlier uses of the same memory, unless the bit of stores stands between (OpenGL 4.5,
section 7.13.2: stores "will not execute until all memory accesses initiated prior to the barrier complete").

A barrier is no resource's own: it works on all memory at once. So one that was needed for one resource often spares
that of another.
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
    # Reading pixels is one, the blit to a window the other.
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
    """The bits of all barriers since shaders last stored to an object, and since anybody last used it; None: never."""

    stored: int | None = None
    used: int | None = None


@dataclass(frozen=True)
class _Use:
    held: int
    bits: int
    stores: bool


def memory_barriers(
    graph: Graph, passes: Mapping[str, Pass], in_slot: Sequence[Mapping[str, Image | Buffer]]
) -> list[int]:
    """Return for each step the bits of the barrier in front of it, 0 for none.

    `passes` are by the names of the steps; `in_slot` has what is behind the names of resources. What counts is the
    object: two transients may share one, and frame follows on frame.
    """
    frames = [[_uses(step, passes[step.name], held) for step in graph.steps] for held in in_slot]
    barriers = [0] * len(graph.steps)
    memory: dict[int, _Memory] = {}
    while True:
        before = [*barriers]
        for frame in (*frames, *frames):  # twice each: a frame also follows on the other slot's
            for number, uses in enumerate(frame):
                _wait(memory, barriers[number])
                for use in uses:
                    barriers[number] |= _missing(memory.setdefault(use.held, _Memory()), use)
                _wait(memory, barriers[number])
                for use in uses:
                    _note(memory[use.held], use)
        if barriers == before:
            return barriers


def _uses(step: Step, made: Any, held: Mapping[str, Image | Buffer]) -> list[_Use]:
    """Return how a step uses objects; a step that only copies declares nothing else."""
    names = (*step.reads, *step.writes)
    copies = step.kind == "copy"
    ways = ["copy"] * len(names) if copies else [access.use for access in (*made.reads, *made.writes)]
    found = []
    for number, (name, use) in enumerate(zip(names, ways, strict=True)):
        one = held[name]
        bits = (_BUFFER_BITS if isinstance(one, Buffer) else _IMAGE_BITS)[use]
        found.append(_Use(id(one), bits, use == "storage" and number >= len(step.reads)))
    return found


def _wait(memory: Mapping[int, _Memory], bits: int) -> None:
    for known in memory.values():
        if known.stored is not None:
            known.stored |= bits
        if known.used is not None:
            known.used |= bits


def _missing(known: _Memory, use: _Use) -> int:
    since = known.used if use.stores else known.stored
    return 0 if since is None else use.bits & ~since


def _note(known: _Memory, use: _Use) -> None:
    known.used = 0
    if use.stores:
        known.stored = 0
