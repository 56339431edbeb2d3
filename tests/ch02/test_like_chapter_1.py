"""Another binding model is no other picture: chapters 1 and 2 agree to the bit, scene by scene."""

from __future__ import annotations

from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pytest

import assets
import chapters
from chapters import scenes
from chapters.ch01.shading.views import NAMES
from common.gltf import load_scene
from common.paths import asset_dir
from common.scene import Image, Material, Scene
from common.scene.pose import evaluate_pose
from common.view.camera import view_of_scene
from tests.support.chapter import Chapter
from tests.support.scenes import facing, quad_scene, texture, translated

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


def check_views(chapter: Chapter, names: Sequence[str], materials: Sequence[Material]) -> None:
    """Two squares show the same under each of these views as in chapter 1."""
    image = Image("noise", np.random.default_rng(1).integers(0, 256, (8, 8, 4), np.uint8))
    places = (translated(-0.6, 0.0, 0.0), translated(0.6, 0.0, 0.1))
    for material in materials:
        scene = quad_scene(material, images=(image,), matrices=places)
        for name in names:
            found = []
            for opened in (Chapter(1, chapter.backend, chapter.device), chapter):
                settings = chapters.settings_class(opened.which)(view=name)
                with opened.open(scene, SIZE, settings, outputs=("color",)) as renderer:
                    found.append(renderer.render(facing()).image("color").astype(int))
            assert np.abs(found[0] - found[1]).max() <= (not chapter.device.capabilities.is_software), name


PLAIN = Material(base_color=(0.5, 0.25, 1.0, 1.0))


def test_every_view_shows_what_it_shows_in_chapter_1(chapter):
    check_views(chapter, NAMES, (PLAIN, Material(base_color_texture=texture())))


@pytest.mark.newest
def test_coordinates_are_shown_where_nothing_is_sampled(chapter):
    """The material has uv and no texture, so its shaders have neither slots nor arrays to look into."""
    check_views(chapter, ("uv",), (PLAIN,))


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
