"""Views of what draw commands draw: which meshlet, in which phase of culling.

A command's first instance is its object, so its meshlet is in the vertex offset (culling/records.glsl). Every pass that
reads these commands has the define UNIT_CODE, and takes the code off the number of a vertex. Other views, and the
picture, have neither code nor define.
"""

from __future__ import annotations

from typing import Any

OF_MESHLETS = ("meshlets", "survivors")
"""The views that are about meshlets, and show little of a scene that is drawn by whole meshes."""

CODED = ("triangle-id", *OF_MESHLETS)
"""The views that read the code. Triangles are numbered within a meshlet."""

UNIT_CODE = "UNIT_CODE"


def unit_defines(settings: Any) -> dict[str, int]:
    """Return the define of shaders that write or read draw commands with a code; nothing without one."""
    return {UNIT_CODE: 1} if settings.shading.view in CODED else {}
