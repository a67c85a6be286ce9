# Copyright 2026 tp_controller contributors
#
# Licensed under the Apache License, Version 2.0 (the "License");
# you may not use this file except in compliance with the License.
# You may obtain a copy of the License at
#
#     http://www.apache.org/licenses/LICENSE-2.0
#
# Unless required by applicable law or agreed to in writing, software
# distributed under the License is distributed on an "AS IS" BASIS,
# WITHOUT WARRANTIES OR CONDITIONS OF ANY KIND, either express or implied.
# See the License for the specific language governing permissions and
# limitations under the License.

"""
What one level does within bounds: a quadratic program, regularised.

    minimise    Σ s_i² (a_i − a°_i)²    subject to    lower ≤ A a ≤ upper

Directions with s = 0 cost nothing, so the answer may lie in a corner of the bounds, and jump to
another corner in the next cycle. Therefore no direction is softer than the regularisation μ: what
is missing to μ² pulls towards a°, and in a second program to the answer of the first, which takes
nearly all of the bias away again.

The bounds, and the levels above that A knows of, are planes to the program, but curved in truth.
Newton's method would add their curvature to s², each weighted with its multiplier, and that of
the level itself with what it misses (Nocedal and Wright, Numerical Optimization, 18.1: the
Hessian of the Lagrangian). A velocity that is held for a period T overshoots where T times that
is larger than s²: where the level pushes hard and what is soft turns quickly, as beside a
singularity, the robot would swing from side to side. The curvature is not known; the second
program takes κ T (‖misses‖ + ‖multipliers‖) for it, and what is missing to that pulls back.

The share of it that belongs to levels above pulls towards rest, as Levenberg and Marquardt do, so
that where the robot stands still nothing is biased. A row turns the faster the shorter it is, and
counts with its multiplier per length. What belongs to limits of the joints pulls towards a = 0:
towards the velocity there was, cut off at the limits. It may be fast there, for limits do not
curve.
"""

import math

import numpy as np
from tp_controller.solver.null_space import REACTION
from tp_controller.solver.qp import nearest_point

# Share of the multipliers in the curvature, as `REACTION` is that of what is missed.
PUSHING = 16.0
# For an exact answer the regularisation shrinks, by a factor and in shares of the largest
# stiffness, from here to where rounding would take over, and stays there until nothing changes.
EXACT_REGULARISATION = np.array([1e-3, 1e-8])
EXACT_DECREASE = 0.1
EXACT_REPETITIONS = 20
CONVERGED = 1e-12


def regularised(stiffness, target, A, lower, upper, regularisation, period, lengths=(),
                rest=None):
    """
    Return the a that minimises Σ stiffness_i (a_i − target_i)² within bounds.

    Parameters
    ----------
    stiffness, target : ndarray (k,)
        s² and a°.
    A : ndarray (r, k)
        Rows that are bounded.
    lower, upper : ndarray (r,)
        Their bounds, infinite where there is none. Some a is within them.
    regularisation : float
        μ²; 0: exact.
    period : float
        T, how long the velocity will be held [s].
    lengths : array_like (r',)
        Of the last rows of A, which belong to levels above, where they were short before they
        were made 1 long; else 1. The first rows are limits of joints.
    rest : ndarray (k,), optional
        Where the robot stands still; not needed where all rows are limits of joints.

    Returns
    -------
    a : ndarray (k,)
    multipliers : ndarray (r,)
        Positive at upper bounds, negative at lower ones, else zero.
    curvature : float
        What no direction was softer than on account of the period.

    """
    if regularisation == 0.0:
        return *exact(stiffness, target, A, lower, upper), 0.0
    stiff = np.maximum(stiffness, regularisation)
    unit = _unit(stiff)
    first = _nearest(stiff, target, A, lower, upper, unit)
    if first is None:
        return *_no_motion(A), 0.0
    a, multipliers = first
    missed = math.sqrt(stiffness.dot((a - target) ** 2))
    joints = len(A) - len(lengths)
    limits, rows = multipliers[:joints], multipliers[joints:] / lengths
    of_rows = period * PUSHING * math.sqrt(rows.dot(rows))
    curvature = of_rows + period * (REACTION * missed + PUSHING * math.sqrt(limits.dot(limits)))
    stiffer = np.maximum(stiff, curvature)
    if not np.count_nonzero(stiffer > stiffness):
        return a, multipliers, curvature
    centre = stiffness * target + (stiff - stiffness) * a
    if of_rows > 0.0:
        centre += (stiffer - stiff) * (of_rows / curvature) * rest
    centre /= stiffer
    return *(_nearest(stiffer, centre, A, lower, upper, unit) or first), curvature


def exact(stiffness, target, A, lower, upper):
    """Return what `regularised` does as the regularisation goes to zero."""
    unit = _unit(stiffness)
    missing, least = unit * EXACT_REGULARISATION
    answer = _nearest(np.maximum(stiffness, missing), target, A, lower, upper, unit)
    if answer is None:
        return _no_motion(A)
    if stiffness.min() >= missing:
        return answer
    for _ in range(EXACT_REPETITIONS):
        before, missing = answer, max(missing * EXACT_DECREASE, least)
        stiff = np.maximum(stiffness, missing)
        centre = (stiffness * target + (stiff - stiffness) * before[0]) / stiff
        answer = _nearest(stiff, centre, A, lower, upper, unit)
        if answer is None:
            # Rounding: what was found with more regularisation is as near as it gets.
            return before
        change = answer[0] - before[0]
        if change.dot(change) <= CONVERGED ** 2 * (1.0 + answer[0].dot(answer[0])):
            break
    return answer


def _unit(stiffness):
    """Return the largest stiffness: in it a program is the same whatever units the rows have."""
    return stiffness[stiffness.argmax()] or 1.0


def _nearest(stiffness, centre, A, lower, upper, unit):
    """Return the a nearest to a centre, and its multipliers; None where rounding forbids it."""
    root = np.sqrt(stiffness / unit)
    found = nearest_point(root * centre, np.divide(A, root, order='C'), lower, upper)
    if found is None:
        return None
    z, multipliers = found
    return z / root, unit * multipliers


def _no_motion(A):
    """Return zero for a and its multipliers."""
    rows, columns = A.shape
    return np.zeros(columns), np.zeros(rows)
