"""Lists of user interfaces on both backends: against a model in numpy, and against each other."""

from __future__ import annotations

from itertools import pairwise

import numpy as np
import pytest

from backends.gl import api as gl
from backends.gl.context import Context
from common.view.draw_lists import FONT, GREY, VERTEX, Command, DrawList, TextureUpdate, load, save
from tests.support.draw_lists import QUAD, blended, on_gl, on_vulkan, quad
from tests.support.panel import RECORDED

SIZE = (64, 48)
EVERYTHING = (0.0, 0.0, 64.0, 48.0)
WHITE = TextureUpdate(FONT, (1, 1), np.full((1, 1, 4), 255, np.uint8))


def background():
    """A picture no two rows or columns of which are alike."""
    y, x = np.mgrid[0:48, 0:64]
    return np.stack([4 * x, 5 * y, 255 - 2 * x - 2 * y, np.full_like(x, 255)], -1).astype(np.uint8)


def glyphs(seed=0):
    """Texels (8, 16, 4), all different."""
    return np.random.default_rng(seed).integers(0, 256, (8, 16, 4), np.uint8)


def listed(quads, commands, updates=(WHITE,), **more):
    """A list of quads, one after the other; command i draws the quads it names."""
    vertices = np.concatenate(quads)
    indices = np.concatenate([QUAD + 4 * number for number in range(len(quads))])
    made = DrawList((64.0, 48.0), vertices, indices, tuple(commands), tuple(updates), **more)
    made.check()
    return made


@pytest.fixture
def paint(either_device):
    """A function from lists to pictures over `background()`; a message of either driver fails the test."""
    draw = on_gl if isinstance(either_device, Context) else on_vulkan
    return lambda *lists: draw(either_device, lists, background())


@pytest.mark.feature("ui/imgui-renderer")
def test_glyphs_and_clips_are_exact_to_the_pixel(paint):
    texels = glyphs()
    texels[..., 3] = 255
    font = TextureUpdate(FONT, (16, 8), texels)
    quads = [
        quad((10, 20, 26, 28)),  # one texel a pixel
        quad((40, 4, 48, 8), (0.5, 0.25, 1.0, 0.75)),  # a part of the texture
        quad((0, 0, 64, 48)),
    ]
    drawn = listed(
        quads,
        [
            Command(EVERYTHING, FONT, 0, 6),
            Command((42.0, 5.0, 46.0, 99.0), FONT, 0, 6, base=4),  # quad 1 by its base
            Command((-5.0, 40.0, 0.4, 44.6), FONT, 12, 6),  # less than half a pixel wide: nothing
            Command((7.0, 7.0, 7.0, 9.0), FONT, 12, 6),
        ],
        [font],
    )
    expected = background()
    expected[20:28, 10:26] = texels
    expected[5:8, 42:46] = texels[3:6, 10:14]
    assert np.array_equal(paint(drawn)[0], expected)


@pytest.mark.feature("ui/imgui-renderer")
def test_the_corners_of_the_extent_are_those_of_the_target(paint):
    red, clear = (255, 0, 0, 255), (0, 0, 0, 0)
    extent = {"origin": (100.0, -20.0)}
    whole = listed(
        [quad((100, -20, 164, 28), color=red)], [Command((100, -20, 164, 28), FONT, 0, 6)], **extent
    )
    corner = listed(
        [quad((100, -20, 101, -19), color=red)], [Command((100, -20, 164, 28), FONT, 0, 6)], **extent
    )
    nothing = listed(
        [quad((100, -20, 164, 28), color=clear)], [Command((100, -20, 164, 28), FONT, 0, 6)], **extent
    )
    pictures = paint(whole, corner, nothing)
    assert (pictures[0] == red).all()
    expected = background()
    expected[0, 0] = red
    assert np.array_equal(pictures[1], expected), "y points down"
    assert np.array_equal(pictures[2], background())


def test_codes_are_blended_as_the_list_says(paint):
    boxes = [(0, 0, 40, 30), (20, 10, 64, 48), (30, 0, 50, 48)]
    colors = [(255, 128, 0, 128), (10, 200, 90, 77), (0, 0, 0, 3)]
    drawn = listed(
        [quad(box, color=color) for box, color in zip(boxes, colors, strict=True)],
        [Command(EVERYTHING, FONT, 0, 18)],
    )
    expected = background().astype(np.float64)
    for box, color in zip(boxes, colors, strict=True):
        blended(expected, box, color)
    (found,) = paint(drawn)
    assert np.abs(found - expected).max() < 3, (
        "at most a step for each of three layers: drivers blend in 8 bits"
    )


