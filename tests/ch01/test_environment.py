"""Chapter 1's environment maps: the kernels against closed forms and float64, the furnace, the disk's cache."""

from __future__ import annotations

from functools import cache

import numpy as np
import pytest

from backends import shader_text
from backends.vulkan import api as vk
from backends.vulkan.barriers import barriers
from backends.vulkan.compute import Kernel, Sampled
from backends.vulkan.once import submit_once
from backends.vulkan.resources import create_buffer, create_sampler, destroy_buffer
from chapters.ch01.environment import model as logic
from chapters.ch01.environment.model import SMOOTH, Sizes
from chapters.ch01.environment.vulkan import create_environment, read_levels
from chapters.ch01.settings import Settings
from common.environment import ENERGIES, Environment, constant, read_environment
from common.environment.directions import (
    cube_directions,
    cube_solid_angles,
    panorama_directions,
    panorama_solid_angles,
    turn_back,
)
from common.paths import asset_dir
from common.settings import knobs
from tests.twins import shading_environment as ibl
from tests.twins.shading import distribution_ggx

pytestmark = pytest.mark.variants("vulkan")  # the kernels need nothing that a device may lack

SMALL = Sizes(face=32, irradiance_face=4, irradiance_source=32, table=16, table_samples=64, lobe_part=0.3)
HALF = 2.0**-11
"""The relative error of rounding to half precision."""


@pytest.fixture(autouse=True)
def own_cache(tmp_path, monkeypatch):
    """Let no test find maps that another one, or the user, has kept."""
    folder = tmp_path / "environment"
    folder.mkdir()
    monkeypatch.setattr(logic, "cache_dir", lambda name: folder)


def doubles(device, image):
    """Return the levels of an image as float64."""
    return [level.astype(np.float64) for level in read_levels(device, image)]


def made(device, environment, sizes=SMALL):
    """Return (radiance by level, irradiance) in nits and the table, as float64 arrays."""
    maps = create_environment(device, environment, sizes)
    try:
        levels = [level[..., :3] * maps.scale for level in doubles(device, maps.radiance)]
        irradiance = doubles(device, maps.irradiance)[0][..., :3] * maps.scale
        return levels, irradiance, doubles(device, maps.table)[0][0][..., :3]
    finally:
        maps.close(device)


def of(function, height=64):
    """Return the environment whose radiance in unit direction d is `function(d)`, (..., 3)."""
    return Environment("made up", function(panorama_directions(height)).astype(np.float32))


@cache
def garden(height):
    """Return the real environment, averaged down to `height` rows."""
    if asset_dir() is None:
        pytest.skip("the environments made elsewhere are not here (STRATA_ASSETS)")
    pixels = read_environment(asset_dir() / "environments" / "chinese_garden_1k.hdr").radiance
    step = len(pixels) // height
    return Environment(
        "garden", pixels.reshape(height, step, 2 * height, step, 3).mean(axis=(1, 3)).astype(np.float32)
    )


# --- closed forms ---


def test_a_constant_environment_stays_constant(vulkan_device):
    light = np.array([0.3, 5.0, 700.0])
    levels, irradiance, _ = made(vulkan_device, constant(light))
    assert [level.shape for level in levels] == [(6, 32, 32, 3), (6, 16, 16, 3), (6, 8, 8, 3)]
    for texels in (*levels, irradiance):
        assert np.abs(texels / light - 1).max() < 2 * HALF


