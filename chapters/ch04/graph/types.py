"""The words of the frame graph: what passes declare, and what compiling them gives. No graphics API is named here.

    Node       a pass as the graph sees it: its name, what it reads, what it writes
    Resource   an image or a buffer: everything that lives in one place under one or several names
    Touch      one way of using a resource: the layout it has then, the stages that use it, the kinds of access
    Barrier    what must happen to a resource between two touches
    Step       a pass in its place in the frame: the barriers before it, and what it draws to
    Graph      the whole frame, ready for a backend to carry out

A *name* stands for what one pass wrote. A pass that draws on top writes a new name that continues the old one
(`Access.of`), so "before" and "after" are two names of the same *resource*, which is called by its first name.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from backends.contract import Access
from common.errors import UserError

PREVIOUS = "@previous"
"""Ends the name of a history's second image: that which the frame before wrote."""


class GraphError(UserError):
    """A graph that cannot be a frame; the text is one sentence with the names that are to blame."""


@dataclass(frozen=True)
class Node:
    """A pass as the graph sees it. `why_not` says why it is left out of the frame; "" where it is wanted."""

    name: str
    reads: tuple[Access, ...] = ()
    writes: tuple[Access, ...] = ()
    why_not: str = ""

    @property
    def kind(self) -> Literal["graphics", "compute", "copy"]:
        """What the pass does, told by what it writes: draw to attachments, run compute shaders, or only copy."""
        writes = {access.use for access in self.writes}
        if writes & {"color", "depth"}:
            return "graphics"
        uses = writes | {access.use for access in self.reads}
        return "copy" if uses == {"copy"} else "compute"


@dataclass(frozen=True)
class External:
    """A resource that somebody else makes and owns; it is never aliased nor freed.

    `enters` is the touch in which a frame finds it, `leaves` that in which it must be left (None: in any).
    """

    format: str | None
    size: tuple[int, int] | None
    enters: Touch
    leaves: Touch | None = None
    bytes: int = 0
    samples: int = 1


@dataclass(frozen=True)
class Requirement:
    """What memory a resource asks for: bytes, alignment in bytes, and a mask of the memory types that will do."""

    size: int
    alignment: int = 1
    types: int = 1


@dataclass(frozen=True)
class Resource:
    """An image or a buffer of a frame.

    `names` are what it is called from write to write, the first one being its own. `kind` is "attachment" for what
    passes draw to, else "texture" or "buffer". A "transient" is used within one frame and shares memory with others;
    a "kept" one is still there after it (an output, or what is looked at); a "history" is two, of which one is written
    while the other, under its name with `PREVIOUS` behind, still holds the frame before; "external" is somebody else's.
    """

    name: str
    names: tuple[str, ...]
    kind: Literal["attachment", "texture", "buffer"]
    life: Literal["transient", "kept", "history", "external"]
    format: str | None = None
    size: tuple[int, int] | None = None
    bytes: int = 0
    samples: int = 1
    uses: frozenset[str] = frozenset()
    """In how many ways it is used, over all of its names: what a backend has to ask for when it makes it."""


@dataclass(frozen=True)
class Touch:
    """One way of using a resource. `layout` is "" for buffers; stages and accesses are those of `sync/states.py`."""

    layout: str
    stages: frozenset[str]
    access: frozenset[str]
    writes: bool = False


UNTOUCHED = Touch("undefined", frozenset(), frozenset())
"""Memory that nobody has used yet."""


@dataclass(frozen=True)
class Barrier:
    """What happens to `resource` between two touches: wait, make visible, change the layout.

    With `discard` the content is given up. `before` is then what used the memory last, be it another resource, whose
    names are in `instead_of`: memory of one resource is reused by the next, or by the same one of the frame before.
    """

    resource: str
    before: Touch
    after: Touch
    discard: bool = False
    instead_of: tuple[str, ...] = ()


