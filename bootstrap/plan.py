"""Decide what a machine needs before Strata can draw on it: a pure function from its description to a plan.

Nothing here looks at the machine or changes it; `machine.py` describes, `run.py` does.
"""

from __future__ import annotations

import shlex
from collections.abc import Iterator
from dataclasses import dataclass
from typing import Literal

from bootstrap import apt_sources
from bootstrap.graphics import why_not
from bootstrap.machine import VALIDATION_LAYER, Machine

Mode = Literal["nothing", "run", "ask", "print"]
Blocks = Literal["nothing", "graphics", "everything"]

APT_VULKAN = ("libvulkan1", "mesa-vulkan-drivers")
# libegl1 and libgl1 bring libEGL.so.1 and libGL.so.1, which the program opens by name; the rest is Mesa behind them.
APT_GL = ("libegl1", "libgl1", "libegl-mesa0", "libglx-mesa0", "libgl1-mesa-dri", "libgbm1")
APT_LAYERS = ("vulkan-validationlayers",)
# A screen in memory, and what GLFW opens by name when it makes a window on it.
APT_WINDOW = ("xvfb", "libx11-xcb1", "libxcursor1", "libxi6", "libxinerama1", "libxrandr2")
# On Ubuntu this name brings a snap, which containers cannot run.
APT_BROWSER = ("chromium",)
APT_PACKAGES = (*APT_VULKAN, *APT_GL, *APT_LAYERS, *APT_WINDOW, *APT_BROWSER)
"""All that a plan may ask apt for, so that `machine.describe` can say what is there already."""

# Another apt at work is waited for, two minutes at most.
APT_INSTALL = ("apt-get", "-o", "DPkg::Lock::Timeout=120", "install", "-y", "--no-install-recommends")
BACKPORTED = "src:mesa src:libdrm"  # Mesa, and the library below it whose version it asks for
PACKAGES = {
    "dnf": {
        "vulkan": ("vulkan-loader", "mesa-vulkan-drivers", "mesa-libEGL"),
        "layers": ("vulkan-validation-layers",),
    },
    "pacman": {
        "vulkan": ("vulkan-icd-loader", "vulkan-swrast", "mesa"),
        "layers": ("vulkan-validation-layers",),
    },
    "brew": {"vulkan": ("molten-vk", "vulkan-loader"), "layers": ("vulkan-validationlayers",)},
}
VULKAN, GL = "Vulkan 1.3 device", "OpenGL 4.5"
INSTALL = {
    "dnf": ("dnf", "install", "-y"),
    "pacman": ("pacman", "-S", "--needed", "--noconfirm"),
    "brew": ("brew", "install"),
}


@dataclass(frozen=True)
class Step:
    """One change to the system: a command, or a file to write, with its reason."""

    reason: str
    command: tuple[str, ...] = ()
    file: tuple[str, str] | None = None  # (path, text), in place of a command
    may_fail: bool = False
    instead: Step | None = None  # done when the command fails; the plan then goes on
    otherwise: str = ""  # what that means, in one sentence

    def shell(self, prefix: str = "") -> str:
        """Return the step as a line (or a here-document) for a shell; `prefix` is "sudo " or nothing."""
        if self.file is not None:
            path, text = self.file
            return f"{prefix}tee {shlex.quote(path)} >/dev/null <<'END'\n{text}END"
        line = prefix + shlex.join(self.command)
        return line if self.instead is None else f"{line} || {self.instead.shell(prefix)}"


_UPDATE = Step("Bring apt's lists of packages up to date.", ("apt-get", "update"), may_fail=True)


@dataclass(frozen=True)
class Plan:
    """What is missing, what would help, and whether it is done, asked about or only shown."""

    mode: Mode
    steps: tuple[Step, ...] = ()
    prefix: tuple[str, ...] = ()  # put before every command: ("sudo",) or nothing
    missing: tuple[str, ...] = ()  # sentences for the user
    notes: tuple[str, ...] = ()  # sentences that ask for nothing
    blocks: Blocks = "nothing"  # what cannot be done without the steps

    def commands(self) -> Iterator[str]:
        """Yield every step as the user would type it."""
        prefix = "".join(word + " " for word in self.prefix)
        return (step.shell(prefix) for step in self.steps)


def decide_environment(machine: Machine, *, yes: bool = False, install: bool = True) -> Plan:
    """Return what this Python needs before it can make `.venv`, in which the program is asked for the rest."""
    if machine.can_make_venv:
        return Plan("nothing")
    missing = ("This Python cannot make virtual environments: it has no module venv or ensurepip.",)
    steps: tuple[Step, ...] = ()
    if "apt-get" in machine.managers:
        # Python's own name is in the package's, so that a second Python (Ubuntu 22.04: python3.11) gets its own.
        package = "python{}.{}-venv".format(*machine.python)
        steps = (_UPDATE, Step("Python's virtual environments.", (*APT_INSTALL, package)))
    mode, prefix = _mode(machine, yes, install) if steps else ("nothing", ())
    return Plan(mode, steps, prefix, missing, blocks="everything")


