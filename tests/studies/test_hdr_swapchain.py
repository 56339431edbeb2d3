"""The study hdr-swapchain: functions against float64 and the standards, the signal of frames, and which surface."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from backends.vulkan import api as vk
from chapters import studies
from chapters.ch11.studies.hdr_swapchain import (
    STOPS,
    STRIPS,
    Settings,
    check,
    decide,
    limits,
    matrices,
)
from chapters.ch11.studies.hdr_swapchain.gamut import REC_709, REC_2020, between, xyz_from_rgb
from chapters.ch11.studies.hdr_swapchain.vulkan_surface import (
    HDR10,
    SCRGB,
    SRGB,
    HdrDisplay,
    Surface,
    choose_surface,
)
from common.errors import SettingError, UnsupportedError
from common.settings import apply_overrides
from tests.support import gl_functions, gpu_functions
from tests.support.bounds import codes_off

WHICH = "11/hdr-swapchain"
FILE = "../chapters/ch11/studies/hdr_swapchain/signal.glsl"
ULP = 2.0**-24
COLORS = np.array([(1, 1, 1), (1, 0.5, 0.15), (1, 0, 0), (0, 1, 0), (0, 0, 1)], np.float64)


def pq(nits):
    """SMPTE ST 2084, equation 5.1 as it is printed, in float64."""
    m1, m2 = 2610 / 16384, 2523 / 4096 * 128
    c1, c2, c3 = 3424 / 4096, 2413 / 4096 * 32, 2392 / 4096 * 32
    power = (np.asarray(nits, np.float64) / 10000) ** m1
    return ((c1 + c2 * power) / (1 + c3 * power)) ** m2


def rolled(nits, knee, peak):
    """The hyperbola through (knee, knee) with slope 1 and limit `peak`, as knee + (peak - knee) t / (1 + t)."""
    above = np.maximum(np.asarray(nits, np.float64) - knee, 0) / (peak - knee)
    return np.where(nits <= knee, nits, knee + (peak - knee) * above / (1 + above))


def evaluate(stage, body, outputs, **inputs):
    where = gpu_functions if stage.backend == "vulkan" else gl_functions
    given = {name: np.asarray(value, np.float32) for name, value in inputs.items()}
    return where.evaluate(stage.device, [FILE], body, given, outputs, defines=dict(matrices()))


# --- PQ ---


def test_codes_of_known_luminances(stage):
    """Of the standard's ends, and of ITU-R BT.2408-5, table 1: 203 nits are 58 %, 1000 are 75 %, 26 are 38 %."""
    nits = np.array([0, 100, 203, 1000, 26, 10000, 20000, -5])
    got = evaluate(stage, "code = pq_from_nits(nits);", {"code": "float"}, nits=nits)["code"]
    assert got[0] == pytest.approx(7.30956e-7, rel=2e-5)  # c1^m2
    assert got[1] == pytest.approx(0.508078421517399, abs=8 * ULP)
    assert np.round(100 * got[2:5]).tolist() == [58, 75, 38]
    assert got[5] == got[6] == 1.0 and got[7] == got[0]


def test_codes_are_those_of_float64(stage):
    """In units of 2^-24, with Vulkan's precision: p = y^m1 is off by 2 (3 + 2 * 5) of itself, and a code by 0.7 of that
    at most, its largest derivative by ln p. The exponent adds 12 times code |ln code|, which is at most 0.37, and exp
    2 (3 + 2 |ln code|) times the code: 27 in all. Measured with lavapipe: 4.8, and 254 for the printed form."""
    nits = np.concatenate([np.geomspace(1e-6, 1e4, 40_000), np.linspace(0, 1e4, 10_001)])
    got = evaluate(stage, "code = pq_from_nits(nits);", {"code": "float"}, nits=nits)["code"]
    assert np.abs(got - pq(nits.astype(np.float32))).max() <= 27 * ULP
    assert (np.diff(got[:40_000]) >= -27 * ULP).all()
    assert np.abs(got - pq(1.0001 * nits)).max() > 100 * ULP, "an error of 1e-4 in luminance would be seen"


