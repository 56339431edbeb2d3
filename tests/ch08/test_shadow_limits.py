"""Shadows at the ends of what can be asked for: pools of a page, thousands of lights, numbers that are none."""

from __future__ import annotations

import math
import warnings

import numpy as np
import pytest

from backends.vulkan import api as vk
from chapters.ch08.page_table.refusal import with_less
from chapters.ch08.settings import Settings
from common.errors import DeviceError, SettingError
from common.numerics.transforms import pose_looking_at
from common.scene import Light
from common.settings import apply_overrides, replaced
from common.view.camera import Orthographic, View
from tests.support.scenes import translated
from tests.support.shadows import PLAIN, faces_of, lit_taps, point, spot, sun, yard

pytestmark = pytest.mark.variants("vulkan", "gl", long=("gl",))

SIZE = (32, 32)
ABOVE = View(pose_looking_at((0, 6, 0), (0, 0, 0), (0, 0, -1)), Orthographic(3.0, 0.1, 20.0))
BASE = Settings(
    **PLAIN,
    graph="forward",
    shadow_size=128,
    shadow_sun_size=256,
    shadow_cascades=1,
    shadow_kernel=1,
)
PAGE = 1 / 16
SPOT = ((1.5, 4.0, 1.0), (0.0, 0.5, 0.0), math.radians(55))


def drawn(chapter, scene, looking=ABOVE, **turned):
    """Return a picture, the work of its frame and the records of faces; shadows warn of nothing, and all is finite."""
    settings = replaced(BASE, **turned)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")  # the scene's records warn of what is beyond float32
        warnings.filterwarnings("error", module=r"chapters\.ch08\.(shadows|page_table)")
        with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
            frame = renderer.render(looking)
            picture = frame.image("color_linear").astype(np.float64)
            again = renderer.render(looking).image("color_linear")
            memory = renderer.techniques["shadows"].memory
            faces = None if memory is None else faces_of(renderer) if frame.work["shadow_faces"] else ()
            work = dict(frame.work)
    assert np.isfinite(picture).all() and np.array_equal(picture, again)
    assert faces is None or all(
        np.isfinite(faces[name]).all() for name in ("origin", "far", "scale_x") if len(faces)
    )
    return picture, work, faces


def but_for(first, *others):
    """Return parameters of which all but the first run with --long alone."""
    return [first, *(pytest.param(other, marks=pytest.mark.long) for other in others)]


def factors(chapter, scene, **turned):
    return drawn(chapter, scene, view="shadow-factor", **turned)[0][..., 0]


# --- the pool ---


@pytest.mark.feature("sparse/page-pool")
def test_a_pool_of_one_page_serves_one_light(chapter):
    """A spot has one face of a page, and a point light all six in a page; what has none is counted and lights."""
    alone = yard(spot(*SPOT))
    picture, work, _ = drawn(chapter, alone, shadow_pool=PAGE)
    assert work["shadow_pages"] == 1 and work["shadow_bytes"] == 64 << 10
    assert work["shadow_lights"] == 1 and work["shadow_lights_lowered"] == 0
    full = drawn(chapter, alone, shadow_memory="full")[0]
    assert np.array_equal(picture, full)
    lamp = factors(chapter, yard(point((0.0, 3.0, 0.0))), shadow_pool=PAGE)
    assert 0.02 < (lit_taps(lamp, 1, chapter.device) == 0).mean() < 0.2  # the cube's, 40 texels a face
    crowd = yard(sun((0.3, -1.0, 0.2)), spot(*SPOT), point((0.0, 3.0, 0.0)))
    _, work, faces = drawn(chapter, crowd, shadow_pool=PAGE)
    assert work["shadow_pages"] <= 1 and work["shadow_lights"] == 1 and work["shadow_lights_left_out"] == 2
    assert work["shadow_bytes"] == 64 << 10 and len({*faces["light"].tolist()} - {0xFFFFFFFF}) == 1


def test_pools_without_a_page_are_refused():
    for wrong in ("0", "0.06", "-1", "1025", "nan", "inf", "a page"):
        with pytest.raises(SettingError, match="shadow_pool"):
            apply_overrides(Settings(), [f"shadow_pool={wrong}"])


# --- lights ---


@pytest.mark.parametrize("kind", ["spot", "point"])
def test_ranges_without_an_end_are_those_of_the_scene(chapter, kind):
    def light(reach):
        return spot(*SPOT, reach=reach) if kind == "spot" else point((0.2, 3.0, 0.1), reach=reach)

    endless, far = (factors(chapter, yard(light(reach))) for reach in (math.inf, 1e6))
    assert np.array_equal(endless, far) and 0.02 < (endless == 0).mean() < 0.9


@pytest.mark.parametrize("reach", [0.0, -1.0, 1e-30, math.nan])
def test_lights_that_reach_nothing_have_no_map(chapter, reach):
    picture, work, _ = drawn(chapter, yard(point((0.0, 3.0, 0.0), reach=reach), spot(*SPOT)))
    alone, *_ = drawn(chapter, yard(spot(*SPOT)))
    assert np.allclose(picture, alone, rtol=1e-5, atol=1e-6) and alone.max() > 0
    assert work["shadow_lights"] == 1 and work["shadow_faces"] == 1


