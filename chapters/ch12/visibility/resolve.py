"""The material resolve: the G-buffer, filled from the numbers of triangles by a kernel over all pixels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from backends.contract import Access, Sources
from common.scene import Scene

from ..frames.commands import Commands, SceneBinding
from ..pipelines.compute_description import ComputeDescription
from ..pipelines.description import Built
from ..post.fullscreen import FullscreenPass
from ..scene.packing import ROLES, Variant
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shading import deferred
from .model import FORMAT, RESOLVE, VISIBILITY, flag_defines, in_use

Bind = Callable[[Commands, Built, SceneBinding, Any, Any], None]
"""Binds a kernel with a scene's binding, a page, and a set of textures or None."""

SOURCES = Sources(set=3, first={"texture": 16, "storage": 5, "uniform": 3})
"""The bindings of the visibility buffer and of the targets: behind those of the scene, a page and textures."""

FORMAT_DEFINES = ("COLOR_FORMAT", "NORMAL_FORMAT", "MATERIAL_FORMAT", "EMISSION_FORMAT")
"""The formats of the targets, in their order, as the kernel is told."""


class ResolveSurfacesPass(FullscreenPass):
    """Evaluates the material of each pixel once, whatever lay behind it and however small its triangle is.

    The levels of textures come from analytic gradients, since the pixels of a work group may all have other triangles.
    No device stores to an image of format sRGB from compute, so the kernel computes that code (color_code.glsl).
    """

    name = RESOLVE
    sources = SOURCES

    bind: Bind
    """The bindings of the backend, set by the technique."""
    samples_along = 1
    """Samples along the longer change of uv that the kernel takes by itself; 1 leaves filtering to the device."""

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.reads = (Access(VISIBILITY, "sampled", format=FORMAT),)
        self._scene = parts.scene
        self._targets = tuple(
            Access(target.resource, "storage", format=target.format)
            for target in deferred.written(parts.settings)
        )
        self.writes = self._targets

    def declare(self) -> None:
        """Write the emission, which is the last target, only while a material emits."""
        self.writes = self._targets[: len(deferred.formats(self._scene, self._settings))]

    @staticmethod
    def needed(scene: Scene, settings: Settings) -> bool:
        """Whether there is a visibility buffer."""
        return in_use(settings)

    @property
    def _all(self) -> Variant:
        """The variant that has all that any solid material needs."""
        drawn = [self._data.variants[material] for material in self._draws.used]
        solid = [deferred.surface_alone(it) for it in drawn if it.alpha_mode != "blend"]
        defines = sorted({define for variant in solid for define in variant.defines})
        roles = tuple(role for role in ROLES if any(role in variant.roles for variant in solid))
        return Variant(tuple(defines), "opaque", False, roles)

    def create(self) -> None:
        """Build the pipeline for all solid materials; again when a material became another kind."""
        whole, settings = self._all, self._settings
        derived = settings.visibility.tangents == "derived"
        formats = zip(FORMAT_DEFINES, deferred.formats(self._scene, settings), strict=False)
        defines = (
            *whole.defines,
            *self._data.texture_defines(whole, lambda _: whole),
            *flag_defines(),
            *((("TANGENTS_DERIVED", 1),) if derived else ()),
            *((("SAMPLES_ALONG", "part.which.z"),) if self.samples_along > 1 else ()),
            *(*deferred.code_defines(settings), *deferred.emission_defines(self._scene, settings), *formats),
        )
        described = ComputeDescription("visibility/resolve.comp", defines, name="visibility resolve")
        self.pipelines = self._pipelines.get([described])

    def record(self, commands: Commands) -> None:
        """Record a dispatch for each page of geometry, with each set of textures, that solid objects use."""
        draws, data, textured = self._draws, self._data, bool(self._all.roles)
        (pipeline,) = self.pipelines
        for page, textures in dict.fromkeys((batch.page, batch.textures) for batch in draws.solid):
            images = data.texture_set(textures) if textured else None
            self.bind(commands, pipeline, draws.binding, data.bound_page(draws.slot, page), images)
            commands.push(pipeline, np.array([page, textures, self.samples_along, 0], np.uint32))
            commands.dispatch_over(pipeline, commands.extent)

    def key(self, slot: int) -> Any:
        """Return what the recorded draws depend on: the lists of the scene."""
        return self._draws.key(slot)