def test_the_printed_form_loses_more_digits(stage):
    printed = """
        float p = pow(nits / PQ_PEAK, PQ_M1);
        printed = pow((PQ_C1 + PQ_C2 * p) / (1.0 + PQ_C3 * p), PQ_M2);
        code = pq_from_nits(nits);
    """
    nits = np.geomspace(1e-3, 1e4, 40_000)
    got = evaluate(stage, printed, {"printed": "float", "code": "float"}, nits=nits)
    off = {name: np.abs(values - pq(nits.astype(np.float32))).max() for name, values in got.items()}
    assert off["printed"] > 4 * off["code"]


def test_codes_lead_back_to_luminance(stage):
    """Codes of 10 bits: a relative error far below their step, which is at least 0.8 % of the luminance above 1 nit."""
    codes = np.arange(1, 1024) / 1023
    got = evaluate(stage, "nits = nits_from_pq(code);", {"nits": "float"}, code=codes)["nits"]
    wanted = np.interp(codes, pq(np.geomspace(1e-7, 1e4, 400_001)), np.geomspace(1e-7, 1e4, 400_001))
    bright = wanted > 0.01
    assert np.abs(got[bright] / wanted[bright] - 1).max() < 5e-4
    assert np.abs(got[~bright] - wanted[~bright]).max() < 1e-5 and bright.sum() > 900


# --- gamut, scale, range ---


def test_the_matrices_follow_from_the_primaries():
    """ITU-R BT.2087-0 prints four digits of the matrix; BT.709 and BT.2020 print those of luminance."""
    matrix = between(REC_709, REC_2020)
    printed = [[0.6274, 0.3293, 0.0433], [0.0691, 0.9195, 0.0114], [0.0164, 0.0880, 0.8956]]
    assert np.abs(matrix - printed).max() <= 6e-5
    assert np.abs(xyz_from_rgb(REC_709)[1] - (0.2126, 0.7152, 0.0722)).max() <= 5e-5
    assert np.abs(xyz_from_rgb(REC_2020)[1] - (0.2627, 0.6780, 0.0593)).max() <= 5e-5
    assert np.abs(matrix.sum(axis=1) - 1).max() < 1e-14, "white stays white"
    assert (matrix > 0).all(), "no colour of Rec. 709 lies outside of Rec. 2020"
    assert np.abs(between(REC_2020, REC_709) @ matrix - np.eye(3)).max() < 1e-14
    for gamut in (REC_709, REC_2020):
        for column, place in zip(xyz_from_rgb(gamut).T, gamut, strict=False):
            assert column[:2] / column.sum() == pytest.approx(place, abs=1e-14)


def test_the_shader_has_the_matrices(stage):
    """Three products and two sums, and elements rounded once: each of 2^-24 of the sum of sizes."""
    light = np.random.default_rng(3).uniform(-2, 1000, (2000, 3)).astype(np.float32)
    body = "there = rec2020_from_rec709(light); back = rec709_from_rec2020(light);"
    got = evaluate(stage, body, {"there": "vec3", "back": "vec3"}, light=light)
    for name, matrix in (("there", between(REC_709, REC_2020)), ("back", between(REC_2020, REC_709))):
        off = np.abs(got[name] - light.astype(np.float64) @ matrix.T)
        assert (off <= 4 * ULP * (np.abs(light) @ np.abs(matrix).T)).all()
    wrong = light.astype(np.float64) @ between(REC_709, REC_2020)
    assert np.abs(got["there"] - wrong).max() > 1, "the transposed matrix"


