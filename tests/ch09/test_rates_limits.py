"""Shading rates at the ends of what can be asked for, far from the origin, and of light that is no number."""

from __future__ import annotations

import numpy as np
import pytest

from chapters.ch09.settings import Settings
from common.errors import SettingError
from common.numerics.transforms import pose_looking_at
from common.scene import Light, Material
from common.settings import apply_overrides, replaced
from common.view.camera import Perspective, View
from tests.support.scenes import facing, moved, quad_scene, scaled
from tests.support.shadows import PLAIN, point, spot, yard

pytestmark = pytest.mark.variants("vulkan", "gl", long=("gl",))

SIZE = (83, 53)
VIEW = View(pose_looking_at((3.0, 2.5, 4.0), (0.0, 0.4, 0.0)), Perspective(0.9, 0.05))
BASE = Settings(**PLAIN, graph="compute", shadows="off", rate_policy="sobel", rate_texel=16)
MASK = "rate_mask/rates"


def drawn(chapter, scene, view=VIEW, size=SIZE, frames=3, **turned):
    """Return the light of the last of some frames, its mask, and the pixels along a texel of that.

    All light is finite, and the same calls repeat it.
    """
    knobs = replaced(BASE, **turned)
    with chapter.open(scene, size, knobs, outputs=("color", "color_linear"), inspect=True) as renderer:
        runs = []
        for _ in range(2):
            for _ in range(frames):
                frame = renderer.render(view)
            runs.append([frame.image(name) for name in ("color_linear", "color", MASK)])
            renderer.reset_history("again")
        (texel,) = (it.texel[0] for node in renderer.nodes for it in node.writes if it.resource == "rates")
    assert all(np.isfinite(light).all() for light, *_ in runs)
    assert all(np.array_equal(one, other) for one, other in zip(*runs, strict=True))
    light, _, mask = runs[0]
    return light, mask.reshape(mask.shape[:2]).astype(int), texel


@pytest.fixture(scope="module")
def scene():
    return yard(spot((1.5, 4.0, 1.0), (0.0, 0.5, 0.0)), point((-1.2, 3.0, 0.8)))


# --- what is asked for ------------------------------------------------------------------------------------------------


@pytest.mark.feature("vrs/sobel-mask", "vrs/rate-policies")
@pytest.mark.runs_on("vulkan", "gl")
@pytest.mark.parametrize(
    ("name", "values", "range_"),
    [
        ("rate_threshold", ("-0.1", "32.1", "nan", "inf"), "must be 0 to 32, not '{}'"),
        ("rate_surface", ("-1", "1.01", "nan"), "must be 0 to 1, not '{}'"),
        ("rate_radius", ("-0.01", "5", "-inf"), "must be 0 to 4, not '{}'"),
        ("rate_threshold", ("", "high"), "must be a number, not '{}'"),
        ("rate_coarse", ("1x1", "8x8", "16"), "must be one of 2x2, 4x4, not '{}'"),
        ("rate_policy", ("edges", ""), "must be one of none, sobel, radial, not '{}'"),
        ("rate_fragments", ("both",), "must be one of auto, device, passes, not '{}'"),
    ],
)
def test_values_out_of_range_are_one_sentence(name, values, range_):
    for value in values:
        with pytest.raises(SettingError) as refused:
            apply_overrides(Settings(), [f"{name}={value}"])
        said = str(refused.value)
        assert said == f"setting {name} {range_.format(value)}" and "\n" not in said


@pytest.mark.feature("vrs/sobel-mask")
@pytest.mark.parametrize("ends", [{"rate_threshold": 0.0}, {"rate_threshold": 32.0, "rate_surface": 1.0}])
def test_thresholds_at_both_ends(chapter, scene, ends):
    """At 0 a texel stays coarse only if its luminance is constant; at 32 no gradient of codes from 0 to 1 is above it.

    Sobel's weights add up to 4 on either side, so a component is at most 4 and the squared gradient at most 32.
    """
    light, mask, texel = drawn(chapter, scene, rate_coarse="4x4", **ends)
    assert (mask == 10).any() and (mask == 0).any()
    if ends["rate_threshold"] == 0:
        for row, column in np.argwhere(mask == 10):
            part = np.s_[row * texel : (row + 1) * texel, column * texel : (column + 1) * texel]
            assert np.ptp(light[part][..., :3], axis=(0, 1)).max() == 0
    else:
        assert (mask == 10).mean() > 0.5


