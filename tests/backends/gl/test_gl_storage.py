"""Memory that OpenGL refuses: the calls that ask for it return nothing, and so the driver is asked. And long copies."""

from __future__ import annotations

import numpy as np
import pytest

from backends.gl import api as gl
from backends.gl import readback, storage
from backends.gl.context import Context
from backends.gl.readback import Fence, Readback, read_image
from backends.gl.resources import create_buffer, create_image, destroy_image, write_image
from common.errors import DeviceError

pytestmark = pytest.mark.feature("device/lifetime-and-leaks")


def a_buffer(context):
    return create_buffer(context, 1 << 20, "device", "refused")


def an_image(context):
    return create_image(context, "rgba8", (64, 32), "refused")


@pytest.fixture
def unchecked(gl_context):
    """A context whose calls are not checked, as those of a user; `gl_context` skips it where there is none."""
    with Context() as context:
        yield context


@pytest.mark.parametrize(
    ("make", "what"), [(a_buffer, "'refused', 1.0"), (an_image, "'refused' of 64x32 pixels, 0.0")]
)
def test_refused_memory_is_an_error_where_calls_are_not_checked(unchecked, monkeypatch, make, what):
    monkeypatch.setattr(storage, "ASKED_BYTES", 1024)
    before, answers = dict(unchecked.alive), iter([gl.GL_OUT_OF_MEMORY, gl.GL_OUT_OF_MEMORY])
    monkeypatch.setitem(unchecked.fn.__dict__, "glGetError", lambda: next(answers))
    with pytest.raises(DeviceError) as caught:
        make(unchecked)
    assert str(caught.value) == (
        f"There is no memory on the device for {what} MiB: a smaller --size or scene needs less (the driver answers "
        "GL_OUT_OF_MEMORY)."
    )
    assert caught.value.exit_code == 2 and unchecked.alive == before and next(answers, None) is None


def test_another_error_is_told_as_itself(unchecked, monkeypatch):
    monkeypatch.setattr(storage, "ASKED_BYTES", 1024)
    before, answers = dict(unchecked.alive), iter([gl.GL_NO_ERROR, gl.GL_INVALID_VALUE])
    monkeypatch.setitem(unchecked.fn.__dict__, "glGetError", lambda: next(answers))
    with pytest.raises(DeviceError, match=r"making the texture.*failed with GL_INVALID_VALUE") as caught:
        an_image(unchecked)
    assert not caught.value.is_full and unchecked.alive == before


def test_an_error_of_an_earlier_call_is_no_lack_of_memory(unchecked, monkeypatch):
    monkeypatch.setattr(storage, "ASKED_BYTES", 1024)
    answers = iter([gl.GL_OUT_OF_MEMORY, gl.GL_NO_ERROR])
    monkeypatch.setitem(unchecked.fn.__dict__, "glGetError", lambda: next(answers))
    destroy_image(unchecked, an_image(unchecked))
    assert next(answers, None) is None


def test_memory_without_an_address_is_an_error(unchecked, monkeypatch):
    """Numpy would read from address 0."""
    before = dict(unchecked.alive)
    monkeypatch.setitem(unchecked.fn.__dict__, "glMapNamedBufferRange", lambda *_: gl.NULL)
    with pytest.raises(
        DeviceError, match=r"no memory on the device for 'refused', 0.0 MiB.*gives no address"
    ):
        create_buffer(unchecked, 64, "readback", "refused")
    assert unchecked.alive == before


def test_what_a_lack_of_memory_leaves_does_not_hide_it(gl_context):
    def opened():
        with Context() as context:
            an_image(context)
            raise DeviceError("glCall() failed with GL_OUT_OF_MEMORY.", is_full=True)

    with pytest.raises(DeviceError, match="GL_OUT_OF_MEMORY"):
        opened()


@pytest.mark.parametrize(("shape", "layers"), [("2d", 1), ("3d", 3)])
@pytest.mark.parametrize("most", [1, 4 * 5 * 2, 4 * 5 * 4, 1 << 30])
def test_a_picture_longer_than_one_call_takes_is_copied_in_parts(
    gl_context, monkeypatch, shape, layers, most
):
    """A call has 31 bits for the number of bytes: less than 16384x16384 pixels of four floats."""
    image = create_image(gl_context, "rgba8", (5, 7), "long", shape=shape, layers=layers)
    pixels = np.random.default_rng(3).integers(0, 256, (layers, 7, 5, 4), np.uint8)
    write_image(gl_context, image, pixels if shape == "3d" else pixels[0])
    monkeypatch.setattr(readback, "MOST_BYTES", most)
    sizes, real = [], gl_context.fn.glGetTextureSubImage
    monkeypatch.setitem(
        gl_context.fn.__dict__, "glGetTextureSubImage", lambda *words: (sizes.append(words[-2]), real(*words))
    )
    copy = Readback(gl_context, image, "copy")
    copy.record()
    Fence(gl_context).wait()
    assert np.array_equal(copy.read(), pixels if shape == "3d" else pixels[0])
    assert max(sizes) <= max(most, 4 * 5) and sum(sizes) == pixels.nbytes
    assert np.array_equal(read_image(gl_context, image, layer=layers - 1), pixels[-1])
    copy.close()
    destroy_image(gl_context, image)
