"""The traps of the `vulkan` package that need no device, one test each: constants, structs, lifetimes, arrays.

The independent truth for numbers is the package's C header, read by a regular expression of this test; for which
sType belongs to which struct it is the default in the package's constructors, which come from Khronos' registry.
"""

from __future__ import annotations

import ast
import gc
import importlib.util
import re
import subprocess
import sys
import weakref
from collections.abc import Callable
from functools import cache
from pathlib import Path
from typing import Any

import numpy as np
import pytest

from backends.vulkan import api as vk
from common.errors import UnsupportedError
from common.paths import ROOT

ffi = vk.ffi


def package_file(name: str) -> str:
    spec = importlib.util.find_spec("vulkan")
    assert spec and spec.submodule_search_locations
    return Path(spec.submodule_search_locations[0], name).read_text(encoding="utf-8")


def header_values() -> dict[str, int]:
    """Return every enumerator and 64-bit flag of the header as a number, aliases followed."""
    header = package_file("vulkan.cdef.h")
    raw = dict(re.findall(r"^\s+(VK_\w+) = ([^,\s]+),?$", header, re.M))
    raw |= dict(re.findall(r"^static const \w+ (VK_\w+) = (\w+?)(?:ULL)?;$", header, re.M))

    def value(name: str) -> int:
        return value(raw[name]) if raw[name] in raw else int(raw[name], 0)

    return {name: value(name) for name in raw}


HEADER = header_values()


# --- constants ----------------------------------------------------------------------------------------------


def test_every_constant_has_the_header_s_value() -> None:
    """39 constants of the package's Python layer are wrong and 492 are None."""
    assert len(HEADER) > 3600
    assert {name: getattr(vk, name) for name in HEADER} == HEADER


@pytest.mark.parametrize(
    ("name", "value"),
    [
        # Numbers of the Vulkan specification, written down from it: an extension's enums are 1000000000 + 1000 x
        # (its number - 1) + offset, negative for errors. The package has other values for all of these.
        ("VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR", 1000165000),
        ("VK_STRUCTURE_TYPE_RAY_TRACING_PIPELINE_CREATE_INFO_KHR", 1000150015),
        ("VK_STRUCTURE_TYPE_RAY_TRACING_SHADER_GROUP_CREATE_INFO_KHR", 1000150016),
        ("VK_ERROR_OUT_OF_POOL_MEMORY", -1000069000),
        ("VK_ERROR_FRAGMENTATION", -1000161000),
        ("VK_GEOMETRY_INSTANCE_TRIANGLE_FRONT_COUNTERCLOCKWISE_BIT_KHR", 2),
        ("VK_INDEX_TYPE_NONE_KHR", 1000165000),
        ("VK_IMAGE_LAYOUT_FRAGMENT_SHADING_RATE_ATTACHMENT_OPTIMAL_KHR", 1000164003),
        # Absent from the package.
        ("VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT", 0x20000),
        ("VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT", 2),
        ("VK_DESCRIPTOR_POOL_CREATE_UPDATE_AFTER_BIND_BIT", 2),
        ("VK_DESCRIPTOR_SET_LAYOUT_CREATE_UPDATE_AFTER_BIND_POOL_BIT", 2),
        ("VK_FORMAT_FEATURE_TRANSFER_SRC_BIT", 0x4000),
        ("VK_PIPELINE_SHADER_STAGE_CREATE_REQUIRE_FULL_SUBGROUPS_BIT", 2),
        # None in the package.
        ("VK_SEMAPHORE_TYPE_TIMELINE_KHR", 1),
        ("VK_DESCRIPTOR_BINDING_PARTIALLY_BOUND_BIT_EXT", 4),
        ("VK_DYNAMIC_STATE_CULL_MODE_EXT", 1000267000),
        ("VK_STRUCTURE_TYPE_MEMORY_BARRIER_2_KHR", 1000314000),
        # Macros, which no enum holds (specification, "Defines" of API constants). WHOLE_SIZE is -1 in the package.
        ("VK_WHOLE_SIZE", 0xFFFF_FFFF_FFFF_FFFF),
        ("VK_REMAINING_MIP_LEVELS", 0xFFFF_FFFF),
        ("VK_REMAINING_ARRAY_LAYERS", 0xFFFF_FFFF),
        ("VK_QUEUE_FAMILY_IGNORED", 0xFFFF_FFFF),
        ("VK_QUEUE_FAMILY_EXTERNAL", 0xFFFF_FFFE),
        ("VK_ATTACHMENT_UNUSED", 0xFFFF_FFFF),
        ("VK_SUBPASS_EXTERNAL", 0xFFFF_FFFF),
        ("VK_SHADER_UNUSED_KHR", 0xFFFF_FFFF),
        ("VK_LOD_CLAMP_NONE", 1000.0),
        ("VK_TRUE", 1),
        ("VK_FALSE", 0),
        ("VK_API_VERSION_1_3", 4206592),
    ],
)
def test_constants_that_the_package_gets_wrong_or_lacks(name: str, value: float) -> None:
    assert getattr(vk, name) == value


