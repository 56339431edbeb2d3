"""One sphere drawn by Mitsuba 3, a path tracer written by others: the radiance along given rays, with its noise.

Mitsuba's `scalar_rgb` computes in float32 on the CPU and shares no code with this project. Its `roughconductor` has
the GGX distribution and the separable Smith masking that glTF names, and with the material "none" it reflects all that
meets its facets; its `diffuse` is Lambert's.
"""

from __future__ import annotations

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from numpy.typing import ArrayLike, NDArray

from common.environment import Environment

Float64 = NDArray[np.float64]
Emitter = dict[str, Any]


@dataclass(frozen=True, eq=False)
class Measured:
    """What Mitsuba says: `batches` (B, rays, 3), estimates of the same radiance from independent random numbers."""

    batches: Float64

    @property
    def mean(self) -> Float64:
        """The best estimate (rays, 3)."""
        return self.batches.mean(axis=0)

    @property
    def error(self) -> Float64:
        """The standard error of `mean` (rays, 3)."""
        return standard_error(self.batches)

    @property
    def total_error(self) -> Float64:
        """The standard error (3) of the mean over all rays."""
        return standard_error(self.batches.mean(axis=1))


def standard_error(batches: Float64) -> Float64:
    """Return the standard error of the mean over the first axis."""
    return batches.std(axis=0, ddof=1) / np.sqrt(len(batches))


def mitsuba() -> Any:
    """Return the package, set to its plain CPU variant."""
    import mitsuba

    mitsuba.set_variant("scalar_rgb")
    return mitsuba


def metal(alpha: float) -> dict[str, Any]:
    """Return a conductor of facets that reflect everything; perfectly smooth where `alpha` is 0."""
    if alpha == 0:
        return {"type": "conductor", "material": "none"}
    return {"type": "roughconductor", "material": "none", "distribution": "ggx", "alpha": alpha}


def white() -> dict[str, Any]:
    """Return a diffuse surface that reflects everything."""
    return {"type": "diffuse", "reflectance": {"type": "rgb", "value": 1.0}}


def sunlight(direction: ArrayLike, illuminance: Sequence[float]) -> Emitter:
    """Return light that travels in `direction` and gives a surface facing it `illuminance` (3) lux."""
    travels = [float(x) for x in np.asarray(direction, np.float64)]
    return {
        "type": "directional",
        "direction": travels,
        "irradiance": {"type": "rgb", "value": list(illuminance)},
    }


def uniform(radiance: Sequence[float]) -> Emitter:
    """Return `radiance` (3) nits from everywhere."""
    return {"type": "constant", "radiance": {"type": "rgb", "value": list(radiance)}}


def panorama(environment: Environment) -> Emitter:
    """Return an environment as Mitsuba holds it.

    It puts the first and last row of a picture on the poles, where ours begin half a pixel from them: so it gets one
    row more, each the mean of the two that meet there. And the middle of its panorama is seen along +z: half a turn
    away.
    """
    mi = mitsuba()
    rows = np.pad(environment.radiance, ((1, 1), (0, 0), (0, 0)), mode="edge")
    half_turn = mi.ScalarTransform4f().rotate([0, 1, 0], 180)
    return {"type": "envmap", "bitmap": mi.Bitmap((rows[1:] + rows[:-1]) / 2), "to_world": half_turn}


class Rays:
    """Rays through the scene, each of which measures radiance: `eye` (3), unit `directions` (rays, 3)."""

    def __init__(self, eye: ArrayLike, directions: ArrayLike) -> None:
        origin = [float(x) for x in np.asarray(eye, np.float64)]
        box = {"type": "box"}  # no sample counts for its neighbour
        film = {"type": "hdrfilm", "width": 1, "height": 1, "rfilter": box}
        towards = np.asarray(directions, np.float64)
        sensors: dict[str, Any] = {
            f"ray{index}": {
                "type": "radiancemeter",
                "origin": origin,
                "direction": [float(x) for x in d],
                "film": film,
            }
            for index, d in enumerate(towards)
        }
        wide = {**film, "width": len(towards), "component_format": "float32", "pixel_format": "rgb"}
        self._sensor = mitsuba().load_dict({"type": "batch", "film": wide, **sensors})

    def measure(self, bsdf: dict[str, Any], emitter: Emitter, samples: int, batches: int = 32) -> Measured:
        """Return the light that a unit sphere about the origin sends along every ray, from `batches` of `samples`.

        Each sample takes one direction from the light and one from the surface, weighted by their densities (multiple
        importance sampling). A sphere does not shadow itself, so one reflection is all there is.
        """
        mi = mitsuba()
        integrator = {"type": "direct", "emitter_samples": 1, "bsdf_samples": 1}
        sphere = {"type": "sphere", "bsdf": bsdf}
        scene = mi.load_dict(
            {"type": "scene", "integrator": integrator, "sphere": sphere, "emitter": emitter}
        )
        seen = [
            np.array(mi.render(scene, sensor=self._sensor, spp=samples, seed=seed))[0]
            for seed in range(batches)
        ]
        return Measured(np.array(seen, np.float64))
