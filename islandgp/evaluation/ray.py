"""Episodes on a Ray cluster: a local one, or one that is running already.

Results do not depend on the cluster, as an episode is a function of its job. A task has as many
episodes as take BATCH_S seconds together, so the overhead of a task is small. Ray runs a task again
if its worker or machine dies; if it fails again, its episodes run one by one, and an episode whose
worker dies each time is reported and ends the run.
"""

from __future__ import annotations

import logging
import os
import secrets
import socket
from collections.abc import Sequence
from pathlib import Path
from time import monotonic, perf_counter, sleep
from typing import TYPE_CHECKING, Any, Final, NamedTuple

from pydantic import BaseModel, Field

from islandgp.domain import Outcome
from islandgp.errors import EvaluationError, brief
from islandgp.evaluation.base import Job, Problem, blame, simulate

if TYPE_CHECKING:
    from ray import ObjectRef

QUIET: Final = {"include_dashboard": False, "log_to_driver": False, "logging_level": logging.ERROR}

POLL_S: Final = 5.0  # s between two checks of the cluster while waiting for an episode
BATCH_S: Final = 0.25  # target duration of a task, s
SHARES: Final = 3  # least tasks per worker, so that all end at about the same time
HEAD_TIMEOUT_S: Final = 20.0
"""Seconds without the head node until the run ends; Ray exits silently after 60."""


class RaySettings(BaseModel, frozen=True, extra="forbid"):
    """Address of the cluster and resources of an episode."""

    address: str = Field(min_length=1)  # "local": start one here; "auto", "host:port", "ray://..."
    cpus: float = Field(gt=0, le=64)  # of an episode
    retries: int = Field(ge=0, le=100)  # of an episode whose worker died
    workers: int = Field(ge=0, le=1024)  # of a local cluster; 0: one for each core
    episode_timeout: float = Field(600, ge=0, le=1e6)  # s until an episode is given up; 0: never


class Batch(NamedTuple):
    """The episodes of one task."""

    outcomes: list[Outcome]
    seconds: float  # that they took together


def simulate_batch(problem: Problem, jobs: Sequence[Job], limit: float) -> Batch:
    """Runs the episodes of jobs, one after another. See `simulate`."""
    began = perf_counter()
    outcomes = [simulate(problem, job, limit) for job in jobs]
    return Batch(outcomes, perf_counter() - began)


