"""The scene as every renderer sees it: structure-of-arrays numpy, free of any file format and graphics API.

Geometry lives in one pool of vertices and one of indices; a *mesh* is a range of both with one material (a
glTF primitive). An *instance* draws one mesh at one node; its number is its stable id, seen in
`frame.image("instance_id")`. Nodes form a forest; their world matrices are composed in float64 and only
`world - origin` ever becomes float32, so a scene far from zero keeps its precision.
"""

from __future__ import annotations

import math
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field
from enum import Flag, auto
from functools import cached_property
from pathlib import Path
from typing import TYPE_CHECKING, Any, Literal

import numpy as np
from numpy.typing import NDArray

from common.environment.medium import Medium
from common.scene.ancestry import Ancestry
from common.scene.images import EncodedImage as EncodedImage
from common.scene.images import Image as Image

if TYPE_CHECKING:
    from common.environment import Environment

Float32 = NDArray[np.float32]
Float64 = NDArray[np.float64]
UInt32 = NDArray[np.uint32]

MESH_DTYPE = np.dtype(
    [
        ("first_index", np.uint32),  # into Scene.indices
        ("index_count", np.uint32),  # a multiple of three
        ("first_vertex", np.uint32),  # added to every index
        ("vertex_count", np.uint32),
        ("material", np.uint32),  # into Scene.materials
        ("bounds_min", np.float32, 3),  # of the rest pose, in object space
        ("bounds_max", np.float32, 3),
    ]
)

AlphaMode = Literal["opaque", "mask", "blend"]


@dataclass(frozen=True)
class Sampler:
    """Filters and wrap modes in words: 'nearest' or 'linear'; mipmap None means that only level 0 is used."""

    mag: Literal["nearest", "linear"] = "linear"
    min: Literal["nearest", "linear"] = "linear"
    mipmap: Literal["nearest", "linear"] | None = "linear"
    wrap_u: Literal["repeat", "clamp", "mirror"] = "repeat"
    wrap_v: Literal["repeat", "clamp", "mirror"] = "repeat"


@dataclass(frozen=True)
class TextureRef:
    """One use of an image by a material: which image, how sampled, which uv set, KHR_texture_transform."""

    image: int
    sampler: Sampler = Sampler()
    uv_set: int = 0
    offset: tuple[float, float] = (0.0, 0.0)
    rotation: float = 0.0  # radians, counter-clockwise in uv space as the extension defines it
    scale: tuple[float, float] = (1.0, 1.0)

    def matrix(self) -> Float64:
        """Return `image_from_uv` (2, 3) = translation * rotation * scale of KHR_texture_transform."""
        c, s = math.cos(self.rotation), math.sin(self.rotation)
        return np.array(
            [
                [c * self.scale[0], s * self.scale[1], self.offset[0]],
                [-s * self.scale[0], c * self.scale[1], self.offset[1]],
            ]
        )


@dataclass(frozen=True)
class Material:
    """The metallic-roughness material of glTF 2.0; colours are linear, `emissive` is in nits."""

    name: str = ""
    base_color: tuple[float, float, float, float] = (1.0, 1.0, 1.0, 1.0)
    metallic: float = 1.0
    roughness: float = 1.0
    emissive: tuple[float, float, float] = (0.0, 0.0, 0.0)
    normal_scale: float = 1.0
    occlusion_strength: float = 1.0
    alpha_mode: AlphaMode = "opaque"
    alpha_cutoff: float = 0.5
    double_sided: bool = False
    unlit: bool = False
    base_color_texture: TextureRef | None = None
    metallic_roughness_texture: TextureRef | None = None
    normal_texture: TextureRef | None = None
    occlusion_texture: TextureRef | None = None
    emissive_texture: TextureRef | None = None

    def textures(self) -> dict[str, TextureRef]:
        """Return the textures that this material has, by role."""
        roles = {
            "base_color": self.base_color_texture,
            "metallic_roughness": self.metallic_roughness_texture,
            "normal": self.normal_texture,
            "occlusion": self.occlusion_texture,
            "emissive": self.emissive_texture,
        }
        return {role: texture for role, texture in roles.items() if texture is not None}


@dataclass(frozen=True)
class Light:
    """A punctual light of KHR_lights_punctual; it shines along the -z axis of its node.

    `intensity` is candela for point and spot lights, lux for directional ones; `range` in metres, infinite if
    none was given; cone angles are half angles in radians.
    """

    kind: Literal["point", "spot", "directional"]
    node: int
    name: str = ""
    color: tuple[float, float, float] = (1.0, 1.0, 1.0)
    intensity: float = 1.0
    range: float = math.inf
    inner_cone: float = 0.0
    outer_cone: float = math.pi / 4


NUMBER_LIMIT = 1e18
"""No number of a scene is larger: its square still fits into a 32-bit float, so lengths stay finite."""

