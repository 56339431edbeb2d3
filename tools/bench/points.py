"""What a bench measures: the settings of a chapter, each with its time, its error and its work.

Error is against the `reference` preset drawn with several samples a pixel along each axis and averaged: no setting is
its own truth, and what all of them lack (here: more than one sample a pixel) counts for all of them. Or it is against
light that the path tracer finds (truth.py).
"""

from __future__ import annotations

import statistics
import time as clock
from collections.abc import Callable, Iterable, Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from importlib import import_module
from itertools import islice
from typing import Any

import numpy as np

import chapters
from backends.contract import Frame, Renderer
from chapters import scenes, studies
from common.images.color import decode_srgb, encode_srgb
from common.reports.benches import Effort, middle
from common.scene import Scene, stability
from common.settings import Knob, flat, knobs, preset, replaced
from common.view.camera import View
from tools.bench.truth import OWN, Truth, truth_of

Array = np.ndarray


FULL = Effort(warm_up=3, frames=12, rounds=7, samples=4, starts=3, everything=True)
QUICK = Effort(warm_up=1, frames=3, rounds=1, samples=2, starts=1, everything=False)


@dataclass
class Point:
    """One setting on the plot: its figures of every round and frame."""

    name: str
    kind: str  # "preset" or "knob"
    settings: Any
    rounds: list[list[dict[str, float]]] = field(default_factory=list)
    error: dict[str, float | None] = field(default_factory=dict)
    work: dict[str, int] = field(default_factory=dict)

    def record(self, defaults: dict[str, Any]) -> dict[str, Any]:
        """Return what the JSON holds; of the settings, those that are not the chapter's defaults.

        Times are medians over all frames in ms; `noise_ms` is half the distance between the quartiles of the rounds'
        medians, which one disturbed round does not reach; with fewer than three rounds, those of the frames. `least_ms`
        is the quickest frame, which a busy machine disturbs least.
        """
        changed = {k: v for k, v in flat(self.settings).items() if v != defaults[k]}
        frames = [frame for one in self.rounds for frame in one]
        # A pass that a frame left out took no time there.
        passes = {name: statistics.median(f.get(name, 0.0) for f in frames) for name in frames[0]}
        spread = {name: self._spread(name) for name in ("gpu", "wall", "cpu")}
        return {
            "name": self.name,
            "kind": self.kind,
            "settings": changed,
            "gpu_ms": passes.pop("gpu"),
            "wall_ms": passes.pop("wall"),
            "cpu_ms": passes.pop("cpu"),
            "noise_ms": spread["gpu"][0],
            "wall_noise_ms": spread["wall"][0],
            "cpu_noise_ms": spread["cpu"][0],
            "least_ms": spread["gpu"][1],
            "wall_least_ms": spread["wall"][1],
            "cpu_least_ms": spread["cpu"][1],
            "passes_ms": passes,
            "error": self.error,
            "work": self.work,
        }

    def _spread(self, name: str) -> tuple[float, float]:
        """Return the noise of a time, and the least of all frames."""
        rounds = [[frame[name] for frame in one] for one in self.rounds]
        frames = [value for one in rounds for value in one]
        middles = [statistics.median(one) for one in rounds] if len(rounds) > 2 else frames
        return middle(middles)[1], min(frames)


def points(settings_class: type) -> list[Point]:
    """Return the presets, then `medium` with each knob of the presets (or of the class's SWEEP) turned alone.

    Knobs of what is made before the first frame are left out: `prepared` turns them, on a scene that needs it.
    """
    presets: dict[str, dict[str, Any]] = settings_class.PRESETS  # type: ignore[attr-defined]
    made = [Point(name, "preset", preset(settings_class, name)) for name in presets]
    known = knobs(settings_class)
    turned = {name: list(_values(name, known[name], presets)) for one in presets.values() for name in one}
    for swept in getattr(settings_class, "PREPARED", ()):
        turned = {name: values for name, values in turned.items() if name not in swept.knobs}
    turned |= {name: list(values) for name, values in getattr(settings_class, "SWEEP", {}).items()}
    base: Any = preset(settings_class, "medium")
    for name, values in turned.items():
        for value in values:
            settings = replaced(base, **{name: value})
            if all(flat(settings) != flat(point.settings) for point in made):
                made.append(
                    Point(
                        f"{name}={value:g}" if isinstance(value, float) else f"{name}={value}",
                        "knob",
                        settings,
                    )
                )
    return made


