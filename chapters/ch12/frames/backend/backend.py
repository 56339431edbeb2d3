"""The interface between the renderer and an API. `vulkan.py` and `gl.py` implement it."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from importlib import import_module
from typing import Any

from backends.contract import Pass, Plan
from common.scene import Pose, Scene

from ...graph.plan import COPY, FramePlan
from ...graph.sync.queues import GRAPHICS
from ...graph.types import Graph, Requirements
from ...loading.loading import Loading
from ...pipelines.description import Pipelines
from ...scene.data import SceneData
from ...settings import Settings
from ..frame import SLOTS
from .outputs import OutputCopies


class Backend:
    """The objects of a renderer on one API, from opening to closing."""

    name: str
    """"vulkan" or "gl": the module of a subject's folder that belongs to this API."""
    formats: Collection[str]
    """The formats that an image of the graph can have."""
    device: Any
    plan: Plan
    """The path of each feature, from `create` on."""
    data: SceneData
    pipelines: Pipelines
    frames: Any
    """The ring of slots: `begin`, `submit`, `wait`, `forget`."""
    executor: Any = None
    """Executes the graph of the last `follow`; None before."""
    copies: OutputCopies
    """The last step of a frame: the copies of its outputs."""
    inspector: type[Any]
    """The class of `inspection`, which copies and counts the output of each pass after it."""
    inspection: Any
    by_address = True
    """Whether a draw's record is read when the GPU executes the draw, and not when it is recorded."""
    queues: Collection[str] = (GRAPHICS,)
    """The queues that the graph is compiled for; if the device has only one, all batches go to it."""
    requirement: Requirements | None = None
    """The memory requirements of images and buffers, if the API lets the graph place them."""

    def __init__(self, device: Any, validate: bool, without: Iterable[str]) -> None:
        """Use `device`, or open a new one if it is None."""
        raise NotImplementedError

    def enter(self) -> None:
        """Prepare for calls of the API: OpenGL makes its context current."""

    def offered_samples(self, color_format: str) -> set[int]:
        """Return the sample counts that a colour target of this format and a depth target can have."""
        raise NotImplementedError

    def create(self, scene: Scene, settings: Settings, plan: Plan, loading: Loading, pose: Pose) -> None:
        """Create frames, pipelines and the scene's data; `pose` is the pose at time 0."""
        raise NotImplementedError

    def part(self, package: str) -> Any:
        """Return the module of a subject's folder that is written for this API, such as `cloth.vulkan`."""
        return import_module(f"{package}.{self.name}")

    def make_sets(self, passes: Collection[Pass]) -> None:
        """Create the scene's descriptor sets for the pipelines of `passes`; OpenGL has none."""

    # --- a graph ---

    def follow(self, plan: FramePlan, graph: Graph, settings: Settings, lender: Any = None) -> None:
        """Create everything that depends on the graph and the picture size: targets, barriers, readbacks.

        `lender` are images of another graph, whose histories this one continues where they are alike.
        """
        self.frames.forget()
        passes = plan.implementations()
        self._passes = [passes[step.name] for step in graph.steps if step.name != COPY]
        self.executor = self._execute(graph, passes | {COPY: self.copies}, settings, lender)
        images = [self.executor.images.by_name(graph, slot) for slot in range(SLOTS)]
        self.inspection = self.inspector(self.device, plan.watched(graph), images)

    def _execute(
        self, graph: Graph, passes: Mapping[str, Pass], settings: Settings, lender: Any = None
    ) -> Any:
        """Return the executor of a graph with these passes."""
        raise NotImplementedError

    def leave(self) -> None:
        """Free what `follow` created; no frame is in flight."""
        raise NotImplementedError

    # --- a frame ---

    def begin(self, slot: Any) -> None:
        """Prepare for a frame in `slot`, which the GPU has finished with."""

    def deform(self, slot: Any, pose: Pose) -> int:
        """Write the vertices that `pose` deforms into the slot's geometry; return the bytes written."""
        raise NotImplementedError

    def record(self, slot: Any, again: bool) -> bool:
        """Record the slot's frame if its recording is no longer valid, or always unless `again`.

        Returns whether it was recorded.
        """
        raise NotImplementedError

    def timings(self, slot: Any) -> dict[str, float]:
        """Return GPU milliseconds by pass of the slot's finished frame."""
        raise NotImplementedError

    def readbacks(self, slot: Any) -> Mapping[str, Any]:
        """Return the copies of the slot's outputs, by name."""
        raise NotImplementedError

    def picture(self, graph: Graph) -> Any:
        """Return the picture, for a window to copy from."""
        raise NotImplementedError

    # --- life ---

    @property
    def counts(self) -> dict[str, int]:
        """Return the numbers of API objects, and counters of the last frame."""
        raise NotImplementedError

    def reload(self, changed: Collection[Any]) -> tuple[str, ...]:
        """Rebuild the pipelines that use one of the files `changed`, all or none; return their names."""
        raise NotImplementedError

    def close(self) -> None:
        """Free everything; a second call does nothing."""
        raise NotImplementedError


def open_backend(name: str, device: Any, validate: bool, without: Iterable[str]) -> Backend:
    """Return the backend "vulkan" or "gl"; only this call imports its module, and the binding of the API."""
    backend: Backend = import_module(f".{name}", __package__).open_backend(device, validate, without)
    return backend
