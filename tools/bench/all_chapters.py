"""`strata bench --all`: every chapter's bench on every backend that is here, and one table; what fails is named.

Each bench is a process of its own, `python -m tools.bench.all_chapters`: a driver that ends its process, or that keeps
what it was once given, spoils one row and no other.
"""

from __future__ import annotations

import datetime
import json
import subprocess
import sys
import time as clock
from collections.abc import Collection, Sequence
from contextlib import suppress
from pathlib import Path
from typing import Any

from rich.console import Console

import chapters
from backends.choice import NOTHING, probe
from backends.contract import BACKENDS
from chapters import folders, scenes
from common.errors import StrataError, UnsupportedError, UserError
from common.paths import ROOT, temporary_folder
from common.reports.benches import Effort
from common.reports.tables import table
from tools.bench import bench
from tools.bench import truth as bench_truth
from tools.bench.figures.chapters import plot_all
from tools.bench.lessons.parts import PARTS, parts_of
from tools.bench.points import FULL
from tools.bench.report import show
from tools.cli.console import Steps, err, out, say
from tools.run.record import STDOUT

BRIEF = Effort(warm_up=1, frames=4, rounds=2, samples=2, starts=1, everything=False)
"""Of a quick run: opening a chapter takes longer than its frames, and each round opens it again."""

SIZE = (160, 90)
"""Of a quick run."""

QUICK_PARTS = ("settings", "stability")
"""What a quick run measures: what every chapter has, and what takes a second or few. `--only` names other parts."""

KIND = "every chapter"
"""What a record of several benches says that it is."""

NAMES = {"vulkan": "Vulkan", "gl": "OpenGL"}
COMMAND = ["-m", "tools.bench.all_chapters"]
FAILED = 3
"""Exit code of a bench that failed and has said why on stderr, on one line."""


def run(
    backend: str = "auto",
    scene: str = scenes.DEFAULT,
    size: tuple[int, int] = SIZE,
    quick: bool = True,
    json_path: Path | None = None,
    record: bool = False,
    only: Sequence[str] = (),
    truth: str = bench_truth.OWN,
    plot_path: Path | None = None,
) -> int:
    """Measure every chapter, and return the exit code: 1 if one of them failed.

    `backend` "auto" means each that is here, but with `record` the one that draws best: records are kept by class of
    device. `only` names the PARTS to measure; chapters without any of them are left out. `truth` is what pictures
    are held to; with a traced one `plot_path` gets the presets of all chapters. Raises UserError for a wrong argument,
    UnsupportedError where nothing can be measured, before anything is.
    """
    bench_truth.check(truth, record, only)
    bench.check_plot(plot_path)
    bench.check_paths(json_path, plot_path)
    bench.check_record(record, quick, only)
    only = only or bench.judged_parts(truth)
    scenes.find(scene)
    path = Path(scene)  # a bench has another folder than the one this was typed in
    found_at = str(path.absolute()) if path.is_file() else scene
    wanted = pairs(backend, quick, only, one_backend=record)
    kept: list[Path] = []
    rows: list[tuple[int, str, dict[str, Any] | str, float]] = []
    with Steps() as steps:
        for place, (number, api, parts) in enumerate(wanted):
            steps(f"chapter {number} on {NAMES[api]}", place / len(wanted))
            began = clock.perf_counter()
            asked = {
                "which": number,
                "backend": api,
                "scene": found_at,
                "size": size,
                "quick": quick,
                "parts": parts,
                "truth": truth,
            }
            made = one(asked)
            rows.append((number, api, made, clock.perf_counter() - began))
            if not isinstance(made, str):
                made["scene"]["name"] = scene
                kept += bench.keep(made) if record else []
    records = [made for _, _, made, _ in rows if not isinstance(made, str)]
    failed = [(number, api, why) for number, api, why, _ in rows if isinstance(why, str)]
    found = {
        "format": bench.FORMAT,
        "kind": KIND,
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "commit": bench.commit(),
        "quick": quick,
        "records": records,
        "failures": [{"chapter": number, "backend": api, "why": why} for number, api, why in failed],
    }
    if json_path == STDOUT:
        print(json.dumps(found, indent=1))
    elif json_path is not None:
        bench.write_record(json_path, found)
    if plot_path is not None:
        plot_all(plot_path, records)
    to = err if json_path == STDOUT else out
    for made in records if only else ():
        show(made, to)
    show_rows(rows, size, to)
    written_to = (path for path in (json_path, plot_path) if path not in (None, STDOUT))
    for written in (*kept, *written_to):
        say(f"Wrote {written}")
    for number, api, why in failed:
        say(f"strata: The bench of chapter {number} on {NAMES[api]} failed: {why}")
    return 1 if failed else 0


