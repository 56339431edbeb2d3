"""`strata run N`: open a chapter on a scene, draw, and leave a picture and a record; with a display, a window."""

from __future__ import annotations

import math
import re
import sys
import time as clock
from contextlib import ExitStack
from dataclasses import dataclass
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Any

import chapters
from chapters import studies
from chapters.folders import Folder
from common import images
from common.errors import UserError
from common.paths import cache_problem, folder_problem, write_problem, written_file
from common.settings import apply_overrides, flat, replaced
from tools.cli.console import Steps, say
from tools.cli.stopping import prompt_stop
from tools.lessons.places import places_of
from tools.run import quality, recording
from tools.run.films import FILMS
from tools.run.live import Live
from tools.run.opening import Opening, open_scene
from tools.run.record import STDOUT, Log, triangles
from tools.run.views import with_view
from tools.run.watch import until_idle, watch

if TYPE_CHECKING:
    from backends.contract import Frame, Renderer
    from common.scene import Scene
    from common.view.camera import View

QUALITIES = ("auto", "low", "medium", "high", "reference")
"""What every chapter has; a chapter may have further presets."""
DEFAULT_SIZE = (1280, 720)
MAX_EV = 60
PICTURES = (".png", ".exr")
"""What `--out` names: the picture as it is shown, or linear light."""
EXR_OUTPUTS = {"color_linear": "", "depth": "depth", "instance_id": "instance_id"}
"""What goes into an EXR, and the name of its layer."""


@dataclass(frozen=True)
class Request:
    """What the user asked for, checked as far as that needs neither scene nor device."""

    chapter: chapters.Which
    backend: str = "auto"
    scene: str | None = None  # None: what the chapter or the study draws by itself
    environment: str = "none"
    ev100: float | None = None
    size: tuple[int, int] = DEFAULT_SIZE
    frames: int | None = None
    out: Path | None = None
    camera: str | None = None
    path: str | None = None  # a name or a file of `common.view.paths`
    quality: str = "auto"
    overrides: tuple[str, ...] = ()
    view: str | None = None
    without: tuple[str, ...] = ()
    validate: bool = False
    cached: bool = True
    compressed: bool = False
    json: Path | None = None
    time: float = 0.0
    fps: float = 60.0
    headless: bool = False
    verbose: bool = False
    watch: bool = False


def parse_size(text: str) -> tuple[int, int]:
    """Return (width, height) of a text such as "640x360"; raise UserError unless both are at least 1."""
    match = re.fullmatch(r"\s*(\d{1,9})\s*[xX×]\s*(\d{1,9})\s*", text, re.ASCII)
    if match is None:
        raise UserError(f"--size {text!r} is no size: write width x height in pixels, such as 640x360.")
    from backends.contract import check_size

    return check_size((int(match[1]), int(match[2])))


def qualities_of(which: chapters.Which) -> tuple[str, ...]:
    """Return what `--quality` may say of a chapter or a study."""
    own = getattr(chapters.settings_class(which), "PRESETS", {})
    return (*QUALITIES, *(name for name in own if name not in QUALITIES))


def check(request: Request) -> None:
    """Raise UserError for what is wrong with a request before anything is opened."""
    from backends.contract import check_time, check_without

    backend = chapters.choose_backend(request.backend, request.chapter)
    chapters.renderer_module(request.chapter, backend)
    check_without(request.without)
    known = qualities_of(request.chapter)
    if request.quality not in known:
        from common.names import suggest

        near = suggest(request.quality, known)
        raise UserError(
            f"There is no quality {request.quality!r}{near}" + ("" if near.endswith("?") else ".")
        )
    if request.frames is not None and request.frames < 1:
        raise UserError(f"--frames {request.frames} draws nothing: it must be at least 1.")
    check_time(request.time, "--time")
    if request.ev100 is not None and not -MAX_EV <= request.ev100 <= MAX_EV:
        raise UserError(
            f"--ev {request.ev100} is no exposure: give EV100 between {-MAX_EV} and {MAX_EV}; daylight is about 15."
        )
    if not (math.isfinite(request.fps) and request.fps > 0):
        raise UserError(f"--fps {request.fps} is no rate: give frames per second above 0.")
    if request.frames is not None:
        count = min(request.frames, 10**18)  # a float holds that; nobody waits for so many
        check_time(request.time + (count - 1) / request.fps, "With --frames and --fps the last --time")
    # Before the file: a study that cannot fill an EXR is no reason to install the package that writes one.
    studies.check(request.chapter, request.quality, request.out)
    if request.path is not None:
        recording.check(request)
    elif request.out is not None:
        if request.out.suffix.lower() in FILMS.keys() - PICTURES:
            raise UserError(f"--out {request.out} is an animation: say what moves, such as --path walk.")
        images.check_writable(request.out, PICTURES)
    record = written_file(request.json.absolute()) if request.json not in (None, STDOUT) else None
    if record is not None and (record.is_dir() or not record.parent.is_dir()):
        raise UserError(f"--json {request.json} cannot be written: name a file in a folder that exists.")
    if record is not None and request.out is not None and record == written_file(request.out.absolute()):
        raise UserError(
            f"--out and --json both name {request.out}: the picture and the record are two files."
        )
    settings_of(request, "medium")