def test_a_unit_of_scrgb_is_80_nits(stage):
    nits = np.array([[80.0, 0.0, 203.0], [10000.0, 40.0, 8.0]])
    got = evaluate(stage, "signal = scrgb_from_nits(nits);", {"signal": "vec3"}, nits=nits)["signal"]
    np.testing.assert_allclose(got, [[1, 0, 2.5375], [125, 0.5, 0.1]], rtol=3 * ULP)


@pytest.mark.parametrize(("knee", "peak"), [(500.0, 1000.0), (0.0, 203.0), (990.0, 1000.0), (1.0, 10000.0)])
def test_the_roll_off_keeps_what_is_below_the_knee_and_ends_at_the_peak(stage, knee, peak):
    nits = np.concatenate([np.linspace(0, 3 * peak, 6001), np.geomspace(3 * peak, 3e38, 2000), [np.inf]])
    nits = nits.astype(np.float32)
    given = {"nits": nits, "knee": np.full_like(nits, knee), "peak": np.full_like(nits, peak)}
    got = evaluate(stage, "shown = roll_off(nits, knee, peak);", {"shown": "float"}, **given)["shown"]
    below = nits <= knee
    assert (got[below] == nits[below]).all()
    with np.errstate(invalid="ignore"):
        wanted = rolled(nits.astype(np.float64), knee, peak)
    # A sum, a quotient, a product and a difference, each off by 2^-24 of the peak at most; a quotient by 2.5 of that.
    assert np.abs(got[:-1] - wanted[:-1]).max() <= 8 * ULP * peak
    assert (np.diff(got) >= -4 * ULP * peak).all() and got.max() == got[-1] == np.float32(peak)
    assert (got[nits < 3 * peak] < peak).all(), "it reaches the peak in the limit only"
    step = peak / 1000
    at = np.array([knee, knee + step], np.float32)
    slope = (
        np.diff(
            evaluate(
                stage,
                "shown = roll_off(nits, knee, peak);",
                {"shown": "float"},
                nits=at,
                knee=np.full(2, knee),
                peak=np.full(2, peak),
            )["shown"]
        )[0]
        / step
    )
    assert slope == pytest.approx((peak - knee) / (peak - knee + step), rel=1e-3)


def test_hues_stay_and_bad_light_is_black(stage):
    light = np.array(
        [[8, 4, 2], [1, 0.5, 0], [np.nan, 1, 0], [-3, 1, -0.5], [np.inf, 1, 0], [0, 0, 0]], np.float32
    )
    body = "nits = displayed_nits(light, 200.0, 500.0, 1000.0); dark = displayed_nits(light, 200.0, 0.0, 1000.0);"
    got = evaluate(stage, body, {"nits": "vec3", "dark": "vec3"}, light=light)
    nits = got["nits"]
    assert nits[0] == pytest.approx(rolled(1600, 500, 1000) * np.array([1, 0.5, 0.25]), rel=1e-6)
    assert nits[1].tolist() == [200, 100, 0] and nits[2].tolist() == [0, 200, 0]
    assert nits[3].tolist() == [0, 200, 0] and nits[5].tolist() == [0, 0, 0]
    assert nits[4, 0] == pytest.approx(1000, rel=1e-4) and 0 < nits[4, 1] < 1
    assert got["dark"][5].tolist() == [0, 0, 0]


# --- frames ---


def scene(width):
    """Return the light of the strips, (STRIPS, width, 3) float64."""
    stops = -STOPS + 2 * STOPS * (np.arange(width) + 0.5) / width
    return COLORS[:, None] * 2.0 ** stops[:, None]


def nits_of(settings, encoding, light):
    """Return the luminance of each channel that a display is to show, from scene light."""
    nits = light * settings.paper_white
    largest = nits.max(axis=-1, keepdims=True)
    return nits * rolled(largest, *limits(settings, encoding)) / largest


def srgb(share):
    """IEC 61966-2-1."""
    share = np.minimum(share, 1)
    return np.where(share <= 0.0031308, 12.92 * share, 1.055 * share ** (1 / 2.4) - 0.055)


