"""What is made once, before the first frame: how long that takes on the GPU, and the error that it leaves in pictures.

Later frames cost the same whatever these knobs say, so their time is that of making alone. Only they are turned: the
error is against the same picture with values beyond those of any preset.
"""

from __future__ import annotations

import os
import shutil
import statistics
import tempfile
from collections.abc import Callable, Iterator
from contextlib import contextmanager
from dataclasses import asdict, replace
from pathlib import Path
from typing import Any

import numpy as np

import chapters
from backends import verdicts
from chapters import scenes
from common.reports.benches import Effort, errors
from common.settings import Sweep, preset
from tools.bench.points import Subject, on_front, picture


def prepared_points(settings_class: type, swept: Sweep) -> list[tuple[str, str, Any]]:
    """Return (name, kind, settings): the presets' values of the knobs, then `medium` with each knob turned alone."""
    medium: Any = preset(settings_class, "medium")
    found: list[tuple[str, str, Any]] = []
    for name in settings_class.PRESETS:  # type: ignore[attr-defined]
        values = asdict(preset(settings_class, name))
        found.append((name, "preset", replace(medium, **{knob: values[knob] for knob in swept.knobs})))
    for knob, values_of_knob in swept.knobs.items():
        for value in values_of_knob:
            settings = replace(medium, **{knob: value})
            if all(settings != other for _, _, other in found):
                found.append((f"{knob}={value}", "knob", settings))
    return found


def sweeps(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> list[dict[str, Any]]:
    """Return one record for each sweep of the settings of the subject's chapter, on scenes of their own."""
    settings_class = chapters.settings_class(subject.chapter)
    found: tuple[Sweep, ...] = getattr(settings_class, "PREPARED", ())
    return [_sweep(subject, effort, step, one, settings_class) for one in found]


def _sweep(
    like: Subject, effort: Effort, step: Callable[[str, float], None], swept: Sweep, settings_class: type
) -> dict[str, Any]:
    scene = scenes.load(swept.scene, around=swept.environment)
    subject = Subject(like.chapter, like.backend, scene, like.size, like.device)
    wanted = prepared_points(settings_class, swept)
    medium: Any = preset(settings_class, "medium")
    converged = swept.truth
    if not effort.everything:  # a quick look: the presets, held to the last of them
        values = asdict(preset(settings_class, "reference"))
        converged = {knob: values[knob] for knob in swept.knobs}
        wanted = [p for p in wanted if p[1] == "preset" and p[0] != "reference"]
    with _nothing_kept() as forget:
        step("reference", 0.0)
        truth, _ = _made(subject, replace(medium, **converged), forget)
        times: dict[str, list[dict[str, float]]] = {name: [] for name, _, _ in wanted}
        error: dict[str, Any] = {}
        rounds = min(effort.rounds, 3)  # of seconds each, where those of frames are of milliseconds
        for turn in range(rounds):  # in turns, so that a busy minute hits no point alone
            for number, (name, _, settings) in enumerate(wanted):
                step(name, (turn + number / len(wanted)) / rounds)
                picture, took = _made(subject, settings, forget)
                times[name].append(took)
                error[name] = errors(picture, truth)
    points = []
    defaults = asdict(medium)
    for name, kind, settings in wanted:
        totals = [sum(one.values()) for one in times[name]]
        low, high = np.percentile(totals, (25, 75))
        points.append(
            {
                "name": name,
                "kind": kind,
                "settings": {k: v for k, v in asdict(settings).items() if v != defaults[k]},
                "gpu_ms": statistics.median(totals),
                "noise_ms": float(high - low) / 2,
                "parts_ms": {
                    part: statistics.median(one[part] for one in times[name]) for part in times[name][0]
                },
                "error": error[name],
            }
        )
    for point in points:
        point["front"] = on_front(point, points)
    return {
        "name": swept.name,
        "scene": swept.scene,
        "environment": swept.environment,
        "truth": dict(converged),
        "points": points,
    }


def _made(subject: Subject, settings: Any, forget: Callable[[], None]) -> tuple[Any, dict[str, float]]:
    """Return the picture (as `errors` takes it) of a renderer that made everything anew, and what that took."""
    forget()
    with subject.open(settings, {"color", "color_linear"}) as renderer:
        return picture(renderer.render(chapters.view_of(renderer))), dict(renderer.prepared_ms)


@contextmanager
def _nothing_kept() -> Iterator[Callable[[], None]]:
    """Give the process an empty cache, and a function that empties it again but for compiled shaders."""
    before = {name: os.environ.get(name) for name in ("STRATA_CACHE", "STRATA_VERDICTS")}
    os.environ.update(verdicts.variables())
    with tempfile.TemporaryDirectory(prefix="strata-bench-") as folder:

        def forget() -> None:
            for path in Path(folder).iterdir():
                if path.name != "spirv":
                    shutil.rmtree(path)

        os.environ["STRATA_CACHE"] = folder
        try:
            yield forget
        finally:
            for name, value in before.items():
                if value is None:
                    del os.environ[name]
                else:
                    os.environ[name] = value
