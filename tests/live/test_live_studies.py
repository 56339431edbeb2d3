"""The shaders of studies: a reader who starts at the triangle changes one and sees it."""

from __future__ import annotations

import shutil
from functools import partial
from importlib import import_module
from pathlib import Path

import numpy as np
import pytest

import chapters
from common.errors import StaleFrameError
from common.scene import Scene
from tests.live.test_reload import ticking
from tests.support.scenes import facing, quad_scene
from tools.run.live import Live
from tools.window.opening import Opened

STUDIES = {
    # name: (file, a piece of it, what it becomes, what cannot be compiled)
    "first-triangle": (
        "triangle.frag",
        "vec4(in_color, 1.0)",
        "vec4(1.0 - in_color, 1.0)",
        "vec4(colour, 1.0)",
    ),
    "rotating-cube": ("cube.frag", "out_color = ", "out_color = vec4(1.0) - ", "out_color = colour + "),
}


@pytest.mark.feature("tools/live-shaders")
@pytest.mark.parametrize("name", STUDIES)
def test_an_edit_of_a_study_is_seen_and_a_wrong_one_is_not(chapter, shaders, monkeypatch, name):
    file, old, new, wrong = STUDIES[name]
    place = name.replace("-", "_")
    module = import_module(f"chapters.ch01.studies.{place}.{chapter.backend}")
    folder = shaders.chapter / "studies" / place
    shutil.copytree(Path(module.__file__).parent, folder)
    monkeypatch.setattr(module, "FOLDER", folder, raising=False)
    path = folder / file
    text = path.read_text("utf-8")
    assert text.count(old) == 1
    said: list[str] = []
    scene: Scene = quad_scene()
    opener = partial(chapters.open, f"1/{name}", chapter.backend, scene=scene, device=chapter.device)

    def alive():
        return {
            one for one in chapter.device.alive if one[0] != "VkDeviceMemory"
        }  # its blocks are the device's

    before = alive()
    with Live(ticking(), said.append) as live:
        window = Opened(opener, (32, 32), {"outputs": ("color",)})
        try:
            live.renew = window.renew
            live.follow(window.renderer)

            def picture():
                return window.renderer.render(facing(), 1.0).image("color").astype(int)

            def save(piece):
                path.write_text(text.replace(old, piece), "utf-8")
                assert any(live.follow(window.renderer) for _ in range(400))

            def built():
                kinds = [kind for kind, _ in chapter.device.alive]
                return {kind: kinds.count(kind) for kind in ("program", "VkPipeline", "VkShaderModule")}

            good, objects = picture(), built()
            save(wrong)
            assert f"{path}:" in live.error and "colour" in live.error
            assert built() == objects
            assert (picture() == good).all()
            if chapter.backend == "vulkan":
                declared = "layout(set = 3, binding = 1) uniform Other { vec4 tint; } other;\nvoid main"
                path.write_text(
                    text.replace("void main", declared).replace("vec4(in_color, 1.0)", "other.tint"), "utf-8"
                )
                assert any(live.follow(window.renderer) for _ in range(400))
                assert "set 3, binding 1 'other': this uniform block is new" in live.error, (
                    "or the driver crashes"
                )
                assert (picture() == good).all()
            save(new)
            assert live.error == ""
            drawn = (good != good[0, 0]).any(-1)
            assert drawn.any()
            inverse = picture()
            assert np.abs(good + inverse - 255)[drawn].max() <= 1, "the complement of each colour"
            assert built() == objects
        finally:
            window.close()
        assert alive() == before, "what was opened anew or exchanged is freed with the rest"
        window.close()  # a second time does nothing
        with pytest.raises(StaleFrameError, match="closed"):
            picture()
