"""Edits of a scene: what changed gets a new revision, however the edit ends."""

from __future__ import annotations

import pytest

from common.scene import Change, Material
from tests.support.scenes import quad_scene


def test_an_edit_that_ends_in_an_error_shows_what_it_did_until_then():
    """The new material is in the scene, and renderers that are not told would show it with some later edit."""
    scene = quad_scene()
    before = dict(scene.revision)

    def edit():
        with scene.edit() as change:
            change.set_material(0, Material(unlit=True))
            change.set_visible(99, False)

    with pytest.raises(IndexError):
        edit()
    assert scene.materials[0].unlit
    assert scene.revision == before | {Change.MATERIALS: before[Change.MATERIALS] + 1}
