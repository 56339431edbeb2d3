"""A sheet of cloth that parts of a bench are measured on: its scene, a renderer that draws it small, a step timed."""

from __future__ import annotations

import time as clock
from contextlib import AbstractContextManager
from dataclasses import replace
from typing import Any

import numpy as np

from backends.contract import Renderer
from common.reports.benches import Subject
from common.scene import Scene
from common.scene.sheets import cloth, cloth_scene_of
from common.settings import preset

KNOB = "cloth_method"
"""The setting; a chapter without it has no cloth."""

PASS = "cloth"

SIZE = (64, 36)
"""Of the pictures: cloth is what is measured."""

FABRIC = {"stretch_n_per_m": 60, "shear_n_per_m": 12, "bend_n_per_m": 1}
"""Springs of a soft cloth: a sheet of 17 x 17 vertices needs 14 substeps of them, not a hundred."""

LEVEL = np.array([[1.0, 0, 0, 0], [0, 0, 1, 0], [0, -1, 0, 0], [0, 0, 0, 1]])
"""Turns a sheet that hangs in z = 0 into one that lies in y = 0."""


def level_sheet(edge: int, **fabric: Any) -> Scene:
    """Return a level sheet of a square metre, of `edge` x `edge` vertices, held at two corners of one side."""
    said = cloth(edge, edge, pins=[0, edge - 1], **{**FABRIC, **fabric})
    return cloth_scene_of(said, matrices=[LEVEL], size=(edge, edge))


def cloth_of(subject: Subject, name: str) -> Any:
    """Return a module of the cloth of the subject's chapter."""
    return subject.module(f"cloth.{name}")


def medium_of(subject: Subject, **more: Any) -> Any:
    """Return the settings of the chapter's `medium`, and others on top."""
    medium: Any = preset(subject.settings_class, "medium")
    return replace(medium, **more)


def opened(subject: Subject, scene: Scene, settings: Any) -> AbstractContextManager[Renderer]:
    """Return a renderer of a small picture of a scene, forward, so that little else than cloth is done."""
    return subject.on(scene, SIZE).open(replace(settings, graph="forward"), {"color"})


def timed_step(subject: Subject, renderer: Renderer, number: int, dt: float) -> float:
    """Return the ms of the cloth in the frame of step `number`; of all of it, where the GPU tells no times.

    Step 0 is the cloth as it was modelled. Frames are to follow one another.
    """
    began = clock.perf_counter()
    frame = renderer.render(subject.view(renderer), number * dt)
    took = frame.timings.get(PASS)
    wall = (clock.perf_counter() - began) * 1e3
    if frame.work["cloth_steps"] != min(number, 1):
        raise AssertionError(f"frame {number} made {frame.work['cloth_steps']} steps of cloth")
    return wall if took is None else took


def states(renderer: Any) -> list[Any]:
    """Return where the particles of each cloth are after all frames, read from the GPU."""
    renderer.device.wait_idle()
    found: list[Any] = renderer.techniques["cloth"].cloth.states()
    return found
