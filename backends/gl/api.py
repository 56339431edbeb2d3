"""The raw calls that moderngl lacks: a table of function pointers, found at run time and checked under validation.

`Functions` is to a context what `backends.vulkan.api.Functions` is to a device: `fn.glDepthMask(0)`. Nothing is loaded
before the first call, and a call that the driver lacks is a sentence and no crash.
"""

from __future__ import annotations

import re
from collections.abc import Callable, Sequence
from typing import Any

import cffi
import numpy as np

from backends.gl.driver.calls import CALLS, TYPES
from backends.gl.driver.constants import *  # noqa: F403
from backends.gl.driver.constants import (
    GL_INVALID_ENUM,
    GL_INVALID_FRAMEBUFFER_OPERATION,
    GL_INVALID_OPERATION,
    GL_INVALID_VALUE,
    GL_NO_ERROR,
    GL_OUT_OF_MEMORY,
)
from common.errors import DeviceError, UnsupportedError

# All calls are declared as the members of one struct: cffi then parses them together (30 ms), not one by one (230 ms).
_MEMBERS = re.sub(r"\b(gl\w+)\(", r"(*\1)(", re.sub(r"//.*", "", CALLS))

ffi = cffi.FFI()
ffi.cdef(f"{TYPES} struct Calls {{ {_MEMBERS} }};")
NULL = ffi.NULL

_POINTERS = {name: member.type for name, member in ffi.typeof("struct Calls").fields}

ERRORS = {
    GL_INVALID_ENUM: ("GL_INVALID_ENUM", "a constant is not allowed there"),
    GL_INVALID_VALUE: ("GL_INVALID_VALUE", "a number is out of its range"),
    GL_INVALID_OPERATION: ("GL_INVALID_OPERATION", "the state or the object does not allow it"),
    GL_INVALID_FRAMEBUFFER_OPERATION: (
        "GL_INVALID_FRAMEBUFFER_OPERATION",
        "the framebuffer is not complete",
    ),
    GL_OUT_OF_MEMORY: ("GL_OUT_OF_MEMORY", "the GPU has no memory left: take a smaller picture or scene"),
    0x0507: ("GL_CONTEXT_LOST", "the GPU was reset"),
}
"""Each error's name and what it means."""


class Functions:
    """The calls of one context; `resolve` gives a call's address or 0. With `check` each asks for errors afterwards."""

    def __init__(self, resolve: Callable[[str], int], check: bool = False) -> None:
        self._resolve, self._check = resolve, check

    def __getattr__(self, name: str) -> Any:
        if name not in _POINTERS:
            raise AttributeError(name)
        address = self._resolve(name)
        if not address:
            raise UnsupportedError(f"The OpenGL driver has no {name}: install a newer driver.")
        function = ffi.cast(_POINTERS[name], address)
        if self._check and name != "glGetError":
            function = self._checked(name, function)
        setattr(self, name, function)
        return function

    def has(self, name: str) -> bool:
        """Whether the driver has an entry point for the call `name`."""
        return bool(self._resolve(name))

    def _checked(self, name: str, function: Any) -> Callable[..., Any]:
        error = self.glGetError

        def call(*arguments: Any) -> Any:
            error()  # of an earlier unchecked call, as moderngl makes them; the sink reports it
            result = function(*arguments)
            code = error()
            if code != GL_NO_ERROR:
                raise DeviceError(describe(name, arguments, code), code == GL_OUT_OF_MEMORY)
            return result

        return call


def describe(name: str, arguments: Sequence[Any], code: int) -> str:
    """Return the sentence about a call that failed."""
    shown = ", ".join(
        hex(value) if isinstance(value, int) and value > 255 else str(value) for value in arguments
    )
    error, hint = ERRORS.get(code, (hex(code), "the driver gives no reason"))
    return f"{name}({shown}) failed with {error}: {hint}."


def pointer(array: np.ndarray) -> Any:
    """Return where the bytes of a contiguous array begin; the caller keeps the array until the call is over."""
    return ffi.from_buffer(array) if array.size else NULL


def names(*values: int) -> Any:
    """Return object names as the array of GLuint that calls for several objects take."""
    return ffi.new("GLuint[]", values)


def text(value: Any) -> str:
    """Return a C string of the driver's as text, "" for none."""
    return ffi.string(ffi.cast("char *", value)).decode("utf-8", "replace") if value else ""
