"""Study: roulette. A path that carries little ends at random, and those that go on stand for it.

Each reflection makes a path carry less, and each costs as much as the one before. Russian roulette (Arvo and Kirk
1990) lets a path go on with a probability p, and divides what it carries by p. The mean is the same for any p above 0.
The chapter's p is the largest component of what the path carries, at most 1, so all paths that are left carry about the
same. What is saved in time is paid in variance, since some paths now stand for several. So neither time nor variance
tells which is better, but their product does:

    efficiency = 1 / (variance x time)

At equal time the variance of two methods is in the inverse ratio of their efficiencies. `path_roulette` is the number
of reflections that are safe: 0 lets paths end at the first one, and 1024 never, so that `path_bounces` alone ends them.
[`model.py`](model.py) measures all three.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from common.lessons import OWN, Study
from common.settings import group, knob

from ...frames.frame import OUTPUTS
from ...settings import Settings as ChapterSettings
from ..of_paths import OwnLight, TracedSettings
from .model import room

STUDY = Study(
    title="roulette",
    idea="Paths that carry little end at random, and what goes on is divided by the probability that it did.",
    order=7,
    features=("path-tracer/russian-roulette",),
    outputs=OUTPUTS,
    scene=OWN,
)

own_scene = room


@dataclass
class RouletteSettings(TracedSettings):
    """How paths are sampled: as long as they carry anything."""

    path_bounces: int = knob(64, "reflections of a path at most", minimum=0, maximum=1024, live=True)


@dataclass(init=False)
class Settings(ChapterSettings):
    """The chapter's settings, with long paths."""

    ORDER: ClassVar[str] = ChapterSettings.ORDER

    paths: RouletteSettings = group(RouletteSettings)
    scene: OwnLight = group(OwnLight)
