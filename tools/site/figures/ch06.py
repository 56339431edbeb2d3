"""Figures of chapter 6: meshlets, cones of normals, tests, compaction, the depth pyramid, two phases, mesh shaders."""

from __future__ import annotations

import math
from functools import cache

import numpy as np
from numpy.typing import NDArray

from chapters.ch06.culling.pyramid import PyramidLayout
from chapters.ch06.meshlets.build import build_meshlets
from chapters.ch06.meshlets.packing import unpack_counts, unpack_words
from common.scene import MESH_DTYPE, Instances, Material, Nodes, Scene

from .canvas import KINDS, Canvas, Point
from .culling import tests

Float64 = NDArray[np.float64]

# --- a ball in meshlets -----------------------------------------------------------------------------------------------

RINGS, AROUND = 28, 44


def ball_scene() -> Scene:
    """Return a scene with one ball of radius 1."""
    theta, phi = np.meshgrid(
        np.linspace(0, np.pi, RINGS + 1), np.linspace(0, 2 * np.pi, AROUND + 1)[:-1], indexing="ij"
    )
    places = np.stack([np.sin(theta) * np.cos(phi), np.cos(theta), -np.sin(theta) * np.sin(phi)], axis=-1)
    row, column = np.meshgrid(np.arange(RINGS), np.arange(AROUND), indexing="ij")
    here, right = row * AROUND + column, row * AROUND + (column + 1) % AROUND
    below, across = here + AROUND, right + AROUND
    triangles = np.concatenate(
        [
            np.stack([here, below, right], -1)[1:].reshape(-1, 3),
            np.stack([right, below, across], -1)[:-1].reshape(-1, 3),
        ]
    )
    positions = places.reshape(-1, 3).astype(np.float32)
    count = len(positions)
    mesh = np.zeros(1, MESH_DTYPE)
    mesh["vertex_count"], mesh["index_count"] = count, triangles.size
    mesh["bounds_min"], mesh["bounds_max"] = -1, 1
    one = np.zeros(1, np.int32)
    return Scene(
        name="ball",
        path=None,
        positions=positions,
        normals=positions.copy(),
        tangents=np.tile(np.array((1, 0, 0, 1), np.float32), (count, 1)),
        uv0=np.zeros((count, 2), np.float32),
        uv1=None,
        colors=None,
        indices=triangles.reshape(-1).astype(np.uint32),
        meshes=mesh,
        mesh_names=["ball"],
        materials=[Material()],
        images=[],
        nodes=Nodes(
            np.full(1, -1, np.int32),
            np.zeros((1, 3)),
            np.array([[0.0, 0.0, 0.0, 1.0]]),
            np.ones((1, 3)),
            np.eye(4)[None],
            np.zeros(1, bool),
            ["ball"],
        ),
        instances=Instances(one, one),
        lights=[],
        cameras=[],
        animations=[],
        deformations=[],
    )


@cache
def cut_ball() -> tuple[Float64, NDArray[np.int64], list[int], tuple[int, int]]:
    """Return triangles (T, 3, 3), the meshlet of each, a colour for each meshlet, and (vertices, triangles) of one."""
    scene = ball_scene()
    meshlets = build_meshlets(scene)
    corners = unpack_words(meshlets.records, meshlets.words).astype(np.int64).reshape(-1, 3)
    vertices, triangles = unpack_counts(meshlets.records["counts"])
    of = np.repeat(np.arange(len(triangles)), triangles)
    users: dict[tuple[int, int], set[int]] = {}  # by edge
    for meshlet, (i, j, k) in zip(of.tolist(), np.sort(corners).tolist(), strict=True):
        for edge in ((i, j), (j, k), (i, k)):
            users.setdefault(edge, set()).add(meshlet)
    beside: list[set[int]] = [set() for _ in triangles]
    for group in users.values():
        for meshlet in group:
            beside[meshlet] |= group - {meshlet}
    colors: list[int] = []
    for meshlet in range(len(triangles)):
        used = {colors[other] for other in beside[meshlet] if other < meshlet}
        colors.append(next(color for color in range(len(KINDS)) if color not in used))
    return scene.positions[corners].astype(np.float64), of, colors, (int(vertices[0]), int(triangles[0]))


