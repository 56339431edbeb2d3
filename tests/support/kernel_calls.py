"""What a study told Vulkan or OpenGL about who waits for a kernel, held against what its passes touch.

On Vulkan the calls of some frames become the events of `hazards.py`: barriers from the structs that the driver got,
uses from a table of the test, by the label under which they are recorded. On OpenGL a dispatch owes a memory barrier to
whoever reads what it stored, by the way in which that is read.
"""

from __future__ import annotations

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import replace
from typing import Any

from backends.vulkan import api as vk
from tests.support.hazards import Barriers, Dependency, Event, Given, Signal, Submit, Use, Wait, find_hazards
from tests.support.traced_frames import ACCESS, STAGES, layout, number, words

HOST_READ = frozenset({("host", "host_read")})
HOST_WRITE = frozenset({("host", "host_write")})
ALL = (
    "glCopyNamedBufferSubData",
    "glNamedBufferSubData",
    "glDispatchCompute",
    "glMemoryBarrier",
    "glDrawArrays",
    "glDrawElementsBaseVertex",
    "glDrawArraysInstanced",
    "glMultiDrawElementsIndirect",
    "glMultiDrawElementsIndirectCountARB",
)


def use(by: str, resource: str, *touches: str, layout: str = "", fresh: bool = False) -> Use:
    """Return a use, `touches` as "compute storage_write"; one that is `fresh` needs nothing of what is there.

    A resource whose name ends in "#" exists once per slot.
    """
    pairs = frozenset((stage, access) for stage, access in (one.split() for one in touches))
    return Use(by, resource, pairs, layout, needs=not fresh)


def events_of(
    renderer: Any,
    draw: Callable[[int], None],
    uses: Mapping[str, Sequence[Use]],
    *,
    images: Mapping[str, Any] = {},
    uploaded: Iterable[str] = (),
    downloaded: Iterable[str] = (),
    frames: int = 5,
) -> list[Event]:
    """Return what happened in `frames` frames, of which `draw(number)` draws one.

    `uses` are those of each label; `images` the images among the resources, whose copies are found by themselves; the
    CPU reads what is `downloaded` and writes what is `uploaded` when it gets the slot.
    """
    log: list[Any] = []
    begin, submit = renderer._frames.begin, renderer._frames.submit

    def noted_begin() -> Any:
        slot = begin()
        log.append(("begin", slot.index))
        return slot

    def noted_submit(slot: Any, *more: Any) -> None:
        submit(slot, *more)
        log.append(("submit", slot.index))

    renderer._frames.begin, renderer._frames.submit = noted_begin, noted_submit
    renderer.device.fn.trace(log)
    try:
        for frame in range(frames):
            draw(frame)
    finally:
        renderer.device.fn.trace(None)
        del renderer._frames.begin, renderer._frames.submit
    names = {one.resource for listed in uses.values() for one in listed}
    slots = {which for name, which in log if name == "begin"}
    every = sorted({name + str(slot) if name[-1] == "#" else name for name in names for slot in slots})
    handles = {number(image.handle): name for name, image in images.items()}
    events: list[Event] = []
    recorded: list[Event] = []
    slot, seen = 0, set()
    for name, arguments in log:
        if name == "begin":
            slot = arguments
            if slot in seen:
                events.append(Wait(f"slot {slot}", queue="host"))
                events += [Use("the CPU", f"{one}{slot}", HOST_READ, queue="host") for one in downloaded]
                events += [Given(f"{one}{slot}") for one in downloaded]
            events += [
                Use("the CPU", f"{one}{slot}", HOST_WRITE, needs=False, queue="host") for one in uploaded
            ]
            recorded = []
        elif name == "submit":
            seen.add(slot)
            events += [Submit(), *recorded, Signal(f"slot {slot}")]
        elif name == "vkCmdPipelineBarrier2":
            made = _barriers(arguments[1], every, handles)
            recorded += [Barriers(made)] if made else []
        elif name == "vkCmdCopyImageToBuffer" and number(arguments[1]) in handles:
            copied = handles[number(arguments[1])]
            recorded.append(use("the copy", copied, "copy copy_read", layout="copy_source"))
        elif name == "vkCmdBeginDebugUtilsLabelEXT":
            label = vk.ffi.string(arguments[1].pLabelName).decode()
            for one in uses.get(label, ()):
                own = one.resource + str(slot) if one.resource[-1] == "#" else one.resource
                recorded.append(replace(one, resource=own))
    return events


