"""Puts the building of the atrium together: storeys of shared bays, and walls, floors and roof made to measure."""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace

import numpy as np

from assets.atrium_building import (
    BAY,
    CEILING,
    EAVE,
    GALLERY,
    HALF_X,
    HALF_Z,
    MOSAIC,
    OVERHANG,
    PAVING,
    PLANKS,
    PLASTER,
    RIDGE,
    SIDES,
    SPRING,
    STEP,
    STONE,
    TILES,
    UPPER_CEILING,
    UPPER_FLOOR,
    UPPER_SPRING,
    UPPER_WALL,
    WALL,
    Detail,
    arch_ring,
    ceiling_bay,
    column,
    door,
    placed,
    plan_uv,
    railing,
    spandrel,
)
from assets.gltf_writer import GltfBuilder
from assets.shapes import Mesh, arc, box, extrude, join, normalized, quad, rotation_y, surface

EDGE_X, EDGE_Z = HALF_X - 0.35, HALF_Z - 0.35  # where the step down to the court is
INNER_X, INNER_Z = HALF_X + GALLERY, HALF_Z + GALLERY  # faces of the back walls
OUTER_X, OUTER_Z = INNER_X + WALL, INNER_Z + WALL
DADO = 1.05  # height of the mosaic on the back walls
GROUND_DOORS = {"north": (1, 3), "south": (0, 2, 4), "west": (1,)}  # bays with a door
UPPER_DOORS = {"north": (0, 2, 4), "south": (1, 3), "east": (1,)}

Part = tuple[Mesh, str]  # a mesh and the name of its material


def add_building(scene: GltfBuilder, material: dict[str, int], detail: Detail) -> dict[str, int]:
    """Add the building; return its nodes by name, for furniture to hang on: "building", "north", "north_ground"..."""
    building = scene.add_node("building")
    nodes = {"building": building}
    shared = {
        name: scene.add_mesh(name, *((mesh, material[kind]) for mesh, kind in parts))
        for name, parts in _shared_parts(detail).items()
    }
    for side, (degrees, position, bays) in SIDES.items():
        frame = np.eye(4)
        frame[:3, :3], frame[:3, 3] = rotation_y(degrees), position
        nodes[side] = scene.add_node(f"{side}_side", building, matrix=frame)
        nodes[f"{side}_ground"] = _ground_storey(scene, shared, nodes[side], side, bays)
        nodes[f"{side}_upper"] = _upper_storey(scene, shared, nodes[side], side, bays)
    portal = (0, SPRING, -GALLERY - WALL / 2)
    scene.add_node("portal_arch", nodes["east"], translation=portal, mesh=shared["arch_ground"])
    piers = scene.add_node("corner_piers", building)
    for name, x, z in (("nw", -1, -1), ("ne", 1, -1), ("sw", -1, 1), ("se", 1, 1)):
        scene.add_node(f"pier_{name}", piers, translation=(x * HALF_X, 0, z * HALF_Z), mesh=shared["pier"])
    for name, (mesh, kind) in _unique_parts(detail).items():
        scene.add_node(name, building, mesh=scene.add_mesh(name, (mesh, material[kind])))
    return nodes


def _ground_storey(scene: GltfBuilder, shared: dict[str, int], parent: int, side: str, bays: int) -> int:
    storey = scene.add_node(f"{side}_ground", parent)
    for k in range(bays):
        bay = scene.add_node(f"{side}_ground_bay_{k}", storey, translation=((k - (bays - 1) / 2) * BAY, 0, 0))
        scene.add_node(f"{side}_ground_arch_{k}", bay, translation=(0, SPRING, 0), mesh=shared["arch_ground"])
        scene.add_node(
            f"{side}_ground_ceiling_{k}", bay, translation=(0, CEILING, 0), mesh=shared["ceiling_bay"]
        )
        if k in GROUND_DOORS.get(side, ()):
            scene.add_node(
                f"{side}_ground_door_{k}", bay, translation=(0, STEP, -GALLERY), mesh=shared["door"]
            )
    for k in range(1, bays):
        at = ((k - bays / 2) * BAY, STEP, 0)
        scene.add_node(f"{side}_ground_column_{k}", storey, translation=at, mesh=shared["column_ground"])
    return storey