def test_an_unknown_constant_is_an_error_and_never_none() -> None:
    for name in (
        "VK_FORMAT_R8G8B8A8_UNORN",
        "VK_NOPE",
        "VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_4_FEATURES",
    ):
        with pytest.raises(AttributeError, match=f"{name} is not a constant of Vulkan"):
            getattr(vk, name)
    with pytest.raises(AttributeError):
        vk.nonsense  # noqa: B018


def test_macros_fit_the_members_they_are_for() -> None:
    assert vk.new("VkMappedMemoryRange", size=vk.VK_WHOLE_SIZE).size == 2**64 - 1
    assert vk.new("VkDescriptorBufferInfo", range=vk.VK_WHOLE_SIZE).range == 2**64 - 1
    assert vk.new("VkBufferMemoryBarrier2", size=vk.VK_WHOLE_SIZE).size == 2**64 - 1
    assert vk.new("VkImageSubresourceRange", levelCount=vk.VK_REMAINING_MIP_LEVELS).levelCount == 2**32 - 1
    assert vk.new("VkSamplerCreateInfo", maxLod=vk.VK_LOD_CLAMP_NONE).maxLod == 1000.0


def test_every_struct_gets_its_stype() -> None:
    """Among them those of ray tracing, for which the package's defaults crash a validation layer."""
    owners = dict(
        re.findall(r"^def (Vk\w+)\(sType=(VK_STRUCTURE_TYPE_\w+),", package_file("_vulkan.py"), re.M)
    )
    # Structs of platforms that the header leaves out have no members here.
    known = [name for name in ffi.list_types()[0] if name in owners and _has_members(name)]
    assert len(known) > 700
    assert {struct: vk.new(struct).sType for struct in known} == {
        struct: HEADER[owners[struct]] for struct in known
    }


def _has_members(name: str) -> bool:
    ctype = ffi.typeof(name)
    return ctype.kind == "struct" and bool(ctype.fields)


# --- lifetimes ----------------------------------------------------------------------------------------------

REPEATS = 50


def reuse_freed_memory() -> None:
    """Fill what has just been freed with other bytes: a dangling pointer then reads them."""
    gc.collect()
    for size in (8, 16, 24, 32, 48, 64, 96, 128, 256):
        for _ in range(40):
            ffi.memmove(ffi.new("char[]", size), b"X" * size, size)


def stage_struct(number: int) -> Any:
    return vk.new("VkPipelineShaderStageCreateInfo", pName=f"entry_point_number_{number}")


def name_of(pointer: Any) -> str:
    return ffi.string(pointer).decode()


def constant_info(number: int) -> Any:
    """A specialization of one constant, whose data would be garbage if it were freed."""
    return vk.new(
        "VkSpecializationInfo",
        pMapEntries=[{"constantID": number, "size": 4}],
        dataSize=4,
        pData=np.array([number], np.uint32),
    )


def constant_of(info: Any) -> tuple[int, int]:
    return info.pMapEntries[0].constantID, ffi.cast("uint32_t *", info.pData)[0]


def versions_of(info: Any) -> list[int]:
    chain, found = info.pNext, []
    while chain != vk.NULL:
        struct = ffi.cast("VkBaseInStructure *", chain)
        found.append(int(struct.sType))
        chain = struct.pNext
    return found


