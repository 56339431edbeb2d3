"""A compiled graph to be read: as text, and as JSON for programs. `tools.frames.svg` draws it.

The text goes from top to bottom as the frame does: each pass with what it waits for, reads and draws to; then what was
left out and why; what several queues run at the same time; then when each resource is alive, and where its memory lies.

Graphs of every chapter that has some are told: those of chapter 4 have one queue, and steps that name none.
"""

from __future__ import annotations

from collections.abc import Iterable, Iterator, Mapping, Sequence
from dataclasses import dataclass, fields, is_dataclass
from importlib import import_module
from typing import Any, TypeAlias

from tools.frames.overlap import Barrier, Graph, batches_of, lines, moved_to, overlaps

Attachment: TypeAlias = Any
Resource: TypeAlias = Any
Step: TypeAlias = Any

VERSION = 1
"""Of the JSON: a later one may have more keys; where one is gone or means something else, this number is another."""

_STAGES = {
    "color": "colour targets",
    "depth": "depth tests",
    "vertex": "vertex shaders",
    "fragment": "fragment shaders",
    "compute": "compute shaders",
    "copy": "copies",
    "indirect": "indirect draws",
    "rate": "shading rates",
    "host": "programs on the CPU",
}


@dataclass(frozen=True)
class Row:
    """One image or buffer over a frame; a history is two, its second one with `PREVIOUS` behind its name.

    `signs` has a sign for each step that uses it: R reads, W writes, X both. It is alive from `first` to `last`.
    """

    name: str
    resource: Resource
    signs: Mapping[int, str]
    first: int
    last: int


def rows(graph: Graph) -> list[Row]:
    """Return the rows in the order of their first use."""
    previous = import_module(type(graph).__module__).PREVIOUS
    signs: dict[str, dict[int, str]] = {}
    for number, step in enumerate(graph.steps):
        tested = [step.depth.resource] if step.depth and step.depth.store == "none" else []
        continued = [one.resource for one in targets(step) if one.load == "load" and one.store != "none"]
        for name in dict.fromkeys((*step.reads, *tested, *step.writes)):
            reads = name in step.reads or name in continued
            writes = name in step.writes
            signs.setdefault(name, {})[number] = "X" if reads and writes else "W" if writes else "R"
    found = []
    end = len(graph.steps) - 1
    for name, mine in sorted(signs.items(), key=lambda item: (min(item[1]), item[0])):
        resource = graph.resources[name.removesuffix(previous)]
        lasting = resource.life in ("history", "external")
        first = 0 if lasting else min(mine)
        found.append(
            Row(name, resource, mine, first, max(mine) if resource.life == "transient" else max(end, first))
        )
    return found


def targets(step: Step) -> tuple[Attachment, ...]:
    """Return what a pass draws to, depth last."""
    return (*step.colors, *([step.depth] if step.depth else []))


def sharing(graph: Graph, name: str) -> list[str]:
    """Return the transients that lie in bytes of transient `name` before or after it."""
    mine = graph.memory.places[name]

    def shares(other: str) -> bool:
        place = graph.memory.places[other]
        overlap = place.offset < mine.offset + mine.size and mine.offset < place.offset + place.size
        return other != name and place.heap == mine.heap and overlap

    return [other for other in graph.memory.places if shares(other)]


# --- text -------------------------------------------------------------------------------------------------------------


def text(graph: Graph) -> str:
    """Return all there is to know about a graph, in lines that end with a line's end."""
    queued = lines(graph, _STAGES)
    parts = (_summary(graph), _passes(graph), _left_out(graph), queued, _lifetimes(graph), _memory(graph))
    return "\n".join("".join(f"{line.rstrip()}\n" for line in part) for part in map(list, parts) if part)


def _summary(graph: Graph) -> Iterator[str]:
    waiting = sum(bool(step.barriers) for step in graph.steps)
    figures = graph.counts()
    copies = len(graph.steps) - figures["passes"]
    yield (
        f"{_number(figures['passes'], 'pass', 'passes')}"
        f"{' and ' + _number(copies, 'copy', 'copies') if copies else ''} at {graph.size[0]}x{graph.size[1]}, "
        f"{_number(len(graph.resources), 'resource')}, {_number(figures['barriers'], 'barrier')} "
        f"({_number(figures['transitions'], 'transition')}) in front of {_number(waiting, 'pass', 'passes')}"
    )
    for output, resource in graph.outputs.items():
        yield f"output {output}: {resource}"
    for output in graph.missing:
        yield f"output {output}: nobody writes it in this frame"


