"""Study: depth peeling. The depth test finds the nearest layer of each pixel, then the next one behind it, and so on.

Everitt, "Interactive Order-Independent Transparency" (2001). Each pass draws all blended objects with an ordinary depth
test, and leaves out what is not behind the layer of the pass before ([`peel.frag`](peel.frag)). So pass i has the i-th
layer of every pixel, whatever the order of draws. The layers are then blended over the lit picture, the last one first.

No list and no atomics are needed, and memory is known in advance: one colour and one depth for each layer. But all
objects are drawn as often as there are layers, and those of a pixel that has more are lost, farthest first. Of surfaces
with equal depth only one is seen.

The passes ([`passes.py`](passes.py)) take the place of the chapter's pass for sorted objects, so every setting of the
chapter is one of this study.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from common.lessons import OWN, Study
from common.settings import group, knob

from ...frames.frame import OUTPUTS
from ...settings import Settings as ChapterSettings
from .glass import glass

STUDY = Study(
    title="depth peeling",
    idea="Each pass draws the nearest layer behind that of the pass before, so no layer has to be sorted.",
    order=2,
    features=("oit/alternatives",),
    outputs=OUTPUTS,
    scene=OWN,
)

own_scene = glass


@dataclass
class PeelingSettings:
    """The knobs of the study."""

    layers: int = knob(
        8, "layers of a pixel that are drawn, the nearest ones", minimum=1, maximum=64, flat="peeled_layers"
    )


@dataclass(init=False)
class Settings(ChapterSettings):
    """The chapter's settings, and those of peeling."""

    ORDER: ClassVar[str] = f"peeled_layers {ChapterSettings.ORDER}"

    peeling: PeelingSettings = group(PeelingSettings)
