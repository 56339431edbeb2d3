"""The Vulkan instance, what it finds on the machine, and the choice of a device among that."""

from __future__ import annotations

import os
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass, field
from itertools import pairwise
from typing import Any, Literal

from backends.selftest import verdicts
from backends.vulkan import api as vk
from backends.vulkan.driver import features as vf
from backends.vulkan.driver.debug import ValidationSink
from common.errors import UnsupportedError, UserError

VALIDATION_LAYER = "VK_LAYER_KHRONOS_validation"
SHADING_RATE = "VK_KHR_fragment_shading_rate"
PORTABILITY_ENUMERATION = (
    "VK_KHR_portability_enumeration"  # macOS: the loader lists MoltenVK only with this extension
)
NO_DEVICE = "No Vulkan 1.3 device was found ({}): ./strata doctor says what to install."


class Instance:
    """A Vulkan 1.3 instance. `validate` adds the validation layers with synchronization validation.

    `extensions` are needed, and UnsupportedError names a missing one; `wished` ones are enabled where they are offered.
    """

    def __init__(
        self, validate: bool = False, extensions: Iterable[str] = (), wished: Iterable[str] = ()
    ) -> None:
        functions, get = vk.global_functions()
        self.layers = {
            vk.text(layer.layerName): _version(layer.specVersion)
            for layer in vk.listed(
                functions.vkEnumerateInstanceLayerProperties,
                "vkEnumerateInstanceLayerProperties",
                "VkLayerProperties",
            )
        }
        offered = {
            vk.text(extension.extensionName)
            for extension in vk.listed(
                functions.vkEnumerateInstanceExtensionProperties,
                "vkEnumerateInstanceExtensionProperties",
                "VkExtensionProperties",
                vk.NULL,
            )
        }
        if validate and VALIDATION_LAYER not in self.layers:
            raise UnsupportedError(
                "The Vulkan validation layers are not installed: ./strata doctor says how, or run without --validate."
            )
        missing = sorted(set(extensions) - offered)
        if missing:
            raise UnsupportedError(f"The Vulkan loader lacks the instance extension {missing[0]}.")
        self.version = self._loader_version(functions)
        if self.version < (1, 3, 0):
            raise UnsupportedError(
                f"The Vulkan loader is version {_dotted(self.version)}; Strata needs 1.3 or newer."
            )
        self.validates = validate
        enabled = set(extensions) | offered.intersection(wished)
        self.has_debug_utils = validate or "VK_EXT_debug_utils" in offered
        if self.has_debug_utils:
            enabled.add("VK_EXT_debug_utils")
        if PORTABILITY_ENUMERATION in offered:
            enabled.add(PORTABILITY_ENUMERATION)
        self.sink = ValidationSink()
        chain: Any = self.sink.create_info() if self.has_debug_utils else None
        if validate:
            enabled.add("VK_EXT_validation_features")
            checks = [vk.VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT]
            chain = vk.new("VkValidationFeaturesEXT", pNext=chain, pEnabledValidationFeatures=checks)
        info = vk.new(
            "VkInstanceCreateInfo",
            pNext=chain,
            flags=vk.VK_INSTANCE_CREATE_ENUMERATE_PORTABILITY_BIT_KHR
            if PORTABILITY_ENUMERATION in enabled
            else 0,
            pApplicationInfo={"pApplicationName": "strata", "apiVersion": vk.VK_API_VERSION_1_3},
            ppEnabledLayerNames=[VALIDATION_LAYER] if validate else None,
            ppEnabledExtensionNames=sorted(enabled),
        )
        handle = vk.ffi.new("VkInstance *")
        code = functions.vkCreateInstance(info, vk.NULL, handle)
        if code == vk.VK_ERROR_INCOMPATIBLE_DRIVER:
            raise UnsupportedError(NO_DEVICE.format("the loader found no driver"))
        vk.check(code, "vkCreateInstance")
        self.handle = handle[0]
        self.extensions = frozenset(enabled)
        self.fn = vk.Functions(lambda name: get(self.handle, name))
        self._messenger: Any = None
        if self.has_debug_utils:
            messenger = vk.ffi.new("VkDebugUtilsMessengerEXT *")
            code = self.fn.vkCreateDebugUtilsMessengerEXT(
                self.handle, self.sink.create_info(), vk.NULL, messenger
            )
            vk.check(code, "vkCreateDebugUtilsMessengerEXT")
            self._messenger = messenger[0]

    @staticmethod
    def _loader_version(functions: vk.Functions) -> tuple[int, int, int]:
        version = vk.ffi.new("uint32_t *")
        vk.check(functions.vkEnumerateInstanceVersion(version), "vkEnumerateInstanceVersion")
        return _version(version[0])

    def devices(self) -> list[PhysicalDevice]:
        """Return every device that the drivers offer, described; devices below Vulkan 1.3 are among them."""
        handles = vk.listed(
            self.fn.vkEnumeratePhysicalDevices, "vkEnumeratePhysicalDevices", "VkPhysicalDevice", self.handle
        )
        return [describe(self, handle) for handle in handles]

    def close(self) -> None:
        """Destroy the instance; its devices must be closed before."""
        if self._messenger is not None:
            self.fn.vkDestroyDebugUtilsMessengerEXT(self.handle, self._messenger, vk.NULL)
            self._messenger = None
        if self.handle is not None:
            self.fn.vkDestroyInstance(self.handle, vk.NULL)
            self.handle = None

    def __enter__(self) -> Instance:
        return self

    def __exit__(self, *_: object) -> None:
        self.close()