def settings_of(request: Request, quality: str) -> Any:
    """Return the settings of a preset of what is run, or those of a study, changed by --set and --view."""
    chosen = apply_overrides(studies.preset_of(request.chapter, quality), request.overrides)
    return with_view(chosen, request.chapter, request.view)


def run(request: Request) -> int:
    """Do what was asked; return the exit code. Raises StrataError."""
    began = clock.perf_counter()
    check(request)
    choice = chapters.decide_backend(request.backend, request.chapter)
    if request.backend == "auto" and (request.verbose or choice.backend == "gl"):
        say(f"strata: drawing with {choice.reason}.")
    problem = cache_problem() if request.verbose else ""
    if problem:
        say(f"strata: the cache {problem}: STRATA_CACHE can name another folder.")
    with prompt_stop():
        return show(request) if wants_window(request) else draw(request, began)


def validation(which: chapters.Which, wanted: bool, allowed: bool, backend: str) -> bool:
    """Return whether calls are checked: if it is `wanted`, and those of a fork, a work in progress, if `allowed`.

    Says so where a fork is not checked because the validation layers are not installed.
    """
    if wanted and not allowed:
        raise UserError("--validate and --no-validate cannot both be meant: leave one out.")
    if wanted or not allowed or not isinstance(which, Folder):
        return wanted
    if chapters.choose_backend(backend, which) == "gl":
        return True
    from backends.vulkan.instance import VALIDATION_LAYER, Instance

    with Instance() as plain:
        there = VALIDATION_LAYER in plain.layers
    if not there:
        say(
            "strata: the calls of a fork are checked where the Vulkan validation layers are installed; here they are "
            "not: ./strata doctor says how, --no-validate leaves this line out."
        )
    return there


def wants_window(request: Request) -> bool:
    """Whether to open a window: there is a display, and no picture was asked for."""
    if request.headless or request.watch or request.out is not None or request.path is not None:
        return False
    from backends.window import display_available

    return display_available()


def show(request: Request) -> int:
    """Draw in a window until it is closed, and write the record if one was asked for."""
    with ExitStack() as stack:
        with Steps() as steps:
            opening = stack.enter_context(open_drawn(request, steps))
            steps("measure the presets" if request.quality == "auto" else "open", 0.6)
            preset_name, note = chosen_quality(request, opening.scene)
        opening.start()
        return show_opened(request, opening, preset_name, note)


def open_drawn(request: Request, steps: Steps) -> Opening:
    """Open the scene that was asked for, with its exposure, and say what is to be known about it."""
    load = steps.of("load", 0.05, 0.5)
    opening = open_scene(
        request.chapter, request.scene, load, request.environment, request.cached, request.compressed
    )
    expose(opening.scene, request)
    tell_warnings(opening.scene, request.verbose)
    return opening


