"""Each key of the island's world and rewards changes what an episode is worth."""

from __future__ import annotations

from collections.abc import Iterator, Mapping
from typing import Any

import pytest
import yaml

import islandgp
from islandgp.errors import ConfigError
from islandgp.resources import resource

pytestmark = pytest.mark.slow

WORLDS = range(6)
NAMES = {"component"}  # keys whose values are names of the domain


def numbers(settings: Mapping[str, Any], path: str) -> Iterator[tuple[str, Any]]:
    """The path and value of each number, and of each list of numbers or points."""
    for key, value in settings.items():
        if isinstance(value, Mapping):
            yield from numbers(value, f"{path}.{key}")
        elif key not in NAMES:
            yield f"{path}.{key}", value


def others(value: Any) -> list[Any]:
    """Other values of a key, some of which may be out of its range."""
    if isinstance(value, list) and isinstance(value[0], list):
        return [value[1:]]
    if isinstance(value, list) and isinstance(value[0], dict):
        return [[{**value[0], "points": 1}, *value[1:]], [{**value[0], "below": 70}]]
    if isinstance(value, list):
        return [[each / 2 for each in value], [each + 20 for each in value]]
    return [value * 3, value / 3, 0, int(value) // 3, int(value) + 1]


def settings_of(group: str, name: str) -> list[tuple[str, Any]]:
    """The keys of a file of the configuration, with their values."""
    return list(
        numbers(yaml.safe_load((resource("conf") / group / f"{name}.yaml").read_text()), group)
    )


def outcomes(*overrides: str) -> list[Any]:
    """What the example trees earn and do in some worlds."""
    experiment = islandgp.compose("tracking=off", "progress=off", *overrides)
    texts = [file.read_text() for file in sorted(resource("grammar/examples").glob("*.bt"))]
    return [experiment.evaluate(experiment.parse(text), WORLDS) for text in texts]


@pytest.fixture(scope="module")
def before() -> list[Any]:
    """The outcomes with the default settings."""
    return outcomes()


@pytest.mark.parametrize(
    ("key", "value"), [*settings_of("world", "island"), *settings_of("rewards", "paper")]
)
def test_the_key_acts(key: str, value: Any, before: list[Any]) -> None:
    """Another value within the range changes an outcome of some example tree."""
    for other in others(value):
        text = str(other).replace("'", "")
        try:
            after = outcomes(f"{key}={text}")
        except ConfigError:
            continue
        if after != before:
            return
    pytest.fail(f"no value of {key} changes anything")
