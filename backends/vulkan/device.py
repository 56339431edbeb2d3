"""The logical device: negotiated features, queues, checked creation and destruction, and the count of what lives."""

from __future__ import annotations

import sys
from collections.abc import Iterable
from dataclasses import dataclass
from typing import TYPE_CHECKING, Any

from backends.contract import Capabilities, check_without
from backends.selftest import verdicts
from backends.vulkan import api as vk
from backends.vulkan.driver import features as vf
from backends.vulkan.instance import Instance, PhysicalDevice, choose, feature_chain, find_family
from common.errors import DeviceError
from common.names import visible

if TYPE_CHECKING:
    from backends.vulkan.window.display import Display

_OBJECT_TYPES = {
    name.removeprefix("VK_OBJECT_TYPE_").replace("_", "").lower(): value
    for name, value in vk.ffi.typeof("VkObjectType").relements.items()
}

_NAME_INFO = vk.ffi.typeof("VkDebugUtilsObjectNameInfoEXT *")

LIMITS = (
    "maxImageDimension2D",
    "maxImageDimension3D",
    "maxPushConstantsSize",
    "maxBoundDescriptorSets",
    "maxPerStageDescriptorStorageBuffers",
    "maxPerStageDescriptorSamplers",
    "maxStorageBufferRange",
    "minUniformBufferOffsetAlignment",
    "minStorageBufferOffsetAlignment",
    "maxComputeWorkGroupInvocations",
    "maxComputeSharedMemorySize",
    "maxSamplerAllocationCount",
)
"""The limits that `Capabilities` reports."""


@dataclass(frozen=True)
class Queue:
    """A queue to submit to."""

    handle: Any
    family: int
    flags: int


