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

"""What the solver is given: levels of the hierarchy."""

from dataclasses import dataclass
from functools import lru_cache

import numpy as np


@dataclass(slots=True, eq=False)
class Level:
    """
    One level of the hierarchy: the joint velocities should satisfy J q_dot = v.

    Attributes
    ----------
    J : ndarray (m, n)
        Task Jacobian.
    v : ndarray (m,)
        Wanted task velocity.

    """

    J: np.ndarray
    v: np.ndarray


@lru_cache(maxsize=None)
def identity(n):
    """
    Return the n×n identity, the same read-only array every time.

    As Jacobian of the lowest level it tells the solver, without a comparison, that the level
    asks for a velocity of every joint.
    """
    eye = np.eye(n)
    eye.setflags(write=False)
    return eye
