"""The view of one frame: pose, projection and exposure; and how a scene, a name or a text becomes one."""

from __future__ import annotations

import math
from dataclasses import dataclass
from typing import Protocol

import numpy as np
from numpy.typing import NDArray

from common.errors import SceneError, UserError
from common.names import suggest
from common.numerics.transforms import invert_rigid, orthographic, perspective, pose_looking_at
from common.scene import LEAST_NEAR, LEAST_YFOV, NUMBER_LIMIT, Pose, Scene, SceneCamera
from common.view.inputs import Inputs

Float64 = NDArray[np.float64]

UNIT_EV100 = -math.log2(1.2)
"""The exposure value at which 1 nit becomes 1.0: what a scene gets whose author named no exposure."""

LIGHT_GREY = 0.4

FRAMED_YFOV = math.radians(50.0)
FRAMED_DIRECTION = (
    0.5,
    0.4,
    1.0,
)  # from the scene to the camera: glTF's front is +z, so three-quarter, from above
NAMES_SHOWN = 32  # cameras that a sentence about an unknown one names
NEAR_FRACTION = 1e-3  # near plane of a view that no file gives, in length scales of the scene


def exposure(ev100: float) -> float:
    """Return the factor from luminance in nits to the value 1.0 of the picture.

    A sensor at ISO 100 saturates at 1.2 * 2^EV100 nits (Lagarde and de Rousiers 2014, "Moving Frostbite to
    PBR", 4.1.3, with their lens transmittance q = 0.65).
    """
    return 1.0 / (1.2 * 2.0**ev100)


@dataclass(frozen=True)
class Perspective:
    """`yfov` is the whole vertical angle in radians, `near` in metres; the far plane is at infinity."""

    yfov: float = FRAMED_YFOV
    near: float = 0.1

    def clip_from_view(self, aspect: float) -> Float64:
        """Return the (4, 4) projection for a picture of `aspect` = width / height."""
        return perspective(self.yfov, aspect, self.near)


@dataclass(frozen=True)
class Orthographic:
    """`ymag` is half the height of the view, all in metres."""

    ymag: float
    near: float
    far: float

    def clip_from_view(self, aspect: float) -> Float64:
        """Return the (4, 4) projection for a picture of `aspect` = width / height."""
        return orthographic(self.ymag, aspect, self.near, self.far)


Projection = Perspective | Orthographic


@dataclass(frozen=True, eq=False)
class View:
    """What one frame shows: everything that a renderer knows about the camera.

    `world_from_view` (4, 4) float64 is rigid; the camera stands at its last column and looks along -z, +y up. It is a
    copy that cannot be written to.
    `cut` says that the view before has nothing to do with this one, so no history may be used. A renderer that finds
    the exposure by itself begins with `ev100`.
    """

    world_from_view: Float64
    projection: Projection = Perspective()
    ev100: float = UNIT_EV100
    cut: bool = False

    def __post_init__(self) -> None:
        # Renderers keep the view of the frame before. A pose that changes in place would make it this frame's view.
        pose = np.array(self.world_from_view)
        pose.flags.writeable = False
        object.__setattr__(self, "world_from_view", pose)

    @property
    def eye(self) -> Float64:
        """(3,) position of the camera in the world."""
        return self.world_from_view[:3, 3]

    def view_from_world(self) -> Float64:
        """Return the (4, 4) inverse of the pose."""
        return invert_rigid(self.world_from_view)

    def clip_from_view(self, aspect: float) -> Float64:
        """Return the (4, 4) projection for a picture of `aspect` = width / height."""
        return self.projection.clip_from_view(aspect)

    def clip_from_world(self, aspect: float) -> Float64:
        """Return the (4, 4) product of both."""
        return self.clip_from_view(aspect) @ self.view_from_world()

    def __eq__(self, other: object) -> bool:
        """Compare all fields, the pose bit for bit: equal views give equal pictures."""
        if not isinstance(other, View):
            return NotImplemented
        rest = (self.projection, self.ev100, self.cut)
        same = rest == (other.projection, other.ev100, other.cut)
        return same and self.world_from_view.tobytes() == other.world_from_view.tobytes()

    __hash__ = None  # type: ignore[assignment]  # it holds an array


class Positioner(Protocol):
    """Moves a camera: by input, by program, or not at all. Nothing else knows which."""

    @property
    def world_from_view(self) -> Float64:
        """The (4, 4) rigid pose now."""
        ...

    def update(self, dt: float, inputs: Inputs) -> None:
        """Advance by `dt` seconds."""
        ...


class Camera:
    """A positioner with a lens. Swap `positioner` at any time: the next view is marked as a cut."""

    def __init__(self, positioner: Positioner, projection: Projection, ev100: float = UNIT_EV100) -> None:
        self._positioner = positioner
        self._cut = True
        self.projection = projection
        self.ev100 = ev100

    @property
    def positioner(self) -> Positioner:
        """What moves this camera."""
        return self._positioner

    @positioner.setter
    def positioner(self, positioner: Positioner) -> None:
        self._positioner = positioner
        self._cut = True

    def advance(self, dt: float, inputs: Inputs) -> View:
        """Move by `dt` seconds and return the view of this frame; to be called once a frame."""
        self._positioner.update(dt, inputs)
        cut, self._cut = self._cut, False
        return View(self._positioner.world_from_view.copy(), self.projection, self.ev100, cut)


