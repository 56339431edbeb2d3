"""One thing is changed, two more frames are drawn, one for each slot: how many of them had to be recorded?"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np

from common.scene import Light, Material, Scene
from common.view.camera import View
from tests.support.scenes import facing, quad_scene, translated
from tools.exercises import Answer
from tools.exercises.checking import Given

SOLID = Material(base_color=(0.8, 0.6, 0.4, 1.0))
GREEN = Material(base_color=(0.2, 0.9, 0.4, 0.5), alpha_mode="blend")
SMOKE = Material(base_color=(0.5, 0.5, 0.5, 0.3), alpha_mode="blend", double_sided=True)


def measure(given: Given) -> dict[str, Answer]:
    """Change something in a renderer that has drawn four frames, each time in a new one."""
    found: dict[str, Answer] = {
        "camera": _recorded(given, SMOKE, lambda opened: _seen(0.2)),
        "object": _recorded(given, SMOKE, lambda opened: _moved(opened, 0, 0.1)),
        "colour": _recorded(
            given, SMOKE, lambda opened: _edited(opened, replace(SOLID, base_color=(0, 0, 1, 1)))
        ),
        "kind": _recorded(given, SMOKE, lambda opened: _edited(opened, replace(SOLID, unlit=True))),
        "glass_of_one_kind": _recorded(given, GREEN, lambda opened: _moved(opened, 1, 0.9)),
        "glass_of_two_kinds": _recorded(given, SMOKE, lambda opened: _moved(opened, 1, 0.9)),
        "size": _recorded(given, SMOKE, lambda opened: opened.resize((16, 8))),
    }
    given.silent()
    return found


def _recorded(given: Given, second: Material, change: Callable[[Any], View | None]) -> int:
    """Return how many frames are recorded behind a change, of the first two."""
    with given.open(_scene(second), (8, 8)) as opened:
        for _ in range(4):
            opened.render(_seen())
        view = change(opened) or _seen()
        return sum(opened.render(view).work["recorded"] for _ in range(2))


def _scene(second: Material) -> Scene:
    """A solid square, and before it two panes, the first one farther away."""
    return quad_scene(
        matrices=(np.eye(4), translated(z=0.2), translated(z=0.5)),
        materials=(SOLID, GREEN, second),
        instance_materials=(0, 1, 2),
        lights=(Light("directional", node=0, intensity=3.0),),
    )


def _seen(x: float = 0.0) -> View:
    view = facing()
    return replace(view, world_from_view=translated(x=x) @ view.world_from_view)


def _moved(opened: Any, node: int, z: float) -> None:
    with opened.scene.edit() as edit:
        edit.set_transform(node, matrix=translated(z=z))


def _edited(opened: Any, material: Material) -> None:
    with opened.scene.edit() as edit:
        edit.set_material(0, material)
