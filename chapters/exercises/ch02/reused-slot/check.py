"""A slot of the bindless set that was given up is neither given out again nor written while a frame may read it."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from common.errors import UnsupportedError
from common.scene import Image, Material
from tests.support.scenes import facing, quad_scene, texture
from tools.exercises.checking import Given


def check(given: Given) -> None:
    """Free a slot between frames that are not waited for."""
    if not given.device.has("bindless"):
        name = given.device.capabilities.device
        raise UnsupportedError(f"This exercise needs bindless textures, which {name} lacks.")
    slots = given.module("frames.frame").SLOTS
    image = Image("texels", np.full((2, 2, 4), 200, np.uint8))
    scene = quad_scene(Material(unlit=True, base_color_texture=texture()), images=(image,))
    with given.open(scene, (8, 8)) as made:
        opened: Any = made
        bindless = opened._data._textures.bindless
        view = bindless._dummy["texture"].view
        slot = bindless.add(view)
        frames = [made.render(facing()) for _ in range(slots)]
        if _waits(given, lambda: bindless.free(slot)):
            # No frame is in flight any more, so the slot may be written and given out at once.
            given.need(bindless.add(view) == slot, f"Slot {slot} is never given out again: slots run out.")
            return
        other = bindless.add(view)
        given.need(
            other != slot,
            f"Slot {slot} was given up, and is given out again at once, while {slots} frames that were submitted may "
            "still read it.",
        )
        written = _written_by(given, made, frames)
        given.need(
            slot not in written,
            f"Slot {slot} was given up, and the next frame writes it, while frames before may still read it.",
        )
        for _ in range(slots + 1):
            made.render(facing()).image("color")
        given.need(bindless.add(view) == slot, f"Slot {slot} is never given out again: slots run out.")


def _waits(given: Given, call: Callable[[], object]) -> bool:
    """Call a function, and return whether it waited until the device was idle."""
    log: list[tuple[str, tuple[Any, ...]]] = []
    given.device.fn.trace(log)
    try:
        call()
    finally:
        given.device.fn.trace(None)
    return any(name in ("vkDeviceWaitIdle", "vkQueueWaitIdle") for name, _ in log)


def _written_by(given: Given, made: Any, frames: list[Any]) -> set[int]:
    """Return the slots that the next frame writes; `frames` are those before, kept until then."""
    log: list[tuple[str, tuple[Any, ...]]] = []
    given.device.fn.trace(log)
    try:
        frames.append(made.render(facing()))
    finally:
        given.device.fn.trace(None)
    calls = [arguments for name, arguments in log if name == "vkUpdateDescriptorSets"]
    return {
        call[2][n].dstArrayElement + k
        for call in calls
        for n in range(call[1])
        for k in range(call[2][n].descriptorCount)
    }
