"""Graph files: JSON that selects passes, connects them, and sets formats and sizes.

    {
      "title": "Deferred, with half a picture of blur",
      "passes": [
        {"pass": "gbuffer"},
        {"pass": "lighting", "format": {"color_lit": "rgba16f"}},
        {"pass": "bokeh", "scale": {"dof_blurred": 0.5}},
        {"pass": "tonemap", "name": "second", "reads": {"color_hdr": "color_lit"}, "writes": {"color": "other"},
         "enabled": false},
        {"pass": "blur", "queue": "compute"}
      ],
      "outputs": {"color_linear": "color_lit"}
    }

Declarations of passes are not repeated. Every key of `reads`, `writes`, `format`, `scale` and `size` is a name that the
pass declares; the values of `reads` and `writes` are the names in this graph. `scale` is relative to the picture,
`size` [width, height] in pixels. `queue` is "compute" for a pass that may run beside others, if the device has a
compute queue. The second use of a pass needs a `name` of its own.

Errors are `GraphError`s of one sentence that begins with file:line:column. The compiler finds errors of the whole
graph, such as a cycle; `GraphFile.where` returns the place of a pass.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Iterator, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Protocol

from backends.contract import Access
from common.files import shader_files
from common.names import suggest
from common.paths import ROOT

from .fields import Field
from .json_places import JsonError, brief, line_and_column, parse
from .sync.queues import check_word, moved
from .types import GraphError, Node

GRAPHS = Path(__file__).parent
"""The folder of the chapter's graphs."""

MAX_BYTES = 1 << 20
"""The largest file in bytes; thousands of passes take less."""


class Declared(Protocol):
    """The declarations of a pass that a file needs; `why_not` is the reason to leave the pass out, or ""."""

    @property
    def name(self) -> str: ...
    @property
    def reads(self) -> tuple[Access, ...]: ...
    @property
    def writes(self) -> tuple[Access, ...]: ...
    @property
    def queue(self) -> str: ...
    @property
    def why_not(self) -> str: ...


@dataclass(frozen=True)
class Use:
    """One entry of `passes`. Its keys are the names that the pass declares."""

    entry: Field
    of: Field
    name: str
    enabled: Field | None
    reads: Mapping[str, Field]
    writes: Mapping[str, Field]
    format: Mapping[str, Field]
    scale: Mapping[str, Field]
    size: Mapping[str, Field]
    queue: Field | None = None


@dataclass(frozen=True)
class GraphFile:
    """The contents of a graph file, checked as far as possible without its passes."""

    path: Path
    title: str
    uses: tuple[Use, ...]
    connected: Mapping[str, Field]

    @property
    def outputs(self) -> dict[str, str]:
        """The name of each output that the file connects."""
        return {output: field.word() for output, field in self.connected.items()}

    @property
    def passes(self) -> dict[str, str]:
        """The pass of each node; it differs from the node's name if the entry has a `name`."""
        return {use.name: use.of.word() for use in self.uses}

    @property
    def off(self) -> frozenset[str]:
        """The nodes that the file switches off."""
        return frozenset(use.name for use in self.uses if use.enabled is not None and not use.enabled.flag())

    @property
    def shown(self) -> str:
        """The path for messages; within the repository it is relative to the root."""
        return self.path.relative_to(ROOT).as_posix() if self.path.is_relative_to(ROOT) else str(self.path)

    def where(self, name: str) -> str:
        """Return "file:line" of the node `name`; KeyError if there is none."""
        for use in self.uses:
            if use.name == name:
                return f"{self.shown}:{use.entry.line}"
        raise KeyError(name)

    def nodes(
        self,
        declared: Mapping[str, Declared],
        formats: Collection[str],
        externals: Collection[str] = (),
        outputs: Collection[str] | None = None,
        on: Collection[str] = (),
    ) -> list[Node]:
        """Return the nodes of the graph, in the order of the file.

        `declared` are the chapter's passes by name, `formats` the formats that images can have, `externals` the
        resources of other owners, and `outputs` the outputs that a frame can have (None: no check). Nodes in `on` run
        although the file switches them off. Raises GraphError for an entry that does not fit its pass.
        """
        off = self.off.difference(on)
        nodes = [_node(use, declared, formats, externals, use.name in off) for use in self.uses]
        _check_producers(self.uses, nodes, declared)
        _check_sources(self.uses, nodes, declared, externals)
        known = _known(nodes, externals)
        for output, field in self.connected.items():
            if outputs is not None and output not in outputs:
                raise field.wrong_key(f"is no output of a frame{suggest(output, outputs)}")
            _known_resource(field, known)
        return nodes


def graph_path(text: str) -> Path:
    """Return the path for `text`: the name of a graph of the chapter, such as "deferred", or else a file."""
    own = GRAPHS / f"{text}.json"
    if re.fullmatch(r"[a-z_]+", text) and not Path(text).is_file():
        if not own.is_file():
            names = [path.stem for path in GRAPHS.glob("*.json")]
            near = suggest(text, names)
            raise GraphError(f"There is no graph {text!r}{near}" + ("" if near.endswith("?") else "."))
        return own
    return Path(text)