def chain_of_three() -> Any:
    last = vk.new("VkPhysicalDeviceVulkan13Features")
    middle = vk.new("VkPhysicalDeviceVulkan12Features", pNext=last)
    return vk.new("VkDeviceCreateInfo", pNext=vk.new("VkPhysicalDeviceFeatures2", pNext=middle))


CHAIN = [
    HEADER[f"VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_{name}"] for name in ("FEATURES_2", "VULKAN_1_2_FEATURES")
]
CHAIN.append(HEADER["VK_STRUCTURE_TYPE_PHYSICAL_DEVICE_VULKAN_1_3_FEATURES"])

LIFETIMES: dict[str, tuple[Callable[[int], Any], Callable[[Any], Any], Callable[[int], Any]]] = {
    # what: (make, read, expected). The package reads garbage in the first four in nearly every try.
    "struct by value": (
        lambda i: vk.new("VkComputePipelineCreateInfo", stage=stage_struct(i)),
        lambda made: name_of(made.stage.pName),
        lambda i: f"entry_point_number_{i}",
    ),
    "listed structs": (
        lambda i: vk.new("VkGraphicsPipelineCreateInfo", pStages=[stage_struct(i), stage_struct(i + 1)]),
        lambda made: [name_of(made.pStages[k].pName) for k in range(2)],
        lambda i: [f"entry_point_number_{i}", f"entry_point_number_{i + 1}"],
    ),
    "pointer inside a listed struct": (
        lambda i: vk.new(
            "VkGraphicsPipelineCreateInfo",
            pStages=[{"pName": "main", "pSpecializationInfo": constant_info(i)}],
        ),
        lambda made: constant_of(made.pStages[0].pSpecializationInfo),
        lambda i: (i, i),
    ),
    "pNext inside a listed struct": (
        lambda i: vk.new(
            "VkGraphicsPipelineCreateInfo",
            pStages=[
                {
                    "pNext": vk.new(
                        "VkPipelineShaderStageRequiredSubgroupSizeCreateInfo", requiredSubgroupSize=i
                    )
                }
            ],
        ),
        lambda made: (
            ffi.cast(
                "VkPipelineShaderStageRequiredSubgroupSizeCreateInfo *", made.pStages[0].pNext
            ).requiredSubgroupSize
        ),
        lambda i: i,
    ),
    "dicts all the way": (
        lambda i: vk.new(
            "VkComputePipelineCreateInfo",
            stage={
                "pName": f"entry_point_number_{i}",
                "pSpecializationInfo": {"pMapEntries": [{"constantID": i}], "dataSize": 4, "pData": b"abcd"},
            },
        ),
        lambda made: (
            name_of(made.stage.pName),
            made.stage.pSpecializationInfo.pMapEntries[0].constantID,
            bytes(ffi.buffer(made.stage.pSpecializationInfo.pData, 4)),
        ),
        lambda i: (f"entry_point_number_{i}", i, b"abcd"),
    ),
    "array of structs": (
        lambda i: vk.array(
            "VkComputePipelineCreateInfo", [{"stage": stage_struct(i)}, {"stage": stage_struct(7)}]
        ),
        lambda made: [name_of(made[k].stage.pName) for k in range(2)],
        lambda i: [f"entry_point_number_{i}", "entry_point_number_7"],
    ),
    "strings": (
        lambda i: vk.new(
            "VkInstanceCreateInfo", ppEnabledExtensionNames=[f"extension_{i}_{k}" for k in range(5)]
        ),
        lambda made: [name_of(made.ppEnabledExtensionNames[k]) for k in range(5)],
        lambda i: [f"extension_{i}_{k}" for k in range(5)],
    ),
    "chain": (lambda i: chain_of_three(), versions_of, lambda i: CHAIN),
    "numpy array": (
        lambda i: vk.new("VkDeviceQueueCreateInfo", pQueuePriorities=np.full(8, i, np.float32)),
        lambda made: list(made.pQueuePriorities[0:8]),
        lambda i: [float(i)] * 8,
    ),
    "strided numpy array": (
        lambda i: vk.new(
            "VkDeviceQueueCreateInfo", pQueuePriorities=np.arange(i, i + 16, dtype=np.float32)[::2]
        ),
        lambda made: list(made.pQueuePriorities[0:8]),
        lambda i: [float(i + 2 * k) for k in range(8)],
    ),
    "bytes": (
        lambda i: vk.new("VkShaderModuleCreateInfo", codeSize=8, pCode=i.to_bytes(4, "little") * 2),
        lambda made: list(made.pCode[0:2]),
        lambda i: [i, i],
    ),
    "struct without its pointer": (
        lambda i: stage_struct(i)[0],
        lambda made: name_of(made.pName),
        lambda i: f"entry_point_number_{i}",
    ),
    "things kept by hand": (
        lambda i: vk.keep(ffi.new("void **"), ffi.new("uint32_t *", i)),
        lambda made: len(vk._KEEP[id(made)][1]),
        lambda i: 1,
    ),
}


