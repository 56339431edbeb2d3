"""The renderer's objects on Vulkan."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from contextlib import ExitStack, closing
from functools import partial
from typing import Any

from backends.contract import Pass, Plan
from backends.vulkan.device import Device
from backends.vulkan.inspection import Inspection
from backends.vulkan.instance import Instance
from backends.vulkan.resources import FORMATS, Image
from common.errors import ShaderError
from common.scene import Pose, Scene

from ...clusters.model import loop_defines
from ...graph.execute.vulkan import GraphExecutor
from ...graph.memory.vulkan_images import GraphMemory
from ...graph.plan import FramePlan
from ...graph.sync.queues import QUEUES
from ...graph.types import Graph
from ...loading.loading import Loading
from ...loading.vulkan_first_uses import rehearse
from ...pipelines.vulkan import Pipelines
from ...pipelines.vulkan_cache import PipelineCache
from ...pipelines.vulkan_descriptors import Descriptors
from ...pipelines.vulkan_layouts import CAPACITY, SetLayout
from ...scene.vulkan_data import VulkanSceneData
from ...settings import Settings
from ...tasks.workers import Workers
from ..queues.vulkan_queues import Queues
from ..queues.vulkan_submission import QueueFrames
from ..recording.vulkan_recordings import RecordedSlot
from ..recording.vulkan_secondaries import open_commands
from ..vulkan_commands import TABLES
from ..vulkan_profiler import Profiler
from ..vulkan_resources import Resources, offered_samples
from .backend import Backend
from .vulkan_outputs import CopyOutputs


class VulkanBackend(Backend):
    """Queues, resources, descriptors and recordings."""

    name = "vulkan"
    inspector = Inspection
    formats = FORMATS
    queues = QUEUES
    data: VulkanSceneData
    pipelines: Pipelines

    def __init__(self, device: Device | None, validate: bool, without: Iterable[str]) -> None:
        with ExitStack() as opened:
            if device is None:
                instance = opened.enter_context(closing(Instance(validate)))
                device = opened.enter_context(closing(Device(instance, without=without)))
            self.device: Device = device
            self._owned = opened.pop_all()

    def offered_samples(self, color_format: str) -> set[int]:
        """Return the sample counts that a colour target of this format and a depth target can have."""
        return offered_samples(self.device, color_format, "d32f")

    def create(self, scene: Scene, settings: Settings, plan: Plan, loading: Loading, pose: Pose) -> None:
        """Create frames, pipelines and the scene's data."""
        device, self._scene, self.plan = self.device, scene, plan
        self._queues = Queues(device, plan.native("async-compute") and settings.queues.async_compute)
        self.frames = QueueFrames(device, self._queues)
        self.resources = Resources(device, self._queues.families)
        self.descriptors = Descriptors(device)
        self.profiler = Profiler(device)
        self.workers = Workers(settings.frames.recording_threads)
        self.by_address = multi_draw = plan.native("multi-draw")
        self.commands = open_commands(device, self.frames, self.workers, multi_draw, settings.frames)
        anisotropy = settings.scene.anisotropy if plan.native("anisotropy") else 1.0
        bindless = plan.native("bindless")
        self.data = VulkanSceneData(
            device, scene, settings, anisotropy, self.resources, self.descriptors, bindless, loading
        )
        rehearse(loading, device, self.frames.slots, self.data, pose)
        self._cache = PipelineCache.on_disk(device)
        defines = (*self.data.defines, *loop_defines(settings, plan.native("subgroups")))
        capacity = self.data.slot_count or CAPACITY
        self.pipelines = Pipelines(device, self._cache, capacity, defines, self.data.constants)
        poisoned = ["copy_target"] * (settings.graph.poison != "off")
        self.memory = GraphMemory(device, poisoned, self._queues.families)
        self.requirement = self.memory.requirement
        self.copies = CopyOutputs(device)

    def make_sets(self, passes: Collection[Pass]) -> None:
        """Create the scene's descriptor sets, which all pipelines share; ShaderError if their layouts disagree."""
        layouts: dict[int, SetLayout] = {}
        for gpu_pass in passes:
            own = gpu_pass.sources.set if gpu_pass.sources else None
            for pipeline in gpu_pass.pipelines:
                for number, layout in enumerate(pipeline.sets):
                    if layout is None or number in (own, TABLES):  # what is there is not the scene's
                        continue
                    if layouts.setdefault(number, layout).handle != layout.handle:
                        raise ShaderError(
                            f"The shaders of the scene disagree about set {number}: a file that a new pipeline needs "
                            "was edited into other bindings; mend it, and open the scene again.",
                            pipeline.code.files,
                        )
        self.data.make_sets(layouts)

    # --- a graph ---

    def follow(self, plan: FramePlan, graph: Graph, settings: Settings, lender: Any = None) -> None:
        """Create everything that depends on the graph and the picture size: targets, barriers, readbacks."""
        super().follow(plan, graph, settings, lender)
        self.frames.follow(self.executor, self.profiler)

    def _execute(
        self, graph: Graph, passes: Mapping[str, Pass], settings: Settings, lender: Any = None
    ) -> GraphExecutor:
        return GraphExecutor(
            self.device,
            graph,
            passes,
            self.memory,
            self.resources,
            self.descriptors,
            partial(self.copies.attach, graph),
            settings.graph.poison,
            self._queues,
            lender,
        )

    def leave(self) -> None:
        """Free what `follow` created; no frame is in flight."""
        self.device.wait_idle()  # a window may still copy from a target
        self.copies.close()
        self.inspection.close()
        self.executor.close()
        self.resources.flush()  # now: several changes of size before the next frame keep only one set of targets

    # --- a frame ---

    def begin(self, slot: RecordedSlot) -> None:
        """Destroy the resources that no frame in flight can use after the last frame in `slot`."""
        self.resources.collect(slot.number)

    def deform(self, slot: RecordedSlot, pose: Pose) -> int:
        """Write the vertices that `pose` deforms into the slot's geometry; return the bytes written."""
        if not self._scene.deformations:
            return 0
        return self.data.record_deformation(self.frames.uploads(slot), slot.index, pose)

    def record(self, slot: RecordedSlot, again: bool) -> bool:
        """Record the batches whose recordings are no longer valid; return whether graphics batches are among them."""
        return self.frames.record(slot, self.commands, self.inspection, again)

    def timings(self, slot: RecordedSlot) -> dict[str, float]:
        """Return GPU milliseconds by pass of the slot's frame."""
        return self.frames.timings(slot)

    def readbacks(self, slot: RecordedSlot) -> Mapping[str, Any]:
        """Return the copies of the slot's outputs, by name."""
        return self.copies.readbacks[slot.index]

    def picture(self, graph: Graph) -> Image:
        """Return the image with the picture."""
        picture: Image = self.executor.images.image(0, graph.names["color"])
        return picture

    # --- life ---

    @property
    def counts(self) -> dict[str, int]:
        """Return the number of descriptor sets and of samplers, and the counters of the last submission."""
        return {
            "descriptor_sets": self.descriptors.set_count + self.data.bindless_sets,
            "samplers": self.resources.counts["samplers"],
            **self.frames.work,
        }

    def reload(self, changed: Collection[Any]) -> tuple[str, ...]:
        """Rebuild the pipelines that use one of the files `changed`, all or none; return their names."""
        return self.pipelines.reload(changed, self.resources.defer)

    def close(self) -> None:
        """Free everything; a second call does nothing."""
        self.device.wait_idle()
        for name in (
            *("workers", "inspection", "copies", "executor", "commands", "frames", "profiler"),
            *("pipelines", "_cache", "data", "resources", "descriptors"),
        ):
            component = getattr(self, name, None)
            if component is not None:
                component.close()
        self._owned.close()


open_backend = VulkanBackend
