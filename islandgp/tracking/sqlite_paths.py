"""The paths and addresses in a SQLite store, which anybody may have written.

MLflow sends files, and the user's password, to the address that a row names. So the artifacts of
this package's runs are in the folder that the user's configuration names, also in a store that was
moved.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Final
from urllib.parse import urlsplit

from islandgp.errors import TrackingError
from islandgp.gate import check_file, cleaned

ADDRESSES: Final = {
    "experiments": "artifact_location",
    "runs": "artifact_uri",
    "logged_models": "artifact_location",
    "model_versions": "storage_location",
    "workspaces": "trace_archival_location",
    "webhooks": "url",
}
"""Tables with addresses to which MLflow's server connects, and their columns."""


LOCKED: Final = 60.0  # s to wait for another process that writes


def keep_artifacts(file: Path | None, artifacts: str | None, tag: str) -> None:
    """Sets the place of the artifacts of all runs with a tag to a folder; for a server, nothing.

    Raises:
        TrackingError: the database is another program's.
        UntrustedError: the folder is a link.
    """
    if file is None or artifacts is None:
        return
    folder = Path(artifacts)
    check_file(folder)
    where = f"{location(folder)}/"
    with closing(_open(file)) as store, store:
        store.execute(
            "UPDATE runs SET artifact_uri = ?1 || run_uuid || '/artifacts'"
            " WHERE artifact_uri IS NOT ?1 || run_uuid || '/artifacts'"
            " AND run_uuid IN (SELECT run_uuid FROM tags WHERE key = ?2)",
            (where, tag),
        )


def check_addresses(file: Path) -> None:
    """Raises TrackingError if a row of any table names a server, for MLflow's own server."""
    with closing(_open(file)) as store:
        for table, column in ADDRESSES.items():
            if column not in {row[1] for row in store.execute(f"PRAGMA table_info({table})")}:
                continue
            for (text,) in store.execute(f"SELECT {column} FROM {table} WHERE {column} != ''"):
                parts = urlsplit(str(text))
                if parts.netloc or parts.scheme not in ("", "file", "models", "runs"):
                    raise TrackingError(
                        f"Expected a store whose artifacts are files, found {cleaned(str(text))} in"
                        f" {file}; `mlflow ui` shows it, and connects to that address."
                    )


def location(folder: Path) -> str:
    """A folder of artifacts for MLflow, which decodes ? and % in a path, not in an address."""
    return folder.as_uri() if set(str(folder)) & set("?%#") else str(folder)


def _open(file: Path) -> sqlite3.Connection:
    """A connection to a store. Raises TrackingError if it is not a store of MLflow."""
    store = sqlite3.connect(f"{file.as_uri()}?mode=rw", uri=True, timeout=LOCKED)
    try:
        names = {name for (name,) in store.execute("SELECT name FROM sqlite_master")}
    except sqlite3.DatabaseError:
        names = set()
    if not {"experiments", "runs", "alembic_version"} <= names:
        store.close()
        raise TrackingError(
            f"Expected an MLflow store in {file}, found a file of another program; give another"
            " file by tracking.policy.uri or --uri."
        )
    return store
