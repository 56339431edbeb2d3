"""The study edited-draws: the commands that a kernel leaves, and the pixels of all ways against each other."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from backends.gl import api as gl
from chapters.ch06.studies.edited_draws import Settings, circle
from chapters.ch06.studies.edited_draws.records import MATERIALS, pack, unpack
from common.errors import UnsupportedError, UserError
from tests.support.hazards import find_hazards
from tests.support.kernel_calls import events_of, gl_calls, owed, use, without_each

multi = pytest.mark.feature("gpu-driven/multi-draw-indirect")
bases = pytest.mark.feature("gpu-driven/base-instance")
counts = pytest.mark.feature("gpu-driven/indirect-count")
records = pytest.mark.feature("gpu-driven/draw-records")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
only_gl = pytest.mark.parametrize("stage", ["gl"], indirect=True, scope="module")
WHICH = "6/edited-draws"
SIZE = (96, 72)
OUTPUTS = ("color", "depth", "instance_id")
ABOVE = "0,4.5,0.01:0,0,0"
"""A camera from which no object hides another."""


def drawn(stage, settings, time=0.0, camera=None, size=SIZE, **more):
    """Return the outputs of a frame, its counters, and the renderer's way."""
    with stage.open(WHICH, size, settings=settings, outputs=OUTPUTS, **more) as renderer:
        frame = renderer.render(chapters.view_of(renderer, camera), time)
        return {name: frame.image(name) for name in OUTPUTS}, frame.work, renderer.way


def same(one, other):
    return all((one[name] == other[name]).all() for name in OUTPUTS)


def numbers(images):
    """Return the numbers that the target of ids shows."""
    return {int(number) - 1 for number in np.unique(images["instance_id"]) if number}


def inside_by_hand(renderer, settings, time):
    """Return which objects lie inside, in double precision; none is close to the circle's edge."""
    x, z, radius, _ = circle(settings, time).astype(float)
    away = np.hypot(renderer.drawn.objects[:, 0, 3] - x, renderer.drawn.objects[:, 2, 3] - z)
    assert np.abs(away - radius).min() > 1e-6
    return away <= radius


# --- commands ---------------------------------------------------------------------------------------------------------


@multi
@pytest.mark.parametrize("objects", [1, 3, 257, 1000])
@pytest.mark.parametrize("time", [0.0, 2.1])
def test_the_kernel_keeps_what_is_inside_in_the_order_of_the_scene(stage, objects, time):
    for way in ("count", "zero"):
        settings = Settings(objects, way=way)
        with stage.open(WHICH, (8, 8), settings=settings) as renderer:
            frame = renderer.render(chapters.view_of(renderer), time)
            edited, work = renderer.commands_after(), frame.work
            kept = inside_by_hand(renderer, settings, time)
            before, parts = renderer.drawn.commands, renderer.drawn.parts
        if way == "zero":
            assert (edited["instance_count"] == kept).all()
            edited["instance_count"] = 1
            assert (edited == before).all()
            continue
        assert work["counted"] == kept.sum()
        for first, count in parts:
            part = slice(first, first + count)
            number = kept[part].sum()
            assert (edited[part][:number] == before[part][kept[part]]).all()
            assert (np.sort(edited[part]) == np.sort(before[part])).all()  # nothing lost, nothing twice


@multi
@pytest.mark.parametrize("way", ["count", "zero"])
@pytest.mark.parametrize("time", [0.0, 1.3])
def test_one_call_a_part_draws_the_bits_of_separate_draws(stage, way, time):
    settings = Settings(120, way=way)
    images, work, _ = drawn(stage, settings, time)
    apart, calls, _ = drawn(stage, Settings(120, way="separate"), time)
    assert same(images, apart) and len(numbers(images)) > 20
    assert work["calls"] == 2 * 2 and work["draws"] == 2 * 120  # two parts, for colours and for ids
    with stage.open(WHICH, (8, 8), settings=settings) as renderer:
        kept = int(inside_by_hand(renderer, settings, time).sum())
    assert calls["calls"] == calls["draws"] == 2 * kept and 20 < kept < 100


@multi
def test_a_circle_of_radius_0_draws_nothing_and_a_large_one_everything(stage):
    for way in ("count", "zero", "separate"):
        images, _, _ = drawn(stage, Settings(40, 0.0, way))
        assert not images["depth"].any() and len(np.unique(images["color"].reshape(-1, 3), axis=0)) == 1
        images, _, _ = drawn(stage, Settings(40, 9.0, way), camera=ABOVE)
        assert numbers(images) == {*range(40)}


