"""What a bench holds pictures to: the chapter's own reference, or light that the path tracer finds.

The own reference shares what all settings of a chapter leave out, such as shadows in chapter 1. Paths leave nothing
out: against them errors by design count too, and so all chapters have one scale.
"""

from __future__ import annotations

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from common.errors import UserError
from common.images.color import encode_srgb
from common.reports.benches import Effort, errors
from common.scene.pose import evaluate_pose
from common.settings import preset
from common.view.camera import exposure, view_of_scene
from tools.reference.settings import chapter_settings, differences
from tools.reference.tracing import DEFAULT_PATHS, reference

Array = np.ndarray

OWN = "own"
FILTERS = {"path-tracer": "box", "path-tracer-centre": "centre"}
"""The truths that are traced, and where in a pixel their paths go. Pictures with one sample a pixel, in its centre, are
held to paths through the centre where their aliasing shall not count."""

TRUTHS = (OWN, *FILTERS)
GOAL, QUICK_GOAL, QUICK_PATHS = 0.02, 0.1, 256
"""The estimated errors at which tracing stops, and what a quick look traces of each pixel at most."""


@dataclass(frozen=True)
class Truth:
    """A picture that others are held to. `facts` say in a record what it is."""

    picture: tuple[Array, Array]
    facts: dict[str, Any]
    exposure: float | None = None

    def errors(self, pictures: tuple[Array, Array]) -> dict[str, float | None]:
        """Return the errors of pictures as `Subject.pictures` returns them.

        Against light without a tone curve, what is shown has none either: both are the light at one exposure.
        """
        linear, shown = pictures
        return errors(
            (linear, shown if self.exposure is None else _shown(linear, self.exposure)), self.picture
        )


def truth_of(subject: Any, wanted: str, effort: Effort, step: Callable[[str, float], None]) -> Truth:
    """Return what pictures of a `tools.bench.points.Subject` are held to; `wanted` is one of TRUTHS."""
    step("reference", 0.0)
    if wanted == OWN:
        picture = subject.pictures(preset(subject.settings_class, "reference"), effort.samples)
        return Truth(picture, {"preset": "reference", "samples_per_pixel": effort.samples**2})
    goal, paths = (GOAL, DEFAULT_PATHS) if effort.everything else (QUICK_GOAL, QUICK_PATHS)
    light, error = reference(
        subject.chapter,
        subject.scene,
        None,
        subject.size,
        goal,
        paths=paths,
        filter=FILTERS[wanted],
        backend=subject.backend,
        progress=lambda part, detail: step(f"reference, {detail}", 0.1 * part),
        device=subject.device,
    )
    width, height = subject.size
    scale = exposure(
        view_of_scene(subject.scene, evaluate_pose(subject.scene, 0.0), None, width / height).ev100
    )
    settings, _ = chapter_settings(subject.chapter)
    facts = {
        "truth": wanted,
        "estimated_error": error,
        "by_design": differences(subject.chapter, settings, subject.scene),
    }
    return Truth((light, _shown(light, scale)), facts, scale)


def _shown(light: Array, scale: float) -> Array:
    shown: Array = encode_srgb(np.clip(light.astype(np.float64) * scale, 0.0, 1.0)).astype(np.float32)
    return shown


def check(truth: str, record: bool, only: Sequence[str] = ()) -> None:
    """Raise UserError for a truth that there is not, or that nothing is held to."""
    if truth not in TRUTHS:
        raise UserError(f"There is no truth {truth!r}: write {', '.join(TRUTHS[:-1])} or {TRUTHS[-1]}.")
    if truth != OWN and record:
        raise UserError(
            "--record keeps errors against a chapter's own reference: leave out --truth, or --record."
        )
    if truth != OWN and only and "settings" not in only:
        raise UserError(
            f"--truth {truth} is for pictures of the part settings, and --only {','.join(only)} measures none: "
            "leave one of them out."
        )


def sentence(facts: dict[str, Any]) -> str:
    """Return what errors of a record are against."""
    if "truth" not in facts:
        return f"Errors are against the reference at {facts['samples_per_pixel']} samples a pixel."
    where = "anywhere in a pixel" if FILTERS[facts["truth"]] == "box" else "through the centres of pixels"
    error = f"{facts['estimated_error']:.2g}"
    text = f"Errors are against light traced by paths {where}, with an estimated error of {error}."
    return f"{text} {facts['by_design']}".rstrip()


def axis(facts: dict[str, Any]) -> str:
    """Return the same for the axis of a plot."""
    if "truth" not in facts:
        return f"against the reference at {facts['samples_per_pixel']} samples a pixel"
    return f"against light traced by paths (estimated error {facts['estimated_error']:.2g})"
