"""The scene on the GPU: one shared buffer with aligned streams, and edits that upload what they touched and no more."""

from __future__ import annotations

import itertools
import math
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch01.scene import draw_lists, packing
from chapters.ch01.scene.geometry import STREAMS, stream_offsets, used_streams
from chapters.ch01.scene.packing import material_variant
from chapters.ch01.scene.textures.texels import half_texels
from chapters.ch01.settings import Settings
from common import layouts
from common.errors import SceneError, ShaderError
from common.images.color import decode_srgb
from common.scene import Deformation, Image, Instances, Light, Material, Sampler
from common.settings import replaced
from common.view.camera import UNIT_EV100, exposure
from tests.support.bounds import decoded_srgb
from tests.support.chapter import building, of_backend
from tests.support.scenes import facing, nodes_at, quad_scene, texture, translated

on_vulkan = pytest.mark.variants("vulkan", "without-all")
"""For tests that look at the objects behind the contract."""

SIZE = (16, 16)
SUN = Light("directional", node=1, intensity=math.pi)
MATTE = Material(metallic=0.0, roughness=1.0)
EXACT = Settings(color_format="rgba32f", background=0.0, default_light=False, tone_curve="none")
FRAME, INSTANCE = (layouts.dtype(name).itemsize for name in ("FrameConstants", "Instance"))
LIGHTS = 16 + 2 * packing.LIGHT.itemsize
DRAW = draw_lists.COMMAND.itemsize if hasattr(draw_lists, "COMMAND") else 0
"""Bytes of a draw's record. Chapter 1 has none: it records its draws anew for each frame."""

GEOMETRY = ("geometry", "page ")
"""How the names of buffers with vertices begin: one in chapter 1, then pages."""


def lit_scene(**more):
    """Return two squares side by side, of two materials, under a sun and a lamp."""
    scene = quad_scene(
        materials=(MATTE, replace(MATTE, base_color=(0.5, 0.25, 1.0, 1.0))),
        matrices=(translated(-1.0), translated(1.0)),
        instance_materials=(0, 1),
        lights=(SUN, Light("point", node=2, intensity=2.0)),
        **more,
    )
    return replace(scene, nodes=nodes_at(translated(-1.0), translated(1.0), translated(z=2.0)))


def fresh(chapter, scene, view, settings=EXACT, output="color_linear", time=0.0):
    """Return the picture of a renderer that has no past."""
    with chapter.open(scene, SIZE, settings, outputs={output}) as made:
        return made.render(view, time).image(output)


# --- the shared buffer ---


@pytest.mark.feature("geometry/shared-buffer")
@pytest.mark.parametrize("alignment", [16, 32, 64, 128, 256])
def test_streams_are_aligned_and_do_not_overlap(alignment):
    rng = np.random.default_rng(alignment)
    for _ in range(50):
        sizes = {f"stream {i}": int(size) for i, size in enumerate(rng.integers(0, 5000, rng.integers(1, 8)))}
        offsets, end = stream_offsets(sizes, alignment)
        assert all(offset % alignment == 0 for offset in offsets.values())
        ranges = sorted((offsets[name], offsets[name] + size) for name, size in sizes.items())
        assert all(a_end <= b_start for (_, a_end), (b_start, _) in itertools.pairwise(ranges))
        assert end == max(stop for _, stop in ranges)
        assert end - sum(sizes.values()) < alignment * len(sizes), "no more than the padding is lost"


@pytest.mark.feature("geometry/shared-buffer")
def test_a_draw_from_a_place_deep_in_the_buffer_equals_one_from_its_beginning(chapter):
    """The same square as the only mesh, and behind 1,000 vertices and 999 indices of others that nobody draws."""
    plain = lit_scene()
    deep = lit_scene()
    pad = np.random.default_rng(1).normal(size=(1000, 3)).astype(np.float32)
    deep.positions = np.concatenate([pad, deep.positions])
    deep.normals = np.concatenate([pad, deep.normals])
    deep.tangents = np.concatenate([np.ones((1000, 4), np.float32), deep.tangents])
    deep.uv0 = np.concatenate([pad[:, :2], deep.uv0])
    deep.indices = np.concatenate([np.arange(999, dtype=np.uint32), deep.indices])
    deep.meshes["first_vertex"] += 1000
    deep.meshes["first_index"] += 999
    a = fresh(chapter, plain, facing(ymag=2.0))
    assert a.max() > 0.5
    assert np.array_equal(a, fresh(chapter, deep, facing(ymag=2.0)))
    deep.meshes["first_index"] -= 3
    assert not np.array_equal(a, fresh(chapter, deep, facing(ymag=2.0))), (
        "a triangle too early is another picture"
    )


