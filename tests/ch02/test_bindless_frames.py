"""One set of textures from frame to frame: written in time, never where a frame in flight reads, and bounded."""

from __future__ import annotations

import re
from dataclasses import replace
from typing import Any

import numpy as np
import pytest

from backends.vulkan.device import capabilities
from backends.vulkan.driver import features as vf
from backends.vulkan.shaders.compiler import compile_shader
from chapters.ch02.pipelines import vulkan
from chapters.ch02.pipelines.vulkan import CHAPTER, source_of
from chapters.ch02.pipelines.vulkan_layouts import Layouts
from chapters.ch02.scene import vulkan_data
from chapters.ch02.settings import Settings
from common.errors import ShaderError, UnsupportedError
from common.scene import MESH_DTYPE, Image, Instances, Material, Sampler, Scene
from common.view.camera import UNIT_EV100
from tests.support.devices import ALL_BITS, described
from tests.support.scenes import NEAREST, facing, nodes_at, quad_scene, texture, translated

bindless = pytest.mark.variants("vulkan")
SIZE = (16, 16)
EXACT = Settings(
    color_format="rgba32f", background=0.0, default_light=False, tone_curve="none", anisotropy=1.0
)
UNLIT = Material(unlit=True)


def color(number: int) -> tuple[int, int, int, int]:
    """Return codes 0 and 255 by the bits of a number, which any decoder of sRGB leaves as they are."""
    return (255 * (number & 1), 255 * (number >> 1 & 1), 255 * (number >> 2 & 1), 255)


IMAGES = tuple(Image(f"color {i}", np.full((1, 1, 4), color(i), np.uint8)) for i in range(8))


def textured(number: int, sampler: Sampler = NEAREST) -> Material:
    """Return a material that shows one image."""
    return replace(UNLIT, base_color_texture=texture(number, sampler))


def row_of(count: int, images: tuple[Image, ...] = IMAGES) -> Scene:
    """Return `count` squares beside each other, over a picture of count x 1 pixels, with a material each."""
    return quad_scene(
        materials=tuple(textured(i % len(images)) for i in range(count)),
        images=images,
        matrices=tuple(translated(2 * i + 1 - count) for i in range(count)),
        instance_materials=tuple(range(count)),
    )


@pytest.fixture
def native(chapter):
    """The chapter, where its device has descriptor indexing."""
    if chapter.backend != "vulkan" or not chapter.device.has("bindless"):
        pytest.skip("the device has no descriptor indexing")
    return chapter


# --- the queue ---


class Watched:
    """A renderer whose writes to the set of textures are followed in the calls that Vulkan gets."""

    def __init__(self, chapter: Any, scene: Scene, size: tuple[int, int] = SIZE) -> None:
        self.device, self.scene = chapter.device, scene
        self.log: list = []
        self.device.fn.trace(self.log)
        self.renderer = chapter.open(scene, size, EXACT, outputs={"color_linear"})
        self.held: dict[int, Any] = {}
        """What stands in each slot: an image view."""
        self.follow()

    def follow(self) -> list[int]:
        """Return the slots that were written since the last time."""
        slots = []
        calls, self.log[:] = list(self.log), []
        drawing = next((i for i, (name, _) in enumerate(calls) if name == "vkCmdBeginRendering"), len(calls))
        for place, (name, arguments) in enumerate(calls):
            if name != "vkUpdateDescriptorSets":
                continue
            for write in (arguments[2][i] for i in range(arguments[1])):
                if write.dstBinding == 10 and write.pImageInfo:  # a set of buffers may have as many
                    assert place < drawing, "written before anything of the frame is drawn"
                    for i in range(write.descriptorCount):
                        slots.append(write.dstArrayElement + i)
                        self.held[slots[-1]] = write.pImageInfo[i].imageView
        return slots

    def frame(self) -> tuple[Any, list[int]]:
        """Render; return the picture and the slots that were written for it."""
        frame = self.renderer.render(facing(ev100=UNIT_EV100))
        return frame.image("color_linear"), self.follow()

    def read(self) -> dict[int, Any]:
        """Return the slots that the materials name now, with the view that should stand there."""
        textures = self.renderer._data._textures
        return {slot: textures._textures.get(read.key).view for read, slot in textures._slots.items()}

    def close(self) -> None:
        self.device.fn.trace(None)
        self.renderer.close()


