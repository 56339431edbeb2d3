"""The study shading-rates: invocations of each cell and draw, where each is evaluated, and what is refused."""

from __future__ import annotations

from types import SimpleNamespace

import numpy as np
import pytest

import chapters
from backends.vulkan import api as vk
from backends.vulkan.driver import features as vf
from backends.vulkan.shaders.live import compile_stages
from chapters.ch09.pipelines.vulkan import source_of
from chapters.ch09.studies.shading_rates import (
    Settings,
    code_of,
    defines,
    names_of,
    rated,
    shaders,
    side_of,
    vulkan,
)
from common.errors import UnsupportedError, UserError
from common.images.palette import id_color
from tests.support.bounds import codes_off
from tests.support.drivers import needs_feature

DRAWS = pytest.mark.feature("vrs/per-draw-rate")
PRIMITIVES = pytest.mark.feature("vrs/per-primitive-rate")
only_vulkan = pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module")
WHICH, SIZE, SIDE = "9/shading-rates", (261, 194), 32
RATES = ("1x1", "1x2", "2x1", "2x2", "2x4", "4x2", "4x4")
KEEP, REPLACE = 0, 1
"""Combiners, as the specification numbers them."""


@pytest.fixture
def rated_stage(stage):
    """The Vulkan device, if it has shading rates and counts fragments."""
    needs_feature(stage.device, "shading-rate")
    needs_feature(stage.device, "pipeline-statistics")
    return stage


def drawn(stage, source, rate="2x2", combiner="replace"):
    """Return the picture, the counts of each cell and the counters of a frame; skip where the device lacks it."""
    bits = rated.BITS.get(source, ())
    missing = stage.device.physical.lacks(vf.Requirement(bits=bits))
    if source == "mesh":
        needs_feature(stage.device, "mesh-shader")
    if missing:
        pytest.skip(missing)
    settings = Settings(source=source, rate=rate, combiner=combiner)
    if tuple(map(int, rate.split("x"))) not in rated.rates_of(stage.device):
        pytest.skip(f"the device has no rate {rate}")
    with stage.open(WHICH, SIZE, settings=settings) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        return frame.image("color")[..., :3], frame.work, renderer.last_counts


def invocations(width, height):
    """Return how many blocks of this size the two triangles of a cell touch; pixels of the diagonal are the lower's."""
    y, x = np.mgrid[0:SIDE, 0:SIDE]
    block = y // height * SIDE + x // width
    lower = x + y >= SIDE - 1
    return len(np.unique(block[lower])) + len(np.unique(block[~lower]))


def marked_cells(source):
    """Return (6, 8) which cells have the rate: those of the lower draw, or every second one."""
    row, column = np.mgrid[0:6, 0:8]
    return (row + column) % 2 == 1 if source in ("vertex", "mesh") else row >= 3


