"""Surfaces rebuilt from numbers of triangles equal those of the G-buffer pass, and double precision."""

from __future__ import annotations

from dataclasses import replace

import numpy as np
import pytest

from chapters import view_of
from chapters.ch07.scene import pages
from chapters.ch07.settings import Settings
from chapters.ch07.shading.deferred import EMISSION, TARGETS
from chapters.scenes import load
from common.errors import UserError
from common.numerics.transforms import pose_looking_at
from common.scene import Deformation, Image, Material, Sampler
from common.scene.pose import evaluate_pose
from common.settings import replaced
from common.view.camera import Orthographic, Perspective, View
from tests.support.bounds import snapping
from tests.support.drivers import needs_whole_quads
from tests.support.jumble import CAMERA, jumble
from tests.support.scenes import NEAREST, facing, nodes_at, quad_scene, texture, translated
from tests.support.towns import KINDS, MASKED, OPAQUE, TWO_SIDED, ball, grid, of_shapes, town, walk
from tests.twins.visibility import barycentrics, differences, level, raster

SIZE = (96, 54)
EXACT = Settings(
    graph="deferred",
    culling="off",
    color_format="rgba32f",
    gbuffer_format="full",
    anisotropy=1.0,
    ambient=0.3,
)
SMOOTH = Sampler("linear", "linear", "linear")
TILTED = View(pose_looking_at((0.0, -1.6, 0.9), (0.0, 0.2, 0.0)), Perspective(0.9, 0.05))
"""A view along the square of `quad_scene`, which it shows from 0.9 m above one edge."""


WRITERS = {"gbuffer": "gbuffer", "visibility": "visibility_resolve"}


def surfaces(chapter, scene, view, size=SIZE, time=0.0, ways=tuple(WRITERS), **turned):
    """Return the G-buffer and the picture by name, (H, W, 4) float64, of each of both ways to fill it."""
    found = []
    for way in ways:
        writer = WRITERS[way]
        settings = replaced(EXACT, surfaces=way, **turned)
        with chapter.open(scene, size, settings, outputs=("color_linear",), inspect=True) as renderer:
            for _ in range(2):
                frame = renderer.render(view, time)
            targets = (*TARGETS, EMISSION) if EMISSION in renderer.graph.resources else TARGETS
            images = {name: frame.image(f"{writer}/{name}").astype(float) for name in targets}
            found.append({**images, "picture": frame.image("color_linear").astype(float)})
    assert all(np.isfinite(image).all() for images in found for image in images.values())
    return found


def difference(found, name):
    """Return (H, W) the largest difference of a target's channels."""
    return np.abs(found[0][name] - found[1][name]).max(axis=-1)


def colored_town():
    """Return a town without textures whose vertices have colours, all different."""
    scene = town(count=26)
    colors = np.random.default_rng(1).uniform(0.1, 1.0, (len(scene.positions), 4)).astype(np.float32)
    colors[:, 3] = 1.0
    normals = scene.normals.copy()
    for row in scene.meshes[
        [1, 2, 5, 6]
    ]:  # not the balls: normals of walls, stretched, would turn within a pixel
        normals[row["first_vertex"] : row["first_vertex"] + row["vertex_count"]] = (0.0, 0.6, 0.8)
    return replace(scene, colors=colors, normals=normals)


def true_surfaces(scene, wanted, shown, weights):
    """Return base colour and normal (N, 3) of the pixels `shown` in double precision; either side of a normal.

    `weights` (N, 3) are those of the vertices at each of these pixels.
    """
    instance, mesh = wanted.instance[shown], scene.instances.mesh[wanted.instance[shown]]
    first = scene.meshes["first_index"][mesh].astype(int) + 3 * wanted.triangle[shown]
    vertices = scene.indices[first[:, None] + np.arange(3)].astype(int)
    vertices += scene.meshes["first_vertex"][mesh].astype(int)[:, None]
    colors, normals = (
        np.einsum("ni,nij->nj", weights, stream[vertices].astype(float))
        for stream in (scene.colors[:, :3], scene.normals)
    )
    colors *= np.array([scene.materials[number].base_color[:3] for number in scene.meshes["material"][mesh]])
    world = evaluate_pose(scene, 0.0).world_from_object[instance][:, :3, :3]
    normals = np.einsum("nji,nj->ni", np.linalg.inv(world), normals)
    return colors, normals / np.linalg.norm(normals, axis=1, keepdims=True)


