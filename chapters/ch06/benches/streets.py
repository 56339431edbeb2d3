"""What the benches of culling share: the city, its named views, a walk through its streets, and renderers that walk."""

from __future__ import annotations

import time as clock
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np

from common.reports.benches import Effort, Subject, middle
from common.scene import Scene
from common.scene.pose import evaluate_pose
from common.settings import preset, replaced
from common.view.camera import View, view_of_scene

KNOB = "culling"
"""The setting; a chapter without it culls nothing."""

SCENE, QUICK_SCENE = "city:1M", "city:10K"

STREET = "street"
"""The names of views at street level begin with this."""

STREETS, FEW_STREETS, QUICK_STREETS = 12, 4, 2
"""Views of a measurement on a GPU, on a software driver, and of a quick look."""

STRIDE = 1.4 / 60
"""Metres of a frame: walking speed at 60 Hz."""

LARGE = (1920, 1080)
"""Size of the pictures on a GPU, unless the bench's is larger."""

SOFTWARE_FRAMES = 4
"""Frames of a view on a software driver, which draws the whole city in seconds."""

LEAST_WARM_UP = 3
"""Frames of a view before the measured ones: the first one draws everything, the second what the first one saw."""

CULLING, GEOMETRY = ("cull", "depth_pyramid"), ("gbuffer", "depth_prepass")
"""How the names of passes begin that select what is drawn, and of those that draw it."""


def is_software(subject: Subject) -> bool:
    """Whether the subject's device is a software driver."""
    return bool(subject.device.capabilities.kind == "software")


def city(subject: Subject, effort: Effort) -> tuple[str, Scene]:
    """Return the name of the city of an effort, and the city."""
    name = SCENE if effort.everything else QUICK_SCENE
    return name, subject.load(name)


def picture_size(subject: Subject, effort: Effort) -> tuple[int, int]:
    """Return the size of the pictures: on a GPU and at full effort at least LARGE."""
    size = subject.size
    small = size[0] * size[1] < LARGE[0] * LARGE[1]
    return LARGE if effort.everything and small and not is_software(subject) else size


def street_views(subject: Subject, effort: Effort, scene: Scene) -> list[str]:
    """Return the names of the street views of an effort, evenly spread over those of the scene."""
    names = [camera.name for camera in scene.cameras if camera.name.startswith(STREET)][:STREETS]
    count = FEW_STREETS if is_software(subject) else STREETS
    count = min(count if effort.everything else QUICK_STREETS, len(names))
    return [names[number * len(names) // count] for number in range(count)]


def view_at(scene: Scene, name: str, size: tuple[int, int]) -> View:
    """Return the view of a camera at time 0."""
    return view_of_scene(scene, evaluate_pose(scene, 0.0), name, size[0] / size[1])


def walked(view: View, frames: int) -> View:
    """Return a view after so many frames of walking straight on, on level ground; frame 0 is a cut."""
    ahead = -view.world_from_view[:3, 2] * (1.0, 0.0, 1.0)
    pose = view.world_from_view.copy()
    pose[:3, 3] += STRIDE * frames * ahead / max(float(np.linalg.norm(ahead)), 1e-6)
    return replace(view, world_from_view=pose, cut=frames == 0)


def medium(subject: Subject, **values: Any) -> Any:
    """Return the settings of the chapter's `medium`, with these values changed."""
    settings: Any = preset(subject.settings_class, "medium")
    return replaced(settings, **values)


def solid_triangles(scene: Scene) -> int:
    """Return the triangles of all visible instances that are not blended: what chapter 5 draws before them."""
    solid = np.array([material.alpha_mode != "blend" for material in scene.materials], bool)
    mesh = scene.instances.mesh[scene.instances.visible]
    rows = scene.meshes[mesh[solid[scene.meshes["material"][mesh]]]]
    return int(rows["index_count"].sum(dtype=np.int64)) // 3


@dataclass
class Walker:
    """A renderer that walks through views, and the times and counters of its frames."""

    renderer: Any
    frames: dict[str, list[dict[str, float]]] = field(default_factory=dict)
    """By view the frames: times of passes in ms, and "gpu" (passes that select and draw), "frame" (all passes), "wall"
    (until the GPU is done) and "python" (processor time of its thread)."""
    work: dict[str, list[dict[str, int]]] = field(default_factory=dict)

    def walk(self, view: str, warm_up: int, frames: int) -> None:
        """Draw the frames of a view, after some that are not measured."""
        start = view_at(self.renderer.scene, view, self.renderer.size)
        for number in range(warm_up + frames):
            view_now, began, on_thread = walked(start, number), clock.perf_counter(), clock.thread_time()
            frame = self.renderer.render(view_now, 0.0)
            python = (clock.thread_time() - on_thread) * 1e3
            passes = dict(frame.timings)
            wall = (clock.perf_counter() - began) * 1e3
            if number >= warm_up:
                # A device without timestamps leaves the wall clock.
                gpu = part(passes, CULLING) + part(passes, GEOMETRY) if passes else wall
                whole = sum(passes.values()) if passes else wall
                times = {**passes, "gpu": gpu, "frame": whole, "wall": wall, "python": python}
                self.frames.setdefault(view, []).append(times)
                self.work.setdefault(view, []).append(dict(frame.work))

    def time(self, name: str) -> tuple[float, float]:
        """Return the median over the views of a time's median in each view, and of its noise."""
        medians, noises = zip(
            *(middle([frame[name] for frame in of_view]) for of_view in self.frames.values()), strict=True
        )
        return float(np.median(medians)), float(np.median(noises))

    def times(self, name: str) -> dict[str, float]:
        """Return the median of a time by view."""
        return {view: middle([frame[name] for frame in of_view])[0] for view, of_view in self.frames.items()}

    def passes(self) -> dict[str, float]:
        """Return the times of the passes that select and draw, as `time` does."""
        first = next(iter(self.frames.values()))[0]
        return {name: self.time(name)[0] for name in first if name.startswith(CULLING + GEOMETRY)}

    def counts(self, names: Iterable[str]) -> dict[str, int]:
        """Return the mean of counters over all frames. Means of tests and of their survivors add up."""
        frames = [work for of_view in self.work.values() for work in of_view]
        return {
            name: round(float(np.mean([work[name] for work in frames])))
            for name in names
            if name in frames[0]
        }


def part(passes: dict[str, float], names: tuple[str, ...]) -> float:
    """Return the sum of the times of passes whose names begin with one of these."""
    return sum(took for name, took in passes.items() if name.startswith(names))


def frames_of(subject: Subject, effort: Effort) -> tuple[int, int]:
    """Return the frames of a view that are not measured, and those that are."""
    measured = min(effort.frames, SOFTWARE_FRAMES) if is_software(subject) else effort.frames
    return max(effort.warm_up, LEAST_WARM_UP), measured


def paths(subject: Subject) -> Sequence[str]:
    """Return the geometries with meshlets that the device has, the compute path first."""
    features = subject.device.capabilities.features
    return [
        path for path, feature in (("compute", "multi-draw"), ("mesh", "mesh-shader")) if feature in features
    ]
