# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Recordings that tests make up: what is in them is known."""

import math

import numpy as np
from robots import PLANAR_DH
from rosbags.typesys import get_typestore, Stores
from tp_controller import Robot
from tp_controller.tools.recording.writer import BagWriter

STORE = get_typestore(Stores.ROS2_JAZZY)
# When recordings begin [ns since 1970].
BEGAN = 1_700_000_000 * 10**9
JOINTS = ('joint1', 'joint2', 'joint3')
STACK = '- tool: {type: position, frame: link3}\n- posture: {type: posture}'
STATUS = 'diagnostic_msgs/msg/DiagnosticArray'


def make(kind, *values):
    """Return a message of a type with the values of its fields."""
    return STORE.types[kind](*values)


def header(frame=''):
    """Return a header."""
    return make('std_msgs/msg/Header', make('builtin_interfaces/msg/Time', 0, 0), frame)


def status(node, head='running', **tasks):
    """Return a status; of each task {key: value}."""
    def entry(name, message, values):
        return make('diagnostic_msgs/msg/DiagnosticStatus', 0, name, message, node, [
            make('diagnostic_msgs/msg/KeyValue', key, str(value)) for key, value in values])
    return make(STATUS, header(), [
        entry(node, head, [('scale', 1), ('limiting', '')]),
        *(entry(f'{node}: {name}', '', values.items()) for name, values in tasks.items())])


def task(error=0.5, state='moving', unit='m', reason='', causes=None, accepted=0, refused=0,
         refusal=''):
    """Return the values of a task in a status; older ones have no causes."""
    return {'type': 'position', 'level': 1, 'status': state, f'error [{unit}]': error,
            f'tolerance [{unit}]': 0.001, 'reason': reason,
            **({} if causes is None else {'causes': causes}), 'goals accepted': accepted,
            'goals refused': refused, 'last refusal': refusal}


def joint_state(positions, names=JOINTS):
    """Return joint states."""
    nothing = np.empty(0)
    return make('sensor_msgs/msg/JointState', header(), list(names), np.array(positions, float),
                nothing, nothing)


def numbers(values):
    """Return an array of numbers."""
    return make('std_msgs/msg/Float64MultiArray', make('std_msgs/msg/MultiArrayLayout', [], 0),
                np.array(values, float))


def point(x, y, z, frame=''):
    """Return a goal that is a position."""
    return make('geometry_msgs/msg/PointStamped', header(frame),
                make('geometry_msgs/msg/Point', x, y, z))


def text(data):
    """Return a text."""
    return make('std_msgs/msg/String', data)


def parameters(node, **values):
    """Return the event that sets parameters; their names have ``__`` for a dot."""
    none = np.empty(0)

    def value(given):
        texts, number = isinstance(given, str), isinstance(given, float)
        return make('rcl_interfaces/msg/ParameterValue', 4 if texts else 3 if number else 9, False,
                    0, given if number else 0.0, given if texts else '', none.astype(np.uint8),
                    none.astype(bool), none.astype(np.int64), none,
                    [] if texts or number else list(given))

    return make('rcl_interfaces/msg/ParameterEvent', make('builtin_interfaces/msg/Time', 0, 0),
                f'/{node}', [make('rcl_interfaces/msg/Parameter', name.replace('__', '.'),
                                  value(given)) for name, given in values.items()], [], [])


def write(path, messages):
    """Write a recording of (time [s], topic, message); return its folder."""
    bag = BagWriter(path)
    for time, topic, message in messages:
        kind = message.__msgtype__
        bag.write(topic, kind, BEGAN + round(1e9 * time),
                  bytes(STORE.serialize_cdr(message, kind)))
    bag.close()
    return path


def run(node='tp_controller', seconds=4.0, rate=50):
    """
    Yield the messages of a run of the planar arm: a goal that is reached, one that is refused.

    The first joint moves by 0.1 rad/s for as long as the goal is not reached.
    """
    namespace = f'/{node}'.rpartition('/')[0]
    yield 0.0, f'{namespace}/robot_description', text(Robot.from_file(PLANAR_DH).urdf)
    yield 0.0, '/parameter_events', parameters(
        node, stack=STACK, joints=[''], command_joints=[''], base='fixed',
        limits__joint1__velocity=0.2)
    for step in range(int(seconds * rate)):
        now = step / rate
        arrived, refused = now >= 2.0, now >= 3.0
        yield now, f'{namespace}/joint_states', joint_state((0.1 * min(now, 2.0), 0.6, 0.3))
        yield now, f'{namespace}/velocity_controller/commands', numbers(
            (0.0 if arrived else 0.1, 0.0, -0.05 if step == 10 else 0.0))
        if step == rate // 2:
            yield now, f'/{node}/tool/goal', point(0.4, 0.2, 0.0)
        if step == 3 * rate:
            yield now, f'/{node}/tool/goal', point(math.nan, 0.0, 0.0)
        head = 'stopped by ~/stop' if 1.0 <= now < 1.2 else 'running'
        if step % 5 == 0:
            known = head == 'running'
            yield now, f'/{node}/status', status(
                node, head,
                tool=task((2.0 - now) / 2.0 if now < 2.0 else 0.0,
                          'reached' if arrived else 'moving' if known else 'stopped',
                          accepted=int(now > 0.5), refused=int(refused),
                          refusal='not finite' if refused else ''),
                posture=task(0.25, 'limited', 'rad', *2 * ['blocked by tool' if known else '']))
