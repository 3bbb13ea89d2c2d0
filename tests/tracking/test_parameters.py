"""A configuration as parameters, and without its secrets."""

from __future__ import annotations

import pytest

from islandgp.plain import flatten
from islandgp.records.parameters import flat, redacted, secret_in


def test_nested_values_become_dotted_keys() -> None:
    """Text stays text, anything else is JSON."""
    config = {"a": {"b": 1, "c": [1, 2]}, "d": "x", "e": None, "f": {}}
    assert dict(flat(config)) == {"a.b": "1", "a.c": "[1, 2]", "d": "x", "e": "null", "f": "{}"}


def test_values_by_dotted_key() -> None:
    """Values keep their type; a mapping by operators, whose names no store takes, stays whole."""
    config = {"a": {"b": 1, "c": [1, 2]}, "operators": {"<": 3, "==": 1}, "e": None, "f": {}}
    assert flatten(config) == {
        "a.b": 1,
        "a.c": [1, 2],
        "operators": {"<": 3, "==": 1},
        "e": None,
        "f": {},
    }
    assert [key for key, _ in flat(config)] == list(flatten(config))


def test_secrets_are_hidden_at_any_depth() -> None:
    """Values of keys that name a secret go; a missing one stays missing."""
    config = {"supervisor": {"policy": {"api_key": "sk-1", "max_tokens": 8}}, "api_key": None}
    assert redacted(config) == {
        "supervisor": {"policy": {"api_key": "***", "max_tokens": 8}},
        "api_key": None,
    }


@pytest.mark.parametrize(
    ("key", "secret"),
    [
        ("supervisor.policy.api_key", True),
        ("apikey", True),
        ("auth_token", True),
        ("password", True),
        ("supervisor.policy.max_tokens", False),
        ("supervisor.policy.key_words", False),
    ],
)
def test_which_keys_name_a_secret(key: str, secret: bool) -> None:
    """The last part of the key decides."""
    assert secret_in(f"{key}=x") == (key if secret else "")
