"""Shading rates of an attachment as state of a pipeline on Vulkan.

Three rates of a fragment are combined: that of the pipeline, of the primitive, and of the attachment's texel. The first
combiner keeps the pipeline's in place of the primitive's, the second one replaces it by the attachment's. Without this
state both combiners keep, and the attachment has no effect (Vulkan 1.3 specification, "Combining the Fragment Shading
Rates").
"""

from __future__ import annotations

from typing import Any

from backends.vulkan import api as vk


def rates_of_attachment() -> Any:
    """Return the VkPipelineFragmentShadingRateStateCreateInfoKHR of draws whose attachment decides."""
    return vk.new(
        "VkPipelineFragmentShadingRateStateCreateInfoKHR",
        fragmentSize={"width": 1, "height": 1},
        combinerOps=[
            vk.VK_FRAGMENT_SHADING_RATE_COMBINER_OP_KEEP_KHR,
            vk.VK_FRAGMENT_SHADING_RATE_COMBINER_OP_REPLACE_KHR,
        ],
    )
