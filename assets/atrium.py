"""The atrium: a courtyard in evening light, the default scene of every chapter.

This module furnishes the building, lights it, sets up cameras and animation. Light is chosen so that a forward renderer
with nothing but punctual lights and a little ambient light shows a good picture: a hazy low sun of 3,000 lux, lanterns
of some hundred candela, and ambient light of about an eighth of what the sun gives.
"""

from __future__ import annotations

import math

import numpy as np

from assets import atrium_props as props
from assets.atrium_building import (
    BAY,
    DETAILS,
    GALLERY,
    HALF_X,
    SIDES,
    SPRING,
    STEP,
    UPPER_FLOOR,
    Detail,
    plan_occlusion,
)
from assets.atrium_materials import add_materials
from assets.atrium_outside import add_outside
from assets.atrium_shell import add_building
from assets.gltf_writer import Channel, GltfBuilder, axis_angle, look_at
from assets.shapes import Float64, Mesh, box, join, sphere, surface, tube

SUN_LUX, SUN_DIRECTION, SUN_COLOR = 3000.0, (0.42, -0.84, 0.34), (1.0, 0.85, 0.64)
AMBIENT_NITS = 180.0
FOG = {"extinction": 0.06, "albedo": (0.95, 0.95, 0.95)}
"""The haze of `atrium:fog`, per metre: where the sun comes in between roofs and arches, its way is seen."""
FOG_AMBIENT_NITS, FOG_EV100 = 30.0, 8.3
LANTERN_CANDELA, LANTERN_COLOR, LANTERN_REACH = 700.0, (1.0, 0.62, 0.28), 7.0
EV100 = 9.3
LOOP_S = 12.0  # seconds until everything that moves is where it was

# Side, bay, metres from the column axis into the court, length of the chain, swing in degrees and its period.
LANTERNS = (
    ("north", 0, 0.0, 0.40, 0.0, 0.0),
    ("north", 2, 0.0, 0.40, 5.0, 3.0),
    ("north", 4, 0.0, 0.40, 0.0, 0.0),
    ("south", 0, 0.0, 0.40, 0.0, 0.0),
    ("south", 2, 0.0, 0.40, 7.0, 3.0),
    ("south", 4, 0.0, 0.40, 4.0, 2.4),
    ("east", 1, 0.0, 0.40, 3.0, 4.0),
    ("west", 1, -1.2, 0.35, 0.0, 0.0),
)
BANNERS = (("north", 1, "crimson"), ("north", 3, "saffron"), ("north", 4, "teal"),
           ("south", 1, "saffron"), ("south", 2, "teal"), ("south", 4, "crimson"))  # fmt: skip
TREES = ((-4.35, -1.95), (-4.35, 1.95), (4.35, -1.95), (4.35, 1.95))
POTS = (
    (-1.75, 0.0, -2.75), (0.0, 0.0, -2.85), (1.75, 0.0, -2.75), (-1.75, 0.0, 2.75), (0.0, 0.0, 2.85), (1.75, 0.0, 2.75),
    (7.85, STEP, -1.7), (7.85, STEP, 1.7), (-5.2, 0.0, 0.95), (-5.2, 0.0, -0.95),
)  # fmt: skip
IVY = (("north", -4.8), ("north", 0.3), ("south", 2.6), ("south", -3.1), ("east", 2.3), ("west", -1.6))


def build(size: str = "medium") -> GltfBuilder:
    """Return the scene at one of the sizes in `DETAILS`, or "fog" in haze, ready to be written."""
    detail = DETAILS["medium" if size == "fog" else size]
    scene = GltfBuilder("atrium")
    material = add_materials(scene, detail.texture_px, plan_occlusion(detail.texture_px))
    nodes = add_building(scene, material, detail)
    moving = [*_fountain(scene, material, detail), *_lanterns(scene, material, detail, nodes)]
    _banners(scene, material, detail, nodes)
    _plants(scene, material, detail, nodes)
    _glass(scene, material, nodes)
    add_outside(scene, material)
    _lights_and_cameras(scene, size == "fog")
    scene.add_animation("evening_breeze", moving)
    extras = {"ambient": FOG_AMBIENT_NITS, "fog": FOG} if size == "fog" else {"ambient": AMBIENT_NITS}
    scene.gltf.scenes[0].extras = {"strata": extras}
    return scene


