"""What every test gets: a validated device that fails the test on any message, and on anything left alive.

The tests of chapters run once per variant: on the device as it is, and with every optional feature switched off.
"""

from __future__ import annotations

import contextlib
import functools
import gc
import os
import signal
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import pytest

import chapters
from backends import choice
from backends.gl.context import Context
from backends.selftest import verdicts
from backends.vulkan.device import Device
from backends.vulkan.instance import VALIDATION_LAYER, Instance
from common.errors import UnsupportedError
from common.paths import asset_dir, user_cache
from common.reports import waiting
from tests.support import first, goldens, packages, sharing, snapshots, timing
from tests.support.chapter import Chapter
from tests.support.gl_functions import assert_silent
from tests.support.opened import Opened
from tests.support.report import Report

HERE = Path(__file__).parent
VARIANTS = {
    "vulkan": frozenset[str](),
    "without-all": frozenset({"all"}),
    "gl": frozenset[str](),
    "deferred": frozenset[str](),
}
"""Names of the variants, and what the devices of each do without; "gl" is for what draws with OpenGL.

"deferred" is for chapters that can light a frame after its surfaces were drawn: what the chapters before them are held
to, on that path. Elsewhere tests of those take the forward path.
"""

FORWARD_ALONE = {
    "test_timings_name_the_passes_in_order",
    "test_an_edit_is_seen_in_the_next_frame_and_costs_what_it_touched",
    "test_work_and_timings_stay_when_the_picture_is_gone",
    "test_a_frame_that_fails_leaves_the_next_one_whole",
    "test_a_scene_of_nothing_is_its_background",
    "test_a_scene_without_textures_has_no_texture_sampler_or_material_set",
    "test_pipelines_are_those_of_materials_that_are_drawn",
    "test_triangles_side_by_side_each_show_their_own_texture",
    "test_pipelines_that_share_a_set_but_not_its_layout_are_refused",
    "test_chapter_1_draws_the_same_bits",
    "test_a_frame_makes_the_same_calls_for_any_number_of_objects",
    "test_secondaries_say_all_themselves_and_stand_in_the_order_of_the_draws",
    "test_without_multi_draw_a_call_for_each_object_draws_the_same_bits",
    "test_forced_off_is_the_same_picture_by_another_path",
    "test_glass_in_any_order_keeps_no_more_than_its_states",
}
"""Tests that count draws, pipelines and sets of the forward path or name its passes, or hold it to a picture of its
own: on the other path the numbers are others, and the tests of that path hold that both give the same light."""

DEFERRED_SAMPLE = ("test_materials.py", "test_skipping.py")
"""The files of which the usual run takes that path, too; with --long all do."""

USUAL = {
    "chapter": ("vulkan", "without-all", "gl"),
    "vulkan_device": ("vulkan", "without-all"),
    "gl_context": ("gl",),
}
"""The variants of a test that uses this fixture, the first of these that it uses; the mark `variants` names others."""


def pytest_addoption(parser: pytest.Parser) -> None:
    """Add what `strata test` passes on."""
    parser.addoption("--long", action="store_true", help="also run what takes minutes")
    parser.addoption(
        "--record", action="store_true", help="keep results of whole areas in docs/records/tests.json"
    )
    parser.addoption("--first", action="store_true", help="end with the first failure, and in time")
    parser.addoption("--uses", type=Path, metavar="DIR", help="write which test files ask for packages")
    goldens.add_options(parser)
    sharing.add_options(parser)
    snapshots.add_options(parser)


def pytest_configure(config: pytest.Config) -> None:
    """Let the report watch the run, and software drivers compile quickly."""
    # Where a test has an empty cache, what was found out about the drivers stays known: trying them takes seconds.
    os.environ.setdefault("STRATA_VERDICTS", str(verdicts.folder()))
    # Tests solve exercises; that is no progress of the user.
    os.environ["STRATA_STATE"] = str(user_cache() / "test-state")
    compile_quickly(config.getoption("--long"))
    hear_signals()
    config.pluginmanager.register(Report(config), "strata-report")
    later = snapshots.Snapshots(
        snapshots.official(),
        snapshots.chosen(config.getoption("--chapter")),
        long=config.getoption("--long"),
        full=config.getoption("--first"),
    )
    config.pluginmanager.register(later, "strata-snapshots")
    config.pluginmanager.register(goldens, "strata-goldens")
    if not (config.getoption("--first") or sharing.is_second(config)):
        config.pluginmanager.register(sharing.Sharing(config), "strata-sharing")
    if config.getoption("--first"):
        (subject,) = later.chosen
        word = str(subject.folder) if subject.is_fork else str(subject.number)
        config.pluginmanager.register(first.First(subject.number, word), "strata-first")
    if config.getoption("--uses"):
        config.pluginmanager.register(packages.Uses(config.getoption("--uses")), "strata-uses")


