"""What stands around a pass on OpenGL: clears, what is given up, shared textures, and barriers behind stores."""

from __future__ import annotations

from contextlib import contextmanager

import numpy as np
import pytest

from backends import shader_text
from backends.contract import Access, Pass, Sources
from backends.gl import api as gl
from backends.gl.draws import create_vertex_array
from backends.gl.programs import Programs
from backends.gl.readback import read_image
from backends.gl.resources import (
    Buffer,
    Image,
    bind_buffer,
    bind_storage_image,
    create_image,
    create_sampler,
    destroy_image,
    write_image,
)
from chapters.ch04.frames.gl_commands import Commands
from chapters.ch04.frames.recording.gl_recordings import Recordings
from chapters.ch04.graph.execute.gl import GraphExecutor
from chapters.ch04.graph.frame_graph import compile_graph
from chapters.ch04.graph.memory.gl_images import GraphImages, sharing
from chapters.ch04.graph.sync.gl import memory_barriers
from chapters.ch04.graph.types import External, Node, Touch
from chapters.ch04.pipelines.gl import Pipelines
from tests.support import gl_functions

pytestmark = pytest.mark.variants("gl")

SIZE = (8, 6)
IMAGE, STORAGE = gl.GL_SHADER_IMAGE_ACCESS_BARRIER_BIT, gl.GL_SHADER_STORAGE_BARRIER_BIT
FETCH, UPDATE = gl.GL_TEXTURE_FETCH_BARRIER_BIT, gl.GL_TEXTURE_UPDATE_BARRIER_BIT
TARGET, COMMAND = gl.GL_FRAMEBUFFER_BARRIER_BIT, gl.GL_COMMAND_BARRIER_BIT


class Made(Pass):
    """A pass of a test: `draw(commands)` is what it records."""

    def __init__(self, name, reads=(), writes=(), draw=lambda commands: None):
        self.name, self.reads, self.writes = name, reads, writes
        self.record = draw

    @property
    def node(self):
        return Node(self.name, self.reads, self.writes)


def compiled(passes, outputs, externals=None, alias=True):
    return compile_graph([one.node for one in passes], SIZE, outputs, externals, alias=alias)


class Stage:
    """Draws frames of a graph of test passes, without a scene."""

    def __init__(self, context):
        self.context, self.programs = context, Programs(context)
        self.pipelines, self.frames = Pipelines(context), Recordings(context)
        self.commands = Commands(context, self.pipelines, True)
        self.samplers = []
        self.empty = create_vertex_array(context, [], None, None, "no vertices")
        self.vertices = self.source(
            "vert",
            "void main() { gl_Position = vec4(vec2((VERTEX_ID << 1) & 2, "
            "VERTEX_ID & 2) * 2.0 - 1.0, 0.0, 1.0); }",
        )

    def source(self, stage, text):
        return shader_text.build_text(text, stage, "gl", extensions=())

    def sampler(self, described, anisotropy):
        self.samplers.append(create_sampler(self.context, described, anisotropy, "a test"))
        return self.samplers[-1]

    def fullscreen(self, text):
        """Return what draws one triangle by a fragment shader, with what its pass samples from unit 0 on."""
        program = self.programs.get([self.vertices, self.source("frag", text)])

        def draw(commands, made=None):
            fn = self.context.fn
            fn.glUseProgram(program.handle)
            for capability in (gl.GL_CULL_FACE, gl.GL_DEPTH_TEST, gl.GL_BLEND):
                fn.glDisable(capability)
            fn.glBindVertexArray(self.empty)
            fn.glDrawArrays(gl.GL_TRIANGLES, 0, 3)

        return draw

    @contextmanager
    def drawing(self, passes, outputs, alias=True, externals=None, held=None):
        """Yield (executor, function that draws a frame and returns its calls)."""
        graph = compiled(passes, outputs, externals, alias)
        named = {one.name: one for one in passes}
        given = (lambda images: [held] * len(images.in_slot)) if held else None
        executor = GraphExecutor(self.context, graph, named, self.sampler, given, alias)
        self.frames.forget()

        with gl_functions.traced(self.context) as names:

            def frame():
                del names[:]
                slot = self.frames.begin()
                if slot.key is None:
                    with self.frames.recording(slot, "whole") as calls:
                        self.commands.begin(slot)
                        slot.timestamps.begin_frame()
                        executor.record(self.commands, slot.index, calls)
                self.frames.submit(slot)
                return [*names]

            try:
                yield executor, frame
            finally:
                executor.close()

    def close(self):
        self.frames.close()
        for sampler in self.samplers:
            self.context.destroy("sampler", sampler)
        self.context.destroy("vertex array", self.empty)
        self.pipelines.close()
        self.programs.close()


