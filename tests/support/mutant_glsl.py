"""Mutants of GLSL: the same small changes as of Python (mutant_texts.py), in the bodies of functions.

A shader has no lines of its own that could be measured: a test counts for all lines of the files that it reads.
"""

from __future__ import annotations

import re
from bisect import bisect_right

from tests.support.mutant_texts import ARITHMETIC, COMPARE, Mutant

SUFFIXES = (".glsl", ".vert", ".tesc", ".tese", ".geom", ".task", ".mesh", ".frag", ".comp")
KEPT = ("+", "-", "*", "/", "<<", ">>")
OPERATORS = COMPARE | {before: ARITHMETIC[before] for before in KEPT}
OPERATORS |= {"&&": "||", "||": "&&", "+=": "-=", "-=": "+=", "*=": "/=", "!": ""}
APART = re.compile(r"//[^\n]*|/\*.*?\*/|^[ \t]*#(?:\\\n|[^\n])*", re.S | re.M)
TOKEN = re.compile(
    r"[A-Za-z_]\w*|0[xX][0-9a-fA-F]+[uU]?|(?:\d+\.\d*|\.\d+|\d+)(?:[eE][-+]?\d+)?(?:[uUfF]|lf|LF)?"
    r"|<<=|>>=|\+\+|--|<<|>>|<=|>=|==|!=|&&|\|\||[-+*/%&|^]=|\S"
)
OPERAND = re.compile(r"[\w.)\]]$")
KEYWORDS = {"return", "case", "else", "in", "out", "do"}


def mutants(text: str, file: str) -> list[Mutant]:
    """Return all mutants of a shader's text, in the order of the text."""
    plain = APART.sub(lambda found: re.sub(r"[^\n]", " ", found[0]), text)
    tokens = [(found.start(), found[0]) for found in TOKEN.finditer(plain)]
    starts = [0, *(found.end() for found in re.finditer("\n", text))]
    found = []
    blocks: list[bool] = []  # of each open brace: whether it is a function's body, or in one
    before = ""
    for place, token in tokens:
        if token == "{":
            blocks.append(before == ")" or (bool(blocks) and blocks[-1]))
        elif token == "}" and blocks:
            blocks.pop()
        elif blocks and blocks[-1]:
            after = _other(token, before)
            if after is not None:
                line = bisect_right(starts, place)
                column = place - starts[line - 1]
                found.append(Mutant(file, line, column, token, after, (line, line), (line, line)))
        before = token
    return found


def _other(token: str, before: str) -> str | None:
    """Return what a token becomes, "" for nothing, None if it stays; `before` is the token before it."""
    if token in ("+", "-") and (before in KEYWORDS or not OPERAND.search(before)):
        return "" if token == "-" else None  # a sign
    if token in OPERATORS:
        return OPERATORS[token]
    if token in ("true", "false"):
        return "false" if token == "true" else "true"
    if number := re.fullmatch(r"(\d+)([uU]?)", token):
        return f"{int(number[1]) + 1}{number[2]}"
    if number := re.fullmatch(r"(\d+\.\d*|\.\d+|\d+)((?:[eE][-+]?\d+)?)([fF]?)", token):
        value = float(number[1] + number[2])
        return f"{2.0 * value if value else 1.0!r}{number[3]}"
    return None
