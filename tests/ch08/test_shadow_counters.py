"""Counters of casters in frames: what kernels left to be drawn, held to the lists and commands that they wrote."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch08.settings import Settings
from common.settings import replaced
from tests.support.lamps import lamps, lit
from tests.support.shadows import commanded, listed, point, yard
from tests.support.towns import town, walk

pytestmark = pytest.mark.variants("vulkan", "gl", long=("gl",))

SIZE = (48, 32)
NAMES = ("shadow_units", "shadow_units_culled", "shadow_draws", "shadow_triangles")
BASE = Settings(
    geometry="compute",  # mesh shaders write no commands
    anisotropy=1.0,
    default_light=False,
    shadow_memory="full",
    shadow_size=128,
    shadow_sun_size=256,
    shadow_cascades=2,
)
VIEW = walk()[0]


@pytest.fixture(scope="module")
def scene():
    """Return a town of 150 objects under 9 lamps: their 44 faces are one round."""
    return lit(town(count=150), *lamps(9))


def several(chapter):
    if not chapter.device.has("multi-draw"):
        pytest.skip("the device draws one command with each call")


def counted(frame):
    return {name: frame.work[name] for name in NAMES}


@pytest.mark.feature("shadows/instance-culling")
def test_counters_are_those_of_lists_and_commands(chapter, scene):
    several(chapter)
    with chapter.open(scene, SIZE, BASE) as renderer:
        frame = renderer.render(VIEW)
        frame.image("color")
        pass_ = renderer.techniques["shadows"].passes["shadows"]
        assert len(pass_.schedule.rounds) == 1
        lists, commands = listed(renderer), np.concatenate(commanded(renderer))
        told, units = counted(frame), int(pass_.lists.tables.draws["units"].sum())
        assert told["shadow_units"] == sum(map(len, lists)) > 0
        assert told["shadow_units"] + told["shadow_units_culled"] == units * len(lists)
        assert told["shadow_draws"] == len(commands)
        assert told["shadow_triangles"] == int(commands[:, 0].sum()) // 3


@pytest.mark.long
@pytest.mark.feature("shadows/instance-culling", "shadows/cull-toggles")
def test_equal_frames_have_equal_counts_and_toggles_raise_them(chapter, scene):
    several(chapter)
    found = {}
    for off in ((), ("instances",), ("faces",), ("instances", "meshlets", "faces")):
        knobs = {f"shadow_cull_{name}": False for name in off}
        frames = []
        for _ in range(1 if off else 2):
            with chapter.open(scene, SIZE, replaced(BASE, geometry="compute", **knobs)) as renderer:
                frames.append(counted(renderer.render(VIEW)))
        assert frames[0] == frames[-1]
        found[off] = frames[0]
    everything = found["instances", "meshlets", "faces"]
    assert everything["shadow_units_culled"] == 0
    for off, told in found.items():
        assert told["shadow_units"] + told["shadow_units_culled"] == everything["shadow_units"]
        assert not off or told["shadow_draws"] > found[()]["shadow_draws"]


@pytest.mark.feature("shadows/caching", "shadows/instance-culling")
def test_a_resting_frame_counts_nothing_and_waits_for_nothing(chapter):
    several(chapter)
    scene = yard(point((-1.2, 3.0, 0.8)), point((1.2, 3.0, 0.8)))
    with chapter.open(scene, SIZE, BASE) as renderer:
        technique = renderer.techniques["shadows"]
        first, told = renderer.render(VIEW), []
        told.append(counted(first))
        for _ in range(3):
            told.append(renderer.render(VIEW).work)
        assert told[0]["shadow_draws"] > 0 and not technique.tells
        assert all(work.get("shadow_draws", 0) == 0 for work in told[1:])
        with scene.edit() as edit:
            edit.set_transform(scene.lights[0].node, translation=(-1.0, 3.0, 0.8))
        moved = counted(renderer.render(VIEW))
        assert technique.tells and 0 < moved["shadow_draws"] < told[0]["shadow_draws"]
        # A frame that was over before it was asked has kept its own.
        assert counted(first) == told[0]


@pytest.mark.feature("shadows/instance-culling")
def test_rounds_of_a_frame_add_up(chapter):
    """Faces of 512 texels are 32 a round, and those of 128 are 64: two rounds and one, of the same 39 faces."""
    several(chapter)
    scene = lit(town(count=50), *lamps(9))
    with chapter.open(scene, SIZE, replaced(BASE, shadow_size=512)) as renderer:
        frame = renderer.render(VIEW)
        rounds = renderer.techniques["shadows"].passes["shadows"].schedule.rounds
        whole = counted(frame)
        frame.image("color")
        last, lists = sum(map(len, commanded(renderer))), listed(renderer)
    assert [turn.layers for turn in rounds] == [32, 8] and whole["shadow_draws"] > last > 0
    with chapter.open(scene, SIZE, BASE) as renderer:
        small = counted(renderer.render(VIEW))
    # The guard is a smaller part of a larger face, which meets fewer casters by that.
    assert 0 <= small["shadow_draws"] - whole["shadow_draws"] < 0.05 * small["shadow_draws"]
    # The light whose faces are in both rounds has a list in each.
    assert whole["shadow_units"] == small["shadow_units"] + len(lists[0])


@pytest.mark.feature("shadows/per-face-fallback")
def test_without_kernels_the_draws_of_the_recording_are_counted(chapter):
    """Every caster into every face: seven squares, and six faces."""
    settings = replaced(BASE, geometry="auto")
    with chapter.open(yard(point((-1.2, 3.0, 0.8))), SIZE, settings, without=("multi-draw",)) as renderer:
        work = renderer.render(VIEW).work
        assert work["shadow_draws"] == 6 * 7 and work["shadow_triangles"] == 6 * 7 * 2
        assert "shadow_units" not in work and not renderer.techniques["shadows"].tells
