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

"""Interface of the subcommands."""

import argparse
from collections.abc import Callable
from typing import NamedTuple


class Command(NamedTuple):
    """
    Subcommand of the command line.

    Attributes
    ----------
    brief, description : str
        Descriptions in the list of commands and in its own help.
    examples : str
        Example lines at the end of its help.
    add_arguments : callable
        Adds its arguments to its parser.
    run : callable
        Runs the command with the parsed arguments; returns the exit status.

    """

    brief: str
    description: str
    examples: str
    add_arguments: Callable[[argparse.ArgumentParser], None]
    run: Callable[[argparse.Namespace], int]

    def add_to(self, commands: 'argparse._SubParsersAction[argparse.ArgumentParser]',
               name: str) -> None:
        """Add the command to a parser."""
        parser = commands.add_parser(
            name, help=self.brief, description=self.description, epilog=self.examples,
            formatter_class=argparse.RawDescriptionHelpFormatter)
        self.add_arguments(parser)
        parser.set_defaults(run=self.run)
