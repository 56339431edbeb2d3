"""Chapter 2: one set of descriptors for all textures, layouts read from SPIR-V, and pipelines kept on disk."""

from common.lessons import Lesson, Needs

LESSON = Lesson(
    number=2,
    title="Bindless resources, SPIR-V reflection and a pipeline cache",
    adds=(),
    needs=Needs(required=frozenset(), optional=frozenset({"anisotropy", "bindless", "multi-draw"})),
    reading=("renderer.py",),
)
