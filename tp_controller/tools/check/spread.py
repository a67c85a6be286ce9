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

"""The same work for many seeds: here, in other processes, or on other machines."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, ExitStack
from typing import Any, TypeVar

from tp_controller.errors import SettingsError
from tp_controller.tools.check.setup import in_process, Plan, Setup

# What joblib sends work through.
BACKENDS = ('loky', 'dask', 'ray')
# In how many parts the work of each process is sent, so that none waits for another at the end.
PARTS = 8

Seed = TypeVar('Seed')
Made = TypeVar('Made')


class Spreader:
    """
    Does work for a setup.

    Parameters
    ----------
    setup : Setup
    jobs : int
        Processes; -1: as many as there are processors. With one all is done in this process.
    backend : str
        One of `BACKENDS`.

    Raises
    ------
    SettingsError
        The number of jobs or the backend is not valid.
    ModuleNotFoundError
        joblib, or what the backend needs, is not installed.

    """

    def __init__(self, setup: Setup, jobs: int, backend: str) -> None:
        if backend not in BACKENDS:
            raise SettingsError([f'backend must be one of {", ".join(BACKENDS)}, not '
                                 f'{backend!r}'])
        if jobs == 0 or jobs < -1:
            raise SettingsError([f'jobs must be a number from 1 on, or -1 for all processors, '
                                 f'not {jobs}'])
        self._setup, self._jobs, self._backend = setup, jobs, backend
        self._plan: Plan | None = None
        self._parallel: Any = None
        self._workers = 1
        self._opened = ExitStack()

    def __enter__(self) -> 'Spreader':
        """Start what the work is done by."""
        if self._jobs != 1:
            self._plan = Plan.of(self._setup)
            with ExitStack() as opened:
                self._parallel, self._workers = opened.enter_context(
                    _parallel(self._jobs, self._backend))
                self._opened = opened.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        """End it."""
        self._opened.close()

    def spread(self, work: Callable[[Setup, Seed], Made], seeds: Sequence[Seed],
               advance: Callable[[], None]) -> list[Made]:
        """
        Return what work gives for each seed, in their order.

        Parameters
        ----------
        work : callable
            Of a module, so that other processes find it.
        seeds : sequence
            What the work is done with, each.
        advance : callable
            Called after each.

        """
        found = []
        for each in self._each(work, seeds):
            found.append(each)
            advance()
        return found

    def _each(self, work: Callable[[Setup, Seed], Made],
              seeds: Sequence[Seed]) -> Iterator[Made]:
        """Yield what work gives for each seed."""
        if self._parallel is None:
            for seed in seeds:
                yield work(self._setup, seed)
            return
        from joblib import delayed
        size = max(1, len(seeds) // (PARTS * self._workers))
        for part in self._parallel(delayed(in_process)(work, self._plan, seeds[first:first + size])
                                   for first in range(0, len(seeds), size)):
            yield from part


@contextmanager
def _parallel(jobs: int, backend: str) -> Iterator[tuple[Any, int]]:
    """Open joblib with a backend; how many processes that is comes with it."""
    from joblib import effective_n_jobs, Parallel, parallel_config
    with ExitStack() as opened:
        if backend == 'dask':
            client = opened.enter_context(_dask_client(jobs))
            opened.enter_context(parallel_config('dask', client=client))
        elif backend == 'ray':
            from ray.util.joblib import register_ray
            register_ray()
            opened.enter_context(parallel_config('ray'))
        else:
            opened.enter_context(parallel_config('loky'))
        # With Dask and Ray it is the cluster that says how many processes there are.
        many = jobs if backend == 'loky' else -1
        # Ray gives back nothing before all is done.
        returned = 'list' if backend == 'ray' else 'generator'
        yield (opened.enter_context(Parallel(n_jobs=many, batch_size=1, return_as=returned)),
               effective_n_jobs(many))


@contextmanager
def _dask_client(jobs: int) -> Iterator[Any]:
    """Open a client of the cluster that DASK_SCHEDULER_ADDRESS names, else of one made here."""
    import dask.config
    from distributed import Client, LocalCluster
    if dask.config.get('scheduler-address', None):
        with Client() as client:
            yield client
        return
    with LocalCluster(n_workers=jobs if jobs > 0 else None, threads_per_worker=1,
                      dashboard_address=None) as cluster, Client(cluster) as client:
        yield client
