"""Frames on two queues: the batches of a graph, each submitted after the batches that it depends on.

Every batch waits for values of the queues' timelines, runs its commands, and signals the next value of its own queue.
No batch waits for a later submission, so the same batches also run in the same order if both queues are one. Successive
batches of one queue are submitted in one call.

Recordings are kept by batch. Those of the graphics queue are recorded together, since the draws of a frame change
together. A batch of the compute queue has its own recording, valid while `key(slot)` of its passes stays the same. The
batch is not submitted if all of its passes are `resting` and other batches do not need it.
"""

from __future__ import annotations

from dataclasses import dataclass, field
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.inspection import Inspection

from ...graph.execute.batches import EVERYTHING, Reached, Waited, can_rest
from ...graph.execute.vulkan import GraphExecutor
from ...graph.sync.batches import Batch
from ...graph.sync.queues import GRAPHICS, QUEUES
from ...graph.sync.vulkan import STAGES
from ..frame import SLOTS
from ..recording.vulkan_recordings import RecordedSlot, Recordings
from ..vulkan import FrameSlot
from ..vulkan_commands import Commands
from ..vulkan_profiler import Profiler
from .vulkan_pace import ALL_COMMANDS, Pace, sign
from .vulkan_queues import Queues


class _OwnCommands(FrameSlot):
    """The commands of a batch. The first graphics batch has those of the slot instead, with the uploads."""

    key: Any = None


@dataclass
class _Part:
    """A batch in one slot. `commands` is a slot or `_OwnCommands`; each frame rewrites the structs in `waits`."""

    number: int
    batch: Batch
    commands: Any
    profiler: Profiler
    waits: Any
    can_rest: bool
    rests: bool = False
    work: dict[str, int] = field(default_factory=dict)

    @property
    def draws(self) -> bool:
        return self.batch.queue == GRAPHICS


