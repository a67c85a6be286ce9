# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""Locked joints in the loop of the node, and joints that it locks as they do not follow."""

from dataclasses import replace

from fault_table import Outcome, outcomes
from monitor import promise_of
import numpy as np
import pytest
from robots import panda, PANDA_READY, PANDA_TOOL
from tp_controller import Robot
from world import World

NAMES = panda().joint_names
# Joint 6 begins near its lower limit.
ROBOT = Robot(panda().urdf, limits=dict.fromkeys(NAMES, {'acceleration': 8.0}) | {
    'panda_joint6': {'acceleration': 8.0, 'lower': 1.4}})
# Enough joints for the tool without one of them.
STACK = (f'- tool: {{type: position, frame: {PANDA_TOOL}, gain: 1.0}}\n'
         '- posture: {type: posture}\n')
OUTPUTS = ('velocity', 'position', 'trajectory')
LOCKING = {'on_not_following': 'lock'}
# One window of 1 s, and 0.4 s that a robot may be late; where positions are commanded, the lead.
NOTICED = {'velocity': 1.4, 'position': 3.5, 'trajectory': 3.5}
GOES_ON = 'the joint is [locked](ros.md#locked-joints), the others go on'


def make_world(patch, way=(0.15, 0.35, 0.0), stack=STACK, **values):
    """Return a world whose tool is on its way, and its goal."""
    world = World(patch, ROBOT, stack, np.array(PANDA_READY), **values)
    assert world.run(0.2, until=lambda: not world.stopped()), world.stopped()
    goal = ROBOT.state(world.q).position(PANDA_TOOL) + way
    world.controller.set_goal('tool', goal, world.now)
    return world, goal


def failing(world, *joints):
    """Let joints stand still from now on."""
    share = np.ones(7)
    share[list(joints)] = 0.0
    ideal = world.plant

    def plant(velocity):
        """Return the velocities of a robot whose joints stand still."""
        if not world.holds:
            return share * velocity
        return share * np.clip(velocity + (world.setpoint - world.q) / 0.02, -3.0, 3.0)

    world.plant = plant
    return ideal


def distance(world, goal):
    """Return the distance of the tool from its goal."""
    return float(np.linalg.norm(ROBOT.state(world.q).position(PANDA_TOOL) - goal))


def check(world):
    """Check what is promised about every command."""
    promise = replace(promise_of(world.robot, world.period, world.values['state_timeout'], 1e-3),
                      lead=np.inf)
    assert world.monitor.faults(promise, late=0.02) == []


@pytest.mark.parametrize('output', OUTPUTS)
def test_tool_arrives_without_a_joint_that_is_locked_in_motion(monkeypatch, output):
    world, goal = make_world(monkeypatch, output=output)
    world.run(0.5)
    world.controller.lock([NAMES[0]], world.now)
    world.run(0.5)
    stands = world.q[0]
    assert world.run(8.0, until=lambda: distance(world, goal) < 1e-3)
    assert world.q[0] == pytest.approx(stands, abs=1e-6)
    assert not world.told[1:]
    check(world)


@pytest.mark.parametrize('output', OUTPUTS)
def test_locked_joint_may_sag_beyond_its_limits_and_what_was_commanded(monkeypatch, output):
    world, goal = make_world(monkeypatch, output=output)
    world.controller.lock([NAMES[5]], world.now)
    world.run(0.2)
    target = None if world.target is None else world.target[5]
    ideal = failing(world, 5)
    plant = world.plant
    # Down to 0.2 rad beyond its lower limit.
    sag = np.zeros(7)
    sag[5] = -(world.q[5] - ROBOT.lower[5] + 0.2) / 6.0
    world.plant = lambda velocity: plant(velocity) + sag
    world.run(6.0)
    assert world.q[5] < ROBOT.lower[5] - 0.1
    assert not world.stopped() and not world.told[1:]
    if world.holds:
        assert world.target[5] == target
    world.plant = plant
    # What the tool is away by follows from where the joint is measured.
    assert world.run(8.0, until=lambda: distance(world, goal) < 2e-3), \
        (distance(world, goal), world.q)
    # Unlocked, it counts again, from then on.
    world.plant = ideal
    world.controller.unlock([NAMES[5]], world.now)
    world.run(3.0)
    assert not world.stopped()


@outcomes('Robot', [Outcome('one joint stands still, and `on_not_following` is `lock`', result,
                            'unlocking it', 'does not follow', NOTICED[output], positions)
                    for result, positions, output in (
                        (GOES_ON, '', 'velocity'), ('', 'the same', 'position'))])
