"""Three-way merge of files and of folders of files: bytes in, bytes out; lines are merged by git's `merge-file`.

There are three versions: `base`, from which two have come; `ours`, which gets the change; and `theirs`, which has it.
What becomes of a file that theirs changed against base is decided by these rules, in this order:

- ours has it as base had it: theirs is taken, and so is a removal;
- ours has what theirs has: nothing is to be done;
- both changed it: the lines are merged, and lines that both changed are a *conflict*: both versions stand in the file
  between markers. A file with a zero byte is no text and has no lines: it stays as ours has it, and is a conflict;
- theirs removed it and ours changed it: it stays, and is a conflict;
- theirs added it and ours has another file there: both are shown between markers, as a conflict;
- ours has no such file any more: nothing is to be mended, which is said and is no conflict;
- a file that is gone on one side while one appeared there that has most of its lines is a *renamed* file, as
  `strata diff` finds them: it is merged under its new name; where both sides renamed it, ours keeps its own. Where ours
  has another file under the new name, both stay, as a conflict.

Line ends are no change of a line: they stay as ours has them, unless it is theirs alone that changed them.
"""

from __future__ import annotations

import re
from collections.abc import Collection, Iterable, Mapping
from dataclasses import dataclass, replace

from common.errors import StrataError
from common.paths import temporary_folder
from tools.diff.files import Source, renamed
from tools.snapshots.history import call

MARKER = re.compile(rb"^(<<<<<<<|\|\|\|\|\|\|\||>>>>>>>) ", re.M)
"""The line of `=======` in the middle is none: it underlines titles, too."""


@dataclass(frozen=True)
class Labels:
    """What the markers of a conflict say about the three versions."""

    ours: str = "ours"
    base: str = "base"
    theirs: str = "theirs"


@dataclass(frozen=True)
class Merged:
    """What became of one file: its content (of a binary conflict: ours), and how many places are in conflict."""

    content: bytes
    conflicts: int = 0
    binary: bool = False


@dataclass(frozen=True)
class Step:
    """What became of one file that theirs changed.

    `kind` is "taken", "merged", "added", "removed", "already", "absent" or "conflict". `content` is what stands at
    `path` afterwards (None: nothing), `before` what stood there. `source` are the file's names in base and theirs.
    `sentence` says what a conflict without markers is about, and how a rule decided.
    """

    path: str
    kind: str
    content: bytes | None
    before: bytes | None
    conflicts: int = 0
    sentence: str = ""
    source: tuple[str | None, str | None] = (None, None)

    @property
    def marked(self) -> bool:
        """Whether the file holds conflict markers now."""
        return self.kind == "conflict" and self.content is not None and has_markers(self.content)


def is_binary(content: bytes) -> bool:
    """Whether a file is no text."""
    return b"\0" in content


def has_markers(content: bytes) -> bool:
    """Whether a conflict in this file is not resolved yet."""
    return not is_binary(content) and MARKER.search(content) is not None


def merge_file(base: bytes, ours: bytes, theirs: bytes, labels: Labels | None = None) -> Merged:
    """Merge the change from `base` to `theirs` into `ours`.

    Raises UserError where there is no git; no git is needed where only one side changed.
    """
    if ours == theirs or base == theirs:
        return Merged(ours)
    if base == ours:
        return Merged(theirs)
    if any(is_binary(content) for content in (base, ours, theirs)):
        return Merged(ours, conflicts=1, binary=True)
    ends = [line_ends(content) for content in (base, ours, theirs)]
    if None in ends or len(set(ends) - {b""}) < 2:
        return _merge_lines(base, ours, theirs, labels or Labels())
    kept = ends[2] if ends[0] == ends[1] else ends[1] or ends[2]
    base, ours, theirs = (content.replace(b"\r\n", b"\n") for content in (base, ours, theirs))
    merged = merge_file(base, ours, theirs, labels)
    return Merged(merged.content.replace(b"\n", kept or b"\n"), merged.conflicts)


def line_ends(content: bytes) -> bytes | None:
    r"""Return what ends every line, b"\n" or b"\r\n", b"" where no line ends, or None where they differ."""
    lines, with_return = content.count(b"\n"), content.count(b"\r\n")
    if with_return not in (0, lines):
        return None
    return b"" if not lines else b"\r\n" if with_return else b"\n"


def _merge_lines(base: bytes, ours: bytes, theirs: bytes, labels: Labels) -> Merged:
    with temporary_folder() as folder:
        for name, content in (("ours", ours), ("base", base), ("theirs", theirs)):
            (folder / name).write_bytes(content)
        said = [word for label in (labels.ours, labels.base, labels.theirs) for word in ("-L", label)]
        words = ("merge-file", "-p", "-q", "--diff3", *said, "ours", "base", "theirs")
        done = call(*words, folder=folder)
    if not 0 <= done.returncode < 128:
        raise StrataError(f"git merge-file failed: {done.stderr.decode('utf-8', 'replace').strip()}.")
    return Merged(done.stdout, done.returncode)


