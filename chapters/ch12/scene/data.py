"""The scene on the GPU, as passes see it: the part that is the same for both APIs.

`vulkan_data.py` and `gl_data.py` hold the buffers and images, and follow the decisions of this module.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from typing import Any

import numpy as np

from backends.contract import Sources
from common.scene import Change, Scene
from common.view.camera import View

from ..clusters.model import list_defines
from ..environment import model
from ..fog.model import fog_defines
from ..frames.commands import SceneBinding
from ..hdr.memory import ExposureMemory
from ..loading.importance import material_sizes
from ..loading.loading import Loading, report_failures
from ..settings import Settings
from ..shading import views
from ..shadows.model import places, shadow_constants, shadow_defines
from ..taa.model import texture_defines
from ..visibility.model import index_defines
from . import geometry, packing, pages
from .draw_lists import COMMAND
from .packing import Variant
from .records import RECORD_BYTES, Records, Slot, instance_parts
from .textures import texels
from .textures.reads import uses

ENVIRONMENT_UNIT, ARRAY_UNIT = 0, 3
"""The first texture unit of the environment's three maps, and the first behind them."""

BEHIND_SCENE = Sources(set=1, first={"texture": ARRAY_UNIT, "storage": 4, "uniform": 3})
"""The sources of a pass that reads the scene: set 0, and the first bindings of OpenGL, are the scene's (scene.glsl)."""