@pytest.fixture
def watched(native):
    opened = []

    def open_(*arguments: Any) -> Watched:
        opened.append(Watched(native, *arguments))
        return opened[-1]

    yield open_
    for one in opened:
        one.close()


@bindless
@pytest.mark.feature("bindless/update-queue")
def test_no_slot_of_a_frame_in_flight_is_ever_written(watched):
    """Forty edits of what four squares show: every frame finds its textures, and leaves alone those of the last one."""
    made = watched(row_of(4), (4, 1))
    rng = np.random.default_rng(7)
    shown = [0, 1, 2, 3]
    before: dict[int, Any] = {}
    wrote = 0
    for step in range(40):
        if step % 3:
            with made.scene.edit() as change:
                for square in rng.permutation(4)[: int(rng.integers(1, 4))].tolist():
                    shown[square] = int(rng.integers(8))
                    change.set_material(square, textured(shown[square]))
        picture, slots = made.frame()
        assert np.array_equal(picture[0] * 255, [color(number)[:3] for number in shown])
        assert len(slots) == len({*slots}), "each at most once"
        assert not before.keys() & {*slots}, "the frame before may still be drawn"
        now = made.read()
        assert now.items() <= made.held.items()
        assert len(now) == len({*shown})
        before = now
        wrote += len(slots)
    assert wrote > 40


@bindless
@pytest.mark.feature("bindless/update-queue")
def test_new_textures_are_written_once_and_a_still_scene_writes_nothing(watched):
    made = watched(row_of(4), (4, 1))
    assert len(made.frame()[1]) == 4, "with the first frame"
    assert [made.frame()[1] for _ in range(3)] == [[], [], []]
    with made.scene.edit() as change:
        change.set_material(1, textured(6))
    lowest = len(made.read()) + 1
    written = [made.frame()[1] for _ in range(5)]
    assert written == [[lowest], [], [2], [], []], (
        "the new one at once, the dummy when nobody reads the old one"
    )
    with made.scene.edit() as change:
        change.set_material(2, textured(7))
    assert made.frame()[1] == [2], "the lowest free slot"


@bindless
@pytest.mark.feature("bindless/global-descriptor-set")
def test_there_is_one_set_for_the_life_of_the_renderer(native):
    """Edits, other sizes and other shaders leave it where it is; materials of any number share it."""
    with native.open(row_of(8), (8, 1), EXACT, outputs={"color_linear"}) as made:
        the_set = made._data._textures.bindless.sets[0]
        sets = made.render(facing()).work["descriptor_sets"]
        with made.scene.edit() as change:
            change.set_material(0, replace(textured(3), alpha_mode="blend"))
        made.render(facing())
        made.resize((16, 2))
        assert made.render(facing()).work["descriptor_sets"] == sets
        assert made._data._textures.bindless.sets[0] == the_set
    with native.open(row_of(2), (8, 1), EXACT, outputs={"color_linear"}) as made:
        assert made.render(facing()).work["descriptor_sets"] == sets


# --- bounds ---

FULL = r"^There are more textures than the 4 that one set holds on .*: use fewer, or run with --without bindless\.$"


