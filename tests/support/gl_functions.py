"""What tests on OpenGL share: pure GLSL functions run over arrays, and the check that the driver had nothing to say.

`evaluate` runs the shader text that `gpu_functions.evaluate` runs on Vulkan.
"""

from __future__ import annotations

from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from typing import Any

import numpy as np

from backends import shader_text
from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.programs import Programs
from backends.gl.resources import bind_buffer, create_buffer, destroy_buffer, read_buffer, write_buffer
from tests.support import gpu_functions as vulkan


def evaluate(
    context: Context,
    includes: Sequence[str],
    body: str,
    inputs: Mapping[str, np.ndarray],
    outputs: Mapping[str, str],
    defines: Mapping[str, int | float | str] | None = None,
) -> dict[str, np.ndarray]:
    """Return the arrays that `body` wrote; everything is as in `tests.support.gpu_functions.evaluate`."""
    types = {name: vulkan._glsl_type(name, array) for name, array in inputs.items()}
    count = len(next(iter(inputs.values())))
    text = vulkan._shader(includes, body, types, outputs)
    source = shader_text.build_text(text, "comp", "gl", name="<function under test>", defines=defines)
    programs = Programs(context)
    buffers = []
    try:
        program = programs.get([source])
        for name, array in inputs.items():
            buffers.append(create_buffer(context, array.nbytes, "device", name))
            write_buffer(context, buffers[-1], array)
        for name, kind in outputs.items():
            buffers.append(create_buffer(context, count * 4 * vulkan._TYPES[kind][1], "device", name))
        for number, buffer in enumerate(buffers):
            bind_buffer(context, "storage", number, buffer)
        context.fn.glUseProgram(program.handle)
        context.fn.glDispatchCompute((count + vulkan.GROUP - 1) // vulkan.GROUP, 1, 1)
        context.fn.glMemoryBarrier(gl.GL_BUFFER_UPDATE_BARRIER_BIT)
        found = {}
        for (name, kind), buffer in zip(outputs.items(), buffers[len(inputs) :], strict=True):
            scalar, width = vulkan._TYPES[kind]
            values = read_buffer(context, buffer, vulkan._SCALARS[scalar])[: count * width]
            found[name] = values if width == 1 else values.reshape(count, width)
        return found
    finally:
        for buffer in buffers:
            destroy_buffer(context, buffer)
        programs.close()


@contextmanager
def traced(context: Context) -> Iterator[list[str]]:
    """Yield a list that gets the name of every raw call made within; moderngl's own are not among them."""
    names: list[str] = []
    with noted(context, lambda name, _: names.append(name)):
        yield names


@contextmanager
def noted(context: Context, note: Callable[[str, tuple[Any, ...]], object]) -> Iterator[None]:
    """Call `note(name, arguments)` before every raw call made within; moderngl's own are not among them."""
    fn = context.fn
    before = dict(vars(fn))

    def logged(name: str, function: Callable[..., Any]) -> Callable[..., Any]:
        def call(*arguments: Any) -> Any:
            note(name, arguments)
            return function(*arguments)

        return call

    for name in gl._POINTERS:
        if name != "glGetError" and fn.has(name):
            setattr(fn, name, logged(name, getattr(fn, name)))
    try:
        yield
    finally:
        vars(fn).clear()
        vars(fn).update(before)


def assert_silent(context: Context) -> None:
    """Fail if the driver said anything, or if an error or an open label was left; forget all of it."""
    context.make_current()
    error = context.fn.glGetError()
    messages = context.sink.report()
    labels = list(context.sink.labels)
    context.sink.messages.clear()
    assert not messages, "the OpenGL driver says:\n" + "\n".join(messages)
    assert not error, f"an OpenGL error was left: {error:#x}"
    assert not labels, f"labels were left open: {labels}"