def test_near_planes_behind_the_range_leave_the_light(chapter):
    """Nothing within the range can cast a shadow, so there is none: the light is what it is without shadows."""
    scene = yard(point((0.0, 3.0, 0.0), reach=4.5))
    assert scene.length_scale > 4.5
    picture, work, _ = drawn(chapter, scene, shadow_near=1.0)
    assert work["shadow_lights"] == 0 and work["shadow_lights_left_out"] == 1
    bare, *_ = drawn(chapter, scene, shadows="off")
    assert np.array_equal(picture, bare) and bare.max() > 0
    assert not np.array_equal(picture, drawn(chapter, scene)[0])


@pytest.mark.feature("sparse/page-pool")
@pytest.mark.long
@pytest.mark.parametrize(("side", "most"), [(8, 16), (64, 256)])
def test_of_many_lights_the_chosen_ones_have_maps_and_the_others_light(chapter, side, most):
    places = np.linspace(-3.5, 3.5, side)
    near = {
        (x, z): max(abs(x), abs(z)) < 0.7 for x in places for z in places
    }  # the brightest: around the cube
    scene = yard(
        *(point((float(x), 1.8, float(z)), 0.06 if one else 0.05, 2.5) for (x, z), one in near.items())
    )
    picture, work, _ = drawn(chapter, scene, shadow_pool=4.0, shadow_lights=most)
    assert work["shadow_lights"] + work["shadow_lights_left_out"] == side**2
    assert 0 < work["shadow_lights"] <= min(most, 64) and work["shadow_pages"] <= 64  # a page each at least
    assert work["shadow_bytes"] <= 4 << 20
    bare, *_ = drawn(chapter, scene, shadows="off")
    # Shadows of some can only take light.
    assert (picture <= bare * (1 + 1e-4)).all() and 0 < picture.sum() < bare.sum()


BROKEN = {
    "a place that is no number": (math.nan, 2.0, 0.0),
    "an endless place": (0.0, math.inf, 0.0),
    "a place beyond float32": (1e300, 0.0, 0.0),
}


@pytest.mark.parametrize("kind", ["directional", "spot", "point"])
@pytest.mark.parametrize("place", but_for(*BROKEN))
def test_lights_that_are_nowhere_harm_no_other_shadow(chapter, kind, place):
    light = Light(kind, 0, intensity=50.0, inner_cone=0.3, outer_cone=0.6)
    scene = yard((light, translated(*BROKEN[place])), spot(*SPOT), point((-1.2, 3.0, 0.8)))
    wanted, *_ = drawn(chapter, yard(spot(*SPOT), point((-1.2, 3.0, 0.8))))
    picture, work, _ = drawn(chapter, scene)
    # A sun has no place; it shines along -z, past the ground and the top of the cube.
    assert np.allclose(picture, wanted, rtol=1e-4, atol=1e-5) and work["shadow_lights"] >= 2


@pytest.mark.parametrize("axis", but_for("zero", "nan", "inf"))
@pytest.mark.parametrize("kind", ["directional", "spot"])
def test_lights_without_a_direction_harm_no_other_shadow(chapter, kind, axis):
    pose = translated(0.0, 3.0, 0.0)
    pose[:3, :3] = {"zero": 0.0, "nan": math.nan, "inf": math.inf}[axis]
    light = Light(kind, 0, intensity=0.5, inner_cone=0.3, outer_cone=0.6)
    picture, work, _ = drawn(chapter, yard((light, pose), point((-1.2, 3.0, 0.8))))
    alone, *_ = drawn(chapter, yard(point((-1.2, 3.0, 0.8))))
    assert work["shadow_lights"] >= 1
    assert (picture >= alone * (1 - 1e-4) - 1e-5).all()
    assert axis == "zero" or np.allclose(picture, alone, rtol=1e-4, atol=1e-5)


@pytest.mark.parametrize("kind", ["sun", "spot", "point"])
@pytest.mark.parametrize("place", but_for(*BROKEN))
def test_casters_that_are_nowhere_leave_the_shadows_of_others(chapter, kind, place):
    """One square of the cube is elsewhere: with another one in its place nothing changes but that it casts none."""
    light = {
        "sun": lambda: sun((0.3, -1.0, 0.2)),
        "spot": lambda: spot(*SPOT),
        "point": lambda: point((0.2, 3, 0)),
    }
    lost = yard(light[kind](), extra=(translated(*BROKEN[place]),))
    lost.bounds, lost.origin = yard(light[kind]()).bounds, yard(light[kind]()).origin
    wanted, found = factors(chapter, yard(light[kind]())), factors(chapter, lost)
    assert 0.01 < (wanted == 0).mean() < 0.9
    assert (found != wanted).mean() < 0.02  # the fit of a sun to the scene may have moved by a texel


