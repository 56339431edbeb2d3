"""Runs pure GLSL functions over arrays: `evaluate` wraps a few lines in a compute shader and returns what they wrote.

    got = evaluate(
        device,
        ["srgb.glsl"],
        "light = linear_from_srgb(coded);",
        inputs={"coded": codes},          # (N, 3) float32: the body sees `vec3 coded`
        outputs={"light": "vec3"},        # the body assigns `vec3 light`; got["light"] is (N, 3) float32
    )

The body runs once per element. Inputs keep every bit, so NaN, infinities and denormals arrive as they were given.
"""

from __future__ import annotations

from collections.abc import Mapping, Sequence
from contextlib import ExitStack

import numpy as np

from backends import shader_text
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.device import Device
from backends.vulkan.once import submit_once
from backends.vulkan.resources import Buffer, create_buffer, destroy_buffer
from backends.vulkan.shaders.compiler import compile_shader

GROUP = 64

_SCALARS = {"float": np.dtype(np.float32), "int": np.dtype(np.int32), "uint": np.dtype(np.uint32)}
_VECTORS = {"float": "vec", "int": "ivec", "uint": "uvec"}
_TYPES = {
    name if width == 1 else f"{_VECTORS[name]}{width}": (name, width)
    for name in _SCALARS
    for width in range(1, 5)
}
"""GLSL type -> (scalar type, components)."""


def evaluate(
    device: Device,
    includes: Sequence[str],
    body: str,
    inputs: Mapping[str, np.ndarray],
    outputs: Mapping[str, str],
    defines: Mapping[str, int | float | str] | None = None,
) -> dict[str, np.ndarray]:
    """Return the arrays that `body` wrote, one (N,) or (N, components) array per output.

    `inputs` are (N,) or (N, 1 to 4) arrays of float32, int32 or uint32, one row per element; `outputs` name GLSL
    types (float, vec2, ..., uvec4). `includes` are files of `shaders/`. Raises TypeError for an array of another dtype,
    ValueError for lengths that differ, ShaderError for a body that does not compile.
    """
    types = {name: _glsl_type(name, array) for name, array in inputs.items()}
    counts = {len(array) for array in inputs.values()}
    if len(counts) != 1:
        raise ValueError(f"inputs have different lengths: {sorted(counts)}")
    count = counts.pop()
    text = _shader(includes, body, types, outputs)
    code = compile_shader(
        shader_text.build_text(text, "comp", "vulkan", name="<function under test>", defines=defines)
    )
    with ExitStack() as stack:

        def storage(name: str, size: int) -> Buffer:
            usage = vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT
            buffer = create_buffer(device, size, usage, "readback", name)
            stack.callback(destroy_buffer, device, buffer)
            return buffer

        buffers = []
        for name, array in inputs.items():
            raw = np.ascontiguousarray(array).view(np.uint8).reshape(-1)
            buffer = storage(name, raw.size)
            buffer.mapped[: raw.size] = raw
            buffers.append(buffer)
        results = [storage(name, count * 4 * _TYPES[kind][1]) for name, kind in outputs.items()]
        _dispatch(device, stack, code, [*buffers, *results], count)
        found = {}
        for (name, kind), buffer in zip(outputs.items(), results, strict=True):
            device.memory.invalidate(buffer.allocation)
            scalar, width = _TYPES[kind]
            values = buffer.view(_SCALARS[scalar])[: count * width].copy()
            found[name] = values if width == 1 else values.reshape(count, width)
        return found


def _glsl_type(name: str, array: np.ndarray) -> str:
    width = 1 if array.ndim == 1 else array.shape[1]
    for kind, (scalar, components) in _TYPES.items():
        if _SCALARS[scalar] == array.dtype and components == width and array.ndim <= 2:
            return kind
    raise TypeError(f"input {name} is {array.dtype} {array.shape}, not (N,) or (N, 1 to 4) of 32 bits")


def _shader(includes: Sequence[str], body: str, inputs: Mapping[str, str], outputs: Mapping[str, str]) -> str:
    """Return the shader: arrays of scalars (vec3 in a storage block would be padded), loads, the body, stores."""
    lines = [f'#include "{name}"' for name in includes]
    lines.append(f"layout(local_size_x = {GROUP}) in;")
    loads, stores = [], []
    for number, (name, kind) in enumerate([*inputs.items(), *outputs.items()]):
        scalar, width = _TYPES[kind]
        access = "readonly" if name in inputs else "writeonly"
        block = f"{access} buffer Block{number}_ {{ {scalar} {name}_[]; }};"
        lines.append(f"layout(BIND(0, {number}, {number}), std430) {block}")
        parts = [f"{name}_[{width}u * i_ + {part}u]" for part in range(width)]
        if name in inputs:
            loads.append(f"    {kind} {name} = {kind}({', '.join(parts)});")
        else:
            loads.append(f"    {kind} {name};")
            members = [name] if width == 1 else [f"{name}.{part}" for part in "xyzw"[:width]]
            stores += [f"    {part} = {member};" for part, member in zip(parts, members, strict=True)]
    first = next(iter(inputs))
    width = _TYPES[inputs[first]][1]
    lines += [
        "void main() {",
        "    uint i_ = gl_GlobalInvocationID.x;",
        f"    if (i_ >= uint({first}_.length()) / {width}u) return;",
        *loads,
        body,
        *stores,
        "}",
    ]
    return "\n".join(lines) + "\n"


