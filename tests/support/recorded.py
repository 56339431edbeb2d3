"""What a frame draws, read from the calls that Vulkan got: the same whether the CPU or a buffer says what a draw is."""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from backends.vulkan import api as vk
from tests.support.chapter import of_backend


@dataclass(frozen=True)
class Draw:
    """One object that is drawn: its number, its indices (first and count), and how its triangles are culled."""

    instance: int
    first_index: int
    index_count: int
    cull: int
    front: int


def draws(renderer: Any, log: Sequence[tuple[str, tuple[Any, ...]]]) -> list[list[Draw]]:
    """Return by rendering (a pass that draws) the objects that a traced frame draws, in their order.

    An object's number is what was pushed last, or else the first instance of its draw. Draws whose records lie in a
    buffer are read from it, so the renderer must still be open.
    """
    found: list[list[Draw]] = []
    pushed: int | None = None
    cull = front = 0
    for name, arguments in log:
        if name == "vkCmdBeginRendering":
            found.append([])
        elif name == "vkCmdPushConstants":
            pushed = int(vk.ffi.cast("uint32_t *", arguments[5])[0])
        elif name == "vkCmdSetCullMode":
            cull = arguments[1]
        elif name == "vkCmdSetFrontFace":
            front = arguments[1]
        elif name in ("vkCmdDrawIndexed", "vkCmdDrawIndexedIndirect"):
            records = [arguments[1:]] if name == "vkCmdDrawIndexed" else _records(renderer, *arguments[1:])
            for count, instances, first, _, number in records:
                assert instances == 1
                found[-1].append(Draw(number if pushed is None else pushed, first, count, cull, front))
    return found


def _records(renderer: Any, buffer: Any, offset: int, count: int, stride: int) -> Iterable[list[int]]:
    (held,) = (one for _, one in of_backend(renderer, "resources").buffers.items() if one.handle == buffer)
    assert stride == 20, "VkDrawIndexedIndirectCommand"
    raw = held.mapped[offset : offset + count * stride]
    found: list[list[int]] = raw.view(np.int32).reshape(count, 5).tolist()
    return found
