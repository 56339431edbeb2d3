"""Strata's chapter 1 beside pygfx, another renderer in Python, on the same machine in the same run.

    .venv/bin/python docs/benchmarks/peer_pygfx.py --peer /path/to/pygfx-venv/bin/python --models /path/to/models

pygfx lives in an environment of its own (`pip install "pygfx==0.17.*" gltflib`) and is no dependency of Strata. Both
load the same files, see them through the same camera under one light, draw at 640x360 and bring every picture to the
CPU. Each measurement is a process of its own; sides take turns, and the best of several runs counts, since whatever
else the machine does only ever adds time.

pygfx is measured twice: "as it comes" (2x2 samples a pixel and anti-aliasing after that) and "one sample", which is the
work that chapter 1 does. The record goes to `ch01-peer.json`.
"""

from __future__ import annotations

import argparse
import json
import math
import os
import statistics
import subprocess
import sys
import tempfile
import time
from pathlib import Path
from typing import Any

HERE = Path(__file__).resolve().parent
ROOT = HERE.parents[1]
SIZE = (640, 360)
BOXES = 1000
TURN_DEG = 0.5
"""How far the camera goes round its target from frame to frame: nothing may be kept because nothing moved."""

SIDES = ("strata", "pygfx one sample", "pygfx as it comes")


def eye_at(camera: dict[str, Any], frame: int) -> tuple[float, float, float]:
    """Return the eye of a frame: turned about the vertical through the target."""
    (ex, ey, ez), (tx, _, tz) = camera["eye"], camera["target"]
    angle = math.radians(TURN_DEG * frame)
    x, z = ex - tx, ez - tz
    c, s = math.cos(angle), math.sin(angle)
    return (tx + c * x + s * z, ey, tz - s * x + c * z)


# --- one side, in a process of its own ----------------------------------------------------------------------


