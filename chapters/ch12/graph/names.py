"""Edges of the frame graph from the names that passes read and write; passes without effect are left out.

Every name has one writer. A pass that is left out (the scene does not need it, or it is switched off) writes nothing;
its readers then read the name in `Access.instead`. Edges follow from the names alone: the order in which passes are
declared does not matter.

    depth_prepass -> depth -> gbuffer -> ... -> lighting -> color_lit
                                   transparent continues color_lit as color_hdr -> tonemap -> color
"""

from __future__ import annotations

from collections.abc import Collection, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace

from common.names import suggest

from .types import Edge, External, GraphError, Node


@dataclass(frozen=True)
class Wiring:
    """The passes of the frame, sorted by name, and the edges between them.

    `roots` has for each name the first name of the same resource; `outputs` has the name of each available output.
    """

    nodes: tuple[Node, ...]
    edges: tuple[Edge, ...]
    roots: Mapping[str, str]
    outputs: Mapping[str, str]
    names: Mapping[str, str]
    left_out: Mapping[str, str]
    missing: tuple[str, ...]


def connect(
    nodes: Sequence[Node],
    outputs: Mapping[str, str],
    externals: Mapping[str, External],
    keep: Collection[str] = (),
) -> Wiring:
    """Find the writer of each name that is read, and leave out the passes that no output needs.

    Raises GraphError with the names of the passes if a name has no writer or two, or if passes form a cycle.
    """
    return _Connector(nodes, externals).connect(outputs, keep)


def inputs(node: Node) -> Iterator[str]:
    """Yield the names of this frame that a node reads: its declared reads, and the names that it continues."""
    yield from (access.resource for access in node.reads if not access.previous)
    yield from (access.of for access in node.writes if access.of)