def renames(before: Mapping[str, bytes], after: Mapping[str, bytes]) -> dict[str, str]:
    """Return the new name of every file of `before` that is gone in `after`, while one like it appeared there."""
    gone = {name: content for name, content in before.items() if name not in after}
    return _pairs(gone, {name: content for name, content in after.items() if name not in before})


def _pairs(gone: Mapping[str, bytes], new: Mapping[str, bytes]) -> dict[str, str]:
    old, made = ({name: Source(name, content) for name, content in side.items()} for side in (gone, new))
    return {was: name for name, was in renamed(old, made).items()}


def merge_trees(
    base: Mapping[str, bytes],
    ours: Mapping[str, bytes],
    theirs: Mapping[str, bytes],
    labels: Labels | None = None,
    known: Collection[str] | None = None,
) -> list[Step]:
    """Merge the changes from `base` to `theirs` into `ours`; return a step for each file that they concern.

    `base` and `theirs` may hold a part of the files; then `known` are all names that base's folder has, since a file
    of ours with another name may be a renamed one.
    """
    labels = labels or Labels()
    their_names = renames(base, theirs)
    new = {name: ours[name] for name in ours if name not in (base if known is None else known)}
    changed = {name for name in base if theirs.get(name) != base[name]}
    our_names = _pairs({name: base[name] for name in changed if name not in ours}, new)
    steps = []
    for name in sorted(changed):
        steps += _changed(name, base[name], ours, theirs, their_names, our_names.get(name, name), labels)
    for name in sorted(set(theirs) - set(base) - set(their_names.values())):
        steps.append(_added(name, ours.get(name), theirs[name], labels))
    return steps


def _changed(
    name: str,
    base: bytes,
    ours: Mapping[str, bytes],
    theirs: Mapping[str, bytes],
    their_names: Mapping[str, str],
    here: str,
    labels: Labels,
) -> list[Step]:
    """Return what becomes of a file of base that theirs changed, moved or removed; ours has it at `here`."""
    there = their_names.get(name, name)
    mine, other = ours.get(here), theirs.get(there)
    source = (name, None if other is None else there)
    if mine is None:
        if there != name and there in ours:  # ours moved it there as well
            return [_merged(there, base, ours[there], theirs[there], source, labels)]
        said = "" if other is None else "there is no such file any more, so nothing is to be mended"
        kind = "already" if other is None else "absent"
        return [Step(name, kind, None, None, sentence=said, source=source)]
    if other is None:
        if mine == base:
            return [Step(here, "removed", None, mine, source=source)]
        said = "the change removes this file, but it has lines of its own: remove it or keep it"
        return [Step(here, "conflict", mine, mine, 1, said, source)]
    if there == name or here != name:
        return [_merged(here, base, mine, other, source, labels)]
    if there in ours:
        said = f"the change renames this file to {there}, which is another file here: rename or merge it yourself"
        return [Step(here, "conflict", mine, mine, 1, said, source)]
    moved = replace(_merged(here, base, mine, other, source, labels), path=there, before=None)
    moved = replace(moved, kind="merged") if moved.kind == "already" else moved
    return [Step(here, "removed", None, mine, sentence=f"now {there}", source=(name, None)), moved]


def _merged(
    path: str, base: bytes, ours: bytes, theirs: bytes, source: tuple[str | None, str | None], labels: Labels
) -> Step:
    result = merge_file(base, ours, theirs, labels)
    if result.conflicts:
        said = "this file is no text, so the change cannot be merged into it" if result.binary else ""
        return Step(path, "conflict", result.content, ours, result.conflicts, said, source)
    kind = "already" if result.content == ours else "taken" if result.content == theirs else "merged"
    return Step(path, kind, result.content, ours, source=source)


def _added(path: str, ours: bytes | None, theirs: bytes, labels: Labels) -> Step:
    if ours is None:
        return Step(path, "added", theirs, None, source=(None, path))
    return _merged(path, b"", ours, theirs, (None, path), labels)


def writes(steps: Iterable[Step]) -> dict[str, bytes | None]:
    """Return what is to be written, by path (None: remove)."""
    return {step.path: step.content for step in steps if step.content != step.before}


def show_conflict(content: bytes, around: int = 2) -> list[str]:
    """Return the lines of every conflict in a file, numbered, with some lines `around` it."""
    lines = content.decode("utf-8", "backslashreplace").splitlines()
    begins = [number for number, line in enumerate(lines) if line.startswith("<<<<<<< ")]
    ends = [number for number, line in enumerate(lines) if line.startswith(">>>>>>> ")]
    shown: list[str] = []
    for begin, end in zip(begins, ends, strict=False):
        if shown:
            shown.append("      ...")
        for number in range(max(begin - around, 0), min(end + around + 1, len(lines))):
            shown.append(f"{number + 1:5} {lines[number]}")
    return shown


def markers(labels: Labels) -> str:
    """Return what the markers of a conflict mean."""
    return (
        "In the file the lines of both stand between markers:\n"
        f"  <<<<<<<  {labels.ours}\n"
        f"  |||||||  {labels.base}: what both come from\n"
        f"  =======  {labels.theirs}, down to >>>>>>>\n"
        "Make of them what is right here, and take the four marker lines out."
    )
