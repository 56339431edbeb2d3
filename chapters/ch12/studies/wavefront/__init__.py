"""Study: wavefront. The path tracer as small kernels over queues of paths, beside the loop of the chapter.

The chapter traces a path in one loop: a *megakernel*. The lanes of a processor run together, so a lane whose path has
ended waits for the longest path of its 32, and all of them have room for the registers of the whole loop. A
*wavefront* path tracer takes all paths one step at a time (Laine, Karras and Aila 2013). Each step is a kernel of its
own ([`wave.comp`](wave.comp)), and a path between two steps is a record in memory ([`wave.glsl`](wave.glsl)):

    generate -> (extend -> shade -> shadow) for each reflection -> add

`shade` puts the paths that go on into the next queue, by an atomic counter, and paths with rays towards light into
another one. The next dispatches are as large as the queues are: a kernel writes their arguments, and the CPU never
knows them. So no lane waits for a path that has ended. The price is memory traffic: a path has 256 bytes, most of which
are written and read in each round.

Both have the same functions ([`paths/steps.glsl`](../../paths/steps.glsl)) and the same random numbers, so they have
the same picture. `--set path_kernel=loop` shows the chapter's loop as compute. Kernels find hits by ray queries or by
our own hierarchy; in a ray pipeline the driver decides how shaders follow each other, and nothing can be taken apart.
"""

from __future__ import annotations

from dataclasses import dataclass
from typing import Any, ClassVar

from common.errors import SettingError
from common.lessons import Study
from common.scene import Scene
from common.settings import group, knob

from ...fog import model as fog
from ...frames.frame import OUTPUTS
from ...rays.settings import RaySettings
from ...settings import Settings as ChapterSettings
from ..of_paths import TracedSettings

STUDY = Study(
    title="wavefront",
    idea="All paths take a step, then the next one: queues of live paths in place of one long loop.",
    order=5,
    outputs=OUTPUTS,
    scene="cornell",
)

PATH_BYTES = 256
"""Bytes of a path in flight: 16 rows of wave.glsl."""

KERNELS = ("wave", "loop")


@dataclass
class WaveSettings:
    """The knobs of the study."""

    kernel: str = knob(
        "wave",
        "how paths are traced: by kernels over queues, or by one kernel with a loop",
        choices=KERNELS,
        flat="path_kernel",
    )
    paths: int = knob(
        2**18,
        "paths in flight at most: larger pictures are traced in tiles. A path takes 256 bytes",
        minimum=64,
        maximum=2**21,
        flat="wave_paths",
    )


@dataclass
class WavePathSettings(TracedSettings):
    """How paths are sampled: with the rays towards light that a path in flight has room for."""

    path_lights: str = knob(
        "one",
        "rays towards lights at each reflection: a path in flight has room for one to a light of the scene",
        choices=("one",),
        live=True,
    )


@dataclass
class WaveRaySettings(RaySettings):
    """How hits are found: by what a kernel can do."""

    ray_way: str = knob(
        "auto",
        "what finds hits: ray queries, or our own hierarchy; auto takes the first that there is",
        choices=("auto", "query", "bvh"),
    )


@dataclass(init=False)
class Settings(ChapterSettings):
    """The chapter's settings, and those of the study."""

    ORDER: ClassVar[str] = f"path_kernel wave_paths {ChapterSettings.ORDER}"

    waves: WaveSettings = group(WaveSettings)
    paths: WavePathSettings = group(WavePathSettings)
    rays: WaveRaySettings = group(WaveRaySettings)


def check(scene: Scene, settings: Any) -> None:
    """Raise SettingError for what paths in flight have no room for."""
    if settings.waves.kernel == "wave" and fog.needed(scene, settings):
        raise SettingError(
            "The study wavefront follows paths between surfaces, and this scene has fog between them: set fog=off, or "
            "path_kernel=loop."
        )
