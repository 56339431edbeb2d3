"""Chapter 6: Meshlets, mesh shaders and GPU culling."""

from common.lessons import Lesson, Needs

LESSON = Lesson(
    number=6,
    title="Meshlets, mesh shaders and GPU culling",
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
            }
        ),
    ),
    reading=("renderer.py",),
)
