"""The setup of tests/conftest.py and its command line, for the tests of plug-ins and examples."""

from tests.conftest import pytest_collection_modifyitems, pytest_configure
from tests.trees.conftest import islandgp

__all__ = ["islandgp", "pytest_collection_modifyitems", "pytest_configure"]
