"""The loop of `strata run N` with a display: what it draws, what it leaves out, and how it ends."""

from __future__ import annotations

import subprocess
import sys
import time
from functools import partial
from types import SimpleNamespace

import numpy as np
import pytest

import chapters
from backends.vulkan.instance import VALIDATION_LAYER, Instance
from common.errors import UnsupportedError
from common.paths import ROOT
from common.scene import Light, Material
from common.settings import flat
from common.view.camera import Camera, Perspective
from common.view.inputs import Inputs
from common.view.positioners import FirstPerson, Orbit
from tests.support.display import User, shows, virtual_display
from tests.support.scenes import quad_scene, translated
from tools.window.camera import open_camera
from tools.window.keys import BINDINGS, HELP
from tools.window.window import IDLE_WAIT_S, MINIMISED_WAIT_S, Loop, run_window

STEP_NS = 10_000_000


# --- the loop alone, with a window and a renderer that only take notes ------------------------------------------------


class FakeWindow:
    """A window whose user follows a script: what happens at which look for events."""

    def __init__(self, script=None):
        self.inputs = Inputs(bindings=BINDINGS)
        self.damaged, self.minimised, self.closing = True, False, False
        self.size, self.script, self.polls = (64, 32), script or {}, 0
        self.keys, self.waits, self.titles = [], [], []
        self.now_ns = 0

    def poll(self):
        self.now_ns += STEP_NS
        for act in self.script.get(self.polls, ()):
            act(self)
        self.polls += 1
        if self.polls > 200:
            pytest.fail("the loop does not end")

    def wait(self, timeout):
        self.waits.append(timeout)
        self.now_ns += int(timeout * 1e9)

    def take_keys(self):
        keys, self.keys = self.keys, []
        return keys

    def request_close(self):
        self.closing = True

    def set_title(self, title):
        self.titles.append(title)


class FakeRenderer:
    """A renderer of a scene that stands still, or moves."""

    def __init__(self, moves=False):
        self.scene = quad_scene()
        self.size, self.moves = (64, 32), moves
        self.views, self.times, self.sizes = [], [], []
        self.last = None

    def render(self, view, time):
        self.views.append(view)
        self.times.append(time)
        self.last = (view, time if self.moves else 0.0)
        return SimpleNamespace(timings={"forward": 3.0, "tonemap": 1.5}, cpu_ms=0.5)

    def idle(self, view, time):
        return self.last == (view, time if self.moves else 0.0)

    def resize(self, size):
        self.size, self.last = size, None
        self.sizes.append(size)


class FakeScreen:
    def __init__(self, *answers):
        self.answers, self.shown = list(answers), 0

    def show(self, renderer):
        self.shown += 1
        return self.answers.pop(0) if self.answers else True


def press(*keys):
    def act(window):
        for key in keys:
            window.keys.append(key)

    return act


def hold(key, down):
    return lambda window: window.inputs.key(key, down)


def close(window):
    window.closing = True


def play(script=None, moves=False, frames=None, screen=None, renderer=None):
    """Run the loop on a script, 10 ms from look to look; return window, renderer, screen and loop after its end."""
    window, renderer, screen = FakeWindow(script), renderer or FakeRenderer(moves), screen or FakeScreen()
    camera = Camera(FirstPerson.at(np.eye(4)), Perspective())
    loop = Loop(window, screen, renderer, camera, "Strata", timer_ns=lambda: window.now_ns)
    loop.run(frames)
    return window, renderer, screen, loop


def test_a_picture_that_would_be_the_same_is_not_drawn():
    window, renderer, screen, loop = play({20: [close]})
    assert len(renderer.views) == 2, "the first view is marked as a cut, the second is not"
    assert loop.figures.idle == 18
    assert window.waits == [IDLE_WAIT_S] * 18
    assert screen.shown == 2
    assert "nothing moves" in window.titles[-1]
    assert len(window.titles) == len(set(window.titles)), (
        "a title is an event, which would end the next sleep"
    )


def test_a_damaged_window_is_shown_the_same_picture_again():
    def damage(window):
        window.damaged = True

    window, renderer, screen, _ = play({10: [damage], 20: [close]})
    assert (len(renderer.views), screen.shown) == (2, 3)
    assert not window.damaged


def test_a_picture_that_the_display_did_not_take_is_shown_later():
    _, renderer, screen, loop = play({20: [close]}, screen=FakeScreen(True, False, False))
    assert (len(renderer.views), screen.shown, loop.figures.shown) == (2, 4, 2)


