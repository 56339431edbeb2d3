"""The renderer's objects on OpenGL; compare vulkan.py.

The driver finds out itself which draws must wait for which. This is convenient, but the driver repeats the work for
each call of each frame. The Vulkan backend states each dependency once, as a barrier.
"""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from functools import partial
from typing import Any

from backends.contract import Pass, Plan
from backends.gl.context import Context
from backends.gl.inspection import Inspection
from backends.gl.resources import FORMATS, sample_counts
from backends.gl.targets import Framebuffer
from common.scene import Pose, Scene

from ...graph.execute.gl import GraphExecutor
from ...graph.types import Graph
from ...loading.loading import Loading
from ...pipelines.gl import Pipelines
from ...scene.gl_data import GlSceneData
from ...settings import Settings
from ...tasks.workers import Workers
from ..recording.gl_parts import open_commands
from ..recording.gl_recordings import RecordedSlot, Recordings
from .backend import Backend
from .gl_outputs import CopyOutputs


class GlBackend(Backend):
    """Programs, buffers, textures, and lists of calls in place of recordings."""

    name = "gl"
    inspector = Inspection
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
        """Return the sample counts that a colour target of this format and a depth target can have."""
        return {*sample_counts(self.device, color_format)} & {*sample_counts(self.device, "d32f")}

    def create(self, scene: Scene, settings: Settings, plan: Plan, loading: Loading, pose: Pose) -> None:
        """Create frames, programs and the scene's data."""
        context, self.plan = self.device, plan
        self.frames = Recordings(context)
        anisotropy = settings.scene.anisotropy if plan.native("anisotropy") else 1.0
        self.data = GlSceneData(context, scene, settings, anisotropy, loading)
        self.pipelines = Pipelines(context, self.data.defines, self.data.constants)
        self.workers = Workers(settings.frames.recording_threads)
        multi_draw = plan.native("multi-draw")
        self.commands = open_commands(context, self.pipelines, multi_draw, self.workers, settings.frames)
        self.copies = CopyOutputs(context)

    # --- a graph ---

    def _execute(
        self, graph: Graph, passes: Mapping[str, Pass], settings: Settings, lender: Any = None
    ) -> GraphExecutor:
        attach, knobs = partial(self.copies.attach, graph), settings.graph
        return GraphExecutor(
            self.device, graph, passes, self.data.sampler, attach, knobs.alias, knobs.poison, lender
        )

    def leave(self) -> None:
        """Free what `follow` created; OpenGL itself waits until the GPU has finished with it."""
        self.copies.close()
        self.inspection.close()
        self.executor.close()

    # --- a frame ---

    def deform(self, slot: RecordedSlot, pose: Pose) -> int:
        """Write the vertices that `pose` deforms into the slot's geometry; return the bytes written."""
        return self.data.write_deformation(slot.index, pose)

    def record(self, slot: RecordedSlot, again: bool) -> bool:
        """Record the calls of the slot's frame if they are no longer valid; return whether they were recorded."""
        key = tuple(gpu_pass.key(slot.index) for gpu_pass in self._passes)
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
        assert isinstance(self.copies, CopyOutputs) and self.copies.picture is not None, (
            "a picture is handed on"
        )
        return self.copies.picture

    # --- life ---

    @property
    def counts(self) -> dict[str, int]:
        """Return the number of samplers."""
        # OpenGL has no descriptor sets: textures and buffers are bound one by one.
        return {"descriptor_sets": 0, "samplers": self.data.samplers}

    def reload(self, changed: Collection[Any]) -> tuple[str, ...]:
        """Relink the programs that use one of the files `changed`, all or none; return their pipelines' names."""
        return self.pipelines.reload(changed)

    def close(self) -> None:
        """Free everything; a second call does nothing."""
        self.enter()
        for name in ("workers", "inspection", "copies", "executor", "data", "frames", "pipelines"):
            component = getattr(self, name, None)
            if component is not None:
                component.close()
        for owned in self._owned:
            owned.close()
        self._owned.clear()


open_backend = GlBackend
