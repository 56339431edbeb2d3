"""The traps of the `vulkan` package that need a device, and the raw path: on a device made by the binding alone.

Nothing of the device layer is used here, so that a fault in it cannot hide one in the binding.
"""

from __future__ import annotations

import gc
from collections.abc import Callable, Iterator
from dataclasses import dataclass, field
from typing import Any

import numpy as np
import pytest

from backends.shader_text import build_text
from backends.vulkan import api as vk
from backends.vulkan.shaders import glslang
from common.errors import DeviceError, UnsupportedError
from tests.support.timing import least_times, timed

ffi = vk.ffi
LAYER = "VK_LAYER_KHRONOS_validation"
RAYS = ("VK_KHR_acceleration_structure", "VK_KHR_ray_tracing_pipeline", "VK_KHR_deferred_host_operations")
ALLOWED = ("is not supported by this layer", "not a conformant Vulkan implementation")


@dataclass
class Minimal:
    """An instance and a device with one queue, and whatever the layers said about them."""

    instance: Any
    instance_fn: vk.Functions
    physical: Any
    device: Any
    fn: vk.Functions
    queue: Any
    has_rays: bool
    has_debug_utils: bool
    messages: list[str] = field(default_factory=list)

    def pool(self) -> Any:
        pool = ffi.new("VkCommandPool *")
        info = vk.new("VkCommandPoolCreateInfo", flags=vk.VK_COMMAND_POOL_CREATE_RESET_COMMAND_BUFFER_BIT)
        vk.check(self.fn.vkCreateCommandPool(self.device, info, vk.NULL, pool), "vkCreateCommandPool")
        return pool[0]

    def commands(self, pool: Any) -> Any:
        commands = ffi.new("VkCommandBuffer *")
        info = vk.new("VkCommandBufferAllocateInfo", commandPool=pool, commandBufferCount=1)
        vk.check(self.fn.vkAllocateCommandBuffers(self.device, info, commands), "vkAllocateCommandBuffers")
        return commands[0]

    def submit(self, record: Callable[[Any], None]) -> None:
        """Record, submit, and wait."""
        pool = self.pool()
        commands = self.commands(pool)
        fn = self.fn
        vk.check(
            fn.vkBeginCommandBuffer(commands, vk.new("VkCommandBufferBeginInfo")), "vkBeginCommandBuffer"
        )
        record(commands)
        vk.check(fn.vkEndCommandBuffer(commands), "vkEndCommandBuffer")
        info = vk.array("VkSubmitInfo2", [{"pCommandBufferInfos": [{"commandBuffer": commands}]}])
        vk.check(fn.vkQueueSubmit2(self.queue, 1, info, vk.NULL), "vkQueueSubmit2")
        vk.check(fn.vkDeviceWaitIdle(self.device), "vkDeviceWaitIdle")
        fn.vkDestroyCommandPool(self.device, pool, vk.NULL)


def extensions_of(function: Any, *arguments: Any) -> set[str]:
    found = vk.listed(function, "vkEnumerate...ExtensionProperties", "VkExtensionProperties", *arguments)
    return {vk.text(one.extensionName) for one in found}


