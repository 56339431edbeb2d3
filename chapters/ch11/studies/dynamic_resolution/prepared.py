"""Frames that are prepared beside each other, and that continue the same histories; the renderer draws one of them.

A prepared frame is a compiled graph with its images, its descriptor sets and its recordings. The current one is parked,
and another one taken. The next frame continues the histories: they belong to the stream of frames, and their images are
lent from one executor to the next. Scene, pipelines, shadow maps, fog and exposure exist once for all.

What invalidates recordings, such as an edit of materials or another size, drops all prepared frames but the current
one.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any

from ...graph.types import Graph
from ...renderer import Renderer as ChapterRenderer


@dataclass
class Prepared:
    """A frame that is ready to be drawn; `parts` are members of the backend."""

    graph: Graph
    nodes: Any
    recordings: Any
    parts: dict[str, Any]


class PreparedFrames(ChapterRenderer):
    """The chapter's renderer with several prepared frames, by number. A subclass says what differs between them."""

    PARTS: tuple[str, ...] = ("executor", "copies", "inspection", "_passes")
    """Members of the backend that belong to a prepared frame."""

    _number: int
    """The number of the current frame."""
    _prepared: dict[int, Prepared]
    """The parked frames."""
    _valid_until = 0
    """How often recordings had become invalid when the parked frames were valid."""
    _made = 1
    """How many frames were made."""

    def _use(self, number: int) -> None:
        """Let settings be those of a frame."""
        raise NotImplementedError

    def _go_to(self, number: int, why: str) -> None:
        """Draw another prepared frame from now on, and make it at the first time; after an error none changes.

        Waits for the frames in flight, whose images can no longer be read; `why` says the reason.
        """
        self._api.enter()
        self._let_go(why)
        if self._frames.forgotten != self._valid_until:
            self._drop()
        before, prepared = self._number, self._prepared.pop(number, None)
        parked = self._park(prepared)
        self._use(number)
        if prepared is not None:
            self._resume(prepared)
        else:
            try:
                self._prepare(parked)
            except BaseException:  # the device has no memory for it
                self._use(before)
                self._undo(parked)
                raise
            self._made += 1
        self._prepared[before] = parked
        self._valid_until = self._frames.forgotten

    def _park(self, other: Prepared | None) -> Prepared:
        """Return the frame that is drawn, and go on with the recordings of another one, or with none."""
        recordings = self._frames.exchange(other.recordings if other else None)
        parts = {name: getattr(self._api, name) for name in self.PARTS}
        return Prepared(self.graph, self._plan.nodes, recordings, parts)

    def _resume(self, prepared: Prepared) -> None:
        """Draw a prepared frame from now on."""
        for name, part in prepared.parts.items():
            setattr(self._api, name, part)
        self.graph, self._plan.nodes = prepared.graph, prepared.nodes
        self.graph_work = self.graph.counts()

    def _prepare(self, lender: Prepared) -> None:
        """Make the frame of a scale that was not visited yet, with the histories of another one."""
        api, steps = self._api, [step.name for step in self.graph.steps]
        graph = self._compiled()
        assert sorted(step.name for step in graph.steps) == sorted(steps), "a scale changes sizes alone"
        kind: Any = type(api.copies)
        copies = kind(self.device)
        copies.also = api.copies.also
        api.copies = copies
        self._renew()
        api.follow(self._plan, graph, self._settings, lender.parts["executor"].images)
        self.graph, self.graph_work = graph, graph.counts()

    def _undo(self, parked: Prepared) -> None:
        """Free what a failed `_prepare` has made, and draw a parked frame again."""
        failed = self._park(parked)
        failed.parts["copies"].close()
        self._free_renewed(failed)
        self._frames.discard(failed.recordings)
        self._resume(parked)

    def _renew(self) -> None:
        """Make what else a prepared frame has of its own."""

    def _drop(self, with_histories: bool = False) -> None:
        """Free all prepared frames but the current one, which then owns the histories, unless they are freed, too."""
        if self._prepared:
            self._wait()
        for prepared in self._prepared.values():
            if not with_histories:
                self._api.executor.images.own(prepared.parts["executor"].images)
            self._frames.discard(prepared.recordings)
            for name in ("copies", "inspection", "executor"):
                prepared.parts[name].close()
            self._free_renewed(prepared)
        self._prepared = {}

    def _wait(self) -> None:
        """Wait until nothing uses images: a window may still copy from one."""

    def _free_renewed(self, prepared: Prepared) -> None:
        """Free what `_renew` made."""

    def _create_targets(self) -> None:
        self._drop(with_histories=True)  # those of another size
        self._use(self._number)
        super()._create_targets()
        self._valid_until = self._frames.forgotten

    def _rebuild(self) -> None:
        super()._rebuild()
        self._drop()
        self._valid_until = self._frames.forgotten

    def _free(self) -> None:
        self._drop()
        super()._free()
