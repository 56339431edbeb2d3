"""The window without anything drawn in it: events of a real X server, sizes, and places where no window can be."""

from __future__ import annotations

import numpy as np
import pytest

from backends import window as module
from backends.window import Event, Window, display_available
from common.errors import UnsupportedError
from common.view.camera import Camera, Perspective
from common.view.inputs import Action, Inputs
from common.view.positioners import FirstPerson
from tests.support.display import User, virtual_display


@pytest.fixture(scope="module")
def display():
    with virtual_display() as name:
        yield name


@pytest.fixture
def window(display):
    with Window((200, 100), "a test") as made:
        yield made


@pytest.fixture
def user(window):
    return User(window)


# --- where there is no display ----------------------------------------------------------------------------------------


@pytest.fixture
def nowhere(monkeypatch):
    for name in ("DISPLAY", "WAYLAND_DISPLAY"):
        monkeypatch.delenv(name, raising=False)
    monkeypatch.setattr(module.sys, "platform", "linux")


@pytest.mark.parametrize(
    ("display", "said"), [(None, "neither DISPLAY nor WAYLAND_DISPLAY is set"), (":987", ":987")]
)
def test_without_a_display_nothing_is_printed_and_the_error_says_what_to_do(
    nowhere, monkeypatch, capfd, recwarn, display, said
):
    if display:
        pytest.importorskip("glfw", reason="without GLFW that is what the error names")
        monkeypatch.setenv("DISPLAY", display)
    assert not display_available()
    with pytest.raises(UnsupportedError, match="run with --headless") as caught:
        Window((200, 100), "a test")
    assert said in str(caught.value)
    assert str(caught.value).count(".") == 1
    assert capfd.readouterr() == ("", "")
    assert not recwarn.list


def test_a_display_is_found_and_nothing_stays_open(display, capfd):
    assert display_available()
    assert module._open == 0
    assert capfd.readouterr() == ("", "")


def test_after_a_display_that_failed_another_one_works(display, monkeypatch):
    monkeypatch.setenv("DISPLAY", ":987")
    assert not display_available()
    monkeypatch.setenv("DISPLAY", display)
    with Window((20, 10), "a test") as window:
        assert window.size == (20, 10)


# --- events -----------------------------------------------------------------------------------------------------------


@pytest.mark.feature("camera/input-bindings")
def test_keys_become_actions_and_commands(window, user):
    user.key("W", True)
    user.key("LEFT_SHIFT", True)
    assert window.inputs.actions == Action.FORWARD | Action.FAST
    user.key("W", False)
    assert window.inputs.actions == Action.FAST
    user.key("C", True)
    assert window.take_keys() == ["W", "LEFT_SHIFT", "C"]
    assert window.take_keys() == []


def test_a_held_key_counts_once_and_stays_held(window):
    import glfw

    for action in (glfw.PRESS, glfw.REPEAT, glfw.REPEAT):
        window._on_key(window.handle, glfw.KEY_W, 0, action, 0)
    window._on_key(window.handle, glfw.KEY_UNKNOWN, 0, glfw.PRESS, 0)
    assert window.take_keys() == ["W"]
    assert window.inputs.actions == Action.FORWARD


def test_the_mouse_is_in_fractions_of_the_window(window, user):
    user.move(50, 25)
    assert window.inputs.mouse == (0.25, 0.25)
    assert not window.inputs.dragging
    user.button(1, True, 50, 25)
    assert window.inputs.dragging
    user.button(1, False, 50, 25)
    user.button(3, True, 50, 25)
    assert not window.inputs.dragging
    user.button(4, True)
    user.button(4, True)
    user.button(5, True)
    assert window.inputs.take_scroll() == 1.0


def test_losing_the_focus_lets_go_of_everything(window, user):
    user.focus(True)
    user.key("W", True)
    user.button(1, True)
    user.focus(False)
    assert not window.inputs.actions
    assert not window.inputs.dragging


class Listening:
    """A user interface on the left half of the window, in which something may be typed."""

    def __init__(self):
        self.events, self.typing = [], False

    def event(self, event):
        self.events.append(event)

    def takes_mouse(self, x, y):
        return x < 100

    def takes_keys(self):
        return self.typing


