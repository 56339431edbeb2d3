"""The types of the frame graph: the declarations of passes, and the compiled frame, for any graphics API.

    Node       a declared pass: its name, its reads and its writes
    Resource   an image or a buffer, which may have several names
    Touch      one use of a resource: image layout, pipeline stages and kinds of access
    Barrier    the dependency between two touches of a resource
    Step       a pass in the order of the frame, with its barriers and attachments
    Batch      consecutive steps of one queue in one submission
    Graph      the compiled frame, which a backend executes

A *name* stands for the result of one pass. A pass that draws over an older result writes a new name, which continues
the old name (`Access.of`). Both are names of the same *resource*, and the first name is the name of the resource.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from typing import Literal

from backends.contract import Access
from common.errors import UserError

from .sync.batches import Batch

PREVIOUS = "@previous"
"""The suffix of a history's second image, which the previous frame wrote."""


class GraphError(UserError):
    """An invalid graph; the text is one sentence with the names that are wrong."""


@dataclass(frozen=True)
class Node:
    """A declared pass. `why_not` is the reason to leave the pass out of the frame, or ""."""

    name: str
    reads: tuple[Access, ...] = ()
    writes: tuple[Access, ...] = ()
    why_not: str = ""
    queue: str = "graphics"
    """The queue of the pass: "compute" runs beside "graphics" if the device has two queues."""

    @property
    def kind(self) -> Literal["graphics", "compute", "copy"]:
        """The kind of work, from the uses of its accesses: draw to attachments, run compute shaders, or only copy."""
        writes = {access.use for access in self.writes}
        uses = writes | {access.use for access in self.reads}
        if writes & {"color", "depth"} or "depth" in uses:  # a depth test needs draws
            return "graphics"
        return "copy" if uses == {"copy"} else "compute"


@dataclass(frozen=True)
class External:
    """A resource that another object creates and owns; the graph never aliases or frees it.

    `enters` is its touch at the beginning of a frame, `leaves` the required touch at the end (None: any). Both are on
    the graphics queue, unless the resource is unused. An image for several queues is created with concurrent sharing.
    """

    format: str | None
    size: tuple[int, int] | None
    enters: Touch
    leaves: Touch | None = None
    bytes: int = 0
    samples: int = 1


@dataclass(frozen=True)
class Requirement:
    """The memory requirements of a resource: size and alignment in bytes, and a mask of allowed memory types."""

    size: int
    alignment: int = 1
    types: int = 1
    padding: int = 0
    """The bytes at the end of `size` that hold no texels if rows are packed."""


@dataclass(frozen=True)
class Resource:
    """An image or a buffer of a frame.

    `names` has one name for each write; the first one is the name of the resource. `kind` is "attachment" for a target
    of draws, else "texture" or "buffer". A "transient" is used within one frame and may share memory with others. A
    "kept" resource is still valid after the frame (an output, or an inspected image). A "history" has two images: the
    frame writes one; the other, with the suffix `PREVIOUS`, holds the previous frame. An "external" has another owner.
    """

    name: str
    names: tuple[str, ...]
    kind: Literal["attachment", "texture", "buffer"]
    life: Literal["transient", "kept", "history", "external"]
    format: str | None = None
    size: tuple[int, int] | None = None
    bytes: int = 0
    samples: int = 1
    slices: int = 0
    """The slices of a 3D image; 0 for a 2D one."""
    uses: frozenset[str] = frozenset()
    """All uses, over all of its names: a backend creates the resource for these uses."""


@dataclass(frozen=True)
class Touch:
    """One use of a resource. `layout` is "" for buffers; stages and accesses are those of `sync/states.py`."""

    layout: str
    stages: frozenset[str]
    access: frozenset[str]
    writes: bool = False


UNTOUCHED = Touch("undefined", frozenset(), frozenset())
"""The state of memory before its first use."""


@dataclass(frozen=True)
class Barrier:
    """The dependency between two touches of `resource`: execution, visibility, and a layout transition.

    With `discard` the old contents are lost. `before` is then the last touch of the memory. If other resources that
    share the memory had it before, `instead_of` has their names.
    """

    resource: str
    before: Touch
    after: Touch
    discard: bool = False
    instead_of: tuple[str, ...] = ()
    hand_over: tuple[str, str] | None = None
    """(source, destination) of a queue family ownership transfer of an image. The same barrier is in `Step.releases` of
    the last step on the source queue and in `Step.barriers` of the first step on the destination queue. (For a history
    this may be a step of the next frame, where the image has the other name.) The release waits for `before` and makes
    its writes available. The acquisition follows a semaphore wait at the stages of `after`, so these are its source and
    destination stages. Both barriers have both layouts. If the queues are of one family, there is no release, and the
    acquisition is an ordinary barrier. In a prologue, two equal queues are the queue that runs the barrier, and two
    different ones are a release, which the first frame acquires."""


