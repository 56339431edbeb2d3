"""Where shaders find the scene on OpenGL, which counts the bindings of each kind over the whole program."""

from __future__ import annotations

from backends.contract import Sources

ENVIRONMENT_UNIT, ARRAY_UNIT = 0, 3
"""The first texture unit of the environment's three maps, and the first behind them."""

BEHIND_SCENE = Sources(set=1, first={"texture": ARRAY_UNIT, "storage": 4, "uniform": 1})
"""The sources of a pass that reads the scene: set 0, and the first bindings of OpenGL, are the scene's (scene.glsl)."""
