# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Domains that nobody else on the machine has."""

import os
import subprocess
import sys

import pytest
from tp_controller.errors import TpControllerError
from tp_controller.tools.demos import processes
from tp_controller.tools.demos.processes import own_domain

ANOTHER = """
from tp_controller.tools.demos.processes import own_domain
with own_domain() as environment:
    print(environment['ROS_DOMAIN_ID'])
"""


@pytest.fixture
def only(monkeypatch):
    """Let there be one domain, which no other test takes."""
    monkeypatch.setattr(processes, 'DOMAINS', [10_000 + os.getpid()])


def test_a_domain_is_reserved_until_it_is_left(only):
    for _ in range(2):
        with own_domain() as environment:
            assert environment['ROS_DOMAIN_ID'] == str(10_000 + os.getpid())


def test_a_process_with_another_temporary_directory_gets_another_domain(tmp_path):
    with own_domain() as mine:
        its = subprocess.run([sys.executable, '-c', ANOTHER], check=True, text=True,
                             env={**os.environ, 'TMPDIR': str(tmp_path)}, capture_output=True)
    assert its.stdout.strip() != mine['ROS_DOMAIN_ID']


def test_domains_that_are_all_taken_are_an_error(only):
    with own_domain(), pytest.raises(TpControllerError, match='no free ROS domain'), own_domain():
        pass