def _number(count: int, one: str, many: str = "") -> str:
    return f"{count} {one if count == 1 else many or one + 's'}"


def _passes(graph: Graph) -> Iterator[str]:
    if graph.prologue:
        yield "once, before the first frame"
        yield from _listed("starts", map(sentence, graph.prologue))
    for number, step in enumerate(graph.steps, 1):
        size = f", {step.size[0]}x{step.size[1]}" if step.size else ""
        queue = getattr(step, "queue", "graphics")
        on = f", on the {queue} queue" if queue != "graphics" else ""
        yield f"{number:2} {step.name} ({step.kind}{size}){on}"
        drawn = {one.resource for one in targets(step)}
        yield from _listed("waits", map(sentence, step.barriers))
        yield from _listed("reads", filter(None, [", ".join(dict.fromkeys(step.reads))]))
        yield from _listed("draws to", (_target(one, graph) for one in targets(step)))
        yield from _listed("writes", (name for name in dict.fromkeys(step.writes) if name not in drawn))
        yield from _listed(
            "releases", (f"{one.resource}{moved_to(one)}" for one in getattr(step, "releases", ()))
        )
    if graph.epilogue:
        yield "behind the last pass"
        yield from _listed("leaves", map(sentence, graph.epilogue))


def _listed(what: str, lines: Iterable[str]) -> Iterator[str]:
    for line in lines:
        yield f"     {what:<9}{line}"
        what = ""


def _target(target: Attachment, graph: Graph) -> str:
    resource = graph.resources[target.resource]
    samples = f" x{resource.samples}" if resource.samples > 1 else ""
    start = {"clear": "cleared", "load": "goes on", "discard": "begins with anything"}[target.load]
    if target.clear is not None and target.load == "clear":
        start += f" to {' '.join(f'{value:g}' for value in target.clear)}"
    end = {"store": "stored", "discard": "not stored, since nobody reads it", "none": "tested only"}
    return f"{target.resource} ({resource.format}{samples}): {start}, {end[target.store]}"


def sentence(barrier: Barrier) -> str:
    """Return in words who waits for whom, and what changes."""
    after, before = _stages(barrier.after.stages), _stages(barrier.before.stages)
    did, does = ("wrote" if barrier.before.writes else "read"), "write" if barrier.after.writes else "read"
    before_layout, after_layout = barrier.before.layout, barrier.after.layout
    if not barrier.before.stages:
        says = f"{after} {does} it first" if after else "nobody used it before"
    elif barrier.discard and before_layout == "undefined":
        says = f"{after} {does} it anew, behind the wait for another queue"
    elif barrier.instead_of:
        says = f"{after} {does} where {_and(barrier.instead_of)} lay, when {before} are done"
    elif barrier.discard:
        says = f"{after} {does} it anew, when {before} of the frame before {did} it"
    elif barrier.after.writes:
        says = f"{after} {does} on what {before} {did}"
    else:
        says = f"{after} {does} what {before} {did}"
    if barrier.discard:
        before_layout = "anything"
    moved = (
        f", layout {before_layout} -> {after_layout}"
        if after_layout and before_layout != after_layout
        else ""
    )
    return f"{barrier.resource}: {says}{moved}{moved_to(barrier)}"


def _stages(stages: Iterable[str]) -> str:
    return _and(sorted(_STAGES.get(stage, stage) for stage in stages))


def _and(words: Sequence[str]) -> str:
    return " and ".join(filter(None, (", ".join(words[:-1]), *words[-1:])))


def _left_out(graph: Graph) -> Iterator[str]:
    if graph.left_out:
        yield "left out"
        width = max(map(len, graph.left_out))
        for name, why in graph.left_out.items():
            yield f"   {name:<{width}}  {why}"
        for name, root in graph.names.items():
            if name not in graph.resources[root].names:
                yield f"   who reads {name} gets {root} instead"


