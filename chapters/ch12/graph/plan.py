"""The plan of a frame: the passes of a graph file, with changes while frames are drawn, and the compiled graph.

    plan = FramePlan(file, passes, outputs, handed_on, formats)
    plan.switch("depth_of_field", False)
    graph = plan.compile(size, scene, settings, memory.requirement)

The plan is independent of the backend: the same file gives the same passes on both.
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

from ..culling.choice import overlay_of
from ..frames.frame import OUTPUTS
from ..rates.model import wanted as has_rates
from ..shading.deferred import EMISSION, emits
from ..shading.views import PICTURE
from ..ssao.model import wanted as occludes
from ..taa.scale import drawn_size, enlarged
from ..visibility.model import RESOLVE
from ..visibility.model import in_use as numbers
from .checks import check_finish, check_name, check_output, check_pass, check_readers
from .file import GraphFile
from .frame_graph import bytes_of, compile_graph
from .names import connect
from .sync.queues import GRAPHICS
from .types import External, Graph, GraphError, Node, Requirements, Touch

COPY = "copy outputs"
"""The step that copies outputs to the CPU and brings the picture into the layout for a window's copy."""

OFF = "switched off"


def graph_name(settings: Any) -> str:
    """Return the name of the graph that the settings select; "auto" is deferred, or forward with multisampling.

    With shading rates "auto" is compute; where the device lights by them, rates/native.py has replaced it.
    A view always needs forward: it shows a quantity of each surface while the surface is drawn. Multisampling needs
    forward because a G-buffer holds one surface per pixel.
    """
    if settings.shading.view != PICTURE or (settings.graph.name == "auto" and settings.shading.msaa > 1):
        return "forward"
    if overlay_of(settings) != "off":  # drawn over the forward pass
        return "forward"
    if settings.graph.name != "auto":
        return str(settings.graph.name)
    return "compute" if has_rates(settings) else "deferred"


def check_samples(file: GraphFile, settings: Any) -> None:
    """Raise UserError for a graph with a G-buffer with several samples a pixel, or without one if settings need it."""
    if "gbuffer" in file.passes.values() and settings.shading.msaa > 1:
        raise UserError(
            f"{file.path.name} has a G-buffer, which holds one sample a pixel: set msaa=1, or graph=forward."
        )
    if occludes(settings) and "ssao" not in file.passes.values():
        raise UserError(
            f"{file.path.name} lights objects while their depth is drawn, and ssao={settings.ssao.mode} needs the "
            "depth of all before: set graph=deferred and msaa=1, or ssao=off."
        )
    if (
        numbers(settings)
        and overlay_of(settings) == "off"
        and not {"gbuffer", RESOLVE} & {*file.passes.values()}
    ):
        raise UserError(
            f"{file.path.name} has no G-buffer, and surfaces={settings.visibility.surfaces} fills one: set "
            "graph=deferred or compute, or surfaces=gbuffer."
        )
    check_finish(file, settings)


@dataclass(frozen=True)
class Declared:
    """The declarations of a pass, as a graph file needs them."""

    name: str
    reads: tuple[Access, ...]
    writes: tuple[Access, ...]
    why_not: str
    queue: str


