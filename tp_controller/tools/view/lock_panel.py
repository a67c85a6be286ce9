# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Buttons of the page that lock the joint that has stopped the robot, and unlock all joints."""

from collections.abc import Callable

from tp_controller.untrusted.texts import plain
import viser

# Longest label [characters].
LONGEST_BUTTON = 60


class LockPanel:
    """
    Buttons that are visible while they have an effect.

    Parameters
    ----------
    gui : viser.GuiApi
    lock : callable
        Called with True to lock the joint and go on, with False to unlock all joints.

    Attributes
    ----------
    lock_button, unlock_button : viser.GuiButtonHandle

    """

    def __init__(self, gui: viser.GuiApi, lock: Callable[[bool], None]) -> None:
        self.lock_button = gui.add_button('Lock', color='orange', icon=viser.Icon.LOCK,
                                          visible=False)
        self.unlock_button = gui.add_button('Unlock', icon=viser.Icon.LOCK_OPEN, visible=False)
        self.lock_button.on_click(lambda _: lock(True))
        self.unlock_button.on_click(lambda _: lock(False))

    def show(self, failing: str, locked: str) -> None:
        """Show the joint that has stopped the robot, and the locked joints; each may be empty."""
        for button, name, text in (
                (self.lock_button, failing, f'Lock {failing} and go on'),
                (self.unlock_button, locked, f'Unlock {locked}')):
            button.visible = bool(name)
            if name:
                button.label = plain(text, LONGEST_BUTTON)
