"""Chapter 4: The frame graph."""

from common.lessons import Lesson, Needs

LESSON = Lesson(
    number=4,
    title="The frame graph",
    adds=(),
    needs=Needs(
        required=frozenset(),
        optional=frozenset({"anisotropy", "async-transfer", "bindless", "block-compression", "multi-draw"}),
    ),
    reading=("renderer.py",),
)