@pytest.mark.feature("ui/input-routing")
def test_what_an_interface_takes_reaches_no_camera(window, user):
    listener = window.listener = Listening()
    user.move(50, 25)
    user.button(1, True, 50, 25)
    assert not window.inputs.dragging
    user.button(1, False, 50, 25)
    user.button(4, True)
    assert window.inputs.take_scroll() == 0.0
    user.move(150, 25)
    user.button(1, True, 150, 25)
    user.button(4, True)
    assert window.inputs.dragging and window.inputs.take_scroll() == 1.0
    user.move(50, 25)
    user.button(1, False, 50, 25)
    assert not window.inputs.dragging, "what is let go is let go everywhere"
    for number, button in ((1, 0), (3, 1), (2, 2)):  # X11 counts left, middle, right
        user.button(number, True)
        assert listener.events[-1] == Event("button", button=button, down=True)
    assert Event("move", 150.0, 25.0) in listener.events


@pytest.mark.feature("ui/input-routing")
def test_keys_that_are_typed_somewhere_are_no_commands(window, user):
    listener = window.listener = Listening()
    user.key("W", True)
    listener.typing = True
    for name in ("C", "ESCAPE", "F1", "LEFT_SHIFT"):
        user.key(name, True)
        user.key(name, False)
    user.key("LEFT_SHIFT", True)
    assert window.take_keys() == ["W", "F1"]
    assert window.inputs.actions == Action.FORWARD
    user.key("W", False)
    user.key("LEFT_SHIFT", False)
    assert not window.inputs.actions
    listener.typing = False
    user.key("C", True)
    user.key("LEFT_SHIFT", True)
    assert window.inputs.actions == Action.FAST
    assert window.take_keys() == ["C", "LEFT_SHIFT"]
    assert Event("key", name="ESCAPE", down=True) in listener.events
    assert Event("text", name="c") in listener.events


@pytest.mark.feature("camera/input-bindings")
def test_events_move_a_camera_as_the_same_inputs_do(window, user):
    """What the user does and what a script writes into `Inputs` end in the same pose."""

    def camera():
        return Camera(FirstPerson.at(np.eye(4)), Perspective())

    seen, scripted, inputs = camera(), camera(), Inputs()
    user.key("W", True)
    user.move(100, 50)
    user.button(1, True, 100, 50)
    seen.advance(0.1, window.inputs)
    user.move(120, 50)
    seen.advance(0.1, window.inputs)
    inputs.key("W", True)
    inputs.dragging = True
    scripted.advance(0.1, inputs)
    inputs.mouse = (0.6, 0.5)
    end = scripted.advance(0.1, inputs)
    view = seen.advance(0.0, window.inputs)
    assert np.array_equal(view.world_from_view, end.world_from_view)
    assert view.eye[2] < -0.1
    assert -view.world_from_view[0, 2] > 0.1, "dragged to the right, it looks to the right"


def test_the_window_closes_when_the_user_says_so(window, user):
    assert not window.closing
    user.close()
    assert window.closing


# --- size -------------------------------------------------------------------------------------------------------------


def test_a_new_size_arrives_with_the_events_and_damages_the_picture(window):
    window.poll()
    window.damaged = False
    window.resize((120, 80))
    for _ in range(50):
        window.wait(0.02)
        if window.size == (120, 80):
            break
    assert window.size == (120, 80)
    assert window.damaged


def test_minimised_is_iconified_or_without_area(window, monkeypatch):
    assert not window.minimised
    window._on_iconify(window.handle, 1)
    assert window.minimised
    window.damaged = False
    window._on_iconify(window.handle, 0)
    assert not window.minimised
    assert window.damaged, "what was hidden is to be drawn again"
    monkeypatch.setattr(Window, "size", (0, 0))
    assert window.minimised


def test_windows_follow_each_other_and_close_twice(display):
    for size in ((30, 20), (50, 40)):
        window = Window(size, "a test")
        with Window((10, 10), "another"):
            assert window.size == size
        assert window.size == size, "the end of one window is not the end of GLFW"
        window.close()
        window.close()
    assert module._open == 0


def test_without_vulkan_the_window_says_so(window, monkeypatch):
    import glfw

    assert "VK_KHR_surface" in window.vulkan_extensions()
    monkeypatch.setattr(glfw, "vulkan_supported", lambda: False)
    with pytest.raises(UnsupportedError, match="Vulkan cannot draw to this display"):
        window.vulkan_extensions()
