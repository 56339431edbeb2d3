"""Light for a scene that brings none: one that travels with the camera, and a little from everywhere."""

from __future__ import annotations

from dataclasses import replace

import numpy as np

from common.scene import Light, Pose, Scene
from common.view.camera import View

from ..environment.model import needed
from ..settings import Settings


class DefaultLight:
    """`scene` is what is drawn: the scene itself, or a view of it with the default light in it."""

    def __init__(self, scene: Scene, settings: Settings) -> None:
        self._settings = settings
        self._lit_from_afar = needed(scene, settings)
        self.on = not scene.lights and settings.scene.default_light and not self._lit_from_afar
        self.scene = scene
        if self.on:
            # Pi lux on a white diffuse surface that faces the light gives a luminance of 1.
            light = Light("directional", node=0, name="default light", intensity=float(np.pi))
            self.scene = replace(scene, lights=[light])
            self.scene.revision = scene.revision  # edits of the scene are edits of this view of it

    def pose(self, pose: Pose, view: View) -> Pose:
        """Return the pose in which the light stands a little above and beside the camera's shoulder."""
        if not self.on:
            return pose
        right, up, back = view.world_from_view[:3, :3].T
        # Only the -z axis of the light's node matters: it is the direction of the light. The other nodes are no longer
        # needed, and copying all nodes in every frame would be slow in a large scene.
        node = np.eye(4)
        node[:3, 2] = back + 0.5 * up + 0.3 * right
        return replace(pose, world_from_node=node[None])

    def ambient(self) -> float:
        """Return the luminance that arrives from everywhere, in nits."""
        if self._settings.scene.ambient >= 0.0:
            return self._settings.scene.ambient
        if self._lit_from_afar:
            return 0.0  # what stood in for light from everywhere is there now
        if self.scene.ambient is not None:
            return self.scene.ambient
        return 0.25 if self.on else 0.0