def batch_size(episode_s: float, jobs: int, workers: int) -> int:
    """Number of episodes of a task.

    Args:
        episode_s: seconds of an episode, > 0.
        jobs: number of episodes to run.
        workers: number of tasks that run side by side, >= 1.

    Returns:
        As many as take BATCH_S seconds, but few enough for SHARES tasks a worker; >= 1.
    """
    return max(1, min(int(BATCH_S / max(episode_s, 1e-9)), jobs // (SHARES * workers)))


class Ray:
    """The evaluator for many machines."""

    Settings = RaySettings

    @classmethod
    def make(cls, settings: RaySettings, problem: Problem) -> Ray:
        """See `Evaluator`."""
        return cls(settings, problem)

    def __init__(self, settings: RaySettings, problem: Problem) -> None:
        """Connects to the cluster, or starts one.

        Raises:
            EvaluationError: Ray is not installed, or there is no cluster at the address.
        """
        self.simulated = 0
        self._limit = settings.episode_timeout
        self._looked = monotonic()
        self._ray, self._ours = _connect(settings)
        remote = settings.address.startswith("ray://")  # its own address is in another network
        self._head = settings.address if remote else self._ray.get_runtime_context().gcs_address
        self._node = "" if remote else _own_node(self._ray)
        options = {"num_cpus": settings.cpus, "max_retries": settings.retries}
        self._task: Any = self._ray.remote(**options)(simulate_batch)
        self._cpus = settings.cpus
        self._episode_s = BATCH_S  # of the last batches, mean; at first one episode is a batch
        self._problem = self._ray.put(problem)  # sent to each machine once

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.simulated += len(jobs)
        if monotonic() > self._looked + POLL_S:
            self._must_be_there()  # without the head, Ray ends this process after a minute
            self._looked = monotonic()
        n = batch_size(self._episode_s, len(jobs), self._workers())
        batches = [jobs[i : i + n] for i in range(0, len(jobs), n)]
        futures = [self._submitted(batch) for batch in batches]
        try:
            results = [self._result(b, f) for b, f in zip(batches, futures, strict=True)]
        except BaseException:
            for future in futures:
                self._ray.cancel(future, force=True)
            raise
        if jobs:
            self._episode_s = sum(result.seconds for result in results) / len(jobs)
        return [outcome for result in results for outcome in result.outcomes]

    def _workers(self) -> int:
        """Tasks that the cluster can run side by side, >= 1."""
        return max(1, int(self._ray.cluster_resources().get("CPU", 1) / self._cpus))

    def _submitted(self, batch: Sequence[Job]) -> ObjectRef[Batch]:
        future: ObjectRef[Batch] = self._task.remote(self._problem, batch, self._limit)
        return future

    def _result(self, batch: Sequence[Job], future: ObjectRef[Batch]) -> Batch:
        from ray.exceptions import GetTimeoutError, RayError, RayTaskError

        while True:
            try:
                result: Batch = self._ray.get(future, timeout=POLL_S)
            except GetTimeoutError:
                self._must_be_there()
            except RayTaskError as error:  # its message names the job
                raise EvaluationError(str(error.cause)) from error
            except RayError as error:
                if len(batch) == 1:
                    reason = "that its worker died again and again"
                    raise EvaluationError(blame(batch[0], reason)) from error
                each = [self._result([job], self._submitted([job])) for job in batch]
                return Batch([r.outcomes[0] for r in each], sum(r.seconds for r in each))
            else:
                return result

    def _must_be_there(self) -> None:
        """Raises EvaluationError if the head node is away for HEAD_TIMEOUT_S seconds."""
        end = monotonic() + HEAD_TIMEOUT_S
        while True:
            try:
                _reach(self._node)  # Ray ends this process some seconds after its node
                return _reach(self._head)
            except OSError as error:
                if monotonic() > end or not _listens(self._node):
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


def _connect(settings: RaySettings) -> tuple[Any, bool]:
    """Connect; return the module `ray`, and whether this evaluator must close the connection."""
    os.environ.setdefault("RAY_ACCEL_ENV_VAR_OVERRIDE_ON_ZERO", "0")  # Ray's own new default
    try:
        import ray
    except ImportError:
        raise EvaluationError(
            "Expected Ray for evaluator=ray, found it not installed; pip install 'islandgp[ray]'."
        ) from None
    if ray.is_initialized():  # inside a job of the Ray launcher
        return ray, False
    options: dict[str, Any] = {**QUIET, "address": settings.address}
    if settings.address == "local":
        own_token()
        if settings.workers:
            options["num_cpus"] = settings.workers
    try:
        _reach(settings.address)
    except (OSError, ValueError) as error:
        raise _no_cluster(settings.address, error) from error
    try:
        ray.init(**options)
    except Exception as error:  # Ray also raises bare exceptions, e.g. if its start takes too long
        if settings.address == "local":
            raise EvaluationError(
                f"Expected Ray to start on this machine, found that it cannot ({brief(error)});"
                " make room, and repeat the command."
            ) from error
        if isinstance(error, ValueError) or "any running" in str(error):
            raise _no_cluster(settings.address, error) from error
        raise _refused(settings.address, error) from error
    return ray, True


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
    variables = {"RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"} & os.environ.keys()
    if not variables and not (Path.home() / ".ray" / "auth_token").exists():
        os.environ["RAY_AUTH_TOKEN"] = secrets.token_hex(32)


def _no_cluster(address: str, error: Exception) -> EvaluationError:
    return EvaluationError(
        f"Expected a Ray cluster at {address!r}, found none ({error});"
        " start one with `ray start --head`, or take evaluator.policy.address=local."
    )


def _refused(address: str, error: Exception) -> EvaluationError:
    return EvaluationError(
        f"Expected to join the Ray cluster at {address!r}, found that it rejects the connection"
        f" ({brief(error)}); its version of Ray and Python must be this one's, and its token, if"
        " it has one: RAY_AUTH_MODE=token, and RAY_AUTH_TOKEN or ~/.ray/auth_token."
    )


def _reach(address: str) -> None:
    """Raises OSError if no server listens, as Ray would wait for minutes or end the process."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if port.isdigit():
        socket.create_connection((host, int(port)), timeout=10).close()


def _listens(address: str) -> bool:
    try:
        _reach(address)
    except OSError:
        return False
    return True
