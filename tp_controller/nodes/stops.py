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

    """

    def __init__(self, settle: float) -> None:
        self._settle = settle
        self._latched = ''
        self._passing = ''
        self._ended = -1.0

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
            self._passing, self._ended = passing, now
        elif self._passing and now - self._ended >= self._settle:
            self._passing = ''
        if self._latched:
            return f'{self._latched}; call ~/start to go on'
        if passing or not self._passing:
            return passing
        return f'{self._passing}, until a moment ago'

    def latch(self, fault: str) -> None:
        """Stop until the next start; the first fault is the one that is told."""
        self._latched = self._latched or fault

    def start(self, cause: str) -> str:
        """
        Go on, unless the cause lasts.

        Parameters
        ----------
        cause : str
            What latches and is still so; else empty.

        Returns
        -------
        str
            Why it is refused; empty where it is not.

        """
        if not cause:
            self._latched = ''
        return cause
