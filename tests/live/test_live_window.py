"""Live shaders in a real window on a display that nobody sees, and without one in `run N --watch`."""

from __future__ import annotations

import re
import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import chapters
from backends.vulkan.instance import VALIDATION_LAYER, Instance
from chapters.__main__ import run as strata
from common.errors import UnsupportedError, UserError
from common.images import read_image
from common.scene import Light, Material
from tests.common.gltf.builder import triangle
from tests.support.display import User, virtual_display
from tests.support.drivers import checked
from tests.support.panel import SIZE, PanelUser
from tests.support.scenes import quad_scene
from tests.support.timing import PATIENCE_S, once_more
from tools.panel.panel import PanelState, open_panel
from tools.run import watch as watching
from tools.window import window as windows
from tools.window.window import run_window

BACKENDS = ("vulkan", "gl")


@pytest.fixture(scope="module")
def display():
    with virtual_display() as name:
        yield name


@pytest.fixture(scope="module")
def validate():
    try:
        with Instance() as plain:
            return VALIDATION_LAYER in plain.layers
    except UserError:
        return False


def played(monkeypatch, backend, validate, script):
    """Run a window whose user follows a generator: it gets the loop, and goes on after each step of it."""
    real, act = windows.Loop.step, []

    def step(loop, always=False):
        real(loop, always)
        if not act:
            act.append(script(loop))
        if next(act[0], "end") == "end":
            loop.window.request_close()

    monkeypatch.setattr(windows.Loop, "step", step)
    sun = Light("directional", node=0, intensity=np.pi)
    scene = quad_scene(Material(metallic=0.0, roughness=1.0), lights=(sun,))
    try:
        return run_window(
            partial(chapters.open, 1, backend, scene=scene),
            size=(96, 64),
            title="a test",
            backend=backend,
            panel=True,
            validate=validate and backend == "vulkan",
        )
    except UnsupportedError as error:
        pytest.skip(f"no window of {backend}: {error}")


def until(condition, seconds=PATIENCE_S):
    """Let the loop go on until something is so."""
    end = time.monotonic() + seconds
    while not condition():
        assert time.monotonic() < end
        yield


@pytest.mark.alone
@pytest.mark.feature("tools/live-shaders")
@pytest.mark.parametrize("backend", BACKENDS)
def test_a_window_in_which_nothing_moves_shows_an_edit_within_a_second(
    display, validate, shaders, monkeypatch, capsys, backend
):
    took, noted = [], {}

    def shown(loop):
        return loop.screen.picture(loop.renderer)[32, 48, :3].tolist()

    def script(loop):
        yield from until(lambda: loop.figures.idle >= 3)
        drawn, renderer, camera = (
            loop.figures.drawn,
            loop.renderer,
            loop.camera.positioner.world_from_view.copy(),
        )
        index = renderer._index
        while once_more(took, 1.0):
            for blue in [1.0, 0.0] if took else [0.0]:
                before = loop.figures.drawn
                shaders.paint(0.0, 1.0, blue)
                began = time.monotonic()
                yield from until(lambda before=before: loop.figures.drawn > before)
            took.append(time.monotonic() - began)
        noted["green"] = shown(loop)
        noted["same"] = (
            loop.renderer is renderer and loop.renderer._index - index == loop.figures.drawn - drawn
        )
        noted["camera"] = np.array_equal(loop.camera.positioner.world_from_view, camera)
        noted["message"] = loop.message
        areas = len(loop.panel.interface._areas) if loop.panel is not None else 0
        # Broken: the panel shows it, the picture stays, another setting can be chosen.
        shaders.edit("post/tonemap.frag", "0.0, 1.0, 0.0", "0.0, one, 0.0")
        yield from until(lambda: loop._live.error)
        noted["error"] = loop._live.error
        if loop.panel is not None:  # nobody touches it, and yet it is drawn until the error has its place
            yield from until(lambda: len(loop.panel.interface._areas) > areas)
        noted["still"] = shown(loop)
        loop._change_settings(chapters.settings_class(1)(msaa=1))
        noted["after a setting"] = (loop.message, loop.renderer is not renderer)
        yield
        noted["still after a setting"] = shown(loop)
        # Repaired, and closed while the pipelines are being built.
        real = loop.renderer.reload_shaders

        def closing(changed):
            User(loop.window).close()
            noted["device"] = loop.renderer.device
            return real(changed)

        loop.renderer.reload_shaders = closing
        shaders.edit("post/tonemap.frag", "0.0, one, 0.0", "1.0, 0.0, 0.0")
        yield from until(lambda: False)

    figures = played(monkeypatch, backend, validate, script)
    assert figures.messages == []
    assert min(took) < 1.0, took
    assert noted["green"] == noted["still"] == noted["still after a setting"] == [0, 255, 0]
    assert noted["same"] and noted["camera"]
    assert "tonemap.frag: 1 pipeline" in noted["message"]
    assert "one" in noted["error"] and "^" in noted["error"]
    assert noted["after a setting"] == ("", True)
    assert not noted["device"].alive
    said = capsys.readouterr().err
    assert noted["error"] in said.replace("strata: ", "")
    print(f"{backend}: {min(took):.3f} s from saving to the picture in a window that was idle")