def _dispatch(device: Device, stack: ExitStack, code: bytes, buffers: Sequence[Buffer], count: int) -> None:
    """Run a compute shader whose set 0 holds `buffers` in order, for `count` elements, and wait for it."""
    fn = device.fn

    def create(call: str, info: object) -> object:
        handle = device.create(call, info, "function under test")
        stack.callback(device.destroy, "Vk" + call.removeprefix("vkCreate"), handle)
        return handle

    compute, storage = vk.VK_SHADER_STAGE_COMPUTE_BIT, vk.VK_DESCRIPTOR_TYPE_STORAGE_BUFFER
    bindings = [
        {"binding": number, "descriptorType": storage, "descriptorCount": 1, "stageFlags": compute}
        for number in range(len(buffers))
    ]
    set_layout = create(
        "vkCreateDescriptorSetLayout", vk.new("VkDescriptorSetLayoutCreateInfo", pBindings=bindings)
    )
    layout = create("vkCreatePipelineLayout", vk.new("VkPipelineLayoutCreateInfo", pSetLayouts=[set_layout]))
    sizes = [{"type": storage, "descriptorCount": len(buffers)}]
    pool = create("vkCreateDescriptorPool", vk.new("VkDescriptorPoolCreateInfo", maxSets=1, pPoolSizes=sizes))
    module = create(
        "vkCreateShaderModule", vk.new("VkShaderModuleCreateInfo", codeSize=len(code), pCode=code)
    )
    stage = vk.new("VkPipelineShaderStageCreateInfo", stage=compute, module=module, pName="main")
    infos = vk.array(
        "VkComputePipelineCreateInfo", [vk.new("VkComputePipelineCreateInfo", stage=stage, layout=layout)]
    )
    pipeline = device.create_pipelines("vkCreateComputePipelines", infos, ["function under test"])[0]
    stack.callback(device.destroy, "VkPipeline", pipeline)
    sets = vk.ffi.new("VkDescriptorSet[1]")
    allocate = vk.new("VkDescriptorSetAllocateInfo", descriptorPool=pool, pSetLayouts=[set_layout])
    vk.check(fn.vkAllocateDescriptorSets(device.handle, allocate, sets), "vkAllocateDescriptorSets")
    writes = [
        {
            "dstSet": sets[0],
            "dstBinding": number,
            "descriptorCount": 1,
            "descriptorType": storage,
            "pBufferInfo": [{"buffer": buffer.handle, "range": buffer.size}],
        }
        for number, buffer in enumerate(buffers)
    ]
    fn.vkUpdateDescriptorSets(
        device.handle, len(writes), vk.array("VkWriteDescriptorSet", writes), 0, vk.NULL
    )
    written = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
    read = (vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT)
    with submit_once(device) as commands:
        point = vk.VK_PIPELINE_BIND_POINT_COMPUTE
        fn.vkCmdBindPipeline(commands, point, pipeline)
        fn.vkCmdBindDescriptorSets(commands, point, layout, 0, 1, sets, 0, vk.NULL)
        fn.vkCmdDispatch(commands, (count + GROUP - 1) // GROUP, 1, 1)
        fn.vkCmdPipelineBarrier2(commands, barriers(memory=(*written, *read)))


def ulps(got: np.ndarray, truth: np.ndarray) -> np.ndarray:
    """Return |got - truth| in units of the last place of the float32 nearest to `truth` (float64), elementwise.

    Equal infinities, and NaN against NaN, are 0 apart; any other meeting with something not finite is infinitely far.
    """
    got64, truth = got.astype(np.float64), np.asarray(truth, np.float64)
    with np.errstate(invalid="ignore", over="ignore"):
        nearest = truth.astype(np.float32)
        step = np.spacing(np.abs(np.where(np.isfinite(nearest), nearest, np.float32(1.0)))).astype(np.float64)
        apart = np.abs(got64 - truth) / step
    same = (got64 == nearest) & ~np.isfinite(nearest) | np.isnan(got64) & np.isnan(truth)
    return np.where(same, 0.0, np.where(np.isfinite(apart) & np.isfinite(nearest), apart, np.inf))