def _upper_storey(scene: GltfBuilder, shared: dict[str, int], parent: int, side: str, bays: int) -> int:
    storey = scene.add_node(f"{side}_upper", parent, translation=(0, UPPER_FLOOR, 0))
    rise, ceiling = UPPER_SPRING - UPPER_FLOOR, UPPER_CEILING - UPPER_FLOOR
    for k in range(bays):
        bay = scene.add_node(f"{side}_upper_bay_{k}", storey, translation=((k - (bays - 1) / 2) * BAY, 0, 0))
        scene.add_node(
            f"{side}_upper_ceiling_{k}", bay, translation=(0, ceiling, 0), mesh=shared["ceiling_bay"]
        )
        for half, x in (("a", -BAY / 4), ("b", BAY / 4)):
            name = f"{side}_upper_{{}}_{k}{half}"
            scene.add_node(name.format("arch"), bay, translation=(x, rise, 0), mesh=shared["arch_upper"])
            scene.add_node(name.format("railing"), bay, translation=(x, 0, 0), mesh=shared["railing"])
        if k in UPPER_DOORS.get(side, ()):
            scene.add_node(f"{side}_upper_door_{k}", bay, translation=(0, 0, -GALLERY), mesh=shared["door"])
    for k in range(1, 2 * bays):
        at = ((k - bays) * BAY / 2, 0, 0)
        scene.add_node(f"{side}_upper_column_{k}", storey, translation=at, mesh=shared["column_upper"])
    return storey


