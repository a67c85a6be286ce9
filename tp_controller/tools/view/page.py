# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Page of a controller: shows its state, and forwards the actions of users."""

from collections import deque
from collections.abc import Callable, Sequence
from contextlib import suppress
from functools import partial
from html import escape
import sys
import time
from traceback import format_exception

import numpy as np
from tp_controller.errors import in_words, TpControllerError
from tp_controller.ros.client.status import TaskStatus
from tp_controller.ros.parameters import TASKS
from tp_controller.tasks import task_types
from tp_controller.tools.view.camera import FIELD_OF_VIEW, first_view
from tp_controller.tools.view.draggables import draggables_of, Topics
from tp_controller.tools.view.gizmos import Gizmos
from tp_controller.tools.view.joint_sliders import JointSliders
from tp_controller.tools.view.link import Link
from tp_controller.tools.view.lock_panel import LockPanel
from tp_controller.tools.view.markers import MarkerScene
from tp_controller.tools.view.plots import Plots, Sample
from tp_controller.tools.view.scene import add_ground, add_sky, RobotScene, tip, Trail
from tp_controller.tools.view.stack_edits import StackChanges
from tp_controller.tools.view.stack_panel import assign, StackPanel
from tp_controller.tools.view.status import BAD, Condition, ConditionReader
from tp_controller.untrusted.texts import plain
import viser
from visualization_msgs.msg import Marker

# Frame rate [1/s]; period of the texts, with and without a browser [s].
RATE, TEXT_SECONDS, UNSEEN_SECONDS = 30.0, 0.2, 1.0
# Longest wait of the first view for the gizmos, which must be in it [s].
VIEW_SECONDS = 2.0
# Notice after a restart of the controller.
RESTARTED = ('the controller has been restarted and has no goals; drag them, or send them '
             'again')
# Largest number of pending actions of browsers; others are dropped.
MOST_WAITING = 100
# Largest number of internal errors that are reported; longest report [characters].
MOST_INTERNAL_ERRORS, LONGEST_INTERNAL_ERROR = 10, 5000
# Display time of a notice [s].
NOTICE_SECONDS = 12.0
# Colours of refusals and of remarks.
REFUSAL_COLOURS = '#fdecea;color:#8c1d18'
REMARK_COLOURS = '#eef1f4;color:#5b6470'


