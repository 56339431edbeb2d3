"""Pictures to lay over one another on a chapter's page, with the map of their difference: drawn once and recorded.

docs/records/pairs.json   what differs in each pair, by how much, and on which device
docs/pictures/pairs/      the sides, and the maps
"""

from __future__ import annotations

import datetime
import json
import posixpath
import re
from contextlib import ExitStack
from dataclasses import asdict, dataclass
from functools import partial
from html import escape
from pathlib import Path
from typing import Any

import numpy as np

from assets import locate
from common.gltf import load_scene
from common.images.color import quantize
from common.images.small_pictures import write_small
from common.paths import ROOT, write_whole
from tools.bench.bench import commit
from tools.compare import report
from tools.compare.measure import ErrorMap, Errors, Measured, Moment, Stand, errors
from tools.compare.sheet import heat
from tools.compare.sides import Drawn, read_side
from tools.run.run import open_device
from tools.site import inputs
from tools.site.draft import Draft

SIZE = (480, 270)
SCENE = "atrium"
QUALITY = "medium"
EXTRA = {1: (("1@vulkan:msaa=4", "1@vulkan:msaa=1"),), 4: (("4@vulkan", "4@vulkan:aperture=0.3"),)}
"""Pairs that show what a chapter is about, beside those that every chapter has."""
RECORD = ROOT / "docs" / "records" / "pairs.json"
FOLDER = ROOT / "docs" / "pictures" / "pairs"


@dataclass(frozen=True)
class Pair:
    """Two sides as `strata compare` reads them; `chapter` is the one on whose page they stand."""

    chapter: int
    a: str
    b: str

    @property
    def name(self) -> str:
        """How its map is called."""
        return f"{file_of(self.a)}--{file_of(self.b)}"

    @property
    def chapters(self) -> tuple[int, int]:
        """Whose code draws A, and B."""
        return int(self.a.partition("@")[0]), int(self.b.partition("@")[0])


def pairs_of(number: int) -> list[Pair]:
    """Return the pairs of a chapter: with the one before it, of the two backends, of its cheapest and truest preset,
    and its own."""
    here = f"{number}@vulkan"
    before = [Pair(number, f"{number - 1}@vulkan", here)] if number > 1 else []
    own = [Pair(number, *sides) for sides in EXTRA.get(number, ())]
    return [
        *before,
        Pair(number, here, f"{number}@gl"),
        Pair(number, f"{here}:reference", f"{here}:low"),
        *own,
    ]


def file_of(side: str) -> str:
    """Return the name, without suffix, of the picture of a side: "4@vulkan:low" is "ch04-vulkan-low"."""
    number, _, rest = side.partition("@")
    return f"ch{int(number):02d}-{re.sub('[:=.]', '-', rest)}"


def files_of(pair: Pair) -> list[Path]:
    """Return the pictures of a pair: A, B and the map."""
    return [FOLDER / f"{name}.png" for name in (file_of(pair.a), file_of(pair.b), pair.name)]


def inputs_of(pair: Pair) -> dict[Path, list[Path]]:
    """Return what each picture of a pair is made from: a side by its own chapter, which other pairs show too."""
    scene = inputs.scene(SCENE)
    a, b = ([*inputs.chapter(number), *scene] for number in pair.chapters)
    return dict(zip(files_of(pair), (a, b, [*a, *b]), strict=True))


def draw(pair: Pair) -> tuple[dict[Path, Any], dict[str, Any]]:
    """Return the pictures of a pair, (H, W, 3) uint8 by file, and its record. Raises StrataError."""
    scene = load_scene(locate(SCENE))
    sides, found = [read_side(text, QUALITY) for text in (pair.a, pair.b)], []
    with ExitStack() as stack:
        for side in sides:
            assert isinstance(side, Drawn)
            device = open_device(stack, side.backend)
            stand = Stand(
                side,
                stack.enter_context(
                    side.module.Renderer(
                        scene, SIZE, settings=side.settings, outputs=set(side.outputs), device=device
                    )
                ),
                Moment(),
            )
            measured = stand.picture()
            measured.capabilities, measured.plan = stand.renderer.capabilities, stand.renderer.plan
            found.append(measured)
        known, error_map, shown = errors(found[0], found[1], 1.0)
    files = files_of(pair)
    pictures = {path: quantize(pixels) for path, pixels in zip(files, shown, strict=False)}
    pictures[files[2]] = heat(error_map.values, error_map.limit)
    return pictures, _record(pair, found, known, error_map)


def _record(pair: Pair, found: list[Measured], known: Errors, error_map: ErrorMap) -> dict[str, Any]:
    a, b = found
    return {
        "chapter": pair.chapter,
        "a": {"side": pair.a, "what": _what(a.side), "file": file_of(pair.a)},
        "b": {"side": pair.b, "what": _what(b.side), "file": file_of(pair.b)},
        "map": {
            "file": pair.name,
            "what": report.map_text(error_map),
            "limit": error_map.limit,
            "more": error_map.more,
        },
        "differs": report.differences(a, b),
        "verdict": report.verdict(known),
        "error": {
            name: asdict(known)[name] for name in ("relative_mse", "max_abs", "flip", "pixels_changed")
        },
        "scene": SCENE,
        "size": list(SIZE),
        "device": f"{a.capabilities.device}, {a.capabilities.driver}",
        "commit": commit(),
        "date": datetime.datetime.now(datetime.UTC).isoformat(timespec="seconds"),
    }


