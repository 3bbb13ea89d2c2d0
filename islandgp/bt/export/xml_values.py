"""The arguments of nodes from the attributes of XML elements.

Each function raises ValueError with the expected and the actual value; the caller adds the place.
"""

from __future__ import annotations

import re
from collections.abc import Mapping
from typing import Final

from islandgp.bt.core import kinds
from islandgp.bt.core.kinds import COUNTS, KINDS, POLICIES, SECONDS, TARGETS
from islandgp.bt.core.language import MAX_CHARACTERS
from islandgp.bt.core.node import CountArgs, ParallelArgs, Policy, SecondsArgs, Value
from islandgp.bt.core.parameters import Parameter, fits, value_range
from islandgp.bt.core.source import shown
from islandgp.bt.export.plan import SemanticDifference

Attributes = Mapping[str, str]

COUNTED: Final = {tag: (n, t.ports[0]) for tag, (n, t) in TARGETS.items() if n in kinds.COUNTED}
"""By tag: our kind, and the attribute with the count."""

TIMED: Final = {
    "Sleep": ("wait", "msec", 1000),
    **{
        tag: (name, target.ports[-1], 1 if target.category else 1000)
        for tag, (name, target) in TARGETS.items()
        if name in kinds.TIMED and name != "every"
    },
}
"""By tag: our kind, the attribute, and the number of its units in a second."""

ALWAYS: Final = {"AlwaysSuccess": "success", "AlwaysFailure": "failure"}
"""By tag: the status of an `always`."""
ENDLESS: Final = {"repeater": "until_failure", "retry": "until_success"}
"""The kind of an endless repetition, by that of a counted one."""
PLAIN: Final = {
    "SequenceWithMemory": "sequence",
    **{
        tag: name
        for tag, (name, _) in TARGETS.items()
        if not KINDS[name].arguments and KINDS[name].advance_status is None
    },
}
"""Tags of nodes that have no arguments here."""
_NUMBER: Final = re.compile(r"[0-9]{1,9}(\.[0-9]{1,20})?")
_FLAGS: Final = {"true": "yes", "1": "yes", "false": "no", "0": "no"}

MEMORY = SemanticDifference(
    "memory",
    "SequenceWithMemory continues with the failed child when it starts again; a sequence starts"
    " with its first child",
)
WAITS = SemanticDifference(
    "waits",
    "ParallelAll with max_failures above 1 ends when all children have ended; a parallel ends as"
    " soon as enough of them have succeeded",
)
COMMENTS = SemanticDifference(
    "comments",
    f"there are comments and names, with which the text would have more than {MAX_CHARACTERS:,}"
    " characters; they are left out",
)


def count_args(attributes: Attributes, attribute: str, default: str = "") -> CountArgs:
    """A number of repetitions."""
    count = attributes.get(attribute, default)
    if not _is_count(count):
        fewest, most = COUNTS
        raise ValueError(f"expected {attribute} from {fewest} to {most:,}, found {shown(count)}")
    return CountArgs(int(count))


def _is_count(text: str) -> bool:
    return text.isdecimal() and len(text) < 10 and COUNTS[0] <= int(text) <= COUNTS[1]


def seconds_args(attributes: Attributes, attribute: str, unit: int) -> SecondsArgs:
    """A time, from an attribute in units of 1/`unit` seconds."""
    text = attributes.get(attribute, "")
    seconds = float(text) / unit if _NUMBER.fullmatch(text) else 0.0
    least, most = SECONDS
    if not least <= seconds <= most:
        raise ValueError(
            f"expected {attribute} from {least * unit:g} to {most * unit:,}, found {shown(text)}"
        )
    return SecondsArgs(seconds)


def period_args(attributes: Attributes) -> SecondsArgs:
    """The time between two starts of a RateController's child."""
    text = attributes.get("hz", "10")
    hz = float(text) if _NUMBER.fullmatch(text) else 0.0
    least, most = SECONDS
    if not 1 / most <= hz <= 1 / least:
        raise ValueError(f"expected hz from {1 / most:f} to {1 / least:g}, found {shown(text)}")
    return SecondsArgs(round(1 / hz, 6))


def judged_args(attributes: Attributes) -> ParallelArgs:
    """The policies of a JudgedParallel."""
    policies: list[Policy] = []
    for attribute, default in (("success", "all"), ("failure", "one")):
        policy = attributes.get(attribute, default)
        if policy not in POLICIES and not _is_count(policy):
            raise ValueError(f"expected {attribute} one, all or a number, found {shown(policy)}")
        policies.append(policy if policy in POLICIES else int(policy))
    return ParallelArgs(*policies)


THRESHOLDS: Final = {"success_threshold": "success_count", "failure_threshold": "failure_count",
                     "threshold": "success_count"}  # fmt: skip
"""Attributes of a Parallel of version 3, with those of version 4."""


def all_args(attributes: Attributes, count: int) -> ParallelArgs:
    """The policies of a ParallelAll with `count` children, which fails after all have ended."""
    failure = _threshold(attributes, "max_failures", "1", count)
    return ParallelArgs("all" if failure == 1 else _policy(count - failure + 1, count), "all")


def parallel_args(attributes: Attributes, count: int) -> ParallelArgs:
    """The policies of a Parallel with `count` children."""
    attributes = {THRESHOLDS.get(name, name): value for name, value in attributes.items()}
    success = _threshold(attributes, "success_count", "-1", count)
    # It fails when it can no longer succeed.
    failure = min(_threshold(attributes, "failure_count", "1", count), count - success + 1)
    succeeds: Policy = "all" if success == count else _policy(success, count)
    return ParallelArgs(succeeds, _policy(failure, count))


def _threshold(attributes: Attributes, attribute: str, default: str, count: int) -> int:
    value = attributes.get(attribute, default)
    number = int(value) if re.fullmatch(r"-?[0-9]{1,4}", value) else 0
    number = max(0, count + number + 1) if number < 0 else number  # -1 is all
    if not 1 <= number <= min(count, COUNTS[1]):
        raise ValueError(f"expected {attribute} 1 to {count}, or -1 for all, found {shown(value)}")
    return number


def _policy(number: int, count: int) -> Policy:
    return "one" if number == 1 else "all" if number == count else number


def port_value(port: str, text: str, parameter: Parameter) -> Value:
    """The value of an action's argument from that of its port."""
    value: Value = _FLAGS.get(text, text) if parameter.sort == "flag" else text
    if parameter.numeric and _NUMBER.fullmatch(text.removeprefix("-")):
        value = float(text)
    if not fits(parameter, value):
        raise ValueError(f"expected {port} of {value_range(parameter)}, found {shown(text)}")
    return value
