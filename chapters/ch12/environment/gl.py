"""The environment on the GPU: three images made once by compute before the first frame, or read from the disk's cache.

The kernels, their sizes and the files on disk are those of environment/vulkan.py: what one backend has made, the
other one reads.
"""

from __future__ import annotations

import time as clock
from contextlib import ExitStack
from dataclasses import dataclass
from typing import Any

import numpy as np

from backends import shader_text
from backends.gl import api as gl
from backends.gl.context import Context
from backends.gl.programs import Program, Programs
from backends.gl.readback import read_image
from backends.gl.resources import (
    Image,
    bind_storage_image,
    bind_texture,
    create_image,
    create_sampler,
    create_view,
    destroy_image,
    write_image,
)
from common.environment import Environment
from common.errors import UserError

from . import model as logic
from .model import PANORAMA, SMOOTH, Maps, MapsOnGpu, Sizes


@dataclass(eq=False)
class EnvironmentMaps(MapsOnGpu):
    """The sampled images; `close` frees it."""

    irradiance: Image
    table: Image

    def close(self, context: Context) -> None:
        """Free the images; OpenGL itself waits for the GPU's use."""
        for image in (self.radiance, self.irradiance, self.table):
            destroy_image(context, image)


def create_environment(context: Context, environment: Environment, sizes: Sizes) -> EnvironmentMaps:
    """Return the maps of an environment: from the disk where they are kept, else made, and kept. Waits for the GPU."""
    with ExitStack() as failed:

        def image(edge: int, name: str, levels: int = 1, shape: Any = "cube") -> Image:
            image = create_image(context, logic.FORMAT, (edge, edge), name, shape=shape, levels=levels)
            failed.callback(destroy_image, context, image)
            return image

        radiance = image(sizes.face, "environment radiance", sizes.levels)
        irradiance = image(sizes.irradiance_face, "environment irradiance")
        table = image(sizes.table, "environment table", shape="2d")
        made_ms = {}
        key = logic.maps_key(environment, sizes)
        maps = logic.read_maps(key, sizes)
        if maps is None:
            maps, made_ms["maps"] = _make_maps(context, environment, sizes, radiance, irradiance)
            logic.write_maps(key, maps)
        else:
            for level, texels in enumerate(maps.radiance):
                write_image(context, radiance, texels, level=level)
            write_image(context, irradiance, maps.irradiance)
        key = logic.table_key(sizes)
        texels_of_table = logic.read_table(key, sizes)
        if texels_of_table is None:
            values, made_ms["table"] = _make_table(context, sizes, table)
            logic.write_table(key, values)
        else:
            write_image(context, table, texels_of_table)
        failed.pop_all()
        return EnvironmentMaps(radiance, maps.scale, made_ms, irradiance, table)


def _program(programs: Programs, name: str) -> Program:
    path = logic.SHADERS / f"{name}.comp"
    return programs.get(
        [shader_text.build(path, "gl", defines={"FORMAT": logic.FORMAT})], f"environment {name}"
    )


def _make_maps(
    context: Context, environment: Environment, sizes: Sizes, radiance: Image, irradiance: Image
) -> tuple[Maps, float]:
    """Run the kernels; return what they wrote and their milliseconds."""
    height, width = environment.radiance.shape[:2]
    largest = context.capabilities.limits["maxImageDimension2D"]
    if width > largest:
        raise UserError(
            f"The environment {environment.name} is {width} pixels wide, and {context.capabilities.device} takes "
            f"{largest}: scale it down"
        )
    scale = logic.storage_scale(environment)
    fn = context.fn
    with ExitStack() as stack:
        programs = Programs(context)
        stack.callback(programs.close)
        panorama = create_image(context, logic.FORMAT, (width, height), "panorama")
        stack.callback(destroy_image, context, panorama)
        source = create_image(
            context,
            logic.FORMAT,
            (sizes.face, sizes.face),
            "environment source",
            shape="cube",
            levels=sizes.source_levels,
        )
        stack.callback(destroy_image, context, source)
        samplers = [create_sampler(context, how, 1.0, "environment") for how in (PANORAMA, SMOOTH)]
        for sampler in samplers:
            stack.callback(context.destroy, "sampler", sampler)
        write_image(context, panorama, logic.panorama_texels(environment, scale))

        def run(name: str, view: int, sampler: int, target: Image, level: int, push: np.ndarray) -> None:
            fn.glUseProgram(_program(programs, name).handle)
            bind_texture(context, 0, view, sampler)
            bind_storage_image(context, 0, target, level=level)
            context.push(push)
            fn.glDispatchCompute(*logic.groups(target.width >> level))
            fn.glMemoryBarrier(
                gl.GL_TEXTURE_FETCH_BARRIER_BIT
            )  # the next kernel reads the stores of this kernel

        for name in logic.KERNELS:  # compiled before the clock runs
            _program(programs, name)
        fn.glFinish()
        began = clock.perf_counter()
        first = logic.push((sizes.face, logic.points_per_edge(environment, sizes)))
        for cube in (source, radiance):  # level 0 is the environment itself
            run("cube", panorama.view, samplers[0], cube, 0, first)
        for level in range(1, sizes.source_levels):
            above = create_view(context, source, logic.FORMAT, level=level - 1, levels=1)
            run("mips", above, samplers[1], source, level, logic.push((sizes.face >> level,)))
        counts = logic.push((sizes.irradiance_face, sizes.irradiance_source, sizes.irradiance_level))
        run("irradiance", source.view, samplers[1], irradiance, 0, counts)
        for level in range(1, sizes.levels):
            alpha = logic.level_roughness(level, sizes.levels) ** 2
            part = logic.level_part(sizes, level)
            lobe = logic.push((sizes.face >> level, sizes.source_levels - 1), alpha, part)
            run("prefilter", source.view, samplers[1], radiance, level, lobe)
        fn.glMemoryBarrier(gl.GL_TEXTURE_UPDATE_BARRIER_BIT)
        fn.glFinish()
        made_ms = (clock.perf_counter() - began) * 1e3
        levels = [read_cube(context, radiance, level) for level in range(sizes.levels)]
        return Maps(levels, read_cube(context, irradiance, 0), scale), made_ms


def read_cube(context: Context, image: Image, level: int) -> np.ndarray:
    """Return a level of a cube map as (6, n, n, C)."""
    return np.stack([read_image(context, image, level=level, layer=face) for face in range(6)])


def _make_table(context: Context, sizes: Sizes, table: Image) -> tuple[np.ndarray, float]:
    """Run the table's kernel; return what it wrote and its milliseconds."""
    programs = Programs(context)
    try:
        context.fn.glUseProgram(_program(programs, logic.TABLE_KERNEL).handle)
        context.fn.glFinish()
        began = clock.perf_counter()
        bind_storage_image(context, 0, table)
        context.push(logic.push((sizes.table, sizes.table_samples)))
        context.fn.glDispatchCompute(*logic.groups(sizes.table, 1))
        context.fn.glMemoryBarrier(gl.GL_TEXTURE_FETCH_BARRIER_BIT | gl.GL_TEXTURE_UPDATE_BARRIER_BIT)
        context.fn.glFinish()
        made_ms = (clock.perf_counter() - began) * 1e3
        return read_image(context, table), made_ms
    finally:
        programs.close()