def view_of_scene(scene: Scene, pose: Pose, spec: str | None, aspect: float) -> View:
    """Return the view that `spec` names.

    None is the first camera of the scene, or a framing of its bounds if it has none. Else `spec` is a
    camera's name, its index, or "ex,ey,ez:tx,ty,tz[:fov_deg]": eye, target, and vertical field of view in
    degrees. Raises UserError if there is no such camera or the text is none of these.
    """
    names = [camera.name for camera in scene.cameras]
    if spec is None:
        return _view_of_camera(scene, pose, 0) if names else framed_view(scene, aspect)
    if spec in names:
        return _view_of_camera(scene, pose, names.index(spec))
    if spec.isascii() and spec.isdigit():
        if int(spec) < len(names):
            return _view_of_camera(scene, pose, int(spec))
        count = "no cameras" if not names else f"{len(names)}, counted from 0"
        raise UserError(f"camera {spec} does not exist: scene {scene.name!r} has {count}")
    if ":" in spec:
        return _view_of_text(scene, spec)
    hint = (
        suggest(spec, [name for name in names if name], NAMES_SHOWN)
        or "; it has none, so give ex,ey,ez:tx,ty,tz"
    )
    raise UserError(f"scene {scene.name!r} has no camera {spec!r}{hint}")


def framed_view(scene: Scene, aspect: float) -> View:
    """Return a three-quarter view from slightly above, in which the sphere around the bounds just fits."""
    half = FRAMED_YFOV / 2
    half = min(half, math.atan(math.tan(half) * aspect))  # a tall picture is tight at its sides
    offset = np.array(FRAMED_DIRECTION) / np.linalg.norm(FRAMED_DIRECTION)
    centre = scene.bounds.mean(axis=0)
    eye = centre + offset * (scene.length_scale / math.sin(half))
    projection = Perspective(FRAMED_YFOV, _near_of(scene))
    # The direction is not that from eye to centre, which are the same point where a scene lies far from its origin.
    world_from_view = pose_looking_at(offset, np.zeros(3))
    world_from_view[:3, 3] = eye
    return View(world_from_view, projection, _scene_ev100(scene))


def _near_of(scene: Scene) -> float:
    """Return the distance of the near plane of a view that the file does not bring, metres."""
    return max(NEAR_FRACTION * scene.length_scale, LEAST_NEAR)


def _scene_ev100(scene: Scene) -> float:
    """The exposure of the scene: the user's, else the first that the author chose, which fits the lights anywhere.

    A scene without either in an environment gets the exposure at which a white wall, lit by it from all sides, is a
    light grey; most of a day's light is in the small sun, so that the sky itself is darker than the wall.
    """
    if scene.ev100 is not None:
        return scene.ev100
    chosen = next((camera.ev100 for camera in scene.cameras if camera.ev100 is not None), None)
    if chosen is None and scene.environment is not None:
        return fitting_ev100(scene.environment.mean_luminance)
    return UNIT_EV100 if chosen is None else chosen


def fitting_ev100(luminance: float, least: float = 1e-6) -> float:
    """Return the exposure value at which `luminance`, in nits, becomes a light grey; less than `least` stays dark."""
    return math.log2(max(luminance, least) / (1.2 * LIGHT_GREY))


def _view_of_camera(scene: Scene, pose: Pose, index: int) -> View:
    camera = scene.cameras[index]
    node = pose.world_from_node[camera.node]
    # A camera's node may be scaled, mirrored or sheared by its parents: glTF looks along its -z, +y up, no
    # more.
    eye, forward, up = node[:3, 3], -node[:3, 2], node[:3, 1]
    if not np.isfinite(node).all() or not forward.any() or not up.any():
        label = camera.name or index
        raise SceneError(
            f"camera {label!r} of scene {scene.name!r} has no direction: its node is scaled to 0"
        )
    if np.abs(eye).max() > NUMBER_LIMIT:
        label = camera.name or index
        raise SceneError(
            f"camera {label!r} of scene {scene.name!r} stands further than {NUMBER_LIMIT:g} m from the origin: move it"
        )
    ev100 = camera.ev100 if camera.ev100 is not None and scene.ev100 is None else _scene_ev100(scene)
    world_from_view = pose_looking_at(np.zeros(3), forward, up)
    world_from_view[:3, 3] = eye
    return View(world_from_view, _projection_of(camera), ev100)


def _projection_of(camera: SceneCamera) -> Projection:
    if camera.kind == "orthographic":
        return Orthographic(camera.ymag, camera.near, camera.far)
    return Perspective(camera.yfov, camera.near)


def _view_of_text(scene: Scene, spec: str) -> View:
    example = "write ex,ey,ez:tx,ty,tz or ex,ey,ez:tx,ty,tz:fov_deg, as in 3,2,5:0,1,0:45"
    try:
        eye, target, *fov = [[float(number) for number in part.split(",")] for part in spec.split(":")]
    except ValueError:
        raise UserError(f"camera {spec!r} is neither a name nor a view: {example}") from None
    if len(eye) != 3 or len(target) != 3 or len(fov) > 1 or any(len(f) != 1 for f in fov):
        raise UserError(f"camera {spec!r} has the wrong count of numbers: {example}")
    if not all(abs(number) <= NUMBER_LIMIT for number in eye + target):  # a NaN is not
        raise UserError(
            f"camera {spec!r} has a number that is not finite, or beyond {NUMBER_LIMIT:g}: {example}"
        )
    fov_deg = fov[0][0] if fov else math.degrees(FRAMED_YFOV)
    if not LEAST_YFOV <= math.radians(fov_deg) < math.pi:
        raise UserError(
            f"camera {spec!r} has a field of view of {fov_deg:g} degrees: it must be between "
            f"{math.degrees(LEAST_YFOV):.1g} and 180"
        )
    if eye == target:
        raise UserError(f"camera {spec!r} looks at the point where it stands: move the eye or the target")
    projection = Perspective(math.radians(fov_deg), _near_of(scene))
    return View(pose_looking_at(eye, target), projection, _scene_ev100(scene))
