"""Where shaders find the scene on OpenGL, which counts the bindings of each kind over the whole program."""

from __future__ import annotations

ENVIRONMENT_UNIT, ARRAY_UNIT = 0, 3
"""The first texture unit of the environment's three maps, and the first behind them."""
