"""Copies decoded textures to the GPU, beside the frames: nothing here waits, unless somebody wants all of them now.

Each frame gives away a part of its time, a budget of bytes. What was decoded is written to the staging ring, copied by
a submission of its own, and can be sampled when that has been done. Where the device has a queue for copies alone, that
one does it while the other draws, and the image is handed over; elsewhere both are one queue, and all that is submitted
after the copies comes after them. Mip levels are computed, and therefore made on the graphics queue in any case.
"""

from __future__ import annotations

from collections.abc import Hashable, Iterable, Mapping, Sequence
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.upload import SETS, MipPipeline
from common.images import blocks

from .loading import Loading, Request, Wanted
from .ring import rows_that_fit
from .uploads import MOST_LEVELS, block_rows, cost, is_late, level_places
from .vulkan_barriers import after_copy, before_copy, part_barrier
from .vulkan_copies import Copy, Owner
from .vulkan_staging import MOST_RING, Staging, Submission, Submissions, ring_bytes


class Loader:
    """Takes from `loading` what is decoded, and copies it to where `owner` says.

    Its memory and its command buffers are made when the first texture comes, and freed after the last.
    """

    def __init__(
        self, device: Device, owner: Owner, loading: Loading, own_queue: bool, ring: int = MOST_RING
    ) -> None:
        """With `own_queue` copies go to the device's transfer queue, if it has one that copies parts of images."""
        self._device, self._owner, self._loading, self._ring_size = device, owner, loading, ring
        other = device.transfer_queue if own_queue else None
        tile = device.physical.families[other.family].granularity if other is not None else (1, 1, 1)
        if other is None or not tile[1]:
            other, tile = device.queue, (1, 1, 1)
        self._queue, self._step = other, tile[1]
        self.one_family = other.family == device.queue.family
        self._staging: Staging | None = None
        # Written anew for each copy: a scene has hundreds, and this is quicker than a struct for each.
        region = {"imageSubresource": {"layerCount": 1}, "imageExtent": {"depth": 1}}
        self._regions = vk.array("VkBufferImageCopy", [region] * MOST_LEVELS)
        self._mips: dict[tuple[str, bool], MipPipeline] = {}
        self._current: Copy | None = None
        self._begun: dict[Request, Copy] = {}  # placed, and not arrived
        self._copied: list[Copy] = []  # on the other queue, and not handed over
        self._framed = False  # whether a frame has asked
        self.bytes = 0
        """Bytes that were copied so far."""
        self.submissions = 0
        """Submissions with copies so far."""

    def prepare(self, formats: Iterable[tuple[str, bool]]) -> None:
        """Make ahead what no frame should have to: pipelines for images of (format, whether arrays) with levels.

        Compressed images bring their levels, and need none.
        """
        if self._loading.streams and self._loading.busy:
            pipelines = [self._pipeline(*key) for key in formats if not blocks.is_compressed(key[0])]
            for pipeline in pipelines:
                pipeline.build(srgb=False)
                pipeline.build(srgb=True)
            if self._staging is None:
                self._open()
                self._takes.rehearse(pipelines[0].create_pool if pipelines else None)
                if not self.one_family:
                    self._copies.rehearse(None)

    # --- what is wanted -----------------------------------------------------------------------------------------------

    def want(self, wanted: Mapping[Hashable, Wanted]) -> None:
        """Begin to load all of `wanted`, and nothing else: `advance` or `finish` returns what has arrived."""
        self._drop(self._loading.want(wanted))
        self._loading.feed()

    def _drop(self, requests: list[Request]) -> None:
        for request in requests:
            copy = self._begun.pop(request, None)
            if copy is None:
                continue  # it had arrived, and its image is the owner's
            if copy is self._current:
                self._current = None
            copy.cancelled = True
            if copy in self._copied:
                self._copied.remove(copy)
            if not copy.flying:
                self._owner.discard(request)

    def finish(self) -> list[Request]:
        """Load everything now, and wait for it; return what has arrived.

        Unless frames are to fill in, raises SceneError if not everything can be decoded; what has arrived stays.
        """
        try:
            arrived = self.advance()
            while self._loading.busy:
                before = self.submissions
                arrived += self.advance()
                if self.submissions == before and self._loading.busy and not self._wait_for_gpu():
                    self._loading.wait()
            self._loading.refuse_failed()
        except BaseException:
            self.stop()
            raise
        self._rest()
        return arrived

    def _wait_for_gpu(self) -> bool:
        """Wait for a submission without which nothing goes on, and return whether there was one."""
        if self._staging is None or not (self._begun or self._loading.decoded):
            return False
        for submissions in (self._copies, self._takes):
            if submissions.flying:
                submissions.wait()
                return True
        return False

    # --- a frame's part -----------------------------------------------------------------------------------------------

    def advance(self, budget: int | None = None) -> list[Request]:
        """Copy up to `budget` bytes (None: half of the ring); return the textures that have arrived.

        They can be sampled by all that is submitted to the graphics queue from now on. Nothing is waited for: where the
        GPU still copies what was submitted before, nothing is done. Nor is it for the first frame, which does all else
        for the first time: it is shown the sooner.
        """
        loading = self._loading
        loading.feed()
        if budget is not None and loading.streams and not self._framed:
            self._framed = True
            return []
        if self._staging is not None:
            self._copies.collect(self._ended)
            if not self.one_family:
                self._takes.collect(lambda one: None)
        elif not loading.decoded:
            return []
        arrived = self._take_over() if self._copied else []
        if self._current is not None or loading.decoded:
            self._open()
            if self._copies.ready:
                arrived += self._copy(budget)
        elif not loading.busy:
            self._rest()
        for request in arrived:
            del self._begun[request]
            loading.arrived(request)
        return arrived

    def _ended(self, one: Submission) -> None:
        """Use again what a submission of copies has used."""
        assert self._staging is not None
        self._staging.ring.free_to(one.mark)
        self._ended_count += 1
        for copy in one.uploads:
            copy.flying -= 1
            if copy.flying:
                continue
            if copy.cancelled:
                self._owner.discard(copy.request)
            elif copy.ended and not self.one_family:
                self._copied.append(copy)

    def _copy(self, budget: int | None) -> list[Request]:
        """Record copies up to the budget and submit them; return what has arrived with them.

        Without one, half of the ring is written while the GPU copies from the other.
        """
        assert self._staging is not None
        most = self._staging.ring.capacity // 2 if budget is None else budget
        one: Submission | None = None
        spent, arrived = 0, []
        while (copy := self._next()) is not None:
            if one is not None and one.set_count + copy.target.image.levels > SETS:
                break
            left = most - spent
            if left <= 0:
                break
            if not copy.whole:
                places = self._reserve(copy, left, spent == 0)
                if not places:
                    break
                one = one or self._copies.begin()
                spent += self._record(one, copy, places)
            if copy.whole:
                if is_late(copy.upload, spent, budget):
                    break
                one = one or self._copies.begin()
                spent += cost(copy.upload) if budget is not None else 0
                copy.upload = copy.upload.without_bytes()
                self._current = None
                self._loading.copied(copy.request)
                if self._end(one, copy):
                    arrived.append(copy.request)
        if one is None:
            return []
        if self._current is not None and self._current.last is one and self._current.target.held:
            again = part_barrier(self._current.part(), "copy_target", "sampled")
            self._barrier(one, again)  # frames may be drawn before the rest of it comes
        one.mark = self._staging.ring.head
        signal = self._semaphore_info(self._copies.count + 1) if not self.one_family else None
        self._copies.submit(one, signal=signal)
        self.submissions += 1
        return arrived

    def _next(self) -> Copy | None:
        """Return the texture to go on with."""
        if self._current is None:
            request = self._loading.take()
            if request is not None:
                assert request.upload is not None, "what is decoded has pixels"
                self._current = Copy(request, request.upload, self._owner.place(request))
                self._begun[request] = self._current
        return self._current

    def _reserve(self, copy: Copy, left: int, first: bool) -> list[tuple[int, int]]:
        """Return (offset in the ring, rows) for each level that is left, or for some rows of one; [] if for none."""
        assert self._staging is not None
        levels, ring = copy.upload.rows[copy.level :], self._staging.ring
        count, row_bytes = levels[0].shape[0] - copy.row, levels[0].shape[1]
        width = max(1, copy.upload.shape.width >> copy.level)
        alignment = self._staging.alignment(row_bytes // -(-width // block_rows(copy.upload)))
        starts, end = level_places(levels, alignment)
        if not copy.row and end <= left:
            place = ring.take(lambda room: end if end <= room else 0, alignment)
            if place is not None:
                return [
                    (place[0] + start, level.shape[0]) for start, level in zip(starts, levels, strict=True)
                ]

        def wanted(room: int, most: int) -> int:
            return rows_that_fit(count, row_bytes, self._step, min(room, most)) * row_bytes

        place = ring.take(lambda room: wanted(room, left), alignment)
        if place is None and first:  # the budget is less than a row: then it is one
            least = min(count, self._step) * row_bytes
            place = ring.take(lambda room: wanted(room, least), alignment)
            if place is None and not ring.used:
                raise ValueError(f"{least} bytes do not fit into a staging ring of {ring.capacity}.")
        return [] if place is None else [(place[0], place[1] // row_bytes)]

    def _record(self, one: Submission, copy: Copy, places: Sequence[tuple[int, int]]) -> int:
        """Write rows to their places in the ring, as `_reserve` says, and record their copy; return their bytes."""
        assert self._staging is not None
        self._touch(one, copy)
        image, block, spent = copy.target.image, block_rows(copy.upload), 0
        for (offset, count), region in zip(places, self._regions, strict=False):
            rows, y = copy.upload.rows[copy.level], copy.row * block
            part = rows[copy.row : copy.row + count].reshape(-1)
            self._staging.write(part, offset)
            level = region.imageSubresource
            region.bufferOffset, region.imageOffset.y = offset, y
            level.aspectMask, level.mipLevel, level.baseArrayLayer = (
                image.aspect,
                copy.level,
                copy.target.layer,
            )
            region.imageExtent.width = max(1, image.width >> copy.level)
            region.imageExtent.height = min(count * block, max(1, image.height >> copy.level) - y)
            copy.row += count
            if copy.row == rows.shape[0]:
                copy.level, copy.row = copy.level + 1, 0
            spent += part.size
        layout, fn = vk.VK_IMAGE_LAYOUT_TRANSFER_DST_OPTIMAL, self._device.fn
        handle = self._staging.buffer.handle
        fn.vkCmdCopyBufferToImage(one.commands, handle, image.handle, layout, len(places), self._regions)
        self.bytes += spent
        return spent

    def _touch(self, one: Submission, copy: Copy) -> None:
        """Let a submission work on a texture, whichever has before."""
        if copy.last is one:
            return
        if copy.last is None:
            self._barrier(one, before_copy(copy.part(), copy.target.held))
        elif copy.target.held:
            self._barrier(one, part_barrier(copy.part(), "sampled", "copy_target"))
        copy.last = one
        copy.flying += 1
        one.uploads.append(copy)

    def _end(self, one: Submission, copy: Copy) -> bool:
        """Record what follows the last copy; return whether the texture has arrived with it."""
        self._touch(one, copy)
        copy.ended = True
        release, acquire = after_copy(copy.part(), self._queue.family, self._device.queue.family)
        self._barrier(one, release)
        if acquire is not None:
            return False
        self._make_mips(one, copy)
        return True

    def _take_over(self) -> list[Request]:
        """Record on the graphics queue what makes images its own that were copied by the other one; return them."""
        one: Submission | None = None
        taken: list[Request] = []
        while self._copied and self._takes.ready:
            copy = self._copied[0]
            if one is None:
                one = self._takes.begin()
            elif one.set_count + copy.target.image.levels > SETS:
                break
            self._copied.pop(0)
            self._barrier(one, after_copy(copy.part(), self._queue.family, self._device.queue.family)[1])
            self._make_mips(one, copy)
            taken.append(copy.request)
        if one is not None:
            # The GPU has got there, else we would not: the semaphore orders memory, and costs no time.
            self._takes.submit(one, wait=self._semaphore_info(self._ended_count))
        return taken

    def _make_mips(self, one: Submission, copy: Copy) -> None:
        image, target, given = copy.target.image, copy.target, len(copy.upload.rows)
        if given == image.levels:
            return
        plain = "rgba8" if image.format == "rgba8_srgb" else image.format
        pipeline = self._pipeline(plain, image.array)
        if one.sets is None:
            one.sets = pipeline.create_pool()
        before = "sampled" if target.held else "undefined"
        self._barrier(one, part_barrier(copy.part(1, image.levels - 1), before, "storage", discard=True))
        pipeline.record(one.commands, one.sets, image, plain, copy.upload.srgb, target.layer, 1)
        one.set_count += image.levels - 1

    def _pipeline(self, format: str, array: bool) -> MipPipeline:
        if (format, array) not in self._mips:
            self._mips[format, array] = MipPipeline(self._device, format, array)
        return self._mips[format, array]

    def _barrier(self, one: Submission, barrier: Any) -> None:
        self._device.fn.vkCmdPipelineBarrier2(one.commands, barriers(barrier))

    def _semaphore_info(self, value: int) -> Any:
        stage = vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT
        return vk.new("VkSemaphoreSubmitInfo", semaphore=self._semaphore, value=value, stageMask=stage)

    # --- life ---------------------------------------------------------------------------------------------------------

    def _open(self) -> None:
        """Make the ring, the submissions and, between two queues, the semaphore that counts those with copies."""
        if self._staging is not None:
            return
        self._staging = Staging(self._device, min(self._ring_size, ring_bytes(self._loading)))
        self._copies = Submissions(self._device, self._queue, "texture copies")
        self._takes, self._semaphore, self._ended_count = self._copies, None, 0
        if not self.one_family:
            self._takes = Submissions(self._device, self._device.queue, "texture hand-over")
            kind = vk.new("VkSemaphoreTypeCreateInfo", semaphoreType=vk.VK_SEMAPHORE_TYPE_TIMELINE)
            info = vk.new("VkSemaphoreCreateInfo", pNext=kind)
            self._semaphore = self._device.create("vkCreateSemaphore", info, "texture copies")

    def _rest(self) -> None:
        """Free the threads, and what copies are made with, when nothing is left to load."""
        self._loading.rest()
        if self._staging is None or self._copies.flying or self._takes.flying:
            return
        self._free()

    def _free(self) -> None:
        """Free what copies are made with; pipelines stay, since drivers end drawing before they let one go."""
        assert self._staging is not None
        for one in {self._copies, self._takes}:
            one.close()
        if self._semaphore is not None:
            self._device.destroy("VkSemaphore", self._semaphore)
        self._staging.close()
        self._staging = None

    def stop(self) -> None:
        """Join all threads, wait for the copies that are under way, and free everything; what has arrived stays."""
        self._drop(self._loading.stop())
        if self._staging is not None:
            self._device.wait_idle()
            self._copies.collect(self._ended)
            self._takes.collect(lambda one: None)
            self._free()
        for pipeline in self._mips.values():
            pipeline.close()
        self._mips.clear()
