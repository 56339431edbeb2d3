"""Which passes make a frame: those that a graph file names, less what the scene does not need and what is switched off.

    plan = FramePlan(file, passes, scene, settings)
    plan.switch("depth_of_field", False)
    graph = plan.compile(size, memory.requirement)

The plan belongs to no backend: either one's passes declare the same, so the same file gives the same graph.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from backends.contract import Access
from common.errors import UserError
from common.names import suggest

from .frame import OUTPUTS
from .frame_graph import bytes_of, compile_graph
from .graph_json import GraphFile
from .graph_names import connect
from .graph_types import External, Graph, GraphError, Node, Requirements, Touch
from .views import PICTURE

COPY = "copy outputs"
"""The step in which outputs go to the CPU, or are left as a window copies them."""

OFF = "switched off"

POISONS = ("off", "depth 0", "depth 1")
"""What memory can be filled with before its first use: nothing, or NaN, integers of all ones and this depth."""


def graph_name(settings: Any) -> str:
    """Return the graph that settings mean: "auto" is deferred, where that can show what is asked for.

    A G-buffer holds one surface a pixel, so several samples a pixel are the forward path's; and so are views, which
    show a quantity of each surface while it is drawn.
    """
    if settings.view != PICTURE or (settings.graph == "auto" and settings.msaa > 1):
        return "forward"
    return "deferred" if settings.graph == "auto" else str(settings.graph)


def check_samples(file: GraphFile, settings: Any) -> None:
    """Raise UserError where a graph with a G-buffer is asked for several samples a pixel."""
    if "gbuffer" in file.passes.values() and settings.msaa > 1:
        raise UserError(
            f"{file.path.name} has a G-buffer, which holds one sample a pixel: set msaa=1, or graph=forward."
        )


@dataclass(frozen=True)
class Declared:
    """A pass as a graph file asks for it."""

    name: str
    reads: tuple[Access, ...]
    writes: tuple[Access, ...]
    why_not: str


class FramePlan:
    """The passes of a frame, and the graph that follows from them.

    `passes` are the chapter's by name, made but not created; `outputs` says by output from which name it is read,
    `handed_on` which names somebody copies from after the frame.
    """

    def __init__(
        self,
        file: GraphFile,
        passes: Mapping[str, Any],
        outputs: Mapping[str, str],
        handed_on: Collection[str],
        formats: Collection[str],
    ) -> None:
        self._file, self._passes, self._formats = file, dict(passes), formats
        self.title = file.title
        self.read_from, self._handed_on = {**outputs}, {*handed_on}
        for output, name in file.outputs.items():
            if output in outputs:
                self._handed_on.discard(outputs[output])
                self._handed_on.add(name)
                self.read_from[output] = name
        self._off: dict[str, str] = {}
        self._inserted: dict[str, Any] = {}
        self._readers: dict[str, Mapping[str, Mapping[str, str]]] = {}
        self.nodes: dict[str, Node] = {}
        """The passes as they were compiled last, by the names of their steps."""
        self.keep: set[str] = set()
        """Names that are looked at: they share memory with nobody."""
        self.keeps_all = False
        self.kept: set[str] = set()
        self.externals: dict[str, External] = {}
        """What they were compiled with."""

    # --- what can be changed while frames are drawn ---

    @property
    def switches(self) -> dict[str, bool]:
        """Each pass of the file and what was inserted, and whether it is switched on."""
        return {name: name not in self._off for name in (*self._file.passes, *self._inserted)}

    def switch(self, name: str, on: bool) -> None:
        """Switch a pass on or off; GraphError where there is none of this name."""
        if name not in self.switches:
            raise GraphError(f"There is no pass '{name}'{suggest(name, self.switches)}")
        self._off.pop(name, None)
        if not on:
            self._off[name] = OFF

    def insert(self, made: Any, readers: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Add a pass that the file does not name; where it runs follows from what it reads and writes.

        `readers` says which passes read something else from now on: {"tonemap": {"color_focused": "color_sharp"}}.
        """
        if made.name in self.switches:
            raise GraphError(f"There is a pass '{made.name}' already: give the new one another name.")
        for reader in readers or {}:
            if reader not in self.switches:
                raise GraphError(f"There is no pass '{reader}'{suggest(reader, self.switches)}")
        self._inserted[made.name] = made
        self._readers[made.name] = readers or {}

    def remove(self, name: str) -> None:
        """Take out a pass that was inserted, and connect those that read it as they were."""
        del self._inserted[name], self._readers[name]

    def implementations(self) -> dict[str, Any]:
        """Return what draws, by the names of the steps."""
        return {name: self._passes[of] for name, of in self._file.passes.items()} | self._inserted

    def swap(self, name: str, made: Any) -> None:
        """Let `made` draw in place of pass `name`; it declares the same."""
        now = self.implementations()[name]
        if (made.reads, made.writes) != (now.reads, now.writes):
            raise GraphError(f"What takes the place of '{name}' has to read and write the same as that.")
        if name in self._inserted:
            self._inserted[name] = made
        else:
            self._passes[self._file.passes[name]] = made

    # --- compiled ---

    def needs(self, scene: Any, settings: Any) -> dict[str, bool]:
        """Return whether the scene and the settings give each pass anything to do."""
        return {name: made.needed(scene, settings) for name, made in self.implementations().items()}

    def compile(
        self,
        size: tuple[int, int],
        scene: Any,
        settings: Any,
        requirements: Requirements | None = None,
        alias: bool = True,
    ) -> Graph:
        """Compile the frame for a picture of `size` pixels; `nodes` are then those of its steps."""
        declared = {
            name: Declared(name, made.reads, made.writes, _why_not(made, scene, settings))
            for name, made in self._passes.items()
        }
        nodes = self._file.nodes(declared, self._formats, outputs=OUTPUTS)
        nodes += [
            Node(made.name, made.reads, made.writes, _why_not(made, scene, settings))
            for made in self._inserted.values()
        ]
        for readers in self._readers.values():
            nodes = [_reconnected(node, readers.get(node.name, {})) for node in nodes]
        nodes = [replace(node, why_not=self._off.get(node.name, node.why_not)) for node in nodes]
        there, copy, self.externals = self._copied(nodes, size)
        if copy.reads:  # else nobody wants anything of this frame
            nodes.append(copy)
        self.nodes = {node.name: node for node in nodes}
        self.kept = {a.resource for node in nodes for a in node.writes} if self.keeps_all else {*self.keep}
        return compile_graph(nodes, size, there, self.externals, requirements, alias, self.kept)

    def watched(self, graph: Graph) -> list[Any]:
        """Return the passes of a graph that draw, in its order, with the names of this graph (see `Inspection`)."""
        return [self.nodes[step.name] for step in graph.steps if step.kind == "graphics"]

    def _copied(
        self, nodes: Sequence[Node], size: tuple[int, int]
    ) -> tuple[dict[str, str], Node, dict[str, External]]:
        """Return the outputs that there are, and the step that hands them on, with the buffers that it fills."""
        wiring = connect(nodes, self.read_from | {f"for {name}": name for name in self._handed_on}, {})
        missing = set(wiring.missing)
        there = {output: name for output, name in self.read_from.items() if output not in missing}
        names = sorted({name for name in self._handed_on if f"for {name}" not in missing})
        made = {access.resource: access for node in nodes for access in node.writes}
        externals = {}
        for output in there:
            access = made[wiring.outputs[output]]
            while access.of:
                access = made[access.of]
            width, height = access.size or (round(size[0] * access.scale), round(size[1] * access.scale))
            texel = bytes_of(access.format or "rgba8")
            externals[on_cpu(output)] = External(None, None, _HOST_IDLE, _HOST_READS, width * height * texel)
        copy = Node(
            COPY,
            tuple(Access(name, "copy") for name in names),
            tuple(Access(name, "copy", bytes=held.bytes) for name, held in externals.items()),
        )
        return there, copy, externals

    def where(self, error: GraphError) -> GraphError:
        """Return the error with the place in the file of the first pass that it names."""
        for name in self._file.passes:
            if f"'{name}'" in str(error) and str(self._file.path) not in str(error):
                return GraphError(f"{self._file.where(name)}: {error}")
        return error


def on_cpu(output: str) -> str:
    """Return what the buffer is called into which an output is copied."""
    return f"{output} on the CPU"


def _reconnected(node: Node, names: Mapping[str, str]) -> Node:
    """Return a node that reads other names."""
    if not names:
        return node
    reads = tuple(
        replace(access, resource=names.get(access.resource, access.resource)) for access in node.reads
    )
    writes = tuple(replace(access, of=names.get(access.of, access.of)) for access in node.writes)
    return replace(node, reads=reads, writes=writes)


def _why_not(made: Any, scene: Any, settings: Any) -> str:
    return "" if made.needed(scene, settings) else "the scene and the settings give it nothing to do"


_HOST_IDLE = Touch("", frozenset(), frozenset())
"""The slot's fence was waited for: nobody uses the buffer any more."""
_HOST_READS = Touch("", frozenset({"host"}), frozenset({"host_read"}))