class SceneData:
    """Everything that draws read. A backend uploads it, and says what its commands bind."""

    slots: Sequence[Slot]
    page_of: np.ndarray
    """(M,) page of geometry of each mesh."""
    first_index: np.ndarray
    """(M,) where the indices of each mesh begin in its page."""

    def __init__(
        self,
        scene: Scene,
        settings: Settings,
        anisotropy: float,
        limits: tuple[int, int],
        loading: Loading,
    ) -> None:
        self._scene, self._settings, self.anisotropy = scene, settings, anisotropy
        self._largest_image, self._largest_page = limits
        self._energy = settings.environment.energy if model.needed(scene, settings) else None
        self.records = Records(scene, settings.scene.light_cutoff, settings.clusters.most_lights)
        self.environment = model.NO_ENVIRONMENT
        """The environment in the constants of every frame."""
        self.prepared_ms: dict[str, float] = {}
        self._loading = loading
        self._seen_from: View | None = None
        self.texture_work: dict[str, int] = {}
        self._kinds: Any = None
        self.exposures: ExposureMemory | None = None
        self.shadow_places = places(scene, settings)
        self.shadows: Any = None
        """The memory of shadows, if lights cast any (shadows/memory.py)."""
        self.reordered: Callable[[], bool] = lambda: False
        """Puts triangles into the order that materials ask for by now; returns whether any was in another one."""
        self.vertices_read_twice = False
        """Whether the frame after reads a slot's deforming vertices, too (motion/technique.py)."""
        self.fog: Any = None
        """The memory of fog, if there is a medium (fog/memory.py)."""
        self._materials_seen = -1
        self.instance_parts = instance_parts(len(scene.instances), limits[1])
        self.light_lists: Any = None
        """The buffer of the light lists, once the size of the picture is known."""
        # These two refuse what cannot be drawn, before anything is made that would be left behind.
        self._choose_variants()
        self._plan_geometry()

    @property
    def defines(self) -> tuple[tuple[str, int | float | str], ...]:
        """The defines of all shaders: of light lists, and how many instances are in the first of two bindings."""
        (_, first), *more = self.instance_parts
        lists: tuple[Any, ...] = list_defines(self._scene, self._settings)
        lists = (
            *lists,
            *index_defines(self._settings),
            *((("PREVIOUS_WORDS", 1),) if self._scene.deformations else ()),
            *shadow_defines(self._scene, self._settings, self.shadow_places),
            *fog_defines(self._scene, self._settings),
        )
        return (("INSTANCES_PER_PAGE", first // RECORD_BYTES), *lists) if more else lists

    @property
    def constants(self) -> tuple[tuple[str, int], ...]:
        """The specialization constants of all shaders that declare these names."""
        return shadow_constants(self._settings)

    def _choose_variants(self) -> None:
        # First: an edit that cannot be followed says so until another one mends it.
        packing.check_materials(self._scene)
        texels.check_images(self._scene, self._largest_image)
        self.variants = [
            views.variant_of(material, self._scene, self._settings, self._energy)
            for material in self._scene.materials
        ]
        self.lit = any(variant.has("LIT") for variant in self.variants)

    def _plan_geometry(self) -> None:
        """Choose streams and pages; where a mesh is too large for one, nothing has changed."""
        streams = geometry.used_streams(self.variants)
        largest = min(pages.PAGE_BYTES, self._largest_page)
        self.pages = pages.plan_pages(self._scene, streams, largest)
        self.streams = streams

    @property
    def has_environment(self) -> bool:
        """Whether shaders read the environment's maps."""
        return self._energy is not None and self._scene.environment is not None

    def _tell_environment(self, maps: model.MapsOnGpu) -> None:
        """Keep the levels and units of the environment's maps for shaders, and the time of their preparation."""
        self.prepared_ms = {f"environment {name}": took for name, took in maps.made_ms.items()}
        self.environment = model.frame_values(self._settings.environment, maps.scale, maps.last_level)

    # --- made anew when a material becomes another kind ---

    def _material_kinds(self) -> Any:
        """Return all of the materials that is no number in their records: their variants, images and samplers."""
        return uses(self._scene, self.variants), list(self.variants)

    def follow_materials(self) -> bool:
        """Make what edited materials need, give up what none needs; return whether any became another kind.

        The caller then makes the pipelines anew, and the sets.
        """
        revision = self._scene.revision[Change.MATERIALS]
        if revision == self._materials_seen:
            return False
        self._choose_variants()
        if self._material_kinds() == self._kinds:
            self._materials_seen = revision
            return False
        # Until `followed`: what is refused halfway is done anew by the next frame, from the start.
        again, self._kinds = self._kinds is None, None
        streams_changed = self.reordered() or again or geometry.used_streams(self.variants) != self.streams
        if streams_changed:
            self._plan_geometry()
        self._replace(streams_changed)
        return True

    def followed(self) -> None:
        """Note that pipelines were made, too, for what `follow_materials` made: only then is an edit done with."""
        self._kinds, self._materials_seen = self._material_kinds(), self._scene.revision[Change.MATERIALS]

    def _replace(self, streams_changed: bool) -> None:
        """Upload what the materials need now, and give up what they no longer need."""
        raise NotImplementedError

    # --- what passes read ---

    def texture_defines(
        self, needed: Variant, of: Callable[[Variant], Variant] = lambda whole: whole
    ) -> tuple[tuple[str, int | float | str], ...]:
        """Return what the shaders of `needed` are built with, which `of` makes of a material's variant."""
        if not needed.roles:
            return ()
        drawn = [number for number, it in enumerate(self.variants) if of(it).defines == needed.defines]
        return (*self._defines_of(drawn), *texture_defines(self._settings))

    def _defines_of(self, materials: Sequence[int]) -> tuple[tuple[str, int | str], ...]:
        """Return what shaders of these materials are built with, to reach their textures."""
        raise NotImplementedError

    @property
    def textures_of(self) -> np.ndarray:
        """(M,) number of the set that holds each material's textures."""
        raise NotImplementedError

    @property
    def textures(self) -> int:
        """Images that were uploaded."""
        raise NotImplementedError

    def texture_set(self, number: int) -> Any:
        """Return what binds a set of textures."""
        raise NotImplementedError

    def bound_page(self, slot: int, page: int) -> tuple[Any, Any]:
        """Return what binds a page of geometry, and its indices, for slot number `slot`."""
        raise NotImplementedError

    def page_buffer(self, slot: int, page: int) -> Any:
        """Return the buffer of a page of geometry as slot number `slot` draws it."""
        raise NotImplementedError

    def binding(self, slot: int) -> SceneBinding:
        """Return what the draws of slot number `slot` bind of the scene."""
        raise NotImplementedError

    # --- written for every frame ---

    def write_frame(self, slot: int, constants: np.ndarray) -> None:
        """Write the frame's constants."""
        # As bytes: numpy would copy the record member by member.
        self.slots[slot].frame.view(np.uint8)[: constants.nbytes] = np.frombuffer(constants, np.uint8)

    def write_commands(self, slot: int, commands: np.ndarray, first: int = 0) -> int:
        """Write records of draws into the slot's list, from number `first` on; return the bytes written."""
        if len(commands):
            self.slots[slot].commands.view(COMMAND)[first : first + len(commands)] = commands
        return int(commands.nbytes)

    def update_textures(self, slot: int, view: View) -> None:
        """Go on loading, most of all what `view` shows, and name to the slot's materials what has arrived.

        On Vulkan this writes descriptors of textures that are new, so it comes before a frame is recorded.
        """
        if self._loading.decoding and self._seen_from != view:
            self._loading.prioritise(material_sizes(self._scene, self.records.instances, view))
            self._seen_from = view
        copied = self._load_textures(self._loading.budget)
        self.texture_work = self._loading.counts(self.textures, copied)
        report_failures(self._loading, self._scene)
        self.records.write_maps(self.slots[slot], self._maps_revision)

    def load_textures(self) -> None:
        """Wait until all textures are there."""
        self._load_textures(None)

    def _load_textures(self, budget: int | None) -> int:
        """Copy what has arrived, at most `budget` bytes, or wait for all; return the bytes copied."""
        raise NotImplementedError

    @property
    def _maps_revision(self) -> int:
        """How often the numbers changed by which materials know their textures."""
        raise NotImplementedError