@pytest.fixture(scope="module")
def minimal() -> Iterator[Minimal]:
    """Vulkan 1.3 through the binding; the module's tests fail if the validation layers said anything."""
    try:
        functions, get = vk.global_functions()
    except UnsupportedError as error:
        pytest.skip(str(error))
    layers = vk.listed(functions.vkEnumerateInstanceLayerProperties, "layers", "VkLayerProperties")
    layer = [LAYER] if LAYER in {vk.text(one.layerName) for one in layers} else []
    has_debug_utils = "VK_EXT_debug_utils" in extensions_of(
        functions.vkEnumerateInstanceExtensionProperties, vk.NULL
    )
    handle = ffi.new("VkInstance *")
    info = vk.new(
        "VkInstanceCreateInfo",
        pApplicationInfo={"pApplicationName": "test", "apiVersion": vk.VK_API_VERSION_1_3},
        ppEnabledLayerNames=layer,
        ppEnabledExtensionNames=["VK_EXT_debug_utils"] if has_debug_utils else [],
    )
    code = functions.vkCreateInstance(info, vk.NULL, handle)
    if code < 0:
        pytest.skip(f"no Vulkan instance: {vk.VulkanError('vkCreateInstance', code)}")
    instance = handle[0]
    instance_fn = vk.Functions(lambda name: get(instance, name))
    devices = vk.listed(instance_fn.vkEnumeratePhysicalDevices, "devices", "VkPhysicalDevice", instance)
    physical = next((one for one in devices if version_of(instance_fn, one) >= vk.VK_API_VERSION_1_3), None)
    if physical is None:
        instance_fn.vkDestroyInstance(instance, vk.NULL)
        pytest.skip("no device of Vulkan 1.3")
    extensions = extensions_of(instance_fn.vkEnumerateDeviceExtensionProperties, physical, vk.NULL)
    has_rays = set(RAYS) <= extensions
    chain: Any = vk.new("VkPhysicalDeviceVulkan13Features", synchronization2=1)
    if has_rays:
        chain = vk.new("VkPhysicalDeviceRayTracingPipelineFeaturesKHR", pNext=chain, rayTracingPipeline=1)
        chain = vk.new(
            "VkPhysicalDeviceAccelerationStructureFeaturesKHR", pNext=chain, accelerationStructure=1
        )
    info = vk.new(
        "VkDeviceCreateInfo",
        pNext=vk.new("VkPhysicalDeviceVulkan12Features", pNext=chain, bufferDeviceAddress=1),
        pQueueCreateInfos=[{"queueFamilyIndex": 0, "pQueuePriorities": [1.0]}],
        ppEnabledExtensionNames=RAYS if has_rays else None,
    )
    handle = ffi.new("VkDevice *")
    vk.check(instance_fn.vkCreateDevice(physical, info, vk.NULL, handle), "vkCreateDevice", physical, info)
    device = handle[0]
    fn = vk.Functions(lambda name: instance_fn.vkGetDeviceProcAddr(device, name))
    queue = ffi.new("VkQueue *")
    fn.vkGetDeviceQueue(device, 0, 0, queue)
    made = Minimal(instance, instance_fn, physical, device, fn, queue[0], has_rays, has_debug_utils)
    messenger = add_messenger(made, lambda text: made.messages.append(text)) if has_debug_utils else None
    yield made
    fn.vkDestroyDevice(device, vk.NULL)
    if messenger:
        instance_fn.vkDestroyDebugUtilsMessengerEXT(instance, messenger[0], vk.NULL)
    instance_fn.vkDestroyInstance(instance, vk.NULL)
    assert [text for text in made.messages if not any(part in text for part in ALLOWED)] == []


def version_of(fn: vk.Functions, physical: Any) -> int:
    properties = vk.new("VkPhysicalDeviceProperties2")
    fn.vkGetPhysicalDeviceProperties2(physical, properties)
    return properties.properties.apiVersion


def add_messenger(minimal: Minimal, receive: Callable[[str], None]) -> Any:
    """Return a (1,) array of the messenger, which keeps the callback alive."""

    @ffi.callback("PFN_vkDebugUtilsMessengerCallbackEXT")
    def callback(severity: int, kinds: int, data: Any, user: Any) -> int:
        receive(vk.text(data.pMessage))
        return 0

    info = vk.new(
        "VkDebugUtilsMessengerCreateInfoEXT",
        messageSeverity=vk.VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT
        | vk.VK_DEBUG_UTILS_MESSAGE_SEVERITY_ERROR_BIT_EXT,
        messageType=vk.VK_DEBUG_UTILS_MESSAGE_TYPE_GENERAL_BIT_EXT
        | vk.VK_DEBUG_UTILS_MESSAGE_TYPE_VALIDATION_BIT_EXT,
        pfnUserCallback=callback,
    )
    messenger = vk.keep(ffi.new("VkDebugUtilsMessengerEXT *"), callback)
    code = minimal.instance_fn.vkCreateDebugUtilsMessengerEXT(minimal.instance, info, vk.NULL, messenger)
    vk.check(code, "vkCreateDebugUtilsMessengerEXT")
    return messenger


@dataclass
class Buffer:
    """A buffer in mapped memory, seen by numpy as bytes."""

    handle: Any
    memory: Any
    bytes: np.ndarray
    address: int


