"""`--quality auto`: the best preset that holds 20 frames a second here, from a short measurement that is kept."""

from __future__ import annotations

import contextlib
import hashlib
import json
import math
import statistics
import time as clock
from collections.abc import Callable, Sequence
from pathlib import Path

from backends.contract import Capabilities
from common.paths import cache_dir, write_whole

GOAL_MS = 50.0
CANDIDATES = ("high", "medium", "low")
"""From the best on; `reference` is for measuring, not for looking."""

WARM_UP, MEASURED = 2, 5

LIMIT_S = 2.0
"""After so many seconds a preset is measured well enough."""

MOST_PIXELS = 1280 * 720
"""Larger windows are judged by a smaller picture: on a software driver, one frame of 8192x8192 takes half a minute."""

Measure = Callable[[str], float]
"""Milliseconds that a frame takes with the preset of this name."""


def choose(
    measure: Measure, key: str | None, candidates: Sequence[str] = CANDIDATES, folder: Path | None = None
) -> tuple[str, float]:
    """Return the first of `candidates` whose frames take at most `GOAL_MS`, else the last, and its milliseconds.

    What was measured is kept in `folder` (default: the user's cache) under `key` and not measured again; None keeps
    nothing.
    """
    folder = folder or cache_dir("quality")
    path = folder / f"{hashlib.sha256(key.encode()).hexdigest()[:24]}.json" if folder and key else None
    known = _read(path, candidates)
    if known is not None:
        return known
    name, taken = candidates[-1], 0.0
    for name in candidates:
        taken = measure(name)
        if taken <= GOAL_MS:
            break
    if path is not None:
        with contextlib.suppress(OSError):
            write_whole(path, json.dumps({"key": key, "preset": name, "ms": taken}).encode())
    return name, taken


def _read(path: Path | None, candidates: Sequence[str]) -> tuple[str, float] | None:
    if path is None:
        return None
    try:
        kept = json.loads(path.read_text("utf-8"))
        name, taken = kept["preset"], float(kept["ms"])
    except (OSError, ValueError, KeyError, TypeError):
        return None
    return (name, taken) if name in candidates else None


def key_of(
    which: int | str, capabilities: Capabilities, scene: str, size: tuple[int, int], settings: str
) -> str:
    """Return what a measurement holds for: another chapter or version of a fork, another driver, scene, size or
    setting is measured anew."""
    parts = (which, capabilities.backend, capabilities.device, capabilities.driver, scene, size, settings)
    return json.dumps(parts)


def measured_size(size: tuple[int, int]) -> tuple[int, int]:
    """Return the size to measure at for a window of `size`: as it is, or of `MOST_PIXELS` in the same proportions."""
    width, height = size
    scale = math.sqrt(MOST_PIXELS / (width * height))
    return size if scale >= 1.0 else (max(1, round(width * scale)), max(1, round(height * scale)))


def estimated_ms(taken: float, measured: tuple[int, int], size: tuple[int, int]) -> float:
    """Return what a frame of `size` takes, when one of the size `measured` takes `taken` milliseconds.

    It is in proportion to the pixels, which says too much rather than too little: part of a frame is not theirs.
    """
    return taken * (size[0] * size[1]) / (measured[0] * measured[1])


def frame_ms(draw: Callable[[], object], limit_s: float = LIMIT_S) -> float:
    """Return the median time of one call of `draw`, which draws a frame and waits for it, after a warm-up.

    After `limit_s` no more frames are drawn than the two without which there is no time: in the first, drivers compile.
    """
    began = before = clock.perf_counter()
    times: list[float] = []
    for _ in range(WARM_UP + MEASURED):
        draw()
        now = clock.perf_counter()
        times.append((now - before) * 1e3)
        before = now
        if len(times) > 1 and now - began > limit_s:
            break
    return statistics.median(times[min(WARM_UP, len(times) - 1) :])
