"""The figures of the lessons: drawings of ideas, made by code, from the chapters' own data where there is any.

    canvas    boxes, arrows and words in SVG, in the colours of the reader's scheme
    graphs    compiled frames of chapters 4 and 5
    ch01 ...  the figures of a chapter, `FIGURES` by name; from chapter 7 on a folder
    culling   streets from above, and the loops of chapter 6
    charts    curves over two axes, and bars
    measured  charts of what was measured, from the records

`python docs/pictures.py` writes them to docs/pictures.
"""

from __future__ import annotations

from collections.abc import Callable
from importlib import import_module
from pathlib import Path

import chapters
from tools.site import inputs
from tools.site.figures import measured
from tools.site.figures.canvas import Canvas

HERE = Path(__file__).parent
DATA = {"ch04": (4,), "ch05": (5,)}
"""The chapters whose data a module's figures show."""
PARTS = {
    "ch06": (6, ("meshlets/*.py", "culling/pyramid.py")),
    "ch07-bins": (7, ("clusters/model.py",)),
    "ch07-tiles": (7, ("clusters/model.py",)),
    "ch08-faces": (8, ("shadows/faces.py",)),
    "ch08-cascades": (8, ("shadows/cascades.py",)),
    "ch08-pages": (8, ("page_table/pool.py",)),
    "ch08-need": (8, ("page_table/rule.py", "page_table/lamps.py")),
    "ch08-casters": (8, ("shadows/faces.py",)),
    "ch09-codes": (9, ("rates/model.py",)),
    "ch09-mask": (9, ("rates/model.py",)),
    "ch11-jitter": (11, ("taa/jitter.py",)),
    "ch11-rest": (11, ("taa/jitter.py", "taa/model.py")),
    "ch12-levels": (12, ("rays/bvh/build.py", "rays/bvh/morton.py")),
    "ch12-walk": (12, ("rays/bvh/build.py",)),
    "ch12-table": (12, ("pipelines/vulkan_rays.py", "rays/groups.py")),
}
"""The same where figures show data of a few files, of all figures of a chapter or of one."""


def figures() -> dict[str, Callable[[], Canvas]]:
    """Return what draws each figure, by name."""
    found: dict[str, Callable[[], Canvas]] = {}
    for number in chapters.available():
        name = chapters.folder_name(number)
        if (HERE / f"{name}.py").is_file() or (HERE / name).is_dir():
            found |= import_module(f"{__name__}.{name}").FIGURES
        found |= {key: draw for key, draw in measured.FIGURES.items() if key.startswith(name)}
    return found


def inputs_of(name: str) -> list[Path]:
    """Return the files that a figure is made from."""
    if name in measured.FIGURES:
        return [HERE / "canvas.py", HERE / "charts.py", HERE / "measured.py", measured.path_of(name)]
    chapter = name.partition("-")[0]
    files = [HERE / "canvas.py"]
    if (HERE / chapter).is_dir():
        module = figures()[name].__module__.rpartition(".")[2]
        files.append(HERE / chapter / f"{module}.py")
    else:
        files.append(HERE / f"{chapter}.py")
    for number in DATA.get(chapter, ()):
        files += [HERE / "graphs.py", *inputs.chapter(number)]
    if name == "ch06-tests":
        files.append(HERE / "culling.py")
    for number, patterns in [PARTS[key] for key in (chapter, name) if key in PARTS]:
        folder = chapters.FOLDER / chapters.folder_name(number)
        files += sorted(path for pattern in patterns for path in folder.glob(pattern))
    if chapter == "ch04":
        files += inputs.study(4, "glow")
    return files
