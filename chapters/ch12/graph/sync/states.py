"""The meaning of a declared use: image layout, pipeline stages and accesses.

The terms are those of Vulkan without prefixes. A use that reads and writes has both accesses.
"""

from __future__ import annotations

from backends.contract import Access

from ..types import GraphError, Touch

# use: (layout, stages in a pass that draws, stages in another pass, access to read, access to write)
_USES: dict[str, tuple[str, str, str, str, str]] = {
    "color": ("color", "color", "", "color_read", "color_write"),
    "depth": ("depth", "depth", "", "depth_read", "depth_write"),
    "sampled": ("read", "fragment", "compute", "sampled", ""),
    "storage": ("general", "fragment", "compute", "storage_read", "storage_write"),
    "copy": ("copy", "copy", "copy", "copy_read", "copy_write"),
    "uniform": ("", "vertex fragment", "compute", "uniform", ""),
    "rate": ("rate", "rate", "", "rate_read", ""),
    "indirect": ("", "indirect", "indirect", "indirect", ""),
    "structure": ("", "", "compute", "structure_read", "structure_write"),
    "build": ("", "", "build", "build_input", ""),
}

_RAY_STAGES = frozenset({"rgen", "rmiss", "rchit", "rahit", "rint", "rcall"})
"""The shader stages of a ray pipeline, which are one stage of the GPU's pipeline: "rays"."""


def touch_of(access: Access, kind: str, writes: bool, buffer: bool = False) -> Touch:
    """Return the touch of a declared access in a pass of `kind`.

    Raises GraphError for an impossible use: a sampler that writes, or an attachment in a pass that does not draw.
    """
    layout, drawing, computing, reading, writing = _USES[access.use]
    stages = access.stages or (drawing if kind == "graphics" else computing).split()
    stages = ["rays" if stage in _RAY_STAGES else stage for stage in stages]
    if not stages or (writes and not writing) or (access.use == "color" and not writes):
        does = "writes" if writes else "reads"
        raise GraphError(f"'{access.resource}': a pass that is {kind} {does} nothing as '{access.use}'.")
    if access.use == "depth" and not writes:
        # Tested and not written: in the read-only layout shaders can sample it at the same time.
        return Touch("read", frozenset(stages), frozenset({reading}))
    accesses = {writing} if writes else {reading}
    if writes and (access.of or access.use in ("depth", "storage")):
        accesses.add(reading)  # blending, the depth test, old contents
    if layout == "copy":
        layout = "copy_target" if writes else "copy_source"
    return Touch("" if buffer else layout, frozenset(stages), frozenset(accesses), writes)


def merged(first: Touch, second: Touch) -> Touch | None:
    """Return one touch for two simultaneous touches; None if they need different layouts."""
    if first.layout != second.layout:
        return None
    return Touch(
        first.layout,
        first.stages | second.stages,
        first.access | second.access,
        first.writes or second.writes,
    )


def conflict(before: Touch, after: Touch) -> bool:
    """Whether two touches need a barrier between them: the layout changes, or one of them writes."""
    touched = bool(before.stages)
    return before.layout != after.layout or (touched and (before.writes or after.writes))


def covers(before: Touch, after: Touch) -> bool:
    """Whether a touch of one owner needs no barrier before that of another owner.

    Contents are visible only to the stages and accesses that have read them.
    """
    known = after.stages <= before.stages and after.access <= before.access
    return not conflict(before, after) and (known or not before.stages)
