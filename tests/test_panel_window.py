"""The panel in a window: what is on the screen, what a user there changes, and what the loop does for it."""

from __future__ import annotations

import dataclasses
import json
import os
import subprocess
import sys
import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import chapters
from backends.gl.window import present
from backends.vulkan.instance import VALIDATION_LAYER, Instance
from chapters.ch01.settings import Settings
from common.errors import UserError
from common.images import read_image
from common.numerics.transforms import pose_looking_at
from common.paths import ROOT
from common.reports import metrics
from common.scene import Light, Material
from common.scene.pose import evaluate_pose
from common.settings import replaced
from common.view.camera import Camera, Orthographic, Perspective, view_of_scene
from common.view.draw_lists import VERTEX, Command, DrawList
from common.view.inputs import Inputs
from common.view.positioners import FirstPerson, Orbit
from tests.support import packages
from tests.support.display import User, screenshot, virtual_display
from tests.support.scenes import quad_scene
from tests.support.timing import PATIENCE_S, once_more
from tools.lessons.places import Place
from tools.panel import imgui
from tools.panel.panel import PanelActions
from tools.window import opening, reference
from tools.window import window as module
from tools.window.camera import camera_text
from tools.window.keys import panel_help
from tools.window.opening import Opened, Refused
from tools.window.stop import Stop
from tools.window.window import Loop, run_window

# --- the loop alone, with a panel that asks for what a script says ----------------------------------------------------


class FakePanel:
    """A panel that notes what it is shown."""

    def __init__(self, script=()):
        self.visible, self.restless = True, False
        self.script, self.states, self.times = list(script), [], []
        self.drawn = DrawList((1.0, 1.0))
        self.history = SimpleNamespace(add=self.times.append)

    def frame(self, state, size, dt):
        self.states.append(state)
        return self.script.pop(0) if self.script else PanelActions()


class FakeRenderer:
    def __init__(self, settings=None):
        self.scene, self.size, self.settings = quad_scene(), (64, 32), settings or Settings()
        self.passes = []
        self.plan, self.capabilities = None, SimpleNamespace(device="a device", backend="none")
        self.views, self.drawn_at, self.reads, self.last, self.closed = [], [], [], None, False

    def render(self, view, time):
        self.views.append(view)
        self.drawn_at.append(time)
        self.last = (view, time)
        number = len(self.views)

        class Frame(SimpleNamespace):
            @property
            def timings(frame):
                self.reads.append((number, len(self.views)))
                return {"forward": float(number)}

        return Frame(work={"draws": number}, cpu_ms=0.5)

    def idle(self, view, time):
        return self.last is not None and self.last[0] == view

    def close(self):
        self.closed = True


class FakeScreen:
    def __init__(self):
        self.laid, self.shown = [], 0

    def show(self, renderer):
        self.shown += 1
        return True

    def lay(self, drawn):
        self.laid.append(drawn)

    def picture(self, renderer):
        return np.full((4, 6, 4), 77, np.uint8)


def looped(*script, reopen=None, **more):
    """Return a loop with a fake of everything, whose panel asks for the actions of `script` frame by frame."""
    window = SimpleNamespace(
        inputs=Inputs(), size=(64, 32), minimised=False, damaged=False, closing=False, waits=[], copied=[]
    )
    window.now = iter(range(0, 10**12, 10_000_000))
    window.wait, window.copy_text, window.set_title = (
        window.waits.append,
        window.copied.append,
        lambda title: None,
    )
    camera = Camera(FirstPerson.at(np.eye(4)), Perspective(), 3.0)
    return Loop(
        window,
        FakeScreen(),
        FakeRenderer(),
        camera,
        "Strata",
        timer_ns=lambda: next(window.now),
        panel=FakePanel(script),
        reopen=reopen,
        **more,
    )


def steps(loop, count):
    for _ in range(count):
        loop.step()


def test_the_panel_is_drawn_with_every_frame_and_once_more_when_nothing_moves():
    loop = looped()
    steps(loop, 8)
    assert (loop.figures.drawn, len(loop.panel.states), loop.screen.shown) == (2, 3, 3)
    assert len(loop.window.waits) == 5
    loop.panel.restless = True
    steps(loop, 4)
    assert (loop.figures.drawn, len(loop.panel.states), loop.screen.shown) == (2, 7, 7)
    assert loop.screen.laid == [loop.panel.drawn] * 7


