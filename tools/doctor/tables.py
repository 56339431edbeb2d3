"""Prints what `strata doctor` found, the answer first: does it work, what is in the way, and then the details."""

from __future__ import annotations

from typing import Any

from rich.console import Console
from rich.markup import escape

from backends.features import REQUIRED_USES
from backends.verdicts import OK, UNCHECKED
from common.reports.tables import table

Report = dict[str, Any]

NAMES = {"vulkan": "Vulkan", "gl": "OpenGL"}


def show(report: Report, console: Console) -> None:
    """Print a report of `tools.doctor.doctor.report`."""

    def say(text: str) -> None:
        console.print(text, markup=False, soft_wrap=True)

    if report["works"]:
        device = _used(report)
        say(f"Strata draws on {device['name']} ({device['driver']}).")
        say(f"--backend auto takes {NAMES[report['auto']['backend']]}: {report['auto']['reason']}.")
    else:
        say(report["problem"])
    for sentence in report["shadowed"]:
        say(f"! {sentence}")
    if report["install"]:
        say(report["install"])
    for sentence in report["advice"]:
        say(f"+ {sentence}")
    say("")
    _show_versions(report, console)
    _show_devices(report, console)
    for device in report["vulkan"]["devices"]:
        _show_verdicts(device, "Vulkan", console)
    if report["opengl"]["device"]:
        _show_verdicts(report["opengl"]["device"], "OpenGL", console)
    _show_plans(report, console)


def _used(report: Report) -> Report:
    """Return the device of the backend that is taken."""
    if report["auto"]["backend"] == "gl":
        by_gl: Report = report["opengl"]["device"]
        return by_gl
    number = report["vulkan"]["chosen"]
    found: Report = next(d for d in report["vulkan"]["devices"] if d["number"] == number)
    return found


def _show_versions(report: Report, console: Console) -> None:
    strata, vulkan, gl = report["strata"], report["vulkan"], report["opengl"]
    loader, display = vulkan["loader"], report["display"]
    rows = [
        ("Strata", f"{strata.get('version')} in {strata.get('root')}"),
        ("Python", f"{strata.get('python')}, {strata.get('executable')}"),
        ("system", f"{strata.get('system')}, {strata.get('processors')} processors"),
        ("cache", strata.get("cache_problem") or strata.get("cache")),
        ("real models", strata.get("models") or "none (STRATA_ASSETS names their folder)"),
        ("packages", ", ".join(f"{name} {v or 'missing'}" for name, v in report["packages"].items())),
        (
            "Vulkan loader",
            f"{loader['version']}, {loader['path'] or loader['name']}" if loader else vulkan["problem"],
        ),
        ("Vulkan drivers", "\n".join(vulkan["drivers"]) or "none is announced"),
        ("Vulkan layers", "\n".join(f"{name} {v}" for name, v in vulkan["layers"].items()) or "none"),
    ]
    for compiler in report["compilers"]:
        problem = f": {compiler['problem']}" if "problem" in compiler else ""
        rows.append(
            ("GLSL compiler", f"{compiler.get('version') or compiler['name']}, {compiler['path']}{problem}")
        )
    rows += [
        ("OpenGL", f"{gl['version']}, {gl['renderer']}" if gl["version"] else f"none: {gl['problem']}"),
        ("display", f"{display['kind']}: {display['detail']}"),
        *(("environment", f"{name}={value}") for name, value in report["environment"].items()),
    ]
    made = table("What is here", "what", "found")
    before = None
    for what, found in rows:
        made.add_row(what if what != before else "", escape(str(found or "none")))
        before = what
    console.print(made)


def _show_devices(report: Report, console: Console) -> None:
    devices = report["vulkan"]["devices"]
    if not devices:
        return
    made = table("Vulkan devices", ">", "name", "driver", "kind", "Vulkan", "queues", "fit")
    for device in devices:
        queues = "\n".join(f"{q['queues']}x {' '.join(q['kinds'])}" for q in device["queues"])
        taken = report["auto"] is not None and report["auto"]["backend"] == "vulkan"
        taken = taken and device["number"] == report["vulkan"]["chosen"]
        fit = device["unfit"] or ("yes, taken" if taken else "yes")
        made.add_row(
            str(device["number"]),
            device["name"],
            device["driver"],
            device["kind"],
            device["api"],
            queues,
            fit,
        )
    console.print(made)


def _show_verdicts(device: Report, api: str, console: Console) -> None:
    verdicts = device["verdicts"] or {}
    if device["unfit"] and not verdicts:
        return
    title = f"Features of {device['name']} by {api}"
    if not verdicts:
        title += ", as the driver says (./strata doctor --selftest tries them)"
    made = table(title, "feature", "use", "verdict")
    rows: dict[tuple[str, ...], str] = {}
    for feature in device["advertised"]:
        rows[feature, ""] = "there"
    for use, reason in device["broken"].items():
        if use.partition("/")[0] in {*device["advertised"], *REQUIRED_USES}:
            rows[tuple(use.split("/", 1))] = reason
    for feature, uses in verdicts.items():
        rows.pop((feature, ""), None)
        for use, verdict in uses.items():
            if not verdict.startswith(UNCHECKED) or (feature, use) not in rows:
                rows[feature, use] = "works" if verdict == OK else verdict
    for feature, reason in device["why_not"].items():
        if feature not in device["advertised"]:
            rows[feature, ""] = f"missing: {reason}"
    before = None
    for (feature, use), verdict in sorted(rows.items()):
        made.add_row(feature if feature != before else "", use, escape(verdict))
        before = feature
    console.print(made)


def _show_plans(report: Report, console: Console) -> None:
    by = f", by {NAMES[report['auto']['backend']]}" if report["auto"] else ""
    made = table(f"How the chapters run here{by}", "chapter", "feature", "path", "why")
    for name, plan in report["plan"].items():
        if plan["problem"]:
            path = "runs by the other backend" if plan["runs"] else "does not run"
            made.add_row(name, "", path, escape(plan["problem"]))
        elif not plan["choices"]:
            made.add_row(name, "", "runs; it uses no optional feature", "")
        for index, choice in enumerate(plan["choices"]):
            label = name if index == 0 else ""
            made.add_row(label, choice["feature"], choice["path"], choice["reason"])
    console.print(made)
