"""Carries a compiled frame graph out on Vulkan: everything that stood between the passes by hand, from the graph.

For each step there are ready-made structs: the barriers in front of it, the attachments it draws to, and the set
through which it reads what others drew. Recording a frame is a walk over them; in a frame whose recording is still good
nothing of this file runs.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from typing import Any

from backends.contract import Pass
from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.inspection import Inspection
from backends.vulkan.once import submit_once
from backends.vulkan.resources import Buffer, Image
from common.scene import Sampler

from ...frames.frame import SLOTS
from ...frames.queues.vulkan_queues import Queues
from ...frames.vulkan_commands import Commands
from ...frames.vulkan_profiler import Profiler
from ...frames.vulkan_resources import Resources
from ...pipelines.vulkan_descriptors import Descriptors, Held, Sets, Texture
from ..memory.vulkan_images import GraphImages, GraphMemory
from ..memory.vulkan_poison import Poison
from ..sync.vulkan import dependency, layout_of
from ..types import Graph, Step
from .batches import batches_of, last_drawn, prologues
from .vulkan_sets import check_sources, sources
from .vulkan_targets import Targets


@dataclass
class _Ready:
    """A step in one slot, as it is recorded."""

    step: Any  # a `Step`, which has what an inspection asks of a pass: its name
    barriers: Any
    targets: Targets | None
    poison: Poison | None = None
    sources: Any = None
    """(number, array of one descriptor set), for a pass that reads what others wrote."""
    releases: Any = None


@dataclass
class _Slot:
    steps: list[_Ready] = field(default_factory=list)
    epilogue: Any = None


class GraphExecutor:
    """A graph with its images, ready to be recorded for each slot. Close it before another graph takes its place.

    `passes` are by the names of the graph's nodes; `externals` the images and buffers of others, by slot. `poison` is
    the setting of that name. Each of the `batches` is recorded by itself, into the slot that says which one it is.
    """

    def __init__(
        self,
        device: Device,
        graph: Graph,
        passes: Mapping[str, Pass],
        memory: GraphMemory,
        resources: Resources,
        descriptors: Descriptors,
        externals: Callable[[GraphImages], list[Mapping[str, Image | Buffer]]] | None = None,
        poison: str = "off",
        queues: Queues | None = None,
    ) -> None:
        self._device, self.graph, self._passes = device, graph, dict(passes)
        self._queues, self.batches = queues or Queues(device), batches_of(graph)
        self._resources, self._descriptors = resources, descriptors
        self._sets: dict[str, Sets] = {}
        self.images = GraphImages(device, graph, memory, {})
        try:
            if externals is not None:
                for held, more in zip(self.images.in_slot, externals(self.images), strict=True):
                    held.update(more)
            self._slots = [self._ready(slot, poison) for slot in range(SLOTS)]
            for step in graph.steps:
                self._bind_sources(step)
            self._begin_lasting()
        except BaseException:
            self.close()
            raise

    # --- made once for a graph ---

    def _ready(self, slot: int, poison: str) -> _Slot:
        queues, held, graph = self._queues, self.images.in_slot[slot], self.graph
        steps = [
            _Ready(
                step,
                dependency(step.barriers, held, queues.taking),
                Targets(step, held) if step.kind == "graphics" else None,
                Poison(queues, step.barriers, held, poison) if poison != "off" else None,
                releases=dependency(step.releases, held, queues.giving) if queues.families else None,
            )
            for step in graph.steps
        ]
        return _Slot(steps, dependency(graph.epilogue, held, queues.taking))

    def _begin_lasting(self) -> None:
        """Bring what lasts from frame to frame into the state, and to the queue, in which a frame finds it."""
        queues = self._queues
        for queue, released, planned in prologues(self.graph):
            if released and not queues.families:
                continue  # a queue of the same family takes it as it is
            with submit_once(self._device, queues.of[queue]) as commands:
                for held in self.images.in_slot:
                    made = dependency(planned, held, queues.giving if released else queues.taking)
                    self._device.fn.vkCmdPipelineBarrier2(commands, made)

    def _bind_sources(self, step: Step) -> None:
        """Make the sets through which a pass samples, one binding for each of its reads in the order it declares."""
        made = self._passes[step.name]
        if made.sources is None:
            return
        sampled = step.sampled(made.reads)
        number, smooth = made.sources.set, made.sources.filter
        sampler = self._resources.sampler(Sampler(smooth, smooth, None, "clamp", "clamp"), 1.0)
        if step.kind == "compute":
            check_sources(step, made, self.graph)
        layout = made.pipelines[0].sets[number]
        assert layout is not None, f"'{step.name}' samples what it reads"
        wanted = []
        for slot in range(SLOTS):
            images = [self.images.image(slot, name) for name in sampled]
            held: dict[int, Held] = {
                binding: Texture(image.view, sampler, layout_of("read", image))
                for binding, image in enumerate(images)
            }
            if step.kind == "compute":  # it has no attachments: all that it touches is bound
                held = sources(step, made, self.graph, self.images.in_slot[slot], sampler)
            wanted.append((layout, held, f"{step.name} sources, slot {slot}"))
        self._sets[step.name] = self._descriptors.create(wanted)
        for ready, handle in zip(self._of(step.name), self._sets[step.name].handles, strict=True):
            ready.sources = number, vk.array("VkDescriptorSet", [handle])

    def _of(self, name: str) -> list[_Ready]:
        """Return a step as it is in each slot."""
        return [next(one for one in mine.steps if one.step.name == name) for mine in self._slots]

    def swap(self, name: str, made: Pass) -> None:
        """Let another implementation draw step `name`: the graph stays as it is, the recordings do not.

        It declares the same reads and writes; no frame is in flight.
        """
        step = next(step for step in self.graph.steps if step.name == name)
        if step.kind == "compute" and made.sources is not None:  # before anything is given up
            check_sources(step, made, self.graph)
        self._passes[name] = made
        if name in self._sets:
            self._descriptors.destroy(self._sets.pop(name))
        for ready in self._of(name):
            ready.sources = None
        self._bind_sources(next(step for step in self.graph.steps if step.name == name))

    # --- recorded ---

    def record(
        self, commands: Commands, slot: int, profiler: Profiler, inspection: Inspection | None = None
    ) -> None:
        """Record a batch of a slot's frame: each pass between its barriers, label, timestamps and attachments."""
        ready, batch = self._slots[slot], commands.slot.batch
        for one in (ready.steps[place] for place in self.batches[batch].steps):
            made, name = self._passes[one.step.name], one.step.name
            if one.poison is not None:
                one.poison.record(commands)
            elif one.barriers is not None:
                commands.barrier(one.barriers)
            commands.begin_label(name)
            timed = one.step.kind != "copy"
            if timed:
                profiler.begin(commands.slot, name)
            commands.sources = one.sources
            commands.extent = one.step.size
            made.pre_render(commands)
            if one.targets is not None:
                commands.begin_rendering(one.targets)
            made.record(commands)
            if one.targets is not None:
                commands.end_rendering()
            if timed:
                profiler.end(commands.slot)
            commands.end_label()
            if inspection is not None and timed:
                inspection.record(commands.handle, slot, one.step, commands.work)
            if one.releases is not None:
                commands.barrier(one.releases)
        if ready.epilogue is not None and batch == last_drawn(self.batches):
            commands.barrier(ready.epilogue)

    def passes_of(self, batch: int) -> list[tuple[Step, Pass]]:
        """Return the steps of a batch, each with what carries it out."""
        steps = [self.graph.steps[place] for place in self.batches[batch].steps]
        return [(step, self._passes[step.name]) for step in steps]

    def close(self) -> None:
        """Free images and sets; no frame is in flight."""
        for sets in self._sets.values():
            self._descriptors.destroy(sets)
        self._sets = {}
        self.images.close()
