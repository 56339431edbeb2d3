"""The scene on the GPU, as passes see it: the part that is the same for both APIs.

`vulkan_data.py` and `gl_data.py` hold the buffers and images, and follow the decisions of this module.
"""

from __future__ import annotations

from collections.abc import Sequence
from typing import Any

import numpy as np

from common.scene import Change, Scene, TextureRef

from ..environment import model
from ..frames.commands import SceneBinding
from ..pipelines.description import Binding
from ..settings import Settings
from ..shading import views
from . import geometry
from .draw_lists import Range
from .packing import ROLES, Variant
from .records import Records, Slot
from .textures import texels

ENVIRONMENT_UNIT = 5
"""The first of the three texture units of the environment, after those of materials (forward.frag)."""

ENVIRONMENT_BINDING = 4
"""The first of the three bindings of the environment in the frame's set (forward.frag)."""


class SceneData:
    """Everything that draws read. A backend uploads it, and says what its commands bind."""

    slots: Sequence[Slot]
    streams: list[str]
    """The vertex streams that are uploaded."""

    def __init__(self, scene: Scene, settings: Settings, anisotropy: float, largest_image: int) -> None:
        self._scene, self._settings, self._anisotropy = scene, settings, anisotropy
        self._largest_image = largest_image
        self._energy = settings.environment.energy if model.needed(scene, settings) else None
        self.records = Records(scene, settings.scene.light_cutoff)
        self.environment = model.NO_ENVIRONMENT
        """The environment in the constants of every frame."""
        self.prepared_ms: dict[str, float] = {}
        self._kinds: Any = None
        self._materials_seen = -1
        self._choose_variants()

    def _choose_variants(self) -> None:
        # First: an edit that cannot be followed says so until another one mends it.
        texels.check_images(self._scene, self._largest_image)
        self.variants = [
            views.variant_of(material, self._scene, self._settings, self._energy)
            for material in self._scene.materials
        ]
        self.lit = any(variant.has("LIT") for variant in self.variants)

    @property
    def has_environment(self) -> bool:
        """Whether shaders read the environment's maps."""
        return self._energy is not None and self._scene.environment is not None

    def _tell_environment(self, maps: model.MapsOnGpu) -> None:
        """Keep the levels and units of the environment's maps for shaders, and the time of their preparation."""
        self.prepared_ms = {f"environment {name}": took for name, took in maps.made_ms.items()}
        self.environment = model.frame_values(self._settings.environment, maps.scale, maps.last_level)

    def _used_textures(self) -> list[tuple[str, TextureRef | None]]:
        """Return (role, texture) of everything that some variant samples."""
        return [
            (role, material.textures().get(role))
            for material, variant in zip(self._scene.materials, self.variants, strict=True)
            for role in variant.roles
        ]

    # --- made anew when a material becomes another kind ---

    def _material_kinds(self) -> Any:
        """Return all of each material that is no number in its record: its variant, images and samplers."""
        kinds = []
        for material, variant in zip(self._scene.materials, self.variants, strict=True):
            textures = material.textures()
            used = [(role, textures[role]) for role in variant.roles if role in textures]
            kinds.append(
                (variant, [(texels.key_of(role, texture), texture.sampler) for role, texture in used])
            )
        return kinds

    def follow_materials(self) -> bool:
        """Make what edited materials need, give up what none needs; return whether any became another kind."""
        revision = self._scene.revision[Change.MATERIALS]
        if revision == self._materials_seen:
            return False
        self._choose_variants()
        if self._material_kinds() == self._kinds:
            self._materials_seen = revision
            return False
        # Until `followed`: what is refused halfway is done anew by the next frame, from the start.
        self._kinds = None
        self._replace(geometry.used_streams(self.variants) != self.streams)
        return True

    def followed(self) -> None:
        """Note that pipelines were made, too, for what `follow_materials` made: only then is an edit done with."""
        self._kinds, self._materials_seen = self._material_kinds(), self._scene.revision[Change.MATERIALS]

    def _replace(self, streams_changed: bool) -> None:
        """Upload what the materials need now, and give up what they no longer need."""
        raise NotImplementedError

    # --- what passes read ---

    @property
    def frame_bindings(self) -> tuple[Binding, ...]:
        """The bindings of set 0, which every shader of the scene can read."""
        bindings = [Binding(0, "uniform"), Binding(1, "storage"), Binding(2, "storage")]
        if self.lit:
            bindings.append(Binding(3, "storage", "fragment"))
        first = ENVIRONMENT_BINDING
        maps = range(first, first + 3) if self.has_environment else ()
        return (*bindings, *(Binding(number, "texture", "fragment") for number in maps))

    @staticmethod
    def material_bindings(variant: Variant) -> tuple[Binding, ...]:
        """Return the bindings of set 1: the textures that `variant` samples."""
        return tuple(Binding(ROLES.index(role), "texture", "fragment") for role in variant.roles)

    def sets(self, variant: Variant) -> tuple[tuple[Binding, ...], ...]:
        """Return the sets of a pipeline for `variant`: the frame's, and the material's if it has textures."""
        textures = self.material_bindings(variant)
        return (self.frame_bindings, textures) if textures else (self.frame_bindings,)

    @staticmethod
    def vertex_streams(variant: Variant) -> tuple[tuple[int, int], ...]:
        """Return (location, floats) of the streams that `variant` reads."""
        return tuple(geometry.STREAMS[name] for name in geometry.used_streams([variant]))

    def textures_of(self, material: int) -> Any:
        """Return what binds the textures of a material."""
        raise NotImplementedError

    def draw(self, indices: Range) -> Any:
        """Return a draw as the commands take it."""
        raise NotImplementedError

    def binding(self, slot: int) -> SceneBinding:
        """Return what the draws of slot number `slot` bind of the scene."""
        raise NotImplementedError

    # --- written for every frame ---

    def write_frame(self, slot: int, constants: np.ndarray) -> None:
        """Write the frame's constants."""
        # As bytes: numpy would copy the record member by member.
        self.slots[slot].frame.view(np.uint8)[: constants.nbytes] = np.frombuffer(constants, np.uint8)