def draw_by_strata(job: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Open chapter 1; return a function that draws frame i, and what is worth noting."""
    sys.path.insert(0, str(ROOT))
    import chapters
    from common.gltf import load_scene
    from common.numerics.transforms import pose_looking_at
    from common.view.camera import Perspective, View

    camera = job["camera"]
    renderer = chapters.open(1, scene=load_scene(Path(job["scene"])), size=SIZE)
    lens = Perspective(math.radians(camera["yfov_deg"]), camera["near"])
    timings: dict[str, float] = {}

    def draw(frame: int) -> Any:
        made = renderer.render(View(pose_looking_at(eye_at(camera, frame), camera["target"]), lens))
        picture = made.image("color")
        timings.update(made.timings, cpu=made.cpu_ms)
        return picture

    return draw, {"device": renderer.capabilities.device, "last_frame_ms": timings}


def draw_by_pygfx(job: dict[str, Any]) -> tuple[Any, dict[str, Any]]:
    """Make the same picture with pygfx; return a function that draws frame i, and what is worth noting."""
    import numpy as np
    import pygfx
    from rendercanvas.offscreen import RenderCanvas

    camera = job["camera"]
    canvas = RenderCanvas(size=SIZE, pixel_ratio=1)
    options = {} if job["side"] == "pygfx as it comes" else {"pixel_ratio": 1, "ppaa": "none"}
    renderer = pygfx.renderers.WgpuRenderer(canvas, **options)
    loaded = pygfx.load_gltf(job["scene"], quiet=True)
    scene = pygfx.Scene()
    scene.add(loaded.scene or loaded.scenes[0], pygfx.AmbientLight(intensity=0.25))
    # pygfx takes the mean of both angles of view, weighted by aspect.
    aspect = SIZE[0] / SIZE[1]
    mean = 2 * math.atan(math.tan(math.radians(camera["yfov_deg"]) / 2) * (1 + aspect) / 2)
    eye = pygfx.PerspectiveCamera(
        math.degrees(mean), aspect, depth_range=(camera["near"], 1e4 * camera["near"])
    )
    light = pygfx.DirectionalLight()
    light.local.position = (0.3, 0.5, 1.0)
    eye.add(light)
    scene.add(eye)
    canvas.request_draw(lambda: renderer.render(scene, eye))

    def draw(frame: int) -> Any:
        eye.local.position = eye_at(camera, frame)
        eye.look_at(camera["target"])
        return np.asarray(canvas.draw())

    return draw, {
        "device": renderer.device.adapter.info["device"],
        "physical_size": list(renderer.physical_size),
    }


def work(job: dict[str, Any]) -> None:
    """Do one job and print what it took: seconds to the first picture, then milliseconds for each frame."""
    draw, notes = (draw_by_strata if job["side"] == "strata" else draw_by_pygfx)(job)
    picture = draw(0)
    result: dict[str, Any] = {"start_s": time.time() - job["began"], **notes}
    frames = []
    for frame in range(1, job["frames"] + 1):
        began = time.perf_counter()
        picture = draw(frame)
        frames.append((time.perf_counter() - began) * 1e3)
    result["frames_ms"] = frames
    assert picture.shape[:2] == (SIZE[1], SIZE[0]), picture.shape
    result["covered"] = float((picture[..., :3].max(axis=-1) > 40).mean())
    assert result["covered"] > 0.03, "the picture is empty"
    if job["picture"]:
        from PIL import Image

        Image.fromarray(picture[..., :3]).save(job["picture"])
    print(json.dumps(result))
    sys.stdout.flush()
    os._exit(0)  # tearing down is not measured, and neither side's matters here


# --- the driver ---------------------------------------------------------------------------------------------


def write_boxes(folder: Path) -> Path:
    """Write a glTF file of 1,000 separate boxes: one mesh, 1,000 nodes, ten by ten by ten."""
    from assets.gltf_writer import GltfBuilder
    from assets.shapes import box

    scene = GltfBuilder("boxes")
    mesh = scene.add_mesh(
        "box", (box((-0.3, -0.3, -0.3), (0.3, 0.3, 0.3)), scene.add_material("grey", (0.6, 0.6, 0.6, 1.0)))
    )
    for i in range(BOXES):
        scene.add_node(f"box {i}", mesh=mesh, translation=(i % 10 - 4.5, i // 10 % 10 - 4.5, i // 100 - 4.5))
    return scene.save(folder, binary=True)


def framed(scene: Path) -> dict[str, Any]:
    """Return the camera that frames a scene, in plain numbers for both sides."""
    from common.gltf import load_scene
    from common.view.camera import framed_view

    loaded = load_scene(scene)
    view = framed_view(loaded, SIZE[0] / SIZE[1])
    return {
        "eye": view.eye.tolist(),
        "target": loaded.bounds.mean(axis=0).tolist(),
        "yfov_deg": math.degrees(view.projection.yfov),  # type: ignore[union-attr]
        "near": view.projection.near,
    }


def run_side(
    side: str, python: str, scene: Path, camera: dict[str, Any], frames: int, cache: Path, picture: str
) -> Any:
    """Run one job in a new process, with the caches of Strata and of the driver in `cache`; return its result."""
    job = {"side": side, "scene": str(scene), "camera": camera, "frames": frames, "picture": picture}
    environment = {
        **os.environ,
        "STRATA_CACHE": str(cache / "strata"),
        "MESA_SHADER_CACHE_DIR": str(cache / "driver"),
    }
    job["began"] = time.time()
    words = [python, str(Path(__file__).resolve()), "--work", json.dumps(job)]
    run = subprocess.run(words, env=environment, cwd=cache, capture_output=True, text=True)
    if run.returncode:
        raise SystemExit(f"{side} failed:\n{run.stderr}")
    return json.loads(run.stdout.splitlines()[-1])


def compare(
    name: str, scene: Path, peer: str, runs: int, frames: int, pictures: Path | None
) -> dict[str, Any]:
    """Measure all sides on one scene, in turns; return their best figures and the ratios."""
    camera = framed(scene)
    found: dict[str, list[dict[str, Any]]] = {side: [] for side in SIDES}
    with tempfile.TemporaryDirectory(prefix="strata-peer-") as folder:
        for turn in range(runs):
            for side in SIDES:
                cache = Path(folder) / side.replace(" ", "-")
                cache.mkdir(exist_ok=True)
                shown = (
                    str(pictures / f"{name}-{side.replace(' ', '-')}.png") if pictures and turn == 0 else ""
                )
                python = sys.executable if side == "strata" else peer
                found[side].append(run_side(side, python, scene, camera, frames, cache, shown))
                print(f"  {name}, {side}: {found[side][-1]['start_s']:.2f} s", file=sys.stderr)
    result: dict[str, Any] = {"scene": name, "camera": camera, "runs": runs, "frames": frames, "sides": {}}
    for side, jobs in found.items():
        result["sides"][side] = {
            "cold_start_s": jobs[0]["start_s"],  # the first run finds every cache empty
            "warm_start_s": min(job["start_s"] for job in jobs[1:]),
            "frame_ms": min(statistics.median(job["frames_ms"]) for job in jobs),
            "fastest_frame_ms": min(min(job["frames_ms"]) for job in jobs),
            **{key: value for key, value in jobs[-1].items() if key not in ("start_s", "frames_ms")},
        }
    ours = result["sides"]["strata"]
    result["ratios"] = {
        side: {
            key: round(ours[key] / result["sides"][side][key], 3)
            for key in ("cold_start_s", "warm_start_s", "frame_ms", "fastest_frame_ms")
        }
        for side in SIDES[1:]
    }
    return result


def main() -> None:
    """Compare on both scenes and write the record."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--work", help=argparse.SUPPRESS)
    parser.add_argument("--peer", help="Python of an environment with pygfx")
    parser.add_argument("--models", type=Path, help="folder with FlightHelmet/FlightHelmet.gltf")
    parser.add_argument("--runs", type=int, default=5, help="processes per side and scene, at least 2")
    parser.add_argument("--frames", type=int, default=30)
    parser.add_argument("--pictures", type=Path, help="folder for the last picture of every side")
    parser.add_argument("--out", type=Path, default=HERE / "ch01-peer.json")
    given = parser.parse_args()
    if given.work:
        work(json.loads(given.work))
        return
    if not given.peer or not given.models or given.runs < 2:
        parser.error("--peer and --models are needed, and at least 2 runs")
    sys.path.insert(0, str(ROOT))
    from tools.bench.bench import commit

    versions = "import pygfx, wgpu; print(pygfx.__version__, wgpu.__version__)"
    pygfx, wgpu = subprocess.run(
        [given.peer, "-c", versions], capture_output=True, text=True, check=True
    ).stdout.split()
    helmet = given.models / "FlightHelmet" / "FlightHelmet.gltf"
    load = os.getloadavg()
    with tempfile.TemporaryDirectory(prefix="strata-peer-") as folder:
        scenes = {"FlightHelmet": helmet, "1,000 boxes": write_boxes(Path(folder))}
        compared = [
            compare(name, scene, given.peer, given.runs, given.frames, given.pictures)
            for name, scene in scenes.items()
        ]
    record = {
        "size": list(SIZE),
        "pygfx": pygfx,
        "wgpu": wgpu,
        "commit": commit(),
        "cpus": os.cpu_count(),
        "load_before": load[0],
        "load_after": os.getloadavg()[0],
        "scenes": compared,
    }
    given.out.write_text(json.dumps(record, indent=1) + "\n")
    for one in compared:
        print(one["scene"])
        for side, figures in one["sides"].items():
            times = ", ".join(
                f"{key} {figures[key]:.2f}"
                for key in ("cold_start_s", "warm_start_s", "frame_ms", "fastest_frame_ms")
            )
            print(f"  {side}: {times}  {one['ratios'].get(side, '')}")


if __name__ == "__main__":
    main()
