"""Chapter 8: Shadows."""

from common.lessons import Lesson, Needs

LESSON = Lesson(
    number=8,
    title="Shadows",
    adds=(),
    needs=Needs(
        required=frozenset(),
        optional=frozenset(
            {
                "anisotropy",
                "async-compute",
                "async-transfer",
                "bindless",
                "block-compression",
                "draw-indirect-count",
                "mesh-shader",
                "multi-draw",
                "subgroups",
            }
        ),
    ),
    reading=("renderer.py",),
)
