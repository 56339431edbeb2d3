"""The part `loads` of a bench. Chapter 3's bench says what is loaded, in which ways and how often.

Each load is a process of its own: `python -m tools.bench.lessons.loads WHICH BACKEND SCENE WxH WAY [FILE.npz]` prints
what it measured as JSON.
"""

from __future__ import annotations

import json
import os
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from functools import partial
from pathlib import Path
from typing import Any

import chapters
from backends import verdicts
from chapters import scenes
from common.errors import DeviceError, UserError
from common.paths import ROOT, asset_dir
from common.reports.benches import Effort
from common.scene.primitive import nothing
from tools.bench.lessons import bench
from tools.bench.points import Subject
from tools.run.run import open_device


def measure(
    which: chapters.Whole,
    backend: str,
    size: tuple[int, int],
    effort: Effort,
    step: Callable[[str, float], None],
) -> list[dict[str, Any]]:
    """Return a record for each scene of `Settings.LOADS`; [] where there are none."""
    names = getattr(chapters.settings_class(which), "LOADS", ())
    return bench("loads").measure(names, find, partial(run, which, backend, size), effort, step)


def find(name: str) -> Path | None:
    """Return the file of a scene of our own, or of a model among the tests' assets; None where it is not here."""
    models = asset_dir()
    model = None if models is None else models / "models" / name / f"{name}.gltf"
    if model is not None and model.is_file():
        return model
    try:
        return scenes.find(name)
    except UserError:
        return None


def run(
    which: chapters.Whole,
    backend: str,
    size: tuple[int, int],
    scene: Path,
    way: str,
    cache: Path,
    picture: Path | None = None,
) -> dict[str, Any]:
    """Return the figures of one load in a process of its own, whose cache is the folder `cache`."""
    words = [str(which if isinstance(which, int) else which.path), backend, str(scene)]
    words += [f"{size[0]}x{size[1]}", way, *([str(picture)] if picture else [])]
    done = subprocess.run(
        [sys.executable, "-m", "tools.bench.lessons.loads", *words],
        env={**os.environ, **verdicts.variables(), "STRATA_CACHE": str(cache)},
        cwd=ROOT,
        capture_output=True,
        text=True,
    )
    if done.returncode:
        last = (done.stderr.strip().splitlines() or ["no message"])[-1]
        raise DeviceError(f"Loading {scene.stem} in a process of its own failed: {last}")
    figures: dict[str, Any] = json.loads(done.stdout)
    return figures


def once(
    which: chapters.Whole,
    backend: str,
    path: Path,
    size: tuple[int, int],
    way: str,
    picture: Path | None = None,
) -> dict[str, Any]:
    """Return the figures of one load in this process; `picture` is an .npz that gets what is seen."""
    load = bench("load")
    if way in load.DECODED:
        return dict(load.decoded(path, way))
    with ExitStack() as stack:
        subject = Subject(which, backend, nothing("what is loaded"), size, open_device(stack, backend))
        return dict(load.once(subject, path, way, picture))


def main() -> None:
    """Measure this process."""
    chapter, backend, path, size, way, *picture = sys.argv[1:]
    width, _, height = size.partition("x")
    which = chapters.parse_chapter(chapter)
    print(json.dumps(once(which, backend, Path(path), (int(width), int(height)), way, *map(Path, picture))))


if __name__ == "__main__":
    main()
