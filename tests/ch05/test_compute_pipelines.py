"""Compute pipelines whose layouts come from their shaders, work groups that cover any size, and what is refused."""

from __future__ import annotations

import itertools

import numpy as np
import pytest

from backends import shader_text
from backends.vulkan.shaders.compiler import compile_shader
from chapters import ch05
from chapters.ch05.frames.dispatches import MOST_GROUPS, group_count
from chapters.ch05.pipelines.spirv.shared_memory import shared_bytes
from common.errors import ShaderError, UnsupportedError
from tests.support.drivers import needs_line_marks
from tests.support.kernels import kernels_on

AFFINE = """
layout(local_size_x = 64) in;
struct Push { uvec4 numbers; };  // x: elements, y: a, z: b
PUSH(Push, push)
layout(BIND(0, 0, 0)) readonly buffer In_ { uint x[]; };
layout(BIND(0, 1, 1)) writeonly buffer Out_ { uint y[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i < push.numbers.x) { y[i] = push.numbers.y * x[i] + push.numbers.z; }
}
"""
COVER = """
layout(local_size_x = 8, local_size_y = 8) in;
struct Push { uvec4 size; };
PUSH(Push, push)
layout(BIND(0, 0, 0)) buffer Seen_ { uint seen[]; };
layout(BIND(0, 1, 1)) buffer Outside_ { uint outside; };
void main() {
    uvec2 pixel = gl_GlobalInvocationID.xy;
    if (any(greaterThanEqual(pixel, push.size.xy))) {
        atomicAdd(outside, 1u);
        return;
    }
    atomicAdd(seen[pixel.y * push.size.x + pixel.x], 1u);
}
"""
COPY = """
layout(local_size_x = 32) in;
layout(BIND(0, 0, 0)) readonly buffer In_ { uint x[]; };
layout(BIND(0, 1, 1)) writeonly buffer Out_ { uint y[]; };
void main() { y[gl_GlobalInvocationID.x] = x[gl_GlobalInvocationID.x]; }
"""


@pytest.fixture(scope="module")
def kernels(chapter):
    with kernels_on(chapter.device, ch05.__name__) as made:
        yield made


@pytest.fixture
def shader(tmp_path):
    """Write the text of a kernel to a file of its own."""
    numbers = itertools.count()

    def write(text, file=None):
        file = file or tmp_path / f"kernel{next(numbers)}.comp"
        file.write_bytes(text.encode())
        return file

    return write


def numbers(*values):
    return np.array([*values, 0, 0, 0][:4], np.uint32)


@pytest.mark.feature("compute/pipelines-and-buffers")
@pytest.mark.parametrize("count", [1, 63, 64, 65, 1_000_000])
def test_an_affine_map_is_exact_at_any_size(kernels, shader, count):
    x = np.random.default_rng(count).integers(0, 2**32, count, np.uint32)
    before = np.full(count + 1, 7, np.uint32)
    _, y = kernels.run(kernels.pipeline(shader(AFFINE)), [x, before], (count,), numbers(count, 3, 5))
    assert np.array_equal(y[:count], x * np.uint32(3) + np.uint32(5))
    assert y[count] == 7, "the last group stands over the end, and its kernel writes nothing there"


@pytest.mark.feature("compute/pipelines-and-buffers")
def test_random_data_survive_upload_identity_and_download(kernels, shader):
    x = np.random.default_rng(1).integers(0, 2**32, 4096, np.uint32)
    same, y = kernels.run(kernels.pipeline(shader(COPY)), [x, np.zeros_like(x)], x.shape)
    assert np.array_equal(y, x) and np.array_equal(same, x)


