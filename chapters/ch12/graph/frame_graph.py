"""The frame graph: compiles the declarations of passes into a frame with an order, memory and barriers.

    connect      names become edges; passes that the frame does not need are left out    graph/names.py
    order        a topological order with few layout transitions                         graph/order.py
    resources    the images and buffers of the names, with formats and sizes             here
    memory       resources with disjoint lifetimes share memory                          graph/memory/placement.py
    barriers     between dependent touches only                                          graph/sync/barriers.py
    steps        for each pass its barriers, and load and store operations               here
    batches      submissions to queues, and the semaphores between them                  graph/sync/queues.py

This code is independent of the graphics API: a backend executes the steps, and returns the memory requirements of
resources. The graph is compiled when its structure changes (a pass is added or removed, or the size changes), not per
frame.
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
    """Compile a frame of `size` pixels; the order of the nodes in `nodes` does not matter.

    `outputs` are the names that are needed after the frame, or a mapping from outputs to names.
    `externals` are resources with another owner. `requirements` returns the memory requirements of a resource (by
    default the size of its texels). `alias` lets transients share memory; the resources in `keep` never do, and stay
    valid after the frame. `queues` are the available queues: a pass for another queue runs on graphics. Raises
    GraphError with one sentence that names the passes.
    """
    externals = externals or {}
    requested = dict(outputs) if isinstance(outputs, Mapping) else {name: name for name in outputs}
    wiring = connect(nodes, requested, externals)
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


class _Facts:
    """The declarations of one resource, gathered over all of its names."""

    def __init__(self) -> None:
        self.names: list[str] = []
        self.first_write: Access | None = None
        self.uses: set[str] = set()
        self.drawn = self.previous = False


def _resources(
    wiring: Wiring, size: tuple[int, int], externals: Mapping[str, External], keep: Collection[str]
) -> tuple[dict[str, Resource], dict[str, dict[str, Touch]]]:
    """Return the resources by name, and for each pass its touch of each resource."""
    gathered: dict[str, _Facts] = {}
    for node in wiring.nodes:
        for access, writes in (*((a, False) for a in node.reads), *((a, True) for a in node.writes)):
            facts = gathered.setdefault(wiring.roots[access.resource], _Facts())
            facts.uses.add(f"copy_{'target' if writes else 'source'}" if access.use == "copy" else access.use)
            facts.drawn |= writes and access.use in ("color", "depth")
            facts.previous |= access.previous
            if access.resource not in facts.names:
                facts.names.append(access.resource)
            if writes and not access.of:
                facts.first_write = access
    kept = {wiring.roots[name] for name in wiring.outputs.values()}
    kept |= {wiring.names[name] for name in keep if name in wiring.names}
    resources = {
        name: _resource(name, facts, size, externals.get(name), name in kept)
        for name, facts in sorted(gathered.items())
    }
    touches = {node.name: _touches(node, wiring, resources) for node in wiring.nodes}
    return resources, touches


def _resource(
    name: str, facts: _Facts, size: tuple[int, int], external: External | None, kept: bool
) -> Resource:
    names = tuple(sorted(facts.names, key=lambda alias: (alias != name, alias)))
    uses = frozenset(facts.uses)
    if external is not None:
        kind: Any = "buffer" if external.bytes else "attachment" if facts.drawn else "texture"
        return Resource(
            name,
            names,
            kind,
            "external",
            external.format,
            external.size,
            external.bytes,
            external.samples,
            uses=uses,
        )
    first_write = facts.first_write
    assert first_write is not None, "a name without a writer was refused before"
    life: Any = "history" if facts.previous else "kept" if kept else "transient"
    if first_write.bytes:
        return Resource(name, names, "buffer", life, bytes=first_write.bytes, uses=uses)
    if first_write.format is None:
        raise GraphError(f"No pass states the format of '{name}'.")
    if "storage" in uses:
        check_stored(name, first_write.format, first_write.samples)
    pixels = first_write.size or (
        -(-max(1, round(size[0] * first_write.scale)) // first_write.texel[0]),
        -(-max(1, round(size[1] * first_write.scale)) // first_write.texel[1]),
    )
    if min(pixels) < 1:
        raise GraphError(
            f"'{name}' cannot have {pixels[0]}x{pixels[1]} pixels: each side must be 1 at least."
        )
    kind = "attachment" if facts.drawn else "texture"
    return Resource(
        name,
        names,
        kind,
        life,
        first_write.format,
        pixels,
        samples=first_write.samples,
        slices=first_write.slices,
        uses=uses,
    )


def texels(resource: Resource) -> Requirement:
    """Return the size of an image's texels or a buffer's bytes, without padding."""
    if resource.kind == "buffer":
        return Requirement(resource.bytes, 256)
    assert resource.size is not None and resource.format is not None, "an image has both"
    width, height = resource.size
    texels = width * height * resource.samples * max(1, resource.slices)
    return Requirement(texels * bytes_of(resource.format), 256)


def bytes_of(format: str) -> int:
    """Return the bytes of a texel from the name of its format: channels times bits per channel ('rgba16f': 8)."""
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
    """Return the touch of each resource of the pass."""
    touches: dict[str, Touch] = {}
    for access, writes in (*((a, False) for a in node.reads), *((a, True) for a in node.writes)):
        name = wiring.roots[access.resource]
        buffer = resources[name].kind == "buffer"
        if buffer != (
            access.use in ("uniform", "indirect", "structure", "build")
            or (access.use in ("storage", "copy") and buffer)
        ):
            what = "a buffer" if buffer else "an image"
            raise GraphError(f"'{node.name}' uses '{access.resource}' as '{access.use}', but it is {what}.")
        is_integer = (resources[name].format or "").endswith("ui")
        if access.use == "sampled" and is_integer and not (access.format or "").endswith("ui"):
            raise GraphError(
                f"'{node.name}' samples '{access.resource}', which holds whole numbers, and does not say so."
            )
        touch = touch_of(access, node.kind, writes, buffer)
        name += PREVIOUS * access.previous
        combined = merged(touches[name], touch) if name in touches else touch
        if combined is None:
            raise GraphError(
                f"'{node.name}' uses '{access.resource}' in two ways at once, of which each wants another layout."
            )
        touches[name] = combined
    return touches


def _step(
    node: Node, number: int, wiring: Wiring, resources: Mapping[str, Resource], ends: Mapping[str, int]
) -> Step:
    """Return the step of a pass with its attachments; barriers are added later."""
    colors: list[Attachment] = []
    depth: Attachment | None = None
    for access in node.writes:
        name = wiring.roots[access.resource]
        if access.use not in ("color", "depth"):
            continue
        needed = resources[name].life != "transient" or ends[name] > number
        load = "load" if access.of else "discard" if access.clear is None else "clear"
        target = Attachment(name, load, "store" if needed else "discard", access.clear)  # type: ignore[arg-type]
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
    """Return the common size of the attachments, or without attachments the size of the first written image."""
    for target in targets[1:]:
        first, other = resources[targets[0].resource], resources[target.resource]
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
