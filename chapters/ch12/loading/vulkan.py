"""Copies decoded textures to the GPU while frames are drawn. Nothing here waits, except `finish`.

Each frame has a budget of bytes. Decoded pixels are written to the staging ring and copied by a separate submission;
the texture can be sampled when that has ended. If the device has a transfer queue, it copies while the graphics queue
draws, and ownership of the image is transferred. Otherwise there is one queue, and later submissions follow the copies.
Mip levels are made by compute, so always on the graphics queue.
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
    """Copies decoded textures of `loading` to the destinations that `owner` returns.

    Its memory and command buffers are created for the first texture, and freed after the last one.
    """

    def __init__(
        self, device: Device, owner: Owner, loading: Loading, own_queue: bool, ring: int = MOST_RING
    ) -> None:
        """With `own_queue`, copies go to the transfer queue, if the device has one that copies parts of images."""
        self._device, self._owner, self._loading, self._ring_size = device, owner, loading, ring
        other = device.transfer_queue if own_queue else None
        tile = device.physical.families[other.family].granularity if other is not None else (1, 1, 1)
        if other is None or not tile[1]:
            other, tile = device.queue, (1, 1, 1)
        self._queue, self._step = other, tile[1]
        self.one_family = other.family == device.queue.family
        self._staging: Staging | None = None
        # One array for all copies: a scene has hundreds, and new structs would be slower.
        region = {"imageSubresource": {"layerCount": 1}, "imageExtent": {"depth": 1}}
        self._regions = vk.array("VkBufferImageCopy", [region] * MOST_LEVELS)
        self._mips: dict[tuple[str, bool], MipPipeline] = {}
        self._current: Copy | None = None
        self._begun: dict[Request, Copy] = {}  # placed and not arrived
        self._copied: list[Copy] = []  # on the transfer queue, and not transferred yet
        self._framed = False  # whether `advance` was called
        self.bytes = 0
        """The number of bytes copied so far."""
        self.submissions = 0
        """The number of submissions with copies so far."""

    def prepare(self, formats: Iterable[tuple[str, bool]]) -> None:
        """Build mip pipelines for images of (format, whether they are arrays) before the first frame.

        Compressed images contain their levels and need no pipeline.
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

    # --- wanted textures ----------------------------------------------------------------------------------------------

    def want(self, wanted: Mapping[Hashable, Wanted]) -> None:
        """Begin to load all of `wanted` and nothing else; `advance` or `finish` returns the arrived textures."""
        self._drop(self._loading.want(wanted))
        self._loading.feed()

    def _drop(self, requests: list[Request]) -> None:
        for request in requests:
            copy = self._begun.pop(request, None)
            if copy is None:
                continue  # it has arrived: its image belongs to the owner
            if copy is self._current:
                self._current = None
            copy.cancelled = True
            if copy in self._copied:
                self._copied.remove(copy)
            if not copy.flying:
                self._owner.discard(request)

    def finish(self) -> list[Request]:
        """Load everything now and wait; return the textures that have arrived.

        Raises SceneError if one cannot be decoded, unless frames stream textures; textures that have arrived stay.
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
        """Wait for the submission that blocks progress; return whether there was one."""
        if self._staging is None or not (self._begun or self._loading.decoded):
            return False
        for submissions in (self._copies, self._takes):
            if submissions.flying:
                submissions.wait()
                return True
        return False

    # --- the part of a frame ------------------------------------------------------------------------------------------

    def advance(self, budget: int | None = None) -> list[Request]:
        """Copy up to `budget` bytes (None: half of the ring); return the textures that have arrived.

        Work that is submitted to the graphics queue from now on can sample them. Nothing waits: while the GPU is busy
        with earlier copies, the call does nothing. It also does nothing in the first frame, which is shown sooner.
        """
        loading = self._loading
        loading.feed()
        if budget is not None and loading.streams and not self._framed:
            self._framed = True
            return []
        if self._staging is not None:
            self._copies.collect(self._ended)
            if not self.one_family:
                self._takes.collect(lambda submission: None)
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

    def _ended(self, submission: Submission) -> None:
        """Free the staging memory of a submission that has ended."""
        assert self._staging is not None
        self._staging.ring.free_to(submission.mark)
        self._ended_count += 1
        for copy in submission.uploads:
            copy.flying -= 1
            if copy.flying:
                continue
            if copy.cancelled:
                self._owner.discard(copy.request)
            elif copy.ended and not self.one_family:
                self._copied.append(copy)

    def _copy(self, budget: int | None) -> list[Request]:
        """Record copies up to the budget and submit them; return the textures that have arrived with them.

        Without a budget, one half of the ring is written while the GPU copies from the other half.
        """
        assert self._staging is not None
        most = self._staging.ring.capacity // 2 if budget is None else budget
        submission: Submission | None = None
        spent, arrived = 0, []
        while (copy := self._next()) is not None:
            if submission is not None and submission.set_count + copy.target.image.levels > SETS:
                break
            left = most - spent
            if left <= 0:
                break
            if not copy.whole:
                places = self._reserve(copy, left, spent == 0)
                if not places:
                    break
                submission = submission or self._copies.begin()
                spent += self._record(submission, copy, places)
            if copy.whole:
                if is_late(copy.upload, spent, budget):
                    break
                submission = submission or self._copies.begin()
                spent += cost(copy.upload) if budget is not None else 0
                copy.upload = copy.upload.without_bytes()
                self._current = None
                self._loading.copied(copy.request)
                if self._end(submission, copy):
                    arrived.append(copy.request)
        if submission is None:
            return []
        if self._current is not None and self._current.last is submission and self._current.target.held:
            again = part_barrier(self._current.part(), "copy_target", "sampled")
            self._barrier(submission, again)  # frames may be drawn before the rest arrives
        submission.mark = self._staging.ring.head
        signal = self._semaphore_info(self._copies.count + 1) if not self.one_family else None
        self._copies.submit(submission, signal=signal)
        self.submissions += 1
        return arrived

    def _next(self) -> Copy | None:
        """Return the texture to copy next."""
        if self._current is None:
            request = self._loading.take()
            if request is not None:
                assert request.upload is not None, "what is decoded has pixels"
                self._current = Copy(request, request.upload, self._owner.place(request))
                self._begun[request] = self._current
        return self._current

    def _reserve(self, copy: Copy, left: int, first: bool) -> list[tuple[int, int]]:
        """Return (offset in the ring, rows) for each remaining level, or for some rows of one; [] if nothing fits."""
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
        if place is None and first:  # the budget is less than a row: copy one row
            least = min(count, self._step) * row_bytes
            place = ring.take(lambda room: wanted(room, least), alignment)
            if place is None and not ring.used:
                raise ValueError(f"{least} bytes do not fit into a staging ring of {ring.capacity}.")
        return [] if place is None else [(place[0], place[1] // row_bytes)]

    def _record(self, submission: Submission, copy: Copy, places: Sequence[tuple[int, int]]) -> int:
        """Write rows to their places from `_reserve` and record their copy; return their bytes."""
        assert self._staging is not None
        self._touch(submission, copy)
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
        fn.vkCmdCopyBufferToImage(
            submission.commands, handle, image.handle, layout, len(places), self._regions
        )
        self.bytes += spent
        return spent

    def _touch(self, submission: Submission, copy: Copy) -> None:
        """Record the barrier before a submission's first work on a texture."""
        if copy.last is submission:
            return
        if copy.last is None:
            self._barrier(submission, before_copy(copy.part(), copy.target.held))
        elif copy.target.held:
            self._barrier(submission, part_barrier(copy.part(), "sampled", "copy_target"))
        copy.last = submission
        copy.flying += 1
        submission.uploads.append(copy)

    def _end(self, submission: Submission, copy: Copy) -> bool:
        """Record the work after the last copy; return whether the texture has arrived with it."""
        self._touch(submission, copy)
        copy.ended = True
        release, acquire = after_copy(copy.part(), self._queue.family, self._device.queue.family)
        self._barrier(submission, release)
        if acquire is not None:
            return False
        self._make_mips(submission, copy)
        return True

    def _take_over(self) -> list[Request]:
        """Record the acquisitions of images from the transfer queue on the graphics queue; return their requests."""
        submission: Submission | None = None
        taken: list[Request] = []
        while self._copied and self._takes.ready:
            copy = self._copied[0]
            if submission is None:
                submission = self._takes.begin()
            elif submission.set_count + copy.target.image.levels > SETS:
                break
            self._copied.pop(0)
            self._barrier(
                submission, after_copy(copy.part(), self._queue.family, self._device.queue.family)[1]
            )
            self._make_mips(submission, copy)
            taken.append(copy.request)
        if submission is not None:
            # The copies have ended already: the semaphore only makes them visible, and costs no time.
            self._takes.submit(submission, wait=self._semaphore_info(self._ended_count))
        return taken

    def _make_mips(self, submission: Submission, copy: Copy) -> None:
        image, target, copied_levels = copy.target.image, copy.target, len(copy.upload.rows)
        if copied_levels == image.levels:
            return
        plain = "rgba8" if image.format == "rgba8_srgb" else image.format
        pipeline = self._pipeline(plain, image.array)
        if submission.sets is None:
            submission.sets = pipeline.create_pool()
        before = "sampled" if target.held else "undefined"
        self._barrier(
            submission, part_barrier(copy.part(1, image.levels - 1), before, "storage", discard=True)
        )
        pipeline.record(submission.commands, submission.sets, image, plain, copy.upload.srgb, target.layer, 1)
        submission.set_count += image.levels - 1

    def _pipeline(self, format: str, array: bool) -> MipPipeline:
        if (format, array) not in self._mips:
            self._mips[format, array] = MipPipeline(self._device, format, array)
        return self._mips[format, array]

    def _barrier(self, submission: Submission, barrier: Any) -> None:
        self._device.fn.vkCmdPipelineBarrier2(submission.commands, barriers(barrier))

    def _semaphore_info(self, value: int) -> Any:
        stage = vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT
        return vk.new("VkSemaphoreSubmitInfo", semaphore=self._semaphore, value=value, stageMask=stage)

    # --- life ---------------------------------------------------------------------------------------------------------

    def _open(self) -> None:
        """Create the ring, the submissions and, for two queues, the semaphore that counts submissions with copies."""
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
        """Free the threads and the staging memory when nothing is left to load."""
        self._loading.rest()
        if self._staging is None or self._copies.flying or self._takes.flying:
            return
        self._free()

    def _free(self) -> None:
        """Free staging memory and command buffers; pipelines stay, since drivers finish all draws to destroy one."""
        assert self._staging is not None
        for submissions in {self._copies, self._takes}:
            submissions.close()
        if self._semaphore is not None:
            self._device.destroy("VkSemaphore", self._semaphore)
        self._staging.close()
        self._staging = None

    def stop(self) -> None:
        """Join all threads, wait for copies in flight, and free everything; textures that have arrived stay."""
        self._drop(self._loading.stop())
        if self._staging is not None:
            self._device.wait_idle()
            self._copies.collect(self._ended)
            self._takes.collect(lambda submission: None)
            self._free()
        for pipeline in self._mips.values():
            pipeline.close()
        self._mips.clear()
