"""What an OpenGL driver can do, in the words of `backends.contract`: features, limits, and the kind of device."""

from __future__ import annotations

from collections.abc import Collection
from dataclasses import dataclass
from typing import Literal

from backends.contract import Capabilities
from backends.features import FEATURES
from backends.gl import api as gl
from backends.selftest import verdicts

Kind = Literal["discrete", "integrated", "virtual", "software", "other"]


@dataclass(frozen=True)
class Requirement:
    """Extensions of which one must be there, and calls that all must be there; none of both: OpenGL 4.5 has it."""

    extensions: tuple[str, ...] = ()
    calls: tuple[str, ...] = ()


OPTIONAL: dict[str, Requirement] = {
    "anisotropy": Requirement(("GL_ARB_texture_filter_anisotropic", "GL_EXT_texture_filter_anisotropic")),
    # Part of 4.5, as RGTC and BPTC.
    "block-compression": Requirement(),
    "draw-indirect-count": Requirement(
        ("GL_ARB_indirect_parameters",), ("glMultiDrawElementsIndirectCountARB",)
    ),
    # Part of 4.5 as well; but the GPUs of desktops cannot read it, and their drivers unpack it at the upload.
    "etc2": Requirement(),
    "fp64": Requirement(),
    "int64": Requirement(("GL_ARB_gpu_shader_int64",)),
    "multi-draw": Requirement(),
    "pipeline-statistics": Requirement(("GL_ARB_pipeline_statistics_query",)),
    "sampler-minmax": Requirement(("GL_ARB_texture_filter_minmax", "GL_EXT_texture_filter_minmax")),
    "wireframe": Requirement(),
}
"""Strata's optional features that OpenGL may have."""

ABSENT: dict[str, str] = {
    "async-compute": "OpenGL has one queue",
    "async-transfer": "OpenGL has one queue",
    "bindless": "on OpenGL textures are bound in sets of fixed size on every driver",
    "mesh-shader": "on OpenGL compute culls and indirect draws follow on every driver",
    "ray-query": "OpenGL has no rays",
    "ray-tracing": "OpenGL has no rays",
    "shading-rate": "OpenGL has no variable rate shading",
    "sparse": "on OpenGL the page table is software on every driver",
    "subgroups": "on OpenGL each invocation works alone on every driver",
    "types-16bit": "OpenGL has no 16-bit types in buffers",
}
"""The features that no OpenGL driver has here, and why. Paths that the software driver cannot run are not taken."""

_LIMITS: dict[str, tuple[int, ...]] = {
    # name, where there is one that of Vulkan: the smallest of these
    "maxImageDimension2D": (gl.GL_MAX_TEXTURE_SIZE, gl.GL_MAX_VIEWPORT_DIMS),
    "maxImageDimension3D": (gl.GL_MAX_3D_TEXTURE_SIZE,),
    "maxImageArrayLayers": (gl.GL_MAX_ARRAY_TEXTURE_LAYERS,),
    "maxUniformBufferRange": (gl.GL_MAX_UNIFORM_BLOCK_SIZE,),
    "maxPerStageDescriptorStorageBuffers": (
        gl.GL_MAX_FRAGMENT_SHADER_STORAGE_BLOCKS,
        gl.GL_MAX_COMPUTE_SHADER_STORAGE_BLOCKS,
    ),
    "maxVertexStorageBuffers": (gl.GL_MAX_VERTEX_SHADER_STORAGE_BLOCKS,),
    "maxPerStageDescriptorSamplers": (gl.GL_MAX_TEXTURE_IMAGE_UNITS,),
    "maxStorageBufferRange": (gl.GL_MAX_SHADER_STORAGE_BLOCK_SIZE,),
    "minUniformBufferOffsetAlignment": (gl.GL_UNIFORM_BUFFER_OFFSET_ALIGNMENT,),
    "minStorageBufferOffsetAlignment": (gl.GL_SHADER_STORAGE_BUFFER_OFFSET_ALIGNMENT,),
    "maxComputeWorkGroupInvocations": (gl.GL_MAX_COMPUTE_WORK_GROUP_INVOCATIONS,),
    "maxComputeSharedMemorySize": (gl.GL_MAX_COMPUTE_SHARED_MEMORY_SIZE,),
    "maxSamples": (gl.GL_MAX_SAMPLES,),
}

STORAGE_BUFFERS, SAMPLERS = 12, 16
"""What a shader stage of Strata may use, on either backend."""

_FLOOR = {
    "maxPerStageDescriptorStorageBuffers": STORAGE_BUFFERS,
    "maxVertexStorageBuffers": 4,
    "maxPerStageDescriptorSamplers": SAMPLERS,
    "maxComputeWorkGroupInvocations": 1024,
}
"""What is asked of every driver: OpenGL 4.5 alone promises 8 storage buffers, and none in vertex shaders."""