@pytest.mark.parametrize("case", LIFETIMES)
def test_what_a_struct_points_to_lives_as_long_as_it_does(case: str) -> None:
    make, read, expected = LIFETIMES[case]
    made = [make(i) for i in range(REPEATS)]
    reuse_freed_memory()
    assert [read(one) for one in made] == [expected(i) for i in range(REPEATS)]


def test_structs_at_one_address_do_not_lose_each_other_s_things() -> None:
    """cffi's pointers are equal when their addresses are, so keep-alive goes by identity."""
    struct = stage_struct(1)
    alias = vk.keep(ffi.addressof(struct, "sType"), ffi.new("char[]", b"more"))
    assert alias == struct  # the trap
    del alias
    reuse_freed_memory()
    assert name_of(struct.pName) == "entry_point_number_1"


def test_nothing_is_kept_longer_than_needed() -> None:
    gc.collect()
    before = len(vk._KEEP)
    structs = [vk.new("VkComputePipelineCreateInfo", stage={"pName": "main"}) for _ in range(10)]
    structs += [vk.array("VkImageMemoryBarrier2", [{"pNext": vk.new("VkSampleLocationsInfoEXT")}])]
    # An alias that keeps its owner must not keep it for ever, though the addresses are the same.
    owner = structs[0]
    structs.append(vk.keep(ffi.cast("VkBaseInStructure *", owner), owner))
    dead = [weakref.ref(struct) for struct in structs]
    del structs, owner
    gc.collect()
    assert [reference() for reference in dead] == [None] * len(dead)
    assert len(vk._KEEP) == before


def test_handles_are_not_kept_and_cost_no_more_than_numbers() -> None:
    before = len(vk._KEEP)
    made = vk.new("VkImageMemoryBarrier2", image=ffi.cast("VkImage", 7), subresourceRange={"levelCount": 1})
    assert len(vk._KEEP) == before and made.image == ffi.cast("VkImage", 7)
    assert vk.new("VkImageMemoryBarrier2", image=vk.NULL).image == vk.NULL
    with pytest.raises(TypeError):
        vk.new("VkImageMemoryBarrier2", image=ffi.cast("VkBuffer", 7))


# --- values and arrays --------------------------------------------------------------------------------------


def test_numpy_arrays_are_taken_as_they_are() -> None:
    """The package raises on arrays, and drops those of one zero without a word."""
    zero = vk.new("VkSpecializationInfo", pData=np.zeros(1, np.uint32), dataSize=4)
    assert zero.pData != vk.NULL
    assert ffi.cast("uint32_t *", zero.pData)[0] == 0
    indices = vk.new("VkBufferCreateInfo", pQueueFamilyIndices=np.array([3, 5], np.uint32))
    assert (indices.queueFamilyIndexCount, list(indices.pQueueFamilyIndices[0:2])) == (2, [3, 5])
    code = vk.new("VkShaderModuleCreateInfo", codeSize=8, pCode=np.array([0x07230203, 7], np.uint32))
    assert list(code.pCode[0:2]) == [0x07230203, 7]
    records = np.array([(1, 0, 4), (2, 4, 8)], np.dtype([("id", "u4"), ("offset", "u4"), ("size", "u8")]))
    entries = vk.new("VkSpecializationInfo", pMapEntries=records)
    assert [(e.constantID, e.offset, e.size) for e in entries.pMapEntries[0:2]] == [(1, 0, 4), (2, 4, 8)]
    grid = vk.new("VkDeviceQueueCreateInfo", pQueuePriorities=np.ones((2, 4), np.float32))
    assert grid.queueCount == 8


