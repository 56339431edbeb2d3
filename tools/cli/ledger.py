"""The options of `strata list` and `strata explain`; what they print is in `tools.ledger`."""

from __future__ import annotations

from typing import Annotated

import typer


def list_(
    chapter: Annotated[
        str | None,
        typer.Argument(
            metavar="[N|DIR]", help="A chapter, a study or a fork, to see its lesson.", show_default=False
        ),
    ] = None,
    settings: Annotated[bool, typer.Option("--settings", help="Every knob of chapter N.")] = False,
    views: Annotated[bool, typer.Option("--views", help="What `--view` of chapter N can show.")] = False,
    scenes: Annotated[bool, typer.Option("--scenes", help="The scenes that come with Strata.")] = False,
    features: Annotated[
        bool,
        typer.Option(
            "--features", help="What is tested, and how that went on each backend; with N of a chapter."
        ),
    ] = False,
    find: Annotated[
        str, typer.Option(metavar="WORDS", help="Of the features those with these words.", show_default=False)
    ] = "",
    tests: Annotated[bool, typer.Option("--tests", help="Also the tests of each feature.")] = False,
    json: Annotated[bool, typer.Option("--json", help="Print the features as JSON.")] = False,
) -> int:
    """Show the chapters, one chapter's lesson, knobs or views, the scenes, or the features that tests hold."""
    from tools.ledger import listing

    return listing.run(
        chapter,
        settings=settings,
        views=views,
        scenes=scenes,
        features=features,
        find=find,
        tests=tests,
        as_json=json,
    )


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
