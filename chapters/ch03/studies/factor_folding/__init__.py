"""Study: materials without factors. What a factor would multiply is multiplied before, and everything is a texture."""

from __future__ import annotations

from common.lessons import Study

from ...frames.frame import OUTPUTS
from ...settings import Settings as Settings

STUDY = Study(
    title="factor folding",
    idea="A factor times a texture is a texture: multiplied before, it costs memory, and no shader reads a factor.",
    order=2,
    features=("scene-cache/factor-folding",),
    outputs=OUTPUTS,
    scene="cornell",
)
