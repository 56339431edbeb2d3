"""Executes a compiled frame graph on Vulkan: it records each pass with its barriers, attachments and descriptor sets.

Each step has its structs: the barriers before it, its attachments, and the descriptor set of its reads. Recording a
frame iterates over the steps. While the recording is valid, no code of this file runs.
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
from ..types import PREVIOUS, Graph, Step
from .batches import batches_of, last_drawn, prologues
from .steps import ReadyStep, add_externals
from .vulkan_sets import check_sources, sources
from .vulkan_targets import Targets


@dataclass
class _Ready(ReadyStep):
    barriers: Any
    targets: Targets | None
    poison: Poison | None = None
    releases: Any = None


@dataclass
class _Slot:
    steps: list[_Ready] = field(default_factory=list)
    epilogue: Any = None


class GraphExecutor:
    """A graph with its images, ready to be recorded for each slot. Close it before you open another graph.

    `passes` are by the names of the graph's nodes; `externals` returns the external images and buffers of each slot.
    `poison` is the setting of that name. Each of the `batches` is recorded separately. Histories may be those of the
    `lender`.
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
        lender: GraphImages | None = None,
    ) -> None:
        self._device, self.graph, self._passes = device, graph, dict(passes)
        self._queues, self.batches = queues or Queues(device), batches_of(graph)
        self._resources, self._descriptors = resources, descriptors
        self._sets: dict[str, Sets] = {}
        self.images = GraphImages(device, graph, memory, {}, lender)
        try:
            add_externals(self.images, externals)
            self._slots = [self._ready(slot, poison) for slot in range(SLOTS)]
            for step in graph.steps:
                self._bind_sources(step)
            self._begin_lasting()
            self._find_keyed()
        except BaseException:
            self.close()
            raise

    # --- created once for each graph ---

    def _ready(self, slot: int, poison: str) -> _Slot:
        queues, resources, graph = self._queues, self.images.in_slot[slot], self.graph
        steps = [
            _Ready(
                step,
                dependency(step.barriers, resources, queues.taking),
                Targets(step, resources, self._passes[step.name].reads) if step.kind == "graphics" else None,
                Poison(queues, step.barriers, resources, poison) if poison != "off" else None,
                releases=dependency(step.releases, resources, queues.giving) if queues.families else None,
            )
            for step in graph.steps
        ]
        return _Slot(steps, dependency(graph.epilogue, resources, queues.taking))

    def _begin_lasting(self) -> None:
        """Bring lasting resources into the state, and to the queue, in which the first frame finds them."""
        queues, borrowed = self._queues, self.images.borrowed
        for queue, released, all_planned in prologues(self.graph):
            # A borrowed history is in that state already, and has contents.
            planned = [it for it in all_planned if it.resource.removesuffix(PREVIOUS) not in borrowed]
            if not planned or (released and not queues.families):
                continue  # no transfer within a queue family
            with submit_once(self._device, queues.of[queue]) as commands:
                for resources in self.images.in_slot:
                    barriers_ = dependency(planned, resources, queues.giving if released else queues.taking)
                    self._device.fn.vkCmdPipelineBarrier2(commands, barriers_)

    def _bind_sources(self, step: Step) -> None:
        """Create the descriptor sets of a pass, one for each slot: one binding for each read, in the declared order."""
        gpu_pass = self._passes[step.name]
        if gpu_pass.sources is None:
            return
        sampled = step.sampled(gpu_pass.reads)
        number, smooth = gpu_pass.sources.set, gpu_pass.sources.filter
        sampler = self._resources.sampler(Sampler(smooth, smooth, None, "clamp", "clamp"), 1.0)
        if step.kind == "compute":
            check_sources(step, gpu_pass, self.graph)
        layout = gpu_pass.pipelines[0].sets[number]
        assert layout is not None, f"'{step.name}' samples what it reads"
        contents = []
        for slot in range(SLOTS):
            images = [self.images.image(slot, name) for name in sampled]
            bindings: dict[int, Held] = {
                binding: Texture(image.view, sampler, layout_of("read", image))
                for binding, image in enumerate(images)
            }
            if step.kind == "compute":  # no attachments: all resources are bound
                bindings = sources(step, gpu_pass, self.graph, self.images.in_slot[slot], sampler)
            contents.append((layout, bindings, f"{step.name} sources, slot {slot}"))
        self._sets[step.name] = self._descriptors.create(contents)
        for ready, handle in zip(self._of(step.name), self._sets[step.name].handles, strict=True):
            ready.sources = number, vk.array("VkDescriptorSet", [handle])

    def _of(self, name: str) -> list[_Ready]:
        """Return the step of this name in each slot."""
        return [
            next(ready_step for ready_step in slot.steps if ready_step.step.name == name)
            for slot in self._slots
        ]

    def swap(self, name: str, gpu_pass: Pass) -> None:
        """Let another pass draw step `name`: the graph stays valid, the recordings do not.

        It must declare the same reads and writes; no frame is in flight.
        """
        step = next(step for step in self.graph.steps if step.name == name)
        if step.kind == "compute" and gpu_pass.sources is not None:  # before the old pass is replaced
            check_sources(step, gpu_pass, self.graph)
        self._passes[name] = gpu_pass
        self._find_keyed()
        if name in self._sets:
            self._descriptors.destroy(self._sets.pop(name))
        for ready in self._of(name):
            ready.sources = None
        self._bind_sources(next(step for step in self.graph.steps if step.name == name))

    def _find_keyed(self) -> None:
        workload = [[gpu_pass for _, gpu_pass in self.passes_of(batch)] for batch in range(len(self.batches))]
        self.keyed = [[it for it in passes if type(it).key is not Pass.key] for passes in workload]
        """The passes of each batch whose recordings depend on something."""

    # --- recording ---

    def record(
        self, commands: Commands, slot: int, profiler: Profiler, inspection: Inspection | None = None
    ) -> None:
        """Record a batch of a slot's frame: each pass between its barriers, label, timestamps and attachments."""
        ready, batch = self._slots[slot], commands.slot.batch
        for ready_step in (ready.steps[place] for place in self.batches[batch].steps):
            gpu_pass, name = self._passes[ready_step.step.name], ready_step.step.name
            if ready_step.poison is not None:
                ready_step.poison.record(commands)
            elif ready_step.barriers is not None:
                commands.barrier(ready_step.barriers)
            commands.begin_label(name)
            timed = ready_step.step.kind != "copy"
            if timed:
                profiler.begin(commands.slot, name)
            ready_step.enter(commands, gpu_pass)
            if ready_step.targets is not None:
                commands.begin_rendering(ready_step.targets)
            gpu_pass.record(commands)
            if ready_step.targets is not None:
                commands.end_rendering()
            if timed:
                profiler.end(commands.slot)
            commands.end_label()
            if inspection is not None and timed:
                inspection.record(commands.handle, slot, ready_step.step, commands.work)
            if ready_step.releases is not None:
                commands.barrier(ready_step.releases)
        if ready.epilogue is not None and batch == last_drawn(self.batches):
            commands.barrier(ready.epilogue)

    def passes_of(self, batch: int) -> list[tuple[Step, Pass]]:
        """Return the steps of a batch, each with its pass."""
        steps = [self.graph.steps[place] for place in self.batches[batch].steps]
        return [(step, self._passes[step.name]) for step in steps]

    def close(self) -> None:
        """Free images and sets; no frame is in flight."""
        for sets in self._sets.values():
            self._descriptors.destroy(sets)
        self._sets = {}
        self.images.close()
