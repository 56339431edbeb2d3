"""Frames that fill in while textures load: placeholders, any order of arrival, budgets, failures, edits, the end."""

from __future__ import annotations

import importlib
import threading
import time
from dataclasses import replace
from itertools import permutations

import numpy as np
import pytest

import chapters
from chapters.ch03.frames.frame import SLOTS
from chapters.ch03.scene.draw_lists import COMMAND
from chapters.ch03.settings import Settings
from common.errors import SceneError
from common.images import blocks
from common.images.mips import mip_chain
from common.scene import Image, Light, Material
from common.scene.images import Chain, EncodedImage
from common.settings import knobs, replaced
from common.view.camera import UNIT_EV100
from tests.support.scenes import NEAREST, facing, quad_scene, texture, translated
from tests.support.timing import PATIENCE_S

pytestmark = pytest.mark.usefixtures("no_thread_left")
EXACT = Settings(
    color_format="rgba32f", background=0.0, default_light=False, tone_curve="none", anisotropy=1.0
)
STREAM = replaced(EXACT, loading="stream", decoding_threads=8)
UNLIT = Material(unlit=True)
COLORS = [(255, 0, 0, 255), (0, 255, 0, 255), (0, 0, 255, 255), (255, 255, 0, 255)]
WHITE = (255, 255, 255, 255)


class Gated:
    """Images whose decoders wait until they are let through, or raise."""

    def __init__(self, *pictures):
        self.gates = [threading.Event() for _ in pictures]
        self.errors = {}
        self.decoded = []
        self.images = tuple(
            EncodedImage(
                f"picture {n}", pixels.shape[1::-1], np.uint8, lambda n=n, p=pixels: self._decode(n, p)
            )
            for n, pixels in enumerate(pictures)
        )

    def _decode(self, number, pixels):
        assert self.gates[number].wait(PATIENCE_S)
        self.decoded.append(number)
        if number in self.errors:
            raise self.errors[number]
        return pixels

    def open(self, *numbers):
        for number in numbers or range(len(self.gates)):
            self.gates[number].set()


@pytest.fixture
def gated():
    made = []

    def make(*pictures):
        made.append(Gated(*pictures))
        return made[-1]

    yield make
    for one in made:
        one.open()


def plain(color, size=(1, 1)):
    return np.full((*size[::-1], 4), color, np.uint8)


def row_of(images, materials=None):
    """Return squares beside each other, over a picture of count x 1 pixels, with an image each."""
    made = materials or tuple(replace(UNLIT, base_color_texture=texture(n)) for n in range(len(images)))
    count = len(made)
    return quad_scene(
        materials=made,
        images=tuple(images),
        matrices=tuple(translated(2 * n + 1 - count) for n in range(count)),
        instance_materials=tuple(range(count)),
    )


VIEW = facing(ev100=UNIT_EV100)


def drawn(renderer):
    frame = renderer.render(VIEW)
    return frame.image("color_linear"), frame.work


def open_(chapter, scene, settings=STREAM, size=None):
    return chapter.open(scene, size or (len(scene.materials), 1), settings, outputs={"color_linear"})


def frames_until(renderer, done):
    """Render until `done(picture, work)`; return all pictures and counters."""
    found, end = [], time.monotonic() + PATIENCE_S
    while not found or not done(*found[-1]):
        found.append(drawn(renderer))
        assert time.monotonic() < end, "it never happened"
    return found


def loaded(picture, work):
    return work["textures_waiting"] == 0


@pytest.mark.variants("vulkan", "without-all")
def test_a_first_frame_that_fills_in_finds_its_records_written(chapter, gated):
    """Instances and materials of each slot: what is left are the constants, and once in each slot the draws.

    Where lights are written when they change, the 16 bytes before them are written once in each slot, too.
    """
    once = len(COLORS) * COMMAND.itemsize
    if "light_lists" in knobs(chapters.settings_class(chapter.which)):
        once += 16
    images = gated(*map(plain, COLORS))
    with open_(chapter, row_of(images.images)) as renderer:
        written = [drawn(renderer)[1]["bytes_written"] for _ in range(SLOTS + 1)]
        images.open()
    assert written[:-1] == [written[-1] + once] * SLOTS