def test_a_numpy_array_is_passed_without_a_copy() -> None:
    data = np.zeros(4, np.uint32)
    info = vk.new("VkSpecializationInfo", pData=data, dataSize=data.nbytes)
    data[2] = 77
    assert ffi.cast("uint32_t *", info.pData)[2] == 77


def test_numbers_of_numpy_are_numbers() -> None:
    info = vk.new("VkBufferCreateInfo", size=np.uint64(2**40), usage=np.int32(3), sharingMode=np.uint8(1))
    assert (info.size, info.usage, info.sharingMode) == (2**40, 3, 1)
    viewport = vk.new("VkViewport", width=np.float32(0.5), height=np.float64(2.0), maxDepth=1)
    assert (viewport.width, viewport.height, viewport.maxDepth) == (0.5, 2.0, 1.0)
    assert vk.new(
        "VkPipelineInputAssemblyStateCreateInfo", primitiveRestartEnable=np.bool_(True)
    ).primitiveRestartEnable
    assert list(vk.new("VkClearColorValue", float32=np.arange(4, dtype=np.float32)).float32) == [0, 1, 2, 3]


@pytest.mark.parametrize(
    ("struct", "member", "value"),
    [
        ("VkDeviceQueueCreateInfo", "pQueuePriorities", np.ones(1, np.float64)),
        ("VkDeviceQueueCreateInfo", "pQueuePriorities", np.ones(1, np.int32)),
        ("VkDeviceQueueCreateInfo", "pQueuePriorities", np.ones(1, ">f4")),
        ("VkBufferCreateInfo", "pQueueFamilyIndices", np.ones(1, np.float32)),
        ("VkBufferCreateInfo", "pQueueFamilyIndices", np.ones(1, np.int64)),
        ("VkPresentInfoKHR", "pImageIndices", np.ones(1, bool)),
        ("VkSpecializationInfo", "pMapEntries", np.ones(4, np.float32)),
        ("VkDescriptorSetAllocateInfo", "pSetLayouts", np.ones(1, np.uint32)),
        ("VkInstanceCreateInfo", "ppEnabledExtensionNames", {"a"}),
        ("VkInstanceCreateInfo", "ppEnabledExtensionNames", 5),
        ("VkInstanceCreateInfo", "pApplicationInfo", vk.new("VkBufferCreateInfo")),
        ("VkComputePipelineCreateInfo", "stage", vk.new("VkBufferCreateInfo")),
        ("VkBufferCreateInfo", "pNext", {"sType": 1}),
        ("VkBufferCreateInfo", "pNext", [1]),
        ("VkBufferCreateInfo", "size", 1.5),
        ("VkBufferCreateInfo", "size", "1"),
    ],
)
def test_a_wrong_kind_of_value_raises(struct: str, member: str, value: Any) -> None:
    with pytest.raises(TypeError):
        vk.new(struct, **{member: value})


def test_numbers_out_of_range_raise() -> None:
    for value in (-1, 2**64):
        with pytest.raises(OverflowError):
            vk.new("VkBufferCreateInfo", size=value)


def test_wrong_names_raise() -> None:
    with pytest.raises(AttributeError, match="VkBufferCreateInfo has no member sise"):
        vk.new("VkBufferCreateInfo", sise=4)
    with pytest.raises(AttributeError, match="VkApplicationInfo has no member nope"):
        vk.new("VkInstanceCreateInfo", pApplicationInfo={"nope": 1})
    for name in ("VkBuferCreateInfo", "VkFormat", "VkBuffer", "VkPhysicalDeviceVulkan14Features"):
        with pytest.raises(AttributeError, match=f"{name} is not a struct"):
            vk.new(name)


