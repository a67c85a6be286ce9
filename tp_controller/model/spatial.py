# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Rotations, poses and angles.

Quaternions are ordered ``xyzw``; poses are 4×4 homogeneous matrices ``T_a_b`` (frame b
expressed in frame a), rotations 3×3 matrices ``R_a_b``; angles are in radians.
"""

import math
from typing import TypeAlias, TypeVar

import numpy as np
from numpy.typing import ArrayLike, NDArray
import pinocchio

Array: TypeAlias = NDArray[np.float64]
AnyArray = TypeVar('AnyArray', bound=np.ndarray)
# Tolerance of the norm of a quaternion: numbers typed with two digits pass, an all-zero quaternion
# or an angle triple does not.
QUATERNION_TOLERANCE = 0.05
ROTATION_TOLERANCE = 1e-3
IDENTITY = np.eye(3)
# Within this angle of half a turn both directions are equally short, and noise alone would select
# one of them [rad].
HALF_TURN_BAND = 0.1
# Angle below which terms of the fourth order are rounding errors [rad].
SMALL_ANGLE = 1e-4
# [a]× of the unit vectors, so that a.dot(CROSS) is [a]× of any vector a.
CROSS = np.zeros((3, 3, 3))
for _i, _j, _k in ((0, 1, 2), (1, 2, 0), (2, 0, 1)):
    CROSS[_i, _j, _k], CROSS[_i, _k, _j] = 1.0, -1.0


def wrap_angle(angle: Array) -> Array:
    """
    Return angles [rad] in the interval [-π, π).

    Parameters
    ----------
    angle : ndarray
        Any shape.

    Returns
    -------
    ndarray
        The same shape.

    """
    return (angle + math.pi) % (2.0 * math.pi) - math.pi


def rotation_vector(R: Array) -> Array:
    """
    Return the rotation vector (log map) of a rotation matrix.

    Parameters
    ----------
    R : ndarray (3, 3)
        Rotation matrix.

    Returns
    -------
    ndarray (3,)
        Axis times angle [rad], angle in [0, π].

    """
    return pinocchio.log3(R)


def rotation_from_vector(vector: ArrayLike) -> Array:
    """Return the rotation matrix (3, 3) of a rotation vector (3,) [rad]."""
    return pinocchio.exp3(np.asarray(vector, dtype=float))


def vector_rate_matrix(vector: Array) -> Array:
    """
    Return the matrix (3, 3) from an angular velocity to the rate of a rotation vector (3,).

    It is the inverse left Jacobian, 1 − ½ [r]× + (1 − ½ θ cot ½ θ) / θ² [r]×² with θ = ‖r‖ < 2 π;
    the angular velocity is in the axes of the vector.
    """
    angle, cross_matrix = math.sqrt(vector.dot(vector)), skew(vector)
    half = 0.5 * angle
    share = (1.0 - half / math.tan(half)) / angle ** 2 if angle > SMALL_ANGLE else 1.0 / 12.0
    return IDENTITY - 0.5 * cross_matrix + share * cross_matrix.dot(cross_matrix)


def skew(vector: Array) -> Array:
    """Return the matrix [a]× (3, 3) of a vector (3,): [a]× b = a × b."""
    return pinocchio.skew(vector)


def skews(vectors: Array) -> Array:
    """Return the matrices [a]× (…, 3, 3) of vectors (…, 3)."""
    return vectors.dot(CROSS)


def cross(a: Array, b: Array) -> Array:
    """Return the cross products of rows (m, 3), several times as fast as numpy for a few rows."""
    return (skews(a) @ b[:, :, np.newaxis])[:, :, 0]


def shorter_rotation(vector: Array, previous: Array | None) -> Array:
    """
    Return the rotation vector to follow, steady near half a turn.

    Up to half a turn the log map gives the shorter rotation. At half a turn both directions are
    equally long. Measurement noise would flip between them, and the robot would not move at all.
    Within `HALF_TURN_BAND` of it the previous direction is kept.

    Parameters
    ----------
    vector : ndarray (3,)
        Rotation vector from the log map [rad].
    previous : ndarray (3,) or None
        Previous rotation vector.

    Returns
    -------
    ndarray (3,)
        `vector`, or the same rotation in the other direction.

    """
    if previous is None or vector.dot(previous) >= 0.0:
        return vector
    angle = math.sqrt(vector.dot(vector))
    if angle < math.pi - HALF_TURN_BAND:
        return vector
    return vector * ((angle - 2.0 * math.pi) / angle)


def rotation_from_quaternion(quat_xyzw: ArrayLike) -> Array:
    """
    Return the rotation matrix of a quaternion.

    Parameters
    ----------
    quat_xyzw : ndarray (4,)
        Norm within `QUATERNION_TOLERANCE` of 1; it is normalised.

    Returns
    -------
    ndarray (3, 3)

    Raises
    ------
    ValueError
        The norm is not near 1.

    """
    norm = float(np.linalg.norm(quat_xyzw))
    if not abs(norm - 1.0) <= QUATERNION_TOLERANCE:
        raise ValueError(f'a quaternion (x, y, z, w) has norm 1, this one has {norm:.3g}')
    return pinocchio.Quaternion(np.asarray(quat_xyzw, float) / norm).toRotationMatrix()


def quaternion_from_rotation(R: Array) -> Array:
    """
    Return the quaternion of a rotation matrix, with w ≥ 0 (lecture 3.3, slip corrected).

    Parameters
    ----------
    R : ndarray (3, 3)
        Rotation matrix.

    Returns
    -------
    ndarray (4,)
        Ordered x, y, z, w; w is not negative.

    """
    quat_xyzw = pinocchio.Quaternion(np.ascontiguousarray(R)).coeffs()
    return -quat_xyzw if quat_xyzw[3] < 0.0 else quat_xyzw


def check_rotation(R: Array) -> Array:
    """
    Return a rotation matrix if it is valid.

    Raises
    ------
    ValueError
        R is not orthonormal, or mirrors.

    """
    x, y, z = R.T.tolist()
    mirrors = (x[1] * y[2] - x[2] * y[1]) * z[0] + (x[2] * y[0] - x[0] * y[2]) * z[1] \
        + (x[0] * y[1] - x[1] * y[0]) * z[2] < 0.0
    if mirrors or np.abs(R.dot(R.T) - IDENTITY).max() > ROTATION_TOLERANCE:
        raise ValueError('the 3×3 part is not a rotation matrix (R Rᵀ = 1, det R = 1)')
    return R


def are_rotations(R: Array) -> bool:
    """Return whether all of several matrices (count, 3, 3) are valid; see `check_rotation`."""
    deviations = np.abs(R @ R.transpose(0, 2, 1) - IDENTITY)
    return bool((deviations <= ROTATION_TOLERANCE).all() and (np.linalg.det(R) > 0.0).all())


def rotation_from_rpy(roll: float, pitch: float, yaw: float) -> Array:
    """Return the 3×3 rotation matrix Rz(yaw) Ry(pitch) Rx(roll), angles in radians (URDF)."""
    return pinocchio.rpy.rpyToMatrix(float(roll), float(pitch), float(yaw))


def pose(R: Array, p: ArrayLike) -> Array:
    """Return the 4×4 homogeneous matrix of a rotation (3, 3) and a position (3,) [m]."""
    T = np.eye(4)
    T[:3, :3] = R
    T[:3, 3] = p
    return T


def inverse_pose(T: Array) -> Array:
    """Return the inverse of a 4×4 homogeneous matrix."""
    R_T = T[:3, :3].T
    return pose(R_T, -R_T.dot(T[:3, 3]))


def read_only(array: AnyArray) -> AnyArray:
    """Return the array, made read-only."""
    array.setflags(write=False)
    return array
