"""Real models, made elsewhere: each loads, draws without a validation message, and stands where float64 puts it."""

from __future__ import annotations

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest

from backends.gl import api as gl
from chapters.ch01.renderer import Renderer
from common.gltf import load_scene
from common.paths import asset_dir
from common.scene.pose import evaluate_pose
from common.view.camera import exposure, view_of_scene
from tests.support import gl_functions
from tests.support.chapter import on_opengl
from tests.support.recorded import draws

SIZE = (64, 64)
FLIGHT_HELMET = [59040, 72534, 24408, 60288, 65688, 2208]
"""Indices of its six draws, as a capture of the original engine shows them."""


def model_files():
    """Return the files below the folder of models; none where it is missing."""
    folder = asset_dir()
    files = sorted((folder / "models").rglob("*.gl*")) if folder is not None else []
    return [file for file in files if file.suffix in (".gltf", ".glb")]


FILES = {file.stem: file for file in model_files()}
SAMPLE = (
    "BoxVertexColors",
    "Cameras",
    "FlightHelmet",
    "LightsPunctualLamp",
    "MultiUVTest",
    "SimpleInstancing",
    "SimpleMorph",
    "SimpleSkin",
    "SimpleSparseAccessor",
    "TwoSidedPlane",
)
"""Models of the quick run, each with something of its own; all of them are drawn in the long one."""
CASES = [name if name in SAMPLE else pytest.param(name, marks=pytest.mark.long) for name in FILES]


@pytest.fixture(scope="session")
def opened():
    """Models that were loaded already: both variants draw the same scenes."""
    scenes = {}

    def load(file: Path):
        if file not in scenes:
            scenes[file] = load_scene(file)
        return scenes[file]

    return load


def projected(scene, pose, view):
    """Return (V, 4) float64 clip coordinates of all corners of all visible triangles."""
    clip_from_world = view.clip_from_world(SIZE[0] / SIZE[1])
    clips = []
    for instance in np.flatnonzero(scene.instances.visible):
        number = int(scene.instances.mesh[instance])
        mesh = scene.meshes[number]
        first, count = int(mesh["first_vertex"]), int(mesh["vertex_count"])
        positions = scene.positions[first : first + count]
        if number in pose.vertices:
            positions = pose.vertices[number][0]
        used = scene.indices[mesh["first_index"] : mesh["first_index"] + mesh["index_count"]]
        corners = positions[np.unique(used)].astype(np.float64)
        clip_from_object = clip_from_world @ pose.world_from_object[instance]
        clips.append(corners @ clip_from_object[:, :3].T + clip_from_object[:, 3])
    return np.concatenate(clips)


@pytest.mark.feature("gltf/gpu-upload")
@pytest.mark.parametrize("name", CASES or ["none"])
def test_a_model_is_drawn_where_it_stands_and_twice_the_same(vulkan_device, models, opened, name):
    """Finite, seen, equal bits in both slots; and no pixel or depth lies outside what its vertices project to."""
    scene = opened(FILES[name])
    pose = evaluate_pose(scene, 0.0)
    view = view_of_scene(scene, pose, None, SIZE[0] / SIZE[1])
    outputs = {"color_linear", "depth", "instance_id"}
    with Renderer(scene, SIZE, outputs=outputs, device=vulkan_device) as made:
        frames = [made.render(view), made.render(view)]
        first, second = ({output: frame.image(output) for output in outputs} for frame in frames)
        background = made.settings.background / exposure(view.ev100)
    assert all(np.array_equal(first[output], second[output]) for output in outputs)
    assert np.isfinite(first["color_linear"]).all()
    seen = (np.abs(first["color_linear"] - background) > 1e-2 * background).any(axis=-1)
    assert seen.mean() > 0.01, "something is drawn"
    solid = first["instance_id"] > 0
    assert first["instance_id"].max() <= len(scene.instances)
    assert np.array_equal(solid, first["depth"] > 0), "ids and depth are of the same surfaces"

    clip = projected(scene, pose, view)
    if (clip[:, 3] <= 0).any():
        return  # the camera of the file stands inside the scene: what is behind it has no place in the picture
    ndc = clip[:, :3] / clip[:, 3:]
    left, top = ((ndc[:, :2].min(axis=0) + 1) / 2 * SIZE).clip(0, SIZE)
    right, bottom = ((ndc[:, :2].max(axis=0) + 1) / 2 * SIZE).clip(0, SIZE)
    rows, columns = np.nonzero(solid | seen)
    assert columns.min() + 0.5 >= left - 0.01
    assert columns.max() + 0.5 <= right + 0.01
    assert rows.min() + 0.5 >= top - 0.01
    assert rows.max() + 0.5 <= bottom + 0.01
    depths = first["depth"][solid].astype(np.float64)
    if solid.any():
        assert depths.max() <= ndc[:, 2].max() * (1 + 1e-5)
        assert depths.min() >= ndc[:, 2].min() * (1 - 1e-5)


@pytest.mark.feature("gltf/gpu-upload")
def test_flight_helmet_is_six_draws(vulkan_device, models, opened):
    """Read from the calls that the API got: the opaque draws in any order, the glass last."""
    if "FlightHelmet" not in FILES:
        pytest.skip("FlightHelmet is not among the models")
    scene = opened(FILES["FlightHelmet"])
    view = view_of_scene(scene, evaluate_pose(scene, 0.0), None, 1.0)
    log: list = []
    with Renderer(scene, (8, 8), outputs={"color_linear"}, device=vulkan_device) as made:
        made.render(view)
        vulkan_device.fn.trace(log)
        work = made.render(view).work
        vulkan_device.fn.trace(None)
        counts = [one.index_count for one in draws(made, log)[0]]
    assert sorted(counts) == sorted(FLIGHT_HELMET)
    assert sum(counts) == 284_166
    assert work["draws"] == 6
    assert work["triangles"] == 284_166 // 3


@pytest.mark.until(1, "a buffer says what is drawn, which the test above reads")
@pytest.mark.feature("gltf/gpu-upload")
def test_flight_helmet_is_six_draws_on_opengl(gl_context, models, opened):
    """All of one buffer of indices, each at an offset of its own; a part that is hidden is missing."""
    OpenGL = on_opengl(Renderer)
    if "FlightHelmet" not in FILES:
        pytest.skip("FlightHelmet is not among the models")
    scene = opened(FILES["FlightHelmet"])
    view = view_of_scene(scene, evaluate_pose(scene, 0.0), None, 1.0)
    places = []

    def note(name, arguments):
        if name == "glDrawElementsBaseVertex":
            places.append((arguments[1], int(gl.ffi.cast("uintptr_t", arguments[3]))))

    with OpenGL(scene, (8, 8), outputs={"color_linear"}, device=gl_context) as made:
        with gl_functions.noted(gl_context, note):
            made.render(view)
        drawn = sorted(places)
        assert [count for count, _ in drawn] == sorted(FLIGHT_HELMET)
        behind = sorted((first, first + 4 * count) for count, first in drawn)
        assert all(one[1] == other[0] for one, other in pairwise(behind)), "one behind the other"
        places.clear()
        try:
            with scene.edit() as edit:
                edit.set_visible(0, False)
            with gl_functions.noted(gl_context, note):
                made.render(view)
        finally:
            with scene.edit() as edit:
                edit.set_visible(0, True)
    assert len(places) == 5 and sorted(places) != drawn


def test_the_models_are_those_that_are_tested(models):
    assert len(FILES) >= 25, "names of files are the names of the tests: none may hide another"
    assert len(FILES) == len(model_files())