def moved(chapter, scene, wanted, shown):
    """Return (H, W) how far colours and normals of `shown` may be off where a device moves vertices before it fills.

    A vertex that moves along an axis takes the triangle's attributes with it: by its way times their slope.
    """
    y, x = np.nonzero(shown)
    ndc, off = ndc_of(x, y), np.zeros(shown.shape)
    for axis in (0, 1):
        ahead, behind = (ndc + side * 1e-3 * np.eye(2)[axis] * 2 / SIZE[axis] for side in (1, -1))
        ends = [
            true_surfaces(scene, wanted, shown, barycentrics(wanted.clip[shown], place))
            for place in (ahead, behind)
        ]
        slopes = [np.abs(one - other).max(axis=1) / 2e-3 for one, other in zip(*ends, strict=True)]
        off[shown] += snapping(chapter.device) * np.maximum(*slopes)
    return off


def heights(clip):
    """Return (H, W) the smallest heights in pixels of triangles (H, W, 3, 4); infinite if the eye cuts one."""
    with np.errstate(divide="ignore", invalid="ignore"):
        place = clip[..., :2] / clip[..., 3:] * np.array(SIZE) / 2
    edges = np.roll(place, -1, axis=-2) - place
    area = np.abs(edges[..., 0, 0] * edges[..., 1, 1] - edges[..., 0, 1] * edges[..., 1, 0])
    height = area / np.maximum(np.linalg.norm(edges, axis=-1).max(axis=-1), 1e-9)
    return np.where((clip[..., 3] > 0).all(axis=-1), height, np.inf)


def ndc_of(x, y):
    """Return (N, 2) the centres of pixels in the units of clip space."""
    return np.stack([(x + 0.5) * 2 / SIZE[0] - 1, (y + 0.5) * 2 / SIZE[1] - 1], axis=1)


@pytest.mark.feature("visibility-buffer/ids")
@pytest.mark.parametrize(
    "view", [walk()[0], pytest.param(walk()[-1], marks=pytest.mark.long)], ids=["street", "above"]
)
def test_attributes_equal_those_of_the_gbuffer_and_of_double_precision(chapter, view):
    """Colours of vertices, normals of both faces and of mirrored and sheared objects, factors, emission.

    A vertex 10 m from the origin is off by some 2^-24 of that in the eye's space, and 1e-4 pixels on the screen. Over a
    triangle of h pixels an attribute is off by 1e-4 / h of its range: 1e-5 from 8 pixels on, in either path. The
    software driver's interpolation is off by 1.5e-5 in smaller ones, where the rebuilt ones are right. On a GPU the
    interpolated ones are those of vertices on a grid of 1/256 pixel.
    """
    scene = colored_town()
    found = surfaces(chapter, scene, view)
    wanted = raster(scene, view, SIZE)
    shown = wanted.sure & (wanted.instance >= 0)
    assert shown.mean() > 0.5
    bound = 1e-5 * np.maximum(1.0, 8.0 / np.maximum(heights(wanted.clip), 1e-3))
    assert (bound[shown] == 1e-5).mean() > 0.5
    y, x = np.nonzero(shown)
    weights = barycentrics(wanted.clip[shown], ndc_of(x, y))
    colors, normals = true_surfaces(scene, wanted, shown, weights)
    off = moved(chapter, scene, wanted, shown)
    stored = [found[1][name][shown][:, :3] for name in ("gbuffer_base_color", "gbuffer_normal")]
    side = np.sign((stored[1] * normals).sum(axis=1))[:, None]
    for got, truth in ((stored[0], colors), (stored[1], side * normals)):
        assert (np.abs(got - truth).max(axis=1) <= bound[shown]).all()
    for name in TARGETS:
        apart = difference(found, name)
        assert (apart <= 2 * bound + off)[shown].all() and (apart <= 1e-5 + off)[shown].mean() > 0.98, name
        assert np.quantile(apart, 0.99) <= 1e-4 + np.quantile(off[shown], 0.99), name
    assert np.ptp(stored[0]) > 0.5


