"""The material resolve: the G-buffer, filled from the numbers of triangles by a pass over all pixels."""

from __future__ import annotations

from collections.abc import Callable
from typing import Any

import numpy as np

from backends.contract import Access, Sources
from common.scene import Scene

from ..frames.commands import Commands
from ..pipelines.description import Built, PipelineDescription
from ..post.fullscreen import FullscreenPass
from ..scene.packing import ROLES, Variant
from ..scene.pass_parts import PassParts
from ..settings import Settings
from ..shading import deferred
from .model import FORMAT, RESOLVE, VISIBILITY, flag_defines, in_use

Draw = Callable[[Commands, Built, Any, Any, Any, np.ndarray], None]
"""Draws the triangle over all pixels with a scene's binding, a page, a set of textures or None, and constants."""

SOURCES = Sources(set=3, first={"texture": 16})
"""The bindings of the visibility buffer: behind those of the scene, a page and textures."""


class ResolveSurfacesPass(FullscreenPass):
    """Evaluates the material of each pixel once, whatever lay behind it and however small its triangle is.

    A pass of fragments and not of compute: the G-buffer's base colour is stored as sRGB, which no device stores from a
    compute shader. Both would do the same work. The full screen is one triangle, so no quad has idle fragments, and the
    levels of textures come from analytic gradients, as they would in compute.
    """

    name = RESOLVE
    sources = SOURCES

    draw: Draw
    """The draw of the backend, set by the technique."""

    def __init__(self, parts: PassParts) -> None:
        super().__init__(parts)
        self.reads = (Access(VISIBILITY, "sampled", format=FORMAT),)
        self._scene, self._targets = parts.scene, deferred.written(parts.settings)
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

    def describe(self) -> PipelineDescription:
        """Return the pipeline for all solid materials."""
        whole, settings = self._all, self._settings
        derived = settings.visibility.tangents == "derived"
        return PipelineDescription(
            shaders=("post/fullscreen.vert", "visibility/resolve.frag"),
            defines=(
                *whole.defines,
                *self._data.texture_defines(whole, lambda _: whole),
                *flag_defines(),
                *((("TANGENTS_DERIVED", 1),) if derived else ()),
                *(*deferred.normal_defines(settings), *deferred.emission_defines(self._scene, settings)),
            ),
            color=deferred.formats(self._scene, settings),
            depth=None,
            name="visibility resolve",
        )

    def record(self, commands: Commands) -> None:
        """Record a draw for each page of geometry, with each set of textures, that solid objects use."""
        draws, data, textured = self._draws, self._data, bool(self._all.roles)
        (pipeline,) = self.pipelines
        for page, textures in dict.fromkeys((batch.page, batch.textures) for batch in draws.solid):
            self.draw(
                commands,
                pipeline,
                draws.binding,
                data.bound_page(draws.slot, page),
                data.texture_set(textures) if textured else None,
                np.array([page, textures, 0, 0], np.uint32),
            )

    def key(self, slot: int) -> Any:
        """Return what the recorded draws depend on: the lists of the scene."""
        return self._draws.key(slot)
