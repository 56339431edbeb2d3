"""What the benches of shadows draw: scenes with some of their lights, settings, and the factors that are found."""

from __future__ import annotations

from collections.abc import Collection, Iterable
from dataclasses import replace
from typing import Any, NamedTuple

import numpy as np

from common.reports.benches import Effort, Subject, middle, moved_view
from common.scene import Nodes, Scene
from common.scene.pose import evaluate_pose
from common.settings import knobs, preset, replaced
from common.view.camera import View, view_of_scene

from ..shadows.faces import UNUSED
from .ray_casting import Float64

KNOB = "shadow_memory"
"""The setting; a chapter without it has no shadow maps."""

LAMPS, SUNS = ("point", "spot"), ("directional",)

SOFTWARE_SIZE = (320, 180)
"""Size of the pictures on a software driver, unless the bench's is smaller."""

LEAST_WARM_UP = 3

FEW_FRAMES, SLOW_MS = 3, 100.0
"""Frames that are measured where one takes longer than this."""

SHADED = ("forward", "lighting")
"""Beginnings of the names of passes that ask maps."""

MIB = 1 << 20
PAGE_BYTES = 1 << 16


def is_software(subject: Subject) -> bool:
    """Whether the subject's device is a software driver."""
    return bool(subject.device.capabilities.kind == "software")


def picture_size(subject: Subject) -> tuple[int, int]:
    """Return the size of the pictures: the bench's, on a software driver at most SOFTWARE_SIZE."""
    sizes = [subject.size, *([SOFTWARE_SIZE] if is_software(subject) else [])]
    return min(sizes, key=lambda size: size[0] * size[1])


def scene_with(scene: Scene, kinds: Collection[str]) -> Scene:
    """Return a scene at rest, with the lights of some kinds alone."""
    return replace(scene, lights=[light for light in scene.lights if light.kind in kinds], animations=[])


def with_loose_lights(scene: Scene) -> Scene:
    """Return a scene at rest whose lights have nodes of their own: nothing that is drawn moves with them."""
    pose, nodes, count = evaluate_pose(scene, 0.0), scene.nodes, len(scene.lights)
    matrices = pose.world_from_node[[light.node for light in scene.lights]].reshape(count, 4, 4)
    more = Nodes(
        parent=np.concatenate([nodes.parent, np.full(count, -1, np.int32)]),
        translation=np.concatenate([nodes.translation, np.zeros((count, 3))]),
        rotation=np.concatenate([nodes.rotation, np.tile((0.0, 0.0, 0.0, 1.0), (count, 1))]),
        scale=np.concatenate([nodes.scale, np.ones((count, 3))]),
        matrix=np.concatenate([nodes.matrix, matrices]),
        has_matrix=np.concatenate([nodes.has_matrix, np.ones(count, bool)]),
        names=[*nodes.names, *(f"light {number}" for number in range(count))],
    )
    lights = [replace(light, node=len(nodes) + number) for number, light in enumerate(scene.lights)]
    return replace(scene, nodes=more, lights=lights, animations=[])


def move_lights(scene: Scene, lights: Iterable[int], offset: tuple[float, float, float]) -> None:
    """Move some of those lights in the world."""
    with scene.edit() as edit:
        for number in lights:
            matrix = scene.nodes.matrix[scene.lights[number].node].copy()
            matrix[:3, 3] += offset
            edit.set_transform(scene.lights[number].node, matrix=matrix)


def view_at(scene: Scene, camera: str | None, size: tuple[int, int]) -> View:
    """Return the view of one of a scene's cameras, or its first one."""
    return view_of_scene(scene, evaluate_pose(scene, 0.0), camera, size[0] / size[1])


def settings_of(subject: Subject, **values: Any) -> Any:
    """Return the settings of the pictures: those of `medium`, without what moves and without coarser meshes."""
    exact = {"graph": "deferred", "color_format": "rgba32f", "lod_pixels": 0.0, "cloth": False, **values}
    known = knobs(subject.settings_class)
    settings = preset(subject.settings_class, "medium")
    return replaced(settings, **{name: value for name, value in exact.items() if name in known})


class Found(NamedTuple):
    """What a renderer found for a view: factors (H, W), work, FACE records, and ms of the passes that ask maps.

    `walked` has for each frame of a walk how many faces it draws.
    """

    factor: Float64
    work: dict[str, int]
    faces: np.ndarray
    ms: float
    noise_ms: float
    walked: list[int]

    @property
    def mib(self) -> float:
        """Memory that maps take up, in MiB."""
        return self.work["shadow_pages"] * PAGE_BYTES / MIB


def found_by(
    drawn: Subject, settings: Any, effort: Effort, without: Iterable[str] = (), walk: int = 0
) -> Found:
    """Return what a renderer with these settings finds in the first view of a scene, and along a walk from there."""
    shown = replaced(settings, view="shadow-factor", graph="forward")
    with drawn.open(shown, {"color", "color_linear"}, without=without) as renderer:
        view = drawn.view(renderer)
        factor = drawn.settled_picture(renderer)[0][..., 0].astype(np.float64)
        times: list[float] = []
        while len(times) < (FEW_FRAMES if times and max(times) > SLOW_MS else effort.frames):
            frame = renderer.render(view)
            passes = frame.timings
            times.append(sum(took for name, took in passes.items() if name.startswith(SHADED)))
        faces = renderer.techniques["shadows"].faces
        used = faces[faces["light"] != UNUSED].copy()
        views = [moved_view(view, drawn.scene, number) for number in range(1, walk + 1)]
        walked = [int(renderer.render(it).work["shadow_faces_drawn"]) for it in views]
        return Found(factor, dict(frame.work), used, *middle(times), walked)


def percent(value: float | None) -> str:
    """Return a share in percent as a table has it, "-" for None."""
    return "-" if value is None else f"{100 * value:.2f}"
