"""Study: step 2 of the frame graph. The barriers follow from what passes declare.

The study `names` puts a barrier before each pass that waits for everything. Here each barrier waits for what the pass
needs: the stage that wrote the image that it reads, and for nothing else. Where two passes read the same image, only
the first one has a barrier for it. `strata graph` shows such barriers for the frames of the chapter.

Only Vulkan has barriers of this kind. OpenGL orders draws and what they sample by itself, so there the study has
nothing to derive.
"""

from __future__ import annotations

from dataclasses import dataclass

from common.lessons import Study
from common.settings import knob

STUDY = Study(
    title="step 2: barriers",
    idea="A barrier waits for the stage that wrote what a pass reads, and the declarations say which one that is.",
    order=2,
    features=("frame-graph/barriers",),
)


@dataclass(frozen=True)
class Settings:
    """The knobs of this study."""

    wait: str = knob("needed", "what a pass waits for", choices=("needed", "everything"))