def test_bytes_are_taken_for_untyped_pointers() -> None:
    for data in (b"\1\2\3\4", bytearray(b"\1\2\3\4"), memoryview(b"\1\2\3\4")):
        info = vk.new("VkSpecializationInfo", pData=data, dataSize=4)
        assert bytes(ffi.buffer(info.pData, 4)) == b"\1\2\3\4"


def test_unions_nest_in_dicts_and_lists() -> None:
    made = vk.array("VkClearValue", [{"color": {"float32": [1, 2, 3, 4]}}, {"depthStencil": {"depth": 0.5}}])
    assert list(made[0].color.float32) == [1, 2, 3, 4]
    assert made[1].depthStencil.depth == 0.5
    inside = vk.new("VkRenderingAttachmentInfo", clearValue={"color": {"uint32": [1, 2, 3, 2**32 - 1]}})
    assert list(inside.clearValue.color.uint32) == [1, 2, 3, 2**32 - 1]


def test_none_and_false_are_not_confused() -> None:
    made = vk.new("VkBufferCreateInfo", pNext=None, size=0, pQueueFamilyIndices=[], queueFamilyIndexCount=0)
    assert made.pNext == vk.NULL
    assert made.sType == HEADER["VK_STRUCTURE_TYPE_BUFFER_CREATE_INFO"]


def test_the_instance_of_an_acceleration_structure_is_packed() -> None:
    matrix = np.arange(12, dtype=np.float32).reshape(3, 4)
    made = vk.new(
        "VkAccelerationStructureInstanceKHR",
        transform={"matrix": matrix},
        instanceCustomIndex=0xABCDEF,
        mask=0x5A,
        instanceShaderBindingTableRecordOffset=0x123456,
        flags=vk.VK_GEOMETRY_INSTANCE_TRIANGLE_FRONT_COUNTERCLOCKWISE_BIT_KHR,
        accelerationStructureReference=2**63 + 1,
    )
    expected = matrix.tobytes() + np.array([0x5AABCDEF, 0x02123456], np.uint32).tobytes()
    assert bytes(ffi.buffer(made)) == expected + (2**63 + 1).to_bytes(8, "little")


COUNTS = {
    # struct: {array member: count member}; most of these are not the member's own name
    "VkBufferCreateInfo": {"pQueueFamilyIndices": "queueFamilyIndexCount"},
    "VkSwapchainCreateInfoKHR": {"pQueueFamilyIndices": "queueFamilyIndexCount"},
    "VkDescriptorSetAllocateInfo": {"pSetLayouts": "descriptorSetCount"},
    "VkPipelineLayoutCreateInfo": {
        "pSetLayouts": "setLayoutCount",
        "pPushConstantRanges": "pushConstantRangeCount",
    },
    "VkDescriptorSetLayoutCreateInfo": {"pBindings": "bindingCount"},
    "VkDescriptorSetLayoutBinding": {"pImmutableSamplers": "descriptorCount"},
    "VkDescriptorSetLayoutBindingFlagsCreateInfo": {"pBindingFlags": "bindingCount"},
    "VkDescriptorSetVariableDescriptorCountAllocateInfo": {"pDescriptorCounts": "descriptorSetCount"},
    "VkDescriptorPoolCreateInfo": {"pPoolSizes": "poolSizeCount"},
    "VkWriteDescriptorSet": {"pImageInfo": "descriptorCount"},
    "VkDeviceQueueCreateInfo": {"pQueuePriorities": "queueCount"},
    "VkDeviceCreateInfo": {
        "pQueueCreateInfos": "queueCreateInfoCount",
        "ppEnabledExtensionNames": "enabledExtensionCount",
        "ppEnabledLayerNames": "enabledLayerCount",
    },
    "VkPipelineRenderingCreateInfo": {"pColorAttachmentFormats": "colorAttachmentCount"},
    "VkRenderingInfo": {"pColorAttachments": "colorAttachmentCount"},
    "VkRenderPassCreateInfo": {
        "pAttachments": "attachmentCount",
        "pSubpasses": "subpassCount",
        "pDependencies": "dependencyCount",
    },
    "VkSubpassDescription": {"pColorAttachments": "colorAttachmentCount"},
    "VkFramebufferCreateInfo": {"pAttachments": "attachmentCount"},
    "VkGraphicsPipelineCreateInfo": {"pStages": "stageCount"},
    "VkPipelineDynamicStateCreateInfo": {"pDynamicStates": "dynamicStateCount"},
    "VkPipelineColorBlendStateCreateInfo": {"pAttachments": "attachmentCount"},
    "VkSpecializationInfo": {"pMapEntries": "mapEntryCount"},
    "VkDependencyInfo": {
        "pMemoryBarriers": "memoryBarrierCount",
        "pBufferMemoryBarriers": "bufferMemoryBarrierCount",
        "pImageMemoryBarriers": "imageMemoryBarrierCount",
    },
    "VkSubmitInfo2": {
        "pWaitSemaphoreInfos": "waitSemaphoreInfoCount",
        "pCommandBufferInfos": "commandBufferInfoCount",
        "pSignalSemaphoreInfos": "signalSemaphoreInfoCount",
    },
    "VkSubmitInfo": {"pWaitSemaphores": "waitSemaphoreCount", "pWaitDstStageMask": "waitSemaphoreCount"},
    "VkSemaphoreWaitInfo": {"pSemaphores": "semaphoreCount", "pValues": "semaphoreCount"},
    "VkPresentInfoKHR": {"pSwapchains": "swapchainCount", "pImageIndices": "swapchainCount"},
    "VkBindSparseInfo": {"pBufferBinds": "bufferBindCount", "pImageOpaqueBinds": "imageOpaqueBindCount"},
    "VkSparseImageMemoryBindInfo": {"pBinds": "bindCount"},
    "VkAccelerationStructureBuildGeometryInfoKHR": {"pGeometries": "geometryCount"},
    "VkRayTracingPipelineCreateInfoKHR": {"pStages": "stageCount", "pGroups": "groupCount"},
    "VkPipelineLibraryCreateInfoKHR": {"pLibraries": "libraryCount"},
    "VkValidationFeaturesEXT": {"pEnabledValidationFeatures": "enabledValidationFeatureCount"},
}