@on_vulkan
def test_only_streams_that_a_material_reads_are_uploaded(chapter):
    images = (Image("grey", np.full((2, 2, 4), 128, np.uint8)),)
    colors = np.ones((4, 4), np.float32)
    cases = [
        (quad_scene(Material(unlit=True)), ["positions"]),
        (quad_scene(MATTE), ["positions", "normals"]),
        (quad_scene(Material(unlit=True), colors=colors), ["positions", "colors"]),
        (
            quad_scene(Material(unlit=True, base_color_texture=texture()), images=images),
            ["positions", "uv0"],
        ),
        (
            quad_scene(replace(MATTE, normal_texture=texture()), images=images),
            ["positions", "normals", "tangents", "uv0"],
        ),
        # An unlit material shows its base colour alone: other maps of it are not read.
        (
            quad_scene(Material(unlit=True, normal_texture=texture()), images=images),
            ["positions"],
        ),
    ]
    for scene, streams in cases:
        assert used_streams([material_variant(scene.materials[0], scene)]) == streams
        with chapter.open(scene, SIZE, EXACT) as made:
            sizes = {name: 4 * 4 * STREAMS[name][1] for name in streams} | {"indices": scene.indices.nbytes}
            held = [
                buffer
                for _, buffer in of_backend(made, "resources").buffers.items()
                if buffer.name.startswith(GEOMETRY)
            ]
            assert [buffer.size for buffer in held] == [stream_offsets(sizes)[1]]
            assert made._data.textures == ("uv0" in streams)


def shared_image():
    """Return a scene of three materials that read one image, one of them as data."""
    images = (Image("shared", np.full((4, 4, 4), 99, np.uint8)),)
    used = Material(unlit=True, base_color_texture=texture())
    return quad_scene(
        materials=(used, replace(used, base_color=(1, 0, 0, 1)), replace(MATTE, normal_texture=texture())),
        images=images,
        matrices=(np.eye(4),) * 3,
        instance_materials=(0, 1, 2),
    )


def test_an_image_is_uploaded_once_however_many_materials_share_it(chapter):
    with chapter.open(shared_image(), SIZE, EXACT) as made:
        work = made.render(facing()).work
    assert work["textures"] == 2, "once as colour (sRGB) and once as data"
    assert work["samplers"] == 2, "the materials' and the tone curve's"


@pytest.mark.until(1, "nothing is bound per material once resources are bindless")
def test_each_material_has_a_set(chapter):
    with chapter.open(shared_image(), SIZE, EXACT) as made:
        work = made.render(facing()).work
    sets = 2 + 3 + 1 if chapter.backend == "vulkan" else 0
    assert work["descriptor_sets"] == sets, "slots, materials, tone curve"


@pytest.mark.parametrize(
    ("role", "decoded"), [("base_color", True), ("emissive", True), ("occlusion", False)]
)
def test_colours_are_decoded_and_data_are_not(chapter, role, decoded):
    """The code 188 is a light of 0.503 as colour and of 188/255 as data."""
    material = {
        "base_color": Material(unlit=True, base_color_texture=texture()),
        "emissive": Material(
            base_color=(0, 0, 0, 1), metallic=1.0, emissive=(1, 1, 1), emissive_texture=texture()
        ),
        "occlusion": Material(metallic=1.0, occlusion_texture=texture()),
    }[role]
    images = (Image("code", np.full((2, 2, 4), (188, 188, 188, 255), np.uint8)),)
    settings = replaced(EXACT, ambient=1.0 if role == "occlusion" else 0.0)
    picture = fresh(chapter, quad_scene(material, images=images), facing(ev100=UNIT_EV100), settings)
    if decoded and not chapter.device.capabilities.is_software:
        low, high = decoded_srgb(np.array(188))
        assert (low <= picture).all() and (picture <= high).all()
    else:
        code = 188 / 255
        assert np.allclose(picture, decode_srgb(np.array(code)) if decoded else code, rtol=2e-3)


