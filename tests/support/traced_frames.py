"""What a renderer really told Vulkan, as the simulator of `hazards.py` reads it: submissions, barriers, waits and uses.

Calls are noted while some frames are drawn. Barriers are taken from the structs that were handed to the driver, the
order from the command buffers that were submitted (a recording that is submitted again counts again), waits for fences
and timelines from the calls and from what was submitted. What each pass touches is what it declares, found by the
truths of `graph_truths.py`, at the place of the label of its name.

What signals one timeline counts as a queue, also where the device has but one: what is found then holds for two.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator
from dataclasses import replace
from importlib import import_module
from types import SimpleNamespace
from typing import Any

from backends.vulkan import api as vk
from tests.support.chapter import graph_truth
from tests.support.graph_truths import PREVIOUS, places_of
from tests.support.hazards import (
    ALL_STAGES,
    Barriers,
    Dependency,
    Event,
    Given,
    Hazard,
    Range,
    Signal,
    Use,
    Wait,
    find_hazards,
)
from tests.support.pacing import listed, number, values

STAGES = {
    "VERTEX_SHADER": "vertex",
    "GEOMETRY_SHADER": "geometry",
    "FRAGMENT_SHADER": "fragment",
    "COMPUTE_SHADER": "compute",
    "COLOR_ATTACHMENT_OUTPUT": "color",
    "EARLY_FRAGMENT_TESTS": "depth",
    "LATE_FRAGMENT_TESTS": "depth",
    "DRAW_INDIRECT": "indirect",
    "INDEX_INPUT": "index",
    "TASK_SHADER": "task",
    "MESH_SHADER": "mesh",
    "ALL_TRANSFER": "copy",
    "HOST": "host",
    "ACCELERATION_STRUCTURE_BUILD": "build",
    "RAY_TRACING_SHADER": "rays",
}
ACCESS = {
    "COLOR_ATTACHMENT_READ": "color_read",
    "COLOR_ATTACHMENT_WRITE": "color_write",
    "DEPTH_STENCIL_ATTACHMENT_READ": "depth_read",
    "DEPTH_STENCIL_ATTACHMENT_WRITE": "depth_write",
    "SHADER_SAMPLED_READ": "sampled",
    "SHADER_STORAGE_READ": "storage_read",
    "SHADER_STORAGE_WRITE": "storage_write",
    "UNIFORM_READ": "uniform",
    "INDIRECT_COMMAND_READ": "indirect",
    "INDEX_READ": "index_read",
    "TRANSFER_READ": "copy_read",
    "TRANSFER_WRITE": "copy_write",
    "HOST_READ": "host_read",
    "SHADER_READ": "build_input",  # only builds are told so
    "ACCELERATION_STRUCTURE_READ": "structure_read",
    "ACCELERATION_STRUCTURE_WRITE": "structure_write",
}
LAYOUTS = {
    "UNDEFINED": "undefined",
    "COLOR_ATTACHMENT_OPTIMAL": "color",
    "DEPTH_ATTACHMENT_OPTIMAL": "depth",
    "DEPTH_READ_ONLY_OPTIMAL": "read",
    "SHADER_READ_ONLY_OPTIMAL": "read",
    "GENERAL": "general",
    "TRANSFER_SRC_OPTIMAL": "copy_source",
    "TRANSFER_DST_OPTIMAL": "copy_target",
}


def words(mask: int, table: dict[str, str], prefix: str) -> frozenset[str]:
    """Return the bits of a mask as the simulator calls them; KeyError for one that it does not know."""
    bits = {}
    for name, word in table.items():
        names = (f"{prefix}_{name}_BIT{owner}" for owner in ("", "_EXT", "_KHR"))
        bits[int(getattr(vk, next(bit for bit in names if hasattr(vk, bit))))] = word
    return frozenset(bits[1 << place] for place in range(64) if mask >> place & 1)


def layout(number: int) -> str:
    """Return a layout as the simulator calls it."""
    return {int(getattr(vk, f"VK_IMAGE_LAYOUT_{name}")): word for name, word in LAYOUTS.items()}[int(number)]


class Trace:
    """The events of the frames of one renderer of a chapter with a frame graph.

    With `apart` what signals one timeline is a queue; else all is one queue, as on a device that has no other.
    """

    def __init__(self, renderer: Any, apart: bool = True) -> None:
        self._renderer, self._apart = renderer, apart
        self.truth = graph_truth(renderer)
        self._names: dict[int, str] = {}
        api = getattr(renderer, "_api", renderer)
        for slot, held in enumerate(api.executor.images.in_slot):
            for name, one in held.items():
                self._names[number(one.handle)] = self._physical(name, slot)
        frames = renderer._frames
        self._batches = {number(slot.commands): (slot.index, 0) for slot in frames.slots}
        """Slot and number of the batch of each command buffer."""
        self._timelines: dict[int, str] = {}
        if hasattr(frames, "pace"):
            self._timelines = {number(one.handle): one.name for one in frames.pace.timelines.values()}
            self._batches = {
                number(part.commands.commands): (slot, part.number)
                for slot, parts in enumerate(frames._parts)
                for part in parts
            }

    def _physical(self, name: str, slot: int) -> str:
        """Return the name of one image or buffer: of histories and of what the CPU reads there are two."""
        graph = self._renderer.graph
        resource = graph.resources[name.removesuffix(PREVIOUS)]
        if resource.life == "history":
            return f"{resource.name}#{(slot + (name != resource.name)) % 2}"
        return f"{name}#{slot}" if resource.life == "external" else name

    @property
    def places(self) -> dict[str, Range]:
        """Where the transients lie."""
        return places_of(self._renderer.graph)

    def events(self, draw: Callable[[], object], frames: int = 4) -> list[Event]:
        """Draw frames, the first ones of them recorded, and return what happened."""
        # What structs hold is read while they hold it: they are rewritten from frame to frame.
        events: list[Event] = []
        self._recorded: dict[int, list[Event]] = {}
        self._signalled: dict[Any, str] = {}
        self._running: dict[int, set[Any]] = {}  # by slot, what was submitted and not waited for
        log = _Reader(lambda name, arguments: events.extend(self._read_call(name, arguments)))
        renderer = self._renderer
        renderer.device.wait_idle()
        renderer._frames.forget()
        renderer.device.fn.trace(log)
        try:
            for _ in range(frames):
                draw()
        finally:
            renderer.device.fn.trace(None)
        return events

    def _read_call(self, name: str, arguments: Any) -> Iterator[Event]:
        """Yield what a call does to the GPU now, and note what it records for later."""
        steps = {step.name for step in self._renderer.graph.steps}
        recorded = self._recorded
        if name == "vkBeginCommandBuffer":
            recorded[number(arguments[0])] = []
        elif name == "vkCmdPipelineBarrier2":
            recorded[number(arguments[0])].append(self._barriers(arguments[1]))
        elif name == "vkCmdBeginDebugUtilsLabelEXT":
            label = vk.ffi.string(arguments[1].pLabelName).decode()
            buffer = number(arguments[0])
            if label in steps and buffer in self._batches:
                recorded[buffer] += self._uses(label, self._batches[buffer][0])
        elif name == "vkQueueSubmit2":
            for place in range(arguments[1]):
                yield from self._submitted(arguments[2][place], arguments[3])
        elif name == "vkWaitForFences":
            yield from self._waited([number(arguments[2][0])])
        elif name == "vkWaitSemaphores":
            info = arguments[1]
            pairs = [(number(info.pSemaphores[i]), int(info.pValues[i])) for i in range(info.semaphoreCount)]
            yield from self._waited(pairs)

    def _submitted(self, info: Any, fence: Any) -> Iterator[Event]:
        signals: list[Any] = values(info, "Signal")
        if fence != vk.NULL:
            signals.append(number(fence))
        buffers = [
            number(info.pCommandBufferInfos[i].commandBuffer) for i in range(info.commandBufferInfoCount)
        ]
        slot, batch = next(self._batches[one] for one in buffers if one in self._batches)
        queue = self._timelines[signals[0][0]] if self._timelines and self._apart else "main"
        for one in listed(info, "Wait"):
            signal = self._signalled.get((number(one.semaphore), int(one.value)))
            if signal is not None:  # else it was reached before the trace began
                yield Wait(signal, _stages(one.stageMask), queue)
        for buffer in buffers:
            for event in self._recorded[buffer]:
                yield replace(event, queue=queue)
        name = f"batch {batch} of slot {slot}"
        self._running.setdefault(slot, set()).add(signals[0])
        for key in signals:
            self._signalled[key] = name
        yield Signal(name, queue=queue)

    def _waited(self, keys: list[Any]) -> Iterator[Event]:
        """What comes of a wait of the CPU: what was signalled is over, and of a slot that is, outputs can be read."""
        for key in keys:
            if key in self._signalled:
                yield Wait(self._signalled[key], queue="host")
        for slot, running in list(self._running.items()):
            running -= {one for one in running for key in keys if _comes_with(one, key)}
            if not running:
                del self._running[slot]
                yield from self._read(slot)

    def _uses(self, step: str, slot: int) -> list[Use]:
        return [
            Use(one.by, self._physical(one.resource, slot), one.touches, one.layout, one.needs, one.fills)
            for one in self.truth.uses(step)
        ]

    def _read(self, slot: int) -> list[Event]:
        """What the CPU does when it waited for a slot: it reads outputs, and lends what is not the graph's again."""
        graph = self._renderer.graph
        plan = type(self._renderer._plan)
        copy = (
            None if plan is SimpleNamespace else import_module(plan.__module__).COPY
        )  # a test's frames have none
        read = [name for step in graph.steps if step.name == copy for name in step.writes]
        theirs = [name for name, resource in graph.resources.items() if resource.life == "external"]
        touches = frozenset({("host", "host_read")})
        return [
            *(Use("the CPU", self._physical(name, slot), touches, queue="host") for name in read),
            *(Given(self._physical(name, slot)) for name in theirs),
        ]

    def _barriers(self, info: Any) -> Barriers:
        found = [
            self._dependency(
                one, self._names[number(one.image)], layout(one.oldLayout), layout(one.newLayout)
            )
            for one in (info.pImageMemoryBarriers[i] for i in range(info.imageMemoryBarrierCount))
            if not _releases(one)
        ]
        found += [
            self._dependency(one, self._names[number(one.buffer)])
            for one in (info.pBufferMemoryBarriers[i] for i in range(info.bufferMemoryBarrierCount))
        ]
        # A barrier that names no resource is one of each.
        found += [
            self._dependency(one, name)
            for one in (info.pMemoryBarriers[i] for i in range(info.memoryBarrierCount))
            for name in sorted(set(self._names.values()))
        ]
        return Barriers(tuple(found))

    @staticmethod
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


