"""The options of `strata bench`; what it does is in `tools.bench`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from common.errors import UserError
from tools.cli.options import Backend, Scene, Size

OPTIONS = {"json_": "--json", "all_": "--all"}
"""Options whose parameter has another name, since Python has a use for theirs."""


def bench(
    context: typer.Context,
    chapter: Annotated[
        str | None,
        typer.Argument(
            metavar="N|DIR",
            help="Number of the chapter, 1 or ch01, or the folder of a fork; none with --all and --compare.",
            show_default=False,
        ),
    ] = None,
    backend: Backend = "auto",
    scene: Scene = "atrium",
    size: Size = "640x360",
    quick: Annotated[bool, typer.Option("--quick", help="Few frames: a look, not a measurement.")] = False,
    all_: Annotated[
        bool,
        typer.Option(
            "--all",
            help="Every chapter on every backend that is here; with --quick in minutes, at 160x90.",
        ),
    ] = False,
    compare: Annotated[
        tuple[Path, Path] | None,
        typer.Option(
            metavar="OLD NEW",
            help="Measure nothing, and name what became worse from one record to the other, beyond noise.",
            show_default=False,
        ),
    ] = None,
    json_: Annotated[
        Path | None,
        typer.Option("--json", metavar="FILE", help="Write the record; - prints it.", show_default=False),
    ] = None,
    plot: Annotated[
        Path | None,
        typer.Option(metavar="FILE", help="Write time against error as a picture.", show_default=False),
    ] = None,
    record: Annotated[bool, typer.Option("--record", help="Keep the record in docs/benchmarks.")] = False,
    only: Annotated[
        list[str] | None,
        typer.Option(
            metavar="PART",
            help="That part alone, repeatable: settings, prepared, start, stability, scales, pipelines, threads, "
            "loads, readback, graph, prepass, gbuffer, cloth, drift, async, pacing, culling, ideal, meshlets, lods, "
            "lights, surfaces, occlusion, transparency, hdr, memory, filters, cascades, caching, casters, "
            "rates, constants, fog, taa, rays.",
            show_default=False,
        ),
    ] = None,
) -> int:
    """Measure time, error and work of a chapter's presets and knobs, and what grows with the scene."""
    given = {
        OPTIONS.get(name, f"--{name}")
        for name in context.params
        if getattr(context.get_parameter_source(name), "name", "") == "COMMANDLINE" and name != "chapter"
    }
    if compare is not None:
        refuse(
            given - {"--compare", "--json", "--only"},
            chapter,
            "--compare reads two records and measures nothing",
        )
        from tools.bench import compare as bench_compare

        return bench_compare.run(*compare, json_path=json_, only=tuple(only or ()))
    if all_:
        refuse(given & {"--plot"}, chapter, "--all measures every chapter, and a plot is of one")
    elif chapter is None:
        raise UserError(
            "Name the chapter to measure, as `strata bench 1`, or all of them: `strata bench --all --quick`."
        )

    import chapters
    from tools.run import run as running

    options: dict[str, Any] = {"backend": backend, "scene": scene, "quick": quick, "record": record}
    options |= {"json_path": json_, "only": tuple(only or ())}
    if chapter is None:
        from tools.bench import all_chapters

        wanted = running.parse_size(size) if "--size" in given or not quick else all_chapters.SIZE
        return all_chapters.run(size=wanted, **options)
    from tools.bench import bench as measuring

    return measuring.run(
        chapters.parse_chapter(chapter), size=running.parse_size(size), plot_path=plot, **options
    )


def refuse(options: set[str], chapter: str | None, why: str) -> None:
    """Raise UserError for options, and a chapter, that make no sense beside the one that `why` names first."""
    words = [*([chapter] if chapter is not None else []), *sorted(options)]
    if words:
        raise UserError(f"{why}: leave out {' and '.join(words)}.")