# --- memory that is refused ---


def refusing(monkeypatch, chapter, most):
    """Let the device have no memory for an image of pages of more than `most` bytes; return the sizes asked for."""
    from chapters.ch08.frames import vulkan_resources
    from chapters.ch08.page_table import gl as gl_memory

    asked = []

    def refuse(create, place):
        def created(*arguments, **options):
            size = arguments[place]
            if "shadow pages" in arguments:
                asked.append(4 * size[0] * size[1])
                if asked[-1] > most:
                    if chapter.backend == "gl":
                        raise DeviceError("glTextureStorage2D() failed with GL_OUT_OF_MEMORY: none is left.")
                    raise vk.VulkanError("vkAllocateMemory", vk.VK_ERROR_OUT_OF_DEVICE_MEMORY, ())
            return create(*arguments, **options)

        return created

    for module in (vulkan_resources, gl_memory):
        monkeypatch.setattr(module, "create_image", refuse(module.create_image, 2))
    return asked


@pytest.mark.feature("sparse/page-pool")
def test_refused_memory_halves_the_pool_and_one_sentence_says_so(chapter, monkeypatch):
    lights = [point((x, 3.0, z)) for x in (-2.0, 0.0, 2.0) for z in (-2.0, 2.0)]
    scene = yard(*lights)
    turned = {"shadow_memory": "full", "shadow_size": 256, "shadow_pool": 16}
    _, work, _ = drawn(chapter, scene, **turned)
    assert work["shadow_pages"] == 6 * 6 * 4 and not scene.warnings
    asked = refusing(monkeypatch, chapter, 3 << 20)
    _, work, _ = drawn(chapter, scene, **turned)
    assert asked == sorted(asked, reverse=True) and len(asked) == 3 and asked[-1] <= 3 << 20
    assert (
        work["shadow_bytes"] == asked[-1] and work["shadow_lights"] == 6 and work["shadow_lights_lowered"] > 0
    )
    (sentence,) = scene.warnings
    assert "for shadow maps" in sentence and sentence.count(".") >= 1 and "shadow_pool" in sentence


@pytest.mark.variants("gl")
def test_opengl_is_asked_for_its_errors_where_calls_are_not_checked(chapter, monkeypatch):
    """The call that makes an image returns nothing: without the question, pages without memory would be drawn to."""
    scene, asked = yard(*[point((x, 3.0, 0.0)) for x in (-2.0, 0.0, 2.0)]), iter((0, 0x0505, 0, 0))
    drawn(
        chapter, scene, shadow_memory="full", shadow_size=256
    )  # calls that are checked here have their question now
    monkeypatch.setattr(chapter.device.fn, "glGetError", lambda: next(asked, 0))
    _, work, _ = drawn(chapter, scene, shadow_memory="full", shadow_size=256)
    assert next(asked, None) is None and len(scene.warnings) == 1 and work["shadow_lights_lowered"] > 0


def test_memory_that_is_never_there_is_one_error(chapter, monkeypatch):
    asked = refusing(monkeypatch, chapter, 0)
    with pytest.raises(DeviceError, match="OUT_OF_"):
        drawn(chapter, yard(point((0.0, 3.0, 0.0))), shadow_memory="full")
    assert len(asked) > 2 and asked[-1] == 64 << 10
    monkeypatch.undo()
    drawn(chapter, yard(point((0.0, 3.0, 0.0))))


@pytest.mark.variants("vulkan")
@pytest.mark.feature("sparse/residency-image")
@pytest.mark.parametrize("blocks", [0, 1])
def test_sparse_pages_share_the_memory_that_there_is(chapter, monkeypatch, blocks):
    lights = [point((x, 3.0, z)) for x in (-2.0, 0.0, 2.0) for z in (-2.0, 2.0)]
    scene, create, given = yard(sun((0.3, -1.0, 0.2)), *lights), type(chapter.device).create, []

    def refuse(device, call, info, name):
        if call == "vkAllocateMemory" and name.startswith("shadow pages"):
            given.append(name)
            if len(given) > blocks:
                raise vk.VulkanError("vkAllocateMemory", vk.VK_ERROR_OUT_OF_DEVICE_MEMORY, ())
        return create(device, call, info, name)

    monkeypatch.setattr(type(chapter.device), "create", refuse)
    _, work, _ = drawn(chapter, scene, shadow_size=512, shadow_detail=16.0)
    assert given and work["shadow_pages"] <= 64 * blocks and len(scene.warnings) >= 1
    assert work["shadow_bytes"] == work["shadow_pages"] << 16
    assert (work["shadow_lights_lowered"] > 0) == (blocks > 0) or not blocks


def test_other_failures_are_no_lack_of_memory():
    def lost(tiles):
        raise DeviceError("vkAllocateMemory() failed with VK_ERROR_DEVICE_LOST.")

    with pytest.raises(DeviceError, match="LOST"):
        with_less(lost, 64, [])
    said: list[str] = []
    assert with_less(lambda tiles: tiles, 64, said) == 64 and said == []