def signal(settings, encoding, nits):
    """Return the signal of luminances in float64, from the standards."""
    if encoding == "hdr10":
        return pq(nits @ between(REC_709, REC_2020).T)
    return nits / 80 if encoding == "scrgb" else srgb(nits / settings.paper_white)


@pytest.mark.parametrize("encoding", ["hdr10", "scrgb", "srgb"])
@pytest.mark.parametrize("knobs", [{}, {"paper_white": 100.0, "peak": 4000.0, "knee": 0.1}])
def test_the_encoded_image_is_the_signal(stage, encoding, knobs):
    settings, size = Settings(encoding=encoding, **knobs), (64, 40)
    with stage.open(WHICH, size, settings=settings, outputs=("color", "encoded")) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        got, work = frame.image("encoded"), frame.work
    assert (renderer.encoding, work["draws"]) == (encoding, 3)
    middle = (2 * np.arange(STRIPS) + 1) * size[1] // (2 * STRIPS)
    got = got[middle][..., :3].astype(np.float64) / (255 if encoding == "srgb" else 1)
    # Each channel of light is one of the two halves beside it, up to 2^-10 off, and so is the largest of them. The
    # signal is rounded to its own format.
    nits = nits_of(settings, encoding, scene(size[0]))
    low, high = (signal(settings, encoding, nits * factor) for factor in (1 - 2**-9, 1 + 2**-9))
    step = {
        "hdr10": 0.51 / 1023,
        "scrgb": 2.0**-10 * high + 2.0**-24,
        "srgb": (codes_off(stage.device) + 0.01) / 255,
    }
    assert (got >= low - step[encoding]).all() and (got <= high + step[encoding]).all()
    assert got[0, -1] == pytest.approx(got[0, -1, 0]) and len(np.unique(got[0, :, 0])) > 40


@pytest.mark.parametrize("encoding", ["hdr10", "scrgb", "srgb"])
def test_the_picture_shows_the_signal_four_times(stage, encoding):
    settings, size = Settings(encoding=encoding), (64, 80)
    with stage.open(WHICH, size, settings=settings, outputs=("color", "encoded")) as renderer:
        frame = renderer.render(chapters.view_of(renderer))
        picture, encoded = frame.image("color").astype(float), frame.image("encoded")
    rows = (2 * np.arange(STRIPS) + 1) * size[1] // (2 * STRIPS)
    seen = 255 * srgb(nits_of(settings, encoding, scene(64)) / settings.paper_white)
    codes = np.clip(encoded[rows][..., :3].astype(float) * (1 if encoding == "srgb" else 255), 0, 255)
    for strip in range(STRIPS):
        # 10 bits of PQ are coarser than 8 of sRGB nowhere but where a strong channel leaves residues in weak ones.
        strong = COLORS[strip] > 0
        assert np.abs(picture[4 * strip + 3][:, strong] - seen[strip][:, strong]).max() <= 3
        assert np.abs(picture[20 + 4 * strip + 3, :] - codes[strip]).max() <= codes_off(stage.device) + 0.01
    # False colours of white: seven colours from 0.1 nits to 10,000.
    nits = nits_of(settings, encoding, scene(64))[0, :, 0]
    ramp = np.array([(0, 0, 0), (0, 0, 1), (0, 1, 1), (0, 1, 0), (1, 1, 0), (1, 0, 0), (1, 1, 1)]).T * 255
    heat = [np.interp((np.log10(nits) + 1) * 6 / 5, np.arange(7), channel) for channel in ramp]
    # 8-bit sRGB is coarse in the dark: half a code of 13 is 4 % of the light, which is 5 codes here.
    assert np.abs(picture[43] - np.stack(heat, axis=-1)).max() <= (6 if encoding == "srgb" else 3)
    # The curve rises to the peak, and the orange line leaves it behind the knee.
    curve = picture[60:]
    blue = [int(np.argmin(np.abs(curve[:, x] - (115, 191, 255)).sum(axis=1))) for x in range(64)]
    assert (np.diff(blue) <= 0).all() and blue[0] > blue[-1]
    filled = curve[-1, :, 2] > 60
    assert filled.all() and (curve[: blue[-1], -1, 2] < 20).any(), "filled below, and dark above"
    assert abs(20 * (1 - pq(limits(settings, encoding)[1])) - blue[-1]) <= 2