def pairs(
    backend: str, quick: bool, only: Sequence[str], one_backend: bool = False
) -> list[tuple[int, str, tuple[str, ...]]]:
    """Return what is measured: number of a chapter, backend, parts. What is left out is said."""
    if backend == "auto" and not one_backend:
        here = list(BACKENDS)
        for api in BACKENDS:
            try:
                probe(api)
            except UnsupportedError as error:
                here.remove(api)
                say(f"strata: {NAMES[api]} is not measured: {error}")
        if not here:
            raise UnsupportedError(NOTHING)
    else:
        here = [chapters.choose_backend(backend)]
        probe(here[0])
    for part in only:
        if part not in PARTS:
            parts_of(chapters.available()[0], here[0], [part])  # says what is wrong with it
    found, lacking = [], []
    for number in chapters.available():
        for api in here:
            parts = _parts(number, api, quick, only)
            if parts is None:
                lacking.append(f"chapter {number} on {NAMES[api]}")
            else:
                found.append((number, api, parts))
    if not found:
        raise UserError(
            f"--only {', '.join(only)}: no chapter has that on {' or '.join(NAMES[api] for api in here)}."
        )
    if lacking:
        say(f"strata: There is nothing of this to measure in {', '.join(lacking)}.")
    return found


def _parts(number: int, api: str, quick: bool, only: Sequence[str]) -> tuple[str, ...] | None:
    """Return what is measured of a chapter on a graphics API; None if it has no such version, or none of the parts."""
    if api == "gl" and not folders.renderer_name(chapters.folder_of(number), "gl"):
        return None
    wanted: Collection[str] = only or (QUICK_PARTS if quick else PARTS)
    parts = tuple(part for part in parts_of(number, api) if part in wanted)
    return parts or None


# --- one bench, in a process of its own -------------------------------------------------------------------------------


def one(asked: dict[str, Any]) -> dict[str, Any] | str:
    """Return the record of one bench, or in a sentence why there is none."""
    with temporary_folder() as folder:
        path = folder / "record.json"
        done = subprocess.run(
            [sys.executable, *COMMAND, json.dumps({**asked, "path": str(path)})],
            cwd=ROOT,
            capture_output=True,
            text=True,
            errors="replace",
        )
        if done.returncode == 0:
            with suppress(UserError):
                return bench.read_record(path)
    last = (done.stderr.strip().splitlines() or ["it said nothing"])[-1]
    if done.returncode == FAILED:
        return last
    ended = f"a signal, {-done.returncode}" if done.returncode < 0 else f"exit code {done.returncode}"
    return f"its process ended with {ended}; the last line it wrote is: {last}"


def main() -> int:
    """Measure what the one argument, an object of JSON, asks for, and write the record to its "path"."""
    asked = json.loads(sys.argv[1])
    path, quick = Path(asked.pop("path")), asked.pop("quick")
    try:
        with Steps(enabled=False) as steps:
            made = bench.measure(
                **{**asked, "size": tuple(asked["size"])}, effort=BRIEF if quick else FULL, steps=steps
            )
    except StrataError as error:
        print(" ".join(str(error).split()), file=sys.stderr)
        return FAILED
    made["quick"] = quick
    bench.write_record(path, made)
    return 0


# --- what came out ----------------------------------------------------------------------------------------------------


def show_rows(
    rows: Sequence[tuple[int, str, dict[str, Any] | str, float]], size: tuple[int, int], to: Console
) -> None:
    """Print one row for each bench: the preset medium, and how long the bench took."""
    first = next((made for _, _, made, _ in rows if not isinstance(made, str)), None)
    scene = "" if first is None else f"{first['scene']['name']}, "
    shown = table(
        f"Every chapter: the preset medium, {scene}{size[0]}x{size[1]}",
        *(">chapter", "on", ">GPU ms", ">±", ">Python ms", ">FLIP", ">draws", ">changes", ">s"),
    )
    devices: dict[str, str] = {}
    for number, api, made, seconds in rows:
        cells = ["failed", *("-",) * 5] if isinstance(made, str) else _cells(made)
        shown.add_row(str(number), NAMES[api], *cells, f"{seconds:.0f}")
        if not isinstance(made, str):
            devices[api] = made["device"]["name"]
    to.print(shown)
    for api, device in devices.items():
        to.print(f"{NAMES[api]}: {device}", soft_wrap=True, markup=False)
    traced = first is not None and "truth" in first["reference"]
    against = "light traced by paths" if traced else "the preset reference with more samples a pixel"
    changes = "" if traced else "; changes are the pixels that the worst case of stability changes"
    to.print(f"FLIP is against {against}{changes}.", soft_wrap=True)


def _cells(made: dict[str, Any]) -> list[str]:
    medium = next((point for point in made["points"] if point["name"] == "medium"), None)
    worst = made["stability"]
    changes = f"{worst['worst']['pixels_changed']:.3%}" if worst else "-"
    if medium is None:
        return [*("-",) * 5, changes]
    flip = medium["error"]["flip"]
    return [
        f"{medium['gpu_ms']:.2f}",
        f"{medium['noise_ms']:.2f}",
        f"{medium['cpu_ms']:.2f}",
        "-" if flip is None else f"{flip:.4f}",
        f"{medium['work']['draws']:,}",
        changes,
    ]


if __name__ == "__main__":
    sys.exit(main())
