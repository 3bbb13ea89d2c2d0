"""The MLflow store: a SQLite file by default, or a tracking server.

Only one process creates a new SQLite file, because MLflow's creation of tables fails if several
processes do it at once.
"""

from __future__ import annotations

import logging
import os
import re
from collections.abc import Iterable, Mapping
from dataclasses import dataclass, field
from errno import ENOSPC
from getpass import getuser
from itertools import islice
from pathlib import Path
from typing import TYPE_CHECKING, Final
from urllib.parse import quote, urlsplit

from filelock import FileLock
from pydantic import BaseModel, Field, field_validator

from islandgp.atomic_files import must_take_files
from islandgp.errors import TrackingError
from islandgp.gate import check_folder
from islandgp.tracking.sqlite_paths import keep_artifacts, location

if TYPE_CHECKING:
    from mlflow.entities import Metric, Run
    from mlflow.tracking import MlflowClient


SQLITE: Final = "sqlite:///"
PARAMETERS: Final = 100  # MLflow's limit of parameters a call
MAX_PARAMETER: Final = 6000  # MLflow's limit of characters a parameter
MAX_NAME: Final = 250  # MLflow's limit of characters of a name
INVALID: Final = re.compile(r"[^\w. :/-]")  # characters that MLflow rejects in names
KEY: Final = "islandgp.id"  # tag with the key of a run
SENT: Final = "islandgp.sent"  # tag with status and number of generations when all was sent
LOCK: Final = ".tracking.lock"  # in a folder whose records are sent
ARM: Final = "islandgp.sweep.arm"
"""The tag with the name of a run's arm in its sweep.

MLflow takes the colour of a group of runs from a hash of the tag's name and value. With this name
all supervisors in `conf` have different colours.
"""

ENVIRONMENT: Final = {
    "MLFLOW_HTTP_REQUEST_TIMEOUT": "10",  # s a request; the default is 120
    # `Sender` repeats failed requests itself, after querying the store.
    "MLFLOW_HTTP_REQUEST_MAX_RETRIES": "0",
    "MLFLOW_DISABLE_TELEMETRY": "true",
    "MLFLOW_SUPPRESS_PRINTING_URL_TO_STDOUT": "true",
    "GIT_PYTHON_REFRESH": "quiet",
}
"""MLflow's settings, unless the user has set them."""


class MLflowSettings(BaseModel, frozen=True, extra="forbid"):
    """Settings of `tracking=mlflow`."""

    uri: str = Field(pattern=r"^(sqlite:///.+|https?://.+)$")  # without a password
    artifacts: str = Field(min_length=1)  # folder, for the SQLite store; a server knows its own
    experiment: str = Field(min_length=1)  # name of the MLflow experiment
    patience: float = Field(ge=0, le=3600)  # s to wait for the store at the end of a run

    @field_validator("uri")
    @classmethod
    def _can_be_asked(cls, uri: str) -> str:
        if uri.startswith(SQLITE):
            return uri
        try:
            parts = urlsplit(uri)
            sound = bool(parts.hostname) and parts.port != 0
        except ValueError:  # it may show a part of a password
            sound = False
        if not sound:
            raise ValueError("expected http://HOST:PORT with a port from 1 to 65535")
        if "@" in parts.netloc:
            raise ValueError(
                "expected an address without a password; set MLFLOW_TRACKING_USERNAME and"
                " MLFLOW_TRACKING_PASSWORD"
            )
        return uri


@dataclass(frozen=True, slots=True)
class TrackingStore:
    """The address of a store and an experiment in it, independent of the working folder."""

    uri: str  # of a file: sqlite:/// and its absolute path
    artifacts: str | None  # absolute folder; None: the server decides
    experiment: str
    configured: str = field(default="", repr=False, compare=False)  # the address as configured

    @classmethod
    def of(cls, settings: MLflowSettings, home: Path) -> TrackingStore:
        """The place for these settings; relative paths are relative to `home`."""
        uri, experiment = settings.uri.rstrip("/"), settings.experiment
        if not uri.startswith(SQLITE):
            return cls(uri, None, experiment, uri)
        file = os.path.normpath(home.resolve() / uri.removeprefix(SQLITE))
        artifacts = os.path.normpath(home.resolve() / settings.artifacts)
        return cls(f"{SQLITE}{file}", artifacts, experiment, uri)

    @property
    def file(self) -> Path | None:
        """The SQLite file; None for a server."""
        return Path(self.uri.removeprefix(SQLITE)) if self.uri.startswith(SQLITE) else None

    @property
    def address(self) -> str:
        """The address for MLflow, which takes ? and % for parts of an address.

        With the name of the driver, as MLflow makes a folder of the quoted name without it.
        """
        if self.file is None:
            return self.uri
        return f"sqlite+pysqlite:///{quote(str(self.file), safe=UNQUOTED)}"


UNQUOTED: Final = "".join(chr(n) for n in range(32, 127) if chr(n) not in "?%#")


def check_place(place: TrackingStore) -> None:
    """Raises TrackingError if a SQLite file cannot be created or written.

    A full disk is no error, as it may have space again at the end of the run.
    """
    if (file := place.file) is None:
        return
    try:
        if file.exists():
            file.open("r+b").close()
        must_take_files(file.parent)
    except OSError as error:
        if error.errno != ENOSPC:
            raise TrackingError(
                f"tracking.policy.uri: expected a SQLite file that can be written, found {file}:"
                f" {error.strerror or error}; choose another, or tracking=off"
            ) from None


