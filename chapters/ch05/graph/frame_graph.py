"""The frame graph: from what passes declare to a frame in which every pass runs at the right moment, or not at all.

    connect      names become edges; passes that the frame does not need fall out        graph/names.py
    order        one that all edges allow, with few changes of layout                    graph/order.py
    resources    what lies behind the names, with formats and sizes                      here
    memory       resources that are never alive together share bytes                     graph/memory/placement.py
    barriers     between writing and reading, and nowhere else                           graph/sync/barriers.py
    steps        for each pass its barriers, and what its targets begin and end with     here
    batches      what queues run side by side, and who waits for whom                    graph/sync/queues.py

Nothing here knows a graphics API: a backend carries the steps out, and tells what memory a resource asks for. Compiling
happens when the structure changes (a pass comes or goes, the size is another one), never in a frame.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from backends.contract import Access

from .execute.bindings import check_stored
from .memory.placement import place_transients
from .names import Wiring, connect
from .order import order
from .sync.barriers import plan_barriers
from .sync.batches import Batch
from .sync.crossings import Lanes
from .sync.queues import GRAPHICS, Eager, queue_of
from .sync.states import merged, touch_of
from .types import (
    PREVIOUS,
    Attachment,
    External,
    Graph,
    GraphError,
    Node,
    Requirement,
    Requirements,
    Resource,
    Step,
    Touch,
)


def compile_graph(
    nodes: Sequence[Node],
    size: tuple[int, int],
    outputs: Collection[str] | Mapping[str, str] = (),
    externals: Mapping[str, External] | None = None,
    requirements: Requirements | None = None,
    alias: bool = True,
    keep: Collection[str] = (),
    queues: Collection[str] = (GRAPHICS,),
) -> Graph:
    """Compile a frame of `size` pixels; in which order the nodes are declared makes no difference.

    `outputs` are the names that somebody wants after the frame, or what he calls them with the name behind each;
    `externals` are resources that somebody else made. `requirements` tells what memory a resource asks for (without
    it: its texels). `alias` lets transients share memory; those that `keep` names never do, and are there after the
    frame. `queues` are those that there are: a pass that asks for another one runs on graphics. Raises GraphError, one
    sentence that names who is to blame.
    """
    externals = externals or {}
    asked = dict(outputs) if isinstance(outputs, Mapping) else {name: name for name in outputs}
    wiring = connect(nodes, asked, externals)
    resources, touches = _resources(wiring, size, externals, set(keep))
    layouts = {
        name: {resource: touch.layout for resource, touch in used.items()} for name, used in touches.items()
    }
    by_name = {node.name: node for node in wiring.nodes}
    lane = {node.name: queue_of(node, queues) for node in wiring.nodes}
    several = bool({*lane.values()} - {GRAPHICS})
    eager = Eager(lane, wiring.edges) if several else None
    frame = [by_name[name] for name in order(list(by_name), wiring.edges, layouts, eager)]

    used = [touches[node.name] for node in frame]
    lives: dict[str, tuple[int, int]] = {}
    for number, touched in enumerate(used):
        for name in touched:
            first, _ = lives.get(name, (number, number))
            lives[name] = first, number
    transients = {name: lives[name] for name, resource in resources.items() if resource.life == "transient"}
    needs = {name: (requirements or texels)(resources[name]) for name in transients}
    buffers = {name for name in transients if resources[name].kind == "buffer"}
    on = [lane[node.name] for node in frame]
    lanes = Lanes(on, used, resources, externals) if several else None
    memory = place_transients(transients, needs, buffers, alias, lanes.together if lanes else None)
    plan = plan_barriers(used, resources, externals, memory, lanes)

    ends = {name: last for name, (_, last) in lives.items()}
    steps = tuple(
        replace(
            _step(node, number, wiring, resources, ends),
            barriers=barriers,
            queue=on[number],
            releases=lanes.releases(number) if lanes else (),
        )
        for number, (node, barriers) in enumerate(zip(frame, plan.steps, strict=True))
    )
    return Graph(
        steps,
        resources,
        wiring.names,
        wiring.edges,
        wiring.left_out,
        memory,
        plan.prologue,
        plan.epilogue,
        wiring.missing,
        size,
        {output: wiring.roots[name] for output, name in wiring.outputs.items()},
        lanes.batches(bool(plan.epilogue)) if lanes else (Batch(GRAPHICS, tuple(range(len(steps)))),),
    )


# --- resources --------------------------------------------------------------------------------------------------------


class _Found:
    """What the declarations say about one resource, gathered over all of its names."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.made: Access | None = None
        self.uses: set[str] = set()
        self.drawn = self.previous = False


