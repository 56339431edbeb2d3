"""The renderer's objects on OpenGL; compare vulkan_backend.py.

The driver finds out by itself that a pass must wait for what it reads. That is comfortable, and it is work that the
driver does for each call of each frame: what Vulkan's barriers say once, OpenGL guesses again and again.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from functools import partial
from typing import Any

from backends.contract import Plan
from backends.gl.context import Context
from backends.gl.inspection import Inspection
from backends.gl.resources import FORMATS, sample_counts
from backends.gl.targets import Framebuffer
from common.scene import Pose, Scene

from ..graph.execute.gl import GraphExecutor
from ..graph.plan import COPY, FramePlan
from ..graph.types import Graph
from ..loading.loading import Loading
from ..pipelines.gl import Pipelines
from ..scene.gl_data import GlSceneData
from ..settings import Settings
from ..tasks.workers import Workers
from .backend import Backend
from .frame import SLOTS
from .gl_outputs import CopyOutputs
from .recording.gl_parts import open_commands
from .recording.gl_recordings import RecordedSlot, Recordings


class GlBackend(Backend):
    """Programs, buffers, textures, and the lists of calls that stand in for recordings."""

    name = "gl"
    formats = FORMATS
    data: GlSceneData
    pipelines: Pipelines

    def __init__(self, device: Context | None, validate: bool, without: Iterable[str]) -> None:
        self._owned: list[Context] = []
        if device is None:
            device = Context(validate, without)
            self._owned.append(device)
        self.device: Context = device

    def enter(self) -> None:
        """Make the context current."""
        self.device.make_current()

    def offered_samples(self, color_format: str) -> set[int]:
        """Return how many samples a pixel of colour in this format and of depth can have."""
        return {*sample_counts(self.device, color_format)} & {*sample_counts(self.device, "d32f")}

    def create(self, scene: Scene, settings: Settings, plan: Plan, loading: Loading, pose: Pose) -> None:
        """Make frames, programs and the scene's data."""
        context = self.device
        self.frames = Recordings(context)
        self.pipelines = Pipelines(context)
        anisotropy = settings.anisotropy if plan.native("anisotropy") else 1.0
        self.data = GlSceneData(context, scene, settings, anisotropy, loading)
        self.workers = Workers(settings.recording_threads)
        multi_draw = plan.native("multi-draw")
        self.commands = open_commands(context, self.pipelines, multi_draw, self.workers, settings)
        self.copies = CopyOutputs(context)

    # --- a graph ---

    def follow(self, plan: FramePlan, graph: Graph, settings: Settings) -> None:
        """Make everything whose size is the picture's: targets, framebuffers, readback."""
        self.frames.forget()
        passes = plan.implementations()
        self._passes = [passes[step.name] for step in graph.steps if step.name != COPY]
        self.executor = GraphExecutor(
            self.device,
            graph,
            passes | {COPY: self.copies},
            self.data.sampler,
            partial(self.copies.attach, graph),
            settings.alias,
            settings.poison,
        )
        images = self.executor.images.by_name(graph)
        self.inspection = Inspection(self.device, plan.watched(graph), images, SLOTS)

    def leave(self) -> None:
        """Free that; OpenGL itself waits for the GPU's use."""
        self.copies.close()
        self.inspection.close()
        self.executor.close()

    # --- a frame ---

    def deform(self, slot: RecordedSlot, pose: Pose) -> int:
        """Write the vertices that `pose` deforms into the slot's geometry; return the bytes written."""
        return self.data.write_deformation(slot.index, pose)

    def record(self, slot: RecordedSlot, again: bool) -> bool:
        """Find the calls of the slot's frame where they are no longer good; return whether it did."""
        key = tuple(one.key(slot.index) for one in self._passes)
        if slot.key == key and again:
            return False
        with self.frames.recording(slot, key) as calls:
            self.commands.begin(slot)
            slot.timestamps.begin_frame()
            self.data.bind_frame(slot.index)
            self.executor.record(self.commands, slot.index, calls, self.inspection)
            slot.work = self.commands.work
        return True

    def timings(self, slot: RecordedSlot) -> dict[str, float]:
        """Return GPU milliseconds by pass of the slot's frame."""
        return slot.timestamps.read()

    def readbacks(self, slot: RecordedSlot) -> Mapping[str, Any]:
        """Return the copies of the slot's outputs, by name."""
        return self.copies.readbacks[slot.index]

    def picture(self, graph: Graph) -> Framebuffer:
        """Return the framebuffer with the picture."""
        assert self.copies.picture is not None, "a picture is handed on"
        return self.copies.picture

    # --- life ---

    @property
    def counts(self) -> dict[str, int]:
        """Return how many samplers there are."""
        # OpenGL has no descriptor sets: textures and buffers are bound one by one.
        return {"descriptor_sets": 0, "samplers": self.data.samplers}

    def reload(self, changed: Collection[Any]) -> tuple[str, ...]:
        """Link the programs anew that use one of the files `changed`, all or none; return their pipelines' names."""
        return self.pipelines.reload(changed)

    def close(self) -> None:
        """Free everything; a second time does nothing."""
        self.enter()
        for name in ("workers", "inspection", "copies", "executor", "data", "frames", "pipelines"):
            held = getattr(self, name, None)
            if held is not None:
                held.close()
        for owned in self._owned:
            owned.close()
        self._owned.clear()


open_backend = GlBackend
