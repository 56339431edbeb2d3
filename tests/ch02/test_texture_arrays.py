"""Textures without bindless: where each lies, and the same bits as from the one set that holds them all."""

from __future__ import annotations

import math
from dataclasses import replace
from itertools import cycle, islice

import numpy as np
import pytest

from chapters.ch02.scene import gl_data as on_gl
from chapters.ch02.scene.packing import ROLES, material_variant
from chapters.ch02.scene.textures import arrays, texels
from chapters.ch02.scene.textures import vulkan_materials as on_vulkan
from chapters.ch02.scene.textures.arrays import ARRAYS, LAYER_SHIFT, plan_arrays
from chapters.ch02.scene.textures.reads import image_roles, uses
from chapters.ch02.settings import Settings
from common.scene import Image, Light, Material, Sampler, Scene
from common.view.camera import UNIT_EV100
from tests.support.bounds import decoded_srgb
from tests.support.drivers import needs_whole_quads
from tests.support.scenes import NEAREST, facing, nodes_at, quad_scene, texture, translated

SIZE = (64, 64)
EXACT = Settings(
    color_format="rgba32f",
    background=0.0,
    tone_curve="none",
    default_light=False,
    ambient=0.4,
    anisotropy=1.0,  # the variant without any feature has none
)
SAMPLERS = (
    NEAREST,
    Sampler(),
    Sampler("linear", "linear", None, "clamp", "mirror"),
    Sampler("nearest", "linear", "nearest", "mirror", "clamp"),
)


def image(number: int, width: int, height: int, dtype: type = np.uint8) -> Image:
    """Return noise in the whole range of its type; floats in [0, 2)."""
    rng = np.random.default_rng(number)
    if np.dtype(dtype).kind == "f":
        return Image(f"image {number}", rng.uniform(0, 2, (height, width, 4)).astype(dtype))
    return Image(f"image {number}", rng.integers(0, np.iinfo(dtype).max + 1, (height, width, 4), dtype=dtype))


IMAGES = (
    image(0, 1, 1),
    image(1, 3, 5),
    image(2, 7, 2),
    image(3, 8, 8),
    image(4, 5, 3, np.uint16),
    image(5, 4, 4, np.float32),
    image(6, 16, 1),
    image(7, 8, 8),
    image(8, 1, 1, np.uint16),
)


def reads(scene: Scene) -> list:
    """Return everything that the materials of a scene sample."""
    return uses(scene, [material_variant(one, scene) for one in scene.materials])


# --- the plan ---


def random_scene(seed: int) -> Scene:
    """Return a scene of random materials, each with up to five textures."""
    rng = np.random.default_rng(seed)
    materials = []
    for _ in range(int(rng.integers(1, 30))):
        chosen = [role for role in ROLES if rng.random() < 0.6]
        maps = {
            f"{role}_texture": texture(int(rng.integers(len(IMAGES))), SAMPLERS[rng.integers(len(SAMPLERS))])
            for role in chosen
        }
        materials.append(Material(unlit=rng.random() < 0.3, **maps))
    return quad_scene(materials=tuple(materials), images=IMAGES)


@pytest.mark.parametrize("width", [5, 6, ARRAYS])
@pytest.mark.parametrize("max_layers", [1, 2, 2048])
def test_every_use_finds_its_image_with_its_sampler(width, max_layers):
    several = 0
    for seed in range(25):
        scene = random_scene(seed)
        found = reads(scene)
        plan = plan_arrays(scene, found, max_layers, width)
        for use in found:
            number = int(plan.maps[use.material, use.role])
            array = plan.arrays[plan.sets[plan.set_of[use.material]][number & 255]]
            assert array.layers[number >> LAYER_SHIFT] == use.read.key
            assert array.sampler == use.read.sampler
            assert array.shape == texels.shape_of(scene, use.read.key)
        used = {(use.material, use.role) for use in found}
        unused = [place for place in np.argwhere(plan.maps).tolist() if tuple(place) not in used]
        assert not unused, "what no role reads names no texture"
        assert all(len(held) <= width and len({*held}) == len(held) for held in plan.sets)
        assert plan.width == max(len(held) for held in plan.sets)
        assert {array for held in plan.sets for array in held} == {*range(len(plan.arrays))}
        # As few arrays as can be, and nothing in them twice.
        assert all(len(array.layers) <= max_layers for array in plan.arrays)
        kinds: dict = {}
        for read in {use.read for use in found}:
            kinds.setdefault((texels.shape_of(scene, read.key), read.sampler), []).append(read)
        assert len(plan.arrays) == sum(math.ceil(len(held) / max_layers) for held in kinds.values())
        assert sum(len(array.layers) for array in plan.arrays) == len({use.read for use in found})
        several += len(plan.sets) > 1
    assert several > 0