def _shared_parts(detail: Detail) -> dict[str, tuple[Part, ...]]:
    """Return the meshes that many nodes use, by name."""
    count, steps = detail.voussoirs, detail.arch_steps
    upper_count = max(5, count * 2 // 3) | 1  # odd: a keystone in the middle
    # Upper columns are half as thick and farther away: they need fewer corners for the same outline.
    slender = replace(
        detail,
        column_segments=max(4, detail.column_segments * 2 // 3),
        curve_steps=(detail.curve_steps + 1) // 2,
    )
    frame, leaves = door(detail.curve_steps > 0)
    rails, lattice = railing()
    # The bay in the middle of the north side stands for all: they share its place on the plan of occlusion.
    ceiling = ceiling_bay(BAY, 3)
    ceiling = replace(ceiling, uv1=plan_uv(placed(ceiling, "north")).uv1)
    return {
        "column_ground": ((column(detail, SPRING - STEP, 0.165, 0.48), "column_stone"),),
        "column_upper": ((column(slender, UPPER_SPRING - UPPER_FLOOR, 0.085, 0.28), "column_stone"),),
        "arch_ground": (
            (spandrel(BAY / 2, BAY / 2, CEILING - SPRING, WALL, count * steps), "limestone"),
            (arch_ring(BAY / 2 - 0.2, 0.2, WALL + 0.06, count, steps), "voussoirs"),
        ),
        "arch_upper": (
            (
                spandrel(BAY / 4, BAY / 4, UPPER_CEILING - UPPER_SPRING, UPPER_WALL, upper_count * steps),
                "limestone",
            ),
            (arch_ring(BAY / 4 - 0.1, 0.1, UPPER_WALL + 0.04, upper_count, steps), "voussoirs"),
        ),
        "pier": ((box((-0.27, 0, -0.27), (0.27, EAVE, 0.27), "xXzZ").with_uv(STONE), "limestone"),),
        "ceiling_bay": ((ceiling, "ceiling"),),
        "railing": ((rails, "limestone"), (lattice, "iron_lattice")),
        "door": ((frame, "limestone"), (leaves, "wood")),
    }


def _unique_parts(detail: Detail) -> dict[str, Part]:
    """Return the meshes that exist once, by the name of their node, in the building's frame."""
    floor = _flat(0.0, (-EDGE_X, EDGE_X), (-EDGE_Z, EDGE_Z))
    parts: dict[str, Part] = {
        "court_floor": (plan_uv(floor.with_uv(PAVING)), "floor"),
        "gallery_floor": (
            plan_uv(_ring(STEP, (EDGE_X, EDGE_Z), (INNER_X, INNER_Z)).with_uv(PAVING)),
            "floor",
        ),
        "upper_floor": (
            plan_uv(_ring(UPPER_FLOOR, (HALF_X - 0.2, HALF_Z - 0.2), (INNER_X, INNER_Z)).with_uv(PAVING)),
            "floor",
        ),
        "corner_ceilings": (plan_uv(_corner_ceilings()), "ceiling"),
        "step": (_around(_step), "limestone"),
        "cornice": (_around(_cornice), "limestone"),
        "frieze": (_around(_frieze), "zellige"),
        "eaves": (_around(_eaves), "wood"),
        "roof": (_around(_roof_side), "roof_tiles"),
        "portal_jambs": (_portal_jambs(), "limestone"),
        "outer_walls": (_outer_walls(), "outer_wall"),
    }
    if detail.carved:
        parts["roof_barrels"] = (_around(_roof_barrels), "roof_tiles")
        parts["dentils"] = (_around(_dentils), "limestone")
    for side in SIDES:
        plaster, dado, ledge = _back_wall(side)
        parts[f"{side}_wall"] = (plan_uv(plaster), "wall")
        parts[f"{side}_dado"] = (plan_uv(dado), "dado")
        parts[f"{side}_ledge"] = (ledge, "limestone")
    return parts


def _around(make: Callable[[float], Mesh]) -> Mesh:
    """Return what `make(half length)` gives in the frame of each of the four sides."""
    return join(*(placed(make(bays * BAY / 2), side) for side, (_, _, bays) in SIDES.items()))


def _flat(y: float, x: tuple[float, float], z: tuple[float, float]) -> Mesh:
    """Return a floor; its texture lies on the world's axes."""
    mesh = quad((x[0], y, z[0]), (x[1] - x[0], 0, 0), (0, 0, z[1] - z[0]))
    return replace(mesh, uv0=mesh.positions[:, [0, 2]])


def _ring(y: float, inner: tuple[float, float], outer: tuple[float, float]) -> Mesh:
    """Return the floor between two rectangles given by their half extents."""
    (ix, iz), (ox, oz) = inner, outer
    return join(
        _flat(y, (-ox, ox), (-oz, -iz)),
        _flat(y, (-ox, ox), (iz, oz)),
        _flat(y, (-ox, -ix), (-iz, iz)),
        _flat(y, (ix, ox), (-iz, iz)),
    )


def _corner_ceilings() -> Mesh:
    parts = []
    for y in (CEILING, UPPER_CEILING):
        for x in (-INNER_X, HALF_X):
            for z in (-HALF_Z, INNER_Z):
                parts.append(quad((x, y, z), (GALLERY, 0, 0), (0, 0, -GALLERY)))
    return join(*parts).with_uv(PLANKS)


def _step(half: float) -> Mesh:
    """Return the riser between court and gallery."""
    inset = HALF_X - EDGE_X
    return quad((inset - half, STEP, inset), (2 * (half - inset), 0, 0), (0, -STEP, 0)).with_uv(STONE)


def _cornice(half: float) -> Mesh:
    """Return the band between the storeys: a moulding that hangs over towards its top."""
    top, low = UPPER_FLOOR, CEILING - 0.06
    hollow = arc((0.36, top - 0.22), 0.13, 90, 180, 3)
    profile = [
        [(0.2, top), (0.38, top)],
        [(0.38, top), (0.38, top - 0.09)],
        [(0.38, top - 0.09), (0.36, top - 0.09)],
        hollow,
        [(0.23, top - 0.22), (0.23, low)],
        [(0.23, low), (0.2, low)],
    ]
    return extrude(profile, 2 * half).with_uv(STONE)


def _frieze(half: float) -> Mesh:
    z = UPPER_WALL / 2 + 0.02
    return quad((-half, EAVE, z), (2 * half, 0, 0), (0, UPPER_CEILING - EAVE, 0)).with_uv(MOSAIC)


def _eaves(half: float) -> Mesh:
    """Return the boards under the overhanging roof, mitred, and the edge that the court sees."""
    inner, out, back = half - OVERHANG, OVERHANG, UPPER_WALL / 2
    outer = half - back
    points = np.array(
        [[(-inner, EAVE, out), (inner, EAVE, out)], [(-outer, EAVE, back), (outer, EAVE, back)]]
    )
    boards = surface(points, points[..., [0, 2]])
    edge = quad((-inner, EAVE + 0.10, out), (2 * inner, 0, 0), (0, -0.10, 0))
    return join(boards, edge).with_uv(PLANKS)


def _roof_side(half: float) -> Mesh:
    """Return one slope of the roof, mitred to its neighbours, from beyond the outer walls down to the eaves."""
    out, back = OVERHANG, -GALLERY - WALL - 0.15
    wide, narrow, low = half - back, half - out, EAVE + 0.10
    points = np.array(
        [[(-wide, RIDGE, back), (wide, RIDGE, back)], [(-narrow, low, out), (narrow, low, out)]]
    )
    slope = float(np.hypot(out - back, RIDGE - low))
    uv = np.stack([points[..., 0], np.array([[0.0, 0.0], [slope, slope]])], -1)
    return surface(points, uv).with_uv(TILES)


def _roof_barrels(half: float) -> Mesh:
    """Return rows of half-round tiles on one slope, each course lying over the next; they end at the mitre."""
    out, back, low = OVERHANG, -GALLERY - WALL - 0.15, EAVE + 0.10
    foot, head = np.array([0.0, low, out]), np.array([0.0, RIDGE, back])
    along, across = normalized(foot - head), np.array([1.0, 0.0, 0.0])
    above = np.cross(across, -along)
    length, spacing, course, radius = float(np.linalg.norm(foot - head)), 0.26, 0.34, 0.10
    tiles = []  # x, start and end of each, along the slope
    for x in np.arange(-half + back, half - back, spacing) + spacing / 2:
        reach = length * min(1.0, (half - back - abs(x)) / (out - back))
        for k in range(int(reach / course) + 1):
            start, end = k * course, min((k + 1) * course + 0.04, reach)
            if end - start >= 0.08:
                tiles.append((x, start, end))
    table = np.array(tiles)
    x, t = table[:, 0][:, None, None, None], table[:, 1:][:, :, None, None]
    angle = np.linspace(np.pi, 0.0, 6)[None, :, None]
    lift, width = (np.array(ends)[:, None, None] for ends in ((0.0, 0.025), (radius * 0.9, radius)))
    rim = across * np.cos(angle) * width + above * (np.sin(angle) * width + lift)
    uv = np.stack(np.broadcast_arrays(1 - angle[..., 0] / np.pi, t[..., 0]), -1)
    return surface(head + across * x + along * t + rim, uv).with_uv(TILES)


def _dentils(half: float) -> Mesh:
    """Return the row of small blocks that seems to carry the cornice."""
    block = box((-0.045, CEILING - 0.02, 0.2), (0.045, CEILING + 0.08, 0.30), "xXyZ").with_uv(STONE)
    count = round(2 * half / 0.2)
    return join(*(block.moved(((k + 0.5) * 2 * half / count - half, 0, 0)) for k in range(count)))


def _back_wall(side: str) -> tuple[Mesh, Mesh, Mesh]:
    """Return plaster, mosaic and the ledge between them, both storeys, of a gallery's back wall."""
    bays = SIDES[side][2]
    half = bays * BAY / 2 + GALLERY
    plaster, dado, ledge = [], [], []
    for floor, ceiling in ((STEP, CEILING), (UPPER_FLOOR, UPPER_CEILING)):
        gap = BAY / 2 if side == "east" and floor == STEP else 0.0
        spans = [(-half, -gap), (gap, half)] if gap else [(-half, half)]
        for left, right in spans:
            width = (right - left, 0, 0)
            plaster.append(_wall(left, width, ceiling, floor + DADO, PLASTER))
            dado.append(_wall(left, width, floor + DADO, floor, MOSAIC))
            low, high = (left, floor + DADO - 0.03, -GALLERY), (right, floor + DADO + 0.05, -GALLERY + 0.05)
            ledge.append(box(low, high, "yYZ").with_uv(STONE))
    return placed(join(*plaster), side), placed(join(*dado), side), placed(join(*ledge), side)


def _wall(left: float, width: tuple[float, float, float], top: float, bottom: float, scale: float) -> Mesh:
    mesh = quad((left, top, -GALLERY), width, (0, bottom - top, 0))
    return replace(mesh, uv0=np.stack([mesh.positions[:, 0], -mesh.positions[:, 1]], -1) * scale)


def _portal_jambs() -> Mesh:
    """Return the cheeks of the opening in the east wall and its threshold."""
    inner, outer, half = -GALLERY + 0.02, -GALLERY - WALL - 0.02, BAY / 2
    jambs = [
        box((-half, 0, outer), (0.2 - half, SPRING, inner), "XzZ"),
        box((half - 0.2, 0, outer), (half, SPRING, inner), "xzZ"),
        box((-half, 0, outer - 0.3), (half, STEP, -GALLERY), "xXYz"),
    ]
    return placed(join(*jambs).with_uv(STONE), "east")


def _outer_walls() -> Mesh:
    """Return the building's outside, with the portal's opening in the east."""
    parts = []
    for side in SIDES:
        half = OUTER_X if side in ("north", "south") else OUTER_Z
        z = -GALLERY - WALL
        if side == "east":
            gap = BAY / 2
            parts.append(placed(quad((half, RIDGE, z), (gap - half, 0, 0), (0, -RIDGE, 0)), side))
            parts.append(placed(quad((-gap, RIDGE, z), (gap - half, 0, 0), (0, -RIDGE, 0)), side))
            parts.append(placed(quad((gap, RIDGE, z), (-2 * gap, 0, 0), (0, CEILING - RIDGE, 0)), side))
        else:
            parts.append(placed(quad((half, RIDGE, z), (-2 * half, 0, 0), (0, -RIDGE, 0)), side))
    return join(*parts).with_uv(PLASTER)
