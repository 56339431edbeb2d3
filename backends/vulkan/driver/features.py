"""Which extensions and feature bits stand behind each of Strata's features, and what is asked of every device."""

from __future__ import annotations

from dataclasses import dataclass


@dataclass(frozen=True)
class Requirement:
    """Device extensions, (struct, member) feature bits and properties in words that all must be there."""

    extensions: tuple[str, ...] = ()
    bits: tuple[tuple[str, str], ...] = ()
    properties: tuple[str, ...] = ()


CORE = "VkPhysicalDeviceFeatures2"
V11 = "VkPhysicalDeviceVulkan11Features"
V12 = "VkPhysicalDeviceVulkan12Features"
V13 = "VkPhysicalDeviceVulkan13Features"
MESH = "VkPhysicalDeviceMeshShaderFeaturesEXT"
ACCELERATION = "VkPhysicalDeviceAccelerationStructureFeaturesKHR"
RAY_PIPELINE = "VkPhysicalDeviceRayTracingPipelineFeaturesKHR"
RAY_QUERY = "VkPhysicalDeviceRayQueryFeaturesKHR"
SHADING_RATE = "VkPhysicalDeviceFragmentShadingRateFeaturesKHR"

SUBGROUPS = "subgroup arithmetic in fragment and compute shaders"
"""What no feature bit tells, but VkPhysicalDeviceVulkan11Properties."""

FLOOR = Requirement(
    bits=(
        (V12, "timelineSemaphore"),
        (V12, "bufferDeviceAddress"),
        (V12, "scalarBlockLayout"),
        (V12, "hostQueryReset"),
        (V13, "dynamicRendering"),
        (V13, "synchronization2"),
        (V13, "maintenance4"),
    )
)
"""What Vulkan 1.3 guarantees and Strata always enables."""

OPTIONAL: dict[str, Requirement] = {
    "anisotropy": Requirement(bits=((CORE, "samplerAnisotropy"),)),
    "bindless": Requirement(
        bits=(
            (V12, "descriptorIndexing"),
            (V12, "runtimeDescriptorArray"),
            (V12, "descriptorBindingPartiallyBound"),
            (V12, "descriptorBindingVariableDescriptorCount"),
            (V12, "descriptorBindingSampledImageUpdateAfterBind"),
            (V12, "descriptorBindingStorageImageUpdateAfterBind"),
            (V12, "shaderSampledImageArrayNonUniformIndexing"),
            (V12, "shaderStorageImageArrayNonUniformIndexing"),
            (CORE, "shaderStorageImageWriteWithoutFormat"),
        )
    ),
    "block-compression": Requirement(bits=((CORE, "textureCompressionBC"),)),
    "draw-indirect-count": Requirement(bits=((V12, "drawIndirectCount"), (CORE, "multiDrawIndirect"))),
    "etc2": Requirement(bits=((CORE, "textureCompressionETC2"),)),
    "fp64": Requirement(bits=((CORE, "shaderFloat64"),)),
    "int64": Requirement(bits=((CORE, "shaderInt64"),)),
    "mesh-shader": Requirement(("VK_EXT_mesh_shader",), ((MESH, "taskShader"), (MESH, "meshShader"))),
    "multi-draw": Requirement(bits=((CORE, "multiDrawIndirect"), (CORE, "drawIndirectFirstInstance"))),
    "pipeline-statistics": Requirement(bits=((CORE, "pipelineStatisticsQuery"),)),
    "ray-query": Requirement(
        ("VK_KHR_acceleration_structure", "VK_KHR_deferred_host_operations", "VK_KHR_ray_query"),
        ((ACCELERATION, "accelerationStructure"), (RAY_QUERY, "rayQuery")),
    ),
    "ray-tracing": Requirement(
        ("VK_KHR_acceleration_structure", "VK_KHR_deferred_host_operations", "VK_KHR_ray_tracing_pipeline"),
        ((ACCELERATION, "accelerationStructure"), (RAY_PIPELINE, "rayTracingPipeline")),
    ),
    "sampler-minmax": Requirement(bits=((V12, "samplerFilterMinmax"),)),
    "shading-rate": Requirement(
        ("VK_KHR_fragment_shading_rate",),
        (
            (SHADING_RATE, "pipelineFragmentShadingRate"),
            (SHADING_RATE, "attachmentFragmentShadingRate"),
            (CORE, "shaderStorageImageExtendedFormats"),  # a shader writes the bytes of the attachment
        ),
    ),
    "sparse": Requirement(
        bits=((CORE, "sparseBinding"), (CORE, "sparseResidencyImage2D"), (CORE, "shaderResourceResidency"))
    ),
    "subgroups": Requirement(properties=(SUBGROUPS,)),
    "types-16bit": Requirement(
        bits=((V11, "storageBuffer16BitAccess"), (V12, "shaderFloat16"), (CORE, "shaderInt16"))
    ),
    "wireframe": Requirement(bits=((CORE, "fillModeNonSolid"),)),
}
"""Strata's optional features, see `backends.contract.FEATURES`. Queues are decided from the families."""

EXTRA_BITS: tuple[tuple[str, str], ...] = (
    # Enabled where they are there; nothing takes another path without them.
    (CORE, "geometryShader"),  # for gl_PrimitiveID in fragment shaders
    (CORE, "tessellationShader"),
    (CORE, "independentBlend"),
    (CORE, "imageCubeArray"),
    (CORE, "drawIndirectFirstInstance"),
    (CORE, "shaderSampledImageArrayDynamicIndexing"),
    (CORE, "shaderStorageImageExtendedFormats"),  # for mip levels of one and two channels
    (CORE, "shaderStorageImageWriteWithoutFormat"),
    (CORE, "sparseResidencyAliased"),  # for memory that is bound in several places
    (CORE, "sparseResidencyBuffer"),
    (CORE, "fragmentStoresAndAtomics"),
    (CORE, "vertexPipelineStoresAndAtomics"),
    (V11, "shaderDrawParameters"),
    (V12, "uniformBufferStandardLayout"),
)

BESIDE: dict[tuple[str, str], frozenset[str]] = {
    # Enabled where they are there, beside features whose extensions they belong to; studies use them.
    (SHADING_RATE, "primitiveFragmentShadingRate"): frozenset({"shading-rate"}),
    (MESH, "primitiveFragmentShadingRateMeshShader"): frozenset({"shading-rate", "mesh-shader"}),
}

EXTRA_EXTENSIONS: dict[str, frozenset[str]] = {
    # Enabled where they are there, beside features that they add to.
    "VK_KHR_pipeline_library": frozenset({"ray-tracing"}),
}

STRUCT_EXTENSIONS = {
    MESH: "VK_EXT_mesh_shader",
    ACCELERATION: "VK_KHR_acceleration_structure",
    RAY_PIPELINE: "VK_KHR_ray_tracing_pipeline",
    RAY_QUERY: "VK_KHR_ray_query",
    SHADING_RATE: "VK_KHR_fragment_shading_rate",
}
"""Feature structs that may be chained only where their extension is offered."""
