"""The night market: stalls with awnings in lanes around a square, thousands of lamps, glass, and facades around.

`market` has 2,400 lamps, each a point or spot light with a body that glows; `market:lights=400` has 400 of them, which
are the first 400 of one order. `market:fog` is that in mist. Besides there is the moon, a
directional light of a tenth of a lux.
"""

from __future__ import annotations

from collections.abc import Callable
from functools import partial

import numpy as np

from assets.city_buildings import Lot, Side, building
from assets.city_fittings import fountain, table
from assets.city_furniture import bench
from assets.city_ground import dome
from assets.city_parts import Parts
from assets.gltf_writer import GltfBuilder, axis_angle, look_at
from assets.market_goods import GOODS, stack
from assets.market_lamps import Lamps
from assets.market_materials import FLOOR_METRES, PAVING_METRES, add_materials
from assets.market_plan import HALF, SQUARE, lamps, poles, stalls, strings
from assets.market_stalls import AWNINGS, awning, frame, pole, wires
from assets.market_views import add_views
from assets.shapes import Mesh, quad

MOON_LUX, MOON_DIRECTION, MOON_COLOR = 0.1, (0.5, -0.72, 0.35), (0.62, 0.74, 1.0)
AMBIENT_NITS = 0.1
FOG_LAMPS = 400
FOG = {"extinction": 0.015, "height_extinction": 0.06, "height_falloff": 0.4, "albedo": (0.95, 0.95, 0.95)}
"""The mist of `market:fog`, per metre: it lies on the ground, so that lamps have halos and roofs are clear."""
BACKDROP = {"strata": {"backdrop": True}}
FRONT, DEEP = 11.4, 8.0
"""Width of a house's front, and its depth, in metres."""

HOUSES = (
    ("townhouse", 3),
    ("tenement", 3),
    ("palace", 2),
    ("works", 2),
    ("townhouse", 2),
    ("bank", 2),
    ("tenement", 4),
)
"""Look, and storeys above the ground floor."""

GLASS_STALLS = ((0.0, 15.3), (3.4, 15.3), (-3.4, -11.1), (-3.4, -15.3), (6.8, 6.5))
"""Stalls (x, z) that always sell glass: what the camera `glass` looks at, and some along the first view."""

SHARES = (0.17, 0.15, 0.15, 0.17, 0.17, 0.12, 0.07)
"""Of the other goods, in the order of GOODS."""

FURNITURE = (
    ("table", 3.4, 3.6, 20.0), ("table", 8.6, -3.4, 75.0), ("table", -3.6, -3.9, 130.0), ("table", -8.4, 0.4, 10.0),
    ("table", 9.3, 3.2, 160.0), ("bench", 0.0, 4.4, 180.0), ("bench", 0.0, -4.4, 0.0), ("bench", -8.0, -4.0, 20.0),
)  # fmt: skip
"""Kind, x, z and turn of what stands on the square besides the fountain in its middle."""


def build(size: str = "lights=2400") -> GltfBuilder:
    """Return the market with so many lamps, such as "lights=2400", ready to be written."""
    number = FOG_LAMPS if size == "fog" else int(size.removeprefix("lights="))
    market = _Market()
    _add_ground(market)
    _add_houses(market)
    _add_stalls(market)
    _add_square(market)
    _add_strings(market)
    group, bodies = market.scene.add_node("lamps"), Lamps(market.scene, market.material)
    for k, lamp in enumerate(lamps(number)):
        bodies.add(k, lamp, group)
    moon = look_at((0, 0, 0), MOON_DIRECTION)
    market.scene.add_light("moon", "directional", MOON_COLOR, MOON_LUX, translation=(0, 60, 0), rotation=moon)
    add_views(market.scene)
    extras = {"ambient": AMBIENT_NITS} | ({"fog": FOG} if size == "fog" else {})
    market.scene.gltf.scenes[0].extras = {"strata": extras}
    return market.scene


class _Market:
    """The scene while it is made; each mesh is made once, by its name."""

    def __init__(self) -> None:
        self.scene = GltfBuilder("market")
        self.material = add_materials(self.scene)
        self._meshes: dict[str, int] = {}

    def draw(
        self, mesh: str, make: Callable[[], Parts], node: str, parent: int,
        at: tuple[float, float, float] | None = None, turn: float = 0.0, backdrop: bool = False,
    ) -> None:  # fmt: skip
        """Draw a mesh, made if need be, at a place, turned about y by degrees."""
        if mesh not in self._meshes:
            parts = [(geometry, self.material[name]) for name, geometry in make().meshes()]
            self._meshes[mesh] = self.scene.add_mesh(mesh, *parts)
        rotation = axis_angle((0, 1, 0), turn) if turn else None
        extras = BACKDROP if backdrop else None
        self.scene.add_node(node, parent, at, rotation, mesh=self._meshes[mesh], extras=extras)


