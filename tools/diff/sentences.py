"""The sentence with which a file says what it is: of Python's docstring, GLSL's first comment, a text's heading."""

from __future__ import annotations

import re
from pathlib import Path, PurePath

SHADERS = frozenset(
    {
        *(".glsl", ".vert", ".frag", ".comp", ".geom", ".tesc", ".tese", ".mesh", ".task"),
        *(".rgen", ".rchit", ".rahit", ".rmiss", ".rint", ".rcall"),
    }
)
"""Suffixes of GLSL."""


def first_sentence(path: Path) -> str:
    """Return the first sentence with which a file says what it is; "" where there is none, or no file."""
    return sentence_of(path.name, path.read_text("utf-8")) if path.is_file() else ""


def sentence_of(name: str, text: str) -> str:
    """Return the first sentence of a file called `name` with content `text`; it need not be whole or correct."""
    suffix = PurePath(name).suffix
    body = ""
    if suffix == ".py":
        match = re.match(r'\s*[rR]?"""(.*?)"""', text, re.S)
        body = match[1] if match else ""
    elif suffix == ".md":
        match = re.match(r"\s*#+\s*(.*)", text)
        body = match[1] if match else ""
    elif suffix in SHADERS:
        match = re.match(r"\s*(?:/\*(.*?)\*/|((?://[^\n]*\n?)+))", text, re.S)
        body = (match[1] or re.sub(r"^//+", "", match[2], flags=re.M)) if match else ""
        body = re.sub(r"^\s*\*+", "", body, flags=re.M)
    return re.split(r"(?<=[.])\s", " ".join(body.split()), maxsplit=1)[0]
