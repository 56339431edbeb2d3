"""What `strata compare` measures: both pictures of the same moment, their times in turns, and how far B is from A."""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from typing import Any, Literal

import numpy as np
from numpy.typing import NDArray

import chapters
from backends.contract import Frame, Renderer
from common.errors import UserError
from common.images.color import LUMINANCE, encode_srgb
from common.reports import metrics
from common.scene import Scene
from common.settings import flat
from common.view.camera import View, exposure
from tools.bench import points
from tools.compare.sides import Drawn, Float32, Picture, Side, shown_values

WARM_UP, ROUNDS = 3, 5
FRAMES = 4
"""Frames of a side in each round of timing; fewer where they are slow."""
ROUND_S = 0.5
"""Seconds that a side's frames of one round should not exceed by much."""

STEP = 1 / 255 * (1 + 1e-4)
"""A pixel has changed if it differs by more than one step of 8 bits; float32 codes of one step are not above this."""
SMALLEST_LIMIT = {"flip": 0.01, "difference": 1 / 255}
"""The error map's scale ends there or above, so that what nobody can see is not shown as if it were large."""


@dataclass(frozen=True)
class Moment:
    """When and from where both sides are drawn. Without `frames`: at `time`, until every temporal pass is done."""

    camera: str | None = None
    time: float = 0.0
    frames: int | None = None
    fps: float = 60.0

    def at(self, index: int) -> float:
        """Return the time of frame `index`; the clock stands still without `frames`."""
        return self.time if self.frames is None else self.time + index / self.fps


@dataclass
class Measured:
    """One side: what it shows, its light, and of a renderer the record of its times and work."""

    side: Side
    shown: Float32 | None
    linear: Float32 | None
    view: View | None = None
    record: dict[str, Any] = field(default_factory=dict)
    capabilities: Any = None
    plan: Any = None


class Stand:
    """An opened renderer with its moment: draws the picture, then goes on with frames for timing."""

    def __init__(self, side: Drawn, renderer: Renderer, moment: Moment) -> None:
        self.side, self.renderer, self.moment = side, renderer, moment
        self._index = 0
        self.point = points.Point(side.text, "side", renderer.settings)
        self._defaults = flat(type(renderer.settings)())
        self._work: dict[str, int] = {}

    def view(self, time: float) -> View:
        """Return the view at `time`."""
        return chapters.view_of(self.renderer, self.moment.camera, time)

    def next_frame(self) -> Frame:
        """Draw the frame that is next on the clock."""
        time = self.moment.at(self._index)
        self._index += 1
        return self.renderer.render(self.view(time), time)

    def along(self, view: View, time: float) -> Measured:
        """Draw a frame of a path, and return what is compared; its times count."""
        frame, times = self._timed(lambda: self.renderer.render(view, time))
        self.point.rounds.append([times])
        self._work = dict(frame.work)
        return self._measured(frame, view)

    def picture(self) -> Measured:
        """Return what is compared."""
        moment = self.moment
        frame = self.next_frame()
        for _ in range((moment.frames or 1) - 1):
            frame = self.next_frame()
        if moment.frames is None:
            view, most = self.view(moment.time), 64
            while most and not self.renderer.idle(view, moment.time):
                frame, most = self.next_frame(), most - 1
        self._work = dict(frame.work)
        return self._measured(frame, self.view(moment.at(self._index - 1)))

    def _measured(self, frame: Frame, view: View) -> Measured:
        got = {name: frame.image(name) for name in self.side.outputs}
        shown = shown_values(got["color"]) if "color" in got else None
        linear = got["color_linear"][..., :3].astype(np.float32) if "color_linear" in got else None
        return Measured(self.side, shown, linear, view)

    def timed_frame(self) -> dict[str, float]:
        """Draw a frame and return its milliseconds: each pass, "gpu", "cpu", and "wall" until it was done."""
        return self._timed(self.next_frame)[1]

    @staticmethod
    def _timed(draw: Callable[[], Frame]) -> tuple[Frame, dict[str, float]]:
        began = clock.perf_counter()
        frame = draw()
        passes = frame.timings
        wall = (clock.perf_counter() - began) * 1e3
        gpu = sum(passes.values()) if passes else wall
        return frame, {**passes, "gpu": gpu, "cpu": frame.cpu_ms, "wall": wall}

    def record(self) -> dict[str, Any]:
        """Return medians of the times, and the work of the frame that is compared."""
        self.point.work = self._work
        return self.point.record(self._defaults)


