"""Scenes of tests as Mitsuba 3 holds them, and pictures that its path tracers draw.

Mitsuba's `scalar_rgb` computes in float32 on the CPU and shares no code with this project. What is handed over is the
description of a scene alone: squares with their matrices, numbers of materials and lights, the camera.

Materials coincide where they are metal: with `metallic` 1, Mitsuba's `principled` is Schlick's Fresnel between the base
colour and 1, over GGX with the separable Smith masking that glTF names; with a white base colour that is its
`roughconductor` without a material. Its `roughplastic` and the diffuse lobe of `principled` are other models than
glTF's dielectric. That one is `Layered` here: Mitsuba's own `diffuse` and `roughconductor`, mixed by Schlick's Fresnel
at the half vector. The mixture is written for this test, and so it is not independent.
"""

from __future__ import annotations

import math
from functools import cache
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.environment import Environment
from common.scene import Light, Material, Medium, Scene
from common.view.camera import Perspective, View

Float64 = NDArray[np.float64]
Parts = dict[str, Any]

SENSOR_HEIGHT_M = 0.024
"""Of the camera whose lens has an f-number: a full frame, 36 x 24 mm."""

APART = 1e-3
"""Metres between two squares that stand for one that emits from both of its sides."""


@cache
def mitsuba() -> Any:
    """Return the package, set to its plain CPU variant, with `Layered` among its materials."""
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    mitsuba.register_bsdf("layered", lambda properties: _layered()(properties))
    return mitsuba


def render(parts: Parts, samples: int, batches: int, first: int = 0) -> Float64:
    """Return (batches, H, W, 3) pictures of a scene by independent random numbers."""
    mi = mitsuba()
    scene = mi.load_dict(parts)
    return np.array(
        [np.array(mi.render(scene, spp=samples, seed=seed)) for seed in range(first, first + batches)],
        np.float64,
    )


def scene_parts(
    scene: Scene, view: View, size: tuple[int, int], *, bounces: int, anisotropy: float = 0.0, turn: float = 0.0,
    aperture: float = 0.0, focus: float = 0.0,
) -> Parts:  # fmt: skip
    """Return a scene of squares (`tests.support.scenes.quad_scene`) for `render`.

    Paths are reflected `bounces` times at most and never end at random. `turn` is that of the environment, in degrees.
    A spot light needs cones that are nearly the same: only an edge
    without a soft part is the same in both programs.
    """
    parts: Parts = {"type": "scene", "sensor": _sensor(view, size, aperture, focus)}
    integrator = "path" if scene.medium is None else "volpath"
    parts["integrator"] = {"type": integrator, "max_depth": bounces + 1, "rr_depth": 10**6}
    if scene.medium is not None:
        parts |= _medium(scene, scene.medium, anisotropy)
        if "whole" in parts:
            parts["sensor"]["medium"] = {"type": "ref", "id": "air"}
    for number, (node, mesh) in enumerate(zip(scene.instances.node, scene.instances.mesh, strict=True)):
        material = scene.materials[int(scene.meshes["material"][mesh])]
        parts |= _squares(f"square{number}", np.asarray(scene.nodes.matrix[node], np.float64), material)
    for number, light in enumerate(scene.lights):
        parts[f"light{number}"] = _light(light, scene.nodes.matrix[light.node])
    if scene.environment is not None:
        parts["environment"] = _environment(scene.environment, turn)
    return parts


def rgb(values: ArrayLike) -> Parts:
    """Return a colour, or any three numbers of light."""
    return {"type": "rgb", "value": [float(it) for it in np.broadcast_to(np.asarray(values, np.float64), 3)]}


def transform(matrix: ArrayLike) -> Any:
    """Return a (4, 4) matrix as Mitsuba takes it."""
    return mitsuba().ScalarTransform4f(np.asarray(matrix, np.float64).tolist())


