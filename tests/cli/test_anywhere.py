"""Chapters and studies start from any folder: their shaders, scenes and names are found beside the package."""

from __future__ import annotations

import os
import subprocess
import sys

import numpy as np
import pytest

import chapters
from chapters import studies
from common.images import read_image
from common.paths import ROOT

anywhere = pytest.mark.feature("cli/demo-registry")

BACKENDS = ("vulkan", "gl")
LACKING = ("ARB_bindless_texture", "needs shading-rate")
"""Words of sentences about the studies whose subject a software driver lacks."""


def demos():
    """Return (chapter or study, backend): each chapter with both, and each study with the first that it has.

    The usual run has chapters 1 and the newest with both, those between with one of them by turns.
    """
    found = []
    first, *_, newest = chapters.available()
    for number in chapters.available():
        for turn, backend in enumerate(BACKENDS):
            rare = number not in (first, newest) and number % 2 != turn
            found.append(pytest.param(str(number), backend, marks=[pytest.mark.long] * rare))
        for count, name in enumerate(studies.available(number)):
            which = f"{number}/{name}"
            marks = [pytest.mark.long] if count else []
            found.append(pytest.param(which, studies.backends(which)[0], marks=marks))
    return found


@anywhere
@pytest.mark.parametrize(("which", "backend"), demos())
def test_it_draws_from_a_folder_that_has_nothing_in_it(strata, tmp_path, which, backend):
    scene = () if "/" in which else ("--scene", "cornell")
    code, _, err = strata("run", which, "--backend", backend, *scene, "--size", "32x24", "--out", "a.png")
    if code and any(word in err for word in LACKING):
        assert code == 2 and err.count("\n") == 1
        return
    assert code == 0, err
    assert len(np.unique(read_image(tmp_path / "a.png"))) > 1
    assert {path.name for path in tmp_path.iterdir()} == {"a.png"}


@anywhere
def test_names_mean_the_packages_scenes_and_paths_the_readers_files(strata, tmp_path):
    """The folder `assets` is the package's, unless the reader says where he is."""
    assert (ROOT / "assets" / "cornell.py").is_file()
    assert strata("run", "1", "--scene", "cornell", "--size", "16x16", "--out", "a.png")[0] == 0
    code, _, err = strata("run", "1", "--scene", "assets/cornell.gltf", "--size", "16x16")
    assert code == 2 and "assets/cornell.gltf" in err and "Traceback" not in err


@anywhere
def test_a_program_elsewhere_opens_a_chapter(tmp_path):
    """In a process of its own, with nothing but the path to the package."""
    program = (
        "import chapters\n"
        "from chapters import scenes\n"
        "with chapters.open(1, scene=scenes.load('cornell'), size=(16, 16)) as renderer:\n"
        "    print(renderer.render(chapters.view_of(renderer)).image('color').shape)\n"
    )
    done = subprocess.run(
        [sys.executable, "-c", program],
        cwd=tmp_path,
        env={**os.environ, "PYTHONPATH": str(ROOT)},
        capture_output=True,
        text=True,
        check=False,
    )
    assert (done.returncode, done.stdout.strip()) == (0, "(16, 16, 3)"), done.stderr