def read_graph(path: Path) -> GraphFile:
    """Read a graph file; like shaders, it may be edited while frames are drawn (common/files/shader_files.py).

    Raises GraphError if the file cannot be read, is not JSON, or is not a graph.
    """
    return shader_files.held(path, _read)


def _read(path: Path) -> GraphFile:
    text = _text_of(path)
    try:
        whole = Field(path, text, "", parse(text))
    except JsonError as error:
        line, column = line_and_column(text, error.at)
        raise GraphError(f"{path}:{line}:{column}: this is no JSON: {error}.") from None
    parts = whole.members(("title", "passes", "outputs"))
    if "passes" not in parts:
        raise whole.wrong('has no "passes": a graph lists its passes, as {"passes": [{"pass": "forward"}]}')
    uses = [_use(entry) for entry in parts["passes"].items()]
    if not uses:
        raise parts["passes"].wrong("is empty: a frame has at least one pass")
    first: dict[str, Use] = {}
    for use in uses:
        if use.name in first:
            line = first[use.name].entry.line
            raise use.entry.wrong(
                f'is a second {use.name!r}, after that of line {line}: give it a "name" of its own'
            )
        first[use.name] = use
    title = parts["title"].word() if "title" in parts else ""
    return GraphFile(path, title, tuple(uses), parts["outputs"].names() if "outputs" in parts else {})


def _text_of(path: Path) -> str:
    try:
        if path.is_dir():
            raise GraphError(f"{path} is a folder, and a graph is a file: name a .json in it.")
        if path.exists() and not path.is_file():
            raise GraphError(f"{path} is no file that can be read twice: name a .json.")
        with path.open("rb") as file:
            data = file.read(MAX_BYTES + 1)
    except FileNotFoundError:
        raise GraphError(f"There is no graph {path}: name one of the chapter, or a .json file.") from None
    except (OSError, ValueError) as error:  # ValueError: a zero byte in the name
        why = getattr(error, "strerror", None) or error
        raise GraphError(f"The graph {str(path)!r} cannot be read: {why}.") from None
    if len(data) > MAX_BYTES:
        raise GraphError(f"{path} is no graph: it has more than {MAX_BYTES:,} bytes.")
    try:
        return data.decode("utf-8-sig")
    except UnicodeDecodeError as error:
        line = data.count(b"\n", 0, error.start) + 1
        raise GraphError(
            f"{path}:{line}: this is no text in UTF-8: save the file in that encoding."
        ) from None


def _use(entry: Field) -> Use:
    """Return an entry of `passes` with checked types and ranges."""
    keys = ("pass", "name", "enabled", "reads", "writes", "format", "scale", "size", "queue")
    parts = entry.members(keys)
    if "pass" not in parts:
        raise entry.wrong('has no "pass": say which one it is, as {"pass": "tonemap"}')
    open_: dict[str, dict[str, Field]] = {
        key: parts[key].members() if key in parts else {} for key in ("format", "scale", "size")
    }
    for field in open_["format"].values():
        field.word()
    for field in open_["scale"].values():
        field.scale()
    for name, field in open_["size"].items():
        field.size()
        if name in open_["scale"]:
            raise field.wrong(f"says again what scale.{name} says: leave one of them out")
    if "enabled" in parts:
        parts["enabled"].flag()
    if "queue" in parts:
        check_word(parts["queue"])
    name = parts["pass"].name()
    name = parts["name"].name() if "name" in parts else name
    connections = {key: parts[key].names() if key in parts else {} for key in ("reads", "writes")}
    return Use(
        entry, parts["pass"], name, parts.get("enabled"), **connections, **open_, queue=parts.get("queue")
    )


def _node(
    use: Use,
    declared: Mapping[str, Declared],
    formats: Collection[str],
    externals: Collection[str],
    off: bool,
) -> Node:
    name = use.of.word()
    if name not in declared:
        raise use.of.wrong(f"is {name!r}, and there is no such pass{suggest(name, declared)}")
    gpu_pass = declared[name]
    written = [access.resource for access in gpu_pass.writes]
    sources = [word for access in (*gpu_pass.reads, *gpu_pass.writes) for word in _sources(access, gpu_pass)]
    _check_keys(use.reads, sources, f"reads nothing that {name!r} declares")
    for fields in (use.writes, use.format, use.scale, use.size):
        _check_keys(fields, written, f"is nothing that {name!r} writes")
    # If a pass reads its own result of the previous frame, the read has the name of the write.
    writes = {key: field.word() for key, field in use.writes.items()}
    reads = writes | {key: field.word() for key, field in use.reads.items()}
    why_not = gpu_pass.why_not
    if off and use.enabled is not None:
        why_not = f"switched off in {use.enabled.file}:{use.enabled.line}"
    node = Node(
        use.name,
        tuple(_connected(access, reads, reads) for access in gpu_pass.reads),
        tuple(
            _connected(_shaped(use, access, formats, externals), writes, reads) for access in gpu_pass.writes
        ),
        why_not,
        gpu_pass.queue,
    )
    return node if use.queue is None else moved(node, use.queue, name)