def meshlets() -> Canvas:
    """A ball cut into meshlets, and the words of one of them."""
    c = Canvas(760, 330, "A ball cut into meshlets, and the data of one of them")
    triangles, of, colors, (vertices, count) = cut_ball()
    turn = 0.45
    tilt = np.array([[1, 0, 0], [0, math.cos(turn), math.sin(turn)], [0, -math.sin(turn), math.cos(turn)]]).T
    seen = triangles @ tilt
    facing = np.cross(seen[:, 1] - seen[:, 0], seen[:, 2] - seen[:, 0])[:, 2] > 0
    x, y, radius = 165.0, 160.0, 140.0
    for meshlet in range(len(colors)):
        own = seen[facing & (of == meshlet)]
        if len(own):
            shape = "".join(
                "M" + "L".join(f"{x + radius * p:.1f} {y - radius * q:.1f}" for p, q, _ in three) + "Z"
                for three in own.tolist()
            )
            c.raw(
                f'<path d="{shape}" fill="var(--f-{KINDS[colors[meshlet]]})" stroke="var(--f-line)" '
                'stroke-width="0.4"/>'
            )
    c.note(12, 320, f"{len(triangles):,} triangles in {len(colors)} meshlets")
    left = 350
    c.text(left, 34, f"one meshlet: {vertices} vertices, {count} triangles", bold=True)
    bytes_of = (("centre, radius", 16), ("extent", 12), ("cone", 4), ("range", 8), ("data, mesh", 8))
    at = float(left)
    for number, (words, size) in enumerate(bytes_of):
        wide = 8.1 * size
        c.box(at, 48, wide, 34, "", KINDS[number % 5])
        c.text(at + wide / 2, 100 + 15 * (number % 2), words, 11, "middle")
        at += wide
    c.note(left, 140, "its record: 48 bytes, read by the tests")
    c.box(left, 158, 190, 34, f"{vertices} words", "a")
    c.box(left + 190, 158, 190, 34, f"{-(-3 * count // 4)} words", "b")
    c.note(left, 210, "numbers of its vertices")
    c.note(left + 190, 210, "local indices, 4 in a word")
    c.note(left, 228, "its data: read by mesh shaders alone")
    c.box(left, 246, 388, 26, "", "card")
    c.box(left + 120, 246, 62, 26, f"{3 * count}", "c")
    c.note(left, 290, f"the indices of the mesh: a meshlet is one range, here of {3 * count}")
    c.note(left, 308, "The compute path draws this range by a command.")
    return c


# --- the cone of normals ----------------------------------------------------------------------------------------------

HALF_ANGLE = math.radians(35)


