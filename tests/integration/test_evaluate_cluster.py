"""An evaluation on a real Dask cluster of two worker processes."""

from __future__ import annotations

from collections.abc import Iterator
from dataclasses import replace

import pytest

from acquisition.simulator.scenarios import SCENARIOS
from tinyekf_py.evaluate.job import Job, Recorded, Simulated
from tinyekf_py.evaluate.spread import run_jobs

distributed = pytest.importorskip("distributed", reason="the extra [cluster] is not installed")


@pytest.fixture(scope="module")
def scheduler() -> Iterator[str]:
    with distributed.LocalCluster(n_workers=2, threads_per_worker=1, processes=True, dashboard_address=None) as cluster:
        yield cluster.scheduler_address


def test_a_cluster_gives_what_one_process_gives(scheduler: str, tmp_path_factory: pytest.TempPathFactory) -> None:
    scenario = replace(SCENARIOS["harbour"], duration_s=30.0)
    jobs = [Job(f"run {seed}", Simulated(scenario, seed=seed), ("cnw3", "compass"), "runs") for seed in (1, 2, 3)]
    nowhere = tmp_path_factory.mktemp("nothing")
    jobs.append(Job("lost", Recorded(nowhere / "lost.rec", nowhere / "lost.csv"), ("cnw3",)))
    names: list[str] = []
    there = run_jobs(jobs, cluster=scheduler, told=lambda _done, _total, name: names.append(name))
    found: list[str] = []
    here = run_jobs(jobs, processes=1, found=lambda evaluation: found.append(evaluation.name))
    assert sorted(names) == ["lost", "run 1", "run 2", "run 3"]
    assert [evaluation.name for evaluation in there.evaluations] == ["run 1", "run 2", "run 3"]
    for far, near in zip(there.evaluations, here.evaluations, strict=True):
        for method in ("cnw3", "compass"):
            assert far.measures[method].rmse_deg == near.measures[method].rmse_deg
    assert found == ["run 1", "run 2", "run 3"]
    assert [failure.name for failure in there.failures] == ["lost"]
    assert "cannot read recording" in there.failures[0].reason