@pytest.mark.parametrize("encoding", ["hdr10", "scrgb", "srgb"])
def test_another_size_is_encoded_anew_and_nothing_is_left(stage, encoding):
    with stage.open(WHICH, (8, 8)):  # what the device itself keeps is made by the first one
        pass
    before = dict(stage.device.alive)
    more = {"settings": Settings(encoding=encoding), "outputs": ("color", "encoded")}
    with stage.open(WHICH, (64, 80), **more) as renderer:
        view = chapters.view_of(renderer)
        first, again = (renderer.render(view).image("encoded") for _ in range(2))
        assert np.array_equal(first, again) and renderer.idle(view, 1.0)
        for size in ((33, 17), (1, 1)):
            renderer.resize(size)
            frame = renderer.render(view)
            assert frame.image("encoded").shape[:2] == frame.image("color").shape[:2] == size[::-1]
        renderer.resize((64, 80))
        assert np.array_equal(renderer.render(view).image("encoded"), first)
    assert stage.device.alive == before


# --- surfaces ---

BGRA = (vk.VK_FORMAT_B8G8R8A8_UNORM, SRGB)
TEN = (vk.VK_FORMAT_A2B10G10R10_UNORM_PACK32, HDR10)
TEN_TURNED = (vk.VK_FORMAT_A2R10G10B10_UNORM_PACK32, HDR10)
HALF = (vk.VK_FORMAT_R16G16B16A16_SFLOAT, SCRGB)
TEN_SRGB = (vk.VK_FORMAT_A2B10G10R10_UNORM_PACK32, SRGB)
HALF_PQ = (vk.VK_FORMAT_R16G16B16A16_SFLOAT, HDR10)
SRGB_AGAIN = (vk.VK_FORMAT_B8G8R8A8_SRGB, SRGB)


@pytest.mark.parametrize(
    ("offered", "pair", "encoding", "said"),
    [
        ([BGRA, HALF, TEN], TEN, "hdr10", "offers HDR10: the last pass writes PQ codes"),
        ([TEN_TURNED, BGRA, TEN], TEN, "hdr10", "offers HDR10"),
        ([BGRA, TEN_TURNED, HALF], TEN_TURNED, "hdr10", "offers HDR10"),
        ([BGRA, HALF], HALF, "scrgb", "not HDR10 but scRGB: the last pass writes linear light"),
        ([TEN_SRGB, SRGB_AGAIN, BGRA], BGRA, "srgb", "neither HDR10 nor scRGB among its 3 pairs"),
        ([HALF_PQ, BGRA], BGRA, "srgb", "neither HDR10 nor scRGB among its 2 pairs"),
    ],
)
def test_the_best_pair_of_a_surface_is_chosen(offered, pair, encoding, said):
    surface = choose_surface(offered)
    assert ((surface.format, surface.space), surface.encoding) == (pair, encoding)
    assert said in surface.sentence and surface.sentence.endswith(".") and "\n" not in surface.sentence


def test_without_the_extension_the_other_spaces_are_not_asked_for():
    surface = choose_surface([TEN, HALF, BGRA], extended=False)
    assert surface.encoding == "srgb" and "VK_EXT_swapchain_colorspace" in surface.sentence
    display = HdrDisplay()
    assert display.device_extensions == ("VK_EXT_hdr_metadata",)
    assert display.choose([TEN, BGRA], frozenset()) == BGRA
    assert display.choose([TEN, BGRA], frozenset({"VK_EXT_swapchain_colorspace"})) == TEN
    assert display.surface.encoding == "hdr10"


