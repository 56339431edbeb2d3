"""Texts and keys of a shader with two constants, for several values."""

from __future__ import annotations

import re
from itertools import combinations
from typing import Any

from backends.shader_text import ShaderSource
from tools.exercises.checking import Given

TEXT = """layout(constant_id = 3) const int TAPS = 8;
layout(constant_id = 1) const int STEP = 1;
void main() {}
"""
VALUES: tuple[dict[str, int], ...] = (
    {"TAPS": 4, "STEP": 2},
    {"TAPS": 2, "STEP": 4},
    {"TAPS": 4, "STEP": 3},
    {"TAPS": 4},
    {"STEP": 4},
)


def check(given: Given) -> None:
    """First that other values have other keys, then that equal ones have equal keys."""
    specialized: Any = given.module("pipelines.gl_specialization").specialized

    def built(values: dict[str, int], key: str = "key of the text") -> ShaderSource:
        (source,) = specialized([ShaderSource("comp", TEXT, (), key)], tuple(values.items()))
        assert isinstance(source, ShaderSource)
        return source

    for values in VALUES:
        text = built(values).text
        for name, value in {"TAPS": 8, "STEP": 1, **values}.items():
            right = re.search(rf"^const int {name} = {value};", text, re.M) is not None
            given.need(right, f"With {_spoken(values)} the text has no constant {name} = {value}.")
    for one, other in combinations(VALUES, 2):
        given.need(
            built(one).key != built(other).key,
            f"A shader with {_spoken(one)} has the key of the same shader with {_spoken(other)}.",
        )
    given.need(
        built(VALUES[0]).key != built(VALUES[0], "key of another text").key,
        "Two shaders with equal constants and different texts have one key.",
    )
    given.need(
        built(VALUES[0]).key == built(dict(reversed(VALUES[0].items()))).key,
        "The same constants in another order give another key, so the program is compiled twice.",
    )


def _spoken(values: dict[str, int]) -> str:
    return " and ".join(f"{name} = {value}" for name, value in values.items())
