"""A GPU that only keeps the books: it runs a list of events and says where one of them was not synchronised.

It follows the memory model of the Vulkan specification ("Synchronization and Cache Control" and the appendix "Memory
Model"), and knows nothing of how barriers are found:

- A command is *ordered* behind an earlier one by a chain of barriers, each of whose first stages meet the second
  stages of the one before; the order of submission alone orders nothing. Reading before writing needs no more.
- Before it is written over, what was written must besides be made *available*, by a barrier that names the stage and
  the access that wrote it and covers the memory; the next write comes behind that in the chain.
- Before it is read, it must then be made *visible* to the stage and the access that read, by the same barrier or by
  one further down the chain that covers the memory.
- The barriers of one call do not follow each other. A change of layout is a write that happens between the two
  halves of its barrier: it has to be ordered itself, and is visible to what its barrier names alone.
- Images that share memory overwrite each other: whoever writes owns the bytes, all others have lost content and layout.
- A signal makes everything on its queue available, a wait makes it visible on another one; the host sees only what a
  barrier made visible to it *and* what it waited for.

Events speak of stages and accesses in the words of the frame graph. Time is the order of the list, for all queues.
"""

from __future__ import annotations

from bisect import bisect_left
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field

Stage = tuple[str, str]
"""(queue, stage)"""

HOST: Stage = ("host", "host")
ALL_STAGES = (
    "vertex",
    "geometry",
    "fragment",
    "compute",
    "color",
    "depth",
    "copy",
    "indirect",
    "index",
    "task",
    "mesh",
    "rate",
    "build",
    "rays",
)
CHANGE = "change"
WRITES = frozenset(
    {"color_write", "depth_write", "storage_write", "copy_write", "host_write", "structure_write", CHANGE}
)
"""The kinds of access that write; every other one reads. A change of layout writes, too."""

Range = tuple[int, int, int]
"""Number of a heap, first byte, and the byte behind the last one."""


# --- events -----------------------------------------------------------------------------------------------------------


@dataclass(frozen=True)
class Dependency:
    """One barrier: a memory dependency for one resource, which may change the layout of an image."""

    resource: str
    first_stages: frozenset[str]
    first_access: frozenset[str]
    second_stages: frozenset[str]
    second_access: frozenset[str]
    old: str = ""
    new: str = ""
    """Layouts of an image; from "undefined" the content is given up. Equal ones, and "" of buffers, change nothing."""

    @property
    def changes(self) -> bool:
        return self.old != self.new


@dataclass(frozen=True)
class Barriers:
    """One call of `vkCmdPipelineBarrier2`."""

    dependencies: tuple[Dependency, ...]
    queue: str = "main"


@dataclass(frozen=True)
class Use:
    """A command that touches a resource. `needs`: it wants the content that is there; `fills`: it leaves one."""

    by: str
    resource: str
    touches: frozenset[tuple[str, str]]
    """(stage, access)"""
    layout: str = ""
    needs: bool = True
    fills: bool = True
    queue: str = "main"


@dataclass(frozen=True)
class Given:
    """Somebody else hands over a resource that he last used so; he waited for all that was done with it before."""

    resource: str
    touches: frozenset[tuple[str, str]] = frozenset()
    """(stage, access); without any, the resource is ready for everybody."""
    layout: str = ""
    queue: str = "main"


@dataclass(frozen=True)
class Signal:
    """A queue signals a semaphore (name and value) when these stages are done with everything before."""

    semaphore: str
    stages: tuple[str, ...] = ALL_STAGES
    queue: str = "main"


@dataclass(frozen=True)
class Wait:
    """These stages of a queue, or the queue "host", wait for a semaphore."""

    semaphore: str
    stages: tuple[str, ...] = ALL_STAGES
    queue: str = "main"


@dataclass(frozen=True)
class Submit:
    """A queue is given work: what the host wrote until now is visible to it."""

    queue: str = "main"


Event = Barriers | Use | Given | Signal | Wait | Submit


@dataclass(frozen=True)
class Hazard:
    """What went wrong: which event of the list, by whom, with which resource, and how."""

    event: int
    by: str
    resource: str
    text: str

    def __str__(self) -> str:
        return f"event {self.event}, {self.by}: '{self.resource}' {self.text}"


# --- the books --------------------------------------------------------------------------------------------------------