def show_opened(request: Request, opening: Opening, preset_name: str, note: str) -> int:
    """Draw an opened scene in a window until it is closed."""
    from tools.panel.panel import preset_of
    from tools.window.keys import HELP, panel_help
    from tools.window.window import run_window

    scene = opening.scene
    settings = settings_of(request, preset_name)
    logs: list[Log] = []

    def opened(**options: Any) -> Renderer:
        # The panel asks for other settings; then a record holds what came since.
        wanted, told = {"settings": settings, **options}, len(scene.warnings)
        renderer = chapters.open(request.chapter, request.backend, scene=scene, **wanted)
        if not logs:
            tell_warnings(scene, request.verbose, told)  # of what the renderer found out about the window
        quality = preset_name if wanted["settings"] == settings else preset_of(wanted["settings"]) or "own"
        logs.append(Log(request, renderer, quality))
        return renderer

    say(f"{studies.spoken(request.chapter)}, {scene.name}{note}. {HELP} {panel_help()}")
    backend = chapters.choose_backend(request.backend, request.chapter)
    figures = run_window(
        partial(opened, without=request.without, validate=request.validate),
        size=request.size,
        title=f"Strata {request.chapter}: {chapters.title_of(request.chapter)}",
        camera=request.camera,
        validate=request.validate,
        without=request.without,
        time=request.time,
        frames=request.frames,
        # Reading a frame's figures waits for it: only who asked for them pays that.
        on_frame=(lambda _, frame: logs[-1].add(frame)) if request.json or request.verbose else None,
        backend=backend,
        display=studies.display(request.chapter, backend),
        panel=True,
        name=chapters.file_name(request.chapter),
        quality=note.removeprefix(", "),
        places=places_of(request.chapter),
    )
    for text in figures.messages:
        say(f"strata: {text}")
    opening.report(request.verbose)
    if logs and logs[-1].frames:
        if request.json is not None:
            logs[-1].write(request.json)
        if request.verbose:
            logs[-1].show()
    return 1 if figures.messages else 0


def chosen_quality(request: Request, scene: Scene) -> tuple[str, str]:
    """Return the preset for a window, and what to say about it: `auto` takes the best that is fast enough here."""
    if request.quality != "auto" or isinstance(request.chapter, str):
        return request.quality, ""
    size = quality.measured_size(request.size)
    with ExitStack() as stack:
        device = open_device(stack, request.backend, request.validate, request.without)
        which = request.chapter
        key = quality.key_of(
            which if isinstance(which, int) else which.state(),
            device.capabilities,
            f"{scene.path} {triangles(scene)}",
            request.size,
            f"{settings_of(request, 'medium')} {request.environment} {request.camera} {sorted(request.without)}",
        )

        def measure(name: str) -> float:
            settings = settings_of(request, name)
            if flat(settings).get("loading") == "auto":  # as in the window that waits for this
                settings = replaced(settings, loading="stream")
            with chapters.open(
                request.chapter,
                request.backend,
                scene=scene,
                size=size,
                settings=settings,
                device=device,
            ) as renderer:
                view = chapters.view_of(renderer, request.camera, request.time)
                taken = quality.frame_ms(lambda: renderer.render(view, request.time).timings)
                return quality.estimated_ms(taken, size, request.size)

        name, taken = quality.choose(measure, key)
    judged = "" if size == request.size else f", judged by {size[0]}x{size[1]}"
    return name, f", quality {name} ({taken:.0f} ms a frame here{judged}; --quality sets another)"


def draw(request: Request, began: float) -> int:
    """Render without a window, write the picture and the record, and say where they are."""
    target = request.out or default_picture(request)
    outputs = set(EXR_OUTPUTS) if target.suffix.lower() == ".exr" else {"color"}
    # A study has no presets, and stays with what it was asked for: "auto".
    wants_default = request.quality == "auto" and not isinstance(request.chapter, str)
    preset_name = "medium" if wants_default else request.quality
    settings = settings_of(request, preset_name)
    with Steps() as steps, Live() as live, open_drawn(request, steps) as opening:
        scene, told = opening.scene, len(opening.scene.warnings)
        steps("create", 0.5)
        opener = partial(
            chapters.open,
            request.chapter,
            request.backend,
            scene=scene,
            size=request.size,
            settings=settings,
            without=request.without,
            outputs=outputs,
            validate=request.validate,
        )
        with opener() as renderer:
            log = Log(request, renderer, preset_name)
            if request.path is not None:
                log.pictures = recording.record(request, renderer, log, target, steps)
            else:
                view, time = draw_last(request, renderer, log, steps, target)
            opening.finish(steps.of("cache", 0.9, 1.0))
            steps.finish()
            log.start = {**steps.times, "total": clock.perf_counter() - began}
            messages = report_messages(renderer)
            if request.json is not None:
                log.write(request.json)
            if request.verbose:
                log.show()
            what = f"{studies.spoken(request.chapter)}, {scene.name}"
            wrote = recording.spoken(log.pictures, request)
            say(f"{what}, {request.size[0]}x{request.size[1]}, {log.device}: wrote {wrote}")
            tell_warnings(scene, request.verbose, told)  # of what was loaded meanwhile
            opening.report(request.verbose)
            if request.watch:
                watch(live, renderer, opener, view, time, partial(write_picture, target), target)
    return 1 if messages else 0