class Device:
    """A Vulkan device with every optional feature that it has and `without` does not take away.

    Everything is created by `create` and destroyed by `destroy`, so that `close` can name what was forgotten.
    With `believe` the driver's word counts, whatever self-tests said about it.
    """

    def __init__(
        self,
        instance: Instance,
        physical: PhysicalDevice | None = None,
        without: Iterable[str] = (),
        extensions: Iterable[str] = (),
        *,
        believe: bool = False,
    ) -> None:
        self.instance = instance
        self.physical = physical or choose(instance.devices())
        self.capabilities = capabilities(self.physical, believe)
        self.without = check_without(without)
        self.features = self.capabilities.features - self.without
        self.limits = self.physical.limits
        self.sink = instance.sink
        self.alive: dict[tuple[str, int], str] = {}
        self.display: Display | None = None
        """What the window shows on, set by its `Screen`; None without a window."""
        families = self._pick_families()
        enabled, bits = self._negotiate(set(extensions))
        chain = feature_chain(vf.CORE, *sorted({struct for struct, _ in bits} - {vf.CORE}))
        for struct, member in bits:
            setattr(chain[struct].features if struct == vf.CORE else chain[struct], member, 1)
        info = vk.new(
            "VkDeviceCreateInfo",
            pNext=chain[vf.CORE],
            pQueueCreateInfos=[
                {"queueFamilyIndex": family, "pQueuePriorities": [1.0], "queueCount": 1}
                for family in sorted(families)
            ],
            ppEnabledExtensionNames=sorted(enabled),
        )
        handle = vk.ffi.new("VkDevice *")
        code = instance.fn.vkCreateDevice(self.physical.handle, info, vk.NULL, handle)
        vk.check(code, "vkCreateDevice", self.physical.handle)
        self.handle = handle[0]
        self.extensions = frozenset(enabled)
        resolve = instance.fn.vkGetDeviceProcAddr
        self.fn = vk.Functions(lambda name: resolve(self.handle, name))
        self.queue = self._queue(self._graphics)
        self.compute_queue = self._queue(self._compute) if self._compute is not None else None
        self.transfer_queue = self._queue(self._transfer) if self._transfer is not None else None
        self._closers: list[Any] = []
        from backends.vulkan.memory import MemoryAllocator

        self.memory = MemoryAllocator(self)

    def _pick_families(self) -> set[int]:
        families = self.physical.families
        self._graphics = find_family(families, vk.VK_QUEUE_GRAPHICS_BIT | vk.VK_QUEUE_COMPUTE_BIT)
        self._compute: int | None = None
        self._transfer: int | None = None
        if "async-compute" in self.features:
            self._compute = find_family(families, vk.VK_QUEUE_COMPUTE_BIT, vk.VK_QUEUE_GRAPHICS_BIT)
        if "async-transfer" in self.features:
            both = vk.VK_QUEUE_GRAPHICS_BIT | vk.VK_QUEUE_COMPUTE_BIT
            self._transfer = find_family(families, vk.VK_QUEUE_TRANSFER_BIT, both)
        return {f for f in (self._graphics, self._compute, self._transfer) if f is not None}

    def _negotiate(self, enabled: set[str]) -> tuple[set[str], set[tuple[str, str]]]:
        """Return the extensions and feature bits to enable: the floor, the wanted features, the harmless extras."""
        bits = set(vf.FLOOR.bits) | {bit for bit in vf.EXTRA_BITS if bit in self.physical.bits}
        for feature in self.features & vf.OPTIONAL.keys():
            enabled |= set(vf.OPTIONAL[feature].extensions)
            bits |= set(vf.OPTIONAL[feature].bits)
        beside = {bit for bit, features in vf.BESIDE.items() if features <= self.features}
        bits |= beside & self.physical.bits
        more = {name for name, features in vf.EXTRA_EXTENSIONS.items() if features <= self.features}
        enabled |= more & self.physical.extensions
        missing = sorted(enabled - self.physical.extensions)
        if missing:
            raise DeviceError(f"The device '{self.physical.name}' lacks the extension {missing[0]}.")
        # An implementation that is not fully conformant (MoltenVK) demands that its programs say they know.
        if "VK_KHR_portability_subset" in self.physical.extensions:
            enabled.add("VK_KHR_portability_subset")
        return enabled, bits

    def _queue(self, family: int) -> Queue:
        out = vk.ffi.new("VkQueue *")
        self.fn.vkGetDeviceQueue(self.handle, family, 0, out)
        return Queue(out[0], family, self.physical.families[family].flags)

    def has(self, feature: str) -> bool:
        """Whether the native path of `feature` is enabled."""
        return feature in self.features

    # --- objects ---

    def create(self, call: str, info: Any, name: str = "") -> Any:
        """Call `vkCreate...` or `vkAllocateMemory`, check, name the object, and note that it lives."""
        ctype = "VkDeviceMemory" if call == "vkAllocateMemory" else "Vk" + call.removeprefix("vkCreate")
        out = vk.ffi.new(f"{ctype} *")
        vk.check(getattr(self.fn, call)(self.handle, info, vk.NULL, out), call, self.handle, info)
        self.adopt(ctype, out[0], name)
        return out[0]

    def create_pipelines(self, call: str, infos: Any, names: list[str], cache: Any = vk.NULL) -> list[Any]:
        """Call `vkCreateGraphicsPipelines` or `vkCreateComputePipelines` for an array of infos."""
        out = vk.ffi.new("VkPipeline[]", len(names))
        code = getattr(self.fn, call)(self.handle, cache, len(names), infos, vk.NULL, out)
        vk.check(code, call, self.handle, infos)
        for handle, name in zip(out, names, strict=True):
            self.adopt("VkPipeline", handle, name)
        return list(out)

    def adopt(self, ctype: str, handle: Any, name: str = "") -> None:
        """Note that an object lives that was made by another call than `create`."""
        self.alive[ctype, _integer(handle)] = name
        if name:
            self.name(ctype, handle, name)

    def name(self, ctype: str, handle: Any, name: str) -> None:
        """Give an object the name under which messages, captures and traces show it."""
        if not self.instance.has_debug_utils:
            return
        # A scene has hundreds of objects: filled field by field, which takes a quarter of the time of `vk.new`.
        info, text = vk.ffi.new(_NAME_INFO), vk.ffi.new("char[]", visible(name).encode())
        info.sType = vk.VK_STRUCTURE_TYPE_DEBUG_UTILS_OBJECT_NAME_INFO_EXT
        info.objectType, info.objectHandle = _OBJECT_TYPES[ctype[2:].lower()], _integer(handle)
        info.pObjectName = text
        vk.check(self.fn.vkSetDebugUtilsObjectNameEXT(self.handle, info), "vkSetDebugUtilsObjectNameEXT")

    def destroy(self, ctype: str, handle: Any) -> None:
        """Destroy an object that `create` or `adopt` noted; a second time is an error."""
        if self.alive.pop((ctype, _integer(handle)), None) is None:
            raise DeviceError(f"A {ctype} was destroyed twice, or was never made on this device.")
        call = "vkFreeMemory" if ctype == "VkDeviceMemory" else "vkDestroy" + ctype[2:]
        getattr(self.fn, call)(self.handle, handle, vk.NULL)

    def at_close(self, close: Any) -> None:
        """Call `close()` when the device closes, last given first: for objects that live as long as the device."""
        self._closers.append(close)

    # --- lifetime ---

    def wait_idle(self) -> None:
        """Wait until the device has nothing left to do."""
        vk.check(self.fn.vkDeviceWaitIdle(self.handle), "vkDeviceWaitIdle")

    def close(self) -> None:
        """Destroy the device; raise DeviceError naming whatever is still alive on it."""
        if self.handle is None:
            return
        self.fn.vkDeviceWaitIdle(self.handle)  # after a lost device there is nothing to wait for
        for closer in reversed(self._closers):
            closer()
        self._closers.clear()
        self.memory.close()
        ending = sys.exception()
        if isinstance(ending, DeviceError) and ending.is_full:  # it may have come between any two creations
            for ctype, handle in reversed([*self.alive]):
                self.destroy(ctype, vk.ffi.cast(ctype, handle))
        left = [f"{ctype} '{name}'" if name else ctype for (ctype, _), name in self.alive.items()]
        if not left:
            self.fn.vkDestroyDevice(self.handle, vk.NULL)
        self.handle = None
        # Ctrl-C may come between any two lines: what it left behind is no fault of the code.
        if left and not isinstance(ending, KeyboardInterrupt):
            shown = ", ".join(left[:8]) + (", ..." if len(left) > 8 else "")
            raise DeviceError(f"{len(left)} objects outlived their device: {shown}.")

    def __enter__(self) -> Device:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