@pytest.fixture
def stage(gl_context):
    made = Stage(gl_context)
    yield made
    made.close()


# --- attachments ---


@pytest.mark.feature("device/offscreen-targets")
def test_targets_without_a_size_are_as_large_as_the_frame(stage, gl_context):
    """Colour alone, depth alone, and both in one pass; another with a size beside them."""
    formats = {"picture": "rgba8", "shadow": "d32f", "light": "rgba32f", "depth": "d32f", "small": "rgba8"}
    values = {
        "picture": (0.0, 1.0, 0.0, 1.0),
        "shadow": (0.75,),
        "light": (1.5, -2.0, 0.0, 4.0),
        "depth": (0.25,),
    }
    values["small"] = (1.0, 0.0, 0.0, 1.0)
    targets = {
        name: Access(
            name,
            "depth" if format == "d32f" else "color",
            format=format,
            clear=values[name],
            size=(3, 5) if name == "small" else None,
        )
        for name, format in formats.items()
    }
    passes = [Made(f"clears {name}", writes=(targets[name],)) for name in ("picture", "shadow", "small")]
    passes.append(Made("clears both", writes=(targets["light"], targets["depth"])))
    with stage.drawing(passes, tuple(targets)) as (executor, frame):
        frame()
        read = {name: read_image(gl_context, executor.images.image(0, name)) for name in targets}
    width, height = SIZE
    for name, pixels in read.items():
        assert pixels.shape[:2] == ((5, 3) if name == "small" else (height, width)), name
        scale = 255 if formats[name] == "rgba8" else 1
        assert (pixels.reshape(-1, len(values[name])) == np.array(values[name]) * scale).all(), name


@pytest.mark.feature("frame-graph/render-targets")
def test_each_target_is_cleared_to_its_own_value(stage, gl_context):
    """Floats, bytes, integers beyond the exact ones of a float, and depth; one that is not cleared is given up."""
    whole = 0xFFFFFFFE
    made = Made(
        "clears",
        writes=(
            Access("light", "color", format="rgba32f", clear=(1.5, -2.0, 1e-20, 4.0)),
            Access("id", "color", format="r32ui", clear=(whole, 0, 0, 0)),
            Access("picture", "color", format="rgba8", clear=(1.0, 0.0, 1.0, 0.0)),
            Access("whatever", "color", format="rg16f"),
            Access("depth", "depth", format="d32f", clear=(0.25,)),
        ),
    )
    with stage.drawing([made], ("light", "id", "picture", "depth", "whatever")) as (executor, frame):
        names = frame()
        read = {name: read_image(gl_context, executor.images.image(0, name)) for name in executor.graph.names}
    assert (read["light"] == np.float32((1.5, -2.0, 1e-20, 4.0))).all()
    assert (read["id"] == whole).all()
    assert (read["picture"] == (255, 0, 255, 0)).all()
    assert (read["depth"] == 0.25).all()
    assert names.count("glInvalidateNamedFramebufferData") == 1
    assert "glMemoryBarrier" not in names


