"""What a set of passes means, found by brute force from their declarations: the truth that a compiled frame is held to.

Nothing here is fast, and nothing looks at how a frame is compiled. A *value* is what one pass wrote under a name; a
pass that continues it (`of`) makes another value of the same resource. All passes are `Node`s of the frame graph.
"""

from __future__ import annotations

from collections.abc import Collection, Mapping, Sequence
from dataclasses import replace
from typing import Any

from backends.contract import Access
from tests.support.hazards import WRITES, Barriers, Dependency, Event, Given, Range, Signal, Use, Wait

PREVIOUS = "@previous"
READ_IN = {
    "sampled": ("read", "sampled"),
    "depth": ("read", "depth_read"),
    "storage": ("general", "storage_read"),
    "copy": ("copy_source", "copy_read"),
    "uniform": ("", "uniform"),
    "indirect": ("", "indirect"),
    "rate": ("rate", "rate_read"),
    "structure": ("", "structure_read"),
    "build": ("", "build_input"),
}
"""Layout and access of what a pass reads, by the word it declares (Vulkan specification, "Image Layouts")."""

WRITTEN_IN = {
    "color": ("color", ("color_write",), ("color_read",)),
    "depth": ("depth", ("depth_read", "depth_write"), ()),
    "storage": ("general", ("storage_write",), ("storage_read",)),
    "copy": ("copy_target", ("copy_write",), ()),
    "structure": ("", ("structure_write",), ("structure_read",)),
}
"""Layout and accesses of what a pass writes, and those that come with wanting what was there before."""

OF_RAYS = ("rgen", "rmiss", "rchit", "rahit", "rint", "rcall")
"""Shaders of ray pipelines, which run in one stage (Vulkan specification, "Pipeline Stages")."""