def test_a_fixed_number_of_frames_is_drawn_in_any_case():
    window, renderer, _, loop = play(frames=30)
    assert len(renderer.views) == loop.figures.drawn == 30
    assert window.waits == []


def test_time_is_the_clocks_and_space_stops_it():
    _, renderer, _, _ = play({5: [press("SPACE")], 10: [press("SPACE")], 15: [close]}, moves=True)
    expected = [0.01, 0.02, 0.03, 0.04, 0.05, 0.06, 0.07, 0.08, 0.09, 0.10]
    assert np.allclose(renderer.times, expected, rtol=0, atol=1e-12)


def test_a_minimised_window_draws_nothing_and_lets_no_time_pass():
    def minimise(window):
        window.minimised, window.size = True, (0, 0)

    def restore(window):
        window.minimised, window.size, window.damaged = False, (64, 32), True

    window, renderer, _, _ = play({3: [minimise], 9: [restore], 12: [close]}, moves=True)
    assert np.allclose(renderer.times, [0.01, 0.02, 0.03, 0.04, 0.05, 0.06])
    assert window.waits == [MINIMISED_WAIT_S] * 6
    assert renderer.sizes == []


def test_another_size_reaches_the_renderer_before_the_next_frame():
    def grow(window):
        window.size = (128, 96)

    window, renderer, _, _ = play({6: [grow], 12: [close]})
    assert renderer.sizes == [(128, 96)]
    assert len(renderer.views) == 3
    assert "128x96" in window.titles[-1]


@pytest.mark.parametrize("end", [close, press("ESCAPE")])
def test_nothing_is_drawn_after_the_end(end):
    _, renderer, _, _ = play({4: [end]}, moves=True)
    assert len(renderer.views) == 4


def test_a_held_key_flies_as_far_as_the_camera_says_however_long_nothing_moved_before():
    script = {8: [hold("W", True)], 12: [hold("W", False)], 13: [close]}
    _, renderer, _, _ = play(script)
    alone, inputs = FirstPerson.at(np.eye(4)), Inputs()
    inputs.key("W", True)
    for _ in range(4):
        alone.update(STEP_NS * 1e-9, inputs)
    assert np.allclose(renderer.views[-2].eye, alone.position, rtol=0, atol=1e-12)
    assert alone.position[2] < -0.05


def test_a_frame_that_takes_long_is_no_jump():
    renderer = FakeRenderer()
    ticks = iter([0, 0, 10_000_000_000, 20_000_000_000])
    window = FakeWindow({0: [hold("W", True)]})
    camera = Camera(FirstPerson.at(np.eye(4)), Perspective())
    Loop(window, FakeScreen(), renderer, camera, "Strata", timer_ns=lambda: next(ticks)).run(2)
    assert -2.0 < renderer.views[-1].eye[2] < 0.0
    assert renderer.times[-1] == 20.0, "the scene's time is the clock's"


@pytest.mark.feature("camera/facade")
def test_c_changes_the_camera_and_keeps_its_place():
    _, renderer, _, loop = play({4: [press("C")], 8: [press("C")], 10: [press("C")], 12: [close]})
    assert isinstance(loop.camera.positioner, Orbit)
    for view in renderer.views:
        assert np.allclose(view.world_from_view, np.eye(4), atol=1e-12)
    assert [view.cut for view in renderer.views] == [True, False] * 4


def test_a_scene_with_a_camera_is_flown_through_and_one_without_is_turned():
    renderer = FakeRenderer()
    turned = open_camera(renderer, None, 0.0).positioner
    assert isinstance(turned, Orbit)
    assert np.allclose(turned.target, renderer.scene.bounds.mean(axis=0))
    flown = open_camera(renderer, "0,0,5:0,0,0", 0.0).positioner
    assert isinstance(flown, FirstPerson)
    assert flown.unit * flown.max_speed == pytest.approx(renderer.scene.length_scale)


def test_the_title_says_how_fast_it_is():
    window, *_ = play({120: [close]}, moves=True)
    assert window.titles[-1] == "Strata | 64x32 | 100 frames/s, GPU 4.5 ms, CPU 0.5 ms"


def test_a_key_freezes_culling_where_there_is_any():
    """The knob of the open renderer changes, and nothing is opened anew."""
    for number, steps in ((1, [None, None, None]), (6, [False, True, False])):
        renderer = FakeRenderer()
        renderer.settings = chapters.settings_class(number)()
        frozen = []

        def note(_window, settings=renderer.settings, frozen=frozen):
            frozen.append(flat(settings).get("culling_frozen"))

        play({1: [note, press("K")], 3: [note, press("K")], 5: [note, close]}, renderer=renderer)
        assert frozen == steps


