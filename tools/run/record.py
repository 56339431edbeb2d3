"""What a run leaves for `--json` and `-v`: device, plan, settings, start-up times, and each frame's figures."""

from __future__ import annotations

import json
import platform
import statistics
import sys
import tomllib
from dataclasses import asdict, dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

import chapters
from chapters.folders import Folder
from common.errors import UserError
from common.paths import ROOT, write_whole
from common.settings import flat
from tools.cli.console import err, out

if TYPE_CHECKING:
    from backends.contract import Frame, Renderer
    from common.scene import Scene
    from tools.run.run import Request

STDOUT = Path("-")
"""The file of --json that is no file: the record is printed, and whatever else is said goes to stderr."""

FRAMES_KEPT = 1000
"""A record holds the figures of at most so many frames, the last ones."""


@dataclass
class Log:
    """The record of one renderer; `request` and `quality` say what was asked for."""

    request: Request
    renderer: Renderer
    quality: str
    frames: list[dict[str, Any]] = field(default_factory=list)
    start: dict[str, float] = field(default_factory=dict)
    pictures: list[str] = field(default_factory=list)

    @property
    def device(self) -> str:
        """The device's name and driver."""
        capabilities = self.renderer.capabilities
        return f"{capabilities.device} ({capabilities.driver})"

    def add(self, frame: Frame) -> None:
        """Keep one frame's figures; reading them waits, so no frame's time holds a part of the next one's."""
        self.frames.append(
            {
                "index": frame.index,
                "cpu_ms": frame.cpu_ms,
                "timings_ms": dict(frame.timings),
                "work": dict(frame.work),
                "reset": frame.reset,
            }
        )
        del self.frames[:-FRAMES_KEPT]

    def medians(self) -> dict[str, float]:
        """Return the median of each pass's GPU milliseconds, and of the CPU's.

        The first frame, in which drivers compile, counts only if it is the only one.
        """
        counted = self.frames[1:] or self.frames
        names = list(dict.fromkeys(name for frame in counted for name in frame["timings_ms"]))
        result = {
            name: statistics.median(f["timings_ms"][name] for f in counted if name in f["timings_ms"])
            for name in names
        }
        return {**result, "cpu": statistics.median(f["cpu_ms"] for f in counted)}

    def record(self) -> dict[str, Any]:
        """Return everything as JSON has it."""
        from backends.vulkan.shaders.compiler import shared

        scene, capabilities, renderer = self.renderer.scene, self.renderer.capabilities, self.renderer
        return {
            "strata": strata_version(),
            **naming(self.request.chapter),
            "title": chapters.title_of(self.request.chapter),
            "backend": capabilities.backend,
            "device": {
                "name": capabilities.device,
                "driver": capabilities.driver,
                "api_version": ".".join(map(str, capabilities.api_version)),
                "kind": capabilities.kind,
            },
            "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}",
            "plan": [asdict(choice) for choice in renderer.plan.choices],
            "scene": {
                "name": scene.name,
                "path": str(scene.path) if scene.path else None,
                "meshes": len(scene.meshes),
                "instances": len(scene.instances),
                "triangles": triangles(scene),
                "indices": int(scene.meshes["index_count"][scene.instances.mesh].sum()),
                "materials": len(scene.materials),
                "images": len(scene.images),
                "lights": len(scene.lights),
                "environment": scene.environment.name if scene.environment else None,
                "warnings": list(scene.warnings),
            },
            "size": list(renderer.size),
            "quality": self.quality,
            "settings": flat(renderer.settings),
            "start_s": self.start,
            "shaders": asdict(shared().counters),
            "median_ms": self.medians(),
            "frames": self.frames,
            "pictures": self.pictures,
            **({} if self.request.path is None else {"path": self.request.path, "fps": self.request.fps}),
        }

    def write(self, path: Path) -> None:
        """Write the record, whole or not at all; to `STDOUT`, print it."""
        text = json.dumps(self.record(), indent=1) + "\n"
        if path == STDOUT:
            sys.stdout.write(text)
            return
        try:
            write_whole(path.absolute(), text.encode())
        except OSError as error:
            raise UserError(f"--json {path} cannot be written: {error.strerror or error}.") from None

    def show(self) -> None:
        """Print plan and figures as tables."""
        from common.reports.tables import table

        to = err if self.request.json == STDOUT else out
        plan = table(f"Plan on {self.device}", "feature", "path", "why")
        for choice in self.renderer.plan.choices:
            plan.add_row(choice.feature, choice.path, choice.reason)
        to.print(plan)
        # A first frame alone is no median of anything, and in it drivers compile.
        of = "median" if len(self.frames) > 1 else "first frame"
        figures = table("Milliseconds", "part", f">{of}")
        for name, value in self.medians().items():
            figures.add_row("recording (CPU)" if name == "cpu" else name, f"{value:.2f}")
        to.print(figures)
        if self.start:
            seconds = ", ".join(f"{name} {value:.2f}" for name, value in self.start.items())
            to.print(f"Start in seconds: {seconds}", soft_wrap=True)
        work = ", ".join(f"{name} {count}" for name, count in self.frames[-1]["work"].items())
        to.print(f"Work: {work}", soft_wrap=True)
        resets = ", ".join(
            f"{frame['reset']} (frame {frame['index']})" for frame in self.frames if frame["reset"]
        )
        to.print(f"Started without history: {resets or 'none of these frames'}", markup=False, soft_wrap=True)


def naming(which: chapters.Which) -> dict[str, Any]:
    """Return how records name what drew: "chapter" is a number or a study's name; "fork" is there for a fork alone."""
    if isinstance(which, Folder):
        return {"chapter": which.lesson.number, "fork": str(which.path)}
    return {"chapter": which}


def triangles(scene: Scene) -> int:
    """Return the triangles that a frame of the whole scene draws."""
    return int(np.sum(scene.meshes["index_count"][scene.instances.mesh], dtype=np.int64)) // 3


def strata_version() -> str:
    """Return the version of this clone."""
    project = tomllib.loads((ROOT / "pyproject.toml").read_text("utf-8"))["project"]
    found: str = project["version"]
    return found
