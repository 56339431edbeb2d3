"""Study: a buffer of 4 MiB of which few pages have memory, and whose content moves without a byte being copied.

A sparse buffer is a range of addresses. The queue binds pages of memory to it, and may bind them elsewhere later: then
the content is at the new addresses. Here a kernel writes each page once, in the first frame. From there on, only
binds move the pages, and another kernel finds every word where its page is now.

A shader can ask whether a texel of a sparse image has memory. For buffers there is no such question: the program has to
know which pages it bound. So a list says for each place which page it has, and the other places are not read: what
they return is up to the device.

Only Vulkan binds pages of buffers; OpenGL has that in an extension.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from backends.stage import Work
from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="sparse buffer",
    idea="Memory of a buffer can be bound elsewhere: its content moves by a change of the page table alone.",
    order=4,
    features=("sparse/page-pool",),
)

PAGE_BYTES = 1 << 16
WORDS = PAGE_BYTES // 4
PLACES = 64
"""Pages that the buffer has addresses for."""

NONE = 0xFFFFFFFF
"""The page of a place without memory."""

STRIDE = 3
"""Places from a page to the next one; odd, so no two of them meet in a ring of 64."""

STEPS = 4
"""Times in a second at which all pages move on by a place."""

FOLDER = "studies/sparse_buffer"
SHADERS = ("post/fullscreen.vert", f"{FOLDER}/show.frag")
KERNELS = (f"{FOLDER}/write.comp", f"{FOLDER}/check.comp")


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    pages: int = knob(24, "pages of memory", minimum=1, maximum=PLACES)


@dataclass
class BufferWork(Work):
    """What a frame did: places that were `bound` and `unbound`, bytes of memory, and bytes that a kernel `wrote`."""

    dispatches: int = 0
    bound: int = 0
    unbound: int = 0
    bytes: int = 0
    wrote: int = 0


def layout(settings: Settings, time: float) -> NDArray[np.uint32]:
    """Return (PLACES,) the page at each place of the buffer at a time, NONE for a place without memory."""
    pages = np.arange(settings.pages)
    places = np.full(PLACES, NONE, np.uint32)
    places[(STRIDE * pages + math.floor(STEPS * time)) % PLACES] = pages
    return places


def work_of(
    settings: Settings, before: NDArray[np.uint32], after: NDArray[np.uint32], new: bool
) -> BufferWork:
    """Return the counters of a frame that changes one layout into another; a `new` buffer is written."""
    changed = before != after
    return BufferWork(
        draws=1,
        triangles=1,
        dispatches=1 + int(new),
        bound=int((changed & (after != NONE)).sum()),
        unbound=int((changed & (after == NONE)).sum()),
        bytes=settings.pages * PAGE_BYTES,
        wrote=settings.pages * PAGE_BYTES if new else 0,
    )


def words_of(page: int) -> NDArray[np.uint32]:
    """Return (WORDS,) the content of a page, as words.glsl has it."""
    index = np.arange(WORDS, dtype=np.uint64)
    mixed = (index * 2654435761 + 40503 * page) & 0xFFFFFFFF
    return (np.uint32(page << 24) | (mixed >> np.uint64(8)).astype(np.uint32)).astype(np.uint32)


def defines() -> tuple[tuple[str, int], ...]:
    """Return the macros of the shaders."""
    return (("WORDS", WORDS), ("PLACES", PLACES))


def told(counts: np.ndarray) -> dict[str, int]:
    """Return counters of a frame: words that were read, and those among them that were wrong."""
    read, wrong = counts.reshape(PLACES, 2).sum(axis=0, dtype=int).tolist()
    return {"read_words": read, "wrong_words": wrong}