def test_times_are_read_when_nobody_waits_for_them():
    loop = looped()
    loop.renderer.idle = lambda view, time: False
    steps(loop, 6)
    assert loop.panel.times == [{"forward": 2.0}, {"forward": 3.0}, {"forward": 4.0}], (
        "in the first, drivers compile"
    )
    assert loop.renderer.reads == [(number, number + 2) for number in range(2, 5)]
    assert loop.panel.states[-1].work == {"draws": 4}
    loop.renderer.idle = lambda view, time: True
    steps(loop, 1)
    assert loop.panel.times[-1] == {"forward": 6.0}, "nothing follows, so the last ones can be waited for"


def test_time_stands_still_steps_and_runs_at_another_speed():
    loop = looped(PanelActions(paused=True), PanelActions(step=True), PanelActions(paused=False, speed=10.0))
    loop.renderer.idle = lambda view, time: False
    steps(loop, 6)
    expected = [0.01, 0.01, 0.01 + 1 / 60, 0.11 + 1 / 60, 0.21 + 1 / 60, 0.31 + 1 / 60]
    assert np.allclose(loop.renderer.drawn_at, expected, rtol=0, atol=1e-12)
    assert [state.paused for state in loop.panel.states] == [False, True, True, False, False, False]
    assert loop.panel.states[-1].speed == 10.0


def test_exposure_and_camera_change_without_another_renderer():
    loop = looped(PanelActions(ev_offset=2.0), PanelActions(mode="orbit"), PanelActions(mode="orbit"))
    steps(loop, 6)
    assert [view.ev100 for view in loop.renderer.views[:2]] == [3.0, 5.0]
    assert isinstance(loop.camera.positioner, Orbit)
    assert [state.mode for state in loop.panel.states][:3] == ["first person", "first person", "orbit"]
    assert loop.panel.states[-1].ev_offset == 2.0


def test_other_settings_open_another_renderer_and_camera_and_time_stay():
    made = []

    def reopen(settings):
        for _ in range(50):  # it takes half a second
            next(loop.window.now)
        made.append(FakeRenderer(settings))
        return made[-1]

    wanted = Settings(background=1.0)
    loop = looped(PanelActions(), PanelActions(settings=wanted), reopen=reopen)
    first = loop.renderer
    steps(loop, 4)
    assert (len(first.views), len(made), made[0].settings) == (2, 1, wanted)
    assert loop.renderer is made[0]
    assert np.array_equal(made[0].views[0].world_from_view, first.views[-1].world_from_view)
    assert made[0].drawn_at[0] == pytest.approx(first.drawn_at[-1] + 0.01)
    assert loop.panel.states[-1].settings == wanted
    assert first.reads == [], "nobody asks a closed renderer"


def test_a_knob_that_is_read_in_every_frame_is_turned_in_the_renderer_that_is_open():
    """Cloth goes on when the wind turns; with another number of substeps it begins anew."""
    calm = chapters.settings_class(5)()
    windy = replaced(calm, wind_speed=8.0, wind_direction=90.0)
    others = replaced(windy, cloth_substeps=4)
    made = []

    def reopen(settings):
        made.append(FakeRenderer(settings))
        return made[-1]

    loop = looped(PanelActions(), PanelActions(settings=windy), PanelActions(settings=others), reopen=reopen)
    first = loop.renderer
    first.settings = dataclasses.replace(calm)
    steps(loop, 2)
    assert loop.renderer is first and first.settings == windy and not made
    steps(loop, 2)
    assert loop.renderer is made[0] and made[0].settings == others and first.settings == windy


def test_settings_that_cannot_be_are_refused_with_the_reason():
    opened = []

    def opener(size, settings=None):
        if settings is not None and settings.shading.background == 1.0:
            raise UserError("not with such a background")
        opened.append(FakeRenderer(settings))
        return opened[-1]

    holder = Opened(opener, (64, 32), {})
    loop = looped(PanelActions(settings=Settings(background=1.0)), reopen=holder.reopen)
    steps(loop, 3)
    assert loop.panel.states[-1].message == "not with such a background"
    assert loop.renderer is holder.renderer is opened[-1] and not opened[-1].closed
    assert opened[0].closed and opened[-1].settings == Settings()
    with pytest.raises(Refused):
        holder.reopen(Settings(background=1.0))