def _releases(one: Any) -> bool:
    """Whether a barrier is the first half of handing an image over: it happens once, where the other half stands."""
    return bool(one.srcQueueFamilyIndex != one.dstQueueFamilyIndex and one.dstStageMask == 0)


def _stages(mask: int) -> tuple[str, ...]:
    if mask == vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT:
        return ALL_STAGES
    return tuple(sorted(words(mask, STAGES, "VK_PIPELINE_STAGE_2")))


def _comes_with(one: Any, key: Any) -> bool:
    """Whether a fence or a value is over when another is: with a value of a timeline come all below it."""
    both = isinstance(one, tuple) and isinstance(key, tuple)
    return bool(one[0] == key[0] and one[1] <= key[1]) if both else bool(one == key)


class _Reader(list[Any]):
    """A log that reads each call before it is made."""

    def __init__(self, read: Callable[[str, Any], None]) -> None:
        super().__init__()
        self._read = read

    def append(self, call: Any) -> None:
        """Read a call."""
        self._read(*call)


def hazards_without(events: list[Event], places: dict[str, Range], left_out: Any) -> list[Hazard]:
    """Return the hazards of the events without those parts for which `left_out(event, dependency or None)` holds."""
    kept: list[Event] = []
    for event in events:
        if isinstance(event, Barriers):
            rest = tuple(one for one in event.dependencies if not left_out(event, one))
            kept += [Barriers(rest)] if rest else []
        elif not left_out(event, None):
            kept.append(event)
    return find_hazards(kept, places)