def _sources(access: Access, gpu_pass: Declared) -> Iterator[str]:
    """Yield the names from other passes that a declared access uses."""
    if access in gpu_pass.reads:
        yield access.resource
    yield from filter(None, (access.of, access.instead))


def _check_keys(fields: Mapping[str, Field], known: Iterable[str], problem: str) -> None:
    words = set(known)
    for key, field in fields.items():
        if key not in words:
            raise field.wrong_key(f"{problem}{suggest(key, words)}")


def _connected(access: Access, names: Mapping[str, str], sources: Mapping[str, str]) -> Access:
    """Return an access with the names of this graph."""
    if not {access.resource, access.of, access.instead} & {*names, *sources}:
        return access
    return replace(
        access,
        resource=names.get(access.resource, access.resource),
        of=sources.get(access.of, access.of),
        instead=sources.get(access.instead, access.instead),
    )


def _shaped(use: Use, access: Access, formats: Collection[str], externals: Collection[str]) -> Access:
    """Return a declared write with the format and the size from the file."""
    name = access.resource
    name_here = use.writes[name].word() if name in use.writes else name
    fields = {
        key: mapping[name]
        for key, mapping in (("format", use.format), ("scale", use.scale), ("size", use.size))
        if name in mapping
    }
    for key, field in fields.items():
        if access.bytes:
            raise field.wrong(f"sets the {key} of a buffer, which has none: leave it out")
        if access.of:
            raise field.wrong(f"is that of {access.of!r}, which it continues: set it where that is written")
        declared = access.format if key == "format" else access.size or (access.scale != 1.0 and access.scale)
        if declared:
            raise field.wrong(f"repeats what {use.of.word()!r} declares, {brief(declared)}: leave it out")
    format_, scale, size = access.format, access.scale, access.size
    if "format" in fields:
        format_ = fields["format"].format(formats)
        if (format_[0] == "d") != (access.use == "depth"):
            kind = "depth" if access.use == "depth" else "colour"
            raise fields["format"].wrong(f"is {format_!r}, and {use.of.word()!r} writes {kind} there")
    elif not (format_ or access.of or access.bytes or name_here in externals):
        raise use.entry.wrong(
            f'({use.name!r}) leaves the format of {name!r} open: add "format": {{"{name}": "rgba16f"}}'
        )
    if "scale" in fields:
        scale = fields["scale"].scale()
    if "size" in fields:
        size = fields["size"].size()
    return access if not fields else replace(access, format=format_, scale=scale, size=size)


def _check_producers(uses: Iterable[Use], nodes: list[Node], declared: Mapping[str, Declared]) -> None:
    """Raise GraphError if two passes of a frame write one name."""
    first: dict[str, Use] = {}
    for use, node in zip(uses, nodes, strict=True):
        if node.why_not:
            continue
        for access, own in zip(node.writes, declared[use.of.word()].writes, strict=True):
            name = access.resource
            if name in first:
                by, line = first[name].name, first[name].entry.line
                raise use.writes.get(own.resource, use.entry).wrong(
                    f"writes {name!r}, as {by!r} in line {line} does: give one of them another name by "
                    f'"writes": {{"{own.resource}": "..."}}'
                )
            first[name] = use


def _check_sources(
    uses: Iterable[Use], nodes: list[Node], declared: Mapping[str, Declared], externals: Collection[str]
) -> None:
    """Raise GraphError if a pass of the frame reads or continues a name that no pass writes."""
    known = _known(nodes, externals)
    for use, node in zip(uses, nodes, strict=True):
        for field in use.reads.values():
            _known_resource(field, known)
        if node.why_not:
            continue
        gpu_pass = declared[use.of.word()]
        needed = [(access.resource, "reads") for access in node.reads]
        needed += [(access.of, "continues") for access in (*node.reads, *node.writes) if access.of]
        for name, does in needed:
            if name not in known:
                near = suggest(name, known)
                end = "" if near.endswith("?") else ': add one that does, or connect another by "reads"'
                raise use.entry.wrong(
                    f"({gpu_pass.name!r}) {does} {name!r}, which no pass here writes{near}{end}"
                )


def _known(nodes: Iterable[Node], externals: Iterable[str]) -> set[str]:
    return {*externals, *(access.resource for node in nodes for access in node.writes)}


def _known_resource(field: Field, known: Collection[str]) -> None:
    name = field.word()
    if name not in known:
        raise field.wrong(f"is {name!r}, which no pass here writes{suggest(name, known)}")
