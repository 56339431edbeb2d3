"""The study texture-handles: bound units against numpy; handles against bound units, where the driver has them."""

from __future__ import annotations

from typing import Any

import numpy as np
import pytest

import chapters
from backends.gl import api as gl
from backends.gl.driver.capabilities import extensions
from chapters import studies
from chapters.ch02.studies.texture_handles import ACROSS, COUNT, DOWN, EXTENSION, Settings, defines, textures
from common.errors import UnsupportedError
from tests.support.bounds import codes_off
from tests.support.gl_functions import noted

WHICH = "2/texture-handles"
SIZE = (40 * ACROSS, 40 * DOWN)


def opened(context, way):
    scene, settings = studies.load(WHICH, None), Settings(way=way)
    return chapters.open(WHICH, "gl", scene=scene, size=SIZE, settings=settings, device=context)


def drawn(context, way):
    with opened(context, way) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        return frame.image("color"), frame.work


def bilinear(texels: np.ndarray, u: np.ndarray, v: np.ndarray) -> np.ndarray:
    """Return texels (H, W, 4) at uv between their centres, repeated across and clamped down, in double precision."""
    height, width = texels.shape[:2]
    x, y = u * width - 0.5, v * height - 0.5
    left, top = np.floor(x).astype(int), np.floor(y).astype(int)
    total = np.zeros((*u.shape, 4))
    for dy in (0, 1):
        for dx in (0, 1):
            weight = np.abs(1 - dx - (x - left)) * np.abs(1 - dy - (y - top))
            texel = texels[np.clip(top + dy, 0, height - 1), (left + dx) % width]
            total += weight[..., None] * texel
    return total


@pytest.mark.feature("bindless/gl-texture-handles")
def test_bound_units_show_each_texture_in_its_rectangle(gl_context):
    picture, work = drawn(gl_context, "units")
    assert work["draws"] == COUNT
    background = np.rint(255 * np.array([0.05, 0.05, 0.06]))
    for number, texels in enumerate(textures()):
        row, column = divmod(number, ACROSS)
        cell = picture[40 * row : 40 * row + 40, 40 * column : 40 * column + 40].astype(float)
        at = (np.arange(36) + 0.5) / 36
        truth = bilinear(texels, *np.meshgrid(at, at))[..., :3]
        # Filters weigh in steps of 1/256 of a texel, and neighbours may differ by all there is.
        assert np.abs(cell[2:38, 2:38] - truth).max() <= 255 * 2 / 256 + 1 + codes_off(gl_context)
        assert (cell[:2] == background).all() and (cell[:, 38:] == background).all()


def test_no_two_textures_have_one_size_so_that_no_array_could_hold_them():
    assert len({pixels.shape for pixels in textures()}) == COUNT == len(textures())


@pytest.mark.feature("bindless/gl-texture-handles")
def test_handles_give_the_picture_of_bound_units_to_the_bit(gl_context):
    if EXTENSION not in extensions(gl_context.fn):
        pytest.skip(f"the driver lacks {EXTENSION}")
    bound, _ = drawn(gl_context, "units")
    with opened(gl_context, "handles") as renderer:
        handles = [int(one) for one in renderer.handles]
        assert len({*handles} - {0}) == COUNT
        assert all(gl_context.fn.glIsTextureHandleResidentARB(one) for one in handles)
        frames = [renderer.render(chapters.view_of(renderer), time) for time in (0.0, 1.0)]
        for frame in frames:
            assert (frame.image("color") == bound).all()
            assert frame.work["draws"] == COUNT
    again, _ = drawn(gl_context, "handles")  # after all were given back
    assert (again == bound).all()


@pytest.mark.feature("bindless/gl-texture-handles")
def test_the_handle_of_each_draw_leads_to_the_texture_of_its_number(gl_context, monkeypatch):
    """On any driver: the extension's calls are replaced by a table, and the shaders are those of units."""
    module, fn = chapters.renderer_module(WHICH, "gl"), gl_context.fn
    offered, unit_defines = extensions(fn) | {EXTENSION}, defines(Settings(way="units"))
    table: dict[int, tuple[int, int]] = {}
    resident: set[int] = set()

    def handle_of(texture, sampler):
        handle = (texture << 32) + (sampler << 8) + 7
        table[handle] = texture, sampler
        return handle

    def give_back(handle):
        assert ("texture", table[handle][0]) in gl_context.alive, "the texture was freed before its handle"
        resident.discard(handle)

    monkeypatch.setattr(module, "extensions", lambda fn: offered)
    monkeypatch.setattr(module, "defines", lambda settings: unit_defines)
    monkeypatch.setitem(vars(fn), "glGetTextureSamplerHandleARB", handle_of)
    monkeypatch.setitem(vars(fn), "glMakeTextureHandleResidentARB", resident.add)
    monkeypatch.setitem(vars(fn), "glMakeTextureHandleNonResidentARB", give_back)
    calls: list[tuple[str, Any]] = []
    with opened(gl_context, "handles") as renderer:
        with noted(gl_context, lambda name, arguments: calls.append((name, arguments))):
            renderer.render(chapters.view_of(renderer))
        assert [arguments[3] for name, arguments in calls if name == "glMultiDrawElementsIndirect"] == [COUNT]
        bound = [arguments for name, arguments in calls if name.startswith("glBindBuffer")]
        (buffer,) = (one[2] for one in bound if one[:2] == (gl.GL_SHADER_STORAGE_BUFFER, 0))
        handles = np.empty(COUNT, np.uint64)
        fn.glGetNamedBufferSubData(buffer, 0, handles.nbytes, gl.pointer(handles))
        assert len({*handles.tolist()}) == COUNT
        for handle, texels in zip(handles.tolist(), textures(), strict=True):
            assert handle in resident
            texture, sampler = table[handle]
            assert ("sampler", sampler) in gl_context.alive
            out, (height, width) = np.empty_like(texels), texels.shape[:2]
            form = (gl.GL_RGBA, gl.GL_UNSIGNED_BYTE, out.nbytes)
            fn.glGetTextureSubImage(texture, *(0, 0, 0, 0), *(width, height, 1), *form, gl.pointer(out))
            assert (out == texels).all()
    assert not resident, "every handle was given back"


@pytest.mark.feature("bindless/gl-texture-handles")
def test_without_the_extension_the_refusal_names_it_in_a_sentence(gl_context, monkeypatch):
    """On a driver that has it, as if it had not."""
    module = chapters.renderer_module(WHICH, "gl")
    without = extensions(gl_context.fn) - {EXTENSION}
    monkeypatch.setattr(module, "extensions", lambda fn: without)
    alive = dict(gl_context.alive)
    with pytest.raises(UnsupportedError) as refused:
        opened(gl_context, "handles")
    said = str(refused.value)
    assert said.startswith(
        f"The study texture-handles needs the OpenGL extension {EXTENSION}, which the driver of "
    )
    assert said.endswith("--set way=units.") and said.count(". ") == 0 and "\n" not in said
    assert gl_context.alive == alive


def test_on_the_command_line_it_finds_its_one_backend_and_ends_with_that_sentence(strata, gl_context):
    there = EXTENSION in extensions(gl_context.fn)
    code, out, err = strata("run", WHICH, "--size", "64x48")
    if there:
        assert code == 0
        return
    assert (code, out) == (2, "") and EXTENSION in err and "Traceback" not in err
    code, _, err = strata("run", WHICH, "--set", "way=units", "--size", "64x48", "--out", "a.png")
    assert code == 0 and "a.png" in err