class Truth:
    """What passes mean together. `outputs` and `keep` are names, `externals` has the hand-over of each name."""

    def __init__(
        self,
        nodes: Sequence[Any],
        outputs: Collection[str] = (),
        externals: Mapping[str, Any] | None = None,
        keep: Collection[str] = (),
    ) -> None:
        self.nodes = {node.name: node for node in nodes}
        self.externals = externals or {}
        self.wanted = {name: node for name, node in self.nodes.items() if not node.why_not}
        self._writers: dict[str, tuple[Any, Access]] = {}
        self._uses: dict[str, list[Use]] = {}
        for node in sorted(
            nodes, key=lambda node: not node.why_not
        ):  # one that is wanted comes last, and counts
            self._writers |= {access.resource: (node, access) for access in node.writes}
        self.outputs = {value for name in outputs if (value := self.value(name)) is not None}
        self.alive = self._alive()
        seen = {value for name in keep if (value := self.value(name)) is not None}
        self._kept = {value for value in self.outputs | seen if self.producer(value) in self.alive}
        self.edges = self.edges_of(self.alive)

    # --- names --------------------------------------------------------------------------------------------------------

    def value(self, name: str) -> str | None:
        """The value that a name stands for once passes are left out; None where nobody writes one."""
        if name not in self._writers:
            return name if name in self.externals else None
        node, access = self._writers[name]
        if not node.why_not:
            return name
        other = access.instead or access.of
        return self.value(other) if other else None

    def before(self, value: str) -> str | None:
        """The value that this one is drawn on top of."""
        access = self._writers[value][1] if value in self._writers else None
        return self.value(access.of) if access and access.of else None

    def resource(self, value: str) -> str:
        """The name of the memory that a value is in: that of the first value there."""
        before = self.before(value)
        return value if before is None else self.resource(before)

    def producer(self, value: str | None) -> str | None:
        """The pass that writes a value; None of what an external holds from the start."""
        return self._writers[value][0].name if value in self._writers else None

    def consumed(self, node: Any) -> list[str]:
        """The values of this frame that a pass needs: what it reads, and what it draws on top of."""
        read = [self.value(access.resource) for access in node.reads if not access.previous]
        return [value for value in (*read, *self.continued(node)) if value is not None]

    def continued(self, node: Any) -> list[str]:
        """The values that a pass draws on top of."""
        return [value for access in node.writes if (value := self.before(access.resource)) is not None]

    # --- passes -------------------------------------------------------------------------------------------------------

    def edges_of(self, names: Collection[str]) -> set[tuple[str, str, str]]:
        """Every pair (before, after) of these passes, with why."""
        edges = set()
        for after in names:
            for value in self.consumed(self.nodes[after]):
                edges.add((self.producer(value), after, "reads"))
            for value in self.continued(self.nodes[after]):
                readers = {
                    other
                    for other in names
                    for access in self.nodes[other].reads
                    if not access.previous and self.value(access.resource) == value
                }
                edges |= {(reader, after, "replaces") for reader in readers}
        return {(before, after, why) for before, after, why in edges if before in names}

    def _alive(self) -> set[str]:
        """The passes from which an output, an external or a history that is read can be reached."""
        alive = {
            node.name
            for node in self.wanted.values()
            for access in node.writes
            if access.resource in self.outputs or self.resource(access.resource) in self.externals
        }
        while True:
            more = set(alive)
            for name in alive:
                node = self.nodes[name]
                old = [self.value(access.resource) for access in node.reads if access.previous]
                more |= {self.producer(value) for value in (*self.consumed(node), *old)} - {None}
            if more == alive:
                return alive
            alive = more

    @property
    def histories(self) -> set[str]:
        """The resources of which some pass reads what the frame before left."""
        old = (access for name in self.alive for access in self.nodes[name].reads if access.previous)
        return {self.resource(value) for access in old if (value := self.value(access.resource)) is not None}

    def life(self, resource: str) -> str:
        """How long a resource is needed."""
        if resource in self.externals:
            return "external"
        if resource in self.histories:
            return "history"
        return "kept" if resource in {self.resource(value) for value in self._kept} else "transient"

    def resources(self) -> set[str]:
        """All that the passes of the frame touch."""
        return {resource.removesuffix(PREVIOUS) for name in self.alive for resource, *_ in self.touches(name)}

    def is_wanted_later(self, value: str) -> bool:
        """Whether somebody needs a value after the pass that wrote it."""
        if value in self._kept or self.life(self.resource(value)) in ("external", "history"):
            return True
        return any(value in self.consumed(self.nodes[name]) for name in self.alive)

    # --- touches ------------------------------------------------------------------------------------------------------

    def touches(self, name: str) -> list[tuple[str, Access, bool]]:
        """The resource behind each thing that a pass reads, then writes, and whether it writes."""
        node = self.nodes[name]
        read = [
            (self.resource(value) + PREVIOUS * access.previous, access, False)
            for access in node.reads
            if (value := self.value(access.resource)) is not None
        ]
        return read + [(self.resource(access.resource), access, True) for access in node.writes]

    def uses(self, name: str) -> list[Use]:
        """What a pass does to each resource, by the tables of this module."""
        if name not in self._uses:
            made: dict[str, list[Use]] = {}
            for resource, access, writes in self.touches(name):
                made.setdefault(resource, []).append(self._use(self.nodes[name], resource, access, writes))
            self._uses[name] = [_merged(parts) for parts in made.values()]
        return self._uses[name]

    def _use(self, node: Any, resource: str, access: Access, writes: bool) -> Use:
        shaders = access.stages or (("fragment",) if node.kind == "graphics" else ("compute",))
        shaders = tuple("rays" if stage in OF_RAYS else stage for stage in shaders)
        fixed = {"color": "color", "depth": "depth", "copy": "copy", "indirect": "indirect", "rate": "rate"}
        fixed["build"] = "build"
        stages = (fixed[access.use],) if access.use in fixed else shaders
        if writes:
            layout, kinds, before = WRITTEN_IN[access.use]
            needs = bool(access.of) and access.clear is None
            kinds += before if needs else ()
            attached = access.use in ("color", "depth")
            fills = not attached or self.is_wanted_later(access.resource)
        else:
            layout, kind = READ_IN[access.use]
            kinds, needs, fills = (kind,), True, True
        touches = frozenset((stage, kind) for stage in stages for kind in kinds)
        return Use(node.name, resource, touches, layout if self.is_image(resource) else "", needs, fills)

    def is_image(self, resource: str) -> bool:
        """Whether a resource is an image: it has a format, or an external's."""
        name = resource.removesuffix(PREVIOUS)
        if name in self.externals:
            return self.externals[name].format is not None
        return not self._writers[name][1].bytes


def _merged(parts: list[Use]) -> Use:
    """Several ways in which one pass uses one resource, at the same time."""
    assert len({part.layout for part in parts}) == 1, f"{parts[0].by} uses {parts[0].resource} in two layouts"
    touches = frozenset[tuple[str, str]]().union(*(part.touches for part in parts))
    needs, fills = any(part.needs for part in parts), all(part.fills for part in parts)
    return replace(parts[0], touches=touches, needs=needs, fills=fills)


# --- orders -----------------------------------------------------------------------------------------------------------

Layouts = tuple[tuple[str, str], ...]


def _changed(truth: Truth, name: str, layouts: Layouts) -> tuple[int, Layouts]:
    """How many images change layout for a pass, and all layouts behind it."""
    now = dict(layouts)
    wanted = {use.resource: use.layout for use in truth.uses(name) if use.layout}
    return sum(now.get(image) != layout for image, layout in wanted.items()), tuple(
        sorted((now | wanted).items())
    )