def _resources(
    wiring: Wiring, size: tuple[int, int], externals: Mapping[str, External], keep: Collection[str]
) -> tuple[dict[str, Resource], dict[str, dict[str, Touch]]]:
    """Return the resources by name, and by pass how it touches each of them."""
    found: dict[str, _Found] = {}
    for node in wiring.nodes:
        for access, writes in (*((a, False) for a in node.reads), *((a, True) for a in node.writes)):
            one = found.setdefault(wiring.roots[access.resource], _Found())
            one.uses.add(f"copy_{'target' if writes else 'source'}" if access.use == "copy" else access.use)
            one.drawn |= writes and access.use in ("color", "depth")
            one.previous |= access.previous
            if access.resource not in one.names:
                one.names.append(access.resource)
            if writes and not access.of:
                one.made = access
    kept = {wiring.roots[name] for name in wiring.outputs.values()}
    kept |= {wiring.names[name] for name in keep if name in wiring.names}
    resources = {
        name: _resource(name, one, size, externals.get(name), name in kept)
        for name, one in sorted(found.items())
    }
    touches = {node.name: _touches(node, wiring, resources) for node in wiring.nodes}
    return resources, touches


def _resource(
    name: str, found: _Found, size: tuple[int, int], external: External | None, kept: bool
) -> Resource:
    names = tuple(sorted(found.names, key=lambda one: (one != name, one)))
    uses = frozenset(found.uses)
    if external is not None:
        kind: Any = "buffer" if external.bytes else "attachment" if found.drawn else "texture"
        return Resource(
            name,
            names,
            kind,
            "external",
            external.format,
            external.size,
            external.bytes,
            external.samples,
            uses,
        )
    made = found.made
    assert made is not None, "a name without a writer was refused before"
    life: Any = "history" if found.previous else "kept" if kept else "transient"
    if made.bytes:
        return Resource(name, names, "buffer", life, bytes=made.bytes, uses=uses)
    if made.format is None:
        raise GraphError(f"Nobody says which format '{name}' has.")
    if "storage" in uses:
        check_stored(name, made.format, made.samples)
    pixels = made.size or (max(1, round(size[0] * made.scale)), max(1, round(size[1] * made.scale)))
    if min(pixels) < 1:
        raise GraphError(
            f"'{name}' cannot have {pixels[0]}x{pixels[1]} pixels: each side must be 1 at least."
        )
    kind = "attachment" if found.drawn else "texture"
    return Resource(name, names, kind, life, made.format, pixels, samples=made.samples, uses=uses)


def texels(resource: Resource) -> Requirement:
    """Return what an image's texels or a buffer's bytes take, with nothing around them."""
    if resource.kind == "buffer":
        return Requirement(resource.bytes, 256)
    assert resource.size is not None and resource.format is not None, "an image has both"
    width, height = resource.size
    return Requirement(width * height * resource.samples * bytes_of(resource.format), 256)