def _values(name: str, knob: Knob, presets: dict[str, dict[str, Any]]) -> Iterator[Any]:
    """Give a knob's values to measure: all choices, both states, or those of the presets and doublings between."""
    if knob.choices:
        yield from knob.choices
    elif isinstance(knob.default, bool):
        yield from (False, True)
    else:
        named = sorted({one[name] for one in presets.values() if name in one})
        value = named[0]
        while value < named[-1]:
            yield value
            value = value * 2 if value > 0 else named[1]
        yield named[-1]


class Subject:
    """One chapter on one scene and size, opened with one setting after the other on one device.

    It is what the benches of lessons are handed: see `common.reports.benches`. A study can be one, too.
    A device for each opening would measure the same, but some drivers load no more after some hundred times.
    """

    def __init__(
        self, chapter: chapters.Which, backend: str, scene: Scene, size: tuple[int, int], device: Any
    ) -> None:
        self.chapter, self.backend, self.scene, self.size = chapter, backend, scene, size
        self.device = device

    @property
    def settings_class(self) -> Any:
        """The class of the chapter's settings."""
        return chapters.settings_class(self.chapter)

    def module(self, name: str) -> Any:
        """Return a module of the chapter by its name in it: "graph.types"."""
        if isinstance(self.chapter, str):
            raise ValueError(f"{self.chapter} is a study, which has no modules of a chapter")
        return import_module(f"{chapters.package_of(self.chapter)}.{name}")

    def load(self, name: str, around: str = "none") -> Scene:
        """Return one of the project's scenes by name, in the environment `around`."""
        return scenes.load(name, around=around)

    def on(self, scene: Scene, size: tuple[int, int] | None = None) -> Subject:
        """Return the same chapter on another scene, and if given, in another size."""
        return Subject(self.chapter, self.backend, scene, size or self.size, self.device)

    def study(self, name: str, size: tuple[int, int]) -> Subject:
        """Return a study, as "5/timeline-or-fences", on its own scene and the same device."""
        return Subject(name, self.backend, studies.load(name, None), size, self.device)

    def view(self, renderer: Renderer) -> View:
        """Return the first view of a renderer's scene."""
        return chapters.view_of(renderer)

    def settled_picture(self, renderer: Renderer) -> tuple[Array, Array]:
        """Return what is seen when another frame would be the same, as `errors` takes it."""
        return picture(settled(renderer, self.view(renderer)))

    @contextmanager
    def open(
        self,
        settings: Any,
        outputs: set[str],
        size: tuple[int, int] | None = None,
        without: Iterable[str] = (),
        inspect: bool = False,
    ) -> Iterator[Renderer]:
        """Open the chapter without some features; the size is the bench's, if no other is given."""
        size = size or self.size
        with chapters.open(
            self.chapter,
            self.backend,
            scene=self.scene,
            size=size,
            settings=settings,
            outputs=outputs,
            without=without,
            device=self.device,
            **({"inspect": True} if inspect else {}),
        ) as renderer:
            yield renderer

    def measure(self, settings: Any, effort: Effort) -> tuple[list[dict[str, float]], dict[str, int]]:
        """Return one round: per frame the passes' GPU milliseconds with "gpu", "cpu" and "wall", and the work."""
        with self.open(settings, {"color"}) as renderer:
            view = chapters.view_of(renderer)
            for _ in range(effort.warm_up):  # drivers compile at the first draw
                renderer.render(view).timings  # noqa: B018
            frames = []
            for _ in range(effort.frames):
                began = clock.perf_counter()
                frame = renderer.render(view)
                passes = frame.timings
                wall = (clock.perf_counter() - began) * 1e3
                # A device without timestamps leaves the wall clock.
                gpu = sum(passes.values()) if passes else wall
                frames.append({**passes, "gpu": gpu, "cpu": frame.cpu_ms, "wall": wall})
            return frames, dict(frame.work)

    def pictures(self, settings: Any, samples: int = 1) -> tuple[Array, Array]:
        """Return (linear light (H, W, 3) float32, what is shown (H, W, 3) of 0..1), averaged over `samples`^2 a pixel.

        What is shown is averaged as light, as an eye at a distance does.
        """
        width, height = self.size
        with self.open(settings, {"color", "color_linear"}, (width * samples, height * samples)) as renderer:
            linear, shown = picture(settled(renderer, chapters.view_of(renderer)))
        if samples == 1:
            return linear, shown
        return _averaged(linear, samples), encode_srgb(_averaged(decode_srgb(shown), samples)).astype(
            np.float32
        )


def picture(frame: Frame) -> tuple[Array, Array]:
    """Return what a frame shows as `errors` takes it: linear light (H, W, 3) float32, and codes (H, W, 3) of 0..1."""
    return frame.image("color_linear"), frame.image("color")[..., :3].astype(np.float32) / np.float32(255)


