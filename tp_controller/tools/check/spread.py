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

"""Parallel execution of work for many seeds: in this process, in others, or on a cluster."""

from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, ExitStack
from typing import Any, TypeVar

from tp_controller.errors import SettingsError
from tp_controller.tools.check.setup import in_process, Plan, Setup

# Backends of joblib.
BACKENDS = ('loky', 'dask', 'ray')
# Parts into which the work of each process is divided, to balance the load at the end.
PARTS = 8

Seed = TypeVar('Seed')
Result = TypeVar('Result')


class Spreader:
    """
    Executor of work for a setup.

    Parameters
    ----------
    setup : Setup
    jobs : int
        Number of processes; -1: one per processor. 1: all work runs in this process.
    backend : str
        One of `BACKENDS`.

    Raises
    ------
    SettingsError
        The number of jobs or the backend is not valid.
    ModuleNotFoundError
        joblib, or a package of the backend, is not installed.

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
        """Start the processes."""
        if self._jobs != 1:
            self._plan = Plan.of(self._setup)
            with ExitStack() as opened:
                self._parallel, self._workers = opened.enter_context(
                    _parallel(self._jobs, self._backend))
                self._opened = opened.pop_all()
        return self

    def __exit__(self, *error: Any) -> None:
        """End the processes."""
        self._opened.close()

    def spread(self, work: Callable[[Setup, Seed], Result], seeds: Sequence[Seed],
               advance: Callable[[], None]) -> list[Result]:
        """
        Return the results of work for each seed, in their order.

        Parameters
        ----------
        work : callable
            Function of a module, so that other processes can import it.
        seeds : sequence
            Arguments of the work, one for each call.
        advance : callable
            Called after each result.

        """
        found = []
        for each in self._each(work, seeds):
            found.append(each)
            advance()
        return found

    def _each(self, work: Callable[[Setup, Seed], Result],
              seeds: Sequence[Seed]) -> Iterator[Result]:
        """Yield the result of work for each seed."""
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
    """Open joblib with a backend; yield it with the number of processes."""
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
        # With Dask and Ray the cluster determines the number of processes.
        many = jobs if backend == 'loky' else -1
        # Ray returns no result before all work is done.
        returned = 'list' if backend == 'ray' else 'generator'
        yield (opened.enter_context(Parallel(n_jobs=many, batch_size=1, return_as=returned)),
               effective_n_jobs(many))


@contextmanager
def _dask_client(jobs: int) -> Iterator[Any]:
    """Open a client of the cluster at DASK_SCHEDULER_ADDRESS, or of a new local cluster."""
    import dask.config
    from distributed import Client, LocalCluster
    if dask.config.get('scheduler-address', None):
        with Client() as client:
            yield client
        return
    with LocalCluster(n_workers=jobs if jobs > 0 else None, threads_per_worker=1,
                      dashboard_address=None) as cluster, Client(cluster) as client:
        yield client
