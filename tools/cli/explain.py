"""The options of `strata explain`; what it does is in `tools.ledger.explain`."""

from __future__ import annotations

from typing import Annotated

import typer


def explain(
    words: Annotated[
        list[str] | None,
        typer.Argument(
            metavar="[TERM|FEATURE|SETTING]",
            help="barrier, frame-graph/topological-sort, msaa; without it: all names.",
            show_default=False,
        ),
    ] = None,
) -> int:
    """Tell what a word of the lessons means, which tests hold a feature, or what a setting does."""
    from tools.ledger import explain as explaining

    return explaining.run(words or ())