def transitions(truth: Truth, order: Sequence[str]) -> int:
    """How often images change layout in one frame of this order, into the layout of their first use included."""
    count, layouts = 0, _entered(truth)
    for name in order:
        more, layouts = _changed(truth, name, layouts)
        count += more
    return count


def fewest_transitions(truth: Truth) -> int:
    """The least of `transitions` over all orders that the edges allow; RuntimeError where there is none.

    All orders are walked; those that came to the same passes and the same layouts go on as one.
    """
    behind = {name: {before for before, after, _ in truth.edges if after == name} for name in truth.alive}
    best: dict[tuple[frozenset[str], Layouts], int] = {(frozenset(), _entered(truth)): 0}
    for _ in behind:
        longer: dict[tuple[frozenset[str], Layouts], int] = {}
        for (done, layouts), count in best.items():
            for name in behind.keys() - done:
                if behind[name] <= done:
                    more, later = _changed(truth, name, layouts)
                    key = done | {name}, later
                    longer[key] = min(count + more, longer.get(key, count + more))
        best = longer
    if not best:
        raise RuntimeError("the passes wait for each other")
    return min(best.values())


def _entered(truth: Truth) -> Layouts:
    return tuple(sorted((name, external.enters.layout) for name, external in truth.externals.items()))


# --- events -----------------------------------------------------------------------------------------------------------


def places_of(graph: Any) -> dict[str, Range]:
    """Where the transients of a compiled frame lie, for the simulator."""
    return {
        name: (place.heap, place.offset, place.offset + place.size)
        for name, place in graph.memory.places.items()
    }


def events_of(truth: Truth, graph: Any, frames: int = 3, skip: Any = None) -> list[Event]:
    """The events of some frames: the order and the barriers of a compiled frame, around what the passes declare.

    Histories are two images that change places from frame to frame. `skip` is one barrier, as (step or "prologue" or
    "epilogue", number), that is left out wherever it would come.
    """
    histories = {resource for resource in truth.resources() if truth.life(resource) == "history"}
    events: list[Event] = []

    def physical(resource: str, frame: int) -> str:
        name = resource.removesuffix(PREVIOUS)
        return f"{name}#{(frame + (name != resource)) % 2}" if name in histories else name

    def barriers(key: Any, listed: Sequence[Any], frame: int) -> None:
        left = [barrier for number, barrier in enumerate(listed) if (key, number) != skip]
        if left:
            events.append(Barriers(tuple(_dependency(one, physical(one.resource, frame)) for one in left)))

    barriers("prologue", graph.prologue, 0)
    used = truth.resources()
    for frame in range(frames):
        for name, external in truth.externals.items():
            if name in used:
                touch = external.enters
                events.append(Given(name, _pairs(touch), touch.layout))
        for number, step in enumerate(graph.steps):
            barriers(number, step.barriers, frame)
            for use in truth.uses(step.name):
                # Shaders leave out a history that is not there yet, by a bit of the frame's constants.
                needs = use.needs and not (frame == 0 and use.resource.endswith(PREVIOUS))
                events.append(
                    Use(use.by, physical(use.resource, frame), use.touches, use.layout, needs, use.fills)
                )
        barriers("epilogue", graph.epilogue, frame)
        done = f"frame {frame}"
        events += [Signal(done), Wait(done, queue="host")]
        for name, external in truth.externals.items():
            if name in used and external.leaves is not None:
                events.append(_taken(name, external.leaves))
    return events


def _taken(name: str, touch: Any) -> Use:
    host = touch.stages == frozenset({"host"})
    return Use(f"the owner of {name}", name, _pairs(touch), touch.layout, queue="host" if host else "main")


def _pairs(touch: Any) -> frozenset[tuple[str, str]]:
    """The accesses that each stage of a touch can make."""
    able = {
        "color": {"color_read", "color_write"},
        "depth": {"depth_read", "depth_write"},
        "copy": {"copy_read", "copy_write"},
        "indirect": {"indirect"},
        "rate": {"rate_read"},
        "host": {"host_read"},
        "build": {"build_input", "structure_read", "structure_write"},
    }
    shader = {"sampled", "storage_read", "storage_write", "uniform", "structure_read"}
    return frozenset(
        (stage, access) for stage in touch.stages for access in touch.access & able.get(stage, shader)
    )


def _dependency(barrier: Any, resource: str) -> Dependency:
    before, after = barrier.before, barrier.after
    image = after.layout != ""
    old = "undefined" if barrier.discard else before.layout
    return Dependency(
        resource,
        before.stages,
        before.access & WRITES,
        after.stages,
        after.access,
        old if image else "",
        after.layout if image else "",
    )
