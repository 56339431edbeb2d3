"""Window sizes in pixels and per cent."""

from __future__ import annotations

import pytest

from common.errors import UserError
from common.view.windows import window_size

MONITOR = (1920, 1080)


@pytest.mark.feature("app/percent-window-size")
@pytest.mark.parametrize(
    ("asked", "size"),
    [
        ((1280, 720), (1280, 720)),
        ((-80, -50), (1536, 540)),
        ((-100, 720), (1920, 720)),
        ((5000, -1), (5000, 10)),
    ],
)
def test_pixels_and_per_cent(asked, size):
    assert window_size(asked, MONITOR) == size


def test_a_window_has_a_pixel_at_least():
    assert window_size((-1, -1), (50, 50)) == (1, 1)


@pytest.mark.feature("app/percent-window-size")
@pytest.mark.parametrize(("asked", "name"), [((0, 720), "width is 0"), ((1280, -101), "height is -101")])
def test_refused(asked, name):
    with pytest.raises(UserError, match=name):
        window_size(asked, MONITOR)
