"""Study: strategies. Two ways to find the same light, each with cases in which it fails, and their combination.

Four lamps of the same power, from small to large, shine on four plates from smooth to rough (after Veach and Guibas
1995). A plate shows a lamp by reflected rays that happen to meet it (`path_strategy=bsdf`), by rays that are sent
towards it (`lights`), or by both (`mis`):

    reflected rays   fail at small lamps and rough plates: hardly any of them meets the lamp
    rays to lamps    fail at large lamps and smooth plates: hardly any of them lies in the narrow lobe

With the power heuristic a ray counts by the square of its density, in parts of both squares. So where one of the two
is good, nearly all light is counted there, and the other one adds little noise. [`model.py`](model.py) measures the
variance of each pair of a plate and a lamp.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from common.lessons import OWN, Study
from common.settings import group, knob

from ...frames.frame import OUTPUTS
from ...settings import Settings as ChapterSettings
from ..of_paths import OwnLight, TracedSettings
from .model import plates_and_lamps

STUDY = Study(
    title="strategies",
    idea="What one strategy seldom finds, another one finds often: weights by their densities combine both.",
    order=6,
    features=("path-tracer/mis",),
    outputs=OUTPUTS,
    scene=OWN,
)

own_scene = plates_and_lamps


@dataclass
class StrategySettings(TracedSettings):
    """How paths are sampled: light that was reflected once."""

    path_bounces: int = knob(1, "reflections of a path at most", minimum=0, maximum=1024, live=True)


@dataclass(init=False)
class Settings(ChapterSettings):
    """The chapter's settings, with paths of one reflection and the light of the lamps alone."""

    ORDER: ClassVar[str] = ChapterSettings.ORDER

    paths: StrategySettings = group(StrategySettings)
    scene: OwnLight = group(OwnLight)
