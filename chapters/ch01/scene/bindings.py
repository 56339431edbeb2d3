"""Where shaders find the scene on OpenGL, which counts the bindings of each kind over the whole program."""

from __future__ import annotations

ENVIRONMENT_UNIT = 5
"""The first of the three texture units of the environment, after those of materials (forward.frag)."""
