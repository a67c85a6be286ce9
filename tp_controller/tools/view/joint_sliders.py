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

"""Sliders of joints on the page, by which tasks about joints get their goals."""

from collections.abc import Callable, Sequence
import math

from sensor_msgs.msg import JointState
from tp_controller.model.robot import Robot
from tp_controller.model.spatial import Array
from tp_controller.tools.view.gizmos import PERIOD
from tp_controller.tools.view.stack_panel import assign
import viser

# Positions between which a joint without limits is moved, and from where on a limit counts as none
# [rad or m].
ENDLESS, FAR = math.pi, 10.0 * math.pi
# The box beside a slider is as wide as a sign, a point and so many digits; after the point there
# are as many as that leaves, and no more than somebody needs.
DIGITS, MOST_DECIMALS = 4, 3


class JointSliders:
    """
    A slider for each driven joint; those that nobody has moved show where the joint is.

    Parameters
    ----------
    gui : viser.GuiApi
    moved : callable
        Told the name of a joint, and where it is to be; it calls `move` in its time.

    Attributes
    ----------
    task : viser.GuiDropdownHandle or None
        The task that gets the goals.
    sliders : dict
        {joint: viser.GuiSliderHandle}; those of another robot are used again, since a browser
        that draws seldom may still have updates of them.

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
        self._wanted: dict[str, float] = {}
        self._sent = -math.inf
        self._all: list[viser.GuiSliderHandle[float]] = []
        self.sliders: dict[str, viser.GuiSliderHandle[float]] = {}

    def build(self, robot: Robot) -> None:
        """Have sliders for the joints of a robot."""
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
        """Show where joints are at q (nq,), and the tasks that take positions of them."""
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
        """Take where a joint is to be [rad or m]."""
        self._wanted[name] = position

    def due(self, now: float) -> JointState | None:
        """Return the goal that is to be sent now, if there is one."""
        if not self._wanted or now - self._sent < PERIOD:
            return None
        wanted, self._wanted, self._sent = self._wanted, {}, now
        return JointState(name=list(wanted), position=list(wanted.values()))

    def _new_slider(self) -> 'viser.GuiSliderHandle[float]':
        """Return a slider of no joint yet."""
        slider = self._gui.add_slider('', -ENDLESS, ENDLESS, 0.1, 0.0, visible=False)

        @slider.on_update
        def _(event: 'viser.GuiEvent[viser.GuiSliderHandle[float]]') -> None:
            if event.client_id is not None:
                for name, each in self.sliders.items():
                    if each is slider:
                        self._moved.add(name)
                        self._on_moved(name, float(event.target.value))

        return slider

    def _prepare(self, slider: 'viser.GuiSliderHandle[float]', robot: Robot, name: str) -> None:
        """Let a slider be that of a joint."""
        row = robot.joint_index(name)
        slider.min, slider.max, slider.precision = span(
            float(robot.lower[row]), float(robot.upper[row]))
        slider.step = 10.0 ** -slider.precision
        slider.label, slider.hint = name, robot.velocity_units[row]
        assign(slider, min(max(0.0, slider.min), slider.max))


def span(lower: float, upper: float) -> tuple[float, float, int]:
    """
    Return between which positions a slider moves a joint, and with how many decimals.

    Parameters
    ----------
    lower, upper : float
        Limits of the joint, infinite where it has none [rad or m].

    Returns
    -------
    low, high : float
        Within the limits, with no more decimals than that, unless nothing else is within them
        [rad or m].
    decimals : int

    """
    if lower < -FAR:
        lower = min(-ENDLESS, upper - 2.0 * ENDLESS)
    if upper > FAR:
        upper = max(ENDLESS, lower + 2.0 * ENDLESS)
    whole = len(str(int(max(abs(lower), abs(upper)))))
    decimals = min(max(DIGITS - whole, 0), MOST_DECIMALS)
    unit = 10.0 ** decimals
    low, high = math.ceil(lower * unit) / unit, math.floor(upper * unit) / unit
    return (low, high, decimals) if low < high else (lower, upper, decimals)
