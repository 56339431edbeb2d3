"""The study texture-generator: exact bytes at odd sizes, a host for shaders from elsewhere, nothing done twice."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from backends.gl import api as gl
from chapters.ch05.studies.texture_generator import FOLDER, Settings
from tests.support.hazards import find_hazards
from tests.support.kernel_calls import events_of, gl_calls, owed, use, without_each

generates = pytest.mark.feature("compute/texture-generator")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
only_gl = pytest.mark.parametrize("stage", ["gl"], indirect=True, scope="module")
WHICH = "5/texture-generator"
BOTH = ("color", "texture")


def texture(stage, settings, time=0.0, size=(8, 8)):
    return stage.draw(WHICH, size, time, settings=settings, outputs=BOTH)["texture"]


@generates
@pytest.mark.parametrize("size", [(17, 9), (1, 1), (15, 33), (16, 16), (61, 3), (255, 129), (300, 2)])
def test_the_gradient_has_the_rounded_bytes(stage, size):
    width, height = size
    found = texture(stage, Settings("gradient", width, height))
    x, y = np.meshgrid(np.arange(width), np.arange(height)[::-1])  # there y goes up
    # round(255 x / w), in whole numbers; no value lies on a half where w is odd
    expected = np.stack([(510 * x + width) // (2 * width), (510 * y + height) // (2 * height)], axis=-1)
    assert found.shape == (height, width, 4)
    off = np.abs(found[..., :2] - expected)
    halves = np.stack([510 * x % (2 * width) == width, 510 * y % (2 * height) == height], axis=-1)
    assert off[~halves].max() == 0 and off.max() <= 1
    assert (found[..., 2] == 0).all() and (found[..., 3] == 255).all()


@generates
@pytest.mark.parametrize("shader", [one.stem for one in FOLDER.glob("*.comp")])
def test_a_shader_gives_the_same_bytes_at_time_0_whenever_it_is_opened(stage, shader):
    settings = Settings(shader, 33, 17)
    first, again = (texture(stage, settings) for _ in range(2))
    assert (first == again).all() and len(np.unique(first)) > 8
    with stage.open(WHICH, (8, 8), settings=settings, outputs=BOTH) as renderer:
        view = chapters.view_of(renderer)
        later = renderer.render(view, 1.7).image("texture")
        back = renderer.render(view, 0.0).image("texture")
    assert (back == first).all()
    assert shader == "gradient" or (later != first).any()


PORTED = """#include "{host}"
void mainImage( out vec4 fragColor, in vec2 fragCoord )
{{
    // Normalized pixel coordinates (from 0 to 1)
    vec2 uv = fragCoord/iResolution.xy;
    // Time varying pixel color
    vec3 col = 0.5 + {half}*cos(iTime+uv.xyx+vec3(0,2,4));
    fragColor = vec4(col,0.25);
}}
"""


def port(stage, monkeypatch, folder, half=0.5):
    """Write a shader as its host offers it for a beginning, and have the study run it; return its file."""
    file = folder / "ported.comp"
    file.write_text(PORTED.format(host=(FOLDER / "toy.glsl").as_posix(), half=half), "utf-8")
    module = chapters.renderer_module(WHICH, stage.backend)
    monkeypatch.setattr(module.Renderer, "kernel", staticmethod(lambda settings: str(file)))
    return file


@generates
@pytest.mark.parametrize("time", [0.0, 2.5])
@pytest.mark.parametrize("size", [(17, 9), (40, 23)])
def test_a_ported_shader_gives_its_colours_for_the_time_and_the_size_of_the_image(
    stage, monkeypatch, tmp_path, size, time
):
    port(stage, monkeypatch, tmp_path)
    found = texture(stage, Settings(width=size[0], height=size[1]), time)
    u, v = np.meshgrid((np.arange(size[0]) + 0.5) / size[0], 1 - (np.arange(size[1]) + 0.5) / size[1])
    expected = 0.5 + 0.5 * np.cos(time + np.stack([u, v, u], axis=-1) + np.array([0, 2, 4]))
    assert np.abs(found[..., :3] - 255 * expected).max() <= 0.51
    assert (found[..., 3] == 255).all()  # as there, alpha means nothing


@generates
def test_the_picture_shows_the_texture_texel_by_texel(stage):
    made = stage.draw(WHICH, (34, 18), 0.6, settings=Settings(width=17, height=9), outputs=BOTH)
    assert (made["color"] == made["texture"][..., :3].repeat(2, axis=0).repeat(2, axis=1)).all()
    whole = stage.draw(WHICH, (19, 7), outputs=BOTH)  # without a size of its own it has the picture's
    assert (whole["color"] == whole["texture"][..., :3]).all()


TIMES = (0.0, 0.0, 0.0, 0.5, 0.5, 0.0)


@generates
@pytest.mark.parametrize("outputs", [("color",), BOTH])
def test_nothing_is_dispatched_while_time_stands_still_and_the_picture_is_the_same(stage, outputs):
    found = {}
    for skips in (True, False):
        with stage.open(WHICH, (21, 13), outputs=outputs) as renderer:
            view, found[skips] = chapters.view_of(renderer), []
            for time in TIMES:
                if not skips:
                    renderer._made_at = None
                frame = renderer.render(view, time)
                found[skips].append([frame.work["dispatches"], *(frame.image(name) for name in outputs)])
            assert renderer.idle(view, TIMES[-1])
            renderer.resize((20, 12))
            assert renderer.render(view, TIMES[-1]).work["dispatches"] == 1
    assert [one[0] for one in found[True]] == [1, 0, 0, 1, 0, 1]
    assert [one[0] for one in found[False]] == [1] * 6
    for one, other in zip(found[True], found[False], strict=True):
        assert all((a == b).all() for a, b in zip(one[1:], other[1:], strict=True))


@generates
def test_an_edited_shader_is_computed_anew_though_time_stands_still(stage, monkeypatch, tmp_path):
    file = port(stage, monkeypatch, tmp_path)
    with stage.open(WHICH, (8, 8)) as renderer:
        view = chapters.view_of(renderer)
        before = renderer.render(view).image("color")
        assert file in renderer.shader_files
        port(stage, monkeypatch, tmp_path, half=0.25)
        assert renderer.reload_shaders({file}).pipelines == ("rings",)
        frame = renderer.render(view)
        assert frame.work["dispatches"] == 1 and (frame.image("color") != before).any()


# --- who waits ---


@generates
@only_vulkan
@pytest.mark.parametrize("outputs", [("color",), BOTH])
def test_each_barrier_is_needed_and_none_is_missing(stage, outputs):
    uses = {
        "kernel": [use("kernel", "made", "compute storage_write", layout="general", fresh=True)],
        "show": [use("show", "made", "fragment sampled", layout="read")],
    }
    with stage.open(WHICH, (17, 9), outputs=outputs) as renderer:
        view = chapters.view_of(renderer)
        image = renderer.image
        events = events_of(
            renderer,
            lambda number: renderer.render(view, TIMES[number]),
            uses,
            images={"made": image},
            frames=len(TIMES),
        )
    assert find_hazards(events, {}) == []
    changes = [(one, hazards) for one, hazards in without_each(events) if one.dependencies[0].new]
    assert len(changes) >= 2 and all(hazards for _, hazards in changes)


@generates
@only_gl
def test_opengl_is_told_how_the_texture_is_read_and_that_it_was(stage):
    fetch, store = gl.GL_TEXTURE_FETCH_BARRIER_BIT, gl.GL_SHADER_IMAGE_ACCESS_BARRIER_BIT
    with stage.open(WHICH, (17, 9)) as renderer:
        view = chapters.view_of(renderer)
        calls = gl_calls(stage.device, renderer, lambda number: renderer.render(view, 0.1 * number))
    assert owed(calls, {"glDrawArrays": fetch}, store) == []
    for bit in (fetch, store):
        assert owed([one for one in calls if one != ("glMemoryBarrier", bit)], {"glDrawArrays": fetch}, store)


@pytest.mark.parametrize(
    ("set_", "said"),
    [
        ("shader=ring", "did you mean 'rings'?"),
        ("width=-1", "width must be 0 to 16384"),
    ],
)
def test_what_cannot_be_is_one_sentence(strata, set_, said):
    code, _, err = strata("run", WHICH, "--set", set_)
    assert code == 2 and said in err and err.count("\n") == 1, err