def _lifetimes(graph: Graph) -> Iterator[str]:
    found = rows(graph)
    if not found:
        return
    width = max(len(row.name) for row in found)
    count = len(graph.steps)
    yield "lifetimes: W writes, R reads, X goes on, - alive"
    for digit in reversed(range(len(str(count)))):
        numbers = (
            str(number // 10**digit % 10) if number >= 10**digit else " " for number in range(1, count + 1)
        )
        yield f"   {'':<{width}}  {''.join(numbers)}"
    for row in found:
        bar = "".join(
            row.signs.get(number, "-" if row.first <= number <= row.last else ".") for number in range(count)
        )
        yield f"   {row.name:<{width}}  {bar}  {described(row.resource)}"


def described(resource: Resource) -> str:
    """Return how long a resource lives, and what it is, in a few words."""
    size = f", {resource.size[0]}x{resource.size[1]}" if resource.size else ""
    samples = f" x{resource.samples}" if resource.samples > 1 else ""
    names = f", then {', '.join(resource.names[1:])}" if resource.names[1:] else ""
    told = resource.bytes or (resource.format is not None and resource.size is not None)
    takes = f", {shown_bytes(bytes_of(resource))}" if told else ""
    return f"{resource.life} {resource.format or resource.kind}{samples}{size}{takes}{names}"


def _memory(graph: Graph) -> Iterator[str]:
    memory = graph.memory
    if not memory.places:
        return
    saved = f", {100 * (1 - memory.size / memory.alone):.0f} % less" if memory.size < memory.alone else ""
    yield (
        f"memory of transients: {shown_bytes(memory.size)} in {_number(len(memory.heaps), 'heap')}; each on its own "
        f"{shown_bytes(memory.alone)}{saved}; no arrangement is below {shown_bytes(memory.bound)}"
    )
    width = max(map(len, memory.places))
    for number, heap in enumerate(memory.heaps):
        yield f"   heap {number + 1}, {shown_bytes(heap.size)}"
        mine = [
            (place.offset, memory.lives[name], name)
            for name, place in memory.places.items()
            if place.heap == number
        ]
        digits = len(f"{max(offset for offset, *_ in mine):,}")
        for offset, (first, last), name in sorted(mine):
            with_ = sharing(graph, name)
            few = with_ if len(with_) <= 4 else [*with_[:3], f"{len(with_) - 3} more"]
            yield (
                f"     {offset:>{digits},}  {name:<{width}}  {shown_bytes(memory.places[name].size):>9}, steps "
                f"{first + 1} to {last + 1}" + (f", shared with {_and(few)}" if with_ else "")
            )


def bytes_of(resource: Resource) -> int:
    """Return what an image's texels or a buffer's bytes take, with nothing around them."""
    graphs = import_module(type(resource).__module__.removesuffix("types") + "frame_graph")
    size: int = graphs.texels(resource).size
    return size


def shown_bytes(count: int) -> str:
    """Return a number of bytes as "1.5 MiB"."""
    for unit, size in (("GiB", 1 << 30), ("MiB", 1 << 20), ("KiB", 1 << 10)):
        if count >= size:
            return f"{count / size:.1f} {unit}"
    return f"{count} B"


# --- JSON -------------------------------------------------------------------------------------------------------------


def record(graph: Graph) -> dict[str, Any]:
    """Return a graph as JSON takes it.

    Its keys are the fields of `types.Graph` and of what is in it, under their names: "steps" with "barriers",
    "colors" and "depth", "resources", "names", "edges", "left_out", "memory" with "lives", "places" and "heaps",
    "prologue", "epilogue", "missing", "size", "outputs". Sets are sorted lists; steps count from 0. "counts" has the
    figures that frames carry, and "version" is `VERSION`. "overlaps" is `overlap.overlaps`, of several batches.
    """
    more = {"overlaps": _plain(tuple(overlaps(graph)))} if len(batches_of(graph)) > 1 else {}
    return {"version": VERSION, "counts": graph.counts(), **_plain(graph), **more}


def _plain(value: Any) -> Any:
    if is_dataclass(value) and not isinstance(value, type):
        return {field.name: _plain(getattr(value, field.name)) for field in fields(value)}
    if isinstance(value, Mapping):
        return {key: _plain(one) for key, one in value.items()}
    if isinstance(value, frozenset):
        return sorted(value)
    return [_plain(one) for one in value] if isinstance(value, tuple) else value
