# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Reasons with many causes are shortened, others stay as they are."""

import pytest
from tp_controller.control.reason_text import brief_reason, causes_in

MANY = ('blocked by tool, elbow, the acceleration limit of panda_joint3, the acceleration limit '
        'of panda_joint7 and the acceleration limit of panda_joint1 together')


@pytest.mark.parametrize('reason, causes, brief', [
    ('', [], ''),
    ('slowed by damping', ['slowed by damping'], 'slowed by damping'),
    ('blocked by tool; slowed by damping', ['blocked by tool', 'slowed by damping'],
     'blocked by tool; slowed by damping'),
    ('blocked by tool and elbow together', ['blocked by tool', '+ elbow'],
     'blocked by tool + elbow'),
    (MANY, ['blocked by tool', '+ elbow', '+ the acceleration limit of panda_joint3', '+ 2 more'],
     'blocked by tool + elbow + the acceleration limit of panda_joint3 + 2 more'),
    ('blocked by tool, elbow, wrist, 2 more tasks and 4 more velocity limits together',
     ['blocked by tool', '+ elbow', '+ wrist', '+ 6 more'],
     'blocked by tool + elbow + wrist + 6 more')])
def test_a_reason_names_no_more_causes_than_can_be_read(reason, causes, brief):
    assert causes_in(reason) == causes
    assert brief_reason(reason) == brief