def test_what_nobody_wants_afterwards_is_given_up_behind_the_pass(stage, monkeypatch):
    """The depth of a pass whose colours alone are read, once in each frame."""
    given_up = []
    draw = stage.fullscreen("layout(location = 0) out vec4 c; void main() { c = vec4(0.5); }")
    made = Made(
        "draws",
        writes=(
            Access("color", "color", format="rgba8", clear=(0.0,) * 4),
            Access("depth", "depth", format="d32f", clear=(0.0,)),
        ),
        draw=draw,
    )
    real = stage.context.fn.glInvalidateNamedFramebufferData
    monkeypatch.setattr(
        stage.context.fn,
        "glInvalidateNamedFramebufferData",
        lambda handle, count, points: (given_up.append([*points]), real(handle, count, points)),
    )
    with stage.drawing([made], ("color",)) as (_, frame):
        names = [frame() for _ in range(2)]
    assert given_up == [[gl.GL_DEPTH_ATTACHMENT]] * 2
    order = names[0]
    assert order.index("glInvalidateNamedFramebufferData") > order.index("glDrawArrays")


# --- textures that are shared ---


def chain(stage, length):
    """Return passes that each add their number to what the one before wrote."""
    text = """layout(BIND(0, 0, 0)) uniform sampler2D from;
    layout(location = 0) out vec4 c; void main() {{ c = texelFetch(from, ivec2(gl_FragCoord), 0) + {}; }}"""
    passes = [
        Made("pass 0", writes=(Access("step 0", "color", format="rgba32f", clear=(1.0, 2.0, 3.0, 4.0)),))
    ]
    for number in range(1, length):
        made = Made(
            f"pass {number}",
            (Access(f"step {number - 1}", "sampled"),),
            (Access(f"step {number}", "color", format="rgba32f"),),
        )
        draw = stage.fullscreen(text.format(float(number)))

        def record(commands, made=made, draw=draw):
            commands.bind_textures(commands.sources)
            draw(commands)

        made.sources, made.record = Sources(), record
        passes.append(made)
    return passes


@pytest.mark.feature("frame-graph/resource-aliasing")
def test_textures_that_are_shared_change_no_bit(stage, gl_context):
    """Of nine transients in a row two textures are left; the plan for memory that can be placed says the same."""
    found = []
    for alias in (True, False):
        with stage.drawing(chain(stage, 10), ("step 9",), alias) as (executor, frame):
            for _ in range(3):
                frame()
            found.append(read_image(gl_context, executor.images.image(0, "step 9")))
            held, memory = executor.images, executor.graph.memory
            assert len({id(held.in_slot[0][f"step {n}"]) for n in range(9)}) == (2 if alias else 9)
            assert (held.size, held.alone) == (memory.size, memory.alone)
            assert held.alone == 9 * SIZE[0] * SIZE[1] * 16
    assert np.array_equal(*found)
    assert (found[0] == np.float32((46, 47, 48, 49))).all()


@pytest.mark.feature("frame-graph/external-resources")
def test_what_comes_from_outside_is_read_and_is_neither_shared_nor_freed(stage, gl_context):
    """Its texture looks like those of the passes, which are shared; it is read last, and is there afterwards."""
    theirs = create_image(gl_context, "rgba32f", SIZE, "theirs")
    content = np.random.default_rng(2).random((SIZE[1], SIZE[0], 4), np.float32)
    write_image(gl_context, theirs, content)
    text = """layout(BIND(0, 0, 0)) uniform sampler2D mine;
    layout(BIND(0, 1, 1)) uniform sampler2D theirs;
    layout(location = 0) out vec4 c;
    void main() { ivec2 at = ivec2(gl_FragCoord); c = texelFetch(mine, at, 0) + texelFetch(theirs, at, 0); }"""
    sums = Made(
        "sums",
        (Access("step 3", "sampled"), Access("theirs", "sampled")),
        (Access("sum", "color", format="rgba32f"),),
    )
    draw = stage.fullscreen(text)

    def record(commands):
        commands.bind_textures(commands.sources)
        draw(commands)

    sums.sources, sums.record = Sources(), record
    externals = {"theirs": External("rgba32f", SIZE, Touch("sampled", frozenset(), frozenset()), None)}
    passes = [*chain(stage, 4), sums]
    with stage.drawing(passes, ("sum",), True, externals, {"theirs": theirs}) as (executor, frame):
        for _ in range(3):
            frame()
        held = executor.images.in_slot[0]
        found = read_image(gl_context, executor.images.image(0, "sum"))
        assert held["theirs"] is theirs
        assert not any(held[name] is theirs for name in held if name != "theirs")
    assert np.array_equal(found, np.float32((7, 8, 9, 10)) + content)
    assert np.array_equal(read_image(gl_context, theirs), content), "it outlives the graph, unchanged"
    destroy_image(gl_context, theirs)


