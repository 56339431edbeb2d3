"""The picture in a window: upright, with its own codes, in any size; and a context that a window has made."""

from __future__ import annotations

import numpy as np
import pytest

from backends.gl.context import Context
from backends.gl.readback import read_image
from backends.gl.resources import create_image, destroy_image, write_image
from backends.gl.targets import create_framebuffer, destroy_framebuffer
from backends.gl.window import present
from common.errors import UnsupportedError
from tests.support.display import screenshot, shows, virtual_display
from tests.support.gl_functions import assert_silent

SIZE = (40, 24)


def picture() -> np.ndarray:
    """Return (24, 40, 4) codes whose corners all differ."""
    codes = np.full((SIZE[1], SIZE[0], 4), 255, np.uint8)
    codes[..., 0] = np.linspace(0, 255, SIZE[0], dtype=np.uint8)[None]
    codes[..., 1] = np.linspace(0, 255, SIZE[1], dtype=np.uint8)[:, None]
    codes[..., 2] = 188
    return codes


def test_the_blit_turns_the_picture_over_and_keeps_its_codes(gl_context):
    """Also into a target that codes sRGB, as the framebuffer of a window may."""
    for format in ("rgba8", "rgba8_srgb"):
        source = create_image(gl_context, "rgba8", SIZE, "picture")
        target = create_image(gl_context, format, SIZE, "window")
        made = [create_framebuffer(gl_context, [image], None, image.name) for image in (source, target)]
        write_image(gl_context, source, picture())
        present.blit(gl_context, *made)
        assert np.array_equal(read_image(gl_context, target), picture()[::-1])
        for framebuffer in made:
            destroy_framebuffer(gl_context, framebuffer)
        for image in (source, target):
            destroy_image(gl_context, image)


@pytest.mark.feature("device/screenshot")
def test_a_window_shows_the_picture_upright(gl_context):
    """Beside a context without a window: GLX would end the process if that one still held the thread."""
    with virtual_display() as display, present.open_window(SIZE, "a test") as window:
        try:
            context = Context(validate=True, window=window.handle)
        except UnsupportedError as error:
            pytest.skip(f"no OpenGL 4.5 in a window here: {error}")
        with context:
            image = create_image(context, "rgba8", SIZE, "picture")
            framebuffer = create_framebuffer(context, [image], None, "picture")
            write_image(context, image, picture())
            for size in ((0, 0), window.size):  # minimised: nothing happens
                window.poll()
                present.present(context, framebuffer, window.handle, size)
            context.wait_idle()
            assert shows(display, picture()[..., :3])
            window.resize((80, 48))
            for _ in range(20):
                window.wait(0.02)
                if window.size == (80, 48):
                    break
            present.present(context, framebuffer, window.handle, window.size)
            context.wait_idle()
            larger = screenshot(display, (80, 48)).astype(int)
            assert np.abs(larger[0::2, 0::2] - picture()[..., :3]).max() <= 12
            destroy_framebuffer(context, framebuffer)
            destroy_image(context, image)
            assert_silent(context)
    gl_context.make_current()
    gl_context.destroy("buffer", gl_context.create("buffer", "made after the window"))
