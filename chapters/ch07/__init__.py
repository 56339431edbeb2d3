"""Chapter 7: Chapter 7."""

from common.lessons import Lesson, Needs

LESSON = Lesson(
    number=7,
    title="Chapter 7",
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
