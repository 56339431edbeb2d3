"""Pipelines with a rate, and which rates a device has."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Any

from backends.vulkan import api as vk
from backends.vulkan.device import Device
from backends.vulkan.driver import features as vf
from common.errors import UnsupportedError

from ...pipelines.description import PipelineDescription
from ...pipelines.vulkan import Pipelines
from ...rates.model import decode
from . import Settings, code_of, names_of

KEEP, REPLACE = (
    vk.VK_FRAGMENT_SHADING_RATE_COMBINER_OP_KEEP_KHR,
    vk.VK_FRAGMENT_SHADING_RATE_COMBINER_OP_REPLACE_KHR,
)
OF_PRIMITIVES = (vf.SHADING_RATE, "primitiveFragmentShadingRate")
BITS: dict[str, tuple[tuple[str, str], ...]] = {
    "vertex": (OF_PRIMITIVES,),
    "mesh": (OF_PRIMITIVES, (vf.MESH, "primitiveFragmentShadingRateMeshShader")),
}
"""The bits of features that a source needs beside those of the extension."""


@dataclass(frozen=True)
class Rated(PipelineDescription):
    """The description of a pipeline with a rate: its own, or one that a command sets, and what replaces it."""

    rate: tuple[int, int] = (1, 1)
    set_by_command: bool = False
    replaced: bool = False

    @property
    def combiners(self) -> list[int]:
        """What becomes of the rate of a primitive, and of that of an image, of which there is none."""
        return [REPLACE if self.replaced else KEEP, KEEP]


class RatedPipelines(Pipelines):
    """The chapter's pipelines, with rates."""

    @staticmethod
    def _finished(described: PipelineDescription, info: Any) -> Any:
        if not isinstance(described, Rated):
            return info
        states = list(info.pDynamicState.pDynamicStates[0 : info.pDynamicState.dynamicStateCount])
        states += [vk.VK_DYNAMIC_STATE_FRAGMENT_SHADING_RATE_KHR] * described.set_by_command
        dynamic = vk.new("VkPipelineDynamicStateCreateInfo", pDynamicStates=states)
        width, height = described.rate
        rate = vk.new(
            "VkPipelineFragmentShadingRateStateCreateInfoKHR",
            pNext=info.pNext,
            fragmentSize={"width": width, "height": height},
            combinerOps=described.combiners,
        )
        info.pNext, info.pDynamicState = rate, dynamic
        return vk.keep(info, rate, dynamic)


def command_of(size: tuple[int, int]) -> tuple[Any, Any]:
    """Return what vkCmdSetFragmentShadingRateKHR sets: a rate, and combiners that keep it."""
    extent = vk.new("VkExtent2D", width=size[0], height=size[1])
    return extent, vk.ffi.new("VkFragmentShadingRateCombinerOpKHR[2]", [KEEP, KEEP])


def rates_of(device: Device) -> list[tuple[int, int]]:
    """Return the rates of a device for pictures of one sample a pixel, (width, height) each."""
    count = vk.ffi.new("uint32_t *")
    ask = device.instance.fn.vkGetPhysicalDeviceFragmentShadingRatesKHR
    vk.check(ask(device.physical.handle, count, vk.NULL), "vkGetPhysicalDeviceFragmentShadingRatesKHR")
    blank = [vk.new("VkPhysicalDeviceFragmentShadingRateKHR") for _ in range(count[0])]
    listed = vk.array("VkPhysicalDeviceFragmentShadingRateKHR", blank)
    vk.check(ask(device.physical.handle, count, listed), "vkGetPhysicalDeviceFragmentShadingRatesKHR")
    return [
        (int(rate.fragmentSize.width), int(rate.fragmentSize.height))
        for rate in listed[0 : count[0]]
        if rate.sampleCounts & vk.VK_SAMPLE_COUNT_1_BIT
    ]


def check_device(device: Device, without: Collection[str], settings: Settings) -> None:
    """Raise UnsupportedError where the device lacks what the settings ask for."""
    needs = ["shading-rate", "pipeline-statistics", *["mesh-shader"] * (settings.source == "mesh")]
    for feature in needs:
        if feature in without:
            raise UnsupportedError(
                f"The study shading-rates needs {feature}, but it is switched off by --without."
            )
        if not device.has(feature):
            why = device.capabilities.why_not.get(feature, "the device lacks it")
            raise UnsupportedError(f"The study shading-rates needs {feature}, but {why}.")
    missing = device.physical.lacks(vf.Requirement(bits=BITS.get(settings.source, ())))
    if missing:
        raise UnsupportedError(
            f"The study shading-rates has rates of primitives, but {missing}; try --set source=dynamic."
        )
    sizes = rates_of(device)
    if decode(code_of(settings)) not in sizes:
        raise UnsupportedError(f"The device has no rate {settings.rate}: it has {names_of(sizes)}.")
