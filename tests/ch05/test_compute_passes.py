"""Passes that compute, in the chapter's own frame: what they declare is what their kernels reach, and nothing else."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from backends.contract import Access, Pass, Sources
from chapters.ch05.graph.execute.bindings import STORABLE, Bound, bindings_of, check_table
from chapters.ch05.graph.frame_graph import compile_graph
from chapters.ch05.graph.types import GraphError, Node
from chapters.ch05.pipelines.compute_description import ComputeDescription
from chapters.ch05.settings import Settings
from common.scene import Material
from tests.support.scenes import facing, quad_scene, translated

SETTINGS = Settings(ambient=1.0, anisotropy=1.0, tone_curve="none", background=0.25)

MARK = """
layout(local_size_x = 8, local_size_y = 4) in;
layout(BIND(0, 0, 0)) uniform sampler2D color_lit;
layout(BIND(0, 1, 0), rgba16f) uniform writeonly image2D marked;
layout(BIND(0, 2, 1), r32ui) uniform writeonly uimage2D places;
layout(BIND(0, 3, 0)) writeonly buffer Rows_ { uint rows[]; };
void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = imageSize(marked);
    if (any(greaterThanEqual(pixel, size))) { return; }
    uint place = uint(pixel.y * size.x + pixel.x);
    imageStore(marked, pixel, vec4(1.0 - texelFetch(color_lit, pixel, 0).rgb, 1.0));
    imageStore(places, pixel, uvec4(place + 7u));
    rows[place] = place * place;
}
"""
CHECK = """
layout(local_size_x = 4, local_size_y = 8) in;
layout(BIND(0, 0, 0)) readonly buffer Rows_ { uint rows[]; };
layout(BIND(0, 1, 0), r32ui) uniform readonly uimage2D places;
layout(BIND(0, 2, 1), rgba16f) uniform image2D color_checked;
void main() {
    ivec2 pixel = ivec2(gl_GlobalInvocationID.xy), size = imageSize(color_checked);
    if (any(greaterThanEqual(pixel, size))) { return; }
    uint place = uint(pixel.y * size.x + pixel.x);
    bool good = rows[place] == place * place && imageLoad(places, pixel).x == place + 7u;
    imageStore(color_checked, pixel, good ? imageLoad(color_checked, pixel) : vec4(100.0));
}
"""
SIZE = (21, 13)
READERS = {"tonemap": {"color_focused": "color_checked"}}


@pytest.fixture(scope="module")
def scene():
    return quad_scene(
        matrices=(translated(-0.5, 0, 0), translated(0.2, 0.3, 0.4)),
        materials=(
            Material(base_color=(0.7, 0.5, 0.3, 1.0), roughness=0.4),
            Material(base_color=(0.2, 0.6, 0.9, 0.5), alpha_mode="blend"),
        ),
        instance_materials=(0, 1),
    )


class Computing(Pass):
    """A compute pass of a test: everything that it declares is bound, on either backend."""

    def __init__(self, chapter, renderer, file, name, text, reads, writes):
        self.builder, self.sources = renderer._pipelines, Sources()
        self.file, self.name, self.reads, self.writes = file, name, reads, writes
        file.parent.mkdir()
        file.write_text(text, "utf-8")

    def create(self):
        self.pipelines = self.builder.get([ComputeDescription(str(self.file), name=self.name)])

    def record(self, commands):
        commands.bind_compute(self.pipelines[0])
        commands.dispatch_over(self.pipelines[0], commands.extent)


@pytest.fixture
def opened(chapter, scene, tmp_path):
    """Yield a renderer, and what makes compute passes for it."""
    with chapter.open(scene, SIZE, replace(SETTINGS, graph="compute"), outputs={"color"}) as renderer:

        def computing(name, text, reads, writes):
            file = tmp_path / str(len(list(tmp_path.iterdir()))) / f"{name}.comp"
            return Computing(chapter, renderer, file, name, text, reads, writes)

        yield renderer, computing


def marking(computing, text=MARK):
    return computing(
        "mark",
        text,
        (Access("color_hdr", "sampled"),),
        (
            Access("color_marked", "storage", format="rgba16f"),
            Access("places", "storage", format="r32ui"),
            Access("rows", "storage", bytes=4 * SIZE[0] * SIZE[1]),
        ),
    )


def checking(computing, text=CHECK):
    return computing(
        "check",
        text,
        (Access("rows", "storage"), Access("places", "storage")),
        (Access("color_checked", "storage", format="rgba16f", of="color_marked"),),
    )


def test_images_and_buffers_go_from_kernel_to_kernel(opened):
    """One inverts the light and writes two tables, the other one lets a pixel through only if both tables are right."""
    renderer, computing = opened
    renderer.insert_pass(marking(computing))
    renderer.insert_pass(checking(computing), READERS)
    frames = [renderer.render(facing()) for _ in range(3)]
    assert frames[2].work["dispatches"] == 3 and frames[2].work["recorded"] == 0
    found = frames[2].image("color")
    with pytest.raises(GraphError, match="No pass of this frame draws 'rows'") as caught:
        renderer.show_resource("rows")
    assert "did you mean 'rows'" not in str(caught.value), "a buffer is no picture"
    light = renderer.show_resource("color_hdr")
    shown = renderer.render(facing()).image(light)[..., :3].astype(np.float64)
    inverted = (1.0 - shown).astype(np.float16).astype(np.float64).clip(0.0, 1.0)
    code = np.where(inverted <= 0.0031308, 12.92 * inverted, 1.055 * inverted ** (1 / 2.4) - 0.055) * 255.0
    assert np.abs(found[..., :3] - code).max() <= 1.0
    assert np.ptp(found[..., :3], (0, 1)).min() > 20
    renderer.resize((13, 9))
    renderer.render(facing())


def test_what_a_kernel_reaches_and_nobody_declares_is_refused_in_a_sentence(opened):
    renderer, computing = opened
    before = renderer.render(facing()).image("color")
    text = MARK.replace("void main", "layout(BIND(0, 4, 1)) buffer More_ { uint more[]; };\nvoid main")
    text = text.replace("rows[place] =", "more[place] = rows[place] =").replace("writeonly buffer", "buffer")
    with pytest.raises(
        GraphError, match=r"^'mark' declares .*, and .*mark.* has .*'(more|More_)'.*: declare what"
    ):
        renderer.insert_pass(marking(computing, text), {"tonemap": {"color_focused": "color_marked"}})
    assert np.array_equal(renderer.render(facing()).image("color"), before), "the frame is as it was"


def test_a_kernel_takes_the_place_of_another_one(opened):
    renderer, computing = opened
    renderer.insert_pass(marking(computing), {"tonemap": {"color_focused": "color_marked"}})
    before = renderer.render(facing()).image("color")
    text = MARK.replace("1.0 - texelFetch", "texelFetch")
    wrong = text.replace("void main", "layout(BIND(0, 4, 1)) buffer More_ { uint more[]; };\nvoid main")
    wrong = wrong.replace("rows[place] =", "more[place] = rows[place] =").replace(
        "writeonly buffer", "buffer"
    )
    with pytest.raises(GraphError, match="'mark' declares"):
        renderer.swap_pass("mark", marking(computing, wrong))
    assert np.array_equal(renderer.render(facing()).image("color"), before), "the frame is as it was"
    renderer.swap_pass("mark", marking(computing, text))
    found = renderer.render(facing()).image("color")
    assert not np.array_equal(found, before)
    renderer.remove_pass("mark")
    assert np.array_equal(renderer.render(facing()).image("color"), found)


@pytest.mark.variants("vulkan", "without-all")
def test_bindings_in_another_order_are_refused_in_a_sentence(opened):
    renderer, computing = opened
    text = MARK.replace("BIND(0, 0, 0)", "BIND(0, 1, 0)").replace(
        "BIND(0, 1, 0), rgba16f", "BIND(0, 0, 0), rgba16f"
    )
    with pytest.raises(
        GraphError, match=r"'mark' binds 'color_lit' as texture at binding 0, where .* 'marked'"
    ):
        renderer.insert_pass(marking(computing, text), {"tonemap": {"color_focused": "color_marked"}})
    renderer.render(facing())


# --- without a device ---


def bound(reads, writes, others=()):
    made = Node("kernel", reads, writes)
    graph = compile_graph([made, *others], (8, 8), [writes[0].resource])
    step = next(step for step in graph.steps if step.name == "kernel")
    return bindings_of(step, made, graph)


def test_bindings_follow_the_order_of_reads_and_then_of_writes():
    other = Node(
        "before",
        (),
        (
            Access("numbers", "storage", bytes=64),
            Access("field", "storage", format="r32f"),
            Access("arguments", "storage", bytes=16),
            Access("shown", "storage", format="rgba8"),
        ),
    )
    reads = (
        Access("field", "storage"),
        Access("arguments", "indirect"),
        Access("shown", "sampled"),
        Access("numbers", "uniform"),
        Access("sum", "storage", previous=True),
    )
    found = bound(reads, (Access("sum", "storage", bytes=64),), [other])
    assert found == [
        Bound("field", "image", False),
        Bound("shown", "texture", False),
        Bound("numbers", "uniform", False),
        Bound("sum@previous", "storage", False),
        Bound("sum", "storage", True),
    ]


def test_a_table_that_does_not_fit_is_told_in_a_sentence():
    declared = [Bound("a", "texture", False), Bound("b", "image", True)]
    good = {0: ("texture", "source"), 1: ("image", "target")}
    check_table("kernel", declared, good, "set 0 of kernel.comp")
    check_table("kernel", declared, {1: good[1]}, "set 0 of kernel.comp")  # what it declares and does not use
    for table, text in (
        ({}, r"^set 0 of kernel\.comp has no bindings, and 'kernel' binds what it declares there\.$"),
        (
            good | {2: ("storage", "more")},
            r"^'kernel' declares 2 accesses that are bound, and set 0 of kernel\.comp has the storage 'more' at "
            r"binding 2: declare what it reads or writes there\.$",
        ),
        (
            {0: good[1], 1: good[0]},
            r"^'kernel' binds 'a' as texture at binding 0, where set 0 of kernel\.comp has the image 'target': ",
        ),
    ):
        with pytest.raises(GraphError, match=text):
            check_table("kernel", declared, table, "set 0 of kernel.comp")


@pytest.mark.parametrize("format", ["rgba8_srgb", "d32f", "rgb10a2", "rg16f"])
def test_formats_that_no_shader_stores_to_are_refused_in_a_sentence(format):
    with pytest.raises(
        GraphError, match=rf"^A shader cannot store to 'target' in {format}: images .*rgba16f"
    ):
        bound((), (Access("target", "storage", format=format),))
    for good in STORABLE:
        bound((), (Access("target", "storage", format=good),))


def test_an_image_of_several_samples_is_not_stored_to():
    with pytest.raises(GraphError, match="'target', which has 4 samples"):
        bound((), (Access("target", "storage", format="rgba16f", samples=4),))