def bytes_of(format: str) -> int:
    """Return the bytes of a texel by a format's name: its bits a channel, times its channels ('rgba16f': 8)."""
    packed = {"d32f": 4, "d16": 2, "rgb10a2": 4, "r11g11b10f": 4}
    if format in packed:
        return packed[format]
    channels = len(format) - len(format.lstrip("rgba"))
    bits = "".join(c for c in format[channels:].split("_")[0] if c.isdigit())
    if not channels or not bits:
        raise GraphError(f"'{format}' is no format whose size is known.")
    return channels * int(bits) // 8


# --- steps ------------------------------------------------------------------------------------------------------------


def _touches(node: Node, wiring: Wiring, resources: Mapping[str, Resource]) -> dict[str, Touch]:
    """Return how the pass touches each of its resources."""
    found: dict[str, Touch] = {}
    for access, writes in (*((a, False) for a in node.reads), *((a, True) for a in node.writes)):
        name = wiring.roots[access.resource]
        buffer = resources[name].kind == "buffer"
        if buffer != (
            access.use in ("uniform", "indirect") or (access.use in ("storage", "copy") and buffer)
        ):
            what = "a buffer" if buffer else "an image"
            raise GraphError(f"'{node.name}' uses '{access.resource}' as '{access.use}', but it is {what}.")
        whole = (resources[name].format or "").endswith("ui")
        if access.use == "sampled" and whole and not (access.format or "").endswith("ui"):
            raise GraphError(
                f"'{node.name}' samples '{access.resource}', which holds whole numbers, and does not say so."
            )
        touch = touch_of(access, node.kind, writes, buffer)
        name += PREVIOUS * access.previous
        both = merged(found[name], touch) if name in found else touch
        if both is None:
            raise GraphError(
                f"'{node.name}' uses '{access.resource}' in two ways at once, of which each wants another layout."
            )
        found[name] = both
    return found


def _step(
    node: Node, number: int, wiring: Wiring, resources: Mapping[str, Resource], ends: Mapping[str, int]
) -> Step:
    """Return the pass with its targets; barriers come later."""
    colors: list[Attachment] = []
    depth: Attachment | None = None
    for access in node.writes:
        name = wiring.roots[access.resource]
        if access.use not in ("color", "depth"):
            continue
        wanted = resources[name].life != "transient" or ends[name] > number
        load = "load" if access.of else "discard" if access.clear is None else "clear"
        target = Attachment(name, load, "store" if wanted else "discard", access.clear)  # type: ignore[arg-type]
        if access.use == "color":
            colors.append(target)
        else:
            depth = target
    for access in node.reads:
        if access.use == "depth" and depth is None:
            depth = Attachment(wiring.roots[access.resource], "load", "none")
    return Step(
        node.name,
        node.kind,
        colors=tuple(colors),
        depth=depth,
        size=_size(node, [*colors, *([depth] if depth else [])], wiring, resources),
        reads=tuple(wiring.roots[a.resource] + PREVIOUS * a.previous for a in node.reads),
        writes=tuple(wiring.roots[a.resource] for a in node.writes),
    )


def _size(
    node: Node, targets: Sequence[Attachment], wiring: Wiring, resources: Mapping[str, Resource]
) -> tuple[int, int] | None:
    """Return the size of what the pass draws to, which all of its targets share; else of the first image it writes."""
    for one in targets[1:]:
        first, other = resources[targets[0].resource], resources[one.resource]
        if (first.size, first.samples) != (other.size, other.samples):
            raise GraphError(
                f"'{node.name}' draws to '{first.name}' ({_shape(first)}) and '{other.name}' ({_shape(other)}): "
                "targets of one pass have the same size and samples."
            )
    if targets:
        return resources[targets[0].resource].size
    written = [resources[wiring.roots[access.resource]].size for access in node.writes]
    return next((size for size in written if size is not None), None)


def _shape(resource: Resource) -> str:
    width, height = resource.size or (0, 0)
    return f"{width}x{height}" + (f", {resource.samples} samples" if resource.samples > 1 else "")
