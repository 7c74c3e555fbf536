"""Rotations: conversions and their inverses, group laws, agreement with scipy."""

from __future__ import annotations

import numpy as np
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from analyze.geometry import rotations

component = st.floats(-1.8, 1.8, allow_nan=False)
vectors = (
    st.tuples(component, component, component)
    .map(np.array)
    .filter(lambda v: np.linalg.norm(v) < np.pi - 1e-3)
)
TOLERANCE_RAD = 1e-9


@given(vectors)
def test_vector_and_matrix_are_inverse(vector):
    matrix = rotations.matrix_from_vector(vector)
    assert np.allclose(matrix @ matrix.T, np.eye(3), atol=1e-12)
    assert np.allclose(rotations.vector_from_matrix(matrix), vector, atol=TOLERANCE_RAD)


@given(vectors)
def test_conversions_agree_with_scipy(vector):
    theirs = Rotation.from_rotvec(vector)
    assert np.allclose(rotations.matrix_from_vector(vector), theirs.as_matrix(), atol=1e-12)
    xyzw = theirs.as_quat(canonical=True)
    assert np.allclose(rotations.wxyz_from_matrix(theirs.as_matrix()), np.roll(xyzw, 1), atol=1e-9)


@given(vectors, vectors)
def test_product_of_quaternions_is_product_of_matrices(a, b):
    product = rotations.matrix_from_vector(a) @ rotations.matrix_from_vector(b)
    assert np.allclose(rotations.matrix_from_wxyz(rotations.wxyz_from_matrix(product)), product, atol=1e-12)


@given(vectors, vectors)
def test_relative_rotation_takes_one_to_the_other(a, b):
    R_a, R_b = rotations.matrix_from_vector(a), rotations.matrix_from_vector(b)
    assert np.allclose(R_a @ rotations.relative(R_a, R_b), R_b, atol=1e-12)
    assert np.isclose(
        rotations.angle_between(R_a, R_b), rotations.angle_between(R_b, R_a), atol=TOLERANCE_RAD
    )


def test_half_turns_survive_conversion_to_vectors():
    for axis in np.vstack([np.eye(3), np.ones(3) / np.sqrt(3)]):
        matrix = rotations.matrix_from_vector(np.pi * axis)
        assert np.allclose(
            rotations.matrix_from_vector(rotations.vector_from_matrix(matrix)), matrix, atol=1e-9
        )


def test_leading_axes_broadcast():
    vectors_many = np.random.default_rng(1).normal(size=(5, 7, 3)) * 0.5
    matrices = rotations.matrix_from_vector(vectors_many)
    assert matrices.shape == (5, 7, 3, 3)
    assert np.allclose(rotations.vector_from_matrix(matrices), vectors_many, atol=1e-12)
    assert rotations.wxyz_from_matrix(matrices).shape == (5, 7, 4)


def test_nearest_rotation_removes_noise():
    rng = np.random.default_rng(2)
    exact = rotations.matrix_from_vector(rng.normal(size=(4, 3)))
    mended = rotations.nearest_rotation(exact + 1e-6 * rng.normal(size=(4, 3, 3)))
    assert np.allclose(mended @ np.swapaxes(mended, -1, -2), np.eye(3), atol=1e-12)
    assert np.allclose(np.linalg.det(mended), 1.0)
    assert np.max(rotations.angle_between(exact, mended)) < 1e-5


def test_inverse_transform_undoes_the_transform():
    T = rotations.transform(
        rotations.matrix_from_vector(np.array([0.1, -0.4, 2.0])), np.array([1.0, 2.0, 3.0])
    )
    assert np.allclose(T @ rotations.inverse_transform(T), np.eye(4))
    points = np.array([[1.0, 0.0, 0.5], [0.0, 0.0, 0.0]])
    assert np.allclose(rotations.apply(rotations.inverse_transform(T), rotations.apply(T, points)), points)
