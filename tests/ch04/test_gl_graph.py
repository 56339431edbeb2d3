"""A frame of the graph on OpenGL: chapter 3's bits, from a list of calls that is right whatever ran before it."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.resources import create_image, destroy_image
from backends.gl.targets import create_framebuffer, destroy_framebuffer
from backends.gl.window.present import blit
from chapters.ch04.gl import Renderer
from chapters.ch04.settings import Settings
from common.errors import DeviceError, UnsupportedError
from common.scene import Image, Light, Material
from common.settings import replaced
from common.view.camera import View
from tests.support.chapter import Chapter, as_modelled, building
from tests.support.scenes import facing, quad_scene, texture, translated
from tests.support.timing import least_times, timed

pytestmark = pytest.mark.variants("gl")

SIZE = (48, 32)
OUTPUTS = ("color", "color_linear", "depth", "instance_id")
SETTINGS = as_modelled(Settings(graph="forward", anisotropy=1.0), 4)
DEFERRED = replaced(SETTINGS, graph="deferred", aperture=0.5, focus_distance=1.0)
TEXELS = Image("texels", np.random.default_rng(3).integers(0, 256, (8, 8, 4), dtype=np.uint8))


def scene_of(count=4):
    """Return a wall of wood, a mask with holes and panes of glass before it, one behind the other."""
    materials = (
        Material(base_color=(0.7, 0.5, 0.3, 1.0), roughness=0.4),
        Material(base_color_texture=texture(), alpha_mode="mask", double_sided=True),
        Material(base_color=(0.2, 0.6, 0.9, 0.5), alpha_mode="blend"),
    )
    places = [translated(0.15 * number - 0.4, 0.1 * number, 0.2 * number) for number in range(count)]
    return quad_scene(
        matrices=tuple(places),
        materials=materials,
        instance_materials=(0, 1, *(2,) * (count - 2)),
        images=(TEXELS,),
        lights=(Light("point", node=count - 1, intensity=30.0),),
    )


def moved(x):
    """Return the view of the squares from `x` metres to the right."""
    return View(facing().world_from_view @ translated(x, 0, 0), facing().projection)


def images(frame, names=OUTPUTS):
    """Return the outputs of a frame."""
    return {name: frame.image(name) for name in names}


def assert_equal(one, other):
    """Fail unless the outputs of two frames have equal bits."""
    for name, image in one.items():
        assert np.array_equal(image, other[name]), name


# --- pictures ---


@pytest.mark.parametrize("msaa", [1, 4])
def test_chapter_3_draws_the_same_bits(chapter, msaa):
    """In both slots, found and made again, seen from where it was and from elsewhere."""
    scene, views = scene_of(), [facing(), facing(), moved(0.1), facing(), moved(0.2)]
    found = []
    for which, settings in ((3, {}), (4, {"graph": "forward"})):
        kind = chapters.settings_class(which)
        settings = kind(anisotropy=1.0, msaa=msaa, **settings)
        with Chapter(which, "gl", chapter.device).open(scene, SIZE, settings, outputs=OUTPUTS) as renderer:
            found.append([images(renderer.render(view)) for view in views])
    for before, now in zip(*found, strict=True):
        assert_equal(before, now)


@pytest.mark.parametrize("graph", ["forward", "deferred"])
def test_threads_that_list_draws_change_no_bit(chapter, graph):
    """Their lists become part of the frame's own."""
    scene, found = scene_of(), []
    for more in ({}, {"recording_threads": 2, "draws_per_secondary": 1}):
        settings = replaced(SETTINGS, graph=graph, **more)
        with Renderer(scene, SIZE, settings, device=chapter.device, outputs=OUTPUTS) as renderer:
            frames = [renderer.render(view) for view in (facing(), facing(), moved(0.1))]
            assert [frame.work["recorded"] for frame in frames] == [1, 1, 0]
            assert (frames[-1].work["recorded_parts"] > 0) == bool(more)
            found.append(images(frames[-1]))
    assert_equal(*found)


def test_what_is_looked_at_in_a_frame_is_of_that_frame(chapter):
    """The copies behind each pass are calls of the list as well."""
    with Renderer(scene_of(), SIZE, SETTINGS, device=chapter.device, inspect=True) as renderer:
        for view in (facing(), facing(), moved(0.1), moved(0.2), moved(0.3)):
            frame = renderer.render(view)
            assert np.array_equal(frame.image("forward/depth"), frame.image("depth"))
            assert np.array_equal(frame.image("tonemap/color")[..., :3], frame.image("color"))


