"""`strata carry`: take a fix that was made in one chapter forward through every later one, by three-way merge.

The fix is what differs between a commit (HEAD, or `--base`) and the files on disk. It goes from chapter to chapter in
the order of their numbers. What a chapter made of it is what the next one is merged with, so each merge is between
neighbours, and a conflict that was resolved once is resolved for all later chapters. A chapter in which a file is gone
ends the way of that file, and so does one whose conflict was resolved by leaving the file as it was.

All merges up to the first conflict are made before a file is written, and files are written all or none.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

from common.errors import UserError
from common.names import suggest
from tools.cli.console import out, say
from tools.snapshots.carry_state import Fix, State, alone, load, save
from tools.snapshots.history import History
from tools.snapshots.merging import (
    Labels,
    Step,
    has_markers,
    markers,
    merge_trees,
    renames,
    show_conflict,
    writes,
)
from tools.snapshots.trees import STAR, Tree, belongs, numbers, read_tree, write_files

KINDS = {
    "taken": "takes it: the file was the same",
    "merged": "merged with its own lines",
    "added": "gets the new file",
    "removed": "loses the file",
    "already": "has it already",
    "absent": "left out",
    "conflict": "conflict",
}
"""What the kinds of steps are called."""

FINISH = (
    "`strata carry --continue` takes it up once that is resolved, `strata carry --abort` takes all of it back"
)


@dataclass(frozen=True)
class Landing:
    """What becomes of the fix in one chapter; `after` is the fix as the next chapter meets it."""

    number: int
    folder: str
    steps: list[Step]
    after: Fix

    @property
    def conflicts(self) -> list[Step]:
        """The files that somebody has to look at."""
        return [step for step in self.steps if step.kind == "conflict"]


def start(root: Path, number: int, files: Sequence[str], *, base: str = "HEAD", dry_run: bool = False) -> int:
    """Carry what changed in `files` of chapter `number` since `base`; return 0, or 1 if it stopped at a conflict.

    Raises UserError for a chapter or file that is not there or did not change, and while another carry waits.
    """
    if dry_run:
        return _carry(root, State(number, None), _fix(root, number, files, base), number, dry_run)
    with alone(root):
        waiting = load(root)
        if waiting is not None:
            raise UserError(f"A carry from {_folder(root, waiting.number)} is not finished: {FINISH}.")
        return _carry(root, State(number, None), _fix(root, number, files, base), number, dry_run)


def resume(root: Path, *, dry_run: bool = False) -> int:
    """Go on behind the chapter whose conflict was resolved; return as `start` does.

    Raises UserError if there is nothing to go on with, or conflict markers are left.
    """
    with alone(root):
        state = load(root)
        if state is None:
            raise UserError("No carry is waiting: `strata carry ch01 FILE` begins one.")
        if state.stopped is None:
            raise UserError("The last carry was ended while it wrote: `strata carry --abort` takes it back.")
        folder = _folder(root, state.stopped)
        mine = {name: old for name, old in state.originals.items() if name.startswith(f"{folder}/")}
        base, theirs = dict(state.pending.base), dict(state.pending.theirs)
        for name, old in mine.items():
            path, inside = root / name, name.removeprefix(f"{folder}/")
            if old is not None:
                base[inside] = old
            if path.is_file():
                theirs[inside] = path.read_bytes()
                if has_markers(theirs[inside]):
                    raise UserError(
                        f"{_shown(root, name)} still has conflict markers (lines that begin with <<<<<<<, "
                        "||||||| or >>>>>>>): resolve them, then `strata carry --continue`."
                    )
            state.written[name] = theirs.get(inside)  # resolved: a later conflict does not put it in question
        return _carry(root, state, Fix(base, theirs), state.stopped, dry_run)


def abort(root: Path) -> int:
    """Put all files back as they were before the carry; the fix itself stays. Return 0.

    Raises UserError if no carry waits, or a file that it wrote without a conflict was changed since.
    """
    with alone(root):
        state = load(root)
        if state is None:
            raise UserError("No carry is waiting, so there is nothing to take back.")
        for name, left in state.written.items():
            path = root / name
            now = path.read_bytes() if path.is_file() else None
            waiting = state.stopped is not None and name.startswith(f"{_folder(root, state.stopped)}/")
            if state.stopped is not None and not waiting and now not in (left, state.originals[name]):
                raise UserError(
                    f"{_shown(root, name)} was changed after the carry wrote it, and that would be lost: "
                    "put it aside, and take the file back by git."
                )
        write_files(root, state.originals)
        save(root, None)
    count = len(state.originals)
    say(f"The later chapters are as they were ({_count(count, 'file')}); the fix is still in its own.")
    return 0


def _carry(root: Path, state: State, fix: Fix, behind: int, dry_run: bool) -> int:
    """Merge into every chapter behind one up to the first conflict, write, and say so."""
    landings = plan(root, behind, fix)
    would = "would " if dry_run else ""
    for landing in landings:
        for step in landing.steps:
            out.print(f"{landing.folder}  {step.path}: {_words(step)}", markup=False, soft_wrap=True)
    stopped = landings[-1] if landings and landings[-1].conflicts else None
    if not dry_run:
        _write(root, state, landings, stopped)
    written = sum(len(writes(landing.steps)) for landing in landings)
    if stopped is None:
        later = [folder.name for number, folder in numbers(root).items() if number > behind]
        if not later:
            say(f"There is no chapter behind {_folder(root, behind)}: nothing {would}remains to be carried.")
        elif dry_run:
            say(f"Nothing was written; {_count(written, 'file')} would be.")
        else:
            say(f"Carried to the end: {_count(written, 'file')} written.")
            say("Next: `strata test` for those chapters, then commit them together with the fix.")
        return 0
    _explain(root, stopped, dry_run)
    return 1


def plan(root: Path, behind: int, fix: Fix) -> list[Landing]:
    """Return what becomes of `fix` in each chapter behind number `behind`, in order, up to the first conflict."""
    landings: list[Landing] = []
    folders = numbers(root)
    known = set(read_tree(folders[behind])) | set(fix.base)
    for number, folder in folders.items():
        if number <= behind:
            continue
        labels = Labels(
            folder.name, "the chapter before, without the fix", "the chapter before, with the fix"
        )
        ours = read_tree(folder)
        steps = merge_trees(fix.base, ours, fix.theirs, labels, known)
        fix = _after(fix, steps)
        landings.append(Landing(number, folder.name, steps, fix))
        if landings[-1].conflicts:
            break
        known = set(ours)
    return landings


def _after(fix: Fix, steps: list[Step]) -> Fix:
    """Return the fix as the next chapter meets it: what this one had and has now, or where it had it, as before."""
    base: Tree = {}
    theirs: Tree = {}
    for step in steps:
        if step.kind == "already":
            was, is_now = step.source
            base |= {} if was is None else {was: fix.base[was]}
            theirs |= {} if is_now is None else {is_now: fix.theirs[is_now]}
        elif step.kind not in ("absent", "conflict"):
            base |= {} if step.before is None else {step.path: step.before}
            theirs |= {} if step.content is None else {step.path: step.content}
    return Fix(base, theirs)


def _write(root: Path, state: State, landings: list[Landing], stopped: Landing | None) -> None:
    """Write what was planned; if that fails, files and state are as they were."""
    files: dict[str, bytes | None] = {}
    originals = dict(state.originals)
    pending = Fix({}, {})
    for landing in landings:
        for step in landing.steps:
            if step.content != step.before or step.kind == "conflict":
                originals.setdefault(f"{landing.folder}/{step.path}", step.before)
        for path, content in writes(landing.steps).items():
            files[f"{landing.folder}/{path}"] = content
        if landing is stopped:
            pending = _after_pending(landing)
    before = load(root)
    written = {**state.written, **files}
    save(root, State(state.number, None, originals, written))
    try:
        write_files(root, files)
    except BaseException:
        save(root, before)
        raise
    waits = None if stopped is None else State(state.number, stopped.number, originals, written, pending)
    save(root, waits)


def _after_pending(landing: Landing) -> Fix:
    """Return the part of the fix that the stopped chapter had already; the rest is read from its files later."""
    had = [step.source for step in landing.steps if step.kind == "already"]
    old, new = {was for was, _ in had}, {is_now for _, is_now in had}
    return Fix(
        {name: data for name, data in landing.after.base.items() if name in old},
        {name: data for name, data in landing.after.theirs.items() if name in new},
    )


def _explain(root: Path, stopped: Landing, dry_run: bool) -> None:
    labels = Labels(stopped.folder, "the chapter before, without the fix", "the chapter before, with the fix")
    for step in stopped.conflicts:
        out.print()
        name = _shown(root, f"{stopped.folder}/{step.path}")
        if not step.marked:
            out.print(f"{name}: {step.sentence}.", markup=False, soft_wrap=True)
            continue
        out.print(f"{name}, {_count(step.conflicts, 'place')}:", markup=False, soft_wrap=True)
        for line in show_conflict(step.content or b""):
            out.print(line, markup=False, soft_wrap=True)
    if any(step.marked for step in stopped.conflicts):
        out.print()
        out.print(markers(labels), markup=False, soft_wrap=True)
    if dry_run:
        say(
            f"Nothing was written; it would stop at {stopped.folder}, and what follows depends on how you resolve it."
        )
    else:
        say(f"strata: stopped at {stopped.folder}; {FINISH}.")


def _words(step: Step) -> str:
    words = KINDS[step.kind]
    return f"{words}: {step.sentence}" if step.sentence else words


# --- the fix ----------------------------------------------------------------------------------------------------------


def _fix(root: Path, number: int, files: Sequence[str], base: str) -> Fix:
    """Return what changed in `files` of a chapter since the commit `base`."""
    folders = numbers(root)
    if number not in folders:
        raise UserError(f"There is no chapter {number} in {root}.")
    folder = folders[number]
    history = History(root)
    since = history.commit(base)
    changed = [
        name.removeprefix(f"{folder.name}/")
        for name in history.changed(folder.name, since)
        if belongs(name.removeprefix(f"{folder.name}/"))
    ]
    now: Tree = {name: (folder / name).read_bytes() for name in changed if (folder / name).is_file()}
    then: Tree = {}
    for name in changed:
        content = history.read(since, f"{folder.name}/{name}")
        if content is not None:
            then[name] = content
    if not files:
        found = ", ".join(changed) or "nothing"
        raise UserError(f"Which files? In {folder.name} this differs from {base}: {found}.")
    wanted: set[str] = set()
    for text in files:
        wanted |= _wanted(root, folder, text, changed, base)
    for old, new in renames(then, now).items():  # both ends of a rename go together
        wanted |= {old, new} if {old, new} & wanted else set()
    fix = Fix(_only(then, wanted), _only(now, wanted))
    out.print(
        f"The fix in {folder.name} since {base}: {', '.join(sorted(wanted))}", markup=False, soft_wrap=True
    )
    for name, content in fix.theirs.items():
        if has_markers(content):
            raise UserError(
                f"{_shown(root, f'{folder.name}/{name}')} has conflict markers: resolve them first."
            )
    return fix


def _wanted(root: Path, folder: Path, text: str, changed: Sequence[str], base: str) -> set[str]:
    """Return the changed files that a word of the command line means: a file, or all in a folder."""
    home = folder.resolve()
    tried = [(start / text).resolve() for start in (Path.cwd(), root.parent, folder)]
    inside = [path for path in tried if path.is_relative_to(home)]
    if not inside:
        raise UserError(f"{text} is not in {folder.name}: name files of that chapter, as shading/forward.py.")
    names = [path.relative_to(home).as_posix() for path in inside]
    star = names[0].split("/")[0]
    if star in STAR:
        raise UserError(f"{text} is of one chapter alone: {star} are not copied to later chapters.")
    for name in names:
        found = {one for one in changed if name in (".", one) or one.startswith(f"{name}/")}
        if found:
            return found
    if any(path.exists() for path in inside):
        raise UserError(
            f"{folder.name}/{names[0]} is as it is in {base}, so there is no fix to carry; "
            "if the fix is committed, name the commit before it: --base HEAD~1."
        )
    near = suggest(names[-1], changed or read_tree(folder))
    raise UserError(f"There is no file {text} in {folder.name}{near}{'' if near.endswith('?') else '.'}")


def _only(tree: Mapping[str, bytes], names: set[str]) -> Tree:
    return {name: content for name, content in tree.items() if name in names}


def _folder(root: Path, number: int) -> str:
    return numbers(root)[number].name


def _shown(root: Path, name: str) -> str:
    return f"{root.name}/{name}"


def _count(number: int, what: str) -> str:
    return f"{number} {what}{'' if number == 1 else 's'}"