@pytest.mark.feature("ibl/irradiance-convolution")
def test_linear_and_quadratic_light_return_with_their_factors(vulkan_device):
    """24,576 texels are summed; the factors are those of the cosine's spherical harmonics, 1, 2/3 and 1/4."""
    direction = np.array([0.48, 0.6, 0.64])
    sizes = Sizes(face=64, irradiance_face=8, irradiance_source=64, table=16, table_samples=16)
    n = cube_directions(8) @ direction

    def light(d):
        x = d @ direction
        return np.stack([0.5 + 0.4 * x, x * x, 0.1 + 0.3 * x + 0.5 * x * x], axis=-1)

    _, irradiance, _ = made(vulkan_device, of(light, 256), sizes)
    quadratic = 1 / 3 + (n * n - 1 / 3) / 4
    truth = np.stack([0.5 + 0.4 * n * 2 / 3, quadratic, 0.1 + 0.3 * n * 2 / 3 + 0.5 * quadratic], axis=-1)
    assert np.abs(irradiance - truth).max() < 1e-3
    assert np.abs(irradiance - light(cube_directions(8))).max() > 0.1, "light that is not spread is another"


def test_the_mirrors_level_is_the_environment(vulkan_device):
    levels, _, _ = made(vulkan_device, of(lambda d: 1 + d, 128))
    assert (
        np.abs(levels[0] - (1 + cube_directions(32))).max() < 2e-3
    )  # a texel is a mean, half precision is 1e-3 at 2


def lobe_share(alpha):
    """Return the mean cosine from the mirrored direction under D (n.l)."""
    c = np.linspace(0, 1, 200_001)
    weight = distribution_ggx(np.sqrt((1 + c) / 2), alpha) * c
    return (weight * c).sum() / weight.sum()


def test_blurred_linear_light_keeps_the_lobes_share(vulkan_device):
    """Of light b.d a lobe leaves b.n times the mean cosine under D (n.l): an integral over one angle."""
    levels, _, _ = made(vulkan_device, of(lambda d: 1 + 0.9 * d, 128))
    for level, texels in enumerate(levels[1:], start=1):
        alpha = logic.level_roughness(level, len(levels)) ** 2
        truth = 1 + 0.9 * lobe_share(alpha) * cube_directions(texels.shape[1])
        assert np.abs(texels - truth).max() < 5e-3, f"level {level}"  # the mean is 1


# --- a real environment ---


@cache
def blurred(content_height, edge, alpha, faces=6):
    """Return the garden's mean radiance (faces, edge, edge, 3) under the lobe, or the cosine alone, over all pixels."""
    light, areas = garden(content_height).radiance.astype(np.float64), panorama_solid_angles(content_height)
    d = panorama_directions(content_height).reshape(-1, 3)
    cosine = cube_directions(edge)[:faces].reshape(-1, 3) @ d.T
    weight = np.maximum(cosine, 0) * np.broadcast_to(areas, light.shape[:2]).ravel()
    if alpha is not None:
        weight *= distribution_ggx(np.sqrt(np.maximum(1 + cosine, 0) / 2), alpha)
    total = weight @ light.reshape(-1, 3) / weight.sum(axis=1, keepdims=True)
    return total.reshape(faces, edge, edge, 3)


def test_a_sunny_garden_against_sums_over_all_its_pixels(vulkan_device):
    """Half of this garden's light comes from a few pixels: a texel that is passed over, or met twice, would show."""
    sizes = Sizes(
        face=64, irradiance_face=4, irradiance_source=64, table=16, table_samples=16, lobe_part=0.15
    )
    environment = garden(64)
    levels, irradiance, _ = made(vulkan_device, environment, sizes)
    truth = blurred(64, 4, None)
    assert np.sqrt(((irradiance - truth) ** 2).mean()) < 0.005 * np.sqrt((truth**2).mean())
    assert np.abs(irradiance / truth - 1).max() < 0.03
    for level in (2, 3):
        edge = 64 >> level
        faces = {2: 2, 3: 6}[level]  # all of them take long at the finer level
        truth = blurred(64, edge, logic.level_roughness(level, 4) ** 2, faces)
        rms = np.sqrt(((levels[level][:faces] - truth) ** 2).mean() / (truth**2).mean())
        assert rms < 0.03, f"level {level}: {rms}"
    for level, texels in enumerate(levels):
        mean = np.einsum("fijc,ij->c", texels, cube_solid_angles(texels.shape[1])) / (4 * np.pi)
        assert np.abs(mean / environment.mean - 1).max() < 0.01, f"level {level}"