def test_shaders_have_code_for_the_arrays_of_their_own_materials_alone():
    """The masks of some materials are the bits of what their records say, whatever the rest of the scene samples."""
    for seed in range(25):
        scene = random_scene(seed)
        found = reads(scene)
        plan = plan_arrays(scene, found, 2048)
        drawn = sorted({use.material for use in found})[:: 1 + seed % 3]
        if not drawn:
            continue
        masks = [0] * len(ROLES)
        for use in found:
            if use.material in drawn:
                masks[use.role] |= 1 << (int(plan.maps[use.material, use.role]) & 255)
        expected = ", ".join(f"{mask}u" for mask in masks)
        assert plan.defines(drawn) == (("ARRAYS", plan.width), ("ROLE_ARRAYS", f"uint[5]({expected})"))


def test_a_scene_without_textures_has_no_arrays():
    scene = quad_scene()
    plan = plan_arrays(scene, reads(scene), 2048)
    assert (plan.arrays, plan.width) == ((), 0)
    assert not plan.maps.any() and not plan.set_of.any()


def test_what_a_shape_says_is_what_the_pixels_are():
    """Every image in every role, alone and beside another role: formats hold what is read, and nothing else."""
    formats = set()
    for number in range(len(IMAGES)):
        for roles in (
            *((role,) for role in ROLES),
            ("occlusion", "metallic_roughness"),
            ("normal", "occlusion"),
        ):
            for sampler in SAMPLERS[:2]:
                maps = {f"{role}_texture": texture(number, sampler) for role in roles}
                scene = quad_scene(Material(**maps), images=IMAGES)
                for key, role in image_roles(reads(scene)).items():
                    made, shape = texels.texels_of(scene, role, key), texels.shape_of(scene, key)
                    assert made.pixels.shape[:2] == (shape.height, shape.width)
                    described = (made.format, made.view_format, made.levels, made.swizzle)
                    assert described == (shape.format, shape.view_format, shape.levels, shape.swizzle)
                    formats.add(shape.format)
                    if IMAGES[number].pixels.dtype == np.uint8:
                        seen = {"0": 0, "1": 255} | {
                            one: made.pixels[..., place]
                            for place, one in enumerate("rgba"[: made.pixels.shape[2]])
                        }
                        read = {c for role in roles for c in texels.READ.get(role, "rgba")}
                        for place, channel in enumerate("rgba"):
                            if channel in read:
                                expected = IMAGES[number].pixels[..., place]
                                assert np.array_equal(seen[made.swizzle[place]], expected)
                    # A mip level for each halving of the longer side.
                    longest = max(shape.width, shape.height)
                    assert shape.levels == (1 if sampler.mipmap is None else int(math.log2(longest)) + 1)
    assert formats == {"r8", "rg8", "rgba8", "rgba16f"}


# --- pictures ---


