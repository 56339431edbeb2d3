"""Study: reflections in screen space. A mirrored ray is marched through the depth of the frame that is being drawn.

The lit picture already holds most of what a mirror shows. For each pixel of a smooth surface, view vector and normal
give the mirrored ray. Its way over the screen is divided into equal steps ([`march.glsl`](march.glsl)), and the first
step that ends behind the surface of its pixel is halved until the place is known. The picture's light there replaces
what the environment gave from the same direction ([`resolve.frag`](resolve.frag)). Where the ray leaves the picture, or
goes behind something, the picture has no answer, and the environment stays.

Two passes do this, between lighting and transparent surfaces ([`passes.py`](passes.py)). They are inserted into the
chapter's own frame, so every setting of the chapter is one of this study.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import ClassVar

from common.lessons import OWN, Study
from common.settings import group, knob

from ...frames.frame import OUTPUTS
from ...settings import Settings as ChapterSettings
from .hall import hall

STUDY = Study(
    title="screen-space reflections",
    idea="A mirrored ray is marched through the depth buffer, and shows the light of the pixel at which it ends.",
    order=1,
    features=("ssr/ray-march", "ssr/roughness-blur"),
    outputs=OUTPUTS,
    scene=OWN,
)

own_scene = hall


@dataclass
class ReflectionSettings:
    """The knobs of the study."""

    strength: float = knob(
        1.0,
        "part of a reflection that is shown; 0: no pass",
        minimum=0,
        maximum=1,
        flat="reflection_strength",
    )
    steps: int = knob(64, "steps of a ray over the picture", minimum=1, maximum=4096, flat="reflection_steps")
    refinements: int = knob(
        5,
        "halvings of the step that ends behind a surface",
        minimum=0,
        maximum=16,
        flat="reflection_refinements",
    )
    thickness: float = knob(
        0.05,
        "how far behind its surface a pixel is solid, as a part of its distance",
        minimum=0,
        maximum=10,
        flat="reflection_thickness",
    )
    roughest: float = knob(
        0.6,
        "roughness from which a surface reflects nothing",
        minimum=0.001,
        maximum=1,
        flat="reflection_roughest",
    )
    blur: float = knob(
        10.0, "radius of the box at roughness 1", "pixels", minimum=0, maximum=64, flat="reflection_blur"
    )
    edge: float = knob(
        0.1,
        "border in which reflections fade, as a part of the picture",
        minimum=0,
        maximum=0.5,
        flat="reflection_edge",
    )


@dataclass(init=False)
class Settings(ChapterSettings):
    """The chapter's settings, and those of reflections."""

    ORDER: ClassVar[str] = (
        "reflection_strength reflection_steps reflection_refinements reflection_thickness reflection_roughest "
        f"reflection_blur reflection_edge {ChapterSettings.ORDER}"
    )

    reflection: ReflectionSettings = group(ReflectionSettings)
