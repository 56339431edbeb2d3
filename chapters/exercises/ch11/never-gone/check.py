"""A pixel that is not a number in one frame, and the frames after it."""

from __future__ import annotations

from dataclasses import replace
from pathlib import Path
from tempfile import TemporaryDirectory
from typing import Any

import numpy as np

from backends.contract import Access
from tests.support.taa import FULL, SIZE, VIEW, court
from tools.exercises.checking import Given

HOLE = """
layout(BIND(1, 0, 3)) uniform sampler2D color_hdr;
layout(location = 0) in vec2 in_uv;
layout(location = 0) out vec4 out_color;
void main() {
    out_color = texelFetch(color_hdr, ivec2(gl_FragCoord.xy), 0);
    if (HOLE != 0 && ivec2(gl_FragCoord.xy) == ivec2(20, 15)) {
        out_color.rgb = vec3(uintBitsToFloat(0x7fc00000u));
    }
}
"""


def holed(given: Given, file: str) -> Any:
    """Return a pass that copies the picture, with a pixel that is not a number while `holed`."""
    description: Any = given.module("pipelines.description").PipelineDescription
    base: Any = given.module("post.fullscreen").FullscreenPass

    class Holed(base):  # type: ignore[misc]
        name = "holed"
        reads = (Access("color_hdr", "sampled"),)
        writes = (Access("color_holed", "color", format="rgba32f"),)
        holed = False

        def describe(self) -> Any:
            shaders = ("post/fullscreen.vert", file)
            return description(shaders=shaders, color="rgba32f", depth=None, name="holed")

        def create(self) -> None:
            every = [replace(self.describe(), defines=(("HOLE", hole),)) for hole in (0, 1)]
            self.pipelines = self._pipelines.get(every)

        def record(self, commands: Any) -> None:
            commands.draw_fullscreen(self.pipelines[self.holed], self._draws.binding)

        def key(self, slot: int) -> bool:
            return self.holed

    return Holed


def check(given: Given) -> None:
    """A view at rest whose frames are averaged, and one whose frames are blended."""
    with TemporaryDirectory() as folder:
        file = Path(folder) / "hole.frag"
        file.write_text(HOLE, "utf-8")
        for average in (True, False):
            knobs = {**FULL, "taa_average": average}
            with given.open(court(), SIZE, ("color_linear",), **knobs) as opened:
                renderer: Any = opened
                gpu_pass: Any = renderer.make_pass(holed(given, str(file)))
                renderer.insert_pass(gpu_pass, {"taa": {"color_hdr": "color_holed"}})
                for number in range(4):
                    gpu_pass.holed = number == 0
                    picture = renderer.render(VIEW).image("color_linear")
            given.silent()
            bad = int((~np.isfinite(picture)).any(axis=-1).sum())
            given.need(
                bad == 0,
                f"Three frames after a pixel was not a number {bad} pixels of the picture are not, with "
                f"taa_average={str(average).lower()}.",
            )
