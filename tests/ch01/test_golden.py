"""Pictures of the project's own scenes: facts that hold on any driver, and pixels on the one that made the golden."""

from __future__ import annotations

import numpy as np
import pytest

from assets import locate
from chapters.ch01.renderer import Renderer
from chapters.ch01.settings import Settings
from common.gltf import load_scene
from common.images.color import LUMINANCE
from common.scene.pose import evaluate_pose
from common.view.camera import view_of_scene
from tests.support.chapter import as_modelled, on_path

SIZE = (128, 72)
TIME = 0.5  # within the clips, so that what is animated is not at rest

# Without anisotropic filtering, which one of the variants lacks: then both show the same picture.
SETTINGS = Settings(anisotropy=1.0)


@pytest.mark.newest
@pytest.mark.parametrize("name", ["cornell", "spheres", "atrium"])
def test_a_scene_looks_as_it_did(vulkan_device, golden, name):
    scene = load_scene(locate(name))
    view = view_of_scene(scene, evaluate_pose(scene, TIME), None, SIZE[0] / SIZE[1])
    outputs = {"color", "color_linear", "instance_id"}
    with Renderer(
        scene, SIZE, as_modelled(on_path(SETTINGS), 1), outputs=outputs, device=vulkan_device
    ) as made:
        frame = made.render(view, TIME)
        color, linear, ids = (frame.image(output) for output in ("color", "color_linear", "instance_id"))
    assert np.isfinite(linear).all()
    assert (linear >= 0).all()
    assert len(np.unique(color.reshape(-1, 3), axis=0)) > 200, "a picture, not a few flat surfaces"
    facts = {
        "coverage": float((ids > 0).mean()),
        "objects seen": float(len(np.unique(ids[ids > 0]))),
        "mean luminance": float((linear @ LUMINANCE).mean()),
    }
    golden(name, color, vulkan_device.capabilities, **facts)
