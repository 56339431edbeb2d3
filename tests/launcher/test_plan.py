"""What the bootstrap decides, as tables: one machine, one expected plan."""

from __future__ import annotations

from dataclasses import replace

import pytest

from bootstrap.apt_sources import BACKPORTS_FILE, PIN_FILE, Source
from bootstrap.machine import VALIDATION_LAYER, Machine
from bootstrap.plan import APT_GL, APT_LAYERS, APT_PACKAGES, APT_VULKAN, APT_WINDOW, Plan, decide

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


def working(machine: Machine, **more: object) -> Machine:
    return replace(machine, vulkan=(1, 3), vulkan_device="a card", glslang=True, **more)


@pytest.mark.parametrize("machine", ALL, ids=name)
@pytest.mark.parametrize("terminal", [False, True])
@pytest.mark.parametrize("root", [False, True])
@pytest.mark.parametrize("yes", [False, True])
def test_where_graphics_work_nothing_is_changed(
    machine: Machine, terminal: bool, root: bool, yes: bool
) -> None:
    plan = decide(working(machine, terminal=terminal, root=root), yes=yes)
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
    ("machine", "sentence"),
    [
        (replace(NOBLE, vulkan=(1, 2), vulkan_device="an old card"), "an old card offers Vulkan 1.2"),
        (NOBLE, "No Vulkan device was found"),
    ],
)
def test_the_reason_is_given(machine: Machine, sentence: str) -> None:
    plan = decide(machine)
    assert plan.blocks == "graphics"
    assert any(sentence in text for text in plan.missing)


# --- OpenGL alone ---


def with_gl(machine: Machine, version: tuple[int, int] = (4, 6), **more: object) -> Machine:
    return replace(machine, gl=version, gl_device="a card", **more)


@pytest.mark.parametrize(
    "machine",
    [
        with_gl(NOBLE, terminal=True),
        with_gl(BOOKWORM, root=True),  # without a terminal: a container, where a step would be done unasked
        with_gl(WINDOWS),
        with_gl(NOBLE, (4, 5)),
        with_gl(NOBLE, vulkan=(1, 2), vulkan_device="an old card"),
        with_gl(GENTOO, root=True),
        with_gl(FEDORA, terminal=True),
        with_gl(WSL),
    ],
    ids=name,
)
@pytest.mark.parametrize("yes", [False, True])
def test_where_opengl_works_nothing_is_changed_and_the_user_hears_what_vulkan_adds(
    machine: Machine, yes: bool
) -> None:
    plan = decide(machine, yes=yes)
    assert replace(plan, notes=()) == Plan("nothing")
    version = ".".join(map(str, machine.gl or ()))
    assert plan.notes[0].startswith(f"Strata draws with OpenGL {version} here (a card); Vulkan 1.3 would add")
    assert not any("glslangValidator" in note or "Install the Vulkan" in note for note in plan.notes)


@pytest.mark.parametrize(
    "machine", [with_gl(NOBLE, (4, 4)), with_gl(MACOS, (4, 1)), with_gl(WINDOWS, (3, 3)), NOBLE], ids=name
)
def test_an_old_opengl_is_no_device(machine: Machine) -> None:
    plan = decide(machine)
    assert plan.blocks == "graphics"
    assert plan.steps
    assert "Strata needs Vulkan 1.3 or OpenGL 4.5" in plan.missing[0]
    assert not any("draws with OpenGL" in note for note in plan.notes)


def test_in_ci_vulkan_and_its_layers_are_wanted_though_opengl_works() -> None:
    plan = decide(with_gl(NOBLE, ci=True, root=True))
    assert (plan.mode, plan.blocks) == ("run", "graphics")
    assert installed(plan) == (*APT_VULKAN, *APT_GL, *APT_LAYERS, *APT_WINDOW)
    assert "in CI Strata needs Vulkan 1.3" in plan.missing[0]


def test_a_python_without_venv_is_helped_where_opengl_works_and_with_nothing_more() -> None:
    plan = decide(with_gl(NOBLE, can_make_venv=False))
    assert plan.blocks == "everything"
    assert installed(plan) == ("python3.12-venv",)


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
    has_layers = replace(machine, layers=frozenset({VALIDATION_LAYER}))
    assert installed(decide(has_layers)) == APT_WINDOW
    assert decide(replace(has_layers, packages=frozenset(APT_PACKAGES))) == Plan("nothing")


def test_ci_on_debian_gets_a_browser_and_goes_on_without_one() -> None:
    machine = working(BOOKWORM, ci=True, root=True)
    (step,) = (one for one in decide(machine).steps if "chromium" in one.command)
    assert step.may_fail
    all_else = replace(machine, layers=frozenset({VALIDATION_LAYER}), packages=frozenset(APT_WINDOW))
    assert [one.command[-1] for one in decide(all_else).steps] == ["update", "chromium"]
    for other in (replace(machine, ci=False), working(NOBLE, ci=True, root=True)):
        assert not any("chromium" in one.command for one in decide(other).steps)


def test_a_machine_with_an_old_mesa_that_draws_too_little_gets_the_newer_one() -> None:
    machine = replace(BOOKWORM, vulkan=(1, 1), packages=frozenset(APT_PACKAGES))
    assert set(APT_VULKAN) < set(installed(decide(machine)))


def test_a_python_without_venv_blocks_everything_and_its_own_package_is_named() -> None:
    for machine, package in (
        (BOOKWORM, "python3.11-venv"),
        (JAMMY, "python3.11-venv"),
        (NOBLE, "python3.12-venv"),
    ):
        plan = decide(replace(working(machine), can_make_venv=False))
        assert plan.blocks == "everything"
        assert installed(plan) == (package,)
