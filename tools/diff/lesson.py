"""A difference as a lesson: what is new first, in the order of reading, plumbing folded; and the words for it."""

from __future__ import annotations

import re
from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import PurePosixPath

from common.errors import UserError
from common.names import suggest
from tools.diff.diff import FileDifference, TreeDifference, tree_difference
from tools.diff.sides import Side, are_versions, files_of


@dataclass(frozen=True)
class Comparison:
    """Two sides and what differs: `ideas` to be read in their order, and `plumbing`, which a reader may pass over.

    `versions`: the sides are a Vulkan and an OpenGL version, to be read side by side.
    """

    a: Side
    b: Side
    tree: TreeDifference
    ideas: tuple[FileDifference, ...]
    plumbing: tuple[FileDifference, ...]
    only: tuple[str, ...] = ()
    versions: bool = False

    @property
    def title(self) -> str:
        """The heading of all."""
        if self.versions:
            return f"{_upper(self.a.name)} beside {self.b.name}"
        title = f": {self.b.title}" if self.b.title and self.a.number != self.b.number else ""
        return f"From {self.a.name} to {self.b.name}{title}"

    @property
    def nothing(self) -> str:
        """The sentence for sides that do not differ, or "" if they do."""
        if self.tree.changed:
            return ""
        where = f" in {' or '.join(self.only)}" if self.only else ""
        why = ": both use the same files" if self.versions else ""
        return f"Nothing differs{where} between {self.a.name} and {self.b.name}{why}."

    def where(self, file: FileDifference) -> str:
        """Return the name under which a file is shown: both paths where they differ."""
        if file.old is not None and file.new is not None and file.old.path != file.new.path:
            return f"{file.old.path} {'|' if self.versions else '->'} {file.new.path}"
        return file.source.path

    def status(self, file: FileDifference) -> str:
        """Return what became of a file."""
        if self.versions and file.status in ("new", "removed"):
            side = self.b if file.status == "new" else self.a
            return "only" + (" on OpenGL" if side.backend == "gl" else " on Vulkan")
        return "two versions" if self.versions else file.status

    def totals(self) -> str:
        """Return the counts of all files as a sentence."""
        numbers = {
            name: len(self.tree.of_status(name)) for name in ("new", "changed", "renamed", "removed", "same")
        }
        if self.versions:
            pairs = numbers["changed"] + numbers["same"]
            words = [f"{pairs} {_files(pairs)} with a twin"]
            alone = [*self.tree.of_status("removed"), *self.tree.of_status("new")]
            for word in dict.fromkeys(self.status(file) for file in alone):
                words.append(f"{sum(self.status(file) == word for file in alone)} {word}")
        else:
            words = [f"{count} {name}" for name, count in numbers.items() if count and name != "same"]
            words[0] = words[0].replace(" ", f" {_files(int(words[0].split()[0]))} ", 1)
        lines = f"{count(self.tree.insertions, self.tree.deletions)} lines of Python and GLSL"
        return f"{', '.join(words)}; {lines}."

    def notes(self, file: FileDifference) -> list[str]:
        """Return what is to be said of a file beside its lines, as sentences: moved code among it."""
        said = [f"{_upper(note)}." for note in file.notes]
        for move in self.tree.moves:
            lines = f"{move.lines} lines"
            if file.new is not None and move.new_path == file.new.path:
                source = "" if move.old_path == move.new_path else f"{move.old_path}, "
                said.append(
                    f"Moved, not new: {lines} at line {move.new_line} are from {source}line {move.old_line}."
                )
            elif file.old is not None and move.old_path == file.old.path:
                said.append(
                    f"Moved, not gone: {lines} from line {move.old_line} are in {move.new_path}, line {move.new_line}."
                )
        return said

    def folded(self) -> list[tuple[str, list[FileDifference]]]:
        """Return the plumbing in groups, each with why it is passed over."""
        imports = [file for file in self.plumbing if file.imports_only]
        others = [file for file in self.plumbing if not file.imports_only]
        why = "without a twin" if self.versions else "not in the order of reading"
        return [(name, files) for name, files in (("imports alone", imports), (why, others)) if files]


def compare(a: Side, b: Side, only: Sequence[str] = ()) -> Comparison:
    """Return what differs between two sides, in the folders `only` or everywhere.

    Raises UserError for a folder that `--only` does not know, OSError where a file cannot be read.
    """
    versions = are_versions(a, b)
    if versions:
        a, b = (side if side.backend else replace(side, backend="vulkan") for side in (a, b))
    reading = b.reading or a.reading
    old, new = files_of(a, versions), files_of(b, versions)
    parts = sorted({path.split("/")[0] for path in (*old, *new) if "/" in path})
    for name in only:
        if name not in parts:
            near = suggest(name, parts)
            raise UserError(f"--only {name}: there is no such part{near}{'' if near.endswith('?') else '.'}")
    tree = tree_difference(old, new, reading, versions)
    if only:
        files = tuple(file for file in tree.files if any(path.split("/")[0] in only for path in paths(file)))
        named = {path for file in files for path in paths(file)}
        tree = replace(
            tree,
            files=files,
            moves=tuple(move for move in tree.moves if {move.old_path, move.new_path} & named),
        )
    same_lesson = a.number == b.number or None in (a.number, b.number)
    ideas = [file for file in tree.changed if _is_idea(file, tree.reading, same_lesson, versions)]
    if not ideas:  # then there is nothing beside which the rest would be plumbing
        ideas = [*tree.changed]
    plumbing = sorted(
        (file for file in tree.changed if file not in ideas), key=lambda file: file.status != "new"
    )
    return Comparison(a, b, tree, tuple(ideas), tuple(plumbing), tuple(only), versions)


def _is_idea(file: FileDifference, reading: Sequence[str], same_lesson: bool, versions: bool) -> bool:
    """Whether a file is to be read: of two versions each pair, of a copy of its chapter whatever was changed in it,
    else what the order of reading names; imports alone never."""
    if versions:
        return file.old is not None and file.new is not None
    return not file.imports_only and (same_lesson or file.path in reading)


def paths(file: FileDifference) -> list[str]:
    """Return the paths of a file on its sides."""
    return [one.path for one in (file.old, file.new) if one is not None]


def pass_of(file: FileDifference) -> str:
    """Return the name of the pass that a file may belong to: x of a/x.py, a/vulkan_x.py, a/x.frag; a of a/vulkan.py."""
    path = PurePosixPath(file.path)
    if len(path.parts) != 2:
        return ""
    name = re.sub(r"^(vulkan|gl)(_|$)", "", path.stem)
    return name or path.parts[0]


def count(insertions: int, deletions: int) -> str:
    """Return "+3 -1"."""
    return f"+{insertions:,} -{deletions:,}"


def _files(number: int) -> str:
    return "file" if number == 1 else "files"


def _upper(text: str) -> str:
    return text[:1].upper() + text[1:]
