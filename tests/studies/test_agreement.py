"""Studies on both backends: the same picture, and the same bits of depth, on the software drivers."""

from __future__ import annotations

import ast

import numpy as np
import pytest

import chapters
from chapters import studies
from common.paths import ROOT
from tests.support.gl_functions import assert_silent

NAMES = tuple(studies.available(1))


@pytest.mark.parametrize("name", NAMES)
@pytest.mark.parametrize("time", [0.0, 1.3])
def test_both_backends_draw_the_same_picture(vulkan_device, gl_context, name, time):
    which = f"1/{name}"
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
    if name == "sine-hash" and not software:
        color = color[:, 24:]  # the left half is what no two drivers agree on: that is what it shows
    assert color.max() <= (1 if software else 2)
    if "depth" in outputs and software:
        assert (frames["vulkan"]["depth"] == frames["gl"]["depth"]).all()
        assert (frames["vulkan"]["depth"] > 0).any()


def test_studies_are_small_and_each_follows_the_one_before():
    """At most about 150 lines a file, on both backends; the way in without gaps; a first sentence in each."""
    from chapters.sentences import first_sentence

    order = [about.order for about in studies.available(1).values()]
    assert order[:5] == [1, 2, 3, 4, 5] and len(set(order)) == len(order)
    for name in NAMES:
        folder = studies.folder(1) / name.replace("-", "_")
        assert {"vulkan.py", "gl.py"} <= {path.name for path in folder.iterdir()}
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
    for about in studies.available(1).values():
        assert {*about.features} <= marked
