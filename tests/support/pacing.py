"""What frames are paced by, read from the calls that Vulkan gets: fences, or values of timelines.

Structs that are submitted again and again are rewritten in between, so this has to be read when the call is made.
"""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk

End = int | tuple[int, int]
"""A fence, or a semaphore and a value of it."""


def number(handle: Any) -> int:
    """Return a handle as a number."""
    return int(vk.ffi.cast("uintptr_t", handle))


def listed(info: Any, kind: str) -> list[Any]:
    """Return the VkSemaphoreSubmitInfo of a VkSubmitInfo2 of a kind, "Wait" or "Signal"."""
    infos = getattr(info, f"p{kind}SemaphoreInfos")
    return [infos[place] for place in range(getattr(info, f"{kind.lower()}SemaphoreInfoCount"))]


def values(info: Any, kind: str) -> list[tuple[int, int]]:
    """Return (semaphore, value) of what a VkSubmitInfo2 waits for or signals."""
    return [(number(one.semaphore), int(one.value)) for one in listed(info, kind)]


def ends(name: str, arguments: tuple[Any, ...]) -> list[End]:
    """Return what a call of the CPU waits for, or what a submission signals when it is over; [] of other calls.

    Values of 0, which are there from the beginning, are left out.
    """
    found: list[End] = []
    if name == "vkWaitForFences":
        found = [number(arguments[2][place]) for place in range(arguments[1])]
    elif name == "vkWaitSemaphores":
        info = arguments[1]
        found = [
            (number(info.pSemaphores[i]), int(info.pValues[i]))
            for i in range(info.semaphoreCount)
            if info.pValues[i]
        ]
    elif name == "vkQueueSubmit2":
        for place in range(arguments[1]):
            found += values(arguments[2][place], "Signal")
        if arguments[3] != vk.NULL:
            found.append(number(arguments[3]))
    return found