def _integer(handle: Any) -> int:
    return int(vk.ffi.cast("uintptr_t", handle))


def capabilities(physical: PhysicalDevice, believe: bool = False) -> Capabilities:
    """Return what `physical` can do, in Strata's feature names: what it says, less what self-tests found wrong.

    With `believe` it is all that the driver says.
    """
    why_not: dict[str, str] = {}
    for feature, requirement in vf.OPTIONAL.items():
        reason = physical.lacks(requirement)
        if reason:
            why_not[feature] = reason
    graphics, compute = vk.VK_QUEUE_GRAPHICS_BIT, vk.VK_QUEUE_COMPUTE_BIT
    for feature, wanted, avoid in (
        ("async-compute", compute, graphics),
        ("async-transfer", vk.VK_QUEUE_TRANSFER_BIT, graphics | compute),
    ):
        try:
            find_family(physical.families, wanted, avoid)
        except LookupError:
            why_not[feature] = "the device has no queue family for it alone"
    if "sparse" not in why_not and not any(
        f.flags & vk.VK_QUEUE_SPARSE_BINDING_BIT for f in physical.families
    ):
        why_not["sparse"] = "no queue can bind sparse memory"
    said = Capabilities(
        backend="vulkan",
        device=physical.name,
        driver=physical.driver,
        api_version=physical.version,
        kind=physical.kind,
        features=frozenset({*vf.OPTIONAL, "async-compute", "async-transfer"} - why_not.keys()),
        why_not=why_not,
        limits={name: int(getattr(physical.limits, name)) for name in LIMITS} | dict(physical.rates),
    )
    if believe:
        return said
    return verdicts.apply(said, physical.wrong())
