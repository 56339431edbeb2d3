#!/usr/bin/env python3
"""Records what a checkout of Strata computes and prints, to show that moved code still does the same.

    python3 .ci/same_results.py record CHECKOUT FOLDER [NAME...]    parts whose names begin with NAME; none: all
    python3 .ci/same_results.py compare OLD NEW                     exit code 1 if the two records differ

A record is a folder of files: pixels and work counters of every chapter, variant, scene, preset and view (`frames`),
the files of scene caches by size and hash (`caches`), and what commands print, frame graphs among it (`commands`).
The checkout needs its `.venv`; scenes of `STRATA_ASSETS` are drawn where they are present. Nothing of the checkout is
imported here: frames are drawn by `chapters.open` in processes of their own, which keeps its name.
"""

from __future__ import annotations

import hashlib
import json
import os
import re
import shutil
import subprocess
import sys
import tempfile
from collections.abc import Callable
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path

CHAPTERS = (1, 2, 3, 4, 5)
VARIANTS = ("vulkan", "without-all", "gl")
DRAW = """
import hashlib, json, sys
from importlib import import_module
from pathlib import Path
import numpy as np
import chapters
from chapters import scenes
from common.errors import StrataError
from common.settings import apply_overrides, knobs, preset

number, variant, assets, folder = int(sys.argv[1]), sys.argv[2], sys.argv[3], Path(sys.argv[4])
lesson = chapters.lesson(number)
backend = "gl" if variant == "gl" else "vulkan"
without = tuple(lesson.needs.optional) if variant == "without-all" else ()
kind = chapters.settings_class(number)
outputs = chapters.outputs_of(number)
models = sorted(path for path in Path(assets, "models").glob("*/**/*.gl*") if path.suffix in (".gltf", ".glb"))
cases = [(name, name, None, 0.0) for name in ("atrium", "cloth", "cornell", "spheres")]
cases += [(path.relative_to(Path(assets, "models")).as_posix(), str(path), None, 0.0) for path in models]
cases += [(f"{name} at 0.5 s", name, None, 0.5) for name in ("atrium", "cloth")]
cases += [(f"atrium {name}", "atrium", preset(kind, name), 0.0) for name in kind.PRESETS]
known = knobs(kind)
texts = [f"view={name}" for name in (known["view"].choices if "view" in known else ())]
texts += ["graph=forward", "graph=compute", "aperture=2", "depth_prepass=on", "gbuffer_format=full", "msaa=4"]
texts += ["recording_threads=2", "alias=off", "resubmit=off", "cloth_method=springs", "cloth_execution=dispatch"]
for text in texts:
    if text.partition("=")[0] in known:
        cases.append((f"atrium {text}", "atrium", apply_overrides(kind(), [text]), 0.0))
found = {}
loaded = {}
for label, which, settings, time in cases:
    try:
        scene = loaded.setdefault(which, None) or scenes.load(which)
        loaded[which] = scene
        with chapters.open(number, backend, scene=scene, size=(96, 64), settings=settings, without=without,
                           outputs=outputs) as renderer:
            view = chapters.view_of(renderer)
            renderer.render(view, 0.0)
            frame = renderer.render(view, time)
            images = {name: frame.image(name) for name in outputs}
            work = {name: value for name, value in frame.work.items()}
    except StrataError as error:
        found[label] = {"error": str(error)}
        continue
    np.savez_compressed(folder / (label.replace("/", "~").replace(" ", "_") + ".npz"), **images)
    hashes = {name: hashlib.sha256(np.ascontiguousarray(image).tobytes()).hexdigest() for name, image in images.items()}
    found[label] = {"images": hashes, "work": work}
(folder / "found.json").write_text(json.dumps(found, indent=1, sort_keys=True))
"""
COMMANDS = (
    *(
        "--help",
        "run --help",
        "bench --help",
        "compare --help",
        "diff --help",
        "frame --help",
        "graph --help",
    ),
    *("list --help", "explain --help", "assets --help", "bundle --help", "convert --help", "docs --help"),
    *(
        "exercise --help",
        "check --help",
        "carry --help",
        "new --help",
        "fork --help",
        "doctor --help",
        "test --help",
    ),
    *("list", "list --scenes", "list --features --find culling", "explain bindless", "explain nonsense"),
    *(f"{word} {number}" for number in CHAPTERS for word in ("list", "exercise")),
    *(f"list {number} --{word}" for number in CHAPTERS for word in ("settings", "views")),
    *(
        "run 77",
        "run 1 --set nonsense=1",
        "run 1 --scene nowhere.gltf",
        "run 5 --set cloth_step=9",
        "compare 1",
    ),
    *("diff 1 77", "graph 1", "frame 5 --scene nowhere", "check nowhere", "fork 1", "assets get nonsense"),
    *(f"graph {number} --backend {backend} --json -" for number in (4, 5) for backend in ("vulkan", "gl")),
)


def environment(checkout: Path, cache: Path) -> dict[str, str]:
    """Return the variables of a process of the checkout."""
    return os.environ | {"PYTHONPATH": str(checkout), "STRATA_CACHE": str(cache), "COLUMNS": "200", "CI": ""}


