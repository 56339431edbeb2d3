"""The commands and their options; what they do is in the module of each."""

from __future__ import annotations

from pathlib import Path
from typing import Annotated, Any

import typer
from typer.core import TyperCommand, TyperGroup

from common.errors import UserError
from tools.cli import assets
from tools.cli.bench import bench, reference
from tools.cli.bundle import bundle
from tools.cli.console import say
from tools.cli.diff import diff
from tools.cli.docs import docs
from tools.cli.exercises import check, exercise
from tools.cli.frames import frame, graph
from tools.cli.ledger import explain, list_
from tools.cli.lessons import next_
from tools.cli.options import (
    Backend,
    Camera,
    CameraPath,
    Compress,
    Environment,
    Rate,
    Runnable,
    Set,
    Size,
    Uncached,
    Unchecked,
    Validate,
    Without,
)
from tools.cli.snapshots import carry, fork, new
from tools.cli.stopping import STOPPED, stop_code


def _without_metavar(parameters: list[Any]) -> list[Any]:
    """Return a command's parameters; a flag takes no value, and so its help shows none, as typer's own would."""
    for parameter in parameters:
        if getattr(parameter, "is_flag", False):
            parameter.metavar = ""
    return parameters


class Command(TyperCommand):
    """A command of typer's, whose flags have no metavar; `--help`, which typer adds, is one of them."""

    def get_params(self, context: Any) -> list[Any]:
        """Return options and arguments."""
        return _without_metavar(super().get_params(context))


class Group(TyperGroup):
    """The same for the program itself."""

    def get_params(self, context: Any) -> list[Any]:
        """Return options and arguments."""
        return _without_metavar(super().get_params(context))


app = typer.Typer(
    name="strata",
    cls=Group,
    help="Real-time rendering in fifteen chapters: run one, look at its code, change it, measure it.",
    epilog="Start with: ./strata run 1, or ./strata run 1/first-triangle",
    add_completion=False,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["-h", "--help"]},
)


# Some versions of typer bring a click of their own: the base of all complaints is found from one that typer exports.
ClickException: Any = next(kind for kind in typer.BadParameter.__mro__ if kind.__name__ == "ClickException")


def invoke(words: list[str]) -> int:
    """Run the command in `words` and return its exit code; click's own complaints become one sentence."""
    try:
        result = typer.main.get_command(app).main(
            words or ["--help"], prog_name="strata", standalone_mode=False
        )
    except ClickException as error:
        say(f"strata: {sentence(error)}")
        return 2
    except typer.Exit as ended:
        return ended.exit_code
    except typer.Abort:
        say("strata: stopped.")
        return stop_code()
    code = result if isinstance(result, int) else 0
    if code == STOPPED:  # typer makes this of Ctrl-C, and says nothing
        say("strata: stopped.")
        return stop_code()
    return code


def sentence(error: Any) -> str:
    """Return a complaint of click on one line, with where help is."""
    text = " ".join(error.format_message().split())
    context = getattr(error, "ctx", None)
    command = context.command_path if context else "strata"
    return f"{text}{'' if text.endswith(('.', '?')) else '.'} `{command} --help` shows what there is."