def test_a_surface_without_any_of_them_is_refused():
    with pytest.raises(UnsupportedError, match="no plain 8-bit colour format: run with --headless"):
        choose_surface([SRGB_AGAIN, TEN_SRGB])


def test_the_setting_and_the_surface_decide_together():
    assert [decide("auto", surface) for surface in (None, "hdr10", "scrgb", "srgb")] == [
        *("hdr10", "hdr10", "scrgb", "srgb")
    ]
    assert decide("scrgb", None) == decide("scrgb", "srgb") == decide("scrgb", "scrgb") == "scrgb"
    with pytest.raises(
        UnsupportedError, match="takes HDR10, not 8-bit sRGB: leave encoding at auto"
    ) as refused:
        decide("srgb", "hdr10")
    assert "\n" not in str(refused.value)


def surface_of(encoding, pair):
    return Surface(encoding, *pair, "a sentence.")


@pytest.mark.parametrize(("encoding", "pair"), [("hdr10", TEN), ("scrgb", HALF), ("srgb", BGRA)])
def test_a_window_gets_the_encoded_image_and_its_display_the_peak(vulkan_device, encoding, pair):
    """Software drivers have no such surface: a surface is put on the device by hand."""
    display = vulkan_device.display = HdrDisplay()
    display.surface = surface_of(encoding, pair)
    try:
        more = {"scene": studies.load(WHICH, None), "size": (16, 10), "device": vulkan_device}
        with chapters.open(WHICH, "vulkan", settings=Settings(peak=600.0), presents=True, **more) as renderer:
            renderer.render(chapters.view_of(renderer))
            assert renderer.encoding == encoding and display.source(renderer) is renderer.encoded
            eight_bits = renderer.encoded if encoding == "srgb" else renderer.picture
            assert renderer.present_source is eight_bits
            assert renderer.scene.warnings == ["a sentence."]
            told = display.mastering(renderer)
        if encoding == "srgb":
            assert told is None
            return
        info = told.info()
        assert (info.maxLuminance, info.minLuminance, info.maxContentLightLevel) == (600, 0, 600)
        assert info.displayPrimaryGreen.y == pytest.approx(0.6) and info.whitePoint.x == pytest.approx(0.3127)
        assert info.displayPrimaryRed.x == pytest.approx(0.64) and info.displayPrimaryBlue.y == pytest.approx(
            0.06
        )
        with pytest.raises(UnsupportedError, match="leave encoding at auto"):
            chapters.open(WHICH, "vulkan", settings=Settings(encoding="srgb"), presents=True, **more)
    finally:
        vulkan_device.display = None


# --- bad numbers ---


@pytest.mark.parametrize(
    "asked",
    [f"{name}={value}" for name in ("peak", "paper_white") for value in ("0", "-5", "nan", "inf", "10001")],
)
def test_numbers_out_of_range_are_refused_in_one_sentence(asked):
    with pytest.raises(SettingError, match=asked.split("=")[0]) as found:
        apply_overrides(Settings(), [asked])
    assert "\n" not in str(found.value)
    name, value = asked.split("=")
    with pytest.raises(SettingError, match=f"{name}=.* is out of range: give 1 to 10000") as found:
        check(Settings(**{name: float(value)}))
    assert "\n" not in str(found.value)


@pytest.mark.parametrize(
    "knobs", [{"peak": 202.0}, {"paper_white": 1001.0}, {"knee": float("nan")}, {"knee": 1.0}]
)
def test_a_peak_below_paper_white_is_refused_in_one_sentence(stage, knobs):
    said = "below paper_white=.*; raise peak or lower" if "knee" not in knobs else "knee=.* is out of range"
    with pytest.raises(SettingError, match=said) as found:
        stage.open(WHICH, (8, 8), settings=Settings(**knobs))
    assert "\n" not in str(found.value)