@pytest.fixture
def buffers(minimal: Minimal) -> Iterator[Callable[..., Buffer]]:
    made: list[Buffer] = []
    fn, device = minimal.fn, minimal.device

    def make(size: int, usage: int) -> Buffer:
        handle, memory, mapped = ffi.new("VkBuffer *"), ffi.new("VkDeviceMemory *"), ffi.new("void **")
        usage |= vk.VK_BUFFER_USAGE_SHADER_DEVICE_ADDRESS_BIT
        info = vk.new("VkBufferCreateInfo", size=size, usage=usage)
        vk.check(fn.vkCreateBuffer(device, info, vk.NULL, handle), "vkCreateBuffer", info)
        needs = ffi.new("VkMemoryRequirements *")
        fn.vkGetBufferMemoryRequirements(device, handle[0], needs)
        info = vk.new(
            "VkMemoryAllocateInfo",
            pNext=vk.new("VkMemoryAllocateFlagsInfo", flags=vk.VK_MEMORY_ALLOCATE_DEVICE_ADDRESS_BIT),
            allocationSize=needs.size,
            memoryTypeIndex=visible_type(minimal, needs.memoryTypeBits),
        )
        vk.check(fn.vkAllocateMemory(device, info, vk.NULL, memory), "vkAllocateMemory", info)
        vk.check(fn.vkBindBufferMemory(device, handle[0], memory[0], 0), "vkBindBufferMemory")
        vk.check(fn.vkMapMemory(device, memory[0], 0, vk.VK_WHOLE_SIZE, 0, mapped), "vkMapMemory")
        view = np.frombuffer(ffi.buffer(mapped[0], size), np.uint8)
        address = fn.vkGetBufferDeviceAddress(device, vk.new("VkBufferDeviceAddressInfo", buffer=handle[0]))
        made.append(Buffer(handle[0], memory[0], view, address))
        return made[-1]

    yield make
    for buffer in made:
        fn.vkDestroyBuffer(device, buffer.handle, vk.NULL)
        fn.vkFreeMemory(device, buffer.memory, vk.NULL)


def visible_type(minimal: Minimal, allowed: int) -> int:
    properties = ffi.new("VkPhysicalDeviceMemoryProperties *")
    minimal.instance_fn.vkGetPhysicalDeviceMemoryProperties(minimal.physical, properties)
    wanted = vk.VK_MEMORY_PROPERTY_HOST_VISIBLE_BIT | vk.VK_MEMORY_PROPERTY_HOST_COHERENT_BIT
    for index in range(properties.memoryTypeCount):
        if allowed >> index & 1 and properties.memoryTypes[index].propertyFlags & wanted == wanted:
            return index
    raise AssertionError("Vulkan promises a host-visible, coherent memory type")


TRANSFER = vk.VK_BUFFER_USAGE_TRANSFER_SRC_BIT | vk.VK_BUFFER_USAGE_TRANSFER_DST_BIT


# --- calls and results --------------------------------------------------------------------------------------


@pytest.mark.feature("device/checked-calls")
def test_a_failing_call_raises_with_its_name_arguments_and_a_hint(minimal: Minimal) -> None:
    info = vk.new(
        "VkDeviceCreateInfo",
        pQueueCreateInfos=[{"queueFamilyIndex": 0, "pQueuePriorities": [1.0]}],
        ppEnabledExtensionNames=["VK_KHR_no_such_thing"],
    )
    handle = ffi.new("VkDevice *")
    said = len(minimal.messages)
    code = minimal.instance_fn.vkCreateDevice(minimal.physical, info, vk.NULL, handle)
    del minimal.messages[said:]  # the loader rightly says something about that extension
    with pytest.raises(vk.VulkanError) as caught:
        vk.check(code, "vkCreateDevice", minimal.physical, info, 7, vk.NULL)
    error = caught.value
    assert isinstance(error, DeviceError)
    assert (error.call, error.code, error.result) == ("vkCreateDevice", -7, "VK_ERROR_EXTENSION_NOT_PRESENT")
    assert str(error).startswith("vkCreateDevice(")
    for part in (
        "VkPhysicalDevice",
        "VkDeviceCreateInfo *",
        "7",
        "NULL",
        "VK_ERROR_EXTENSION_NOT_PRESENT",
        "doctor",
    ):
        assert part in str(error)


