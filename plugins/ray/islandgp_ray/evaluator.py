"""Episodes on a Ray cluster: a local one, or one that is running already.

Results do not depend on the cluster, as an episode is a function of its job. A task has several
episodes, so its overhead is small. Ray runs a task again if its worker or machine dies; if it fails
again, its episodes run one by one, and an episode whose worker dies each time ends the run.
"""

from __future__ import annotations

import logging
import os
import secrets
import socket
from collections.abc import Iterable, Sequence
from importlib import import_module
from pathlib import Path
from time import monotonic, sleep
from typing import Any, Final

from pydantic import BaseModel, Field

from islandgp.domain import Outcome
from islandgp.errors import EvaluationError, brief
from islandgp.evaluation.base import Job, Problem, blame, simulate

QUIET: Final = {"include_dashboard": False, "log_to_driver": False, "logging_level": logging.ERROR}

SHARES: Final = 3  # least tasks per worker, so that all end at about the same time
POLL_S: Final = 5.0  # s between two checks of the cluster while waiting for an episode
HEAD_TIMEOUT_S: Final = 20.0
"""Seconds without the head node until the run ends; Ray exits silently after 60."""


class RaySettings(BaseModel, frozen=True, extra="forbid"):
    """Address of the cluster and resources of an episode."""

    address: str = Field(min_length=1)  # "local": start one here; "auto", "host:port", "ray://..."
    cpus: float = Field(gt=0, le=64)  # of an episode
    retries: int = Field(ge=0, le=100)  # of an episode whose worker died
    workers: int = Field(ge=0, le=1024)  # of a local cluster; 0: one for each core
    episode_timeout: float = Field(600, ge=0, le=1e6)  # s until an episode is given up; 0: never


def simulate_batch(problem: Problem, jobs: Sequence[Job], limit: float) -> list[Outcome]:
    """Runs the episodes of jobs, one after another. See `simulate`."""
    return [simulate(problem, job, limit) for job in jobs]


class Ray:
    """The evaluator for many machines."""

    Settings = RaySettings

    @classmethod
    def make(cls, settings: RaySettings, problem: Problem) -> Ray:
        """See `Evaluator`."""
        return cls(settings, problem)

    def __init__(self, settings: RaySettings, problem: Problem) -> None:
        """Connects to the cluster, or starts one. Raises EvaluationError if there is none."""
        ray: Any = import_module("ray")  # slow, and no validation of a configuration needs it

        self._ray, self._settings = ray, settings
        self._ours = not ray.is_initialized()  # False inside a job of Ray
        if self._ours:
            _connect(ray, settings)
        remote = settings.address.startswith("ray://")  # its own address is in another network
        self._head = settings.address if remote else ray.get_runtime_context().gcs_address
        self._node = "" if remote else _own_node(ray)
        options = ray.remote(num_cpus=settings.cpus, max_retries=settings.retries)
        self._task = options(simulate_batch)
        self._problem = ray.put(problem)  # sent to each machine once

    def evaluate(self, jobs: Iterable[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        jobs = list(jobs)
        self._must_be_there()  # without the head, Ray ends this process after a minute
        workers = self._ray.cluster_resources().get("CPU", 1) / self._settings.cpus
        n = max(1, int(len(jobs) / (SHARES * max(1, workers))))
        batches = [jobs[i : i + n] for i in range(0, len(jobs), n)]
        futures = [self._submitted(batch) for batch in batches]
        try:
            results = [self._result(b, f) for b, f in zip(batches, futures, strict=True)]
        except BaseException:
            for future in futures:
                self._ray.cancel(future, force=True)
            raise
        return [outcome for result in results for outcome in result]

    def _submitted(self, batch: Sequence[Job]) -> Any:
        return self._task.remote(self._problem, batch, self._settings.episode_timeout)

    def _result(self, batch: Sequence[Job], future: Any) -> list[Outcome]:
        from ray.exceptions import GetTimeoutError, RayError, RayTaskError

        while True:
            try:
                outcomes: list[Outcome] = self._ray.get(future, timeout=POLL_S)
            except GetTimeoutError:
                self._must_be_there()
            except RayTaskError as error:  # its message names the job
                raise EvaluationError(str(error.cause)) from error
            except RayError as error:
                if len(batch) == 1:
                    reason = "that its worker died again and again"
                    raise EvaluationError(blame(batch[0], reason)) from error
                return [o for job in batch for o in self._result([job], self._submitted([job]))]
            else:
                return outcomes

    def _must_be_there(self) -> None:
        """Raises EvaluationError if the head node is away for HEAD_TIMEOUT_S seconds."""
        end = monotonic() + HEAD_TIMEOUT_S
        while error := _unreachable(self._node) or _unreachable(self._head):
            # Ray ends this process some seconds after its own node.
            if monotonic() > end or _unreachable(self._node):
                raise EvaluationError(
                    f"Expected the Ray cluster at {self._head!r}, found that it has ended"
                    f" ({error}). The run's records are kept; start the cluster and give the"
                    " command again."
                ) from error
            sleep(1)

    def close(self) -> None:
        """See `Evaluator`."""
        if self._ours:
            self._ray.shutdown()


def _connect(ray: Any, settings: RaySettings) -> None:
    if settings.address == "local":
        own_token()
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # Ray's own new default
    cpus = settings.workers if settings.address == "local" and settings.workers else None
    error = _unreachable(settings.address)
    try:
        if error is None:
            ray.init(settings.address, num_cpus=cpus, **QUIET)
    except Exception as refusal:  # Ray also raises bare exceptions, e.g. if its start takes long
        error = refusal
    if error is not None:
        raise EvaluationError(
            f"Expected a Ray cluster at {settings.address!r}, found {brief(error)}; start one with"
            " `ray start --head`, of the same version of Ray and Python and with the token of"
            " RAY_AUTH_TOKEN if it has one, or take evaluator.policy.address=local."
        ) from error


def _own_node(ray: Any) -> str:
    """The address of the cluster's node on this machine."""
    node_id = ray.get_runtime_context().get_node_id()
    (node,) = (node for node in ray.nodes() if node["NodeID"] == node_id)
    return f"{node['NodeManagerAddress']}:{node['NodeManagerPort']}"


def own_token() -> None:
    """Sets a token for a cluster that Ray starts for this process only.

    Otherwise Ray writes a token into the home folder, and later `ray start --head` requires it but
    `ray start --address` does not send it. A user's own token is kept.
    """
    variables = {"RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"}
    if not variables & os.environ.keys() and not (Path.home() / ".ray" / "auth_token").exists():
        os.environ["RAY_AUTH_TOKEN"] = secrets.token_hex(32)


def _unreachable(address: str) -> Exception | None:
    """The error if no server listens, as Ray would wait for minutes or end the process."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if port.isdigit():
        try:
            socket.create_connection((host, int(port)), timeout=10).close()
        except (OSError, OverflowError) as error:
            return error
    return None
