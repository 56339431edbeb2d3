"""The study edited-draws on Vulkan: a kernel writes commands, and a barrier makes them visible to indirect draws."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers, image_barrier
from backends.vulkan.driver import features as vf
from common.errors import UnsupportedError
from common.view.camera import View

from ...frames.frame import SLOTS
from ...frames.vulkan import FrameSlot
from ...frames.vulkan_commands import Commands, Rendering
from ...scene.draw_lists import COMMAND
from ..drawing_vulkan import Drawing
from . import STUDY, UNIFORM_BYTES, DrawWork, Settings, circle, kernel_of, matrices, plan_of, push, way_of
from .records import MATERIALS, inside, scene_of
from .shapes import all_meshes
from .vulkan_draws import Draws

DRAW_NUMBER = vf.Requirement(bits=((vf.V11, "shaderDrawParameters"),))
STORED = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
DRAWN = (vk.VK_PIPELINE_STAGE_2_DRAW_INDIRECT_BIT, vk.VK_ACCESS_2_INDIRECT_COMMAND_READ_BIT)
READ = (DRAWN[0] | vk.VK_PIPELINE_STAGE_2_HOST_BIT, DRAWN[1] | vk.VK_ACCESS_2_HOST_READ_BIT)
COUNTS = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT | vk.VK_BUFFER_USAGE_INDIRECT_BUFFER_BIT


class Renderer(Drawing):
    """Many meshes, of which those inside a circle are drawn."""

    study = STUDY
    settings_class: type = Settings
    has_depth = True

    def create(self) -> None:
        """Upload meshes and records, and make the pipelines and the buffers that the kernel fills."""
        settings, meshes = self.settings, all_meshes()
        missing = self.device.physical.lacks(DRAW_NUMBER)
        if settings.show == "draw" and missing:
            raise UnsupportedError(f"The numbers of draws need gl_DrawID: {missing}; try --set show=object.")
        self.plan = plan_of(self.capabilities, self.without)
        self.way = way_of(settings, self.plan)
        self.drawn = scene_of(settings.objects, meshes)
        self._draws = Draws(self, settings, meshes, self.drawn)
        objects = self.filled(self.drawn.objects, ["storage"], "objects")
        held = {1: objects, 2: self.filled(MATERIALS[: settings.materials], ["storage"], "materials")}
        if settings.feed == "pulled":
            held[3] = self._draws.vertices
        self._uniforms = self.per_slot(UNIFORM_BYTES, "uniform", "matrices")
        pipeline = self._draws.colors[0]
        self._sets = [self.set_of(pipeline, {0: frame, **held}, frame.name) for frame in self._uniforms]
        self.edited = self.empty(self.drawn.commands.nbytes, ["storage", "indirect"], "edited commands")
        self.draw_counts = [
            self._buffer(8, COUNTS, "readback", f"counts, slot {slot}") for slot in range(SLOTS)
        ]
        if self.way != "separate":
            commands = self.filled(self.drawn.commands, ["storage"], "commands")
            self._kernel = self.pipelines.get([kernel_of(self.way)])[0]
            bound = {0: commands, 1: objects, 2: self.edited}
            more: list[dict[int, Any]] = [{3: it} if self.way == "count" else {} for it in self.draw_counts]
            self._editing = [self.set_of(self._kernel, bound | counts, "commands") for counts in more]
        self._before_kernel = barriers(memory=(*DRAWN, STORED[0], vk.VK_ACCESS_2_NONE))
        self._after_kernel = barriers(memory=(*STORED, *READ))

    def create_sized(self) -> None:
        """Make the target of ids, if it is asked for. Its pass tests against the depth of the first pass."""
        self._with_ids = "instance_id" in self.outputs
        if self._with_ids:
            target, depth = self.target("ids", "r32ui", "instance_id"), self.depth
            assert depth is not None
            begins = self._start(target, "color")
            self._to_ids = barriers(begins, image_barrier(depth.handle, depth.aspect, "depth", "depth"))
            self._second = Rendering(self.size, target, depth, (0, 0, 0, 0))

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Let the kernel edit the commands, and draw both parts, once for colours and once for ids."""
        slot, way = commands.slot.index, self.way
        self.work = work = DrawWork()
        self._uniforms[slot].view(np.float32)[:] = matrices(view, self.size[0] / self.size[1])
        if way != "separate":
            commands.barrier(self._before_kernel)
            commands.begin_label("edit")
            commands.bind_compute(self._kernel)
            commands.bind_compute_set(self._kernel, 0, self._editing[slot])
            commands.push(self._kernel, push(self.settings, self.drawn.parts, time))
            commands.dispatch(2 if way == "count" else -(-self.settings.objects // 64))
            commands.end_label()
            commands.barrier(self._after_kernel)
        commands.begin_label("draws")
        self.begin(commands)
        self._draw_parts(commands, self._draws.colors, time, work)
        self.end(commands)
        if self._with_ids:
            commands.barrier(self._to_ids)
            commands.begin_rendering(self._second)
            self._draw_parts(commands, self._draws.ids, time, work)
            commands.end_rendering()
        commands.end_label()

    def _draw_parts(self, commands: Commands, pipelines: list[Any], time: float, work: DrawWork) -> None:
        slot, draws = commands.slot.index, self._draws
        draws.begin(commands)
        for part, pipeline in enumerate(pipelines):
            commands.bind_pipeline(pipeline, cull=part == 0)
            commands.bind_set(pipeline, 0, self._sets[slot])
            if self.way == "separate":
                visible = inside(self.drawn.objects, circle(self.settings, time))
                draws.separate(commands, part, visible, work)
            else:
                counts = self.draw_counts[slot] if self.way == "count" else None
                draws.indirect(commands, part, self.edited, counts, work)

    def read_told(self, slot: FrameSlot) -> dict[str, int]:
        """Return how many draws the count buffer asked for in the slot's frame, after a wait for it."""
        if self.way != "count":
            return {}
        self._frames.wait(slot)
        buffer = self.draw_counts[slot.index]
        self.device.memory.invalidate(buffer.allocation)
        return {"counted": int(buffer.view(np.uint32).sum())}

    def commands_after(self) -> np.ndarray:
        """Return the commands that the last frame drew, (D,) COMMAND."""
        return self.download(self.edited, STORED).view(COMMAND)
