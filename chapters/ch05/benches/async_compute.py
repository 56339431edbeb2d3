"""The gain from a queue for compute: the same frames with `async_compute` on and off.

Cloth is simulated beside drawing where the device has a queue family for compute alone. The time from frame to frame
shows how much of it is hidden, since the GPU's times of single passes become longer when two of them share it. At most
the shorter of both can be hidden. Work of a few dispatches leaves most of a GPU idle, and work that fills it can hardly
run beside other work. So there are two scenes: some small cloths, and a building with a large sheet. The sheet has as
many substeps as make its simulation take about as long as drawing.

Frames begin at time 0 in every round, so that no cloth comes to rest. Separate frames have a stamp at both ends of
every submission. If the stamps of both queues count one clock, they show for how long submissions of both were under
way. Vulkan does not promise one clock; three stamps test it. A submission that waits in its middle counts as under way.
"""

from __future__ import annotations

import time as clock
from collections.abc import Callable
from contextlib import ExitStack
from dataclasses import dataclass, field
from functools import partial
from typing import Any

import numpy as np
from rich.console import Console

from backends.contract import Renderer
from backends.vulkan.once import submit_once
from backends.vulkan.stamps import Stamps, can_stamp, common_ms, merged
from common.reports.benches import Effort, Subject, difference, middle
from common.reports.tables import table
from common.scene import Scene
from common.scene.merge import merge_scenes
from common.scene.sheets import cloth, cloth_scene_of
from common.settings import flat, knobs, replaced

from .sheet import FABRIC, PASS, medium_of

KNOB = "async_compute"
"""The setting; a chapter without it has one queue."""

LARGE = (1920, 1080)
"""Size of the pictures on a GPU, unless the bench's is larger: frames must not wait for the CPU."""

EDGE = 128
"""Vertices along an edge of the large sheet."""

HELD = np.array([[4.0, 0, 0, 0], [0, 0, 4.0, 6.0], [0, -4.0, 0, 0], [0, 0, 0, 1]])
"""Place of the sheet in the atrium: level, 4 m wide, 6 m above the floor."""

FRAMES, ALONE, STAMPED = 22, 4, 12
"""Frames of a round, frames after them that begin when the GPU is done, and frames with stamps. The first two together
take less time than a cloth must be calm to be at rest."""

MOST_SUBSTEPS = 64


@dataclass
class _Run:
    """The frames of a scene with the setting on or off."""

    on: bool
    subject: Subject
    renderer: Renderer
    frames_ms: list[float] = field(default_factory=list)
    cpu_ms: list[float] = field(default_factory=list)
    passes: list[dict[str, float]] = field(default_factory=list)
    picture: Any = None

    def round(self, count: int) -> None:
        """Draw frames from time 0 on without waiting between them, and keep their times."""
        renderer: Any = self.renderer
        view, dt = self.subject.view(renderer), renderer.settings.cloth.step
        for number in range(2):
            renderer.render(view, number * dt).timings  # noqa: B018
        began = clock.perf_counter()
        frames = [renderer.render(view, (2 + number) * dt) for number in range(count)]
        renderer.device.wait_idle()
        self.frames_ms.append((clock.perf_counter() - began) * 1e3 / count)
        if any(frame.work["cloth_steps"] != 1 for frame in frames):
            raise AssertionError("a frame did not make one step of cloth")
        if "color_linear" in renderer.outputs:
            self.picture = np.array(frames[-1].image("color_linear"))
        for number in range(ALONE):  # otherwise a frame waits for the last frame of its slot
            renderer.device.wait_idle()
            self.cpu_ms.append(renderer.render(view, (2 + count + number) * dt).cpu_ms)
        self.passes += [dict(frame.timings) for frame in frames]

    def record(self) -> dict[str, Any]:
        """Return the figures of the frames."""
        whole, noise = middle(self.frames_ms)
        drawing, beside = ([_part(timings, own) for timings in self.passes] for own in (False, True))
        return {
            "frame_ms": whole,
            "noise_ms": noise,
            "cpu_ms": middle(self.cpu_ms)[0],
            "drawing_ms": middle(drawing)[0],
            "compute_ms": middle(beside)[0],
        }


def _part(passes: dict[str, float], compute: bool) -> float:
    """Return the ms of the compute pass, or of all other passes."""
    return sum(took for name, took in passes.items() if (name == PASS) == compute)