@pytest.mark.feature("visibility-buffer/ids")
def test_uv_are_those_of_double_precision(chapter):
    """Each texel of the texture says where it is, so the colour of a pixel is its uv in steps of 1/64."""
    steps = np.arange(64, dtype=np.uint8) * 4
    texels = np.full((64, 64, 4), 255, np.uint8)
    texels[..., 0], texels[..., 1] = steps[None], steps[:, None]
    material = Material(base_color_texture=texture(0, NEAREST), unlit=True)
    scene = quad_scene(material, images=(Image("places", texels),))
    found = surfaces(chapter, scene, TILTED)
    wanted = raster(scene, TILTED, SIZE)
    shown = wanted.sure & (wanted.instance >= 0)
    assert shown.mean() > 0.3
    y, x = np.nonzero(shown)
    ndc = ndc_of(x, y)
    weights = barycentrics(wanted.clip[shown], ndc)
    corners = scene.uv0[scene.indices.reshape(-1, 3)[wanted.triangle[shown]]].astype(float)
    uv = np.einsum("ni,nij->nj", weights, corners) * 64
    clear = (np.abs(uv - np.round(uv)) > 64e-5).all(axis=1)
    assert clear.mean() > 0.95
    stored = found[1]["gbuffer_base_color"][shown][:, :2]
    codes = np.where(stored <= 0.0031308, stored * 12.92, 1.055 * stored ** (1 / 2.4) - 0.055)
    assert np.array_equal(np.round(codes[clear] * 255 / 4), np.floor(uv[clear]).clip(0, 63))


@pytest.mark.feature("visibility-buffer/analytic-derivatives")
def test_the_level_of_a_texture_is_that_of_the_sampler(chapter):
    """The view `mip-level` asks the sampler of the forward pass; the derivatives are those of the weights."""
    needs_whole_quads(chapter.device)
    texels = np.random.default_rng(2).integers(0, 256, (512, 512, 4), np.uint8)
    scene = quad_scene(Material(base_color_texture=texture(0, SMOOTH)), images=(Image("noise", texels),))
    settings = replaced(EXACT, view="mip-level", graph="forward")
    with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
        found = renderer.render(TILTED).image("color_linear")[..., 0].astype(float)
    wanted = raster(scene, TILTED, SIZE)
    shown = wanted.sure & (wanted.instance >= 0)
    y, x = np.nonzero(shown)
    ndc = ndc_of(x, y)
    corners = scene.uv0[scene.indices.reshape(-1, 3)[wanted.triangle[shown]]].astype(float)
    changes = [np.einsum("ni,nij->nj", it, corners) for it in differences(wanted.clip[shown], ndc, SIZE)]
    levels = level(*changes, (512, 512))
    assert np.ptp(levels) > 1.5 and levels.min() > 0
    # A sampler takes the differences within a quad of 2x2 pixels, whose middle is half a pixel away: where the level
    # changes by s a pixel, the two differ by about s / 2.
    if chapter.device.capabilities.is_software:
        assert np.abs(found[shown] - levels).mean() < 0.05
        assert np.abs(found[shown] - levels).max() < 0.1
    # The length of a change may be anything from its larger part to sqrt(2) times the sum of both (Vulkan 1.3, 16.5.7):
    # an H100 takes up to 1.08 times the length.
    parts = [np.abs(change) * 512 for change in changes]
    least = np.log2(np.maximum(*(it.max(axis=1) for it in parts)))
    most = np.log2(np.maximum(*(it.sum(axis=1) for it in parts))) + 0.5
    assert (found[shown] > least - 0.1).all() and (found[shown] < most + 0.1).all()
    assert np.abs(found[shown] - levels).mean() < 0.2