def test_the_panel_shows_the_error_over_the_lower_edge():
    panel = open_panel()
    if panel is None:
        pytest.skip("the panel needs imgui-bundle")
    try:
        error = "shaders/tone.glsl:12: error: 'x' : undeclared identifier\n    float y = x;\n              ^"
        plan = SimpleNamespace(choices=())
        settings = chapters.settings_class(1)()
        user = PanelUser(panel, PanelState(settings, plan))
        before = list(panel.interface._areas)
        user.state = PanelState(settings, plan, error=error)
        user.wait()
        (area,) = [area for area in panel.interface._areas if area not in before]
        assert area[3] == pytest.approx(SIZE[1] - 10, abs=1)
        assert area[1] > SIZE[1] / 2
        assert not user.wait(), "it asks for nothing"
        user.state = PanelState(settings, plan)
        user.wait()
        assert list(panel.interface._areas) == before
        long = "\n".join(f"line {number} " + "x" * 300 for number in range(300))
        user.state = PanelState(settings, plan, error=long)
        user.wait()
        (area,) = [area for area in panel.interface._areas if area not in before]
        assert area[2] <= SIZE[0] and area[1] >= SIZE[1] / 2 - 11, "it scrolls"
    finally:
        panel.close()


@pytest.mark.feature("tools/live-shaders")
@pytest.mark.parametrize(
    "backend", ["vulkan", pytest.param("gl", marks=pytest.mark.needs("moderngl", "glcontext"))]
)
def test_watch_writes_the_picture_anew_until_it_is_stopped(
    vulkan_instance, shaders, monkeypatch, tmp_path, capsys, backend
):
    monkeypatch.chdir(tmp_path)
    target = tmp_path / "a.png"
    steps = []

    def written(before):
        end = time.monotonic() + PATIENCE_S
        while target.stat().st_mtime_ns == before:
            assert time.monotonic() < end
            yield

    def script():
        state = target.stat().st_mtime_ns
        time.sleep(0.01)
        shaders.paint(0.0, 0.0, 1.0)
        yield from written(state)
        steps.append(read_image(target)[0, 0, :3].tolist())
        state = target.stat().st_mtime_ns
        shaders.edit("post/tonemap.frag", "vec4(0.0, 0.0, 1.0", "vec4(0.0, zero, 1.0")
        for _ in range(20):
            yield
        assert target.stat().st_mtime_ns == state, "a broken shader writes nothing"
        shaders.edit("post/tonemap.frag", "zero, 1.0", "1.0, 1.0")
        yield from written(state)
        steps.append(read_image(target)[0, 0, :3].tolist())
        raise KeyboardInterrupt

    events = []

    def sleep(seconds):
        time.sleep(0.01)
        if not events:
            events.append(script())
        next(events[0])

    monkeypatch.setattr(watching, "clock", SimpleNamespace(sleep=sleep, monotonic=time.monotonic))
    box = triangle().write(tmp_path)
    words = ["run", "1", "--backend", backend, "--watch", "--scene", str(box), "--size", "32x32"]
    assert strata([*words, "--out", str(target), *checked(vulkan_instance, backend)]) == 130
    assert steps == [[0, 0, 255], [0, 255, 255]]
    said = capsys.readouterr().err
    assert "Watching" in said and "Ctrl-C ends." in said
    assert len(re.findall(r"a\.png, \d\.\d\d s after the file was saved", said)) == 2
    assert "zero" in said


def test_a_picture_that_could_not_be_written_is_written_after_the_next_edit(monkeypatch, capsys, tmp_path):
    """The next edit may take the last one back, and then nothing is rebuilt. An edit with a fault writes nothing."""
    edits = iter([(1, ""), (0, "a fault"), (0, ""), (0, "")])
    full = [UserError("the disk is full.")]
    written = []

    class Edits:
        noticed = 0.0

        def files(self, renderer):
            return ()

        def follow(self, renderer):
            try:
                self.rebuilt, self.error = next(edits)
            except StopIteration:
                raise KeyboardInterrupt from None
            self.renderer = renderer
            return True

    def write(frame):
        if full:
            raise full.pop()
        written.append(frame)

    monkeypatch.setattr(watching, "POLL_S", 0)
    still = SimpleNamespace(render=lambda view, time: "a frame", idle=lambda view, time: True)
    with pytest.raises(KeyboardInterrupt):
        watching.watch(Edits(), still, None, None, 0.0, write, tmp_path / "a.png")
    assert written == ["a frame"], "once: after the edit without a fault, and not again after the last one"
    assert "strata: the disk is full." in capsys.readouterr().err
