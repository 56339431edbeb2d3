"""Chapter 12: rays by three ways, and a picture that is traced with them."""

from common.lessons import Lesson, Needs

LESSON = Lesson(
    number=12,
    title="Rays on every machine",
    adds=(),
    shows=("rays=beside",),
    needs=Needs(required=frozenset(), optional=frozenset({"anisotropy", "async-compute", "async-transfer", "bindless", "block-compression", "draw-indirect-count", "mesh-shader", "multi-draw", "ray-query", "ray-tracing", "shading-rate", "sparse", "subgroups"})),
    reading=("renderer.py",),
)
