"""Memory of buffers and images: a lack of it is an error here, also where calls are not checked."""

from __future__ import annotations

from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any

import numpy as np

from backends.gl import api as gl
from backends.gl.context import Context, Kind
from common.errors import DeviceError

ASKED_BYTES = 16 << 20
"""From here on the driver is asked whether there is memory. It may have to end what it does for that."""


@contextmanager
def in_memory(context: Context, kind: Kind, handle: int, what: str, size: int) -> Iterator[None]:
    """Make the storage of an object, `size` bytes, in the `with` block; without memory free the object.

    The calls that make storage return nothing, and draws to what has none do nothing. Raises DeviceError.
    """
    fn, asked = context.fn, size >= ASKED_BYTES
    if asked:
        fn.glGetError()  # of an earlier call
    try:
        yield
        if asked and (code := fn.glGetError()) != gl.GL_NO_ERROR:
            if code == gl.GL_OUT_OF_MEMORY:
                raise DeviceError("the driver answers GL_OUT_OF_MEMORY", is_full=True)
            raise DeviceError(gl.describe(f"making the {kind}", (what,), code))
    except Exception as error:
        context.destroy(kind, handle)
        if isinstance(error, DeviceError):
            error.add_size(what, size)
        raise


def mapped(context: Context, handle: int, size: int, flags: int) -> np.ndarray:
    """Return the bytes of a buffer, mapped for good. Raises DeviceError where the driver does not map it."""
    address: Any = context.fn.glMapNamedBufferRange(handle, 0, size, flags)
    if address == gl.NULL:
        raise DeviceError("glMapNamedBufferRange gives no address", is_full=True)
    return np.frombuffer(gl.ffi.buffer(address, size), np.uint8)