@app.command(cls=Command)
def run(
    chapter: Runnable,
    backend: Backend = "auto",
    scene: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|PATH",
            help="A scene of `strata list --scenes`, a model of `strata assets list`, or a .gltf, .glb or .obj file; "
            "the atrium, or a study's own.",
            show_default=False,
        ),
    ] = None,
    environment: Environment = "none",
    size: Size = "1280x720",
    frames: Annotated[
        int | None,
        typer.Option(
            metavar="K",
            help="Stop after K frames; a file gets the last, or with --path all.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Write .png (as shown) or .exr (linear light, depth, ids), without a window; with --path .webp, .gif "
            "or .png that move, or numbered pictures: a folder, or a name with %04d.",
            show_default=False,
        ),
    ] = None,
    camera: Annotated[
        str | None,
        typer.Option(
            metavar="NAME|VIEW",
            help="A camera of the scene, or eye:target[:fov] as 3,2,5:0,1,0:45.",
            show_default=False,
        ),
    ] = None,
    path: CameraPath = None,
    ev: Annotated[
        float | None,
        typer.Option(
            metavar="EV100",
            help="Exposure: 15 for daylight, 7 for a room. Without it: that of the scene.",
            show_default=False,
        ),
    ] = None,
    quality: Annotated[
        str,
        typer.Option(
            metavar="auto|low|medium|high|reference",
            help="Preset of settings; auto: the best that holds 20 frames a second in a window, else medium.",
        ),
    ] = "auto",
    set_: Set = None,
    view: Annotated[
        str | None,
        typer.Option(
            metavar="NAME",
            help="Show one quantity of `strata list N --views` in place of the picture.",
            show_default=False,
        ),
    ] = None,
    without: Without = None,
    validate: Validate = False,
    no_validate: Unchecked = False,
    no_cache: Uncached = False,
    compress: Compress = False,
    json: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|-",
            help="Write timings, work, device, plan and settings; - prints them.",
            show_default=False,
        ),
    ] = None,
    time: Annotated[float, typer.Option(metavar="SECONDS", help="Time of the first frame.")] = 0.0,
    fps: Rate = None,
    headless: Annotated[bool, typer.Option("--headless", help="Open no window.")] = False,
    watch: Annotated[
        bool,
        typer.Option("--watch", help="Write the picture anew whenever a shader is saved; without a window."),
    ] = False,
    verbose: Annotated[
        bool, typer.Option("-v", "--verbose", help="Show plan, timings, work and notes.")
    ] = False,
) -> int:
    """Draw a scene with a chapter's renderer: in a window, or without a display into a file."""
    import chapters
    from tools.run import films, views
    from tools.run import run as running

    which = chapters.parse(chapter)
    request = running.Request(
        chapter=which,
        backend=backend,
        scene=scene,
        environment=environment,
        ev100=ev,
        size=running.parse_size(size),
        frames=frames,
        out=out,
        camera=camera,
        path=path,
        quality=quality,
        overrides=views.shown_by(which, set_ or ()),
        view=view,
        without=tuple(without or ()),
        validate=running.validation(which, validate, not no_validate, backend),
        cached=not no_cache,
        compressed=compress,
        json=json,
        time=time,
        fps=films.usual_rate(out) if fps is None else fps,
        headless=headless,
        verbose=verbose,
        watch=watch,
    )
    return running.run(request)


app.command(cls=Command)(frame)
app.command(cls=Command)(graph)


app.command(name="list", cls=Command)(list_)


app.command(cls=Command)(explain)


@app.command(cls=Command)
def doctor(
    json: Annotated[bool, typer.Option("--json", help="Print the report as JSON.")] = False,
    selftest: Annotated[
        bool,
        typer.Option(
            "--selftest", help="Try every feature that the device advertises, each in its own process."
        ),
    ] = False,
) -> int:
    """Show what this machine has and how each chapter would run on it."""
    from tools.doctor import doctor as examination

    return examination.run(json=json, selftest=selftest)


@app.command(
    name="test",
    cls=Command,
    context_settings={"allow_extra_args": True, "ignore_unknown_options": True},
    epilog="Whatever is not listed here goes to pytest: ./strata test ch01 -k alpha -x",
)
def run_tests(
    context: typer.Context,
    long: Annotated[bool, typer.Option("--long", help="Also what takes minutes.")] = False,
    bless: Annotated[
        bool, typer.Option("--bless", help="Make golden pictures anew, after showing them.")
    ] = False,
    static: Annotated[
        bool, typer.Option("--static", help="Also ruff, mypy and import-linter, as CI does.")
    ] = False,
    record: Annotated[
        bool, typer.Option("--record", help="Keep the results of whole areas for the site, in docs/records.")
    ] = False,
    chapter: Annotated[
        str | None,
        typer.Option(
            metavar="N|DIR",
            help="A first test of one chapter, 90 s at most, that ends with the first failure.",
            show_default=False,
        ),
    ] = None,
    mutants: Annotated[
        int | None,
        typer.Option(
            metavar="N",
            min=0,
            help="Change one token of the code, N times, and show which changes no test notices.",
            show_default=False,
        ),
    ] = None,
    seed: Annotated[
        str | None,
        typer.Option(metavar="WORD", help="What mutants are drawn by; the commit's hash if left out."),
    ] = None,
    jobs: Annotated[
        int | None,
        typer.Option(
            metavar="N", min=1, help="Mutants that are tried at a time; one for each core if left out."
        ),
    ] = None,
) -> int:
    """Run the tests: all, those of an area such as ch01, common or backends, or a chapter's on the folder of a fork."""
    from tools.ledger import testing

    if mutants is not None:
        if long or bless or static or chapter is not None:
            raise UserError("--mutants takes --seed, --jobs and --record alone: leave out other options.")
        return testing.run_mutants(mutants, [*context.args], seed=seed, jobs=jobs, record=record)
    if seed is not None or jobs is not None:
        raise UserError("--seed and --jobs are for mutants: add --mutants N, or leave them out.")
    return testing.run([*context.args], long=long, bless=bless, static=static, record=record, chapter=chapter)