def test_every_key_of_the_loop_is_in_the_help_and_moves_no_camera():
    for key, said in (
        *(("C", "C to change"), ("SPACE", "space to stop"), ("ESCAPE", "Esc to close")),
        ("K", "K to freeze culling"),
    ):
        assert said in HELP
        assert key not in BINDINGS


@pytest.mark.feature("app/application-loop")
def test_a_subclass_runs_its_frames_without_a_display_and_leaves_nothing(either_device):
    """Five frames of a renderer on a real device, in a window that only takes notes."""
    device = either_device
    before = {key: name for key, name in device.alive.items() if key[0] != "VkDeviceMemory"}
    module = chapters.renderer_module(1, device.capabilities.backend)

    class Demo(module.Renderer):
        frames = 0

        def render(self, view, time=0.0):
            self.frames += 1
            return super().render(view, time)

    window, pictures = FakeWindow(), []
    camera = Camera(FirstPerson.at(translated(z=2.0)), Perspective())
    scene = quad_scene(Material(unlit=True, base_color=(1.0, 0.0, 0.0, 1.0)))
    with Demo(scene, window.size, device=device) as demo:
        loop = Loop(
            window,
            FakeScreen(),
            demo,
            camera,
            "Demo",
            timer_ns=lambda: window.now_ns,
            on_frame=lambda renderer, frame: pictures.append(frame.image("color")),
        )
        figures = loop.run(5)
        assert {key for key in device.alive if key[0] != "VkDeviceMemory"} > {*before}
    assert (figures.drawn, figures.shown, figures.idle, demo.frames) == (5, 5, 0, 5)
    red, green, blue = pictures[0][16, 32].tolist()
    assert red > 200 and max(green, blue) < 100, "the square is seen"
    assert len(pictures) == 5 and all(np.array_equal(one, pictures[0]) for one in pictures)
    assert {key: name for key, name in device.alive.items() if key[0] != "VkDeviceMemory"} == before


# --- a real window ----------------------------------------------------------------------------------------------------


@pytest.fixture(scope="module")
def display():
    with virtual_display() as name:
        try:
            with Instance() as instance:
                fit = [found for found in instance.devices() if found.unfit() is None]
        except UnsupportedError as error:
            pytest.skip(f"no Vulkan: {error}")
        if not fit:
            pytest.skip("no Vulkan 1.3 device")
        yield name


@pytest.fixture(scope="module")
def validate(display):
    with Instance() as instance:
        return VALIDATION_LAYER in instance.layers


def opener():
    sun = Light("directional", node=0, intensity=np.pi)
    scene = quad_scene(Material(metallic=0.0, roughness=1.0), lights=(sun,))
    return partial(chapters.open, 1, scene=scene)


SHOWN = {"size": (96, 64), "title": "Strata 1"}


@pytest.mark.feature("app/application-loop")
def test_frames_are_shown_and_everything_is_closed_without_a_message(display, validate):
    devices = []

    def note(renderer, frame):
        devices.append(renderer.device)

    figures = run_window(opener(), **SHOWN, frames=30, validate=validate, on_frame=note)
    assert (figures.drawn, figures.shown, figures.messages) == (30, 30, [])
    assert len(devices) == 30
    assert devices[0].alive == {}


def test_what_can_be_read_is_what_is_seen(display):
    shown = []

    def note(renderer, frame):
        picture = frame.image("color")
        renderer.device.wait_idle()
        shown.append((picture.std() > 10, shows(display, picture)))

    run_window(opener(), **SHOWN, frames=6, outputs={"color"}, on_frame=note)
    assert shown == [(True, True)] * 6


def test_the_user_resizes_and_closes_while_it_runs(display, validate, monkeypatch):
    sizes = [(120, 90), (60, 80), (97, 65), (33, 21), (200, 150)]
    seen, windows = [], catch_windows(monkeypatch)

    def act(renderer, frame):
        if renderer.size not in seen:
            seen.append(renderer.size)
        if len(seen) <= len(sizes):
            windows[0].resize(sizes[len(seen) - 1])
        else:
            User(windows[0]).close()

    run = run_window(moving(opener()), **SHOWN, validate=validate, on_frame=act)
    assert seen == [(96, 64), *sizes]
    assert run.messages == []