REQUIRED = ("GL_ARB_shader_draw_parameters",)
"""Extensions that every driver must list: each vertex shader needs the base instance, which 4.5 alone does not have.
A driver of 4.6, where it is core, must list it too, since shaders ask for it by this name."""

_SOFTWARE = ("llvmpipe", "softpipe", "swrast", "swiftshader", "software rasterizer", "gdi generic")
_VIRTUAL = ("virgl", "svga3d", "vmware", "virtualbox", "parallels", "d3d12")
_INTEGRATED = (
    "tegra",
    "intel",
    "apple",
    "mali",
    "adreno",
    "v3d",
    "panfrost",
    "asahi",
    "radeon graphics",
    "vega 8",
)
_DISCRETE = ("nvidia", "nouveau", "radeon", "amd", "ati ", "arc")


def kind_of(vendor: str, renderer: str) -> Kind:
    """Return the kind of device that the driver's strings speak of: OpenGL has no better source."""
    both = f"{vendor} {renderer}".lower()
    if (
        "arc" in renderer.lower().replace("(tm)", " ").split()
    ):  # Intel's cards; its other GPUs are in processors
        return "discrete"
    kinds: tuple[tuple[tuple[str, ...], Kind], ...] = (
        (_SOFTWARE, "software"),
        (_VIRTUAL, "virtual"),
        (_INTEGRATED, "integrated"),
        (_DISCRETE, "discrete"),
    )
    return next((kind for words, kind in kinds if any(word in both for word in words)), "other")


def extensions(fn: gl.Functions) -> frozenset[str]:
    """Return the names of the extensions that the current context lists."""
    count = integer(fn, gl.GL_NUM_EXTENSIONS)
    return frozenset(gl.text(fn.glGetStringi(gl.GL_EXTENSIONS, index)) for index in range(count))


def integer(fn: gl.Functions, name: int) -> int:
    """Return an integer of the context's state; of several, the smallest."""
    values = gl.ffi.new("GLint64[4]", [2**62] * 4)
    fn.glGetInteger64v(name, values)
    return min(values)


def lacks(requirement: Requirement, offered: frozenset[str], fn: gl.Functions) -> str | None:
    """Return what is missing for `requirement` in a few words, or None if nothing is."""
    if requirement.extensions and not offered & set(requirement.extensions):
        return f"the driver lacks {requirement.extensions[0]}"
    for call in requirement.calls:
        if not fn.has(call):
            return f"the driver lists {requirement.extensions[0]} but has no {call}"
    return None


def probe(fn: gl.Functions) -> Capabilities:
    """Return what the current context can do."""
    offered = extensions(fn)
    why_not = dict(ABSENT)
    for feature, requirement in OPTIONAL.items():
        reason = lacks(requirement, offered, fn)
        if reason:
            why_not[feature] = reason
    vendor, renderer, version = (
        gl.text(fn.glGetString(name)) for name in (gl.GL_VENDOR, gl.GL_RENDERER, gl.GL_VERSION)
    )
    return Capabilities(
        backend="gl",
        device=renderer,
        driver=version if vendor.partition(" ")[0].lower() in version.lower() else f"{vendor} {version}",
        api_version=(integer(fn, gl.GL_MAJOR_VERSION), integer(fn, gl.GL_MINOR_VERSION), 0),
        kind=kind_of(vendor, renderer),
        features=frozenset(FEATURES.keys() - why_not.keys()),
        why_not=why_not,
        limits={
            name: min(integer(fn, constant) for constant in constants) for name, constants in _LIMITS.items()
        },
    )


def identity(capabilities: Capabilities) -> verdicts.Identity:
    """Return under which name verdicts on the driver of a context are kept."""
    return verdicts.Identity(capabilities.device, capabilities.driver, "OpenGL")


def wrong(capabilities: Capabilities) -> dict[str, str]:
    """Return "feature/use" -> what is wrong with it, by the self-tests of this driver."""
    return verdicts.broken(capabilities.driver, verdicts.read(identity(capabilities)))


def unfit(capabilities: Capabilities, offered: Collection[str]) -> str | None:
    """Return why Strata cannot use a context that lists the extensions `offered` at all, or None."""
    if capabilities.api_version < (4, 5, 0):
        return (
            f"it offers OpenGL {capabilities.api_version[0]}.{capabilities.api_version[1]}, and 4.5 is needed"
        )
    for name, least in _FLOOR.items():
        if capabilities.limits[name] < least:
            return f"its limit {name} is {capabilities.limits[name]}, and {least} is needed"
    missing = [name for name in REQUIRED if name not in offered]
    return f"the driver lacks {' and '.join(missing)}" if missing else None
