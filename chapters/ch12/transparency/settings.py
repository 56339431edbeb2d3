"""The knobs of transparency."""

from __future__ import annotations

from dataclasses import dataclass
from typing import Literal, get_args

from common.settings import knob

Mode = Literal["sorted", "lists", "weighted"]
"""How blended surfaces over one another become one colour."""


@dataclass
class TransparencySettings:
    """How blended surfaces are composited."""

    mode: str = knob(
        "sorted",
        "blended surfaces: objects drawn farthest first, all layers of a pixel sorted, or a weighted mean of them",
        choices=get_args(Mode),
        flat="transparency",
    )
    nodes: float = knob(
        4.0,
        "layers that the pool of lists holds, as a mean over all pixels; with more in a frame it is drawn as weighted",
        unit="layers per pixel",
        minimum=1 / 64,
        maximum=65536,
        flat="transparency_nodes",
    )
