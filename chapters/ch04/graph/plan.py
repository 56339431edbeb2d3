"""Which passes make a frame: those that a graph file names, less what the scene does not need and what is switched off.

    plan = FramePlan(file, passes, outputs, handed_on, formats)
    plan.switch("depth_of_field", False)
    graph = plan.compile(size, scene, settings, memory.requirement)

The plan belongs to no backend: either one's passes declare the same, so the same file gives the same graph.
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from contextlib import contextmanager
from copy import copy as shallow
from dataclasses import dataclass, replace
from typing import Any

from backends.contract import Access, Pass
from common.errors import UserError
from common.names import suggest

from ..frames.frame import OUTPUTS
from ..shading.views import PICTURE
from .checks import check_name, check_output, check_pass, check_readers
from .file import GraphFile
from .frame_graph import bytes_of, compile_graph
from .names import connect
from .types import External, Graph, GraphError, Node, Requirements, Touch

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
        passes: Mapping[str, Pass],
        outputs: Mapping[str, str],
        handed_on: Collection[str],
        formats: Collection[str],
    ) -> None:
        self._formats, self._asked = formats, (dict(outputs), frozenset(handed_on))
        self._off: dict[str, str] = {}
        self._on: set[str] = set()  # although the file switches them off
        self._inserted: dict[str, Pass] = {}
        self._swapped: dict[str, Pass] = {}
        self._readers: dict[str, Mapping[str, Mapping[str, str]]] = {}
        self.nodes: dict[str, Node] = {}
        """The passes as they were compiled last, by the names of their steps."""
        self.shown = ""
        """A name that is looked at: it shares memory with nobody."""
        self.keeps_all = False
        self.kept: set[str] = set()
        self.externals: dict[str, External] = {}
        """What they were compiled with."""
        self.passes = dict(passes)
        self.follow(file)

    def follow(self, file: GraphFile) -> None:
        """Have `file` describe the frame from now on; what was inserted, swapped and switched off stays so."""
        outputs, handed_on = self._asked
        self.file, self.title = file, file.title
        self._on.clear()
        self.read_from, self._handed_on = {**outputs}, {*handed_on}
        for output, name in file.outputs.items():
            if output in outputs:
                self._handed_on.discard(outputs[output])
                self._handed_on.add(name)
                self.read_from[output] = name

    # --- what can be changed while frames are drawn ---

    @contextmanager
    def changing(self) -> Iterator[None]:
        """Within, the plan may be changed; an exception leaves it as it was before."""
        before = {name: shallow(value) for name, value in vars(self).items()}
        try:
            yield
        except BaseException:
            vars(self).update(before)
            raise

    @property
    def switches(self) -> dict[str, bool]:
        """Each pass of the file and what was inserted, and whether it is switched on."""
        off = self._off.keys() | (self.file.off - self._on)
        return {name: name not in off for name in (*self.file.passes, *self._inserted)}

    def switch(self, name: str, on: bool) -> None:
        """Switch a pass on or off; GraphError where there is none of this name."""
        check_name(name, self.switches)
        self._off.pop(name, None)
        self._on.discard(name)
        if on:
            self._on.add(name)
        else:
            self._off[name] = OFF

    def insert(self, made: Pass, readers: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Add a pass that the file does not name; where it runs follows from what it reads and writes.

        `readers` says, by the names of the graph, which passes read something else from now on:
        {"tonemap": {"color_focused": "color_sharp"}}.
        """
        check_pass(made, self._formats)
        if made.name in self.switches:
            raise GraphError(f"There is a pass '{made.name}' already: give the new one another name.")
        check_readers(readers or {}, self.switches)
        self._inserted[made.name] = made
        self._readers[made.name] = readers or {}

    def remove(self, name: str) -> None:
        """Take out a pass that was inserted, and connect those that read it as they were."""
        check_name(name, self.switches)
        if name not in self._inserted:
            raise GraphError(f"No pass '{name}' was inserted: what is the file's own is switched off.")
        del self._inserted[name], self._readers[name]
        self._swapped.pop(name, None)

    def implementations(self) -> dict[str, Pass]:
        """Return what draws, by the names of the steps."""
        own = {name: self.passes[of] for name, of in self.file.passes.items()} | self._inserted
        return own | {name: made for name, made in self._swapped.items() if name in own}

    def swap(self, name: str, made: Pass) -> None:
        """Let `made` draw in place of pass `name`; it declares the same, and whether it is needed stays as it is."""
        check_name(name, self.switches)
        check_pass(made, self._formats)
        now = self.implementations()[name]
        for what in ("reads", "writes"):
            old, new = (each.reads if what == "reads" else each.writes for each in (now, made))
            if old != new:
                declared = [", ".join(one.resource for one in each) for each in (old, new)]
                was, now_ = (text or "nothing" for text in declared)
                other = f"not {now_}" if was != now_ else "in the same way"
                raise GraphError(f"What takes the place of '{name}' has to {what[:-1]} {was}, {other}.")
        self._swapped[name] = made

    # --- compiled ---

    def needs(self, scene: Any, settings: Any) -> dict[str, bool]:
        """Return whether the scene and the settings give each pass anything to do."""
        return {name: made.needed(scene, settings) for name, made in (self.passes | self._inserted).items()}

    def compile(
        self,
        size: tuple[int, int],
        scene: Any,
        settings: Any,
        requirements: Requirements | None = None,
        alias: bool = True,
    ) -> Graph:
        """Compile the frame for a picture of `size` pixels; `nodes` are then those of its steps."""
        try:
            nodes, graph = self._compile(size, scene, settings, requirements, alias)
        except GraphError as error:
            raise self._where(error) from None
        self.nodes = {node.name: node for node in nodes}
        return graph

    def _compile(
        self, size: tuple[int, int], scene: Any, settings: Any, requirements: Requirements | None, alias: bool
    ) -> tuple[list[Node], Graph]:
        declared = {
            name: Declared(name, made.reads, made.writes, _why_not(made, scene, settings))
            for name, made in self.passes.items()
        }
        nodes = self.file.nodes(declared, self._formats, outputs=OUTPUTS, on=self._on)
        nodes += [
            Node(made.name, made.reads, made.writes, _why_not(made, scene, settings))
            for made in self._inserted.values()
        ]
        for readers in self._readers.values():
            nodes = [_reconnected(node, readers.get(node.name, {})) for node in nodes]
        nodes = [replace(node, why_not=self._off.get(node.name, node.why_not)) for node in nodes]
        there, copy, externals = self._copied(nodes, size)
        if copy.reads:  # else nobody wants anything of this frame
            nodes.append(copy)
        kept = {a.resource for node in nodes for a in node.writes} if self.keeps_all else {self.shown}
        graph = compile_graph(nodes, size, there, externals, requirements, alias, kept)
        self.kept, self.externals = kept, externals
        return nodes, graph

    def watched(self, graph: Graph) -> list[Any]:
        """Return the passes that write what is looked at, in the order of the frame (see `Inspection`)."""
        found = []
        for step in graph.steps:
            writes = self.nodes[step.name].writes if step.kind == "graphics" else ()
            writes = tuple(one for one in writes if self.keeps_all or one.resource == self.shown)
            if writes:
                found.append(replace(self.nodes[step.name], writes=writes))
        return found

    def drawn(self, graph: Graph) -> list[Node]:
        """Return the passes of a frame in their order; who reads a pass that is left out reads what he gets instead."""
        instead = {
            access.resource: access.instead or access.of
            for name in graph.left_out
            for access in self.nodes[name].writes
        }

        def there(access: Access) -> Access:
            name = access.resource
            while instead.get(name):
                name = instead[name]
            return replace(access, resource=name)

        nodes = (self.nodes[step.name] for step in graph.steps if step.name != COPY)
        return [replace(node, reads=tuple(map(there, node.reads))) for node in nodes]

    def _copied(
        self, nodes: Sequence[Node], size: tuple[int, int]
    ) -> tuple[dict[str, str], Node, dict[str, External]]:
        """Return the outputs that there are, and the step that hands them on, with the buffers that it fills."""
        wanted_last = sorted(
            nodes, key=lambda node: not node.why_not
        )  # who is left out says nothing of a name
        made = {access.resource: access for node in wanted_last for access in node.writes}
        asked = self.read_from | {f"for {name}": name for name in self._handed_on}
        if self.keeps_all:  # whoever looks at everything takes what there is
            asked = {output: name for output, name in asked.items() if name in made}
        wiring = connect(nodes, asked, {})
        for output in () if self.keeps_all else wiring.missing:
            self._check_missing(asked[output], nodes)
        there = {output: name for output, name in self.read_from.items() if output in wiring.outputs}
        names = sorted({name for name in self._handed_on if f"for {name}" in wiring.outputs})
        externals = {}
        for output in there:
            access = made[wiring.outputs[output]]
            while access.of:
                access = made[access.of]
            check_output(output, self.read_from[output], access, size)
            width, height = size
            texel = bytes_of(access.format or "rgba8")
            externals[on_cpu(output)] = External(None, None, _HOST_IDLE, _HOST_READS, width * height * texel)
        copy = Node(
            COPY,
            tuple(Access(name, "copy") for name in names),
            tuple(Access(name, "copy", bytes=held.bytes) for name, held in externals.items()),
        )
        return there, copy, externals

    def _check_missing(self, name: str, nodes: Sequence[Node]) -> None:
        """Raise GraphError where somebody switched off what writes an output; else it just has nothing to show."""
        for node in nodes:
            if name in {access.resource for access in node.writes} and not self.switches[node.name]:
                raise GraphError(
                    f"Nobody would write '{name}', which is asked for: '{node.name}' is {node.why_not}."
                )

    def _where(self, error: GraphError) -> GraphError:
        """Return the error with the place in the file of the first pass that it names."""
        for name in self.file.passes:
            if f"'{name}'" in str(error) and self.file.shown not in str(error):
                return GraphError(f"{self.file.where(name)}: {error}")
        return (
            error
            if self._inserted or self.file.shown in str(error)
            else GraphError(f"{self.file.shown}: {error}")
        )


def on_cpu(output: str) -> str:
    """Return what the buffer is called into which an output is copied."""
    return f"{output} on the CPU"


def _reconnected(node: Node, names: Mapping[str, str]) -> Node:
    """Return a node that reads other names; GraphError where it does not read one of them."""
    if not names:
        return node
    known = [name for one in (*node.reads, *node.writes) for name in (one.resource, one.of) if name]
    for name in names:
        if name not in known:
            raise GraphError(f"'{node.name}' reads nothing called '{name}'{suggest(name, known)}")
    reads = tuple(
        replace(access, resource=names.get(access.resource, access.resource)) for access in node.reads
    )
    writes = tuple(replace(access, of=names.get(access.of, access.of)) for access in node.writes)
    return replace(node, reads=reads, writes=writes)


def _why_not(made: Pass, scene: Any, settings: Any) -> str:
    return "" if made.needed(scene, settings) else "the scene and the settings give it nothing to do"


_HOST_IDLE = Touch("", frozenset(), frozenset())
"""The slot's fence was waited for: nobody uses the buffer any more."""
_HOST_READS = Touch("", frozenset({"host"}), frozenset({"host_read"}))
