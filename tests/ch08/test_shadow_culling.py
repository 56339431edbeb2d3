"""Casters that kernels leave out: complete lists in the order of the scene, and maps of the same bits."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch08.settings import Settings
from chapters.ch08.shadows.faces import FACE
from chapters.ch08.shadows.layout import NO_FACE
from chapters.ch08.shadows.lists import schedule
from common.settings import replaced
from tests.support.lamps import lamps, lit
from tests.support.shadows import all_faces, commanded, faces_of, list_numbers, listed
from tests.support.towns import town, walk

pytestmark = pytest.mark.variants("vulkan", "gl")

SIZE = (48, 32)
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
    """Return a town of 150 objects under 9 lamps, three of them spots."""
    return lit(town(count=150), *lamps(9))


def several(chapter):
    if not chapter.device.has("multi-draw"):
        pytest.skip("the device draws one command with each call")


def boxes(renderer):
    """Return (D, 3) centres, half edges, and (D,) radii of the boxes of all draws, in float64."""
    draws = renderer.techniques["shadows"].passes["shadows"].lists.tables.draws
    records = renderer._data.records.instances[draws["instance"]]
    centre, extent = records["bounds_centre"].astype(np.float64), records["bounds_extent"].astype(np.float64)
    return centre[:, :3], extent[:, :3], centre[:, 3], draws


def bases(renderer):
    """Return the first face of each list."""
    technique = renderer.techniques["shadows"]
    schedule = technique.passes["shadows"].schedule
    lists = schedule.lists[schedule.rounds[-1].first :]
    return (lists & 0xFFFFFF)[lists > 0]


@pytest.mark.feature("shadows/instance-culling")
def test_each_light_lists_what_its_sphere_meets(chapter, scene):
    several(chapter)
    knobs = {"shadow_cull_meshlets": False, "shadow_cull_faces": False}
    with chapter.open(scene, SIZE, replaced(BASE, **knobs)) as renderer:
        renderer.render(VIEW).image("color")
        centre, _, radius, draws = boxes(renderer)
        faces, found = faces_of(renderer), listed(renderer)
        assert len(found) == len(bases(renderer)) == 9
        for base, entries in zip(bases(renderer), found, strict=True):
            face = faces[base]
            away = np.linalg.norm(centre - face["origin"].astype(np.float64), axis=1)
            margin = float(face["far"]) + radius - away
            got = np.zeros(len(draws), bool)
            got[entries[:, 0]] = True
            sure = np.abs(margin) > 1e-3
            assert np.array_equal(got[sure], (margin >= 0)[sure] & (draws["units"][sure] > 0))
            # Each unit of what is listed, once, in order.
            order = entries[:, 0].astype(np.int64) * 2**24 + entries[:, 1]
            assert (np.diff(order) > 0).all()
            assert len(entries) == draws["units"][got].sum()
        assert 0 < sum(map(len, found)) < 9 * draws["units"].sum()


@pytest.mark.core
@pytest.mark.feature("shadows/face-culling", "shadows/indirect-commands")
def test_no_face_misses_what_it_sees_and_commands_follow_the_lists(chapter, scene):
    several(chapter)
    with chapter.open(scene, SIZE, BASE) as renderer:
        renderer.render(VIEW).image("color")
        centre, extent, _, draws = boxes(renderer)
        faces, found, commands = faces_of(renderer), listed(renderer), commanded(renderer)
        extra = seen = 0
        corners = np.indices((2, 2, 2)).reshape(3, -1).T * 2.0 - 1.0
        random = np.random.default_rng(3).uniform(-1, 1, (400, 3))
        for base, entries in zip(bases(renderer), found, strict=True):
            count = 6 if base + 1 < len(faces) and faces[base + 1]["light"] == faces[base]["light"] else 1
            for number in range(count):
                face = faces[base + number]
                axes = np.stack([face["right"], face["down"], face["ahead"]]).astype(np.float64)
                points = centre[:, None] + extent[:, None] * np.concatenate([corners, random])[None]
                p = (points - face["origin"]) @ axes.T
                widest = float(face["size"]) / 2 / float(face["scale_x"])
                inside = (np.abs(p[..., :2]) < widest * p[..., 2:]).all(-1) & (p[..., 2] < float(face["far"]))
                within = np.linalg.norm(centre - face["origin"], axis=1) < float(face["far"])
                truth = inside.any(axis=1) & within & (draws["units"] > 0)
                masked = entries[(entries[:, 2] >> number & 1) == 1]
                got = np.zeros(len(draws), bool)
                got[masked[:, 0]] = True
                whole = draws["units"] == 1  # of others some meshlets may be left out
                assert got[truth & whole].all()
                extra, seen = extra + int((got & ~truth & within).sum()), seen + int(truth.sum())
        assert seen > 200 and extra < 0.15 * seen  # sampled: boxes that only touch a face count as extra
        technique = renderer.techniques["shadows"].passes["shadows"]
        for layer, drawn in enumerate(commands):
            word = int(technique.schedule.drawn[technique.schedule.rounds[-1].first + layer])
            bit, number = word >> 12 & 15, (word >> 16) - technique.schedule.rounds[-1].first
            number = list_numbers(renderer).index(number)
            entries = found[number][(found[number][:, 2] >> bit & 1) == 1]
            assert np.array_equal(drawn[:, 4], draws["instance"][entries[:, 0]])
            assert (drawn[:, 1] == 1).all() and (drawn[:, 3] == 0).all()


@pytest.mark.feature("shadows/cull-toggles")
def test_toggles_change_counts_and_no_bit_of_a_map(chapter):
    several(chapter)
    scene = lit(town(count=80), *lamps(4))
    pages, counts = [], []
    for off in (
        (),
        ("instances",),
        ("meshlets",),
        ("cones",),
        ("faces",),
        ("instances", "meshlets", "cones", "faces"),
    ):
        knobs = {f"shadow_cull_{name}": False for name in off}
        with chapter.open(scene, SIZE, replaced(BASE, shadow_sides="front", **knobs)) as renderer:
            renderer.render(VIEW).image("color")
            pages.append(all_faces(renderer))
            counts.append(sum(map(len, commanded(renderer))))
    assert all(np.array_equal(other, pages[0]) for other in pages[1:])
    assert counts[3] > counts[0] and counts[4] > counts[0] and counts[5] == max(counts)
    assert counts[5] > 4 * counts[0]


@pytest.mark.feature("shadows/per-face-fallback", "shadows/instance-culling")
@pytest.mark.parametrize("missing", ["multi-draw", "draw-indirect-count"])
def test_devices_without_indirect_draws_draw_the_same_maps(chapter, scene, missing):
    several(chapter)
    few = lit(town(count=30), *lamps(3))
    pages = []
    for without in ((), (missing,)):
        with chapter.open(few, SIZE, replaced(BASE, geometry="auto"), without=without) as renderer:
            renderer.render(VIEW).image("color")
            pages.append(all_faces(renderer))
    assert np.array_equal(*pages) and not (pages[0] > 1e29).all()


def test_rounds_have_layers_of_one_size_and_whole_lights_have_one_list():
    faces = np.zeros(6 + 3 + 1 + 6, FACE)
    faces["light"] = [1] * 6 + [0] * 3 + [2] + [3] * 6
    faces["perspective"] = faces["light"] != 0
    faces["size"] = [128] * 6 + [512] * 3 + [128] + [128] * 6
    due = np.r_[6:9, 0:6, 9:16]
    made = schedule(faces, due, 8, padded=False)
    assert [turn[:3] for turn in made.rounds] == [(512, 0, 3), (128, 3, 8), (128, 11, 5)]
    assert (made.drawn & 0xFFF).tolist() == due.tolist()
    assert (made.drawn >> 12 & 15).tolist() == [0, 0, 0, *range(6), 0, *range(6)]
    # Lists have the number of the first layer of their light in the round.
    assert (made.drawn >> 16).tolist() == [0, 1, 2, *[3] * 6, 9, 10, *[11] * 5]
    assert (made.lists & 0xFFFFFF)[made.lists > 0].tolist() == [6, 7, 8, 0, 9, 10, 10]
    assert (made.lists >> 24)[made.lists > 0].tolist() == [1, 1, 1, 6, 1, 6, 6]
    assert schedule(faces, np.arange(0)).rounds == ()
    # Rounds of a power of two of layers: frames that draw other faces have the same rounds.
    padded = schedule(faces, due, 8)
    assert [turn[:3] for turn in padded.rounds] == [(512, 0, 4), (128, 4, 8), (128, 12, 8)]
    assert padded.drawn[[3, 17, 18, 19]].tolist() == [NO_FACE] * 4
    assert (padded.drawn[padded.places] & 0xFFF).tolist() == due.tolist()
