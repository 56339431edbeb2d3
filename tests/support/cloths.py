"""Cloths for tests, and the GPU as one function: buffers made, dispatches run in order, buffers read.

What renderers do from frame to frame is done here in the plainest way, on Vulkan and on OpenGL.
"""

from __future__ import annotations

from collections.abc import Callable, Mapping, Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

import numpy as np

from backends import shader_text
from backends.gl import api as gl
from backends.gl import resources as gl_resources
from backends.gl.context import Context
from backends.gl.programs import Programs
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.compute import Kernel
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.resources import create_buffer, destroy_buffer


def grid(columns: int, rows: int, edge: float = 0.1) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Return positions (V, 3) hanging down in z = 0, triangles (T, 3) and uv (V, 2) of a flat sheet."""
    u, v = (part.reshape(-1) for part in np.meshgrid(np.arange(columns), np.arange(rows)))
    positions = np.stack([u, -v, 0 * u], axis=1) * edge
    cells = (np.arange(rows - 1)[:, None] * columns + np.arange(columns - 1)).reshape(-1)
    a, b, c, d = cells, cells + 1, cells + columns, cells + columns + 1
    triangles = np.concatenate([np.stack([a, c, b], axis=1), np.stack([b, c, d], axis=1)])
    return positions, triangles, np.stack([u, v], axis=1).astype(np.float32) / 16


def sheet(build: Callable[..., Any], columns: int, rows: int, edge: float = 0.1, **properties: Any) -> Any:
    """Return what `build`, a chapter's `build_cloth`, makes of a sheet that hangs flat.

    It is pinned at the two upper corners unless `pins` says otherwise.
    """
    positions, triangles, _ = grid(columns, rows, edge)
    asked = {"columns": columns, "rows": rows, "pins": [0, columns - 1], **properties}
    return build(positions, triangles, asked)


def run(
    shaders: Path,
    device: Device | Context,
    packed: Any,
    todo: Sequence[Any],
    arrays: Mapping[str, np.ndarray],
    wanted: Sequence[str] = ("positions", "velocities"),
) -> dict[str, np.ndarray]:
    """Return the buffers `wanted` as float32 after the dispatches; `arrays` replace or add to those of `packed`.

    `shaders` is the chapter's folder of them; `packed` is what its `pack` returns, `todo` what its `dispatches` does.
    """
    contents = {**packed.arrays, "stats": np.zeros(packed.sizes()["stats"] // 4, np.float32), **arrays}
    runner = _run_gl if isinstance(device, Context) else _run_vulkan
    return runner(shaders, device, todo, contents, wanted)  # type: ignore[operator]


def _source(shaders: Path, step: Any, backend: Any) -> shader_text.ShaderSource:
    return shader_text.build(shaders / step.kernel.file, backend, defines=step.kernel.defines)


def _run_vulkan(
    shaders: Path,
    device: Device,
    todo: Sequence[Any],
    contents: Mapping[str, np.ndarray],
    wanted: Sequence[str],
) -> dict[str, np.ndarray]:
    needed = {name for step in todo for name in step.kernel.buffers} | {*wanted}
    usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
    compute, read_write = vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_READ_BIT
    written = vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT
    between = barriers(memory=(compute, written, compute, read_write | written))
    last = barriers(memory=(compute, written, vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT))
    uses: dict[Any, int] = {}
    for step in todo:
        uses[step.kernel] = uses.get(step.kernel, 0) + 1
    with ExitStack() as stack:
        buffers, kernels = {}, {}
        for name in needed:
            raw = np.ascontiguousarray(contents[name]).view(np.uint8).reshape(-1)
            buffers[name] = create_buffer(device, raw.size, usage, "readback", name)
            stack.callback(destroy_buffer, device, buffers[name])
            buffers[name].mapped[: raw.size] = raw
        for step in todo:
            if step.kernel not in kernels:
                kinds: Any = ["storage"] * len(step.kernel.buffers)
                made = Kernel(device, _source(shaders, step, "vulkan"), kinds, 16, uses[step.kernel])
                kernels[step.kernel] = made
                stack.callback(made.close)
        with submit_once(device) as commands:
            for step in todo:
                if step.after:
                    device.fn.vkCmdPipelineBarrier2(commands, between)
                held = [buffers[name] for name in step.kernel.buffers]
                kernels[step.kernel].record(commands, held, step.groups, np.array(step.push, np.uint32))
            device.fn.vkCmdPipelineBarrier2(commands, last)
        found = {}
        for name in wanted:
            device.memory.invalidate(buffers[name].allocation)
            found[name] = buffers[name].view(np.float32)[: contents[name].nbytes // 4].copy()
        return found


def _run_gl(
    shaders: Path,
    context: Context,
    todo: Sequence[Any],
    contents: Mapping[str, np.ndarray],
    wanted: Sequence[str],
) -> dict[str, np.ndarray]:
    needed = {name for step in todo for name in step.kernel.buffers} | {*wanted}
    with ExitStack() as stack:
        programs = Programs(context)
        stack.callback(programs.close)
        buffers = {}
        for name in needed:
            array = np.ascontiguousarray(contents[name])
            buffers[name] = gl_resources.create_buffer(context, array.nbytes, "device", name)
            stack.callback(gl_resources.destroy_buffer, context, buffers[name])
            gl_resources.write_buffer(context, buffers[name], array)
        for step in todo:
            context.fn.glUseProgram(programs.get([_source(shaders, step, "gl")]).handle)
            for place, name in enumerate(step.kernel.buffers):
                gl_resources.bind_buffer(context, "storage", place, buffers[name])
            context.push(np.array(step.push, np.uint32))
            context.fn.glDispatchCompute(*step.groups)
            context.fn.glMemoryBarrier(gl.GL_SHADER_STORAGE_BARRIER_BIT | gl.GL_BUFFER_UPDATE_BARRIER_BIT)
        return {
            name: gl_resources.read_buffer(context, buffers[name], np.float32)[: contents[name].nbytes // 4]
            for name in wanted
        }