def cone() -> Canvas:
    """A meshlet from the side with its normals, their cone, and the region from which all of it faces away."""
    c = Canvas(760, 310, "The cone of the normals of a meshlet, and the eyes that see only its back")
    x, y, size = 240.0, 100.0, 54.0
    around = np.linspace(-HALF_ANGLE, HALF_ANGLE, 7)
    # A circular arc of this radius; its normals are within the half angle of the axis, which points upwards.
    radius = size / math.sin(HALF_ANGLE)
    rise = radius * (1 - math.cos(HALF_ANGLE))
    corners = [
        (x + radius * math.sin(a), y - rise / 2 + radius * (1 - math.cos(a)))
        for a in np.linspace(-HALF_ANGLE, HALF_ANGLE, 9).tolist()
    ]
    bound = math.hypot(size, rise / 2)
    region = [(x + dx, y + dy) for dx, dy in back_region(bound)]
    c.polygon(region, "a", "line")
    c.circle(x, y, bound, "paper")
    c.line(corners, "ink", 3)
    for a in around.tolist():
        px, py = x + radius * math.sin(a), y - rise / 2 + radius * (1 - math.cos(a))
        c.arrow(px, py, px + 34 * math.sin(a), py - 34 * math.cos(a), "s1")
    c.line([(x, y), (x, 16)], "mark", 2, dashed=True, arrow=True)
    c.text(x + 10, 22, "axis a", 13, role="mark")
    c.circle(x, y, 3, "mark", "mark")
    c.text(x + 8, y + 16, "c", 13, role="mark")
    c.line([(x, y), (x - bound, y)], "line", 1, dashed=True)
    c.text(x - bound + 8, y + 16, "r", 13, role="soft")
    c.text(x, 280, "only backs are seen from here", 12, "middle")
    c.circle(560, 250, 5, "f", "ink")
    c.text(572, 254, "eye e: sees some fronts", 12)
    c.line([(560, 250), (x + 6, y + 4)], "line", 1, dashed=True)
    c.note(468, 50, "dot(c - e, a) >= sin(alpha) |c - e| + r")
    c.note(468, 70, f"alpha is {math.degrees(HALF_ANGLE):.0f} degrees here.")
    c.note(468, 90, "A wider cone has a smaller region;")
    c.note(468, 110, "at 90 degrees there is none.")
    return c


def back_region(bound: float, reach: float = 190.0) -> list[Point]:
    """Return the corners of the region with dot(c - e, a) >= sin(alpha) |c - e| + bound, for c = 0 and a = (0, -1).

    y counts downwards. The region is cut `reach` below c.
    """
    angles = np.linspace(-math.pi / 2 + HALF_ANGLE, math.pi / 2 - HALF_ANGLE, 81)[1:-1]
    distance = bound / (np.cos(angles) - math.sin(HALF_ANGLE))
    edge = np.stack([distance * np.sin(angles), distance * np.cos(angles)], axis=-1)
    inside = edge[edge[:, 1] <= reach]
    return [
        (float(inside[0, 0]), reach),
        *[(float(px), float(py)) for px, py in inside],
        (float(inside[-1, 0]), reach),
    ]


# --- compaction -------------------------------------------------------------------------------------------------------

SURVIVES = (0, 1, 0, 0, 1, 1, 0, 1)
OWNERS = (0, 0, 0, 1, 2, 2, 2, 2)


def compaction() -> Canvas:
    """Flags of units, the sums before each, and the commands at these places."""
    c = Canvas(760, 290, "Compaction: flags, the sum before each unit, and commands without gaps")
    flags = np.array(SURVIVES)
    before = np.cumsum(flags) - flags
    left, step = 190.0, 58.0
    for y, words in (
        (40, "units of instances"),
        (94, "is it drawn?"),
        (148, "sum before it"),
        (232, "commands"),
    ):
        c.text(12, y + 20, words)
    for unit, (owner, flag, place) in enumerate(zip(OWNERS, SURVIVES, before.tolist(), strict=True)):
        x = left + step * unit
        c.box(x, 40, 46, 30, f"{owner}.{unit - OWNERS.index(owner)}", "abc"[owner] if flag else "paper")
        c.box(x, 94, 46, 30, str(flag), "card" if flag else "paper", dashed=not flag)
        c.box(x, 148, 46, 30, str(place), "card" if flag else "paper", dashed=not flag)
        if flag:
            c.arrow(x + 23, 178, left + step * place + 23, 232, "mark")
            number = unit - OWNERS.index(owner)
            c.box(left + step * place, 232, 46, 30, f"{owner}.{number}", "abc"[owner])
    c.text(left + step * int(flags.sum()) + 8, 252, f"count: {int(flags.sum())}", 13, role="mark")
    c.note(12, 282, "The commands have the order of the units. Each becomes an indirect draw of one meshlet.")
    c.note(left, 30, "instance 0")
    c.note(left + 3 * step, 30, "1")
    c.note(left + 4 * step, 30, "instance 2")
    return c