NAMED_ERROR = {"VK_ERROR_PIPELINE_COMPILE_REQUIRED_EXT", "VK_ERROR_INCOMPATIBLE_SHADER_BINARY_EXT"}
"""Success codes in spite of their names; later headers rename them."""


@pytest.mark.feature("device/checked-calls")
def test_every_result_is_judged_by_its_sign() -> None:
    """The package raises on success codes, and has five errors with the sign lost."""
    results = ffi.typeof("VkResult").relements
    assert len(results) > 40
    for name, code in results.items():
        if code >= 0:
            assert vk.check(code, "vkCall") == code
        else:
            with pytest.raises(vk.VulkanError) as caught:
                vk.check(code, "vkCall")
            assert results[caught.value.result] == code  # one of the names that this number has
            assert f"vkCall() failed with {caught.value.result}" in str(caught.value)
        assert (code < 0) == (name.startswith("VK_ERROR") and name not in NAMED_ERROR), name
    with pytest.raises(vk.VulkanError, match=r"vkCall\(\) failed with -12345\."):
        vk.check(-12345, "vkCall")


@pytest.mark.feature("device/checked-calls")
def test_success_codes_of_real_calls_are_returned(minimal: Minimal) -> None:
    fn, device = minimal.fn, minimal.device
    fence = ffi.new("VkFence *")
    vk.check(fn.vkCreateFence(device, vk.new("VkFenceCreateInfo"), vk.NULL, fence), "vkCreateFence")
    assert vk.check(fn.vkGetFenceStatus(device, fence[0]), "vkGetFenceStatus") == vk.VK_NOT_READY == 1
    assert vk.check(fn.vkWaitForFences(device, 1, fence, 1, 1000), "vkWaitForFences") == vk.VK_TIMEOUT == 2
    fn.vkDestroyFence(device, fence[0], vk.NULL)
    count, one = ffi.new("uint32_t *", 1), ffi.new("VkExtensionProperties[1]")
    enumerate_ = minimal.instance_fn.vkEnumerateDeviceExtensionProperties
    assert vk.check(enumerate_(minimal.physical, vk.NULL, count, one), "list") == vk.VK_INCOMPLETE == 5


def test_lists_are_whole_however_often_they_change() -> None:
    """A list that grows between the two calls is asked for again: VK_INCOMPLETE is no error and no end."""
    lengths = iter([2, 3, 3, 5, 5, 5])
    current = [2]

    def enumerate_(count: Any, data: Any) -> int:
        current[0] = next(lengths)
        if data == vk.NULL:
            count[0] = current[0]
            return vk.VK_SUCCESS
        written = min(count[0], current[0])
        for index in range(written):
            data[index].specVersion = index + 1
        count[0] = written
        return vk.VK_INCOMPLETE if written < current[0] else vk.VK_SUCCESS

    items = vk.listed(enumerate_, "list", "VkExtensionProperties")
    gc.collect()
    # If the items did not keep the list's memory, these would get it.
    junk = [ffi.new("char[]", b"X" * 5 * ffi.sizeof("VkExtensionProperties")) for _ in range(100)]
    assert junk
    assert [item.specVersion for item in items] == [1, 2, 3, 4, 5]


def test_listed_structs_know_their_type_and_outlive_the_list(minimal: Minimal) -> None:
    call = minimal.instance_fn.vkGetPhysicalDeviceQueueFamilyProperties2  # returns nothing at all
    families = vk.listed(call, "families", "VkQueueFamilyProperties2", minimal.physical)
    last = families[-1]
    del families
    gc.collect()
    assert last.sType == vk.VK_STRUCTURE_TYPE_QUEUE_FAMILY_PROPERTIES_2
    assert last.queueFamilyProperties.queueCount >= 1


def test_core_functions_come_from_the_device_too(minimal: Minimal) -> None:
    """The package refuses vkGetDeviceProcAddr for every core function."""
    table = vk.Functions(lambda name: minimal.instance_fn.vkGetDeviceProcAddr(minimal.device, name))
    for name in ("vkCmdDraw", "vkQueueSubmit2", "vkGetPipelineCacheData", "vkGetBufferDeviceAddress"):
        function = getattr(table, name)
        assert ffi.typeof(function) is ffi.typeof(f"PFN_{name}")
        assert getattr(table, name) is function  # looked up once


