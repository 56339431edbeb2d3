"""How much more is drawn than is visible: `strata bench 6 --only ideal`.

The ideal visible set are the meshlets that own a pixel of the picture. It is measured, not estimated: a view of the
scene has every meshlet as an instance and a mesh of its own, and is drawn without culling; then the instance ids of the
picture are the visible meshlets. What culling draws is held against their triangles, since no test of whole meshlets
can draw less. The late share is that of a walk through the view, where the guess of the last frame is a little wrong.
"""

from __future__ import annotations

from collections.abc import Callable
from dataclasses import replace
from typing import Any

import numpy as np
from numpy.typing import NDArray
from rich.console import Console

from common.reports.benches import Effort, Subject, middle
from common.reports.tables import table
from common.scene import Instances, Scene
from common.settings import knobs

from .streets import (
    KNOB,
    LARGE,
    LEAST_WARM_UP,
    city,
    is_software,
    medium,
    solid_triangles,
    view_at,
    walked,
)

VIEWS, QUICK_VIEWS = 20, 4
"""Views, in the order of the file; the last ones of the city look down at its roofs."""

SOFTWARE_SIZE, QUICK_SIZE = (960, 540), (320, 180)
"""Sizes of the pictures on a software driver, and of a quick look; on a GPU it is LARGE."""

WALK = 8
"""Frames of the walk in each view."""

PATHS = {"meshlets": {"culling": "occlusion"}, "whole": {"culling": "occlusion", "geometry": "classic"}}
"""What is held against the visible set: meshlets, on the fastest path of the device, and whole meshes."""


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any] | None:
    """Return the record of a chapter that culls; None for others."""
    if KNOB not in knobs(subject.settings_class):
        return None
    step("the city", 0.0)
    name, scene = city(subject, effort)
    size = (SOFTWARE_SIZE if is_software(subject) else LARGE) if effort.everything else QUICK_SIZE
    names = [camera.name for camera in scene.cameras][: VIEWS if effort.everything else QUICK_VIEWS]
    rows: list[dict[str, Any]] = [{"view": view} for view in names]
    apart, triangles = meshlets_apart(scene, subject.module("meshlets.scene").meshlets_of(scene))
    settings = medium(subject, culling="off", geometry="classic")
    with subject.on(apart, size).open(settings, {"instance_id"}) as renderer:
        for number, row in enumerate(rows):
            step(f"visible in {row['view']}", 0.1 + 0.5 * number / len(rows))
            ids = np.unique(renderer.render(view_at(apart, row["view"], size), 0.0).image("instance_id"))
            seen = triangles[ids[ids > 0].astype(np.int64) - 1]
            row |= {"visible": int(seen.sum()), "visible_meshlets": len(seen)}
    del apart
    for place, (path, values) in enumerate(PATHS.items()):
        with subject.on(scene, size).open(medium(subject, **values), {"color"}) as renderer:
            for number, row in enumerate(rows):
                step(f"{path} in {row['view']}", 0.6 + 0.2 * (place + number / len(rows)))
                still = view_at(scene, row["view"], size)
                row[path], late = _drawn(renderer, still, WALK if path == "meshlets" else 0)
                if late:
                    row |= {"late": float(np.median(late)), "late_most": max(late)}
    found = {path: [row[path] / max(row["visible"], 1) for row in rows] for path in PATHS}
    return {
        "scene": name,
        "size": list(size),
        "triangles": solid_triangles(scene),
        "frames": WALK,
        "views": rows,
        "ratio": middle(found["meshlets"])[0],
        "ratio_whole": middle(found["whole"])[0],
        "late": middle([row["late"] for row in rows])[0],
    }


def _drawn(renderer: Any, still: Any, walk: int) -> tuple[int, list[float]]:
    """Return the triangles that a view which stands still draws, and the late parts of those of a walk."""
    for _ in range(LEAST_WARM_UP):
        work = renderer.render(still, 0.0).work
    late = []
    for number in range(1, walk + 1):
        moved = renderer.render(walked(still, number), 0.0).work
        late.append(moved["triangles_late"] / max(moved["triangles_drawn"], 1))
    return int(work["triangles_drawn"]), late


