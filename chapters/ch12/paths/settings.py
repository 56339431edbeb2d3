"""The knobs of the path tracer."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from common.settings import knob

Strategy = Literal["mis", "bsdf", "lights"]
"""How light of the environment and of emissive triangles is found."""

Sequence = Literal["pcg", "sobol"]
"""Where random numbers come from."""

Filter = Literal["box", "centre"]
"""Where in a pixel rays go."""

Lights = Literal["all", "one"]
"""How many rays towards light a vertex of a path sends."""


@dataclass
class PathSettings:
    """How paths are sampled, and when a picture is finished."""

    path_tracer: bool = knob(False, "whether the picture is traced by paths, in place of all that is drawn")
    path_samples: int = knob(1, "paths through each pixel in a frame", minimum=1, maximum=4096, live=True)
    path_limit: int = knob(
        4096, "paths through each pixel after which the picture rests", minimum=1, maximum=2**24, live=True
    )
    path_average: bool = knob(
        True,
        "whether frames that show the same are averaged; else each frame shows its own paths alone",
        live=True,
    )
    path_first: int = knob(
        0,
        "number of the first path of each pixel: other numbers are other paths",
        minimum=0,
        maximum=2**31,
        live=True,
    )
    path_seed: int = knob(
        0, "number of the random sequence of all paths", minimum=0, maximum=2**31, live=True
    )
    path_error: float = knob(
        0.0,
        "estimated standard error, relative to the light, at which blocks of 4x4 pixels get no further paths; 0: all "
        "get path_limit. Stopping by what was drawn makes the mean a little wrong",
        minimum=0,
        maximum=1,
        live=True,
    )
    path_bounces: int = knob(
        8,
        "reflections of a path at most; 0: what emits light is seen, and nothing is lit",
        minimum=0,
        maximum=1024,
        live=True,
    )
    path_roulette: int = knob(
        3,
        "reflections after which a path may end at random, with a probability that follows what it still carries",
        minimum=0,
        maximum=1024,
        live=True,
    )
    path_strategy: str = knob(
        "mis",
        "what finds light of the environment and of emissive triangles: rays that are reflected, rays towards it, or "
        "both, weighted by how well each finds it",
        choices=get_args(Strategy),
        live=True,
    )
    path_lights: str = knob(
        "one",
        "rays towards light at each reflection: one to each light and one to what emits, or one in all, drawn in "
        "proportion to what each adds without shadows",
        choices=get_args(Lights),
        live=True,
    )
    path_sequence: str = knob(
        "pcg",
        "random numbers: independent ones, or points of Sobol's sequence in random order",
        choices=get_args(Sequence),
        live=True,
    )
    path_filter: str = knob(
        "box",
        "where rays pass through a pixel: anywhere, or in its centre, as in drawn pictures",
        choices=get_args(Filter),
        live=True,
    )