def _fountain(scene: GltfBuilder, material: dict[str, int], detail: Detail) -> list[Channel]:
    """Add the fountain with its turning ornament and a boat; return their animation channels."""
    root = scene.add_node("fountain")
    stone, mosaic = props.basin()
    mesh = scene.add_mesh(
        "basin",
        (stone.with_uv(1 / 1.2), material["limestone"]),
        (mosaic.with_uv(0.5), material["fountain_mosaic"]),
    )
    scene.add_node("basin", root, mesh=mesh)
    scene.add_node(
        "bowls", root, mesh=scene.add_mesh("bowls", (props.bowls(detail), material["column_stone"]))
    )
    for name, radius, y in (("basin", 1.0, 0.42), ("lower_bowl", 0.54, 0.885), ("upper_bowl", 0.29, 1.245)):
        water = props.disc(radius, detail.round_segments)
        name = f"water_{name}"
        scene.add_node(
            name, root, translation=(0, y, 0), mesh=scene.add_mesh(name, (water, material["water"]))
        )

    ornament = scene.add_node("ornament", root, translation=(0, 1.62, 0))
    globe = scene.add_mesh(
        "globe", (sphere(0.075, detail.round_segments, detail.round_segments // 2), material["gold"])
    )
    scene.add_node("globe", ornament, mesh=globe)
    hoop = scene.add_mesh("hoop", (props.hoop(0.25, 0.011, detail).with_uv(2.5), material["gold"]))
    outer = scene.add_node("outer_hoop", ornament, mesh=hoop)
    tilt = axis_angle((1, 0, 0), 66)
    middle = scene.add_node("middle_hoop", outer, rotation=tilt, scale=(0.86, 0.86, 0.86), mesh=hoop)
    inner = scene.add_node(
        "inner_hoop", middle, rotation=axis_angle((0, 0, 1), 80), scale=(0.86, 0.86, 0.86), mesh=hoop
    )
    boat = scene.add_node(
        "paper_boat",
        root,
        translation=(0.78, 0.425, 0),
        mesh=scene.add_mesh("paper_boat", (props.paper_boat(), material["paper"])),
    )

    times = np.linspace(0, LOOP_S, 9)

    def turns(axis: tuple[float, float, float], count: int) -> Float64:
        return np.array([axis_angle(axis, 360 * count * t / LOOP_S) for t in times])

    circle = np.linspace(0, 2 * np.pi, 9) + 2.4  # at first the boat lies in front for most cameras
    at = np.stack([0.78 * np.cos(circle), 0.425 + 0.006 * np.sin(3 * circle), 0.78 * np.sin(circle)], -1)
    speed = np.stack([-0.78 * np.sin(circle), 0.018 * np.cos(3 * circle), 0.78 * np.cos(circle)], -1) * (
        2 * np.pi / LOOP_S
    )
    heading = np.array([axis_angle((0, 1, 0), -90 - math.degrees(a)) for a in circle])
    return [
        (outer, "rotation", times, turns((0, 1, 0), 1), "LINEAR"),
        (inner, "rotation", times, turns((1, 0, 0), 2), "LINEAR"),
        (boat, "translation", times, np.stack([speed, at, speed], 1).reshape(-1, 3), "CUBICSPLINE"),
        (boat, "rotation", times, heading, "LINEAR"),
    ]


def _lanterns(
    scene: GltfBuilder, material: dict[str, int], detail: Detail, nodes: dict[str, int]
) -> list[Channel]:
    """Hang the lanterns into the arches, each with its light; return the channels of those that swing."""
    chains = {
        length: scene.add_mesh("chain", (props.chain(length, detail), material["bronze"]))
        for length in sorted({lantern[3] for lantern in LANTERNS})
    }
    body = scene.add_mesh(
        "lantern", (props.lantern_body(detail), material["bronze"]), (props.flame(detail), material["flame"])
    )
    panes = scene.add_mesh("lantern_panes", (props.lantern_panes(), material["lantern_glass"]))
    channels = []
    for side, bay, into, length, degrees, period in LANTERNS:
        x = (bay - (SIDES[side][2] - 1) / 2) * BAY
        hook_at = (x, SPRING + 1.0 if into == 0.0 else 3.7, into)
        hook = scene.add_node(f"lantern_{side}_{bay}", nodes[f"{side}_ground"], translation=hook_at)
        scene.add_node(f"lantern_{side}_{bay}_chain", hook, mesh=chains[length])
        lamp = scene.add_node(f"lantern_{side}_{bay}_body", hook, translation=(0, -length, 0), mesh=body)
        scene.add_node(f"lantern_{side}_{bay}_panes", lamp, mesh=panes)
        scene.add_light(
            f"lantern_{side}_{bay}_light", "point", LANTERN_COLOR, LANTERN_CANDELA,
            lamp, translation=(0, -0.38, 0), reach=LANTERN_REACH,
        )  # fmt: skip
        if degrees:
            times = np.linspace(0, period, 17)
            angle = degrees * np.sin(2 * np.pi * times / period + bay)
            keys = np.array([axis_angle((0.8, 0, 0.6), a) for a in angle])
            repeat = round(LOOP_S / period)
            times = np.concatenate([[0.0], *(times[1:] + k * period for k in range(repeat))])
            keys = np.concatenate([keys[:1], *([keys[1:]] * repeat)])
            channels.append((hook, "rotation", times, keys, "LINEAR"))
    return channels


def _banners(scene: GltfBuilder, material: dict[str, int], detail: Detail, nodes: dict[str, int]) -> None:
    """Hang cloth from rods before the columns; its arrays exist once, each dye is a mesh."""
    cloth, physics = props.banner(detail)
    shared = scene.add_geometry(cloth, material["cloth_crimson"])
    dyed = {
        dye: scene.add_mesh_of(f"banner_{dye}", (shared, material[f"cloth_{dye}"]))
        for dye in ("crimson", "saffron", "teal")
    }
    half = props.BANNER[0] / 2 + 0.08
    rod = tube(np.array([[-half, 0, 0], [half, 0, 0]]), 0.016, max(5, detail.round_segments // 3))
    brackets = [tube(np.array([[x, 0, 0], [x, 0, -0.5]]), 0.011, 4) for x in (-half + 0.04, half - 0.04)]
    holder = scene.add_mesh("banner_rod", (join(rod, *brackets).with_uv(2.5), material["bronze"]))
    for side, column, dye in BANNERS:
        x = (column - SIDES[side][2] / 2) * BAY
        at = scene.add_node(
            f"banner_{side}_{column}", nodes[f"{side}_upper"], translation=(x, 0.94, 0.47), mesh=holder
        )
        scene.add_node(
            f"banner_{side}_{column}_cloth",
            at,
            translation=(0, -0.016, 0),
            mesh=dyed[dye],
            extras={"strata": {"cloth": physics}},
        )


def _plants(scene: GltfBuilder, material: dict[str, int], detail: Detail, nodes: dict[str, int]) -> None:
    """Add trees in beds of pebbles, potted plants, and ivy over the cornice."""
    garden = scene.add_node("plants")
    wood, crown, fruit = props.tree(detail)
    tree = scene.add_mesh(
        "orange_tree",
        (wood.with_uv(1.25), material["bark"]),
        (crown, material["leaves"]),
        (fruit, material["orange_peel"]),
    )
    kerb, soil = props.planter()
    bed = scene.add_mesh("bed", (kerb, material["limestone"]), (soil, material["soil"]))
    for k, (x, z) in enumerate(TREES):
        at = scene.add_node(f"bed_{k}", garden, translation=(x, 0, z), mesh=bed)
        scene.add_node(
            f"orange_tree_{k}",
            at,
            translation=(0, 0.08, 0),
            rotation=axis_angle((0, 1, 0), 75 * k),
            mesh=tree,
        )

    pot, earth = props.pot(detail)
    parts = [(pot, material["terracotta"]), (earth, material["soil"])]
    bushes = [
        scene.add_mesh(f"potted_plant_{k}", *parts, (props.bush(detail, 411 + k), material["leaves"]))
        for k in range(2)
    ]
    for k, place in enumerate(POTS):
        size = 1.0 + 0.08 * ((k * 5) % 4)
        scene.add_node(
            f"pot_{k}",
            garden,
            translation=place,
            rotation=axis_angle((0, 1, 0), 49 * k),
            scale=(size, size, size),
            mesh=bushes[k % 2],
        )

    vines = [scene.add_mesh(f"ivy_{k}", (props.ivy(detail, 421 + k), material["leaves"])) for k in range(2)]
    for k, (side, x) in enumerate(IVY):
        scene.add_node(f"ivy_{k}", nodes[f"{side}_upper"], translation=(x, 0.1, 0.36), mesh=vines[k % 2])

    rng = np.random.default_rng(431)
    count = round(16 * detail.plenty) * len(TREES)
    bed_of = np.array(TREES)[np.arange(count) % len(TREES)]
    spot = rng.uniform(-0.46, 0.46, (count, 2)) + bed_of
    size = rng.uniform(0.035, 0.075, (count, 1)) * np.array([1.25, 0.6, 1.0])
    turn = np.array([axis_angle((0, 1, 0), degrees) for degrees in rng.uniform(0, 360, count)])
    stones = scene.add_node(
        "pebbles", garden, mesh=scene.add_mesh("pebble", (props.pebble(), material["pebbles"]))
    )
    height = np.full(count, 0.095)
    scene.instance_on_gpu(stones, np.stack([spot[:, 0], height, spot[:, 1]], -1), turn, size)


def _glass(scene: GltfBuilder, material: dict[str, int], nodes: dict[str, int]) -> None:
    """Add coloured glass in two arches of the east side."""
    lunette = scene.add_mesh("lunette", (_lunette(), material["stained_glass"]))
    beam = scene.add_mesh(
        "transom",
        (
            box((-1.0, -0.05, -0.05), (1.0, 0.05, 0.05), "yYzZ").with_turned_uv().with_uv(1.25),
            material["wood"],
        ),
    )
    for k in (0, 2):
        at = scene.add_node(f"window_{k}", nodes["east_ground"], translation=((k - 1) * BAY, SPRING, 0))
        scene.add_node(f"window_{k}_transom", at, mesh=beam)
        scene.add_node(f"window_{k}_glass", at, mesh=lunette)


def _lunette() -> Mesh:
    """Return half a disc of radius 1 with its picture centred on the arch's middle."""
    angle = np.linspace(np.pi, 0.0, 17)
    rim = np.stack([np.cos(angle), np.sin(angle), np.zeros_like(angle)], -1)
    rim[[0, -1], 1] = 0.0
    points = np.stack([rim, rim * [1.0, 0.0, 0.0]])
    uv = points[..., :2] * [0.5, -1.0] + [0.5, 0.0]
    # The grid shrinks to a point at both ends, where it has no slope to take a normal from.
    normals = np.broadcast_to([0.0, 0.0, 1.0], points.shape)
    return surface(points, uv, normals).without_tangents()


def _lights_and_cameras(scene: GltfBuilder, fog: bool) -> None:
    """Add the sun, two spots and the named cameras, the first of them the one that people see first."""
    sun = look_at((0, 0, 0), SUN_DIRECTION)
    scene.add_light("sun", "directional", SUN_COLOR, SUN_LUX, translation=(0, 12, 0), rotation=sun)
    eye, target = (-2.2, UPPER_FLOOR + 2.2, -3.3), (0.0, 1.5, 0.0)
    scene.add_light(
        "fountain_spot",
        "spot",
        (1.0, 0.88, 0.70),
        9000,
        translation=eye,
        rotation=look_at(eye, target),
        reach=14.0,
        cone_degrees=(5.0, 9.0),
    )
    eye, target = (HALF_X + 0.6, 0.4, 0.0), (HALF_X + GALLERY, SPRING + 0.4, 0.05)
    scene.add_light(
        "portal_spot",
        "spot",
        (1.0, 0.72, 0.45),
        900,
        translation=eye,
        rotation=look_at(eye, target),
        reach=8.0,
        cone_degrees=(20.0, 38.0),
    )
    views = {
        "overview": ((-5.5, 1.9, 0.45), (3.0, 2.2, -0.5), 60.0, EV100),
        "fountain": ((-2.2, 1.75, 1.55), (0.05, 0.98, 0.0), 44.0, EV100),
        "gallery": ((-5.6, 1.75, -5.0), (5.0, 2.0, -4.3), 58.0, EV100 - 0.7),
        "upper": ((-5.3, 5.5, -2.3), (1.4, 1.2, 1.2), 60.0, EV100),
        "banners": ((-1.2, 2.6, 0.6), (-0.1, 3.35, 3.6), 55.0, EV100),
        "oranges": ((2.95, 1.6, 0.55), (4.35, 1.8, 2.05), 50.0, EV100),
        "portal": ((2.6, 1.7, -0.3), (8.4, 2.2, 0.1), 52.0, EV100),
        "roof": ((-9.0, 17.0, 8.0), (0.4, 1.5, 0.3), 40.0, EV100),
    }
    if fog:  # against the sun, towards which haze sends most of the light
        views = {"shafts": ((7.5, 1.6, 0.5), (-3.0, 3.5, -2.5), 57.0, FOG_EV100)} | views
    group = scene.add_node("cameras")
    for name, (eye, target, yfov, ev100) in views.items():
        scene.add_camera(name, eye, target, yfov, ev100, parent=group)
