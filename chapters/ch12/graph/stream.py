"""The frame graph of a renderer: compiled, executed, and changed between two frames.

    renderer.switch_pass("depth_of_field", False)
    renderer.insert_pass(renderer.make_pass(Invert), readers={"tonemap": {"color_focused": "color_inverted"}})
    renderer.swap_pass("tonemap", renderer.make_pass(OtherTonemap))

A new pass derives from `backends.contract.Pass`, which lists the members of a pass. The shortest new pass is a
`FullscreenPass` with its own shader:

    class Invert(FullscreenPass):
        name = "invert"
        reads = (Access("color_focused", "sampled"),)
        writes = (Access("color_inverted", "color", format="rgba16f"),)
        ...

An invalid change raises an error of one sentence, and leaves the frame unchanged.
"""

from __future__ import annotations

from collections.abc import Callable, Collection, Iterator, Mapping
from contextlib import contextmanager
from pathlib import Path
from typing import Any, TypeVar

from backends.contract import Access, Pass
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
    """A stream of frames from a frame graph. The renderer passes its plan to `_plan_frame` and adopts the graph."""

    graph: Graph
    """The compiled frame."""
    passes: list[Pass]
    _parts: PassParts
    _settings: Settings
    graph_work: dict[str, int]
    """The counters of the graph (`Graph.counts`): part of every frame's `work`."""
    _plan: FramePlan
    _created: list[tuple[Pass, tuple[Access, ...], tuple[Access, ...]]]
    """The passes that were created, with what they declared then: pipelines follow it."""
    _materials_seen = 0
    _needs: Mapping[str, bool]

    # --- execution ---

    def _plan_frame(self, plan: FramePlan) -> None:
        """Draw the frames of `plan` from now on."""
        self._plan, self._needs = plan, plan.needs(self.scene, self.settings)
        self._histories = Histories()
        self._created = []
        self._materials_seen = self.scene.revision[Change.MATERIALS]

    def _adopt(self, graph: Graph) -> None:
        """Use a graph, and create its passes. After an error the previous graph stays."""
        implementations = self._plan.implementations()
        before = getattr(self, "passes", [])
        self.passes = [implementations[step.name] for step in graph.steps if step.name != COPY]
        declared = [(gpu_pass, gpu_pass.reads, gpu_pass.writes) for gpu_pass in self.passes]
        if any(each not in self._created for each in declared):
            try:
                self._create_passes()
            except BaseException:
                self.passes = before
                raise
        self._created = declared
        self.graph, self.graph_work = graph, graph.counts()

    def _rebuild(self) -> None:
        """Compile the graph and replace the previous one; after an error the previous one stays."""
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
        """Compile again if edits of materials changed which passes are needed."""
        revision = self.scene.revision[Change.MATERIALS]
        if revision == self._materials_seen:
            return
        needs = self._plan.needs(self.scene, self.settings)
        if needs != self._needs:
            self._created = []  # targets may be others, and pipelines follow them
            self._rebuild()
        self._materials_seen, self._needs = revision, needs

    def _compiled(self) -> Graph:
        """Compile the plan; raise GraphError if it is not a valid frame."""
        api, alias = self._api, self._settings.graph.alias
        return self._plan.compile(self.size, self.scene, self._settings, api.requirement, alias, api.queues)

    def _create_passes(self) -> None:
        """Create all `passes`, again if they exist, and the descriptor sets that bind the scene for them."""
        for gpu_pass in self.passes:
            gpu_pass.create()
        self._api.make_sets(self.passes)

    def _create_targets(self) -> None:
        """Compile the graph for the size of the picture, and create its images."""
        self._adopt(self._compiled())
        self._follow_graph()

    def _follow_graph(self) -> None:
        self._histories.forget()
        self._api.follow(self._plan, self.graph, self._settings)

    def _valid_histories(self, slot: Any, reset: str) -> int:
        return self._histories.mask(self.graph, slot.number, reset)

    # --- the parts of a frame ---

    @property
    def nodes(self) -> list[Node]:
        """The nodes of the frame in order, one for each of `passes`, with the names of the graph.

        Reads of a pass that is left out are rerouted.
        """
        return self._plan.drawn(self.graph)

    @property
    def graph_file(self) -> Path:
        """The file that names the passes."""
        return self._plan.file.path

    @property
    def switches(self) -> dict[str, bool]:
        """Whether each pass of the graph is switched on, by name; the frame may not need a pass that is on."""
        return self._plan.switches

    # --- changes between two frames ---

    def make_pass(self, kind: Callable[[PassParts], PassOfOwn]) -> PassOfOwn:
        """Return a new pass of a class that takes `PassParts`, as `FullscreenPass` does."""
        return kind(self._parts)

    def switch_pass(self, name: str, on: bool) -> None:
        """Switch a pass on or off, from the next frame on.

        Resources that only this pass used are freed, and its readers read the name in `Access.instead`. Raises
        GraphError, and changes nothing, if another pass needs its result, or for an unknown name.
        """
        with self._changing():
            self._plan.switch(name, on)
            self._rebuild()

    def insert_pass(self, gpu_pass: Pass, readers: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Add a pass from the next frame on; its reads and writes decide its place.

        `readers` has, for passes that read another name from now on, the new name by the old one, as in
        {"tonemap": {"color_focused": "color_sharp"}}: the new pass reads color_focused, and tonemap reads its result.
        Raises GraphError, and changes nothing, if the pass does not fit.
        """
        with self._changing():
            self._plan.insert(gpu_pass, readers)
            self._rebuild()

    def remove_pass(self, name: str) -> None:
        """Remove an inserted pass; raise GraphError, and change nothing, if another pass reads its result."""
        with self._changing():
            self._plan.remove(name)
            self._rebuild()

    def swap_pass(self, name: str, gpu_pass: Pass) -> None:
        """Let another pass draw in place of pass `name` from the next frame on.

        It must declare the same reads and writes, so the graph is not compiled again; else GraphError is raised, and
        nothing changes. Whether the pass is needed does not change.
        """
        with self._changing():
            self._plan.swap(name, gpu_pass)
            self._adopt(self.graph)
            if name in {step.name for step in self.graph.steps}:
                self._let_go("another implementation draws since")
                self._api.executor.swap(name, gpu_pass)
                self._frames.forget()

    def show_resource(self, name: str | None) -> str:
        """Copy the resource `name` after its pass in every frame from now on; None ends this.

        Returns its name for `Frame.image`. While the resource is shown, it shares no memory. Raises GraphError,
        and changes nothing, if no pass of the frame draws it.
        """
        if (name or "") != self._plan.shown:
            with self._changing():
                self._plan.shown = name or ""
                if name and not self._plan.watched(self.graph):
                    drawn = [
                        access.resource for node in self.nodes for access in node.writes if not access.bytes
                    ]
                    raise GraphError(f"No pass of this frame draws '{name}'{suggest(name, drawn)}")
                self._rebuild()
        return next((f"{node.name}/{name}" for node in self._plan.watched(self.graph)), "")

    @property
    def shader_files(self) -> frozenset[Path]:
        """The files of the shaders, and the graph file."""
        return super().shader_files | {self.graph_file}

    def _reload_graph(self, changed: Collection[Path]) -> bool:
        """Read the graph file again if it is in `changed`; return whether it is."""
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
        self._last = None  # the same view has another picture now