# --- the pyramid ------------------------------------------------------------------------------------------------------

PICTURE = (13, 9)
FIRST, LAST = (4, 2), (8, 5)


@cache
def levels() -> list[NDArray[np.int64]]:
    """Return the levels of the pyramid of a small picture of depths from 1 (far) to 9 (near), level 0 first."""
    width, height = PICTURE
    rng = np.random.default_rng(4)
    x, y = np.meshgrid(np.arange(width), np.arange(height))
    depth = 3 + rng.integers(0, 3, (height, width)) + np.where((x > 1) & (x < 11) & (y < 7), 3, 0)
    found = [depth]
    for level in PyramidLayout.of(PICTURE).levels:
        last = found[-1]
        padded = np.full((2 * level.height, 2 * level.width), 10)
        padded[: last.shape[0], : last.shape[1]] = last
        found.append(padded.reshape(level.height, 2, level.width, 2).min(axis=(1, 3)))
    return found


def level_of(first: tuple[int, int], last: tuple[int, int]) -> int:
    """Return the lowest level from 1 on at which pixels first..last are in at most 2x2 texels."""
    level = 1
    while any((b >> level) - (a >> level) > 1 for a, b in zip(first, last, strict=True)):
        level += 1
    return level


def pyramid() -> Canvas:
    """All levels of a small picture, with a rectangle and the texels that the test reads for it."""
    c = Canvas(760, 290, "A depth pyramid of a picture of 13x9 pixels: each texel is the minimum below it")
    read = level_of(FIRST, LAST)
    left, cell = 14.0, 23.0
    for number, level in enumerate(levels()):
        height, width = level.shape
        top = 52.0
        name = "picture" if number == 0 else f"level {number}"
        c.text(left, 26, name, 12, bold=True)
        c.text(left, 42, f"{width}x{height}", 11, role="soft")
        for row in range(height):
            for column in range(width):
                value = int(level[row, column])
                box = (left + cell * column, top + cell * row, cell, cell)
                covered = number == read and all(
                    a >> read <= at <= b >> read for at, a, b in zip((column, row), FIRST, LAST, strict=True)
                )
                fill = "b" if covered else "a" if value >= 6 else "paper"
                c.rectangle(box, fill, "line", False, 0)
                c.text(box[0] + cell / 2, box[1] + 15.5, str(value), 11, "middle")
        if number == 0:
            x0, y0 = left + cell * FIRST[0], top + cell * FIRST[1]
            x1, y1 = left + cell * (LAST[0] + 1), top + cell * (LAST[1] + 1)
            c.line([(x0, y0), (x1, y0), (x1, y1), (x0, y1), (x0, y0)], "mark", 3)
        left += max(cell * width, 46.0) + 18
    texels = levels()[read][
        FIRST[1] >> read : (LAST[1] >> read) + 1, FIRST[0] >> read : (LAST[0] >> read) + 1
    ]
    c.note(318, 200, "red: the pixels that a unit may cover", "mark")
    c.note(
        318,
        220,
        f"yellow: the {texels.size} texels that the test reads, with the minimum {int(texels.min())}",
    )
    c.note(318, 240, f"A unit whose nearest depth is below {int(texels.min())} is hidden.")
    c.note(
        14,
        280,
        "9 is near and 1 is far (reversed depth). Sizes are rounded up: each pixel is below one texel of each level.",
    )
    return c


# --- two phases -------------------------------------------------------------------------------------------------------