@pytest.mark.feature("bindless/global-descriptor-set")
@bindless
@pytest.mark.feature("bindless/support-check")
@pytest.mark.parametrize("limit", ["ours", "the device's"])
def test_more_textures_than_there_is_room_for_are_one_sentence(native, monkeypatch, limit):
    """Three textures and the dummy fit; the fourth is refused, when a scene is opened and when it is edited."""

    def of_four(device, capacity):
        return Layouts(device, 4)

    if limit == "ours":
        monkeypatch.setattr(vulkan_data, "slots_for", lambda *_: 4)
    else:
        monkeypatch.setattr(vulkan, "Layouts", of_four)

    def alive():  # blocks of memory are kept for the next one
        return {key for key in native.device.alive if key[0] != "VkDeviceMemory"}

    before = alive()
    with pytest.raises(UnsupportedError, match=FULL):
        native.open(row_of(4), (4, 1), EXACT)
    assert alive() == before, "and nothing is left behind"
    scene = row_of(3)
    with native.open(scene, (3, 1), EXACT, outputs={"color_linear"}) as made:

        def shown():
            return (made.render(facing(ev100=UNIT_EV100)).image("color_linear")[0] * 255).tolist()

        expected = [list(color(i)[:3]) for i in range(3)]
        assert shown() == expected
        with scene.edit() as change:
            change.set_material(0, replace(textured(0), base_color_texture=texture(0, Sampler())))
            change.set_material(1, replace(textured(5), unlit=False, emissive_texture=texture(6)))
        for _ in range(2):
            with pytest.raises(UnsupportedError, match=FULL):
                made.render(facing())
        with scene.edit() as change:
            change.set_material(0, textured(0))
            change.set_material(1, textured(1))
        for _ in range(4):
            assert shown() == expected, "as if nothing had happened"
        for number in (4, 5, 6):  # all slots are taken, and frames in flight read what is given up
            with scene.edit() as change:
                change.set_material(0, textured(number))
            assert shown() == [list(color(number)[:3]), *expected[1:]]


@pytest.mark.feature("bindless/support-check")
@pytest.mark.parametrize("bit", vf.OPTIONAL["bindless"].bits, ids=lambda bit: bit[1])
def test_the_features_decide_and_nothing_else(bit):
    assert "bindless" in capabilities(described(), believe=True).features
    lacking = capabilities(described(bits=ALL_BITS - {bit}), believe=True)
    assert "bindless" not in lacking.features and bit[1] in lacking.why_not["bindless"]
    other = capabilities(
        described("another", "software", version=(1, 3, 7), extensions=frozenset()), believe=True
    )
    assert "bindless" in other.features, "no name, kind or extension counts"


# --- shaders ---

EXTENSION = "#extension GL_EXT_nonuniform_qualifier : require\n"
DEFINES = {
    "plain": (("SHADED", 1), ("LIT", 1)),
    "bindless": (("SHADED", 1), ("TEXTURED", 1), ("BASE_COLOR_MAP", 1), ("BINDLESS", 1)),
    "bindless mask": (("ALPHA_MASK", 1), ("TEXTURED", 1), ("BASE_COLOR_MAP", 1), ("BINDLESS", 1)),
    "arrays": (("SHADED", 1), ("TEXTURED", 1), ("BASE_COLOR_MAP", 1), ("ARRAYS", 3)),
}


@pytest.mark.feature("bindless/extension-injection")
@pytest.mark.parametrize("kind", DEFINES)
@pytest.mark.parametrize(
    "file",
    [
        "shading/forward.vert",
        "shading/forward.frag",
        "shading/instance_id.frag",
        "post/tonemap.frag",
        "shading/sky.frag",
    ],
)
def test_the_extension_stands_once_in_shaders_that_use_it_and_in_no_other(file, kind):
    source = source_of(file, DEFINES[kind])
    uses = "layout(set = 2, binding = 10" in source.text or "BIND(2, 10" in source.text
    assert uses == (
        kind.startswith("bindless") and file in ("shading/forward.frag", "shading/instance_id.frag")
    )
    assert source.text.count("GL_EXT_nonuniform_qualifier") == source.text.count(EXTENSION) == int(uses)