@dataclass(frozen=True)
class QueueFamily:
    """One queue family: its flags and how many queues it has.

    `granularity` are the texels in whose multiples it copies parts of images; (0, 0, 0): whole mip levels only.
    """

    index: int
    flags: int
    count: int
    timestamp_bits: int
    granularity: tuple[int, int, int] = (1, 1, 1)

    def has(self, flags: int) -> bool:
        """Whether all `flags` are there. Graphics and compute families can copy, whether they say so or not."""
        own = self.flags
        if own & (vk.VK_QUEUE_GRAPHICS_BIT | vk.VK_QUEUE_COMPUTE_BIT):
            own |= vk.VK_QUEUE_TRANSFER_BIT
        return own & flags == flags


@dataclass(frozen=True)
class PhysicalDevice:
    """A device as its driver describes it.

    `bits` are the supported (struct, member) feature bits, `properties` those of `driver.features.Requirement`.
    """

    handle: Any
    index: int
    name: str
    driver: str
    kind: Literal["discrete", "integrated", "virtual", "software", "other"]
    version: tuple[int, int, int]
    extensions: frozenset[str]
    bits: frozenset[tuple[str, str]]
    families: tuple[QueueFamily, ...]
    limits: Any
    cache_uuid: str
    properties: frozenset[str] = frozenset()
    rates: Mapping[str, int] = field(default_factory=dict)
    """The limits of shading rates; empty without them. See `shading_rates`."""

    def lacks(self, requirement: vf.Requirement) -> str | None:
        """Return what is missing for `requirement` in a few words, or None if nothing is."""
        for extension in requirement.extensions:
            if extension not in self.extensions:
                return f"the driver lacks {extension}"
        for struct, member in requirement.bits:
            if (struct, member) not in self.bits:
                return f"the driver lacks the feature {member}"
        for name in requirement.properties:
            if name not in self.properties:
                return f"the driver lacks {name}"
        return None

    @property
    def identity(self) -> verdicts.Identity:
        """Under which name verdicts on this device are kept."""
        return verdicts.Identity(self.name, self.driver, self.cache_uuid)

    def wrong(self) -> dict[str, str]:
        """Return "feature/use" -> what is wrong with it, by the self-tests of this driver and what is known of it."""
        return verdicts.broken(self.driver, verdicts.read(self.identity))

    def unfit(self) -> str | None:
        """Return why Strata cannot use this device at all, or None: what it lacks, or what self-tests found wrong."""
        return self.lacking() or verdicts.unfit(self.wrong())

    def lacking(self) -> str | None:
        """Return what this device lacks, by its driver's word, of what every chapter needs, or None."""
        if self.version < (1, 3, 0):
            return f"it offers Vulkan {_dotted(self.version)}, and 1.3 is needed"
        if not any(
            family.has(vk.VK_QUEUE_GRAPHICS_BIT | vk.VK_QUEUE_COMPUTE_BIT) for family in self.families
        ):
            return "it has no queue for graphics and compute"
        return self.lacks(vf.FLOOR)