class FramePlan:
    """The passes of a frame, and the graph that follows from them.

    `passes` are the passes of the chapter by name, before `create`. `outputs` has for each output the name that it is
    read from; `handed_on` are the names that are copied after the frame.
    """

    def __init__(
        self,
        file: GraphFile,
        passes: Mapping[str, Pass],
        outputs: Mapping[str, str],
        handed_on: Collection[str],
        formats: Collection[str],
    ) -> None:
        self._formats, self._requested = formats, (dict(outputs), frozenset(handed_on))
        self._off: dict[str, str] = {}
        self._on: set[str] = set()  # passes that the file switches off and a user switches on
        self._inserted: dict[str, Pass] = {}
        self._swapped: dict[str, Pass] = {}
        self._readers: dict[str, Mapping[str, Mapping[str, str]]] = {}
        self.nodes: dict[str, Node] = {}
        """The nodes of the last compilation, by the names of their steps."""
        self.shown = ""
        """The name of the inspected resource, which shares no memory."""
        self.keeps_all = False
        self.kept: set[str] = set()
        self.externals: dict[str, External] = {}
        """The externals of the last compilation."""
        self.passes = dict(passes)
        self.follow(file)

    def follow(self, file: GraphFile) -> None:
        """Use another graph file; insertions, swaps and switched-off passes stay."""
        outputs, handed_on = self._requested
        self.file, self.title = file, file.title
        self._on.clear()
        self.read_from, self._handed_on = {**outputs}, {*handed_on}
        for output, name in file.outputs.items():
            if output in outputs:
                self._handed_on.discard(outputs[output])
                self._handed_on.add(name)
                self.read_from[output] = name

    # --- changes while frames are drawn ---

    @contextmanager
    def changing(self) -> Iterator[None]:
        """Change the plan inside a `with` block; after an exception the plan is as before."""
        before = {name: shallow(value) for name, value in vars(self).items()}
        try:
            yield
        except BaseException:
            vars(self).update(before)
            raise

    @property
    def switches(self) -> dict[str, bool]:
        """For each pass of the file and each inserted pass: whether it is switched on."""
        off = self._off.keys() | (self.file.off - self._on)
        return {name: name not in off for name in (*self.file.passes, *self._inserted)}

    def switch(self, name: str, on: bool) -> None:
        """Switch a pass on or off; raise GraphError for an unknown name."""
        check_name(name, self.switches)
        self._off.pop(name, None)
        self._on.discard(name)
        if on:
            self._on.add(name)
        else:
            self._off[name] = OFF

    def insert(self, pass_: Pass, readers: Mapping[str, Mapping[str, str]] | None = None) -> None:
        """Add a pass that the file does not name; its reads and writes decide its place.

        `readers` has, for passes that read another name from now on, the new name by the old one:
        {"tonemap": {"color_focused": "color_sharp"}}.
        """
        check_pass(pass_, self._formats)
        if pass_.name in self.switches:
            raise GraphError(f"There is a pass '{pass_.name}' already: give the new one another name.")
        check_readers(readers or {}, self.switches)
        self._inserted[pass_.name] = pass_
        self._readers[pass_.name] = readers or {}

    def remove(self, name: str) -> None:
        """Remove an inserted pass; its readers read their former names again."""
        check_name(name, self.switches)
        if name not in self._inserted:
            raise GraphError(f"No pass '{name}' was inserted: what is the file's own is switched off.")
        del self._inserted[name], self._readers[name]
        self._swapped.pop(name, None)

    def implementations(self) -> dict[str, Pass]:
        """Return the pass that executes each step, by the name of the step."""
        own = {name: self.passes[of] for name, of in self.file.passes.items()} | self._inserted
        return own | {name: pass_ for name, pass_ in self._swapped.items() if name in own}

    def swap(self, name: str, pass_: Pass) -> None:
        """Let another pass draw in place of pass `name`. It must declare the same reads and writes."""
        check_name(name, self.switches)
        check_pass(pass_, self._formats)
        self._declare(pass_)
        now = self.implementations()[name]
        for what in ("reads", "writes"):
            old, new = (each.reads if what == "reads" else each.writes for each in (now, pass_))
            if old != new:
                declared = [", ".join(access.resource for access in each) for each in (old, new)]
                was, now_ = (text or "nothing" for text in declared)
                other = f"not {now_}" if was != now_ else "in the same way"
                raise GraphError(f"What takes the place of '{name}' has to {what[:-1]} {was}, {other}.")
        self._swapped[name] = pass_

    # --- compilation ---

    def needs(self, scene: Any, settings: Any) -> dict[str, bool]:
        """Return for each pass whether the scene and the settings need it, and whether the scene has emission."""
        needs = {
            name: pass_.needed(scene, settings) for name, pass_ in (self.passes | self._inserted).items()
        }
        return needs | {EMISSION: emits(scene, settings)}

    def compile(
        self,
        size: tuple[int, int],
        scene: Any,
        settings: Any,
        requirements: Requirements | None = None,
        alias: bool = True,
        queues: Collection[str] = (GRAPHICS,),
    ) -> Graph:
        """Compile the frame for a picture of `size` pixels; sets `nodes`."""
        self._queues = queues
        try:
            nodes, graph = self._compile(size, scene, settings, requirements, alias)
        except GraphError as error:
            raise self._where(error) from None
        self.nodes = {node.name: node for node in nodes}
        return graph

    def _compile(
        self, size: tuple[int, int], scene: Any, settings: Any, requirements: Requirements | None, alias: bool
    ) -> tuple[list[Node], Graph]:
        for pass_ in (*self.passes.values(), *self._inserted.values(), *self._swapped.values()):
            self._declare(pass_)
        off = {*self.file.passes.values()} - self._beside
        declared = {
            name: Declared(
                name,
                pass_.reads,
                pass_.writes,
                OFF if name in off else _why_not(pass_, scene, settings),
                pass_.queue,
            )
            for name, pass_ in self.passes.items()
        }
        written = {access.resource for pass_ in self.passes.values() for access in pass_.writes}
        external = {name for pass_ in self.passes.values() for name in pass_.externals} - written
        nodes = self.file.nodes(declared, self._formats, external, OUTPUTS, self._on)
        nodes += [
            Node(pass_.name, pass_.reads, pass_.writes, _why_not(pass_, scene, settings), pass_.queue)
            for pass_ in self._inserted.values()
        ]
        for readers in self._readers.values():
            nodes = [_reconnected(node, readers.get(node.name, {})) for node in nodes]
        nodes = [replace(node, why_not=self._off.get(node.name, node.why_not)) for node in nodes]
        self.externals = {name: it for pass_ in self.passes.values() for name, it in pass_.externals.items()}
        nodes = enlarged(nodes, settings, size)
        outputs, copy, externals = self._copied(nodes, size)
        externals |= self.externals
        if copy.reads:  # else the frame has no output
            nodes.append(copy)
        kept = {a.resource for node in nodes for a in node.writes} if self.keeps_all else {self.shown}
        drawn = drawn_size(settings, size)
        graph = compile_graph(
            nodes, drawn, outputs, externals, requirements, alias, kept, queues=self._queues
        )
        self.kept, self.externals = kept, externals
        return nodes, graph

    def _declare(self, pass_: Pass) -> None:
        """Let a pass bring its reads and writes up to date, and tell it which passes are switched on."""
        pass_.beside = self._beside
        pass_.declare()

    @property
    def _beside(self) -> frozenset[str]:
        passes = self.file.passes  # made anew at each call
        return frozenset(passes.get(name, name) for name, on in self.switches.items() if on)

    def watched(self, graph: Graph) -> list[Any]:
        """Return the passes that write an inspected image, in the order of the frame (see `Inspection`)."""
        nodes = []
        for step in graph.steps:
            writes = self.nodes[step.name].writes if step.kind != "copy" else ()
            writes = tuple(it for it in writes if not graph.resources[graph.names[it.resource]].bytes)
            writes = tuple(access for access in writes if self.keeps_all or access.resource == self.shown)
            if writes:
                nodes.append(replace(self.nodes[step.name], writes=writes))
        return nodes

    def drawn(self, graph: Graph) -> list[Node]:
        """Return the passes of a frame in their order; reads of a pass that is left out are rerouted."""
        instead = {
            access.resource: access.instead or access.of
            for name in graph.left_out
            for access in self.nodes[name].writes
        }
        for step in graph.steps:
            for access in self.nodes[step.name].writes if step.name != COPY else ():
                instead.pop(access.resource, None)

        def rerouted(access: Access) -> Access:
            name = access.resource
            while instead.get(name):
                name = instead[name]
            return replace(access, resource=name)

        nodes = (self.nodes[step.name] for step in graph.steps if step.name != COPY)
        return [replace(node, reads=tuple(map(rerouted, node.reads))) for node in nodes]

    def _copied(
        self, nodes: Sequence[Node], size: tuple[int, int]
    ) -> tuple[dict[str, str], Node, dict[str, External]]:
        """Return the available outputs, the step that copies them, and the buffers that it fills."""
        needed_last = sorted(
            nodes, key=lambda node: not node.why_not
        )  # a needed pass overrides a pass that is left out
        written_by = {access.resource: access for node in needed_last for access in node.writes}
        requested = self.read_from | {f"for {name}": name for name in self._handed_on}
        if self.keeps_all:  # an inspection of all images allows missing outputs
            requested = {output: name for output, name in requested.items() if name in written_by}
        wiring = connect(nodes, requested, self.externals)
        for output in () if self.keeps_all else wiring.missing:
            self._check_missing(requested[output], nodes)
        outputs = {output: name for output, name in self.read_from.items() if output in wiring.outputs}
        names = sorted({name for name in self._handed_on if f"for {name}" in wiring.outputs})
        externals = {}
        for output in outputs:
            access = written_by[wiring.outputs[output]]
            while access.of:
                access = written_by[access.of]
            check_output(output, self.read_from[output], access, size)
            width, height = size
            texel = bytes_of(access.format or "rgba8")
            externals[on_cpu(output)] = External(None, None, _HOST_IDLE, _HOST_READS, width * height * texel)
        copy = Node(
            COPY,
            tuple(Access(name, "copy") for name in names),
            tuple(Access(name, "copy", bytes=external.bytes) for name, external in externals.items()),
        )
        return outputs, copy, externals

    def _check_missing(self, name: str, nodes: Sequence[Node]) -> None:
        """Raise GraphError if the writer of an output is switched off; otherwise the output is only unavailable."""
        for node in nodes:
            if name in {access.resource for access in node.writes} and not self.switches[node.name]:
                raise GraphError(f"No pass would write the output '{name}': '{node.name}' is {node.why_not}.")

    def _where(self, error: GraphError) -> GraphError:
        """Return the error with the line of the first pass that it names, in the graph file."""
        for name in self.file.passes:
            if f"'{name}'" in str(error) and self.file.shown not in str(error):
                return GraphError(f"{self.file.where(name)}: {error}")
        return (
            error
            if self._inserted or self.file.shown in str(error)
            else GraphError(f"{self.file.shown}: {error}")
        )


def on_cpu(output: str) -> str:
    """Return the name of the buffer that an output is copied to."""
    return f"{output} on the CPU"


def _reconnected(node: Node, names: Mapping[str, str]) -> Node:
    """Return a node that reads other names; raise GraphError for a name that it does not read."""
    if not names:
        return node
    known = [
        name for access_ in (*node.reads, *node.writes) for name in (access_.resource, access_.of) if name
    ]
    for name in names:
        if name not in known:
            raise GraphError(f"'{node.name}' reads nothing called '{name}'{suggest(name, known)}")
    reads = tuple(
        replace(access, resource=names.get(access.resource, access.resource)) for access in node.reads
    )
    writes = tuple(replace(access, of=names.get(access.of, access.of)) for access in node.writes)
    return replace(node, reads=reads, writes=writes)


def _why_not(pass_: Pass, scene: Any, settings: Any) -> str:
    return "" if pass_.needed(scene, settings) else "the scene and the settings give it nothing to do"


_HOST_IDLE = Touch("", frozenset(), frozenset())
"""The CPU has waited for the slot: the buffer is unused."""
_HOST_READS = Touch("", frozenset({"host"}), frozenset({"host_read"}))
