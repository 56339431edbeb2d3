"""Carries a compiled frame graph out on OpenGL; compare vulkan.py.

For each step there is what stands around its pass: a barrier where shaders stored something, the framebuffer, and the
textures through which it reads what others drew. Recording a frame is a walk over them that ends in a list of calls; in
a frame whose list is still good nothing of this file runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass
from typing import Any

from backends.contract import Pass
from backends.gl.context import Context
from backends.gl.inspection import Inspection
from backends.gl.resources import Buffer, Image
from common.scene import Sampler

from ...frames.frame import SLOTS
from ...frames.gl_commands import Commands, Textures
from ...frames.recording.gl_recordings import CallRecorder
from ..memory.gl_images import GraphImages
from ..memory.gl_poison import Poison
from ..sync.gl import memory_barriers
from ..types import Graph, Step
from .gl_bindings import BoundSources, check_sources, sources
from .gl_targets import Framebuffers, Targets


@dataclass
class _Ready:
    """A step in one slot, as it is recorded."""

    step: Any  # a `Step`, which has what an inspection asks of a pass: its name
    barrier: int
    targets: Targets | None
    poison: Poison | None = None
    sources: Textures | BoundSources | None = None
    """For a pass that samples what others drew."""


class GraphExecutor:
    """A graph with its images, ready to be recorded for each slot. Close it before another graph takes its place.

    `passes` are by the names of the graph's nodes; `sampler` makes samplers; `externals` gives the images and buffers
    of others, by slot; `alias` and `poison` are the settings of these names.
    """

    def __init__(
        self,
        context: Context,
        graph: Graph,
        passes: Mapping[str, Pass],
        sampler: Callable[[Sampler, float], int],
        externals: Callable[[GraphImages], list[Mapping[str, Image | Buffer]]] | None = None,
        alias: bool = True,
        poison: str = "off",
    ) -> None:
        self._context, self.graph, self._passes = context, graph, dict(passes)
        self._sampler = sampler
        self._framebuffers = Framebuffers(context)
        self.images = GraphImages(context, graph, alias)
        try:
            if externals is not None:
                for held, more in zip(self.images.in_slot, externals(self.images), strict=True):
                    held.update(more)
            self.barriers = memory_barriers(graph, self._passes, self.images.in_slot)
            """By step the bits of the glMemoryBarrier in front of it, 0 for none."""
            self._slots = [self._ready(slot, poison) for slot in range(SLOTS)]
            for step in graph.steps:
                self._bind_sources(step)
        except BaseException:
            self.close()
            raise

    # --- made once for a graph ---

    def _ready(self, slot: int, poison: str) -> list[_Ready]:
        context, held = self._context, self.images.in_slot[slot]
        return [
            _Ready(
                step,
                barrier,
                Targets(context, self._framebuffers.get(step, held), step)
                if step.kind == "graphics"
                else None,
                Poison(context, step.barriers, held, poison) if poison != "off" else None,
            )
            for step, barrier in zip(self.graph.steps, self.barriers, strict=True)
        ]

    def _bind_sources(self, step: Step) -> None:
        """Note what a pass binds to sample what it reads: one unit for each, in the order in which it declares them."""
        made = self._passes[step.name]
        if made.sources is None:
            return
        sampled = step.sampled(made.reads)
        smooth, first = made.sources.filter, made.sources.first.get("texture", 0)
        sampler = self._sampler(Sampler(smooth, smooth, None, "clamp", "clamp"), 1.0)
        for slot, steps in enumerate(self._slots):
            ready = next(one for one in steps if one.step.name == step.name)
            if step.kind == "compute":  # it has no attachments: all that it touches is bound
                check_sources(self._context, step, made, self.graph)
                ready.sources = sources(step, made, self.graph, self.images.in_slot[slot], sampler)
                continue
            ready.sources = tuple(
                (unit, self.images.image(slot, name).view, sampler)
                for unit, name in enumerate(sampled, first)
            )

    def swap(self, name: str, made: Pass) -> None:
        """Let another implementation draw step `name`: the graph stays as it is, the recordings do not.

        It declares the same reads and writes.
        """
        step = next(step for step in self.graph.steps if step.name == name)
        if step.kind == "compute" and made.sources is not None:  # before anything is given up
            check_sources(self._context, step, made, self.graph)
        self._passes[name] = made
        self._bind_sources(next(step for step in self.graph.steps if step.name == name))

    # --- recorded ---

    def record(
        self, commands: Commands, slot: int, calls: CallRecorder, inspection: Inspection | None = None
    ) -> None:
        """Record the frame of a slot: each pass between its barrier, label, timestamps and framebuffer."""
        context, labels = self._context, self._context.sink.labels
        for one in self._slots[slot]:
            made, name = self._passes[one.step.name], one.step.name
            if one.poison is not None:
                one.poison.record()
            if one.barrier:
                context.fn.glMemoryBarrier(one.barrier)
            timed = one.step.kind != "copy"
            calls.add(labels.append, name)  # for messages while the calls are made
            with context.label(name):
                if timed:
                    commands.slot.timestamps.begin(name)
                commands.sources = one.sources
                commands.extent = one.step.size
                made.pre_render(commands)
                if one.targets is not None:
                    one.targets.begin(commands)
                made.record(commands)
                if one.targets is not None:
                    one.targets.end()
                if timed:
                    commands.slot.timestamps.end()
                calls.add(labels.pop)
            if inspection is not None and timed:
                inspection.record(slot, one.step, commands.work)

    def close(self) -> None:
        """Free framebuffers and images."""
        self._framebuffers.close()
        self.images.close()