@pytest.mark.variants("vulkan", "without-all")
def test_threads_decode_while_pipelines_are_made(chapter, gated, monkeypatch):
    """Where frames wait for textures, too: nothing here is decoded before the first pipeline is asked for."""
    images, made = gated(*map(plain, COLORS)), []
    module = importlib.import_module(f"{chapters.package_of(chapter.which)}.pipelines.vulkan")
    get = module.Pipelines.get

    def begin(self, wanted):
        images.open()
        made.append(list(images.decoded))
        return get(self, wanted)

    monkeypatch.setattr(module.Pipelines, "get", begin)
    with open_(chapter, row_of(images.images), replaced(EXACT, loading="wait")) as renderer:
        picture, _ = drawn(renderer)
    assert made[0] == []
    assert np.array_equal(picture[0, :, :3], np.array(COLORS)[:, :3] / 255)


def codes(picture):
    return np.rint(picture[0, :, :3] * 255).astype(int).tolist()


# --- before anything arrives, and while it does ---


def lit_scene(images, roles):
    """Return squares in light with textures in all roles, each role with the image whose number `roles` has."""
    refs = {f"{role}_texture": texture(number, NEAREST) for role, number in roles.items()}
    material = Material(
        base_color=(0.8, 0.6, 0.4, 1.0), emissive=(0.1, 0.2, 0.0), metallic=0.3, roughness=0.6
    )
    return replace(
        quad_scene(replace(material, **refs), images=tuple(images), matrices=(translated(0.3, 0.2),)),
        lights=[Light("point", 0, color=(1.0, 0.9, 0.8), intensity=30.0)],
    )


ROLES = ("base_color", "metallic_roughness", "occlusion", "emissive", "normal")


@pytest.mark.feature("async-loading/lazy-textures")
def test_before_any_arrival_the_frame_is_that_of_all_white_textures(chapter, gated):
    pictures = gated(*(plain((9 * n, 80, 200, 255), (4, 4)) for n in range(5)))
    scene = lit_scene(pictures.images, {role: n for n, role in enumerate(ROLES)})
    white = lit_scene([Image("white", plain(WHITE))], dict.fromkeys(ROLES[:4], 0))
    # White is no normal: there it is the one that points straight up, sampled as such.
    with open_(chapter, white, replaced(EXACT, skip_unused=False), (24, 24)) as renderer:
        expected, _ = drawn(renderer)
    with open_(chapter, scene, STREAM, (24, 24)) as renderer:
        for _ in range(4):
            picture, work = drawn(renderer)
            assert np.array_equal(picture, expected)
            assert (work["textures_resident"], work["textures_waiting"]) == (0, 5)
            assert not renderer.idle(VIEW)
        pictures.open()
        pictures_after = frames_until(renderer, loaded)
        assert renderer.idle(VIEW) and not np.array_equal(pictures_after[-1][0], expected)
    with open_(chapter, scene, EXACT, (24, 24)) as renderer:
        assert np.array_equal(drawn(renderer)[0], pictures_after[-1][0])


@pytest.mark.core
@pytest.mark.feature("async-loading/lazy-textures")
@pytest.mark.parametrize("order", [*permutations(range(3))][::2])
def test_any_order_of_arrival_ends_in_the_picture_of_eager_loading(chapter, gated, order):
    random = np.random.default_rng(1)
    arrays = [random.integers(0, 256, (*size, 4), np.uint8) for size in ((16, 16), (16, 16), (5, 9))]
    pictures = gated(*arrays)
    smooth = [texture(n, replace(NEAREST, min="linear", mag="linear", mipmap="linear")) for n in range(3)]
    materials = tuple(replace(UNLIT, base_color_texture=ref) for ref in smooth)
    eager = row_of([Image("eager", one) for one in arrays], materials)
    with open_(chapter, eager, EXACT, (12, 4)) as renderer:
        expected, _ = drawn(renderer)
    with open_(chapter, row_of(pictures.images, materials), STREAM, (12, 4)) as renderer:
        for count, number in enumerate(order, 1):
            pictures.open(number)
            picture, _ = frames_until(renderer, lambda _, work: work["textures_resident"] == count)[-1]  # noqa: B023
            for other in range(3):  # each square is white or final, and never anything between
                part = np.s_[:, 4 * other : 4 * other + 4, :3]
                truth = expected[part] if other in order[:count] else np.ones_like(expected[part])
                assert np.array_equal(picture[part], truth), (order, number, other)
        assert np.array_equal(picture, expected)
    assert tuple(pictures.decoded) == order