def draw_last(
    request: Request, renderer: Renderer, log: Log, steps: Steps, target: Path
) -> tuple[View, float]:
    """Draw the frames that were asked for, or until the renderer is idle; write the last and return its moment."""
    count = request.frames or 1
    for index in range(count):
        steps("first frame" if index == 0 else "frames", 0.7 + 0.3 * index / count)
        time = request.time + index / request.fps
        view = chapters.view_of(renderer, request.camera, time)
        frame = renderer.render(view, time)
        log.add(frame)
    if request.frames is None:  # an exposure that the GPU finds, for one, shows a frame later
        for frame in until_idle(renderer, view, time):
            log.add(frame)
    steps("write", 0.9)
    if request.out is None:
        target.parent.mkdir(exist_ok=True)
    write_picture(target, frame)
    log.pictures = [str(target)]
    return view, time


def default_picture(request: Request) -> Path:
    """Return where a picture goes for which no place was named: in `out/` of the current folder, made at the end."""
    name = studies.picture_name(request.chapter, request.scene)
    if request.path is not None:
        return in_out(f"{name}-{recording.file_name(request.path)}.webp")
    return in_out(f"{name}-{request.view}.png" if request.view else f"{name}.png")


def in_out(name: str) -> Path:
    """Return a file in `out/` of the current folder. Raises UserError where it could not be written there."""
    folder = Path("out")
    problem = folder_problem(folder)
    if problem:
        raise UserError(f"Nothing can be written to {folder.absolute()}: {problem}; say --out FILE.png.")
    problem = write_problem(folder / name) if folder.is_dir() else ""
    if problem:
        raise UserError(f"{folder / name} cannot be written: {problem}; say --out FILE.")
    return folder / name


def write_picture(path: Path, frame: Frame) -> None:
    """Write a frame as it is shown (.png), or its linear colour, depth and instance ids as layers (.exr)."""
    if path.suffix.lower() == ".exr":
        images.write_layers(path, {layer: frame.image(name) for name, layer in EXR_OUTPUTS.items()})
    else:
        images.write_image(path, frame.image("color"))


def expose(scene: Scene, request: Request) -> None:
    """Give the scene the exposure of --ev; say so where an environment does not fit the one that the scene has."""
    scene.ev100 = request.ev100
    if scene.environment is None or request.ev100 is not None:
        return
    if flat(settings_of(request, "medium")).get("exposure", "view") != "view":  # the renderer finds it
        return
    from common.view.camera import exposure, fitting_ev100, framed_view

    light = scene.environment.mean_luminance
    fits = fitting_ev100(light, least=sys.float_info.min)
    chosen = framed_view(scene, 1.0).ev100
    if abs(fits) > MAX_EV:
        extreme = "dark" if fits < 0 else "bright"
        say(f"strata: the environment has {light:.2g} nits on average: it is too {extreme} for any exposure.")
    elif abs(chosen - fits) > 3.0:
        seen = exposure(chosen) * light
        say(
            f"strata: at this exposure the environment has a brightness of {seen:.2g} on average: --ev {fits:.1f} fits."
        )


def open_device(stack: ExitStack, backend: str, validate: bool = False, without: tuple[str, ...] = ()) -> Any:
    """Return a device of a backend, closed by `stack`, that several renderers can share."""
    if chapters.choose_backend(backend) == "gl":
        from backends.gl.context import Context

        return stack.enter_context(Context(validate, without))
    from backends.vulkan.device import Device
    from backends.vulkan.instance import Instance

    instance = stack.enter_context(Instance(validate))
    return stack.enter_context(Device(instance, without=without))


def tell_warnings(scene: Scene, verbose: bool, first: int = 0) -> None:
    """Say what the file holds that was left out or put right, from note `first` on: all with -v, else how much."""
    found = scene.warnings[first:]
    shown = found if verbose else found[:3]
    for warning in shown:
        say(f"strata: {scene.name}: {warning}")
    if len(found) > len(shown):
        say(f"strata: {scene.name}: {len(found) - len(shown)} more notes; -v shows them.")


def report_messages(renderer: Renderer) -> int:
    """Print each distinct validation message once with its count; return how many there are."""
    sink = getattr(getattr(renderer, "device", None), "sink", None)
    texts: list[str] = sink.report() if sink is not None else []
    for text in texts:
        say(f"strata: {text}")
    return len(texts)