@pytest.mark.parametrize("struct", COUNTS)
def test_counts_are_filled_in(struct: str) -> None:
    fields = dict(ffi.typeof(struct).fields)
    for member, count in COUNTS[struct].items():
        item = fields[member].type.item
        if item.kind == "struct":
            values: list[Any] = [{}, {}, {}]
        elif item.kind == "pointer":
            values = ["a", "b", "c"] if item.item.cname == "char" else [vk.NULL] * 3
        else:
            values = [0, 0, 0]
        assert getattr(vk.new(struct, **{member: values}), count) == 3
        assert (
            getattr(vk.new(struct, **{member: tuple(values), count: 2}), count) == 2
        )  # what is given counts
        assert getattr(vk.new(struct, **{member: []}), count) == 0


def test_an_array_of_unknown_length_is_refused() -> None:
    """A count left at zero would have the driver ignore the array without a word."""
    with pytest.raises(TypeError, match="give the count of pViewMasks"):
        vk.new("VkRenderPassMultiviewCreateInfo", pViewMasks=[1])
    assert vk.new("VkRenderPassMultiviewCreateInfo", pViewMasks=[1], subpassCount=1).pViewMasks[0] == 1
    # The sample mask's length follows from the sample count: there is nothing to give.
    assert vk.new("VkPipelineMultisampleStateCreateInfo", pSampleMask=[5]).pSampleMask[0] == 5


# --- the loader ---------------------------------------------------------------------------------------------


@pytest.mark.parametrize(
    ("platform", "environment", "first", "among"),
    [
        ("linux", {}, "libvulkan.so.1", "libvulkan.so"),
        ("win32", {}, "vulkan-1.dll", "vulkan-1.dll"),
        ("darwin", {}, "libvulkan.dylib", "/opt/homebrew/lib/libvulkan.dylib"),
        ("darwin", {}, "libvulkan.dylib", "/usr/local/lib/libMoltenVK.dylib"),
        ("darwin", {"VULKAN_SDK": "/sdk/macOS"}, "libvulkan.dylib", "/sdk/macOS/lib/libvulkan.1.dylib"),
    ],
)
def test_loaders_are_looked_for_by_each_system_s_names(
    platform: str, environment: dict[str, str], first: str, among: str
) -> None:
    names = vk.loader_names(platform, environment)
    assert names[0] == first
    assert among in names
    assert not any(name.startswith("None") for name in names)


