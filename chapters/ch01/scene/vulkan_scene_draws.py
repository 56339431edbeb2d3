"""The draws of the scene as the commands take them: pipelines, sets and push constants, ready to record."""

from __future__ import annotations

from collections.abc import Callable, Sequence

import numpy as np

from backends.vulkan import api as vk
from common.scene import Scene

from ..frames.vulkan_commands import Draw, DrawGroup
from ..pipelines.vulkan import Built
from .draw_lists import DrawLists, Range, build_draw_lists
from .packing import PUSH_SIZE, Variant
from .vulkan_data import SceneData


class DrawListBuilder:
    """Makes the draw lists of a scene, anew only when visibility or the handedness of an object changed."""

    def __init__(self, scene: Scene, data: SceneData) -> None:
        self._scene, self._data = scene, data
        # All push constants there will ever be, written once: draw number i pushes 16 bytes from row i.
        rows = np.zeros((len(scene.instances), PUSH_SIZE // 4), np.uint32)
        rows[:, 0] = np.arange(len(rows))
        self._rows = rows
        base = vk.ffi.cast("char *", vk.ffi.from_buffer(rows)) if len(rows) else vk.NULL
        self._push = [base + PUSH_SIZE * index for index in range(len(rows))]

    def build(self, mirrored: np.ndarray, pipeline_of: Callable[[Variant], Built]) -> DrawLists:
        """Return the lists of what is visible; `mirrored` (I,) bool says whose front faces wind the other way."""

        def make_group(ranges: Sequence[Range], material: int, mirrored: bool) -> DrawGroup:
            variant = self._data.variants[material]
            return DrawGroup(
                pipeline=pipeline_of(variant),
                cull=vk.VK_CULL_MODE_NONE if variant.double_sided else vk.VK_CULL_MODE_BACK_BIT,
                front=vk.VK_FRONT_FACE_CLOCKWISE if mirrored else vk.VK_FRONT_FACE_COUNTER_CLOCKWISE,
                material=material,
                material_set=self._data.material_set(material),
                draws=[Draw(self._push[one.instance], *one[1:]) for one in ranges],
            )

        return build_draw_lists(self._scene, self._data.variants, mirrored, make_group)
