"""Study: a frame of layers, of which the first and the last draw nothing. The first clears; the last ends the frame.

A layer that draws need not know its place in the frame: it draws over the picture that is there. The first layer gives
every pixel a colour and a depth. The last layer brings the picture into the layout in which a window or a copy reads
it. Depth is cleared to 0, because depth is reversed here: 1 is near, 0 is infinitely far. Books with the usual depth
clear to 1.

An image has one layout to be drawn to, another to be read by a shader, and a third to be copied; between them a GPU may
decompress or flush. Vulkan does not know the layout of an image: each barrier states it. So the last layer declares one
final layout, and the copy after the frame relies on it. OpenGL tracks the state of every image itself.
"""

from __future__ import annotations

from dataclasses import dataclass

import numpy as np

from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="clear and finish",
    idea="Two layers draw nothing: one makes every pixel known, one leaves the picture as its reader expects it.",
    order=5,
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
