"""Many of everything: ids beyond 16 bits, images that nobody reads, and calls that do not grow with the objects."""

from __future__ import annotations

from contextlib import closing
from dataclasses import replace

import numpy as np
import pytest

from chapters.ch02.scene.packing import MATERIAL
from chapters.ch02.settings import Settings
from common import layouts
from common.scene import Image, Light, Material, Sampler, Scene
from common.view.camera import UNIT_EV100, View
from tests.ch02.test_bindless import TEXEL, Reader, one_color
from tests.support.chapter import of_backend
from tests.support.scenes import NEAREST, facing, nodes_at, quad_scene, texture

SIZE = (16, 16)
EXACT = Settings(
    color_format="rgba32f", background=0.0, default_light=False, tone_curve="none", anisotropy=1.0
)
FRAME = layouts.dtype("FrameConstants").itemsize
UNLIT = Material(unlit=True)


def grid(columns: int, rows: int, count: int, materials: tuple[Material, ...], **more: object) -> Scene:
    """Return squares of one pixel each, row by row from the top, in a picture of columns x rows; see `over`."""
    at = np.arange(count)
    places = np.tile(np.eye(4), (count, 1, 1))
    places[:, 0, 0] = places[:, 1, 1] = 0.5
    places[:, 0, 3] = at % columns + 0.5 - columns / 2
    places[:, 1, 3] = rows / 2 - 0.5 - at // columns
    scene = quad_scene(
        materials=materials, instance_materials=tuple(range(count)), matrices=(np.eye(4),), **more
    )
    instances = replace(
        scene.instances,
        node=np.arange(count, dtype=np.int32),
        mesh=(at % len(materials)).astype(np.int32),
        visible=np.ones(count, bool),
    )
    return replace(scene, nodes=nodes_at(*places), instances=instances)


def over(rows: int) -> View:
    """Return the view that shows one square of `grid` in each pixel."""
    return facing(ymag=rows / 2, ev100=UNIT_EV100)


def test_ids_of_instances_are_exact_beyond_sixteen_bits(chapter):
    """65,537 objects, a pixel each: every one shows its number."""
    count = 65_537
    scene = grid(257, 256, count, (UNLIT,))
    with chapter.open(scene, (257, 256), EXACT, outputs={"instance_id"}) as made:
        frame = made.render(over(256))
        ids = frame.image("instance_id").reshape(-1)
    assert [int(ids[number]) for number in (0, 65_535, 65_536)] == [1, 65_536, 65_537]
    assert np.array_equal(ids[:count], np.arange(1, count + 1)) and not ids[count:].any()
    assert frame.work["draws"] == 2 * count


def test_ids_of_materials_are_exact_beyond_sixteen_bits(chapter):
    """Of 65,537 materials those with the first and the last numbers, and their neighbours, say which they are."""
    count, shown = 65_537, (0, 1, 65_534, 65_535, 65_536)
    materials = [UNLIT] * count
    for number in shown:
        materials[number] = replace(UNLIT, base_color=(float(number >> 8), float(number & 255), 0.0, 1.0))
    scene = grid(len(shown), 1, len(shown), tuple(materials[number] for number in shown))
    scene.meshes["material"] = shown
    scene = replace(scene, materials=materials)
    with chapter.open(scene, (len(shown), 1), EXACT, outputs={"color_linear"}) as made:
        picture = made.render(over(1)).image("color_linear")
    assert (picture[0, :, :2] @ (256, 1)).tolist() == list(shown)


@pytest.mark.variants("vulkan")
def test_slots_of_textures_are_exact_beyond_sixteen_bits(vulkan_device):
    if not vulkan_device.has("bindless"):
        pytest.skip("the device has no descriptor indexing")
    with closing(Reader(vulkan_device, textures=65_540)) as reader:
        slots = reader.bindless._slots["texture"]
        numbers = [number for number in (1, 65_535, 65_536, slots.count - 1) if number < slots.count]
        for number in numbers:
            slots._unused = number  # as if all before had been given out
            view = reader.image("rgba32f", one_color((number, 0, 0, 1))).view
            assert reader.bindless.add(view, reader.sampler) == number
        found = reader.read([(TEXEL, number, 0, 0) for number in (*numbers, 65_534)])
    assert found[:-1, 0].tolist() == numbers
    assert found[-1].tolist() == [1, 0, 1, 1], "the dummy"


