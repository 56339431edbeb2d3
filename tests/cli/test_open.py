"""`chapters.open` from Python: a wrong argument is a UserError of one sentence, whatever the backend."""

from __future__ import annotations

import pytest

import chapters
from common.errors import UserError
from tests.support.scenes import facing, quad_scene


@pytest.mark.parametrize("backend", ["vulkan", "gl"])
@pytest.mark.parametrize("scene", [None, "atrium"])
def test_what_is_no_scene_is_refused_before_a_device_is_opened(backend, scene):
    with pytest.raises(UserError, match=r"is no scene: chapters\.scenes\.load"):
        chapters.open(1, backend, scene=scene)


@pytest.mark.parametrize("number", ["1", "ch01", 1])
def test_a_chapter_may_be_written_as_on_the_command_line(number, vulkan_device):
    with chapters.open(number, "vulkan", scene=quad_scene(), size=(8, 8), device=vulkan_device) as renderer:
        assert renderer.render(facing()).image("color").shape == (8, 8, 3)


@pytest.mark.parametrize("number", [99, "x", None, 1.5])
def test_a_chapter_that_is_none_is_refused(number):
    with pytest.raises(UserError, match="There is no chapter"):
        chapters.open(number, scene=quad_scene())


def test_a_backend_that_is_none_is_refused():
    with pytest.raises(UserError, match="There is no backend None"):
        chapters.open(1, None, scene=quad_scene())