@on_vulkan
def test_mip_levels_are_made_where_they_are_read(chapter):
    noise = Image("noise", np.random.default_rng(2).integers(0, 256, (64, 64, 4), dtype=np.uint8))
    mipmapped, plain = texture(0, Sampler()), texture(0, Sampler(mipmap=None))
    spread = {}
    for reference, levels in ((mipmapped, 7), (plain, 1)):
        scene = quad_scene(Material(unlit=True, base_color_texture=reference), images=(noise,))
        with chapter.open(scene, (4, 4), EXACT, outputs={"color_linear"}) as made:
            (image,) = (
                image for _, image in of_backend(made, "resources").images.items() if image.name == "noise"
            )
            assert image.levels == levels
            spread[levels] = made.render(facing()).image("color_linear").std()
    assert spread[7] < 0.25 * spread[1], "16 texels a pixel are averaged, or one of them is taken"


def test_sixteen_bits_become_half_precision_light():
    codes = np.array([[[0, 32768, 65535, 65535]]], np.uint16)
    assert np.array_equal(half_texels(codes, False), (codes / 65535.0).astype(np.float16))
    light = half_texels(codes, True)
    assert np.allclose(light[..., :3], decode_srgb(codes[..., :3] / 65535.0), rtol=2**-11)
    assert light[..., 3] == 1.0
    wild = np.array([[[np.nan, np.inf, -np.inf, 1e30]]], np.float32)
    assert np.array_equal(half_texels(wild, False)[0, 0], np.float16([0, 65504, -65504, 65504]))


def without(*what):
    """Return `lit_scene` with empty arrays."""
    scene = lit_scene()
    if "instances" in what:
        scene = replace(scene, instances=Instances(np.zeros(0, np.int32), np.zeros(0, np.int32)))
    if "meshes" in what:
        nothing = {
            name: getattr(scene, name)[:0] for name in ("positions", "normals", "tangents", "uv0", "indices")
        }
        scene = replace(scene, meshes=scene.meshes[:0], mesh_names=[], materials=[], **nothing)
    if "lights" in what:
        scene = replace(scene, lights=[])
    return scene


@pytest.mark.parametrize(
    "what", [("instances",), ("instances", "meshes"), ("instances", "meshes", "lights")], ids=str
)
def test_a_scene_of_nothing_is_its_background(chapter, what):
    outputs = {"color", "color_linear", "depth", "instance_id"}
    settings = Settings(background=0.25)
    with chapter.open(without(*what), SIZE, settings, outputs=outputs) as made:
        for _ in range(3):
            frame = made.render(facing())
        assert len(np.unique(frame.image("color"))) == 1
        assert np.allclose(frame.image("color_linear") * exposure(facing().ev100), 0.25)
        assert not frame.image("depth").any()
        assert not frame.image("instance_id").any()
        assert frame.work["draws"] == 1


# --- what a frame writes ---


def settled(made, view, time=0.0):
    """Return the last of three frames: every slot has been written, and nothing moves."""
    return [made.render(view, time) for _ in range(3)][-1]


def test_a_moved_camera_writes_one_record(chapter):
    with chapter.open(lit_scene(), SIZE, EXACT) as made:
        settled(made, facing())
        assert made.render(facing(distance=3.0)).work["bytes_written"] == FRAME