def measure(
    sides: tuple[Side, Side], scene: Scene | None, size: tuple[int, int], moment: Moment, steps: Any
) -> tuple[Measured, Measured]:
    """Draw and time both sides. `scene` may be None where both are files. Raises StrataError."""
    with ExitStack() as stack:
        stands = open_sides(stack, sides, scene, size, moment, steps)
        found = []
        for stand in stands:
            if isinstance(stand, Picture):
                found.append(Measured(stand, stand.shown, stand.linear))
            else:
                steps(f"draw {stand.side.text}", 0.5)
                found.append(stand.picture())
        drawn = [stand for stand in stands if isinstance(stand, Stand)]
        _time(drawn, steps)
        for measured, stand in zip(found, stands, strict=True):
            if isinstance(stand, Stand):
                measured.record = stand.record()
                measured.capabilities, measured.plan = stand.renderer.capabilities, stand.renderer.plan
    return found[0], found[1]


def open_sides(
    stack: ExitStack,
    sides: tuple[Side, Side],
    scene: Scene | None,
    size: tuple[int, int],
    moment: Moment,
    steps: Any,
) -> list[Stand | Picture]:
    """Return both sides, those that are drawn with a renderer each, which `stack` closes."""
    from tools.run import run as running

    devices: dict[tuple[str, tuple[str, ...]], Any] = {}
    stands: list[Stand | Picture] = []
    for number, side in enumerate(sides):
        if isinstance(side, Picture):
            stands.append(side)
            continue
        assert scene is not None
        steps(f"open {side.text}", 0.3 + 0.1 * number)
        key = side.backend, side.without
        if key not in devices:  # two sides of one backend share a device, as they would share a card
            devices[key] = running.open_device(stack, side.backend, without=side.without)
        renderer = side.module.Renderer(
            scene,
            size,
            settings=side.settings,
            without=side.without,
            outputs=set(side.outputs),
            device=devices[key],
        )
        stands.append(Stand(side, stack.enter_context(renderer), moment))
    return stands


def _time(stands: list[Stand], steps: Any) -> None:
    """Time the renderers in turns, A, B, A, B: a busy minute of the machine hits both."""
    counts = []
    for stand in stands:
        frames = [stand.timed_frame() for _ in range(WARM_UP)]
        seconds = min(frame["wall"] for frame in frames) / 1e3
        counts.append(int(np.clip(ROUND_S / max(seconds, 1e-6), 1, FRAMES)))
    for turn in range(ROUNDS):
        for stand, count in zip(stands, counts, strict=True):
            steps(f"time of {stand.side.text}", 0.6 + 0.4 * turn / ROUNDS)
            stand.point.rounds.append([stand.timed_frame() for _ in range(count)])


# --- errors -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Errors:
    """How far B is from A; None where that cannot be said: no linear light, no package of FLIP, a NaN."""

    of: Literal["shown", "linear"]
    """What `max_abs` and `flip` compare: what is shown (0 to 1), or linear light where only that is there."""

    relative_mse: float | None
    max_abs: float | None
    flip: float | None
    pixels_changed: float
    """Part of the pixels of which a channel, as shown, differs by more than 1/255."""
    not_finite: tuple[int, int]
    """Pixels of A and of B with a NaN or an infinity."""
    same: bool
    """Whether all compared values are equal to the bit."""


@dataclass(frozen=True, eq=False)
class ErrorMap:
    """One number for each pixel, (H, W) float32; NaN where a picture is not finite.

    Colours end at `limit`; where `more`, a few pixels lie above it.
    """

    kind: Literal["flip", "difference"]
    of: Literal["shown", "linear"]
    values: Float32
    limit: float
    more: bool


def exposure_of(a: Measured, b: Measured, ev100: float | None) -> float:
    """Return the factor by which linear light is shown: of --ev, of a renderer's view, else by A's brightest parts."""
    views = [one.view for one in (a, b) if one.view is not None]
    if ev100 is not None or views:
        return exposure(views[0].ev100 if ev100 is None else ev100)
    if a.linear is None:
        return 1.0
    light = a.linear.astype(np.float64) @ LUMINANCE
    bright = float(np.percentile(light[np.isfinite(light)], 99)) if np.isfinite(light).any() else 0.0
    return 1.0 / bright if bright > 0.0 else 1.0


