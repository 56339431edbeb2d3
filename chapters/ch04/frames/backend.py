"""What the renderer asks of an API. `vulkan_backend.py` and `gl_backend.py` answer, each with objects of its own."""

from __future__ import annotations

from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass
from importlib import import_module
from typing import Any

from backends.contract import Pass, Plan
from common.scene import Pose, Scene
from common.view.camera import View

from ..graph.plan import FramePlan
from ..graph.types import Graph, Requirements
from ..loading.loading import Loading
from ..pipelines.description import Pipelines
from ..scene.data import SceneData
from ..settings import Settings


@dataclass(frozen=True)
class FrameInfo:
    """What a technique prepares a frame from. `pose` is that of the scene with all its nodes, `size` in pixels."""

    slot: int
    view: View
    time: float
    size: tuple[int, int]
    pose: Pose
    passes: Collection[Pass]
    """The passes of this frame."""


class Backend:
    """The objects of a renderer on one API, from opening to closing."""

    name: str
    """"vulkan" or "gl": the module of a subject's folder that belongs to this API."""
    formats: Collection[str]
    """The formats that an image of the graph can have."""
    device: Any
    data: SceneData
    pipelines: Pipelines
    frames: Any
    """The ring of slots: `begin`, `submit`, `wait`, `forget`."""
    executor: Any = None
    """What carries the graph out that `follow` was given; None before."""
    inspection: Any
    by_address = True
    """Whether a recorded draw reads its record when it is drawn, and not when it is recorded."""
    requirement: Requirements | None = None
    """What images and buffers ask of memory, where the API lets the graph place them."""

    def __init__(self, device: Any, validate: bool, without: Iterable[str]) -> None:
        """Take over a device, or open one of its own where `device` is None."""
        raise NotImplementedError

    def enter(self) -> None:
        """Get ready to call the API: OpenGL makes its context current."""

    def offered_samples(self, color_format: str) -> set[int]:
        """Return how many samples a pixel of colour in this format and of depth can have."""
        raise NotImplementedError

    def create(self, scene: Scene, settings: Settings, plan: Plan, loading: Loading, pose: Pose) -> None:
        """Make frames, pipelines and the scene's data; `pose` is that at time 0."""
        raise NotImplementedError

    def part(self, package: str) -> Any:
        """Return the module of a subject's folder that is written for this API, as `cloth.vulkan`."""
        return import_module(f"{package}.{self.name}")

    def make_sets(self, passes: Collection[Pass]) -> None:
        """Make what binds the scene for the pipelines of `passes`; OpenGL binds one by one."""

    # --- a graph ---

    def follow(self, plan: FramePlan, graph: Graph, settings: Settings) -> None:
        """Make everything whose size is the picture's: targets, barriers, readback."""
        raise NotImplementedError

    def leave(self) -> None:
        """Free that; no frame is in flight."""
        raise NotImplementedError

    # --- a frame ---

    def begin(self, slot: Any) -> None:
        """Get ready for a frame in `slot`, which the GPU has left."""

    def deform(self, slot: Any, pose: Pose) -> int:
        """Write the vertices that `pose` deforms into the slot's geometry; return the bytes written."""
        raise NotImplementedError

    def record(self, slot: Any, again: bool) -> bool:
        """Record the slot's frame where its recording is no longer good, or always unless `again`.

        Returns whether it was recorded.
        """
        raise NotImplementedError

    def timings(self, slot: Any) -> dict[str, float]:
        """Return GPU milliseconds by pass of the slot's frame, which is over."""
        raise NotImplementedError

    def readbacks(self, slot: Any) -> Mapping[str, Any]:
        """Return the copies of the slot's outputs, by name."""
        raise NotImplementedError

    def picture(self, graph: Graph) -> Any:
        """Return what a window copies the picture from."""
        raise NotImplementedError

    # --- life ---

    @property
    def counts(self) -> dict[str, int]:
        """Return how many objects of its own the backend holds, and what the last frame took of it."""
        raise NotImplementedError

    def reload(self, changed: Collection[Any]) -> tuple[str, ...]:
        """Build the pipelines anew that use one of the files `changed`, all or none; return their names."""
        raise NotImplementedError

    def close(self) -> None:
        """Free everything; a second time does nothing."""
        raise NotImplementedError


def open_backend(name: str, device: Any, validate: bool, without: Iterable[str]) -> Backend:
    """Return the backend "vulkan" or "gl"; its module, and the binding that it needs, are loaded only now."""
    backend: Backend = import_module(f".{name}_backend", __package__).open_backend(device, validate, without)
    return backend