@pytest.hookimpl(wrapper=True)
def pytest_collection() -> Iterator[None]:
    """Collect without looking for cycles, which are few, and never look through what was collected again.

    What pytest keeps of 20,000 tests is a large heap: Python went through it many times while it grew, and in each test
    that makes it collect its garbage.
    """
    gc.disable()
    try:
        return (yield)
    finally:
        gc.enable()
        gc.freeze()


@pytest.hookimpl(tryfirst=True)
def pytest_runtest_setup(item: pytest.Item) -> None:
    """Skip what needs a package that is not here, before any of its fixtures is made."""
    packages.skip_without(item)


LANES = "LP_NATIVE_VECTOR_WIDTH"
"""The bits of a vector of Mesa's software drivers: as many as the processor has, unless this variable says less."""


def compile_quickly(long: bool) -> None:
    """Have Mesa's software drivers compile without optimisation and for four lanes, unless this is the long run.

    Pictures are the same to the bit, since the order of every rounding stays: the long run, which leaves the drivers as
    a user has them, holds the same tests. At 64 pixels a shader takes far longer to compile than to run, and with
    nothing compiled most of a run's time is the compiler's. The optimiser was half of it (chapter 2 on OpenGL: 92 s
    with it, 43 s without). The drivers then write some instructions once for each lane, loads of buffers among them:
    with four lanes instead of eight a third of chapter 12's tests took 44 s instead of 80 s.

    Their cache does not tell kernels for four lanes from those for eight, and one of the other kind crashes: tests keep
    theirs in a folder of its own. Other drivers do not know these variables; the programs that tests start inherit
    them, and `strata run` and `bench` have none.
    """
    if long or LANES in os.environ:  # the second process has what the first has set
        return
    kept = Path(os.environ.get("MESA_SHADER_CACHE_DIR") or user_cache() / "mesa") / "four-lanes"
    with contextlib.suppress(OSError):  # without the folder the driver keeps nothing
        kept.mkdir(parents=True, exist_ok=True)
    os.environ.update({"MESA_SHADER_CACHE_DIR": str(kept), LANES: "128"})
    os.environ.setdefault("GALLIVM_PERF", "nopt")


def hear_signals() -> None:
    """Undo what `nohup` and a shell's `&` do: they have a program ignore SIGHUP or SIGINT, and children inherit it.

    Tests that send these signals to children would wait in vain.
    """
    if signal.getsignal(signal.SIGINT) is signal.SIG_IGN:
        signal.signal(signal.SIGINT, signal.default_int_handler)
    hangup = getattr(signal, "SIGHUP", None)  # Windows has none
    if hangup is not None and signal.getsignal(hangup) is signal.SIG_IGN:
        signal.signal(hangup, signal.SIG_DFL)


def pytest_collection_modifyitems(config: pytest.Config, items: list[pytest.Item]) -> None:
    """Leave out what takes minutes unless it was asked for."""
    if config.getoption("--long"):
        return
    long = [item for item in items if item.get_closest_marker("long")]
    if long:
        config.hook.pytest_deselected(items=long)
        items[:] = [item for item in items if not item.get_closest_marker("long")]


def pytest_generate_tests(metafunc: pytest.Metafunc) -> None:
    """Run the tests of chapters that draw once per variant; the mark `variants` names others than the usual.

    Its `long` names those of them that run with --long alone: the code under test is the same there.
    """
    area = metafunc.definition.path.relative_to(HERE).parts[0]
    if not (area.startswith("ch") or area == "stability"):
        return
    used = [names for fixture, names in USUAL.items() if fixture in metafunc.fixturenames]
    if used:
        mark = metafunc.definition.get_closest_marker("variants")
        names = mark.args if mark else used[0]
        if "chapter" in metafunc.fixturenames and "vulkan" in names and _takes_both_paths(metafunc):
            names = (*names, "deferred")
        later: Any = metafunc.config.pluginmanager.getplugin("strata-snapshots")
        names = later.variants_for(metafunc.definition, names)
        rare = mark.kwargs.get("long", ()) if mark else ()
        variants = [pytest.param(name, marks=pytest.mark.long) if name in rare else name for name in names]
        metafunc.parametrize("variant", variants, indirect=True, scope="module")


