"""A first test of one chapter: `strata test --chapter N`, which shows a failure at once and ends in time.

The order is that in which a fault of the machine or of an edit shows soonest:

    0  a frame on each backend and variant that is here, of the core that every chapter has to pass
    1  the rest of the core, variant by variant
    2  the chapter's own tests that need no device
    3  the chapter's own tests that draw
    4  what draws the project's scenes, whose materials take a software driver half a minute to compile for
    5  tests of earlier chapters that hold for this one

The run ends with the first failure (`-x`), or where the time is over; what was not run is counted.
"""

from __future__ import annotations

import time
from collections.abc import Generator
from typing import Any

import pytest

from assets import SCENES
from tests.support import snapshots

MOST_S = 90.0
"""What the whole may take on two cores, with nothing compiled yet."""

BEGIN_S = 65.0
"""No test begins later: one that finds nothing compiled may take 20 s (tests/support/report.py), and the start of
Python and of pytest takes up to 5."""

VARIANTS = ("vulkan", "gl", "without-all", "deferred")


def variant_of(item: pytest.Item) -> str:
    """Return the variant of a test that draws, "" if it has none."""
    return str(getattr(getattr(item, "callspec", None), "params", {}).get("variant", ""))


def rank(item: pytest.Item, number: int) -> tuple[int, int, bool]:
    """Return the place of a test of chapter `number` in the order: the group, the variant within it, and in that before
    other files the one of the contract, which draws a square."""
    core = any(item.get_closest_marker(name) for name in ("core", "newest"))
    own = snapshots.first_chapter(item.path) == number
    if not snapshots.draws(item):
        return (2 if own else 5), 0, False
    given = getattr(getattr(item, "callspec", None), "params", {}).values()
    large = any(isinstance(value, str) and value in SCENES for value in given)
    variant = variant_of(item)
    place = VARIANTS.index(variant) if variant in VARIANTS else len(VARIANTS)
    group = 5 if not (core or own) else 4 if large else 1 if core else 3
    return group, place, item.path.name != "test_contract.py"


def in_order(items: list[pytest.Item], number: int) -> list[pytest.Item]:
    """Return the tests in the order above."""
    ranked = sorted(items, key=lambda item: rank(item, number))
    frames: dict[str, pytest.Item] = {}
    for item in ranked:
        if rank(item, number)[0] == 1 and variant_of(item):
            frames.setdefault(variant_of(item), item)
    first = list(frames.values())
    return first + [item for item in ranked if item not in first]


class First:
    """The pytest plugin of such a run."""

    def __init__(self, number: int, word: str, begin_s: float = BEGIN_S) -> None:
        """`word` is the chapter as the command line takes it: "3", or a fork's folder."""
        self.number, self.word = number, word
        self.began, self.begin_s = time.perf_counter(), begin_s
        self.left = 0
        self._before: pytest.Item | None = None

    @pytest.hookimpl(wrapper=True)
    def pytest_collection_modifyitems(self, items: list[pytest.Item]) -> Generator[None, None, None]:
        """Bring the tests in their order, after others have left tests out."""
        yield
        items[:] = in_order(items, self.number)

    @pytest.hookimpl(tryfirst=True)
    def pytest_runtest_protocol(self, item: pytest.Item) -> bool | None:
        """Begin no test that may end too late; what the last one had open is closed, and reported, as its end."""
        if time.perf_counter() - self.began <= self.begin_s:
            self._before = item
            return None
        self.left += 1
        if self._before is not None:
            self._close(self._before)
            self._before = None
        return True

    def _close(self, item: pytest.Item) -> None:
        """Close what the files of the last test have open, as pytest does after the last test of a run."""
        state = item.session._setupstate
        call = pytest.CallInfo.from_call(lambda: state.teardown_exact(None), when="teardown")
        if call.excinfo is not None:
            report = pytest.TestReport.from_item_and_call(item, call)
            item.ihook.pytest_runtest_logreport(report=report)

    def pytest_terminal_summary(self, terminalreporter: Any) -> None:
        """Say what this was, and how to run everything."""
        if self.left:
            terminalreporter.line(f"The time of a first test is over: {self.left} tests were not begun.")
        subject = f"chapter {self.word}" if self.word.isdigit() else self.word
        terminalreporter.line(
            f"This was a first test of {subject}. All of it: ./strata test {self.word}; everything: ./strata test."
        )
