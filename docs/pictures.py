"""Makes docs/pictures anew: `python docs/pictures.py [NAME...]` draws scenes with chapter 1, all studies, and loading.

Nearly every picture is drawn twice as wide and high and averaged down in linear light, four samples to a pixel, so
that edges are smooth without any method of a later chapter. Sheets of views and passes show values, and are left as
they are.
"""

from __future__ import annotations

import argparse
import sys
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np
from numpy.typing import NDArray

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT))  # so that it runs from any folder, installed or not

import chapters  # noqa: E402
from assets import SCENES, locate  # noqa: E402
from chapters import studies  # noqa: E402
from chapters.frame import step_through  # noqa: E402
from chapters.run import Request  # noqa: E402
from common.color import decode_srgb, encode_srgb, quantize  # noqa: E402
from common.errors import StrataError  # noqa: E402
from common.gltf import load_scene  # noqa: E402
from common.images import read_image, write_image  # noqa: E402
from common.settings import preset  # noqa: E402

SIZE = (640, 360)
FOLDER = ROOT / "docs" / "pictures"
CHAPTER = 1

STUDY_SIZE = (240, 160)
STUDY_TIMES = {
    "rotating-cube": 0.4,
    "textured-mesh": 6.0,
    "one-light": 0.9,
    "phong": 0.9,
    "flipbook": 2.2,
    "buffer-address": 2.6,
}
"""Seconds at which a study shows what it is about; 1 for the others."""
STUDIES_OF_PIXELS = {"dithered-alpha", "random-textures"}
"""Those about single pixels, which are not to be averaged."""
STUDY_SETTINGS = {"texture-handles": {"way": "units"}}
"""Settings with which every driver can draw a study's picture."""
WITH_STUDIES = (1, 2, 3, 4)
"""The chapters that have studies."""


