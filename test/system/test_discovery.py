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

"""Nodes announce themselves often, unless the user has settings of Fast DDS."""

import os
from pathlib import Path
from xml.etree import ElementTree

import pytest
from tp_controller.nodes.discovery import announce_often, FILES, VARIABLES


@pytest.fixture(autouse=True)
def nothing_set(monkeypatch, tmp_path):
    """Take away what is set, and undo what is set then."""
    for name in VARIABLES:
        monkeypatch.setenv(name, '')
        monkeypatch.delenv(name)
    monkeypatch.chdir(tmp_path)


def test_the_profile_announces_ten_times_a_second():
    announce_often()
    found = {name: os.environ[name] for name in VARIABLES if name in os.environ}
    (path,) = found.values()
    root = ElementTree.parse(path).getroot()
    period, = (element for element in root.iter() if element.tag.endswith('leaseAnnouncement'))
    assert [int(part.text) for part in period] == [0, 10 ** 8]


@pytest.mark.parametrize('name', VARIABLES)
def test_a_profile_of_the_user_stays(monkeypatch, name):
    monkeypatch.setenv(name, 'mine.xml')
    announce_often()
    assert {key: os.environ[key] for key in VARIABLES if key in os.environ} == {name: 'mine.xml'}


@pytest.mark.parametrize('name', FILES)
def test_a_file_that_fast_dds_takes_by_itself_stays_alone(name):
    Path(name).touch()
    announce_often()
    assert not set(VARIABLES) & set(os.environ)