def test_a_function_that_the_driver_lacks_is_named(minimal: Minimal) -> None:
    with pytest.raises(UnsupportedError, match=r"has no vkCmdDrawMeshTasksNV: .*\.$"):
        minimal.fn.vkCmdDrawMeshTasksNV  # noqa: B018
    with pytest.raises(AttributeError):
        minimal.fn.draw  # noqa: B018


# --- what the package loses or lacks ------------------------------------------------------------------------


def test_addresses_are_returned(buffers: Callable[..., Buffer]) -> None:
    """The package returns the argument in place of the address."""
    one, two = buffers(256, TRANSFER), buffers(256, TRANSFER)
    for buffer in (one, two):
        assert isinstance(buffer.address, int)
        assert buffer.address > 0
        assert buffer.address % 4 == 0
    assert abs(one.address - two.address) >= 256


def test_the_pipeline_cache_s_data_can_be_read(minimal: Minimal) -> None:
    """The package has no vkGetPipelineCacheData."""
    fn, device = minimal.fn, minimal.device
    cache, size = ffi.new("VkPipelineCache *"), ffi.new("size_t *")
    info = vk.new("VkPipelineCacheCreateInfo")
    vk.check(fn.vkCreatePipelineCache(device, info, vk.NULL, cache), "vkCreatePipelineCache")
    vk.check(fn.vkGetPipelineCacheData(device, cache[0], size, vk.NULL), "vkGetPipelineCacheData")
    data = np.zeros(size[0], np.uint8)
    vk.check(
        fn.vkGetPipelineCacheData(device, cache[0], size, ffi.from_buffer(data)), "vkGetPipelineCacheData"
    )
    fn.vkDestroyPipelineCache(device, cache[0], vk.NULL)
    properties = vk.new("VkPhysicalDeviceProperties2")
    minimal.instance_fn.vkGetPhysicalDeviceProperties2(minimal.physical, properties)
    # The header that the specification prescribes: length, version, vendor, device, UUID.
    header = data[:16].view(np.uint32)
    plain = properties.properties
    assert list(header) == [32, 1, plain.vendorID, plain.deviceID]
    assert bytes(data[16:32]) == bytes(plain.pipelineCacheUUID)
    again = vk.new("VkPipelineCacheCreateInfo", initialDataSize=data.nbytes, pInitialData=data)
    vk.check(fn.vkCreatePipelineCache(device, again, vk.NULL, cache), "vkCreatePipelineCache")
    fn.vkDestroyPipelineCache(device, cache[0], vk.NULL)


def test_mapped_memory_is_numpy_s_without_a_copy(minimal: Minimal, buffers: Callable[..., Buffer]) -> None:
    """VK_WHOLE_SIZE maps (the package overflows); what numpy writes the GPU copies, what it copies numpy reads."""
    source, target = buffers(4096, TRANSFER), buffers(4096, TRANSFER)
    source.bytes[:] = np.random.default_rng(0).integers(0, 256, 4096, dtype=np.uint8)
    target.bytes[:] = 0
    region = vk.array("VkBufferCopy", [{"srcOffset": 1024, "dstOffset": 0, "size": 2048}])

    def record(commands: Any) -> None:
        minimal.fn.vkCmdCopyBuffer(commands, source.handle, target.handle, 1, region)

    minimal.submit(record)
    assert (target.bytes[:2048] == source.bytes[1024:3072]).all()
    assert not target.bytes[2048:].any()


def test_query_results_go_into_numpy_and_may_not_be_ready(minimal: Minimal) -> None:
    fn, device = minimal.fn, minimal.device
    pool = ffi.new("VkQueryPool *")
    info = vk.new("VkQueryPoolCreateInfo", queryType=vk.VK_QUERY_TYPE_TIMESTAMP, queryCount=2)
    vk.check(fn.vkCreateQueryPool(device, info, vk.NULL, pool), "vkCreateQueryPool")
    values = np.zeros(2, np.uint64)

    def read() -> int:
        code = fn.vkGetQueryPoolResults(
            device, pool[0], 0, 2, values.nbytes, ffi.from_buffer(values), 8, vk.VK_QUERY_RESULT_64_BIT
        )
        return vk.check(code, "vkGetQueryPoolResults")

    def record(commands: Any, written: bool) -> None:
        fn.vkCmdResetQueryPool(commands, pool[0], 0, 2)
        for query in range(2 if written else 0):
            fn.vkCmdWriteTimestamp2(commands, vk.VK_PIPELINE_STAGE_2_ALL_COMMANDS_BIT, pool[0], query)

    minimal.submit(lambda commands: record(commands, False))
    assert read() == vk.VK_NOT_READY  # an exception in the package
    minimal.submit(lambda commands: record(commands, True))
    assert read() == vk.VK_SUCCESS
    assert 0 < values[0] <= values[1]
    fn.vkDestroyQueryPool(device, pool[0], vk.NULL)


