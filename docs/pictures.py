"""Makes all pictures of the repository anew: `python docs/pictures.py [NAME...]`, or `--stale` for those out of date.

They are scenes drawn with chapter 1, studies, sheets of passes and views, pairs of pictures to be laid over one
another, and the plots of docs/benchmarks, which are drawn from their records. Each has at most 150 kB, and
docs/records has what it was made from.

Nearly every picture is drawn twice as wide and high and averaged down in linear light, four samples to a pixel, so
that edges are smooth without any method of a later chapter. Sheets of views and passes show values, and are left as
they are; so are pairs, which show what a chapter draws.
"""

from __future__ import annotations

import argparse
import datetime
import math
import sys
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from functools import partial
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
from common.errors import StrataError  # noqa: E402
from common.gltf import load_scene  # noqa: E402
from common.images import read_image  # noqa: E402
from common.images.color import decode_srgb, encode_srgb, quantize  # noqa: E402
from common.images.small_pictures import write_small  # noqa: E402
from common.names import suggest  # noqa: E402
from common.numerics.transforms import rotation  # noqa: E402
from common.paths import write_whole  # noqa: E402
from common.settings import preset, replaced  # noqa: E402
from tools.bench import bench, report  # noqa: E402
from tools.frames.frame import step_through  # noqa: E402
from tools.run.run import Request  # noqa: E402
from tools.site import figures, pairs  # noqa: E402
from tools.site import inputs as site_inputs  # noqa: E402
from tools.site.figures import loops  # noqa: E402

SIZE = (640, 360)
FOLDER = ROOT / "docs" / "pictures"
CHAPTER = 1

STUDY_SIZE = (240, 160)
STUDY_SIZES = {
    "linear-depth": (360, 240),
    "bias-explorer": (576, 320),
    "constant-loop": (352, 200),
    "blue-noise": (384, 384),
    "phase-functions": (560, 315),
    "far-march": (480, 270),
    "hdr-swapchain": (560, 320),
}
"""Of studies whose pictures are tables."""
STUDY_TIMES = {
    "rotating-cube": 0.4,
    "textured-mesh": 6.0,
    "one-light": 0.9,
    "phong": 0.9,
    "flipbook": 2.2,
    "buffer-address": 2.6,
    "torus-knot": 0.0,
}
"""Seconds at which a study shows what it is about; 1 for the others."""
STUDIES_OF_PIXELS = {
    "dithered-alpha",
    "random-textures",
    "fragment-order",
    "dispatch-size",
    "bias-explorer",
    "blue-noise",
    "hdr-swapchain",
}
"""Those about single pixels, which are not to be averaged."""
STUDY_SETTINGS = {
    "texture-handles": {"way": "units"},
    "dispatch-size": {"guard": False},
    "compacted-indices": {"turned": 110},
    "bias-explorer": {"turn": 45.0},
    "strategies": {"path_samples": 64},
    "roulette": {"path_samples": 64},
}
"""Settings with which every driver can draw a study's picture, or it says more."""
WITH_STUDIES = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 11, 12)
"""The chapters that have studies."""
BY_FIGURES = {"9/shading-rates", "11/dynamic-resolution", "12/wavefront"}
"""Studies that no software driver draws, or that one frame does not show: a figure or a table shows what they do."""


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
    width, height = STUDY_SIZES.get(name, STUDY_SIZE)
    size = (factor * width, factor * height)
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
            CHAPTER, "auto", scene=scene, size=cell, settings=replaced(settings, view=name)
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
    settings: Any = replaced(preset(kind, "high"), loading="stream", decoding_threads=1, upload_budget=0.0625)
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
        settings: Any = replaced(preset(chapters.settings_class(GRAPH), "medium"), aperture=aperture)
        size = (2 * cell[0], 2 * cell[1])
        with chapters.open(GRAPH, "auto", scene=scene, size=size, settings=settings) as renderer:
            view = chapters.view_of(renderer, "fountain")
            cells.append(halved(renderer.render(view).image("color")))
    return np.concatenate(cells, axis=1)


CLOTH = 5
"""The chapter whose cloths the sheet shows."""


