"""Set Strata up on first use, by the plan of `plan.py`, and hand over to the command line in its own environment."""

from __future__ import annotations

import argparse
import os
import shlex
import subprocess
import sys
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import replace
from pathlib import Path

from bootstrap import graphics, machine, offline
from bootstrap.environment import COMPLETE, FOUND, NOTHING, Environment, SetupError, make, only_one, works
from bootstrap.graphics import Graphics
from bootstrap.plan import APT_PACKAGES, Plan, Step, decide, decide_environment

ROOT = Path(__file__).resolve().parents[1]

WITHOUT_DEVICE = (
    *(
        "assets",
        "bundle",
        "carry",
        "convert",
        "diff",
        "docs",
        "doctor",
        "exercise",
        "explain",
        "fork",
        "list",
        "new",
    ),
    *("--help", "--version"),
)
"""Commands that are of use where nothing can be drawn; Strata without a command prints its help."""


def main(arguments: list[str]) -> int:
    """Set up what is missing and start Strata; return an exit code, 2 when the user has to do something first."""
    try:
        options, rest = parse(arguments)
        environment = Environment(ROOT)
        environment.check_readable()
        other = offline.other_python(vars(options)["from"], environment)
        if other is not None:
            return become([*other, "-I", str(ROOT / "bootstrap" / "__main__.py"), *arguments])
        command = rest[0] if rest and not {"--help", "-h"} & set(rest) else "--help"
        set_up(environment, options, command)
        return start(rest)
    except SetupError as error:
        say(str(error))
        return 2
    except KeyboardInterrupt:
        say("Stopped; the next start of ./strata sets up what is still missing.")
        return 130
    except OSError as error:
        say(
            f"The set-up stopped at {error.filename or ROOT}: {error.strerror or error}; change that and start again."
        )
        return 2
    except subprocess.CalledProcessError as error:
        say(f"The environment {ROOT / '.venv'} is broken ({error.cmd[0]} failed): delete it and start again.")
        return 2


FLAGS = {
    "--yes": "agree in advance to what the set-up would change on this system",
    "--no-install": "change nothing on this system outside the clone",
    "--extras": "install all optional packages too, for development and reference",
    "--latest": "install the newest Python packages, not those of the lock",
}


def parse(arguments: list[str]) -> tuple[argparse.Namespace, list[str]]:
    """Return the options of the set-up, which stand before the command, and the words for Strata itself.

    Beside the flags there is `--from FILE`: set up from a bundle, without a network.
    """
    found: dict[str, bool | str | None] = {flag[2:].replace("-", "_"): False for flag in FLAGS}
    found["from"] = None
    left = list(arguments)
    while left:
        name, equals, value = left[0].partition("=")
        if left[0] in FLAGS:
            found[name[2:].replace("-", "_")] = True
        elif name == "--from":
            if not equals:
                del left[0]
                value = left[0] if left else ""
            if not value:
                raise SetupError("--from needs the file of a bundle: ./strata --from FILE run 1.")
            found["from"] = value
        else:
            break
        del left[0]
    if found["latest"] and found["from"]:
        raise SetupError(
            "--latest takes packages from a network and --from from a bundle: leave one of them out."
        )
    return argparse.Namespace(**found), left


def set_up(environment: Environment, options: argparse.Namespace, command: str) -> None:
    """Bring system and environment to what `command` needs; raise SetupError when Strata cannot go on."""
    source, ci = vars(options)["from"], machine.in_ci()
    plan = Plan("nothing")
    with only_one(say), ExitStack() as stack:
        _, extent, found = environment.stamp()
        everything = options.extras or ci or extent == "all"
        packages = options.latest or not environment.has_packages(everything)
        # What was found once is believed; where nothing could draw, every command that draws looks again.
        settled = found in ((COMPLETE,) if ci else (FOUND, COMPLETE))
        looks = options.yes or not (settled or (found == NOTHING and command in WITHOUT_DEVICE))
        if not packages and not looks and source is None:
            return  # another start did it, or the launcher could not tell
        # A bundle is for a machine without a network: then the system is changed only for --yes.
        install = not options.no_install and (source is None or options.yes)
        bundle = stack.enter_context(offline.opened(source, environment, everything)) if source else None
        if packages:
            can_make_environment(environment, options.yes, install)
            supply = stack.enter_context(bundle.packages(say)) if bundle else None
            make(environment, everything, options.latest, say, supply)
        if looks:
            say("Looking at the graphics drivers of this machine.")
            plan = draw_with(environment, options.yes, install)
            drawing = COMPLETE if ci else FOUND
            environment.note_graphics(NOTHING if plan.blocks == "graphics" else drawing)
            if source is not None and (plan.missing or plan.steps):
                plan = replace(plan, notes=(*plan.notes, offline.SYSTEM_PACKAGES))
        if packages:
            say("Strata is set up; this happens once.")
        if bundle:
            bundle.place_the_rest(say)
    if plan.blocks == "graphics" and command not in WITHOUT_DEVICE and not options.no_install:
        raise SetupError(explain(plan))
    text = summary(plan) if options.no_install else explain(plan)
    if text and command != "doctor":  # which says the same itself
        say(text)