LEAST_YFOV = 1e-6
"""Radians of the narrowest field of view, a fifth of an arc second. With `NUMBER_LIMIT` all matrices fit 32 bits."""

LEAST_NEAR = 1 / NUMBER_LIMIT
"""Metres of the nearest near plane of a perspective view, for the same reason."""

LEAST_EXTENT = 1e-9
"""Metres of the smallest height and depth of an orthographic view, for the same reason."""


@dataclass(frozen=True)
class SceneCamera:
    """A camera of the file: it looks along the -z axis of its node, +y up."""

    name: str
    node: int
    kind: Literal["perspective", "orthographic"] = "perspective"
    yfov: float = math.radians(50.0)  # vertical, radians
    near: float = 0.1
    far: float = math.inf  # used by orthographic views alone; perspective ones have an infinite far plane
    ymag: float = 1.0  # half the height of an orthographic view, metres
    aspect: float | None = None  # width / height the author meant, None if left to the window
    ev100: float | None = None  # exposure the author chose (`extras.strata.ev100`)


@dataclass(frozen=True)
class AnimationChannel:
    """Keys of a property of a node; `values` (K, C), for cubic splines (K, 3, C): in-tangent, value, out."""

    node: int
    path: Literal["translation", "rotation", "scale", "weights"]
    times: Float64
    values: Float64
    interpolation: Literal["linear", "step", "cubic"]


@dataclass(frozen=True)
class Animation:
    """A named clip; `duration` is the last key's time in seconds. Clips loop."""

    name: str
    channels: tuple[AnimationChannel, ...]
    duration: float


@dataclass(frozen=True)
class Deformation:
    """What moves the vertices of one mesh: a skin, morph targets, or both.

    `joints` are node numbers, `inverse_bind` (J, 4, 4); `vertex_joints`/`vertex_weights` (V, 4*sets) index
    into `joints`. Morph arrays are (T, V, 3). Each deforming instance has a mesh of its own.
    """

    mesh: int
    node: int
    joints: NDArray[np.int32] | None = None
    inverse_bind: Float64 | None = None
    vertex_joints: NDArray[np.int32] | None = None
    vertex_weights: Float64 | None = None
    morph_positions: Float32 | None = None
    morph_normals: Float32 | None = None
    morph_tangents: Float32 | None = None
    flat: bool = False  # normals are those of the posed triangles; their vertices are unshared and in order


class Change(Flag):
    """What an edit touched; renderers compare revision numbers per kind and redo only that."""

    TRANSFORMS = auto()
    MATERIALS = auto()
    LIGHTS = auto()
    VISIBILITY = auto()


@dataclass
class Nodes:
    """The forest of nodes, structure of arrays: parents stand before children after loading.

    `translation` (N, 3), `rotation` (N, 4) quaternions xyzw, `scale` (N, 3) where `has_matrix` is false, else
    the local matrix is `matrix` (N, 4, 4). All float64.
    """

    parent: NDArray[np.int32]
    translation: Float64
    rotation: Float64
    scale: Float64
    matrix: Float64
    has_matrix: NDArray[np.bool_]
    names: list[str]
    weights: dict[int, Float64] = field(default_factory=dict)  # morph weights of the rest pose, by node
    extras: dict[int, dict[str, Any]] = field(default_factory=dict)
    edited: dict[int, int] = field(
        default_factory=dict
    )  # revision of transforms at a node's last edit, latest last

    @cached_property
    def ancestry(self) -> Ancestry:
        """The hierarchy of nodes: levels, subtrees, world matrices."""
        return Ancestry(self.parent)

    def __len__(self) -> int:
        return len(self.parent)


@dataclass
class Instances:
    """Drawn objects, structure of arrays; the place in these arrays is the instance id."""

    node: NDArray[np.int32]  # (I,)
    mesh: NDArray[np.int32]  # (I,)
    local: Float64 | None = None  # (I, 4, 4) node_from_object of EXT_mesh_gpu_instancing; None: all identity
    visible: NDArray[np.bool_] = field(default_factory=lambda: np.zeros(0, bool))

    def __post_init__(self) -> None:
        if len(self.visible) != len(self.node):
            self.visible = np.ones(len(self.node), bool)

    def __len__(self) -> int:
        return len(self.node)


@dataclass(frozen=True)
class Pose:
    """The scene at one time. Matrices are float64, world from node and world from object.

    `vertices` holds, for each deforming mesh, its (positions, normals, tangents) as float32 in the space that
    the mesh's instance matrix expects.
    """

    time: float
    world_from_node: Float64  # (N, 4, 4)
    world_from_object: Float64  # (I, 4, 4)
    vertices: dict[int, tuple[Float32, Float32, Float32]]


