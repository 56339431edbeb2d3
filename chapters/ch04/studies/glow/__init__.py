"""The frame of the studies names, barriers and memory: the bright parts of a picture glow.

    pass       scene    bright    across    down    combine        outline    show
    reads               scene     bright    across  scene, halo    scene      glow, or outline
    writes     scene    bright    across    halo    glow           outline    the picture

Each pass covers its target with one triangle. It names what it reads and writes. Order, barriers and memory are not
stated: each of the three studies derives one of them.
"""

from __future__ import annotations

import random
from dataclasses import dataclass

from backends.contract import Access
from common.scene import Sampler

from ...graph.types import Node

FORMAT = "rgba16f"
SHOWN = ("glow", "outline")
"""The results that the last pass can show."""
TEXELS = Sampler("nearest", "nearest", None, "clamp", "clamp")
EMPTY = (0.0, 0.0, 0.0, 0.0)


@dataclass(frozen=True)
class Pass:
    """A pass: its fragment shader, the names that it reads in the order of its bindings, and the name that it writes.

    `scale` is the size of its target relative to the picture. A pass without `writes` draws to the picture.
    """

    fragment: str
    reads: tuple[str, ...] = ()
    writes: str = ""
    scale: float = 1.0
    defines: tuple[tuple[str, int], ...] = ()


PASSES = {
    "scene": Pass("glow/scene.frag", (), "scene"),
    "bright": Pass("glow/bright.frag", ("scene",), "bright", 0.5),
    "across": Pass("glow/blur.frag", ("bright",), "across", 0.5, (("DOWN", 0),)),
    "down": Pass("glow/blur.frag", ("across",), "halo", 0.5, (("DOWN", 1),)),
    "combine": Pass("glow/combine.frag", ("scene", "halo"), "glow"),
    "outline": Pass("glow/outline.frag", ("scene",), "outline"),
}
"""All passes but the last one, which shows a result."""


def passes(shown: str = "glow") -> dict[str, Pass]:
    """Return the passes by name; the last one shows the result of this name."""
    return {**PASSES, "show": Pass("glow/show.frag", (shown,))}


def declared(seed: int = 0, shown: str = "glow") -> list[Node]:
    """Return the passes as nodes of a frame graph, in an order that `seed` shuffles."""
    nodes = [_node(name, described) for name, described in passes(shown).items()]
    random.Random(seed).shuffle(nodes)
    return nodes


def _node(name: str, described: Pass) -> Node:
    # A pass without a target of the graph draws to the picture, so its stage has to be said.
    reads = tuple(Access(source, "sampled", stages=("fragment",)) for source in described.reads)
    if not described.writes:
        return Node(name, reads)
    return Node(name, reads, (Access(described.writes, "color", FORMAT, described.scale, clear=EMPTY),))


def size_of(described: Pass, size: tuple[int, int]) -> tuple[int, int]:
    """Return the size of a pass's target in pixels, for a picture of this size."""
    return (max(1, round(size[0] * described.scale)), max(1, round(size[1] * described.scale)))


def shaders(described: Pass) -> tuple[str, str]:
    """Return the shader files of a pass."""
    return "post/fullscreen.vert", f"studies/{described.fragment}"
