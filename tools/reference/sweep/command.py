"""`strata reference --sweep FILE`: trace the references of a file, and write them and a table."""

from __future__ import annotations

import os
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

from chapters import choose_backend, scenes
from common import images, packages
from common.errors import UserError
from common.paths import folder_problem, write_problem
from tools.cli.console import Steps, say
from tools.cli.stopping import prompt_stop
from tools.reference import command as single
from tools.reference.settings import TRACER, chapter_settings, differences, tracer_settings
from tools.reference.sweep import file, table
from tools.reference.sweep.merging import Finished, Merging, Reference
from tools.reference.sweep.pools import MOST_WORKERS, Here, Workers, check_address
from tools.reference.sweep.work import Loaded, task_for
from tools.run import run as running

USUAL_WORKERS = 2
"""Without --workers: one has the GPU trace while another one's sums are read and merged."""


@dataclass(frozen=True)
class Request:
    """What the user asked for; `workers` None: the usual number, or none where Dask is missing."""

    file: Path
    out: Path | None = None
    backend: str = "auto"
    workers: int | None = None
    cluster: str | None = None
    cached: bool = True
    verbose: bool = False


@dataclass(frozen=True)
class Told:
    """What is written of a reference besides its sums: notes of the picture, and its row in the table."""

    notes: dict[str, Any]
    row: dict[str, object]


def run(request: Request) -> int:
    """Trace and write what the file asks for; return the exit code. Raises StrataError."""
    _check(request)
    sweep = file.read(request.file)
    folder = request.out or Path("out") / request.file.stem
    backend = choose_backend(request.backend, TRACER)
    wanted = [
        file.request_of(sweep, entry, folder, backend=backend, cached=request.cached, verbose=request.verbose)
        for entry in sweep.entries
    ]
    _check_requests(sweep, wanted)
    _check_places(folder, wanted)
    images.check_format(sweep.suffix)
    with Steps() as steps:
        references, told = _prepared(sweep, wanted, request, steps)
        steps("start", 0.1)
        last_words = LastWords(request, references)
        pool = _pool(request)
        pool.start()
        # The pool may take seconds to end its workers; Ctrl-C does not wait for that.
        with prompt_stop(last_words.say), pool:
            steps.finish()
            counts = sweep.counts()
            several = f": {counts}" if counts else ""
            say(f"strata: {_counted(len(wanted))} of {request.file}{several}; {pool.where}, into {folder}.")
            _make(folder)
            return _traced(references, told, pool, folder, last_words)


def _check(request: Request) -> None:
    """Raise UserError for options that are wrong."""
    if request.workers is not None and request.cluster is not None:
        raise UserError("--cluster has workers of its own: leave out --workers.")
    if request.workers is not None and not 0 <= request.workers <= MOST_WORKERS:
        raise UserError(
            f"--workers {request.workers} is no number of workers: give one from 0, which traces in this process, to "
            f"{MOST_WORKERS}."
        )
    if request.cluster is not None:
        check_address(request.cluster)
    folder = request.out
    if folder is not None and (
        not folder.absolute().parent.is_dir() or (os.path.lexists(folder) and not folder.is_dir())
    ):
        raise UserError(
            f"--out {folder} is no folder, and none can be made there: name one in a folder that exists."
        )


def _check_places(folder: Path, wanted: list[single.Request]) -> None:
    """Raise UserError where the references, or the table, could not be written at the end."""
    problem = folder_problem(folder)
    if problem:
        raise UserError(f"--out {folder} cannot be written: {problem}.")
    if folder.is_dir():
        for path in (folder / file.TABLE, *(request.out for request in wanted if request.out is not None)):
            problem = write_problem(path)
            if problem:
                raise UserError(f"{path} cannot be written: {problem}.")


def _check_requests(sweep: file.Sweep, wanted: list[single.Request]) -> None:
    """Raise UserError for what is wrong with a reference before any scene is loaded."""
    for entry, request in zip(sweep.entries, wanted, strict=True):
        try:
            single.check_traced(request, single.as_drawn(request))
            own, of_paths = chapter_settings(request.chapter, request.overrides)
            tracer_settings(own, request.filter, request.seed, of_paths)
            scenes.find(request.scene)
        except UserError as error:
            raise UserError(f"{sweep.path}: {file.told(entry)}: {file.plain(error)}") from None


def _prepared(
    sweep: file.Sweep, wanted: list[single.Request], request: Request, steps: Steps
) -> tuple[list[Reference], list[Told]]:
    """Load all scenes, and return the references with what is told of them. Raises UserError."""
    loaded, references, told = Loaded(), [], []
    seen: set[tuple[str, str]] = set()
    for number, (entry, asked) in enumerate(zip(sweep.entries, wanted, strict=True)):
        steps(f"load {asked.scene}", 0.1 * number / len(wanted))
        try:
            scene, hashed = loaded.get(asked)
            if (asked.scene, asked.environment) not in seen:
                seen.add((asked.scene, asked.environment))
                running.tell_warnings(scene, request.verbose)
            task = task_for(asked, scene)
        except UserError as error:
            raise UserError(f"{sweep.path}: {file.told(entry)}: {file.plain(error)}") from None
        facts = task.facts(hashed)
        own, _ = chapter_settings(asked.chapter, asked.overrides)
        left_out = differences(asked.chapter, own, scene)
        notes = single.notes_on_request(asked, task, facts, left_out)
        row = {
            **{name: notes[name] for name in ("chapter", "camera", "time", "ev100", "filter", "seed")},
            "file": asked.out.name if asked.out else "",
            "scene": asked.scene,
            "environment": asked.environment,
            "size": f"{asked.size[0]}x{asked.size[1]}",
            "settings": " ".join(asked.overrides),
            "error_asked": f"{asked.error:g}",
        }
        told.append(Told(notes, row))
        references.append(
            Reference(number, entry.name, _for_workers(asked), facts, task.exposure, request.cached)
        )
    return references, told