@pytest.mark.feature("ui/texture-windows")
def test_textures_are_upright_and_red_shows_as_grey(paint):
    image, other = glyphs(1), glyphs(2)
    image[..., 3] = other[..., 3] = 255
    updates = [WHITE, TextureUpdate(3, (16, 8), image), TextureUpdate(7, (16, 8), other)]
    boxes = [(0, 0, 16, 8), (20, 0, 36, 8), (40, 0, 56, 8), (0, 40, 16, 48)]
    drawn = listed(
        [quad(box) for box in boxes],
        [
            Command(EVERYTHING, 3, 0, 6),
            Command(EVERYTHING, 7, 6, 6),
            Command(EVERYTHING, 3 | GREY, 12, 6),
            Command(EVERYTHING, FONT, 18, 6),
        ],
        updates,
    )
    expected = background()
    expected[0:8, 0:16], expected[0:8, 20:36] = image, other
    expected[0:8, 40:56, :3] = image[..., :1]
    expected[40:48, 0:16] = 255
    assert np.array_equal(paint(drawn)[0], expected)


def test_a_part_of_a_texture_is_replaced_and_a_new_size_makes_it_anew(paint):
    first, part, wide = glyphs(1), glyphs(2)[2:5, 4:9], np.tile(glyphs(3), (2, 1, 1))
    first[..., 3] = part[..., 3] = wide[..., 3] = 255
    show = [quad((0, 0, 16, 8))], [Command(EVERYTHING, FONT, 0, 6)]
    tall = [quad((0, 0, 16, 16))], [Command(EVERYTHING, FONT, 0, 6)]
    pictures = paint(
        listed(*show, [TextureUpdate(FONT, (16, 8), first)]),
        listed(*show, [TextureUpdate(FONT, (16, 8), part, 3, 1)]),
        listed(*show, []),
        listed(*tall, [TextureUpdate(FONT, (16, 16), wide)], dropped=(9,)),
    )
    assert np.array_equal(pictures[0][:8, :16], first)
    first[1:4, 3:8] = part
    assert np.array_equal(pictures[1][:8, :16], first)
    assert np.array_equal(pictures[2], pictures[1])
    assert np.array_equal(pictures[3][:16, :16], wide)


@pytest.mark.feature("ui/texture-windows")
def test_a_texture_that_is_gone_or_new_in_part_is_an_error(paint):
    show = [quad((0, 0, 16, 8))], [Command(EVERYTHING, 5, 0, 6)]
    given = listed(*show, [TextureUpdate(5, (16, 8), glyphs())])
    with pytest.raises(ValueError, match="texture 5"):
        paint(given, listed(*show, [], dropped=(5,)))
    with pytest.raises(ValueError, match="in part"):
        paint(listed(*show, [TextureUpdate(5, (16, 9), glyphs())]))


def test_a_long_list_follows_a_short_one(paint):
    """Buffers grow between frames; the list is longer than their first size."""
    random = np.random.default_rng(3)
    boxes = [(x, y, x + 1, y + 1) for y in range(48) for x in range(64)]
    colors = random.integers(0, 256, (len(boxes), 4), np.uint8)
    colors[:, 3] = 255
    quads = [quad(box, color=tuple(color)) for box, color in zip(boxes, colors, strict=True)]
    short = listed(quads[:1], [Command(EVERYTHING, FONT, 0, 6)])
    long = listed(quads, [Command(EVERYTHING, FONT, 0, 6 * len(quads))], [])
    assert long.vertices.nbytes > 1 << 16
    assert np.array_equal(paint(short, long, long, long)[3], colors.reshape(48, 64, 4))


def wild():
    """Many triangles of every shape, opacity and texture, with edges through the centres of pixels."""
    random = np.random.default_rng(8)
    vertices = np.zeros(900, VERTEX)
    vertices["position"] = np.round(random.uniform(-8, 72, (900, 2)) * 2) / 2
    vertices["uv"] = random.uniform(-0.2, 1.2, (900, 2))
    vertices["color"] = random.integers(0, 256, (900, 4))
    commands = []
    for first in range(0, 900, 30):
        left, top = random.uniform(-5, 50, 2)
        clip = (left, top, left + random.uniform(5, 60), top + random.uniform(5, 40))
        commands.append(Command(clip, int(random.choice([FONT, 4, 4 | GREY])), first, 30))
    updates = (TextureUpdate(FONT, (16, 8), glyphs(4)), TextureUpdate(4, (16, 8), glyphs(5)))
    indices = random.permutation(900).astype(np.uint32)
    return DrawList((64.0, 48.0), vertices, indices, tuple(commands), updates)


@pytest.mark.feature("ui/imgui-renderer")
@pytest.mark.parametrize("size", [(64, 48), (97, 61), (128, 96)])
def test_both_backends_draw_the_same_pixels(gl_context, vulkan_device, size):
    if not all(found.capabilities.is_software for found in (gl_context, vulkan_device)):
        pytest.skip("bits agree on the software drivers alone")
    below = np.resize(background(), (size[1], size[0], 4))
    vulkan, opengl = on_vulkan(vulkan_device, [wild()], below)[0], on_gl(gl_context, [wild()], below)[0]
    assert np.array_equal(vulkan, opengl)
    assert (vulkan != below).any(-1).mean() > 0.5


