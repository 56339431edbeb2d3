"""What a renderer really told Vulkan, as the simulator of `hazards.py` reads it: submissions, barriers, waits and uses.

Calls are noted while some frames are drawn. Barriers are taken from the structs that were handed to the driver, the
order from the command buffers that were submitted (a recording that is submitted again counts again), waits for fences
from the calls. What each pass touches is what it declares, found by the truths of `graph_truths.py`, at the place of
the label of its name.
"""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk
from chapters.ch04.logic.frame_plan import COPY
from tests.support.chapter import graph_truth
from tests.support.graph_truths import PREVIOUS, places_of
from tests.support.hazards import (
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

STAGES = {
    "VERTEX_SHADER": "vertex",
    "FRAGMENT_SHADER": "fragment",
    "COMPUTE_SHADER": "compute",
    "COLOR_ATTACHMENT_OUTPUT": "color",
    "EARLY_FRAGMENT_TESTS": "depth",
    "LATE_FRAGMENT_TESTS": "depth",
    "DRAW_INDIRECT": "indirect",
    "ALL_TRANSFER": "copy",
    "HOST": "host",
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
    "TRANSFER_READ": "copy_read",
    "TRANSFER_WRITE": "copy_write",
    "HOST_READ": "host_read",
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
    bits = {int(getattr(vk, f"{prefix}_{name}_BIT")): word for name, word in table.items()}
    return frozenset(bits[1 << place] for place in range(64) if mask >> place & 1)


def layout(number: int) -> str:
    """Return a layout as the simulator calls it."""
    return {int(getattr(vk, f"VK_IMAGE_LAYOUT_{name}")): word for name, word in LAYOUTS.items()}[int(number)]


def number(handle: Any) -> int:
    """Return a handle as a number."""
    return int(vk.ffi.cast("uintptr_t", handle))


class Trace:
    """The events of the frames of one renderer of a chapter with a frame graph."""

    def __init__(self, renderer: Any) -> None:
        self._renderer = renderer
        self.truth = graph_truth(renderer)
        self._names: dict[int, str] = {}
        for slot, held in enumerate(renderer._executor.images.in_slot):
            for name, one in held.items():
                self._names[number(one.handle)] = self._physical(name, slot)

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

    def events(self, draw: Any, frames: int = 4) -> list[Event]:
        """Draw frames, the first ones of them recorded, and return what happened."""
        renderer = self._renderer
        renderer.device.wait_idle()
        renderer._frames.forget()
        log: list[Any] = []
        renderer.device.fn.trace(log)
        try:
            for _ in range(frames):
                draw()
        finally:
            renderer.device.fn.trace(None)
        return self._events(log)

    def _events(self, log: list[Any]) -> list[Event]:
        slots = {number(slot.commands): slot.index for slot in self._renderer._frames.slots}
        fences = {number(slot.fence): slot.index for slot in self._renderer._frames.slots}
        recorded: dict[int, list[Event]] = {}
        events: list[Event] = []
        submitted: set[int] = set()
        steps = {step.name for step in self._renderer.graph.steps}
        for name, arguments in log:
            if name == "vkBeginCommandBuffer":
                recorded[number(arguments[0])] = []
            elif name == "vkCmdPipelineBarrier2":
                recorded[number(arguments[0])].append(self._barriers(arguments[1]))
            elif name == "vkCmdBeginDebugUtilsLabelEXT":
                label = vk.ffi.string(arguments[1].pLabelName).decode()
                buffer = number(arguments[0])
                if label in steps and buffer in slots:
                    recorded[buffer] += self._uses(label, slots[buffer])
            elif name == "vkQueueSubmit2":
                info = arguments[2]
                for place in range(info.commandBufferInfoCount):
                    events += recorded[number(info.pCommandBufferInfos[place].commandBuffer)]
                slot = fences[number(arguments[3])]
                events.append(Signal(f"slot {slot}"))
                submitted.add(slot)
            elif name == "vkWaitForFences":
                slot = fences[number(arguments[2][0])]
                if slot in submitted:
                    events += [Wait(f"slot {slot}", queue="host"), *self._read(slot)]
        return events

    def _uses(self, step: str, slot: int) -> list[Use]:
        return [
            Use(one.by, self._physical(one.resource, slot), one.touches, one.layout, one.needs, one.fills)
            for one in self.truth.uses(step)
        ]

    def _read(self, slot: int) -> list[Event]:
        """What the CPU does when a slot's fence was waited for: it reads the outputs, and gives their buffers back."""
        written = [step.writes for step in self._renderer.graph.steps if step.name == COPY]
        names = [self._physical(name, slot) for listed in written for name in listed]
        touches = frozenset({("host", "host_read")})
        return [
            *(Use("the CPU", name, touches, queue="host") for name in names),
            *(Given(name) for name in names),
        ]

    def _barriers(self, info: Any) -> Barriers:
        found = [
            self._dependency(
                one, self._names[number(one.image)], layout(one.oldLayout), layout(one.newLayout)
            )
            for one in (info.pImageMemoryBarriers[i] for i in range(info.imageMemoryBarrierCount))
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
