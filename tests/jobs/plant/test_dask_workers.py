"""Tasks on the workers of a Dask scheduler, some of which are killed."""

import os
import signal
import threading

import pytest
from usdfoliage.errors import FoliageError
from usdfoliage.jobs.plant.dask_workers import connect_dask
from usdfoliage.jobs.plant.executors import run_on

from tests.support.dask_clusters import dask_cluster
from tests.support.fake_builds import (
    DIAMOND,
    fake_plant,
    in_order,
    is_alive,
    kill_always,
    kill_once,
    lines_of,
    next_of,
    sleep_long,
    wait_until,
    write_line,
)

KILLERS = {"a": [], "killer": ["a"], "other": ["a"], "z": ["killer", "other"]}


def test_tasks_run_on_workers_that_start_again_when_they_are_killed(tmp_path):
    with dask_cluster(tmp_path) as cluster, connect_dask(cluster.address) as workers:
        plants = [fake_plant(tmp_path, "p", KILLERS), fake_plant(tmp_path, "q", DIAMOND)]
        done = list(run_on(next_of(plants), kill_once, workers, 1))
        assert all(each.is_good for _, each in done)
        for number, tasks in enumerate((KILLERS, DIAMOND)):
            own = [each.name for place, each in done if place == number]
            assert sorted(own) == sorted(tasks)
            assert in_order(own, tasks)
        mine = os.getpid()
        assert all(int(line.split()[2]) != mine for line in (tmp_path / "log").read_text().splitlines())


@pytest.mark.slow
def test_without_nannies_other_workers_do_what_a_killed_one_did(tmp_path):
    with dask_cluster(tmp_path, 2, "--no-nanny") as cluster, connect_dask(cluster.address) as workers:
        wait_until(lambda: workers.count() == 2)
        plants = [fake_plant(tmp_path, "p", KILLERS)]
        done = [each.name for _, each in run_on(next_of(plants), kill_once, workers, 1)]
        assert sorted(done) == sorted(KILLERS)
        wait_until(lambda: workers.count() == 1)
        assert sum(worker.poll() is None for worker in cluster.workers) == 1


@pytest.mark.slow
def test_a_task_that_kills_every_worker_is_given_up(tmp_path):
    with dask_cluster(tmp_path) as cluster, connect_dask(cluster.address) as workers:
        plants = [fake_plant(tmp_path, "p", {"killer": [], "z": ["killer"]}), fake_plant(tmp_path, "q", {"a": []})]
        done = list(run_on(next_of(plants), kill_always, workers, 1))
        assert [(place, each.name) for place, each in done if each.is_good] == [(1, "a")]
        (given_up,) = [each for _, each in done if not each.is_good]
        assert "killed each time" in given_up.error


@pytest.mark.parametrize("what", ["worker", pytest.param("scheduler", marks=pytest.mark.slow)])
def test_when_all_workers_or_the_scheduler_are_gone_there_is_an_error(tmp_path, what):
    with (
        dask_cluster(tmp_path, 1, "--no-nanny") as cluster,
        connect_dask(cluster.address, patience_s=2.0) as workers,
    ):
        running = run_on(next_of([fake_plant(tmp_path, "p", {"a": []})]), sleep_long, workers, 1)
        gone = cluster.workers[0] if what == "worker" else cluster.scheduler
        killer = threading.Thread(target=lambda: (wait_until(lambda: bool(lines_of(tmp_path))), gone.kill()))
        killer.start()
        with pytest.raises(FoliageError, match="gone, or has had no workers for 2 s"):
            list(running)
        killer.join()


@pytest.mark.slow
def test_workers_that_come_later_work_too(tmp_path):
    with dask_cluster(tmp_path, 1) as cluster, connect_dask(cluster.address) as workers:
        assert workers.count() == 1
        cluster.add_worker()
        wait_until(lambda: workers.count() == 2)


def test_where_no_scheduler_answers_the_error_names_the_command_that_starts_one():
    with pytest.raises(FoliageError, match="start one with: dask scheduler"), connect_dask("tcp://127.0.0.1:9", 1.0):
        pass


def test_a_scheduler_without_workers_is_an_error(tmp_path):
    with (
        dask_cluster(tmp_path, 0) as cluster,
        pytest.raises(FoliageError, match="has no workers; start some with: dask worker"),
        connect_dask(cluster.address, 1.0),
    ):
        pass


@pytest.mark.slow
def test_nothing_of_a_cluster_is_left_running(tmp_path):
    with dask_cluster(tmp_path, 1) as cluster, connect_dask(cluster.address) as workers:
        list(run_on(next_of([fake_plant(tmp_path, "p", {"a": []})]), write_line, workers, 1))
        pids = [int(line.split()[2]) for line in (tmp_path / "log").read_text().splitlines()]
        cluster.workers[0].send_signal(signal.SIGTERM)
    wait_until(lambda: not any(is_alive(pid) for pid in pids))