def _add_ground(market: _Market) -> None:
    """Add the paving around the square in strips that meet edge to edge, the floor of the square, and the sky."""
    group, (x, z), reach = market.scene.add_node("ground"), SQUARE, HALF + DEEP
    strips = ((-reach, reach, -reach, -z), (-reach, reach, z, reach), (-reach, -x, -z, z), (x, reach, -z, z))

    def paved(material: str, area: tuple[float, float, float, float], metres: float) -> Parts:
        x0, x1, z0, z1 = area
        mesh: Mesh = quad((x0, 0.0, z0), (x1 - x0, 0.0, 0.0), (0.0, 0.0, z1 - z0), 8)
        uv = mesh.positions[:, [0, 2]] / metres
        parts = Parts()
        parts.add(material, Mesh(mesh.positions, mesh.normals, mesh.triangles, uv).painted((1.0, 1.0, 1.0)))
        return parts

    for number, strip in enumerate(strips):
        name = f"paving_{number}"
        market.draw(name, partial(paved, "setts", strip, PAVING_METRES), name, group)
    market.draw("floor", partial(paved, "floor", (-x, x, -z, z), FLOOR_METRES), "floor", group)

    def sky() -> Parts:
        parts = Parts()
        parts.add("sky", dome(85.0).painted((1.0, 1.0, 1.0)))
        return parts

    market.draw("sky", sky, "sky", group, backdrop=True)


def _add_houses(market: _Market) -> None:
    """Add five houses on each side, wall to wall, and one behind each corner."""
    group, plain = market.scene.add_node("houses"), Side("party")

    def house(number: int, width: float) -> Parts:
        look, storeys = HOUSES[number]
        lot = Lot(-width / 2, 0.0, width, DEEP, look, storeys, "flat", (Side("street"), plain, plain, plain))
        return building(lot, 1, np.random.default_rng(2301 + number))

    for side in range(4):
        turn = 90.0 * side
        c, s = round(np.cos(np.radians(turn))), round(np.sin(np.radians(turn)))
        for k in range(5):
            number = (3 * side + 2 * k) % len(HOUSES)
            # The corner of the lot, which is at its back left, in the frame of a side that looks towards +z.
            x, z = (k - 2.5) * FRONT, -HALF - DEEP
            at = (c * x + s * z, 0.0, c * z - s * x)
            market.draw(
                f"house_{number}", partial(house, number, FRONT), f"house_{side}_{k}", group, at, turn
            )
        x, z = 2.5 * FRONT, -HALF - DEEP
        at = (c * x + s * z, 0.0, c * z - s * x)
        market.draw("corner", partial(house, 0, DEEP), f"corner_{side}", group, at, turn)


def _add_stalls(market: _Market) -> None:
    """Add all stalls with awnings and goods, and crates behind some."""
    group, rng = market.scene.add_node("stalls"), np.random.default_rng(2401)
    kinds = [kind for kind in GOODS if kind != "glassware"]
    bare = ("fruit", "food")
    for number, stall in enumerate(stalls()):
        at, node = (stall.x, 0.0, stall.z), f"stall_{number}"
        chance, wood, style = float(rng.random()), int(rng.integers(2)), int(rng.integers(len(AWNINGS)))
        kind, variant = str(rng.choice(kinds, p=SHARES)), int(rng.integers(2))
        if chance < 0.05 or any(abs(stall.x - x) + abs(stall.z - z) < 0.1 for x, z in GLASS_STALLS):
            kind = "glassware"
        tiers = kind not in bare or kind == "food"
        market.draw(
            f"frame_{wood}{tiers:d}", partial(frame, (0.62, 0.85)[wood], tiers), node, group, at, stall.turn
        )
        market.draw(f"awning_{style}", partial(awning, style), f"{node}_awning", group, at, stall.turn)
        goods = partial(GOODS[kind], np.random.default_rng(2501 + 10 * list(GOODS).index(kind) + variant))
        market.draw(f"{kind}_{variant}", goods, f"{node}_goods", group, at, stall.turn)
        if chance > 0.55 and abs(stall.z) > 24.0:  # those in other rows have stalls behind them
            market.draw("stack", stack, f"{node}_stack", group, stall.place(0.0, 0.0, -3.0), stall.turn)


def _add_square(market: _Market) -> None:
    """Add the fountain, tables, benches, and the poles of the whole market."""
    group = market.scene.add_node("square")
    market.draw("fountain", partial(fountain, 12), "fountain", group, (0.0, 0.05, 0.0))
    for number, (kind, x, z, turn) in enumerate(FURNITURE):
        make = partial(table if kind == "table" else bench, 8)
        market.draw(kind, make, f"{kind}_{number}", group, (x, 0.0, z), turn)
    for number, place in enumerate(poles()):
        market.draw(f"pole_{number}", partial(pole, place), f"pole_{number}", group, (place.x, 0.0, place.z))


def _add_strings(market: _Market) -> None:
    """Add the wires, a mesh for each ninth of the market."""
    group, regions = market.scene.add_node("wires"), dict[str, list[int]]()
    every = strings()
    for number, string in enumerate(every):
        x, _, z = string.points(np.array([0.5]))[0]
        cell = f"wires_{int((x + HALF) // (2 * HALF / 3))}{int((z + HALF) // (2 * HALF / 3))}"
        regions.setdefault(cell, []).append(number)
    for cell, numbers in regions.items():
        market.draw(cell, partial(wires, [every[k] for k in numbers]), cell, group)
