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

"""Notice on the page: a refusal, or a remark, shown for some seconds."""

from html import escape
import time

from tp_controller.untrusted import plain
import viser

# Display time of a notice [s].
NOTICE_SECONDS = 12.0
# Colours of refusals and of remarks.
REFUSAL_COLOURS = '#fdecea;color:#8c1d18'
REMARK_COLOURS = '#eef1f4;color:#5b6470'


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