@functools.cache
def has_two_paths(which: chapters.Whole) -> bool:
    """Whether a chapter's frames can take the forward or the deferred path."""
    return hasattr(chapters.settings_class(which)(), "graph")


def _takes_both_paths(metafunc: pytest.Metafunc) -> bool:
    """Whether a test of a chapter with one path runs for one with two, and is of those that take both of them."""
    path = metafunc.definition.path
    written_for, config = snapshots.first_chapter(path), metafunc.config
    if (
        metafunc.function.__name__ in FORWARD_ALONE
        or written_for is None
        or has_two_paths(written_for)
        or not has_two_paths(snapshots.tested(metafunc.definition).which)
    ):
        return False
    return bool(config.getoption("--long")) or path.name in DEFERRED_SAMPLE


@pytest.fixture(scope="module")
def variant(request: pytest.FixtureRequest) -> str | None:
    """Which of the variants is tested; None where there is only one."""
    name: str | None = getattr(request, "param", None)
    return name


@pytest.fixture(scope="session")
def open_devices() -> Iterator[Opened]:
    """The devices that are open."""
    devices = Opened()
    yield devices
    devices.close()


@pytest.fixture(scope="session")
def vulkan_instance(request: pytest.FixtureRequest, open_devices: Opened) -> Iterator[Instance]:
    """A Vulkan instance with validation and synchronization validation, where the layers are installed."""
    try:
        choice.probe("vulkan")  # tries the driver, if that is new: what it gets wrong is not used
        with Instance() as plain:
            validate = VALIDATION_LAYER in plain.layers
            fit = [device for device in plain.devices() if device.unfit() is None]
    except UnsupportedError as error:
        pytest.skip(f"no Vulkan: {error}")
    if not fit:
        pytest.skip("no Vulkan 1.3 device")
    report: Any = request.config.pluginmanager.getplugin("strata-report")
    report.devices.setdefault("vulkan", fit[0].name)
    with Instance(validate) as instance:
        yield instance
        open_devices.close()


def _place(request: pytest.FixtureRequest) -> str:
    """Return whose tests share devices: a chapter's, for which files of several folders run, or a folder's."""
    of_chapter = snapshots.first_chapter(request.path) is not None
    return snapshots.tested(request.node).label if of_chapter else str(request.path.parent)


@contextmanager
def _vulkan(request: pytest.FixtureRequest, variant: str | None) -> Iterator[Device]:
    instance: Instance = request.getfixturevalue("vulkan_instance")
    opened: Opened = request.getfixturevalue("open_devices")
    without = VARIANTS[variant or "vulkan"]
    with opened.lent(
        _place(request), ("vulkan", without), lambda: Device(instance, without=without)
    ) as device:
        layers = "validated" if instance.validates else "without validation layers"
        report: Any = request.config.pluginmanager.getplugin("strata-report")
        report.devices["vulkan"] = f"{device.capabilities.device}, {device.capabilities.driver}, {layers}"
        yield device


@contextmanager
def _opengl(request: pytest.FixtureRequest, variant: str | None) -> Iterator[Context]:
    opened: Opened = request.getfixturevalue("open_devices")

    def open_() -> Context:
        try:
            choice.probe("gl")
            return Context(validate=True, without=VARIANTS[variant or "gl"])
        except UnsupportedError as error:
            pytest.skip(f"no OpenGL: {error}")

    with opened.lent(_place(request), ("gl", VARIANTS[variant or "gl"]), open_) as context:
        context.make_current()
        report: Any = request.config.pluginmanager.getplugin("strata-report")
        report.devices["gl"] = f"{context.capabilities.device}, {context.capabilities.driver}"
        yield context


@pytest.fixture(scope="module")
def vulkan_device(
    request: pytest.FixtureRequest, variant: str | None, vulkan_instance: Instance
) -> Iterator[Device]:
    """A device, lent to the tests of one module; an object that outlives them fails the last one."""
    with _vulkan(request, variant) as device:
        yield device


