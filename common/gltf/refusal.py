"""The one exception of the glTF loader: what is wrong at which place of the file, and what to do."""

from __future__ import annotations

from typing import NoReturn

from common.errors import SceneError

REPAIR = "export it again or repair the file"


class Refusal(SceneError):
    """A fault at a `place` inside a document, such as `meshes[0].primitives[1].indices`.

    Functions below `load_scene` do not know the file's name; `load_scene` adds it, so that the text a user
    sees is one sentence: file, place, fault, advice.
    """

    def __init__(self, place: str, fault: str, advice: str = REPAIR) -> None:
        super().__init__(f"{place} {fault}; {advice}." if place else f"{fault}; {advice}.")


def refuse(place: str, fault: str, advice: str = REPAIR) -> NoReturn:
    """Raise the refusal of `place`."""
    raise Refusal(place, fault, advice)