class Page:
    """
    Page of a controller, shared by all browsers that open it.

    Actions in a browser wait until the next `update`, which is called `RATE` times a second: all
    ROS calls happen there, on one thread.

    Parameters
    ----------
    server : viser.ViserServer
    link : Link

    Attributes
    ----------
    stack : StackPanel
    stop_button, start_button : viser.GuiButtonHandle
    locks : LockPanel
    state_text : viser.GuiHtmlHandle
        State of the controller.
    notice : Notice
        Last refusal or remark.

    """

    def __init__(self, server: viser.ViserServer, link: Link) -> None:
        self.server, self.link = server, link
        self._waiting: deque[Callable[[], None]] = deque()
        self._errors: set[tuple[str, type]] = set()
        self._robot: RobotScene | None = None
        self._texts_due = 0.0
        self._condition, self._reader = Condition('', ''), ConditionReader()
        self._concluded = False
        add_sky(server.scene)
        self._ground, self._grounded = add_ground(server.scene), False
        # Time at which the first view is due, with or without gizmos; None: not now.
        self._view_due: float | None = None
        server.initial_camera.fov = FIELD_OF_VIEW
        self._markers = MarkerScene(server.scene)
        self._changes = StackChanges(link, self._show_answer)
        self.gizmos = Gizmos(server.scene, link.client.publish, self._changes.set_key)
        self._trail = Trail(server.scene, '/path')
        self._topics: Topics = {}
        self._drawn: Sequence[Marker] = ()
        self._accepted: dict[str, int] = {}
        self._refused: dict[str, int] = {}
        gui = server.gui
        self.state_text = gui.add_html('')
        self.stop_button = gui.add_button('Stop', color='red', icon=viser.Icon.HAND_STOP)
        self.start_button = gui.add_button('Start', color='green', icon=viser.Icon.PLAYER_PLAY)
        self.notice = Notice(gui)
        self.stop_button.on_click(lambda _: self._stop())
        self.start_button.on_click(lambda _: self._later(lambda: link.start(self._show_answer)))
        self._add_tabs(gui)

    def _add_tabs(self, gui: viser.GuiApi) -> None:
        """Add the buttons of locks and the tabs below the others."""
        link, later = self.link, self._later
        self.locks = LockPanel(gui, lambda on: later(lambda: link.lock(on, self.notice.answer)))
        tabs = gui.add_tab_group()
        with tabs.add_tab('Stack', viser.Icon.LIST_NUMBERS):
            self.stack = StackPanel(
                gui, lambda task, on: later(lambda: link.enable(task, on, self._show_answer)),
                lambda task, step: later(lambda: self._changes.move(task, step)),
                lambda task, gain: later(lambda: link.set_parameters(
                    {f'{TASKS}{task}.gain': gain}, self._show_answer)))
        with tabs.add_tab('Joints', viser.Icon.ADJUSTMENTS):
            self.joints = JointSliders(
                gui, lambda name, value: later(lambda: self.joints.move(name, value)))
        self.plots = Plots(gui, tabs.add_tab('Plots', viser.Icon.CHART_LINE))
        with tabs.add_tab('Scene', viser.Icon.CUBE):
            self.frame = gui.add_dropdown('frame', ('',), hint='whose path and manipulability '
                                          'are shown')
            self.handles = {group: gui.add_checkbox(f'drag {group}', True)
                            for group in self.gizmos.shown}
            self.trail = gui.add_checkbox('path', True)

    def update(self) -> None:
        """
        Execute pending actions, process new data of the controller, and update the page.

        An exception in one step does not prevent the others.
        """
        for _ in range(len(self._waiting)):
            self._attempt('act', self._act)
        watched = bool(self.server.get_clients())
        now = time.monotonic()
        self._attempt('change the stack', self._changes.update)
        self._attempt('listen', self.link.update)
        # All that the first view depends on is received even without a browser.
        self._attempt('look', partial(self.link.watch, watched or self.link.q is None
                                      or self._view_due is not None))
        self._attempt('show the robot', self._show_robot)
        self._attempt('send goals', self._send_goals)
        if now >= self._texts_due and not self._concluded:
            self._texts_due = now + (TEXT_SECONDS if watched else UNSEEN_SECONDS)
            self._attempt('show the state', partial(self._show_state, now))
            self._attempt('show the tasks', partial(self._show_tasks, now))

    def turn(self, seconds: float = 1.0 / RATE) -> None:
        """Update, and wait until a time has passed since the start of the call [s]."""
        due = time.monotonic() + seconds
        self.update()
        time.sleep(max(due - time.monotonic(), 0.0))

    def conclude(self, text: str) -> None:
        """
        Show the results of a finished demo from now on: its nodes are about to end.

        Parameters
        ----------
        text : str
            Lines, with a title in the first.

        """
        title, _, results = text.partition('\n')
        # The last report, which is shown less often than it comes.
        self._attempt('show the tasks', partial(self._show_tasks, time.monotonic()))
        self._concluded = True
        self.notice.clear()
        self.stop_button.visible = self.start_button.visible = False
        self.locks.show('', '')
        self.state_text.content = (
            f'<div data-state="{escape(title)}" style="padding:4px 12px"><b>{escape(title)}</b>'
            '<div style="white-space:pre-wrap;font-size:0.85em;padding-top:4px">'
            f'{escape(results)}</div></div>')

    def _act(self) -> None:
        """Execute the oldest pending action, unless Stop has dropped it."""
        # Stop is handled on a thread of the server.
        try:
            action = self._waiting.popleft()
        except IndexError:
            return
        action()

    def _later(self, action: Callable[[], None]) -> None:
        """Execute an action in the next `update`."""
        if len(self._waiting) < MOST_WAITING:
            self._waiting.append(action)

    def _stop(self) -> None:
        """Stop the robot in the next `update`; earlier pending actions are dropped."""
        self._waiting.clear()
        self._later(lambda: self.link.stop(self._show_answer))

    def _attempt(self, what: str, action: Callable[[], None]) -> None:
        """Execute an action, and report its failure."""
        try:
            action()
        except TpControllerError as error:
            self._show_answer(False, str(error))
        except Exception as error:
            # The page continues after any error: its Stop must work.
            self._report(what, error)

    def _report(self, what: str, error: Exception) -> None:
        """Report an internal error, once."""
        kind = what, type(error)
        if kind in self._errors or len(self._errors) >= MOST_INTERNAL_ERRORS:
            return
        self._errors.add(kind)
        # A closed terminal, or a full disk, must not end the page.
        with suppress(OSError, ValueError):
            print(plain(''.join(format_exception(error)), LONGEST_INTERNAL_ERROR, lines=True),
                  file=sys.stderr, flush=True)
        self._show_answer(False, f'internal error: cannot {what}: {in_words(error)}')

    def _show_answer(self, worked: bool, text: str) -> None:
        """Show the reason of a refusal; clear the notice on success."""
        if worked:
            self.notice.clear()
        else:
            self.notice.refuse(text)

    def _show_robot(self) -> None:
        """Show the robot at its configuration, and the markers of its tasks."""
        link = self.link
        if link.robot is None:
            return
        if self._robot is None or self._robot.robot is not link.robot:
            self._replace_robot()
        if self._robot is not None and link.q is not None:
            markers = link.markers if link.present else []
            with self.server.atomic():
                self._robot.show(link.q, link.passive)
                if not self._grounded:
                    self._grounded = True
                    self._place_ground(self._robot)
                    self._view_due = time.monotonic() + VIEW_SECONDS
                self._show_path()
                if markers is not self._drawn or not markers:
                    self._drawn = markers
                    self._markers.draw(markers)
                    self._show_gizmos(markers)
                if self._view_due is not None and (
                        self._topics and self.gizmos.gizmos or time.monotonic() > self._view_due):
                    self._view_due = None
                    self._set_initial_camera(self._robot)

    def _show_gizmos(self, markers: Sequence[Marker]) -> None:
        """Update the gizmos."""
        for group, chosen in self.handles.items():
            self.gizmos.shown[group] = chosen.value
        self.gizmos.follow(draggables_of(markers, self._topics, self._changes.numbers))

    def _send_goals(self) -> None:
        """Publish dragged goals and joint goals."""
        self.gizmos.send()
        goal = self.joints.due(time.monotonic())
        if goal is not None and self.joints.task.value:
            self.link.client.publish(self.joints.task.value, 'goal', goal)

    def _show_path(self) -> None:
        """Show the path of the chosen frame."""
        if self._robot is not None and self.trail.value and self.frame.value:
            self._trail.add(self._robot.state.position(self.frame.value))
        else:
            self._trail.clear()

    def _replace_robot(self) -> None:
        """Show another robot, in place of the previous one."""
        link = self.link
        if link.robot is None:
            return
        if self._robot is not None:
            self._robot.remove()
        self._robot, self._grounded = RobotScene(self.server.scene, link.robot), False
        self._place_ground(self._robot)
        self.joints.build(link.robot)
        self._trail.clear()
        self.frame.options = link.robot.frame_names
        assign(self.frame, tip(link.robot))

    def _place_ground(self, robot: RobotScene) -> None:
        """Place the ground below a robot."""
        self._ground.position = (0.0, 0.0, robot.ground())

    def _set_initial_camera(self, robot: RobotScene) -> None:
        """
        Point the cameras of present and future browsers at a robot and its gizmos.

        Browsers apply only the first initial camera, so it is set once the configuration and the
        gizmos are known. From then on users control their cameras.
        """
        camera = self.server.initial_camera
        camera.position, camera.look_at = first_view(
            np.concatenate((robot.outer_points(), self.gizmos.tips())), moves=robot.robot.moves)

    def _show_tasks(self, now: float) -> None:
        """Show the stack and the state of its tasks."""
        link = self.link
        self._topics = link.client.tasks()
        self._changes.read()
        self.stack.show(link.rows, link.gains(), link.present)
        self._show_refusals()
        if link.robot is not None and self._robot is not None:
            self.joints.show(link.robot, link.q, _joint_tasks(link.rows))
            self.plots.add(now, Sample(link.rows, link.robot, self._robot.state, link.velocity,
                                       self.frame.value))

    def _show_state(self, now: float) -> None:
        """Update the state of the controller, the buttons and the notice."""
        link = self.link
        self._show_condition()
        self.start_button.disabled = not self._condition.waits
        self.locks.show(link.status_value('not following'), link.status_value('locked'))
        self.stop_button.disabled = not link.present and not link.reachable
        self.notice.expire(now)

    def _show_condition(self) -> None:
        """Show the state of the controller, and warn about a slow machine."""
        link = self.link
        found = self._reader.read(link.head, link.present)
        if link.fault:
            found = Condition(link.fault, BAD)
        if found != self._condition:
            self._condition = found
            self.state_text.content = (
                f'<div data-state="{escape(found.text)}" style="padding:4px 12px"><b>/'
                f'{escape(link.client.controller)}</b>: <span style="color:{found.colour}">'
                f'{escape(found.text)}</span></div>')
        remark = self._reader.remark()
        if remark:
            self.notice.remark('slow', remark)

    def _show_refusals(self) -> None:
        """Show the reason of a refused goal, and a restart of the controller."""
        accepted = {row.name: row.accepted for row in self.link.rows}
        if any(accepted[name] < before for name, before in self._accepted.items()
               if name in accepted):
            self.notice.remark('restarted', RESTARTED)
        self._accepted = accepted
        for row in self.link.rows:
            if row.refused > self._refused.get(row.name, row.refused):
                self._show_answer(False, f'goal for task {row.name} refused: {row.refusal}')
            self._refused[row.name] = row.refused