def find_family(families: Sequence[QueueFamily], wanted: int, avoid: int = 0) -> int:
    """Return the index of the first family with queues, all of `wanted` and none of `avoid`; raise LookupError if none.

    Family 0 is a valid answer, so "none" cannot be a number.
    """
    for family in families:
        if family.count and family.has(wanted) and not family.flags & avoid:
            return family.index
    raise LookupError(f"no queue family has flags {wanted:#x} without {avoid:#x}")


_KINDS: dict[int, Literal["discrete", "integrated", "virtual", "software", "other"]] = {
    1: "integrated",
    2: "discrete",
    3: "virtual",
    4: "software",
}
_PREFERENCE = ("discrete", "integrated", "virtual", "other", "software")


def _extent(family: Any) -> tuple[int, int, int]:
    tile = family.minImageTransferGranularity
    return int(tile.width), int(tile.height), int(tile.depth)


def describe(instance: Instance, handle: Any) -> PhysicalDevice:
    """Ask the driver for everything that a choice depends on."""
    fn = instance.fn
    driver = vk.new("VkPhysicalDeviceDriverProperties")
    properties = vk.new("VkPhysicalDeviceProperties2")
    fn.vkGetPhysicalDeviceProperties(handle, vk.ffi.addressof(properties, "properties"))
    version = _version(properties.properties.apiVersion)
    of_version_1_1 = vk.new("VkPhysicalDeviceVulkan11Properties", pNext=driver)
    if version >= (1, 2, 0):
        properties.pNext = vk.ffi.cast("void *", of_version_1_1)
        fn.vkGetPhysicalDeviceProperties2(handle, properties)
    extensions = frozenset(
        vk.text(item.extensionName)
        for item in vk.listed(
            fn.vkEnumerateDeviceExtensionProperties,
            "vkEnumerateDeviceExtensionProperties",
            "VkExtensionProperties",
            handle,
            vk.NULL,
        )
    )
    stages = vk.VK_SHADER_STAGE_FRAGMENT_BIT | vk.VK_SHADER_STAGE_COMPUTE_BIT
    adds_up = of_version_1_1.subgroupSupportedOperations & vk.VK_SUBGROUP_FEATURE_ARITHMETIC_BIT
    everywhere = of_version_1_1.subgroupSupportedStages & stages == stages
    bits: set[tuple[str, str]] = set()
    if version >= (1, 3, 0):
        chain = feature_chain(vf.CORE, vf.V11, vf.V12, vf.V13, *_structs_of(extensions))
        fn.vkGetPhysicalDeviceFeatures2(handle, chain[vf.CORE])
        for struct, pointer in chain.items():
            target = pointer.features if struct == vf.CORE else pointer
            bits |= {
                (struct, m) for m in dir(target) if m not in ("sType", "pNext") and getattr(target, m) == 1
            }
    count = vk.ffi.new("uint32_t *")
    fn.vkGetPhysicalDeviceQueueFamilyProperties(handle, count, vk.NULL)
    raw = vk.ffi.new("VkQueueFamilyProperties[]", count[0])
    fn.vkGetPhysicalDeviceQueueFamilyProperties(handle, count, raw)
    families = tuple(
        QueueFamily(i, raw[i].queueFlags, raw[i].queueCount, raw[i].timestampValidBits, _extent(raw[i]))
        for i in range(count[0])
    )
    plain = properties.properties
    return PhysicalDevice(
        handle=handle,
        index=0,
        name=vk.text(plain.deviceName),
        driver=f"{vk.text(driver.driverName)} {vk.text(driver.driverInfo)}".strip(),
        kind=_KINDS.get(int(plain.deviceType), "other"),
        version=version,
        extensions=extensions,
        bits=frozenset(bits),
        families=families,
        limits=vk.keep(vk.ffi.addressof(plain, "limits"), properties, driver),
        cache_uuid=bytes(plain.pipelineCacheUUID).hex(),
        properties=frozenset({vf.SUBGROUPS} if adds_up and everywhere else ()),
        rates=shading_rates(fn, handle) if SHADING_RATE in extensions else {},
    )