@pytest.mark.feature("async-loading/staging-buffer")
def test_at_most_the_budget_is_copied_in_a_frame_and_large_images_come_in_parts(chapter, gated):
    arrays = [plain(color, (96, 96)) for color in COLORS[:3]]
    pictures = gated(*arrays)
    pictures.open()
    settings = replaced(STREAM, upload_budget=1 / 64)  # 16 KiB of 36 KiB each
    with open_(chapter, row_of(pictures.images), settings) as renderer:
        found = frames_until(renderer, loaded)
    copied = [work["bytes_uploaded"] for _, work in found]
    assert max(copied) <= 16 << 10 and sum(copied) == sum(one.nbytes for one in arrays)
    for picture, work in found:
        finished = [
            code for code, color in zip(codes(picture), COLORS, strict=False) if code == list(color[:3])
        ]
        assert len(finished) == work["textures_resident"]
        assert codes(picture).count([255, 255, 255]) == 3 - len(finished)


@pytest.mark.feature("async-loading/staging-buffer")
def test_a_texture_of_a_budget_arrives_in_one_frame_and_a_larger_one_in_two(chapter, gated):
    """16 MiB are a quarter of what a ring may be."""
    pictures = gated(plain(COLORS[0], (2048, 2048)), plain(COLORS[1], (2048, 3072)))  # 16 and 24 MiB
    copied = []
    with open_(chapter, row_of(pictures.images), replaced(STREAM, upload_budget=16)) as renderer:
        drawn(renderer)  # the first frame copies nothing
        for number in range(2):
            pictures.open(number)
            found = frames_until(renderer, lambda _, work: work["textures_resident"] > number)  # noqa: B023
            copied.append([work["bytes_uploaded"] / 2**20 for _, work in found if work["bytes_uploaded"]])
    assert copied == [[16], [16, 8]]
    assert codes(found[-1][0]) == [list(color[:3]) for color in COLORS[:2]]


def test_the_first_frame_copies_nothing_however_much_is_decoded(chapter, gated):
    pictures = gated(*(plain(color) for color in COLORS))
    pictures.open()
    with open_(chapter, row_of(pictures.images)) as renderer:
        while renderer._loading.decoding:
            renderer._loading.wait()
        (first, work), (second, then) = drawn(renderer), drawn(renderer)
    assert work["bytes_uploaded"] == 0 and codes(first) == [[255] * 3] * 4
    assert then["bytes_uploaded"] > 0
    if chapter.backend == "gl" or not chapter.device.has("async-transfer"):
        assert codes(second) == [list(color[:3]) for color in COLORS]


@pytest.mark.variants("vulkan", "without-all")
def test_what_a_driver_does_for_the_first_time_is_done_before_frames_that_fill_in(chapter, gated):
    """No frame builds a pipeline, for levels of colour or of data, nor frees what geometry was copied from."""
    pictures = gated(*(plain((9 * n, 80, 200, 255), (4, 4)) for n in range(5)))
    pictures.open()
    scene = lit_scene(pictures.images, {role: n for n, role in enumerate(ROLES)})
    smooth = replace(NEAREST, min="linear", mag="linear", mipmap="linear")
    refs = {f"{role}_texture": texture(number, smooth) for number, role in enumerate(ROLES)}
    scene = replace(scene, materials=[replace(scene.materials[0], **refs)])
    with open_(chapter, scene, STREAM, (24, 24)) as renderer:
        assert not [name for name in chapter.device.alive.values() if name.startswith("upload ring")]
        drawn(renderer)
        with chapter.calls() as calls:
            work = frames_until(renderer, loaded)[-1][1]
        assert work["textures_resident"] == 5 and "vkCmdDispatch" in calls  # levels were made
        assert not [name for name in calls if name.endswith("Pipelines")]


def test_everything_is_there_before_the_first_frame_where_frames_wait(chapter, gated):
    pictures = gated(*(plain(color) for color in COLORS))
    pictures.open()
    with open_(chapter, row_of(pictures.images), EXACT) as renderer:
        picture, work = drawn(renderer)
        assert codes(picture) == [list(color[:3]) for color in COLORS]
        assert work["textures_resident"] == 4 and work["bytes_uploaded"] == 0 and renderer.idle(VIEW)
        assert not renderer._loading._working


