# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Loop over the levels: the recursion of lecture 2.2 with damping and bounds.

x is the velocity after the levels so far, and Z a basis of their null space. Each level
decomposes its projected Jacobian, J Z = U diag(s) Vᵀ with Q = Z V, and takes one damped step ::

    x ← x + Q a°,   a°_i = s_i d_i / max(s_i² + …, c),   d = Uᵀ (v − J x)     (see `damping`)

if that is feasible. Otherwise one quadratic program returns the nearest feasible step ::

    minimise  Σ max(s_i², c) (a_i − a°_i)²   subject to   x + Q a is feasible     (see `qp`)

The remaining null space is Z ← Z V_null. The first level begins at rest, so that bounds that
exclude zero change its step no more than necessary. A level with bounds moves x to satisfy them;
its rows constrain all levels below. No level depends on those below it.

A level with a mask of its joints, `Level.joints`, has two matrices: it steps within
Z' = Z null(E Z), where E selects the other joints, and leaves the null space of J Z. It begins
where the levels above need the least motion, and takes the shortest of the steps that meet it as
well. The sum x° of these steps is its own: the motion that is minimised at last is
Σ w_j (x_j − x°_j)², so that no other joint replaces them.

Sources: lecture 2.1, 2.2, 3.1, 4; lab exercise 2 [8]; wiki [8]–[15], [20]–[28]; slides (7)–(10);
notes [4], [6], [8]–[11].
"""

import numpy as np
from tp_controller.solver.active_set import ActiveSet
from tp_controller.solver.curvature import bend_against
from tp_controller.solver.damping import bend, Damping
from tp_controller.solver.level import (
    Array,
    FEASIBLE,
    identity,
    Level,
    NEGLIGIBLE,
    norm,
    ROUNDING,
    within,
)
from tp_controller.solver.null_space import (
    decompose,
    Decomposed,
    Directions,
    excluded,
    null_space,
    projection,
    remaining,
    weighted,
)
from tp_controller.solver.polytope import EMPTY, Polytope
from tp_controller.solver.qp import nearest, regularised
from tp_controller.solver.solution import LevelStep

# If levels above, other rows and joints at their limits leave less than this share of a row with
# bounds, it demands no more of the joints than a row of that length would [1].
ROW_DAMPING = 0.1
# μ² below this share of the largest stiffness counts as 0. A share of 1e-28, in units that do not
# suit μ, costs a program all digits of its bounds, and levels above 2 % of their velocity.
SOFTEST = 1e-8


class BoundedHierarchy:
    """
    State of the recursion after the levels so far.

    Attributes
    ----------
    x : ndarray (n,)
        Joint velocities.
    Z : ndarray (n, k)
        Basis of the remaining null space.
    allowed : Polytope
        Feasible velocities.

    """

    def __init__(self, allowed: Polytope, damping: Damping, weights: Array | None = None) -> None:
        self.allowed, self._damping, self._weights = allowed, damping, weights
        # The steps of levels with a mask, x°.
        self._rest = self._own = np.zeros(len(allowed.lower))
        # The velocities after the last level, as its step has them.
        self.x = self._last = allowed.clip(self._rest)
        self.Z = identity(len(self.x))
        # Levels with a demand so far; whether some of their directions were relaxed.
        self._above: list[Decomposed] = []
        self._relaxed = False

    @property
    def damping(self) -> Damping:
        """Return the damping of the next level."""
        return self._damping if self._above else self._damping.first

    def carry_out(self, level: Level, c: float) -> LevelStep:
        """Take the step of a level, damped by its c, or the nearest feasible step."""
        others = self._hold(level)
        directions = whole = decompose(level, self.Z if self._above else None, not self._relaxed)
        if others is not None:
            directions = decompose(level, others[1].free, not self._relaxed)
        gains, origin = self.damping.gains(directions.s, c), self._origin(level)
        missing = level.v if origin is self._rest else level.v - level.J.dot(origin)
        start = None if origin is self._last or origin is self._rest else origin
        P = projection(level, directions)
        step = gains * missing.dot(P)
        if self._take(origin + directions.moving.dot(step)):
            multipliers = EMPTY
        elif level.mode == 'scale':
            multipliers = self._keep_direction(level, directions, P, gains, c)
        else:
            multipliers = self._come_near(origin, *_stiff(level, directions, step), c)
        followed = directions.s * gains
        met = not len(multipliers) and directions.rank == len(level.v) \
            and (not len(followed) or followed[-1] > 1.0 - ROUNDING)
        bend = 0.0 if met else self._bend(level, directions, multipliers, others)
        relaxed = self._leave(whole)
        self._above.append((level, whole))
        return LevelStep(self._after(level, origin), directions, followed, relaxed,
                         *self._apart(multipliers), bend, start)

    def _origin(self, level: Level) -> Array:
        """Return the velocities (n,) at which the step of a level with a demand begins."""
        if self._above:
            return self.x
        return self._own if level.joints is None else np.where(level.joints, self._own, self.x)

    def _keep_direction(self, level: Level, directions: Directions, P: Array, gains: Array,
                        c: float) -> Array:
        """Scale the step of a level down as little as the bounds allow, in its direction."""
        J, s, Q = level.J, directions.s, directions.Q
        achieved = P.T.dot(J.dot(self.x))
        if achieved.any():
            # The path to the demand begins at rest, or as near to rest as the bounds allow.
            self._step(self.x, Q, -gains * achieved, s, c)
        # Undo the feasible part of that step in full: it was damped already.
        moved = P.T.dot(J.dot(self.x)) - achieved
        step = gains * (P.T.dot(level.v) - achieved) - moved / s
        length = norm(step)
        if length == 0.0:
            return EMPTY
        # One direction for the level, and all directions of its null space.
        D = np.column_stack([Q[:, :len(s)].dot(step / length), Q[:, len(s):]])
        along = s * step / length
        return self._step(self.x, D, np.array([length]), np.array([norm(along)]), c)

    def _take(self, x: Array) -> bool:
        """Move to x (n,) if that is feasible; return whether it is."""
        fitting = self.allowed.fitting(x)
        if fitting is None:
            return False
        self.x = fitting
        return True

    def _step(self, origin: Array, Q: Array, step: Array, s: Array, c: float) -> Array:
        """Move x to `origin` + Q step (rank,) or the nearest feasible x; return multipliers."""
        if self._take(origin + Q[:, :len(step)].dot(step)):
            return EMPTY
        return self._come_near(origin, Q, step, s, c)

    def _come_near(self, origin: Array, Q: Array, step: Array, s: Array, c: float) -> Array:
        """Move to the feasible x nearest to `origin` + Q step (rank,); return the multipliers."""
        rank = len(step)
        if not Q.shape[1]:
            return self._stay()
        target, stiffness = np.zeros(Q.shape[1]), np.full(Q.shape[1], c)
        target[:rank], stiffness[:rank] = step, np.maximum(s * s, c)
        demanded = origin + Q[:, :rank].dot(step)
        start = target + Q.T.dot(self.allowed.clip(demanded) - demanded)
        least = self.damping.regularisation ** 2
        if least < SOFTEST * stiffness.max():
            # A smaller μ² would cost the bounds their digits.
            least = 0.0
        return self._move(origin, Q, regularised(
            stiffness, target, *self.allowed.along(origin, Q), least, start))

    def _move(self, origin: Array, Q: Array, found: tuple[Array, Array] | None) -> Array:
        """Move x, exactly onto bounds that have a multiplier; return the multipliers."""
        if found is None:
            # Rounding prevents a solution.
            return self._stay()
        a, multipliers = found
        self.x = self.allowed.clip(origin + Q.dot(a) + multipliers[:len(self.x)] / ROUNDING)
        self.allowed.widen(self.x)
        return multipliers

    def _stay(self) -> Array:
        """Leave x unchanged; return multipliers that are all zero."""
        return np.zeros(len(self.x) + len(self.allowed.rows))

    def _apart(self, multipliers: Array) -> tuple[Array | None, Array | None]:
        """Return the multipliers of joints (n,), and of the rows (r,) as given."""
        if not len(multipliers):
            return None, None
        n = len(self.x)
        return multipliers[:n], multipliers[n:] / self.allowed.lengths

    def _leave(self, directions: Directions) -> Array | None:
        """Reduce Z to the null space of a level; return Z if it has relaxed directions."""
        region = self._damping.release_region
        self.Z = remaining(directions, region, self._damping.damping or region)
        if self.Z.shape[1] == directions.Q.shape[1] - directions.rank:
            return None
        self._relaxed = True
        return self.Z

    def _bend(self, level: Level, directions: Directions, multipliers: Array,
              others: Decomposed | None) -> float:
        """Return h of a level; 0 if its residual is negligible."""
        missed = level.v - level.J.dot(self.x)
        push = norm(missed)
        if push <= NEGLIGIBLE * norm(level.v):
            return 0.0
        h = 0.0 if level.is_identity else bend(directions.size, push)
        if level.weights is not None:
            # In the units of the residual, whatever the weights.
            missed = level.root ** 2 * missed
            share = push / norm(missed)
            missed, multipliers = share * missed, share * multipliers
        return h + self._bend_against(missed.dot(level.J), multipliers, others)

    def _bend_against(self, force: Array, multipliers: Array, others: Decomposed | None) -> float:
        """Return the part of h from what balances a force (n,); see `bend_against`."""
        return bend_against(force, multipliers, self.allowed, self._above, others,
                            self._damping.release_region)

    # Levels with bounds

    def satisfy(self, level: Level, c: float) -> LevelStep:
        """Satisfy the bounds of a level as far as possible, and add them; see `carry_out`."""
        others, start = self._hold(level), self.x
        Z = self.Z if others is None else others[1].free
        lengths = np.sqrt((level.J * level.J).sum(axis=1))
        lengths[lengths == 0.0] = 1.0
        rows = level.J / lengths[:, np.newaxis]
        lower, upper = level.lower / lengths, level.upper / lengths
        values = rows.dot(self.x)
        multipliers = EMPTY
        if not within(values, lower, upper):
            multipliers = self._meet(Z, rows, lower - values, upper - values,
                                     lengths * level.root, c)
            values = rows.dot(self.x)
            lower, upper = np.minimum(lower, values), np.maximum(upper, values)
        self.allowed.add(rows, lower, upper, lengths)
        bend = self._bend_against(self._rest, multipliers, others) if len(multipliers) else 0.0
        return LevelStep(self._after(level, start), None, EMPTY, None, *self._apart(multipliers),
                         bend)

    def _meet(self, Z: Array, rows: Array, lower: Array, upper: Array, sizes: Array,
              c: float) -> Array:
        """Move x so that the change of rows x is within bounds; return multipliers on failure."""
        G, asked = rows.dot(Z), np.maximum(np.maximum(lower, -upper), 0.0)
        if not self._damping.off:
            lower, upper = _reduced(lower, upper, (G * G).sum(axis=1) / ROW_DAMPING ** 2)
        # Mostly the bounds are feasible, and one program suffices, with the tightest tolerance.
        A, least, most = self.allowed.along(self.x, Z)
        found = ActiveSet(np.zeros(G.shape[1]), np.concatenate([A, G]),
                          np.concatenate([least, lower]), np.concatenate([most, upper])
                          ).solve(FEASIBLE)
        if found is None:
            return self._miss(Z, G, lower, upper, sizes, c)
        # If other rows, and joints at their limits, leave a length s of a row, its multiplier is
        # its remaining demand / s².
        dearest = asked / ROW_DAMPING ** 2
        costs = np.where(asked > 0.0, np.abs(found[1][-len(G):]), 0.0)
        if np.count_nonzero(costs > dearest) and not self._damping.off:
            self._ease(Z, G, lower, upper, asked, dearest)
        else:
            self._move(self.x, Z, found)
        return EMPTY

    def _ease(self, Z: Array, G: Array, lower: Array, upper: Array, asked: Array,
              dearest: Array) -> None:
        """
        Move x along Z towards bounds on G a (r,); slack for multipliers (r,) beyond `dearest`.

        The slack w of each row is between 0 and its demand. Minimising ‖a‖² + Σ (w + dearest)²
        makes the multiplier of a row with slack `dearest` + w.
        """
        A, least, most = self.allowed.along(self.x, Z)
        count, k = G.shape
        none = np.zeros(count)
        A = np.block([[A, np.zeros((len(A), count))],
                      [G, np.diag(np.where(lower > 0.0, 1.0, -1.0))],
                      [np.zeros((count, k)), np.eye(count)]])
        found = ActiveSet(np.concatenate([np.zeros(k), -dearest]), A,
                          np.concatenate([least, lower, none]),
                          np.concatenate([most, upper, asked])).solve(FEASIBLE)
        if found is not None:
            self._move(self.x, np.hstack([Z, np.zeros((len(self.x), count))]), found)

    def _miss(self, Z: Array, G: Array, lower: Array, upper: Array, sizes: Array,
              c: float) -> Array:
        """Move x as near as is feasible to bounds that G a (r,) cannot satisfy; see `_meet`."""
        A, least, most = self.allowed.along(self.x, Z)
        # One more variable for each row: its residual.
        count, k = G.shape
        A = np.block([[A, np.zeros((len(A), count))], [G, np.eye(count)]])
        stiffness, target = np.zeros((2, k + count))
        stiffness[:k] = np.maximum(c, self._damping.regularisation ** 2)
        target[:k] = -Z.T.dot(self.x)
        stiffness[k:] = sizes * sizes
        found = regularised(stiffness, target, A, np.concatenate([least, lower]),
                            np.concatenate([most, upper]), 0.0, target)
        if found is None:
            # Rounding prevents a solution: x is unchanged.
            return EMPTY
        slack = np.zeros((len(self.x), count))
        return self._move(self.x, np.hstack([Z, slack]), found)

    # The motion that the levels leave open

    def finish(self) -> None:
        """Minimise Σ w_j (x_j − x°_j)² in the remaining null space of all levels."""
        if not (self._above and self._above[-1][0].is_identity):
            self._shorten(self._free, self._own)

    def _hold(self, level: Level) -> Decomposed | None:
        """Prepare x for a level with a mask; return the joints that it holds, None if none."""
        if level.joints is None:
            return None
        self._shorten(self._free, self._own)
        return excluded(level.joints, self.Z)

    def _after(self, level: Level, origin: Array) -> Array:
        """Return x after a level; one with a mask keeps its shortest step from `origin`."""
        self._last = self.x
        if level.joints is not None:
            self._shorten(excluded(level.joints, self._free)[1].free, origin)
            self._own = self._own + (self.x - origin)
        return self._last

    @property
    def _free(self) -> Array:
        """Return the null space of all levels (n, k), without relaxed directions."""
        if not self._relaxed:
            return self.Z
        return null_space([level for level, _ in self._above], len(self.x))

    def _shorten(self, Z: Array, origin: Array) -> None:
        """Move x along Z so that Σ w_j (x_j − origin_j)² is least."""
        if not Z.shape[1]:
            return
        # One more level: √w_j (x_j − origin_j) = 0.
        weights = self._weights
        cost = identity(len(self.x)) if weights is None else np.diag(np.sqrt(weights))
        directions = decompose(Level(cost, is_identity=weights is None), Z)
        s, Q = directions.s, directions.Q
        step = -cost.dot(self.x - origin).dot(directions.U) / s
        if not self._take(self.x + Q.dot(step)):
            self._move(self.x, Q, nearest(s * s, step, *self.allowed.along(self.x, Q)))


def _stiff(level: Level, directions: Directions, step: Array) -> tuple[Array, Array, Array]:
    """Return Q, step and s; with weights in coordinates in which these give stiffnesses θ²."""
    if level.weights is None or not len(step):
        return directions.Q, step, directions.s
    R, theta = weighted(level, directions)
    return np.hstack([directions.moving.dot(R), directions.free]), R.T.dot(step), theta


def _reduced(lower: Array, upper: Array, share: Array) -> tuple[Array, Array]:
    """Return bounds (r,) with their demands multiplied by a share of at most 1."""
    share = np.minimum(share, 1.0)
    return share * np.maximum(lower, 0.0) + np.minimum(lower, 0.0), \
        share * np.minimum(upper, 0.0) + np.maximum(upper, 0.0)
