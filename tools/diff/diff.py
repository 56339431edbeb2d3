"""The difference of two chapters as data: files, hunks, changed functions, moved code; no output and no device.

    made = difference(Path("chapters/ch01"), Path("chapters/ch02"), LESSON.reading)
    made.insertions, made.deletions                       # lines of code, Python and GLSL
    for file in made.files:                               # those of `reading` first, in its order
        file.path, file.status, file.insertions, file.deletions, file.hunks, file.functions

`status` is "new", "removed", "renamed", "changed" or "same". A file is the same if all its bytes are.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from difflib import SequenceMatcher
from itertools import pairwise
from pathlib import Path

from tools.diff.files import Source, renamed, sources
from tools.diff.functions import Definition, Outline, outline
from tools.diff.moves import Move, moves, runs

CONTEXT = 3
"""Unchanged lines shown around what changed."""

PART = 12
"""Lines that a part of a new file has at least, so that a page can be stepped through."""

LONG = 4000
"""Lines from which on matching leaves out what stands everywhere: its time grows with the square otherwise."""


@dataclass(frozen=True)
class Line:
    """A line of a hunk: "-" deleted, "+" inserted, " " unchanged; its number in A and in B, from 1."""

    mark: str
    old: int | None
    new: int | None
    text: str


@dataclass(frozen=True)
class Hunk:
    """Changed lines with those around them, and the definition that they lie in, "" outside any.

    `imports_only`: what changed is nothing but imports.
    """

    lines: tuple[Line, ...]
    within: str = ""
    imports_only: bool = False

    def rows(self) -> list[tuple[Line | None, Line | None]]:
        """Return the lines side by side: what was deleted beside what was inserted in its place."""
        found: list[tuple[Line | None, Line | None]] = []
        gone: list[Line] = []
        come: list[Line] = []

        def flush() -> None:
            for place in range(max(len(gone), len(come))):
                left = gone[place] if place < len(gone) else None
                found.append((left, come[place] if place < len(come) else None))
            gone.clear()
            come.clear()

        for line in self.lines:
            if line.mark == " ":
                flush()
                found.append((line, line))
            elif line.mark == "-":
                gone.append(line)
            else:
                come.append(line)
        flush()
        return found


@dataclass(frozen=True)
class FunctionDifference:
    """A function, method, class, constant, GLSL struct or block, of which lines were inserted or deleted.

    What is new or removed counts as one with all it holds.
    """

    name: str
    kind: str
    status: str  # "new", "removed" or "changed"
    insertions: int
    deletions: int


@dataclass(frozen=True)
class FileDifference:
    """One file in both chapters. `path` is its path in B, or in A where B has none; `notes` are clauses."""

    path: str
    status: str
    old: Source | None
    new: Source | None
    insertions: int = 0
    deletions: int = 0
    hunks: tuple[Hunk, ...] = ()
    functions: tuple[FunctionDifference, ...] = ()
    notes: tuple[str, ...] = ()
    imports_only: bool = False

    @property
    def source(self) -> Source:
        """The file as it is in B, or in A where B has none."""
        found = self.new or self.old
        assert found is not None
        return found

    @property
    def sentence(self) -> str:
        """The sentence with which the file says what it is, or ""."""
        return self.source.sentence

    @property
    def binary(self) -> bool:
        """Whether it is no text, so that it has no lines."""
        return any(one is not None and one.text is None for one in (self.old, self.new))


@dataclass(frozen=True)
class TreeDifference:
    """All files of two chapters, those of the reading order first, and the code that moved between them."""

    files: tuple[FileDifference, ...]
    moves: tuple[Move, ...] = ()
    reading: tuple[str, ...] = field(default=())

    @property
    def changed(self) -> tuple[FileDifference, ...]:
        """The files that are not the same in both."""
        return tuple(file for file in self.files if file.status != "same")

    @property
    def insertions(self) -> int:
        """Lines of code inserted, those of new files included."""
        return sum(file.insertions for file in self.files if file.source.is_code)

    @property
    def deletions(self) -> int:
        """Lines of code deleted, those of removed files included."""
        return sum(file.deletions for file in self.files if file.source.is_code)

    def of_status(self, *names: str) -> tuple[FileDifference, ...]:
        """Return the files of these statuses."""
        return tuple(file for file in self.files if file.status in names)


def difference(a: Path, b: Path, reading: Sequence[str] = ()) -> TreeDifference:
    """Return how the chapter in folder `b` differs from the one in `a`; `reading` gives the order of the files.

    Raises OSError where a file cannot be read.
    """
    return tree_difference(sources(a), sources(b), reading)


def tree_difference(
    a: Mapping[str, Source], b: Mapping[str, Source], reading: Sequence[str] = (), versions: bool = False
) -> TreeDifference:
    """Return how the files of `b` differ from those of `a`, by their keys.

    `versions`: they are two versions of one thing, as for two APIs, where nothing can have been renamed or moved.
    """
    only_a = {path: a[path] for path in a.keys() - b.keys()}
    only_b = {path: b[path] for path in b.keys() - a.keys()}
    was = {} if versions else renamed(only_a, only_b)
    files = []
    for path in a.keys() | b.keys():
        if path not in was.values():
            files.append(file_difference(path, a.get(was.get(path, path)), b.get(path), path in was))
    places = {path: place for place, path in enumerate(reading)}
    files.sort(key=lambda file: (places.get(file.path, len(places)), file.path))
    return TreeDifference(tuple(files), () if versions else _moved(files), tuple(reading))


def file_difference(
    path: str, old: Source | None, new: Source | None, was_renamed: bool = False
) -> FileDifference:
    """Return how a file differs; one of the sources may be missing."""
    if old is None or new is None:
        return _one_sided(path, old, new)
    if old.data == new.data:
        return FileDifference(path, "renamed" if was_renamed else "same", old, new)
    status = "renamed" if was_renamed else "changed"
    if old.text is None or new.text is None:
        return FileDifference(path, status, old, new, notes=("it is no text, so its lines are not compared",))
    matcher = SequenceMatcher(None, old.lines, new.lines, autojunk=len(old.lines) > LONG)
    outlines = outline(old), outline(new)
    hunks = _hunks(matcher, old, new, outlines)
    gone, come = _numbers([line for hunk in hunks for line in hunk.lines])
    notes = [one.problem for one in outlines if one.problem]
    return FileDifference(
        path,
        status,
        old,
        new,
        insertions=len(come),
        deletions=len(gone),
        hunks=hunks,
        functions=_functions(outlines, (old, new), (gone, come)),
        notes=(*dict.fromkeys(notes), *_ends(old, new)),
        imports_only=bool(hunks) and all(hunk.imports_only for hunk in hunks),
    )


def _one_sided(path: str, old: Source | None, new: Source | None) -> FileDifference:
    source, status = (new, "new") if new is not None else (old, "removed")
    assert source is not None
    if source.text is None:
        return FileDifference(path, status, old, new, notes=(f"it is no text; {len(source.data):,} bytes",))
    made = outline(source)
    numbers = range(1, len(source.lines) + 1)
    sides = ((), numbers) if new is not None else (numbers, ())
    return FileDifference(
        path,
        status,
        old,
        new,
        insertions=len(sides[1]),
        deletions=len(sides[0]),
        hunks=_parts(source, made, "+" if new is not None else "-"),
        functions=_functions(
            (Outline(), made) if new is not None else (made, Outline()),
            (old or Source(path, b""), new or Source(path, b"")),
            sides,
        ),
        notes=(made.problem,) if made.problem else (),
    )


def _of_opcode(code: tuple[str, int, int, int, int], old: Sequence[str], new: Sequence[str]) -> list[Line]:
    tag, i, i_end, j, j_end = code
    if tag == "equal":
        return [Line(" ", i + k + 1, j + k + 1, old[i + k]) for k in range(i_end - i)]
    gone = [Line("-", k + 1, None, old[k]) for k in range(i, i_end)]
    return gone + [Line("+", None, k + 1, new[k]) for k in range(j, j_end)]


def _hunks(
    matcher: SequenceMatcher[str], old: Source, new: Source, outlines: tuple[Outline, Outline]
) -> tuple[Hunk, ...]:
    owners = outlines[0].owners(len(old.lines)), outlines[1].owners(len(new.lines))
    found = []
    for group in matcher.get_grouped_opcodes(CONTEXT):
        lines = [line for code in group for line in _of_opcode(code, old.lines, new.lines)]
        gone, come = _numbers(lines)
        names = [*(owners[1][number] for number in come), *(owners[0][number] for number in gone)]
        imports = _only_imports(old, outlines[0], gone) and _only_imports(new, outlines[1], come)
        found.append(Hunk(tuple(lines), next((name for name in names if name), ""), imports))
    return tuple(found)


def _numbers(lines: Sequence[Line]) -> tuple[list[int], list[int]]:
    """Return the numbers of the deleted and of the inserted lines."""
    gone = [line.old for line in lines if line.old is not None and line.new is None]
    return gone, [line.new for line in lines if line.new is not None and line.old is None]


def _parts(source: Source, made: Outline, mark: str) -> tuple[Hunk, ...]:
    """Return a file that only one side has as hunks of some size: its head, then its definitions in their order.

    The imports at its head are a hunk of their own, which pages fold.
    """
    bounds, names = [1], {1: ""}
    for one in made.definitions:
        if one.kind in ("constant", "block") or one.first - bounds[-1] < PART:
            continue
        bounds.append(one.first)
        names[one.first] = one.name
    imports = _import_block(source, made)
    if _only_imports(source, made, range(1, len(source.lines) + 1)):
        imports = range(0)
    if imports:
        for bound in (imports.start, imports.stop):
            names.setdefault(bound, names[max(one for one in bounds if one <= bound)])
        bounds = sorted({*bounds, imports.start, imports.stop} - {len(source.lines) + 1})
    found = []
    for first, end in pairwise([*bounds, len(source.lines) + 1]):
        numbers = [(n, None) if mark == "-" else (None, n) for n in range(first, end)]
        lines = tuple(Line(mark, old, new, source.lines[(old or new or 1) - 1]) for old, new in numbers)
        if lines:
            found.append(Hunk(lines, names[first], bool(imports) and first == imports.start))
    return tuple(found)


def _import_block(source: Source, made: Outline) -> range:
    """Return the lines of the first imports of a file that follow each other, blank lines between them included."""
    first = min(made.imports, default=0)
    last = number = first
    while number in made.imports or (
        0 < number <= len(source.lines) and not source.lines[number - 1].strip()
    ):
        last = number if number in made.imports else last
        number += 1
    return range(first, last + 1) if first else range(0)


def _functions(
    outlines: tuple[Outline, Outline],
    both: tuple[Source, Source],
    changed: tuple[Sequence[int], Sequence[int]],
) -> tuple[FunctionDifference, ...]:
    """Return the definitions that hold the lines `changed` of A and of B, in the order of the file.

    Where one side cannot be parsed, none: those of the other side would all seem to be gone.
    """
    if any(made.problem for made in outlines):
        return ()
    known = [{one.name: one for one in made.definitions} for made in outlines]
    counts: dict[str, list[int]] = {}
    for side in (0, 1):
        owners = outlines[side].owners(len(both[side].lines))
        for number in changed[side]:
            name = _whole(owners[number], known)
            # A blank line is a change of nothing but a definition that is new or gone with all it holds.
            if name and (both[side].lines[number - 1].strip() or (name in known[0]) != (name in known[1])):
                counts.setdefault(name, [0, 0])[side] += 1
    last = len(both[1].lines) + 1
    found = []
    for name, (deletions, insertions) in counts.items():
        old, new = known[0].get(name), known[1].get(name)
        one = new or old
        assert one is not None
        status = "new" if old is None else "removed" if new is None else "changed"
        place = one.first if new is not None else last + one.first
        found.append((place, FunctionDifference(name, one.kind, status, insertions, deletions)))
    return tuple(each for _, each in sorted(found, key=lambda pair: (pair[0], pair[1].name)))


def _whole(name: str, known: Sequence[Mapping[str, Definition]]) -> str:
    """Return the outermost definition around `name` that only one side has, else `name`."""
    parts = name.split(".")
    for count in range(1, len(parts)):
        outer = ".".join(parts[:count])
        if (outer in known[0]) != (outer in known[1]):
            return outer
    return name


def _only_imports(source: Source, made: Outline, numbers: Sequence[int]) -> bool:
    return all(number in made.imports or not source.lines[number - 1].strip() for number in numbers)


def _ends(old: Source, new: Source) -> list[str]:
    """Return what is to be said of line ends, which the lines themselves do not show."""
    notes = []
    windows = [b"\r\n" in one.data for one in (old, new)]
    if windows[0] != windows[1]:
        notes.append(f"its lines end with CRLF in {'A' if windows[0] else 'B'} alone")
    open_ended = [bool(one.data) and not one.data.endswith(b"\n") for one in (old, new)]
    if open_ended[0] != open_ended[1]:
        notes.append(f"its last line has no end in {'A' if open_ended[0] else 'B'}")
    return notes


def _moved(files: Sequence[FileDifference]) -> tuple[Move, ...]:
    """Return the moves among files: what was deleted anywhere and inserted the same elsewhere."""
    deleted, inserted = [], []
    for file in files:
        changed = [line for hunk in file.hunks for line in hunk.lines]
        if file.old is not None:
            deleted += runs(
                file.old.path, file.old.lines, (n.old for n in changed if n.mark == "-" and n.old)
            )
        if file.new is not None:
            inserted += runs(
                file.new.path, file.new.lines, (n.new for n in changed if n.mark == "+" and n.new)
            )
    return moves(deleted, inserted)