def test_a_frame_that_is_to_stop_needs_a_renderer_that_can_be_looked_into():
    asked = []

    def reopen(settings, **options):
        asked.append((settings, options))
        if len(asked) == 3:
            raise Refused("no memory for that", FakeRenderer(settings))
        made = FakeRenderer(settings)
        made.passes = [SimpleNamespace(name="forward", writes=())]
        return made

    loop = looped(PanelActions(), PanelActions(stop_after="bloom"), PanelActions(), reopen=reopen)
    steps(loop, 3)
    assert asked == [(loop.renderer.settings, {"inspect": True})]
    assert loop.panel.states[-1].stopped == "this frame has no pass bloom"
    assert loop.panel.states[-1].passes == ("forward",) and loop.stop.picture is None
    for wanted in ("", "bloom"):
        loop.panel.script = [PanelActions(stop_after=wanted)]
        steps(loop, 2)
    assert [options for _, options in asked[1:]] == [{"inspect": False}, {"inspect": True}]
    assert loop.panel.states[-1].message == "no memory for that" and loop.stop.after == ""


def test_the_picture_of_a_stop_lies_below_everything_else():
    stop, drawn = Stop(), DrawList((64.0, 32.0), origin=(2.0, 1.0))
    assert stop.under(drawn, (64, 32)) is drawn and stop.under(None, (64, 32)) is None
    stop.picture, stop._fresh = np.full((8, 16, 3), 9, np.uint8), True
    one = DrawList(
        (64.0, 32.0),
        np.zeros(3, VERTEX),
        np.arange(3, dtype=np.uint32),
        (Command((0.0, 0.0, 9.0, 9.0), 0, 0, 3),),
        origin=(2.0, 1.0),
    )
    below = stop.under(one, (64, 32))
    below.check()
    assert below.commands[1:] == one.commands and below.commands[0].texture == 1
    corners = below.vertices["position"][below.commands[0].base + below.indices[3:]]
    assert corners.min(axis=0).tolist() == [2.0, 1.0] and corners.max(axis=0).tolist() == [66.0, 33.0]
    (update,) = below.updates
    assert update.whole and update.size == (16, 8) and (update.pixels[..., 3] == 255).all()
    again = stop.under(None, (64, 32))
    assert again.updates == () and again.extent == (64.0, 32.0), "what the GPU has is not sent again"


# --- a frozen picture -------------------------------------------------------------------------------------------------


def test_a_frozen_picture_is_compared_with_what_comes_after_it():
    loop = looped(PanelActions(freeze=True))
    steps(loop, 4)
    state = loop.panel.states[-1].reference
    assert (state.frozen, state.largest, state.changed) == (True, 0, 0.0)
    later = np.full((4, 6, 4), 77, np.uint8)
    later[0, 0, 1], later[1, 2, 0], later[3, 5, 3] = 80, 70, 0  # alpha is not seen
    loop.screen.picture = lambda renderer: later
    loop.camera.ev100 += 1
    steps(loop, 4)
    state = loop.panel.states[-1].reference
    assert (state.largest, state.changed) == (7, 2 / 24)
    loop.panel.script = [PanelActions(freeze=False)]
    loop.panel.restless = True  # after a click
    steps(loop, 2)
    assert not loop.panel.states[-1].reference.frozen and loop.reference.picture is None


def test_a_moving_picture_is_read_back_a_few_times_a_second_and_once_more_at_rest():
    loop = looped(PanelActions(freeze=True))
    read = []
    loop.screen.picture = lambda renderer: read.append(1) or np.full((4, 6, 4), 77, np.uint8)
    steps(loop, 2)
    before = len(read)
    for _ in range(60):  # of a hundredth of a second each
        loop.camera.ev100 += 0.01
        loop.step()
    moving = len(read) - before
    assert 60 * 0.01 / reference.EVERY_S - 1 <= moving <= 60 * 0.01 / reference.EVERY_S + 1
    steps(loop, 5)
    assert len(read) - before - moving <= 1 and not loop.reference.stale
    settled = len(read)
    steps(loop, 5)
    assert len(read) == settled, "nothing moves, so nothing is measured"