def test_a_sun_beyond_half_precision_keeps_its_light(vulkan_device):
    pixels = np.full((64, 128, 3), 1e3, np.float32)
    pixels[20, 30] = 1.6e9
    environment = Environment("sun", pixels)
    levels, irradiance, _ = made(vulkan_device, environment, SMALL)
    for texels in (*levels, irradiance):
        assert np.isfinite(texels).all()
    mean = np.einsum("fijc,ij->c", levels[0], cube_solid_angles(32)) / (4 * np.pi)
    assert np.abs(mean / environment.mean - 1).max() < 0.02
    assert 2.0 ** np.log2(logic.storage_scale(environment)) == logic.storage_scale(environment)
    assert 1.6e9 / logic.storage_scale(environment) <= logic.LARGEST


def test_coarse_levels_weigh_texels_by_solid_angle(vulkan_device):
    """A sun beside a corner of the cube, where texels are a fifth as large as in the middle of a face."""
    pixels = np.full((64, 128, 3), 1e-3, np.float32)
    pixels[20, 80:82] = 1e3  # some 10 degrees from a corner
    environment = Environment("corner", pixels)
    sizes = Sizes(face=64, irradiance_face=8, irradiance_source=4, table=16, table_samples=16)
    _, irradiance, _ = made(vulkan_device, environment, sizes)
    # The mean of irradiance / pi over all normals is that of the radiance, wherever in a texel the sun is.
    mean = np.einsum("fijc,ij->c", irradiance, cube_solid_angles(8)) / (4 * np.pi)
    assert np.abs(mean / environment.mean - 1).max() < 0.03


def test_no_light_at_all(vulkan_device):
    levels, irradiance, _ = made(vulkan_device, constant(0.0))
    assert max(texels.max() for texels in (*levels, irradiance)) == 0


# --- the table and the furnace ---


def test_the_table_against_quadrature(vulkan_device):
    sizes = Sizes(face=16, irradiance_face=2, irradiance_source=8, table=64, table_samples=1024)
    table = made(vulkan_device, constant(), sizes)[2]
    assert np.isfinite(table).all()
    assert table.min() >= 0
    assert table[..., :2].sum(axis=-1).max() <= 1 + HALF
    rows, columns = np.arange(1, 64, 9), np.array([0, 1, 4, 12, 30, 50, 63])
    cosine, roughness = ((columns + 0.5) / 63.5) ** 2, rows / 63
    truth = ibl.albedo_table(cosine[None, :], roughness[:, None])
    apart = np.abs(table[rows][:, columns] - truth)
    print(f"table of 1024 samples against quadrature: {apart.max():.2e}")
    assert apart.max() < 1e-3
    smooth = (1 - ((np.arange(64) + 0.5) / 63.5) ** 2) ** 5
    assert np.abs(table[0, :, 1] - smooth).max() < 1e-3
    assert np.abs(table[0, :, 0] - (1 - smooth)).max() < 1e-3


FURNACE = """
#include "ibl.glsl"
layout(local_size_x = 64) in;
layout(BIND(0, 0, 0)) uniform samplerCube radiance;
layout(BIND(0, 1, 1)) uniform samplerCube irradiance;
layout(BIND(0, 2, 2)) uniform sampler2D table;
layout(BIND(0, 3, 0), std430) buffer Lights { vec4 points[]; };
void main() {
    uint i = gl_GlobalInvocationID.x;
    if (i >= uint(points.length())) return;
    vec4 p = points[i];
    vec3 v = vec3(sqrt(max(1.0 - p.x * p.x, 0.0)), 0.0, p.x);
    vec3 light = environment_light(
        radiance, irradiance, table, vec3(0.0, 0.0, 1.0), v, vec3(p.z), p.w, p.y, ENERGY, LAST_LEVEL, vec2(0.6, 0.8)
    );
    points[i] = vec4(light, 1.0);
}
"""


