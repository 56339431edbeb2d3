"""The named views of the night market: `lane-1` is the first, which is shown when none is asked for."""

from __future__ import annotations

from assets.gltf_writer import GltfBuilder

EV100 = 2.8

VIEWS = {
    "lane-1": ((-10.6, 1.75, -12.6), (4.0, 1.7, -13.5), 60.0, EV100),
    "lane-2": ((24.4, 1.7, 4.0), (0.0, 2.0, 4.6), 56.0, EV100),
    "lane-3": ((13.9, 1.7, 24.6), (13.2, 1.9, 0.0), 58.0, EV100),
    "square": ((-10.2, 2.1, 4.6), (3.0, 2.3, -1.6), 66.0, EV100),
    "glass": ((0.75, 1.6, 13.85), (-0.1, 1.28, 16.0), 60.0, EV100 - 0.4),
    "lamp": ((2.6, 1.55, -13.9), (7.5, 3.0, -12.9), 62.0, EV100),
    "roof": ((-23.0, 13.5, 24.0), (1.0, 0.0, -3.0), 52.0, EV100 + 0.8),
    "far": ((27.6, 6.2, -26.6), (-6.0, 1.0, 6.0), 56.0, EV100 + 0.5),
}
"""Eye, target, vertical field of view in degrees and EV 100 by name."""


def add_views(scene: GltfBuilder) -> None:
    """Add all views as cameras."""
    group = scene.add_node("cameras")
    for name, (eye, target, yfov, ev100) in VIEWS.items():
        scene.add_camera(name, eye, target, yfov, ev100, parent=group)