def test_who_waits_for_all_textures_gets_the_final_picture_next(chapter, gated):
    pictures = gated(*(plain(color) for color in COLORS))
    with open_(chapter, row_of(pictures.images)) as renderer:
        assert codes(drawn(renderer)[0]) == [[255] * 3] * 4
        pictures.open()
        renderer.wait_loaded()
        assert not renderer.idle(VIEW)
        assert codes(drawn(renderer)[0]) == [list(color[:3]) for color in COLORS]
        assert renderer.idle(VIEW)
        renderer.wait_loaded()
        assert renderer.idle(VIEW)


def test_frames_after_the_last_arrival_copy_and_build_nothing(chapter, gated):
    pictures = gated(*(plain(color, (4, 4)) for color in COLORS))
    pictures.open()
    with open_(chapter, row_of(pictures.images)) as renderer:
        frames_until(renderer, loaded)
        time.sleep(0.02)
        for _ in range(3):
            drawn(renderer)
        with chapter.calls() as calls:
            renderer.render(VIEW)
        upload = ("vkCmdCopyBuffer", "vkGetFence", "vkCreate", "vkUpdate", "glTextureSubImage", "glCreate")
        assert not [name for name in calls if name.startswith(upload)]
        assert not renderer._loading._working


# --- what goes wrong ---


@pytest.mark.feature("async-loading/file-decode")
def test_a_texture_that_cannot_be_decoded_stays_white_and_is_told_once(chapter, gated):
    pictures = gated(*(plain(color) for color in COLORS))
    pictures.errors = {1: ValueError("cut short"), 2: SceneError("c.png: changed since it was opened.")}
    pictures.open()
    scene = row_of(pictures.images)
    with open_(chapter, scene) as renderer:
        picture, work = frames_until(renderer, loaded)[-1]
        drawn(renderer)
        expected = [list(COLORS[0][:3]), [255] * 3, [255] * 3, list(COLORS[3][:3])]
        assert codes(picture) == expected and work["textures_failed"] == 2 and work["textures_resident"] == 2
        assert sorted(scene.warnings) == [
            "c.png: changed since it was opened: it is drawn without its texture.",
            "image 1 ('picture 1') cannot be decoded (cut short): it is drawn without its texture.",
        ]
        assert renderer.idle(VIEW)


def test_where_frames_wait_a_texture_that_cannot_be_decoded_is_an_error_and_leaves_nothing(chapter, gated):
    pictures = gated(*(plain(color, (4, 4)) for color in COLORS))
    pictures.errors[1] = ValueError("cut short")
    pictures.open()
    before = {*chapter.device.alive}
    with pytest.raises(SceneError, match=r"image 1 \('picture 1'\) cannot be decoded \(cut short\)"):
        open_(chapter, row_of(pictures.images), EXACT)
    assert not blockless(chapter, before)


def blockless(chapter, before):
    """Return what lives now and did not before; the device keeps its blocks of memory."""
    return [one for one in {*chapter.device.alive} - before if one[0] != "VkDeviceMemory"]


@pytest.mark.parametrize("frames", [0, 1, 3])
def test_closed_while_loading_leaves_nothing(chapter, gated, frames):
    pictures = gated(*(plain(color, (64, 64)) for color in COLORS))
    pictures.open(0)
    before = {*chapter.device.alive}
    threads = threading.active_count()
    renderer = open_(chapter, row_of(pictures.images), replaced(STREAM, upload_budget=1 / 64))
    for _ in range(frames):
        drawn(renderer)
    later = threading.Timer(0.02, pictures.open)  # what has begun is finished
    later.start()
    renderer.close()
    renderer.close()
    later.join()
    assert threading.active_count() == threads and not blockless(chapter, before)


# --- what an image has ready ---


class Chained(Image):
    """An image of one colour that has all its levels as blocks, for those who can sample them."""

    def chain(self, srgb: bool, mipmapped: bool, channels: str) -> Chain:
        levels = mip_chain(self.pixels, srgb) if mipmapped else (self.pixels,)
        return Chain("bc7_srgb", None, "rgba", blocks.encode_chain(levels, "bc7_srgb", "fast"))


