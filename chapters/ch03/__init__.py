"""Chapter 3: Tasks, parallel recording, asynchronous loading and a scene cache."""

from common.lessons import Lesson, Needs

LESSON = Lesson(
    number=3,
    title="Tasks, parallel recording, asynchronous loading and a scene cache",
    adds=(),
    needs=Needs(required=frozenset(), optional=frozenset({"anisotropy", "bindless", "multi-draw"})),
    reading=("renderer.py",),
)