def _for_workers(request: single.Request) -> single.Request:
    """Return a request for processes that may have another current folder."""
    scene, around = Path(request.scene).expanduser(), Path(request.environment).expanduser()
    if scene.suffix.lower() in scenes.SUFFIXES and scene.is_file():
        request = replace(request, scene=str(scene.absolute()))
    if request.environment not in scenes.ENVIRONMENTS and around.is_file():
        request = replace(request, environment=str(around.absolute()))
    return request


def _pool(request: Request) -> Here | Workers:
    count = request.workers
    if request.cluster is None and count is None:
        count = USUAL_WORKERS
        try:
            packages.load("distributed")
        except ImportError:
            count = 0
    return Here() if count == 0 and request.cluster is None else Workers(count or 0, request.cluster)


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise UserError(f"--out {folder} cannot be made: {error.strerror or error}.") from None


def _traced(
    references: list[Reference], told: list[Told], pool: Here | Workers, folder: Path, last_words: LastWords
) -> int:
    """Trace, write each reference as it is finished, and say what became of all; return the exit code."""
    rows: dict[int, dict[str, object]] = {}
    written = folder / file.TABLE
    said: set[str] = set()

    def write_rows() -> None:
        table.write_table(written, [rows[number] for number in sorted(rows)])

    def ended(reference: Reference, finished: Finished) -> None:
        of = told[reference.number]
        mixed = table.MIXED if len(finished.sums.devices) > 1 else ""
        notes = of.notes | single.notes_on_paths(finished.sums, finished.error)
        rows[reference.number] = of.row | {
            "error_estimated": notes["estimatedError"],
            "paths": notes["paths"],
            "paths_left_out": notes["pathsLeftOut"],
            "seconds": f"{finished.seconds:.3f}",
            "devices": notes["devices"],
            "note": mixed,
        }
        target = reference.request.out
        assert target is not None, "request_of names it"
        try:
            single.write(target, finished.sums, reference.scale, notes | ({"note": mixed} if mixed else {}))
        except UserError:
            del rows[reference.number]
            raise
        last_words.finished = len(rows)
        write_rows()

    def progress(part: float, detail: str) -> None:
        for reference in references:
            problem = reference.keeper.problem if reference.keeper is not None else ""
            if problem and problem not in said:
                said.add(problem)
                say(f"strata: sums cannot be kept ({problem}): tracing goes on, and they stay in memory.")
        advance(part, detail)

    with Steps() as steps:
        advance: Any = steps.of("trace", 0.0, 1.0)
        merging = Merging(references, pool, ended, progress)
        try:
            merging.run()
        except BaseException:
            steps.finish()
            words = last_words.say()
            say(words) if words else None
            raise
    return _tell(references, rows, written)


class LastWords:
    """What becomes of a sweep that Ctrl-C or an error ends; `finished` references are written."""

    def __init__(self, request: Request, references: list[Reference]) -> None:
        self._request, self._references = request, references
        self._said = False
        self.finished = 0

    def say(self) -> str:
        """Keep what is merged, and return a sentence on it: once, and "" then."""
        lost = 0
        for reference in self._references:
            keeper, target = reference.keeper, reference.request.out
            if keeper is None or not keeper.sums.paths or keeper.keep():
                continue
            assert target is not None, "request_of names it"
            beside = target.with_name(f"{target.name}.npz")
            lost += not keeper.keep_beside(beside)
            if beside.exists() and not self._said:
                say(
                    f"strata: sums are kept in {beside}: --sums {beside} of `strata reference` goes on with them."
                )
        if self._said:
            return ""
        self._said = True
        words = f"strata: {self.finished} of {_counted(len(self._references))} are written"
        if lost:
            return f"{words}; the sums of {lost} could be kept nowhere."
        return f"{words}; the same command goes on with the rest." if self._request.cached else f"{words}."


def _tell(references: list[Reference], rows: dict[int, dict[str, object]], written: Path) -> int:
    """Say what was written; return 0, or raise for references that were given up."""
    missed = []
    for reference in references:
        row, asked = rows.get(reference.number), reference.request.error
        if row is not None and 0.0 < asked < float(str(row["error_estimated"])):
            missed.append(reference.name)
    if rows:
        say(f"{len(rows)} of {_counted(len(references))}, and the table {written}: written.")
    if missed:
        say(
            f"strata: {len(missed)} have an estimated error that is larger than asked for, {missed[0]} among them: "
            "paths in the file allows no more."
        )
    left_out = sum(int(str(row["paths_left_out"])) for row in rows.values())
    if left_out:
        say(f"strata: {left_out} paths had light that is no number, and are left out: see the table.")
    mixed = {str(row["devices"]) for row in rows.values() if row["note"]}
    if mixed:
        say(f"strata: {' / '.join(sorted(mixed))}: {table.MIXED}.")
    problems = [reference for reference in references if reference.problem is not None]
    if problems:
        first = problems[0]
        which = f"{_counted(len(problems))} could not be made, first {first.name}"
        which = which if problems[1:] else f"{first.name} could not be made"
        raise UserError(f"{which}: {str(first.problem).rstrip('.')}. Sums that are merged are kept.")
    return 0


def _counted(count: int) -> str:
    return "1 reference" if count == 1 else f"{count} references"
