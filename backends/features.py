"""The optional features of devices by their names, and what each is used for, which self-tests try."""

from __future__ import annotations

FEATURES: dict[str, tuple[str, str]] = {
    # name: (what it gives, the path taken without it)
    "anisotropy": ("anisotropic texture filtering", "trilinear filtering"),
    "async-compute": (
        "a compute queue beside the graphics queue",
        "one queue, same graph, submitted in order",
    ),
    "async-transfer": ("a transfer queue of its own", "one queue, same semaphores, submitted in order"),
    "bindless": ("one unbounded array of textures", "texture arrays in sets of fixed size"),
    "block-compression": ("textures in compressed blocks (BC4, BC5, BC7)", "textures of 8 bits a channel"),
    "fp64": ("64-bit floats in shaders", "32-bit floats"),
    "draw-indirect-count": (
        "draws whose number is on the GPU",
        "draws of zero instances at the end of the list",
    ),
    "etc2": ("textures in compressed blocks (ETC2)", "textures of 8 bits a channel"),
    "int64": ("64-bit integers in shaders", "pairs of 32-bit integers"),
    "mesh-shader": ("task and mesh shaders", "compute culling and compacted indirect draws"),
    "multi-draw": ("one call for many draws, which a buffer describes", "a call for each draw"),
    "pipeline-statistics": ("counts of the GPU's own work", "counters of the program alone"),
    "ray-query": ("rays in any shader", "traversal of our own BVH in compute"),
    "ray-tracing": ("ray-tracing pipelines", "traversal of our own BVH in compute"),
    "sampler-minmax": ("minimum and maximum filters", "four fetches in the shader"),
    "shading-rate": ("variable rate shading", "the lighting function in compute, one sample a block"),
    "sparse": ("sparse residency of images", "a software page table over an atlas"),
    "subgroups": ("arithmetic over invocations that run together", "arithmetic of each invocation alone"),
    "types-16bit": ("16-bit types in shaders and buffers", "packed 32-bit words"),
    "wireframe": ("lines in place of filled triangles", "edges from barycentric coordinates"),
}
"""Every optional feature that some chapter uses, in the words of the plan table."""

MAIN_USES: dict[str, tuple[str, ...]] = {
    "anisotropy": ("sampled",),
    "async-compute": ("hand-over",),
    "async-transfer": ("hand-over",),
    "bindless": ("sampled",),
    "block-compression": ("sampled",),
    "draw-indirect-count": ("draw",),
    "fp64": ("arithmetic",),
    "etc2": ("sampled",),
    "int64": ("arithmetic",),
    "mesh-shader": ("draw", "task"),
    "multi-draw": ("draw",),
    "pipeline-statistics": ("draw", "compute"),
    "ray-query": ("compute",),
    "ray-tracing": ("trace",),
    "sampler-minmax": ("sampled",),
    "shading-rate": ("attachment",),
    "sparse": ("sampled",),
    "subgroups": ("arithmetic",),
    "types-16bit": ("arithmetic",),
    "wireframe": ("draw",),
}
"""What each feature is for; where one of these uses gives wrong results, the feature counts as missing."""

REQUIRED_USES: dict[str, tuple[str, ...]] = {
    "compute": ("buffers",),
    "drawing": ("pulled",),
    "texturing": ("mips",),
    "timeline-semaphore": ("order",),  # every Vulkan 1.3 device has it; OpenGL needs none
}
"""What all chapters rely on; a device on which one of these uses fails cannot be used. What one chapter needs beyond
them is tried by that chapter itself (`tools.doctor.trial`)."""

OTHER_USES: dict[str, tuple[str, ...]] = {
    "mesh-shader": ("indirect-count", "statistics"),
    "pipeline-statistics": ("after-push-constants",),
    "ray-query": ("fragment",),
    "ray-tracing": ("libraries",),
    "sparse": ("attachment", "depth-attachment", "cube-array", "plain-image"),
    "texturing": ("edges",),
}
"""What else a feature may be used for; a chapter asks `Capabilities.use` before it relies on one of these."""