class Notice:
    """
    Notice that disappears after `NOTICE_SECONDS`.

    Parameters
    ----------
    gui : viser.GuiApi
        Panel to which the notice is added.

    """

    def __init__(self, gui: viser.GuiApi) -> None:
        self._html = gui.add_html('')
        self._until = 0.0

    @property
    def content(self) -> str:
        """Return the displayed HTML; empty without a notice."""
        return self._html.content

    def refuse(self, reason: str) -> None:
        """Show the reason of a refusal."""
        self._show('refused', plain(reason), REFUSAL_COLOURS)

    def remark(self, kind: str, text: str) -> None:
        """Show a remark of a kind."""
        self._show(kind, text, REMARK_COLOURS)

    def answer(self, worked: bool, text: str) -> None:
        """Show the message of an answer, as a refusal unless it worked."""
        if worked:
            self.remark('answer', plain(text))
        else:
            self.refuse(text)

    def clear(self) -> None:
        """Clear the notice."""
        if self._until:
            self._until = 0.0
            self._html.content = ''

    def expire(self, now: float) -> None:
        """Clear the notice if its time [s] is over."""
        if now > self._until:
            self.clear()

    def _show(self, kind: str, text: str, colours: str) -> None:
        """Show a text instead of the previous one."""
        self._until = time.monotonic() + NOTICE_SECONDS
        self._html.content = (
            f'<div data-notice="{kind}" style="margin:4px 12px;padding:6px 10px;border-radius:4px;'
            f'background:{colours};font-size:0.9em">{escape(text)}</div>')


def _joint_tasks(rows: Sequence[TaskStatus]) -> list[str]:
    """Return the tasks with joint positions as goals."""
    kinds = task_types()
    return [row.name for row in rows
            if row.kind in kinds and kinds[row.kind].goal_type == 'joints']