def cloth_sheet(cell: tuple[int, int] = (336, 189), rate: int = 60) -> NDArray[Any]:
    """Return (H, W, 3): the cloths of their scene as they were modelled, and two seconds later, in a wind of 3 m/s."""
    scene, cells = load_scene(locate("cloth")), []
    settings: Any = replaced(preset(chapters.settings_class(CLOTH), "medium"), wind_speed=3.0)
    size = (2 * cell[0], 2 * cell[1])
    with chapters.open(CLOTH, "auto", scene=scene, size=size, settings=settings) as renderer:
        view = chapters.view_of(renderer)
        for number in range(2 * rate + 1):
            frame = renderer.render(view, number / rate)
            if number in (0, 2 * rate):
                cells.append(halved(frame.image("color")))
    return np.concatenate(cells, axis=1)


CULLING = 6
"""The chapter whose phases and pyramid the sheets show."""


def survivors_sheet(cell: tuple[int, int] = (240, 135), degrees: float = 40.0) -> NDArray[Any]:
    """Return (H, W, 3): a street of the city, its meshlets, and which phase drew what right after the camera turned."""
    scene, cells = load_scene(locate("city")), []
    size = (2 * cell[0], 2 * cell[1])
    for shown in ("picture", "meshlets", "survivors"):
        settings: Any = replaced(
            preset(chapters.settings_class(CULLING), "medium"), view=shown, culling="occlusion"
        )
        with chapters.open(CULLING, "auto", scene=scene, size=size, settings=settings) as renderer:
            view = chapters.view_of(renderer, "street-1")
            turn = rotation((0.0, 1.0, 0.0), math.radians(degrees))
            before = replace(view, world_from_view=view.world_from_view @ turn)
            for _ in range(2):
                renderer.render(before)
            cells.append(halved(renderer.render(view).image("color")))
    return np.concatenate(cells, axis=1)


LIGHTS = 7
"""The chapter whose light lists the sheet shows."""


def lights_sheet(cell: tuple[int, int] = (264, 148)) -> NDArray[Any]:
    """Return (H, W, 3): the market; with 400 lamps, those that reach each pixel, and those that a pixel evaluates."""
    cells = []
    for lamps, shown in ((2400, "picture"), (400, "light-count"), (400, "lights-evaluated")):
        scene = load_scene(locate(f"market:lights={lamps}"))
        settings: Any = replaced(preset(chapters.settings_class(LIGHTS), "medium"), view=shown)
        size = (2 * cell[0], 2 * cell[1])
        with chapters.open(LIGHTS, "auto", scene=scene, size=size, settings=settings) as renderer:
            cells.append(halved(renderer.render(chapters.view_of(renderer)).image("color")))
    return np.concatenate(cells, axis=1)


SHADOWS = 8
"""The chapter whose shadows the sheet shows."""


def shadows_sheet(cell: tuple[int, int] = (264, 148)) -> NDArray[Any]:
    """Return (H, W, 3): the atrium without shadows, with them, and the part of the light that arrives."""
    cells = []
    for on, shown in (("off", "picture"), ("on", "picture"), ("on", "shadow-factor")):
        settings: Any = replaced(preset(chapters.settings_class(SHADOWS), "medium"), view=shown, shadows=on)
        size = (2 * cell[0], 2 * cell[1])
        with chapters.open(
            SHADOWS, "auto", scene=load_scene(locate("atrium")), size=size, settings=settings
        ) as renderer:
            cells.append(halved(renderer.render(chapters.view_of(renderer)).image("color")))
    return np.concatenate(cells, axis=1)


RATES = 9
"""The chapter whose shading rates the sheet shows."""


def rates_sheet(cell: tuple[int, int] = (264, 148), frames: int = 40, gain: float = 8.0) -> NDArray[Any]:
    """Return (H, W, 3): the atrium at full rate, tinted by its rates, and the difference of both, `gain` times.

    It is drawn four times as wide and high, since blocks are small, and until it rests: the mask is kept then.
    """
    scene, drawn = load_scene(locate("atrium")), []
    size = (4 * cell[0], 4 * cell[1])
    for policy, tint in (("none", False), ("sobel", True), ("sobel", False)):
        settings: Any = replaced(
            preset(chapters.settings_class(RATES), "medium"),
            rate_policy=policy,
            rate_tint=tint,
        )
        with chapters.open(RATES, "auto", scene=scene, size=size, settings=settings) as renderer:
            view = chapters.view_of(renderer)
            frame = renderer.render(view)
            for _ in range(frames):
                if not renderer.idle(view):
                    frame = renderer.render(view)
            drawn.append(frame.image("color")[..., :3])
    whole, tinted, blocks = drawn
    apart = np.abs(whole.astype(np.int32) - blocks.astype(np.int32)).max(axis=-1, keepdims=True)
    grey = np.repeat(np.clip(gain * apart, 0, 255).astype(np.uint8), 3, axis=-1)
    return np.concatenate([halved(halved(one)) for one in (whole, tinted, grey)], axis=1)


