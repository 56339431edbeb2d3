"""What the bootstrap decides, as tables: one machine, one expected plan."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bootstrap.apt_sources import BACKPORTS_FILE, PIN_FILE, Source
from bootstrap.graphics import Device, Graphics
from bootstrap.machine import VALIDATION_LAYER, Machine
from bootstrap.plan import (
    APT_GL,
    APT_LAYERS,
    APT_PACKAGES,
    APT_VULKAN,
    APT_WINDOW,
    Plan,
    decide,
    decide_environment,
)

DEBIAN = Source(
    ("http://mirror.example/debian",), ("bookworm", "bookworm-updates"), ("main",), (("Signed-By", "/k"),)
)
BOOKWORM = Machine(
    distribution="debian", release="12", codename="bookworm", managers=("apt-get",), sources=(DEBIAN,)
)
JAMMY = Machine(
    distribution="ubuntu",
    release="22.04",
    codename="jammy",
    like=("debian",),
    managers=("apt-get",),
    sudo=True,
)
NOBLE = replace(JAMMY, release="24.04", codename="noble", python=(3, 12))
FEDORA = Machine(distribution="fedora", release="43", managers=("dnf",), sudo=True)
ARCH = Machine(distribution="arch", managers=("pacman",), sudo=True)
WSL = replace(NOBLE, wsl=True)
MACOS = Machine(system="darwin", managers=("brew",))
WINDOWS = Machine(system="win32")
GENTOO = Machine(distribution="gentoo", sudo=True)
ALL = (BOOKWORM, JAMMY, NOBLE, FEDORA, ARCH, WSL, MACOS, WINDOWS, GENTOO)


def name(machine: Machine) -> str:
    return " ".join(
        filter(None, (machine.distribution or machine.system, machine.release, "wsl" * machine.wsl))
    )


def last(plan: Plan) -> tuple[str, ...]:
    return plan.steps[-1].command


def installed(plan: Plan) -> tuple[str, ...]:
    """Return the packages that the last command of a plan for apt installs."""
    command = last(plan)
    return command[command.index("--no-install-recommends") + 1 :]


NO_VULKAN = Device(
    problem="No Vulkan loader was found on this machine: ./strata doctor says what to install.",
    libraries=("libvulkan.so.1",),
)
NO_GL = Device(
    problem="No OpenGL 4.5 was found (libgl not loaded): ./strata doctor says what to install.",
    libraries=("libEGL.so.1", "libGL.so.1"),
)
CARD, PROCESSOR = Device("discrete", "a card"), Device("software", "llvmpipe")


def working(machine: Machine, kind: str = "discrete", layers: bool = False, **more: object) -> Machine:
    """Return a machine that draws by Vulkan."""
    listed = frozenset({VALIDATION_LAYER} if layers else ())
    graphics = Graphics(vulkan=Device(kind, "a card"), gl=NO_GL, auto="vulkan", layers=listed)
    return replace(machine, graphics=graphics, glslang=True, **more)


def with_gl(machine: Machine, gl: Device = CARD, **more: object) -> Machine:
    """Return a machine that draws by OpenGL alone."""
    return replace(machine, graphics=Graphics(vulkan=NO_VULKAN, gl=gl, auto="gl"), **more)


def without(machine: Machine, vulkan: Device = NO_VULKAN, gl: Device = NO_GL, **more: object) -> Machine:
    """Return a machine on which nothing draws."""
    return replace(machine, graphics=Graphics(vulkan=vulkan, gl=gl), **more)


@pytest.mark.parametrize("machine", ALL, ids=name)
@pytest.mark.parametrize("terminal", [False, True])
@pytest.mark.parametrize("root", [False, True])
@pytest.mark.parametrize("yes", [False, True])
@pytest.mark.parametrize("kind", ["discrete", "software"])
def test_where_vulkan_works_nothing_is_changed(
    machine: Machine, terminal: bool, root: bool, yes: bool, kind: str
) -> None:
    plan = decide(working(machine, kind, terminal=terminal, root=root), yes=yes)
    assert plan == Plan("nothing")


@pytest.mark.parametrize(
    ("root", "sudo", "terminal", "mode", "prefix"),
    [
        (True, False, False, "run", ()),  # a container, CI
        (True, False, True, "ask", ()),
        (False, True, True, "ask", ("sudo",)),
        (False, True, False, "print", ("sudo",)),
        (False, False, True, "print", ()),
        (False, False, False, "print", ()),
    ],
)
@pytest.mark.parametrize("machine", [BOOKWORM, JAMMY, NOBLE, WSL], ids=name)
def test_who_decides_with_apt(
    machine: Machine, root: bool, sudo: bool, terminal: bool, mode: str, prefix: tuple[str, ...]
) -> None:
    plan = decide(replace(machine, root=root, sudo=sudo, terminal=terminal))
    assert (plan.mode, plan.prefix, plan.blocks) == (mode, prefix, "graphics")


@pytest.mark.parametrize("machine", [FEDORA, ARCH], ids=name)
def test_other_package_managers_are_asked_about_at_a_terminal_and_never_run_unasked(machine: Machine) -> None:
    assert decide(replace(machine, terminal=True)).mode == "ask"
    assert decide(machine).mode == "print"
    assert decide(replace(machine, root=True)).mode == "print"


@pytest.mark.parametrize("machine", ALL, ids=name)
@pytest.mark.parametrize("root", [False, True])
@pytest.mark.parametrize("terminal", [False, True])
def test_no_install_leaves_every_machine_alone(machine: Machine, root: bool, terminal: bool) -> None:
    plan = decide(replace(machine, root=root, terminal=terminal), yes=True, install=False)
    assert plan.mode in ("print", "nothing")
    assert plan.missing


@pytest.mark.parametrize("machine", [JAMMY, FEDORA, ARCH, WSL], ids=name)
def test_yes_runs_as_the_user_may(machine: Machine) -> None:
    assert decide(replace(machine, terminal=True), yes=True).prefix == ("sudo",)
    without_terminal = decide(machine, yes=True)  # a password could not be typed
    assert (without_terminal.mode, without_terminal.prefix) == ("run", ("sudo", "-n"))
    assert decide(replace(machine, sudo=False), yes=True).mode == "print"


def test_what_is_installed_per_system() -> None:
    everything = (*APT_VULKAN, *APT_GL, *APT_LAYERS)
    for machine in (BOOKWORM, JAMMY, NOBLE, WSL):
        assert installed(decide(machine)) == everything
    assert last(decide(FEDORA))[:3] == ("dnf", "install", "-y")
    assert {"vulkan-loader", "mesa-vulkan-drivers", "vulkan-validation-layers"} < set(last(decide(FEDORA)))
    assert {"vulkan-icd-loader", "vulkan-swrast", "vulkan-validation-layers"} < set(last(decide(ARCH)))
    assert last(decide(MACOS)) == ("brew", "install", "molten-vk", "vulkan-loader", "vulkan-validationlayers")
    assert last(decide(WINDOWS)) == ("winget", "install", "--id", "KhronosGroup.VulkanSDK")
    assert decide(GENTOO).steps == ()


def test_macos_and_windows_are_told_and_not_changed() -> None:
    for machine in (MACOS, WINDOWS):
        for terminal in (False, True):
            plan = decide(replace(machine, terminal=terminal))
            assert (plan.mode, plan.prefix, plan.blocks) == ("print", (), "graphics")
    assert any("driver of the graphics card" in note for note in decide(WINDOWS).notes)
    assert any("Vulkan SDK" in note for note in decide(WINDOWS).notes)
    assert any("Homebrew" in note for note in decide(replace(MACOS, managers=())).notes)


def test_windows_without_a_compiler_is_told_of_it_though_it_draws() -> None:
    plan = decide(replace(working(WINDOWS), glslang=False))
    assert (plan.mode, plan.blocks) == ("print", "nothing")
    assert "glslangValidator" in plan.notes[0]


def test_an_unknown_linux_is_told_what_to_look_for() -> None:
    plan = decide(GENTOO)
    assert (plan.mode, plan.blocks) == ("nothing", "graphics")
    assert any("Vulkan loader" in note for note in plan.notes)


@pytest.mark.parametrize(
    ("vulkan", "gl", "sentence"),
    [
        (
            NO_VULKAN,
            NO_GL,
            "No Vulkan 1.3 device was found (libvulkan.so.1 is missing); no OpenGL 4.5 was found (libEGL.so.1 and "
            "libGL.so.1 are missing); Strata needs Vulkan 1.3 or OpenGL 4.5 (a driver in software will do).",
        ),
        (
            Device(
                problem="No Vulkan 1.3 device was found (an old card: it offers 1.2): ./strata doctor says what to "
                "install."
            ),
            Device(
                problem="No OpenGL 4.5 was found (it offers OpenGL 4.1): ./strata doctor says what to install."
            ),
            "No Vulkan 1.3 device was found (an old card: it offers 1.2); no OpenGL 4.5 was found (it offers OpenGL "
            "4.1); Strata needs Vulkan 1.3 or OpenGL 4.5 (a driver in software will do).",
        ),
        (
            NO_VULKAN,
            Device(problem="No OpenGL 4.5 was found (libgl not loaded).", libraries=("libGL.so.1",)),
            "No Vulkan 1.3 device was found (libvulkan.so.1 is missing); no OpenGL 4.5 was found (libGL.so.1 is "
            "missing); Strata needs Vulkan 1.3 or OpenGL 4.5 (a driver in software will do).",
        ),
    ],
    ids=["no libraries", "too old", "no libGL"],
)
def test_the_reason_is_the_programs_own_and_names_missing_libraries(
    vulkan: Device, gl: Device, sentence: str
) -> None:
    plan = decide(without(NOBLE, vulkan, gl))
    assert (plan.blocks, plan.missing) == ("graphics", (sentence,))


def test_a_program_that_cannot_be_asked_costs_a_sentence_and_no_installation() -> None:
    machine = replace(NOBLE, root=True, graphics=Graphics(unanswered="no answer came within 180 s"))
    plan = decide(machine, yes=True)
    assert (plan.mode, plan.steps, plan.blocks) == ("nothing", (), "graphics")
    assert plan.missing == ("The graphics drivers could not be asked: no answer came within 180 s.",)


# --- Debian 12 with parts of its own Mesa, and other machines that draw in software ---


@pytest.mark.parametrize(
    "machine",
    [
        without(BOOKWORM),  # no driver
        with_gl(BOOKWORM, PROCESSOR),  # libgl1-mesa-dri, libegl1, libgl1
        without(
            BOOKWORM, gl=Device(problem="No OpenGL 4.5.", libraries=("libGL.so.1",))
        ),  # the same less libgl1
        # mesa-vulkan-drivers, whose device fails the program's self-tests; with and without OpenGL beside it
        without(BOOKWORM, vulkan=Device(problem="llvmpipe cannot be used: it crashed.")),
        replace(
            with_gl(BOOKWORM, PROCESSOR),
            graphics=Graphics(vulkan=Device(problem="llvmpipe crashed."), gl=PROCESSOR, auto="gl"),
            packages=frozenset(APT_PACKAGES),
        ),
    ],
    ids=["no driver", "software OpenGL", "no libGL", "bad Vulkan", "bad Vulkan beside OpenGL"],
)
@pytest.mark.parametrize(
    ("root", "sudo", "terminal", "yes", "mode"),
    [
        (True, False, False, False, "run"),
        (True, False, True, False, "ask"),
        (True, False, True, True, "run"),
        (False, True, True, False, "ask"),
        (False, True, True, True, "run"),
        (False, True, False, False, "print"),
        (False, False, True, True, "print"),
    ],
)
def test_without_vulkan_and_without_a_card_mesa_is_offered(
    machine: Machine, root: bool, sudo: bool, terminal: bool, yes: bool, mode: str
) -> None:
    machine = replace(machine, root=root, sudo=sudo, terminal=terminal)
    plan = decide(machine, yes=yes)
    assert plan.mode == mode
    assert {"mesa-vulkan-drivers", "libvulkan1", "libgl1", "libegl1", *APT_LAYERS} - machine.packages <= set(
        installed(plan)
    )
    assert any(step.file and step.file[0] == PIN_FILE for step in plan.steps)  # of a Mesa that is new enough
    assert plan.blocks == ("nothing" if machine.graphics.auto else "graphics")
    told = decide(machine, yes=yes, install=False)
    assert (told.mode, told.missing) == ("print", plan.missing)


@pytest.mark.parametrize("machine", [JAMMY, NOBLE, WSL, FEDORA, ARCH], ids=name)
def test_where_opengl_draws_on_the_processor_vulkan_is_offered_and_nothing_waits_for_it(
    machine: Machine,
) -> None:
    plan = decide(with_gl(machine, PROCESSOR, terminal=True))
    assert (plan.mode, plan.blocks) == ("ask", "nothing")
    assert {"mesa-vulkan-drivers", "vulkan-swrast"} & set(last(plan))
    assert plan.missing == (
        "No Vulkan 1.3 device was found (libvulkan.so.1 is missing), so Strata draws with OpenGL's software driver "
        "(llvmpipe).",
    )


def test_on_windows_opengl_is_left_alone_since_no_package_of_ours_has_a_driver() -> None:
    for gl in (CARD, PROCESSOR):
        for yes in (False, True):
            plan = decide(with_gl(WINDOWS, gl), yes=yes)
            assert (plan.mode, plan.steps, plan.blocks) == ("nothing", (), "nothing")


# --- A card that draws by OpenGL ---


@pytest.mark.parametrize(
    "machine",
    [
        with_gl(NOBLE, terminal=True),
        with_gl(BOOKWORM, root=True),  # without a terminal: a container, where a step would be done unasked
        with_gl(NOBLE, Device("integrated", "a card")),
        with_gl(FEDORA, terminal=True),
        with_gl(ARCH, terminal=True),
        with_gl(WSL),
    ],
    ids=name,
)
@pytest.mark.parametrize("install", [False, True])
def test_where_a_card_draws_by_opengl_nothing_is_changed_and_one_sentence_says_what_yes_would_add(
    machine: Machine, install: bool
) -> None:
    plan = decide(machine, install=install)
    assert replace(plan, notes=()) == Plan("nothing")
    (note,) = plan.notes
    assert note.startswith("Strata draws with OpenGL here (a card); Vulkan 1.3 would add")
    assert note.endswith("./strata --yes run 1 installs Vulkan's loader and Mesa's drivers.")


@pytest.mark.parametrize("machine", [with_gl(WINDOWS), with_gl(GENTOO, root=True)], ids=name)
def test_where_no_command_of_ours_brings_vulkan_none_is_named(machine: Machine) -> None:
    (note,) = decide(machine).notes
    assert note.startswith("Strata draws with OpenGL here (a card); Vulkan 1.3 would add")
    assert "--yes" not in note


@pytest.mark.parametrize("machine", [BOOKWORM, NOBLE, WSL, FEDORA, ARCH], ids=name)
def test_yes_adds_vulkan_to_a_card_that_draws_by_opengl(machine: Machine) -> None:
    plan = decide(with_gl(machine, root=True), yes=True)
    assert (plan.mode, plan.blocks) == ("run", "nothing")
    assert {"mesa-vulkan-drivers", "vulkan-swrast"} & set(last(plan))
    assert plan.missing == (
        "No Vulkan 1.3 device was found (libvulkan.so.1 is missing), so Strata draws with OpenGL (a card).",
    )


@pytest.mark.parametrize("gl", [CARD, PROCESSOR], ids=["a card", "software"])
def test_in_ci_vulkan_and_its_layers_are_wanted_though_opengl_works(gl: Device) -> None:
    plan = decide(with_gl(NOBLE, gl, ci=True, root=True))
    assert (plan.mode, plan.blocks) == ("run", "graphics")
    assert installed(plan) == (*APT_VULKAN, *APT_GL, *APT_LAYERS, *APT_WINDOW)
    assert "in CI Strata needs Vulkan 1.3" in plan.missing[0]


# --- Python itself ---


def test_a_python_without_venv_is_helped_first_and_with_nothing_more() -> None:
    for machine, package in (
        (BOOKWORM, "python3.11-venv"),
        (JAMMY, "python3.11-venv"),
        (NOBLE, "python3.12-venv"),
    ):
        plan = decide_environment(replace(machine, can_make_venv=False, terminal=True, sudo=True))
        assert (plan.mode, plan.blocks) == ("ask", "everything")
        assert installed(plan) == (package,)
        assert decide_environment(machine) == Plan("nothing")
    for machine in (FEDORA, GENTOO, MACOS, WINDOWS):
        plan = decide_environment(replace(machine, can_make_venv=False))
        assert (plan.mode, plan.steps, plan.blocks) == ("nothing", (), "everything")
        assert "no module venv" in plan.missing[0]


# --- Debian 12 and its backports ---


def test_debian_12_takes_mesa_from_backports_on_the_same_host() -> None:
    plan = decide(replace(BOOKWORM, root=True))
    update, source, pin, read, install = plan.steps
    assert update.command == ("apt-get", "update")
    assert update.may_fail  # somebody's third source being down must not stop us
    assert source.file is not None
    assert source.file[0] == BACKPORTS_FILE
    for line in ("URIs: http://mirror.example/debian", "Suites: bookworm-backports", "Signed-By: /k"):
        assert line in source.file[1].splitlines()
    assert pin.file is not None
    assert pin.file[0] == PIN_FILE
    assert "Package: src:mesa src:libdrm\nPin: release n=bookworm-backports\nPin-Priority: 500" in pin.file[1]
    assert "Package: *\nPin: release n=bookworm-backports\nPin-Priority: 100" in pin.file[1]
    assert read.instead is not None
    assert read.instead.command == ("rm", "-f", BACKPORTS_FILE, PIN_FILE)
    assert "older Mesa" in read.otherwise
    assert "mesa-vulkan-drivers" in install.command


def test_an_owners_backports_are_used_with_the_owners_priorities() -> None:
    backports = replace(DEBIAN, suites=("bookworm-backports",))
    plan = decide(replace(BOOKWORM, sources=(DEBIAN, backports)))
    files = [step.file for step in plan.steps if step.file]
    assert [path for path, _ in files] == [PIN_FILE]
    assert "Package: *" not in files[0][1]


@pytest.mark.parametrize(
    "machine",
    [
        JAMMY,
        NOBLE,
        replace(BOOKWORM, release="13", codename="trixie"),
        replace(BOOKWORM, sources=()),  # nobody knows where this machine's Debian comes from
        working(BOOKWORM, ci=True),
    ],
)
def test_others_get_no_source(machine: Machine) -> None:
    assert not any(step.file for step in decide(machine).steps)


def test_the_printed_commands_can_be_typed() -> None:
    plan = decide(replace(BOOKWORM, sudo=True))
    update, source, pin, read, install = plan.commands()
    assert read.endswith(f" || sudo rm -f {BACKPORTS_FILE} {PIN_FILE}")
    assert update == "sudo apt-get update"
    assert source.startswith(f"sudo tee {BACKPORTS_FILE} >/dev/null <<'END'\n")
    assert source.endswith("\nEND")
    assert pin.startswith(f"sudo tee {PIN_FILE}")
    assert install.startswith("sudo apt-get ")


# --- CI, and what is half there ---


def test_ci_adds_layers_and_a_screen_where_graphics_work_already() -> None:
    machine = working(BOOKWORM, ci=True, root=True)
    plan = decide(machine)
    assert (plan.mode, plan.blocks) == ("run", "nothing")
    assert installed(plan) == (*APT_LAYERS, *APT_WINDOW)
    has_layers = working(BOOKWORM, layers=True, ci=True, root=True)
    assert installed(decide(has_layers)) == APT_WINDOW
    assert decide(replace(has_layers, packages=frozenset(APT_PACKAGES))) == Plan("nothing")


def test_ci_on_debian_gets_a_browser_and_goes_on_without_one() -> None:
    machine = working(BOOKWORM, ci=True, root=True)
    (step,) = (one for one in decide(machine).steps if "chromium" in one.command)
    assert step.may_fail
    all_else = working(BOOKWORM, layers=True, ci=True, root=True, packages=frozenset(APT_WINDOW))
    assert [one.command[-1] for one in decide(all_else).steps] == ["update", "chromium"]
    for other in (replace(machine, ci=False), working(NOBLE, ci=True, root=True)):
        assert not any("chromium" in one.command for one in decide(other).steps)


def test_a_mesa_that_is_installed_and_draws_nothing_is_replaced_by_a_newer_one() -> None:
    machine = without(BOOKWORM, packages=frozenset(APT_PACKAGES))
    assert set(APT_VULKAN) < set(installed(decide(machine)))