@pytest.mark.variants("without-all", "gl")
def test_layers_are_exact_up_to_the_device_s_limit(chapter):
    """One texture more than an array holds: its first and last layers, and the first of the next array."""
    limits = chapter.device.limits
    limit = limits["maxImageArrayLayers"] if chapter.backend == "gl" else limits.maxImageArrayLayers
    count = min(int(limit), 2048) + 1
    columns = 50
    rows = -(-count // columns)
    codes = np.random.default_rng(2).choice(np.array([0, 255], np.uint8), (count, 3))
    images = tuple(
        Image(f"{i}", np.array((*one, 255), np.uint8).reshape(1, 1, 4)) for i, one in enumerate(codes)
    )
    materials = tuple(replace(UNLIT, base_color_texture=texture(i, NEAREST)) for i in range(count))
    scene = grid(columns, rows, count, materials, images=images)
    with chapter.open(scene, (columns, rows), EXACT, outputs={"color_linear"}) as made:
        frame = made.render(over(rows))
        picture = frame.image("color_linear").reshape(-1, 3)[:count]
    assert np.array_equal(picture * 255, codes)
    assert frame.work["textures"] == count


def test_three_of_4096_textures_are_uploaded(chapter):
    """The picture is that of a scene which holds these three alone."""
    used = (7, 2048, 4095)
    noise = np.random.default_rng(8).integers(0, 256, (4096, 4, 4, 4), dtype=np.uint8)
    images = tuple(Image(f"image {i}", pixels) for i, pixels in enumerate(noise))
    pictures = []
    for numbers, held in ((used, images), ((0, 1, 2), tuple(images[i] for i in used))):
        materials = tuple(replace(UNLIT, base_color_texture=texture(i, Sampler())) for i in numbers)
        scene = grid(3, 1, 3, materials, images=held)
        before = {name for name in chapter.device.alive.values() if name}
        with chapter.open(scene, (48, 16), EXACT, outputs={"color_linear"}) as made:
            frame = made.render(over(1))
            pictures.append(frame.image("color_linear"))
            named = {name for name in chapter.device.alive.values() if name} - before
        assert frame.work["textures"] == 3
        on_device = {name for name in named if name.startswith("image ") and not name.endswith(" view")}
        assert len(on_device) == (1 if "image 7 and 2 more" in named or "image 0 and 2 more" in named else 3)
    assert np.array_equal(*pictures) and pictures[0].std() > 0.1


# --- calls ---


def objects(count: int) -> Scene:
    """Return squares of four materials in turns: opaque ones, one with a texture, one masked."""
    materials = (
        UNLIT,
        Material(metallic=0.0),
        replace(UNLIT, base_color_texture=texture()),
        replace(UNLIT, alpha_mode="mask"),
    )
    lights = (Light("directional", node=0, intensity=2.0),)
    return grid(
        20, 20, count, materials, lights=lights, images=(Image("grey", np.full((1, 1, 4), 99, np.uint8)),)
    )


def warm(made, view):
    """Render until each slot has been written."""
    for _ in range(3):
        made.render(view)


@pytest.mark.variants("vulkan", "gl")
def test_a_frame_makes_the_same_calls_for_any_number_of_objects(chapter):
    """The same, one by one: for four objects as for four hundred, also while the camera moves."""
    calls = {}
    for count in (4, 40, 400):
        with chapter.open(objects(count), SIZE, EXACT, outputs={"color_linear", "instance_id"}) as made:
            if not made.plan.native("multi-draw"):
                pytest.skip("the device draws one object with each call")
            warm(made, over(20))
            with chapter.calls() as names:
                work = made.render(facing(distance=3.0, ymag=10.0)).work
            calls[count] = (list(names), work["draw_calls"])
            assert work["draws"] == 2 * count
            assert work["bytes_written"] == FRAME
    assert calls[4] == calls[40] == calls[400]


@pytest.mark.core
def test_a_moving_camera_writes_one_record_however_many_objects_there_are(chapter):
    with chapter.open(objects(400), SIZE, EXACT) as made:
        warm(made, over(20))
        for step in range(3):
            assert made.render(facing(distance=2.5 + step, ymag=10.0)).work["bytes_written"] == FRAME
        with made.scene.edit() as change:
            change.set_material(0, replace(UNLIT, base_color=(1, 0, 0, 1)))
        assert made.render(over(20)).work["bytes_written"] == FRAME + 4 * MATERIAL.itemsize


def test_without_multi_draw_a_call_for_each_object_draws_the_same_bits(chapter):
    pictures = []
    outputs = ("color_linear", "instance_id", "depth")
    for without in ((), ("multi-draw",)):
        with chapter.open(objects(40), (20, 20), EXACT, outputs=outputs, without=without) as made:
            frame = made.render(over(20))
            pictures.append([frame.image(name) for name in outputs])
            several = made.plan.native("multi-draw")
            assert several == (chapter.device.has("multi-draw") and not without)
            assert frame.work["draws"] == 80
            assert frame.work["draw_calls"] == (2 * 4 if several else 80)
    assert all(np.array_equal(a, b) for a, b in zip(*pictures, strict=True))
    assert len(np.unique(pictures[0][1])) == 41


@pytest.mark.variants("vulkan")
def test_a_list_longer_than_the_device_takes_is_several_calls(chapter, monkeypatch):
    if not chapter.device.has("multi-draw"):
        pytest.skip("the device draws one object with each call")
    pictures = []
    for most in (None, 3):
        with chapter.open(objects(40), (20, 20), EXACT, outputs={"instance_id"}) as made:
            if most:
                monkeypatch.setattr(of_backend(made, "commands"), "_most", most)
            frame = made.render(over(20))
            pictures.append((frame.image("instance_id"), frame.work["draw_calls"]))
    assert np.array_equal(pictures[0][0], pictures[1][0])
    assert pictures[1][1] == 2 * 4 * 4, "ten draws of each of four kinds, three at a time"
