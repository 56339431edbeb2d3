"""Study: leaves are cards with holes, and an any-hit shader says where a ray goes through.

A structure knows the triangles of a card and nothing of its texture. Where a ray meets a triangle that is not flagged
opaque, the driver runs the any-hit shader of the hit group: it looks at the texel and calls `ignoreIntersectionEXT`
where there is no leaf. The hit then never happened, and the ray goes on. The shader runs for candidates in any order,
also for some that are behind the hit in the end; a geometry that is flagged opaque never runs it. --set opaque=true
flags the leaves so: the shader is not asked, and cards are whole. The ground is always opaque.

Without ray pipelines, and in OpenGL, our own hierarchy asks the same function `accept` while it traverses. The counters
`asked` and `ignored` say how often it ran, and how often it answered no; they include the rays from the ground to the
light, by which leaves cast shadows with holes.
"""

from __future__ import annotations

import math
from dataclasses import dataclass

import numpy as np
from numpy.typing import NDArray

from common.lessons import OWN, Study
from common.scene import Scene
from common.settings import knob

from ...rays.bvh import model, pack
from ...rays.bvh.model import CONSTANTS
from ..seen import camera_scene

STUDY = Study(
    title="any-hit alpha",
    idea="A candidate becomes a hit only if the any-hit shader lets it.",
    order=1,
    features=("ray-tracing/any-hit-and-intersection",),
    scene=OWN,
)

FOLDER = "studies/any_hit_alpha"
RAYGEN, KERNEL, ANY = f"{FOLDER}/leaves.rgen", f"{FOLDER}/leaves.comp", f"{FOLDER}/leaf.rahit"

TEXELS = 64
"""Texels along an edge of the mask."""

GROUND = 4.0
"""Metres from the middle of the ground to its edges."""

LEAVES, FLOOR = 0, 1
"""Instances."""

PLACED: tuple[tuple[str, int], ...] = (
    ("RAYS_SET", 0),
    ("RAYS_BINDING", 5),
    ("RAYS_SLOT", 5),
    ("TEXELS", TEXELS),
)
"""Where rays find what they traverse."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    leaves: int = knob(60, "cards", minimum=1, maximum=2000)
    opaque: bool = knob(False, "whether the leaves are flagged opaque, so that nothing asks for their texels")


def own_scene() -> Scene:
    """Return a camera before the leaves; shaders know them."""
    return camera_scene("leaves", (0.0, 2.2, 5.2), (0.0, 0.75, 0.0), math.radians(40.0))


def mask() -> NDArray[np.bool_]:
    """Return (TEXELS, TEXELS) whether there is leaf at a texel, row 0 at v = 0: lobes, two holes, and a stem."""
    v, u = (np.mgrid[:TEXELS, :TEXELS] + 0.5) / TEXELS
    x, along = 2 * u - 1, v
    half = (
        0.9
        * np.sin(np.pi * np.clip((along - 0.15) / 0.85, 0, 1)) ** 0.8
        * (0.8 + 0.2 * np.cos(14 * np.pi * along))
    )
    leaf = (along > 0.15) & (np.abs(x) < half)
    stem = (along <= 0.2) & (np.abs(x) < 0.05)
    holes = (np.hypot(x - 0.35, along - 0.55) < 0.12) | (np.hypot(x + 0.3, along - 0.42) < 0.08)
    whole: NDArray[np.bool_] = (leaf | stem) & ~holes
    return whole


def mask_words() -> NDArray[np.uint32]:
    """Return the mask as bits of words, the lowest bit first."""
    return np.packbits(mask().reshape(-1), bitorder="little").view(np.uint32)


def cards(settings: Settings) -> NDArray[np.float32]:
    """Return (N, 4, 3) the corners of cards, those of uv (0, 0), (1, 0), (1, 1) and (0, 1), by lot."""
    random = np.random.default_rng(7)
    count = settings.leaves
    turned = random.normal(size=(count, 3, 3))
    turned[:, 1, 1] += 1.0  # most leaves point up
    along = turned[:, 1] / np.linalg.norm(turned[:, 1], axis=1, keepdims=True)
    across = np.cross(along, turned[:, 0])
    across /= np.linalg.norm(across, axis=1, keepdims=True)
    angle, far = random.uniform(0, 2 * np.pi, count), 1.5 * np.sqrt(random.random(count))
    middle = np.stack([far * np.cos(angle), random.uniform(0.5, 1.5, count), far * np.sin(angle)], axis=1)
    half = random.uniform(0.2, 0.35, (count, 1))
    signs = ((-1, -1), (1, -1), (1, 1), (-1, 1))
    return np.stack([middle + half * (u * across + v * along) for u, v in signs], axis=1).astype(np.float32)


def meshes(settings: Settings) -> list[tuple[NDArray[np.float32], NDArray[np.uint32]]]:
    """Return positions (V, 3) and indices (T, 3) of the leaves, two triangles a card, and of the ground."""
    corners = cards(settings).reshape(-1, 3)
    first = 4 * np.arange(settings.leaves)[:, None, None]
    indices = (first + np.array([[0, 1, 2], [0, 2, 3]])).reshape(-1, 3).astype(np.uint32)
    g = GROUND
    floor = np.array([(-g, 0, g), (g, 0, g), (g, 0, -g), (-g, 0, -g)], np.float32)
    return [(corners, indices), (floor, np.array([[0, 1, 2], [0, 2, 3]], np.uint32))]


def normals(settings: Settings) -> NDArray[np.float32]:
    """Return (N, 4) the normals of cards."""
    corners = cards(settings).astype(np.float64)
    across = np.cross(corners[:, 1] - corners[:, 0], corners[:, 3] - corners[:, 0])
    unit = across / np.linalg.norm(across, axis=1, keepdims=True)
    return np.concatenate([unit, np.zeros((len(unit), 1))], axis=1).astype(np.float32)


def hierarchy(settings: Settings) -> list[NDArray[np.uint32]]:
    """Return nodes, triangles and instances of our own hierarchy, for bindings 5 to 7."""
    trees = pack.mesh_trees(meshes(settings))
    flags = [0 if settings.opaque else model.NON_OPAQUE, 0]
    built = pack.buffers(trees, np.tile(np.eye(4), (2, 1, 1)), [LEAVES, FLOOR], flags=np.array(flags))
    return [built.nodes.view(np.uint32), built.triangles.view(np.uint32), built.instances]


def defines(driver: bool) -> tuple[tuple[str, int | float | str], ...]:
    """Return the macros of the shaders, for the driver's structures or for our own."""
    own = (("RAYS_PIPELINE", 1),) if driver else tuple(CONSTANTS.items())
    return (("NON_OPAQUE", 1), *PLACED, *own)


def told(counts: NDArray[np.uint32]) -> dict[str, int]:
    """Return the counters of a frame that the GPU counted."""
    return {"asked": int(counts[0]), "ignored": int(counts[1])}
