"""The city: blocks of houses in a grid of streets, made to a given number of triangles and of instances.

`city:1M` has exactly 1,000,000 triangles in its meshes, each counted once, and draws 10,000 instances. Every building
is a mesh of its own; trees, cars, lamps and other furniture are drawn many times, turned, stretched and mirrored. The
ornament of the buildings follows the triangles that are left for them, and the leaves of a few big trees make up the
rest.
"""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import partial

import numpy as np

from assets.city_buildings import Lot, building, tower
from assets.city_ground import ROUND, court, crossing, dome, land, park, paved, pavement, street
from assets.city_landmarks import FEET, church
from assets.city_materials import add_materials
from assets.city_parts import Parts
from assets.city_placing import Place, all_places, taken
from assets.city_plan import BLOCK, KERB, PAVEMENT, Block, Plan, make_plan
from assets.city_things import Finish, all_things, finish_of
from assets.city_trees import KINDS, leafy_tree
from assets.city_views import add_views, eyes
from assets.gltf_writer import GltfBuilder, axis_angle, look_at
from assets.noise import Float64

TRIANGLES_PER_INSTANCE = 100
SPARE = 0.04
"""Share of the triangles that is left for the big trees."""

MOST_PER_TREE = 20000
SUN_LUX, SUN_DIRECTION, SUN_COLOR = 62000.0, (-0.58, -0.62, -0.46), (1.0, 0.93, 0.8)
AMBIENT_NITS = 6200.0
BACKDROP = {"strata": {"backdrop": True}}
TOWER_FOOT = (18.0, 10.0, 42.0, 34.0)
"""x0, z0, x1, z1 of the ground that a tower takes in its block."""

COSTS = np.array([(375, 3.5, 7.6), (507, 23.0, 12.1), (514, 35.0, 24.0), (440, 40.0, 32.0)])
"""About how many triangles a building has at each level of ornament: of itself, for a metre of wall along streets, and
for a metre of each storey. Fitted to buildings of all looks."""


