"""What a chapter and its studies say about themselves: title, what they add, what they need of a device."""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field


@dataclass(frozen=True)
class Needs:
    """Device features by name, as in the table of `strata doctor`.

    Without a `required` one the chapter does not run; an `optional` one has a fallback with the same picture.
    """

    required: frozenset[str] = frozenset()
    optional: frozenset[str] = frozenset()

    def __post_init__(self) -> None:
        both = self.required & self.optional
        if both:
            raise ValueError(f"features cannot be required and optional at once: {', '.join(sorted(both))}")

    def __or__(self, other: Needs) -> Needs:
        """Return what both need together; what one of them requires is required."""
        required = self.required | other.required
        return Needs(required, (self.optional | other.optional) - required)


@dataclass(frozen=True)
class Lesson:
    """One chapter. `adds` are slugs of the feature ledger in teaching order; `reading` is what to go on with.

    `replaces` names what earlier chapters did and this one no longer does: a feature, a file, or a name in a file as
    "shading/sky.py:SkyPass". `plumbing` are files that the lesson is not about and that had to follow, with the
    reason.
    """

    number: int
    title: str
    adds: Sequence[str] = ()
    needs: Needs = field(default_factory=Needs)
    reading: Sequence[str] = ()
    replaces: Sequence[str] = ()
    plumbing: Mapping[str, str] = field(default_factory=dict, hash=False)

    def __post_init__(self) -> None:
        # Lists are how a chapter writes them; tuples are what a frozen record may hold.
        for name in ("adds", "reading", "replaces"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if len(set(self.adds)) != len(self.adds):
            raise ValueError(f"lesson {self.number} adds a feature twice")
        if not all(reason.strip() for reason in self.plumbing.values()):
            raise ValueError(f"lesson {self.number} has plumbing without a reason")


OWN = "own"
"""The `scene` of a study whose package makes one, by `own_scene()`."""


@dataclass(frozen=True)
class Study:
    """A small program beside a chapter's renderer, about one idea; `order` is its place among the chapter's studies.

    `idea` is one sentence. `features` are slugs of the feature ledger that its tests meet. `outputs` are what its
    frames can be asked for. `scene` is the name of what it draws unless told otherwise, or `OWN`; a study without one
    takes no scene at all.
    """

    title: str
    idea: str
    order: int
    features: Sequence[str] = ()
    outputs: Sequence[str] = ("color",)
    scene: str | None = None

    def __post_init__(self) -> None:
        for name in ("features", "outputs"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if not self.idea.endswith("."):
            raise ValueError(f"the idea of the study {self.title!r} is no sentence")
