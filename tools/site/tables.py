"""Tables and figures that pages of the site are filled with, each from records of tests and measurements."""

from __future__ import annotations

import json
import re
from collections.abc import Callable
from functools import partial
from html import escape
from typing import Any

import chapters
from bootstrap.machine import Machine
from bootstrap.plan import decide
from common.paths import ROOT
from tools.ledger import features, results
from tools.ledger.results import BACKENDS, Area
from tools.site import features as site_features
from tools.site import glossary, pairs
from tools.site.draft import Draft
from tools.site.figures.plot import cell, short
from tools.site.records import lacks, records_of

LONG = ROOT / "docs" / "records" / "long.json"

SYSTEMS = {
    "Debian 12": Machine(
        distribution="debian", release="12", codename="bookworm", managers=("apt-get",), sudo=True
    ),
    "Ubuntu": Machine(
        distribution="ubuntu",
        release="24.04",
        codename="noble",
        managers=("apt-get",),
        python=(3, 12),
        sudo=True,
    ),
    "Fedora": Machine(distribution="fedora", release="43", managers=("dnf",), sudo=True),
    "Arch": Machine(distribution="arch", managers=("pacman",), sudo=True),
    "Windows Subsystem for Linux": Machine(
        distribution="ubuntu", release="24.04", codename="noble", managers=("apt-get",), wsl=True, sudo=True
    ),
    "macOS": Machine(system="darwin", managers=("brew",)),
    "Windows": Machine(system="win32"),
}
"""Machines on which nothing is installed: what the launcher and doctor would say to each."""


def _records(path: Any) -> dict[str, Any]:
    try:
        found: dict[str, Any] = json.loads(path.read_text("utf-8"))
    except (OSError, ValueError):
        return {}
    return found


def chapter_cards(draft: Draft, page: str) -> str:
    """Return a card for each chapter: its picture, its title, the question that it answers, and how long it takes."""
    cards = [
        draft.attempt(page, f"the card of chapter {number}", partial(_card, draft, number, page))
        for number in chapters.available()
    ]
    return f'<div class="cards">{"".join(cards)}</div>'


def _card(draft: Draft, number: int, page: str) -> str:
    lesson, name = chapters.lesson(number), chapters.folder_name(number)
    link = re.sub(r"\.md$", ".html", draft.file(f"chapters/{name}/README.md", page))
    picture = draft.file(f"docs/pictures/{lesson.cover}", page)
    hours, minutes = divmod(lesson.minutes, 60)
    time = f"{hours} h {minutes:02} min" if hours else f"{minutes} min"
    return (
        f'<a class="card" href="{link}"><img src="{picture}" alt="A picture of chapter {number}" loading="lazy">'
        f"<strong>{number}. {escape(lesson.title)}</strong><span>{escape(lesson.question)}</span>"
        f"<small>{len(lesson.sections)} sections, {time}</small></a>"
    )


def chapters_table(draft: Draft, page: str) -> str:
    """Chapters, what each adds, and what became of its tests, and of the features that they hold, on each backend."""
    record = results.read()
    rows, missing = [], []
    for number in chapters.available():
        name = chapters.folder_name(number)
        area = record.get(name)
        if area is None:
            missing.append(name)
        cells = ["not run" if area is None else _held(area, backend) for backend in BACKENDS]
        lesson = draft.attempt(
            page, f"what chapter {number} says of itself", partial(_lesson, draft, number, page)
        )
        rows.append(f"| {number} | {lesson} | {' | '.join(cells)} |")
    said = ""
    if missing:
        command = features.run_command(missing, record=True)
        said = draft.lack(page, f"results of {', '.join(missing)}: `{command}` keeps them.")
    made = (
        f"| | chapter, and what it adds | {' | '.join(BACKENDS.values())} |\n|---:|---|{'---|' * len(BACKENDS)}\n"
        + "\n".join(rows)
    )
    own = {name: area for name, area in record.items() if re.fullmatch(r"ch\d\d", name)}
    return f"{made}\n\n{site_features.origins(own)}\n\n{said}"


def _lesson(draft: Draft, number: int, page: str) -> str:
    """Return the title of a chapter, with a link, and what it adds."""
    lesson = chapters.lesson(number)
    link = draft.file(f"chapters/{chapters.folder_name(number)}/README.md", page)
    adds = f'<small class="adds">{escape(", ".join(lesson.adds))}</small>'
    return f"[{escape(lesson.title)}]({link})<br>{adds}"


def _held(area: Area, backend: str) -> str:
    """Return what became of a chapter's tests on a backend, and how many features they hold there."""
    passed = sum(results.state(held.get(backend)) == "passed" for held in area.features.values())
    counts = results.said(area.tests.get(backend))
    return f"{counts}<br><small>{passed} features</small>" if passed else counts