def shading_rates(fn: vk.Functions, handle: Any) -> dict[str, int]:
    """Return what a device with VK_KHR_fragment_shading_rate says of rates at one sample a pixel.

    "shadingRates" has bit `code` of each size of a fragment: 4 log2(width) + log2(height). The others are the least and
    most pixels along a square texel of an attachment.
    """
    limits = vk.new("VkPhysicalDeviceFragmentShadingRatePropertiesKHR")
    fn.vkGetPhysicalDeviceProperties2(handle, vk.new("VkPhysicalDeviceProperties2", pNext=limits))
    least = limits.minFragmentShadingRateAttachmentTexelSize
    most = limits.maxFragmentShadingRateAttachmentTexelSize
    call = "vkGetPhysicalDeviceFragmentShadingRatesKHR"
    offered = vk.listed(getattr(fn, call), call, "VkPhysicalDeviceFragmentShadingRateKHR", handle)
    sizes = [it.fragmentSize for it in offered if it.sampleCounts & vk.VK_SAMPLE_COUNT_1_BIT]
    codes = {(size.width.bit_length() - 1) << 2 | (size.height.bit_length() - 1) for size in sizes}
    return {
        "shadingRates": sum(1 << code for code in codes),
        "minShadingRateTexel": max(int(least.width), int(least.height)),
        "maxShadingRateTexel": min(int(most.width), int(most.height)),
    }


def _structs_of(extensions: frozenset[str]) -> list[str]:
    return [struct for struct, extension in vf.STRUCT_EXTENSIONS.items() if extension in extensions]


def feature_chain(*structs: str) -> dict[str, Any]:
    """Return the named feature structs chained by pNext in this order, the first one owning the rest."""
    filled = {name: vk.new(name) for name in structs}
    pointers = list(filled.values())
    for first, second in pairwise(pointers):
        first.pNext = vk.ffi.cast("void *", second)
    vk.keep(pointers[0], *pointers[1:])
    return filled


def choose(devices: Sequence[PhysicalDevice], wanted: str | None = None) -> PhysicalDevice:
    """Return the device to use: the one named (part of its name, or its number), else the strongest kind first.

    `wanted` defaults to the environment's STRATA_DEVICE. Raises UserError when the named one is not there or not fit,
    UnsupportedError when none is fit. There is no silent fallback from a named device to another.
    """
    wanted = wanted if wanted is not None else os.environ.get("STRATA_DEVICE") or None
    names = ", ".join(f"{number}: {device.name}" for number, device in enumerate(devices))
    if wanted is not None:
        named = [
            device
            for number, device in enumerate(devices)
            if wanted == str(number) or (not wanted.isdigit() and wanted.lower() in device.name.lower())
        ]
        if not named:
            raise UserError(f"No Vulkan device matches '{wanted}'; the devices are: {names or 'none'}.")
        reason = named[0].unfit()
        if reason:
            raise UserError(f"The Vulkan device '{named[0].name}' cannot be used: {reason}.")
        return named[0]
    fit = [device for device in devices if device.unfit() is None]
    if not fit:
        detail = "; ".join(f"{device.name}: {device.unfit()}" for device in devices)
        raise UnsupportedError(NO_DEVICE.format(detail or "the loader found no driver"))
    return min(fit, key=lambda device: _PREFERENCE.index(device.kind))


def _version(packed: int) -> tuple[int, int, int]:
    return (packed >> 22) & 0x7F, (packed >> 12) & 0x3FF, packed & 0xFFF


def _dotted(version: tuple[int, int, int]) -> str:
    return ".".join(map(str, version))
