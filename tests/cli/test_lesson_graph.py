"""The lesson about frame graphs shows what the program prints today: the table of lifetimes, and who shares bytes."""

from __future__ import annotations

import re
from functools import cache

import pytest

import chapters
from assets import locate
from chapters.ch04.settings import Settings
from common.gltf import load_scene
from tools.frames.report import text

LESSON = chapters.FOLDER / "ch04" / "README.md"


@pytest.fixture(scope="module")
def graphs(vulkan_device):
    """Return by settings the graph of the atrium, as the lesson's commands have it compiled."""
    scene = load_scene(locate("atrium"), decode=False)  # no frame is drawn

    @cache
    def compiled(**knobs):
        module = chapters.renderer_module(4, "vulkan")
        settings = Settings(loading="stream", **knobs)
        with module.Renderer(scene, (640, 360), settings, device=vulkan_device) as renderer:
            return renderer.graph

    return compiled


def test_the_tables_of_the_lesson_are_those_of_the_program(graphs, vulkan_device):
    blocks = re.findall(r"^```\n(.*?)^```$", LESSON.read_text("utf-8"), re.M | re.S)
    printed = text(graphs(aperture=2.0)).splitlines()
    lives = next(block for block in blocks if "color_lit           .WXR" in block).splitlines()
    memory = next(block for block in blocks if block.startswith("memory of transients")).splitlines()
    assert len(lives) > 10 and not set(lives) - set(printed)
    if vulkan_device.capabilities.is_software:  # bytes are the driver's
        assert len(memory) > 4 and not set(memory) - set(printed)


def test_the_frames_of_the_lesson_have_as_many_passes_barriers_and_bytes(graphs, vulkan_device):
    rows = re.findall(
        r"^\| (.+?) \| (\d+) \| (\d+) \| ([\d.]+) MiB \| ([\d.]+) MiB \|", LESSON.read_text("utf-8"), re.M
    )
    knobs = {
        "deferred, with a lens": {"aperture": 2.0},
        "the same, G-buffer `full`": {"aperture": 2.0, "gbuffer_format": "full"},
        "forward, with a lens": {"aperture": 2.0, "graph": "forward"},
        "the same, 4 samples a pixel": {"aperture": 2.0, "graph": "forward", "msaa": 4},
        "deferred, without a lens": {},
    }
    assert [row[0] for row in rows] == list(knobs)
    for name, passes, barriers, alone, shared in rows:
        graph = graphs(**knobs[name])
        found = sum(step.kind != "copy" for step in graph.steps)
        assert (int(passes), int(barriers)) == (
            found,
            sum(len(step.barriers) for step in graph.steps) + len(graph.epilogue),
        )
        if vulkan_device.capabilities.is_software:
            sizes = (graph.memory.alone, graph.memory.size)
            assert (alone, shared) == tuple(f"{size / 2**20:.1f}" for size in sizes), name