def test_each_of_several_messengers_hears_everything(minimal: Minimal) -> None:
    """In the package the last one silently replaces the others."""
    if not minimal.has_debug_utils:
        pytest.skip("the loader has no VK_EXT_debug_utils")
    heard: list[list[str]] = [[], [], []]
    messengers = [add_messenger(minimal, texts.append) for texts in heard]
    gc.collect()
    data = vk.new("VkDebugUtilsMessengerCallbackDataEXT", pMessageIdName="test", pMessage="is heard")
    before = len(minimal.messages)
    minimal.instance_fn.vkSubmitDebugUtilsMessageEXT(
        minimal.instance,
        vk.VK_DEBUG_UTILS_MESSAGE_SEVERITY_WARNING_BIT_EXT,
        vk.VK_DEBUG_UTILS_MESSAGE_TYPE_GENERAL_BIT_EXT,
        data,
    )
    assert heard == [["is heard"]] * 3
    assert minimal.messages[before:] == ["is heard"]
    del minimal.messages[before:]
    for messenger in messengers:
        minimal.instance_fn.vkDestroyDebugUtilsMessengerEXT(minimal.instance, messenger[0], vk.NULL)


# --- ray tracing, where most of the wrong constants are -----------------------------------------------------


def test_an_acceleration_structure_has_an_address(minimal: Minimal, buffers: Callable[..., Buffer]) -> None:
    if not minimal.has_rays:
        pytest.skip("the device has no ray-tracing pipelines")
    fn, device = minimal.fn, minimal.device
    storage = buffers(4096, vk.VK_BUFFER_USAGE_ACCELERATION_STRUCTURE_STORAGE_BIT_KHR)
    made = ffi.new("VkAccelerationStructureKHR *")
    info = vk.new(
        "VkAccelerationStructureCreateInfoKHR",
        buffer=storage.handle,
        size=4096,
        type=vk.VK_ACCELERATION_STRUCTURE_TYPE_BOTTOM_LEVEL_KHR,
    )
    code = fn.vkCreateAccelerationStructureKHR(device, info, vk.NULL, made)
    vk.check(code, "vkCreateAccelerationStructureKHR", info)
    info = vk.new("VkAccelerationStructureDeviceAddressInfoKHR", accelerationStructure=made[0])
    address = fn.vkGetAccelerationStructureDeviceAddressKHR(device, info)
    assert isinstance(address, int)
    assert address > 0
    fn.vkDestroyAccelerationStructureKHR(device, made[0], vk.NULL)