def _what(side: Any) -> str:
    """Return what a side is, with the settings that it names: "Chapter 1 on Vulkan, medium, msaa=4"."""
    named = [part for part in side.text.partition(":")[2].split(",") if "=" in part]
    return ", ".join([report.capital(report.described(side)), *named])


def read() -> dict[str, dict[str, Any]]:
    """Return the records of pairs by name; {} without a file of them."""
    try:
        found: dict[str, dict[str, Any]] = json.loads(RECORD.read_text("utf-8"))["pairs"]
    except (OSError, ValueError, KeyError, TypeError, RecursionError):
        return {}
    return found if isinstance(found, dict) else {}


def make(pair: Pair) -> list[Path]:
    """Draw a pair, write its pictures and its record, and return the files. Raises StrataError."""
    pictures, record = draw(pair)
    FOLDER.mkdir(parents=True, exist_ok=True)
    for path, pixels in pictures.items():
        write_small(path, pixels)
    known = {**read(), pair.name: record}
    write_whole(RECORD, (json.dumps({"pairs": dict(sorted(known.items()))}, indent=1) + "\n").encode())
    return list(pictures)


def overlays(draft: Draft, number: int, page: str) -> str:
    """Return the figures of a chapter's pairs, of which a script shows one at a time; notes what is missing."""
    known, figures = read(), []
    for pair in pairs_of(number):
        record = known.get(pair.name)
        files = files_of(pair)
        if record is None or not all(file.is_file() for file in files):
            command = f"python docs/pictures.py pairs/{pair.name}"
            draft.lack(page, f"{pair.a} over {pair.b}, which nobody has drawn: `{command}` does it.")
            continue
        places = [f"pictures/pairs/{file.name}" for file in files]
        for place, file in zip(places, files, strict=True):
            draft.files[place] = file.read_bytes()
        links = [posixpath.relpath(place, posixpath.dirname(page)) for place in places]
        figures.append(draft.attempt(page, f"{pair.a} over {pair.b}", partial(_figure, record, links)))
    return f'<div class="overlays">{"".join(figures)}</div>' if figures else ""


def _figure(record: dict[str, Any], links: list[str]) -> str:
    a, b, of_map = record["a"], record["b"], record["map"]
    width, height = record["size"]
    size = f'width="{width}" height="{height}"'
    title = f"{a['what']}, and {b['what'][:1].lower()}{b['what'][1:]}"
    error = record["error"]
    flip = "" if error["flip"] is None else f' data-flip="{error["flip"]}"'
    picture = f"{record['scene']} by {{}}"
    return (
        f'<figure class="overlay" data-title="{escape(title)}" data-changed="{error["pixels_changed"]}"{flip}>'
        f'<div class="sides"><div><div class="pair">'
        f'<img src="{links[0]}" alt="{escape(_alt(picture, a))}" {size} loading="lazy">'
        f'<img class="over" src="{links[1]}" alt="{escape(_alt(picture, b))}" {size} loading="lazy"></div>'
        f'<label class="handle">Left {escape(a["side"])}, right {escape(b["side"])}'
        f'<input type="range" min="0" max="100" value="50" aria-label="Where {escape(b["what"])} begins, percent">'
        f'</label></div><div><img class="map" src="{links[2]}" alt="{escape(_map_alt(record))}" {size} loading="lazy">'
        f"{_scale(of_map)}</div></div>"
        f"<figcaption>{escape(title)}. {escape(record['differs'])} {escape(record['verdict'])} "
        f"The map: {escape(of_map['what'])}. {escape(record['device'])}, {escape(record['date'][:10])}."
        "</figcaption></figure>"
    )


def _alt(picture: str, side: dict[str, str]) -> str:
    return f"The {picture.format(side['what'][:1].lower() + side['what'][1:])}"


def _map_alt(record: dict[str, Any]) -> str:
    return f"Error map of {record['b']['side']} against {record['a']['side']}: {record['verdict']}"


def _scale(of_map: dict[str, Any]) -> str:
    """Return the colours of the map from 0 to its limit, taken from the function that draws it."""
    ramp = heat(np.linspace(0.0, 1.0, 9, dtype=np.float32)[None, :], 1.0)[0]
    colors = ", ".join(f"rgb({r} {g} {b})" for r, g, b in ramp.tolist())
    more = " and more" if of_map["more"] else ""
    return (
        f'<div class="scale"><span>0</span><span class="ramp" style="background: linear-gradient(90deg, {colors})">'
        f"</span><span>{of_map['limit']:.3g}{more}</span></div>"
    )