@pytest.mark.feature("frame-graph/resource-aliasing")
@pytest.mark.parametrize(("alias", "each"), [(True, 2), (False, 10)])
def test_no_more_is_made_than_is_alive_at_once(gl_context, alias, each):
    """Ten images and ten buffers in a row, where two of each are alive at once; an output, and a pair of histories."""
    passes = []
    for number in range(10):
        before = [Access(f"image {number - 1}", "sampled"), Access(f"sums {number - 1}", "storage")]
        image = Access(f"image {number}", "color", format="rgba32f")
        passes.append(
            Made(
                f"pass {number}",
                before if number else (),
                (image, Access(f"sums {number}", "storage", bytes=64)),
            )
        )
    last = (Access("image 9", "sampled"), Access("mean", "sampled", previous=True))
    writes = [Access(name, "color", format="rgba32f") for name in ("shown", "mean")]
    graph = compiled([*passes, Made("last", last, writes)], ("shown",))
    with gl_functions.traced(gl_context) as names:
        images = GraphImages(gl_context, graph, alias)
    assert names.count("glTextureStorage2D") == names.count("glCreateTextures") == each + 1 + 2
    assert names.count("glNamedBufferStorage") == each
    with gl_functions.traced(gl_context) as names:
        images.close()
    assert names.count("glDeleteTextures") == each + 1 + 2 and names.count("glDeleteBuffers") == each


@pytest.mark.feature("frame-graph/resource-aliasing")
def test_only_what_is_alike_and_over_is_shared():
    """Against every pair, in random graphs: same kind, no common step, and as few as are alive at once."""
    rng = np.random.default_rng(11)
    for _ in range(200):
        count = int(rng.integers(2, 12))
        passes = [Made("p0", writes=(Access("r0", "color", format="r32f"),))]
        for number in range(1, count):
            earlier = rng.choice(number, size=min(number, int(rng.integers(1, 4))), replace=False)
            passes.append(
                Made(
                    f"p{number}",
                    tuple(Access(f"r{other}", "sampled") for other in earlier),
                    (Access(f"r{number}", "color", format=str(rng.choice(["r32f", "rgba8", "d32f"][:2]))),),
                )
            )
        graph = compiled(passes, (f"r{count - 1}",))
        lives, owner = graph.memory.lives, sharing(graph)
        alike = {}
        for name, mine in owner.items():
            alike.setdefault(graph.resources[name].format, []).append(name)
            for other, its in owner.items():
                if name != other and mine == its:
                    assert graph.resources[name].format == graph.resources[other].format
                    assert lives[name][1] < lives[other][0] or lives[other][1] < lives[name][0]
        for names in alike.values():
            most = max(
                sum(lives[name][0] <= step <= lives[name][1] for name in names)
                for step in range(len(graph.steps))
            )
            assert len({owner[name] for name in names}) == most
        assert sharing(graph, alias=False) == {name: name for name in lives}


def test_the_list_is_linear_in_passes(stage):
    lengths = []
    for length in (4, 5, 6, 12):
        with stage.drawing(chain(stage, length), (f"step {length - 1}",)) as (_, frame):
            frame()
            frame()
            lengths.append(len(stage.frames.slots[0].calls))
    each = lengths[1] - lengths[0]
    assert lengths[2:] == [lengths[0] + 2 * each, lengths[0] + 8 * each]


# --- barriers ---

