"""What a declared use means: in which layout a resource is then, which stages touch it, and how.

The words are Vulkan's without its prefixes, since that is where they come from; OpenGL's executor asks only whether
somebody wrote through a shader. A use that both reads and writes has both accesses.
"""

from __future__ import annotations

from backends.contract import Access

from ..types import GraphError, Touch

# use: (layout, stages of a pass that draws, stages of one that does not, access to read, access to write)
_USES: dict[str, tuple[str, str, str, str, str]] = {
    "color": ("color", "color", "", "color_read", "color_write"),
    "depth": ("depth", "depth", "", "depth_read", "depth_write"),
    "sampled": ("read", "fragment", "compute", "sampled", ""),
    "storage": ("general", "fragment", "compute", "storage_read", "storage_write"),
    "copy": ("copy", "copy", "copy", "copy_read", "copy_write"),
    "uniform": ("", "vertex fragment", "compute", "uniform", ""),
    "indirect": ("", "indirect", "indirect", "indirect", ""),
}


def touch_of(access: Access, kind: str, writes: bool, buffer: bool = False) -> Touch:
    """Return how a pass of `kind` touches the resource of one of its declared accesses.

    GraphError for what cannot be: a sampler that writes, a target that only a draw could fill.
    """
    layout, drawing, computing, reading, writing = _USES[access.use]
    stages = access.stages or (drawing if kind == "graphics" else computing).split()
    if not stages or (writes and not writing) or (access.use == "color" and not writes):
        does = "writes" if writes else "reads"
        raise GraphError(f"'{access.resource}': a pass that is {kind} {does} nothing as '{access.use}'.")
    if access.use == "depth" and not writes:
        # Tested against and not written: the layout in which shaders can sample it meanwhile.
        return Touch("read", frozenset(stages), frozenset({reading}))
    found = {writing} if writes else {reading}
    if writes and (access.of or access.use in ("depth", "storage")):
        found.add(reading)  # blending, the depth test, what was there before
    if layout == "copy":
        layout = "copy_target" if writes else "copy_source"
    return Touch("" if buffer else layout, frozenset(stages), frozenset(found), writes)


def merged(first: Touch, second: Touch) -> Touch | None:
    """Return both touches as one, as if they happened at once; None where the resource cannot be both."""
    if first.layout != second.layout:
        return None
    return Touch(
        first.layout,
        first.stages | second.stages,
        first.access | second.access,
        first.writes or second.writes,
    )


def conflict(before: Touch, after: Touch) -> bool:
    """Whether something must happen between the two: a change of layout, or one of them writes."""
    touched = bool(before.stages)
    return before.layout != after.layout or (touched and (before.writes or after.writes))


def covers(before: Touch, after: Touch) -> bool:
    """Whether nothing must happen between a touch of one owner and that of another one.

    What is read before is visible to those who read it, and to no other stage or access.
    """
    known = after.stages <= before.stages and after.access <= before.access
    return not conflict(before, after) and (known or not before.stages)
