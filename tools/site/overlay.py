"""Two pictures over one another with a handle between them, and beside them the map of their difference: HTML."""

from __future__ import annotations

import posixpath
from functools import partial
from html import escape
from typing import Any

import numpy as np

from tools.compare.sheet import heat
from tools.site import pairs
from tools.site.draft import Draft


def overlays(draft: Draft, number: int, page: str) -> str:
    """Return the figures of a chapter's pairs, of which a script shows one at a time; notes what is missing."""
    known, figures = pairs.read(), []
    for pair in pairs.pairs_of(number):
        record = known.get(pair.name)
        files = pairs.files_of(pair)
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