def settled(renderer: Renderer, view: Any, image: str = "color_linear", most: int = 64) -> Frame:
    """Return a frame after which another would be the same: temporal passes have run their course.

    So the renderer says, or its `image`: three times the same to the bit, with every texture there. A reader's own
    renderer may never say it.
    """
    frame, same = renderer.render(view), 0
    before: Array | None = None
    while most > 0 and same < 2 and not renderer.idle(view):
        before = frame.image(image) if before is None else before
        frame = renderer.render(view)
        seen = frame.image(image)
        waiting = frame.work.get("textures_waiting", 0)
        same = 0 if waiting or not np.array_equal(before, seen) else same + 1
        before = seen
        most -= 1
    return frame


def _averaged(image: Array, samples: int) -> Array:
    height, width, channels = image.shape
    blocks = image.reshape(height // samples, samples, width // samples, samples, channels)
    return blocks.mean(axis=(1, 3), dtype=np.float64).astype(np.float32)


def forward_path(settings: Any) -> Any:
    """Return settings that light objects while they are drawn: what every chapter can, with the same picture."""
    return replaced(settings, graph="forward") if "graph" in knobs(settings) else settings


def sweep(
    subject: Subject, effort: Effort, step: Callable[[str, float], None], wanted: str = OWN
) -> tuple[list[Point], Truth]:
    """Measure every point; return them, and what they are held to.

    Rounds go through all of them in turn, so that a busy minute hits no point alone.
    """
    settings_class = chapters.settings_class(subject.chapter)
    found = [point for point in points(settings_class) if effort.everything or point.kind == "preset"]
    truth = truth_of(subject, wanted, effort, step)
    for number, point in enumerate(found):
        step(f"error of {point.name}", 0.1 + 0.3 * number / len(found))
        point.error = truth.errors(subject.pictures(point.settings))
    for turn in range(effort.rounds):
        for number, point in enumerate(found):
            step(f"time of {point.name}", 0.4 + 0.6 * (turn + number / len(found)) / effort.rounds)
            frames, point.work = subject.measure(point.settings, effort)
            point.rounds.append(frames)
    return found, truth


def stability_cases(subject: Subject, effort: Effort) -> list[dict[str, Any]]:
    """Return for each case of `common.scene.stability` the fraction of pixels that change by more than 1/255."""
    settings: Any = preset(chapters.settings_class(subject.chapter), "medium")
    with subject.open(settings, {"color"}) as renderer:
        view = chapters.view_of(renderer)
        still = settled(renderer, view, "color").image("color")
    found = []
    cases = stability.cases(subject.scene, view)
    for name, scene, seen in cases if effort.everything else islice(cases, 1):
        other = Subject(subject.chapter, subject.backend, scene, subject.size, subject.device)
        with other.open(settings, {"color"}) as renderer:
            picture = settled(renderer, seen, "color").image("color")
        found.append({"case": name, "pixels_changed": stability.pixels_changed(picture, still)})
    return found


def on_front(point: dict[str, Any], points: list[dict[str, Any]]) -> bool:
    """Whether no other point is at least as fast and as true, and better in one of the two: the Pareto front."""
    measure = measure_of(points)
    x, y = point["gpu_ms"], point["error"][measure]
    others = [(other["gpu_ms"], other["error"][measure]) for other in points if other is not point]
    return not any(a <= x and b <= y and (a < x or b < y) for a, b in others)


def measure_of(points: list[dict[str, Any]]) -> str:
    """Return the error that plots show: FLIP, where its package was there."""
    return "flip" if all(point["error"]["flip"] is not None for point in points) else "relative_mse"


def dominated(records: list[dict[str, Any]]) -> list[tuple[str, str]]:
    """Return (preset, the one better in time and error by more than the noise) among a record's points."""
    presets = [point for point in records if point["kind"] == "preset"]
    found = []
    for one in presets:
        for other in presets:
            noise = one["noise_ms"] + other["noise_ms"]
            faster = other["gpu_ms"] < one["gpu_ms"] - noise
            measures = [
                name for name, value in one["error"].items() if name != "max_abs" and value is not None
            ]
            truer = all(other["error"][name] < one["error"][name] * (1 - ERROR_NOISE) for name in measures)
            if faster and truer:
                found.append((one["name"], other["name"]))
    return found


ERROR_NOISE = 1e-2
"""Errors that differ by less, relatively, are taken as equal: a finer format moves some edges' codes by one, either way
(RGBA32F beside RGBA16F: 0.4 % of the FLIP), and that is no better picture."""
