"""The cameras of a window: how a renderer's view becomes one that can be moved, and the text that gives it back."""

from __future__ import annotations

from typing import TYPE_CHECKING

import numpy as np

import chapters
from common.view.camera import Camera, Perspective, Positioner
from common.view.positioners import FirstPerson, Orbit

if TYPE_CHECKING:
    from backends.contract import Renderer
    from common.scene import Scene


def first_person(world_from_view: np.ndarray, scene: Scene) -> FirstPerson:
    """Return free flight from a pose (4, 4); at full speed the scene's radius takes one second."""
    flight = FirstPerson.at(world_from_view)
    flight.unit = scene.length_scale / flight.max_speed
    return flight


def orbit(world_from_view: np.ndarray, scene: Scene) -> Orbit:
    """Return an orbit from a pose (4, 4), around the point straight ahead that is as far away as the scene's centre."""
    to_centre = scene.bounds.mean(axis=0) - world_from_view[:3, 3]
    ahead = float(-world_from_view[:3, 2] @ to_centre)
    return Orbit.at(world_from_view, max(ahead, 0.1 * scene.length_scale))


def open_camera(renderer: Renderer, spec: str | None, time: float) -> Camera:
    """Return the camera to begin with, from the view that `spec` names (see `common.view.camera.view_of_scene`).

    A scene that brings a camera is a place to fly through; one without is a thing to turn in the hand.
    """
    view = chapters.view_of(renderer, spec, time)
    scene = renderer.scene
    flies = bool(scene.cameras) or spec is not None
    positioner: Positioner = (first_person if flies else orbit)(view.world_from_view, scene)
    return Camera(positioner, view.projection, view.ev100)


def camera_text(camera: Camera, scene: Scene) -> str:
    """Return the camera's view as --camera takes it (`common.view.camera.view_of_scene`), "" where that has no text.

    Such a text says nothing of roll: it stands upright.
    """
    if not isinstance(camera.projection, Perspective):
        return ""
    pose = camera.positioner.world_from_view
    eye = pose[:3, 3]
    if isinstance(camera.positioner, Orbit):
        target = camera.positioner.target
    else:
        target = eye - pose[:3, 2] * scene.length_scale
    places = (",".join(f"{value:.6g}" for value in point) for point in (eye, target))
    return ":".join([*places, f"{np.degrees(camera.projection.yfov):.4g}"])
