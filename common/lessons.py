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
class Section:
    """A part of a lesson for 15 to 30 minutes: something to see, to run, to read and to solve.

    `title` is the heading of the chapter's README at which the section begins; it ends where the next one begins. `run`
    is a command without `./strata`. `files` are two or three files of the chapter, `exercise` is the name of one of its
    exercises.
    """

    title: str
    minutes: int
    run: str
    files: Sequence[str]
    exercise: str

    def __post_init__(self) -> None:
        object.__setattr__(self, "files", tuple(self.files))
        if not 15 <= self.minutes <= 30:
            raise ValueError(f"the section {self.title!r} takes {self.minutes} minutes, and not 15 to 30")
        if not 2 <= len(self.files) <= 3:
            raise ValueError(f"the section {self.title!r} has {len(self.files)} files, and not two or three")


@dataclass(frozen=True)
class Lesson:
    """One chapter. `adds` are the features in teaching order; `missing` are rows of the ledger that are still to come.

    `question` is the one that the chapter answers, `cover` a picture of it in docs/pictures. `sections` are the path
    through the chapter, with the files to read. `reading` has all files of the lesson.

    `replaces` names what earlier chapters did and this one no longer does: a feature, a file, or a name in a file as
    "shading/sky.py:SkyPass". `plumbing` are files that the lesson is not about and that had to follow, with the
    reason. `shows` are settings of `strata run` that its user need not give, as for --set: where the defaults draw
    what the chapter before draws, they show what is new.
    """

    number: int
    title: str
    adds: Sequence[str] = ()
    needs: Needs = field(default_factory=Needs)
    question: str = ""
    cover: str = ""
    sections: Sequence[Section] = ()
    reading: Sequence[str] = ()
    replaces: Sequence[str] = ()
    plumbing: Mapping[str, str] = field(default_factory=dict, hash=False)
    missing: Sequence[str] = ()
    shows: Sequence[str] = ()

    def __post_init__(self) -> None:
        # Lists are how a chapter writes them; tuples are what a frozen record may hold.
        for name in ("adds", "sections", "reading", "replaces", "missing", "shows"):
            object.__setattr__(self, name, tuple(getattr(self, name)))
        if len(set(self.adds)) != len(self.adds):
            raise ValueError(f"lesson {self.number} adds a feature twice")
        if not all(reason.strip() for reason in self.plumbing.values()):
            raise ValueError(f"lesson {self.number} has plumbing without a reason")

    @property
    def minutes(self) -> int:
        """How long the sections take together."""
        return sum(section.minutes for section in self.sections)

    @property
    def core(self) -> tuple[str, ...]:
        """The files that the sections tell to read, in this order; the rest of `reading` is for reference."""
        return tuple(dict.fromkeys(file for section in self.sections for file in section.files))


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