def decide(machine: Machine, *, yes: bool = False, install: bool = True) -> Plan:
    """Return the plan for a machine; `yes` agrees in advance, `install=False` leaves the system alone.

    Vulkan is the primary backend. A machine without it gets Mesa's, which also draws on the processor, unless a
    graphics card draws by OpenGL: that machine is changed only for `yes`, and a sentence says what that would add.
    """
    graphics = machine.graphics
    if graphics.unanswered:
        sentence = f"The graphics drivers could not be asked: {graphics.unanswered}."
        return Plan("nothing", missing=(sentence,), blocks="graphics")
    by_vulkan, draws = bool(graphics.vulkan.kind), bool(graphics.auto)
    # In CI the tests ask for Vulkan. On Windows no package of ours brings it: the card's own driver does.
    left_alone = (
        draws and not machine.ci and (machine.system == "win32" or (graphics.in_hardware and not yes))
    )
    wants = set() if by_vulkan or left_alone else {"vulkan", "layers"}
    if machine.system == "win32" and (by_vulkan or not draws) and not machine.glslang:
        wants.add("compiler")  # of shaders for Vulkan: OpenGL's drivers have their own
    if machine.ci:
        wants |= ({"layers"} if VALIDATION_LAYER not in graphics.layers else set()) | {"window"}
    missing = _what_is_missing(machine, wants)
    blocks: Blocks = "nothing" if by_vulkan or (draws and not machine.ci) else "graphics"
    steps = _steps(machine, wants)
    notes = _notes(machine, installs=bool(steps))
    if not steps:
        return Plan("nothing", missing=missing, notes=notes, blocks=blocks)
    mode, prefix = _mode(machine, yes, install)
    return Plan(mode, steps, prefix, missing, notes, blocks)


def _mode(machine: Machine, yes: bool, install: bool) -> tuple[Mode, tuple[str, ...]]:
    """Return who decides, and what stands before each command."""
    # Homebrew refuses to run as root, and winget asks by itself.
    by_user = machine.system != "linux" or machine.root
    shown = () if by_user or not machine.sudo else ("sudo",)
    if not install or not (by_user or machine.sudo):
        return "print", shown
    if machine.terminal and machine.system == "linux" and not yes:
        return "ask", shown
    if yes or (machine.root and "apt-get" in machine.managers):
        # Without a terminal nobody can type a password: -n fails at once where one would be asked for.
        return "run", (*shown, "-n") if shown and not machine.terminal else shown
    return "print", shown


def _what_is_missing(machine: Machine, wants: set[str]) -> tuple[str, ...]:
    graphics = machine.graphics
    if graphics.vulkan.kind:
        missing = []
    elif machine.ci:
        missing = [f"{why_not(graphics.vulkan, VULKAN)}, and in CI Strata needs Vulkan 1.3."]
    elif not graphics.auto:
        no_gl = why_not(graphics.gl, GL)
        missing = [
            f"{why_not(graphics.vulkan, VULKAN)}; {no_gl[0].lower()}{no_gl[1:]}; "
            "Strata needs Vulkan 1.3 or OpenGL 4.5 (a driver in software will do)."
        ]
    elif "vulkan" in wants:
        how = "OpenGL" if graphics.in_hardware else "OpenGL's software driver"
        missing = [f"{why_not(graphics.vulkan, VULKAN)}, so Strata draws with {how} ({graphics.gl.name})."]
    else:
        missing = []
    if machine.ci and VALIDATION_LAYER not in graphics.layers:
        missing.append("The Vulkan validation layers are missing, and in CI every test runs under them.")
    return tuple(missing)


def _notes(machine: Machine, installs: bool) -> tuple[str, ...]:
    graphics = machine.graphics
    by_vulkan, draws = bool(graphics.vulkan.kind), bool(graphics.auto)
    by_glslang = ("The GLSL compiler, glslangValidator, comes with the Vulkan SDK.",)
    if by_vulkan:
        return by_glslang if machine.system == "win32" and not machine.glslang else ()
    notes = []
    if graphics.in_hardware:
        note = (
            f"Strata draws with OpenGL here ({graphics.gl.name}); Vulkan 1.3 would add the paths that OpenGL lacks, "
            "such as mesh shaders, ray queries and bindless textures, where the driver has them"
        )
        if machine.system == "win32":
            note += ": it comes with the newest driver from the maker of the card"
        elif not installs and _steps(machine, {"vulkan", "layers"}):
            note += ": ./strata --yes run 1 installs Vulkan's loader and Mesa's drivers"
        return (f"{note}.",)
    if machine.system == "win32":
        notes.append("Vulkan comes with the driver of the graphics card: get the newest from its maker.")
        notes += by_glslang if not draws and not machine.glslang else ()
    elif machine.system == "darwin":
        if "brew" not in machine.managers:
            notes.append("The command needs Homebrew; the Vulkan SDK for macOS brings the same libraries.")
    elif machine.wsl:
        notes.append(
            "Under WSL a Mesa that has the driver dzn draws on Windows' card, any other on the processor."
        )
    else:
        notes.append(
            "Mesa is for AMD, Intel and the processor; for NVIDIA's cards install NVIDIA's own driver."
        )
    known = {"apt-get", "dnf", "pacman"} & set(machine.managers)
    if machine.system == "linux" and not known:
        notes.append("Install the Vulkan loader, Mesa's Vulkan drivers and the validation layers.")
    return tuple(notes)


