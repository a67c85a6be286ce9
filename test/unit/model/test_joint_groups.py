# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Groups of joints have names, and the velocities of a moving base are one."""

import pytest
import robots
from tp_controller import Robot, RobotError
from tp_controller.model.joint_groups import velocities_of

MOBILE = robots.CONFIG / 'robots' / 'mobile_arm.urdf'


def mobile(groups=None, base='differential'):
    """Return the mobile arm with groups of its joints."""
    return Robot.from_file(str(MOBILE), base=base, groups=groups)


def test_base_is_a_group_where_it_moves():
    assert mobile().groups == {'base': ('base_x', 'base_yaw')}
    assert mobile(base='fixed').groups == {}


def test_group_has_joints_and_groups_before_it_each_once():
    robot = mobile({'reach': ['torso_lift', 'arm_1'], 'all': ['reach', 'base', 'arm_1'],
                    'lift': 'torso_lift'})
    assert robot.groups['all'] == ('torso_lift', 'arm_1', 'base_x', 'base_yaw')
    for names, expected in ((['lift', 'base_x', 'reach'], ('torso_lift', 'base_x', 'arm_1')),
                            ('arm_2', ('arm_2',)), (('arm_2', 'arm_2'), ('arm_2',))):
        assert velocities_of(names, robot.velocity_names, robot.groups) == expected


def test_groups_may_be_yaml():
    assert mobile('{arm: [arm_1, arm_2], all: [arm, base]}').groups == mobile(
        {'arm': ['arm_1', 'arm_2'], 'all': ['arm', 'base']}).groups
    assert mobile('').groups == mobile().groups


@pytest.mark.parametrize('groups, message', [
    ('arm: [arm_1', 'groups: not valid YAML'), ('[arm_1]', 'groups need a mapping'),
    ({'base': ['arm_1']}, 'neither base nor that of a joint'),
    ({'arm_1': ['arm_2']}, 'neither base nor that of a joint'),
    ({1: ['arm_2']}, 'neither base nor that of a joint'),
    ({'arm': ['arm_9']}, r"group arm: unknown joint or group 'arm_9' \(.*\); valid: base, base_x"),
    ({'arm': []}, 'group arm: needs a joint, a group or a list of them'),
    ({'arm': 3}, 'group arm: needs a joint, a group or a list of them'),
    ({'arm': [['arm_1']]}, 'unknown joint or group'),
    (['arm_1'], 'groups need a mapping'),
])
def test_groups_that_are_none_are_refused(groups, message):
    with pytest.raises(RobotError, match=message):
        mobile(groups)
