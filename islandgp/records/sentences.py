"""Sentences on the result of a finished run, the same on the terminal and on the run's page."""

from __future__ import annotations

from collections.abc import Iterator, Mapping, Sequence
from typing import Any

from islandgp.text import in_points, title


def measured(v: Mapping[str, Any], sign: str = "") -> str:
    """Mean points with their 95 % interval, or the reason why there is none."""
    low, high = v["low"], v["high"]
    if low is None or high is None:
        return f"{in_points(v['mean'], sign)} points (no interval: one world)"
    ends = f"{in_points(low, sign)} to {in_points(high, sign)}"
    return f"{in_points(v['mean'], sign)} points (95 %: {ends})"


def best_robot(champion: Mapping[str, Any]) -> str:
    """The best robot's result in unseen worlds, and its differences to other trees there."""
    v = champion["validation"]
    if v is None:
        return f"{_name(champion)}, not validated in other worlds"
    n = len(v["worlds"])
    return f"{_name(champion)}: {measured(v)} in {n} unseen world{'s' * (n != 1)}"


def best_robot_in_a_sentence(champion: Mapping[str, Any]) -> str:
    """The best robot's result in unseen worlds with all comparisons, as one sentence."""
    v = champion["validation"]
    others = (
        [f"{measured(other, '+')} against the {other['name']}" for other in v["comparisons"]]
        if v
        else []
    )
    return ", ".join((best_robot(champion), *others)) + "."


def comparisons(champion: Mapping[str, Any]) -> Iterator[str]:
    """One sentence for each tree with which the best robot is compared in these worlds."""
    for other in (champion["validation"] or {}).get("comparisons", ()):
        yield f"Against the {other['name']} in the same worlds: {measured(other, '+')}"


def reached(champion: Mapping[str, Any]) -> Iterator[str]:
    """A sentence on the tiers of the best robot in unseen worlds, if there are any."""
    shares = (champion["validation"] or {}).get("reached", {})
    if texts := [f"{title(tier)} in {share:.0%}" for tier, share in shares.items() if share]:
        yield f"In these worlds it is {', '.join(texts)}"


def constrained(summary: Mapping[str, Any]) -> Iterator[str]:
    """A sentence on the feasibility of the best robot; none without constraints."""
    v = summary["champion"]["validation"]
    if "constraints" not in summary:
        return
    limits = summary["constraints"]
    if v is None or v.get("feasible") is None:
        yield f"Constraints ({limits}): not tried in other worlds"
        return
    result = "kept" if not v["violation"] else f"broken (violation {v['violation']:.3g})"
    yield f"Constraints ({limits}): {result} on average, and in {v['feasible']:.0%} of these worlds"


def _name(champion: Mapping[str, Any]) -> str:
    """The best robot, with the numbers of nodes before and after the shortening, if any."""
    before = champion["record"]["nodes"]
    after = [tree["nodes"] for tree in champion["front"] if tree["chosen"]]
    short = f", shortened from {before} to {after[0]} nodes" if after and after[0] < before else ""
    return f"Best robot: individual {champion['record']['id']}{short}"


def in_lines(learned: Sequence[str]) -> Iterator[str]:
    """What a search has found out about the actions, under a heading."""
    yield "Learned from the episodes:"
    yield from (f"  {sentence}" for sentence in learned)