def test_a_ray_pipeline_binds_and_its_handles_fit(minimal: Minimal) -> None:
    """Struct types and bind point as the package has them crash the layer and the driver; handles it makes 8x long."""
    if not minimal.has_rays:
        pytest.skip("the device has no ray-tracing pipelines")
    source = build_text("void main() {}", "rgen", "vulkan", extensions=["GL_EXT_ray_tracing"])
    try:
        code = glslang.compile_text(source.text, source.stage)
    except UnsupportedError as error:
        pytest.skip(str(error))
    fn, device = minimal.fn, minimal.device
    layout, module, pipeline = (
        ffi.new("VkPipelineLayout *"),
        ffi.new("VkShaderModule *"),
        ffi.new("VkPipeline *"),
    )
    info = vk.new("VkPipelineLayoutCreateInfo")
    vk.check(fn.vkCreatePipelineLayout(device, info, vk.NULL, layout), "vkCreatePipelineLayout")
    info = vk.new("VkShaderModuleCreateInfo", codeSize=len(code), pCode=code)
    vk.check(fn.vkCreateShaderModule(device, info, vk.NULL, module), "vkCreateShaderModule")
    unused = vk.VK_SHADER_UNUSED_KHR
    group = {
        "type": vk.VK_RAY_TRACING_SHADER_GROUP_TYPE_GENERAL_KHR,
        "generalShader": 0,
        "closestHitShader": unused,
        "anyHitShader": unused,
        "intersectionShader": unused,
    }
    stage = {"stage": vk.VK_SHADER_STAGE_RAYGEN_BIT_KHR, "module": module[0], "pName": "main"}
    info = vk.array(
        "VkRayTracingPipelineCreateInfoKHR",
        [{"pStages": [stage], "pGroups": [group], "maxPipelineRayRecursionDepth": 1, "layout": layout[0]}],
    )
    assert info[0].sType == 1000150015
    assert info[0].pGroups[0].sType == 1000150016
    made = fn.vkCreateRayTracingPipelinesKHR(device, vk.NULL, vk.NULL, 1, info, vk.NULL, pipeline)
    vk.check(made, "vkCreateRayTracingPipelinesKHR", info)
    properties = vk.new("VkPhysicalDeviceRayTracingPipelinePropertiesKHR")
    outer = vk.new("VkPhysicalDeviceProperties2", pNext=properties)
    minimal.instance_fn.vkGetPhysicalDeviceProperties2(minimal.physical, outer)
    size = properties.shaderGroupHandleSize
    handles = np.full(size + 256, 0xCD, np.uint8)
    view = ffi.from_buffer(handles)
    result = fn.vkGetRayTracingShaderGroupHandlesKHR(device, pipeline[0], 0, 1, size, view)
    vk.check(result, "vkGetRayTracingShaderGroupHandlesKHR")
    assert (handles[size:] == 0xCD).all()
    assert (handles[:size] != 0xCD).any()
    bind_point = vk.VK_PIPELINE_BIND_POINT_RAY_TRACING_KHR
    minimal.submit(lambda commands: fn.vkCmdBindPipeline(commands, bind_point, pipeline[0]))
    fn.vkDestroyPipeline(device, pipeline[0], vk.NULL)
    fn.vkDestroyShaderModule(device, module[0], vk.NULL)
    fn.vkDestroyPipelineLayout(device, layout[0], vk.NULL)


# --- the trace ----------------------------------------------------------------------------------------------


@pytest.mark.feature("device/api-trace")
def test_a_trace_lists_calls_and_arguments_and_keeps_results(
    minimal: Minimal, buffers: Callable[..., Buffer]
) -> None:
    target = buffers(64, TRANSFER)
    fn = vk.Functions(lambda name: minimal.instance_fn.vkGetDeviceProcAddr(minimal.device, name))
    minimal.fn, usual = fn, minimal.fn
    log: list[tuple[str, tuple[Any, ...]]] = []
    try:
        minimal.submit(lambda commands: fn.vkCmdFillBuffer(commands, target.handle, 0, 64, 1))
        assert log == []
        fn.trace(log)
        minimal.submit(lambda commands: fn.vkCmdFillBuffer(commands, target.handle, 0, 64, 0x01020304))
        names = [name for name, _ in log]
        assert names == [
            "vkCreateCommandPool",
            "vkAllocateCommandBuffers",
            "vkBeginCommandBuffer",
            "vkCmdFillBuffer",
            "vkEndCommandBuffer",
            "vkQueueSubmit2",
            "vkDeviceWaitIdle",
            "vkDestroyCommandPool",
        ]
        fill = log[3][1]
        assert fill[1:] == (target.handle, 0, 64, 0x01020304)
        assert log[5][1][0] == minimal.queue
        assert bytes(target.bytes[:4]) == b"\4\3\2\1"
        fence = ffi.new("VkFence *")
        assert fn.vkCreateFence(minimal.device, vk.new("VkFenceCreateInfo"), vk.NULL, fence) == vk.VK_SUCCESS
        assert fn.vkGetFenceStatus(minimal.device, fence[0]) == vk.VK_NOT_READY
        fn.trace(None)
        before = len(log)
        fn.vkDestroyFence(minimal.device, fence[0], vk.NULL)
        assert len(log) == before
        # Off means off: the members are C functions again, with nothing of Python's around them.
        assert ffi.typeof(fn.vkDestroyFence) is ffi.typeof("PFN_vkDestroyFence")
    finally:
        minimal.fn = usual