def python(
    checkout: Path, cache: Path, *words: str, seconds: float = 3000
) -> subprocess.CompletedProcess[str]:
    """Run the checkout's Python outside its folder."""
    return subprocess.run(
        [str(checkout / ".venv/bin/python"), "-P", *words],
        cwd=cache,
        env=environment(checkout, cache),
        capture_output=True,
        text=True,
        timeout=seconds,
        stdin=subprocess.DEVNULL,
    )


def frames(checkout: Path, folder: Path, cache: Path, name: str) -> None:
    """Draw every scene, preset and view of a chapter in a variant."""
    chapter, _, variant = name.removeprefix("frames-").partition("-")
    folder.mkdir(parents=True)
    assets = os.environ.get("STRATA_ASSETS") or str(checkout.parent / "shared/assets")
    done = python(checkout, cache, "-c", DRAW, chapter, variant, assets, str(folder))
    if done.returncode:
        raise SystemExit(f"{name}: {done.stderr[-3000:]}")


def caches(checkout: Path, folder: Path, cache: Path, name: str) -> None:
    """Keep the names, sizes and hashes of what the scene cache holds after a load."""
    chapter = name.removeprefix("caches-")
    folder.mkdir(parents=True)
    done = python(
        checkout, cache, "-m", "chapters", "run", chapter, "--scene", "atrium", "--out", str(cache / "a.png")
    )
    if done.returncode:
        raise SystemExit(f"{name}: {done.stderr[-3000:]}")
    kept = {}
    for path in sorted((cache / "scene-cache").rglob("*")):
        if path.is_file():
            kept[path.suffix] = {
                "bytes": path.stat().st_size,
                "hash": hashlib.sha256(path.read_bytes()).hexdigest(),
            }
    (folder / "found.json").write_text(json.dumps(kept, indent=1, sort_keys=True))


def commands(checkout: Path, folder: Path, cache: Path, name: str) -> None:
    """Keep what commands print, without the paths of this machine and times."""
    folder.mkdir(parents=True)
    found = {}
    for command in COMMANDS:
        done = python(checkout, cache, "-m", "chapters", *command.split())
        text = (done.stdout + "\n--- stderr ---\n" + done.stderr).replace(str(checkout), "CLONE")
        text = re.sub(r"\d+(\.\d+)? ?(ms|s)\b", "TIME", text.replace(str(cache), "CACHE"))
        found[command] = {"code": done.returncode, "text": text.splitlines()}
    (folder / "found.json").write_text(json.dumps(found, indent=1))


Part = Callable[[Path, Path, Path, str], None]


def parts() -> dict[str, Part]:
    """Return all parts of a record by name."""
    made: dict[str, Part] = {f"frames-{n}-{variant}": frames for n in CHAPTERS for variant in VARIANTS}
    made |= {f"caches-{number}": caches for number in CHAPTERS if number >= 3}
    return made | {"commands": commands}


def record(checkout: Path, folder: Path, names: list[str]) -> None:
    """Make the parts of a record that are not there yet, two at once."""

    shared = folder / "cache"
    shared.mkdir(parents=True, exist_ok=True)

    def one(item: tuple[str, Part]) -> None:
        name, make = item
        if (folder / name / "found.json").is_file() or (names and not name.startswith(tuple(names))):
            return
        shutil.rmtree(folder / name, ignore_errors=True)
        with tempfile.TemporaryDirectory() as empty:
            make(checkout, folder / name, Path(empty) if make is caches else shared, name)
        print(name, flush=True)

    with ThreadPoolExecutor(int(os.environ.get("JOBS", "2"))) as pool:
        list(pool.map(one, parts().items()))


def differences(old: object, new: object, place: str = "") -> list[str]:
    """Return where two values of JSON differ."""
    if isinstance(old, dict) and isinstance(new, dict):
        keys = [*old, *(key for key in new if key not in old)]
        return [
            line
            for key in keys
            for line in (
                differences(old[key], new[key], f"{place}/{key}")
                if key in old and key in new
                else [f"{place}/{key}: only in the {'old' if key in old else 'new'}"]
            )
        ]
    if isinstance(old, list) and isinstance(new, list) and len(old) == len(new):
        return [
            line
            for i, (a, b) in enumerate(zip(old, new, strict=True))
            for line in differences(a, b, f"{place}[{i}]")
        ]
    return [] if old == new else [f"{place}: {old!r} -> {new!r}"]


def compare(old: Path, new: Path) -> int:
    """Print how two records differ; return 1 if they do."""
    names = sorted({path.parent.name for side in (old, new) for path in side.glob("*/found.json")})
    count = 0
    for name in names:
        sides = [side / name / "found.json" for side in (old, new)]
        missing = [str(path) for path in sides if not path.is_file()]
        found = [f"there is no {path}" for path in missing] or differences(
            *(json.loads(path.read_text()) for path in sides)
        )
        count += len(found)
        print(f"{name}: {'the same' if not found else f'{len(found)} differences'}")
        for line in found[:400]:
            print(f"  {line}")
    return 1 if count else 0


if __name__ == "__main__":
    if sys.argv[1:2] == ["record"] and len(sys.argv) >= 4:
        record(Path(sys.argv[2]).resolve(), Path(sys.argv[3]).resolve(), sys.argv[4:])
    elif sys.argv[1:2] == ["compare"] and len(sys.argv) == 4:
        sys.exit(compare(Path(sys.argv[2]), Path(sys.argv[3])))
    else:
        sys.exit(__doc__)
