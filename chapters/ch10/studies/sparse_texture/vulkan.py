"""The study sparse-texture on Vulkan: tiles are bound on the queue, or a table in a buffer takes their place."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from common.errors import UnsupportedError
from common.view.camera import View

from ...frames.vulkan import FrameSlot
from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ...pipelines.vulkan_descriptors import Held, Texture
from ..sparse_vulkan import lacks
from ..stage_vulkan import Stage
from . import (
    FILL,
    KERNELS,
    PAGE_BYTES,
    SHADERS,
    STUDY,
    TEXELS,
    TILE,
    TILES,
    Residency,
    Settings,
    defines,
    told,
)
from .sparse_image import SparseImage

SHADER_STAGES = vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT | vk.VK_PIPELINE_STAGE_2_FRAGMENT_SHADER_BIT
READ = (SHADER_STAGES, vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT | vk.VK_ACCESS_2_SHADER_SAMPLED_READ_BIT)
WRITTEN = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
HOST = (vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT)


class Renderer(Stage):
    """A texture whose tiles have memory around a moving spot."""

    study = STUDY
    settings_class: type = Settings

    def create(self) -> None:
        """Make the texture, sparse or as a pool with a table, and what the CPU writes for each frame."""
        settings = self.settings
        self.residency = Residency(settings)
        self.sparse = settings.way == "sparse" and not lacks(self.device, self.without)
        why = lacks(self.device, self.without, "sparseResidencyAliased")
        if self.sparse and settings.shared and why:
            raise UnsupportedError(f"A page in several places needs aliased memory: {why}; set shared=no.")
        slots = range(self.frame_logic.SLOTS)
        self._tiles = self.per_slot(8 * TILES, "storage", "tiles")
        self._fills = self.per_slot(FILL.itemsize * TILES, "storage", "pages to write")
        self._counts = [self.shared(8 * TILES, f"counts, slot {slot}") for slot in slots]
        macros = defines(self.sparse)
        self._fill, self._count, self._show = self.pipelines.get(
            [
                *(ComputeDescription(kernel, macros, name=kernel) for kernel in KERNELS),
                PipelineDescription(SHADERS, macros, color="rgba8", depth=None, name="show"),
            ]
        )
        written, read = self._texture()
        self._filling, self._counting, self._drawing = [], [], []
        for tiles, fills, counts in zip(self._tiles, self._fills, self._counts, strict=True):
            self._filling.append(self.set_of(self._fill, {0: tiles, 1: written, 2: fills}, "fill"))
            self._counting.append(self.set_of(self._count, {0: tiles, 1: read, 2: counts}, "count"))
            self._drawing.append(self.set_of(self._show, {0: tiles, 1: read}, "show"))
        self._before = barriers(memory=(*READ, *WRITTEN))  # the last frame has read what is written now
        self._filled = barriers(memory=(*WRITTEN, *READ))
        self._counted = barriers(memory=(*WRITTEN, *HOST))

    def _texture(self) -> tuple[Held, Held]:
        """Return the texture as a kernel writes it, and as shaders read it."""
        if not self.sparse:
            pool = self.empty(self.settings.pages * PAGE_BYTES, ["storage"], "pool")
            return pool, pool
        sparse = SparseImage(self.device, self.settings.pages, self.settings.shared)
        self.pages = self.keep(sparse, SparseImage.close)
        view, general = sparse.image.view, vk.VK_IMAGE_LAYOUT_GENERAL
        return Texture(view, vk.NULL, general), Texture(view, self.sampler(TEXELS, "texels"), general)

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Bind what is wanted at this time, write new pages, count, and show."""
        slot = commands.slot.index
        changed, fills = self.residency.update(time)
        self.work = self.residency.work_of(changed, fills)
        if self.sparse and len(changed):
            self.device.wait_idle()  # the frame before still reads the tiles that lose their memory
            self.pages.bind(changed, self.residency.page)
        self._tiles[slot].view(np.uint32)[:] = self.residency.table().reshape(-1)
        if len(fills):
            self._fills[slot].view(FILL)[: len(fills)] = fills
            commands.barrier(self._before)
            commands.begin_label("fill")
            commands.bind_compute(self._fill)
            commands.bind_compute_set(self._fill, 0, self._filling[slot])
            commands.dispatch_over(self._fill, (TILE, TILE, len(fills)))
            commands.end_label()
            commands.barrier(self._filled)
        commands.begin_label("count")
        commands.bind_compute(self._count)
        commands.bind_compute_set(self._count, 0, self._counting[slot])
        commands.dispatch(TILES)
        commands.end_label()
        commands.barrier(self._counted)
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._drawing[slot])
        commands.push(self._show, np.array([*self.size, 0, 0], np.float32))
        commands.draw_triangle()
        self.end(commands)

    def counted(self, slot: FrameSlot) -> np.ndarray:
        """Return (TILES, 2) of the slot's frame: texels of each tile that have memory, and those that are wrong."""
        self._frames.wait(slot)
        counts = self._counts[slot.index]
        self.device.memory.invalidate(counts.allocation)
        return counts.view(np.uint32).reshape(TILES, 2).copy()

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return the sums of what the slot's frame counted."""
        self.last_counts = self.counted(slot)
        return told(self.last_counts)
