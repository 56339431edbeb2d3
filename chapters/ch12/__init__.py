"""Chapter 12: Chapter 12."""

from common.lessons import Lesson, Needs

LESSON = Lesson(
    number=12,
    title="Chapter 12",
    adds=(),
    needs=Needs(required=frozenset(), optional=frozenset({"anisotropy", "async-compute", "async-transfer", "bindless", "block-compression", "draw-indirect-count", "mesh-shader", "multi-draw", "ray-query", "ray-tracing", "shading-rate", "sparse", "subgroups"})),
    reading=("renderer.py",),
)
