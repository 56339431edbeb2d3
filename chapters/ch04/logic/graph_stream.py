"""What a renderer on either backend does with its frame graph: compile it, and change it between two frames."""

from __future__ import annotations

from collections.abc import Mapping
from typing import Any

from common.scene import Change

from .frame_plan import FramePlan
from .graph_types import Graph, GraphError
from .histories import Histories
from .stream import FrameStream


class GraphStream(FrameStream):
    """A stream of frames that a graph describes. A renderer makes `_plan`, and carries `graph` out in `_rebuild`."""

    graph: Graph
    """The frame as it is compiled now."""
    _plan: FramePlan
    _materials_seen = 0
    _needs: Mapping[str, bool]

    def _plan_frame(self, plan: FramePlan) -> None:
        """Draw what `plan` says from now on."""
        self._plan, self._needs = plan, plan.needs(self.scene, self.settings)
        self._histories = Histories()
        self._materials_seen = self.scene.revision[Change.MATERIALS]

    def _rebuild(self) -> None:
        """Compile the graph, and take it in place of the one before; where it is refused, that one stays."""
        raise NotImplementedError

    def _follow_needs(self) -> None:
        """Take another graph where edited materials need a pass that they did not need, or no longer need one."""
        revision = self.scene.revision[Change.MATERIALS]
        if revision == self._materials_seen:
            return
        needs = self._plan.needs(self.scene, self.settings)
        if needs != self._needs:
            self._rebuild()
        self._materials_seen, self._needs = revision, needs

    @property
    def switches(self) -> dict[str, bool]:
        """Each pass that the graph names, and whether it is switched on; one that is on may still not be needed."""
        return self._plan.switches

    def switch_pass(self, name: str, on: bool) -> None:
        """Switch a pass on or off, from the next frame on.

        What only it used goes, and its readers get what it says instead of its result. GraphError, with nothing
        changed, where somebody needs it, or where there is no such pass.
        """
        was = self._plan.switches.get(name)
        self._plan.switch(name, on)
        self._try(lambda: self._plan.switch(name, bool(was)))

    def insert_pass(self, made: Any, readers: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Add a pass from the next frame on; where it runs follows from what it reads and writes.

        `readers` says which passes read something else from now on, as {"tonemap": {"color_hdr": "color_sharp"}}:
        a pass between two others reads what the earlier one writes, and the later one reads the pass. GraphError, with
        nothing changed, where it does not fit.
        """
        self._plan.insert(made, readers)
        self._try(lambda: self._plan.remove(made.name))

    def remove_pass(self, name: str) -> None:
        """Take out a pass that was inserted."""
        self._plan.remove(name)
        self._rebuild()
        self._last = None

    def _try(self, undo: Any) -> None:
        try:
            self._rebuild()
        except GraphError as error:
            undo()
            raise self._plan.where(error) from None
        self._last = None  # the same view makes another picture now
