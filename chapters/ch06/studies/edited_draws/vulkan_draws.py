"""The draws of the study edited-draws on Vulkan: one indirect call for each part, or a call for each draw."""

from __future__ import annotations

from typing import Any

import numpy as np

from backends.vulkan import api as vk

from ...frames.vulkan_commands import Commands
from ...scene.draw_lists import COMMAND
from ..drawing_vulkan import Drawing, Drawn
from . import ID_SHADERS, SHADERS, DrawWork, Settings, defines
from .records import DrawnScene, triangles_of
from .shapes import Meshes


class Draws:
    """Meshes, and a pipeline for each part and pass."""

    def __init__(self, study: Drawing, settings: Settings, meshes: Meshes, scene: DrawnScene) -> None:
        self._fn, self._feed, self._scene = study.device.fn, settings.feed, scene
        vertices = np.concatenate([meshes.positions, meshes.normals])
        self.vertices = study.filled(vertices, ["storage", "vertex"], "vertices")
        self._indices = study.filled(meshes.indices, ["index"], "indices")
        self._streams = vk.array("VkBuffer", [self.vertices.handle] * 2)
        self._offsets = vk.array("VkDeviceSize", [0, meshes.positions.nbytes])
        streams = (3, 3) if settings.feed == "attributes" else ()
        macros = [defines(settings, open_mesh) for open_mesh in (False, True)]
        self.colors = [
            study.build(Drawn(SHADERS, part, color="rgba8", name="colours", streams=streams))
            for part in macros
        ]
        self.ids = [
            study.build(Drawn(ID_SHADERS, part, color="r32ui", depth="equal", name="ids", streams=streams))
            for part in macros
        ]

    def begin(self, commands: Commands) -> None:
        """Bind the meshes. The vertex shader of `feed="pulled"` finds vertices in its descriptor set."""
        self._fn.vkCmdBindIndexBuffer(commands.handle, self._indices.handle, 0, vk.VK_INDEX_TYPE_UINT32)
        if self._feed == "attributes":
            self._fn.vkCmdBindVertexBuffers(commands.handle, 0, 2, self._streams, self._offsets)

    def indirect(self, commands: Commands, part: int, edited: Any, counts: Any, work: DrawWork) -> None:
        """Draw a part by one call. With a buffer of `counts` the GPU reads how many draws it makes."""
        (first, count), stride = self._scene.parts[part], COMMAND.itemsize
        if counts is None:
            self._fn.vkCmdDrawIndexedIndirect(commands.handle, edited.handle, first * stride, count, stride)
        else:
            place = (edited.handle, first * stride, counts.handle, 4 * part)
            self._fn.vkCmdDrawIndexedIndirectCount(commands.handle, *place, count, stride)
        work.add(count, self._scene.triangles[part], 1)

    def separate(self, commands: Commands, part: int, visible: np.ndarray, work: DrawWork) -> None:
        """Draw what is visible of a part, with a call for each draw."""
        first, count = self._scene.parts[part]
        kept = self._scene.commands[first : first + count][visible[first : first + count]]
        for command in kept.tolist():
            self._fn.vkCmdDrawIndexed(commands.handle, *command)
        work.add(len(kept), triangles_of(kept), len(kept))