def _sensor(view: View, size: tuple[int, int], aperture: float, focus: float) -> Parts:
    film = {"type": "hdrfilm", "width": size[0], "height": size[1], "rfilter": {"type": "box"}}
    film |= {"component_format": "float32", "pixel_format": "rgb"}
    # Its cameras look along +z, and +x is to the left.
    pose = np.asarray(view.world_from_view) @ np.diag((-1.0, 1.0, -1.0, 1.0))
    sensor: Parts = {"film": film, "sampler": {"type": "independent"}}
    if not isinstance(view.projection, Perspective):
        height = view.projection.ymag
        pose = pose @ np.diag((height * size[0] / size[1], height * size[0] / size[1], 1.0, 1.0))
        return {
            **sensor,
            "type": "orthographic",
            "near_clip": 1e-3,
            "far_clip": 1e4,
            "to_world": transform(pose),
        }
    angle = view.projection.yfov
    sensor |= {"fov": math.degrees(angle), "fov_axis": "y", "near_clip": 1e-3, "far_clip": 1e4}
    sensor["to_world"] = transform(pose)
    if aperture == 0.0:
        return {**sensor, "type": "perspective"}
    # The lens equation: the focal length f of a thin lens whose sharp image of `focus` is as far behind it as this
    # field of view asks for.
    behind = 0.5 * SENSOR_HEIGHT_M / math.tan(0.5 * angle)
    focal = 1.0 / (1.0 / behind + 1.0 / focus)
    return {**sensor, "type": "thinlens", "aperture_radius": 0.5 * focal / aperture, "focus_distance": focus}


def _bsdf(material: Material) -> Parts:
    """Return a material that reflects the same on both sides."""
    color = np.asarray(material.base_color[:3])
    if material.metallic == 1.0 and (color == 1.0).all():
        kind: Parts = {"type": "roughconductor", "material": "none", "distribution": "ggx"}
        kind["alpha"] = material.roughness**2
    elif material.metallic == 1.0:
        kind = {
            "type": "principled",
            "base_color": rgb(color),
            "metallic": 1.0,
            "roughness": material.roughness,
        }
    else:
        assert material.metallic == 0.0, "no mixtures of metal"
        names = dict(zip(("red", "green", "blue"), color.tolist(), strict=True))
        kind = {"type": "layered", "alpha": material.roughness**2, **names}
    return {"type": "twosided", "bsdf": kind}


def _squares(name: str, matrix: Float64, material: Material) -> Parts:
    """Return a square; two, back to back and APART metres from each other, where both sides emit."""
    square: Parts = {"type": "rectangle", "to_world": transform(matrix), "bsdf": _bsdf(material)}
    if not any(material.emissive):
        return {name: square}
    square["emitter"] = {"type": "area", "radiance": rgb(material.emissive)}
    if not material.double_sided:
        return {name: square}
    normal = np.cross(matrix[:3, 0], matrix[:3, 1])
    back = matrix @ np.diag((1.0, -1.0, -1.0, 1.0))
    back[:3, 3] -= APART * np.sign(normal @ matrix[:3, 2]) * normal / np.linalg.norm(normal)
    return {name: square, f"{name}back": {**square, "to_world": transform(back)}}


def _light(light: Light, pose: Float64) -> Parts:
    power = rgb(np.asarray(light.color) * light.intensity)
    place, along = pose[:3, 3], -pose[:3, 2]
    if light.kind == "directional":
        return {"type": "directional", "direction": along.tolist(), "irradiance": power}
    if light.kind == "point":
        return {"type": "point", "position": place.tolist(), "intensity": power}
    assert light.outer_cone - light.inner_cone < 1e-3, "the soft parts of edges differ"
    look = (
        mitsuba().ScalarTransform4f().look_at(place.tolist(), (place + along).tolist(), pose[:3, 1].tolist())
    )
    degrees = {"cutoff_angle": math.degrees(light.outer_cone), "beam_width": math.degrees(light.inner_cone)}
    return {"type": "spot", "to_world": look, "intensity": power, **degrees}


def _environment(environment: Environment, turn: float) -> Parts:
    """Return an environment as Mitsuba holds it.

    It puts the first and last row of a picture on the poles, where ours begin half a pixel from them: so it gets one
    row more, each the mean of the two that meet there. The middle of its panorama is seen along +z: half a turn away.
    """
    mi = mitsuba()
    if (environment.radiance == environment.radiance[0, 0]).all():
        return {"type": "constant", "radiance": rgb(environment.radiance[0, 0])}
    rows = np.pad(environment.radiance, ((1, 1), (0, 0), (0, 0)), mode="edge")
    turned = mi.ScalarTransform4f().rotate([0, 1, 0], 180 + turn)
    return {"type": "envmap", "bitmap": mi.Bitmap((rows[1:] + rows[:-1]) / 2), "to_world": turned}