@pytest.mark.parametrize(
    ("edit", "size"),
    [
        (lambda e: e.set_transform(0, matrix=translated(-0.5, 0.5)), 2 * INSTANCE),
        # A mirrored object winds the other way round: another front face, from the next frame on.
        (
            lambda e: e.set_transform(0, matrix=translated(-1.0) @ np.diag((-0.5, 1, 1, 1))),
            2 * (INSTANCE + DRAW),
        ),
        # The node of a light: nothing that is drawn hangs there, but places of objects are one array.
        (lambda e: e.set_transform(2, matrix=translated(z=1.0)), 2 * INSTANCE + LIGHTS),
        (lambda e: e.set_material(0, replace(MATTE, base_color=(0, 1, 0, 1))), 2 * packing.MATERIAL.itemsize),
        (lambda e: e.set_light(0, replace(SUN, color=(1.0, 0.5, 0.0))), LIGHTS),
        (lambda e: e.set_visible(1, False), 2 * INSTANCE + DRAW),
    ],
    ids=["object", "mirror", "lamp", "materials", "lights", "visibility"],
)
def test_an_edit_writes_what_it_touched_and_shows_at_once(chapter, edit, size):
    """In both slots: the two frames after the edit equal that of a renderer which never knew the scene before."""
    scene, view = lit_scene(), facing(ymag=2.0)
    with chapter.open(scene, SIZE, EXACT, outputs={"color_linear"}) as made:
        before = settled(made, view).image("color_linear")
        with scene.edit() as change:
            edit(change)
        first = made.render(view)
        assert first.work["bytes_written"] == FRAME + size
        picture = first.image("color_linear")
        second = made.render(view)
        assert second.work["bytes_written"] == FRAME + size
        assert np.array_equal(second.image("color_linear"), picture)
        made.render(view)
        assert made.render(view).work["bytes_written"] == FRAME
    assert not np.array_equal(picture, before)
    assert np.array_equal(picture, fresh(chapter, scene, view))


def test_several_edits_at_once_are_all_seen(chapter):
    scene, view = lit_scene(), facing(ymag=2.0)
    with chapter.open(scene, SIZE, EXACT, outputs={"color_linear"}) as made:
        settled(made, view)
        for step in range(3):
            with scene.edit() as change:
                change.set_transform(0, matrix=translated(-1.0, 0.3 * step))
                change.set_light(1, Light("point", node=2, intensity=1.0 + step))
                change.set_visible(1, step % 2 == 0)
            assert np.array_equal(made.render(view).image("color_linear"), fresh(chapter, scene, view))


def test_an_object_that_stops_is_written_one_frame_longer(chapter):
    """Its previous transform must become its present one, or motion vectors of later chapters would go on."""
    scene = lit_scene()
    with chapter.open(scene, SIZE, EXACT) as made:
        settled(made, facing())
        with scene.edit() as change:
            change.set_transform(0, matrix=translated(0.5))
        flags = []
        for _ in range(4):
            made.render(facing())
            flags.append(bool(made._data.records.instances["flags"][0] & layouts.INSTANCE_MOVED))
            slots = [slot.instances.view(layouts.dtype("Instance"))[0] for slot in made._data.slots]
        assert flags == [True, False, False, False]
        assert all((r["world_from_object"] == r["previous_world_from_object"]).all() for r in slots)


@pytest.mark.parametrize(
    ("cut", "time"), [(True, 2.0), (False, 0.5), (False, 2.0)], ids=["cut", "backwards", "onwards"]
)
def test_a_cut_forgets_the_frame_before(chapter, cut, time):
    """A view that says so, and time that runs backwards: camera, time and objects are now where they were before."""
    scene = lit_scene()
    with chapter.open(scene, SIZE, EXACT) as made:
        made.render(facing(), 1.0)
        with scene.edit() as change:
            change.set_transform(0, matrix=translated(0.5))
        made.render(replace(facing(distance=3.0), cut=cut), time)
        constants = made._data.slots[1].frame.view(layouts.dtype("FrameConstants"))[0]
        moved = bool(made._data.records.instances["flags"][0] & layouts.INSTANCE_MOVED)
    fresh_start = cut or time < 1.0
    assert (constants["previous_view_from_world"] == constants["view_from_world"]).all() == fresh_start
    assert constants["delta_time"] == (0.0 if fresh_start else 1.0)
    assert moved == (not fresh_start)
    assert constants["frame_index"] == 1, "it is no reset"


