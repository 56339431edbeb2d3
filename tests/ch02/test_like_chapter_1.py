"""Another binding model is no other picture: chapters 1 and 2 agree to the bit, scene by scene."""

from __future__ import annotations

from pathlib import Path

import numpy as np
import pytest

import assets
from chapters import scenes
from common.camera import view_of_scene
from common.gltf import load_scene
from common.paths import asset_dir
from common.pose import evaluate_pose
from common.scene import Scene
from tests.support.chapter import Chapter

SIZE = (64, 48)
OUTPUTS = ("color_linear", "depth", "instance_id")
TIME = 0.4


def model_files() -> dict[str, Path]:
    """Return the models made elsewhere by name; none where their folder is missing."""
    folder = asset_dir()
    files = sorted((folder / "models").rglob("*.gl*")) if folder is not None else []
    return {file.stem: file for file in files if file.suffix in (".gltf", ".glb")}


FILES = model_files()
QUICK = ("cornell", "BoxVertexColors", "MultiUVTest", "SimpleInstancing", "SimpleSkin", "TwoSidedPlane")
"""Scenes of every run, each with something of its own; the long one has all of them."""
CASES = [
    name if name in QUICK else pytest.param(name, marks=pytest.mark.long) for name in (*assets.SCENES, *FILES)
]


@pytest.fixture(scope="session")
def loaded():
    """Scenes by name, loaded once for all variants."""
    held: dict[str, Scene] = {}

    def load(name: str) -> Scene:
        if name not in held:
            held[name] = load_scene(FILES[name]) if name in FILES else scenes.load(name)
        return held[name]

    return load


@pytest.mark.parametrize("name", CASES)
def test_chapter_1_draws_the_same_bits(chapter, loaded, name):
    """Light, depth and ids, in both slots, at rest and as its animation has moved it."""
    scene = loaded(name)
    view = view_of_scene(scene, evaluate_pose(scene, 0.0), None, SIZE[0] / SIZE[1])
    found = []
    for opened in (Chapter(1, chapter.backend, chapter.device), chapter):
        with opened.open(scene, SIZE, outputs=OUTPUTS) as made:
            frames = [made.render(view, time) for time in (0.0, TIME)]
            found.append([frame.image(output) for frame in frames for output in OUTPUTS])
    for output, first, second in zip(2 * OUTPUTS, *found, strict=True):
        if chapter.device.capabilities.is_software or output == "instance_id":
            assert np.array_equal(first, second), output
        else:  # other shaders of the same mathematics: a compiler may round them otherwise
            assert np.allclose(first, second, rtol=2e-3, atol=1e-6), output
    assert np.ptp(found[0][0]) > 0
