"""Scenes that our path tracer and Mitsuba 3 have alike, and Mitsuba's pictures of them."""

from __future__ import annotations

import math
import multiprocessing
import os
import time as clock
from collections.abc import Callable
from concurrent.futures import ProcessPoolExecutor
from concurrent.futures.process import BrokenProcessPool
from dataclasses import replace
from typing import Any, cast

import numpy as np

from common.reports.benches import middle
from common.scene import Material, Scene
from common.scene.pose import evaluate_pose
from common.view.camera import Perspective, View

from .rays_scenes import geometry_of

LEAST_ROUGHNESS = 0.3


def of_metal(scene: Scene) -> Scene:
    """Return a scene with metals of the colours of its materials, without textures, and point lights without end.

    Then its materials are Mitsuba's `principled`: both have GGX with separable Smith masking and Schlick's Fresnel.
    """
    materials = [
        Material(
            base_color=(*it.base_color[:3], 1.0),
            metallic=1.0,
            roughness=max(it.roughness, LEAST_ROUGHNESS),
            emissive=it.emissive,
            double_sided=not any(it.emissive),
        )
        for it in scene.materials
    ]
    lights = [replace(light, range=math.inf) for light in scene.lights if light.kind != "spot"]
    return replace(
        scene, materials=materials, images=[], lights=lights, animations=[], deformations=[], medium=None
    )


class Mitsuba:
    """A scene of `of_metal`, as Mitsuba draws it. Raises ImportError where the package or its variant does not run."""

    def __init__(self, scene: Scene, view: View, size: tuple[int, int], variant: str, bounces: int) -> None:
        import mitsuba as package

        self._package = cast(Any, package)  # its stubs name types of another variant
        self._package.set_variant(variant)
        self._turn = self._package.ScalarTransform4f
        integrator = {"type": "path", "max_depth": bounces + 1, "rr_depth": 10**6}
        parts: dict[str, Any] = {
            "type": "scene",
            "integrator": integrator,
            "sensor": self._sensor(view, size),
        }
        self._scene = self._package.load_dict(parts | self._surfaces(scene) | self._lights(scene))

    def picture(self, number: int, samples: int) -> Any:
        """Return (H, W, 3) light, by the random numbers of a number."""
        return np.array(self._package.render(self._scene, spp=samples, seed=number))

    def _sensor(self, view: View, size: tuple[int, int]) -> dict[str, Any]:
        assert isinstance(view.projection, Perspective), "scenes have such cameras"
        film = {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}
        pose = np.asarray(view.world_from_view) @ np.diag((-1.0, 1.0, -1.0, 1.0))  # it looks along +z
        return {
            "type": "perspective",
            "fov": math.degrees(view.projection.yfov),
            "fov_axis": "y",
            "near_clip": view.projection.near,
            "to_world": self._turn(pose.tolist()),
            "film": {**film, "component_format": "float32", "pixel_format": "rgb"},
        }

    def _surfaces(self, scene: Scene) -> dict[str, Any]:
        """Return a mesh for each material that is used: all of its triangles, in the world."""
        geometry = geometry_of(scene, scene.name)
        corners, ids = geometry.world()
        shown = np.flatnonzero(scene.instances.visible)
        material_of = scene.meshes["material"][scene.instances.mesh[shown]][ids[:, 0]]
        parts = {}
        for number in np.unique(material_of).tolist():
            material, triangles = scene.materials[number], corners[material_of == number]
            properties = self._package.Properties()
            kind = {"type": "principled", "base_color": self._rgb(material.base_color[:3]), "metallic": 1.0}
            bsdf = {"type": "twosided", "bsdf": {**kind, "roughness": material.roughness}}
            properties["bsdf"] = self._package.load_dict(bsdf)
            if any(material.emissive):
                light = {"type": "area", "radiance": self._rgb(material.emissive)}
                properties["emitter"] = self._package.load_dict(light)
            count = len(triangles)
            mesh = self._package.Mesh(
                f"of material {number}", vertex_count=3 * count, face_count=count, props=properties
            )
            written = self._package.traverse(mesh)
            written["vertex_positions"] = (
                (triangles.astype(np.float64) + scene.origin).astype(np.float32).ravel()
            )
            written["faces"] = np.arange(3 * count, dtype=np.uint32)
            written.update()
            parts[f"mesh{number}"] = mesh
        return parts

    def _lights(self, scene: Scene) -> dict[str, Any]:
        poses, parts = evaluate_pose(scene, 0.0).world_from_node, {}
        for number, light in enumerate(scene.lights):
            power = self._rgb(np.asarray(light.color) * light.intensity)
            pose = np.asarray(poses[light.node])
            if light.kind == "directional":
                towards = (-pose[:3, 2]).tolist()
                parts[f"light{number}"] = {"type": "directional", "direction": towards, "irradiance": power}
            else:
                place = pose[:3, 3].tolist()
                parts[f"light{number}"] = {"type": "point", "position": place, "intensity": power}
        return parts

    @staticmethod
    def _rgb(values: Any) -> dict[str, Any]:
        return {"type": "rgb", "value": [float(it) for it in values]}


# --- clocks -----------------------------------------------------------------------------------------------------------


def timed(
    picture: Callable[[int], Any], rounds: int, size: tuple[int, int], samples: int
) -> dict[str, float]:
    """Return the speed by which pictures are traced, by the median of some, and how they differ."""
    paths, times, pictures = size[0] * size[1] * samples, [], []
    picture(rounds)  # drivers compile at the first one
    for number in range(rounds):
        began = clock.perf_counter()
        pictures.append(np.asarray(picture(number), np.float64))
        times.append(clock.perf_counter() - began)
    speed, apart = middle([1e-6 * paths / took for took in times])
    middle_ms, noise_ms = middle([1e3 * took for took in times])
    light = float(np.mean(pictures))
    noise = float(np.sqrt(np.var(pictures, axis=0, ddof=1).mean())) / light
    clocked = {"ms": middle_ms, "noise_ms": noise_ms, "least_ms": 1e3 * min(times)}
    return {"mpaths": speed, "mpaths_noise": apart, **clocked, "noise": noise, "light": light}


def timed_mitsuba(
    variant: str, scene: Scene, view: View, size: tuple[int, int], bounces: int, rounds: int, samples: int
) -> dict[str, float]:
    """Return the same of a variant of Mitsuba. Raises ImportError where it does not run.

    It has a process of its own: its compiler ends the process where it meets an LLVM that it cannot use, and a driver
    in software may have brought such a one with it.
    """
    alone = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(1, mp_context=alone, initializer=_quietly) as pool:
        try:
            return pool.submit(_in_a_process, variant, scene, view, size, bounces, rounds, samples).result()
        except BrokenProcessPool:
            raise ImportError("its compiler ended the process") from None


def _quietly() -> None:
    """Let nothing be printed to stderr: what a compiler says as it ends is not for the reader of a bench."""
    os.dup2(os.open(os.devnull, os.O_WRONLY), 2)


def _in_a_process(
    variant: str, scene: Scene, view: View, size: tuple[int, int], bounces: int, rounds: int, samples: int
) -> dict[str, float]:
    traced = Mitsuba(scene, view, size, variant, bounces)
    return timed(lambda number: traced.picture(number, samples), rounds, size, samples)
