"""Study: a frame of layers, of which the first and the last draw nothing. One clears, one hands the picture on.

Layers that draw need not know who comes first and who comes last: all of them draw on what is there. For that, a layer
before them gives every pixel a colour and a depth, and a layer behind them brings the picture into the layout in which
somebody else will read it. Depth is cleared to 0: it is reversed here (1 is near, 0 is infinitely far), where books
with the usual depth clear to 1.

Drawing to an image, reading it in a shader and copying it are three layouts, between which a GPU may have to decompress
or flush. Vulkan believes whoever says in which layout an image is; so the layer that ends the frame has one declared
layout, and whoever goes on from there relies on it. OpenGL knows the state of every image itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="clear and finish",
    idea="Two layers draw nothing: one makes every pixel known, one leaves the picture as its reader expects it.",
    order=2,
    features=("composition/clear-and-finish",),
    outputs=("color", "depth"),
)

CLEAR_COLOR = (0.96, 0.9, 0.8, 1.0)
CLEAR_DEPTH = 0.0
"""What lies infinitely far away."""


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    panels: bool = knob(True, "draw two panels between the first layer and the last")
    finish: str = knob(
        "copy_source",
        "what the picture is ready for in the end; OpenGL needs not be told",
        choices=("copy_source", "sampled", "color"),
    )


SHADERS = ("studies/clear_and_finish/panel.vert", "studies/clear_and_finish/panel.frag")
UNIFORM_BYTES = 16
PANELS = 2


def uniforms(time: float) -> np.ndarray:
    """Return what the shader reads, (4,) float32: how far the panels are to the side, in halves of the picture."""
    return np.array([0.25 * np.sin(time), 0.0, 0.0, 0.0], np.float32)
