"""The views and the overlay of culling: colours are those of the flags, bounds and depths that they stand for."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch06.culling.choice import choose, wants_meshlets
from chapters.ch06.culling.lists import WHOLE
from chapters.ch06.culling.spheres import sphere_records
from chapters.ch06.meshlets.scene import meshlets_of
from chapters.ch06.settings import Settings
from common.errors import SettingError
from common.images import palette
from common.numerics.transforms import pose_looking_at
from common.scene import Material
from common.settings import replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.culled import box_margins, commands, words
from tests.support.towns import OPAQUE, TWO_SIDED, ball, cube, of_shapes, town, walk
from tests.twins.bounds import pyramid_levels

SIZE = (120, 72)
EXACT = Settings(color_format="rgba32f", anisotropy=1.0, ambient=0.3)
BLUE, ORANGE = np.array((0.3, 0.6, 1.0)), np.array((1.0, 0.6, 0.1))


@pytest.fixture(scope="module")
def scene():
    return town()


def ways(chapter):
    """Return the geometries that the device has, but for the classic one where it has others."""
    several, tasks = (chapter.device.has(name) for name in ("multi-draw", "mesh-shader"))
    return [*["compute"] * several, *["mesh"] * tasks] or ["classic"]


def look(chapter, scene, views, size=SIZE, **turned):
    """Return the stored colour, the ids and the depth of the last of several frames, and the draw commands."""
    settings = replaced(EXACT, **turned)
    with chapter.open(scene, size, settings, outputs={"color_linear", "instance_id", "depth"}) as renderer:
        for view in views:
            frame = renderer.render(view)
        images = [frame.image(name).copy() for name in ("color_linear", "instance_id", "depth")]
        return (*images, renderer)


def places_of(depth, view, size=SIZE):
    """Return (H, W, 3) the points in the world that a depth shows."""
    x, y = ((np.arange(side) + 0.5) / side * 2 - 1 for side in size)
    clip = np.stack([*np.meshgrid(x, y), depth, np.ones_like(depth)], axis=-1)
    world = clip @ np.linalg.inv(view.clip_from_world(size[0] / size[1])).T
    return world[..., :3] / np.where(world[..., 3:] == 0, 1.0, world[..., 3:])


# --- views ------------------------------------------------------------------------------------------------------------


@pytest.mark.variants("vulkan", "gl")
@pytest.mark.parametrize(
    "view", [pytest.param("depth", marks=pytest.mark.long), "triangle-id", "overdraw", "light-count"]
)
def test_other_views_show_with_culling_what_they_show_without(chapter, scene, view):
    way = ways(chapter)[0]
    uncut = look(chapter, scene, walk()[:2], view=view, culling="off", geometry=way)
    culled = look(chapter, scene, walk()[:2], view=view, culling="occlusion", geometry=way)
    for one, other in zip(uncut[:3], culled[:3], strict=True):
        assert np.array_equal(one, other)


def test_a_meshlet_has_the_colour_of_its_number_and_a_whole_mesh_is_grey(chapter, scene):
    """The point that a pixel shows lies in the box of a meshlet of that colour."""
    view, meshlets = walk()[1], meshlets_of(scene)
    for way in ways(chapter):
        color, ids, depth, _ = look(chapter, scene, walk()[:2], view="meshlets", geometry=way)
        world = places_of(depth, view)
        cut = 0
        for instance in np.unique(ids[ids > 0]) - 1:
            mesh, here = scene.instances.mesh[instance], ids == instance + 1
            if scene.materials[scene.meshes["material"][mesh]].alpha_mode == "mask":
                continue
            shown = color[here].astype(np.float64)
            # Blended objects are drawn over what the ids name.
            first, number = meshlets.ranges[mesh] if way != "classic" else (0, 0)
            if not number:
                grey = (np.ptp(shown, axis=1) < 1e-6) & (shown[:, 0] > 0.29) & (shown[:, 0] < 0.41)
                assert grey.mean() > 0.5
                continue
            records = meshlets.records[first : first + number]
            colors = palette.id_color(palette.part_id(instance, 1 + np.arange(first, first + number) % 63))
            off = np.abs(shown[:, None] - colors).max(axis=2)
            named, nearest = off.min(axis=1) < 1e-3, off.argmin(axis=1)
            matrix = np.linalg.inv(scene.nodes.matrix[scene.instances.node[instance]])
            points = world[here] @ matrix[:3, :3].T + matrix[:3, 3]
            out = np.abs(points - records["centre"][nearest]) - records["extent"][nearest]
            assert (out[named] < 0.02).all(), "it is another meshlet that is there"
            assert named.any() or np.ptp(shown) < 0.2
            cut += int(named.sum())
        assert cut > 500 or way == "classic"


@pytest.mark.variants("vulkan", "gl")
def test_meshlets_keep_their_colours_and_both_paths_have_the_same(chapter, scene):
    pictures = [
        look(chapter, scene, views, view="meshlets", geometry=way)
        for way in ways(chapter)
        for views in (walk()[:1], walk()[:3] + walk()[:1])
    ]
    color, ids = pictures[0][:2]
    for other in pictures[1:]:
        same = (color == other[0]).all(axis=2)
        assert (
            same[ids == other[1]].mean() > 0.995
        )  # edges of mesh shaders may lie 1/256 pixel beside the others


@pytest.mark.variants("vulkan", "gl")
def test_commands_name_meshlets_and_phases_above_their_vertices(chapter, scene):
    """The highest byte of the vertex offset: the meshlet whose first index the command has, and the phase."""
    if "compute" not in ways(chapter):
        pytest.skip("the device draws one command with each call")
    meshlets, mesh = meshlets_of(scene), scene.instances.mesh
    with chapter.open(
        scene, SIZE, replaced(EXACT, view="survivors", geometry="compute"), outputs={"color_linear"}
    ) as renderer:
        for view in (*walk()[:2], walk()[-2]):
            renderer.render(view)
        listed = [np.concatenate(commands(renderer, phase)).astype(np.int64) for phase in (0, 1)]
        starts = renderer._data.first_index
    assert all(len(rows) for rows in listed)
    for phase, rows in enumerate(listed):
        code, of = rows[:, 3] >> 24, mesh[rows[:, 4]]
        first, number = meshlets.ranges[of].T.astype(np.int64)
        assert (rows[:, 3] == code << 24).all() and (code >> 6 == phase).all()
        assert ((code & 63 == 0) == (number == 0)).all()
        for row in np.flatnonzero(number):
            mine = meshlets.records["first_index"][first[row] : first[row] + number[row]]
            found = first[row] + np.flatnonzero(mine + starts[of[row]] == rows[row, 2])[0]
            assert code[row] & 63 == 1 + found % 63


def test_survivors_are_blue_if_drawn_early_and_orange_if_drawn_late(chapter, scene):
    solid = np.array([scene.materials[k].alpha_mode != "blend" for k in scene.meshes["material"]])
    for way in ways(chapter):
        drawn = {}
        for views in (walk()[:2], [*walk()[:2], walk()[-2]]):
            color, ids, _, _ = look(chapter, scene, views, view="survivors", geometry=way)
            shown = color.reshape(-1, 3).astype(np.float64)
            shares = [
                np.abs(shown / np.maximum(shown.max(axis=1, keepdims=True), 1e-6) - tint).max(axis=1) < 0.01
                for tint in (BLUE, ORANGE)
            ]
            drawn[len(views)] = shares, ids
            assert solid[scene.instances.mesh[np.unique(ids[ids > 0]) - 1]].all()
            brightness = shown.max(axis=1)[shares[0] | shares[1]]
            assert ((brightness > 0.37) & (brightness <= 1.0)).all()
            assert (brightness < 0.51).any(), "there are whole meshes"
            assert (brightness > 0.74).any() == (way != "classic")
        (early, late), _ = drawn[2]
        assert early.mean() > 0.5 and not late.any(), "a short step shows nothing new here"
        (early, late), _ = drawn[3]
        assert early.any() and late.mean() > 0.05, "a jump does"


def test_views_of_meshlets_have_some_in_a_small_scene_unless_it_is_told_otherwise(chapter):
    few, plan, device = town(count=8), None, chapter.device.capabilities
    with chapter.open(few, SIZE, EXACT) as renderer:
        plan = renderer.plan
        assert renderer.techniques["culling"].choice.runs is False
    expected = {"meshlets": "off", "survivors": "occlusion"}
    for view, mode in expected.items():
        auto = replaced(EXACT, view=view)
        choice = choose(few, auto, plan, device)
        assert choice.mode == mode and wants_meshlets(few, auto)
        assert (choice.geometry == "classic") == (ways(chapter) == ["classic"])
        classic = replaced(auto, geometry="classic")
        assert choose(few, classic, plan, device).geometry == "classic" and not wants_meshlets(few, classic)
    color = look(chapter, few, walk()[:1], view="meshlets", geometry="classic")[0]
    assert (np.ptp(color, axis=2) == 0).all() and color.any()


# --- the overlay ------------------------------------------------------------------------------------------------------

ASIDE = View(pose_looking_at((0.0, 1.2, 9.0), (0.0, 0.4, 0.0)), Perspective(0.7, 0.1))
ABOVE = View(
    pose_looking_at((0.0, 20.0, 0.0), (0.0, 0.0, 0.0), up=(0.0, 0.0, -1.0)), Orthographic(8.0, 0.1, 40.0)
)
SQUARE = (320, 320)


def yard(shape=None):
    """Return 7 x 7 black things, 2 m from one another, before which a wall stands: nothing but lines is seen."""
    black = (
        Material(base_color=(0, 0, 0, 1), unlit=True),
        Material(base_color=(0, 0, 0, 1), unlit=True, double_sided=True),
    )
    matrices = np.tile(np.eye(4), (50, 1, 1)) * np.array((0.4, 0.4, 0.4, 1.0))[:, None]
    x, z = np.meshgrid(np.arange(-6, 7, 2), np.arange(-6, 7, 2))
    matrices[:49, 0, 3], matrices[:49, 2, 3] = x.reshape(-1), z.reshape(-1)
    matrices[49, :3, :3] = np.diag((0.4, 1.5, 0.05))
    matrices[49, :3, 3] = (-0.4, 0.7, 7.0)
    mesh = np.r_[np.zeros(49, int), 1]
    return of_shapes([shape or cube(), cube()], [OPAQUE, TWO_SIDED], mesh, matrices, black)


def from_above(chapter, scene, **turned):
    """Return the picture of a camera above a frozen view, what the last frame saw, and its counters."""
    settings = replaced(EXACT, background=0.0, sky=False, **turned)
    with chapter.open(scene, SQUARE, settings) as renderer:
        for view in (ASIDE, ASIDE):
            renderer.render(view)
        renderer.settings.culling.frozen = True
        frame = renderer.render(ABOVE)
        seen = words(renderer, "visible", 0)[: len(scene.instances)] != 0
        return frame.image("color").astype(int), seen, frame.work


def tints(picture):
    """Return (H, W) whether a pixel is of a green, red, orange, violet or yellow line, faint ones included."""
    red, green, blue = np.moveaxis(picture, 2, 0)
    there = picture.max(axis=2) > 60
    return {
        "green": there & (green > 1.5 * red),
        "red": there & (red > 2.2 * green) & (red > 2.2 * blue),
        "orange": there & (red > 1.3 * green) & (green > 2 * blue) & (red < 2.2 * green),
        "violet": there & (blue > 1.1 * red) & (red > 1.5 * green),
        "yellow": there & (np.abs(red - green) < 0.2 * red) & (green > 2 * blue),
    }


def tiles(mask):
    """Return (49,) whether any pixel around a thing of the yard is set, seen from above."""
    rows = cols = (np.arange(-6, 7, 2) + 8.0) / 16.0 * SQUARE[0]
    boxes = [
        mask[int(row) - 12 : int(row) + 13, int(col) - 12 : int(col) + 13] for row in rows for col in cols
    ]
    return np.array([box.any() for box in boxes])


@pytest.mark.feature("culling/freeze-and-debug-boxes")
@pytest.mark.parametrize("mode", [pytest.param("frustum", marks=pytest.mark.long), "occlusion", "off"])
def test_boxes_have_the_colours_of_their_flags(chapter, mode):
    scene = yard()
    for way in ways(chapter) if mode == "occlusion" else ["classic"] if mode == "off" else ways(chapter)[:1]:
        picture, seen, work = from_above(chapter, scene, culling=mode, geometry=way, culling_overlay="boxes")
        shown = tints(picture)
        green, red = tiles(shown["green"]), tiles(shown["red"])
        if mode == "off":
            seen[:] = True
            assert (work["units_drawn"] == len(scene.instances)) if way != "classic" else True
        assert (green == seen[:49]).all() and (red == ~seen[:49]).all()
        if mode == "off":
            continue
        centre = scene.nodes.matrix[:, :3, 3]
        extent = np.abs(scene.nodes.matrix[:, :3, :3]).sum(axis=2)
        margin = box_margins(centre - extent, centre + extent, ASIDE.clip_from_world(1.0))
        assert not seen[margin < -1e-4].any() and (mode == "occlusion" or seen[margin > 1e-4].all())
        assert shown["yellow"].sum() > 100, "the frozen frustum"
        assert work["instances_outside"] > 5 and (work["instances_hidden"] > 5) == (mode == "occlusion")
        assert (~seen).sum() == work["instances_outside"] + work["instances_hidden"]


def test_boxes_of_hidden_and_blended_objects(chapter, scene):
    """What the scene hides has no box; what is blended has the flag of the kernel that tests it."""
    shown = town()
    with shown.edit() as edit:
        edit.set_visible(6, False)
    blended = np.flatnonzero(
        [
            shown.materials[kind].alpha_mode == "blend"
            for kind in shown.meshes["material"][shown.instances.mesh]
        ]
    )
    settings = replaced(EXACT, culling="occlusion", culling_overlay="boxes", culling_frozen=True)
    with chapter.open(shown, SIZE, settings) as renderer:
        for view in (*walk()[:2], walk()[-1]):
            renderer.render(view)
        seen = [words(renderer, "visible", slot)[: len(shown.instances)] for slot in (0, 1)]
    assert np.array_equal(*seen) and not seen[0][6]
    blended = blended[blended != 6]
    if chapter.device.has("multi-draw"):
        assert 0 < seen[0][blended].sum() < len(blended)
    else:
        assert seen[0][blended].all(), "nothing tests them"


@pytest.mark.variants("vulkan", "gl")
def test_spheres_have_the_colour_of_the_test_that_left_them_out(chapter):
    scene = yard(ball(24, 40))
    way = ways(chapter)[0]
    picture, seen, work = from_above(
        chapter, scene, culling="occlusion", geometry=way, culling_overlay="spheres"
    )
    shown = tints(picture)
    assert tiles(shown["green"])[seen[:49]].all() and not tiles(shown["violet"])[~seen[:49]].any()
    assert shown["red"].any() == (work["meshlets_outside"] > 0)
    assert shown["violet"].any() == (work["meshlets_away"] > 0) == (way != "classic")
    assert shown["orange"].any() == (work["meshlets_hidden"] > 0)


def test_spheres_are_those_of_all_units_or_of_some_that_are_evenly_spread(chapter, scene):
    way = ways(chapter)[0]
    with chapter.open(scene, SIZE, replaced(EXACT, culling="occlusion", geometry=way)) as renderer:
        renderer.render(walk()[0])
        lists = renderer.techniques["culling"].memory.lists
    meshlets = None if way == "classic" else meshlets_of(scene)
    records = sphere_records(lists, meshlets)
    assert len(records) == lists.draws["units"].sum()
    row = 0
    for draw in lists.draws:
        for unit in range(int(draw["units"])):
            assert (records[row]["instance"], records[row]["flags"]) == (draw["instance"], draw["flags"])
            if not draw["flags"] & WHOLE:
                truth = meshlets.records[draw["first_meshlet"] + unit]
                assert all(
                    np.array_equal(records[row][name], truth[name])
                    for name in ("centre", "radius", "extent", "cone")
                )
            row += 1
    fewer = sphere_records(lists, meshlets, 20)
    assert np.array_equal(fewer, records[np.arange(20) * len(records) // 20])


@pytest.mark.variants("vulkan", "gl")
@pytest.mark.parametrize("level", [pytest.param(1, marks=pytest.mark.long), 3, 14])
def test_the_overlay_shows_a_level_of_the_pyramid_as_grey(chapter, scene, level):
    """A view that stands still draws nothing late: the depth of the early phase is that of the frame."""
    views = [walk()[0], View(walk()[0].world_from_view, Orthographic(4.0, 0.1, 60.0))]
    size = (121, 71)
    settings = replaced(
        EXACT, culling="occlusion", culling_overlay="pyramid", culling_level=level, tone_curve="none"
    )
    with chapter.open(scene, size, settings, outputs={"color", "depth"}) as renderer:
        for view in views:
            for _ in range(3):
                frame = renderer.render(view)
            depth, codes = frame.image("depth"), frame.image("color").astype(int)
            levels = pyramid_levels(depth)
            texels = levels[min(level, len(levels)) - 1].astype(np.float64)
            rows, cols = (np.arange(side) >> min(level, len(levels)) for side in size[::-1])
            farthest, projection = texels[rows][:, cols], view.projection
            with np.errstate(divide="ignore"):
                distance = (
                    projection.near / farthest
                    if isinstance(projection, Perspective)
                    else projection.near + (1 - farthest) * (projection.far - projection.near)
                )
            scale = 0.25 * scene.length_scale
            grey = np.where(farthest > 0, scale / (scale + distance), 0.0)
            assert np.abs(codes - 255 * grey[..., None]).max() <= 1.01
            assert len(np.unique(codes)) > 3 or level == 14


@pytest.mark.variants("vulkan")
def test_a_pyramid_that_is_not_there_is_refused_in_a_sentence(chapter, scene):
    for mode in ("off", "cone"):
        with pytest.raises(
            SettingError, match=r"culling=\w+ there is no depth pyramid .* set culling=occlusion\.$"
        ):
            chapter.open(scene, SIZE, replaced(EXACT, culling=mode, culling_overlay="pyramid"))


@pytest.mark.variants("vulkan", "gl")
def test_without_an_overlay_nothing_of_it_exists_and_with_one_only_colours_change(chapter, scene):
    """Under views that count there is none: its colours would be counts."""
    outputs = {"color_linear", "depth", "instance_id"}
    found = {}
    for name, turned in {
        "plain": {"graph": "forward"},
        "boxes": {"culling_overlay": "boxes"},
        "counts": {"culling_overlay": "boxes", "view": "overdraw"},
        "no boxes": {"view": "overdraw"},
    }.items():
        with chapter.open(
            scene, SIZE, replaced(EXACT, culling="occlusion", **turned), outputs=outputs
        ) as renderer:
            for view in walk()[:2]:
                frame = renderer.render(view)
            found[name] = {output: frame.image(output).copy() for output in outputs}, frame.work["pipelines"]
            titles = [built.described.name for built in renderer._pipelines._built.values()]
            assert any("overlay" in title for title in titles) == (name == "boxes")
    (plain, pipelines), (boxes, more) = found["plain"], found["boxes"]
    assert more == pipelines + 4
    changed = (plain["color_linear"] != boxes["color_linear"]).any(axis=2)
    assert 0.02 < changed.mean() < 0.9
    for name in ("depth", "instance_id"):
        assert np.array_equal(plain[name], boxes[name])
    assert found["counts"][1] == found["no boxes"][1]
    assert np.array_equal(found["counts"][0]["color_linear"], found["no boxes"][0]["color_linear"])
