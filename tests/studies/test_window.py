"""A study in a window: drawn while it moves, left alone while it does not, closed by Escape."""

from __future__ import annotations

from functools import partial
from importlib.util import find_spec

import pytest

import chapters
from backends.gl.context import Context
from backends.vulkan.instance import VALIDATION_LAYER, Instance
from chapters import studies
from chapters.ch11.studies.hdr_swapchain import Settings
from chapters.ch11.studies.hdr_swapchain.gl import WINDOW
from chapters.ch11.studies.hdr_swapchain.vulkan_surface import SRGB
from common.errors import UnsupportedError
from tests.support.display import User, shows, virtual_display
from tools.window.window import run_window

SIZE = (96, 64)
HDR = "11/hdr-swapchain"


@pytest.fixture(scope="module", params=("vulkan", "gl"))
def backend(request):
    """Each backend that this machine has, with a display."""
    try:
        if request.param == "gl":
            Context().close()
            validate = False
        else:
            with Instance() as instance:
                validate = VALIDATION_LAYER in instance.layers
                if not [found for found in instance.devices() if found.unfit() is None]:
                    pytest.skip("no Vulkan 1.3 device")
    except UnsupportedError as error:
        pytest.skip(str(error))
    with virtual_display() as display:
        yield request.param, display, validate


def opener(which: str, backend: str):
    return partial(chapters.open, which, backend, scene=studies.load(which, None))


@pytest.mark.feature("intro/first-triangle")
def test_escape_closes_the_window_of_a_study(backend, monkeypatch):
    from backends.gl.window import present
    from tools.window import opening as module

    name, _, validate = backend
    made, seen = [], []
    home = module if name == "vulkan" else present
    real = home.Window
    monkeypatch.setattr(home, "Window", lambda *a, **k: made.append(real(*a, **k)) or made[-1])

    def act(renderer, frame):
        seen.append(renderer.device)
        if len(seen) == 3:
            User(made[0]).key("ESCAPE", True)

    figures = run_window(
        opener("1/clear-window", name),
        size=SIZE,
        title="a study",
        validate=validate,
        backend=name,
        on_frame=act,
        frames=50,
    )
    assert figures.drawn == 3
    assert figures.messages == []
    assert seen[0].alive == {}


def test_the_window_shows_what_can_be_read(backend):
    name, display, _ = backend
    shown = []

    def act(renderer, frame):
        picture = frame.image("color")
        renderer.device.wait_idle()
        shown.append((picture.std() > 10, shows(display, picture)))

    figures = run_window(
        opener("1/first-triangle", name),
        size=SIZE,
        title="a study",
        backend=name,
        outputs={"color"},
        on_frame=act,
        frames=5,
    )
    assert figures.drawn == 5
    assert shown == [(True, True)] * 5


def test_the_panel_shows_the_knobs_of_a_study(backend):
    if find_spec("imgui_bundle") is None:  # not imported here: that sets a variable of the process
        pytest.skip("the panel needs imgui-bundle, of the extra ui")
    name, _, validate = backend
    figures = run_window(
        opener("1/one-light", name),
        size=(400, 300),
        title="a study",
        validate=validate,
        backend=name,
        frames=3,
        panel=True,
    )
    assert (figures.drawn, figures.messages) == (3, [])


@pytest.mark.parametrize("encoding", ["auto", "hdr10"])
def test_a_window_of_8_bits_says_that_it_has_no_high_dynamic_range(backend, encoding):
    """The X server and the software drivers offer sRGB only. With `auto` the window shows the sRGB signal."""
    name, display, validate = backend
    shown, own = [], studies.display(HDR, name)
    scene = studies.load(HDR, None)

    def act(renderer, frame):
        signal = frame.image("encoded")[..., :3] if encoding == "auto" else frame.image("color")
        if name == "vulkan":
            renderer.device.wait_idle()
        shown.append((renderer.encoding, signal.std() > 10, shows(display, signal)))

    figures = run_window(
        partial(chapters.open, HDR, name, scene=scene),
        size=SIZE,
        title="a study",
        validate=validate,
        backend=name,
        display=own,
        outputs={"color", "encoded"},
        settings=Settings(encoding=encoding),
        on_frame=act,
        frames=5,
        panel=False,
    )
    assert (figures.drawn, figures.messages) == (5, [])
    if name == "vulkan":
        assert own.surface.encoding == "srgb" and own.surface.space == SRGB
        assert scene.warnings == [own.surface.sentence] and "neither HDR10 nor scRGB" in own.surface.sentence
    else:
        assert own is None and scene.warnings == [WINDOW]
    assert shown == [("srgb" if encoding == "auto" else "hdr10", True, True)] * 5
