"""`--view NAME` and `list N --views` as a user types them."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch01.shading.views import NAMES
from common.images import read_image
from tests.common.gltf.builder import triangle


@pytest.mark.parametrize("backend", ["vulkan", "gl"])
def test_a_view_is_written_beside_the_picture(request, strata, tmp_path, backend):
    device = request.getfixturevalue("vulkan_device" if backend == "vulkan" else "gl_context")
    scene = triangle().write(tmp_path)
    draw = ("run", "1", "--headless", "--backend", backend, "--scene", scene, "--size", "24x24")
    assert strata(*draw)[0] == 0
    assert strata(*draw, "--view", "normal")[0] == 0
    written = sorted((tmp_path / "out").iterdir())
    assert [path.name for path in written] == ["ch01-scene-normal.png", "ch01-scene.png"]
    normals = read_image(written[0])
    # 127.5 lies between two codes, and hardware may take either.
    halves = {128} if device.capabilities.is_software else {127, 128}
    shown = {tuple(row) for row in normals.reshape(-1, 3).tolist()}
    assert shown in [{(0, 0, 0), (half, half, 255)} for half in halves]
    assert strata(*draw, "--set", "view=normal", "--out", "set.png")[0] == 0
    assert np.array_equal(read_image(tmp_path / "set.png"), normals)


def test_an_unknown_view_suggests_the_near_one(strata):
    code, _, err = strata("run", "1", "--view", "nrmal")
    assert (code, err) == (2, "strata: There is no view 'nrmal'; did you mean 'normal'?\n")
    code, _, err = strata("run", "1", "--view", "sharpness-of-everything")
    assert code == 2 and err.count("\n") == 1 and "'base-color'" in err and err.endswith("'uv'.\n")
    code, _, err = strata("run", "1", "--set", "view=nrmal")
    assert (code, err) == (2, "strata: setting view cannot be 'nrmal'; did you mean 'normal'?\n")
    code, _, err = strata("run", "12", "--view", "instance")
    assert (code, err) == (2, "strata: There is no view 'instance'; --set ray_view=instance shows it.\n")


def test_every_view_is_explained(strata):
    code, out, _ = strata("list", "1", "--views")
    assert code == 0
    assert all(name in out for name in NAMES)
    assert strata("list", "--views")[0] == 2