@pytest.fixture(scope="module")
def gl_context(request: pytest.FixtureRequest, variant: str | None) -> Iterator[Context]:
    """An OpenGL context whose calls are checked, lent to the tests of one module; what outlives them fails the last."""
    with _opengl(request, variant) as context:
        yield context


@pytest.fixture(params=["vulkan", "gl"])
def either_device(request: pytest.FixtureRequest) -> Device | Context:
    """A device of each backend in turn; `tests.support.either` runs shaders on it."""
    device: Device | Context = request.getfixturevalue(
        "gl_context" if request.param == "gl" else "vulkan_device"
    )
    return device


@pytest.fixture(scope="module")
def chapter(request: pytest.FixtureRequest, variant: str | None) -> Iterator[Chapter]:
    """The chapter that the test runs for, on a device of the variant: `chapter.open(scene, size)`."""
    which = snapshots.tested(request.node).which
    with (_opengl if variant == "gl" else _vulkan)(request, variant) as device:
        backend, path = "gl" if variant == "gl" else "vulkan", "auto" if variant == "deferred" else "forward"
        yield Chapter(which, backend, device, path, snapshots.first_chapter(request.path))


@pytest.fixture(autouse=True)
def _no_gl_message(request: pytest.FixtureRequest, variant: str | None) -> Iterator[None]:
    """Fail a test on any message of the OpenGL driver, and on an error that the test did not ask for."""
    for context in _contexts(request, variant):
        context.make_current()  # the test before may have had a context of its own
        context.sink.messages.clear()
    yield
    for context in _contexts(request, variant):
        assert_silent(context)


def _contexts(request: pytest.FixtureRequest, variant: str | None) -> list[Context]:
    """Return the contexts that a test uses; after the test also those that it asked for while it ran."""
    used = request.fixturenames
    contexts: list[Context] = [request.getfixturevalue("gl_context")] if "gl_context" in used else []
    if "chapter" in used and variant == "gl":
        contexts.append(request.getfixturevalue("chapter").device)
    return contexts


@pytest.fixture(autouse=True)
def _no_validation_message(request: pytest.FixtureRequest, variant: str | None) -> Iterator[None]:
    """Fail a test on any message of the layers or the driver."""
    if (sink := _sink(request, variant)) is not None:
        sink.messages.clear()
    yield
    if (sink := _sink(request, variant)) is not None:
        messages = sink.report()
        sink.messages.clear()
        assert not messages, "the validation layers say:\n" + "\n".join(messages)


def _sink(request: pytest.FixtureRequest, variant: str | None) -> Any:
    """Return where the layers write to if a test uses Vulkan; after the test also if it asked for it while it ran."""
    used = {*request.fixturenames}
    if not {"vulkan_instance", "vulkan_device"} & used and not ("chapter" in used and variant != "gl"):
        return None
    return request.getfixturevalue("vulkan_instance").sink


@pytest.fixture(scope="session")
def models() -> Path:
    """The folder of real glTF models made elsewhere."""
    folder = asset_dir()
    if folder is None:
        pytest.skip("the models made elsewhere are not here (STRATA_ASSETS)")
    return folder / "models"


@pytest.fixture
def strata(vulkan_instance, capsys, tmp_path, tmp_path_factory, monkeypatch):
    """Run a command in an empty folder, without a display; return (exit code, stdout, stderr)."""
    monkeypatch.chdir(tmp_path)
    monkeypatch.setenv("STRATA_STATE", str(tmp_path_factory.mktemp("state")))
    monkeypatch.delenv("DISPLAY", raising=False)
    monkeypatch.delenv("WAYLAND_DISPLAY", raising=False)

    from chapters.__main__ import run
    from tools.cli import console

    for made in (console.out, console.err):  # a narrow terminal of one test is none of the next
        monkeypatch.setattr(made, "_width", made._width)
    # Tests compare what is printed, and on a busy machine any step may be slow enough for a line of its own.
    monkeypatch.setattr(waiting, "told", functools.partial(waiting.told, after_s=timing.PATIENCE_S))

    def command(*words: str) -> tuple[int, str, str]:
        code = run([str(word) for word in words])
        printed = capsys.readouterr()
        return code, printed.out, printed.err

    return command
