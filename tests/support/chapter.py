"""One chapter as its tests see it: renderers on the device of a variant, whichever the backend."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, is_dataclass, replace
from importlib import import_module
from pathlib import Path
from typing import Any

import chapters
from backends.contract import Renderer
from backends.vulkan.device import Device
from chapters.folders import renderer_name
from common.scene import Scene
from common.settings import flat, knobs, replaced
from tests.support import gl_functions
from tests.support.graph_truths import Truth, events_of, places_of
from tests.support.hazards import find_hazards
from tests.support.queue_truths import Submissions, hazards_of

SURFACES: dict[str, dict[str, Any]] = {"auto": {"gbuffer_format": "full"}}
"""What else is set for a path: what tests hold to the bits of a float, a G-buffer must not round."""


def _value(settings: Any, name: str) -> Any:
    """Return the value of a knob, None where there is none: a test may open a renderer with something else."""
    return flat(settings).get(name) if is_dataclass(settings) else None


def on_path(settings: Any, graph: str = "forward") -> Any:
    """Return settings that take a path through the frame, where the chapter has several and they leave it open."""
    if _value(settings, "graph") != "auto":
        return settings
    return replaced(settings, graph=graph, **SURFACES.get(graph, {}))


def unshadowed(settings: Any) -> Any:
    """Return settings in which lights cast no shadows: they add passes, which differ by what a device can do."""
    return replaced(settings, shadows="off") if _value(settings, "shadows") is not None else settings


def as_modelled(settings: Any, written_for: int | None) -> Any:
    """Return settings in which cloth hangs as it was modelled and lights cast no shadows, for tests of chapters that
    knew no other.

    They hold pictures to what is in the file; the tests of cloth hold that it changes nothing but itself, and those of
    shadows that a picture without casters is what it was.
    """
    known = {} if written_for is None else knobs(chapters.settings_class(written_for))
    for name, off in (("cloth", False), ("shadows", "off")) if known else ():
        if name not in known and _value(settings, name) not in (None, off):
            settings = replaced(settings, **{name: off})
    return settings


@dataclass(frozen=True)
class Chapter:
    """Opens a chapter's renderers on one device, which the tests of a module share."""

    which: chapters.Whole
    backend: str
    device: Any
    graph: str = "forward"
    """The path that a frame takes, where the chapter has several and the test leaves it open."""
    written_for: int | None = None
    """The chapter that the tests were written for, None where they are of no chapter."""

    def open(self, scene: Scene, size: tuple[int, int], settings: Any = None, **more: Any) -> Renderer:
        """Return a renderer, as `chapters.open` does; `outputs` are ("color",) unless they are given."""
        module = chapters.renderer_module(self.which, self.backend)
        settings = on_path(
            chapters.settings_class(self.which)() if settings is None else settings, self.graph
        )
        settings = as_modelled(settings, self.written_for)
        opened: Renderer = module.Renderer(scene, size, settings, device=self.device, **more)
        if getattr(opened, "graph", None) is not None:
            try:
                hold_to_hazards(opened)
            except BaseException:
                opened.close()
                raise
        return opened

    @contextmanager
    def on_new_device(self) -> Iterator[Chapter]:
        """Yield the chapter on a device of its own, which must be left empty; on OpenGL the same.

        A software driver numbers the groups of ray pipelines of a device, and its kernels hold these numbers. On a new
        device they begin anew, so the driver's cache knows the kernel of a pipeline that was there before.
        """
        if self.backend == "gl":
            yield self
            return
        with Device(self.device.instance, self.device.physical, self.device.without) as device:
            yield replace(self, device=device)

    @contextmanager
    def calls(self) -> Iterator[list[str]]:
        """Yield a list that gets the name of every call which is made to the graphics API within."""
        if self.backend == "gl":
            with gl_functions.traced(self.device) as names:
                yield names
            return
        log: list[Any] = []
        made: list[str] = []
        self.device.fn.trace(log)
        try:
            yield made
        finally:
            self.device.fn.trace(None)
            made += [name for name, _ in log]


def on_opengl(vulkan: type) -> Any:
    """Return the renderer on OpenGL of the chapter whose renderer on Vulkan is `vulkan`."""
    package = vulkan.__module__.rpartition(".")[0]
    folder = Path(chapters.__file__).parent / package.rpartition(".")[2]
    return import_module(f"{package}.{renderer_name(folder, 'gl')}").Renderer


def of_backend(renderer: Any, name: str) -> Any:
    """Return what a renderer holds of its API ("resources", "commands"): from chapter 4 on its backend has it."""
    return getattr(renderer._api, name) if hasattr(renderer, "_api") else getattr(renderer, f"_{name}")


def record_anew(renderer: Any) -> None:
    """Have the next frame recorded, also where what was recorded would be sent again."""
    if hasattr(renderer._frames, "forget"):
        renderer._frames.forget()


def targets_of(renderer: Any) -> set[str]:
    """Return the names of what a renderer's passes draw to."""
    graph = getattr(renderer, "graph", None)
    if graph is None:
        return set(renderer._targets)
    return {name for name, one in graph.resources.items() if one.kind == "attachment"}


_SAFE: set[Any] = set()


def hold_to_hazards(renderer: Any) -> None:
    """Fail where three frames of a renderer's graph have a hazard on a simulated GPU; a frame is looked at once."""
    graph, plan = renderer.graph, renderer._plan
    if graph.steps in _SAFE:
        return
    truth = graph_truth(renderer)
    hazards: list[Any] = find_hazards(events_of(truth, graph), places_of(graph))
    if len(getattr(graph, "batches", ())) > 1:  # several queues, and what they wait for
        slotted = [name for name, one in truth.externals.items() if one.leaves is None]
        hazards = hazards_of(Submissions(truth, graph, slotted=slotted))
    assert not hazards, f"{plan.title}: " + "; ".join(map(str, hazards))
    _SAFE.add(graph.steps)


def graph_truth(renderer: Any) -> Truth:
    """Return what the passes of a renderer's frame mean, found without its compiler."""
    plan = renderer._plan
    outputs = [plan.read_from[name] for name in renderer.graph.outputs]
    return Truth(list(plan.nodes.values()), outputs, plan.externals, plan.kept)


BUILDING = (
    *("vkCreate", "vkAllocate", "vkUpdateDescriptorSets", "vkDestroy", "vkFree", "vkMap"),
    *("glCreate", "glGen", "glDelete", "glNamedBufferStorage", "glTextureStorage", "glLinkProgram", "glMap"),
)
"""How calls begin that make or free an object. OpenGL's fences (glFenceSync) are none: there is one per frame."""


def building(calls: list[str]) -> list[str]:
    """Return the calls that make or free something."""
    return [name for name in calls if name.startswith(BUILDING) and name != "glDeleteSync"]
