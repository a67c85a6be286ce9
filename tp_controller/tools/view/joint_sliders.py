# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Joint sliders of the page, which set the goals of joint tasks."""

from collections.abc import Callable, Sequence
import math

from sensor_msgs.msg import JointState
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.tools.view.gizmos import SEND_PERIOD
from tp_controller.tools.view.stack_panel import assign
import viser

# Range of the slider of a joint without limits, and bound from which on a limit is ignored
# [rad or m].
DEFAULT_RANGE, MOST_RANGE = math.pi, 10.0 * math.pi
# Digits that fit into the box beside a slider, with a sign and a point; largest number of
# decimals.
BOX_DIGITS, MOST_DECIMALS = 4, 3


class JointSliders:
    """
    Slider for each driven joint; sliders without user input follow the joint.

    Parameters
    ----------
    gui : viser.GuiApi
    moved : callable
        Called with a joint name and its desired position; it calls `move` later.

    Attributes
    ----------
    task : viser.GuiDropdownHandle or None
        Task that receives the goals.
    sliders : dict
        {joint: viser.GuiSliderHandle}; the sliders of another robot are reused, since a slow
        browser may still have updates of them.

    """

    def __init__(self, gui: viser.GuiApi, moved: Callable[[str, float], None]) -> None:
        self._gui, self._on_moved = gui, moved
        self._folder = gui.add_folder(None)
        with self._folder:
            self._hint = gui.add_markdown('No task of the stack takes joint positions.')
            self.task = gui.add_dropdown('task', ('',), visible=False)
            self._reset = gui.add_button('Show where the joints are', visible=False)
        self._reset.on_click(lambda _: self._moved.clear())
        self._moved: set[str] = set()
        self._desired: dict[str, float] = {}
        self._send_time = -math.inf
        self._all: list[viser.GuiSliderHandle[float]] = []
        self.sliders: dict[str, viser.GuiSliderHandle[float]] = {}

    def build(self, robot: Robot) -> None:
        """Create the sliders of the joints of a robot."""
        self._moved.clear()
        with self._folder:
            while len(self._all) < len(robot.joint_names):
                self._all.append(self._new_slider())
        self.sliders = dict(zip(robot.joint_names, self._all))
        for name, slider in self.sliders.items():
            self._prepare(slider, robot, name)
        for slider in self._all[len(self.sliders):]:
            slider.visible = False

    def show(self, robot: Robot, q: Array | None, tasks: Sequence[str]) -> None:
        """Show the joint positions of q (nq,) and the tasks with joint goals."""
        shown = bool(tasks)
        self._hint.visible = not shown
        for handle in (self.task, self._reset, *self.sliders.values()):
            handle.visible = shown
        if tasks and tuple(tasks) != tuple(self.task.options):
            self.task.options = tuple(tasks)
        if q is None:
            return
        for name, position in zip(robot.joint_names, q[robot.joint_rows].tolist()):
            if name not in self._moved:
                slider = self.sliders[name]
                inside = round(min(max(position, slider.min), slider.max), slider.precision)
                if inside != slider.value:
                    assign(slider, inside)

    def move(self, name: str, position: float) -> None:
        """Set the desired position of a joint [rad or m]."""
        self._desired[name] = position

    def due(self, now: float) -> JointState | None:
        """Return the goal to publish now; None if there is none."""
        if not self._desired or now - self._send_time < SEND_PERIOD:
            return None
        desired, self._desired, self._send_time = self._desired, {}, now
        return JointState(name=list(desired), position=list(desired.values()))

    def _new_slider(self) -> 'viser.GuiSliderHandle[float]':
        """Return a hidden slider without a joint."""
        slider = self._gui.add_slider('', -DEFAULT_RANGE, DEFAULT_RANGE, 0.1, 0.0, visible=False)

        @slider.on_update
        def _(event: 'viser.GuiEvent[viser.GuiSliderHandle[float]]') -> None:
            if event.client_id is not None:
                for name, each in self.sliders.items():
                    if each is slider:
                        self._moved.add(name)
                        self._on_moved(name, float(event.target.value))

        return slider

    def _prepare(self, slider: 'viser.GuiSliderHandle[float]', robot: Robot, name: str) -> None:
        """Assign a slider to a joint."""
        row = robot.joint_index(name)
        slider.min, slider.max, slider.precision = span(
            float(robot.lower[row]), float(robot.upper[row]))
        slider.step = 10.0 ** -slider.precision
        slider.label, slider.hint = name, robot.velocity_units[row]
        assign(slider, min(max(0.0, slider.min), slider.max))


def span(lower: float, upper: float) -> tuple[float, float, int]:
    """
    Return the range and the decimals of the slider of a joint.

    Parameters
    ----------
    lower, upper : float
        Limits of the joint, infinite where it has none [rad or m].

    Returns
    -------
    low, high : float
        Range within the limits, rounded to the decimals unless it would be empty [rad or m].
    decimals : int

    """
    if lower < -MOST_RANGE:
        lower = min(-DEFAULT_RANGE, upper - 2.0 * DEFAULT_RANGE)
    if upper > MOST_RANGE:
        upper = max(DEFAULT_RANGE, lower + 2.0 * DEFAULT_RANGE)
    whole = len(str(int(max(abs(lower), abs(upper)))))
    decimals = min(max(BOX_DIGITS - whole, 0), MOST_DECIMALS)
    unit = 10.0 ** decimals
    low, high = math.ceil(lower * unit) / unit, math.floor(upper * unit) / unit
    return (low, high, decimals) if low < high else (lower, upper, decimals)