class QueueFrames(Recordings):
    """The ring of frame slots, each with its batches: `begin`, `record` the batches that changed, `submit`."""

    def __init__(self, device: Device, queues: Queues) -> None:
        super().__init__(device)
        self.pace.close()
        self.pace = Pace(device, *QUEUES)
        self._queues, self._reached = queues, Reached()
        self._compute_commands = Commands(device)  # for batches that do not draw
        self._parts: list[list[_Part]] = [[] for _ in self.slots]
        self._executor: GraphExecutor
        self.work: dict[str, int] = {}
        """Counters of the last frame: batches, submissions, and waits of one batch for another."""

    # --- creation, once for a graph ---

    def follow(self, executor: GraphExecutor, profiler: Profiler) -> None:
        """Use the batches of another graph from now on; no frame is in flight. `profiler` is for the graphics queue."""
        self._free_parts()
        self._reached.follow()
        self._executor = executor
        compute = self._queues.of["compute"]
        profilers = [
            profiler if batch.queue == GRAPHICS else Profiler(self._device, compute)
            for batch in executor.batches
        ]
        for slot, parts in zip(self.slots, self._parts, strict=True):
            for number, of in enumerate(profilers):
                parts.append(self._make(slot, number, of, not any(part.draws for part in parts)))
        self._infos = vk.ffi.new("VkSubmitInfo2[]", len(profilers))

    def _make(self, slot: RecordedSlot, number: int, profiler: Profiler, first: bool) -> _Part:
        batch, executor = self._executor.batches[number], self._executor
        commands: Any = slot
        if batch.queue != GRAPHICS or not first:
            commands = _OwnCommands(self._device, slot.index, self._queues.of[batch.queue])
        commands.batch = number
        # A resting batch counts as one value of each queue, for batches that wait for it and the next one of its queue.
        waits = vk.array("VkSemaphoreSubmitInfo", [{}] * (len(batch.waits) + 1) * len(QUEUES))
        for info in (commands.submit, commands.submit_both) if commands is slot else (commands.submit,):
            info.pWaitSemaphoreInfos = waits
        return _Part(number, batch, commands, profiler, waits, can_rest(executor.graph, batch))

    def _free_parts(self) -> None:
        workload = [part for parts in self._parts for part in parts]
        for profiler in {id(part.profiler): part.profiler for part in workload if not part.draws}.values():
            profiler.close()
        for part in workload:
            if isinstance(part.commands, _OwnCommands):
                self._device.destroy("VkCommandPool", part.commands.pool)
        self._parts = [[] for _ in self.slots]

    def exchange(self, parked: Any = None) -> Any:
        """Return the recordings of the graph, and go on with those of another one, or with none; no frame in flight.

        Without `parked` recordings the next call is `follow`.
        """
        kept = self.slots, self._parts, self._infos, self._executor
        if parked is None:
            self.slots = [RecordedSlot(self._device, index) for index in range(SLOTS)]
            self._parts = [[] for _ in self.slots]
        else:
            self.slots, self._parts, self._infos, self._executor = parked
        self._reached.follow()
        return kept

    def discard(self, parked: Any) -> None:
        """Free what `exchange` returned; no frame is in flight."""
        kept = self.exchange(parked)
        self._free_parts()
        for slot in self.slots:
            slot.close()
        self.exchange(kept)

    # --- a frame ---

    def record(
        self,
        slot: RecordedSlot,
        commands: Commands,
        inspection: Inspection | None = None,
        again: bool = True,
    ) -> bool:
        """Record the batches that changed; return whether the graphics batches are among them.

        Without `again` every batch is recorded in every frame.
        """
        parts = self._parts[slot.index]
        drawn = [part for part in parts if part.draws]
        keys = tuple(self._key(part) for part in drawn)
        anew = not again or any(part.commands.key != keys for part in drawn)
        if anew:
            commands.begin(drawn[0].commands)
            for part in drawn:
                part.commands.key = None
            for part in drawn:
                self._record(part, keys, commands, inspection)
        for part in parts:
            if not part.draws:
                self._record_compute(part, again)
        slot.work = drawn[0].work | {}
        for part in parts:
            if not part.draws and not part.rests:
                slot.work |= {name: slot.work.get(name, 0) + count for name, count in part.work.items()}
        return anew

    def _record_compute(self, part: _Part, again: bool) -> None:
        passes = [workload for _, workload in self._executor.passes_of(part.number)]
        part.rests = part.can_rest and all(workload.resting for workload in passes)
        key = self._key(part)
        if not part.rests and (not again or part.commands.key != key):
            self._compute_commands.begin(part.commands)
            self._record(part, key, self._compute_commands, None)

    def _key(self, part: _Part) -> tuple[Any, ...]:
        """Return the keys of a batch's passes: its recording is valid while they stay the same."""
        return tuple(workload.key(part.commands.index) for workload in self._executor.keyed[part.number])

    def _record(self, part: _Part, key: Any, commands: Commands, inspection: Inspection | None) -> None:
        slot = part.commands
        with self.recording(slot, key) as handle:
            commands.slot, commands.handle = slot, handle
            if not part.draws or isinstance(slot, RecordedSlot):  # queries of graphics are reset once a frame
                part.profiler.begin_frame(slot)
            self._executor.record(commands, slot.index, part.profiler, inspection)
        part.work = commands.work

    def submit(self, slot: Any) -> None:
        """Submit the slot's batches to their queues, without waiting."""
        if slot.uploading:
            vk.check(self._device.fn.vkEndCommandBuffer(slot.uploads), "vkEndCommandBuffer")
        self._reached.begin_frame()
        self.work = {"batches": 0, "submissions": 0, "queue_waits": 0}
        to: Any = None
        count = 0
        for part in self._parts[slot.index]:
            batch = part.batch
            waits = self._reached.waits(batch)
            if part.rests:
                self._reached.rests(batch, waits)
                continue
            queue = self._queues.of[batch.queue].handle
            if queue != to and count:
                self._call(to, count)
                count = 0
            to = queue
            info = self._info(part, waits)
            value = sign(info, self.pace.timelines[batch.queue])
            self._infos[count] = info[0]
            count += 1
            self._reached.submitted(batch, waits, value)
            self.work["batches"] += 1
            self.work["queue_waits"] += len(waits)
        self._call(to, count)
        slot.values = self._reached.values
        self.number += 1

    def _info(self, part: _Part, waits: list[Waited]) -> Any:
        """Return the VkSubmitInfo2 of a batch with the waits of this frame."""
        slot = part.commands
        info = slot.submit_both if getattr(slot, "uploading", False) else slot.submit
        info.waitSemaphoreInfoCount = len(waits)
        for wait, (queue, reached, stages) in zip(part.waits, waits, strict=False):
            wait.semaphore, wait.value = self.pace.timelines[queue].handle, reached
            wait.stageMask = ALL_COMMANDS if stages == EVERYTHING else sum(STAGES[stage] for stage in stages)
        return info

    def _call(self, queue: Any, count: int) -> None:
        vk.check(self._device.fn.vkQueueSubmit2(queue, count, self._infos, vk.NULL), "vkQueueSubmit2")
        self.work["submissions"] += 1

    def timings(self, slot: RecordedSlot) -> dict[str, float]:
        """Return GPU milliseconds by pass of the slot's finished frame; 0 for the passes of a batch that rested."""
        milliseconds: dict[str, float] = {}
        for part in self._parts[slot.index]:
            passes = [step.name for step, _ in self._executor.passes_of(part.number) if step.kind != "copy"]
            read = dict.fromkeys(passes, 0.0) if part.rests else part.profiler.read(slot)
            milliseconds |= {name: read[name] for name in passes if name in read}
        return milliseconds

    def forget(self) -> None:
        """Invalidate the recordings of all batches."""
        super().forget()
        for part in (part for parts in self._parts for part in parts):
            part.commands.key = None

    def close(self) -> None:
        """Free the slots and their batches, after the GPU has finished with all slots."""
        for slot in self.slots:
            self.wait(slot)
        self._free_parts()
        super().close()