def reflected(device, maps, points, energy):
    """Return the light (P, 3) that leaves for points (P, 4) of cosine, roughness, base colour, metallic."""
    defines = {"ENERGY": ENERGIES.index(energy), "LAST_LEVEL": float(maps.last_level)}
    source = shader_text.build_text(FURNACE, "comp", "vulkan", name="furnace", defines=defines)
    kernel = Kernel(device, source, ("texture", "texture", "texture", "storage"))
    sampler = create_sampler(device, SMOOTH, 1.0, "maps")
    data = np.float32(points)
    buffer = create_buffer(device, data.nbytes, vk.VK_BUFFER_USAGE_STORAGE_BUFFER_BIT, "readback", "points")
    try:
        buffer.view(np.float32)[:] = data.ravel()
        views = (maps.radiance_view, maps.irradiance_view, maps.table.view)
        with submit_once(device) as commands:
            held = [*(Sampled(view, sampler) for view in views), buffer]
            kernel.record(commands, held, ((len(data) + 63) // 64, 1, 1))
            written = (vk.VK_PIPELINE_STAGE_2_COMPUTE_SHADER_BIT, vk.VK_ACCESS_2_SHADER_STORAGE_WRITE_BIT)
            read = (vk.VK_PIPELINE_STAGE_2_HOST_BIT, vk.VK_ACCESS_2_HOST_READ_BIT)
            device.fn.vkCmdPipelineBarrier2(commands, barriers(memory=(*written, *read)))
        device.memory.invalidate(buffer.allocation)
        return buffer.view(np.float32).reshape(-1, 4)[:, :3].astype(np.float64)
    finally:
        destroy_buffer(device, buffer)
        device.destroy("VkSampler", sampler)
        kernel.close()


@cache
def furnace_truth():
    """Return cosine and roughness (K,) and A, B, W (K, 3) by quadrature."""
    cosine, roughness = (
        x.ravel()
        for x in np.meshgrid((0.01, 0.03, 0.1, 0.3, 0.6, 0.85, 1.0), (0.02, 0.11, 0.3, 0.5, 0.77, 1.0))
    )
    return cosine, roughness, ibl.albedo_table(cosine, roughness)


@pytest.mark.feature("ibl/specular-split-sum")
@pytest.mark.parametrize("energy", ENERGIES)
def test_furnace(vulkan_device, energy):
    """In light that is 1 from everywhere, what leaves is what float64 quadrature of the same formula says."""
    cosine, roughness, table = furnace_truth()
    maps = create_environment(
        vulkan_device,
        constant(),
        Sizes(face=16, irradiance_face=2, irradiance_source=8, table=64, table_samples=1024),
    )
    figures = {}
    try:
        for base, metallic in ((1.0, 1.0), (0.2, 1.0), (1.0, 0.0), (0.0, 0.0), (0.5, 0.5)):
            points = np.stack([cosine, roughness, np.full(42, base), np.full(42, metallic)], axis=1)
            got = reflected(vulkan_device, maps, points, energy)
            mirrored, spread = ibl.weights(np.full((42, 3), base), np.full(42, metallic), table, energy)
            apart = np.abs(got / (mirrored + spread) - 1)
            assert apart.max() < 5e-3
            figures[base, metallic] = got
    finally:
        maps.close(vulkan_device)
    metal, dielectric = figures[1.0, 1.0], figures[1.0, 0.0]
    print(
        f"{energy}: white metal {metal.min():.3f} to {metal.max():.3f}, dielectric {dielectric.min():.3f} to "
        f"{dielectric.max():.3f}"
    )
    if energy == "gltf":
        assert abs(metal.min() - 0.307) < 2e-3
        assert dielectric.max() > 1.5
    else:
        assert np.abs(metal - 1).max() < 5e-3
    if energy == "conserving":
        assert max(light.max() for light in figures.values()) <= 1 + 1e-3


def test_each_part_reads_its_map(vulkan_device):
    """In linear light: the level of the roughness along the mirrored direction, irradiance along the normal, turned."""
    environment = of(lambda d: 1 + 0.9 * d, 128)
    sizes = Sizes(
        face=32, irradiance_face=8, irradiance_source=32, table=64, table_samples=1024, lobe_part=0.2
    )
    cosine, roughness = (x.ravel() for x in np.meshgrid((0.2, 0.6, 1.0), (0.5, 1.0)))
    points = np.stack([cosine, roughness, np.full(6, 0.8), np.full(6, 0.5)], axis=1)
    maps = create_environment(vulkan_device, environment, sizes)
    try:
        got = reflected(vulkan_device, maps, points, "compensated") * maps.scale
    finally:
        maps.close(vulkan_device)
    table = ibl.albedo_table(cosine, roughness)
    mirrored, spread = ibl.weights(np.full((6, 3), 0.8), np.full(6, 0.5), table, "compensated")
    mirror = np.stack([-np.sqrt(1 - cosine**2), np.zeros(6), cosine], axis=1)
    turn = np.arctan2(0.8, 0.6)  # as in FURNACE
    share = np.array([lobe_share(r * r) for r in roughness])[:, None]
    truth = mirrored * (1 + 0.9 * share * turn_back(mirror, turn))
    truth += spread * (1 + 0.6 * turn_back([0.0, 0.0, 1.0], turn))
    assert np.abs(got / truth - 1).max() < 0.01


def test_grazing_and_smooth_surfaces_stay_finite(vulkan_device):
    maps = create_environment(vulkan_device, constant(3.0), SMALL)
    points = [(c, r, b, m) for c in (0.0, 1e-7) for r in (0.0, 1e-4, 1.0) for b in (0, 1) for m in (0, 1)]
    try:
        for energy in ENERGIES:
            got = reflected(vulkan_device, maps, points, energy) * maps.scale
            assert np.isfinite(got).all()
            assert got.min() >= 0
            assert got.max() < 3 * 2.01
    finally:
        maps.close(vulkan_device)


# --- sizes, and what is kept on disk ---


def test_levels():
    assert [Sizes(face=face, irradiance_source=8).levels for face in (16, 32, 256, 1024)] == [2, 3, 6, 8]
    assert [logic.level_roughness(level, 6) for level in range(6)] == [0, 0.2, 0.4, 0.6, 0.8, 1.0]
    assert (SMALL.source_levels, Sizes().irradiance_level) == (6, 3)
    for wrong in ({"face": 48}, {"face": 8}, {"irradiance_source": 64, "face": 32}):
        with pytest.raises(ValueError):
            Sizes(**wrong)


def test_edges_are_rounded_down_to_powers_of_two_as_their_help_says():
    sizes = Sizes.of(Settings(environment_size=300, irradiance_source=63))
    assert (sizes.face, sizes.irradiance_source) == (256, 32)
    for name in ("environment_size", "irradiance_source"):
        assert "rounded down to a power of two" in knobs(Settings())[name].doc
    assert "inverse square" in knobs(Settings())["environment_detail"].doc


def test_no_pixel_of_the_panorama_is_passed_over():
    """The widest step between points, in the middle of a face, is no more than a pixel of the panorama."""
    for height in (16, 512, 2048):
        points = logic.points_per_edge(constant(1.0, height), Sizes(face=128))
        step = 2 * np.arctan(1 / (128 * points))
        assert step <= np.pi / height * 1.001 or points == 32


def test_keys_follow_pixels_sizes_and_kernels(monkeypatch):
    one, other = constant(1.0), constant(1.5)
    key = logic.maps_key(one, SMALL)
    assert key == logic.maps_key(Environment("other name", one.radiance), SMALL)
    assert key == logic.maps_key(one, Sizes(**{**vars(SMALL), "table": 8}))
    assert (
        len({key, logic.maps_key(other, SMALL), logic.maps_key(one, Sizes(face=64)), logic.table_key(SMALL)})
        == 4
    )
    monkeypatch.setattr(logic, "kernel_digest", lambda: "another text")
    assert logic.maps_key(one, SMALL) != key


def test_the_digest_knows_every_file_that_a_kernel_includes():
    known = {f"{name}.glsl" for name in logic.INCLUDES}
    for name in (*logic.KERNELS, logic.TABLE_KERNEL):
        for backend in ("vulkan", "gl"):
            source = shader_text.build(
                logic.SHADERS / f"{name}.comp", backend, defines={"FORMAT": logic.FORMAT}
            )
            included = {file.name.split("/")[-1] for file in source.files[2:]}
            assert included <= known, name


def test_the_second_start_reads_what_the_first_made(vulkan_device, tmp_path):
    environment = of(lambda d: 1 + d)

    def start():
        maps = create_environment(vulkan_device, environment, SMALL)
        try:
            arrays = [read_levels(vulkan_device, one) for one in (maps.radiance, maps.irradiance, maps.table)]
            return len(maps.made_ms), maps.scale, arrays
        finally:
            maps.close(vulkan_device)

    first, second = start(), start()
    assert (first[0], second[0]) == (2, 0)
    assert first[1] == second[1]
    for before, after in zip(first[2], second[2], strict=True):
        for one, other in zip(before, after, strict=True):
            assert np.array_equal(one, other)
    files = sorted((tmp_path / "environment").iterdir())
    assert len(files) == 2
    for file in files:  # damaged, cut short, of another shape: made again
        file.write_bytes(file.read_bytes()[:-100])
    assert start()[0] == 2
    for file in files:
        data = bytearray(file.read_bytes())
        data[len(data) // 2] ^= 1
        file.write_bytes(data)
    assert start()[0] == 2
    logic.write_maps(
        logic.maps_key(environment, SMALL), logic.Maps([np.zeros((6, 4, 4, 4), np.float16)], np.zeros(1), 1.0)
    )
    assert start()[0] == 1


def test_a_table_that_is_kept_is_read_and_a_damaged_one_is_not(tmp_path):
    table = np.arange(16 * 16 * 4, dtype=np.float16).reshape(16, 16, 4)
    logic.write_table("table", table)
    assert np.array_equal(logic.read_table("table", SMALL), table)
    (file,) = (tmp_path / "environment").iterdir()
    data = file.read_bytes()
    for place in (0, len(data) // 2, len(data) - 1):
        file.write_bytes(data[:place] + bytes([data[place] ^ 1]) + data[place + 1 :])
        assert logic.read_table("table", SMALL) is None
        file.write_bytes(data[:place])
        assert logic.read_table("table", SMALL) is None


def test_an_environment_stands_as_it_is_unless_it_is_turned():
    """Cosine and sine of no turn and of a quarter, between the factor on its light and the last level."""
    assert logic.frame_values(Settings(), 8.0, 3) == (8.0, 1.0, 0.0, 3.0)
    turned = Settings(environment_turn=90.0, environment_intensity=0.5)
    assert logic.frame_values(turned, 8.0, 3) == pytest.approx((4.0, 0.0, 1.0, 3.0), abs=1e-15)


def test_a_disk_that_takes_nothing_costs_time_alone(vulkan_device, monkeypatch):
    monkeypatch.setattr(logic, "cache_dir", lambda name: None)
    maps = create_environment(vulkan_device, constant(), SMALL)
    assert set(maps.made_ms) == {"maps", "table"}
    assert all(took > 0 for took in maps.made_ms.values())
    maps.close(vulkan_device)