def test_lights_follow_the_exposure(chapter):
    """They are stored pre-exposed: as often as the exposure changes, in whichever slot."""
    scene = lit_scene()
    expected = {ev: fresh(chapter, scene, facing(ev100=ev)) for ev in (0.0, 4.0, -3.0)}
    with chapter.open(scene, SIZE, EXACT, outputs={"color_linear"}) as made:
        for ev in (0.0, 4.0, 4.0, -3.0, 0.0, 0.0, 4.0):
            picture = made.render(facing(ev100=ev)).image("color_linear")
            assert np.array_equal(picture, expected[ev])
    assert expected[0.0].max() > 0.1


def test_after_a_reset_nothing_has_moved(chapter):
    scene = lit_scene()
    with chapter.open(scene, SIZE, EXACT) as made:
        settled(made, facing())
        with scene.edit() as change:
            change.set_transform(0, matrix=translated(0.5))
        made.reset_history("test")
        assert not made.idle(facing()), "the next frame is a first one"
        made.render(facing())
        assert not (made._data.records.instances["flags"] & layouts.INSTANCE_MOVED).any()
        assert made.idle(facing())
        made.reset_history("test")
        assert not made.idle(facing())


# --- edits that change what a material needs ---

GREY = Image("grey", np.full((4, 4, 4), (200, 100, 50, 128), np.uint8))
STRUCTURAL = {
    "unlit": replace(MATTE, unlit=True, base_color=(0.3, 0.6, 0.9, 1.0)),
    "blend": replace(MATTE, alpha_mode="blend", base_color=(1.0, 0.2, 0.2, 0.4)),
    "mask": replace(MATTE, alpha_mode="mask", base_color_texture=texture(), alpha_cutoff=0.6),
    "textured": replace(MATTE, base_color_texture=texture()),
    "normal map": replace(MATTE, normal_texture=texture()),
    "double sided": replace(MATTE, double_sided=True),
}


@pytest.mark.parametrize("name", STRUCTURAL)
def test_a_material_may_become_another_kind(chapter, name):
    """Another pipeline, other textures, other vertex streams: the picture is that of a scene opened like this."""
    scene, view = lit_scene(images=(GREY,)), facing(ymag=2.0)
    outputs = {"color_linear", "instance_id"}
    matte = fresh(chapter, scene, view)
    alive = len(chapter.device.alive)
    with chapter.open(scene, SIZE, EXACT, outputs=outputs) as made:
        settled(made, view)
        with scene.edit() as change:
            change.set_material(0, STRUCTURAL[name])
        frames = [made.render(view), made.render(view)]
        pictures = [frame.image("color_linear") for frame in frames]
        ids = frames[1].image("instance_id")
        assert made.render(view).work["bytes_written"] == FRAME
        with scene.edit() as change:
            change.set_material(0, MATTE)
        last = made.render(view)
        back = last.image("color_linear")
        assert last.work["textures"] == 0, "what no material reads any more is given up"
    assert len(chapter.device.alive) == alive
    assert np.array_equal(back, matte)
    with scene.edit() as change:
        change.set_material(0, STRUCTURAL[name])
    for picture in pictures:
        assert np.array_equal(picture, fresh(chapter, scene, view))
    assert np.array_equal(ids, fresh(chapter, scene, view, output="instance_id"))


def test_an_edit_that_cannot_be_followed_says_so_until_it_is_mended(chapter):
    scene, view = lit_scene(images=(GREY,)), facing(ymag=2.0)
    with chapter.open(scene, SIZE, EXACT, outputs={"color_linear"}) as made:
        expected = settled(made, view).image("color_linear")
        with scene.edit() as change:
            change.set_material(0, replace(MATTE, base_color_texture=texture(7)))
        for _ in range(2):
            with pytest.raises(
                SceneError, match="Material 0 reads image 7 as its base_color, but there are 1 images"
            ):
                made.render(view)
        with scene.edit() as change:
            change.set_material(0, MATTE)
        assert np.array_equal(made.render(view).image("color_linear"), expected)


