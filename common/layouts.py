"""The two records that every shader of every chapter reads, laid out once: `FrameConstants` and `Instance`.

One table gives the numpy dtype, the GLSL members and the offsets, so that host and shader cannot disagree.
Only types that std140 and std430 place alike are used (no vec3, no array of scalars), so a record means the
same in a uniform block, a storage buffer and behind a buffer address. Positions are relative to the origin of
the scene.
"""

from __future__ import annotations

from dataclasses import dataclass
from functools import cache, lru_cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.numerics.transforms import invert_rigid, normal_matrix, translation
from common.view.camera import Orthographic, Projection, View, exposure

Float64 = NDArray[np.float64]


@dataclass(frozen=True)
class Member:
    """One member of a record: GLSL type, name, and what it means."""

    type: str
    name: str
    doc: str


# GLSL type: (numpy base type, shape, alignment in bytes, the same in std140 and std430). Matrices are stored
# by columns, each padded to 16 bytes.
TYPES: dict[str, tuple[Any, tuple[int, ...], int]] = {
    "float": (np.float32, (), 4),
    "uint": (np.uint32, (), 4),
    "vec2": (np.float32, (2,), 8),
    "vec4": (np.float32, (4,), 16),
    "uvec4": (np.uint32, (4,), 16),
    "mat4": (np.float32, (4, 4), 16),
    "mat3x4": (np.float32, (3, 4), 16),  # three columns of four: the rows of an affine matrix
}

_MATRICES = (
    ("view_from_world", "the camera's inverse pose"),
    ("world_from_view", "the camera's pose"),
    ("clip_from_view", "the projection that draws and culls, with jitter"),
    ("view_from_clip", "its inverse"),
    ("clip_from_world", "projection times view, with jitter"),
    ("world_from_clip", "its inverse"),
    (
        "steady_clip_from_view",
        "the projection without jitter: for motion, picking and everything kept for later",
    ),
    ("steady_view_from_clip", "its inverse"),
    ("steady_clip_from_world", "projection times view without jitter"),
    ("steady_world_from_clip", "its inverse"),
)

RECORDS: dict[str, tuple[Member, ...]] = {
    "FrameConstants": (
        *(Member("mat4", name, doc) for name, doc in _MATRICES),
        *(Member("mat4", f"previous_{name}", f"of the frame before: {doc}") for name, doc in _MATRICES),
        Member("vec4", "eye", "xyz: the camera; w: length scale of the scene, metres"),
        Member(
            "vec4",
            "previous_eye",
            "xyz: the camera of the frame before; w: share of this frame in the colour history",
        ),
        Member(
            "vec4",
            "origin",
            "xyz: what was subtracted from every position, metres (for display); w: 1 if the colour history is a mean",
        ),
        Member("vec4", "size", "width and height in pixels, then their inverses"),
        Member("vec4", "ambient", "rgb: luminance that arrives from every direction alike, times exposure"),
        Member(
            "vec4",
            "environment",
            "x: picture value of a stored 1; y, z: cosine and sine of its turn about +y; w: the roughest level",
        ),
        Member("vec2", "jitter", "shift of this frame's picture in ndc units, y down"),
        Member("vec2", "previous_jitter", "of the frame before"),
        Member("float", "exposure", "factor from nits to picture values"),
        Member("float", "previous_exposure", "of the frame before"),
        Member("float", "time", "seconds"),
        Member("float", "previous_time", "of the frame before"),
        Member("float", "delta_time", "time - previous_time, subtracted in float64"),
        Member("float", "near", "distance of the near plane, metres"),
        Member("float", "far", "distance of the far plane of an orthographic view; 0 means infinite"),
        Member("uint", "frame_index", "frames since the last reset"),
        Member("uint", "valid_histories", "bit mask, HISTORY_*: what the frame before left that may be used"),
        Member("uint", "orthographic", "1 for an orthographic view, 0 for a perspective one"),
        Member("uint", "instance_count", "instances of the scene, hidden ones included"),
        Member("uint", "light_count", "lights of the scene"),
    ),
    "Instance": (
        Member("mat3x4", "world_from_object", "vec4(p, 1) * m is the position in the world"),
        Member("mat3x4", "previous_world_from_object", "as last rendered"),
        Member("mat3x4", "normal_from_object", "vec4(n, 0) * m is the normal in the world, to be normalised"),
        Member(
            "vec4",
            "bounds_centre",
            "xyz: middle of the box in the world; w: radius of the sphere around the box",
        ),
        Member("vec4", "bounds_extent", "xyz: half the edges of the box, along the axes of the world"),
        Member("uint", "mesh", "index of the mesh record"),
        Member("uint", "material", "index of the material record"),
        Member("uint", "id", "place in the scene, for ever"),
        Member("uint", "flags", "bit mask, INSTANCE_*"),
    ),
}