@pytest.mark.feature("compute/dispatch-sizing")
@pytest.mark.parametrize("size", [(1, 1), (9, 7), (65, 33), (64, 8), (3, 200)])
def test_groups_cover_every_pixel_once(kernels, shader, size):
    width, height = size
    seen, outside = kernels.run(
        kernels.pipeline(shader(COVER)),
        [np.zeros((height, width), np.uint32), np.zeros(1, np.uint32)],
        size,
        numbers(*size),
    )
    assert (seen == 1).all()
    assert outside[0] == -(-width // 8) * 8 * -(-height // 8) * 8 - width * height


@pytest.mark.feature("compute/dispatch-sizing")
def test_group_counts_are_rounded_up():
    assert group_count((1280, 720), (8, 8, 1)) == (160, 90, 1)
    assert group_count((1281, 721), (8, 8, 1)) == (161, 91, 1)
    assert group_count((1,), (64, 1, 1)) == (1, 1, 1)
    assert group_count((5, 5, 5), (4, 4, 4)) == (2, 2, 2)
    for size, group in itertools.product(range(1, 40), range(1, 12)):
        (groups, _, _) = group_count((size,), (group, 1, 1))
        assert (groups - 1) * group < size <= groups * group


def test_more_groups_than_a_device_runs_are_refused():
    assert group_count((MOST_GROUPS * 64,), (64, 1, 1)) == (MOST_GROUPS, 1, 1)
    with pytest.raises(UnsupportedError, match=r"^4194241 invocations take 65536 work groups in a row"):
        group_count((MOST_GROUPS * 64 + 1,), (64, 1, 1))


def test_a_dispatch_waits_for_the_one_before(kernels, shader):
    """Each kernel adds its neighbour's number, so what the second finds tells whether the first was whole."""
    add = """
layout(local_size_x = 64) in;
layout(BIND(0, 0, 0)) buffer A_ { uint a[]; };
layout(BIND(0, 1, 1)) buffer B_ { uint b[]; };
void main() {
    uint i = gl_GlobalInvocationID.x, n = uint(a.length());
    TO[i] = FROM[(i + 1u) % n] + FROM[i];
}
"""
    file = shader(add)
    there = kernels.pipeline(file, defines=(("FROM", "a"), ("TO", "b")))
    back = kernels.pipeline(file, defines=(("FROM", "b"), ("TO", "a")))
    a = np.arange(64 * 256, dtype=np.uint32)
    found, _ = kernels.run([there, back, there, back], [a, np.zeros_like(a)], a.shape)
    for _ in range(4):
        a = np.roll(a, -1) + a
    assert np.array_equal(found, a)


def test_equal_descriptions_share_a_pipeline_and_another_shader_has_its_own(kernels, shader):
    file = shader(COPY)
    assert kernels.pipeline(file) is kernels.pipeline(file)
    assert kernels.pipeline(file) is not kernels.pipeline(shader(COPY.replace("= 32", "= 16")))


def test_an_edited_kernel_is_built_anew_with_its_new_groups(kernels, shader):
    file = shader(AFFINE)
    pipeline = kernels.pipeline(file)
    x = np.arange(100, dtype=np.uint32)
    shader(AFFINE.replace("x = 64", "x = 16").replace("numbers.z;", "numbers.z + 1u;"), file)
    assert len(kernels.reload(file)) == 1
    _, y = kernels.run(pipeline, [x, np.zeros_like(x)], x.shape, numbers(100, 2, 3))
    assert np.array_equal(y, 2 * x + 4) and pipeline.group == (16, 1, 1)
    shader(AFFINE.replace("x[i]", "x[i"), file)
    with pytest.raises(ShaderError, match=r"kernel\d+\.comp:9"):
        kernels.reload(file)
    _, y = kernels.run(pipeline, [x, np.zeros_like(x)], x.shape, numbers(100, 2, 3))
    assert np.array_equal(y, 2 * x + 4), "what is wrong changes nothing"
    shader(AFFINE, file)
    kernels.reload(file)


@pytest.mark.feature("compute/pipelines-and-buffers")
def test_a_work_group_that_the_device_cannot_run_is_refused_in_a_sentence(chapter, kernels, shader):
    needs_line_marks(chapter.device)
    text = COPY.replace("local_size_x = 32", "local_size_x = 4096, local_size_y = 4096")
    with pytest.raises(ShaderError) as error:
        kernels.pipeline(shader(text))
    assert "kernel0.comp" in str(error.value) and "4096" in str(error.value)


def test_more_shared_memory_than_the_device_has_is_refused_in_a_sentence(kernels, shader):
    text = COPY.replace("void main() {", "shared vec4 much[100000];\nvoid main() { much[x[0]] = vec4(x[1]);")
    text = text.replace("= x[gl_GlobalInvocationID.x]", "= uint(much[x[2]].x)")
    with pytest.raises(ShaderError, match=r"(?is)kernel0\.comp.*shared?"):
        kernels.pipeline(shader(text))


def test_shared_memory_is_counted_without_padding():
    text = """
layout(local_size_x = 4) in;
layout(constant_id = 3) const uint ROOM = 5u;
struct Pair { vec3 a; uint b[3]; };
shared vec4 whole[7];
shared Pair pairs[2][3];
shared mat3 turn;
shared bool done;
shared float chosen[ROOM];
layout(binding = 0) buffer Out_ { float y[]; };
void main() {
    whole[0] = vec4(y[0]); pairs[1][2].a = turn[0]; turn[1] = vec3(y[1]); done = y[2] > 0.0; chosen[1] = y[3];
    barrier();
    y[4] = done ? whole[1].x + pairs[0][1].a.y : turn[2].z + chosen[2];
}
"""
    code = compile_shader(shader_text.build_text(text, "comp", "vulkan"))
    known = 7 * 16 + 2 * 3 * 24 + 36 + 4
    assert shared_bytes(code, {}) == known + 5 * 4
    assert shared_bytes(code, {3: 1000}) == known + 1000 * 4


@pytest.mark.variants("vulkan", "without-all")
def test_a_work_group_is_chosen_when_the_pipeline_is_built(kernels, shader):
    text = COVER.replace("local_size_x = 8, local_size_y = 8", "local_size_x_id = 0, local_size_y_id = 1")
    pipeline = kernels.pipeline(shader(text), specialization=((0, 4), (1, 2)))
    assert pipeline.group == (4, 2, 1)
    arrays = [np.zeros((5, 9), np.uint32), np.zeros(1, np.uint32)]
    seen, outside = kernels.run(pipeline, arrays, (9, 5), numbers(9, 5))
    assert (seen == 1).all() and outside[0] == 12 * 6 - 45