def test_an_edit_whose_pipelines_are_refused_is_done_anew(chapter, monkeypatch):
    """As while a shader has a fault. The sets and textures are made by then, and frames must not draw half of it."""
    scene, view = lit_scene(images=(GREY, GREY)), facing(ymag=2.0)

    def refuse(*_):
        raise ShaderError("no")

    with chapter.open(scene, SIZE, EXACT, outputs={"color_linear", "instance_id"}) as made:
        settled(made, view)
        with scene.edit() as change:
            more = replace(MATTE, base_color_texture=texture(0), normal_texture=texture(1), alpha_mode="mask")
            change.set_material(0, more)
        with monkeypatch.context() as patched:
            patched.setattr(made._pipelines, "get", refuse)
            for _ in range(2):
                with pytest.raises(ShaderError, match="no"):
                    made.render(view)
        for _ in range(2):
            assert np.array_equal(made.render(view).image("color_linear"), fresh(chapter, scene, view))


def test_an_image_larger_than_the_device_takes_is_one_sentence(chapter):
    """When it is opened and when it is edited; a driver need not notice."""
    most = chapter.device.capabilities.limits["maxImageDimension2D"]
    scene, view = lit_scene(images=(GREY, Image("long", np.zeros((1, most + 1, 4), np.uint8)))), facing()
    said = rf"^Image 1 \('long'\) has {most + 1}x1 pixels, and material 0 .* no side longer than {most}\.$"
    long = replace(MATTE, base_color_texture=texture(1))
    alive = len(chapter.device.alive)
    with chapter.open(scene, SIZE, EXACT) as made:
        with scene.edit() as change:
            change.set_material(0, long)
        for _ in range(2):
            with pytest.raises(SceneError, match=said):
                made.render(view)
    with pytest.raises(SceneError, match=said):
        chapter.open(scene, SIZE, EXACT)
    assert len(chapter.device.alive) == alive


def test_a_skin_keeps_its_pose_when_its_material_reads_more(chapter):
    """New streams are a new buffer, at rest: the posed vertices must be copied into it, in both slots."""
    scene = skinned_scene()
    scene.images.append(GREY)
    with chapter.open(scene, SIZE, EXACT, outputs={"instance_id"}) as made:
        before = settled(made, facing()).image("instance_id")
        with scene.edit() as change:
            change.set_material(0, Material(unlit=True, base_color_texture=texture()))
        for _ in range(2):
            assert np.array_equal(made.render(facing()).image("instance_id"), before)
    assert before.sum() == 8 * 8


@on_vulkan
def test_other_textures_leave_the_geometry_where_it_is(chapter):
    images = (GREY, replace(GREY, name="other"))
    scene = quad_scene(Material(unlit=True, base_color_texture=texture(0)), images=images)
    with chapter.open(scene, SIZE, EXACT) as made:
        settled(made, facing())
        before = list(made._data._geometry)
        with scene.edit() as change:
            change.set_material(0, Material(unlit=True, base_color_texture=texture(1)))
        settled(made, facing())
        assert made._data._geometry == before
        with scene.edit() as change:
            change.set_material(0, Material(unlit=True))
        settled(made, facing())
        assert made._data._geometry != before, "without textures there are no uv coordinates either"


def test_other_factors_build_nothing(chapter):
    """Colours, roughness, cutoff, transforms of textures: numbers in a record, and the same pipelines and sets."""
    material = replace(MATTE, alpha_mode="mask", base_color_texture=texture())
    scene = quad_scene(material, images=(GREY,), lights=(replace(SUN, node=0),))
    with chapter.open(scene, SIZE, EXACT, outputs={"color_linear"}) as made:
        settled(made, facing())
        changed = replace(
            material, roughness=0.3, alpha_cutoff=0.1, base_color_texture=texture(offset=(0.5, 0.0))
        )
        with chapter.calls() as calls:
            with scene.edit() as change:
                change.set_material(0, changed)
            picture = made.render(facing()).image("color_linear")
    assert not building(calls)
    assert np.array_equal(picture, fresh(chapter, scene, facing()))


# --- what moves by itself ---