def _medium(scene: Scene, medium: Medium, g: float) -> Parts:
    """Return the media of a scene: the constant one in the box around its surfaces, or one box, not both."""
    assert not medium.height_extinction and bool(medium.extinction) != bool(medium.boxes)
    if medium.boxes:
        (box,) = medium.boxes
        centre, half = np.asarray(box.center), np.asarray(box.half_size)
        extinction, albedo = box.extinction, box.albedo
    else:
        centre, half = scene.origin, (scene.bounds[1] - scene.bounds[0]) / 2
        extinction, albedo = medium.extinction, medium.albedo
    place = np.diag((*np.asarray(half, np.float64), 1.0))
    place[:3, 3] = centre
    air = {"type": "homogeneous", "id": "air", "albedo": rgb(albedo), "sigma_t": float(extinction)}
    air["phase"] = {"type": "hg", "g": g} if g else {"type": "isotropic"}
    inside = {"type": "ref", "id": "air"}
    name = "box" if medium.boxes else "whole"
    cube = {"type": "cube", "to_world": transform(place), "bsdf": {"type": "null"}, "interior": inside}
    return {"air": air, name: cube}


@cache
def _layered() -> Any:
    """Return the class of glTF's dielectric, as a material of Mitsuba's."""
    mi = mitsuba()

    class Layered(mi.BSDF):  # type: ignore[misc, name-defined]
        """Mitsuba's `diffuse` below its `roughconductor`, mixed by Schlick's Fresnel at the half vector."""

        def __init__(self, properties: Any) -> None:
            super().__init__(properties)
            parts = {
                "type": "diffuse",
                "reflectance": rgb([properties[it] for it in ("red", "green", "blue")]),
            }
            self._diffuse = mi.load_dict(parts)
            parts = {"type": "roughconductor", "material": "none", "distribution": "ggx"}
            self._facets = mi.load_dict({**parts, "alpha": properties["alpha"]})
            side = mi.BSDFFlags.FrontSide
            self.m_components = [mi.BSDFFlags.DiffuseReflection | side, mi.BSDFFlags.GlossyReflection | side]
            self.m_flags = self.m_components[0] | self.m_components[1]

        def eval(self, context: Any, at: Any, to_light: Any, active: bool = True) -> Any:
            half = at.wi + to_light
            size = math.sqrt(half.x**2 + half.y**2 + half.z**2)
            if size < 1e-6:
                return mi.Color3f(0.0)
            cosine = abs(half.x * at.wi.x + half.y * at.wi.y + half.z * at.wi.z) / size
            fresnel = 0.04 + 0.96 * max(1.0 - cosine, 0.0) ** 5
            diffuse, facets = (it.eval(context, at, to_light) for it in (self._diffuse, self._facets))
            return diffuse * (1.0 - fresnel) + facets * fresnel

        def pdf(self, context: Any, at: Any, to_light: Any, active: bool = True) -> Any:
            return 0.5 * sum(it.pdf(context, at, to_light) for it in (self._diffuse, self._facets))

        def eval_pdf(self, context: Any, at: Any, to_light: Any, active: bool = True) -> Any:
            return self.eval(context, at, to_light), self.pdf(context, at, to_light)

        def sample(self, context: Any, at: Any, choice: float, u: Any, active: bool = True) -> Any:
            part, number = (self._diffuse, 0) if choice < 0.5 else (self._facets, 1)
            drawn, _ = part.sample(context, at, choice, u)
            drawn.pdf = self.pdf(context, at, drawn.wo) if drawn.pdf > 0.0 else 0.0
            if drawn.pdf <= 0.0:
                return drawn, mi.Color3f(0.0)
            drawn.eta, drawn.sampled_component, drawn.sampled_type = 1.0, number, self.m_components[number]
            return drawn, self.eval(context, at, drawn.wo) / drawn.pdf

    return Layered