@app.command(cls=Command)
def compare(
    a: Annotated[
        str,
        typer.Argument(
            metavar="A",
            help="1, 1@gl, 1:msaa=4,anisotropy=1, 1:low, 1:without=anisotropy, a fork's folder, a .png or .exr.",
            show_default=False,
        ),
    ],
    b: Annotated[
        str, typer.Argument(metavar="B", help="The same; it is held against A.", show_default=False)
    ],
    scene: Annotated[
        str | None,
        typer.Option(metavar="NAME|PATH", help="As for `strata run`.", show_default=False),
    ] = None,
    environment: Environment = "none",
    camera: Camera = None,
    path: CameraPath = None,
    ev: Annotated[
        float | None,
        typer.Option(metavar="EV100", help="Exposure; without it that of the scene.", show_default=False),
    ] = None,
    size: Annotated[
        str | None,
        typer.Option(
            metavar="WxH", help="Size of the pictures: that of a file, else 640x360.", show_default=False
        ),
    ] = None,
    time: Annotated[float, typer.Option(metavar="SECONDS", help="Time of the first frame.")] = 0.0,
    frames: Annotated[
        int | None,
        typer.Option(
            metavar="K",
            help="Draw K frames on a running clock and compare the last, or with --path all; without it, one moment.",
            show_default=False,
        ),
    ] = None,
    fps: Rate = None,
    quality: Annotated[
        str, typer.Option(metavar="low|medium|high|reference", help="Preset of a side that names none.")
    ] = "medium",
    without: Annotated[
        list[str] | None,
        typer.Option(metavar="FEATURE|all", help="Do without it on both sides; repeatable."),
    ] = None,
    map_: Annotated[
        str,
        typer.Option(
            "--map", metavar="auto|flip|difference", help="The error map; auto: FLIP where its package is."
        ),
    ] = "auto",
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Where A, B and the map go, as .png; with --path the worst frame, or all of them as .webp or .gif.",
            show_default=False,
        ),
    ] = None,
    json: Annotated[
        Path | None, typer.Option(metavar="FILE|-", help="Write the record; - prints it.", show_default=False)
    ] = None,
    verbose: Annotated[bool, typer.Option("-v", "--verbose", help="Show all notes on the scene.")] = False,
) -> int:
    """Compare two chapters, forks, backends, settings or pictures: side by side, with time, error and work."""
    from tools.compare import compare as comparing
    from tools.run import films
    from tools.run import run as running

    request = comparing.Request(
        a=a,
        b=b,
        scene=scene,
        environment=environment,
        camera=camera,
        path=path,
        ev100=ev,
        size=None if size is None else running.parse_size(size),
        time=time,
        frames=frames,
        fps=films.usual_rate(out) if fps is None else fps,
        quality=quality,
        without=tuple(without or ()),
        map=map_,
        out=out,
        json=json,
        verbose=verbose,
    )
    return comparing.run(request)


app.command(cls=Command)(bench)
app.command(cls=Command)(reference)
app.command(cls=Command)(diff)
app.command(cls=Command)(fork)
app.command(name="next", cls=Command)(next_)
app.command(cls=Command)(exercise)
app.command(cls=Command)(check)
app.command(cls=Command)(carry)
app.command(cls=Command)(new)
app.command(cls=Command)(assets.convert)
app.command(cls=Command)(docs)
app.command(cls=Command)(bundle)
models = typer.Typer(name="assets", cls=Group, invoke_without_command=True, callback=assets.alone)
for command_name, made in (
    ("list", assets.list_),
    ("get", assets.get),
    ("add", assets.add),
    ("remove", assets.remove),
    ("shrink", assets.shrink),
):
    models.command(name=command_name, cls=Command)(made)
app.add_typer(models)


def _version(wanted: bool) -> None:
    if wanted:
        from tools.run.record import strata_version

        typer.echo(f"strata {strata_version()}")
        raise typer.Exit


@app.callback()
def _options(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    pass