def measure(subject: Subject, effort: Effort, step: Callable[[str, float], None]) -> dict[str, Any] | None:
    """Return the record of a chapter with two queues in its graph; None for others.

    If the device has no family for compute alone, the record gives the reason and has no scenes.
    """
    if KNOB not in knobs(subject.settings_class):
        return None
    device: Any = subject.device
    if device.compute_queue is None:
        why = device.capabilities.why_not.get("async-compute", "it was switched off")
        return {"family": False, "why": why, "scenes": []}
    size = subject.size
    if device.capabilities.kind != "software" and size[0] * size[1] < LARGE[0] * LARGE[1]:
        size = LARGE
    records = []
    scenes = {"cloth": subject.load("cloth"), "atrium with a sheet": building_with_sheet(subject)}
    for number, (name, scene) in enumerate(scenes.items()):
        drawn = subject.on(scene, size)
        records.append(
            {"scene": name, **frames_of(drawn, effort, partial(_within, step, name, number / 2), number > 0)}
        )
    return {"family": True, "why": "", "size": list(size), "scenes": records}


def _within(step: Callable[[str, float], None], name: str, begin: float, what: str, part: float) -> None:
    step(f"{name}, {what}", begin + part / 2)


def building_with_sheet(subject: Subject, edge: int = EDGE) -> Scene:
    """Return the atrium with a large sheet that is held at two corners."""
    properties = cloth(edge, edge, pins=[0, edge - 1], **FABRIC)
    sheet = cloth_scene_of(properties, matrices=[HELD], size=(edge, edge), light=False)
    return merge_scenes([subject.load("atrium"), sheet])[0]


def frames_of(
    subject: Subject, effort: Effort, step: Callable[[str, float], None], balanced: bool, frames: int = FRAMES
) -> dict[str, Any]:
    """Return the record of a scene; if `balanced`, with substeps that make compute take about as long as drawing."""
    settings = medium_of(subject)
    outputs = {"color", "color_linear"}
    if balanced:
        step("how long both take", 0.0)
        with subject.open(replaced(settings, async_compute=False), outputs) as renderer:
            run = _Run(False, subject, renderer)
            run.round(4)
        measured = run.record()
        if measured["compute_ms"] > 0:
            substeps = round(
                flat(settings)["cloth_substeps"] * measured["drawing_ms"] / measured["compute_ms"]
            )
            settings = replaced(settings, cloth_substeps=min(max(substeps, 1), MOST_SUBSTEPS))
    rounds = max(effort.rounds, 2)
    with ExitStack() as stack:
        runs = [
            _Run(
                on, subject, stack.enter_context(subject.open(replaced(settings, async_compute=on), outputs))
            )
            for on in (True, False)
        ]
        for turn in range(rounds + 1):
            step("frames", 0.1 + 0.7 * turn / (rounds + 1))
            for run in runs if turn % 2 else reversed(runs):
                run.round(frames)
            if turn == 0:  # the driver compiled shaders
                for run in runs:
                    run.frames_ms, run.cpu_ms, run.passes = [], [], []
    on, off = (run.record() for run in runs)
    drawn: Any = runs[0].renderer
    step("stamps", 0.8)
    return {
        "substeps": drawn.techniques[
            "cloth"
        ].cloth.frames.steps.substeps,  # fewer than the setting, if they would be too short
        "rounds": rounds,
        "on": on,
        "off": off,
        "ratio": off["frame_ms"] / on["frame_ms"],
        "error": difference(runs[0].picture, runs[1].picture),
        "stamps": _stamps(subject, settings),
    }


def _stamps(subject: Subject, settings: Any) -> dict[str, Any] | None:
    """Return for how long submissions of both queues were under way; None where stamps cannot show it."""
    device: Any = subject.device
    families = device.physical.families
    if not (can_stamp(device) and families[device.compute_queue.family].timestamp_bits):
        return None
    if not clocks_agree(device):
        return None
    stamps = Stamps(device)
    try:  # a recording that is submitted again would keep its first stamps
        with subject.open(replaced(settings, resubmit=False), {"color"}) as renderer:
            _Run(True, subject, renderer).round(STAMPED)
            timeline = stamps.timeline()
    finally:
        stamps.close()
    drawing, beside = timeline.get("graphics", []), timeline.get("compute", [])
    return {
        "submissions": len(beside),
        "compute_ms": sum(end - begin for begin, end in merged(beside)),
        "both_ms": common_ms(drawing, beside),
    }


