"""Hypothesis profiles, of which `tests/conftest.py` chooses one: numbers of examples a test.

`quick` tries the same examples in every run, so that a failing test fails until it is corrected.
`nightly` tries others, and many more: `pytest --hypothesis-profile=nightly`.
"""

from __future__ import annotations

from collections.abc import Iterable, Sequence
from typing import Any, Final

import pytest
from hypothesis import Phase, settings

BASE: Final = 100  # examples a test where neither it nor the profile sets a number
LEAST: Final = 5

settings.register_profile(
    "quick", deadline=None, derandomize=True, database=None, max_examples=BASE // 10
)
settings.register_profile(
    "mutants", settings.get_profile("quick"), phases=(Phase.explicit, Phase.generate)
)
settings.register_profile("nightly", deadline=None, max_examples=5 * BASE)


def examples(max_examples: int, **more: Any) -> settings:
    """Settings of a test that needs more or fewer examples than others do.

    Args:
        max_examples: Number of examples where the profile's is 100; else in proportion.
        more: Other arguments of `hypothesis.settings`.
    """
    return settings(max_examples=cases(max_examples), **more)


def cases(number: int) -> int:
    """Number of random cases that a test runs under the profile.

    Args:
        number: Number of cases where the profile's is 100; else in proportion, at least 5.
    """
    return max(LEAST, round(settings().max_examples / BASE * number))


def sweep(
    names: str | Sequence[str], values: Iterable[Any], *, quick: int, **more: Any
) -> pytest.MarkDecorator:
    """`pytest.mark.parametrize` that marks all but `quick` evenly spread cases as `slow`."""
    one = isinstance(names, str) and "," not in names
    cases = list(values)
    quick_cases = {n * len(cases) // quick for n in range(quick)}
    for n, case in enumerate(cases):
        if n in quick_cases:
            continue
        param = case if isinstance(case, type(pytest.param())) else None
        parts = param.values if param else (case,) if one else case
        marks = (*(param.marks if param else ()), pytest.mark.slow)
        cases[n] = pytest.param(*parts, marks=marks, id=param.id if param else None)
    return pytest.mark.parametrize(names, cases, **more)
