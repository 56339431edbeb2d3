"""What updates of a scene graph cost: a tree of objects beside arrays, and a scene's pose after an edit of few nodes.

    python docs/benchmarks/scene_graph.py OUT.json [nodes ...]     numbers of nodes, 100000 if none are given

Trees are random, of some twenty levels; every row is the median of several rounds in one process, after a first round
that is not counted. `first_edit_ms` is what the first edit of a scene costs more, once: tables of who is below whom.
"""

from __future__ import annotations

import json
import platform
import statistics
import sys
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

ROOT = Path(__file__).resolve().parents[2]
sys.path.insert(0, str(ROOT))

import numpy as np  # noqa: E402

from common.numerics.transforms import normalize  # noqa: E402
from common.paths import write_whole  # noqa: E402
from common.scene import Animation, AnimationChannel, Instances, Nodes, Scene  # noqa: E402
from common.scene.pose import evaluate_pose, local_matrices  # noqa: E402
from common.scene_graph import SceneGraph, graph_from_arrays  # noqa: E402
from common.scene_graph.edit import delete_nodes  # noqa: E402
from common.scene_graph.file import graph_bytes  # noqa: E402
from common.scene_graph.objects import ObjectNode  # noqa: E402
from tests.support.scenes import quad_scene  # noqa: E402
from tools.bench.bench import commit  # noqa: E402

ROUNDS = 7


def main(out: str, counts: list[int]) -> None:
    """Measure every number of nodes and write the record."""
    record: dict[str, Any] = {
        "commit": commit(),
        "system": f"{platform.system()} {platform.machine()}, Python {platform.python_version()}, "
        f"numpy {np.__version__}",
        "rounds": ROUNDS,
        "sizes": [measure(count) for count in counts or [100_000]],
    }
    write_whole(Path(out), (json.dumps(record, indent=1) + "\n").encode())
    for row in record["sizes"]:
        for name, value in row.items():
            print(f"{name:32} {value:12,.3f}" if isinstance(value, float) else f"{name:32} {value:12,}")


def measure(count: int) -> dict[str, float | int]:
    """Return the row of one number of nodes; all times in milliseconds."""
    random = np.random.default_rng(0)
    parent = np.append(-1, random.random(count - 1) * np.arange(1, count)).astype(np.int32)
    nodes = Nodes(
        parent=parent,
        translation=random.normal(size=(count, 3)),
        rotation=normalize(random.normal(size=(count, 4))),
        scale=np.ones((count, 3)),
        matrix=np.tile(np.eye(4), (count, 1, 1)),
        has_matrix=np.zeros(count, bool),
        names=[""] * count,
    )
    local = local_matrices(nodes)
    row: dict[str, float | int] = {"nodes": count, "levels": len(nodes.ancestry.levels)}
    row |= of_objects(parent, local)
    row |= of_arrays(parent, local)
    instances = Instances(np.arange(count, dtype=np.int32), np.zeros(count, np.int32))
    return row | of_scene(replace(quad_scene(), nodes=nodes, instances=instances))


def of_objects(parent: np.ndarray, local: np.ndarray) -> dict[str, float]:
    """Build and update a tree of objects."""

    def build() -> ObjectNode:
        made: list[ObjectNode] = []
        for above, matrix in zip(parent.tolist(), local, strict=True):
            made.append(ObjectNode(matrix))
            if above >= 0:
                made[above].add(made[-1])
        return made[0]

    root = build()
    return {"objects_build_ms": median(build), "objects_update_ms": median(root.update)}


def of_arrays(parent: np.ndarray, local: np.ndarray) -> dict[str, float]:
    """Build, update, edit and store a graph of arrays."""

    def build() -> SceneGraph:
        graph = SceneGraph()
        for above, matrix in zip(parent.tolist(), local, strict=True):
            graph.add(above, matrix)
        return graph

    graph = graph_from_arrays(parent, local)
    every = np.arange(len(graph))
    low = np.flatnonzero(graph.ancestry.sizes == 1)[:10].tolist()

    def update_all() -> None:
        graph.mark(every)
        graph.update()

    def update_ten() -> None:
        for node in low:
            graph.set_local(node, local[node])
        graph.update()

    return {
        "arrays_add_one_by_one_ms": median(build),
        "arrays_from_parents_ms": median(lambda: graph_from_arrays(parent, local)),
        "arrays_update_all_ms": median(update_all),
        "arrays_update_ten_leaves_ms": median(update_ten),
        "arrays_delete_tenth_ms": median(lambda: delete_nodes(graph, every[-len(every) // 10 :])),
        "arrays_file_ms": median(lambda: graph_bytes(graph)),
    }


def of_scene(scene: Scene) -> dict[str, float]:
    """Evaluate a scene's pose whole, after an edit of one leaf, and with a clip that drives twenty leaves."""
    count = len(scene.nodes)

    def whole() -> None:
        scene.rest_pose = None
        evaluate_pose(scene, 0.0)

    def edit() -> None:
        with scene.edit() as change:
            change.set_transform(count - 1, translation=(1.0, 2.0, 3.0))
        evaluate_pose(scene, 0.0)

    result = {"pose_whole_ms": median(whole)}
    began = time.perf_counter()
    edit()
    first = (time.perf_counter() - began) * 1e3
    result |= {"pose_after_edit_ms": median(edit)}
    result |= {"first_edit_ms": first - result["pose_after_edit_ms"]}
    values = np.array([(0.0, 0.0, 0.0), (1.0, 1.0, 1.0)])
    channels = tuple(
        AnimationChannel(count - 1 - leaf, "translation", np.array((0.0, 1.0)), values, "linear")
        for leaf in range(20)
    )
    moving = replace(scene, animations=[Animation("clip", channels, 1.0)])
    result["pose_of_clip_ms"] = median(lambda: evaluate_pose(moving, 0.5))
    moving.driven_levels = None  # as if the clip moved most nodes
    result["pose_of_clip_whole_ms"] = median(lambda: evaluate_pose(moving, 0.5))
    return result


def median(work: Callable[[], object]) -> float:
    """Return the median milliseconds of `work` over some rounds, after one that is not counted."""
    times = []
    for _ in range(ROUNDS + 1):
        began = time.perf_counter()
        work()
        times.append((time.perf_counter() - began) * 1e3)
    return statistics.median(times[1:])


if __name__ == "__main__":
    if len(sys.argv) < 2:
        sys.exit(__doc__)
    main(sys.argv[1], [int(word) for word in sys.argv[2:]])
