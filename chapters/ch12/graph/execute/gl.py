"""Executes a compiled frame graph on OpenGL; compare vulkan.py.

Each step has the state around its pass: a barrier after shader stores, the framebuffer, and the textures that it reads.
Recording a frame iterates over the steps and results in a list of calls. While the list is valid, no code of this file
runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass

from backends.contract import Pass
from backends.gl.context import Context
from backends.gl.inspection import Inspection
from backends.gl.resources import Buffer, Image
from common.scene import Sampler

from ...frames.frame import SLOTS
from ...frames.gl_commands import Commands
from ...frames.recording.gl_recordings import CallRecorder
from ..memory.gl_images import GraphImages
from ..memory.gl_poison import Poison
from ..sync.gl import memory_barriers
from ..types import Graph, Step
from .gl_bindings import check_sources, sources
from .gl_targets import Framebuffers, Targets
from .steps import ReadyStep, add_externals


@dataclass
class _Ready(ReadyStep):
    barrier: int
    targets: Targets | None
    poison: Poison | None = None


class GraphExecutor:
    """A graph with its images, ready to be recorded for each slot. Close it before you open another graph.

    `passes` has the passes by the names of the nodes; `sampler` returns samplers; `externals` returns the external
    images and buffers of each slot; `alias` and `poison` are the settings of these names, `lender` has the histories.
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
        lender: GraphImages | None = None,
    ) -> None:
        self._context, self.graph, self._passes = context, graph, dict(passes)
        self._sampler = sampler
        self._framebuffers = Framebuffers(context)
        self.images = GraphImages(context, graph, alias, lender)
        try:
            add_externals(self.images, externals)
            self.barriers = memory_barriers(graph, self._passes, self.images.in_slot)
            """The bits of the glMemoryBarrier before each step, 0 for none."""
            self._slots = [self._ready(slot, poison) for slot in range(SLOTS)]
            for step in graph.steps:
                self._bind_sources(step)
        except BaseException:
            self.close()
            raise

    # --- created once for each graph ---

    def _ready(self, slot: int, poison: str) -> list[_Ready]:
        context, resources = self._context, self.images.in_slot[slot]
        return [
            _Ready(
                step,
                barrier,
                Targets(context, self._framebuffers.get(step, resources), step)
                if step.kind == "graphics"
                else None,
                Poison(context, step.barriers, resources, poison) if poison != "off" else None,
            )
            for step, barrier in zip(self.graph.steps, self.barriers, strict=True)
        ]

    def _bind_sources(self, step: Step) -> None:
        """Set the textures that a pass samples: one unit for each texture, in the declared order."""
        gpu_pass = self._passes[step.name]
        if gpu_pass.sources is None:
            return
        sampled = step.sampled(gpu_pass.reads)
        smooth, first = gpu_pass.sources.filter, gpu_pass.sources.first.get("texture", 0)
        sampler = self._sampler(Sampler(smooth, smooth, None, "clamp", "clamp"), 1.0)
        for slot, steps in enumerate(self._slots):
            ready = next(ready_step for ready_step in steps if ready_step.step.name == step.name)
            if step.kind == "compute":  # no attachments: all resources are bound
                check_sources(self._context, step, gpu_pass, self.graph)
                ready.sources = sources(step, gpu_pass, self.graph, self.images.in_slot[slot], sampler)
                continue
            ready.sources = tuple(
                (unit, self.images.image(slot, name).view, sampler)
                for unit, name in enumerate(sampled, first)
            )

    def swap(self, name: str, gpu_pass: Pass) -> None:
        """Let another pass draw step `name`: the graph stays valid, the recordings do not.

        It must declare the same reads and writes.
        """
        step = next(step for step in self.graph.steps if step.name == name)
        if step.kind == "compute" and gpu_pass.sources is not None:  # before the old pass is replaced
            check_sources(self._context, step, gpu_pass, self.graph)
        self._passes[name] = gpu_pass
        self._bind_sources(next(step for step in self.graph.steps if step.name == name))

    # --- recording ---

    def record(
        self, commands: Commands, slot: int, calls: CallRecorder, inspection: Inspection | None = None
    ) -> None:
        """Record the frame of a slot: each pass between its barrier, label, timestamps and framebuffer."""
        context, labels = self._context, self._context.sink.labels
        for ready_step in self._slots[slot]:
            gpu_pass, name = self._passes[ready_step.step.name], ready_step.step.name
            if ready_step.poison is not None:
                ready_step.poison.record()
            if ready_step.barrier:
                context.fn.glMemoryBarrier(ready_step.barrier)
            timed = ready_step.step.kind != "copy"
            calls.add(labels.append, name)  # for messages while the calls are made
            with context.label(name):
                if timed:
                    commands.slot.timestamps.begin(name)
                ready_step.enter(commands, gpu_pass)
                if ready_step.targets is not None:
                    ready_step.targets.begin(commands)
                gpu_pass.record(commands)
                if ready_step.targets is not None:
                    ready_step.targets.end()
                if timed:
                    commands.slot.timestamps.end()
                calls.add(labels.pop)
            if inspection is not None and timed:
                inspection.record(slot, ready_step.step, commands.work)

    def close(self) -> None:
        """Free framebuffers and images."""
        self._framebuffers.close()
        self.images.close()
