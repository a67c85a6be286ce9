# Copyright 2026 tp_controller contributors
# SPDX-License-Identifier: Apache-2.0

"""Code of others ends no program; signals do."""

import asyncio
import functools
import signal
import sys
import threading

import pytest
from tp_controller.errors import in_words
from tp_controller.untrusted.calls import foreign, Leaving


class Fatal(BaseException):
    """No `Exception`, and nobody's but ours."""


LEAVING = (SystemExit, KeyboardInterrupt, GeneratorExit, asyncio.CancelledError, Fatal)


@pytest.mark.parametrize('error_type', LEAVING)
def test_what_is_no_exception_leaves_as_one_that_names_it(error_type):
    # Off the main thread no handler can have raised it.
    caught = []

    def call():
        try:
            with foreign:
                raise error_type(3)
        except Leaving as error:
            caught.append(in_words(error))

    thread = threading.Thread(target=call)
    thread.start()
    thread.join()
    assert caught == [f'{error_type.__name__}: 3']


def test_an_exception_stays_what_it_is():
    with pytest.raises(ZeroDivisionError):
        with foreign:
            raise ZeroDivisionError


def test_a_message_that_leaves_is_none():
    class Mute(Exception):

        def __str__(self):
            raise SystemExit

    assert in_words(Mute()) == 'Mute: without a message'


class Handler:
    """A handler that is an object."""

    def __call__(self, *_):
        """Leave."""
        sys.exit(3)

    def leave(self, *_):
        """Leave."""
        sys.exit(3)


def leave_with(status, *_):
    """Leave with a status."""
    sys.exit(status)


@pytest.mark.parametrize('handler', [
    lambda *_: sys.exit(3), Handler(), Handler().leave, functools.partial(leave_with, 3)],
    ids=['function', 'object', 'method', 'partial'])
def test_a_signal_ends_the_program_in_the_middle_of_a_task(handler):
    before = signal.signal(signal.SIGTERM, handler)
    try:
        with pytest.raises(SystemExit) as left:
            with foreign:
                signal.raise_signal(signal.SIGTERM)
        assert left.value.code == 3
        with pytest.raises(Leaving):
            with foreign:
                sys.exit(3)
    finally:
        signal.signal(signal.SIGTERM, before)


def test_ctrl_c_ends_the_program_in_the_middle_of_a_task():
    before = signal.signal(signal.SIGINT, signal.default_int_handler)
    try:
        with pytest.raises(KeyboardInterrupt):
            with foreign:
                signal.raise_signal(signal.SIGINT)
    finally:
        signal.signal(signal.SIGINT, before)