def barriers_told(device: Any, call: Callable[[], Any], resources: Sequence[str]) -> list[Barriers]:
    """Return the barriers that a function records, of memory that all `resources` lie in."""
    log: list[Any] = []
    device.fn.trace(log)
    try:
        call()
    finally:
        device.fn.trace(None)
    return [
        Barriers(_barriers(arguments[1], resources, {}))
        for name, arguments in log
        if name == "vkCmdPipelineBarrier2"
    ]


def _barriers(info: Any, every: Sequence[str], handles: Mapping[int, str]) -> tuple[Dependency, ...]:
    found = []
    for place in range(info.memoryBarrierCount):
        found += [_dependency(info.pMemoryBarriers[place], name) for name in every]
    for place in range(info.imageMemoryBarrierCount):
        one = info.pImageMemoryBarriers[place]
        if number(one.image) in handles:
            old, new = layout(one.oldLayout), layout(one.newLayout)
            found.append(_dependency(one, handles[number(one.image)], old, new))
    return tuple(found)


def _dependency(one: Any, resource: str, old: str = "", new: str = "") -> Dependency:
    return Dependency(
        resource,
        words(one.srcStageMask, STAGES, "VK_PIPELINE_STAGE_2"),
        words(one.srcAccessMask, ACCESS, "VK_ACCESS_2"),
        words(one.dstStageMask, STAGES, "VK_PIPELINE_STAGE_2"),
        words(one.dstAccessMask, ACCESS, "VK_ACCESS_2"),
        old,
        new,
    )


def without_each(events: Sequence[Event]) -> Iterable[tuple[Event, list[Any]]]:
    """Yield each call of a barrier, with the hazards that are found where it is left out of every frame."""
    different = dict.fromkeys(event for event in events if isinstance(event, Barriers))
    for one in different:
        yield one, find_hazards([event for event in events if event != one], {})


# --- OpenGL ---


def gl_calls(
    context: Any, renderer: Any, draw: Callable[[int], None], frames: int = 5
) -> list[tuple[str, int]]:
    """Return (call, first argument) of dispatches, draws and memory barriers of some frames.

    ("begin", slot) stands before each frame.
    """
    fn, log = context.fn, []
    before = dict(vars(fn))
    begin = renderer._frames.begin

    def noted(name: str, call: Any) -> Any:
        def made(*arguments: Any) -> Any:
            log.append((name, int(arguments[0])))
            return call(*arguments)

        return made

    def noted_begin() -> Any:
        slot = begin()
        log.append(("begin", slot.index))
        return slot

    renderer._frames.begin = noted_begin
    for name in ALL:
        setattr(fn, name, noted(name, getattr(fn, name)))
    try:
        for frame in range(frames):
            draw(frame)
    finally:
        vars(fn).clear()
        vars(fn).update(before)
        del renderer._frames.begin
    return log


def owed(calls: Sequence[tuple[str, int]], reads: Mapping[str, int], own: int = 0) -> list[str]:
    """Return which calls come without a barrier, by name.

    `reads` are the bits that calls need behind a dispatch, "begin" for the CPU; with `own`, dispatches write over what
    the calls of `reads` have read, and need a barrier of that kind behind them.
    """
    stored, read, found = 0, False, []
    for name, argument in calls:
        if name == "glMemoryBarrier":
            stored &= ~argument
            read = read and not argument & own
        elif name == "glDispatchCompute":
            if own and read:
                found.append(f"{name} writes over what was read")
            stored, read = 0xFFFFFFFF, False
        elif name in reads:
            if stored & reads[name]:
                found.append(name)
            read = True
    return found