def setup_commands(draft: Draft, page: str) -> str:
    """For each system the commands that the launcher shows there, with their reasons."""
    parts = []
    for name, machine in SYSTEMS.items():
        plan = decide(machine, install=False)
        steps = [f"# {step.reason}\n{line}" for step, line in zip(plan.steps, plan.commands(), strict=True)]
        block = (
            "```sh\n" + "\n".join(steps) + "\n```" if steps else "Nothing can be installed by a command here."
        )
        notes = "".join(f"\n\n{note}" for note in plan.notes)
        parts.append(f"### {name}\n\n{block}{notes}")
    return "\n\n".join(parts)


HEADS = ("GPU, ms", "frame until done, ms", "Python, ms", "FLIP")
"""What the page on speed says of a preset on a device."""


def speed_table(draft: Draft, page: str) -> str:
    """Presets of every chapter, devices side by side: times and error; then where they are from."""
    records, devices = _by_device(draft, page)
    unread = _unread(draft, page)
    if not devices:
        return unread
    heads = [f"{device}: {head}" for device in devices for head in HEADS]
    rows = []
    for number, found in records.items():
        presets = list(dict.fromkeys(p["name"] for _, made in found.values() for p in _presets(made)))
        for preset in presets:
            cells = [cell for device in devices for cell in _figures_of(found.get(device), preset)]
            rows.append(f"| {number} | {cell(preset)} | {' | '.join(cells)} |")
    table = _table(["chapter", "preset", *heads], rows, ["---:", "---", *["---:"] * len(heads)])
    absent = " ".join(
        f"Of chapter {number} there are no presets measured on {device}: `./strata bench {number} --record` there."
        for number, found in records.items()
        for device in devices
        if found and device not in found
    )
    return f"{table}\n\n{absent}\n\n{unread}\n\n### Where these are from\n\n{_origins(draft, page, records, devices)}"


def _unread(draft: Draft, page: str) -> str:
    """Say which records a page of all chapters cannot show."""
    return "\n\n".join(filter(None, (lacks(draft, page, number) for number in chapters.available())))


Records = dict[int, dict[str, tuple[str, dict[str, Any]]]]
"""Of each chapter by device: the name of the file, and the record."""


def _by_device(draft: Draft, page: str) -> tuple[Records, list[str]]:
    """Return the records of every chapter by device, and the devices, software first; what lacks is said."""
    records: Records = {}
    for number in chapters.available():
        records[number] = {_device(made): (name, made) for name, made in records_of(number).items()}
        if not records[number]:
            draft.lack(page, f"measurements of chapter {number}: `./strata bench {number} --record`.")
    devices = list(dict.fromkeys(device for found in records.values() for device in found))
    return records, devices


def _device(made: dict[str, Any]) -> str:
    """Return how a device is called in a heading: without what its name says about versions."""
    return cell(re.sub(r"\s*\(.*?\)", "", made["device"]["name"]))


def _presets(made: dict[str, Any]) -> list[dict[str, Any]]:
    return [point for point in made["points"] if point["kind"] == "preset"]


def _figures_of(held: tuple[str, dict[str, Any]] | None, preset: str) -> list[str]:
    """Return the cells of one preset on one device; dashes where it was not measured."""
    point = next((p for p in _presets(held[1]) if p["name"] == preset), None) if held else None
    if point is None:
        return ["-"] * len(HEADS)
    flip = point["error"]["flip"]
    return [
        f"{short(point['gpu_ms'])} ± {short(point['noise_ms'])}",
        short(point["wall_ms"]),
        short(point["cpu_ms"]),
        "-" if flip is None else f"{flip:.3f}",
    ]


def _origins(draft: Draft, page: str, records: Records, devices: list[str]) -> str:
    """Return which record each chapter's figures are from: its date, driver, commit and size of the picture."""

    def origin(held: tuple[str, dict[str, Any]] | None) -> str:
        if held is None:
            return "-"
        name, made = held
        link = draft.file(f"docs/benchmarks/{name}", page)
        width, height = made["size"]
        driver = cell(made["device"]["driver"])
        said = cell(made["date"][:10])
        return f"[{said}]({link}), {width}x{height}<br>{driver}<br>commit {cell(made['commit'][:12])}"

    rows = [
        f"| {number} | {' | '.join(origin(found.get(device)) for device in devices)} |"
        for number, found in records.items()
    ]
    return _table(["chapter", *devices], rows, ["---:", *["---"] * len(devices)])


def _table(heads: list[str], rows: list[str], sides: list[str]) -> str:
    return "\n".join([f"| {' | '.join(heads)} |", f"|{'|'.join(sides)}|", *rows])