@pytest.mark.needs("etcpak")
@pytest.mark.parametrize("without", [(), ("bindless",)], ids=["as it is", "arrays"])
@pytest.mark.parametrize(
    "settings", [EXACT, replaced(STREAM, upload_budget=1 / 64)], ids=["at once", "parts"]
)
def test_levels_that_an_image_brings_are_copied_as_they_are(chapter, settings, without):
    images = [Chained(str(color), plain(color, (150, 70 + n))) for n, color in enumerate(COLORS)]
    refs = [texture(n, replace(NEAREST, mipmap="nearest")) for n in range(4)]
    scene = row_of(images, tuple(replace(UNLIT, base_color_texture=ref) for ref in refs))
    with (
        chapter.open(scene, (32, 8), settings, outputs={"color_linear"}, without=without) as renderer,
        chapter.calls() as calls,
    ):
        picture, _ = frames_until(renderer, loaded)[-1]
        made = [name for name in calls if name in ("vkCmdDispatch", "glDispatchCompute")]
    shown, truth = np.array(codes(picture[:, ::8])), np.array([color[:3] for color in COLORS])
    assert np.abs(shown - truth).max() <= 3, "the encoder is off by a code"
    if chapter.device.has("block-compression") and settings.loading.mode == "stream":
        assert not made, "the GPU makes none"


# --- edits ---


@pytest.mark.core
def test_an_edit_while_loading_loads_what_it_brings_and_forgets_the_rest(chapter, gated):
    pictures = gated(*(plain(color, (8, 8)) for color in COLORS))
    materials = tuple(replace(UNLIT, base_color_texture=texture(n)) for n in range(3))
    scene = row_of(pictures.images, materials)
    with open_(chapter, scene, replaced(STREAM, decoding_threads=1)) as renderer:
        pictures.open(0)
        frames_until(renderer, lambda _, work: work["textures_resident"] == 1)
        with scene.edit() as edit:  # 1 is being decoded, 2 waits, 0 is there
            edit.set_material(0, replace(UNLIT, base_color_texture=texture(3)))
            edit.set_material(1, UNLIT)
        picture, work = drawn(renderer)
        assert codes(picture) == [[255] * 3] * 3 and work["textures_waiting"] == 2
        pictures.open()
        picture, work = frames_until(renderer, loaded)[-1]
        assert codes(picture) == [list(COLORS[3][:3]), [255] * 3, list(COLORS[2][:3])]
        assert work["textures_resident"] == 2 and work["textures_failed"] == 0
        with scene.edit() as edit:
            edit.set_material(2, replace(UNLIT, base_color_texture=texture(0)))
        picture, _ = frames_until(renderer, loaded)[-1]
        assert codes(picture)[2] == list(COLORS[0][:3])


def test_the_texture_being_copied_may_go(chapter, gated):
    pictures = gated(plain(COLORS[0], (96, 96)), plain(COLORS[1], (4, 4)))
    pictures.open()
    scene = row_of(pictures.images)
    before = {*chapter.device.alive}
    with open_(chapter, scene, replaced(STREAM, upload_budget=1 / 64, decoding_threads=1)) as renderer:
        frames_until(renderer, lambda _, work: work["bytes_uploaded"] > 0)
        with scene.edit() as edit:
            edit.set_material(0, UNLIT)
        picture, work = frames_until(renderer, loaded)[-1]
        assert codes(picture) == [[255] * 3, list(COLORS[1][:3])] and work["textures_resident"] == 1
        for _ in range(4):
            drawn(renderer)
    assert not blockless(chapter, before)


def test_many_tiny_textures_fill_in(chapter):
    count = 300
    images = [Image(f"{n}", plain(COLORS[n % 4])) for n in range(count)]
    scene = row_of(images)
    with open_(chapter, scene, STREAM, (count, 1)) as renderer:
        view_frames = frames_until(renderer, loaded)
        assert codes(view_frames[-1][0]) == [list(COLORS[n % 4][:3]) for n in range(count)]
        resident = [work["textures_resident"] for _, work in view_frames]
        assert len(resident) > 3 and max(np.diff(resident)) <= 40, "a frame makes only so many images"