@multi
def test_what_a_device_lacks_is_drawn_in_another_way_with_the_same_bits(stage):
    images, _, way = drawn(stage, Settings(60))
    assert way == "count"
    for lacking, other in (({"draw-indirect-count"}, "zero"), ({"multi-draw"}, "separate")):
        found, _, way = drawn(stage, Settings(60), without=lacking)
        assert way == other and same(images, found)


# --- counts -----------------------------------------------------------------------------------------------------------


@counts
@pytest.mark.parametrize("asked", [0, 1, 7, 30, 31, 1 << 17])
def test_counts_are_honoured_and_clamped_at_the_length_of_the_list(stage, asked):
    """Behind the commands of the first part lie those of the second: a call that went on would draw them again."""
    settings = Settings(30, 9.0, asked=asked)
    images, work, _ = drawn(stage, settings, camera=ABOVE)
    with stage.open(WHICH, (8, 8), settings=settings) as renderer:
        parts = renderer.drawn.parts
    assert all(count > 7 for _, count in parts)
    expected = {first + i for first, count in parts for i in range(min(asked, count))}
    assert numbers(images) == expected
    assert work["counted"] == 2 * asked
    if asked >= 30:
        assert same(images, drawn(stage, Settings(30, 9.0, "separate"), camera=ABOVE)[0])


@counts
@only_gl
def test_draws_without_a_count_do_not_read_the_buffer_that_was_bound_for_one(stage):
    """Mesa's driver (25.0) does so while a parameter buffer is bound."""
    drawn(stage, Settings(30, 0.0, "count"))
    assert numbers(drawn(stage, Settings(30, 9.0, "zero"), camera=ABOVE)[0]) == {*range(30)}


# --- numbers of draws -------------------------------------------------------------------------------------------------


@bases
@pytest.mark.parametrize("way", ["count", "zero", "separate"])
def test_each_object_s_number_is_its_place_in_the_list(stage, way):
    """An object is drawn around the place at which its record says that it is."""
    settings, size = Settings(50, 9.0, way), (200, 200)
    images, _, _ = drawn(stage, settings, camera=ABOVE, size=size)
    with stage.open(WHICH, size, settings=settings) as renderer:
        view = chapters.view_of(renderer, ABOVE)
        middles = renderer.drawn.objects[:, :, 3].astype(float)
    clip = np.c_[middles, np.ones(50)] @ view.view_from_world().T @ view.clip_from_view(1.0).T
    pixels = (clip[:, :2] / clip[:, 3:] * 0.5 + 0.5) * size
    for number in range(50):
        rows, columns = np.nonzero(images["instance_id"] == number + 1)
        middle = (columns.min() + columns.max()) / 2.0, (rows.min() + rows.max()) / 2.0
        assert len(rows) > 20 and np.abs(np.array(middle) - pixels[number]).max() < 5.0


@bases
@pytest.mark.parametrize("way", ["count", "zero"])
def test_the_number_of_a_draw_counts_from_0_in_each_call(stage, way):
    settings = Settings(50, way=way)
    objects, _, _ = drawn(stage, settings)
    draws, _, _ = drawn(stage, Settings(50, way=way, show="draw"))
    with stage.open(WHICH, SIZE, settings=settings) as renderer:
        kept, parts = inside_by_hand(renderer, settings, 0.0), renderer.drawn.parts
    expected = np.zeros(51, int)
    for first, count in parts:
        # Compaction moves a command, and with it its first instance, but not the number of its draw.
        ranks = np.cumsum(kept[first : first + count]) - 1 if way == "count" else np.arange(count)
        expected[first + 1 : first + count + 1] = ranks + 1
    assert (draws["instance_id"] == expected[objects["instance_id"]]).all()
    assert (objects["depth"] == draws["depth"]).all()


@bases
def test_a_record_holds_two_numbers_of_16_bits_and_refuses_more():
    every = np.arange(65_536)
    for material, number in ((every, every[::-1]), (every, 0), (0, every), (65_535, every)):
        record = pack(material, number)
        assert record.dtype == np.uint32
        back = unpack(record)
        assert (back[0] == material).all() and (back[1] == number).all()
    assert pack(0x1234, 0xABCD) == 0xABCD1234
    for material, number, wrong in ((65_536, 0, "material"), (0, 65_536, "object"), (0, [1, -1], "object")):
        with pytest.raises(UserError, match=f"16 bits for a {wrong}, and .* is not in 0 to 65535"):
            pack(material, number)


