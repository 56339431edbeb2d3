"""Array textures whose layers arrive one by one, the same on both backends."""

from __future__ import annotations

from collections.abc import Callable, Collection, Hashable, Mapping, Sequence
from functools import partial

import numpy as np

from common.scene import Scene

from ..scene.textures import texels
from ..scene.textures.arrays import ARRAYS, ArrayPlan, ArrayTexture, plan_arrays
from ..scene.textures.reads import Use
from ..scene.textures.texels import Key
from . import placeholders
from .loading import Wanted
from .uploads import upload_bytes, upload_of

Layer = tuple[Hashable, int]
"""(array of the backend, layer): the destination of a request."""


class ArrayArrivals:
    """The layers in the materials' records: placeholders until a layer has arrived."""

    def __init__(self, scene: Scene, mended: bool, streams: bool, features: Collection[str]) -> None:
        """`features` are the optional features of the device."""
        self._scene, self._mended, self._streams = scene, mended, streams
        self._features = features
        self._uses: dict[Layer, list[Use]] = {}
        self.revision = 0
        """Counts the arrivals that changed `maps`."""

    def plan(self, uses: Sequence[Use], max_layers: int) -> ArrayPlan:
        """Return the assignment of textures to arrays."""
        if not self._streams:
            return plan_arrays(self._scene, uses, max_layers, features=self._features)
        width = ARRAYS - placeholders.UNITS
        return placeholders.with_placeholders(
            plan_arrays(self._scene, uses, max_layers, width, self._features)
        )

    def wanted(
        self,
        plan: ArrayPlan,
        uses: Sequence[Use],
        roles: Mapping[Key, str],
        ids: Mapping[ArrayTexture, Hashable],
    ) -> dict[Hashable, Wanted]:
        """Return the requests for all layers except placeholders."""
        self._plan = plan
        by_layer = placeholders.layer_uses(plan, uses)
        wanted: dict[Hashable, Wanted] = {}
        self._uses = {}
        for (number, layer), used in by_layer.items():
            array = plan.arrays[number]
            if array == placeholders.ARRAY:
                continue
            key, place = array.layers[layer], (ids[array], layer)
            make = partial(upload_of, self._scene, roles[key], key, self._mended, self._features)
            materials = [use.material for use in used]
            size = upload_bytes(self._scene, key)
            wanted[place] = Wanted(texels.name_of(self._scene, key), size, make, materials)
            self._uses[place] = used
        return wanted

    def begin(self, resident: Callable[[Hashable], bool]) -> np.ndarray:
        """Return the maps for the layers that are resident."""
        self.maps = self._plan.maps.copy() if self._streams else self._plan.maps
        for place, used in self._uses.items() if self._streams else ():
            if not resident(place):
                for use in used:
                    self.maps[use.material, use.role] = placeholders.of_role(use.role)
        return self.maps

    def arrive(self, place: Hashable) -> None:
        """Let materials refer to a layer that has arrived."""
        for use in self._uses.get(place, ()):  # type: ignore[call-overload]
            self.maps[use.material, use.role] = self._plan.maps[use.material, use.role]
        self.revision += 1


def array_name(scene: Scene, array: ArrayTexture) -> str:
    """Return the debug name of an array that is created before its layers arrive."""
    return texels.array_name(
        [
            texels.texels_of(scene, "placeholder", key) if key[0] == "neutral" else scene.images[key[1]]
            for key in array.layers
        ]
    )
