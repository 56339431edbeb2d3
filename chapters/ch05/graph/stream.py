"""What a renderer does with its frame graph: compile it, carry it out, and change it between two frames.

    renderer.switch_pass("depth_of_field", False)
    renderer.insert_pass(renderer.make_pass(Invert), readers={"tonemap": {"color_focused": "color_inverted"}})
    renderer.swap_pass("tonemap", renderer.make_pass(OtherTonemap))

A pass of one's own derives from `backends.contract.Pass`, which says what a pass can have. The shortest way to one is a
`FullscreenPass` that names a shader of its own:

    class Invert(FullscreenPass):
        name = "invert"
        reads = (Access("color_focused", "sampled"),)
        writes = (Access("color_inverted", "color", format="rgba16f"),)
        ...

Whatever is refused raises an error of one sentence, and the frame stays what it was.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from backends.contract import Pass
from common.errors import StaleFrameError
from common.names import suggest
from common.scene import Change

from ..frames.stream import FrameStream
from ..scene.pass_parts import PassParts
from ..settings import Settings
from .file import read_graph
from .histories import Histories
from .plan import COPY, FramePlan, check_samples
from .types import Graph, GraphError, Node

PassOfOwn = TypeVar("PassOfOwn", bound=Pass)


class GraphStream(FrameStream):
    """A stream of frames that a graph describes. A renderer gives its plan to `_plan_frame`, and adopts the graph."""

    graph: Graph
    """The frame as it is compiled now."""
    passes: list[Pass]
    _parts: PassParts
    _settings: Settings
    graph_work: dict[str, int]
    """What the graph has of passes, barriers and memory: part of every frame's `work`."""
    _plan: FramePlan
    _created: list[Pass]
    _materials_seen = 0
    _needs: Mapping[str, bool]

    # --- carried out ---

    def _plan_frame(self, plan: FramePlan) -> None:
        """Draw what `plan` says from now on."""
        self._plan, self._needs = plan, plan.needs(self.scene, self.settings)
        self._histories = Histories()
        self._created = []
        self._materials_seen = self.scene.revision[Change.MATERIALS]

    def _adopt(self, graph: Graph) -> None:
        """Go on with a graph: its passes get their pipelines. An error leaves the graph that there was."""
        made = self._plan.implementations()
        before = getattr(self, "passes", [])
        self.passes = [made[step.name] for step in graph.steps if step.name != COPY]
        if not set(self.passes) <= set(self._created):
            try:
                self._create_passes()
            except BaseException:
                self.passes = before
                raise
        self._created = self.passes
        self.graph, self.graph_work = graph, graph.counts()

    def _rebuild(self) -> None:
        """Compile the graph, and take it in place of the one before; where that is refused, that one stays."""
        before = self.graph, self.passes, self.graph_work
        self._adopt(self._compiled())
        self._let_go("the frame is made of other passes since")
        self._api.leave()
        try:
            self._follow_graph()
        except BaseException:  # the device has no such image, or no memory for it
            self.graph, self.passes, self.graph_work = before
            self._follow_graph()
            raise

    def _follow_needs(self) -> None:
        """Take another graph where edited materials need a pass that they did not need, or no longer need one."""
        revision = self.scene.revision[Change.MATERIALS]
        if revision == self._materials_seen:
            return
        needs = self._plan.needs(self.scene, self.settings)
        if needs != self._needs:
            self._rebuild()
        self._materials_seen, self._needs = revision, needs

    def _compiled(self) -> Graph:
        """Compile the frame as it is planned; GraphError where that cannot be one."""
        api, alias = self._api, self._settings.alias
        return self._plan.compile(self.size, self.scene, self._settings, api.requirement, alias, api.queues)

    def _create_passes(self) -> None:
        """Make the pipelines of all `passes`, again where they have been made, and what binds the scene for them."""
        for one in self.passes:
            one.create()
        self._api.make_sets(self.passes)

    def _create_targets(self) -> None:
        """Compile the graph for the picture's size, and make everything that belongs to it."""
        self._adopt(self._compiled())
        self._follow_graph()

    def _follow_graph(self) -> None:
        self._histories.forget()
        self._api.follow(self._plan, self.graph, self._settings)

    def _valid_histories(self, slot: Any, reset: str) -> int:
        return self._histories.mask(self.graph, slot.number, reset)

    # --- what a frame consists of ---

    @property
    def nodes(self) -> list[Node]:
        """The passes of the frame in their order, under the names of the graph, beside `passes`, which draw them.

        Who reads what a pass that is left out would write reads what he gets instead.
        """
        return self._plan.drawn(self.graph)

    @property
    def graph_file(self) -> Path:
        """The file that names the passes."""
        return self._plan.file.path

    @property
    def switches(self) -> dict[str, bool]:
        """Each pass that the graph names, and whether it is switched on; one that is on may still not be needed."""
        return self._plan.switches

    # --- what can be changed between two frames ---

    def make_pass(self, kind: Callable[[PassParts], PassOfOwn]) -> PassOfOwn:
        """Return a pass of one's own of a class that is made as `FullscreenPass` is."""
        return kind(self._parts)

    def switch_pass(self, name: str, on: bool) -> None:
        """Switch a pass on or off, from the next frame on.

        What only it used goes, and its readers get what it says instead of its result. GraphError, with nothing
        changed, where somebody needs it, or where there is no such pass.
        """
        with self._changing():
            self._plan.switch(name, on)
            self._rebuild()

    def insert_pass(self, made: Pass, readers: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Add a pass from the next frame on; where it runs follows from what it reads and writes.

        `readers` says, by the names of the graph, which passes read something else from now on, as
        {"tonemap": {"color_focused": "color_sharp"}}: a pass between two others reads what the earlier one writes, and
        the later one reads the pass. GraphError, with nothing changed, where it does not fit.
        """
        with self._changing():
            self._plan.insert(made, readers)
            self._rebuild()

    def remove_pass(self, name: str) -> None:
        """Take out a pass that was inserted; GraphError, with nothing changed, where another one reads it."""
        with self._changing():
            self._plan.remove(name)
            self._rebuild()

    def swap_pass(self, name: str, made: Pass) -> None:
        """Let `made` draw in place of pass `name` from the next frame on.

        It declares the same reads and writes, so that the graph stays and nothing of it is compiled; GraphError, with
        nothing changed, where it does not. Whether the pass is needed stays as it was.
        """
        with self._changing():
            self._plan.swap(name, made)
            self._adopt(self.graph)
            if name in {step.name for step in self.graph.steps}:
                self._let_go("another implementation draws since")
                self._api.executor.swap(name, made)
                self._frames.forget()

    def show_resource(self, name: str | None) -> str:
        """Have what a pass writes under `name` copied behind it in every frame from now on; None ends that.

        Returns by which name `Frame.image` gives it. As long as it is looked at, it shares memory with nobody.
        GraphError, with nothing changed, where no pass of the frame draws it.
        """
        if (name or "") != self._plan.shown:
            with self._changing():
                self._plan.shown = name or ""
                if name and not self._plan.watched(self.graph):
                    drawn = [one.resource for node in self.nodes for one in node.writes if not one.bytes]
                    raise GraphError(f"No pass of this frame draws '{name}'{suggest(name, drawn)}")
                self._rebuild()
        return next((f"{node.name}/{name}" for node in self._plan.watched(self.graph)), "")

    @property
    def shader_files(self) -> frozenset[Path]:
        """The files of the shaders, and that of the graph."""
        return super().shader_files | {self.graph_file}

    def _reload_graph(self, changed: Collection[Path]) -> bool:
        """Take over the graph's file, if it is among those that changed; whether it was."""
        if self.graph_file not in changed:
            return False
        with self._changing():
            file = read_graph(self.graph_file)
            check_samples(file, self.settings)
            self._plan.follow(file)
            self._rebuild()
        return True

    @contextmanager
    def _changing(self) -> Iterator[None]:
        if self._closed:
            raise StaleFrameError("This renderer was closed and renders no more: open another one.")
        self._api.enter()
        with self._plan.changing():
            yield
        self._last = None  # the same view makes another picture now