def zoo() -> Scene:
    """Return sixteen squares: twelve unlit ones of all images and samplers in turn, four lit ones of five maps."""
    pairs = list(islice(zip(cycle(range(len(IMAGES))), cycle(SAMPLERS), strict=False), 12))
    plain = [Material(unlit=True, base_color_texture=texture(i, sampler)) for i, sampler in pairs]
    lit = [
        Material(
            **{
                f"{role}_texture": texture((n + place) % len(IMAGES), SAMPLERS[(n * place) % len(SAMPLERS)])
                for place, role in enumerate(ROLES)
            },
            emissive=(0.1, 0.2, 0.3),
        )
        for n in range(4)
    ]
    quarter = np.diag((0.25, 0.25, 1.0, 1.0))
    matrices = tuple(translated(0.5 * (i % 4) - 0.75, 0.5 * (i // 4) - 0.75) @ quarter for i in range(16))
    sun = Light("directional", node=16, intensity=3.0)
    scene = quad_scene(
        materials=(*plain, *lit),
        images=IMAGES,
        matrices=matrices,
        instance_materials=tuple(range(16)),
        lights=(sun,),
        uv_scale=1.7,
    )
    return replace(scene, nodes=nodes_at(*matrices, np.eye(4)))


def picture(chapter, scene, settings=EXACT):
    """Return the light of the second frame, and its work."""
    with chapter.open(scene, SIZE, settings, outputs={"color_linear"}) as made:
        made.render(facing())
        frame = made.render(facing())
        return frame.image("color_linear"), frame.work


TRUTH: dict = {}


@pytest.fixture
def truth(bindless_chapter):
    """The zoo as bindless textures show it."""
    which = str(bindless_chapter.which)
    if which not in TRUTH:
        TRUTH[which] = picture(bindless_chapter, zoo())
    return TRUTH[which]


def assert_same(chapter, a, b):
    """To the bit where one compiler made both; what is lit on OpenGL has a few units in the last place.

    `a` and `b` are pictures of the zoo, whose lit squares are on top.
    """
    if not chapter.device.capabilities.is_software:
        assert np.allclose(a, b, rtol=2e-3, atol=1e-4)
    elif chapter.backend == "vulkan":
        assert np.array_equal(a, b)
    else:
        lit = SIZE[1] // 4
        assert np.array_equal(a[lit:], b[lit:]), "texels"
        assert np.allclose(a[:lit], b[:lit], rtol=2e-6, atol=2e-6)


def narrowed(monkeypatch, width, layers):
    """Let sets hold `width` arrays, and arrays `layers` layers."""

    def narrow(scene, found, max_layers, _=ARRAYS):
        return plan_arrays(scene, found, min(max_layers, layers), width)

    for module in (on_vulkan, on_gl):
        monkeypatch.setattr(module, "plan_arrays", narrow)


@pytest.mark.until(
    2, "from chapter 3 on arrays are planned where textures arrive (loading/array_arrivals.py)"
)
@pytest.mark.feature("bindless/support-check")
@pytest.mark.variants("without-all", "gl")
@pytest.mark.parametrize(("width", "layers"), [(ARRAYS, 2048), (6, 2048), (5, 1)])
def test_arrays_are_the_picture_of_bindless_textures(chapter, truth, monkeypatch, width, layers):
    """However many sets and layers there are; draws of several sets are that many calls more."""
    narrowed(monkeypatch, width, layers)
    scene = zoo()
    sets = len(plan_arrays(scene, reads(scene), layers, width).sets)
    assert sets > 1 or width == ARRAYS
    expected, _ = truth
    found, work = picture(chapter, scene)
    assert_same(chapter, found, expected)
    assert work["draws"] == 16
    assert work["draw_calls"] >= sets
    assert expected.std() > 0.05


@pytest.mark.feature("bindless/support-check")
@pytest.mark.variants("vulkan")
def test_forced_off_is_the_same_picture_by_another_path(chapter, truth):
    with chapter.open(zoo(), SIZE, EXACT, outputs={"color_linear"}, without={"bindless"}) as made:
        assert not made.plan.native("bindless")
        assert made._data.slot_count == 0, "no slot of any set"
        frame = made.render(facing())
        assert np.array_equal(frame.image("color_linear"), truth[0])


def test_nearest_texels_are_those_of_the_image(chapter):
    """An odd image on a square of as many pixels: each texel exactly, as it was decoded."""
    pixels = IMAGES[1].pixels
    material = Material(unlit=True, base_color_texture=texture(0, NEAREST))
    scene = quad_scene(material, images=(IMAGES[1],))
    with chapter.open(scene, (15, 15), EXACT, outputs={"color_linear"}) as made:
        found = made.render(facing(ev100=UNIT_EV100)).image("color_linear")[1::3, 2::5]
    assert found.shape == (5, 3, 3)
    low, high = decoded_srgb(pixels[..., :3])
    assert (low <= found).all() and (found <= high).all()


@pytest.mark.feature("bindless/default-and-dummy-textures")
@pytest.mark.parametrize("levels", [True, False], ids=["mip levels", "one level"])
def test_two_samplers_read_one_image_each_in_its_way(chapter, levels):
    """The left square is nearest, the right linear: one upload with bindless, and neither takes the other's filter."""
    if levels:
        needs_whole_quads(chapter.device)
    mip = "linear" if levels else None
    first, second = (
        Sampler("nearest", "nearest", mip, "clamp", "clamp"),
        Sampler("linear", "linear", mip, "clamp", "clamp"),
    )
    half = np.zeros((2, 2, 4), np.uint8)
    half[:, 1] = 255
    half[..., 3] = 255
    scene = quad_scene(
        materials=tuple(Material(unlit=True, base_color_texture=texture(0, one)) for one in (first, second)),
        images=(Image("step", half),),
        matrices=(translated(-1.0), translated(1.0)),
        instance_materials=(0, 1),
    )
    with chapter.open(scene, (64, 32), EXACT, outputs={"color_linear"}) as made:
        frame = made.render(facing())
        row = frame.image("color_linear")[16, :, 0]
    assert len(np.unique(row[:32])) == 2
    assert len(np.unique(row[32:])) > 10
    if made.plan.native("bindless"):
        assert frame.work["textures"] == 1


# --- channels ---


def data_scene(shared: bool) -> Scene:
    """Return a lit square with roughness, metal and occlusion of one image, or of two with the same pixels."""
    noise = image(11, 16, 8).pixels
    images = (Image("first", noise), Image("second", noise.copy()))
    material = Material(
        metallic_roughness_texture=texture(0, Sampler()),
        occlusion_texture=texture(0 if shared else 1, Sampler()),
    )
    return quad_scene(
        material, images=images, lights=(Light("directional", node=0, intensity=2.0),), uv_scale=3.0
    )


def test_only_the_channels_that_are_read_are_uploaded(chapter, monkeypatch):
    """Less memory, and the same bits as with all four."""
    found = {}
    for narrow in (True, False):

        def every(scene, variants, *_, narrow=narrow):
            return uses(scene, variants, narrow)

        for module in (on_vulkan, on_gl):
            monkeypatch.setattr(module, "uses", every)
        scene = data_scene(shared=False)
        found[narrow] = picture(chapter, scene)[0]
        sizes = {
            role: texels.texels_of(scene, role, key).pixels.nbytes
            for key, role in image_roles(every(scene, [material_variant(scene.materials[0], scene)])).items()
        }
        texel = {"metallic_roughness": 2, "occlusion": 1} if narrow else dict.fromkeys(sizes, 4)
        assert sizes == {role: 16 * 8 * texel[role] for role in sizes} and len(sizes) == 2
    assert np.array_equal(found[True], found[False])
    assert found[True].std() > 0.01


@pytest.mark.variants("vulkan")
@pytest.mark.until(2, "textures are loaded beside the geometry, and their bytes counted apart")
def test_narrow_images_are_fewer_bytes_on_the_device(chapter, monkeypatch):
    uploaded = {}
    for narrow in (True, False):
        monkeypatch.setattr(on_vulkan, "takes_narrow", lambda device, narrow=narrow: narrow)
        with chapter.open(data_scene(shared=False), SIZE, EXACT) as made:
            uploaded[narrow] = made._data.bytes_uploaded
    assert uploaded[False] - uploaded[True] == 16 * 8 * (4 + 4 - 2 - 1)


@pytest.mark.core
def test_an_image_of_two_roles_keeps_the_channels_of_both(chapter):
    scene = data_scene(shared=True)
    (key,) = image_roles(reads(scene))
    assert texels.shape_of(scene, key).format == "rgba8" and set("rgb") <= set(key[-1])
    one, work = picture(chapter, scene)
    two, separate = picture(chapter, data_scene(shared=False))
    assert np.array_equal(one, two)
    assert (work["textures"], separate["textures"]) == (1, 2)


def test_arrays_of_one_layer_are_named_after_it():
    scene = quad_scene(Material(unlit=True, base_color_texture=texture()), images=IMAGES)
    made = [texels.texels_of(scene, role, key) for key, role in image_roles(reads(scene)).items()]
    assert texels.array_name(made) == "image 0"
    assert texels.array_name(made * 3) == "image 0 and 2 more"
    assert arrays.ARRAYS + 3 <= 16, "what every device has, with the environment's three"
