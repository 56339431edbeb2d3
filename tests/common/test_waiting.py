"""What takes long is told once, and what is quick is not."""

from __future__ import annotations

import threading

import pytest

from common.reports import waiting


@pytest.fixture
def heard(monkeypatch: pytest.MonkeyPatch) -> tuple[list[str], threading.Event]:
    """What listeners get, and an event that is set then."""
    texts: list[str] = []
    event = threading.Event()

    def listen(text: str) -> None:
        texts.append(text)
        event.set()

    monkeypatch.setattr(waiting, "listeners", [listen])
    return texts, event


def test_a_long_wait_is_told_with_what_is_true_then(heard: tuple[list[str], threading.Event]) -> None:
    texts, event = heard
    state = "before"
    with waiting.told(lambda: f"waiting {state}.", after_s=0.01):
        state = "now"
        assert event.wait(10.0)
    assert texts in (["waiting now."], ["waiting before."])


def test_a_quick_wait_is_not_told(heard: tuple[list[str], threading.Event]) -> None:
    texts, event = heard
    with waiting.told(lambda: "waiting.", after_s=0.4):
        pass
    assert not event.wait(0.5)
    assert not texts


def test_a_wait_that_ends_in_an_error_is_not_told_later(heard: tuple[list[str], threading.Event]) -> None:
    _, event = heard
    with pytest.raises(ValueError), waiting.told(lambda: "waiting.", after_s=0.05):
        raise ValueError
    assert not event.wait(0.2)
