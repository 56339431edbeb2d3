"""The study buffer-addresses: the bits that a hit fetches, sums of addresses, and triangles in float64."""

from __future__ import annotations

import numpy as np
import pytest

import chapters
from chapters.ch12.studies.buffer_addresses import ENTRY, Settings, arena, meshes, table
from common.errors import SettingError, UnsupportedError
from common.settings import apply_overrides
from tests.support.gpu_functions import evaluate
from tests.support.pixel_rays import pixel_rays
from tests.twins.rays import nearest

WHICH, SIZE = "12/buffer-addresses", (64, 48)
FILE = "../chapters/ch12/studies/buffer_addresses/addresses.glsl"
NONE = 0xFFFFFFFF
TO_LIGHT = np.array([0.3, 0.5, 0.8124])

pytestmark = [
    pytest.mark.feature("ray-tracing/buffer-device-address"),
    pytest.mark.parametrize("stage", ["vulkan"], indirect=True, scope="module"),
]
"""OpenGL has no addresses of buffers."""


@pytest.fixture
def traced(stage):
    """What rays found (H, W), the picture, the view, and the renderer's table and address."""
    if not stage.device.has("ray-tracing"):
        pytest.skip("this device has no ray-tracing")
    with stage.open(WHICH, SIZE) as renderer:
        view = chapters.view_of(renderer)
        picture = renderer.render(view).image("color")
        yield renderer.pixels(), picture, view, renderer


def sums(corners):
    """Return the sum over the bits of positions (N, 3, 3): nine times PCG (Jarzynski and Olano 2020)."""
    total, mask = np.zeros(len(corners), np.uint64), np.uint64(0xFFFFFFFF)
    for bits in np.ascontiguousarray(corners, np.float32).view(np.uint32).reshape(len(corners), 9).T:
        state = ((total ^ bits) * np.uint64(747796405) + np.uint64(2891336453)) & mask
        word = ((state >> ((state >> np.uint64(28)) + np.uint64(4))) ^ state) * np.uint64(277803737) & mask
        total = (word >> np.uint64(22)) ^ word
    return total.astype(np.uint32)


def test_every_hit_fetches_the_bits_of_its_three_vertices(stage, traced):
    """Vertices are in an order by lot, and a sum over all bits tells a wrong one, or a wrong order."""
    found = traced[0]["what"].reshape(-1, 4)
    made = meshes(Settings())
    hit = found[:, 0] != NONE
    assert hit.sum() > 500 and set(found[hit, 0].tolist()) == set(range(12))
    corners = np.stack(
        [made[mesh].positions[made[mesh].indices[triangle]] for mesh, triangle in found[hit, :2]]
    )
    assert (sums(corners) == found[hit, 2]).all()
    assert (sums(corners[:, [1, 0, 2]]) != found[hit, 2]).all()
    next_ = np.stack(
        [made[m].positions[(made[m].indices[t] + 1) % len(made[m].positions)] for m, t in found[hit, :2]]
    )
    assert (sums(next_) != found[hit, 2]).all()


def test_the_fetched_vertices_are_where_the_ray_met_them(traced):
    """Barycentric sums round; the meshes are 4 m from side to side, 7 m away."""
    what = traced[0]["what"].reshape(-1, 4)
    hit = what[:, 0] != NONE
    assert np.ascontiguousarray(what[hit, 3]).view(np.float32).max() < 1e-5