FOG = 10
"""The chapter whose fog the sheet shows."""


def fog_sheet(cell: tuple[int, int] = (264, 148), frames: int = 16) -> NDArray[Any]:
    """Return (H, W, 3): the atrium without its haze, in it, and what the haze leaves of the light of surfaces."""
    cells = []
    for on, shown in ((False, "picture"), (True, "picture"), (True, "fog-transmittance")):
        settings: Any = replaced(preset(chapters.settings_class(FOG), "medium"), view=shown, fog=on)
        size = (2 * cell[0], 2 * cell[1])
        with chapters.open(
            FOG, "auto", scene=load_scene(locate("atrium:fog")), size=size, settings=settings
        ) as renderer:
            view = chapters.view_of(renderer)
            for _ in range(frames):
                frame = renderer.render(view)
            cells.append(halved(frame.image("color")))
    return np.concatenate(cells, axis=1)


TAA = 11
"""The chapter whose edges the sheet shows."""


def edges_sheet(
    size: tuple[int, int] = (480, 270), at: tuple[int, int] = (190, 62), cell: tuple[int, int] = (88, 50)
) -> NDArray[Any]:
    """Return (H, W, 3): a part of the atrium, three times as large: one sample a pixel, FXAA, and a history at rest."""
    scene, cells = load_scene(locate("atrium")), []
    for taa, fxaa in (("off", False), ("off", True), ("full", False)):
        settings: Any = replaced(preset(chapters.settings_class(TAA), "medium"), taa=taa, fxaa=fxaa)
        with chapters.open(TAA, "auto", scene=scene, size=size, settings=settings) as renderer:
            view = chapters.view_of(renderer)
            frame = renderer.render(view)
            while not renderer.idle(view):
                frame = renderer.render(view)
            shown = frame.image("color")[at[1] : at[1] + cell[1], at[0] : at[0] + cell[0], :3]
        cells.append(shown.repeat(3, axis=0).repeat(3, axis=1))
    return np.concatenate(cells, axis=1)


RAYS = 12
"""The chapter whose rays the sheets show."""


def rays_sheet(cell: tuple[int, int] = (396, 222)) -> NDArray[Any]:
    """Return (H, W, 3): the atrium rasterised, and traced by rays."""
    return np.concatenate([_traced(cell, rays=shown) for shown in ("off", "whole")], axis=1)


def ray_views_sheet(cell: tuple[int, int] = (330, 186)) -> NDArray[Any]:
    """Return (H, W, 3): the atrium by distance, instance, barycentric coordinates, and steps of the traversal."""
    shown = [
        _traced(cell, rays="whole", ray_view=name)
        for name in ("distance", "instance", "barycentrics", "steps")
    ]
    return np.concatenate([np.concatenate(row, axis=1) for row in (shown[:2], shown[2:])])


