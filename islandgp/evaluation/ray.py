"""Episodes on a Ray cluster: on this machine, or on one that is running already.

Results do not depend on the cluster: an episode is a function of its job. Ray
runs an episode again when its worker or its machine dies; a job that kills its
worker each time is named and ends the run.
"""

from __future__ import annotations

import logging
import os
import socket
from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Final

from pydantic import BaseModel, Field

from islandgp.domain import Outcome
from islandgp.errors import EvaluationError
from islandgp.evaluation.base import Job, Problem, blame, simulate

if TYPE_CHECKING:
    from ray import ObjectRef

QUIET: Final = {"include_dashboard": False, "log_to_driver": False, "logging_level": logging.ERROR}


class RaySettings(BaseModel, frozen=True, extra="forbid"):
    """Which cluster, and what an episode may take of it."""

    address: str = Field(min_length=1)  # "local": start one here; "auto", "host:port", "ray://..."
    cpus: float = Field(gt=0, le=64)  # of an episode
    retries: int = Field(ge=0, le=100)  # of an episode whose worker died
    workers: int = Field(ge=0, le=1024)  # of a local cluster; 0: one for each core


def _run(setting: Problem, job: Job) -> Outcome:
    return simulate(setting, job)


class Ray:
    """The evaluator for many machines."""

    Settings = RaySettings

    @classmethod
    def make(cls, settings: RaySettings, setting: Problem) -> Ray:
        """See `Evaluator`."""
        return cls(settings, setting)

    def __init__(self, settings: RaySettings, setting: Problem) -> None:
        """Connects to the cluster, or starts one.

        Raises:
            EvaluationError: Ray is not installed, or there is no cluster at the address.
        """
        self.simulated = 0
        self._ray, self._ours = _connect(settings)
        options = {"num_cpus": settings.cpus, "max_retries": settings.retries}
        self._task: Any = self._ray.remote(**options)(_run)
        self._setting = self._ray.put(setting)  # sent to each machine once

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.simulated += len(jobs)
        futures = [self._task.remote(self._setting, job) for job in jobs]
        try:
            return [self._result(job, f) for job, f in zip(jobs, futures, strict=True)]
        except BaseException:
            for future in futures:
                self._ray.cancel(future, force=True)
            raise

    def _result(self, job: Job, future: ObjectRef[Outcome]) -> Outcome:
        from ray.exceptions import RayError, RayTaskError

        try:
            found: Outcome = self._ray.get(future)
        except RayTaskError as error:  # `simulate` named the job already
            raise EvaluationError(str(error.cause)) from error
        except RayError as error:
            raise EvaluationError(blame(job, "that its worker died again and again")) from error
        return found

    def close(self) -> None:
        """See `Evaluator`."""
        if self._ours:
            self._ray.shutdown()


def _connect(settings: RaySettings) -> tuple[Any, bool]:
    """Ray, and whether this connection is ours to close."""
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
    if settings.address == "local" and settings.workers:
        options["num_cpus"] = settings.workers
    try:
        _reach(settings.address)
        ray.init(**options)
    except (OSError, ValueError, RuntimeError) as error:
        raise EvaluationError(
            f"Expected a Ray cluster at {settings.address!r}, found none ({error});"
            " start one with `ray start --head`, or take evaluator.policy.address=local."
        ) from error
    return ray, True


def _reach(address: str) -> None:
    """Raises OSError where nobody listens: Ray would wait for minutes, or end the process."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if port.isdigit():
        socket.create_connection((host, int(port)), timeout=10).close()