def can_make_environment(environment: Environment, yes: bool, install: bool) -> None:
    """Bring this Python to where it can make `.venv`; raise SetupError where it cannot."""
    if works(environment.python):
        return
    here = machine.describe(APT_PACKAGES, Graphics())
    after = carry_out(decide_environment(here, yes=yes, install=install), lambda: Plan("nothing"))
    if after.blocks == "everything":
        raise SetupError(explain(after))


def draw_with(environment: Environment, yes: bool, install: bool) -> Plan:
    """Find out what draws, do what the plan for that says, and return what is still to be done."""

    def look() -> machine.Machine:
        return machine.describe(APT_PACKAGES, graphics.ask(environment.python, say))

    plan = decide(look(), yes=yes, install=install)
    if plan.blocks == "graphics":
        environment.note_graphics(NOTHING)  # first: an installation may fail or be stopped
    return carry_out(plan, lambda: decide(look(), yes=yes, install=False))


def carry_out(plan: Plan, look: Callable[[], Plan]) -> Plan:
    """Do the steps that the plan says to do, or that the user agrees to; return what is still to be done.

    After the steps `look` decides anew: what was installed counts only if it works.
    """
    if plan.mode == "ask":
        say(explain(plan))
        sys.stderr.write(f"strata: Do this now ({len(plan.steps)} steps)? [y/N] ")
        sys.stderr.flush()
        if sys.stdin.readline().strip().lower() not in ("y", "yes"):
            sentence = "Nothing was installed; the commands above help."
            return Plan("nothing", missing=(sentence,), blocks=plan.blocks)
    elif plan.mode != "run":
        return plan
    try:
        for step in plan.steps:
            perform(step, plan.prefix)
    except SetupError as error:
        if plan.blocks != "nothing" or machine.in_ci():
            raise
        return Plan("nothing", missing=(str(error),))  # it draws all the same
    after = look()
    if after.blocks == "nothing" and not after.missing:
        return Plan("nothing")
    still = (
        f"Everything was installed, and still: {' '.join(after.missing)}",
        "`vulkaninfo --summary` of the package vulkan-tools tells what the drivers say, and ./strata --no-install "
        "changes nothing more.",
    )
    return Plan("nothing", missing=still, blocks=after.blocks)


def perform(step: Step, prefix: tuple[str, ...]) -> None:
    """Do one step; raise SetupError where it fails and neither may fail nor has something in its place."""
    command, given = step.command, ""
    if step.file is not None:
        path, given = step.file
        command = ("tee", path)
    say(f"{step.reason}\n  $ {shlex.join((*prefix, *command))}")
    try:
        done = subprocess.run(
            (*prefix, *command),
            input=given,
            # Somebody who looks on sees what it does; in a log its words are of use when it fails.
            stdout=sys.stderr if sys.stderr.isatty() else subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            env={**os.environ, "DEBIAN_FRONTEND": "noninteractive"},
            check=False,
        )
        failed, output = done.returncode != 0, done.stdout or ""
    except OSError as error:
        failed, output = True, str(error)
    if not failed or step.may_fail:
        return
    if step.instead is None:
        lines = "".join(f"\n  {line}" for line in output.strip().splitlines()[-12:])
        raise SetupError(f"`{shlex.join(command)}` failed; ./strata --no-install goes on without.{lines}")
    say(step.otherwise)
    perform(step.instead, prefix)


def explain(plan: Plan) -> str:
    """Return what is missing, what to type and why, and what else there is to know."""
    lines = [*plan.missing]
    if plan.steps:
        by_root = "" if plan.prefix or plan.mode == "ask" or sys.platform != "linux" else ", as root"
        lines += [f"These commands help{by_root}:", ""]
        # Not indented, so that all of them can be copied into a shell at once: a here-document keeps every space.
        for step, command in zip(plan.steps, plan.commands(), strict=True):
            lines += [f"# {step.reason}", command]
        lines.append("")
    lines += plan.notes
    return "\n".join(lines)


def summary(plan: Plan) -> str:
    """Return in one sentence what is missing, "" where nothing is."""
    if not plan.missing:
        return plan.notes[0] if plan.notes else ""
    text = " ".join(plan.missing)
    return f"{text.removesuffix('.')}; ./strata --yes run 1 installs what is missing." if plan.steps else text


def say(text: str) -> None:
    """Tell the user, beside the program's own output."""
    sys.stderr.write(f"strata: {text}\n")
    sys.stderr.flush()


def start(arguments: list[str]) -> int:
    """Become the command line (on Windows: run it and return its exit code)."""
    # -P: a file of the user's folder that is called like a module is not taken for one.
    command = [str(Environment(ROOT).python), "-P", "-m", "chapters", *arguments]
    for name in ("PYTHONHOME", "PYTHONPATH"):  # as in the launchers
        os.environ.pop(name, None)
    return become(command)


def become(command: list[str]) -> int:
    """Go on as another program (on Windows: run it and return its exit code)."""
    if sys.platform == "win32":  # os.execv returns to the prompt there, before the program is done
        try:
            return subprocess.run(command, check=False).returncode
        except KeyboardInterrupt:
            return 130
    return os.execv(command[0], command)
