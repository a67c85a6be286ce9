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
Velocity limits met level by level: what one joint cannot do, the others take over.

Let ζ₁ be the velocity that the recursion of `tp_controller.solver.solve` has found for the first
level, without bounds. x begins as near to it as the bounds allow. Then the levels carry out what
they want as well as the bounds let them, from the first to the last, as in the recursion: level k
moves x in the coordinates a of its own singular directions Q = Z V, which do not move the levels
above. With a° = J̄^# (v_k − J_k x) for the step that it would like best it solves ::

    minimise    Σ s_i² (a_i − a°_i)²
    subject to  lower ≤ x + Q a ≤ upper,  and the rows of the levels with bounds above,

regularised as `tp_controller.solver.regularized_qp` says. If a° fits, it is the answer, so nothing
jumps where the bounds begin to matter; but where a level above pushes against its bounds, soft
directions wait, as they do in its own program. No level knows of the levels below it, and each
moves the joints no farther than it needs. All programs are strictly convex and small, and x itself
always fits.
"""

import math

import numpy as np
from tp_controller.solver.level import identity
from tp_controller.solver.null_space import REACTION
from tp_controller.solver.qp import nearest_point, nearest_point_if_any
from tp_controller.solver.regularized_qp import exact, regularised
from tp_controller.solver.solution import Stage

# What a velocity may exceed a bound by and be cut off, relative to its size.
ROUNDING = 1e-12
# What a row may be off its bound.
FEASIBLE = 1e-11
# A row of length 1 counts as taken by the levels above where so much of it is left.
NEGLIGIBLE = 1e-9
# Speed along a row of length 1 from which on it counts as one that asks for motion [rad/s].
ASKING = 0.02
# A row that is shorter than this counts as one that turns the faster for it [unit/rad].
SHORT = 0.2
TINY = 1e-30
# Pushes a joint with a multiplier the last bit onto its bound.
PUSH = 1e6


def redistribute(levels, unbounded, start, bounds, shared_bounds, regularisation, period,
                 row_damping):
    """
    Carry out levels within bounds.

    Parameters
    ----------
    levels : list of Level
        The highest priority first.
    unbounded : list of Stage
        What the recursion made of them.
    start : ndarray (n, n)
        W^{-1/2}, the diagonal matrix that turns weights into a change of variables.
    bounds : (ndarray (n,), ndarray (n,))
        Lower and upper bounds on the velocities.
    shared_bounds : (ndarray (n,), ndarray (n,))
        The same for what comes after the first level that wants a velocity.
    regularisation : float
        μ, in the units of J; 0: exact.
    period : float
        How long the velocity will be held [s].
    row_damping : float
        Share of a row that is left by the levels above it, below which its level asks for less;
        0: never.

    Returns
    -------
    velocity : ndarray (n,)
        Within the bounds, exactly.
    stages : list of Stage
        For each level.

    """
    nearest = next((stage.velocity for stage in unbounded if stage.projection is not None),
                   np.zeros(len(start)))
    cascade = _Cascade(nearest, bounds, start, regularisation, period, row_damping)
    stages, first = [], True
    for level, stage in zip(levels, unbounded):
        if level.v is None:
            stages.append(cascade.keep(level))
            continue
        carry_out = cascade.scale if level.mode == 'scale' else cascade.carry_out
        stages.append(carry_out(level, stage))
        if first and shared_bounds is not bounds:
            cascade.narrow(shared_bounds)
        first = False
    cascade.finish(unbounded)
    return cascade.x, stages


def within(x, lower, upper):
    """Return x (n,) without what rounding put beyond its bounds; None if it is farther off."""
    clipped = clip(x, lower, upper)
    excess = clipped - x
    return clipped if excess.dot(excess) <= ROUNDING ** 2 * x.dot(x) else None


def meets(level, x):
    """Say whether velocities x (n,) are within the bounds of a level."""
    values = level.J.dot(x)
    return not (np.count_nonzero(values > level.upper + FEASIBLE)
                or np.count_nonzero(values < level.lower - FEASIBLE))


def clip(x, lower, upper):
    """Return x (n,) within bounds."""
    return np.minimum(np.maximum(x, lower), upper)


class _Cascade:
    """The velocity x that the levels so far agree on, what they left free, and what bounds it."""

    def __init__(self, x, bounds, start, regularisation, period, row_damping):
        self.x = clip(x, *bounds)
        self._lower, self._upper = bounds
        self._start = start
        self._Z = start
        self._rows = np.zeros((0, len(start)))
        self._row_lower = self._row_upper = self._row_units = np.zeros(0)
        self._regularisation, self._period = regularisation * regularisation, period
        self._row_damping = row_damping
        # The most curvature of what has pushed so far.
        self._curvature = 0.0

    def narrow(self, bounds):
        """Give the levels from here on less room; where x uses more already, just that."""
        lower, upper = bounds
        self._lower = np.minimum(np.maximum(self._lower, lower), self.x)
        self._upper = np.maximum(np.minimum(self._upper, upper), self.x)

    def carry_out(self, level, stage):
        """Come as near to what a level wants as the bounds allow; return its `Stage`."""
        projection = stage.projection
        aim = self._aim(level, stage)
        self._Z = projection.remaining
        multipliers = self._approach(projection, aim)
        return Stage(self.x, projection, *multipliers)

    def _aim(self, level, stage):
        """Return the step (rank,) from x to where a level wants to be."""
        projection = stage.projection
        if self._Z is self._start:
            # The first level is to get what it gets without bounds.
            return projection.U.T.dot(level.J.dot(stage.velocity - self.x)) / projection.s
        return projection.aim(level.v - level.J.dot(self.x))

    def _take(self, x):
        """Take a velocity if it is within all bounds; say whether it is."""
        x = within(x, self._lower, self._upper)
        if x is None:
            return False
        if len(self._rows):
            values = self._rows.dot(x)
            if np.count_nonzero(values > self._row_upper + FEASIBLE) \
                    or np.count_nonzero(values < self._row_lower - FEASIBLE):
                return False
        self.x = x
        return True

    def _approach(self, projection, aim):
        """Move x along its directions as near to an aim (rank,) as bounds allow."""
        if not len(aim):
            return ()
        target, stiffness = np.zeros((2, projection.directions.shape[1]))
        target[:len(aim)] = self._slowed(aim, projection.s)
        if self._take(self.x + projection.directions.dot(target)):
            return ()
        stiffness[:len(aim)] = projection.s * projection.s
        return self._solve(projection.directions, stiffness, target)

    def _slowed(self, aim, s):
        """Return a step (rank,) whose soft directions wait for the levels above that push."""
        squares = s * s
        if squares[-1] >= self._curvature:
            return aim
        return aim * (squares / np.maximum(squares, self._curvature))

    def scale(self, level, stage):
        """Keep the direction of a level and slow it as little as the bounds allow."""
        projection = stage.projection
        U_T, s, rank = projection.U.T, projection.s, projection.rank
        wanted = U_T.dot(level.J.dot(self.x)) + s * self._aim(level, stage)
        # The way to the wanted velocity begins at rest, or as near to it as the bounds allow.
        if self._Z is self._start:
            self.x = clip(np.zeros(len(self.x)), self._lower, self._upper)
        self._approach(projection, -U_T.dot(level.J.dot(self.x)) / s)
        wanted -= U_T.dot(level.J.dot(self.x))
        way = wanted / s
        self._Z = projection.remaining
        motion = projection.directions[:, :rank].dot(way)
        if self._take(self.x + motion):
            return Stage(self.x, projection)
        # One direction instead of all of them, as long as the way.
        length = math.sqrt(way.dot(way))
        directions = np.column_stack([motion / length, projection.directions[:, rank:]])
        stiffness, target = np.zeros((2, directions.shape[1]))
        stiffness[0], target[0] = wanted.dot(wanted) / (length * length), length
        multipliers = self._solve(directions, stiffness, target)
        return Stage(self.x, projection, *multipliers)

    def keep(self, level):
        """Meet the bounds of a level, as far as they can be, and hold on to that below it."""
        # As long as 1 each, or tolerances would mean something else for every row.
        lengths = np.sqrt((level.J * level.J).sum(axis=1))
        lengths[lengths == 0.0] = 1.0
        rows = level.J / lengths[:, np.newaxis]
        lower, upper = level.lower / lengths, level.upper / lengths
        self._row_units = np.concatenate([self._row_units, lengths])
        values = rows.dot(self.x)
        multipliers = ()
        if np.count_nonzero(values > upper) or np.count_nonzero(values < lower):
            # How many rows ask for motion; one that only begins to counts less.
            asked = np.maximum(lower, 0.0) + np.maximum(-upper, 0.0)
            many = max(np.minimum(asked / ASKING, 1.0).sum(), 1.0)
            multipliers = self._meet(rows, lower - values, upper - values, lengths, many)
            values = rows.dot(self.x)
            lower, upper = np.minimum(lower, values), np.maximum(upper, values)
        self._rows = np.concatenate([self._rows, rows])
        self._row_lower = np.concatenate([self._row_lower, lower])
        self._row_upper = np.concatenate([self._row_upper, upper])
        return Stage(self.x, None, *multipliers)

    def _meet(self, rows, lower, upper, weights, many):
        """
        Move x to within bounds on rows, as far as there is a way.

        Parameters
        ----------
        rows : ndarray (r, n)
            What is bounded.
        lower, upper : ndarray (r,)
            Bounds on what it gains.
        weights : ndarray (r,)
            Of what is missing in the end, before it is squared.
        many : float
            How many rows ask for motion.

        Returns
        -------
        tuple
            Multipliers of joints and rows where the bounds cannot be met, else nothing.

        """
        Z_rows = rows.dot(self._Z)
        # What is left of a row that the levels above have taken is rounding, no way to anywhere.
        Z_rows[(Z_rows * Z_rows).sum(axis=1) < NEGLIGIBLE * NEGLIGIBLE] = 0.0
        if self._row_damping and self._Z is not self._start:
            lower, upper = self._damped(rows, Z_rows, lower, upper)
        # Mostly there is a way, and one program finds it.
        found = nearest_point_if_any(np.zeros(self._Z.shape[1]),
                                     *self._program(self._Z, Z_rows, lower, upper))
        if found is None:
            return self._violate_least(Z_rows, lower, upper, weights, many)
        self._move(self._Z, *found)
        return ()

    def _damped(self, rows, Z_rows, lower, upper):
        """
        Ask for less where the levels above have left hardly a way to move.

        Parameters
        ----------
        rows, Z_rows : ndarray (r, n), (r, k)
            What is bounded, and the same in the coordinates that are left.
        lower, upper : ndarray (r,)
            Bounds on what they gain.

        Returns
        -------
        lower, upper : ndarray (r,)

        """
        whole = rows.dot(self._start)
        squares = (Z_rows * Z_rows).sum(axis=1) / np.maximum((whole * whole).sum(axis=1), TINY)
        # s² / (s² + λ² (1 − (s/ε)²)) with λ = ε.
        share = np.minimum(squares / (self._row_damping * self._row_damping), 1.0)
        return (share * np.maximum(lower, 0.0) + np.minimum(lower, 0.0),
                share * np.minimum(upper, 0.0) + np.maximum(upper, 0.0))

    def _violate_least(self, Z_rows, lower, upper, weights, many):
        """Move x to where rows violate their bounds least; return the multipliers."""
        count, width = Z_rows.shape
        # One more variable for each row: what is missing to its bound.
        directions = np.hstack([self._Z, np.zeros((len(self._Z), count))])
        slack_rows = np.hstack([Z_rows, np.eye(count)])
        # Many rows about the same must not push harder than one.
        soft = many * self._regularisation
        stiffness = np.concatenate([np.full(width, soft), weights * weights])
        # The rest is what would be best without these bounds, whatever the levels below want.
        target = np.concatenate([self._to_rest(self._Z), np.zeros(count)])
        program = self._program(directions, slack_rows, lower, upper)
        found = exact(stiffness, target, *program)
        # As in `programs.regularised`: what misses much turns quickly.
        missed = weights * found[0][width:]
        curvature = self._period * REACTION * math.sqrt(many * missed.dot(missed))
        if 0.0 < soft < curvature:
            stiffness[:width] = curvature
            found = exact(stiffness, target, *program)
        return self._move(directions, *found)

    def _to_rest(self, Z):
        """Return the step (k,) along Z to the smallest velocity."""
        cost = np.diagonal(self._start)
        return -Z.T.dot(self.x / (cost * cost))

    def finish(self, unbounded):
        """Among what is left take the smallest velocity."""
        projections = [stage.projection for stage in unbounded if stage.projection is not None]
        if projections and projections[-1].level.J is identity(len(self.x)):
            return
        Z = self._Z
        if any(projection.released for projection in projections):
            Z = self._unreleased(projections)
        if not Z.shape[1]:
            return
        aim = self._to_rest(Z)
        if not aim.any() or self._take(self.x + Z.dot(aim)):
            return
        found = nearest_point(aim, *self._program(Z.copy()))
        if found is not None:
            self._move(Z, *found)

    def _unreleased(self, projections):
        """Return a basis of what moves no level at all, not even a weak direction of it."""
        Z = self._start
        for projection in projections:
            J_bar = projection.level.J.dot(Z)
            if min(J_bar.shape):
                _, s, V_T = np.linalg.svd(J_bar)
                Z = Z.dot(V_T[int(np.count_nonzero(s > projection.tolerance)):].T)
        return Z

    def _solve(self, directions, stiffness, target):
        """Move x within its bounds as a level would like best; return the multipliers."""
        lengths, rest = (), None
        if len(self._rows):
            lengths, rest = np.minimum(self._row_units / SHORT, 1.0), self._to_rest(directions)
        a, multipliers, curvature = regularised(
            stiffness, target, *self._program(directions), self._regularisation, self._period,
            lengths, rest)
        self._curvature = max(self._curvature, curvature)
        return self._move(directions, a, multipliers)

    def _program(self, directions, slack_rows=None, slack_lower=None, slack_upper=None):
        """
        Return the rows of everything that is bounded, and their bounds.

        Parameters
        ----------
        directions : ndarray (n, k)
            x moves by directions·a.
        slack_rows, slack_lower, slack_upper : ndarray (r, k), (r,), (r,), optional
            More rows, and their bounds on rows·a.

        Returns
        -------
        A : ndarray (n + …, k)
            One row for each joint, then those of levels with bounds, then these.
        lower, upper : ndarray (n + …,)
            Bounds on A a.

        """
        A, lower, upper = directions, self._lower - self.x, self._upper - self.x
        if len(self._rows):
            values = self._rows.dot(self.x)
            A = np.concatenate([A, self._rows.dot(directions)])
            # x is feasible; rounding must not make it infeasible.
            lower = np.concatenate([lower, np.minimum(self._row_lower - values, 0.0)])
            upper = np.concatenate([upper, np.maximum(self._row_upper - values, 0.0)])
        if slack_rows is not None:
            A = np.concatenate([A, slack_rows])
            lower = np.concatenate([lower, slack_lower])
            upper = np.concatenate([upper, slack_upper])
        return A, lower, upper

    def _move(self, directions, a, multipliers):
        """Move x, exactly onto bounds that have a multiplier; return those of joints and rows."""
        n = len(self.x)
        joints = multipliers[:n]
        self.x = clip(self.x + directions.dot(a) + PUSH * joints, self._lower, self._upper)
        rows = multipliers[n:]
        return joints, rows / self._row_units if len(rows) else rows
