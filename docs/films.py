# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Make the films of the documentation anew, docs/images/<name>.webp, from runs of the demos.

``python docs/films.py`` makes all of them, ``python docs/films.py panda drill`` only those two. A
film takes about half a minute, beside the run itself. It needs ROS 2, viser and a Chromium.
"""

import argparse
import os
from pathlib import Path
import shutil
import sys
from tempfile import TemporaryDirectory

from tp_controller.tools.cli.main import main as command
from tp_controller.tools.demos.chromium import find_chromium
from tp_controller.tools.view.visuals import MESHES_VARIABLE, OWN

FOLDER = Path(__file__).resolve().parent / 'images'
# {demo: films of it that the pages show}
FILMS = {
    'panda': ['film'], 'mobile': ['film'], 'underwater': ['film'], 'two_arms': ['film'],
    'drill': ['drill'], 'failed_joint': ['failed_joint'], 'lab1': ['lab1'],
    'lab2': ['lab2_end_effector_first'],
    **{name: [name] for name in ('camera', 'bounds', 'weights', 'forms')},
}


def shown_as(demo, film):
    """Return the name that a film of a demo has among the pictures."""
    return f'{demo if film == "film" else film}.webp'


def main():
    """Make all films, or those of the demos named on the command line."""
    parser = argparse.ArgumentParser(description=__doc__.strip().partition('\n')[0])
    parser.add_argument('demos', nargs='*', metavar='demo', help=', '.join(FILMS))
    demos = parser.parse_args().demos or FILMS
    if find_chromium() is None:
        sys.exit('films of solid robots need a Chromium')
    # What readers see who have not installed the meshes of other robots.
    os.environ[MESHES_VARIABLE] = OWN
    with TemporaryDirectory() as folder:
        for demo in demos:
            if command(['demo', demo, '--output', folder]):
                sys.exit(f'the demo {demo} failed')
            for film in FILMS[demo]:
                shutil.copy(Path(folder) / demo / f'{film}.webp', FOLDER / shown_as(demo, film))


if __name__ == '__main__':
    main()
