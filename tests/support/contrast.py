"""What of a page in the browser has too little contrast, in words; see contrast.js beside this file."""

from __future__ import annotations

import json
from dataclasses import dataclass
from pathlib import Path

from tests.support.browser import Page

MARKS = (
    (".plot .preset circle", "fill", "fillOpacity"),
    (".plot .knob path", "stroke", "strokeOpacity"),
    (".plot .front", "stroke", "strokeOpacity"),
    (".plot .noise", "stroke", "strokeOpacity"),
    (".overlay .ramp", "borderTopColor", ""),
    (".overlays select", "borderTopColor", ""),
    (".search-features input", "borderTopColor", ""),
    (".overlay input[type=range]", "accentColor", ""),
    (".md-typeset .lack", "borderLeftColor", ""),
)
"""What says something without letters: a selector, the property that colours it, and the one that lets through."""

STATES = (
    ("--md-accent-fg-color", "--md-default-bg-color"),
    ("--md-accent-fg-color", "--md-code-bg-color"),
    ("--md-typeset-a-color", "--md-code-bg-color"),
)
"""Colours of links that are pointed at, and of links in code, which few pages have: letters and what is behind them."""


@dataclass(frozen=True)
class Contrast:
    """How a page is drawn: its scheme ("" of a page without the theme), whether it is dark, what was looked at."""

    scheme: str
    dark: bool
    letters: int
    marks: int
    found: list[str]


def of(page: Page) -> Contrast:
    """Return the contrast of a page as it is shown now."""
    body = Path(__file__).with_suffix(".js").read_text("utf-8").rstrip()
    return Contrast(**page.value(f"(\n{body}\n)({json.dumps(MARKS)}, {json.dumps(STATES)})"))
