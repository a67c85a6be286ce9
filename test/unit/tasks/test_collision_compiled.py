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

"""What is compiled of the tasks of collision avoidance does what the reference does."""

import numpy as np
import pytest
import robots
from tp_controller.model.clearance import Clearance
from tp_controller.model.solids import capsule
from tp_controller.solver.compiled import core
from tp_controller.tasks.collision import rows_of

pytestmark = pytest.mark.skipif(core is None, reason='the package was built without a compiler')

MAKERS = {
    'panda': robots.panda, 'baxter': lambda: robots.urdf_robot('baxter'),
    'tiago': lambda: robots.urdf_robot('tiago'), 'DH arm': robots.mixed,
    **{base: lambda base=base: robots.moving_panda(base)
       for base in ('planar', 'differential', 'underwater', 'floating')},
}


def somewhere(robot, rng):
    """Return a state of a robot at random positions."""
    rows = robot.joint_columns
    return robot.state(robot.configuration(rng.uniform(
        np.maximum(robot.lower[rows], -3.0), np.minimum(robot.upper[rows], 3.0))))


@pytest.mark.parametrize('name', MAKERS)
def test_rows_of_pairs_are_those_of_the_reference(name):
    robot, rng, compared = MAKERS[name](), np.random.default_rng(0), 0
    frames = rng.choice(robot.frame_names, 6)
    solids = [capsule(f'c{index}', frame, *rng.normal(0.0, 0.3, (2, 3)), 0.1)
              for index, frame in enumerate(frames)]
    pairs = [(one, other) for other in range(6) for one in range(other)]
    clearance = Clearance(robot.kinematics, solids, pairs, 0.5)
    ids = [robot.kinematics.frame_index(frame) for frame in clearance.frames]
    ends = [(ids[one], ids[other]) for one, other in zip(clearance.first, clearance.second)]
    for _ in range(20):
        state = somewhere(robot, rng)
        near = clearance.nearest(state)
        J = np.full((len(near.pairs), robot.n), 7.0)
        assert core.parting(state.motion, ends, near.pairs, near.normals, near.points, J) is True
        np.testing.assert_allclose(J, rows_of(state, clearance, near), rtol=0.0, atol=1e-12)
        compared += len(J)
    assert compared > 50


def test_what_does_not_fit_is_left_to_the_reference():
    robot = robots.panda()
    motion, two, J = robot.state(robots.PANDA_READY).motion, np.ones((2, 3)), np.empty((2, 7))
    fits = [motion, [(0, 1), (1, 2)], [0, 1], two, two, J]
    assert core.parting(*fits) is True
    for place, wrong in ((1, [(0, 1)]), (1, [(0, 1), (1, 99)]), (1, [(0, 1), (-1, 2)]),
                         (1, [(0, 1), [1, 2]]), (1, [(0, 1), (1, None)]), (1, [(0, 1), (1,)]),
                         (2, [0]), (2, [0, -1]), (2, [0, 'x']), (2, [0, 2 ** 70]), (3, two[:1]),
                         (3, two.tolist()), (4, np.ones((2, 2))), (4, None), (5, J[:, :6]),
                         (5, None), (5, two)):
        given = [*fits]
        given[place] = wrong
        assert core.parting(*given) is False, (place, wrong)
    for place, wrong in ((0, None), (1, ()), (2, (0, 1))):
        given = [*fits]
        given[place] = wrong
        with pytest.raises(ValueError, match='parting'):
            core.parting(*given)
    with pytest.raises(ValueError, match='parting'):
        core.parting(*fits[1:])
