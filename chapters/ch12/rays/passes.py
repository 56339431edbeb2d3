"""The passes of rays.

    ray_structures   instances and what deforms -> ray_world, which stands for all structures
    rays             ray_world, color_hdr -> color_traced, over a part of the rasterised picture

The picture is one text, whatever finds the hits: a raygen shader, a kernel with ray queries, or a kernel over our BVH.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any, Protocol

import numpy as np

from backends.contract import Access, Pass, Sources
from common.errors import UserError
from common.scene import Scene

from ..frames.commands import Commands, SceneBinding
from ..graph.types import External, Touch
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import Built
from ..scene.pass_parts import PassParts
from ..settings import Settings
from . import model

TRACED = "color_traced"

BUFFERS = ("ray_nodes", "ray_triangles", "ray_instances")
"""The buffers of our BVH, in the order of their bindings."""

SOURCES = Sources(set=3, first={"texture": 16, "storage": 5, "uniform": 3})
"""The bindings of structures and target: behind those of the scene, a page and textures."""

READ = Touch("", frozenset({"compute"}), frozenset({"storage_read"}))
"""The last use of a structure in the frame before."""


class Bind(Protocol):
    """Binds a kernel with a scene's binding, a page, and a set of textures or None."""

    def __call__(
        self, commands: Commands, pipeline: Built, scene: SceneBinding, page: Any, textures: Any
    ) -> None: ...


class RayPicturePass(Pass):
    """Traces the picture, an invocation for each pixel."""

    name = "rays"
    sources = SOURCES
    bind: Bind
    """The bindings of the backend, set by the technique."""
    way = model.BVH
    """What finds hits, set by the technique."""

    def __init__(self, parts: PassParts) -> None:
        self._scene, self._settings, self._data = parts.scene, parts.settings, parts.data
        self._draws, self._pipelines = parts.draws, parts.pipelines
        self.writes = (
            Access(TRACED, "storage", format=parts.settings.shading.color_format, of="color_hdr"),
        )

    def read_structures(self, sizes: Sequence[int]) -> None:
        """Declare the buffers of our BVH, whose sizes in bytes are `sizes`."""
        self.reads = tuple(
            Access(name, "storage", bytes=size) for name, size in zip(BUFFERS, sizes, strict=True)
        )
        self.externals = {
            name: External(None, None, READ, bytes=size) for name, size in zip(BUFFERS, sizes, strict=True)
        }

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether a part of the picture is traced."""
        return model.in_use(settings)

    def create(self) -> None:
        """Build the pipeline for all materials; again when a material became another kind."""
        whole = model.variant_of_all([self._data.variants[material] for material in self._draws.used])
        defines = (
            *whole.defines,
            *self._data.texture_defines(whole, lambda _: whole),
            *model.picture_defines(self._scene, self._settings, self._draws.used),
            ("TARGET_BINDING", len(self.reads)),
        )
        self._textured = bool(whole.roles)
        self.pipelines = self._pipelines.get(
            [ComputeDescription("rays/picture.comp", defines, name="rays")]
        )

    def _bound(self) -> tuple[int, int]:
        """Return the page of geometry and the set of textures of all surfaces.

        Raises UserError if the scene has several: a ray may hit any surface.
        """
        used = np.unique(self._scene.instances.mesh)
        pages = np.unique(self._data.page_of[used]).tolist()
        sets = np.unique(self._data.textures_of[self._draws.used]).tolist() if self._textured else [0]
        for what, count in (("pages of geometry", len(pages)), ("sets of textures", len(sets))):
            if count > 1:
                raise UserError(
                    f"This scene has {count} {what} on this backend, and rays may hit any surface: "
                    "set rays=off, or draw it with Vulkan and bindless textures."
                )
        return (pages or [0])[0], (sets or [0])[0]

    def record(self, commands: Commands) -> None:
        """Record a dispatch over the traced part of the picture."""
        (pipeline,) = self.pipelines
        page, textures = self._bound()
        images = self._data.texture_set(textures) if self._textured else None
        self.bind(commands, pipeline, self._draws.binding, self._data.bound_page(self._draws.slot, page), images)
        width, height = commands.extent
        left = int(np.ceil(np.float32(model.first_column(self._settings)) * np.float32(width)))
        if left < width:
            commands.dispatch_over(pipeline, (width - left, height))

    def key(self, slot: int) -> Any:
        """Return what the recording depends on: pages and textures."""
        return self._draws.revision
