"""Buffers that are taken at the same moment by all threads, for each frame slot: whose pools do they come from?"""

from __future__ import annotations

import threading
from typing import Any

from backends.vulkan import api as vk
from tests.support.scenes import quad_scene
from tools.exercises.checking import Given

WORKERS = 2


def check(given: Given) -> None:
    """Let the renderer's thread and its workers each take a buffer while the others do."""
    with given.open(quad_scene(), (8, 8), recording_threads=WORKERS) as made:
        opened: Any = made
        pools = opened._commands._pools
        workers = pools.open()
        found = {slot.index: _taken(given, pools, workers, slot) for slot in opened._frames.slots}
    for slot, by_thread in found.items():
        shared = len(by_thread) - len({*by_thread.values()})
        given.need(
            not shared,
            f"In frame slot {slot}, {len(by_thread)} threads record at the same time, and their buffers come from "
            f"{len({*by_thread.values()})} pools.",
        )
    every = [pool for by_thread in found.values() for pool in by_thread.values()]
    given.need(
        len({*every}) == len(every),
        "Two frame slots take buffers from the same pool: it is reset while the GPU still reads the other frame.",
    )
    given.silent()


def _taken(given: Given, pools: Any, workers: Any, slot: Any) -> dict[int, int]:
    """Return the pool from which each thread's buffer was allocated, by the thread's index."""
    log: list[tuple[str, tuple[Any, ...]]] = []
    buffers: dict[int, int] = {}
    together = threading.Barrier(WORKERS + 1, timeout=10)

    def take(first: int, last: int, thread: int) -> None:
        together.wait()  # else one thread could be done before another one begins
        buffers[thread] = _number(pools.take(slot))

    given.device.fn.trace(log)
    try:
        workers.share("take a buffer", take, WORKERS + 1, WORKERS + 1)
    finally:
        given.device.fn.trace(None)
    pool_of = {
        _number(arguments[2][0]): _number(arguments[1].commandPool)
        for name, arguments in log
        if name == "vkAllocateCommandBuffers"
    }
    return {thread: pool_of[buffer] for thread, buffer in buffers.items()}


def _number(handle: Any) -> int:
    return int(vk.ffi.cast("uintptr_t", handle))
