"""The study timeline-or-fences on Vulkan: a kernel on one queue, a picture on the other, paced in any of the ways."""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from backends.vulkan import api as vk
from backends.vulkan.resources import create_buffer, destroy_buffer
from common.view.camera import View

from ...frames.queues.vulkan_queues import Queues
from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import PipelineDescription
from ..stage_vulkan import Stage
from . import CELLS, STUDY, PaceWork, Settings
from .fences import Fences
from .slots import Slot, Slots, Way
from .timelines import Timelines

KERNEL = "studies/timeline_or_fences/field.comp"
SHADERS = ("post/fullscreen.vert", "studies/timeline_or_fences/show.frag")


class Renderer(Stage):
    """A field that a kernel writes and a shader shows."""

    study = STUDY
    settings_class: type = Settings

    def _set_up(self) -> None:
        super()._set_up()
        self._frames.close()
        queues = Queues(self.device, "async-compute" not in self.without)
        self._frames = slots = Slots(self.device, queues)
        ways: dict[str, Callable[..., Way]] = {
            "timelines": Timelines,
            "timelines-1.2": partial(Timelines, legacy=True),
            "fences": Fences,
        }
        slots.way = ways[self.settings.way](self.device, slots.slots, queues)
        self._families = queues.families
        self._beside = Commands(self.device)

    def create(self) -> None:
        """Make the field, which exists once, and both pipelines."""
        usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
        field = create_buffer(self.device, 4 * CELLS**2, usage, "device", "field", families=self._families)
        self.keep(field, lambda resource: destroy_buffer(self.device, resource))
        defines = (("CELLS", CELLS),)
        self._kernel, self._show = self.pipelines.get(
            [
                ComputeDescription(KERNEL, name="kernel"),
                PipelineDescription(SHADERS, defines, color="rgba8", depth=None, name="show"),
            ]
        )
        self._writing = self.set_of(self._kernel, {0: field}, "field of the kernel")
        self._reading = self.set_of(self._show, {0: field}, "field to show")

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Record the kernel into the compute queue's commands, and the picture into those of graphics."""
        slot = commands.slot
        assert isinstance(slot, Slot)
        beside = self._beside
        beside.begin(slot.beside)
        beside.begin_label("kernel")
        beside.bind_compute(self._kernel)
        beside.bind_compute_set(self._kernel, 0, self._writing)
        phase = int(np.floor(time * 64.0)) & 255
        beside.push(self._kernel, np.array([phase, CELLS, 0, 0], np.uint32))
        beside.dispatch_over(self._kernel, (CELLS, CELLS))
        beside.end_label()
        self.begin(commands)
        commands.bind_pipeline(self._show)
        commands.bind_set(self._show, 0, self._reading)
        commands.draw_triangle()
        self.end(commands)

    def _draw(self, slot: Slot, view: View, time: float) -> None:
        super()._draw(slot, view, time)
        frames, way = self._frames, self._frames.way
        self.work = PaceWork(
            draws=1,
            triangles=1,
            wait_ns=frames.wait_ns,
            submit_ns=frames.submit_ns,
            objects=way.objects,
            cpu_waits=frames.cpu_waits,
            queue_waits=way.queue_waits,
            calls=way.calls + frames.cpu_waits,
        )