@dataclass
class _Done:
    """One access that happened to some bytes, and what is known to come after it."""

    what: str
    stage: Stage | None
    """Where it ran; None of a change of layout, which only barriers further down its chain meet."""
    access: str
    ordered: set[Stage] = field(default_factory=set)
    """What runs behind it."""
    released: set[Stage] = field(default_factory=set)
    """What runs behind its being made available."""
    visible: set[tuple[Stage, str]] = field(default_factory=set)
    """The access "*" stands for any."""
    signals: set[str] = field(default_factory=set)

    @property
    def writes(self) -> bool:
        return self.access in WRITES

    def in_scope(self, stages: set[Stage]) -> bool:
        """Whether a barrier that begins with `stages` waits for it."""
        return self.stage in stages or not stages.isdisjoint(self.ordered)


@dataclass
class _Bytes:
    """A stretch of memory that the same resources cover: who wrote it last, who has read it since, whose it is."""

    writes: list[_Done] = field(default_factory=list)
    reads: dict[Stage, _Done] = field(default_factory=dict)
    """By stage: whoever comes after the newest read of a stage also comes after the older ones."""
    owner: str | None = None
    filled: bool = False

    @property
    def done(self) -> list[_Done]:
        return [*self.writes, *self.reads.values()]


class _Gpu:
    def __init__(self, places: Mapping[str, Range]) -> None:
        self._cover = _stretches(places)
        self._layouts: dict[str, str] = {}
        self._now = 0
        self.hazards: list[Hazard] = []

    def run(self, number: int, event: Event) -> None:
        self._now = number
        match event:
            case Barriers():
                self._barriers(event)
            case Use():
                self._use(event)
            case Given():
                self._given(event)
            case Signal():
                stages = {_on(event.queue, stage) for stage in event.stages}
                for done in self._everything():
                    if done.in_scope(stages):
                        done.signals.add(event.semaphore)
            case Wait():
                behind = [done for done in self._everything() if event.semaphore in done.signals]
                self._let(
                    behind, [HOST] if event.queue == "host" else [_on(event.queue, s) for s in event.stages]
                )
            case Submit():
                written = [done for done in self._everything() if done.stage == HOST and done.writes]
                self._let(written, [(event.queue, stage) for stage in ALL_STAGES])

    def _let(self, behind: Iterable[_Done], stages: Iterable[Stage]) -> None:
        """Order these stages behind what was done, with everything visible to them; to the host nothing is."""
        for done in behind:
            done.ordered.update(stages)
            done.released.update(stages)
            done.visible.update((stage, "*") for stage in stages if stage != HOST)

    def _bytes(self, resource: str) -> list[_Bytes]:
        return self._cover.setdefault(resource, [_Bytes()])

    def _everything(self) -> list[_Done]:
        every = {id(part): part for parts in self._cover.values() for part in parts}
        return [done for part in every.values() for done in part.done]

    def _layout(self, resource: str) -> str:
        """The layout of an image; undefined as soon as somebody else wrote to a part of its memory."""
        lost = any(part.owner != resource for part in self._bytes(resource))
        return "undefined" if lost else self._layouts.get(resource, "undefined")

    def _report(self, by: str, resource: str, text: str) -> None:
        self.hazards.append(Hazard(self._now, by, resource, text))

    def _barriers(self, event: Barriers) -> None:
        everything = self._everything()
        found: list[tuple[_Done, set[Stage], set[Stage], set[tuple[Stage, str]]]] = []
        for one in event.dependencies:
            first = {_on(event.queue, stage) for stage in one.first_stages}
            second = {_on(event.queue, stage) for stage in one.second_stages}
            seen = {(stage, access) for stage in second for access in one.second_access}
            mine = {id(done) for part in self._bytes(one.resource) for done in part.done}
            # What a barrier makes wait are all commands, but it moves only the bytes of its own resource.
            for done in everything:
                there, own = done.in_scope(first), id(done) in mine
                makes = own and done.stage in first and done.access in one.first_access
                released = makes or not first.isdisjoint(done.released)
                if there:
                    behind = second - {HOST}  # the host only ever waits for semaphores
                    found.append(
                        (done, behind, behind if released else set(), seen if own and released else set())
                    )
                if own and one.changes:
                    self._check_change(one.resource, done, there, released)
            if one.old not in ("", "undefined", self._layout(one.resource)):
                text = f"is in layout '{self._layout(one.resource)}', not '{one.old}'"
                self._report("a barrier", one.resource, text)
        for done, ordered, released, visible in found:  # the barriers of one call do not chain
            done.ordered |= ordered
            done.released |= released
            done.visible |= visible
        for one in event.dependencies:
            if one.changes:
                self._change(one, event.queue)

    def _check_change(self, resource: str, done: _Done, there: bool, released: bool) -> None:
        if not there:
            self._report("a barrier", resource, f"changes layout, not ordered behind {done.what}")
        elif done.writes and not released:
            self._report("a barrier", resource, f"changes layout, but {done.what} is not available")

    def _change(self, one: Dependency, queue: str) -> None:
        second = {_on(queue, stage) for stage in one.second_stages}
        for part in self._bytes(one.resource):
            change = _Done(f"its change to layout '{one.new}'", None, CHANGE, set(second), set(second))
            change.visible = {(stage, access) for stage in second for access in one.second_access}
            part.writes, part.reads = [change], {}
            if one.old == "undefined":
                part.owner, part.filled = one.resource, False
        self._layouts[one.resource] = one.new

    def _use(self, event: Use) -> None:
        touches = [(_on(event.queue, stage), access) for stage, access in sorted(event.touches)]
        if event.layout and self._layout(event.resource) != event.layout:
            text = f"is in layout '{self._layout(event.resource)}', not '{event.layout}'"
            self._report(event.by, event.resource, text)
        for part in self._bytes(event.resource):
            if event.needs and not (part.owner == event.resource and part.filled):
                whose = "lost" if part.owner in (None, event.resource) else f"that of '{part.owner}'"
                self._report(event.by, event.resource, f"is read, but the content is {whose}")
            self._check(event, touches, part)
            made = [
                _Done(f"{access} of {event.by} in {stage[1]}", stage, access) for stage, access in touches
            ]
            if written := [done for done in made if done.writes]:
                part.writes, part.reads = written, {}
                part.owner, part.filled = event.resource, event.fills
            part.reads.update({done.stage: done for done in made if done.stage and not done.writes})

    def _check(self, event: Use, touches: Iterable[tuple[Stage, str]], part: _Bytes) -> None:
        """Report what this use of some bytes was not ordered behind, or does not see."""
        for stage, access in touches:
            who = f"({access} in {stage[1]})"
            for done in part.done if access in WRITES else part.writes:
                if stage not in done.ordered:
                    self._report(event.by, event.resource, f"{who} is not ordered behind {done.what}")
                elif access in WRITES and done.writes and stage not in done.released:
                    self._report(
                        event.by, event.resource, f"{who} writes over {done.what}, not yet available"
                    )
                elif access not in WRITES and not done.visible & {(stage, access), (stage, "*")}:
                    self._report(event.by, event.resource, f"{who} does not see {done.what}")

    def _given(self, event: Given) -> None:
        self._layouts[event.resource] = event.layout
        touches = [(_on(event.queue, stage), access) for stage, access in event.touches]
        stages = {stage for stage, _ in touches}
        for part in self._bytes(event.resource):
            part.writes, part.reads = [], {}
            part.owner, part.filled = event.resource, event.layout != "undefined"
            made = [_Done("its owner's use", stage, access) for stage, access in touches]
            part.writes = [done for done in made if done.writes]
            if touches and not part.writes:  # it is there for those who read it already, and for nobody else
                part.writes = [_Done("its owner's writing", None, CHANGE, {*stages}, {*stages}, {*touches})]
            part.reads = {done.stage: done for done in made if done.stage and not done.writes}


