"""Runs jobs side by side: in processes of this computer, or on the workers of a Dask cluster."""

from __future__ import annotations

import importlib
import multiprocessing
import os
import sys
from collections.abc import Callable, Iterator, Sequence
from concurrent.futures import ProcessPoolExecutor, as_completed
from concurrent.futures.process import BrokenProcessPool
from contextlib import contextmanager

from tinyekf_py.evaluate.job import Evaluation, Failure, Job, Results, evaluate

#: Told after each job: how many are done, of how many, and the name of the last.
Told = Callable[[int, int, str], None]
#: Given each evaluation as soon as it is there, in any order.
Found = Callable[[Evaluation], None]

_CONNECT_S = 4.0


class ClusterError(ValueError):
    """A cluster that cannot be used: one line saying why."""


def run_jobs(
    jobs: Sequence[Job],
    *,
    processes: int | None = None,
    cluster: str = "",
    told: Told = lambda *_: None,
    found: Found = lambda _: None,
) -> Results:
    """Do all `jobs`, `processes` at a time (default: one for each processor), or on the scheduler at `cluster`.

    A cluster's workers need this package, and must see the recordings under the same paths. ClusterError when the
    scheduler cannot be reached.
    """
    if cluster:
        done = _on_cluster(jobs, cluster)
    elif len(jobs) == 1 or processes == 1:
        done = ((number, evaluate(job)) for number, job in enumerate(jobs))
    else:
        done = _in_processes(jobs, processes or os.cpu_count() or 1)
    by_number: dict[int, Evaluation | Failure] = {}
    for number, result in done:
        by_number[number] = result
        if isinstance(result, Evaluation):
            found(result)
        told(len(by_number), len(jobs), jobs[number].name)
    results = Results()
    for number in range(len(jobs)):
        result = by_number[number]
        if isinstance(result, Failure):
            results.failures.append(result)
        else:
            results.evaluations.append(result)
    return results


def _in_processes(jobs: Sequence[Job], processes: int) -> Iterator[tuple[int, Evaluation | Failure]]:
    # Fresh interpreters: a fork would copy the progress bar's thread's locks, held or not.
    context = multiprocessing.get_context("spawn")
    with ProcessPoolExecutor(min(processes, len(jobs)), mp_context=context) as pool:
        numbers = {pool.submit(evaluate, job): number for number, job in enumerate(jobs)}
        for future in as_completed(numbers):
            number = numbers[future]
            try:
                yield number, future.result()
            except BrokenProcessPool as error:
                yield number, Failure(jobs[number].name, f"its process died: {error}")


def _on_cluster(jobs: Sequence[Job], address: str) -> Iterator[tuple[int, Evaluation | Failure]]:
    try:
        distributed = importlib.import_module("distributed")
    except ImportError as error:
        raise ClusterError("--cluster needs the package distributed: install the extra [cluster]") from error
    try:
        client = distributed.Client(address, timeout=_CONNECT_S, set_as_default=False)
    except (OSError, ValueError) as error:
        raise ClusterError(f"no Dask scheduler answers at {address}: {error}") from error
    with client:
        futures = client.map(evaluate, jobs, pure=False)
        numbers = {future.key: number for number, future in enumerate(futures)}
        for future in distributed.as_completed(futures, loop=client.loop):
            number = numbers[future.key]
            if future.status == "finished":
                yield number, future.result()
            else:
                yield number, Failure(jobs[number].name, f"the cluster gave it up: {future.exception()}")


@contextmanager
def progress(title: str) -> Iterator[Told]:
    """A progress bar on stderr while that is a terminal (by rich if installed); silent otherwise."""
    if not sys.stderr.isatty():
        yield lambda *_: None
        return
    try:
        rich = importlib.import_module("rich.progress")
        console = importlib.import_module("rich.console").Console(stderr=True)
    except ImportError:
        yield _plain_progress
        return
    with rich.Progress(*rich.Progress.get_default_columns(), rich.MofNCompleteColumn(), console=console) as bar:
        task = bar.add_task(title, total=None)

        def tell(done: int, total: int, name: str) -> None:
            bar.update(task, completed=done, total=total, description=f"{title}: {name}")

        yield tell


def _plain_progress(done: int, total: int, name: str) -> None:
    print(f"\r{done}/{total} {name:<40.40}", end="\n" if done == total else "", file=sys.stderr, flush=True)