@pytest.mark.feature("bindless/extension-injection")
@pytest.mark.parametrize("file", ["shading/forward.frag", "shading/instance_id.frag"])
def test_a_shader_that_uses_it_without_the_extension_is_refused_by_the_compiler(file):
    source = source_of(file, DEFINES["bindless mask"])
    assert compile_shader(source)
    with pytest.raises(ShaderError, match=r"GL_EXT_nonuniform_qualifier|nonuniformEXT"):
        compile_shader(replace(source, text=source.text.replace(EXTENSION, "\n"), key="0" * 64))


@pytest.mark.feature("bindless/nonuniform-indexing")
def test_every_index_into_the_set_is_marked_as_one_that_may_differ():
    """In all shaders of the chapter: some drivers need the mark to be right, and the one in software does not tell."""
    found = 0
    shaders = [path for path in CHAPTER.glob("**/*.*") if path.suffix in (".glsl", ".vert", ".frag", ".comp")]
    for file in sorted(path for path in shaders if "studies" not in path.parts):
        for index in re.findall(
            r"\b(?:textures_2d|textures_3d|textures_uint|images)\[([^\]]*)", file.read_text()
        ):
            assert not index or index.startswith("nonuniformEXT("), f"{file.name}: [{index}]"
            found += bool(index)
    assert found >= 6


# --- neighbours ---


@pytest.mark.core
@pytest.mark.feature("bindless/extension-injection")
@pytest.mark.feature("bindless/nonuniform-indexing")
def test_triangles_side_by_side_each_show_their_own_texture(chapter):
    """Two hundred triangles of eight textures in no order, all in one draw: exact in every pixel, at every edge."""
    rng = np.random.default_rng(9)
    side = 10
    grid = np.stack(np.meshgrid(np.linspace(-1, 1, side + 1), np.linspace(-1, 1, side + 1)), axis=-1).reshape(
        -1, 2
    )
    inner = np.abs(grid).max(axis=1) < 0.99
    grid[inner] += rng.uniform(-0.06, 0.06, (inner.sum(), 2))
    corner = (np.arange(side)[:, None] * (side + 1) + np.arange(side)).reshape(-1)
    triangles = np.concatenate(
        [corner[:, None] + (0, 1, side + 2), corner[:, None] + (0, side + 2, side + 1)]
    ).astype(np.uint32)
    count = len(triangles)
    wanted = rng.integers(0, 8, count)
    meshes = np.zeros(count, MESH_DTYPE)
    meshes["first_index"], meshes["index_count"] = 3 * np.arange(count), 3
    meshes["vertex_count"] = len(grid)
    meshes["material"] = np.arange(count)
    meshes["bounds_min"], meshes["bounds_max"] = (-1, -1, 0), (1, 1, 0)
    scene = replace(
        quad_scene(images=IMAGES),
        positions=np.concatenate([grid, np.zeros((len(grid), 1))], axis=1).astype(np.float32),
        normals=np.tile(np.float32((0, 0, 1)), (len(grid), 1)),
        tangents=np.tile(np.float32((1, 0, 0, 1)), (len(grid), 1)),
        uv0=rng.random((len(grid), 2), np.float32),
        indices=triangles.reshape(-1),
        meshes=meshes,
        mesh_names=[""] * count,
        materials=[textured(number) for number in wanted.tolist()],
        nodes=nodes_at(np.eye(4)),
        instances=Instances(np.zeros(count, np.int32), np.arange(count, dtype=np.int32)),
    )
    with chapter.open(scene, (64, 64), EXACT, outputs={"color_linear", "instance_id"}) as made:
        frame = made.render(facing(ev100=UNIT_EV100))
        ids, picture = frame.image("instance_id"), frame.image("color_linear")
        phases = 1 + any(gpu_pass.name == "cull_late" for gpu_pass in made.passes)
    assert ids.min() > 0 and len(np.unique(ids)) == count
    expected = np.array([color(number)[:3] for number in wanted], np.float32)[ids - 1]
    assert np.array_equal(picture * 255, expected)
    if made.plan.native("multi-draw"):
        assert frame.work["draw_calls"] == 2 * phases, "one for all triangles, one for their ids"
