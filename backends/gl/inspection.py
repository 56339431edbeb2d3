"""Looks at a frame from inside: a copy of what each pass wrote, taken right behind it.

backends/vulkan/inspection.py is the same for Vulkan.
"""

from __future__ import annotations

from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

from backends.contract import Access, Pass, PassWork
from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.readback import Readback
from backends.gl.resources import Image, create_image, destroy_image
from backends.gl.targets import Framebuffer, copy, create_framebuffer, destroy_framebuffer


@dataclass
class _Tap:
    """One output of one pass in one slot.

    An output with several samples is resolved first, from `multisampled` to `resolved`. If a shader `stored` the
    output, the copy needs a barrier.
    """

    depth: bool
    stored: bool
    multisampled: Framebuffer | None
    resolved: Framebuffer | None
    source: Image
    readback: Any = None  # a Readback


class Inspection:
    """Copies of what `passes` write to the `targets` of each slot: a frame in flight may have images of its own.

    With several samples a pixel it is their mean that is copied, of a depth one sample.
    """

    def __init__(
        self, context: Context, passes: Iterable[Pass], targets: Sequence[Mapping[str, Image]]
    ) -> None:
        self._context = context
        self._resolved: list[Image] = []
        self._framebuffers: list[Framebuffer] = []
        self.readbacks: list[dict[str, Readback]] = [{} for _ in targets]
        """For each slot what can be read, by "pass/resource"."""
        self.work = PassWork()
        self._taps: list[dict[str, list[_Tap]]] = [{} for _ in targets]
        for gpu_pass in passes:
            for access in gpu_pass.writes:
                self._tap_in_slots(gpu_pass.name, access, [images[access.resource] for images in targets])

    @property
    def names(self) -> tuple[str, ...]:
        """What can be read: "pass/resource"."""
        return tuple(self.readbacks[0])

    def _tap_in_slots(self, name: str, access: Access, images: Sequence[Image]) -> None:
        taps: dict[int, _Tap] = {}  # by image: most are those of all slots
        for slot, image in enumerate(images):
            if id(image) not in taps:
                taps[id(image)] = self._tap(name, access, image)
            tap = taps[id(image)]
            readback = Readback(self._context, tap.source, f"{name} {image.name}, slot {slot}")
            self._taps[slot].setdefault(name, []).append(replace(tap, readback=readback))
            self.readbacks[slot][f"{name}/{access.resource}"] = readback

    def _tap(self, name: str, access: Access, image: Image) -> _Tap:
        depth, source, multisampled, resolved = access.use == "depth", image, None, None
        if image.samples > 1:
            source = create_image(
                self._context, image.format, (image.width, image.height), f"{name} {image.name}"
            )
            self._resolved.append(source)
            multisampled, resolved = self._framebuffer(image, depth), self._framebuffer(source, depth)
        return _Tap(depth, access.use == "storage", multisampled, resolved, source)

    def _framebuffer(self, image: Image, depth: bool) -> Framebuffer:
        colors, deep = ([], image) if depth else ([image], None)
        self._framebuffers.append(create_framebuffer(self._context, colors, deep, f"inspect {image.name}"))
        return self._framebuffers[-1]

    def record(self, slot: int, gpu_pass: Pass, work: Mapping[str, int]) -> None:
        """Copy what a pass wrote; `work` are the frame's counters so far. Without passes nothing is done."""
        if not any(self._taps):
            return
        self.work.add(gpu_pass.name, work)
        for tap in self._taps[slot].get(gpu_pass.name, ()):
            if tap.stored:
                self._context.fn.glMemoryBarrier(gl.GL_TEXTURE_UPDATE_BARRIER_BIT)
            if tap.multisampled is not None and tap.resolved is not None:
                copy(self._context, tap.multisampled, tap.resolved, depth=tap.depth)
            tap.readback.record()

    def close(self) -> None:
        """Free everything."""
        for held in self.readbacks:
            for readback in held.values():
                readback.close()
            held.clear()
        for framebuffer in self._framebuffers:
            destroy_framebuffer(self._context, framebuffer)
        for image in self._resolved:
            destroy_image(self._context, image)
        self._taps, self._framebuffers, self._resolved = [{} for _ in self._taps], [], []
