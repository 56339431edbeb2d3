"""The lamps of the night market: bodies by kind and colour, each at one node with its light.

The body of a lamp is around its light and faces away from it, so that the light falls only on what is around.
"""

from __future__ import annotations

import numpy as np

from assets.gltf_writer import GltfBuilder, axis_angle, look_at
from assets.market_plan import COLORS, Lamp, wall_places
from assets.market_stalls import IRON, hood
from assets.shapes import Mesh, join, lathe, tube

HEAD_CONES = (24.0, 42.0)
"""Half angles of the spot lights in degrees: inside the first they are brightest, outside the second dark."""

PROFILES = {
    "bulb": ([[(0.012, 0.09), (0.042, 0.015), (0.038, -0.032), (0.0, -0.06)]], 5, 0.06),
    "paper": ([[(0.0, 0.165), (0.06, 0.155)],
               [(0.06, 0.155), (0.145, 0.085), (0.17, 0.0), (0.145, -0.085), (0.06, -0.155)],
               [(0.06, -0.155), (0.0, -0.165)]], 7, 0.165),
    "drum": ([[(0.0, 0.17), (0.12, 0.15)], [(0.12, 0.15), (0.12, -0.15)], [(0.12, -0.15), (0.0, -0.16)]], 8, 0.17),
    "globe": ([[(0.007, 0.26), (0.012, 0.06), (0.05, 0.0), (0.0, -0.06)]], 5, 0.06),
    "wall": ([[(0.0, 0.2), (0.09, 0.15)], [(0.09, 0.15), (0.06, -0.13)], [(0.06, -0.13), (0.0, -0.15)]], 6, 0.15),
}  # fmt: skip
"""Runs of (radius, height) from top to bottom, steps around, and where the glowing part begins."""

STEMS = {"paper": (0.17, 0.22), "drum": (0.165, 0.23)}
"""Lower and upper end of the hook by which a lamp hangs on its wire."""


def body(kind: str) -> Mesh:
    """Return the glowing body of a lamp; v of its picture is 1/8 where the glow begins and 1 at the foot."""
    runs, sides, top = PROFILES[kind]
    mesh = lathe(runs, sides)
    if kind in STEMS:
        low, high = STEMS[kind]
        mesh = join(mesh, lathe([[(0.007, high), (0.007, low)]], 3))
    assert mesh.uv0 is not None
    y, foot = mesh.positions[:, 1], runs[-1][-1][1]
    v = np.where(y > top + 1e-6, 0.06, 0.125 + 0.865 * (top - y) / (top - foot))
    return Mesh(mesh.positions, mesh.normals, mesh.triangles, np.stack([mesh.uv0[:, 0], v], -1))


def material_of(kind: str, color: int) -> str:
    """Return the name of the material of a body: bulbs in warm colours are brighter than shades."""
    return f"string_{color}" if kind == "bulb" and color <= 3 else f"shade_{color}"


class Lamps:
    """Adds lamps to a scene; bodies of one kind share their geometry."""

    def __init__(self, scene: GltfBuilder, material: dict[str, int]) -> None:
        self._scene, self._material = scene, material
        self._meshes: dict[tuple[str, int], int] = {}
        shade = material["shade_0"]
        self._bodies = {kind: scene.add_geometry(body(kind), shade) for kind in PROFILES}
        painted, glass = material["painted"], material["glass"]
        path = np.array(
            [
                (0.0, 0.05, -0.43),
                (0.0, 0.2, -0.36),
                (0.0, 0.28, -0.24),
                (0.0, 0.3, -0.1),
                (0.0, 0.27, -0.03),
                (0.0, 0.19, 0.0),
            ]
        )
        bracket = tube(path, 0.013, 4).painted(IRON)
        shell = lathe([[(0.02, 0.13), (0.105, 0.055), (0.105, -0.055), (0.03, -0.115)]], 6)
        self._more = {
            "wall": (scene.add_geometry(bracket, painted), painted),
            "globe": (scene.add_geometry(shell.painted((0.9, 0.95, 1.0)), glass), glass),
        }
        self._turns = {tuple(np.round(at, 6)): turn for at, turn in wall_places()}

    def _mesh(self, lamp: Lamp) -> int:
        key = lamp.kind, lamp.color
        if key not in self._meshes:
            name = f"{lamp.kind}_{lamp.color}"
            if lamp.kind == "head":
                meshes = hood().meshes()
                self._meshes[key] = self._scene.add_mesh(name, *((m, self._material[k]) for k, m in meshes))
            else:
                parts = [(self._bodies[lamp.kind], self._material[material_of(*key)])]
                if lamp.kind in self._more:
                    parts.append(self._more[lamp.kind])
                self._meshes[key] = self._scene.add_mesh_of(name, *parts)
        return self._meshes[key]

    def add(self, number: int, lamp: Lamp, parent: int) -> None:
        """Add a lamp: a node with its light and its body."""
        rotation, cones = None, None
        if lamp.target is not None:
            rotation, cones = look_at(lamp.at, lamp.target), HEAD_CONES
        elif lamp.kind == "wall":
            rotation = axis_angle((0, 1, 0), self._turns[tuple(np.round(lamp.at, 6))])
        color = COLORS[lamp.color]
        node = self._scene.add_light(
            f"lamp_{number}", "point" if cones is None else "spot", color, lamp.candela, parent,
            translation=lamp.at, rotation=rotation, reach=lamp.reach, cone_degrees=cones,
        )  # fmt: skip
        self._scene.gltf.nodes[node].mesh = self._mesh(lamp)
