"""The study cluster-list on Vulkan: a draw of mesh shaders whose grid a kernel has written, or one of task shaders."""

from __future__ import annotations

import numpy as np

from backends.contract import resolve
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.driver import features as vf
from common.errors import UnsupportedError
from common.view.camera import View

from ...frames.vulkan_commands import Commands
from ...pipelines.compute_description import ComputeDescription
from ...pipelines.description import Built
from ..meshlet_field import check_bytes, field_of
from ..meshlet_field.field_vulkan import STORED, FieldStage
from . import LIST, MESH, STUDY, TASK, Settings, blocks_of, folded, macros_of
from .limits import Limits, at_once_of, check_draws, check_plan, triangles_of

DRAW_NUMBER = vf.Requirement(bits=((vf.V11, "shaderDrawParameters"), (vf.CORE, "multiDrawIndirect")))
READ = (
    vk.VK_PIPELINE_STAGE_2_DRAW_INDIRECT_BIT | vk.VK_PIPELINE_STAGE_2_MESH_SHADER_BIT_EXT,
    vk.VK_ACCESS_2_INDIRECT_COMMAND_READ_BIT | vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT,
)
HOST = (vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT)
CLEARED = (vk.VK_PIPELINE_STAGE_2_ALL_TRANSFER_BIT, vk.VK_ACCESS_2_TRANSFER_WRITE_BIT)
ADDED = (
    vk.VK_PIPELINE_STAGE_2_TASK_SHADER_BIT_EXT,
    vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT | vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT,
)


def limits_of(device: Device) -> Limits:
    """Return what a device with mesh shaders allows."""
    limits = vk.new("VkPhysicalDeviceMeshShaderPropertiesEXT")
    properties = vk.new("VkPhysicalDeviceProperties2", pNext=limits)
    device.instance.fn.vkGetPhysicalDeviceProperties2(device.physical.handle, properties)
    most = limits.maxTaskWorkGroupTotalCount, device.limits.maxDrawIndirectCount
    return Limits(limits.maxMeshOutputVertices, limits.maxMeshOutputPrimitives, *most)


class Renderer(FieldStage):
    """A field whose meshlets are drawn by mesh shaders."""

    study = STUDY
    settings_class: type = Settings

    def create(self) -> None:
        """Upload the field, and make the pipelines and the list."""
        settings = self.settings
        self.plan = resolve((), ("mesh-shader",), self.capabilities, self.without)
        check_plan(self.plan, self.capabilities)
        missing = self.device.physical.lacks(DRAW_NUMBER)
        if settings.way == "list" and missing:
            raise UnsupportedError(f"The list needs draws with numbers: {missing}; try --set way=tasks.")
        limits = limits_of(self.device)
        triangles = triangles_of(settings, limits)
        self.upload(field_of(settings.instances, settings.vertices, triangles))
        self._listed = settings.way == "list"
        at_once = at_once_of(settings, self.capabilities)
        check_draws(settings, self.field, limits, at_once)
        macros = macros_of(settings, triangles, at_once)
        words = self.filled(self.field.words, ["storage"], "words")
        held = {1: self.instances, 2: self.vertices, 3: self.meshlets, 4: words}
        if self._listed:
            self.make_kernels(macros)
            self.make_draws((MESH,), macros)
            self.listed = self.empty(8 * self.field.units, ["storage"], "list")
            self._draws = -(-self.field.units // at_once)
            check_bytes(16 * self._draws, "arguments", self.capabilities.limits["maxStorageBufferRange"])
            self.arguments = self.empty(16 * self._draws, ["storage", "indirect"], "arguments")
            self._list = self.pipelines.get([ComputeDescription(LIST, macros, name="list")])[0]
            tables = {1: self.instances, 2: self.places, 3: self.sums, 4: self.listed, 5: self.arguments}
            self._listing = self.sets(self._list, tables, {})
            self._drawing = self.sets(self.colors, held | {5: self.listed}, {0: self.uniforms})
        else:
            blocks = blocks_of(self.field)
            self._grid = folded(len(blocks))
            self.make_draws((TASK, MESH), macros)
            held |= {5: self.filled(blocks, ["storage"], "blocks")}
            self._drawing = self.sets(self.colors, held, {0: self.uniforms, 6: self.totals})
        self._before_kernels = barriers(memory=(*READ, STORED[0], vk.VK_ACCESS_2_NONE))
        self._after_kernels = barriers(memory=(*STORED, READ[0] | HOST[0], READ[1] | HOST[1]))
        self._after_clear = barriers(memory=(*CLEARED, *ADDED))
        self._after_tasks = barriers(memory=(ADDED[0], STORED[1], *HOST))

    def draw(self, commands: Commands, view: View, time: float) -> None:
        """Draw the field, after a list was made or by task shaders."""
        slot = commands.slot.index
        self.write_view(slot, view, self.settings.turned)
        if not self._listed:
            commands.begin_label("clear")
            self.device.fn.vkCmdFillBuffer(commands.handle, self.totals[slot].handle, 0, 16, 0)
            commands.end_label()
            commands.barrier(self._after_clear)
            self.draw_passes(commands)
            commands.barrier(self._after_tasks)
            return
        commands.barrier(self._before_kernels)
        self.select(commands)
        commands.compute_barrier()
        commands.begin_label("list")
        commands.bind_compute(self._list)
        commands.bind_compute_set(self._list, 0, self._listing[slot])
        commands.dispatch(len(self.field.instances))
        commands.end_label()
        commands.barrier(self._after_kernels)
        self.draw_passes(commands)

    def draw_units(self, commands: Commands, pipeline: Built) -> None:
        """Draw the list, or launch the task shaders."""
        fn, slot = self.device.fn, commands.slot.index
        commands.bind_pipeline(pipeline, cull=True)
        commands.bind_set(pipeline, 0, self._drawing[slot])
        if self._listed:
            fn.vkCmdDrawMeshTasksIndirectEXT(commands.handle, self.arguments.handle, 0, self._draws, 16)
        else:
            fn.vkCmdDrawMeshTasksEXT(commands.handle, *self._grid, 1)
        self.work.draws += 1

    def told(self, units: int, triangles: int) -> dict[str, int]:
        """Return the counters of a frame."""
        return {"meshlets": units, "triangles": triangles}

    def list_after(self) -> np.ndarray:
        """Return the list of the last frame, (units, 2) uint32 instance and meshlet, with what lies behind the last."""
        return self.download(self.listed, STORED).view(np.uint32).reshape(-1, 2)