def test_without_the_package_of_flip_the_key_says_so(monkeypatch):
    def missing():
        raise UserError("FLIP needs the package flip-evaluator.")

    monkeypatch.setattr(metrics, "_flip", missing)
    loop = looped(PanelActions(freeze=True))
    steps(loop, 3)
    loop.press("F")
    steps(loop, 1)
    assert loop.panel.states[-1].reference.said == loop.message == "FLIP needs the package flip-evaluator."


@pytest.mark.needs("flip_evaluator")
def test_flip_is_that_of_the_metrics_and_ends_with_the_next_picture():
    rng = np.random.default_rng(4)
    pictures = [rng.integers(0, 256, (16, 24, 4), dtype=np.uint8) for _ in range(2)]
    loop = looped(PanelActions(freeze=True))
    loop.screen.picture = lambda renderer: pictures[0]
    steps(loop, 2)
    loop.screen.picture = lambda renderer: pictures[1]
    expected = metrics.flip_mean(pictures[1][..., :3], pictures[0][..., :3])
    loop.press("F")
    assert loop.reference.state.flip == expected > 0 and f"FLIP {expected:.4f}" in loop.message
    loop.camera.ev100 += 1
    steps(loop, 1)
    assert loop.reference.state.flip is None


def test_a_window_of_another_size_says_that_the_picture_is_to_be_frozen_again():
    loop = looped(PanelActions(freeze=True))
    steps(loop, 4)
    loop.screen.picture = lambda renderer: np.zeros((8, 6, 4), np.uint8)
    loop.camera.ev100 += 1
    steps(loop, 4)
    assert "freeze the picture again" in loop.panel.states[-1].reference.said


def test_the_left_part_of_a_frozen_picture_lies_over_a_stop_and_below_the_panel():
    frozen, stop = reference.Reference(), Stop()
    picture = np.arange(8 * 16 * 3, dtype=np.uint8).reshape(8, 16, 3)
    frozen.freeze(picture, 1.0)
    frozen.wipe(0.25)
    stop.picture, stop._fresh = np.full((8, 16, 3), 9, np.uint8), True
    one = DrawList(
        (64.0, 32.0),
        np.zeros(3, VERTEX),
        np.arange(3, dtype=np.uint32),
        (Command((0.0, 0.0, 9.0, 9.0), 0, 0, 3),),
    )
    laid = stop.under(frozen.under(one, (64, 32)), (64, 32))
    laid.check()
    assert [command.texture for command in laid.commands] == [1, reference.TEXTURE, 0]
    command = laid.commands[1]
    quad = laid.vertices[command.base + laid.indices[command.first : command.first + 6]]
    assert quad["position"].max(axis=0).tolist() == [16.0, 32.0] and quad["uv"].max(axis=0).tolist() == [
        0.25,
        1.0,
    ]
    assert any(np.array_equal(update.pixels[..., :3], picture) for update in laid.updates)
    assert frozen.under(None, (64, 32)).updates == (), "what the GPU has is not sent again"
    frozen.wipe(0.0)
    assert frozen.under(one, (64, 32)) is one


def test_the_place_where_a_knob_is_explained_goes_to_the_clipboard(tmp_path):
    place = Place(tmp_path / "README.md", "Light in numbers", 178)
    loop = looped(PanelActions(read="ambient"), places={"ambient": place})
    steps(loop, 2)
    assert loop.window.copied == [f"{tmp_path / 'README.md'}:178"]
    assert "ambient is explained in" in loop.message and '"Light in numbers"' in loop.message
    assert loop.panel.states[0].explained == {"ambient": place.spoken}


def test_keys_freeze_and_measure_without_a_panel(capsys):
    loop = looped()
    loop.panel.visible = False
    loop.press("R")
    assert loop.reference.picture is None, "nothing was drawn yet"
    steps(loop, 1)
    loop.press("F")
    assert loop.message == "", "nothing is frozen"
    loop.press("R")
    assert (
        loop.reference.picture is not None and loop.screen.laid[-1].commands[0].texture == reference.TEXTURE
    )
    loop.press("F")
    assert capsys.readouterr().err.startswith("strata: ")


