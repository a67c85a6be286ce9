# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""What takes long beside the loop waits for the gaps between its cycles."""

from itertools import count
import threading

from harness import Arm, Status
import pytest
from tp_controller.ros.interface import reporter
from tp_controller.ros.loop.cycle_scheduling import Gaps

STACK = """
- tip: {type: position, frame: link3, axes: xy}
- rest: {type: posture, target: [0.0, 0.0, 0.0]}
"""
# So long that no test waits for its end [s].
LONG = 60.0


def let_cycles_end(gaps, between):
    """Let two cycles end, some time after each other [s]."""
    gaps.begin(10.0)
    gaps.begin(10.0 + between)


def waits_of(gaps, monkeypatch):
    """Return a list that is added to whenever somebody really waits, which ends at once then."""
    waited = []
    monkeypatch.setattr(gaps._ended, 'wait', lambda timeout: waited.append(timeout) or True)
    return waited


def test_the_end_of_a_cycle_is_waited_for():
    gaps, opened, enough = Gaps(LONG), [], threading.Event()
    let_cycles_end(gaps, 1e-3)

    def cycle():
        for number in count(1):
            opened.append(number)
            gaps.begin(11.0 + 1e-3 * number)
            if enough.wait(1e-3):
                return

    loop = threading.Thread(target=cycle)
    loop.start()
    try:
        for _ in range(20):
            before = len(opened)
            gaps.wait()
            assert len(opened) > before
    finally:
        enough.set()
        loop.join()


@pytest.mark.parametrize('rate, waits', [(2000.0, True), (1000.0, True), (500.0, False),
                                         (100.0, False)])
def test_cycles_that_are_far_apart_are_not_waited_for(rate, waits, monkeypatch):
    gaps = Gaps()
    waited = waits_of(gaps, monkeypatch)
    gaps.wait()
    assert not waited
    let_cycles_end(gaps, 1.0 / rate)
    gaps.wait()
    assert bool(waited) == waits


def test_cycles_that_have_ended_for_good_are_not_waited_for_twice(monkeypatch):
    gaps, waited = Gaps(), []
    monkeypatch.setattr(gaps._ended, 'wait', waited.append)
    let_cycles_end(gaps, 1e-3)
    gaps.wait()
    gaps.wait()
    assert len(waited) == 1
    let_cycles_end(gaps, 1e-3)
    gaps.wait()
    assert len(waited) == 2


def test_the_loop_says_when_a_cycle_has_ended(harness):
    controller, arm = harness.controller(stack=STACK), Arm(harness, (0.0, 0.6, 0.3))
    harness.spin_until(lambda: controller._robot.loop.figures.cycles > 3, meanwhile=arm.publish)
    loop = controller._robot.loop
    assert loop.gaps._last == loop.completed and loop.gaps._between < 15.0


def test_every_part_of_a_status_waits(harness, monkeypatch):
    waits, parts = [], []
    monkeypatch.setattr(Gaps, 'wait', lambda self: waits.append(len(parts)))
    original = reporter.diagnostics
    monkeypatch.setattr(reporter, 'diagnostics',
                        lambda *arguments: parts.append(1) or original(*arguments))
    harness.controller(stack=STACK)
    status, arm = Status(harness), Arm(harness, (0.0, 0.6, 0.3))
    harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)
    made = len(parts)
    harness.spin_until(lambda: len(parts) > made, meanwhile=arm.publish)
    # What came in, the figures and the head of this one; before, of two tasks, what limits them
    # and the rest; and sending.
    assert waits.count(made) >= 3 and waits.count(made + 1) >= 5


def test_no_status_is_made_where_nobody_listens(harness, monkeypatch):
    made = []
    original = reporter.diagnostics
    monkeypatch.setattr(reporter, 'diagnostics',
                        lambda *arguments: made.append(1) or original(*arguments))
    controller = harness.controller(stack=STACK, status_rate=100.0)
    arm = Arm(harness, (0.0, 0.6, 0.3))
    harness.spin_until(lambda: controller._robot.loop.figures.cycles > 50, meanwhile=arm.publish)
    assert not made
    status = Status(harness)
    harness.spin_until(lambda: status.head == 'running', meanwhile=arm.publish)
    assert made
