"""Which lights cast shadows, and what shaders are built with for them; needs no device."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, get_args

import numpy as np
from numpy.typing import NDArray

from common.scene import Scene

from ..scene.packing import LIGHT_KINDS
from .settings import Bias
from .views import SHADOWS

Defines = tuple[tuple[str, int | float | str], ...]

TILE = 128
TILE_BYTES = TILE * TILE * 4
"""A tile is a page of sparse memory: 64 KiB of R32F."""

CUBE_FACES = 6

WIDEST_RADIUS = 16
"""Texels of the widest filter of soft shadows; an eighth of a face if that is less."""

MOST_UNROLLED = 6
"""Texels of the widest radius for which `shadow_loop=auto` makes the loop over taps a constant."""

LEAST = 256
"""Records and words that a buffer has at least."""

REPORTED = 2
"""Frames from a report to its use: its slot's last frame, which is over."""

REPORT_EVERY = 8
"""Frames for each report that is used while something moves."""

MOST_SUNS = 4
"""Directional lights that cast shadows: their cascades follow the view in every frame, light by light."""

DIRECTIONAL = LIGHT_KINDS["directional"]


def wanted(settings: Any) -> bool:
    """Whether the settings ask for shadow maps; a view shows a quantity of a surface, and most of them no light."""
    view = settings.shading.view
    asked = settings.shadows.shadows == "on" and not settings.paths.path_tracer
    return bool(asked and view in ("picture", "non-finite", *SHADOWS))


def possible(scene: Scene, settings: Any) -> bool:
    """Whether a renderer of the scene has shadows: they are wanted, and there are lights and objects.

    The default light travels with the camera, which hardly sees its shadows (scene/default_light.py).
    """
    lights = [light for light in scene.lights if light.name != "default light"]
    return wanted(settings) and bool(lights) and len(scene.instances) > 0


def needed(scene: Scene, settings: Any) -> bool:
    """Whether a frame has shadows: they are possible, and light falls on any object."""
    used = np.unique(scene.meshes["material"][scene.instances.mesh]).tolist()
    return possible(scene, settings) and any(not scene.materials[material].unlit for material in used)


def records_of(scene: Scene, settings: Any) -> int:
    """Return how many lights have records: those that are kept (clusters/lights.py)."""
    return min(len(scene.lights), int(settings.clusters.most_lights))


def most_suns(scene: Scene, settings: Any) -> int:
    """Return how many directional lights cast shadows."""
    suns = sum(light.kind == "directional" for light in scene.lights)
    return min(suns, MOST_SUNS, int(settings.shadows.shadow_lights))


def most_lamps(scene: Scene, settings: Any) -> int:
    """Return how many other lights may cast shadows at a time."""
    lamps = sum(light.kind != "directional" for light in scene.lights)
    left = int(settings.shadows.shadow_lights) - most_suns(scene, settings)
    return min(lamps, records_of(scene, settings), left)


def by_need(settings: Any) -> bool:
    """Whether tiles have memory where the picture needs them. Each light then has a coarse page for what comes next."""
    return bool(settings.shadows.shadow_memory == "pages")