def test_without_a_loader_one_sentence_says_what_to_do(monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setattr(vk, "loader_names", lambda platform, environment: ["libnowhere.so.9"])
    with pytest.raises(UnsupportedError, match=r"^No Vulkan loader .*doctor.*\.$"):
        vk.open_loader()


def test_the_binding_opens_neither_package_nor_loader_by_itself() -> None:
    """Constants and structs work on a machine without Vulkan, where importing the package raises OSError."""
    code = (
        "import ctypes, sys; sys.path.insert(0, '.')\n"
        "from backends.vulkan import api as vk\n"
        "vk.new('VkBufferCreateInfo', size=vk.VK_WHOLE_SIZE)\n"
        "assert 'vulkan' not in sys.modules\n"
        "import pathlib; maps = pathlib.Path('/proc/self/maps')\n"
        "assert not maps.exists() or 'libvulkan' not in maps.read_text()\n"
    )
    subprocess.run([sys.executable, "-c", code], cwd=ROOT, check=True)


# --- what the sources use -----------------------------------------------------------------------------------


@cache
def sources() -> tuple[tuple[Path, ast.Module], ...]:
    """Return the files that name something of Vulkan; of files with one text, which chapters share, the first."""
    paths = sorted([*ROOT.glob("backends/**/*.py"), *ROOT.glob("chapters/**/*.py")], reverse=True)
    texts = {text: path for path in paths if re.search(r"vk[A-Z]|Vk|VK_", text := path.read_text("utf-8"))}
    return tuple((path, ast.parse(text)) for text, path in texts.items())


# Names of extensions and layers have small letters, those of constants have none; the rest are the loader's variables.
CONSTANT = re.compile(r"VK_(?!ICD_|LAYER_|LOADER_|DRIVER_|ADD_|INSTANCE_LAYERS)[A-Z0-9_]+[A-Z0-9]")


def test_every_constant_in_the_sources_exists() -> None:
    used, wrong = 0, []
    for path, tree in sources():
        for node in ast.walk(tree):
            name = None
            if isinstance(node, ast.Attribute) and node.attr.startswith("VK_"):
                name = node.attr
            elif isinstance(node, ast.Constant) and CONSTANT.fullmatch(str(node.value)):
                name = str(node.value)
            if name is None:
                continue
            used += 1
            if not hasattr(vk, name):
                wrong.append(f"{path.relative_to(ROOT)}:{node.lineno}: {name}")
    assert not wrong
    assert used > 100


def test_every_struct_member_and_function_in_the_sources_exists() -> None:
    """Names that are only looked up when the line runs are looked up here: a typing error waits for no frame."""
    used, wrong = 0, []
    functions = {name.removeprefix("PFN_") for name in ffi.list_types()[0] if name.startswith("PFN_vk")}

    def told(path: Path, node: ast.AST, what: object) -> None:
        wrong.append(f"{path.relative_to(ROOT)}:{getattr(node, 'lineno', 0)}: {what}")

    for path, tree in sources():
        for node in ast.walk(tree):
            if isinstance(node, ast.Attribute) and re.match(r"vk[A-Z]", node.attr):
                used += 1
                if node.attr not in functions:
                    told(path, node, node.attr)
            if not (isinstance(node, ast.Call) and isinstance(node.func, ast.Attribute) and node.args):
                continue
            struct = node.args[0]
            if (
                node.func.attr != "new"
                or not isinstance(struct, ast.Constant)
                or not str(struct.value).startswith("Vk")
            ):
                continue
            used += 1
            if "*" in struct.value or "[" in struct.value:
                continue
            try:
                fields = vk._struct_type(struct.value).fields
            except AttributeError as error:
                told(path, node, error)
                continue
            unknown = {keyword.arg for keyword in node.keywords if keyword.arg} - fields.keys()
            for member in sorted(unknown):
                told(path, node, f"{struct.value}.{member}")
    assert not wrong
    assert used > 50
