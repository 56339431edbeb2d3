"""Frames of a renderer, with two batches of graphics each: which values does the CPU wait for, before which frame?"""

from __future__ import annotations

import json
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

from common.errors import DeviceError
from common.scene import Scene
from common.view.camera import View
from tests.support.cloth_runs import VIEW
from tests.support.cloth_scenes import cloth, cloth_scene_of
from tests.support.pacing import ends, number
from tests.support.scenes import facing, quad_scene
from tools.exercises.checking import Given

FRAMES = 9


def check(given: Given) -> None:
    """A square without cloth, cloth that soon hangs still, and lighting on the compute queue."""
    still = cloth_scene_of(cloth(2, 2, pins=range(4)), size=(2, 2))
    with _on_compute(given) as beside:
        _follow(given, "a scene without cloth", quad_scene(), facing(), graph="deferred")
        _follow(given, "cloth that is at rest after some frames", still, VIEW, graph="deferred")
        _follow(given, "lighting on the compute queue", quad_scene(), facing(), graph=beside)


@contextmanager
def _on_compute(given: Given) -> Iterator[str]:
    """Yield the path of a graph whose lighting asks for the compute queue: so graphics has two batches."""
    told = json.loads(given.module("graph.file").graph_path("compute").read_text("utf-8"))
    for entry in told["passes"]:
        if entry["pass"] == "lighting_compute":
            entry["queue"] = "compute"
    with TemporaryDirectory() as folder:
        path = Path(folder) / "beside.json"
        path.write_text(json.dumps(told), "utf-8")
        yield str(path)


def _follow(given: Given, what: str, scene: Scene, view: View, **knobs: Any) -> None:
    """Draw frames; in each the CPU has to wait for what was signalled up to the frame that had its slot before."""
    slots = given.module("frames.frame").SLOTS
    with given.open(scene, (8, 8), **knobs) as made:
        opened: Any = made
        timelines = {number(one.handle): name for name, one in opened._frames.pace.timelines.items()}
        calls = _Calls(timelines)
        behind: list[dict[int, int]] = []
        opened.device.fn.trace(calls)
        try:
            for frame in range(FRAMES):
                opened.render(view, frame / 4)
                left = behind[frame - slots] if frame >= slots else dict.fromkeys(timelines, 0)
                for semaphore, name in timelines.items():
                    waited, value = calls.waited[semaphore], left[semaphore]
                    stands = (
                        f"With {what}, frame {frame} begins when the {name} timeline stands at {waited}, "
                    )
                    given.need(
                        waited >= value,
                        f"{stands}and its slot is free at {value}: what the GPU still reads is written over.",
                    )
                    given.need(
                        waited <= value,
                        f"{stands}and its slot is free at {value}: the CPU waits for more than its slot.",
                    )
                behind.append(dict(calls.signalled))
        except DeviceError as error:
            given.need(False, f"With {what}, frame {len(behind)} never begins. {error}")
        finally:
            opened.device.fn.trace(None)
    given.silent()


class _Calls(list[Any]):
    """Reads calls as they are made: by timeline, the highest value that the CPU waited for, and the last signalled."""

    def __init__(self, timelines: Iterable[int]) -> None:
        super().__init__()
        self.waited = dict.fromkeys(timelines, 0)
        self.signalled = dict.fromkeys(self.waited, 0)

    def append(self, call: tuple[str, tuple[Any, ...]]) -> None:
        """Take in a call."""
        books = self.signalled if call[0] == "vkQueueSubmit2" else self.waited
        for end in ends(*call):
            if isinstance(end, tuple) and end[0] in books:
                books[end[0]] = max(books[end[0]], end[1])
