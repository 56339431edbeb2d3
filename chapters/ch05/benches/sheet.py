"""A sheet of cloth for benches: its scene, a renderer that draws it small, and the time of a step."""

from __future__ import annotations

import time as clock
from contextlib import AbstractContextManager
from typing import Any

import numpy as np

from backends.contract import Renderer
from common.reports.benches import Subject
from common.scene import Scene
from common.scene.sheets import cloth, cloth_scene_of
from common.settings import preset, replaced

KNOB = "cloth_method"
"""The setting; a chapter without it has no cloth."""

PASS = "cloth"

SIZE = (64, 36)
"""Size of the pictures: the bench measures cloth, not drawing."""

FABRIC = {"stretch_n_per_m": 60, "shear_n_per_m": 12, "bend_n_per_m": 1}
"""Springs of a soft cloth: a sheet of 17 x 17 vertices needs 14 substeps of them, not a hundred."""

LEVEL = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Turns a sheet in the plane z = 0 into one in the plane y = 0."""


def level_sheet(edge: int, **fabric: Any) -> Scene:
    """Return a level sheet of a square metre, of `edge` x `edge` vertices, held at two corners of one side."""
    properties = cloth(edge, edge, pins=[0, edge - 1], **{**FABRIC, **fabric})
    return cloth_scene_of(properties, matrices=[LEVEL], size=(edge, edge))


def cloth_of(subject: Subject, name: str) -> Any:
    """Return a module of the cloth of the subject's chapter."""
    return subject.module(f"cloth.{name}")


def medium_of(subject: Subject, **values: Any) -> Any:
    """Return the settings of the chapter's `medium`, with these values changed."""
    medium: Any = preset(subject.settings_class, "medium")
    return replaced(medium, **values)


def opened(subject: Subject, scene: Scene, settings: Any) -> AbstractContextManager[Renderer]:
    """Return a renderer of a small picture of a scene, with the forward path, so that cloth is most of the work."""
    return subject.on(scene, SIZE).open(replaced(settings, graph="forward"), {"color"})


def timed_step(subject: Subject, renderer: Renderer, number: int, dt: float) -> float:
    """Return the ms of the cloth pass in the frame of step `number`; of the whole call without times from the GPU.

    Step 0 is the cloth as it was modelled. Frames must follow one another.
    """
    began = clock.perf_counter()
    frame = renderer.render(subject.view(renderer), number * dt)
    took = frame.timings.get(PASS)
    wall = (clock.perf_counter() - began) * 1e3
    if frame.work["cloth_steps"] != min(number, 1):
        raise AssertionError(f"frame {number} made {frame.work['cloth_steps']} steps of cloth")
    return wall if took is None else took


def states(renderer: Any) -> list[Any]:
    """Return the state of each cloth after all frames, read from the GPU."""
    renderer.device.wait_idle()
    cloth_states: list[Any] = renderer.techniques["cloth"].cloth.states()
    return cloth_states