# --- the list ---


def disturb(context):
    """Leave the context as the worst of guests would: nothing bound, nothing drawn, nothing written."""
    fn = context.fn
    for capability in (gl.GL_BLEND, gl.GL_CULL_FACE, gl.GL_DEPTH_TEST, gl.GL_SCISSOR_TEST):
        fn.glEnable(capability)
    fn.glScissor(0, 0, 1, 1)
    fn.glViewport(0, 0, 1, 1)
    fn.glDepthFunc(gl.GL_NEVER)
    fn.glDepthMask(0)
    fn.glColorMask(0, 0, 0, 0)
    fn.glFrontFace(gl.GL_CW)
    fn.glCullFace(gl.GL_BACK)
    fn.glBlendFuncSeparate(gl.GL_ZERO, gl.GL_ZERO, gl.GL_ZERO, gl.GL_ZERO)
    fn.glUseProgram(0)
    fn.glBindVertexArray(0)
    fn.glBindFramebuffer(gl.GL_FRAMEBUFFER, 0)
    fn.glBindBuffer(gl.GL_DRAW_INDIRECT_BUFFER, 0)
    for unit in range(16):
        fn.glBindTextureUnit(unit, 0)
        fn.glBindSampler(unit, 0)
    for binding in range(8):
        fn.glBindBufferBase(gl.GL_UNIFORM_BUFFER, binding, 0)
        fn.glBindBufferBase(gl.GL_SHADER_STORAGE_BUFFER, binding, 0)


@pytest.mark.parametrize("settings", [SETTINGS, DEFERRED], ids=["forward", "deferred"])
def test_a_list_is_right_whatever_ran_before_it(chapter, settings):
    """A guest, a window's blit, and another renderer of the same context between any two frames."""
    context, scene = chapter.device, scene_of()
    with Renderer(scene, SIZE, settings, device=context, outputs=OUTPUTS, presents=True) as renderer:
        renderer.wait_loaded()  # a renderer for a window draws while it loads
        alone = [images(renderer.render(view)) for view in (facing(), moved(0.1), moved(0.2), moved(0.3))]
        window = create_image(context, "rgba8_srgb", (20, 20), "window")
        shown = create_framebuffer(context, [window], None, "window")
        with Renderer(quad_scene(), (16, 16), SETTINGS, device=context) as guest:
            for number, view in enumerate((facing(), moved(0.1), moved(0.2), moved(0.3))):
                disturb(context)
                guest.render(facing())
                frame = renderer.render(view)
                blit(context, renderer.present_source, shown)
                assert frame.work["recorded"] == 0
                assert_equal(images(frame), alone[number])
        destroy_framebuffer(context, shown)
        destroy_image(context, window)


def names_of_frames(chapter, renderer, views):
    """Return the calls of a frame for each view; the lists are made anew, so that each call of theirs is seen."""
    with chapter.calls() as calls:
        renderer._frames.forget()
        for _ in range(2):
            renderer.render(facing())
        found = []
        for view in views:
            del calls[:]
            assert renderer.render(view).work["recorded"] == 0
            found.append([*calls])
    renderer._frames.forget()  # what was traced is no call any more
    return found


@pytest.mark.parametrize("settings", [SETTINGS, DEFERRED], ids=["forward", "deferred"])
def test_a_frame_of_unchanged_structure_is_the_same_calls(chapter, settings):
    """Nothing is made or asked for, and nothing waits for what no shader stored."""
    with Renderer(scene_of(3), SIZE, settings, device=chapter.device, outputs=OUTPUTS) as renderer:
        frames = names_of_frames(chapter, renderer, [facing(), facing(), moved(0.1), moved(0.2)])
        assert all(frame == frames[0] for frame in frames)
        assert not building(frames[0])
        assert not [name for name in frames[0] if name.startswith("glGet") and "SubImage" not in name]
        assert "glMemoryBarrier" not in frames[0]
        assert renderer._api.executor.barriers == [0] * len(renderer.graph.steps)