INSTANCE_VISIBLE = 1
INSTANCE_MIRRORED = 2  # the determinant is negative: front faces wind the other way round
INSTANCE_MOVED = 4  # the transform differs from the one last rendered
INSTANCE_DEFORMING = 8  # its mesh has a second position buffer

HISTORY_FRAME = 1  # there was a frame before: its matrices and transforms mean something
HISTORY_DEPTH = 2
HISTORY_COLOR = 4
HISTORY_EXPOSURE = 8
HISTORY_FOG = 16
HISTORY_SHADOWS = 32
HISTORY_PROBES = 64
HISTORY_REFLECTIONS = 128
HISTORY_RATES = 256

CONSTANTS = {name: value for name, value in globals().items() if name.startswith(("INSTANCE_", "HISTORY_"))}
"""The bits of the masks, by the name that both languages use."""


@cache
def offsets(name: str) -> dict[str, int]:
    """Return the byte offset of each member of a record, and the size of the whole under the key ""."""
    at, places = 0, {}
    for member in RECORDS[name]:
        base, shape, alignment = TYPES[member.type]
        at = -(-at // alignment) * alignment
        places[member.name] = at
        at += int(np.dtype((base, shape)).itemsize)
    # std140 rounds a struct up to 16 bytes, and so must std430 for both to agree.
    places[""] = -(-at // 16) * 16
    return places


@cache
def dtype(name: str) -> np.dtype[Any]:
    """Return the numpy dtype of a record; matrix fields hold transposed matrices, as GLSL stores columns."""
    members, places = RECORDS[name], offsets(name)
    return np.dtype(
        {
            "names": [member.name for member in members],
            "formats": [TYPES[member.type][:2] for member in members],
            "offsets": [places[member.name] for member in members],
            "itemsize": places[""],
        }
    )


def glsl(name: str) -> str:
    """Return the members of a record, one a line, to stand between the braces of a struct or a block."""
    return "".join(f"    {member.type} {member.name};  // {member.doc}\n" for member in RECORDS[name])


def glsl_constants() -> str:
    """Return the bits of the masks as GLSL constants."""
    return "".join(f"const uint {name} = {value}u;\n" for name, value in CONSTANTS.items())


SNIPPETS = {
    "frame_constants.glsl": glsl("FrameConstants"),
    "instance.glsl": glsl("Instance"),
    "masks.glsl": glsl_constants(),
}
"""Includes by name whose text is made here, so that a record is laid out in one place only."""


def fill_frame_constants(
    record: np.ndarray,
    view: View,
    previous_view: View,
    size: tuple[int, int],
    *,
    origin: ArrayLike,
    length_scale: float,
    time: float = 0.0,
    previous_time: float = 0.0,
    frame_index: int = 0,
    jitter_px: tuple[float, float] = (0.0, 0.0),
    previous_jitter_px: tuple[float, float] = (0.0, 0.0),
    exposure_now: float | None = None,
    exposure_before: float | None = None,
    valid_histories: int = 0,
    instance_count: int = 0,
    light_count: int = 0,
    ambient: float = 0.0,
    environment: tuple[float, float, float, float] = (0.0, 1.0, 0.0, 0.0),
    history_share: float = 1.0,
    averaging: int = 0,
    aspect: float | None = None,
) -> None:
    """Fill one `FrameConstants` record in place, given as a zero-dimensional array.

    `size` is (width, height) in pixels; jitter is in pixels, right and down. Exposures are those of the views unless
    given (adaptation finds its own). `environment` is (nits of a stored 1, cosine and sine of the turn, last level).
    `history_share` is the share of this frame in the history of colour. `averaging` is 0, or 1 if that history is the
    mean of frames that show the same, or 2 if in addition it counts anew as a few frames. `aspect` is that of the
    finished picture, if its size is another one. The origin is subtracted from the poses in float64, and every product
    and inverse is made there, so that only finished matrices are rounded to float32.
    """
    width, height = size
    placed = np.asarray(origin, np.float64).tobytes()
    raw = record.reshape(1).view(np.uint8)
    raw[offsets("FrameConstants")["eye"] :] = 0
    for prefix, shown, shift in (("", view, jitter_px), ("previous_", previous_view, previous_jitter_px)):
        jitter = (2.0 * shift[0] / width, 2.0 * shift[1] / height)
        pose = np.asarray(shown.world_from_view, np.float64).tobytes()
        matrices = _matrices_of(pose, shown.projection, aspect or width / height, jitter, placed)
        first = offsets("FrameConstants")[f"{prefix}view_from_world"]
        raw[first : first + matrices.nbytes] = matrices.view(np.uint8).reshape(-1)
        record[f"{prefix}eye"][:3] = matrices[_POSE, 3, :3]
        record[f"{prefix}jitter"] = jitter
    record["origin"][:3], record["origin"][3] = np.frombuffer(placed), averaging
    record["previous_eye"][3] = history_share
    record["size"] = (width, height, 1 / width, 1 / height)
    flat = isinstance(view.projection, Orthographic)
    record["near"], record["orthographic"] = view.projection.near, flat
    record["far"] = view.projection.far if isinstance(view.projection, Orthographic) else 0.0
    record["eye"][3] = length_scale
    now = exposure(view.ev100) if exposure_now is None else exposure_now
    before = exposure(previous_view.ev100) if exposure_before is None else exposure_before
    record["exposure"], record["previous_exposure"] = now, before
    record["ambient"][:3] = ambient * record["exposure"]
    record["environment"] = (min(environment[0] * float(record["exposure"]), _LARGEST), *environment[1:])
    record["time"], record["previous_time"] = time, previous_time
    record["delta_time"] = time - previous_time
    record["frame_index"], record["valid_histories"] = frame_index, valid_histories
    record["instance_count"], record["light_count"] = instance_count, light_count


_LARGEST = float(np.finfo(np.float32).max)
_POSE = [name for name, _ in _MATRICES].index("world_from_view")


@lru_cache(64)  # those of the frame before, of each renderer that is open
def _matrices_of(
    pose: bytes, projection: Projection, aspect: float, jitter: tuple[float, float], origin: bytes
) -> NDArray[np.float32]:
    """Return (10, 4, 4) the transposed matrices of a view in the order of _MATRICES, as they lie in the record."""
    world_from_view = np.frombuffer(pose).reshape(4, 4).copy()
    world_from_view[:3, 3] -= np.frombuffer(origin)
    view_from_world = invert_rigid(world_from_view)
    matrices = [view_from_world, world_from_view]
    for clip_from_view, view_from_clip in _lens(projection, aspect, jitter):
        matrices += [clip_from_view, view_from_clip]
        matrices += [clip_from_view @ view_from_world, world_from_view @ view_from_clip]
    return np.array(matrices, np.float32).transpose(0, 2, 1).copy()


@lru_cache(64)  # a sequence of jitters comes back to its first
def _lens(
    projection: Projection, aspect: float, jitter: tuple[float, float]
) -> tuple[tuple[Float64, Float64], ...]:
    """Return clip_from_view and its inverse, with jitter and then without: what no camera's path moves."""
    steady = projection.clip_from_view(aspect)
    drawn = steady.copy()
    drawn[:2] += np.outer(jitter, steady[3])  # clip.xy += jitter * clip.w, for both kinds of projection
    return tuple((matrix, np.asarray(np.linalg.inv(matrix), np.float64)) for matrix in (drawn, steady))


def fill_instances(
    records: np.ndarray,
    world_from_object: Float64,
    previous_world_from_object: Float64,
    *,
    origin: ArrayLike,
    object_bounds: ArrayLike,
    mesh: ArrayLike,
    material: ArrayLike,
    visible: ArrayLike,
    deforming: ArrayLike = False,
    first_id: int = 0,
) -> None:
    """Fill (I,) `Instance` records in place from matrices (I, 4, 4) and boxes `object_bounds` (I, 2, 3).

    The box in the world is the tightest one around the transformed box: its half edges are |M| times the old
    ones (Arvo 1990, "Transforming axis-aligned bounding boxes"). Rounding to float32 only ever enlarges it.
    """
    object_bounds = np.asarray(object_bounds, np.float64)
    count = len(world_from_object)
    relative = translation(-np.asarray(origin, np.float64))
    now, before = relative @ world_from_object, relative @ previous_world_from_object
    records["world_from_object"] = now[:, :3]
    records["previous_world_from_object"] = before[:, :3]
    normal = records["normal_from_object"]
    normal[..., :3], normal[..., 3] = normal_matrix(world_from_object), 0.0
    linear = now[:, :3, :3]
    middle = np.einsum("nij,nj->ni", linear, object_bounds.mean(axis=1)) + now[:, :3, 3]
    half = np.einsum("nij,nj->ni", np.abs(linear), (object_bounds[:, 1] - object_bounds[:, 0]) / 2)
    centre = middle.astype(np.float32)
    extent = np.nextafter((half + np.abs(middle - centre)).astype(np.float32), np.float32(np.inf))
    records["bounds_centre"][:, :3], records["bounds_extent"][:, :3] = centre, extent
    radius = np.linalg.norm(extent.astype(np.float64), axis=1).astype(np.float32)
    records["bounds_centre"][:, 3] = np.nextafter(radius, np.float32(np.inf))
    records["mesh"], records["material"] = mesh, material
    records["id"] = np.arange(first_id, first_id + count)
    flags = INSTANCE_VISIBLE * np.asarray(visible, np.uint32)
    flags = flags | INSTANCE_MIRRORED * (np.linalg.det(world_from_object[:, :3, :3]) < 0)
    flags = flags | INSTANCE_MOVED * (world_from_object != previous_world_from_object).any(axis=(1, 2))
    records["flags"] = flags | INSTANCE_DEFORMING * np.asarray(deforming, np.uint32)
