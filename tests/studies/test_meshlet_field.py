"""The field that studies of meshlets draw: its meshes, its meshlets, and where its objects are."""

from __future__ import annotations

import numpy as np

from chapters.ch06.meshlets.packing import unpack_words
from chapters.ch06.studies.meshlet_field import SPREAD, field_of
from chapters.ch06.studies.meshlet_field.shapes import all_meshes

COUNT = 24


def test_the_meshes_are_closed_and_face_outwards():
    for mesh in all_meshes():
        assert np.linalg.norm(mesh.positions, axis=1).max() < 1.0 + 1e-12
        _, joined = np.unique(
            mesh.positions.round(9), axis=0, return_inverse=True
        )  # the poles are several vertices
        edges = joined.reshape(-1)[mesh.indices[:, [0, 1, 1, 2, 2, 0]]].reshape(-1, 2)
        forth, back = {tuple(edge) for edge in edges}, {tuple(edge[::-1]) for edge in edges}
        assert forth == back and len(forth) == len(edges)
        a, b, c = mesh.positions[mesh.indices].transpose(1, 0, 2)
        assert np.einsum("ij,ij->", a, np.cross(b, c)) > 0
        assert (np.einsum("ij,ij->i", mesh.normals[mesh.indices[:, 0]], np.cross(b - a, c - a)) > 0).all()


def test_the_meshlets_of_the_field_are_its_triangles_and_objects_are_apart():
    field = field_of(COUNT)
    ends = field.meshlets["first_index"] + 3 * (field.meshlets["counts"] >> 8)
    assert (field.meshlets["first_index"] == np.append(0, ends[:-1])).all() and ends[-1] == len(field.indices)
    assert (unpack_words(field.meshlets, field.words) == field.indices).all()
    place = field.instances["world_from_object"][:, :, 3].astype(float)
    size = np.linalg.norm(field.instances["world_from_object"][:, 0, :3], axis=1)
    apart = np.linalg.norm(place[:, None] - place, axis=-1) + 9.0 * np.eye(COUNT)
    assert (apart > 0.9 * (size[:, None] + size)).all() and np.linalg.norm(place, axis=1).max() < SPREAD
