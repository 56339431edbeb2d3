"""The knobs of the light lists."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from common.settings import knob

Lists = Literal["brute", "bins", "tiles", "clusters"]
"""What selects the lights of a pixel: nothing, its depth, its place in the picture, or both."""

MOST_LIGHTS = 4096
"""Lights that a scene may have; bins hold their places in 16 bits."""


@dataclass
class ClusterSettings:
    """How a pixel finds the lights that it evaluates."""

    light_lists: str = knob(
        "clusters",
        "the lights that a pixel evaluates: all, those near its depth, those over its tile, or those of both",
        choices=get_args(Lists),
    )
    light_loop: str = knob(
        "plain",
        "how invocations that run together loop: each over its own lights, or all over the lights of any of them",
        choices=("plain", "scalarised"),
    )
    most_lights: int = knob(
        MOST_LIGHTS,
        "lights that are kept, the brightest of the scene",
        minimum=1,
        maximum=MOST_LIGHTS,
    )