def expected(source, width, height, shown=None):
    """Return the picture, (H, W, 3) in codes: rings at the middle of each block, in the colour of its rate.

    `shown` are cells (6, 8) by a code whose colour they have, though their blocks have another.
    """
    y, x = np.mgrid[0 : SIZE[1], 0 : SIZE[0]]
    inside = (x < 8 * SIDE) & (y < 6 * SIDE)
    cells = marked_cells(source)[np.minimum(y // SIDE, 5), np.minimum(x // SIDE, 7)]
    w, h = np.where(cells, width, 1), np.where(cells, height, 1)
    code = {1: 0, 2: 1, 4: 2}
    number = np.where(cells, code[width] << 2 | code[height], 0)
    for other, at in (shown or {}).items():
        number = np.where(at[np.minimum(y // SIDE, 5), np.minimum(x // SIDE, 7)], other, number)
    number = number.astype(np.uint32)
    at = np.stack([x // w * w + w / 2, y // h * h + h / 2], -1) / SIDE - np.array([4, 3])
    wave = np.abs(2 * ((0.5 * (at**2).sum(-1)) % 1) - 1)
    lit = id_color(number.reshape(-1)).reshape(*number.shape, 3) * (0.25 + 0.75 * wave)[..., None]
    return 255 * np.where(inside[..., None], lit, 0.02)


# --- on a device with shading rates -----------------------------------------------------------------------------------


@DRAWS
@only_vulkan
def test_a_draw_at_2x2_runs_a_quarter_of_the_invocations(rated_stage):
    """By the state of the pipeline and by a command alike. Blocks on a diagonal run for both triangles: 27 % in all."""
    _, full, counts = drawn(rated_stage, "none")
    assert (counts == SIDE**2).all() and full["fragments"] == full["pixels"] == 48 * SIDE**2
    found = {}
    for source in ("pipeline", "dynamic"):
        picture, work, counts = drawn(rated_stage, source)
        assert (counts == np.where(marked_cells(source), invocations(2, 2), SIDE**2)).all()
        assert work["fragments_upper"] == full["fragments_upper"]
        assert 0.25 <= work["fragments_lower"] / full["fragments_lower"] < 0.3
        found[source] = picture
    assert (found["pipeline"] == found["dynamic"]).all()


@PRIMITIVES
@only_vulkan
@pytest.mark.parametrize("source", ["vertex", "mesh"])
def test_exactly_the_marked_primitives_run_fewer_invocations(rated_stage, source):
    """Both draws have 12 cells of each kind."""
    _, full, _ = drawn(rated_stage, "none")
    _, work, counts = drawn(rated_stage, source)
    assert (counts == np.where(marked_cells(source), invocations(2, 2), SIDE**2)).all()
    for draw in ("fragments_upper", "fragments_lower"):
        assert 0.5 * 1.25 <= work[draw] / full[draw] < 0.5 * 1.3


@PRIMITIVES
@only_vulkan
@pytest.mark.parametrize("source", ["vertex", "mesh"])
def test_a_combiner_that_keeps_ignores_the_rate_of_primitives(rated_stage, source):
    full, _, _ = drawn(rated_stage, "none")
    picture, work, counts = drawn(rated_stage, source, combiner="keep")
    assert (counts == SIDE**2).all() and work["fragments"] == work["pixels"]
    assert (picture == full).all()


@DRAWS
@only_vulkan
@pytest.mark.parametrize("rate", RATES)
@pytest.mark.parametrize("source", ["pipeline", "dynamic", "vertex", "mesh"])
def test_blocks_are_evaluated_at_their_middle_and_keep_their_edges(rated_stage, source, rate):
    """The colour also says which rate the fragment shader found. Nothing is drawn beyond the cells."""
    width, height = map(int, rate.split("x"))
    picture, _, counts = drawn(rated_stage, source, rate)
    assert (counts == np.where(marked_cells(source), invocations(width, height), SIDE**2)).all()
    off = np.abs(picture - expected(source, width, height))
    assert off.max() <= codes_off(rated_stage.device) + 0.1  # a ring's phase is below 12.5, in steps of 1e-6


@DRAWS
@only_vulkan
def test_what_the_device_lacks_is_one_sentence(stage, monkeypatch):
    alive = dict(stage.device.alive)
    with pytest.raises(UnsupportedError, match=r"needs shading-rate, but it is switched off by --without\.$"):
        stage.open(WHICH, SIZE, without=("shading-rate",))
    if not stage.device.has("shading-rate"):
        with pytest.raises(
            UnsupportedError, match=r"needs shading-rate, but the driver lacks VK_KHR_frag\w+\.$"
        ):
            stage.open(WHICH, SIZE)
    monkeypatch.setattr(vulkan, "check_device", lambda *asked: None)
    for small in ((31, 200), (200, 23)):
        with pytest.raises(UserError, match=r"has 8x6 cells: it takes 32x24 pixels or more\.$"):
            stage.open(WHICH, small)
    assert stage.device.alive == alive


@DRAWS
@PRIMITIVES
def test_the_command_line_says_so_too_and_draws_nothing(strata, tmp_path):
    for source in ("pipeline", "vertex"):
        words = ("run", WHICH, "--without", "shading-rate", "--set", f"source={source}", "--out", "x.png")
        code, out, err = strata(*words)
        assert (code, out) == (2, "") and not (tmp_path / "x.png").exists()
        assert " ".join(err.split()) == (
            "strata: The study shading-rates needs shading-rate, but it is switched off by --without."
        )


# --- on any machine ---------------------------------------------------------------------------------------------------

OWN_FINISHED = rated.RatedPipelines._finished
STATE, DYNAMIC_RATE = 1000226001, 1000226000
"""VkPipelineFragmentShadingRateStateCreateInfoKHR and VK_DYNAMIC_STATE_FRAGMENT_SHADING_RATE_KHR, from vk.xml."""


@pytest.fixture
def asked(stage, monkeypatch, tmp_path):
    """Let the study draw on a device without shading rates, and return what it asks for in pipelines and commands.

    What belongs to the extension is noted and not handed on. In place of the rate of a primitive, shaders write and
    read a variable with the same code, so the picture shows which primitives have which rate. Fragments stay single.
    """
    needs_feature(stage.device, "pipeline-statistics")
    files = []
    for name, way in (("cell.vert", "out"), ("rings.frag", "in")):
        text = (chapters.folder_of(9) / "studies/shading_rates" / name).read_text("utf-8")
        begin = f"layout(location = 1) flat {way} int rate_code;\nvoid main() {{\n"
        for old, new in (
            ("#extension GL_EXT_fragment_shading_rate : require\n", ""),
            ('"cells.glsl"', '"studies/shading_rates/cells.glsl"'),
            ("void main() {\n", begin + "    rate_code = 0;\n" * (way == "out")),
            ("gl_PrimitiveShadingRateEXT" if way == "out" else "gl_ShadingRateEXT", "rate_code"),
        ):
            assert text.count(old) == 1
            text = text.replace(old, new)
        files.append(tmp_path / name)
        files[-1].write_text(text, "utf-8")
    found = SimpleNamespace(states={}, commands=[])

    def finished(described, info):
        state = OWN_FINISHED(
            described, vk.new("VkGraphicsPipelineCreateInfo", pDynamicState=info.pDynamicState)
        )
        rate = vk.ffi.cast("VkPipelineFragmentShadingRateStateCreateInfoKHR *", state.pNext)
        dynamic = state.pDynamicState
        by_command = DYNAMIC_RATE in dynamic.pDynamicStates[0 : dynamic.dynamicStateCount]
        assert rate.sType == STATE
        size = (rate.fragmentSize.width, rate.fragmentSize.height)
        found.states[described.name] = (size, list(rate.combinerOps), by_command)
        return info

    def command(handle, extent, combiners):
        found.commands.append(((extent.width, extent.height), list(combiners)))

    monkeypatch.setattr(rated.RatedPipelines, "_finished", staticmethod(finished))
    monkeypatch.setattr(vulkan, "check_device", lambda *given: None)
    monkeypatch.setattr(vulkan, "shaders", lambda settings: tuple(str(file) for file in files))
    monkeypatch.setitem(stage.device.fn.__dict__, "vkCmdSetFragmentShadingRateKHR", command)
    return found


@DRAWS
@PRIMITIVES
@only_vulkan
@pytest.mark.parametrize("combiner", ["replace", "keep"])
@pytest.mark.parametrize("source", ["none", "pipeline", "dynamic", "vertex"])
def test_each_source_asks_for_its_rate_where_the_specification_has_it(stage, asked, source, combiner):
    """In the state of the lower pipeline, in the command before the lower draw, or with each second cell."""
    settings = Settings(source=source, rate="4x2", combiner=combiner)
    with stage.open(WHICH, SIZE, settings=settings) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        picture, work, counts = frame.image("color")[..., :3], frame.work, renderer.last_counts
    first = REPLACE if source == "vertex" and combiner == "replace" else KEEP
    lower = (4, 2) if source == "pipeline" else (1, 1)
    by_command = source == "dynamic"
    assert asked.states == {
        "upper": ((1, 1), [first, KEEP], by_command),
        "lower": (lower, [first, KEEP], by_command),
    }
    assert asked.commands == ([((1, 1), [KEEP, KEEP]), ((4, 2), [KEEP, KEEP])] if by_command else [])
    assert (counts == SIDE**2).all(), "without the extension each pixel runs once"
    if stage.device.capabilities.is_software:  # hardware may count what completes a quad, too
        assert work["fragments_upper"] == work["fragments_lower"] == work["fragments"] / 2 == 24 * SIDE**2
    marked = {9: marked_cells("vertex")} if source == "vertex" else {}
    off = np.abs(picture - expected(source, 1, 1, marked))
    assert off.max() <= codes_off(stage.device) + 0.1
    if marked:
        assert np.abs(picture - expected(source, 1, 1)).max() > 50, "the colours of both rates are apart"


class Device:
    """A device that has features, bits and rates at will."""

    def __init__(self, features, bits=(), rates=((2, 2), (2, 1), (1, 2), (1, 1))):
        self.capabilities = SimpleNamespace(why_not={"shading-rate": "the driver lacks it"})
        self.has = features.__contains__
        self.physical = SimpleNamespace(
            handle=vk.NULL, lacks=lambda r: next((b for _, b in r.bits if b not in bits), None)
        )
        self.instance = SimpleNamespace(
            fn=SimpleNamespace(vkGetPhysicalDeviceFragmentShadingRatesKHR=self.tell)
        )
        self.rates = rates

    def tell(self, _, count, out):
        count[0] = len(self.rates)
        if out != vk.NULL:
            for one, (width, height) in zip(out[0 : count[0]], self.rates, strict=True):
                one.fragmentSize.width, one.fragmentSize.height = width, height
                one.sampleCounts = 1 if (width, height) != (4, 4) else 4
        return 0


RATED = {"shading-rate", "pipeline-statistics", "mesh-shader"}
PRIMITIVE, MESH = "primitiveFragmentShadingRate", "primitiveFragmentShadingRateMeshShader"


@DRAWS
@PRIMITIVES
@pytest.mark.parametrize(
    ("device", "settings", "said"),
    [
        (Device(set()), {}, "needs shading-rate, but the driver lacks it."),
        (Device({"shading-rate"}), {}, "needs pipeline-statistics, but the device lacks it."),
        (Device(RATED - {"mesh-shader"}), {"source": "mesh"}, "needs mesh-shader, but the device lacks it."),
        (Device(RATED), {"source": "vertex"}, f"but {PRIMITIVE}; try --set source=dynamic."),
        (Device(RATED, (PRIMITIVE,)), {"source": "mesh"}, f"but {MESH}; try --set source=dynamic."),
        (Device(RATED), {"rate": "4x2"}, "no rate 4x2: it has 1x1, 1x2, 2x1, 2x2."),
        (Device(RATED, rates=((4, 4), (1, 1))), {"rate": "4x4"}, "no rate 4x4: it has 1x1."),
        (Device(RATED), {}, ""),
        (Device(RATED, (PRIMITIVE, MESH)), {"source": "mesh"}, ""),
    ],
)
def test_devices_that_lack_something(device, settings, said):
    if not said:
        rated.check_device(device, (), Settings(**settings))
        return
    with pytest.raises(UnsupportedError) as refused:
        rated.check_device(device, (), Settings(**settings))
    assert str(refused.value).endswith(said)


@DRAWS
@PRIMITIVES
@pytest.mark.parametrize("by_command", [False, True])
@pytest.mark.parametrize("replaced", [False, True])
def test_the_state_of_a_pipeline_has_rate_and_combiners(by_command, replaced):
    states = [vk.VK_DYNAMIC_STATE_VIEWPORT, vk.VK_DYNAMIC_STATE_SCISSOR]
    chained = vk.new("VkPipelineRenderingCreateInfo")
    info = vk.new("VkGraphicsPipelineCreateInfo", pNext=chained, pDynamicState={"pDynamicStates": states})
    described = rated.Rated(("a.vert",), rate=(4, 2), set_by_command=by_command, replaced=replaced)
    finished = rated.RatedPipelines._finished(described, info)
    rate = vk.ffi.cast("VkPipelineFragmentShadingRateStateCreateInfoKHR *", finished.pNext)
    assert rate.sType == vk.VK_STRUCTURE_TYPE_PIPELINE_FRAGMENT_SHADING_RATE_STATE_CREATE_INFO_KHR
    assert (rate.fragmentSize.width, rate.fragmentSize.height) == (4, 2)
    assert list(rate.combinerOps) == [REPLACE if replaced else KEEP, KEEP]
    assert rate.pNext == vk.ffi.cast("void *", chained)
    dynamic = finished.pDynamicState
    more = [vk.VK_DYNAMIC_STATE_FRAGMENT_SHADING_RATE_KHR] * by_command
    assert list(dynamic.pDynamicStates[0 : dynamic.dynamicStateCount]) == states + more


FRAGMENT_SHADING_RATE, PRIMITIVE_RATE, RATE, PER_PRIMITIVE = 4422, 4432, 4444, 5271
"""As SPIR-V numbers them: the capability FragmentShadingRateKHR, the built-ins PrimitiveShadingRateKHR and
ShadingRateKHR, and the decoration PerPrimitiveEXT."""


def capabilities_and_decorations(code):
    """Return the capabilities of a SPIR-V module, and what follows the target in its decorations, by target."""
    words, at, needed, decorations = np.frombuffer(code, np.uint32).tolist(), 5, set(), {}
    while at < len(words):
        length, opcode = words[at] >> 16, words[at] & 0xFFFF
        operands = words[at + 1 : at + length]
        if opcode == 17:  # OpCapability
            needed.add(operands[0])
        if opcode in (
            71,
            72,
        ):  # OpDecorate; OpMemberDecorate, whose target is a structure and the place in it
            target, rest = tuple(operands[: opcode - 70]), tuple(operands[opcode - 70 :])
            decorations.setdefault(target, set()).add(rest)
        at += length
    return needed, list(decorations.values())


@PRIMITIVES
@pytest.mark.parametrize("source", ["none", "pipeline", "dynamic", "vertex", "mesh"])
def test_only_shaders_that_write_rates_ask_for_them(source):
    """The rate that a mesh shader writes is a primitive's and not a vertex's."""
    settings = Settings(source=source)
    sources = [source_of(file, defines(settings)) for file in shaders(settings)]
    codes = compile_stages([sources])[0].codes
    (needed, decorations), (of_fragment, read) = map(capabilities_and_decorations, codes)
    built_in = 11
    assert FRAGMENT_SHADING_RATE in of_fragment and any((built_in, RATE) in of_target for of_target in read)
    assert (FRAGMENT_SHADING_RATE in needed) == (source in ("vertex", "mesh"))
    written = [of_target for of_target in decorations if (built_in, PRIMITIVE_RATE) in of_target]
    assert len(written) == (source in ("vertex", "mesh"))
    assert [(PER_PRIMITIVE,) in of_target for of_target in written] == [source == "mesh"] * len(written)


@DRAWS
def test_rates_in_words_and_cells_of_whole_blocks():
    assert [code_of(Settings(rate=rate)) for rate in RATES] == [0, 1, 4, 5, 6, 9, 10]
    assert names_of([(4, 4), (1, 1), (8, 8), (2, 1)]) == "1x1, 2x1, 4x4"
    assert [side_of(size) for size in ((32, 24), (63, 47), (64, 48), SIZE)] == [4, 4, 8, SIDE]