def _on(queue: str, stage: str) -> Stage:
    return HOST if stage == "host" else (queue, stage)


def _stretches(places: Mapping[str, Range]) -> dict[str, list[_Bytes]]:
    """Cut heaps at every end of a resource; return the stretches of each."""
    cuts: dict[int, set[int]] = {}
    for heap, first, end in places.values():
        cuts.setdefault(heap, set()).update((first, end))
    ordered = {heap: sorted(ends) for heap, ends in cuts.items()}
    parts = {heap: [_Bytes() for _ in ends[1:]] for heap, ends in ordered.items()}
    return {
        name: parts[heap][bisect_left(ordered[heap], first) : bisect_left(ordered[heap], end)]
        for name, (heap, first, end) in places.items()
    }


def find_hazards(events: Iterable[Event], places: Mapping[str, Range] | None = None) -> list[Hazard]:
    """Return every hazard of `events`. `places` are the resources in heaps; others have memory of their own."""
    gpu = _Gpu(places or {})
    for number, event in enumerate(events):
        gpu.run(number, event)
    return gpu.hazards


def is_safe(events: Iterable[Event], places: Mapping[str, Range] | None = None) -> bool:
    """Whether there is no hazard in `events`; stops at the first."""
    gpu = _Gpu(places or {})
    for number, event in enumerate(events):
        gpu.run(number, event)
        if gpu.hazards:
            return False
    return True
