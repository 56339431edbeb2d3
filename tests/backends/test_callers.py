"""A message names the line of the pass, not that of the wrapper through which every call goes."""

from __future__ import annotations

import sys

import pytest

from backends.callers import calling_line
from common.paths import ROOT


def defined_in(path: str):
    """Return a function of a file of that name, which asks for the line and stands in its second line."""
    made: dict = {"ask": lambda: calling_line(sys._getframe(1))}
    exec(compile("def draw():\n    return ask()", str(ROOT / path), "exec"), made)
    return made["draw"]


@pytest.mark.parametrize(
    "path",
    [
        "chapters/ch01/frames/vulkan_commands.py",
        "chapters/ch15/frames/gl_commands.py",
        "backends/gl/draws.py",
        "../a fork/frames/gl_commands.py",
    ],
)
def test_a_wrapper_is_passed_over(path):
    line = sys._getframe().f_lineno + 1
    assert defined_in(path)() == f"tests/backends/test_callers.py:{line}"


@pytest.mark.parametrize(
    "path",
    [
        "chapters/ch01/shading/forward.py",
        "chapters/ch01/frames/vulkan.py",
    ],
)
def test_a_pass_is_named(path):
    assert defined_in(path)() == f"{path}:2"
