"""The number of work groups that cover a picture or an array, and the limits of a device on work groups.

A dispatch runs whole groups. If the size is not a multiple of the group size, the last groups extend beyond the edge,
and the kernel has to test whether its invocation is inside. With one group less, the remainder would not be computed.
"""

from __future__ import annotations

import math
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from common.errors import ShaderError, UnsupportedError

from ..pipelines.description import Built

MOST_GROUPS = 65_535
"""Work groups that every device supports along each axis: the smallest limit that Vulkan and OpenGL allow."""


def group_count(extent: Sequence[int], group: Sequence[int]) -> tuple[int, int, int]:
    """Return how many work groups of `group` invocations cover `extent` (1 to 3 numbers) once.

    Raises UnsupportedError for more than every device runs in one dispatch.
    """
    sizes = (*extent, 1, 1)[:3]
    groups = tuple(-(-size // of) for size, of in zip(sizes, group, strict=True))
    if max(groups) > MOST_GROUPS:
        shown = "x".join(map(str, extent))
        raise UnsupportedError(
            f"{shown} invocations take {max(groups)} work groups in a row, and a dispatch runs {MOST_GROUPS}: let each "
            "invocation do more, or use another axis as well."
        )
    return groups[0], groups[1], groups[2]


@dataclass(frozen=True)
class GroupLimits:
    """The limits of a device on one work group: invocations in total, along each axis, and bytes of shared memory."""

    most: int
    along: Sequence[int]
    shared: int


def check_group(
    name: str, group: Sequence[int], shared: int, limits: GroupLimits, files: frozenset[Path] = frozenset()
) -> None:
    """Raise ShaderError if a device cannot run a work group of shader `name` with `shared` bytes of shared memory."""
    shown, count = "x".join(map(str, group)), group[0] * group[1] * group[2]
    if count > limits.most:
        raise ShaderError(
            f"{name} has work groups of {shown} = {count} invocations, and this device runs {limits.most}: make "
            "local_size smaller, and dispatch more groups.",
            files,
        )
    for axis, size, limit in zip("xyz", group, limits.along, strict=True):
        if size > limit:
            raise ShaderError(
                f"{name} has work groups of {shown} invocations, and this device runs {limit} along {axis}: make "
                f"local_size_{axis} smaller.",
                files,
            )
    if shared > limits.shared:
        raise ShaderError(
            f"{name} shares {shared} bytes within a work group, and this device has {limits.shared} for one: share "
            "less, or work on less at a time.",
            files,
        )


def check_rays(extent: Sequence[int], most: int) -> None:
    """Raise UnsupportedError for more rays than a device traces in one command."""
    if math.prod(extent) > most:
        shown = "x".join(map(str, extent))
        raise UnsupportedError(
            f"{shown} rays are {math.prod(extent)}, and this device traces {most} in one command: trace tiles of them."
        )


class DispatchCommands:
    """The common base of the compute commands of both APIs."""

    sources: Any = None
    extent = (0, 0)
    work: dict[str, int]

    def dispatch(self, x: int, y: int = 1, z: int = 1) -> None:
        """Run x * y * z work groups of the bound pipeline."""
        raise NotImplementedError

    def dispatch_over(self, pipeline: Built, extent: Sequence[int]) -> None:
        """Run the work groups that cover `extent`, 1 to 3 numbers of invocations: pixels, or elements of an array."""
        self.dispatch(*group_count(extent, pipeline.group))

    def trace(self, pipeline: Built, extent: Sequence[int]) -> None:
        """Run a ray pass over `extent`, 1 to 3 numbers of rays: by work groups, unless the pipeline is one of rays."""
        self.dispatch_over(pipeline, extent)
