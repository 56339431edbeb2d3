"""The options of `strata bench` and `strata reference`; what they do is in `tools.bench` and `tools.reference`."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer

from common.errors import UserError
from tools.cli.options import Backend, Camera, Environment, Scene, Set, Size

OPTIONS = {"json_": "--json", "all_": "--all", "set_": "--set", "filter_": "--filter"}
"""Options whose parameter has another name, since Python has a use for theirs."""

OF_SWEEPS = {"--sweep", "--out", "--backend", "--workers", "--cluster", "--no-cache", "--verbose"}
"""What `strata reference` takes beside --sweep."""


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
    truth: Annotated[
        str,
        typer.Option(
            metavar="own|path-tracer|path-tracer-centre",
            help="Hold pictures to the chapter's own reference, or to light traced by paths: anywhere in a pixel, or "
            "through its centre, as chapters sample it. With --all and --plot, one plot of all chapters.",
        ),
    ] = "own",
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
        refuse(
            given & {"--plot"} if truth == "own" else set(),
            chapter,
            "--all measures every chapter, and a plot is of one but for --truth path-tracer",
        )
    elif chapter is None:
        raise UserError(
            "Name the chapter to measure, as `strata bench 1`, or all of them: `strata bench --all --quick`."
        )

    import chapters
    from tools.run import run as running

    options: dict[str, Any] = {"backend": backend, "scene": scene, "quick": quick, "record": record}
    options |= {"json_path": json_, "only": tuple(only or ()), "plot_path": plot, "truth": truth}
    if chapter is None:
        from tools.bench import all_chapters

        wanted = running.parse_size(size) if "--size" in given or not quick else all_chapters.SIZE
        return all_chapters.run(size=wanted, **options)
    from tools.bench import bench as measuring

    return measuring.run(chapters.parse_chapter(chapter), size=running.parse_size(size), **options)


def refuse(options: set[str], chapter: str | None, why: str) -> None:
    """Raise UserError for options, and a chapter, that make no sense beside the one that `why` names first."""
    words = [*([chapter] if chapter is not None else []), *sorted(options)]
    if words:
        raise UserError(f"{why}: leave out {' and '.join(words)}.")


def reference(
    context: typer.Context,
    chapter: Annotated[
        str | None,
        typer.Argument(
            metavar="N|DIR",
            help="Number of the chapter, 1 or ch01, or the folder of a fork; none with --sweep.",
            show_default=False,
        ),
    ] = None,
    backend: Backend = "auto",
    scene: Scene = "atrium",
    environment: Environment = "none",
    size: Size = "640x360",
    camera: Camera = None,
    time: Annotated[float, typer.Option(metavar="SECONDS", help="Time of the picture.")] = 0.0,
    ev: Annotated[
        float | None,
        typer.Option(metavar="EV100", help="Exposure; without it that of the scene.", show_default=False),
    ] = None,
    error: Annotated[
        float,
        typer.Option(
            metavar="PART",
            help="Stop where the estimated error is at most this part of the light: the root of the mean squared "
            "relative standard error of pixels.",
        ),
    ] = 0.01,
    paths: Annotated[
        int, typer.Option(metavar="N", help="Trace no more paths of each pixel than these.")
    ] = 65536,
    filter_: Annotated[
        str,
        typer.Option(
            "--filter",
            metavar="box|centre",
            help="Rays go anywhere in a pixel, or through its centre, as chapters sample it.",
        ),
    ] = "box",
    seed: Annotated[
        int, typer.Option(metavar="N", help="Number of the random sequence: others are other paths.")
    ] = 0,
    set_: Set = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|DIR",
            help="Write .exr (nits, with error, number of paths and notes), .npy (nits alone) or .png (as shown, "
            "without a tone curve); with --sweep the folder of all.",
            show_default=False,
        ),
    ] = None,
    sums: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.npz",
            help="Keep the sums of paths in this file in place of the cache, and go on with those that it has.",
            show_default=False,
        ),
    ] = None,
    no_cache: Annotated[
        bool, typer.Option("--no-cache", help="Trace from the first path on, and keep no sums.")
    ] = False,
    sweep: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE.toml",
            help="Trace the references of a file with chapters, scenes, cameras and settings, and write a table.",
            show_default=False,
        ),
    ] = None,
    workers: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            help="Of a sweep: trace in so many processes of this machine, by Dask (2; 0: in this one).",
            show_default=False,
        ),
    ] = None,
    cluster: Annotated[
        str | None,
        typer.Option(
            metavar="tcp://HOST:PORT",
            help="Of a sweep: trace by the workers of this Dask scheduler.",
            show_default=False,
        ),
    ] = None,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="Show all notes on the scene.")] = False,
) -> int:
    """Trace the scene of a chapter by paths, with its camera and light, until the estimated error is small.

    The path tracer is that of chapter 12. Sums of paths are kept, also where Ctrl-C or SIGTERM ends the run, and go on
    for a smaller error.
    """
    given = {
        OPTIONS.get(name, f"--{name.replace('_', '-')}")
        for name in context.params
        if getattr(context.get_parameter_source(name), "name", "") == "COMMANDLINE" and name != "chapter"
    }
    if sweep is not None:
        refuse(given - OF_SWEEPS, chapter, f"--sweep {sweep} says itself what is traced")
        from tools.reference.sweep import command as sweeping

        return sweeping.run(
            sweeping.Request(sweep, out, backend, workers, cluster, cached=not no_cache, verbose=verbose)
        )
    refuse(given & {"--workers", "--cluster"}, None, "Workers trace sweeps alone, of --sweep FILE")
    if chapter is None:
        raise UserError(
            "Name the chapter whose scene is traced, as `strata reference 1`, or a file of many: --sweep FILE."
        )

    import chapters
    from tools.reference import command
    from tools.run import run as running

    return command.run(
        command.Request(
            chapter=chapters.parse_chapter(chapter),
            backend=backend,
            scene=scene,
            environment=environment,
            ev100=ev,
            size=running.parse_size(size),
            camera=camera,
            time=time,
            error=error,
            paths=paths,
            filter=filter_,
            seed=seed,
            overrides=tuple(set_ or ()),
            sums=sums,
            cached=not no_cache,
            out=out,
            verbose=verbose,
        )
    )
