"""Camera paths: a view for each frame of a recording, from a name such as "walk" or from a file of key poses.

A path begins at a view, its start, and is a function of the number of the frame and of the frames per second: frame i
is at time i / fps, and a longer recording begins with the frames of a shorter one. Lengths are relative to the scene's
length scale, so that the same path crosses a thimble and a city in the same time. Poses are float64. A path meets
nothing: it goes through walls.

"walk:speed=0.1,turn=0" is a path with other values than the usual ones; `KINDS` has all of them with unit and range.
"""

from __future__ import annotations

import math
import os
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from numpy.typing import NDArray

from common.errors import UserError
from common.names import shortened, suggest, visible
from common.numerics.transforms import normalize, rotation
from common.view.camera import Orthographic, View
from common.view.key_poses import KeyPoses, read_keys
from common.view.positioners import WORLD_UP

if TYPE_CHECKING:
    from common.scene import Scene

Float64 = NDArray[np.float64]

WALK_BOB, WALK_SWAY = 0.04, 0.02
"""How far the head goes up and down, and to both sides, in lengths of a step."""
STEPS_PER_S = 1.8
TURN_PERIOD_S = 4.0
"""Seconds in which the head of a walk turns to the left, to the right, and ahead again."""


@dataclass(frozen=True, eq=False)
class Stage:
    """What a path is relative to.

    `start` is the view at time 0, `centre` (3,) that of the scene's bounds, `length` the scene's length scale in
    metres, and `size` width and height of the picture in pixels.
    """

    start: View
    centre: Float64
    length: float
    size: tuple[int, int]

    @classmethod
    def of(cls, scene: Scene, start: View, size: tuple[int, int]) -> Stage:
        """Return the stage of a scene that is seen from `start`."""
        return cls(start, scene.bounds.mean(axis=0), scene.length_scale, size)

    def pixel(self, depth: float) -> float:
        """Return the metres that a pixel covers of a plane across the line of sight, `depth` metres ahead."""
        projection = self.start.projection
        if isinstance(projection, Orthographic):
            return 2 * projection.ymag / self.size[1]
        return 2 * depth * math.tan(projection.yfov / 2) / self.size[1]

    def depth_of_centre(self) -> float:
        """Return how far ahead the centre of the scene is, in metres; the length scale where it is not ahead."""
        ahead = float((self.centre - self.start.eye) @ -self.start.world_from_view[:3, 2])
        return ahead if ahead > 1e-3 * self.length else self.length


@dataclass(frozen=True)
class Value:
    """A number of a path: what it is with its unit, the usual one, and the least and the largest."""

    what: str
    usual: float
    least: float
    most: float


Values = Mapping[str, float]
Pose = Callable[[Stage, Values, int, float], Float64]


@dataclass(frozen=True)
class Kind:
    """A named path: what it does, its values, and the pose (4, 4) of frame i from (stage, values, i, fps)."""

    what: str
    values: Mapping[str, Value]
    pose: Pose


def _still(stage: Stage, values: Values, frame: int, fps: float) -> Float64:
    return stage.start.world_from_view


def _pan(stage: Stage, values: Values, frame: int, fps: float) -> Float64:
    """Move along the picture's x axis: all points at one depth cross the picture with one speed."""
    depth = values["depth"] * stage.length or stage.depth_of_centre()
    pose = stage.start.world_from_view.copy()
    pose[:3, 3] += frame * values["pixels"] * stage.pixel(depth) * pose[:3, 0]
    return pose


def _dolly(stage: Stage, values: Values, frame: int, fps: float) -> Float64:
    """Move along the line of sight."""
    pose = stage.start.world_from_view.copy()
    pose[:3, 3] -= (frame / fps * values["speed"] * stage.length) * pose[:3, 2]
    return pose


def _orbit(stage: Stage, values: Values, frame: int, fps: float) -> Float64:
    """Turn the start about the vertical line through the centre of the scene, to the right for positive angles."""
    turn = rotation(WORLD_UP, math.radians(values["degrees"]) * frame / fps)
    pose = stage.start.world_from_view.copy()
    # The centre is subtracted before the turn: far from the origin one matrix for both would lose digits.
    pose[:3, 3] = stage.centre + turn[:3, :3] @ (pose[:3, 3] - stage.centre)
    pose[:3, :3] = turn[:3, :3] @ pose[:3, :3]
    return pose


def _walk(stage: Stage, values: Values, frame: int, fps: float) -> Float64:
    """Go ahead on a level: the head bobs with each step, sways with each pair of steps, and looks to both sides."""
    time = frame / fps
    start = stage.start.world_from_view
    up, ahead = np.array(WORLD_UP), _level(start)
    speed = values["speed"] * stage.length
    step, phase = abs(speed) / STEPS_PER_S, math.pi * STEPS_PER_S * time
    bob = values["bob"] * WALK_BOB * step * math.sin(2 * phase)
    sway = values["bob"] * WALK_SWAY * step * math.sin(phase)
    turn = math.radians(values["turn"]) * math.sin(2 * math.pi * time / TURN_PERIOD_S)
    pose = start.copy()
    pose[:3, :3] = rotation(WORLD_UP, turn)[:3, :3] @ pose[:3, :3]
    pose[:3, 3] += speed * time * ahead + bob * up + sway * np.cross(ahead, up)
    return pose


