"""Studies on both backends: the same picture, and the same bits of depth, on the software drivers."""

from __future__ import annotations

import ast

import numpy as np
import pytest

import chapters
from chapters import studies
from common.paths import ROOT
from tests.support.drivers import needs_feature
from tests.support.gl_functions import assert_silent

WITH_STUDIES = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12)
ALL = tuple(f"{number}/{name}" for number in WITH_STUDIES for name in studies.available(number))
ONE_BACKEND = {
    "4/barriers": ("vulkan",),
    "2/buffer-address": ("vulkan",),
    "2/texture-handles": ("gl",),
    "3/primaries": ("vulkan",),
    "4/render-passes": ("vulkan",),
    "5/timeline-or-fences": ("vulkan",),
    "6/cluster-list": ("vulkan",),
    "8/sparse-buffer": ("vulkan",),
    "9/shading-rates": ("vulkan",),
    "12/callables": ("vulkan",),
    "12/buffer-addresses": ("vulkan",),
}
"""Studies of what only one of the two has."""
NOT_TWICE = {"5/fragment-order"}
"""Studies of what is different every time: their own tests say what is the same."""

BY_PATHS = {"12/wavefront", "12/strategies", "12/roulette"}
"""Studies of random paths, which part from each other at the last bits of a hit: other drivers round otherwise."""


LONG = {"12/wavefront": pytest.mark.long}
"""A cold driver of OpenGL takes half a minute for the kernels of this study; its own tests compare its pictures."""


@pytest.mark.parametrize(
    "which",
    [
        pytest.param(which, marks=LONG.get(which, ()))
        for which in ALL
        if which not in ONE_BACKEND.keys() | NOT_TWICE
    ],
)
@pytest.mark.parametrize("time", [0.0, 1.3])
def test_both_backends_draw_the_same_picture(vulkan_device, gl_context, which, time):
    if which == "2/random-textures":
        needs_feature(vulkan_device, "bindless")
    outputs = chapters.outputs_of(which)
    frames = {}
    for backend, device in (("vulkan", vulkan_device), ("gl", gl_context)):
        scene = studies.load(which, None)
        more = {"scene": scene, "size": (48, 36), "outputs": outputs, "device": device}
        with chapters.open(which, backend, **more) as renderer:
            frame = renderer.render(chapters.view_of(renderer), time)
            frames[backend] = {output: frame.image(output) for output in outputs}
    assert_silent(gl_context)
    color = np.abs(frames["vulkan"]["color"].astype(int) - frames["gl"]["color"])
    software = vulkan_device.capabilities.is_software and gl_context.capabilities.is_software
    if which == "1/sine-hash" and not software:
        color = color[:, 24:]  # the left half is what no two drivers agree on: that is what it shows
    if which == "10/phase-functions":
        color = color[:, : 48 * 3 // 5]  # the rest shows rounding, which no two compilers share
    if which in BY_PATHS and not software:
        means = [frames[backend]["color"].astype(float).mean() for backend in frames]
        assert abs(means[0] - means[1]) < 0.1 * max(means)
    else:
        assert color.max() <= (1 if software else 2)
    if "depth" in outputs and software:
        assert (frames["vulkan"]["depth"] == frames["gl"]["depth"]).all()
        assert (frames["vulkan"]["depth"] > 0).any()


def test_studies_are_small_and_each_follows_the_one_before():
    """At most about 150 lines a file, on both backends; the way in without gaps; a first sentence in each."""
    from tools.diff.sentences import first_sentence

    for number, first in (
        (1, 5),
        (2, 4),
        (3, 2),
        (4, 8),
        (5, 5),
        (6, 5),
        (7, 3),
        (8, 4),
        (9, 2),
        (10, 3),
        (11, 2),
        (12, 7),
    ):
        order = [about.order for about in studies.available(number).values()]
        assert order[:first] == list(range(1, first + 1)) and len(set(order)) == len(order)
    for which in ALL:
        number, name = studies.split(which)
        folder = studies.folder(number) / name.replace("-", "_")
        assert studies.backends(which) == ONE_BACKEND.get(which, ("vulkan", "gl"))
        for path in folder.iterdir():
            if path.is_file():
                assert len(path.read_text("utf-8").splitlines()) <= 150, path
                assert first_sentence(path), path


def test_every_feature_of_a_study_has_a_test_here():
    marked = set()
    for path in (ROOT / "tests" / "studies").glob("test_*.py"):
        for node in ast.walk(ast.parse(path.read_text("utf-8"))):
            if isinstance(node, ast.Constant) and isinstance(node.value, str):
                marked.add(node.value)
    for which in ALL:
        assert {*studies.study(which).features} <= marked