@pytest.mark.feature("visibility-buffer/analytic-derivatives")
@pytest.mark.parametrize(
    "lens", [CAMERA.projection, pytest.param(Orthographic(1.6, 0.1, 10.0), marks=pytest.mark.long)]
)
def test_pictures_with_textures_and_masks_agree(chapter, lens):
    """Masks, both faces, unlit and blended surfaces, seen by a perspective or by an orthographic camera."""
    random = np.random.default_rng(4)
    kinds = (
        Material(base_color_texture=texture(1, SMOOTH), normal_texture=texture(2, SMOOTH), double_sided=True),
        Material(base_color_texture=texture(0), alpha_mode="mask", alpha_cutoff=0.6, double_sided=True),
        Material(base_color=(0.2, 0.5, 0.9, 0.4), alpha_mode="blend", double_sided=True),
        Material(unlit=True, base_color_texture=texture(1, SMOOTH)),
        Material(
            metallic_roughness_texture=texture(2, SMOOTH),
            occlusion_texture=texture(2, SMOOTH, scale=(0.5, 0.5)),
            emissive_texture=texture(1, SMOOTH, rotation=0.3),
            emissive=(1.0, 0.5, 0.2),
            occlusion_strength=0.7,
        ),
    )
    smooth = np.kron(random.integers(0, 256, (8, 8, 4)), np.ones((8, 8, 1))).astype(np.uint8)
    images = (jumble(3).images[0], Image("squares", smooth), Image("more squares", smooth[::-1].copy()))
    scene = replace(jumble(3, kinds), images=list(images))
    found = surfaces(chapter, scene, View(CAMERA.world_from_view, lens))
    assert found[0]["picture"].std() > 0.05
    covered = found[0]["gbuffer_base_color"][..., 3] == found[1]["gbuffer_base_color"][..., 3]
    assert covered.all(), "masks cut the same pixels"
    for name in (*TARGETS, EMISSION, "picture"):
        # What differs is the level: a sampler's differences within a quad reach over the edges of triangles.
        assert difference(found, name).mean() < 2e-3, name
        assert np.quantile(difference(found, name), 0.98) < 0.03, name


@pytest.mark.feature("visibility-buffer/analytic-derivatives")
@pytest.mark.variants("vulkan", "gl")
def test_an_anisotropic_filter_is_that_of_the_gbuffer_pass(chapter):
    """A floor at a grazing angle: the kernel's picture is far nearer to that of the same filter than to a round one."""
    smooth = np.kron(np.random.default_rng(8).integers(0, 256, (32, 32, 4)), np.ones((4, 4, 1))).astype(
        np.uint8
    )
    material = Material(base_color_texture=texture(0, SMOOTH), unlit=True)
    scene = quad_scene(material, images=(Image("squares", smooth),))
    low = View(pose_looking_at((0.0, -1.1, 0.12), (0.0, 0.5, 0.0)), Perspective(0.7, 0.02))
    wide, flat = ([it["picture"] for it in surfaces(chapter, scene, low, anisotropy=a)] for a in (4.0, 1.0))
    filters = np.abs(wide[0] - flat[0])[..., :3].max(axis=-1)
    ways = np.abs(wide[0] - wide[1])[..., :3].max(axis=-1)
    assert filters.mean() > 0.005
    assert ways.mean() < 0.5 * filters.mean() and np.quantile(ways, 0.99) < np.quantile(filters, 0.99)


