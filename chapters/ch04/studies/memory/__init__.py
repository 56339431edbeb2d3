"""Study: step 3 of the frame graph. Images that are never alive at once share memory.

The order of the passes says from which step to which an image is used. `place_transients` gives each image a place in
one block of memory, so that two images with a step in common have no byte in common. A byte may hold one image after
another. The first pass that writes an image then also waits for the last reader of the image before, and the old
contents are lost.

OpenGL has no placement. There two images share a texture if their size and format are equal.
"""

from __future__ import annotations

from dataclasses import dataclass

from common.lessons import Study
from common.settings import knob

from .. import barriers

STUDY = Study(
    title="step 3: memory",
    idea="Two images that no step uses at once can lie in the same memory, one after the other.",
    order=3,
    features=("frame-graph/resource-aliasing",),
)


@dataclass(frozen=True)
class Settings(barriers.Settings):
    """The knobs of step 2, and one of this study."""

    share: bool = knob(True, "whether images share memory")
