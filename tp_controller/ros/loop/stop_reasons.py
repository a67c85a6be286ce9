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

"""Why a robot is stopped, and when it goes on: what passes by itself, and what does not."""

import math


class Stops:
    """
    Decides between faults that pass and faults that latch.

    What passes, as joint states that are late, stops the robot while it lasts and for `settle`
    seconds more, so that nothing flips where it comes and goes. What latches, as a robot that does
    not follow, stops it until somebody starts it again.

    Parameters
    ----------
    settle : float
        For how long everything has to be in order before the robot moves again [s].

    Attributes
    ----------
    latched : str
        What stops the robot until this is emptied.
    moved : bool
        There was a cycle without a reason to stop.
    abrupt : bool
        Zeros have to be commanded at once: it is not known where the robot is, or how it moves.

    """

    def __init__(self, settle: float) -> None:
        self._settle = settle
        self.latched = self._passing = ''
        self._ended = self._interrupted = -math.inf
        # Before that there is nothing to settle.
        self.moved = self.abrupt = False

    def reason(self, passing: str, now: float) -> str:
        """
        Return why the robot is stopped; empty where it is not.

        Parameters
        ----------
        passing : str
            What is wrong now and passes by itself; else empty.
        now : float
            [s]

        """
        if passing:
            self._ended = now
            # What an interruption brings with it is not the cause.
            if not self._passing or now - self._interrupted >= self._settle:
                self._passing = passing
        elif not self.moved or now - self._ended >= self._settle:
            self._passing = ''
        if self.latched:
            return f'{self.latched}; call ~/start to go on'
        if self._passing:
            return self._passing if passing else f'{self._passing}, until a moment ago'
        self.moved, self.abrupt = True, False
        return ''

    def interrupt(self, passing: str, now: float) -> None:
        """Stop for what is over already, for `settle` seconds from now on."""
        self._passing, self._ended, self._interrupted = passing, now, now
        self.abrupt = True

    def latch(self, fault: str, abrupt: bool = True) -> None:
        """Stop until the next start; the first fault is the one that is reported."""
        self.latched = self.latched or fault
        self.abrupt = self.abrupt or abrupt