def meshlets_apart(scene: Scene, meshlets: Any) -> tuple[Scene, NDArray[np.int64]]:
    """Return the scene with an instance and a mesh for each meshlet of each solid instance, and their triangles.

    Blended instances are left out, since they hide nothing and own no pixels. A mesh without meshlets stays whole. The
    instances keep their order, so the winner of equal depths is that of the scene.
    """
    counts = meshlets.ranges[:, 1].astype(np.int64)
    blended = np.array([material.alpha_mode == "blend" for material in scene.materials], bool)
    units = np.where(blended[scene.meshes["material"]], 0, np.maximum(counts, 1))
    first = np.cumsum(units) - units
    owner = np.repeat(np.arange(len(units)), units)
    rows = scene.meshes[owner].copy()
    cut = counts[owner] > 0
    places = meshlets.ranges[owner, 0].astype(np.int64) + np.arange(len(owner)) - first[owner]
    records = meshlets.records[places[cut]]
    rows["first_index"][cut] += records["first_index"]
    rows["index_count"][cut] = 3 * (records["counts"] >> 8)
    rows["bounds_min"][cut] = records["centre"] - records["extent"]
    rows["bounds_max"][cut] = records["centre"] + records["extent"]
    old = scene.instances
    number = units[old.mesh]
    of = np.repeat(np.arange(len(old)), number)
    mesh = first[old.mesh[of]] + np.arange(len(of)) - np.repeat(np.cumsum(number) - number, number)
    local = None if old.local is None else old.local[of]
    instances = Instances(old.node[of], mesh.astype(np.int32), local, old.visible[of])
    apart = replace(
        scene,
        indices=meshlets.indices,
        meshes=rows,
        mesh_names=[""] * len(rows),
        instances=instances,
        deformations=[
            replace(one, mesh=int(first[one.mesh])) for one in scene.deformations if units[one.mesh]
        ],
    )
    return apart, rows["index_count"][mesh].astype(np.int64) // 3


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the record as a table, and its sentences."""
    width, height = record["size"]
    shown = table(
        f"Triangles drawn and visible, {record['scene']}, {width}x{height}",
        *("view", ">visible", ">meshlets", ">ratio", ">whole meshes", ">ratio", ">late %", ">most"),
    )
    for row in record["views"]:
        cells = [f"{row['visible']:,}"]
        for path in PATHS:
            cells += [f"{row[path]:,}", f"{row[path] / max(row['visible'], 1):.2f}"]
        shown.add_row(row["view"], *cells, f"{row['late']:.2%}"[:-1], f"{row['late_most']:.2%}"[:-1])
    to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    width, height = record["size"]
    ratios = [row["meshlets"] / max(row["visible"], 1) for row in record["views"]]
    lines = [
        f"In the median of {len(ratios)} views, {record['ratio']:.2f} times the triangles of the meshlets with a "
        f"visible pixel are drawn ({min(ratios):.2f} to {max(ratios):.2f}), by whole meshes "
        f"{record['ratio_whole']:.2f} times.",
        f"At walking speed {record['late']:.2%} of them are drawn late, in the worst frame of any view "
        f"{max(row['late_most'] for row in record['views']):.2%}.",
    ]
    if width * height < LARGE[0] * LARGE[1]:
        lines.append(
            f"The pictures have {width}x{height} pixels: in larger ones more is visible, and the ratio is smaller."
        )
    return lines


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw for each view the triangles that are visible, and what is drawn of them."""
    rows = sorted(record["views"], key=lambda row: int(row["visible"]))
    place = np.arange(len(rows))
    for name, label, mark in (
        ("whole", "drawn, whole meshes", "s"),
        ("meshlets", "drawn, meshlets", "o"),
        ("visible", "in meshlets with a visible pixel", "_"),
    ):
        axes.plot(place, [row[name] for row in rows], mark, label=label, ms=8 if mark == "_" else 4)
    axes.axhline(record["triangles"], color="0.6", lw=0.8, ls="--", label="of the scene")
    axes.set_yscale("log")
    axes.set_xticks(place, [row["view"] for row in rows], rotation=90, fontsize=7)
    axes.set_ylabel("triangles")
    width, height = record["size"]
    axes.set_title(f"Drawn and visible, {record['scene']}, {width}x{height}", fontsize=10)
    axes.legend(fontsize=8)
