"""Each feature has an independent truth and a negative case: the table oracles.toml against the text of the tests."""

from __future__ import annotations

import ast
from dataclasses import replace

import pytest

import chapters
from tests.support.oracles import Table, evidence, faults, read
from tools.ledger import features
from tools.ledger.features import MarkedTest

discipline = pytest.mark.feature("tests/conformance-discipline")
MOST_LACKING = 0
"""Features that lack a part of their entry. A number that falls; a new feature has all of it."""
MOST_UNSHOWN = 0
"""Features that no machine of CI shows and no record either. It falls, too."""
TEXT = """
import pytest
from common import clock

def test_twin():
    assert True

def test_refused():
    with pytest.raises(ValueError):
        clock.tick()

def test_plain():
    with pytest.raises(ValueError):
        clock.tick()
"""
ENTRY = {
    "oracle": "float64",
    "held": "tests/a/test_x.py::test_twin",
    "negative": "tests/a/test_x.py::test_refused",
    "backends": ["vulkan", "cpu"],
}
RECORDS = {
    "docs/device.json": '{"device": {"name": "NVIDIA H200", "driver": "NVIDIA 580"}}',
    "docs/devices.json": '{"devices": {"gl": "NVIDIA H200/PCIe/SSE2"}}',
    "docs/software.json": '{"device": {"name": "llvmpipe (LLVM 15.0.6, 256 bits)"}}',
}
WHOLE = Table({"float64": "A second program in double precision."}, {"area/feature": ENTRY})
MARKED = {
    "area/feature": tuple(
        MarkedTest(f"tests/a/test_x.py::{name}", "a") for name in ("test_twin", "test_refused")
    )
}


@discipline
def test_every_feature_has_an_independent_oracle_and_a_negative_case():
    table = read()
    assert faults(table, features.marked_tests()) == []
    assert len(table.lacking) <= MOST_LACKING, "write the case that is missing instead"
    assert len(table.unshown) <= MOST_UNSHOWN, "run it where it can be, and keep the record"
    assert len(table.kinds) <= 12 and all(len(words.split()) > 3 for words in table.kinds.values())


def entry(**changed):
    return replace(WHOLE, features={"area/feature": {**ENTRY, **changed}})


def without(part):
    return replace(
        WHOLE, features={"area/feature": {name: one for name, one in ENTRY.items() if name != part}}
    )


WRONG = {
    "no entry": (replace(WHOLE, features={}), "'area/feature' has tests and no entry"),
    "no mark": (
        replace(WHOLE, features={"area/feature": ENTRY, "area/gone": ENTRY}),
        "has 'area/gone', and no test bears that mark",
    ),
    "order": (
        replace(WHOLE, features={"b/b": ENTRY, "area/feature": ENTRY}),
        "'area/feature' stands behind 'b/b'",
    ),
    "kind": (entry(oracle="a golden"), "held by 'a golden', which is none of float64"),
    "kind that nobody has": (
        replace(WHOLE, kinds={**WHOLE.kinds, "magic": "No one knows how."}),
        "No feature is held by 'magic'",
    ),
    "held": (entry(held="tests/a/test_x.py::test_plain"), "test_plain, which does not bear its mark"),
    "no oracle": (without("oracle"), "'area/feature' has no oracle"),
    "no negative": (without("negative"), "'area/feature' has no negative"),
    "gone": (entry(negative="tests/a/test_x.py::test_gone"), "test_gone, is not there"),
    "no such file": (entry(negative="tests/a/test_z.py::test_refused"), "test_refused, is not there"),
    "not about it": (
        entry(negative="tests/a/test_x.py::test_plain"),
        "The negative case of 'area/feature', tests/a/test_x.py::test_plain, does not bear its mark",
    ),
    "no backends": (without("backends"), "'area/feature' has no backends"),
    "an unknown backend": (entry(backends=["metal"]), "they are some of vulkan, gl, cpu"),
    "backends in another order": (entry(backends=["cpu", "vulkan"]), "they are some of vulkan, gl, cpu"),
    "no backend at all": (entry(backends=[]), "they are some of vulkan, gl, cpu"),
    "no such record": (entry(record="docs/gone.json"), "docs/gone.json, which is not there"),
    "a record of a software driver": (entry(record="docs/software.json"), "no device but a software driver"),
    "cannot fail": (
        entry(negative="tests/a/test_x.py::test_twin"),
        "nothing that is refused or that must differ",
    ),
    "another word": (entry(because="of this"), "has because, which is no part of an entry"),
    "lacking nothing": (
        replace(WHOLE, lacking={"area/feature": "Nobody has written one yet."}),
        "lacking nothing",
    ),
    "shown by a record": (
        replace(entry(record="docs/device.json"), unshown={"area/feature": "No machine has such a device."}),
        "does not say in a sentence why it is not shown",
    ),
    "unshown without a reason": (
        replace(WHOLE, unshown={"area/feature": "later"}),
        "does not say in a sentence why it is not shown",
    ),
    "lacking without a reason": (
        replace(without("negative"), lacking={"area/feature": "later"}),
        "in a sentence what",
    ),
}


@discipline
@pytest.mark.parametrize("what", WRONG)
def test_what_is_wrong_in_the_table_is_named_in_a_sentence(what, tmp_path):
    """One part of a table that is right is broken at a time."""
    files = {"tests/a/test_x.py": TEXT, **RECORDS}
    for name, text in files.items():
        (tmp_path / name).parent.mkdir(parents=True, exist_ok=True)
        (tmp_path / name).write_text(text, "utf-8")
    for right in (WHOLE, entry(record="docs/device.json"), entry(record="docs/devices.json")):
        assert faults(right, MARKED, tmp_path) == []
    table, said = WRONG[what]
    found = faults(table, MARKED, tmp_path)
    assert any(said in one for one in found), found
    assert not [one for one in found if not one.endswith(".") or "\n" in one]


@discipline
def test_backends_are_those_of_the_ledger_where_that_is_here():
    table, ledger = read().features, features.ledger()
    rows = {slug: row for slug, row in ledger.items() if features.here(row)}
    missing = {slug for number in chapters.available() for slug in chapters.lesson(number).missing}
    lacking = missing if ledger else set()
    assert {*rows} - {*table} == lacking, "rows without a test are those that lessons name, and no others"
    named = {slug: {*table[slug]["backends"]} for slug in rows if slug not in missing}
    assert named == {slug: {*row.backends} for slug, row in rows.items() if slug not in missing}


@discipline
@pytest.mark.parametrize(
    ("line", "shows"),
    [
        ("with pytest.raises(KeyError): f()", "an error that is expected"),
        ("assert code == 2", "an exit code other than 0"),
        ("assert (done.returncode, out) == (1, '')", "an exit code other than 0"),
        ("assert (a != b).any()", "what must differ"),
        ("assert 'x' not in names", "what must differ"),
        ("assert abs(a - b).max() > 3", "a difference beyond a bound"),
        ("assert 0.1 < apart", "a difference beyond a bound"),
        ("assert not np.array_equal(a, b)", "what must not be the case"),
        ("assert any(word in one for one in found)", "what must be found"),
        ("assert user.choose('mode') == []", "nothing where something was asked for"),
        ("assert code == 0", ""),
        ("assert a == b", ""),
        ("assert abs(a - b).max() < 3", ""),
        ("assert not wrong", ""),
        ("if a != b: return", ""),
    ],
)
def test_what_a_test_shows(line, shows):
    (function,) = ast.parse(f"def test_x():\n    {line}").body
    assert isinstance(function, ast.FunctionDef)
    assert evidence(function) == shows
