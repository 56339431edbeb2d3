"""The dispatches that build a hierarchy anew on the GPU, and those that refit it afterwards."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import dataclass

from .model import DEPTH_LARGEST, DEPTH_UPPER

CODE_BITS, DIGIT_BITS, RUN_LENGTH = 30, 4, 32
"""Of Morton codes, of a digit of the sort, and how many pairs an invocation of the sort takes: as in the kernels."""


@dataclass(frozen=True)
class Step:
    """A dispatch: the kernel's file, the macro that chooses its part, how many invocations, and its push constants.

    `sorts` says which way a step of the sort goes: False from the first buffer of pairs to the second, True back.
    `upper` says that the kernel is built for the upper level.
    """

    file: str
    part: str
    invocations: int
    push: tuple[int, ...]
    sorts: bool | None = None
    upper: bool = False


@dataclass(frozen=True)
class Rebuilt:
    """A hierarchy that is made on the GPU: its first node, triangle and pair, its triangles, and the mesh's page.

    It has a node for each triangle but one (`pack.mesh_tree` leaves room). Those of four triangles or less have no
    children. With `upper` it is the upper level, and its triangles are the records of instances.
    """

    root: int
    first: int
    triangles: int
    page: int = 0
    pair: int = 0
    upper: bool = False

    @property
    def nodes(self) -> int:
        """How many nodes there are."""
        return max(self.triangles - 1, 1)

    @property
    def width(self) -> int:
        """How many boxes the lowest level of the tree of halves has: a power of two."""
        return 1 << max(self.triangles - 1, 0).bit_length()

    @property
    def bits(self) -> int:
        """How many bits of codes decide: those of the number of triangles come on top, and both are levels of nodes."""
        most = DEPTH_UPPER if self.upper else DEPTH_LARGEST
        return min(CODE_BITS, most - max(self.triangles - 1, 0).bit_length())

    @property
    def sizes(self) -> dict[str, int]:
        """Bytes of the buffers that a rebuild uses: two of pairs, the sort's counts, the tree of halves."""
        counts = 4 * (1 << DIGIT_BITS) * -(-self.triangles // RUN_LENGTH)
        return {"pairs": 8 * self.triangles, "counts": counts, "halves": 2 * 32 * self.width}

    def rebuild(self) -> Iterator[Step]:
        """Yield the steps of a rebuild, with a barrier between each two; the boxes must have been refitted."""
        if not self.triangles:
            return
        yield self._step("CODES", self.triangles)
        back = False
        runs = -(-self.triangles // RUN_LENGTH)
        for shift in range(0, 32, DIGIT_BITS):  # an even number of digits: pairs end where they began
            push = (self.triangles, shift, self.pair, 0)
            yield Step("sort.comp", "COUNTS", runs, push, back)
            yield Step("sort.comp", "SCAN", 1, push, back)
            yield Step("sort.comp", "", runs, push, back)
            back = not back
        if not self.upper:  # leaves of the upper level have records of any order
            yield self._step("ORDER", self.triangles)
        yield from self.refit()

    def refit(self) -> Iterator[Step]:
        """Yield the steps that bring corners and boxes up to date, whose order stays that of the last rebuild."""
        if not self.triangles:
            return
        if not self.upper:
            yield Step("refit.comp", "TRIANGLES", self.triangles, (self.first, self.triangles, self.page, 0))
        yield self._step("BOXES", self.width)
        level = self.width // 2
        while level:
            yield self._step("HALVES", level, level)
            level //= 2
        yield self._step("NODES", self.nodes)

    def _step(self, part: str, invocations: int, level: int = 0) -> Step:
        push = (self.root, self.first, self.triangles, self.bits, level, self.width, self.pair, 0)
        return Step("fast.comp", part, invocations, push, upper=self.upper and part != "HALVES")
