"""Settings: what is typed on a command line becomes a checked value, or one sentence."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import ClassVar

import pytest

from common.errors import SettingError
from common.lessons import Lesson, Needs
from common.settings import apply_overrides, describe, knob, knobs, preset, set_live


@dataclass
class Settings:
    PRESETS: ClassVar[dict[str, dict[str, object]]] = {
        "low": {"samples": 1},
        "medium": {},
        "reference": {"filter": "gauss"},
    }
    samples: int = knob(4, "Rays per pixel", minimum=1, maximum=64, reference=64)
    cutoff: float = knob(0.0, "Lights end here", "lux", minimum=0.0)
    shadows: bool = knob(True, "Cast shadows")
    filter: str = knob("box", "Reconstruction filter", choices=("box", "gauss"))
    title: str = knob("", "Text in the corner")
    bias: float = knob(-1.0, "Depth bias", maximum=0.0)
    internal: int = 3


@pytest.mark.parametrize(
    ("text", "name", "value"),
    [
        ("samples=16", "samples", 16),
        ("samples=0x10", "samples", 16),
        (" samples = 2 ", "samples", 2),
        ("cutoff=1e-3", "cutoff", 1e-3),
        ("cutoff=inf", "cutoff", math.inf),
        ("cutoff=2", "cutoff", 2.0),
        ("shadows=off", "shadows", False),
        ("shadows=TRUE", "shadows", True),
        ("shadows=0", "shadows", False),
        ("filter=gauss", "filter", "gauss"),
        ("title=a=b", "title", "a=b"),
        ("bias=-0.5", "bias", -0.5),
    ],
)
def test_overrides(text, name, value):
    before = Settings()
    after = apply_overrides(before, [text])
    assert getattr(after, name) == value and type(getattr(after, name)) is type(value)
    assert before == Settings()  # a copy is changed
    assert all(getattr(after, k) == getattr(before, k) for k in knobs(before) if k != name)


@pytest.mark.parametrize(
    ("text", "sentence"),
    [
        ("samples", "setting 'samples' has no value: write samples=value"),
        ("sampels=3", "there is no setting 'sampels'; did you mean 'samples'?"),
        ("internal=4", "there is no setting 'internal'; known are "),
        ("samples=0", "setting samples must be 1 to 64, not '0'"),
        ("samples=65", "setting samples must be 1 to 64, not '65'"),
        ("samples=2.5", "setting samples must be a whole number, not '2.5'"),
        ("samples=", "setting samples must be a whole number, not ''"),
        ("cutoff=-1", "setting cutoff must be at least 0, not '-1'"),
        ("cutoff=nan", "setting cutoff must be at least 0, not 'nan'"),
        ("cutoff=dark", "setting cutoff must be a number, not 'dark'"),
        ("bias=0.1", "setting bias must be at most 0, not '0.1'"),
        ("shadows=maybe", "setting shadows must be on or off, not 'maybe'"),
        ("filter=bxo", "setting filter cannot be 'bxo'; did you mean 'box'?"),
        ("filter=mitchell", "setting filter must be one of box, gauss, not 'mitchell'"),
    ],
)
def test_wrong_overrides_are_one_sentence(text, sentence):
    with pytest.raises(SettingError) as error:
        apply_overrides(Settings(), ["shadows=on", text])
    assert str(error.value).startswith(sentence) and error.value.exit_code == 2


def test_later_overrides_win():
    assert apply_overrides(Settings(), ["samples=2", "samples=3"]).samples == 3


def test_presets():
    assert preset(Settings, "low") == Settings(samples=1) and preset(Settings, "medium") == Settings()
    assert preset(Settings, "reference") == Settings(samples=64, filter="gauss")
    with pytest.raises(SettingError, match="there is no preset 'lo'; did you mean 'low'"):
        preset(Settings, "lo")


def test_describe_shows_every_knob():
    rows = describe(Settings)
    assert [row.name for row in rows] == ["samples", "cutoff", "shadows", "filter", "title", "bias"]
    assert rows[0] == ("samples", "4", "1 to 64", "", "Rays per pixel")
    assert rows[1] == ("cutoff", "0.0", "at least 0", "lux", "Lights end here")
    assert [row.range for row in rows[2:]] == ["on | off", "box | gauss", "any text", "at most 0"]
    assert rows[2].default == "on"


def test_only_live_knobs_are_set_in_place():
    @dataclass
    class Some:
        wind: float = knob(0.0, "speed", live=True)
        size: int = knob(1, "of it")

    old = Some()
    assert set_live(old, Some(wind=2.0)) and old == Some(wind=2.0)
    assert not set_live(old, Some(wind=2.0)), "nothing differs"
    assert not set_live(old, Some(wind=3.0, size=2)) and old == Some(wind=2.0), "all or nothing"


def test_a_knob_checks_itself():
    for wrong in (
        {"default": 0, "minimum": 1},
        {"default": "x", "choices": "yz"},
        {"default": 1, "reference": 9, "maximum": 5},
    ):
        with pytest.raises(ValueError, match="knob"):
            knob(doc="broken", **wrong)


def test_lessons_hold_what_was_written():
    lesson = Lesson(1, "First light", adds=["a/b", "c/d"], needs=Needs(frozenset({"x"}), frozenset({"y"})))
    assert lesson.adds == ("a/b", "c/d") and hash(lesson)
    with pytest.raises(ValueError, match="twice"):
        Lesson(1, "First light", adds=["a/b", "a/b"])
    with pytest.raises(ValueError, match="required and optional"):
        Needs(frozenset("ab"), frozenset("bc"))
    both = Needs(frozenset("a"), frozenset("b")) | Needs(frozenset("b"), frozenset("c"))
    assert both == Needs(frozenset("ab"), frozenset("c"))