# --- the raw path -------------------------------------------------------------------------------------------


def microseconds(ours: Callable[[], Any], theirs: Callable[[], Any]) -> tuple[float, float]:
    """Return the time of one call of each: the best of 40 short turns, or of more until ours is the shorter one."""
    measures = {"ours": timed(ours, 50), "theirs": timed(theirs, 50)}
    least = least_times(measures, lambda least: least["ours"] < least["theirs"], fewest=40, seconds=1.0)
    return least["ours"] * 1e6, least["theirs"] * 1e6


@pytest.mark.alone
def test_raw_calls_and_structs_are_faster_than_the_package_s(
    minimal: Minimal, record_property: Callable[[str, object], None], capsys: pytest.CaptureFixture[str]
) -> None:
    """Record both; the figure that counts, 1,000 draws recorded, is a benchmark's."""
    try:
        import vulkan
        from vulkan._vulkan import ffi as other
    except (ImportError, OSError) as error:
        pytest.skip(f"the package does not load: {error}")
    pool = minimal.pool()
    commands = minimal.commands(pool)
    fn = minimal.fn
    vk.check(fn.vkBeginCommandBuffer(commands, vk.new("VkCommandBufferBeginInfo")), "vkBeginCommandBuffer")
    theirs = other.cast("VkCommandBuffer", int(ffi.cast("uintptr_t", commands)))
    info = vk.new("VkPipelineLayoutCreateInfo", pPushConstantRanges=[{"stageFlags": 1, "size": 16}])
    layout = ffi.new("VkPipelineLayout *")
    vk.check(fn.vkCreatePipelineLayout(minimal.device, info, vk.NULL, layout), "vkCreatePipelineLayout")
    their_layout = other.cast("VkPipelineLayout", int(ffi.cast("uintptr_t", layout[0])))
    data, their_data = ffi.new("char[16]"), other.new("char[16]")
    viewport = vk.array("VkViewport", [{"width": 1, "height": 1, "maxDepth": 1}])
    their_viewport = other.new("VkViewport[]", [{"width": 1, "height": 1, "maxDepth": 1}])
    barrier = {"srcStageMask": 1, "dstStageMask": 1, "srcAccessMask": 0, "dstAccessMask": 0}
    set_viewport, push = fn.vkCmdSetViewport, fn.vkCmdPushConstants
    rows: dict[str, tuple[Callable[[], Any], Callable[[], Any]]] = {
        "vkCmdSetViewport": (
            lambda: set_viewport(commands, 0, 1, viewport),
            lambda: vulkan.vkCmdSetViewport(theirs, 0, 1, their_viewport),
        ),
        "vkCmdPushConstants": (
            lambda: push(commands, layout[0], 1, 0, 16, data),
            lambda: vulkan.vkCmdPushConstants(theirs, their_layout, 1, 0, 16, their_data),
        ),
        "memory barrier": (
            lambda: vk.new("VkMemoryBarrier2", **barrier),
            lambda: vulkan.VkMemoryBarrier2(**barrier),
        ),
        "nested image barrier": (
            lambda: vk.new(
                "VkImageMemoryBarrier2", subresourceRange={"aspectMask": 1, "levelCount": 1}, **barrier
            ),
            lambda: vulkan.VkImageMemoryBarrier2(
                subresourceRange=vulkan.VkImageSubresourceRange(aspectMask=1, levelCount=1), **barrier
            ),
        ),
    }
    figures = {name: microseconds(*both) for name, both in rows.items()}
    fn.vkEndCommandBuffer(commands)
    fn.vkDestroyPipelineLayout(minimal.device, layout[0], vk.NULL)
    fn.vkDestroyCommandPool(minimal.device, pool, vk.NULL)
    with capsys.disabled():
        for name, (ours, packages) in figures.items():
            record_property(name, f"{ours:.2f} us, package {packages:.2f} us")
            print(f"\n  {name}: {ours:.2f} us, package {packages:.2f} us", end="")
    for name, (ours, packages) in figures.items():
        assert ours < packages, name