def _level(pose: Float64) -> Float64:
    """Return the horizontal direction (3,) in which a camera looks; straight down, that of the picture's top."""
    for axis in (-pose[:3, 2], pose[:3, 1], -pose[:3, 1]):
        flat = axis - axis @ np.array(WORLD_UP) * np.array(WORLD_UP)
        if np.linalg.norm(flat) > 1e-3:
            return normalize(flat)
    return np.array((0.0, 0.0, -1.0))


_SPEED = "length scales of the scene in a second; negative: backwards"
KINDS: Mapping[str, Kind] = {
    "still": Kind("stands at the start", {}, _still),
    "pan": Kind(
        "moves to the right at a constant speed on the screen",
        {
            "pixels": Value("pixels that a point at `depth` moves to the left in a frame", 2.0, -1e4, 1e4),
            "depth": Value(
                "length scales of the scene ahead; 0: where the centre of the scene is", 0.0, 0.0, 1e4
            ),
        },
        _pan,
    ),
    "walk": Kind(
        "goes ahead on a level with bobbing and turning head",
        {
            "speed": Value(_SPEED, 0.02, -100.0, 100.0),
            "bob": Value("how much the head bobs and sways; 0: not at all", 1.0, 0.0, 100.0),
            "turn": Value("degrees that the head turns to either side", 6.0, 0.0, 180.0),
        },
        _walk,
    ),
    "dolly": Kind("moves along the line of sight", {"speed": Value(_SPEED, 0.05, -100.0, 100.0)}, _dolly),
    "orbit": Kind(
        "circles the centre of the scene",
        {"degrees": Value("degrees in a second, to the right; negative: to the left", 30.0, -3600.0, 3600.0)},
        _orbit,
    ),
}
"""The named paths."""


@dataclass(frozen=True, eq=False)
class CameraPath:
    """A path as it was asked for, by `text`: one of `KINDS` with its values, or the key poses of a file."""

    text: str
    kind: Kind | None = None
    values: Values = field(default_factory=dict)
    keys: KeyPoses | None = None

    def frames(self, fps: float) -> int | None:
        """Return how many frames a file's path has, to its last key pose; None for a named path, which has no end."""
        if self.keys is None:
            return None
        return math.floor(min(self.keys.times[-1] * fps * (1 + 1e-12), 1e15)) + 1  # a float holds that

    def view(self, stage: Stage, frame: int, fps: float) -> View:
        """Return the view of a frame; lens and exposure are those of the start."""
        if self.keys is not None:
            pose = self.keys.pose(frame / fps)
        else:
            assert self.kind is not None
            pose = self.kind.pose(stage, self.values, frame, fps)
        return replace(stage.start, world_from_view=np.array(pose, np.float64))

    def views(self, stage: Stage, frames: int, fps: float) -> Iterator[View]:
        """Yield the views of all frames."""
        return (self.view(stage, frame, fps) for frame in range(frames))


def path(text: str, stage: Stage, frames: int, fps: float = 60.0) -> list[View]:
    """Return the views of a path, from its name, with values or without, or the name of its file.

    Raises UserError for what is neither.
    """
    return list(parse_path(text).views(stage, frames, fps))


def parse_path(text: str) -> CameraPath:
    """Return the path that a text names: "walk", "walk:speed=0.1", or a file of key poses (`read_keys`).

    Raises UserError: no such path, a wrong value, or a file that is not there or not well-formed.
    """
    name, colon, rest = text.partition(":")
    if name in KINDS:
        kind = KINDS[name]
        changed = _values(name, kind, rest) if colon else {}
        if colon and not changed:
            values = "".join(
                f", such as {name}:{key}={value.usual:g}" for key, value in [*kind.values.items()][:1]
            )
            has = f"name a value of the path{values}, or leave" if values else "the path has none: leave"
            raise UserError(f"--path {visible(text)} has no value behind the colon: {has} the colon out.")
        return CameraPath(
            text, kind, {key: changed.get(key, value.usual) for key, value in kind.values.items()}
        )
    file = Path(text)
    if file.suffix.lower() == ".json" or "/" in text or os.sep in text:
        return CameraPath(text, keys=read_keys(file))
    near = suggest(visible(name), KINDS)
    said = f"There is no path {shortened(visible(name), 80)!r}{near}"
    raise UserError(said if near.endswith("?") else f"{said}, or the name of a .json file of key poses.")


def _values(name: str, kind: Kind, text: str) -> dict[str, float]:
    """Return the values in a text such as "speed=0.1,turn=0"."""
    values: dict[str, float] = {}
    for item in filter(None, (part.strip() for part in visible(text).split(","))):
        key, equals, number = (part.strip() for part in item.partition("="))
        if key not in kind.values:
            near = suggest(key, kind.values) or "; it has none"
            raise UserError(f"The path {name} has no value {key!r}{near}{'' if near.endswith('?') else '.'}")
        value = kind.values[key]
        try:
            wanted = float(number) if equals else math.nan
        except ValueError:
            wanted = math.nan
        if not value.least <= wanted <= value.most:  # a NaN is not
            raise UserError(
                f"The path {name} cannot have {item!r}: {key} is a number from {value.least:g} to {value.most:g}, "
                f"{value.what}."
            )
        values[key] = wanted
    return values