def test_the_default_light_follows_the_camera(chapter):
    """A scene without lights is lit from beside the camera, wherever that goes, in both slots."""
    scene = quad_scene(replace(MATTE, double_sided=True))
    behind = replace(facing(), world_from_view=np.diag((-1.0, 1.0, -1.0, 1.0)) @ facing().world_from_view)
    lit = Settings(color_format="rgba32f")
    expected = [fresh(chapter, scene, view, lit) for view in (facing(), behind)]
    with chapter.open(scene, SIZE, lit, outputs={"color_linear"}) as made:
        for _ in range(2):
            for view, picture in ((facing(), expected[0]), (behind, expected[1]), (behind, expected[1])):
                assert np.array_equal(made.render(view).image("color_linear"), picture)
    assert expected[1].mean() > 0.5, "the far side is not in the dark"


def skinned_scene():
    """Return a square bound to one joint, node 1, whose place only an edit can change."""
    scene = quad_scene(Material(unlit=True))
    deformation = Deformation(
        mesh=0,
        node=0,
        joints=np.array([1], np.int32),
        inverse_bind=np.eye(4)[None],
        vertex_joints=np.zeros((4, 4), np.int32),
        vertex_weights=np.tile((1.0, 0.0, 0.0, 0.0), (4, 1)),
    )
    half = np.diag((0.5, 0.5, 1.0, 1.0))
    return replace(scene, nodes=nodes_at(np.eye(4), half), deformations=[deformation])


def test_a_joint_that_is_edited_moves_its_skin(chapter):
    scene = skinned_scene()
    with chapter.open(scene, SIZE, EXACT, outputs={"instance_id"}) as made:
        assert settled(made, facing()).image("instance_id").sum() == 8 * 8
        with scene.edit() as change:
            change.set_transform(1, matrix=np.diag((1.0, 0.25, 1.0, 1.0)))
        for _ in range(3):
            ids = made.render(facing()).image("instance_id")
            assert (ids[6:10] == 1).all()
            assert ids.sum() == 16 * 4


def drawn_from(made, slot):
    """Return what stands for the geometry that a slot's frame draws from."""
    data = made._data
    return data.bound_page(slot, 0)[0] if hasattr(data, "bound_page") else data.slots[slot].geometry


def test_deforming_vertices_exist_once_per_slot_and_others_once(chapter):
    """One frame's vertices are written while the GPU may still read the other's."""
    for scene, copies in ((skinned_scene(), 2), (quad_scene(), 1)):
        with chapter.open(scene, SIZE, EXACT) as made:
            assert len({drawn_from(made, slot) for slot in range(len(made._data.slots))}) == copies
            held = [name for name in chapter.device.alive.values() if name and name.startswith(GEOMETRY)]
            assert len(held) == copies * (2 if chapter.backend == "gl" else 1), "and its vertex arrays"


def test_a_skin_that_stands_still_is_not_copied_again(chapter):
    with chapter.open(skinned_scene(), SIZE, EXACT) as made:
        settled(made, facing())
        assert made.render(facing(), time=7.0).work["bytes_written"] == FRAME


@pytest.mark.feature("device/debug-names-and-markers")
@on_vulkan
def test_every_object_of_a_renderer_has_a_name(chapter):
    images = (GREY,)
    scene = lit_scene(images=images)
    scene.materials[0] = replace(MATTE, base_color_texture=texture(), name="wall")
    before = set(chapter.device.alive)
    with chapter.open(scene, SIZE, EXACT, outputs={"color", "depth"}) as made:
        made.render(facing()).image("color")
        named = {key: name for key, name in chapter.device.alive.items() if key not in before}
    without = sorted({kind for (kind, _), name in named.items() if not name})
    assert not without
    kinds = {kind for kind, _ in named}
    assert {"VkBuffer", "VkImage", "VkImageView", "VkSampler", "VkPipeline", "VkQueryPool"} <= kinds
    names = set(named.values())
    assert any(name.startswith(GEOMETRY) for name in names)
    for part in ("instances, slot 1", "grey", "color_hdr", "depth", "tonemap", "frame slot 0"):
        assert any(part in name for name in names), part
