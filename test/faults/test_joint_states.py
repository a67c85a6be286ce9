# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0


"""
Joint states and robots at fault, in computed time, each with twenty seeds.

The robot goes on as it was told last, as behind a `forward_command_controller`; a monitor hears
every command and knows where the robot truly is.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace
import math
from types import SimpleNamespace

from fault_table import AT_ONCE, BY_ITSELF, fault_text, Outcome, outcomes, START
from monitor import promise_of
import numpy as np
import pytest
from robots import PANDA_DH, PANDA_READY, PANDA_TOOL
from tp_controller import Robot, Stack
from tp_controller.ros.declarations.controller import OUTPUTS
from tp_controller.ros.log import Log
from world import ideal, STATE_PERIOD, World

SEEDS = range(20)
JOINTS = tuple(f'panda_joint{number}' for number in range(1, 8))
ACCELERATIONS = (15.0, 7.5, 10.0, 12.5, 15.0, 20.0, 20.0)
ROBOT = Robot.from_file(PANDA_DH, limits={
    name: {'acceleration': limit} for name, limit in zip(JOINTS, ACCELERATIONS)})
STACKS = {'joint': f'- reach: {{type: joint, joints: [{", ".join(JOINTS)}], gain: 2.0}}\n',
          'pose': f'- reach: {{type: pose, frame: {PANDA_TOOL}, gain: 2.0}}\n'
                  '- posture: {type: posture, gain: 0.5}\n'}
# What a computed clock and its steps may add to a timeout [s].
STEPS = 0.02


def make_world(patch, random, kind='joint', **values):
    """Return a world whose robot is on its way to a goal, far from where it began."""
    q = np.clip(PANDA_READY + random.uniform(-0.3, 0.3, 7), ROBOT.lower + 0.1, ROBOT.upper - 0.1)
    world = World(patch, ROBOT, STACKS[kind], q, **values)
    send_goal(world, random, kind)
    assert world.run(1.0, until=world.moving), world.stopped()
    return world


def runs(seeds, others=4):
    """Return outputs with seeds: `others` of them, one after another, for those of positions."""
    first, second = seeds[:others], seeds[others:2 * others] or seeds[:others]
    return [*(('velocity', seed) for seed in seeds), *(('position', seed) for seed in first),
            *(('trajectory', seed) for seed in second)]


def send_goal(world, random, kind='joint'):
    """Send a goal to the task: any the robot can be at, limits included."""
    while True:
        q = np.clip(random.uniform(ROBOT.lower - 0.3, ROBOT.upper + 0.3), ROBOT.lower,
                    ROBOT.upper)
        if np.abs(q - world.q).max() > 1.0:
            break
    T = ROBOT.state(q).pose(PANDA_TOOL)
    world.controller.set_goal('reach', q if kind == 'joint' else T, world.now)


def check(world, beyond=1e-3, lead=0.2):
    """Check what is promised about every command."""
    promise = replace(promise_of(world.robot, world.period, world.values['state_timeout'],
                                 beyond), lead=lead)
    assert world.monitor.faults(promise, late=STEPS) == []


def start(world):
    """Start the robot; one that has passed a limit meanwhile needs a wider tolerance."""
    outside = np.maximum(world.q - ROBOT.upper, ROBOT.lower - world.q).max()
    if outside > world.values['limit_tolerance']:
        assert 'outside its position limits' in world.loop.lasting()
        world.loop.checks.limits.tolerance = outside + 1e-3
    assert world.loop.lasting() == ''
    world.loop.restart()


# Faults of joint states -----------------------------------------------------------------------

Messages = list
Report = Callable[[World], Messages]


@fault_text('no joint states arrive')
def silence(world, random):
    """Send nothing."""
    return lambda world: []


@fault_text('one joint is missing')
def one_joint_missing(world, random):
    """Say nothing about one joint."""
    gone = random.integers(7)
    rest = [row for row in range(7) if row != gone]
    return lambda world: [world.state(world.q[rest], names=[JOINTS[row] for row in rest])]


@fault_text('the same message arrives again and again')
def frozen(world, random):
    """Send the same message again and again."""
    q, stamp = world.q.copy(), world.now
    return lambda world: [world.state(q, stamp)]


@fault_text('the positions stand still while their stamps go on')
def frozen_with_stamps(world, random):
    """Send the same positions with stamps that go on."""
    q = world.q.copy()

    def report(world):
        # Nobody can tell yet.
        world.monitor.heard.append(world.now)
        return [world.state(q)]
    return report


@fault_text('a recording is played, with its stamps')
def replayed(world, random):
    """Send what was recorded before, with its stamps."""
    times, positions = zip(*world.monitor.positions)
    shift = random.uniform(0.2, 0.5) + world.now - times[0]

    def report(world):
        row = min(np.searchsorted(times, world.now - shift), len(times) - 1)
        return [world.state(positions[row], world.now - shift)]
    return report


@fault_text('all stamps are old')
def old(world, random):
    """Stamp everything as if it were old."""
    shift = 10.0 ** random.uniform(-0.6, 4.0)
    return lambda world: [world.state(stamp=world.now - shift)]


@fault_text('all stamps are ahead of time')
def ahead(world, random):
    """Stamp everything as if it came from the future."""
    shift = 10.0 ** random.uniform(-0.6, 4.0)
    return lambda world: [world.state(stamp=world.now + shift)]


@fault_text('messages queue up')
def late(world, random):
    """Let every message wait longer than the one before."""
    waiting, begin, rate = [], world.now, random.uniform(0.3, 0.9)

    def report(world):
        waiting.append(world.state())
        due = len(waiting) - math.ceil(rate * (world.now - begin) / STATE_PERIOD)
        ready, waiting[:] = waiting[:max(due, 0)], waiting[max(due, 0):]
        return ready
    return report


@fault_text('a position is no number')
def not_a_number(world, random):
    """Send positions of which one is no number."""
    joint, bad = random.integers(7), random.choice([math.nan, math.inf, -math.inf, 1e300])

    def report(world):
        q = world.q.copy()
        q[joint] = bad
        return [world.state(q)]
    return report


@fault_text('a joint is named twice')
def named_twice(world, random):
    """Name a joint twice, with two positions."""
    joint = random.integers(7)
    names = [*JOINTS, JOINTS[joint]]
    return lambda world: [world.state([*world.q, 0.0], names=names)]


@fault_text('there are fewer positions than names')
def too_few(world, random):
    """Send fewer positions than names."""
    count = random.integers(7)
    return lambda world: [world.state(world.q[:count], names=JOINTS)]


@fault_text('one position is far off, once')
def one_jump(world, random):
    """Send one position that is far off, once."""
    joint, pending = random.integers(7), [random.choice([-1.0, 1.0]) * random.uniform(0.8, 3.0)]

    def report(world):
        q = world.q.copy()
        q[joint] += pending.pop() if pending else 0.0
        return [world.state(q)]
    return report


@fault_text('two publishers disagree')
def two_publishers(world, random):
    """Let another publisher say something else."""
    other = world.q + random.uniform(0.8, 1.5, 7)
    return lambda world: [world.state(), world.state(other)]


@dataclass(frozen=True)
class Fault:
    """
    What is wrong, and what has to come of it.

    Attributes
    ----------
    report : callable
        Makes the joint states.
    told : str
        Part of the reason.
    latches : bool
        It lasts until the next start.
    within : float
        Time in which it is noticed [s].
    beyond : float
        By how much a joint may pass its limit meanwhile [rad].

    """

    report: Callable[[World, np.random.Generator], Report]
    told: str = 'no joint states of'
    latches: bool = False
    within: float = 0.1
    # A robot that nobody sees goes on until the timeout.
    beyond: float = 0.03


FAULTS = [
    Fault(silence), Fault(one_joint_missing), Fault(frozen, 'by its stamp'),
    Fault(replayed, 'by its stamp'), Fault(old, 'by its stamp'),
    Fault(ahead, 'ahead of the ones before'), Fault(late, 'no joint states of', within=1.0),
    Fault(not_a_number, 'not finite, or beyond'), Fault(named_twice, 'is named twice'),
    Fault(too_few, 'positions)'), Fault(one_jump, 'jumped by', True, 0.01),
    Fault(two_publishers, 'jumped by', True, 0.01),
    Fault(frozen_with_stamps, 'does not follow', True, 1.4, math.inf)]


@outcomes('Joint states', (Outcome(
    fault.report.text, AT_ONCE, START if fault.latches else BY_ITSELF, fault.told,
    fault.within) for fault in FAULTS))
@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS))
@pytest.mark.parametrize('fault', FAULTS, ids=lambda fault: fault.report.__name__)
def test_joint_states_that_cannot_be_believed_stop_the_robot(monkeypatch, fault, output, seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, random, ('joint', 'pose')[seed % 2],
                       rate=(100.0, 0.0)[seed // 2 % 2], output=output)
    world.report = fault.report(world, random)
    # Where cycles follow joint states, a timer looks at them, too.
    watched = min(world.period, 0.5 * world.values['state_timeout'])
    assert world.run(fault.within + STEPS + watched,
                     until=lambda: fault.told in world.stopped()), world.stopped()
    world.settle()
    stopped_at = world.q.copy()
    world.run(0.3)
    assert world.is_at(stopped_at)
    world.report = lambda world: [world.state()]
    if fault.latches:
        world.run(1.1)
        assert world.is_at(stopped_at)
        assert 'call ~/start to go on' in world.stopped()
        start(world)
    assert world.run(world.values['settle_time'] + 0.3, until=world.moving), world.stopped()
    world.run(0.3)
    check(world, fault.beyond)


@pytest.mark.parametrize('output', OUTPUTS)
def test_after_a_clock_that_was_set_the_robot_goes_on(monkeypatch, output):
    random = np.random.default_rng(0)
    world = make_world(monkeypatch, random, output=output)
    world.report = lambda world: [world.state(world.q, world.now - 3600.0)]
    assert world.run(0.2, until=world.stopped)
    assert world.run(3.0, until=world.moving)


@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS, 2))
def test_joint_states_that_stay_late_by_the_same_time_move_nothing(monkeypatch, output, seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, random, rate=(100.0, 0.0)[seed % 2], output=output)
    waiting, delay = [], round(random.uniform(0.15, 0.6) / STATE_PERIOD)

    def report(world):
        waiting.append(world.state())
        return [waiting.pop(0)] if len(waiting) > delay else []

    world.report = report
    assert world.run(0.2, until=world.stopped)
    # A clock that was set would be accepted by then.
    for _ in range(30):
        world.run(0.1)
        assert not world.velocity.any() and 'no joint states' in world.stopped()
    world.report = lambda world: [world.state()]
    assert world.run(1.0, until=world.moving)
    check(world, FAULTS[0].beyond)


@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS, 1))
@pytest.mark.parametrize('fault', [frozen, replayed, old, ahead, late],
                         ids=lambda fault: fault.__name__)
def test_a_fault_that_lasts_is_logged_once_a_second_however_old_it_gets(monkeypatch, fault, output,
                                                                        seed):
    random, lines = np.random.default_rng(seed), []
    world = make_world(monkeypatch, random, rate=(100.0, 0.0)[seed % 2], output=output)
    logger = SimpleNamespace(warning=lines.append, info=lambda text: None)
    world.loop._log = world.loop.measurements._log = log = Log(logger)
    monkeypatch.setattr('tp_controller.ros.log.time',
                        SimpleNamespace(monotonic=lambda: world.now))
    world.report = fault(world, random)
    world.run(3.0, until=log.flush)
    assert any(f'commanding {world.loop.commands.output.stopped}' in line for line in lines)
    # Why they are commanded, that it is over, and that messages are ignored.
    assert len(lines) <= 3 * 4, lines


# Robots at fault ------------------------------------------------------------------------------

@fault_text('one joint stands still, or all')
def blocked(random):
    """Return what stands still, with one joint or all."""
    share = np.where(np.arange(7) == random.integers(7), 0.0, float(random.integers(2)))
    return lambda velocity: share * velocity


@fault_text('joints move the other way')
def reversed_(random):
    """Return what moves the other way."""
    return lambda velocity: -velocity


@fault_text('joints move by a tenth of what is commanded')
def feeble(random):
    """Return what moves by a tenth of what is commanded."""
    return lambda velocity: 0.1 * velocity


@fault_text('joints slide to one side, whatever is commanded')
def adrift(random):
    """Return what slides to one side, whatever is commanded."""
    return lambda velocity: np.full(7, random.choice([-0.8, 0.8]))


PLANTS = blocked, reversed_, feeble, adrift
# One window of 1 s, and 0.4 s that a robot may be late.
FOLLOWS = 1.4


@outcomes('Robot', (Outcome(plant.text, AT_ONCE, START, 'does not follow', FOLLOWS)
                    for plant in PLANTS))
@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS))
@pytest.mark.parametrize('plant', PLANTS)
def test_a_robot_that_does_not_do_as_it_is_told_is_stopped_until_a_start(monkeypatch, plant,
                                                                         output, seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, random, rate=(100.0, 0.0)[seed // 2 % 2], output=output)
    world.plant = plant(random)
    told = 'does not follow', 'has passed its position limit'
    # A joint that stands still has to be one that is commanded to move.
    world.controller.set_goal('reach', np.where(world.q > (ROBOT.lower + ROBOT.upper) / 2.0,
                                                ROBOT.lower, ROBOT.upper), world.now)
    # The goal is set 0.1 s later at most, and a joint may have to turn first.
    assert world.run(FOLLOWS + 0.6, until=lambda: any(text in world.stopped() for text in told))
    assert 'call ~/start to go on' in world.stopped()
    world.settle()
    world.run(0.5)
    assert not world.velocity.any()
    # Positions cannot wait for a robot that moves away from them.
    check(world, math.inf, 0.2 if plant in (blocked, feeble) else math.inf)
    world.plant = ideal
    if world.holds:
        # It comes to where it is blocked.
        world.run(1.0)
    start(world)
    assert world.run(1.0, until=world.moving)


# No false alarms ------------------------------------------------------------------------------

class Drives:
    """Drives that are late and follow with a lag."""

    def __init__(self, delay, lag):
        self._waiting, self._share = [np.zeros(7)] * round(delay / 1e-3), min(1e-3 / lag, 1.0)
        self._velocity = np.zeros(7)

    def __call__(self, velocity):
        """Return the velocities of a robot that is commanded to move."""
        self._waiting.append(velocity)
        self._velocity = self._velocity + self._share * (self._waiting.pop(0) - self._velocity)
        return self._velocity


def noisy(random):
    """Return joint states with noise."""
    return lambda world: [world.state(world.q + random.normal(0.0, 1e-3, 7))]


def quantised(random):
    """Return joint states of encoders with few steps."""
    step = 2.0 * math.pi / 2048.0
    return lambda world: [world.state(step * np.round(world.q / step))]


def lossy(random):
    """Return joint states of which one in ten is lost."""
    return lambda world: [world.state(world.q)] if random.random() > 0.1 else []


def out_of_order(random):
    """Return joint states that overtake each other."""
    waiting = []

    def report(world):
        waiting.append(world.state(world.q))
        if len(waiting) < 4:
            return []
        ready = [waiting.pop(index) for index in (2, 0)]
        return ready
    return report


def irregular(random):
    """Return joint states that are up to 30 ms late."""
    waiting = []

    def report(world):
        waiting.append(world.state(world.q))
        if len(waiting) < random.integers(1, 7):
            return []
        ready, waiting[:] = list(waiting), []
        return ready
    return report


def without_stamps(random):
    """Return joint states without stamps."""
    def report(world):
        message = world.state(world.q)
        message.header.stamp.sec = message.header.stamp.nanosec = 0
        return [message]
    return report


def in_turns(random):
    """Return the joint states of two publishers, each for some of the joints."""
    def report(world):
        part = slice(0, 3) if random.integers(2) else slice(3, 7)
        return [world.state(world.q[part], names=JOINTS[part])]
    return report


def everything(random):
    """Return joint states with noise, of few steps, irregular and with losses."""
    step, gaps = 2.0 * math.pi / 4096.0, irregular(random)

    def report(world):
        exact, world.q = world.q, step * np.round(
            (world.q + random.normal(0.0, 5e-4, 7)) / step)
        ready = gaps(world)
        world.q = exact
        return [message for message in ready if random.random() > 0.1]
    return report


DRIVES = {noisy: (0.0, 0.05), everything: (0.02, 0.05)}


@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS, 3))
@pytest.mark.parametrize('report', [noisy, quantised, lossy, out_of_order, irregular,
                                    without_stamps, in_turns, everything])
def test_a_robot_that_is_only_measured_badly_is_never_stopped(monkeypatch, report, output, seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, random, rate=(100.0, 0.0, 500.0)[seed % 3], output=output)
    world.report = report(random)
    world.plant = Drives(*DRIVES.get(report, (0.0, 1e-3)))
    world.told.clear()
    world.run(1.5)
    send_goal(world, random)
    world.run(1.5)
    # And at rest.
    world.controller.set_goal('reach', np.clip(world.q, ROBOT.lower, ROBOT.upper), world.now)
    world.run(1.5)
    assert world.told == []
    # What is late, or wrong by a little, is not known better.
    assert world.monitor.faults(promise_of(ROBOT, world.period, math.inf, 0.05)) == []


# Stalls ---------------------------------------------------------------------------------------

@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS, 2))
@pytest.mark.parametrize('rate', [100.0, 1000.0, 0.0])
def test_after_a_stall_of_its_own_the_motion_begins_from_rest(monkeypatch, rate, output, seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, random, rate=rate, output=output)
    world.receiver_timeout = 0.1
    world.run(random.uniform(0.0, 0.05))
    world.frozen = True
    world.run(random.uniform(0.2, 4.0))
    resumed, count = world.q.copy(), len(world.monitor.commands)
    world.frozen = False
    assert world.run(0.02 + world.period, until=world.stopped) and not world.velocity.any()
    assert 'the node stood still for' in world.stopped() and world.loop.figures.stalls == 1
    world.run(0.9 * world.values['settle_time'])
    assert world.is_at(resumed)
    assert world.run(0.3, until=lambda: bool(world.velocity.any()))
    assert not any(velocity.any() for _, velocity, _ in world.monitor.commands[count:-1])
    # Between two joint states, where these set the pace.
    passed = 1.0 / rate if rate else 2.0 * STATE_PERIOD
    assert (np.abs(world.velocity) <= ACCELERATIONS * np.array(passed) + 1e-9).all()
    world.run(0.5)
    check(world)


@pytest.mark.parametrize('deceleration', [0.0, 0.5])
@pytest.mark.parametrize('rate', [100.0, 0.0])
def test_a_command_is_not_sent_after_a_stall_that_began_once_it_was_computed(
        monkeypatch, rate, deceleration):
    world = make_world(monkeypatch, np.random.default_rng(0), rate=rate,
                       stop_deceleration=deceleration)
    world.run(0.05)
    assert world.moving()
    if deceleration:
        world.loop.hold = 'a ramp'
    publish, count = world.loop.commands.publish, len(world.monitor.commands)

    def late(*arguments):
        world.now += 2.0
        return publish(*arguments)

    monkeypatch.setattr(world.loop.commands, 'publish', late)
    world.run(0.03)
    sent = [velocity for _, velocity, _ in world.monitor.commands[count:]]
    assert sent and not np.any(sent)


def at_once(world, ages):
    """Return joint states that arrive together, each so long after it was made."""
    return [world.state(stamp=world.now - age) for age in sorted(ages, reverse=True)]


def take_time(patch, world, seconds):
    """Let every cycle take time."""
    update = world.controller.update

    def timed(*given):
        world.now += seconds
        return update(*given)

    patch.setattr(world.controller, 'update', timed)


@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS, 2))
def test_of_joint_states_that_waited_only_the_newest_is_answered(monkeypatch, output, seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, random, rate=0.0, output=output)
    take_time(monkeypatch, world, 1e-4)
    world.frozen = True
    # Too short to count as a stall.
    world.run(random.uniform(0.011, 0.045))
    world.frozen, count = False, len(world.monitor.commands)
    world.run(0.001)
    assert len(world.monitor.commands) == count + 1 and world.velocity.any()
    assert (world.loop.measurements.joints.q == world.sent).all()
    check(world)


@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS, 2))
def test_joint_states_that_waited_for_a_moment_are_answered_one_by_one(monkeypatch, output, seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, random, rate=0.0, output=output)
    take_time(monkeypatch, world, 1e-4)
    count, size = len(world.monitor.commands), random.integers(2, 10)
    ages = random.uniform(0.0, 0.9 * STATE_PERIOD, size)
    world.report = lambda world: [*at_once(world, ages), world.state()]
    world.run(20 * STATE_PERIOD)
    assert len(world.monitor.commands) == count + 20 * (size + 1)
    assert world.velocity.any()
    # Positions count from the begin of a cycle, which the monitor does not know.
    if not world.holds:
        check(world)


@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS, 2))
def test_a_loop_that_falls_behind_does_not_answer_all_joint_states(monkeypatch, output, seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, random, rate=0.0, output=output)
    took = random.uniform(0.0015, 0.003)
    take_time(monkeypatch, world, took)
    world.report = lambda world: [*at_once(world, 1e-4 * np.arange(1, 18)), world.state()]
    count = len(world.monitor.commands)
    world.run(STATE_PERIOD)
    # The last of them is the newest, alone.
    assert count + 0.01 / took < len(world.monitor.commands) <= count + 0.01 / took + 3
    assert (world.loop.measurements.joints.q == world.sent).all()


@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS, 2))
def test_a_burst_of_old_joint_states_moves_nothing_before_it_is_over(monkeypatch, output, seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, random, rate=(100.0, 0.0)[seed % 2], output=output)
    waiting = []

    def keep(world):
        waiting.append(world.state())
        return []

    world.report = keep
    world.run(random.uniform(0.3, 2.0))
    assert not world.velocity.any() and 'no joint states' in world.stopped()
    world.report = lambda world: [*(waiting.pop(0) for _ in tuple(waiting)), world.state()]
    count = len(world.monitor.commands)
    world.run(0.8 * world.values['settle_time'])
    assert not any(velocity.any() for _, velocity, _ in world.monitor.commands[count:])
    assert world.run(0.5, until=world.moving)
    check(world, FAULTS[0].beyond)


def stopped(world):
    """Command zeros from another thread, as ~/stop does."""
    world.loop.commands.interrupt()


def deactivated(world):
    """Deactivate the loop and activate it at once."""
    world.loop.deactivate('inactive')
    world.loop.activate()


@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS))
@pytest.mark.parametrize('act', [stopped, deactivated])
def test_after_zeros_from_elsewhere_the_motion_begins_from_rest(monkeypatch, act, output, seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, random, rate=(100.0, 0.0)[seed % 2], output=output)
    world.run(random.uniform(0.0, 0.1))
    act(world)
    # A robot that is told positions has to brake first.
    if world.holds:
        assert world.run(0.5, until=lambda: world.loop.commands.output.at_rest)
        world.run(0.02, until=lambda: not world.velocity.any())
    assert not world.velocity.any()
    assert world.run(0.5, until=lambda: bool(world.velocity.any()))
    passed = 1.0 / (world.values['rate'] or 1.0 / (2.0 * STATE_PERIOD))
    assert (np.abs(world.velocity) <= ACCELERATIONS * np.array(passed) + 1e-9).all()
    check(world)


@pytest.mark.parametrize('output', OUTPUTS)
@pytest.mark.parametrize('rate', [100.0, 1000.0, 0.0])
def test_after_an_activation_only_what_arrives_then_counts(monkeypatch, rate, output):
    world = make_world(monkeypatch, np.random.default_rng(0), rate=rate, output=output)
    world.loop.come_to_rest('inactive')
    world.settle()
    assert not world.loop.active
    world.loop.hold = ''
    # Moved by hand, sooner than joint states get old.
    world.q = np.clip(world.q + 0.05, ROBOT.lower, ROBOT.upper)
    there = world.setpoint = world.q.copy()
    world.controller.forget_goals()
    world.loop.activate()
    world.run(0.5)
    assert not world.stopped() and (world.q == there).all()


# Load -----------------------------------------------------------------------------------------

@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS, 3))
def test_joint_states_that_are_late_now_and_then_do_not_make_the_robot_flip(monkeypatch, output,
                                                                            seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, random, output=output)
    due = [0.0]

    def report(world):
        if world.now < due[0]:
            return []
        due[0] = world.now + random.uniform(0.02, 0.14)
        return [world.state()]

    world.report, runs, before = report, 0, world.stopped()
    for _ in range(500):
        world.run(0.01)
        runs += bool(before) and not world.stopped()
        before = world.stopped()
    assert runs <= 5.0 / (world.values['settle_time'] + world.values['state_timeout'])
    check(world, FAULTS[0].beyond)


# Changes --------------------------------------------------------------------------------------

def toggled(world, random):
    """Switch the second task on and off."""
    world.controller.enable('posture', bool(random.integers(2)))


def damped(world, random):
    """Set the damping anew."""
    world.controller.settings = replace(world.controller.settings,
                                        damping=random.uniform(0.05, 0.15))


def replaced(world, random):
    """Replace the stack by one that only differs in a gain."""
    gain = random.uniform(0.4, 0.6)
    world.controller.replace_stack(
        Stack.from_yaml(STACKS['pose'].replace('0.5', f'{gain:.3f}'), world.robot))


def repeated(world, random):
    """Send the goal again."""
    world.controller.set_goal('reach', world.goal, world.now)


@pytest.mark.parametrize(('output', 'seed'), runs(SEEDS, 1))
@pytest.mark.parametrize('change', [toggled, damped, replaced, repeated])
def test_changes_that_repeat_do_not_keep_the_robot_from_its_goal(monkeypatch, change, output,
                                                                 seed):
    random = np.random.default_rng(seed)
    world = make_world(monkeypatch, random, 'pose', output=output)
    # A goal that is reached for certain: nearby, within the limits.
    q = np.clip(world.q + random.uniform(-0.3, 0.3, 7), ROBOT.lower + 0.3, ROBOT.upper - 0.3)
    world.goal = ROBOT.state(q).pose(PANDA_TOOL)
    world.controller.set_goal('reach', world.goal, world.now)
    for _ in range(400):
        world.run(0.01)
        change(world, random)
    reached = world.robot.state(world.q).pose(PANDA_TOOL)
    assert np.abs(reached - world.goal).max() < 5e-3
    assert not world.stopped()
    check(world)