def starts_table(draft: Draft, page: str) -> str:
    """Seconds from nothing to the first picture, devices side by side: nothing compiled, and all in its caches."""
    records, devices = _by_device(Draft(), page)  # what lacks is said where times are
    rows = []
    for number, found in records.items():
        cells = []
        for device in devices:
            starts = found[device][1].get("start_s", {}) if device in found else {}
            whole = {"cold", "warm"} <= {*starts}
            cells += [f"{starts[s]['total']:.2f}" if whole else "-" for s in ("cold", "warm")]
        if any(cell != "-" for cell in cells):
            rows.append(f"| {number} | {' | '.join(cells)} |")
    heads = [f"{device}: {state}, s" for device in devices for state in ("cold", "warm")]
    if not rows:
        return draft.lack(page, "times of starts: `./strata bench 1 --record` makes those of chapter 1.")
    return _table(["chapter", *heads], rows, ["---:"] * (1 + len(heads)))


def agreement_table(draft: Draft, page: str) -> str:
    """How far the backends, and neighbours among chapters, are from each other in the pictures of this site."""
    rows = []
    for record in pairs.read().values():
        error = record["error"]
        flip = "-" if error["flip"] is None else f"{error['flip']:.2g}"
        mse = "-" if error["relative_mse"] is None else f"{error['relative_mse']:.2g}"
        rows.append(
            f"| {record['a']['what']} | {record['b']['what']} | {error['max_abs'] * 255:.0f} | {flip} | {mse} | "
            f"{error['pixels_changed']:.2%} |"
        )
    if not rows:
        return draft.lack(page, "differences of pictures: `python docs/pictures.py` draws them.")
    head = "| A | B | most, of 255 | FLIP | relative MSE | pixels changed |\n|---|---|---:|---:|---:|---:|"
    return head + "\n" + "\n".join(rows)


def stability_table(draft: Draft, page: str) -> str:
    """Of every record the worst case of stability: the world moved and scaled."""
    rows, unread = [], _unread(draft, page)
    for number in chapters.available():
        for made in records_of(number).values():
            if made.get("stability"):
                worst = made["stability"]["worst"]
                rows.append(
                    f"| {number} | {cell(made['device']['name'])} | {cell(worst['case'])} | "
                    f"{worst['pixels_changed']:.3%} | "
                    f"{made['stability']['bound']:.1%} |"
                )
    if not rows:
        return unread + draft.lack(
            page, "measurements of stability: `./strata bench 1 --record` makes those of chapter 1."
        )
    heads = ["chapter", "device", "worst when", "pixels changed", "at most"]
    return f"{_table(heads, rows, ['---:', '---', '---', '---:', '---:'])}\n\n{unread}"


def long_table(draft: Draft, page: str) -> str:
    """The long tests with their last result, by the file that holds them."""
    tests = _records(LONG).get("tests", {})
    if not tests:
        return draft.lack(page, "results of the long tests: `./strata test --long` keeps them.")
    files: dict[str, list[dict[str, Any]]] = {}
    for name, one in tests.items():
        files.setdefault(name.partition("::")[0], []).append(one)
    rows = []
    for file, ones in sorted(files.items()):
        results = ", ".join(
            f"{sum(one['result'] == result for one in ones)} {result}"
            for result in sorted({o["result"] for o in ones})
        )
        dates = sorted(one["when"][:10] for one in ones)
        link = draft.file(file, page) if (ROOT / file).is_file() else ""
        shown = f"[{file}]({link})" if link else f"`{file}`"
        rows.append(f"| {shown} | {results} | {sum(one['seconds'] for one in ones):.0f} | {dates[-1]} |")
    return "| tests | last result | seconds | last run |\n|---|---|---:|---|\n" + "\n".join(rows)


PIECES: dict[str, Callable[[Draft, str], str]] = {
    "cards": chapter_cards,
    "chapters": chapters_table,
    "features": site_features.features_list,
    "setup": setup_commands,
    "speed": speed_table,
    "starts": starts_table,
    "agreement": agreement_table,
    "stability": stability_table,
    "long": long_table,
    "glossary": glossary.entries,
}
"""What a page of docs/site asks for by `<!-- strata: NAME -->`."""


def filled(draft: Draft, text: str, page: str) -> str:
    """Return a text with the pieces that it asks for; a piece that cannot be made is a sentence that says so."""

    def piece(found: re.Match[str]) -> str:
        make = PIECES.get(found[1])
        if make is None:
            return draft.lack(page, f"what it calls {found[1]}: there are {', '.join(PIECES)}.")
        return draft.attempt(page, f"the table of {found[1]}", lambda: make(draft, page))

    return re.sub(r"<!-- strata: (\w+) -->", piece, text)