def two_phases() -> Canvas:
    """The steps of a frame with two phases, and what the next frame gets."""
    c = Canvas(760, 300, "A frame with two phases of occlusion culling")
    steps = (
        ("cull", "early list", "a"),
        ("draw", "what the last\nframe saw", "a"),
        ("build", "depth pyramid", "c"),
        ("cull", "late list", "f"),
        ("draw", "what else\nis visible", "f"),
        ("light", "the picture", "card"),
    )
    top, wide, gap = 92.0, 104.0, 20.0
    for number, (kind, words, fill) in enumerate(steps):
        x = 16 + (wide + gap) * number
        c.text(x + wide / 2, top - 8, kind, 11, "middle", "soft")
        c.box(x, top, wide, 52, words, fill, 12)
        if number:
            c.arrow(x - gap, top + 26, x, top + 26)
    c.text(16, 30, "early phase", bold=True)
    c.text(16 + 3 * (wide + gap), 30, "late phase", bold=True)
    c.box(16, 200, wide, 40, "visible in\nframe n - 1", "d", 12)
    c.arrow(16 + wide / 2, 200, 16 + wide / 2, top + 52, "mark")
    x = 16 + 3 * (wide + gap)
    c.box(x, 200, wide, 40, "visible in\nframe n", "d", 12)
    c.arrow(x + wide / 2, top + 52, x + wide / 2, 200, "mark")
    c.line([(x + wide, 220), (744, 220)], "mark", arrow=True)
    c.text(740, 208, "to frame n + 1", 12, "end", "mark")
    c.line([(100, 200), (100, 176), (x + 26, 176), (x + 26, top + 52)], "line", 1, dashed=True, arrow=True)
    c.text(112, 170, "was it drawn early?", 11, role="soft")
    c.note(16, 268, "The late phase tests everything in the frustum against the pyramid of this frame.")
    c.note(
        16, 286, "So its answer is right, whatever the last frame saw. Two buffers of visibility take turns."
    )
    return c


# --- two ways to draw meshlets ----------------------------------------------------------------------------------------


def mesh_shaders() -> Canvas:
    """The compute path and the path with mesh shaders, stage by stage."""
    c = Canvas(760, 300, "The compute path, and the path with task and mesh shaders")
    lanes = (
        (
            "compute path",
            (
                ("cull\ninstances", "c"),
                ("cull\nmeshlets", "c"),
                ("write\ncommands", "c"),
                ("fetch\nindices", "card"),
                ("vertex\nshader", "a"),
            ),
        ),
        (
            "mesh shaders",
            (
                ("cull\ninstances", "c"),
                ("task shader:\ncull meshlets", "f"),
                ("mesh shader:\nvertices, triangles", "f"),
            ),
        ),
    )
    for number, (name, stages) in enumerate(lanes):
        y = 52.0 + 116 * number
        c.text(14, y - 14, name, bold=True)
        wide = 108.0 if len(stages) == 5 else 188.0 + 4 / 3
        x = 14.0
        for place, (words, fill) in enumerate(stages):
            own = 108.0 if place == 0 else wide
            c.box(x, y, own, 52, words, fill, 12)
            x += own + 14
            c.arrow(x - 14, y + 26, x, y + 26)
        c.box(x, y, 746 - x, 52, "fragments", "card", 12)
    c.line([(14 + 3 * 122 - 7, 36), (14 + 3 * 122 - 7, 118)], "mark", 2, dashed=True)
    c.note(14 + 3 * 122 + 2, 34, "through memory: commands and their number", "mark")
    c.line([(129, 152), (129, 234)], "mark", 2, dashed=True)
    c.note(138, 150, "through memory: the number of task groups", "mark")
    c.note(
        14,
        262,
        "green: compute kernels; orange: stages of the draw itself. A payload of 32 meshlets goes from a task",
    )
    c.note(14, 280, "shader to its mesh shaders, in memory on the chip. Both ways include the same tests.")
    return c


FIGURES = {
    "ch06-meshlets": meshlets,
    "ch06-cone": cone,
    "ch06-tests": tests,
    "ch06-compaction": compaction,
    "ch06-pyramid": pyramid,
    "ch06-two-phases": two_phases,
    "ch06-mesh-shaders": mesh_shaders,
}
