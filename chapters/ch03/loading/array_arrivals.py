"""Array textures whose layers arrive one after the other: on either backend the same."""

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
"""An array, as its backend calls it, and the number of a layer: what a request asks for."""


class ArrayArrivals:
    """Which layers the materials' records name: where there are placeholders, those until a layer is there."""

    def __init__(self, scene: Scene, mended: bool, streams: bool, features: Collection[str]) -> None:
        """`features` are the optional ones of the device."""
        self._scene, self._mended, self._streams = scene, mended, streams
        self._features = features
        self._uses: dict[Layer, list[Use]] = {}
        self.revision = 0
        """Grows whenever `maps` change by an arrival."""

    def plan(self, found: Sequence[Use], max_layers: int) -> ArrayPlan:
        """Return which textures lie together."""
        if not self._streams:
            return plan_arrays(self._scene, found, max_layers, features=self._features)
        width = ARRAYS - placeholders.UNITS
        return placeholders.with_placeholders(
            plan_arrays(self._scene, found, max_layers, width, self._features)
        )

    def wanted(
        self,
        plan: ArrayPlan,
        found: Sequence[Use],
        roles: Mapping[Key, str],
        ids: Mapping[ArrayTexture, Hashable],
    ) -> dict[Hashable, Wanted]:
        """Return the requests for all layers, but those that placeholders are."""
        self._plan = plan
        by_layer = placeholders.layer_uses(plan, found)
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
        """Return the maps as they are with what is there already."""
        self.maps = self._plan.maps.copy() if self._streams else self._plan.maps
        for place, used in self._uses.items() if self._streams else ():
            if not resident(place):
                for use in used:
                    self.maps[use.material, use.role] = placeholders.of_role(use.role)
        return self.maps

    def arrive(self, place: Hashable) -> None:
        """Let the materials name a layer that has arrived."""
        for use in self._uses.get(place, ()):  # type: ignore[call-overload]
            self.maps[use.material, use.role] = self._plan.maps[use.material, use.role]
        self.revision += 1


def array_name(scene: Scene, array: ArrayTexture) -> str:
    """Return the name of an array whose layers are still to come."""
    return texels.array_name(
        [
            texels.texels_of(scene, "placeholder", key) if key[0] == "neutral" else scene.images[key[1]]
            for key in array.layers
        ]
    )
