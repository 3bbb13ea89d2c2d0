"""Stores for tests: made once, and copied."""

from __future__ import annotations

import shutil
from pathlib import Path

import pytest

from islandgp.tracking.store import Store
from tests.tracking.folders import place
from tests.trees.conftest import islandgp

__all__ = ["home", "islandgp", "store", "template"]


@pytest.fixture(scope="session")
def template(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A fresh store without our experiment; making it takes a second.

    From then on MLflow reads its migrations, to learn the newest, no more: once is enough.
    """
    home = tmp_path_factory.mktemp("template")
    Store(place(home, "another")).client.search_experiments()
    from mlflow.store.db import utils

    newest = utils._get_latest_schema_revision()
    utils._get_latest_schema_revision = lambda: newest
    return home / "mlflow.db"


@pytest.fixture
def home(tmp_path: Path, template: Path) -> Path:
    """A folder to give commands in, with a store in it."""
    shutil.copy(template, tmp_path / "mlflow.db")
    return tmp_path


@pytest.fixture
def store(home: Path) -> Store:
    """That store, open."""
    return Store(place(home))