@pytest.mark.long
@pytest.mark.feature("visibility-buffer/analytic-derivatives")
@pytest.mark.variants("vulkan", "gl")
@pytest.mark.parametrize("gbuffer_format", ["compact", "octahedral"])
def test_pictures_of_the_atrium_agree(chapter, gbuffer_format):
    """Measured at 320x180: 11 of 255 at most and 0.11 in the mean on Vulkan, 5 and 0.06 on OpenGL."""
    scene, pictures = load("atrium"), []
    for way in ("gbuffer", "visibility"):
        settings = Settings(surfaces=way, graph="deferred", anisotropy=1.0, gbuffer_format=gbuffer_format)
        with chapter.open(scene, (160, 90), settings) as renderer:
            for _ in range(3):
                frame = renderer.render(view_of(renderer))
            pictures.append(frame.image("color").astype(int))
    apart = np.abs(pictures[0] - pictures[1])
    assert apart.max() <= 24 and apart.mean() <= 0.25
    assert pictures[0].std() > 20


@pytest.mark.feature("visibility-buffer/ids")
def test_sets_of_textures_and_pages_are_resolved_each_for_itself(chapter, monkeypatch):
    """Fifteen sizes of textures do not fit into one set of arrays, and no mesh shares its page with another."""
    sizes = [(2 + number, 3) for number in range(15)]
    random = np.random.default_rng(5)
    images = [Image(f"{w}x{h}", random.integers(0, 256, (h, w, 4), np.uint8)) for w, h in sizes]
    kinds = tuple(Material(base_color_texture=texture(number), unlit=True) for number in range(15))
    matrices = np.array([translated(-2.41 + 1.2037 * (n % 5), -1.2 + 1.2053 * (n // 5)) for n in range(15)])
    matrices[:, :2, :2] *= 0.5
    scene = of_shapes([grid(1)] * 15, list(range(15)), np.arange(15), matrices, kinds)
    scene = replace(scene, images=images, lights=[])
    monkeypatch.setattr(pages, "PAGE_BYTES", 4000)
    found = surfaces(chapter, scene, facing(ymag=2.0))
    assert difference(found, "picture").max() == 0.0
    assert (found[1]["picture"][..., :3].max(axis=-1) > 0.02).mean() > 0.3


@pytest.mark.feature("visibility-buffer/ids")
def test_deforming_meshes_are_resolved_from_the_vertices_of_their_slot(chapter):
    scene = quad_scene(Material(base_color=(0.6, 0.5, 0.4, 1)), matrices=(np.eye(4),))
    lean = np.eye(4)
    lean[:3, :3] = np.array([[1, 0, 0], [0, 0.6, -0.8], [0, 0.8, 0.6]])
    top = (scene.positions[:, 1] > 0).astype(float)
    skin = Deformation(
        mesh=0,
        node=0,
        joints=np.array([1, 2], np.int32),
        inverse_bind=np.stack([np.eye(4)] * 2),
        vertex_joints=np.tile(np.array((0, 1, 0, 0), np.int32), (4, 1)),
        vertex_weights=np.stack([1 - top, top, 0 * top, 0 * top], axis=1),
    )
    bent = replace(scene, nodes=nodes_at(np.eye(4), np.eye(4), lean), deformations=[skin])
    flat, found = surfaces(chapter, scene, TILTED)[1], surfaces(chapter, bent, TILTED)
    assert np.abs(found[1]["gbuffer_normal"] - flat["gbuffer_normal"]).max() > 0.1
    for name in TARGETS:
        # Where a device moves vertices, the interpolated attributes follow; the rebuilt picture has their slopes.
        slopes = [np.abs(it).max(axis=-1) for it in np.gradient(found[1][name], axis=(0, 1))]
        off = snapping(chapter.device) * sum(slopes)
        assert (difference(found, name) <= 1e-5 + off).all(), name


@pytest.mark.feature("visibility-buffer/ids")
def test_slivers_and_triangles_without_area_give_numbers(chapter):
    """A fan of needles, triangles of zero area and a ball of a few pixels: `surfaces` asserts that all is finite."""
    angle = np.linspace(0, 2 * np.pi, 400, endpoint=False)
    rim = np.stack([np.cos(angle), np.sin(angle), 0 * angle], axis=1)
    fan = np.concatenate([[[0.0, 0.0, 0.0]], rim]).astype(np.float32)
    numbers = np.arange(1, 401)
    needles = np.stack([0 * numbers, numbers, numbers % 400 + 1], axis=1)
    empty = np.stack([numbers, numbers, numbers[::-1]], axis=1)
    shapes = [(fan, np.concatenate([needles, empty]).astype(np.uint32)), ball(40, 60)]
    matrices = np.array([np.eye(4), translated(1.6, 0.0, 0.0), translated(-1.6, 0.0, 0.0)])
    matrices[1, :3, :3] *= 0.03
    matrices[2, :3, :3] = np.diag((0.5, 1e-7, 0.5))
    kinds = (Material(base_color_texture=texture(0, SMOOTH), double_sided=True), KINDS[TWO_SIDED])
    scene = of_shapes(shapes, [0, 1], np.array([0, 1, 1]), matrices, kinds)
    noise = np.random.default_rng(6).integers(0, 256, (64, 64, 4), np.uint8)
    scene = replace(scene, images=[Image("noise", noise)])
    for view in (facing(ymag=1.2), View(pose_looking_at((0, 3, 0.01), (0, 0, 0)), Perspective(0.8, 0.1))):
        found = surfaces(chapter, scene, view)
        assert np.median(difference(found, "gbuffer_normal")) <= 1e-5


@pytest.mark.variants("vulkan", "gl")
@pytest.mark.feature("visibility-buffer/cotangent-frame")
def test_derived_tangents_show_the_normal_map_of_stored_ones(chapter):
    """Both faces of a mirrored and of a plain square, whose stored tangents are along u."""
    texels = np.random.default_rng(7).integers(64, 192, (4, 4, 4), np.uint8)
    texels[..., 2] = 255
    material = Material(normal_texture=texture(0), double_sided=True)
    mirrored = translated(1.1) @ np.diag((-1.0, 1.0, 1.0, 1.0))
    scene = quad_scene(material, matrices=(translated(-1.1), mirrored), images=(Image("bumps", texels),))
    scene = replace(
        scene,
        instances=replace(scene.instances, mesh=np.zeros(2, np.int32), node=np.arange(2, dtype=np.int32)),
    )
    # Image v grows downwards, and the squares' stored handedness says that green points up.
    for place in ((0.3, -0.8, 2.5), (0.3, -0.8, -2.5)):
        view = View(pose_looking_at(place, (0.0, 0.0, 0.0)), Perspective(0.9, 0.05))
        stored, derived = (
            surfaces(chapter, scene, view, ways=("visibility",), tangents=way)[0]
            for way in ("stored", "derived")
        )
        normals = [images["gbuffer_normal"][..., :3] for images in (stored, derived)]
        shown = np.linalg.norm(normals[0], axis=-1) > 0.5
        assert shown.mean() > 0.2 and np.ptp(normals[0][shown][:, 0]) > 0.3
        assert np.abs(normals[0] - normals[1])[shown].max() < 1e-4


# --- what is off, and what cannot be ---


def steps(renderer):
    return [step.name for step in renderer.graph.steps]


@pytest.mark.feature("visibility-buffer/ids")
def test_what_is_off_creates_nothing(chapter):
    """Without the knob nothing of the folder is compiled or drawn; with it nothing of the G-buffer pass is."""
    scene, opened = jumble(3), {}
    for way in ("gbuffer", "visibility"):
        settings = replaced(EXACT, surfaces=way)
        with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
            work = [renderer.render(CAMERA).work for _ in range(3)][-1]
            built = {file.parent.name for file in renderer.shader_files if file.exists()}
            opened[way] = steps(renderer), work, built, renderer.graph.resources.keys()
    off, on = opened["gbuffer"], opened["visibility"]
    assert "visibility" not in off[2] and "visibility" in on[2]
    assert not {name for name in off[3] if name.startswith("visibility")} and "visibility" in on[3]
    assert [name for name in off[0] if name.startswith("visibility")] == []
    assert [name for name in on[0] if name.startswith("gbuffer")] == []
    assert len(on[0]) == len(off[0]) + 1
    assert on[1]["recorded"] == off[1]["recorded"] == 0, "a frame is submitted again"


@pytest.mark.feature("visibility-buffer/ids")
@pytest.mark.parametrize(
    ("turned", "why"),
    [
        ({"graph": "auto", "msaa": 4}, "msaa=4, since"),
        pytest.param({"graph": "forward", "msaa": 4}, "msaa=4, since", marks=pytest.mark.long),
        pytest.param({"view": "normal"}, "view=normal, which", marks=pytest.mark.long),
        pytest.param({"culling_overlay": "boxes"}, "culling_overlay=boxes, which", marks=pytest.mark.long),
    ],
)
def test_frames_that_take_the_forward_pass_instead_say_so(chapter, turned, why):
    """Once for a scene; they have no pass of numbers, and the picture is that without the knob."""
    scene, pictures = jumble(3), []
    for way in ("gbuffer", "visibility", "visibility"):
        settings = replaced(EXACT, surfaces=way, **turned)
        with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
            pictures.append(renderer.render(CAMERA).image("color_linear").copy())
            assert not [name for name in steps(renderer) if name.startswith("visibility")]
            told = [text for text in renderer.scene.warnings if text.startswith("surfaces=")]
            assert len(told) == (way == "visibility")
            assert all(text.startswith(f"surfaces=visibility has no effect with {why}") for text in told)
    assert np.array_equal(*pictures[:2])


@pytest.mark.feature("visibility-buffer/ids")
def test_a_graph_without_the_passes_is_refused(chapter, tmp_path):
    path = tmp_path / "own.json"
    names = ("gbuffer", "lighting", "transparent", "tonemap")
    path.write_text(
        '{"title": "t", "passes": [' + ", ".join(f'{{"pass": "{name}"}}' for name in names) + "]}"
    )
    settings = replaced(EXACT, surfaces="visibility", graph=str(path))
    with pytest.raises(UserError, match=r"own\.json has no passes 'visibility' and 'visibility_resolve'"):
        chapter.open(quad_scene(), SIZE, settings)


@pytest.mark.feature("visibility-buffer/ids")
def test_a_material_of_another_kind_is_followed(chapter):
    """An edit gives a material a mask and both faces: pipelines, flags and the pass of numbers follow."""
    kinds = (KINDS[OPAQUE], KINDS[MASKED])
    scene = of_shapes(
        [grid(4), ball()], [0, 0], np.array([0, 1]), np.array([np.eye(4), translated(0.5)]), kinds
    )
    settings = replaced(EXACT, surfaces="visibility")
    view = View(pose_looking_at((0.5, 0.5, -3.0), (0.0, 0.0, 0.0)), Perspective(0.9, 0.05))
    with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
        before = renderer.render(view).image("color_linear").copy()
        with scene.edit() as edit:
            edit.set_material(0, replace(KINDS[MASKED], double_sided=True))
        after = [renderer.render(view) for _ in range(3)][-1].image("color_linear").copy()
    assert not np.array_equal(before, after)
    with chapter.open(scene, SIZE, settings, outputs=("color_linear",)) as renderer:
        assert np.array_equal(renderer.render(view).image("color_linear"), after)


@pytest.mark.feature("visibility-buffer/ids")
def test_the_forward_graph_is_refused(chapter):
    """It lights objects while they are drawn: no pass would resolve their numbers."""
    with pytest.raises(
        UserError, match=r"forward\.json has no G-buffer, and surfaces=visibility fills one: set "
    ):
        chapter.open(quad_scene(), SIZE, replaced(EXACT, surfaces="visibility", graph="forward"))
