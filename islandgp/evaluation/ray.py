"""Episodes on a Ray cluster: on this machine, or on one that is running already.

Results do not depend on the cluster: an episode is a function of its job. Ray
runs an episode again when its worker or its machine dies; a job that kills its
worker each time is named and ends the run.
"""

from __future__ import annotations

import logging
import os
import secrets
import socket
from collections.abc import Sequence
from pathlib import Path
from time import monotonic, sleep
from typing import TYPE_CHECKING, Any, Final

from pydantic import BaseModel, Field

from islandgp.domain import Outcome
from islandgp.errors import EvaluationError, brief
from islandgp.evaluation.base import Job, Problem, blame, simulate

if TYPE_CHECKING:
    from ray import ObjectRef

QUIET: Final = {"include_dashboard": False, "log_to_driver": False, "logging_level": logging.ERROR}

LOOK: Final = 5.0  # s of waiting for an episode between two looks whether the cluster is there
GONE: Final = 20.0  # s that its head may be away; Ray ends the process without a word after 60


class RaySettings(BaseModel, frozen=True, extra="forbid"):
    """Address of the cluster and resources of an episode."""

    address: str = Field(min_length=1)  # "local": start one here; "auto", "host:port", "ray://..."
    cpus: float = Field(gt=0, le=64)  # of an episode
    retries: int = Field(ge=0, le=100)  # of an episode whose worker died
    workers: int = Field(ge=0, le=1024)  # of a local cluster; 0: one for each core
    episode_timeout: float = Field(600, ge=0, le=1e6)  # s until an episode is given up; 0: never


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
        remote = settings.address.startswith("ray://")  # whose own address is another network's
        self._head = settings.address if remote else self._ray.get_runtime_context().gcs_address
        self._node = "" if remote else _own_node(self._ray)
        options = {"num_cpus": settings.cpus, "max_retries": settings.retries}
        self._task: Any = self._ray.remote(**options)(simulate)
        self._problem = self._ray.put(problem)  # sent to each machine once

    def evaluate(self, jobs: Sequence[Job]) -> list[Outcome]:
        """See `Evaluator`."""
        self.simulated += len(jobs)
        if monotonic() > self._looked + LOOK:
            self._must_be_there()  # tasks go on for a minute without the head; then Ray ends us
            self._looked = monotonic()
        futures = [self._task.remote(self._problem, job, self._limit) for job in jobs]
        try:
            return [self._result(job, f) for job, f in zip(jobs, futures, strict=True)]
        except BaseException:
            for future in futures:
                self._ray.cancel(future, force=True)
            raise

    def _result(self, job: Job, future: ObjectRef[Outcome]) -> Outcome:
        from ray.exceptions import GetTimeoutError, RayError, RayTaskError

        try:
            while True:
                try:
                    outcome: Outcome = self._ray.get(future, timeout=LOOK)
                    break
                except GetTimeoutError:
                    self._must_be_there()
        except RayTaskError as error:  # `simulate` named the job already
            raise EvaluationError(str(error.cause)) from error
        except RayError as error:
            raise EvaluationError(blame(job, "that its worker died again and again")) from error
        return outcome

    def _must_be_there(self) -> None:
        """Raises EvaluationError where the cluster is gone; its head may be away for a while."""
        end = monotonic() + GONE
        while True:
            try:
                _reach(self._node)  # Ray ends this process some seconds after its node
                return _reach(self._head)
            except OSError as error:
                if monotonic() > end or not _listens(self._node):
                    raise EvaluationError(
                        f"Expected the Ray cluster at {self._head!r}, found that it has ended"
                        f" ({error}). The run keeps what it has; start the cluster, and give the"
                        " command again."
                    ) from error
                sleep(1)

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
    except Exception as error:  # Ray raises bare ones, too, as where its start takes too long
        if settings.address == "local":
            raise EvaluationError(
                f"Expected Ray to start on this machine, found that it cannot ({brief(error)});"
                " make room, and give the command again."
            ) from error
        if isinstance(error, ValueError) or "any running" in str(error):
            raise _no_cluster(settings.address, error) from error
        raise _refused(settings.address, error) from error
    return ray, True


def _own_node(ray: Any) -> str:
    """The address of this machine's part of the cluster."""
    own = ray.get_runtime_context().get_node_id()
    (node,) = (node for node in ray.nodes() if node["NodeID"] == own)
    return f"{node['NodeManagerAddress']}:{node['NodeManagerPort']}"


def own_token() -> None:
    """Gives a token to the cluster that Ray will start for this process alone.

    Ray would write one into the home folder, after which `ray start --head` asks for it and
    `ray start --address` does not send it. A token that the user has stays in use.
    """
    chosen = {"RAY_AUTH_MODE", "RAY_AUTH_TOKEN", "RAY_AUTH_TOKEN_PATH"} & os.environ.keys()
    if not chosen and not (Path.home() / ".ray" / "auth_token").exists():
        os.environ["RAY_AUTH_TOKEN"] = secrets.token_hex(32)


def _no_cluster(address: str, error: Exception) -> EvaluationError:
    return EvaluationError(
        f"Expected a Ray cluster at {address!r}, found none ({error});"
        " start one with `ray start --head`, or take evaluator.policy.address=local."
    )


def _refused(address: str, error: Exception) -> EvaluationError:
    return EvaluationError(
        f"Expected to join the Ray cluster at {address!r}, found that it does not take us"
        f" ({brief(error)}); its version of Ray and Python must be this one's, and its token, if"
        " it has one: RAY_AUTH_MODE=token, and RAY_AUTH_TOKEN or ~/.ray/auth_token."
    )


def _reach(address: str) -> None:
    """Raises OSError where no server listens: Ray would wait for minutes, or end the process."""
    host, _, port = address.removeprefix("ray://").rpartition(":")
    if port.isdigit():
        socket.create_connection((host, int(port)), timeout=10).close()


def _listens(address: str) -> bool:
    try:
        _reach(address)
    except OSError:
        return False
    return True