@pytest.mark.parametrize('output', OUTPUTS)
@pytest.mark.parametrize('joint', [0, 1, 3])
def test_joint_that_does_not_follow_is_locked_and_the_tool_arrives(monkeypatch, joint, output):
    world, goal = make_world(monkeypatch, output=output, **LOCKING)
    warned = []
    world.loop._log.warning = lambda text, *_: warned.append(text)
    world.run(0.1)
    failing(world, joint)
    # It has to be commanded to move by 0.05 rad first.
    assert world.run(NOTICED[output] + 0.1, until=lambda: world.controller.locked)
    assert list(world.controller.locked) == [NAMES[joint]]
    assert any(text.startswith(f'locked {NAMES[joint]}, the others go on: {NAMES[joint]} does '
                               'not follow') for text in warned)
    if joint != 3:
        assert world.run(15.0, until=lambda: distance(world, goal) < 2e-3)
    world.run(1.0)
    assert not world.stopped() and list(world.controller.locked) == [NAMES[joint]]


@pytest.mark.parametrize('output', OUTPUTS)
def test_joint_that_does_not_follow_stops_the_robot_by_default(monkeypatch, output):
    world, _ = make_world(monkeypatch, output=output)
    world.run(0.1)
    failing(world, 0)
    assert world.run(NOTICED[output] + 0.1, until=world.stopped)
    assert 'does not follow' in world.stopped() and not world.controller.locked


@pytest.mark.parametrize('output', OUTPUTS)
def test_others_go_on_after_a_stop_for_a_joint_that_is_locked_then(monkeypatch, output):
    world, goal = make_world(monkeypatch, output=output)
    world.run(0.1)
    ideal = failing(world, 0)
    assert world.run(NOTICED[output] + 0.1, until=world.stopped)
    assert world.loop.stops.joint == NAMES[0]
    world.run(0.5)
    # As the service does it.
    world.controller.lock([NAMES[0]], world.now)
    world.loop.restart()
    assert world.loop.stops.joint == ''
    assert world.run(15.0, until=lambda: distance(world, goal) < 2e-3)
    world.plant = ideal
    world.controller.unlock([NAMES[0]], world.now)
    stood = world.q[0]
    world.controller.set_goal('tool', goal - [0.1, 0.6, 0.0], world.now)
    world.run(3.0)
    assert abs(world.q[0] - stood) > 0.1
    assert not world.stopped() and len(world.told) <= 2
    check(world)


@pytest.mark.parametrize('output', OUTPUTS)
@pytest.mark.parametrize('joints', [range(7), (0, 1), (0, 3), (0, 1, 2, 3)])
def test_several_joints_that_do_not_follow_stop_the_robot(monkeypatch, joints, output):
    world, _ = make_world(monkeypatch, output=output, **LOCKING)
    world.run(0.1)
    failing(world, *joints)
    assert world.run(3.0 * NOTICED[output], until=world.stopped)
    assert 'does not follow' in world.stopped()
    assert len(world.controller.locked) <= 1


@pytest.mark.parametrize('output', OUTPUTS)
def test_only_joint_that_moves_stops_the_robot_as_the_driver_may_have_failed(monkeypatch, output):
    world, _ = make_world(monkeypatch, stack=f'- tool: {{type: position, frame: {PANDA_TOOL}}}\n',
                          way=(0.0, 0.0, 0.0), output=output, **LOCKING)
    world.controller.lock([NAMES[joint] for joint in range(1, 7)], world.now)
    world.controller.set_goal('tool', ROBOT.state(world.q).position(PANDA_TOOL)
                              + [0.0, 0.3, 0.0], world.now)
    failing(world, 0)
    assert world.run(3.0, until=world.stopped)
    assert NAMES[0] not in world.controller.locked


@pytest.mark.parametrize('output', OUTPUTS)
@pytest.mark.parametrize(('share', 'drift'), [(-1.0, 0.0), (1.0, 0.6)])
def test_joint_that_moves_the_other_way_or_by_itself_stops_the_robot(monkeypatch, share, drift,
                                                                     output):
    world, _ = make_world(monkeypatch, output=output, **LOCKING)
    world.run(0.1)
    first = np.arange(7) == 0
    world.plant = lambda velocity: np.where(first, share * velocity + drift, velocity)
    assert world.run(4.0, until=world.stopped)
    assert not world.controller.locked


@pytest.mark.parametrize('output', OUTPUTS)
@pytest.mark.parametrize(('pause', 'stops'), [(3.0, True), (12.0, False)])
def test_second_joint_is_locked_only_after_a_while(monkeypatch, pause, stops, output):
    world, _ = make_world(monkeypatch, output=output, **LOCKING)
    world.run(0.1)
    failing(world, 0)
    assert world.run(1.5, until=lambda: world.controller.locked)
    ideal = world.plant
    world.run(pause)
    world.plant = ideal
    goal = ROBOT.state(world.q).position(PANDA_TOOL)
    world.controller.set_goal('tool', goal + [0.1, -0.3, 0.2], world.now)
    world.run(0.1)
    failing(world, 0, 3)
    if stops:
        assert world.run(6.0, until=world.stopped)
        assert len(world.controller.locked) == 1
    else:
        assert world.run(6.0, until=lambda: len(world.controller.locked) == 2)
        assert not world.stopped()
