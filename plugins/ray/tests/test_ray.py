"""`evaluator=ray` with dead workers and clusters; tests/contracts has what all evaluators do."""

from __future__ import annotations

import os
from pathlib import Path

import pytest

from islandgp.errors import EvaluationError
from islandgp_ray.evaluator import Ray, own_token
from tests.contracts.test_evaluator import EXPECTED, JOBS, KILLER, SETTING, deadly, ray


@pytest.mark.slow
def test_a_ray_worker_killed_in_the_middle_loses_nothing(tmp_path: Path) -> None:
    """Ray runs the job again that killed its worker, and the others as if nothing had been."""
    pytest.importorskip("ray")
    evaluator = ray(deadly(tmp_path / "died"))
    try:
        outcomes = evaluator.evaluate([*JOBS[:6], KILLER, *JOBS[6:]])
    finally:
        evaluator.close()
    assert (tmp_path / "died").exists()
    assert tuple(outcomes[:6] + outcomes[7:]) == EXPECTED


@pytest.mark.slow
def test_a_job_that_kills_ray_workers_is_named() -> None:
    """After its retries the error names tree and seed."""
    pytest.importorskip("ray")
    evaluator = ray(deadly())
    try:
        with pytest.raises(EvaluationError, match=r"world seed 9001.*died again and again"):
            evaluator.evaluate([JOBS[0], KILLER])
    finally:
        evaluator.close()


@pytest.mark.slow
def test_a_job_that_kills_its_worker_is_found_in_its_batch() -> None:
    """The others of its task run again, one by one."""
    pytest.importorskip("ray")
    evaluator = ray(deadly())
    try:
        with pytest.raises(EvaluationError, match=r"world seed 9001.*died again and again"):
            evaluator.evaluate([*JOBS, KILLER, *JOBS])
    finally:
        evaluator.close()


@pytest.mark.slow
def test_a_cluster_that_is_not_there_is_named() -> None:
    """The message gives the command to start one, or to do without."""
    pytest.importorskip("ray")
    settings = Ray.Settings(address="127.0.0.1:9", cpus=1, retries=0, workers=0)
    with pytest.raises(EvaluationError, match=r"Expected a Ray cluster at '127\.0\.0\.1:9'"):
        Ray(settings, SETTING)


def test_a_cluster_that_has_ended_is_reported() -> None:
    """Ray would end the process silently; an address without a listener is enough."""
    evaluator = Ray.__new__(Ray)
    evaluator._head = evaluator._node = "127.0.0.1:9"
    with pytest.raises(
        EvaluationError, match=r"Ray cluster at '127\.0\.0\.1:9', found that it has"
    ):
        evaluator._must_be_there()


def test_the_cluster_of_a_run_leaves_no_token(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its token is in the environment alone; one that the user has chosen stays."""
    monkeypatch.setattr(Path, "home", lambda: tmp_path)
    monkeypatch.setattr(os, "environ", {"RAY_AUTH_TOKEN_PATH": "/mine"})
    own_token()
    assert os.environ == {"RAY_AUTH_TOKEN_PATH": "/mine"}
    monkeypatch.setattr(os, "environ", {})
    own_token()
    assert len(os.environ["RAY_AUTH_TOKEN"]) == 64
    (tmp_path / ".ray").mkdir()
    (tmp_path / ".ray/auth_token").write_text("mine")
    monkeypatch.setattr(os, "environ", {})
    own_token()
    assert os.environ == {}
