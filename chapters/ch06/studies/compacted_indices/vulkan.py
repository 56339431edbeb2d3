"""The study compacted-indices on Vulkan: a kernel writes commands, and indices, which a barrier shows to the draws."""

from __future__ import annotations

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from common.errors import UnsupportedError
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import Built
from ...scene.draw_lists import COMMAND
from ..meshlet_field import check_bytes, defines, field_of
from ..meshlet_field.field_vulkan import STORED, FieldStage
from . import SHADERS, STUDY, WAYS, WRITE, Settings, counters, most_commands, plan_of

DRAWN = (
    vk.VK_PIPELINE_STAGE_2_DRAW_INDIRECT_BIT | vk.VK_PIPELINE_STAGE_2_INDEX_INPUT_BIT,
    vk.VK_ACCESS_2_INDIRECT_COMMAND_READ_BIT | vk.VK_ACCESS_2_INDEX_READ_BIT,
)
READ = (DRAWN[0] | vk.VK_PIPELINE_STAGE_2_HOST_BIT, DRAWN[1] | vk.VK_ACCESS_2_HOST_READ_BIT)


class Renderer(FieldStage):
    """A field whose meshlets are drawn from commands."""

    study = STUDY
    settings_class: type = Settings

    def create(self) -> None:
        """Upload the field, and make the kernels and what they write."""
        settings = self.settings
        self.plan = plan_of(self.capabilities, self.without)
        self.upload(field_of(settings.instances))
        field, limit = self.field, self.capabilities.limits["maxStorageBufferRange"]
        macros = defines(settings.culling, settings.group, WAYS.index(settings.way))
        self.make_kernels(macros)
        self.make_draws(SHADERS, ())
        self._most = most_commands(field, settings.way)
        check_bytes(COMMAND.itemsize * self._most, "commands", limit)
        if self._most > self.device.limits.maxDrawIndirectCount:
            raise UnsupportedError(
                f"This field may need {self._most} commands, and a call of this device draws at most "
                f"{self.device.limits.maxDrawIndirectCount}: set fewer instances."
            )
        self.written = self.empty(COMMAND.itemsize * self._most, ["storage", "indirect"], "commands")
        self.source = self.filled(field.indices, ["storage", "index"], "indices")
        held = {1: self.instances, 2: self.meshlets, 3: self.places, 4: self.sums, 5: self.written}
        self.drawn_indices = self.source
        if settings.way == "indices":
            check_bytes(4 * field.most_indices, "compacted indices", limit)
            self.drawn_indices = self.empty(4 * field.most_indices, ["storage", "index"], "compacted")
            held |= {6: self.source, 7: self.drawn_indices}
        self._write = self.pipelines.get([ComputeDescription(WRITE, macros, name="write")])[0]
        self._writing = self.sets(self._write, held, {})
        self._drawing = self.sets(self.colors, {1: self.instances, 2: self.vertices}, {0: self.uniforms})
        self._before = barriers(memory=(*DRAWN, STORED[0], vk.VK_ACCESS_2_NONE))
        self._after = barriers(memory=(*STORED, *READ))

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Select meshlets, write what draws them, and draw."""
        slot = commands.slot.index
        self.write_view(slot, view, self.settings.turned)
        commands.barrier(self._before)
        self.select(commands)
        commands.compute_barrier()
        commands.begin_label("write")
        commands.bind_compute(self._write)
        commands.bind_compute_set(self._write, 0, self._writing[slot])
        commands.dispatch(len(self.field.instances))
        commands.end_label()
        commands.barrier(self._after)
        self.draw_passes(commands)

    def draw_units(self, commands: Commands, pipeline: Built) -> None:
        """Draw all commands by one call, which reads their number from the totals."""
        fn, slot = self.device.fn, commands.slot.index
        commands.bind_pipeline(pipeline, cull=True)
        commands.bind_set(pipeline, 0, self._drawing[slot])
        fn.vkCmdBindIndexBuffer(commands.handle, self.drawn_indices.handle, 0, vk.VK_INDEX_TYPE_UINT32)
        place = (self.written.handle, 0, self.totals[slot].handle, 0)
        fn.vkCmdDrawIndexedIndirectCount(commands.handle, *place, self._most, COMMAND.itemsize)
        self.work.draws += 1

    def told(self, units: int, triangles: int) -> dict[str, int]:
        """Return the counters of a frame."""
        return counters(self.settings.way, units, triangles)

    def lists_after(self) -> tuple[np.ndarray, np.ndarray]:
        """Return the commands of the last frame and the indices that they draw, both with what lies behind the last."""
        copied = self.settings.way == "indices"
        indices = self.download(self.drawn_indices, STORED).view(np.uint32) if copied else self.field.indices
        return self.download(self.written, STORED).view(COMMAND), indices