class _Connector:
    def __init__(self, nodes: Sequence[Node], externals: Mapping[str, External]) -> None:
        self._externals = externals
        self._nodes: dict[str, Node] = {}
        self._writer: dict[str, str] = {}
        self._left_out: dict[str, str] = {}
        self._instead: dict[
            str, tuple[str, str]
        ] = {}  # name: (its writer, which is left out; the name in its place)
        self._absent: dict[str, list[str]] = {}  # name: all passes that would write it
        for node in sorted(nodes, key=lambda node: node.name):
            if node.name in self._nodes or node.name in self._left_out:
                raise GraphError(f"Two passes are called '{node.name}': give one of them another name.")
            if node.why_not:
                self._left_out[node.name] = node.why_not
                for access in node.writes:
                    self._absent.setdefault(access.resource, []).append(node.name)
                    replacement = access.instead or access.of
                    if replacement or access.resource not in self._instead:
                        self._instead[access.resource] = (node.name, replacement)
                continue
            self._nodes[node.name] = node
            for access in node.writes:
                other = self._writer.setdefault(access.resource, node.name)
                if other != node.name:
                    raise GraphError(
                        f"'{other}' and '{node.name}' both write '{access.resource}': one has to write another name."
                    )

    def connect(self, outputs: Mapping[str, str], keep: Collection[str]) -> Wiring:
        resolved = {output: self._resolve(name, f"output '{output}'") for output, name in outputs.items()}
        self._nodes = {name: self._resolved(node) for name, node in self._nodes.items()}
        live = self._live({name for name in resolved.values() if name})
        for name in self._nodes.keys() - live:
            self._left_out[name] = "no pass reads what it writes"
        nodes = tuple(node for name, node in self._nodes.items() if name in live)
        edges = tuple(self._edges(nodes))
        roots = self._roots(nodes)
        names = {name: roots[name] for name in roots}
        for name in self._instead:
            other = self._resolve(name, f"A reader of '{name}'")
            if other in roots:
                names.setdefault(name, roots[other])
        return Wiring(
            nodes,
            edges,
            roots,
            {output: name for output, name in resolved.items() if name in roots},
            names,
            dict(sorted(self._left_out.items())),
            tuple(output for output, name in resolved.items() if name not in roots),
        )

    # --- names ---

    def _resolve(self, name: str, reader: str) -> str:
        """Return the name that a reader of `name` reads; "" if the writer is left out without a replacement."""
        seen: list[str] = []
        while name not in self._writer and name not in self._externals:
            if name not in self._instead:
                known = [*self._writer, *self._externals, *self._instead]
                near = suggest(name, known)
                raise GraphError(
                    f"{reader} reads '{name}', which no pass writes{near}"
                    + ("" if near.endswith("?") else ".")
                )
            if name in seen:
                raise GraphError(
                    f"Of {', '.join(map(repr, seen))} each stands for the next, and none is written."
                )
            seen.append(name)
            name = self._instead[name][1]
            if not name:
                return ""
        return name

    def _resolved(self, node: Node) -> Node:
        """Return the node with replaced names; a lost name stays, and is an error only if the frame needs the node."""
        quoted = f"'{node.name}'"
        resolved = node
        if any(access.resource not in self._writer for access in node.reads):
            reads = (replace(a, resource=self._resolve(a.resource, quoted) or a.resource) for a in node.reads)
            resolved = replace(resolved, reads=tuple(reads))
        if any(access.of and access.of not in self._writer for access in node.writes):
            writes = (replace(a, of=a.of and (self._resolve(a.of, quoted) or a.of)) for a in node.writes)
            resolved = replace(resolved, writes=tuple(writes))
        for name in inputs(resolved):
            if self._writer.get(name) == node.name:
                raise GraphError(f"{quoted} reads '{name}', which it writes itself.")
        return resolved

    # --- needed passes ---

    def _live(self, outputs: Collection[str]) -> set[str]:
        """Return the passes that an output, an external or the next frame needs."""
        roots = self._roots([*self._nodes.values()]) if self._externals else {}
        waiting = [self._writer[name] for name in sorted(outputs) if name in self._writer]
        waiting += [node.name for node in self._nodes.values() if not node.writes]
        waiting += [
            node.name
            for node in self._nodes.values()
            for access in node.writes
            if roots.get(access.resource) in self._externals
        ]
        live: set[str] = set()
        while waiting:
            name = waiting.pop()
            if name in live:
                continue
            live.add(name)
            node = self._nodes[name]
            # A history adds no edge within the frame, but its writer has to run in every frame.
            for read in (*inputs(node), *(access.resource for access in node.reads if access.previous)):
                writer = self._writer.get(read)
                if writer is not None:
                    waiting.append(writer)
                elif read not in self._externals:
                    raise GraphError(self._lost(node, read))
        return live

    def _lost(self, node: Node, name: str) -> str:
        absent = name
        while self._instead[absent][1] in self._instead:
            absent = self._instead[absent][1]
        writers = " and ".join(
            f"'{writer}' is left out ({self._left_out[writer]})" for writer in self._absent[absent]
        )
        return f"'{node.name}' reads '{name}', which no pass writes: {writers}, with nothing in its place."

    # --- edges ---

    def _edges(self, nodes: Sequence[Node]) -> Iterator[Edge]:
        readers: dict[str, list[str]] = {}
        continued_by: dict[str, str] = {}
        for node in nodes:
            for name in dict.fromkeys(inputs(node)):
                readers.setdefault(name, []).append(node.name)
                if name in self._writer:
                    yield Edge(self._writer[name], node.name, name, "reads")
            for access in node.writes:
                if access.of:
                    other = continued_by.setdefault(access.of, node.name)
                    if other != node.name:
                        raise GraphError(
                            f"'{other}' and '{node.name}' both go on with '{access.of}': one has to go on with "
                            "what the other writes."
                        )
        # Readers of the old contents run before the pass that overwrites it.
        for name, writer in continued_by.items():
            for reader in readers[name]:
                if reader != writer:
                    yield Edge(reader, writer, name, "replaces")
        for node in nodes:
            for access in node.reads:
                if access.previous and access.resource in continued_by:
                    raise GraphError(
                        f"'{node.name}' reads what the frame before left in '{access.resource}', but "
                        f"'{continued_by[access.resource]}' writes over it: read its name for it."
                    )

    def _roots(self, nodes: Sequence[Node]) -> dict[str, str]:
        """Return for each name of these nodes the first name of the same resource."""
        before = {access.resource: access.of for node in nodes for access in node.writes}
        touched = [name for node in nodes for name in inputs(node)]
        touched += [access.resource for node in nodes for access in (*node.reads, *node.writes)]
        roots: dict[str, str] = {}
        for name in touched:
            chain: dict[str, None] = {}
            while name not in roots and before.get(name) and name not in chain:
                chain[name] = None
                name = before[name]
            roots.update(dict.fromkeys((*chain, name), roots.get(name, name)))
        return roots