class Store:
    """An open store. Each method may raise MLflow's errors, e.g. if the server is unreachable."""

    def __init__(self, place: TrackingStore) -> None:
        """Opens the store. Raises TrackingError if its experiment was deleted."""
        self.place = place
        self.client = _client(place)
        self.experiment = self._experiment()

    def _experiment(self) -> str:
        from mlflow.exceptions import MlflowException

        name = self.place.experiment
        experiment = self.client.get_experiment_by_name(name)
        if experiment is None:
            try:
                folder = self.place.artifacts
                where = None if folder is None else location(Path(folder))
                return str(self.client.create_experiment(name, artifact_location=where))
            except MlflowException:  # another process was faster
                experiment = self.client.get_experiment_by_name(name)
        if experiment is None or experiment.lifecycle_stage != "active":
            raise TrackingError(
                f"Expected an experiment {name!r} in {self.place.uri}, found it deleted;"
                " restore it in the MLflow UI, or choose another tracking.policy.experiment."
            )
        return str(experiment.experiment_id)

    def create(
        self, key: str, name: str, *, command: str, started: int, tags: Mapping[str, str]
    ) -> str:
        """Creates a run with the key `key` and returns its id. `started`: ms since 1970."""
        standard_tags = {
            KEY: key,
            "mlflow.user": getuser(),
            "mlflow.source.type": "LOCAL",
            "mlflow.source.name": command,
        }
        run = self.client.create_run(
            self.experiment, start_time=started, tags={**tags, **standard_tags}, run_name=name
        )
        keep_artifacts(self.place.file, self.place.artifacts, KEY)
        return str(run.info.run_id)

    def log_parameters(self, run: str, pairs: Iterable[tuple[str, str]]) -> None:
        """Sends parameters in calls of the size that MLflow accepts; long values are cut."""
        from mlflow.entities import Param

        waiting = iter(pairs)
        while batch := [Param(k, v[:MAX_PARAMETER]) for k, v in islice(waiting, PARAMETERS)]:
            self.client.log_batch(run, params=batch)

    def find(self, key: str) -> Run | None:
        """Finds the run with the key `key`; of several the one with the most data.

        A server may carry out a request to create a run after the client has given up and sent
        another one. Such duplicates without data are deleted.
        """
        runs = self.client.search_runs([self.experiment], f"tags.`{KEY}` = '{key}'")
        if not runs:
            return None

        def fullness(run: Run) -> tuple[int, int, str]:
            return len(run.data.metrics), len(run.data.params), run.info.run_id

        run, *others = sorted(runs, key=fullness, reverse=True)
        if self.place.artifacts is not None:
            folder = Path(self.place.artifacts) / run.info.run_id
            check_folder(folder)
            check_folder(folder / "artifacts")
        for other in others:
            if not other.data.metrics and not other.data.params:
                self.client.delete_run(other.info.run_id)
        return run

    def delete_children(self, parent: str, name: str, *, without: str) -> None:
        """Deletes other children of that name: of a job whose folder was deleted since."""
        tag = f"tags.`mlflow.parentRunId` = '{parent}'"
        for run in self.client.search_runs([self.experiment], tag):
            if run.info.run_name == name and run.info.run_id != without:
                self.client.delete_run(run.info.run_id)

    def last_step(self, run: str, metric: str) -> int:
        """The last step logged of a metric; -1 when there is none."""
        return max((m.step for m in self.client.get_metric_history(run, metric)), default=-1)


def points(values: Mapping[str, float], at: int, step: int) -> list[Metric]:
    """The points of values by name, with valid names; `at` is ms since 1970."""
    from mlflow.entities import Metric

    return [
        Metric(INVALID.sub("_", name)[:MAX_NAME], float(value), at, step)
        for name, value in values.items()
    ]


def load() -> str:
    """Imports MLflow, without its telemetry, log output and long timeouts; returns ""."""
    for name, value in ENVIRONMENT.items():
        os.environ.setdefault(name, value)
    logging.getLogger("alembic").setLevel(logging.WARNING)
    # This logger prints a traceback for each error that is raised anyway.
    logging.getLogger("mlflow.store.db.utils").setLevel(logging.CRITICAL)
    import mlflow.store.tracking.sqlalchemy_store
    import mlflow.tracking  # noqa: F401 -- for its later users

    return ""


def _client(place: TrackingStore) -> MlflowClient:
    load()
    from mlflow.tracking import MlflowClient
    from mlflow.tracking._tracking_service.utils import _get_store

    if place.file is not None and _make(place.file):
        # Its connections may be to a file that was deleted.
        _get_store(place.address).engine.dispose()  # type: ignore[no-untyped-call]
    keep_artifacts(place.file, place.artifacts, KEY)
    return MlflowClient(tracking_uri=place.address)


def _make(file: Path) -> bool:
    """Creates the SQLite file atomically if it is missing; returns True if it did."""
    file.parent.mkdir(parents=True, exist_ok=True)
    if has_data(file):
        return False
    from mlflow.store.tracking.sqlalchemy_store import SqlAlchemyStore

    with FileLock(file.with_name(f".{file.stem}.lock")):
        if has_data(file):
            return True
        new = file.with_name(f".{file.stem}.new")
        new.unlink(missing_ok=True)
        address = TrackingStore(f"{SQLITE}{new}", None, "").address
        artifacts = location(file.with_name("mlartifacts"))
        store = SqlAlchemyStore(address, artifacts)  # type: ignore[no-untyped-call]
        store.engine.dispose()
        new.replace(file)
    return True


def has_data(file: Path) -> bool:
    """True if there is a SQLite file that is not empty."""
    return file.exists() and file.stat().st_size > 0