STORE = """layout(local_size_x = 1) in;
layout(BIND(0, 0, 0), rgba32f) uniform image2D stored;
layout(std430, BIND(0, 1, 1)) buffer Sums { uint sums[]; };
void main() {
    ivec2 at = ivec2(gl_GlobalInvocationID.xy);
    imageStore(stored, at, vec4(at, 0.5, 1.0));
    atomicAdd(sums[at.y], uint(at.x));
}"""
SHOW = """layout(BIND(0, 0, 0)) uniform sampler2D stored;
layout(std430, BIND(0, 1, 1)) buffer Sums { uint sums[]; };
layout(location = 0) out vec4 c;
void main() { c = texelFetch(stored, ivec2(gl_FragCoord), 0); c.w = float(sums[int(gl_FragCoord.y)]); }"""


@pytest.mark.feature("frame-graph/resource-types")
@pytest.mark.feature("frame-graph/barriers")
def test_what_shaders_store_is_there_for_the_next_pass(stage, gl_context):
    """A compute pass stores an image and sums in a buffer; one draw reads both, after one call with both bits."""
    program = stage.programs.get([stage.source("comp", STORE)])
    held = {}

    def store(commands):
        fn = gl_context.fn
        images = held["executor"].images.in_slot[commands.slot.index]
        fn.glClearNamedBufferData(
            images["sums"].handle, gl.GL_R32UI, gl.GL_RED_INTEGER, gl.GL_UNSIGNED_INT, gl.NULL
        )
        fn.glUseProgram(program.handle)
        bind_storage_image(gl_context, 0, images["stored"])
        bind_buffer(gl_context, "storage", 1, images["sums"])
        fn.glDispatchCompute(*SIZE, 1)

    draw = stage.fullscreen(SHOW)
    show = Made(
        "show",
        (Access("stored", "sampled"), Access("sums", "storage")),
        (Access("shown", "color", format="rgba32f"),),
    )
    show.sources = Sources()

    def record(commands):
        commands.bind_textures(commands.sources)
        bind_buffer(gl_context, "storage", 1, held["executor"].images.in_slot[commands.slot.index]["sums"])
        draw(commands)

    show.record = record
    compute = Made(
        "store",
        (),
        (Access("stored", "storage", format="rgba32f"), Access("sums", "storage", bytes=4 * SIZE[1])),
        store,
    )
    with stage.drawing([compute, show], ("shown",)) as (executor, frame):
        held["executor"] = executor
        calls = [frame() for _ in range(4)]
        found = read_image(gl_context, executor.images.image(0, "shown"))
        # The stores of a frame wait for the reads of the one before; the draw is shown what was stored.
        assert executor.barriers == [IMAGE | STORAGE, FETCH | STORAGE]
    assert [names.count("glMemoryBarrier") for names in calls] == [2] * 4
    assert calls[2].index("glMemoryBarrier", calls[2].index("glDispatchCompute")) < calls[2].index(
        "glDrawArrays"
    )
    rows, columns = np.mgrid[: SIZE[1], : SIZE[0]]
    assert np.array_equal(found[..., 0], columns) and np.array_equal(found[..., 1], rows)
    assert (found[..., 3] == sum(range(SIZE[0]))).all()


HOST = External(
    None,
    None,
    Touch("", frozenset(), frozenset()),
    Touch("", frozenset({"host"}), frozenset({"host_read"})),
    64,
)


@pytest.mark.parametrize(
    ("user", "bits"),
    [
        (Made("user", (Access("x", "sampled"),), (Access("y", "color", format="rgba8"),)), FETCH),
        (Made("user", (Access("x", "storage"),), (Access("y", "storage", format="rgba8"),)), IMAGE),
        (Made("user", (), (Access("y", "color", of="x"),)), TARGET),
        (Made("user", (Access("x", "copy"),), (Access("y", "copy", bytes=64),)), UPDATE | TARGET),
        (
            Made(
                "user",
                (Access("b", "indirect"), Access("x", "sampled")),
                (Access("y", "color", format="rgba8"),),
            ),
            FETCH | COMMAND,
        ),
    ],
    ids=["sampled", "storage", "drawn over", "copied", "indirect"],
)
def test_a_barrier_has_the_bits_of_the_next_use(user, bits):
    store = Made("store", (), (Access("x", "storage", format="rgba8"), Access("b", "storage", bytes=16)))
    graph = compiled([store, user], ("y",), {"y": HOST} if user.node.kind == "copy" else None)
    held = {name: stand_in(resource) for name, resource in graph.resources.items()}
    barriers = memory_barriers(graph, {"store": store, "user": user}, [held, held])
    assert barriers[-1] == bits


