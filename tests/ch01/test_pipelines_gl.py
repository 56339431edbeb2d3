"""Pipelines on OpenGL: equal descriptions share one, and what was built once is not built again."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace

import pytest

from backends import shader_text
from chapters.ch01.pipelines.description import PipelineDescription
from chapters.ch01.pipelines.gl import Pipelines
from common.scene import Light, Material
from tests.support.gl_functions import noted
from tests.support.scenes import facing, quad_scene

PLAIN = PipelineDescription(("post/fullscreen.vert", "post/tonemap.frag"), depth=None, name="plain")


@pytest.fixture
def pipelines(gl_context):
    kept = Pipelines(gl_context)
    yield kept
    kept.close()


@contextmanager
def built(context, monkeypatch) -> Iterator[list[str]]:
    """Yield a list of the programs that are linked within, and of the shaders whose text is put together."""
    work: list[str] = []

    def listed(word, function):
        def call(*arguments, **more):
            work.append(word)
            return function(*arguments, **more)

        return call

    with monkeypatch.context() as patch:
        patch.setattr(shader_text, "build", listed("text", shader_text.build))
        patch.setattr(context.mgl, "program", listed("link", context.mgl.program))
        patch.setattr(context.mgl, "compute_shader", listed("link", context.mgl.compute_shader))
        yield work


@pytest.mark.feature("device/graphics-pipelines")
def test_equal_descriptions_share_a_pipeline(pipelines, gl_context, monkeypatch):
    with built(gl_context, monkeypatch) as work:
        first, second, other = pipelines.get([PLAIN, replace(PLAIN), replace(PLAIN, blend="add")])
    assert first is second and first is not other
    assert first.code is other.code, "OpenGL's programs hold no state"
    assert work.count("link") == 1 and work.count("text") == 2 * 2, "two stages of two descriptions"
    calls: list[str] = []
    with built(gl_context, monkeypatch) as work, noted(gl_context, lambda name, _: calls.append(name)):
        assert pipelines.get([replace(PLAIN)]) == [first]
    assert work == calls == []


@pytest.mark.feature("device/graphics-pipelines")
@pytest.mark.variants("gl")
def test_neither_frames_nor_edits_build_what_was_built_before(chapter, monkeypatch):
    """An edit to numbers builds nothing, one to a new kind of material does, and back again builds nothing."""
    wood, glass = Material(metallic=0.3), Material(base_color=(0.2, 0.6, 0.9, 0.5), alpha_mode="blend")
    scene = quad_scene(wood, lights=(Light("directional", node=0),))
    found = []
    with chapter.open(scene, (8, 8)) as renderer:
        renderer.render(facing())
        for material in (wood, replace(wood, metallic=0.6), glass, wood, glass):
            with scene.edit() as edit:
                edit.set_material(0, material)
            with built(chapter.device, monkeypatch) as work:
                renderer.render(facing())
                renderer.render(facing())
            found.append(work)
    assert [bool(work) for work in found] == [False, False, True, False, False], found
