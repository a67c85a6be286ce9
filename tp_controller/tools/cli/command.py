# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

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