def stand_in(resource):
    """Return something that is not on the GPU in place of a resource."""
    if resource.kind == "buffer":
        return Buffer(0, resource.bytes, resource.name, None)
    return Image(0, 0, "rgba8", "rgba8", "2d", 1, 1, 1, 1, 1, resource.name)


# use: (bits of an image, bits of a buffer; None: it is no use of those)
BITS = {
    "color": (TARGET, None),
    "sampled": (FETCH, None),
    "storage": (IMAGE, STORAGE),
    "indirect": (None, COMMAND),
    "uniform": (None, gl.GL_UNIFORM_BARRIER_BIT),
}


def unordered(barriers, frames):
    """Return the pairs of uses that no barrier orders, in frames of [(object, bits, whether a shader stores)] by step.

    Written from section 7.13.2 alone, pair by pair: a use must lie behind a barrier with its bits that lies behind the
    store; a store must lie behind a barrier with its bits that lies behind every use.
    """
    line = []  # of (place, object, bits, stores), and of (place, bits)
    fences = []
    place = 0
    for frame in frames:
        for bits, uses in zip(barriers, frame, strict=True):
            fences.append((place, bits))
            line += [(place + 1, *use) for use in uses]
            place += 2
    found = set()
    for later, held, bits, stores in line:
        for earlier, other, _, stored in line:
            if other == held and earlier < later and (stores or stored):
                between = 0
                for at, has in fences:
                    between |= has if earlier < at < later else 0
                if bits & ~between:
                    found.add((earlier, later))
    return found


def random_frame(rng):
    """Return (graph, passes): each writes an image or a buffer and reads some of the earlier ones."""
    passes, kinds = [], []
    for number in range(int(rng.integers(2, 8))):
        reads = {}
        for other in rng.choice(number, size=min(number, int(rng.integers(0, 3))), replace=False):
            names = [use for use, bits in BITS.items() if bits[kinds[other]] is not None and use != "color"]
            reads[f"r{other}"] = str(rng.choice(names))
        buffer = int(rng.integers(2))
        kinds.append(buffer)
        use = "storage" if buffer or rng.integers(2) else "color"
        more = {"bytes": 64} if buffer else {"format": "rgba8"}
        passes.append(
            Made(
                f"p{number}",
                tuple(Access(name, way, stages=("compute",)) for name, way in reads.items()),
                (Access(f"r{number}", use, **more),),
            )
        )
    return compiled(passes, (f"r{len(passes) - 1}",)), {one.name: one for one in passes}


@pytest.mark.feature("frame-graph/barriers")
def test_no_barrier_is_missing_and_none_is_in_vain():
    """Random frames against the specification's own words; without any single bit of any barrier some pair is lost."""
    rng = np.random.default_rng(5)
    bits_seen = 0
    for _ in range(150):
        graph, passes = random_frame(rng)
        held = {name: stand_in(resource) for name, resource in graph.resources.items()}
        held |= {name: held[owner] for name, owner in sharing(graph).items()}
        uses = []
        for step in graph.steps:
            made = passes[step.name]
            uses.append(
                [
                    (
                        id(held[access.resource]),
                        BITS[access.use][graph.resources[access.resource].kind == "buffer"],
                        access.use == "storage" and access in made.writes,
                    )
                    for access in (*made.reads, *made.writes)
                ]
            )
        barriers = memory_barriers(graph, passes, [held, held])
        assert not unordered(barriers, [uses] * 3)
        for number, bits in enumerate(barriers):
            for bit in [1 << place for place in range(16) if bits >> place & 1]:
                bits_seen += 1
                without = [*barriers]
                without[number] -= bit
                assert unordered(without, [uses] * 3), (number, hex(bit))
    assert bits_seen > 200