@dataclass(frozen=True)
class Attachment:
    """A target of a pass: what its content begins with, and whether anybody wants it afterwards.

    `store` is "none" for what is only tested against: nothing is written, so that others may read it meanwhile.
    """

    resource: str
    load: Literal["clear", "load", "discard"]
    store: Literal["store", "discard", "none"]
    clear: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Step:
    """A pass in its place in the frame. `reads` are the resources behind what it declares to read, in that order."""

    name: str
    kind: Literal["graphics", "compute", "copy"]
    barriers: tuple[Barrier, ...] = ()
    colors: tuple[Attachment, ...] = ()
    depth: Attachment | None = None
    size: tuple[int, int] | None = None
    reads: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()

    def sampled(self, declared: Sequence[Access]) -> list[str]:
        """Return the resources that shaders sample, of a pass that declares these reads; in their order."""
        pairs = zip(declared, self.reads, strict=True)
        return [resource for access, resource in pairs if access.use == "sampled"]


@dataclass(frozen=True)
class Edge:
    """`before` comes before `after`, because of `name`: one "reads" it, or "replaces" what the other still has to
    read."""

    before: str
    after: str
    name: str
    why: Literal["reads", "replaces"]


@dataclass(frozen=True)
class Place:
    """Where a transient lies: number of the heap, offset and size in bytes."""

    heap: int
    offset: int
    size: int


@dataclass(frozen=True)
class Heap:
    """Memory that transients share: its size in bytes, and the memory types that it may be of."""

    size: int
    types: int
    alignment: int = 1


@dataclass(frozen=True)
class Memory:
    """Where all transients lie. `lives` says by resource the numbers of the first and the last step that use it."""

    lives: Mapping[str, tuple[int, int]]
    places: Mapping[str, Place]
    heaps: tuple[Heap, ...]
    alone: int
    """Bytes that the transients would take, each in memory of its own."""
    bound: int
    """Bytes that no arrangement can go below: the most that are alive in one step, heap by heap."""

    @property
    def size(self) -> int:
        """Bytes that the heaps take together."""
        return sum(heap.size for heap in self.heaps)


@dataclass(frozen=True)
class Graph:
    """A compiled frame: carried out step by step, it does everything in the right order and nothing in vain."""

    steps: tuple[Step, ...]
    resources: Mapping[str, Resource]
    names: Mapping[str, str]
    """The resource behind every name that a pass declared, those included that were rerouted."""
    edges: tuple[Edge, ...]
    left_out: Mapping[str, str]
    """Passes that are not part of the frame, and why."""
    memory: Memory
    prologue: tuple[Barrier, ...]
    """What must happen once before the first frame, so that each lasting resource is as every frame leaves it."""
    epilogue: tuple[Barrier, ...] = ()
    """What happens behind the last step: externals are handed back as they are expected."""
    missing: tuple[str, ...] = ()
    """Outputs that were asked for and that nobody writes in this frame."""
    size: tuple[int, int] = (1, 1)
    outputs: Mapping[str, str] = field(default_factory=dict)
    """The resource behind every output."""

    def counts(self) -> dict[str, int]:
        """Return the figures of the graph by name, as `frame.work` has them.

        "passes" draw or compute; what only copies is none. "transitions" are the barriers that change a layout or give
        up a content; "transient_bytes" is what the heaps take, "transient_bytes_alone" what they would without sharing.
        """
        barriers = [barrier for step in self.steps for barrier in step.barriers] + [*self.epilogue]
        return {
            "passes": sum(step.kind != "copy" for step in self.steps),
            "passes_skipped": len(self.left_out),
            "barriers": len(barriers),
            "transitions": sum(one.before.layout != one.after.layout or one.discard for one in barriers),
            "transient_bytes": self.memory.size,
            "transient_bytes_alone": self.memory.alone,
        }


Requirements = Callable[[Resource], Requirement]
"""How a backend tells what memory a resource asks for, before it exists."""