@bases
@only_vulkan
def test_a_device_that_does_not_number_draws_is_told_in_a_sentence(stage, monkeypatch):
    monkeypatch.setattr(
        type(stage.device.physical), "lacks", lambda self, needed: "the driver lacks a feature"
    )
    with pytest.raises(UnsupportedError, match=r"the driver lacks a feature; try --set show=object\."):
        stage.open(WHICH, (4, 4), settings=Settings(show="draw"))
    stage.open(WHICH, (4, 4)).close()


# --- draw records -----------------------------------------------------------------------------------------------------


@records
@pytest.mark.parametrize("way", ["count", "separate"])
def test_pulled_vertices_are_those_of_the_vertex_input_pixel_for_pixel(stage, way):
    for time in (0.0, 1.3):
        pulled, _, _ = drawn(stage, Settings(80, way=way), time)
        fetched, _, _ = drawn(stage, Settings(80, way=way, feed="attributes"), time)
        assert same(pulled, fetched) and pulled["depth"].any()


@records
def test_a_material_that_is_not_in_the_table_is_the_default(stage):
    whole, _, _ = drawn(stage, Settings(50, 9.0), camera=ABOVE)
    short, _, _ = drawn(stage, Settings(50, 9.0, materials=4), camera=ABOVE)
    with stage.open(WHICH, SIZE, settings=Settings(50, 9.0)) as renderer:
        material = unpack(renderer.drawn.commands["first_instance"])[0]
    known = np.append(True, material < 4)[whole["instance_id"]]
    assert (whole["instance_id"] == short["instance_id"]).all() and 0.2 < known.mean() < 0.98
    assert (short["color"][known] == whole["color"][known]).all()
    default = short["color"][~known]
    assert MATERIALS[0].tolist()[:3] == [MATERIALS[0][0]] * 3  # a grey, and no other material is one
    assert (default == default[:, :1]).all() and (np.ptp(whole["color"][~known], axis=-1) > 5).all()


# --- who waits --------------------------------------------------------------------------------------------------------


@multi
@only_vulkan
@pytest.mark.parametrize("way", ["count", "zero"])
def test_each_barrier_is_needed_and_none_is_missing(stage, way):
    uses = {
        "edit": [use("edit", "edited", "compute storage_write", fresh=True)],
        "draws": [use("draws", "edited", "indirect indirect")],
    }
    if way == "count":
        uses["edit"].append(use("edit", "counts#", "compute storage_write", fresh=True))
        uses["draws"].append(use("draws", "counts#", "indirect indirect"))
    downloaded = ["counts#"] if way == "count" else []
    with stage.open(WHICH, (8, 8), settings=Settings(20, way=way)) as renderer:
        view = chapters.view_of(renderer)
        events = events_of(
            renderer, lambda number: renderer.render(view, 0.1 * number), uses, downloaded=downloaded
        )
    assert find_hazards(events, {}) == []
    own = [hazards for one, hazards in without_each(events) if "indirect" in str(one)]
    assert len(own) == 2 and all(own)


@multi
@only_gl
@pytest.mark.parametrize("way", ["count", "zero"])
def test_opengl_shows_stored_commands_to_draws(stage, way):
    command = gl.GL_COMMAND_BARRIER_BIT
    reads = {"glMultiDrawElementsIndirect": command, "glMultiDrawElementsIndirectCountARB": command}
    with stage.open(WHICH, (8, 8), settings=Settings(20, way=way)) as renderer:
        view = chapters.view_of(renderer)
        calls = gl_calls(stage.device, renderer, lambda number: renderer.render(view, 0.1 * number), 3)
    assert owed(calls, reads, command) == [] and sum(name in reads for name, _ in calls) == 3 * 2
    told = [place for place, (name, bits) in enumerate(calls) if name == "glMemoryBarrier" and bits & command]
    for left_out in told[2:4]:  # of the second frame: before the kernel, and behind it
        assert owed([one for place, one in enumerate(calls) if place != left_out], reads, command)


@bases
@pytest.mark.parametrize(
    ("set_", "said"),
    [("objects=65537", "objects must be 1 to 65536"), ("way=counts", "did you mean 'count'?")],
)
def test_what_cannot_be_is_one_sentence(strata, set_, said):
    code, _, err = strata("run", WHICH, "--set", set_)
    assert code == 2 and said in err and err.count("\n") == 1, err