def build(size: str = "100K") -> GltfBuilder:
    """Return the city of `size` unique triangles, such as "100K" or "1M", ready to be written."""
    triangles = int(size[:-1]) * {"K": 1000, "M": 1_000_000}[size[-1]]
    finish, plan, city = finish_of(triangles), make_plan(triangles), _City()
    _add_ground(city, plan, finish)
    _add_landmarks(city, plan, finish)
    things = all_things(finish)
    reserved = sum(parts.triangles for variants in things.values() for parts in variants)
    _add_houses(city, plan, triangles - city.triangles - reserved - max(600, round(SPARE * triangles)))
    big = math.ceil((triangles - city.triangles - reserved) / (0.7 * MOST_PER_TREE)) + 1
    # A tree is two instances, wood and leaves.
    _add_things(city, plan, things, triangles // TRIANGLES_PER_INSTANCE - city.instances - 2 * big)
    _add_big_trees(city, plan, big, triangles - city.triangles)
    add_views(city.scene, plan)
    sun = look_at((0, 0, 0), SUN_DIRECTION)
    city.scene.add_light("sun", "directional", SUN_COLOR, SUN_LUX, translation=(0, 60, 0), rotation=sun)
    city.scene.gltf.scenes[0].extras = {"strata": {"ambient": AMBIENT_NITS}}
    assert (city.triangles, city.instances) == (triangles, triangles // TRIANGLES_PER_INSTANCE)
    return city.scene


class _City:
    """The scene while it is made, with the number of triangles in its meshes and of instances, one a material."""

    def __init__(self) -> None:
        self.scene = GltfBuilder("city")
        self.triangles = 0
        self.instances = 0
        self._material = add_materials(self.scene)
        self._meshes: dict[str, tuple[int, int]] = {}

    def add(self, name: str, make: Parts | Callable[[], Parts]) -> str:
        """Add a mesh, made if need be, unless there is one of that name already; return the name."""
        if name not in self._meshes:
            parts = make if isinstance(make, Parts) else make()
            meshes = parts.meshes()
            number = self.scene.add_mesh(
                name, *((mesh, self._material[material]) for material, mesh in meshes)
            )
            self._meshes[name] = (number, len(meshes))
            self.triangles += parts.triangles
        return name

    def draw(
        self, mesh: str, node: str, parent: int, at: tuple[float, ...] | None = None, turn: float = 0.0,
        scale: tuple[float, float, float] | None = None, lean: tuple[float, tuple[float, float, float]] | None = None,
        backdrop: bool = False,
    ) -> None:  # fmt: skip
        """Draw a mesh at a place, turned about y by degrees and scaled; or leaning by degrees about an axis."""
        number, cost = self._meshes[mesh]
        rotation = axis_angle((0, 1, 0), turn) if turn else None
        if lean is not None:
            rotation = axis_angle(lean[1], lean[0])
        extras = BACKDROP if backdrop else None
        self.scene.add_node(node, parent, at, rotation, scale, mesh=number, extras=extras)
        self.instances += cost


def _add_ground(city: _City, plan: Plan, finish: Finish) -> None:
    """Add sky, land, carriageways, and what lies around and inside each block."""
    group, fine = city.scene.add_node("ground"), not finish.kinds
    reach = 1.3 * float(np.hypot(*plan.half)) + 30.0

    def sky() -> Parts:
        parts = Parts()
        parts.add("sky", dome(reach).painted((1.0, 1.0, 1.0)))
        return parts

    city.draw(city.add("sky", sky), "sky", group, backdrop=True)
    city.draw(city.add("land", partial(land, plan.half, 1.05 * reach)), "land", group)
    for i, (x, a) in enumerate(plan.road_x):
        for j, (z, b) in enumerate(plan.road_z):
            mesh = city.add(f"crossing_{a:.0f}_{b:.0f}", partial(crossing, a, b, fine))
            city.draw(mesh, f"crossing_{i}_{j}", group, (x, 0, z))
    long_x, long_z = (size + 2 * PAVEMENT - 2 * ROUND for size in BLOCK)
    for block in plan.blocks[: plan.columns]:
        for j, (z, b) in enumerate(plan.road_z):
            mesh = city.add(f"street_x_{b:.0f}", partial(street, long_x, b, fine))
            city.draw(mesh, f"street_x_{block.column}_{j}", group, (block.x + BLOCK[0] / 2, 0, z), 90.0)
    for block in plan.blocks[:: plan.columns]:
        for i, (x, a) in enumerate(plan.road_x):
            mesh = city.add(f"street_z_{a:.0f}", partial(street, long_z, a, fine))
            city.draw(mesh, f"street_z_{i}_{block.row}", group, (x, 0, block.z + BLOCK[1] / 2))
    squares = plan.of_kind("square")
    for block in plan.blocks:
        at, label = (block.x, KERB, block.z), f"{block.column}_{block.row}"
        city.draw(city.add("pavement", partial(pavement, fine)), f"pavement_{label}", group, at)
        city.draw(_inner_ground(city, block, block in squares[:1]), f"court_{label}", group, at)


def _inner_ground(city: _City, block: Block, has_church: bool) -> str:
    """Add the ground inside a block, if it is not there yet, and return the name of its mesh."""
    if block.kind == "houses":
        return city.add(f"court_{block.yards[0]:d}{block.yards[1]:d}", partial(court, block.yards))
    if block.kind == "park":
        return city.add("park", park)
    if block.kind == "tower":
        return city.add("plaza", partial(paved, [TOWER_FOOT]))
    return (
        city.add("church_square", partial(paved, FEET))
        if has_church
        else city.add("square", partial(paved, []))
    )


def _add_landmarks(city: _City, plan: Plan, finish: Finish) -> None:
    """Add the church and the towers."""
    rng, group = np.random.default_rng(1101), city.scene.add_node("landmarks")
    for block in plan.of_kind("square")[:1]:
        city.draw(
            city.add("church", partial(church, finish.level, rng)), "church", group, (block.x, KERB, block.z)
        )
    x0, z0, x1, z1 = TOWER_FOOT
    for number, block in enumerate(plan.of_kind("tower")):
        tiers = rng.integers((9, 5, 2), (14, 9, 5)) if finish.level else np.array([7, 3])
        storeys = tuple(int(count) for count in tiers)
        make = partial(tower, (x1 - x0, z1 - z0), storeys, min(finish.level, 2), rng)
        mesh = city.add(f"tower_{number}", make)
        city.draw(mesh, mesh, group, (block.x + (x0 + x1) / 2, KERB, block.z + (z0 + z1) / 2))


def _costs(lot: Lot) -> Float64:
    """Return about how many triangles the building on a lot has at each level of ornament (4,)."""
    lengths = (lot.width, lot.depth, lot.width, lot.depth)
    length = sum(length for length, side in zip(lengths, lot.sides, strict=True) if side.kind == "street")
    return COSTS @ np.array([1.0, length, length * lot.storeys])


def _add_houses(city: _City, plan: Plan, budget: int) -> None:
    """Add a building on every lot, with so much ornament that together they have about `budget` triangles."""
    rng, group = np.random.default_rng(1201), city.scene.add_node("houses")
    lots = [(block, lot, _costs(lot)) for block in plan.blocks for lot in block.lots]
    to_come, end = np.sum([costs for _, _, costs in lots], axis=0), city.triangles + budget
    for number, (block, lot, costs) in enumerate(lots):
        # Each gets its share of what is left, more or less: plain houses stand beside rich ones.
        allowed = (end - city.triangles) * costs[1] / to_come[1] * rng.uniform(0.6, 1.4)
        level = int(np.searchsorted((costs[1:] + costs[:-1]) / 2, allowed))
        to_come -= costs
        parts = building(lot, level, rng)
        while (
            level and city.triangles + parts.triangles + to_come[0] > end
        ):  # the others must have room as well
            level -= 1
            parts = building(lot, level, rng)
        mesh = city.add(f"house_{number}", parts)
        city.draw(mesh, mesh, group, (block.x + lot.x, KERB, block.z + lot.z))


def _add_things(city: _City, plan: Plan, things: Mapping[str, list[Parts]], instances: int) -> None:
    """Put things on their places until there are exactly so many more instances."""
    rng, group = np.random.default_rng(1401), city.scene.add_node("furniture")
    places, variants = [], {}
    for place in all_places(plan, 1501, eyes(plan)):
        if place.kind in things:
            number = int(rng.integers(len(things[place.kind])))
            mesh = f"{place.kind.replace(' ', '_')}_{number}"
            variants[mesh] = things[place.kind][number]
            places.append(replace(place, kind=mesh))
    cost = {mesh: len(parts.meshes()) for mesh, parts in variants.items()}
    for number, place in enumerate(taken(places, cost, instances)):
        city.add(place.kind, variants[place.kind])
        _put(city, place, f"{place.kind}_at_{number}", group)


def _put(city: _City, place: Place, node: str, group: int) -> None:
    """Draw a thing on its place."""
    if not place.lean:
        scale = None if place.scale == (1.0, 1.0, 1.0) else place.scale
        city.draw(place.kind, node, group, place.at, place.turn, scale)
        return
    # A mesh that leans below a stretched parent is sheared: no rotation and scale of one node would do the same.
    wind = city.scene.add_node(f"{node}_wind", group, translation=place.at, scale=(1.3, 1.0, 0.8))
    axis = (math.sin(place.turn), 0.0, math.cos(place.turn))
    city.draw(place.kind, node, wind, scale=place.scale, lean=(place.lean, axis))


def _add_big_trees(city: _City, plan: Plan, count: int, triangles: int) -> None:
    """Add so many trees with single leaves that together have exactly so many triangles."""
    rng, group = np.random.default_rng(1601), city.scene.add_node("big_trees")
    spots = [
        (block.x + x, KERB, block.z + z)
        for kind, places in (
            ("square", ((7.0, 22.0), (55.0, 22.0))),
            ("park", ((9.0, 12.0), (51.0, 32.0), (51.0, 12.0), (9.0, 32.0))),
            ("houses", ((24.0, 22.0), (36.0, 22.0))),
        )
        for block in plan.of_kind(kind)
        for x, z in places
    ]
    for number in range(count):
        rest = count - number - 1
        # The first trees are as large as the others allow, so that there are meshes of all sizes.
        part = (
            min(MOST_PER_TREE, triangles - 2000 * rest)
            if triangles > 4000 * count
            else triangles // (rest + 1)
        )
        triangles -= part
        mesh = city.add(f"big_tree_{number}", partial(leafy_tree, KINDS[number % 3], part, rng))
        city.draw(mesh, mesh, group, spots[number])