def test_the_list_does_not_grow_with_objects(chapter):
    lengths = []
    for count in (3, 4, 40):
        with Renderer(scene_of(count), SIZE, SETTINGS, device=chapter.device) as renderer:
            renderer.render(facing())
            lengths.append(len(renderer._frames.slots[0].calls))
    assert lengths[0] == lengths[1] == lengths[2]


def test_a_call_that_fails_leaves_no_label_open(chapter):
    def fail():
        raise DeviceError("a test")

    with Renderer(quad_scene(), SIZE, SETTINGS, device=chapter.device) as renderer:
        first = renderer.render(facing()).image("color")
        renderer.render(facing())
        renderer.render(facing())
        calls = renderer._frames.slots[1].calls
        middle = next(
            number for number, (call, _) in enumerate(calls) if call == chapter.device.sink.labels.pop
        )
        calls.insert(middle, (fail, ()))
        with pytest.raises(DeviceError, match="a test"):
            renderer.render(facing())
        assert not chapter.device.sink.labels
        renderer._frames.forget()
        assert np.array_equal(renderer.render(facing()).image("color"), first)


@pytest.mark.parametrize("failing", ["forward", "tonemap"])
def test_a_pass_that_fails_while_it_is_recorded_leaves_the_next_frame_whole(chapter, monkeypatch, failing):
    """As Ctrl-C would: nothing of the half list is kept, and calls are made at once again."""

    def interrupted(commands):
        raise KeyboardInterrupt

    with Renderer(scene_of(), SIZE, SETTINGS, device=chapter.device) as renderer:
        first = renderer.render(facing()).image("color")
        kept, fn = renderer.render(facing()), chapter.device.fn
        renderer._frames.forget()
        with monkeypatch.context() as patch:
            patch.setattr(next(one for one in renderer.passes if one.name == failing), "record", interrupted)
            with pytest.raises(KeyboardInterrupt):
                renderer.render(moved(0.1))
        assert chapter.device.fn is fn
        assert np.array_equal(kept.image("color"), first)
        for _ in range(3):
            frame = renderer.render(facing())
            assert np.array_equal(frame.image("color"), first)
            assert list(frame.timings) == ["forward", "tonemap"]


@pytest.fixture
def plain_context():
    """A context whose calls are not checked: that costs more than what is measured."""
    try:
        with Context() as context:
            yield context
    except UnsupportedError as error:
        pytest.skip(f"no OpenGL: {error}")


def written_out(calls, fn):
    """Return a function that makes the calls of a list as a hand would have written them, one a line."""
    called = {gl.ffi.cast("intptr_t", getattr(fn, name)): name for name in gl._POINTERS if fn.has(name)}
    named = {int(address): name for address, name in called.items()}
    known = {"fn": fn}
    lines = []
    for number, (call, arguments) in enumerate(calls):
        word = f"call_{number}"
        if isinstance(call, gl.ffi.CData):
            word = f"fn.{named[int(gl.ffi.cast('intptr_t', call))]}"
        else:
            known[word] = call
        written = []
        for place, value in enumerate(arguments):
            known[f"value_{number}_{place}"] = value
            written.append(repr(value) if isinstance(value, int) else f"value_{number}_{place}")
        lines.append(f"    {word}({', '.join(written)})")
    exec("\n".join(["def frame():", *lines]), known)
    return known["frame"]


@pytest.mark.alone
@pytest.mark.parametrize("settings", [SETTINGS, DEFERRED], ids=["forward", "deferred"])
def test_a_list_costs_at_most_1_3_of_its_calls_written_by_hand(plain_context, settings):
    """The CPU time of the thread that calls: what the driver's own threads draw meanwhile is none of it."""
    fn = plain_context.fn

    with Renderer(scene_of(), SIZE, settings, device=plain_context, outputs=OUTPUTS) as renderer:
        for _ in range(3):
            renderer.render(facing()).image("color")
        calls = renderer._frames.slots[0].calls
        by_hand = written_out(calls, fn)

        def listed():
            for call, arguments in calls:
                call(*arguments)

        def holds(least):
            return least["listed"] <= 1.3 * least["by hand"]

        measures = {
            "listed": timed(listed, before=fn.glFinish),
            "by hand": timed(by_hand, before=fn.glFinish),
        }
        least = least_times(measures, holds, fewest=60)
    assert holds(least), least
