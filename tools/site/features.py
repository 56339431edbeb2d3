"""The page of features: each with its tests, and what became of them on every backend, as the record has it."""

from __future__ import annotations

from collections import defaultdict
from collections.abc import Mapping
from html import escape

from tools.ledger import features, results
from tools.ledger.features import Feature
from tools.ledger.results import BACKENDS, Area
from tools.site.draft import Draft


def features_list(draft: Draft, page: str) -> str:
    """Return a table of features for each chapter, as HTML; a script puts a field above them that chooses by words."""
    record = results.read()
    late = features.out_of_date(record)
    lacks = "\n".join(draft.lack(page, sentence) for sentence in late.sentences())
    groups = features.grouped(features.features())
    parts = [f"### {title}\n\n{_table(group, record)}" for title, group in groups.items()]
    return "\n\n".join([lacks, origins(record), '<div class="search-features"></div>', *parts])


def origins(record: Mapping[str, Area]) -> str:
    """Return of which runs the results are: date, commit, devices, and the areas of each."""
    by_run: dict[str, list[str]] = defaultdict(list)
    for name, area in record.items():
        by_run[area.run.when].append(name)
    said = []
    for when in sorted(by_run, reverse=True):
        run = record[by_run[when][0]].run
        devices = "; ".join(dict.fromkeys(run.devices[b] for b in BACKENDS if b in run.devices))
        areas = "" if len(by_run) == 1 else f" ({', '.join(sorted(by_run[when]))})"
        said.append(f"{when[:10]}, commit {run.commit}{areas}, on {devices}")
    return f"Tests as they went on {'; on '.join(said)}." if said else ""


def _table(group: list[Feature], record: Mapping[str, Area]) -> str:
    heads = "".join(f'<th scope="col">{name}</th>' for name in ("feature", *BACKENDS.values()))
    rows = "".join(_row(one, record) for one in group)
    return (
        f'<div class="features"><table><caption>{len(group)} features</caption>'
        f"<thead><tr>{heads}</tr></thead><tbody>{rows}</tbody></table></div>"
    )


def _row(one: Feature, record: Mapping[str, Area]) -> str:
    counts = features.states(one, record)
    cells = ""
    for backend in BACKENDS:
        state = features.state(one, backend, record)
        shown = results.said(counts[backend]) if backend in counts else state
        cells += f'<td class="{state.replace(" ", "-") or "none"}">{shown}</td>'
    names = "".join(f"<li><code>{escape(test.name.removeprefix('tests/'))}</code></li>" for test in one.tests)
    count = f"{len(one.tests)} test{'s' * (len(one.tests) != 1)}"
    return (
        f'<tr><th scope="row"><code>{escape(one.slug)}</code>'
        f"<details><summary>{count}</summary><ul>{names}</ul></details></th>{cells}</tr>"
    )