def catch_windows(monkeypatch):
    """Return a list to which every window that is opened is added."""
    from tools.window import opening as module

    made = []
    monkeypatch.setattr(module, "Window", windows_of(module.Window, made))
    return made


def moving(open_renderer):
    """Return an opener whose renderer never says that nothing changed, and ends a loop that does not end."""

    def opened(**options):
        renderer = open_renderer(**options)
        looks = iter(range(500))
        renderer.idle = lambda view, time: next(looks) < 0
        return renderer

    return opened


def test_an_idle_window_sleeps(display, monkeypatch):
    """With a real window: whatever the loop does between two sleeps is no event that would end the next one."""
    windows, waits = catch_windows(monkeypatch), []
    real = Loop._sleep

    def sleep(loop, seconds):
        began = time.monotonic()
        real(loop, seconds)
        waits.append(time.monotonic() - began)
        if len(waits) == 5:
            windows[0].request_close()

    monkeypatch.setattr(Loop, "_sleep", sleep)
    figures = run_window(opener(), **SHOWN)
    assert (figures.drawn, figures.shown >= 2) == (2, True)
    assert max(waits) >= 0.9 * IDLE_WAIT_S
    assert sum(waits) >= 2 * IDLE_WAIT_S


def test_escape_and_c_reach_the_loop(display, monkeypatch):
    windows, cameras = catch_windows(monkeypatch), []

    def act(renderer, frame):
        cameras.append(frame.index)
        user = User(windows[0])
        user.key("C" if len(cameras) < 3 else "ESCAPE", True)

    figures = run_window(moving(opener()), **SHOWN, on_frame=act)
    assert figures.drawn == 3


@pytest.mark.feature("app/application-loop")
@pytest.mark.feature("device/lifetime-and-leaks")
@pytest.mark.parametrize("error", [ValueError("in the middle"), KeyboardInterrupt()])
def test_an_exception_in_a_frame_closes_everything(display, validate, error):
    kept = []

    def fail(renderer, frame):
        kept.append(renderer.device)
        raise error

    with pytest.raises(type(error)):
        run_window(opener(), **SHOWN, validate=validate, on_frame=fail)
    assert kept[0].alive == {}
    assert kept[0].sink.report() == []


def test_a_chapter_that_does_not_open_leaves_no_window(display):
    from backends import window as module

    def refuse(**options):
        raise UnsupportedError("not here")

    with pytest.raises(UnsupportedError, match="not here"):
        run_window(refuse, **SHOWN)
    assert module._open == 0


@pytest.mark.parametrize("backend", ["vulkan", pytest.param("gl", marks=pytest.mark.needs("moderngl"))])
def test_a_window_that_another_program_destroys_ends_the_loop_with_a_sentence(display, monkeypatch, backend):
    windows, kept = catch_windows(monkeypatch), []
    if backend == "gl":
        from backends.gl.window import present

        monkeypatch.setattr(present, "Window", windows_of(present.Window, windows))

    def act(renderer, frame):
        kept.append(renderer.device)
        User(windows[0]).destroy()

    open_renderer = partial(moving(opener()), backend=backend)
    with pytest.raises(UnsupportedError, match="another program destroyed it"):
        run_window(open_renderer, **SHOWN, on_frame=act, backend=backend)
    assert kept[0].alive == {}


def windows_of(real, made):
    """Return what opens a window as `real` does, and adds it to `made`."""

    def opened(*arguments, **options):
        made.append(real(*arguments, **options))
        return made[-1]

    return opened


DIES = """
from functools import partial
import chapters
from tools.window.window import run_window
from tests.support.scenes import quad_scene

def say(renderer, frame):
    print("drawn", flush=True)

open_renderer = partial(chapters.open, 1, {backend!r}, scene=quad_scene())
run_window(open_renderer, size=(32, 32), title="a", on_frame=say, backend={backend!r})
"""


@pytest.mark.parametrize("backend", ["vulkan", pytest.param("gl", marks=pytest.mark.needs("moderngl"))])
def test_a_display_that_dies_is_one_sentence(display, backend):
    with virtual_display():
        process = subprocess.Popen(
            [sys.executable, "-c", DIES.format(backend=backend)],
            cwd=ROOT,
            stdout=subprocess.PIPE,
            stderr=subprocess.PIPE,
            text=True,
        )
        assert process.stdout is not None and process.stdout.readline() == "drawn\n"
    _, err = process.communicate(timeout=20)
    assert process.returncode == 2
    assert err == "strata: The display closed the connection, and the window with it.\n"
