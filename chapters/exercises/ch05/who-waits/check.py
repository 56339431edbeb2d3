"""A few frames on two queues: how they are cut into batches, and what those wait for."""

from __future__ import annotations

from typing import Any

from backends.contract import Access
from tools.exercises import Answer
from tools.exercises.checking import Given

OUTPUT = "picture"


def measure(given: Given) -> dict[str, Answer]:
    """Compile the frame and its variants; the last one is submitted, frame by frame, with a pass that rests."""
    first = _Frame(given)
    slots = _Frame(given, slotted=True)
    own = _Frame(given, sources=("motion",))
    return {
        "batches": len(first.batches),
        "waits": first.waits,
        "lighting_too": _Frame(given, readers=("lighting", "tonemap")).waits,
        "of_each_slot": slots.waits,
        "reads_motion": own.waits,
        "reads_motion_batches": len(own.batches),
        "reads_depth_batches": len(_Frame(given, sources=("depth",)).batches),
        "one_queue": len(_Frame(given, queues=("graphics",)).batches),
        "rests": slots.submitted(frames=4, works=1),
    }


class _Frame:
    """The frame of the exercise, compiled. `slotted`: what fog writes is a buffer that exists once per slot."""

    def __init__(
        self,
        given: Given,
        readers: tuple[str, ...] = ("tonemap",),
        sources: tuple[str, ...] = (),
        slotted: bool = False,
        queues: tuple[str, ...] = ("graphics", "compute"),
    ) -> None:
        words = given.module("graph.types")
        fog = Access("fog", "storage") if slotted else Access("fog", "sampled")

        def draws(name: str, read: tuple[str, ...], *written: Access) -> Any:
            taken = [Access(one, "sampled") for one in read]
            return words.Node(name, (*taken, *([fog] if name in readers else [])), written)

        made = Access("fog", "storage", bytes=64) if slotted else Access("fog", "storage", "rgba16f")
        drawn = [Access(name, "color", "rgba8") for name in ("base_color", "motion")]
        nodes = [
            draws("gbuffer", (), *drawn, Access("depth", "depth", "d32f")),
            draws("lighting", ("base_color", "depth"), Access("lit", "color", "rgba16f")),
            draws("tonemap", ("lit",), Access(OUTPUT, "color", "rgba8")),
            words.Node("fog", tuple(Access(one, "sampled") for one in sources), (made,), queue="compute"),
        ]
        free = words.Touch("", frozenset(), frozenset())
        externals = {"fog": words.External(None, None, free, bytes=64)} if slotted else None
        compiler: Any = given.module("graph.frame_graph")
        self._logic: Any = given.module("graph.execute.batches")
        self.graph = compiler.compile_graph(nodes, (64, 32), {OUTPUT}, externals, queues=queues)
        self.batches = self._logic.batches_of(self.graph)

    @property
    def waits(self) -> int:
        """Of one batch for another, in every frame but the first."""
        return sum(len(batch.waits) for batch in self.batches)

    def submitted(self, frames: int, works: int) -> int:
        """Return the waits that the last of some frames is submitted with; fog has something to do in the first
        `works` of them."""
        reached, count = self._logic.Reached(), 0
        for frame in range(frames):
            reached.begin_frame()
            count = 0
            for batch in self.batches:
                waits = reached.waits(batch)
                if frame >= works and self._logic.can_rest(self.graph, batch):
                    reached.rests(batch, waits)
                    continue
                values = dict(zip(("graphics", "compute"), reached.values, strict=True))
                reached.submitted(batch, waits, values[batch.queue] + 1)
                count += len(waits)
        return count