@dataclass(frozen=True)
class Places:
    """The places of faces among their records, and of tiles in the table (`words`).

    The records of a sun are its cascades and then its coarse face; those of a lamp are its faces and then as many
    coarse ones. Coarse faces exist with memory by need alone. Words: a square of `sun_side` x `sun_side` tiles for each
    cascade, one of `lamp_side` x `lamp_side` for each of six faces of a lamp, then one word for each coarse page.
    """

    suns: int
    cascades: int
    sun_side: int
    lamps: int
    lamp_side: int
    coarse: bool

    @property
    def sun_stride(self) -> int:
        """Records of a sun."""
        return self.cascades + self.coarse

    @property
    def lamp_stride(self) -> int:
        """Records of a lamp."""
        return CUBE_FACES * (1 + self.coarse)

    @property
    def first_lamp(self) -> int:
        """The first record of the first lamp."""
        return self.suns * self.sun_stride

    @property
    def faces(self) -> int:
        """All records, at least 1."""
        return max(1, self.first_lamp + self.lamps * self.lamp_stride)

    @property
    def lamp_word(self) -> int:
        """The first word of the first lamp."""
        return self.suns * self.cascades * self.sun_side**2

    @property
    def lamp_words(self) -> int:
        """Words of a lamp."""
        return CUBE_FACES * self.lamp_side**2

    @property
    def coarse_word(self) -> int:
        """The word of the first coarse page: those of suns, then those of lamps."""
        return self.lamp_word + self.lamps * self.lamp_words

    @property
    def words(self) -> int:
        """All words."""
        return self.coarse_word + self.suns + self.lamps

    @property
    def report_words(self) -> int:
        """Words of a report (page_table/report.glsl): a resolution for each lamp, then a bit for each tile.

        At least 2: a buffer of one word stands for memory that the graph does not know (graph/execute/bindings.py).
        """
        return max(2, self.lamps + -(-self.coarse_word // 32))


def places(scene: Scene, settings: Any) -> Places:
    """Return the places of faces and tiles. Suns have smaller cascades if the pool does not hold what is asked for.

    A renderer has the places of the scene with which it was opened: buffers and shaders agree about them. A light that
    becomes one of another kind may find no place, and is counted among those that are left out.
    """
    knobs = settings.shadows
    suns, lamps, coarse = most_suns(scene, settings), most_lamps(scene, settings), by_need(settings)
    cascades, side = int(knobs.shadow_cascades), -(-int(knobs.shadow_sun_size) // TILE)
    tiles = pool_limit(settings)
    room = max(tiles - lamps, min(tiles, suns * (cascades + coarse)))
    while side > 1 and suns * (cascades * side**2 + coarse) > room:
        side //= 2
    if suns * (cascades * side**2 + coarse) > room:
        side = 0
    return Places(suns, cascades, side, lamps, -(-int(knobs.shadow_size) // TILE), coarse)


def pool_limit(settings: Any) -> int:
    """Return the tiles that the setting allows."""
    return max(1, int(settings.shadows.shadow_pool * 2**20) // TILE_BYTES)


def pool_tiles(held: Places, settings: Any) -> int:
    """Return the tiles of the pages: as many as the table has words, or as the pool holds.

    With memory by need there may be a second tile for each word, without casters that move.
    """
    words = held.words * (2 if by_need(settings) else 1)
    return max(1, min(words, pool_limit(settings)))


def most_copies(held: Places, settings: Any) -> int:
    """Return the most parts of faces that a frame copies: each tile and coarse face, and again with movers."""
    return 2 * (pool_tiles(held, settings) + held.faces)


def shadow_defines(scene: Scene, settings: Any, held: Places) -> Defines:
    """Return the defines of all shaders of a scene with shadows: sizes of the buffer, and the filter."""
    if not needed(scene, settings):
        return ()
    knobs = settings.shadows
    return (
        ("SHADOWS", 1),
        ("SHADOW_LIGHTS", padded(records_of(scene, settings))),
        ("SHADOW_FACES", padded(held.faces)),
        ("SHADOW_BLENDED", bit_words(len(scene.materials))),
        ("SHADOW_MOVING", bit_words(len(scene.instances))),
        *((("SHADOW_COARSE", CUBE_FACES),) if held.coarse else ()),
        ("SHADOW_BIAS", get_args(Bias).index(knobs.shadow_bias)),
        *((("SHADOW_SOFT", 1),) if knobs.shadow_filter == "pcss" else ()),
    )


def shadow_constants(settings: Any) -> tuple[tuple[str, int], ...]:
    """Return the specialization constants of shaders that filter shadows: a radius for which loops are unrolled."""
    knobs, radius = settings.shadows, settings.shadows.shadow_kernel // 2
    most = {"auto": MOST_UNROLLED, "constant": radius, "record": -1}[knobs.shadow_loop]
    return (("SHADOW_RADIUS", radius),) if knobs.shadow_filter == "pcf" and radius <= most else ()


def filter_words(settings: Any) -> NDArray[np.float32]:
    """Return (4,) the bias in texels, constant and by slope, the radius of lamps in length scales, and a sun's tangent.

    They are data and no defines: a slider that moves compiles nothing.
    """
    knobs = settings.shadows
    sun = np.tan(np.radians(knobs.shadow_sun_angle))
    return np.array((knobs.shadow_constant, knobs.shadow_slope, knobs.shadow_lamp, sun), np.float32)


def place_words(settings: Any, held: Places) -> NDArray[np.int32]:
    """Return (8,) where words of a report are (page_table/report.glsl), and which tests casters undergo, as bits."""
    suns = held.first_lamp, held.sun_stride, held.sun_side
    return np.array((*suns, held.lamps, held.lamp_side, held.lamp_word, tests_of(settings), 0), np.int32)


def bit_words(count: int) -> int:
    """Return the words of `count` bits."""
    return padded(-(-count // 32))


def padded(count: int) -> int:
    """Return the power of two that holds `count`, at least LEAST: scenes of most sizes then share compiled shaders."""
    return max(LEAST, 1 << (count - 1).bit_length())


def tests_of(settings: Any) -> int:
    """Return the tests of casters against lights, as bits (cull.glsl). Cones need that back faces cast nothing."""
    knobs = settings.shadows
    cones = knobs.shadow_cull_cones and knobs.shadow_sides == "front"
    return (
        knobs.shadow_cull_instances + 2 * knobs.shadow_cull_meshlets + 4 * cones + 8 * knobs.shadow_cull_faces
    )


def guard(settings: Any, size: Any) -> Any:
    """Return the texels at each edge of faces of a size that only filters reach, so that no tap needs another face.

    It is 1 more than the radius of the kernel, or of the widest one of soft shadows.
    """
    if settings.shadows.shadow_filter == "pcss":
        return np.minimum(WIDEST_RADIUS, size // 8) + 1
    return size * 0 + settings.shadows.shadow_kernel // 2 + 1