@dataclass
class Scene:
    """Everything a renderer draws. Arrays are never written after loading; use `edit()` to change the scene.

    `positions` (V, 3), `normals` (V, 3), `tangents` (V, 4; w is the handedness), `uv0` (V, 2) are always
    there; `uv1` (V, 2) and `colors` (V, 4, linear) are None where no mesh has them. `indices` (T*3,) uint32
    relative to each mesh's `first_vertex`. `uv0` is zero and `tangents` are an arbitrary frame where the file
    has none.
    """

    name: str
    path: Path | None
    positions: Float32
    normals: Float32
    tangents: Float32
    uv0: Float32
    uv1: Float32 | None
    colors: Float32 | None
    indices: UInt32
    meshes: np.ndarray  # MESH_DTYPE
    mesh_names: list[str]
    materials: list[Material]
    images: list[Image]
    nodes: Nodes
    instances: Instances
    lights: list[Light]
    cameras: list[SceneCamera]
    animations: list[Animation]
    deformations: list[Deformation]
    ambient: float | None = None  # nits; the author's stand-in for indirect light (`extras.strata.ambient`)
    environment: Environment | None = None  # light from far away; fixed when a renderer opens the scene
    ev100: float | None = None  # an exposure that decides over those of the cameras
    medium: Medium | None = (
        None  # fog between surfaces; fixed when a renderer opens the scene (`extras.strata.fog`)
    )
    warnings: list[str] = field(default_factory=list)
    revision: dict[Change, int] = field(default_factory=lambda: dict.fromkeys(Change, 0))

    def __post_init__(self) -> None:
        from common.scene.animation import build_tracks
        from common.scene.pose import driven_levels, evaluate_pose, pose_bounds

        self.tracks = build_tracks(self.animations)
        """What plays: channels of the animations, grouped to be sampled together."""
        self.driven_levels = driven_levels(self)
        """What hangs on nodes that clips move, by depth; None where that is most of them, or they are few."""
        self.rest_pose: tuple[int, Pose] | None = None
        """The pose without animation and the revision of its transforms, kept by `evaluate_pose`."""
        self.bounds: Float64 = pose_bounds(self, evaluate_pose(self, 0.0))
        """(2, 3) corners of the world-space box around everything visible at time 0, float64."""
        self.origin: Float64 = self.bounds.mean(axis=0)
        """(3,) float64; subtracted before anything becomes float32. Fixed for the life of the scene."""

    @cached_property
    def length_scale(self) -> float:
        """Half the diagonal of the bounds, metres: what constants that are lengths are multiplied with."""
        return float(np.linalg.norm(self.bounds[1] - self.bounds[0]) / 2) or 1.0

    @property
    def triangle_count(self) -> int:
        """Triangles drawn: each mesh counted once per visible instance."""
        counts = self.meshes["index_count"][self.instances.mesh[self.instances.visible]]
        return int(counts.sum(dtype=np.int64)) // 3

    @contextmanager
    def edit(self) -> Iterator[SceneEdit]:
        """Change the scene; on leaving, what changed gets a new revision that every renderer sees.

        So it does where an error ends the edit: what was set before is in the scene already.
        """
        change = SceneEdit(self)
        try:
            yield change
        finally:
            for kind in Change:
                if kind in change.changed:
                    self.revision[kind] += 1


class SceneEdit:
    """The only way to change a scene; records the kinds of change."""

    def __init__(self, scene: Scene) -> None:
        self.scene = scene
        self.changed = Change(0)

    def set_transform(
        self,
        node: int,
        translation: tuple[float, float, float] | None = None,
        rotation: tuple[float, float, float, float] | None = None,
        scale: tuple[float, float, float] | None = None,
        matrix: Float64 | None = None,
    ) -> None:
        """Set the local transform of a node: parts of its TRS, or a whole (4, 4) matrix.

        Raises:
            IndexError: there is no such node.
            ValueError: parts for a node that has a matrix.
        """
        nodes = self.scene.nodes
        if not 0 <= node < len(nodes):
            raise IndexError(f"there is no node {node} among {len(nodes)}")
        if matrix is not None:
            nodes.matrix[node] = matrix
            nodes.has_matrix[node] = True
        else:
            if nodes.has_matrix[node]:
                raise ValueError(f"node {node} has a matrix, not translation, rotation and scale")
            for array, value in (
                (nodes.translation, translation),
                (nodes.rotation, rotation),
                (nodes.scale, scale),
            ):
                if value is not None:
                    array[node] = value
        nodes.edited.pop(node, None)
        nodes.edited[node] = self.scene.revision[Change.TRANSFORMS] + 1
        self.changed |= Change.TRANSFORMS

    def set_material(self, index: int, material: Material) -> None:
        """Replace a material."""
        self.scene.materials[index] = material
        self.changed |= Change.MATERIALS

    def set_light(self, index: int, light: Light) -> None:
        """Replace a light."""
        self.scene.lights[index] = light
        self.changed |= Change.LIGHTS

    def set_visible(self, instance: int, visible: bool) -> None:
        """Show or hide an instance."""
        self.scene.instances.visible[instance] = visible
        self.changed |= Change.VISIBILITY
