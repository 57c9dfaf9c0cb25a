"""Tangents of MikkTSpace, against closed forms and the definition, corner by corner."""

import numpy as np
import pytest

from aoprecalc.mesh.surface import shading_normals
from aoprecalc.mesh.tangents import corner_tangents
from shapes import ball, quad, quad_uvs, rotation, scene


def slow_tangents(corners, normals, uvs):
    """By the definition: for each corner the faces around its vertex that edges join, with UVs the same way round."""
    keys = [
        [tuple(np.concatenate(row)) for row in zip(*face, strict=True)]
        for face in zip(corners, normals, uvs, strict=True)
    ]
    areas = [np.linalg.det(uv[1:] - uv[0]) for uv in uvs]
    result = np.zeros((len(corners), 3, 4))
    for face in range(len(corners)):
        for corner in range(3):
            vertex, joined, pending = keys[face][corner], set(), [face]
            while pending:
                own = pending.pop()
                joined.add(own)
                for other in range(len(corners)):
                    shared = set(keys[own]) & set(keys[other])
                    if other not in joined and areas[other] * areas[face] > 0 and vertex in shared and len(shared) > 1:
                        pending.append(other)
            total = np.zeros(3)
            for own in sorted(joined):
                at = keys[own].index(vertex)
                dv1, dv2 = uvs[own][1:, 1] - uvs[own][0, 1]
                along = dv2 * (corners[own][1] - corners[own][0]) - dv1 * (corners[own][2] - corners[own][0])
                along *= np.sign(areas[own])
                normal = normals[own][at].astype(float)
                sides = [corners[own][(at + turn) % 3] - corners[own][at] for turn in (1, 2)]
                flat = [side - normal * (normal @ side) for side in (along, *sides)]
                units = [vector / np.linalg.norm(vector) for vector in flat]
                total += units[0] * np.arccos(np.clip(units[1] @ units[2], -1, 1))
            result[face, corner] = [*(total / np.linalg.norm(total)), np.sign(areas[face])]
    return result


@pytest.mark.parametrize("flip", [1, -1], ids=["as it is", "mirrored"])
def test_those_of_a_plane_run_along_u(flip):
    right, up = np.array([2.0, 0, 0]), np.array([0.0, 1, 1])
    positions, faces = quad((0, 0, 0), right, up)
    uvs = quad_uvs((0, 0), (1, 1)) * (flip, 1)
    tangents = corner_tangents(positions[faces], shading_normals(scene(positions, faces), "flat", 180), uvs)
    assert tangents[..., :3] == pytest.approx(np.broadcast_to((flip, 0, 0), (2, 3, 3)), abs=1e-6)
    assert (tangents[..., 3] == flip).all()
    bitangents = np.cross(np.cross(right, up) / np.sqrt(8), tangents[..., :3]) * tangents[..., 3:]
    assert bitangents == pytest.approx(np.broadcast_to(up / np.sqrt(2), (2, 3, 3)), abs=1e-6)


@pytest.mark.parametrize("seed", range(2))
def test_they_are_those_of_the_definition(seed):
    """A ball with UVs that run over it, are mirrored in one half, and have seams."""
    positions, faces = ball(1)
    positions = positions @ rotation(seed).T
    corners = positions[faces]
    uvs = corners[..., :2] * (1, 0.7) + 0.1 * corners[..., 2:]
    uvs[seed::3] += 2
    normals = shading_normals(scene(positions, faces), "smooth", 180)
    tangents = corner_tangents(corners, normals, uvs)
    expected = slow_tangents(corners, normals, uvs)
    assert tangents == pytest.approx(expected, abs=1e-5)
    assert {-1, 1} == set(tangents[..., 3].ravel().tolist())


def test_faces_without_area_in_the_uvs_take_those_of_neighbours():
    positions, faces = quad((0, 0, 0), (1, 0, 0), (0, 1, 0))
    normals, uvs = shading_normals(scene(positions, faces), "flat", 180), quad_uvs((0, 0), (1, 1))
    uvs[1, 2] = uvs[1, 1]
    tangents = corner_tangents(positions[faces], normals, uvs)
    assert tangents[1, :2] == pytest.approx(np.broadcast_to((1, 0, 0, 1), (2, 4)), abs=1e-6)
    assert np.linalg.norm(tangents[..., :3], axis=2) == pytest.approx(1, abs=1e-6)
    nowhere = corner_tangents(positions[faces], normals, np.zeros((2, 3, 2)))
    assert np.linalg.norm(nowhere[..., :3], axis=2) == pytest.approx(1, abs=1e-6)
    assert np.einsum("fcx,fcx->fc", nowhere[..., :3], normals) == pytest.approx(0, abs=1e-6)