def displayed(one: Measured, linear: bool, exposed: float) -> Float32:
    """Return a side as the sheet shows it, (H, W, 3) of 0 to 1; of `linear` light, clipped and coded for a screen."""
    if not linear:
        assert one.shown is not None
        return one.shown
    assert one.linear is not None
    light = np.nan_to_num(one.linear.astype(np.float64) * exposed, nan=0.0, posinf=1.0, neginf=0.0)
    return encode_srgb(np.clip(light, 0.0, 1.0)).astype(np.float32)


def errors(
    a: Measured, b: Measured, exposed: float, wanted: str = "auto"
) -> tuple[Errors, ErrorMap, tuple[Float32, Float32]]:
    """Return how far B is from A, the map of it, and both as they are shown.

    `wanted` is the kind of the map: "flip", "difference", or "auto" for FLIP where its package is there.
    Raises UserError for "flip" without the package.
    """
    linear = a.shown is None or b.shown is None
    of: Literal["shown", "linear"] = "linear" if linear else "shown"
    first, second = (a.linear, b.linear) if linear else (a.shown, b.shown)
    assert first is not None and second is not None
    light = None if a.linear is None or b.linear is None else (a.linear, b.linear)
    bad_a, bad_b = (np.asarray(~np.isfinite(one).all(axis=-1)) for one in light or (first, second))
    finite = not (bad_a.any() or bad_b.any())
    said = finite or not linear  # what is shown is always finite
    shown = displayed(a, linear, exposed), displayed(b, linear, exposed)
    with np.errstate(invalid="ignore"):
        difference = np.abs(second.astype(np.float64) - first).max(axis=-1)
    changed = (np.abs(shown[1].astype(np.float64) - shown[0]) > STEP).any(axis=-1)
    if linear:
        changed |= bad_a != bad_b
    flip = None
    if said or wanted == "flip":
        flip = _flip(first, second, exposed if linear else None, wanted, np.logical_or(bad_a, bad_b))
    found = Errors(
        of,
        metrics.relative_mse(light[1], light[0]) if light and finite else None,
        float(difference.max()) if said else None,
        float(flip.mean(dtype=np.float64)) if flip is not None and said else None,
        float(changed.mean()),
        (int(bad_a.sum()), int(bad_b.sum())),
        _equal(first, second) and (light is None or _equal(*light)),
    )
    kind: Literal["flip", "difference"] = "difference" if flip is None or wanted == "difference" else "flip"
    values = difference.astype(np.float32) if kind == "difference" or flip is None else flip
    return found, ErrorMap(kind, of, values, *_limit(kind, values)), shown


def _equal(a: Any, b: Any) -> bool:
    return bool(np.array_equal(a, b, equal_nan=True))


def _flip(
    a: Float32, b: Float32, exposed: float | None, wanted: str, bad: NDArray[np.bool_]
) -> Float32 | None:
    """Return the map of FLIP, B against A; None where its package is not there.

    With `exposed` both are linear light, which is multiplied by it; pixels that are `bad` are left black and NaN.
    """
    try:
        if exposed is None:
            return metrics.flip_map(b, a)
        light = [
            np.where(bad[..., None], 0.0, one * np.float32(exposed)).astype(np.float32) for one in (b, a)
        ]
        return np.where(bad, np.float32(np.nan), metrics.flip_map(light[0], light[1], "hdr"))
    except UserError:
        if wanted == "flip":
            raise
        return None


def _limit(kind: str, values: Float32) -> tuple[float, bool]:
    """Return where the scale of a map ends, 1, 2 or 5 times a power of ten, and whether values lie above.

    It holds all but a thousandth of the pixels that differ: one pixel must not make the map dark for the others.
    """
    finite = values[np.isfinite(values) & (values > 0)].astype(np.float64)
    most = float(np.percentile(finite, 99.9, method="lower")) if finite.size else 0.0
    largest = max(most, SMALLEST_LIMIT[kind])
    power = 10.0 ** np.floor(np.log10(largest))
    step = next(step for step in (1.0, 2.0, 5.0, 10.0) if largest <= step * power * (1 + 1e-6))
    limit = float(step * power)
    return limit, bool(finite.max(initial=0.0) > limit * (1 + 1e-6))