# --- screenshots ------------------------------------------------------------------------------------------------------


def test_a_screenshot_is_written_and_its_place_is_said(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    loop = looped(PanelActions(screenshot=True, copy="1,2,3:4,5,6:50"), name="ch01")
    steps(loop, 3)
    (path,) = (tmp_path / "out").iterdir()
    assert path.name.startswith("ch01-") and np.array_equal(read_image(path), np.full((4, 6, 3), 77))
    assert loop.panel.states[-1].message == f"wrote out/{path.name}"
    assert loop.window.copied == ["1,2,3:4,5,6:50"]


def test_what_came_of_an_action_is_shown_though_nothing_moves(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    loop = looped(*[PanelActions()] * 3, PanelActions(screenshot=True))
    steps(loop, 6)
    assert len(loop.panel.states) == 3
    loop.panel.restless = True
    steps(loop, 1)
    loop.panel.restless = False
    steps(loop, 3)
    assert [bool(state.message) for state in loop.panel.states] == [False] * 4 + [True]


def test_a_screenshot_that_cannot_be_written_is_said_too(tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)
    (tmp_path / "out").write_text("a file")
    loop = looped(PanelActions(screenshot=True))
    steps(loop, 3)
    assert "out" in loop.panel.states[-1].message


@pytest.mark.parametrize("key", ["F1", "TAB"])
def test_a_key_hides_the_panel_and_brings_it_back(key):
    loop = looped()
    steps(loop, 4)
    loop.press(key)
    shown = len(loop.panel.states)
    steps(loop, 3)
    assert not loop.panel.visible and len(loop.panel.states) == shown
    assert loop.screen.laid[-1] is None and not loop.window.damaged
    loop.press(key)
    steps(loop, 1)
    assert len(loop.panel.states) == shown + 1 and loop.screen.laid[-1] is loop.panel.drawn


@pytest.mark.parametrize("positioner", [FirstPerson.at, lambda pose: Orbit.at(pose, 3.0)])
def test_the_text_of_a_view_gives_it_back(positioner):
    scene = quad_scene()
    pose = pose_looking_at(np.array([3.0, 2.0, 5.0]), np.array([0.25, 1.0, -0.5]))
    camera = Camera(positioner(pose), Perspective(0.7))
    found = view_of_scene(scene, evaluate_pose(scene, 0.0), camera_text(camera, scene), 1.5)
    assert np.allclose(found.world_from_view, pose, atol=2e-5)
    assert found.projection.yfov == pytest.approx(0.7, rel=1e-4)
    camera.projection = Orthographic(1.0, 0.1, 10.0)
    assert camera_text(camera, scene) == ""


def test_the_help_names_the_keys_of_the_panel_or_how_to_get_one(monkeypatch):
    monkeypatch.setattr(imgui, "load", lambda: None)
    assert "--extras" in panel_help()
    monkeypatch.setattr(imgui, "load", lambda: imgui)
    assert "F1 or Tab" in panel_help()


def test_the_help_promises_no_panel_of_a_broken_package(tmp_path, monkeypatch):
    (tmp_path / "imgui_bundle.py").write_text("raise ImportError('a library of the system is missing')")
    for name in [name for name in sys.modules if name.split(".")[0] == "imgui_bundle"]:
        monkeypatch.delitem(sys.modules, name)
    monkeypatch.syspath_prepend(tmp_path)
    assert "--extras" in panel_help()


HEADLESS = """
import sys
from chapters.__main__ import run
code = run(["run", "1/first-triangle", "--size", "16x16", "--headless", "--out", "a.png"])
print(code, [name for name in ("imgui_bundle", "glfw") if name in sys.modules])
import tools.window.window
print([name for name in ("imgui_bundle",) if name in sys.modules])
"""


@pytest.mark.feature("ui/imgui-renderer")
def test_a_headless_run_loads_no_package_of_windows(tmp_path, vulkan_instance):
    """In a process of its own; nor does the import of what opens a window load the panel's package."""
    environment = {**os.environ, "PYTHONPATH": str(ROOT)}
    command = [sys.executable, "-c", HEADLESS]
    done = subprocess.run(
        command, cwd=tmp_path, env=environment, capture_output=True, text=True, check=False, timeout=60
    )
    assert done.stdout.splitlines() == ["0 []", "[]"], done.stderr
    assert (tmp_path / "a.png").is_file()


# --- a real window ----------------------------------------------------------------------------------------------------

SIZE = (640, 600)
BESIDE = (slice(60, None), slice(430, None))
"""Rows and columns that no part of the panel covers."""


@pytest.fixture(scope="module")
def display():
    if imgui.load() is None:
        pytest.skip("the extra ui is not installed")
    with virtual_display() as name:
        yield name


class Session:
    """One run in a window, in which a script (a generator) acts as the user: it goes on after each look for events."""

    def __init__(self, display, backend, script, monkeypatch, panel=True, settings=None, chapter=1):
        self.display, self.windows, self.loops, self.user = display, [], [], None
        for place in (opening, present):
            monkeypatch.setattr(place, "Window", self._window(place.Window))
        monkeypatch.setattr(module, "Loop", self._loop)
        monkeypatch.setattr(module, "IDLE_WAIT_S", 0.02)
        sun = Light("directional", node=0, intensity=np.pi)
        scene = quad_scene(Material(metallic=0.0, roughness=1.0), lights=(sun,))
        opener = partial(
            chapters.open, chapter, backend, scene=scene, **({"settings": settings} if settings else {})
        )
        self._script = script(self)
        try:
            with Instance() as plain:
                validate = VALIDATION_LAYER in plain.layers
        except UserError:
            validate = False
        self.figures = run_window(
            opener,
            size=SIZE,
            title="a test",
            backend=backend,
            panel=panel,
            name="ch01",
            validate=validate and backend == "vulkan",
        )

    def _window(self, real):
        def opened(*arguments, **options):
            window = real(*arguments, **options)
            self.windows.append(window)
            return window

        return opened

    def _loop(self, *arguments, **options):
        loop = Loop(*arguments, **options)
        self.loops.append(loop)
        step = loop.step
        self.deadline = time.monotonic() + PATIENCE_S

        def acted(always=False):
            step(always)
            if self.user is None:
                self.user = User(self.windows[0])
            if time.monotonic() > self.deadline:
                pytest.fail("the script does not end")
            if next(self._script, None) == "end":
                self.windows[0].request_close()

        loop.step = acted
        return loop

    @property
    def loop(self):
        return self.loops[0]

    def rest(self):
        """Let the loop run until it has shown everything and sleeps; take a picture of the screen."""
        idle = 0
        while idle < 3:
            before = (self.loop.figures.drawn, self.loop.figures.shown)
            yield
            same = before == (self.loop.figures.drawn, self.loop.figures.shown)
            idle = idle + 1 if same else 0
        self.seen = screenshot(self.display, SIZE)
        for _ in range(50):  # the display takes its time
            time.sleep(0.01)
            again = screenshot(self.display, SIZE)
            if np.array_equal(again, self.seen):
                break
            self.seen = again

    def picture(self):
        """Return what the renderer drew, without the panel."""
        return self.loop.screen.picture(self.loop.renderer)[..., :3]

    def at(self, name, x=0.5):
        left, top, right, bottom = self.loop.panel.places[name]
        return round(left + x * (right - left)), round((top + bottom) / 2)

    def click(self, x, y):
        self.user.move(x, y)
        yield
        self.user.button(1, True, x, y)
        yield
        self.user.button(1, False, x, y)
        yield


@pytest.fixture(params=packages.BACKENDS)
def session(request, display, monkeypatch):
    def run(script, **more):
        found = Session(display, request.param, script, monkeypatch, **more)
        assert found.figures.messages == []
        return found

    return run


@pytest.mark.feature("ui/imgui-renderer")
def test_the_panel_lies_over_the_picture_and_goes_when_asked(session):
    def script(run):
        yield from run.rest()
        picture = run.picture()
        assert np.array_equal(run.seen[BESIDE], picture[BESIDE])
        assert (run.seen[10:590, 10:410] != picture[10:590, 10:410]).any(-1).mean() > 0.9
        assert np.array_equal(run.seen[:9], picture[:9])
        run.user.key("F1", True)
        run.user.key("F1", False)
        yield from run.rest()
        assert np.array_equal(run.seen, picture)
        run.user.key("TAB", True)
        yield from run.rest()
        assert not np.array_equal(run.seen, picture)
        yield "end"

    assert session(script).figures.drawn == 2, "the panel needs no frame of the scene"


def test_a_user_changes_a_knob_and_the_picture_changes(session):
    def script(run):
        yield from run.rest()
        loop, before, picture = run.loop, run.loop.renderer, run.picture()
        pose, at = loop.camera.positioner.world_from_view, loop.time
        yield from run.click(*run.at("subject shading", 0.1))
        yield from run.rest()
        x, y = run.at("set background", 0.25)
        run.user.move(x, y)
        yield
        run.user.button(1, True, x, y)
        for step in range(1, 6):
            run.user.move(x + 8 * step, y)
            yield
        assert loop.renderer is before, "only when the slider is let go"
        run.user.button(1, False, x + 40, y)
        while loop.renderer is before:
            yield
        run.user.move(600, 580)  # the tooltip goes
        yield from run.rest()
        assert loop.renderer.settings.shading.background > before.settings.shading.background
        others = replaced(loop.renderer.settings, background=before.settings.shading.background)
        assert others == before.settings
        assert np.array_equal(loop.camera.positioner.world_from_view, pose) and loop.time >= at
        changed = (run.seen[BESIDE] != picture[BESIDE]).any(-1)
        assert 0.2 < changed.mean() < 1.0, "the background, and nothing else"
        assert np.array_equal(run.seen[BESIDE], run.picture()[BESIDE])
        yield "end"

    session(script)


@pytest.mark.feature("ui/input-routing")
def test_the_mouse_in_the_panel_moves_no_camera(session):
    def script(run):
        yield from run.rest()
        positioner = run.loop.camera.positioner
        pose = positioner.world_from_view
        for start, moves in (((200, 560), False), ((500, 300), True)):
            run.user.move(*start)
            yield
            run.user.button(1, True, *start)
            yield
            run.user.move(start[0] + 90, start[1] + 10)
            yield
            run.user.button(4, True)
            yield
            run.user.button(1, False, start[0] + 90, start[1] + 10)
            yield from run.rest()
            assert np.array_equal(positioner.world_from_view, pose) != moves
        yield "end"

    session(script)


def test_a_screenshot_has_the_picture_and_not_the_panel(session, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def script(run):
        yield from run.rest()
        yield from run.click(*run.at("screenshot"))
        yield from run.rest()
        (path,) = (tmp_path / "out").iterdir()
        assert np.array_equal(read_image(path), run.picture())
        assert path.name in run.loop.message
        yield "end"

    session(script)


def test_without_the_package_the_window_opens_all_the_same(session, monkeypatch):
    monkeypatch.setitem(sys.modules, "imgui_bundle", None)
    assert "--extras" in panel_help()

    def script(run):
        run.user.key("F1", True)
        yield from run.rest()
        assert run.loop.panel is None
        assert np.array_equal(run.seen, run.picture())
        yield "end"

    session(script)


@pytest.mark.feature("tools/frame")
def test_the_window_stops_after_any_pass(session, tmp_path, monkeypatch):
    monkeypatch.chdir(tmp_path)

    def stop(run, name):
        run.loop.panel.frame = lambda *arguments: run.asked.pop() if run.asked else usual(*arguments)
        usual = type(run.loop.panel).frame.__get__(run.loop.panel)
        run.asked = [PanelActions(stop_after=name)]
        run.windows[0].damaged = True
        run.loop._panel_due = True
        while run.loop.stop.after != name:
            yield
        yield from run.rest()

    def script(run):
        yield from run.rest()
        whole = run.seen
        for name in ("instance_id", "tonemap"):
            yield from stop(run, name)
            picture = run.loop.stop.picture
            assert np.array_equal(run.seen[BESIDE], picture[BESIDE])
            if name == "tonemap":
                assert np.array_equal(picture, run.picture())
            else:
                assert not np.array_equal(picture, run.picture())
            assert len(np.unique(picture.reshape(-1, 3), axis=0)) > 1
        assert run.loop.renderer.inspection.names
        yield from run.click(*run.at("screenshot"))
        yield from run.rest()
        (path,) = (tmp_path / "out").iterdir()
        assert np.array_equal(read_image(path), run.loop.stop.picture)
        yield from stop(run, "")
        assert run.loop.renderer.inspection.names == ()
        assert np.array_equal(run.seen[BESIDE], whole[BESIDE])
        yield "end"

    session(script)


@pytest.mark.alone
@pytest.mark.feature("tools/frame", "frame-graph/node-enable")
def test_passes_are_switched_resources_shown_and_the_graphs_file_followed(session, tmp_path):
    file = tmp_path / "own.json"
    deferred, forward = (
        json.dumps({"passes": [{"pass": name} for name in names]})
        for names in (("gbuffer", "lighting", "transparent", "tonemap"), ("forward", "tonemap"))
    )
    file.write_text(deferred)
    settings = chapters.settings_class(4)(graph=str(file), anisotropy=1.0)

    def script(run):
        yield from run.rest()
        picture, renderer = run.picture(), run.loop.renderer
        before = [one.name for one in renderer.passes]
        yield from run.click(*run.at("Frame graph"))
        yield from run.rest()
        yield from run.click(*run.at("resource gbuffer_base_color"))
        yield from run.rest()
        assert run.loop.renderer is renderer, "nothing is opened anew for it"
        shown = run.loop.stop.picture
        assert np.array_equal(run.seen[BESIDE], shown[BESIDE]) and not np.array_equal(shown, picture)
        yield from run.click(*run.at("resource gbuffer_base_color"))
        run.user.move(5, 5)  # a tooltip would lie over the picture
        yield from run.rest()
        assert run.loop.stop.resource == "" and np.array_equal(run.seen[BESIDE], picture[BESIDE])
        yield from run.click(*run.at("pass lighting", 0.05))
        yield from run.rest()
        assert "'lighting'" in run.loop._graph.refused and run.loop.renderer.switches["lighting"]
        took = []
        while once_more(took, 1.0):
            for text, names in [(deferred, before)] * bool(took) + [(forward, ["forward", "tonemap"])]:
                file.write_text(text)
                began = time.monotonic()
                while [one.name for one in renderer.passes] != names:
                    yield
            took.append(time.monotonic() - began)
        assert min(took) < 1.0, took
        assert "own.json: another graph in" in run.loop.message
        assert run.loop._graph.refused == "", "the refusal of a switch ends with the graph that refused it"
        file.write_text("{")
        while not run.loop._live.error:
            yield
        assert "own.json:1:2: this is no JSON" in run.loop._live.error
        # Other settings go on with the graph that was good.
        run.loop._change_settings(replaced(settings, ambient=0.5))
        assert [one.name for one in run.loop.renderer.passes] == ["forward", "tonemap"]
        yield "end"

    session(script, settings=settings, chapter=4)


def test_a_knob_is_turned_against_the_frozen_picture(session):
    """Left of the wipe the window shows the picture from before, right of it the one that the knob makes."""

    def script(run):
        yield from run.rest()
        before = run.picture()
        run.loop.press("R")
        run.loop._change_settings(replaced(run.loop.renderer.settings, background=0.5))
        run.loop.reference.wipe(0.8)
        yield from run.rest()
        after = run.picture()
        state = run.loop.reference.state
        difference = np.abs(after.astype(int) - before).max(axis=-1)
        assert (state.largest, state.changed) == (difference.max(), (difference > 0).mean())
        assert 0 < state.changed < 1
        at = round(0.8 * SIZE[0])
        left, right = np.s_[580:, 420 : at - 2], np.s_[580:, at + 2 :]
        assert np.array_equal(run.seen[left], before[left]) and not np.array_equal(
            run.seen[left], after[left]
        )
        assert np.array_equal(run.seen[right], after[right])
        run.loop.reference.drop()
        run.loop._panel_due = True
        yield from run.rest()
        assert np.array_equal(run.seen[left], after[left])
        yield "end"

    session(script)
