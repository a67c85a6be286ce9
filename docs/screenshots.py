# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""
Make the pictures of the page in the browser anew, from what its tests see in a Chromium.

``python docs/screenshots.py`` writes docs/images/view.png, the page, and
docs/images/reorder.png: two tasks in conflict, in both orders. It needs ROS 2, viser, playwright
and a Chromium.
"""

import os
from pathlib import Path
import subprocess
import sys
from tempfile import TemporaryDirectory

from PIL import Image
from tp_controller.tools.view.visuals import MESHES_VARIABLE, OWN

ROOT = Path(__file__).resolve().parents[1]
FOLDER = ROOT / 'docs' / 'images'
# Between two pictures [pixels].
GAP = 16


def beside(left, right):
    """Return two pictures side by side."""
    both = Image.new('RGB', (left.width + GAP + right.width, left.height), 'white')
    both.paste(left, (0, 0))
    both.paste(right, (left.width + GAP, 0))
    return both


def main():
    """Run the tests of the page, and keep their pictures."""
    with TemporaryDirectory() as folder:
        subprocess.run([sys.executable, '-m', 'pytest', '-q', 'test/system/test_browser.py'],
                       cwd=ROOT, check=True,
                       env={**os.environ, 'TP_CONTROLLER_SCREENSHOTS': folder,
                            # What readers see who have not installed the meshes of other robots.
                            MESHES_VARIABLE: OWN})
        seen = {path.stem: Image.open(path).convert('RGB') for path in Path(folder).iterdir()}
        if not seen:
            sys.exit('the tests were skipped: run them to see why')
        for name, picture in {'view': seen['robot'],
                              'reorder': beside(seen['hand_first'], seen['elbow_first'])}.items():
            picture.save(FOLDER / f'{name}.png', optimize=True)


if __name__ == '__main__':
    main()
