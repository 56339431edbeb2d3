"""What README says of machines with old drivers is what their record holds (`.ci/old_mesa.py` makes both)."""

from __future__ import annotations

import json
from typing import Any

import pytest

import chapters
from chapters import studies
from common.paths import ROOT

MACHINES = {"gl": ("gl",), "vulkan": ("vulkan", "gl")}
"""The machines that README names, and the backends that each of them has."""


REFUSED = {
    "gl": {"2/texture-handles"},
    "vulkan": {
        "2/texture-handles",
        "2/random-textures",
        "6/cluster-list",
        "8/sparse-buffer",
        "9/shading-rates",
        "12/callables",
        "12/buffer-addresses",
    },
}
"""Studies of what these drivers lack, which are refused in a sentence: bindless textures of OpenGL, and of Vulkan,
mesh shaders, sparse memory, shading rates and ray tracing."""

SLOW = {"12/wavefront", "12/strategies", "12/roulette"}
"""Studies that the record leaves out: this driver compiles kernels that trace paths for up to ten minutes and more."""


@pytest.fixture(scope="module")
def record() -> dict[str, Any]:
    found: dict[str, Any] = json.loads((ROOT / "docs" / "records" / "machines.json").read_text("utf-8"))
    return found


@pytest.mark.parametrize("name", MACHINES)
def test_every_chapter_and_study_was_drawn(record: dict[str, Any], name: str) -> None:
    """By `auto` and by each backend that the machine and the study have."""
    wanted = {str(number): {"auto", *MACHINES[name]} for number in chapters.available()}
    for number in chapters.available():
        for study in studies.available(number):
            which = f"{number}/{study}"
            wanted[which] = {"auto", *(b for b in studies.backends(which) if b in MACHINES[name])}
    drawn = record[name]["drawing"]["found"]
    assert wanted.keys() >= SLOW and not drawn.keys() & SLOW
    wanted = {which: ends for which, ends in wanted.items() if which not in SLOW}
    assert {which: set(ends) for which, ends in drawn.items()} == wanted
    refused = {which: ends for which, ends in drawn.items() if set(ends.values()) != {"drawn"}}
    elsewhere = {
        which for which, ends in wanted.items() if ends == {"auto"}
    }  # studies of another backend alone
    assert refused.keys() == REFUSED[name] | elsewhere
    for ends in refused.values():
        assert all(end == "drawn" or end.startswith("exit code 2: strata: ") for end in ends.values())


@pytest.mark.parametrize("name", MACHINES)
def test_the_tests_passed(record: dict[str, Any], name: str) -> None:
    ended = record[name]["tests"]["found"]
    assert ended["code"] == 0 and ended["failed"] == []
    assert int(ended["summary"].split(" passed")[0].split()[-1]) > 8000


def test_readme_names_the_version_that_was_tried(record: dict[str, Any]) -> None:
    text = (ROOT / "README.md").read_text("utf-8")
    for name in MACHINES:
        version = record[name]["drawing"]["mesa"].partition("-")[0]
        assert f"its own Mesa {version}" in text