@pytest.mark.feature("vrs/texel-size-reduction", "vrs/software")
@pytest.mark.parametrize("graph", ["compute", "deferred"])
@pytest.mark.parametrize("size", [(1, 1), (2, 1), (3, 70), (129, 1)])
def test_pictures_smaller_than_a_texel_or_a_block(chapter, scene, size, graph):
    """Each block is lit at a pixel that exists."""
    knobs = {"graph": graph, "rate_fragments": "passes", "rate_coarse": "4x4", "rate_policy": "radial"}
    full, *_ = drawn(chapter, scene, size=size, frames=1, rate_radius=4.0, **knobs)
    light, mask, texel = drawn(chapter, scene, size=size, frames=1, rate_radius=0.0, **knobs)
    y, x = np.indices(light.shape[:2])
    coarse = mask[y // texel, x // texel] == 10
    rows, columns = (
        np.where(coarse, np.minimum(at // 4 * 4 + 2, most - 1), at)
        for at, most in ((y, size[1]), (x, size[0]))
    )
    assert np.abs(light - full[rows, columns]).max() <= 1e-6 * full.max() and full.max() > 0


# --- the world --------------------------------------------------------------------------------------------------------


@pytest.mark.feature("vrs/sobel-mask", "vrs/software")
@pytest.mark.parametrize("case", ["1e5 m away", "a thousandth", "a thousand times"])
def test_place_and_scale_leave_the_mask(chapter, scene, case):
    """The picture differs by what float32 rounds; a texel with a gradient next to the threshold may change."""
    light, mask, _ = drawn(chapter, scene)
    assert 0.2 < (mask == 0).mean() < 0.9
    if case == "1e5 m away":
        other, looking = moved(scene, VIEW, (1e5, -1e5, 1e5))
    else:
        other, looking = scaled(scene, VIEW, 1e-3 if case == "a thousandth" else 1e3)
    there, found, _ = drawn(chapter, other, looking)
    assert (found != mask).mean() <= 1 / mask.size
    assert np.mean(np.abs(there - light) > 1e-3 * light.max()) < 0.01


@pytest.mark.feature("vrs/sobel-mask")
@pytest.mark.parametrize("lux", [0.0, 1e-30, 1e30])
def test_light_without_bounds_gives_a_mask_and_a_picture(chapter, lux):
    """Black has no edges, and light beyond the largest half float is clamped to it: white has none, either."""
    square = quad_scene(
        Material(roughness=1.0, metallic=0.0), lights=(Light("directional", 0, intensity=lux),)
    )
    _, mask, _ = drawn(chapter, square, facing(), size=(64, 64), frames=5)
    assert (mask == 5).any()


@pytest.mark.feature("vrs/sobel-mask")
def test_memory_of_any_content_is_read_by_none(chapter, scene):
    """What the first frame finds in a history is not used; nor is what aliased memory held."""
    light, mask, _ = drawn(chapter, scene)
    for turned in ({"poison": "depth 0"}, {"poison": "depth 1"}, {"alias": False}):
        there, found, _ = drawn(chapter, scene, **turned)
        assert np.array_equal(there, light) and np.array_equal(found, mask)


@pytest.mark.feature("vrs/sobel-mask")
def test_a_history_is_forgotten_with_the_picture_that_it_is_of(chapter, scene):
    """After a cut or another size the first mask lights each pixel; without, most texels keep their rate."""
    with chapter.open(
        scene, SIZE, replaced(BASE, rate_threshold=2.0), outputs=("color",), inspect=True
    ) as it:

        def fine():
            return float((it.render(VIEW).image(MASK) == 0).mean())

        assert fine() == 1.0 and fine() < 1.0
        it.reset_history("a cut")
        assert fine() == 1.0 and fine() < 1.0
        it.resize((64, 48))
        assert fine() == 1.0 and fine() < 1.0
