"""The paths and addresses in a SQLite store, which anybody may have written.

MLflow sends files, and the user's password, to the address that a row names. So the artifacts of
an experiment must be in the folder that the user's configuration names. If the store was moved
with its folder, its rows get the new path.
"""

from __future__ import annotations

import sqlite3
from contextlib import closing
from pathlib import Path
from typing import Final
from urllib.parse import unquote, urlsplit

from islandgp.errors import TrackingError
from islandgp.gate import check_folder, cleaned

ROWS: Final = {
    "experiments": ("artifact_location", "experiment_id"),
    "runs": ("artifact_uri", "run_uuid"),
}
"""Tables with the paths that this package uses: column, and the key of a row."""

OTHERS: Final = {
    **{table: column for table, (column, _) in ROWS.items()},
    "logged_models": "artifact_location",
    "model_versions": "storage_location",
    "workspaces": "trace_archival_location",
    "webhooks": "url",
}
"""Tables with addresses to which MLflow's server connects, and their columns."""


def check_experiment(file: Path, artifacts: Path, experiment: str) -> None:
    """Checks the paths of an experiment and its runs; those of a moved store are corrected.

    Raises:
        TrackingError: the database is another program's, or a path is outside of `artifacts`.
    """
    if artifacts.is_symlink():
        raise TrackingError(
            f"Expected a folder of artifacts in {artifacts}, found a link; set"
            " tracking.policy.artifacts to the folder itself."
        )
    with closing(_open(file)) as store, store:
        for table, (column, key) in ROWS.items():
            named = "SELECT experiment_id FROM experiments WHERE name = ?"
            where = f"WHERE experiment_id IN ({named}) AND {column} IS NOT NULL"
            rows = store.execute(f"SELECT {key}, {column} FROM {table} {where}", (experiment,))
            for row, text in rows.fetchall():
                if _inside(path := _local(text), artifacts):
                    continue
                parts = () if path is None or path.exists() else path.parts
                if artifacts.name not in parts or ".." in parts:
                    raise TrackingError(
                        f"Expected the artifacts of the experiment {experiment} in {artifacts},"
                        f" found {cleaned(str(text))}; set tracking.policy.artifacts to their"
                        " folder, or choose another experiment or store."
                    )
                rest = parts[parts.index(artifacts.name) + 1 :]
                moved = location(artifacts.joinpath(*rest))
                store.execute(f"UPDATE {table} SET {column} = ? WHERE {key} = ?", (moved, row))


def check_addresses(file: Path) -> None:
    """Raises TrackingError if a row of any table names a server, for MLflow's own server."""
    with closing(_open(file)) as store:
        for table, column in OTHERS.items():
            if column not in {row[1] for row in store.execute(f"PRAGMA table_info({table})")}:
                continue
            for (text,) in store.execute(f"SELECT {column} FROM {table} WHERE {column} != ''"):
                if _local(text) is None and urlsplit(str(text)).scheme not in ("models", "runs"):
                    raise TrackingError(
                        f"Expected a store whose artifacts are files, found {cleaned(str(text))} in"
                        f" {file}; `mlflow ui` shows it, and connects to that address."
                    )


def check_artifacts(address: str) -> None:
    """Raises UntrustedError for a link in the folder of a run's artifacts."""
    if (folder := _local(address)) is not None:
        check_folder(folder)
        check_folder(folder.parent)


def location(folder: Path) -> str:
    """A folder of artifacts for MLflow, which decodes ? and % in a path, not in an address."""
    return folder.as_uri() if set(str(folder)) & set("?%#") else str(folder)


def _open(file: Path) -> sqlite3.Connection:
    """A connection to a store. Raises TrackingError if it is not a store of MLflow."""
    store = sqlite3.connect(f"{file.as_uri()}?mode=rw", uri=True)
    try:
        names = {name for (name,) in store.execute("SELECT name FROM sqlite_master")}
    except sqlite3.DatabaseError:
        names = set()
    if not {*ROWS, "alembic_version"} <= names:
        store.close()
        raise TrackingError(
            f"Expected an MLflow store in {file}, found a file of another program; give another"
            " file by tracking.policy.uri or --uri."
        )
    return store


def _local(text: object) -> Path | None:
    """The absolute path that a row names; None for a server or any other address."""
    parts = urlsplit(str(text))
    if parts.scheme == "file" and not parts.netloc:
        return Path(unquote(parts.path))
    return Path(str(text)) if str(text).startswith("/") else None


def _inside(path: Path | None, folder: Path) -> bool:
    return path is not None and ".." not in path.parts and path.is_relative_to(folder)
