"""The study dynamic-resolution in a window, which tells the renderer how long frames take."""

from __future__ import annotations

from functools import partial

import pytest

import chapters
from backends.gl.context import Context
from backends.vulkan.instance import VALIDATION_LAYER, Instance
from chapters.ch11.studies.dynamic_resolution import Settings
from chapters.ch11.studies.dynamic_resolution.controller import WINDOW
from common.errors import UnsupportedError
from tests.support.display import shows, virtual_display
from tests.support.shadows import PLAIN
from tests.support.taa import court
from tools.run.pacing import LATENCY
from tools.window.window import run_window

SIZE = (96, 64)


@pytest.fixture(scope="module", params=("vulkan", "gl"))
def backend(request):
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


def test_a_window_chooses_the_scale_and_shows_each_picture_of_it(backend):
    """No frame holds a hundredth of a millisecond: the smallest scale follows the largest after the first decision."""
    name, display, validate = backend
    numbers, shown, work = [], {}, []

    def act(renderer, frame):
        numbers.append(renderer.number)
        work.append(frame.work)
        if len(numbers) in (2, WINDOW + LATENCY, WINDOW + LATENCY + 1, WINDOW + LATENCY + 3):
            picture = frame.image("color")
            if name == "vulkan":
                renderer.device.wait_idle()
            shown[len(numbers)] = picture.std() > 1 and shows(display, picture)

    settings = Settings(**PLAIN, shadows="off", target_ms=0.01)
    figures = run_window(
        partial(chapters.open, "11/dynamic-resolution", name, scene=court()),
        size=SIZE,
        title="a study",
        validate=validate,
        backend=name,
        outputs={"color"},
        settings=settings,
        on_frame=act,
        frames=WINDOW + LATENCY + 5,
        panel=False,
    )
    assert (figures.drawn, figures.messages) == (WINDOW + LATENCY + 5, [])
    first = WINDOW + LATENCY - 1
    assert numbers == [7] * (first + 0) + [0] * (len(numbers) - first)
    assert [it["history_resets"] for it in work] == [1] + [0] * (len(work) - 1)
    assert shown and all(shown.values()), shown