def clocks_agree(device: Any) -> bool:
    """Whether a stamp of the compute queue lies between two of the graphics queue, made before and after it."""
    stamps = Stamps(device)
    try:
        for queue in (device.queue, device.compute_queue, device.queue):
            with submit_once(device, queue):
                pass
        intervals = stamps.timeline()
    finally:
        stamps.close()
    if [len(intervals.get(name, ())) for name in ("graphics", "compute")] != [2, 1]:
        return False
    (_, before), (after, _) = intervals["graphics"]
    ((begin, end),) = intervals["compute"]
    return before <= begin and end <= after


# --- results ----------------------------------------------------------------------------------------------------------


def show(record: dict[str, Any], to: Console) -> None:
    """Print the record as a table, and its sentences."""
    if record["scenes"]:
        shown = table(
            "The same frames with async_compute on and off, ms",
            *("scene", ">substeps", "queues", ">frame", ">±", ">CPU", ">drawing", ">compute"),
        )
        for scene in record["scenes"]:
            named = [scene["scene"], str(scene["substeps"])]
            for name in ("on", "off"):
                row = scene[name]
                values = ("frame_ms", "noise_ms", "cpu_ms", "drawing_ms", "compute_ms")
                shown.add_row(*named, name, *(f"{row[value]:.3f}" for value in values))
                named = ["", ""]
        to.print(shown)
    for line in sentences(record):
        to.print(line, soft_wrap=True)


def sentences(record: dict[str, Any]) -> list[str]:
    """Return the results as sentences."""
    if not record["family"]:
        return [f"Nothing runs beside drawing here: {record['why']}."]
    lines = []
    for scene in record["scenes"]:
        on, off = scene["on"], scene["off"]
        least = min(off["drawing_ms"], off["compute_ms"])
        spared = off["frame_ms"] - on["frame_ms"]
        line = (
            f"{scene['scene']}: with a queue of its own for compute a frame takes {1 / scene['ratio']:.2f} times as "
            f"long as without; {spared:+.3f} ms are spared of the {least:.3f} ms that could be hidden"
        )
        if abs(spared) <= on["noise_ms"] + off["noise_ms"]:
            line += ", which is within the noise"
        if on["cpu_ms"] > 0.9 * on["frame_ms"]:
            line += "; the processor takes as long, so that the GPU waits for it"
        stamps = scene["stamps"]
        if stamps and stamps["both_ms"]:  # otherwise the queues have different clocks
            line += (
                f"; by stamps compute is under way for {stamps['compute_ms']:.2f} ms, and for "
                f"{stamps['both_ms']:.2f} ms of it drawing, too"
            )
        lines.append(line + ".")
    if any(scene["error"]["pixels_differ"] for scene in record["scenes"]):
        lines.append("The pictures with one queue and with two differ.")
    else:
        lines.append("With one queue and with two the picture is the same to the bit.")
    return lines


def plot(axes: Any, record: dict[str, Any]) -> None:
    """Draw the frame times with one queue and with two, beside the times of drawing and of compute alone."""
    axes.set_title("Compute on a queue of its own", fontsize=10)
    if not record["scenes"]:
        axes.set_xticks([])
        axes.set_yticks([])
        axes.text(0.5, 0.5, record["why"], ha="center", transform=axes.transAxes, fontsize=9)
        return
    names = [scene["scene"] for scene in record["scenes"]]
    place = np.arange(len(names))
    for number, (name, label) in enumerate((("off", "one queue"), ("on", "two queues"))):
        rows = [scene[name] for scene in record["scenes"]]
        axes.bar(
            place + 0.4 * number - 0.2,
            [row["frame_ms"] for row in rows],
            0.36,
            yerr=[row["noise_ms"] for row in rows],
            color=f"C{number}",
            label=f"{label}, frame",
            capsize=2,
        )
    for number, (part, label) in enumerate(
        (("drawing_ms", "drawing alone"), ("compute_ms", "compute alone"))
    ):
        values = [scene["off"][part] for scene in record["scenes"]]
        axes.plot(place, values, "ov"[number], color=f"C{number + 2}", label=label, mec="white", ms=9)
    axes.set_xticks(place, names)
    axes.set_ylabel("ms from frame to frame")
    axes.legend(fontsize=8)