def _steps(machine: Machine, wants: set[str]) -> tuple[Step, ...]:
    if machine.system == "win32":
        if not wants & {"compiler", "layers"}:
            return ()
        sdk = ("winget", "install", "--id", "KhronosGroup.VulkanSDK")
        return (Step("The GLSL compiler and the validation layers.", sdk),)
    if machine.system == "darwin":
        return _one_command("brew", wants, "Vulkan on top of Apple's Metal")
    if "apt-get" in machine.managers:
        return _apt_steps(machine, wants)
    for manager in ("dnf", "pacman"):
        if manager in machine.managers:
            return _one_command(manager, wants, "Vulkan's loader and Mesa's drivers")
    return ()


def _one_command(manager: str, wants: set[str], what: str) -> tuple[Step, ...]:
    names = PACKAGES[manager]
    packages = [package for want, some in names.items() if want in wants for package in some]
    reason = what if "vulkan" in wants else "The validation layers"
    return (Step(f"{reason}.", (*INSTALL[manager], *packages)),) if packages else ()


def _apt_steps(machine: Machine, wants: set[str]) -> tuple[Step, ...]:
    """Return the steps for Debian, Ubuntu and what is made from them; on Debian 12 with Mesa from its backports."""
    wished: dict[str, tuple[str, ...]] = {}
    if "vulkan" in wants:
        wished["Vulkan's loader, Mesa's drivers (one of them draws on the processor)"] = APT_VULKAN + APT_GL
    if "layers" in wants:
        wished["the validation layers"] = APT_LAYERS
    if "window" in wants:
        wished["a screen in memory for the tests of windows"] = APT_WINDOW
    # Mesa is named even where an older one is installed: the point may be its newer version.
    newer = APT_VULKAN + APT_GL if "vulkan" in wants else ()
    lists = {
        why: [p for p in some if p in newer or p not in machine.packages] for why, some in wished.items()
    }
    packages = [package for some in lists.values() for package in some]
    browser = _browser(machine)
    if not packages and browser is None:
        return ()
    steps = [_UPDATE]
    if "vulkan" in wants and machine.distribution == "debian" and machine.codename == "bookworm":
        steps += _backports(machine)
    if browser:
        steps.append(browser)
    if packages:
        reason = "; ".join(why for why, some in lists.items() if some)
        steps.append(Step(reason[0].upper() + reason[1:] + ".", (*APT_INSTALL, *packages)))
    return tuple(steps)


def _browser(machine: Machine) -> Step | None:
    """Return the step that brings a browser for the tests of the site's pages; None where it is, or cannot come."""
    missing = [package for package in APT_BROWSER if package not in machine.packages]
    if not machine.ci or machine.distribution != "debian" or not missing:
        return None
    reason = "A browser for the tests of the site's pages, which are skipped without one."
    return Step(reason, (*APT_INSTALL, *missing), may_fail=True)


def _backports(machine: Machine) -> list[Step]:
    """Return the steps that make Debian 12's apt take Mesa, and nothing else, from its backports."""
    codename = machine.codename
    known = apt_sources.has_backports(machine.sources, codename)
    pin = Step(
        "Take Mesa and its libdrm from the backports, and nothing else.",
        file=(apt_sources.PIN_FILE, apt_sources.pin_of(codename, BACKPORTED, hold_the_rest=not known)),
    )
    if known:
        return [pin]
    text = apt_sources.backports_of(machine.sources, codename)
    if text is None:
        return []
    remove = Step("Take that back.", ("rm", "-f", apt_sources.BACKPORTS_FILE, apt_sources.PIN_FILE))
    # Reads the one new list only: another source that fails is none of our business.
    only = ("-o", f"Dir::Etc::SourceList={apt_sources.BACKPORTS_FILE}", "-o", "Dir::Etc::SourceParts=-")
    keep = ("-o", "APT::Get::List-Cleanup=0")
    return [
        Step(
            "Debian 12's own Mesa is 22.3; its backports, on the same host, have 25.0 with mesh shaders and rays.",
            file=(apt_sources.BACKPORTS_FILE, text),
        ),
        pin,
        Step(
            "Read the list of the backports.",
            ("apt-get", "update", "--error-on=any", *only, *keep),
            instead=remove,
            otherwise=(
                "Debian's backports cannot be reached, so its own older Mesa is taken, which has fewer features: "
                "./strata doctor says how each chapter runs on it."
            ),
        ),
    ]
