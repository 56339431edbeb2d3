"""Study: dynamic resolution. A controller holds a frame time by drawing fewer or more pixels, and the history stays.

With `taa_scale` the chapter draws a part of the picture's pixels, and a history of the picture's size fills the rest.
So the part may differ from frame to frame: the history does not depend on it. A sample has a weight by its distance to
the pixel, at whichever scale it was drawn, and the mean is that of all samples.

Eight scales, from half of the sides to all of them, cost 1.22 times as much from one to the next. Each has a frame
graph, images and recordings of its own, made at the first visit ([`prepared.py`](prepared.py)). The history exists
once, and all eight use it in turn. Pipelines are the same for all: the level of textures, which follows the scale, is
read from the constants of the frame ([`level.py`](level.py)).

[`controller.py`](controller.py) chooses. It gets the time of each frame and returns the number of a scale. `render`
never chooses: the same calls give the same pixels. A window calls `pace` between two frames, and so does a recorded
path. Instead of the measured time, `load` gives one by a formula ([`loads.py`](loads.py)), so that a run is the same
on every machine.

Culling on the GPU fills buffers that belong to one graph, so `culling` is off here. With other values each change of
the scale makes them anew, and records again.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from common.lessons import Study
from common.settings import group, knob

from ...culling.settings import CullingSettings
from ...frames.frame import OUTPUTS
from ...settings import Settings as ChapterSettings
from ...taa.settings import TaaSettings
from .controller import COUNT, MOST_MS
from .loads import LOADS

STUDY = Study(
    title="dynamic resolution",
    idea="The history has the size of the picture, so the number of drawn pixels may follow the time of a frame.",
    order=2,
    outputs=OUTPUTS,
    scene="cornell",
)


@dataclass
class ScalingSettings:
    """The knobs of the study."""

    target_ms: float = knob(
        1000 / 60, "time of a frame on the GPU that is held", unit="ms", minimum=0.01, maximum=MOST_MS
    )
    first_scale: int = knob(
        COUNT - 1,
        "the scale of the first frame: 0 is half of the sides, 7 is all of them",
        minimum=0,
        maximum=7,
    )
    load: str = knob(
        "measured",
        "the time that the controller gets: that of the GPU, or a formula of the frame's number and scale",
        choices=("measured", *LOADS),
    )


@dataclass
class ScaledTaa(TaaSettings):
    """Temporal anti-aliasing, on."""

    taa: str = knob(
        "full", "temporal anti-aliasing; simple: a fixed share of each frame", choices=("simple", "full")
    )


@dataclass
class WithoutCulling(CullingSettings):
    """Culling, off."""

    mode: str = knob(
        "off",
        "tests of objects and meshlets",
        choices=("off", "frustum", "cone", "occlusion"),
        flat="culling",
    )


@dataclass(init=False)
class Settings(ChapterSettings):
    """The chapter's settings, and those of the study."""

    ORDER: ClassVar[str] = f"target_ms first_scale load {ChapterSettings.ORDER}"

    scaling: ScalingSettings = group(ScalingSettings)
    taa: ScaledTaa = group(ScaledTaa)
    culling: WithoutCulling = group(WithoutCulling)