def test_hits_and_light_are_those_of_all_triangles(stage, traced):
    settings, size = Settings(meshes=3), (40, 30)
    with stage.open(WHICH, size, settings=settings) as renderer:
        view = chapters.view_of(renderer)
        renderer.render(view).image("color")
        found = renderer.pixels()
    made = meshes(settings)
    corners = np.concatenate([mesh.positions[mesh.indices] for mesh in made]).astype(np.float64)
    eye, along = pixel_rays(view, size)
    first, t, sure = nearest(corners, np.broadcast_to(eye, along.shape), along)
    begins = np.cumsum([0, *(len(mesh.indices) for mesh in made)])
    what, color = found["what"].reshape(-1, 4), found["color"].reshape(-1, 4).astype(np.float64)
    assert ((what[:, 0] != NONE) == (first >= 0))[sure].all() and sure.mean() > 0.9
    both = np.flatnonzero(sure & (first >= 0))
    assert (begins[what[both, 0].astype(np.int64)] + what[both, 1] == first[both]).all()
    assert np.abs(color[both, 3] / t[both] - 1).max() < 1e-5
    place = eye + t[both, None] * along[both]
    for pixel, at in zip(both[::7], place[::7], strict=True):
        mesh = made[what[pixel, 0]]
        vertices = mesh.indices[what[pixel, 1]]
        a, b, c = mesh.positions[vertices].astype(np.float64)
        weights = np.linalg.lstsq(np.stack([a, b, c], axis=1), at, rcond=None)[0]
        normal = weights @ mesh.normals[vertices].astype(np.float64)
        bytes_ = mesh.colors[vertices].view(np.uint8).reshape(3, 4)[:, :3] / 255
        light = 0.2 + 0.8 * max(normal @ TO_LIGHT / np.linalg.norm(normal), 0)
        assert np.abs(color[pixel, :3] - light * (weights @ bytes_)).max() < 1e-3


def test_addresses_are_sums_of_64_bits_for_any_base_and_word(stage):
    random = np.random.default_rng(9)
    base = random.integers(0, 2**48, 500, dtype=np.uint64)
    word = random.integers(0, 2**32, 500, dtype=np.uint32)
    base[:3], word[:3] = (0xFFFFFFFC, 0x1_0000_0000, 2**33 - 4), (1, 0, 0xFFFFFFFF)
    got = evaluate(
        stage.device, [FILE], "sum = address_of(base, word);",
        {"base": base.view(np.uint32).reshape(-1, 2), "word": word},
        {"sum": "uvec2"},
    )["sum"]  # fmt: skip
    expected = [int(address) + 4 * int(number) for address, number in zip(base, word, strict=True)]
    assert np.ascontiguousarray(got).view(np.uint64).reshape(-1).tolist() == expected
    low = (base + (word << np.uint32(2))) & np.uint64(0xFFFFFFFF)
    assert (low != np.array(expected, np.uint64)).mean() > 0.9, "halves without a carry would be wrong"


def test_the_table_leads_to_each_part_behind_its_gap(stage, traced):
    """No part is where a descriptor could begin, for one of the parts at least; gaps hold other words."""
    renderer = traced[3]
    made = meshes(Settings())
    words, begins = arena(made)
    assert (renderer.entries["positions"] == renderer.address + begins[:, 1].astype(np.uint64)).all()
    for mesh, parts in zip(made, begins // 4, strict=True):
        for first, part in zip(parts, (mesh.indices, mesh.positions, mesh.attributes), strict=True):
            assert (words[first : first + part.size] == part.view(np.uint32).reshape(-1)).all()
    assert (begins % 4 == 0).all() and (begins % 16 != 0).any()
    far = table(begins, 2**40 + 12)
    assert far.dtype == ENTRY and (far["attributes"] - begins[:, 2].astype(np.uint64) == 2**40 + 12).all()


def test_without_ray_tracing_a_sentence_says_so(stage):
    with pytest.raises(
        UnsupportedError, match=r"buffer-addresses needs ray-tracing, but .* --without"
    ) as found:
        stage.open(WHICH, SIZE, without=["ray-tracing"])
    assert "\n" not in str(found.value)


@pytest.mark.parametrize("asked", ["meshes=0", "meshes=65"])
def test_what_is_no_choice_is_refused_in_one_sentence(stage, asked):
    with pytest.raises(SettingError, match="meshes") as found:
        apply_overrides(Settings(), [asked])
    assert "\n" not in str(found.value)