def paths_sheet(cell: tuple[int, int] = (220, 220), paths: int = 160) -> NDArray[Any]:
    """Return (H, W, 3): a box rasterised, traced by rays, and traced by paths, which average a pixel by themselves."""
    cells, medium = [], preset(chapters.settings_class(RAYS), "medium")
    scene = load_scene(locate("cornell"))
    for factor, frames, turned in (
        (2, 4, {"rays": "off"}),
        (2, 4, {"rays": "whole"}),
        (1, paths // 16, {"path_tracer": True, "path_samples": 16}),
    ):
        size = (factor * cell[0], factor * cell[1])
        with chapters.open(
            RAYS, "auto", scene=scene, size=size, settings=replaced(medium, **turned)
        ) as renderer:
            view = chapters.view_of(renderer)
            for _ in range(frames):
                frame = renderer.render(view)
            codes = frame.image("color")
            cells.append(halved(codes) if factor == 2 else codes[..., :3])
    return np.concatenate(cells, axis=1)


def _traced(cell: tuple[int, int], **turned: Any) -> NDArray[Any]:
    settings: Any = replaced(preset(chapters.settings_class(RAYS), "medium"), **turned)
    size = (2 * cell[0], 2 * cell[1])
    with chapters.open(
        RAYS, "auto", scene=load_scene(locate("atrium")), size=size, settings=settings
    ) as renderer:
        view = chapters.view_of(renderer)
        for _ in range(4):  # pages of shadow maps come with the second frame
            frame = renderer.render(view)
        return halved(frame.image("color"))


def pyramid_sheet(cell: tuple[int, int] = (330, 186), shown: Sequence[int] = (0, 3, 5)) -> NDArray[Any]:
    """Return (H, W, 3): a street, and levels of its depth pyramid, each texel over the pixels below it."""
    settings: Any = preset(chapters.settings_class(CULLING), "medium")
    with chapters.open(
        CULLING,
        "auto",
        scene=load_scene(locate("city")),
        size=cell,
        settings=settings,
        outputs={"color", "depth"},
    ) as renderer:
        frame = renderer.render(chapters.view_of(renderer, "street-5"))
        depth = frame.image("depth")
        cells = [frame.image("color")[..., :3]]
    for level in shown:
        side = 2**level
        height, width = (-(-edge // side) for edge in depth.shape)
        padded = np.full((height * side, width * side), np.inf, np.float32)
        padded[: depth.shape[0], : depth.shape[1]] = depth
        farthest = padded.reshape(height, side, width, side).min(axis=(1, 3))
        wide = farthest.repeat(side, axis=0).repeat(side, axis=1)[: depth.shape[0], : depth.shape[1]]
        # Depth is near / distance: its logarithm goes from white at 3 m to black at 300 m and in the sky.
        grey = 1 + np.log10(np.maximum(wide, 1e-9) / depth.max()) / 2
        cells.append(np.repeat(quantize(np.clip(grey, 0, 1))[..., None], 3, axis=-1))
    rows = [np.concatenate(cells[first : first + 2], axis=1) for first in range(0, len(cells), 2)]
    return np.concatenate(rows)


SHEETS = {
    "views": sheet_of_views,
    "frame": frame_sheet,
    "ch03-loading": loading_sheet,
    "ch04-gbuffer": gbuffer_sheet,
    "ch04-lens": lens_sheet,
    "ch05-cloth": cloth_sheet,
    "ch06-survivors": survivors_sheet,
    "ch06-pyramid-levels": pyramid_sheet,
    "ch07-market": lights_sheet,
    "ch08-atrium": shadows_sheet,
    "ch09-atrium": rates_sheet,
    "ch10-atrium": fog_sheet,
    "ch11-atrium": edges_sheet,
    "ch12-atrium": rays_sheet,
    "ch12-views": ray_views_sheet,
    "ch12-cornell": paths_sheet,
}


COVERS: dict[str, int] = {
    "views": CHAPTER,
    "frame": CHAPTER,
    "ch03-loading": LOADING,
    "ch06-survivors": CULLING,
    "ch06-pyramid-levels": CULLING,
    "ch07-market": LIGHTS,
    "ch08-atrium": SHADOWS,
    "ch09-atrium": RATES,
    "ch10-atrium": FOG,
    "ch11-atrium": TAA,
    "ch12-atrium": RAYS,
    "ch12-views": RAYS,
    "ch12-cornell": RAYS,
}
"""The chapter that draws a sheet; GRAPH for the others."""


def picture_of(name: str) -> NDArray[Any]:
    """Return the picture (H, W, 3) of a scene, a study or a sheet."""
    if name in SHEETS:
        return SHEETS[name]()
    return draw_study(name) if "/" in name else draw(name)


def inputs_of(name: str) -> list[Path]:
    """Return the files that a picture of `picture_of` is made from."""
    if name in SHEETS:
        scene = (
            "cornell"
            if name in ("frame", "ch12-cornell")
            else "city"
            if name.startswith("ch06")
            else "atrium"
        )
        scene = "market" if name.startswith("ch07") else scene
        return [*site_inputs.chapter(COVERS.get(name, GRAPH)), *site_inputs.scene(scene)]
    if "/" in name:
        return site_inputs.study(*studies.split(name))
    return [*site_inputs.chapter(CHAPTER), *site_inputs.scene(name)]


@dataclass(frozen=True)
class Made:
    """Pictures that are made together: what each is made from, and what makes them."""

    inputs: dict[Path, list[Path]]
    """Of each file."""
    make: Callable[[Path], object]
    """Takes the folder for pictures, and writes into it; a plot and a pair have one of their own."""


def everything() -> dict[str, Made]:
    """Return all that there is to make, by name."""

    def drawn(name: str) -> Made:
        file = FOLDER / f"{file_of(name)}.png"
        return Made({file: inputs_of(name)}, lambda to: write_small(to / file.name, picture_of(name)))

    all_studies = [f"{number}/{name}" for number in WITH_STUDIES for name in studies.available(number)]
    all_studies = [name for name in all_studies if name not in BY_FIGURES]
    found = {name: drawn(name) for name in (*SCENES, *all_studies, *SHEETS)}
    for name, figure in figures.figures().items():
        found[name] = Made(
            {FOLDER / f"{name}.svg": figures.inputs_of(name)}, partial(_make_figure, name, figure)
        )
    for file, (make, made_from) in loops.files().items():
        found[file.partition(".")[0]] = Made({FOLDER / file: made_from}, partial(_make_loop, file, make))
    for number in chapters.available():
        for pair in pairs.pairs_of(number):
            found[f"pairs/{pair.name}"] = Made(pairs.inputs_of(pair), partial(_make_pair, pair))
    for record in sorted(bench.FOLDER.glob("ch[0-9][0-9]-*.json")):
        plot = record.with_suffix(".png")
        if plot.is_file():
            found[f"plots/{record.stem}"] = Made({plot: [record]}, partial(_make_plot, plot, record))
    return found


def _make_figure(name: str, figure: Callable[[], figures.Canvas], to: Path) -> None:
    write_whole(to / f"{name}.svg", figure().svg().encode())


def _make_loop(file: str, make: Callable[[], bytes], to: Path) -> None:
    write_whole(to / file, make())


def _make_pair(pair: pairs.Pair, _: Path) -> None:
    pairs.make(pair)


def _make_plot(plot: Path, record: Path, _: Path) -> None:
    report.plot(plot, bench.read_record(record))


def wanted() -> dict[str, str]:
    """Return the hash of the inputs of every picture, by its path from the clone's root."""
    return {
        file.relative_to(ROOT).as_posix(): site_inputs.digest(inputs)
        for made in everything().values()
        for file, inputs in made.inputs.items()
    }


def main(arguments: Sequence[str] | None = None) -> int:
    """Make the pictures named, or all, and say how large each file is; return the exit code."""
    parser = argparse.ArgumentParser(description=__doc__)
    known = everything()
    parser.add_argument("names", metavar="NAME", nargs="*", help=f"one of {', '.join(known)}; default all")
    parser.add_argument("--out", type=Path, default=FOLDER, help="folder to write to (default docs/pictures)")
    parser.add_argument("--stale", action="store_true", help="only those whose inputs have changed")
    chosen = parser.parse_args(arguments)
    if unknown := [name for name in chosen.names if name not in known]:
        print(f"There is no picture {unknown[0]!r}{suggest(unknown[0], known)}", file=sys.stderr)
        return 2
    names = chosen.names or [*known]
    if chosen.stale:
        old = {ROOT / name for name in site_inputs.stale(wanted(), site_inputs.read())}
        names = [name for name in names if old & {*known[name].inputs}]
    failed = 0
    for name in names:
        try:
            chosen.out.mkdir(parents=True, exist_ok=True)
            known[name].make(chosen.out)
        except StrataError as error:
            print(f"{name}: {error}", file=sys.stderr)
            failed = 2
            continue
        files = [chosen.out / file.name if file.parent == FOLDER else file for file in known[name].inputs]
        print("\n".join(f"{file}  {file.stat().st_size / 1e3:.0f} kB" for file in files))
        if chosen.out == FOLDER:
            _keep(name, known[name])
    return failed


def _keep(name: str, made: Made) -> None:
    """Write down what pictures were made from, as soon as they are there."""
    head = {
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
        "commit": bench.commit(),
    }
    entries = {
        file.relative_to(ROOT).as_posix(): {
            "made_by": name,
            **site_inputs.entry(file, site_inputs.digest(inputs), head),
        }
        for file, inputs in made.inputs.items()
    }
    there = {path: one for path, one in site_inputs.read().items() if (ROOT / path).is_file()}
    site_inputs.write({**there, **entries})


if __name__ == "__main__":
    sys.exit(main())
