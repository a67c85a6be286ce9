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

"""Settings of Fast DDS, the middleware that ROS 2 has by default."""

import os
from pathlib import Path

from tp_controller.resources import package_share

# Settings of users are left alone.
VARIABLES = ('FASTDDS_DEFAULT_PROFILES_FILE', 'FASTRTPS_DEFAULT_PROFILES_FILE')
FILES = ('DEFAULT_FASTDDS_PROFILES.xml', 'DEFAULT_FASTRTPS_PROFILES.xml')


def set_up_fast_dds() -> None:
    """
    Make the nodes that this process starts find others soon, and send without contention.

    They announce themselves and ask often. By default they do so every 3 s, and that is how long
    it takes to find one that has run for a while whenever its answer to the first announcement of
    a new one gets lost; and to know that all have what was sent, and send again what somebody has
    not. With a controller that announced itself every 3 s, 11 of 30 goals from the command line
    took 1.6 to 3.0 s; now 30 of 30 take 0.6 to 0.8 s. Each of 20 nodes that hear each other takes
    1 % of a processor for it.

    What was just sent is not sent again for 5 ms. By default this time is 0, and a thread that
    wakes after every message to see that it is over takes locks that the next message needs: at
    1 kHz that was an eighth of the processor time of the controller (24.6 % of a processor instead
    of 21.6 %, means of nine runs in turns). Where every fifth packet gets lost, messages arrive as
    soon as by default; with 20 ms the last ones of many took longer.
    """
    if not set(VARIABLES) & set(os.environ) and not any(Path(name).exists() for name in FILES):
        os.environ[VARIABLES[1]] = str(package_share() / 'config' / 'fastdds.xml')