@dataclass(frozen=True)
class Attachment:
    """An attachment of a pass with its load and store operations.

    `store` is "none" for a depth that is only tested: nothing is written, so other passes may read it at the same time.
    """

    resource: str
    load: Literal["clear", "load", "discard"]
    store: Literal["store", "discard", "none"]
    clear: tuple[float, ...] | None = None


@dataclass(frozen=True)
class Step:
    """A pass in the order of the frame. `reads` are the resources of its declared reads, in the same order."""

    name: str
    kind: Literal["graphics", "compute", "copy"]
    barriers: tuple[Barrier, ...] = ()
    colors: tuple[Attachment, ...] = ()
    depth: Attachment | None = None
    size: tuple[int, int] | None = None
    reads: tuple[str, ...] = ()
    writes: tuple[str, ...] = ()
    queue: str = "graphics"
    releases: tuple[Barrier, ...] = ()
    """The releases of images to another queue after this step."""

    def sampled(self, declared: Sequence[Access]) -> list[str]:
        """Return the resources that the shaders sample, in the order of the declared reads."""
        pairs = zip(declared, self.reads, strict=True)
        return [resource for access, resource in pairs if access.use == "sampled"]

    def rates(self, declared: Sequence[Access]) -> tuple[str, tuple[int, int]] | None:
        """Return the mask of shading rates that the rasteriser reads, with the pixels of its texels, or None."""
        pairs = zip(declared, self.reads, strict=True)
        return next(((resource, it.texel) for it, resource in pairs if it.use == "rate"), None)


@dataclass(frozen=True)
class Edge:
    """`before` runs before `after`, which "reads" `name` or "replaces" it after the last read."""

    before: str
    after: str
    name: str
    why: Literal["reads", "replaces"]


@dataclass(frozen=True)
class Place:
    """The place of a transient in memory: number of the heap, offset and size in bytes."""

    heap: int
    offset: int
    size: int
    padding: int = 0
    """The bytes at the end that hold no texels."""


@dataclass(frozen=True)
class Heap:
    """Memory that transients share: its size in bytes, and a mask of allowed memory types."""

    size: int
    types: int
    alignment: int = 1


@dataclass(frozen=True)
class Memory:
    """The places of all transients. `lives` has the first and the last step that use each resource."""

    lives: Mapping[str, tuple[int, int]]
    places: Mapping[str, Place]
    heaps: tuple[Heap, ...]
    alone: int
    """Bytes that the transients would take without sharing."""
    bound: int
    """A lower bound of the bytes: the most that are alive in one step, summed over the heaps."""

    @property
    def size(self) -> int:
        """Bytes that the heaps take together."""
        return sum(heap.size for heap in self.heaps)


@dataclass(frozen=True)
class Graph:
    """A compiled frame: its steps in a valid order, without the passes that the frame does not need."""

    steps: tuple[Step, ...]
    resources: Mapping[str, Resource]
    names: Mapping[str, str]
    """The resource of every declared name, rerouted names included."""
    edges: tuple[Edge, ...]
    left_out: Mapping[str, str]
    """The passes that are left out of the frame, each with the reason."""
    memory: Memory
    prologue: tuple[Barrier, ...]
    """Barriers before the first frame: they bring lasting resources into the state in which frames leave them."""
    epilogue: tuple[Barrier, ...] = ()
    """Barriers after the last step: they bring each external into its required touch."""
    missing: tuple[str, ...] = ()
    """Requested outputs that no pass of this frame writes."""
    size: tuple[int, int] = (1, 1)
    outputs: Mapping[str, str] = field(default_factory=dict)
    """The resource of each output."""
    batches: tuple[Batch, ...] = ()
    """The submissions in their order; none waits for a later one. There is at least one. The last one on the graphics
    queue contains the epilogue. Barriers of the prologue run on the graphics queue, unless `hand_over` has another."""

    def counts(self) -> dict[str, int]:
        """Return the counters of the graph by name, as in `frame.work`.

        "passes" counts passes that draw or compute. "transitions" counts barriers that change a layout or discard
        contents. "transient_bytes" is the size of the heaps, "transient_bytes_alone" their size without sharing.
        """
        barriers = [barrier for step in self.steps for barrier in step.barriers] + [*self.epilogue]
        return {
            "passes": sum(step.kind != "copy" for step in self.steps),
            "passes_skipped": len(self.left_out),
            "barriers": len(barriers),
            "transitions": sum(it.before.layout != it.after.layout or it.discard for it in barriers),
            "transient_bytes": self.memory.size,
            "transient_bytes_alone": self.memory.alone,
        }


Requirements = Callable[[Resource], Requirement]
"""A function that returns the memory requirements of a resource before it exists; each backend has one."""