@pytest.mark.feature("ui/imgui-renderer")
def test_a_recorded_panel_is_the_same_on_both_backends(gl_context, vulkan_device):
    """The list that the panel's own package made, with its glyphs; the package itself is not needed."""
    if not all(found.capabilities.is_software for found in (gl_context, vulkan_device)):
        pytest.skip("bits agree on the software drivers alone")
    recorded = load(RECORDED)
    below = np.full((720, 640, 4), (90, 110, 130, 255), np.uint8)
    vulkan, opengl = on_vulkan(vulkan_device, [recorded], below)[0], on_gl(gl_context, [recorded], below)[0]
    assert np.array_equal(vulkan, opengl)
    assert len(np.unique(vulkan.reshape(-1, 4), axis=0)) > 100
    title = vulkan[11:28, 20:400, :3].astype(int)
    assert title.max() == 255 and (vulkan[400:, 500:] == below[0, 0]).all()


# --- the record -------------------------------------------------------------------------------------------------------


def test_a_list_survives_the_disk(tmp_path):
    made = listed(
        [quad((0, 0, 9.5, 3)), quad((1, 2, 3, 4))],
        [Command((0.5, 1, 2, 3), 3 | GREY, 0, 6), Command(EVERYTHING, FONT, 6, 6, 0)],
        [WHITE, TextureUpdate(3, (16, 9), glyphs(), 0, 1)],
        dropped=(4, 5),
        origin=(2.0, 0.25),
    )
    save(tmp_path / "list.npz", made)
    found = load(tmp_path / "list.npz")
    assert (found.extent, found.origin, found.commands, found.dropped) == (
        made.extent,
        made.origin,
        made.commands,
        made.dropped,
    )
    assert np.array_equal(found.vertices, made.vertices) and np.array_equal(found.indices, made.indices)
    for one, other in zip(found.updates, made.updates, strict=True):
        assert (one.texture, one.size, one.x, one.y) == (other.texture, other.size, other.x, other.y)
        assert np.array_equal(one.pixels, other.pixels)


@pytest.mark.feature("ui/imgui-renderer")
@pytest.mark.parametrize(
    "command",
    [
        Command(EVERYTHING, FONT, 0, 9),
        Command(EVERYTHING, FONT, -3, 3),
        Command(EVERYTHING, FONT, 0, 5),
        Command(EVERYTHING, FONT, 0, 6, base=1),
        Command(EVERYTHING, FONT, 0, 6, base=-1),
    ],
)
def test_a_command_that_reaches_outside_is_refused(command):
    with pytest.raises(ValueError, match="command 0"):
        DrawList((64.0, 48.0), quad((0, 0, 1, 1)), QUAD, (command,)).check()


def test_pixels_outside_their_texture_are_refused():
    for pixels, x, y in ((glyphs(), 1, 0), (glyphs(), 0, -1), (glyphs()[..., :3], 0, 0)):
        with pytest.raises(ValueError, match="no part of a texture"):
            TextureUpdate(0, (16, 8), pixels, x, y)


def test_clips_go_to_the_nearest_pixel():
    drawn = DrawList((64.0, 48.0), origin=(1.0, 0.0))
    assert drawn.scissor(Command((4.6, 2.4, 8.4, 9.6), FONT, 0, 0), (64, 48)) == (4, 2, 3, 8)
    assert drawn.scissor(Command((4.6, 2.4, 8.4, 9.6), FONT, 0, 0), (128, 96)) == (7, 5, 8, 14)
    assert drawn.scissor(Command((-9.0, -9.0, 999.0, 999.0), FONT, 0, 0), (64, 48)) == (0, 0, 64, 48)


def test_nothing_stays_switched_on_for_the_next_pass(gl_context):
    on_gl(gl_context, [wild()], background())
    fn = gl_context.fn
    assert not any(
        fn.glIsEnabled(one) for one in (gl.GL_BLEND, gl.GL_SCISSOR_TEST, gl.GL_DEPTH_TEST, gl.GL_CULL_FACE)
    )


def test_neighbouring_clips_share_their_edge_at_any_scale():
    drawn = DrawList((64.0, 48.0))
    for width in (64, 80, 96, 111, 128, 37):
        edges = []
        for left in range(64):
            clip = drawn.scissor(Command((left, 0, left + 1, 48), FONT, 0, 0), (width, 50))
            if clip is not None:
                edges.append((clip[0], clip[0] + clip[2]))
                assert (clip[1], clip[3]) == (0, 50)
        assert edges[0][0] == 0 and edges[-1][1] == width
        assert all(one[1] == other[0] for one, other in pairwise(edges))
