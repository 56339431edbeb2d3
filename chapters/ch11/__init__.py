"""Chapter 11: Chapter 11."""

from common.lessons import Lesson, Needs

LESSON = Lesson(
    number=11,
    title="Chapter 11",
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
                "shading-rate",
                "sparse",
                "subgroups",
            }
        ),
    ),
    reading=("renderer.py",),
)