def halved(codes: NDArray[np.uint8]) -> NDArray[Any]:
    """Return (H/2, W/2, 3) sRGB codes: each the mean of the light of four of `codes` (H, W, 3 or 4)."""
    light = decode_srgb(codes[..., :3] / 255.0)
    height, width = light.shape[:2]
    mean = light.reshape(height // 2, 2, width // 2, 2, 3).mean(axis=(1, 3))
    return quantize(encode_srgb(mean))


def draw(name: str, camera: str | None = None, size: tuple[int, int] = SIZE) -> NDArray[Any]:
    """Return the picture (H, W, 3) of a scene as its first camera sees it, or the one named."""
    settings: Any = preset(chapters.settings_class(CHAPTER), "high")
    twice = (2 * size[0], 2 * size[1])
    scene = load_scene(locate(name))
    with chapters.open(
        CHAPTER, "auto", scene=scene, size=twice, settings=settings, outputs={"color"}
    ) as renderer:
        return halved(renderer.render(chapters.view_of(renderer, camera, 0.0)).image("color"))


def draw_study(which: str) -> NDArray[Any]:
    """Return the picture (H, W, 3) of a study, "1/first-triangle"."""
    name = studies.split(which)[1]
    factor = 1 if name in STUDIES_OF_PIXELS else 2
    size = (factor * STUDY_SIZE[0], factor * STUDY_SIZE[1])
    settings = chapters.settings_class(which)(**STUDY_SETTINGS.get(name, {}))
    scene = studies.load(which, None)
    with chapters.open(which, "auto", scene=scene, size=size, settings=settings) as renderer:
        picture = renderer.render(chapters.view_of(renderer), STUDY_TIMES.get(name, 1.0)).image("color")
        return halved(picture) if factor == 2 else picture[..., :3]


def file_of(name: str) -> str:
    """Return the file's name, without suffix, for a scene or a study."""
    return chapters.file_name(name) if "/" in name else name.replace(":", "-")


VIEWED = ("base-color", "normal", "roughness", "mip-level", "overdraw", "light-count")
"""The views of the sheet; `strata list 1 --views` has all of them."""


def sheet_of_views(cell: tuple[int, int] = (240, 135)) -> NDArray[Any]:
    """Return (H, W, 3): views of the atrium, three in a row, each drawn at the size of its cell."""
    settings: Any = preset(chapters.settings_class(CHAPTER), "high")
    scene = load_scene(locate("atrium"))
    cells = []
    for name in VIEWED:
        with chapters.open(
            CHAPTER, "auto", scene=scene, size=cell, settings=replace(settings, view=name)
        ) as renderer:
            cells.append(renderer.render(chapters.view_of(renderer)).image("color"))
    rows = [np.concatenate(cells[first : first + 3], axis=1) for first in range(0, len(cells), 3)]
    return np.concatenate(rows)


def frame_sheet() -> NDArray[Any]:
    """Return the contact sheet of `strata frame 1 --scene cornell` with four samples a pixel."""
    request = Request(CHAPTER, scene="cornell", size=(640, 360), headless=True, overrides=("msaa=4",))
    with TemporaryDirectory() as folder:
        step_through(request, folder=Path(folder))
        return read_image(Path(folder) / "contact.png")


LOADING = 3
"""The first chapter that draws while it loads."""


def loading_sheet(cell: tuple[int, int] = (264, 198), share: float = 0.35) -> NDArray[Any]:
    """Return (H, W, 3): the atrium when `share` of its textures have arrived, and beside it when all have."""
    kind = chapters.settings_class(LOADING)
    settings: Any = replace(preset(kind, "high"), loading="stream", decoding_threads=1, upload_budget=0.0625)
    twice = (2 * cell[0], 2 * cell[1])
    with chapters.open(
        LOADING, "auto", scene=load_scene(locate("atrium"), decode=False), size=twice, settings=settings
    ) as renderer:
        view = chapters.view_of(renderer)
        while True:
            frame = renderer.render(view)
            picture = frame.image("color")
            work = frame.work
            if work["textures_resident"] >= share * (work["textures_resident"] + work["textures_waiting"]):
                break
        opened: Any = renderer
        opened.wait_loaded()
        whole = renderer.render(view).image("color")
    return np.concatenate([halved(picture), halved(whole)], axis=1)


GRAPH = 4
"""The first chapter whose frame is a graph, with a G-buffer and a lens in it."""

SURFACE = ("base_color", "normal", "material", "emissive")
"""The targets of the G-buffer, as the sheet shows them; depth is beside them, and then the light."""


def gbuffer_sheet(cell: tuple[int, int] = (224, 126)) -> NDArray[Any]:
    """Return (H, W, 3): the G-buffer of the atrium, target by target, its depth, and what lighting makes of it."""
    request = Request(GRAPH, scene="atrium", size=(2 * cell[0], 2 * cell[1]), headless=True)
    shown = [f"gbuffer-gbuffer_{name}" for name in SURFACE] + ["gbuffer-depth", "tonemap-color"]
    with TemporaryDirectory() as folder:
        step_through(request, folder=Path(folder))
        files = [next(Path(folder).glob(f"*{name}.png")) for name in shown]
        cells = [halved(read_image(file)) for file in files]
    rows = [np.concatenate(cells[first : first + 3], axis=1) for first in range(0, len(cells), 3)]
    return np.concatenate(rows)


def lens_sheet(cell: tuple[int, int] = (320, 180)) -> NDArray[Any]:
    """Return (H, W, 3): the atrium's fountain through a pinhole, and through a lens of f/0.5 focused on its middle.

    No shop has such a lens; in so small a picture a usual one would blur by a pixel.
    """
    scene, cells = load_scene(locate("atrium")), []
    for aperture in (0.0, 0.5):
        settings: Any = replace(preset(chapters.settings_class(GRAPH), "medium"), aperture=aperture)
        size = (2 * cell[0], 2 * cell[1])
        with chapters.open(GRAPH, "auto", scene=scene, size=size, settings=settings) as renderer:
            view = chapters.view_of(renderer, "fountain")
            cells.append(halved(renderer.render(view).image("color")))
    return np.concatenate(cells, axis=1)


SHEETS = {
    "views": sheet_of_views,
    "frame": frame_sheet,
    "ch03-loading": loading_sheet,
    "ch04-gbuffer": gbuffer_sheet,
    "ch04-lens": lens_sheet,
}


def picture_of(name: str) -> NDArray[Any]:
    """Return the picture (H, W, 3) of a scene, a study or a sheet."""
    if name in SHEETS:
        return SHEETS[name]()
    return draw_study(name) if "/" in name else draw(name)


def main(arguments: Sequence[str] | None = None) -> int:
    """Draw the scenes and studies named, or all, and say how large each file is; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    all_studies = [f"{number}/{name}" for number in WITH_STUDIES for name in studies.available(number)]
    all_names = [*SCENES, *all_studies, *SHEETS]
    parser.add_argument(
        "names", metavar="NAME", nargs="*", help=f"one of {', '.join(all_names)}; default all"
    )
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder to write to (default docs/pictures)")
    chosen = parser.parse_args(arguments)
    try:
        names = chosen.names or all_names
        pictures = {file_of(name): picture_of(name) for name in names}
        chosen.out.mkdir(parents=True, exist_ok=True)
        for name, picture in pictures.items():
            path = chosen.out / f"{name}.png"
            write_image(path, picture)
            print(f"{path}  {path.stat().st_size / 1e3:.0f} kB")
    except StrataError as error:
        print(error, file=sys.stderr)
        return 2
    return 0


if __name__ == "__main__":
    sys.exit(main())
