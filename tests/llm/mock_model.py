"""A mock of a language model: rules over the prompt's text, with noise and faults.

Like a model it reads only the prompt, so all other parts can be tested without a model. Rules of
Tables 7 and 8 choose a phase and a target; if an informed prompt has the fates of earlier trees and
traces, the rules use them. The results do not predict those of a real model.
"""

from __future__ import annotations

import hashlib
import json
import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any, Final

import numpy as np

from islandgp.bt.core.kinds import kind_of
from islandgp.bt.core.language import parse, to_text
from islandgp.bt.core.node import FAILURE, Limits, Node, selector, walk, within
from islandgp.errors import TreeError
from tests.llm.faults import Fault, spoiled

_STATE: Final = re.compile(r"```json\n(.*?)\n```", re.DOTALL)
_EXAMPLE: Final = re.compile(r"(?:For ([\w, ]+):\n\n)?```\n(.*?)\n```", re.DOTALL)
_RANGE: Final = re.compile(r"^\| (\w+) \|.*\| ([\d.]+) to ([\d.]+) \|$", re.MULTILINE)
_LIMITS: Final = re.compile(r"More than (\d+) levels or (\d+) nodes are refused")
_TRACED: Final = re.compile(r"^The fittest tree.*?```\n(.*?)\n```", re.MULTILINE | re.DOTALL)
_COMPARED: Final = re.compile(r"([<>]=?) (\d+)")
_URGENT: Final = re.compile(r"^- (\w+): \d+ of \d+ individuals do it", re.MULTILINE)
_PARENT: Final = re.compile(r"^Individual ([\d.]+):", re.MULTILINE)

FAULTS: Final = (Fault.UNKNOWN_ACTION, Fault.OUT_OF_RANGE, Fault.MAX_TOKENS, Fault.WRONG_TYPES)
STAGNANT: Final = 5  # generations without improvement
LOW: Final = 0.35  # diversity


@dataclass(frozen=True)
class MockModel:
    """Answers requests of `supervisor=llm`; a function of its settings and the request."""

    seed: int = 0
    noise: float = 0.0  # share of answers drawn at random, in [0, 1]
    faults: float = 0.0  # share of unusable answers, in [0, 1]

    def __call__(self, request: Mapping[str, Any]) -> Any:
        """The answer as JSON values, or as a text if it is made unusable."""
        system, user = _text(request.get("system", "")), str(request["messages"][0]["content"])
        edits = user.startswith("After generation")
        if (match := _STATE.search(user)) is None and not edits:  # the probe
            return {"greeting": "Hello."}
        rng = self._draws(request)
        state = json.loads(match[1]) if match else {}
        guess, spoil = rng.random() < self.noise, rng.random() < self.faults
        if '"edits": [' in system:
            answer = _edits(system, user, rng)
        elif '"rationale"' in system:
            answer = _tree(state, system, user, rng, guess)
        else:
            answer = _rate(state, system, rng, guess)
        if spoil:
            return spoiled(answer, FAULTS[rng.integers(len(FAULTS))])[0]
        return answer

    def _draws(self, request: Mapping[str, Any]) -> np.random.Generator:
        """A generator seeded by the request, so that the order of requests does not matter."""
        content = json.dumps([self.seed, request.get("system", ""), request["messages"]])
        return np.random.default_rng(list(hashlib.sha256(content.encode()).digest()))


def _text(system: Any) -> str:
    """The text of a system prompt, given as one text or as blocks."""
    return system if isinstance(system, str) else "".join(str(block["text"]) for block in system)


def _rate(
    state: Mapping[str, Any], system: str, rng: np.random.Generator, guess: bool
) -> dict[str, Any]:
    ranges = {name: (float(low), float(high)) for name, low, high in _RANGE.findall(system)}
    milestone = next(iter(state["milestones_reached"]))
    robots, was_reached = state["tiers"][milestone], state["milestones_reached"][milestone]
    stuck, varied = state["stagnant_generations"] >= STAGNANT, state["diversity"]
    low = varied < LOW
    if not robots:
        phase = ("crisis_intervention" if low else "aggressive_exploration") if was_reached else ""
        phase = phase or "early_exploration"
    elif low:
        phase = "aggressive_exploration"
    elif robots < 3:
        phase = "balanced_exploration" if stuck else "refinement"
    else:
        rising = state["best_change"] > 0.2 * abs(state["fitness_max"] - state["best_change"])
        phase = "exploitation" if rising else "balanced_optimization" if stuck else "refinement"
    if guess and ranges:
        phase = list(ranges)[rng.integers(len(ranges))]
    least, most = ranges.get(phase, (0.2, 0.4))
    calm = min(1.0, max(state["working"], robots / 6))
    return {
        "reasoning": f"Mock answer: {robots} {milestone} robots now, diversity {varied:.2f}.",
        "risk": "None: a mock gives this answer.",
        "intervention": phase in ("crisis_intervention", "aggressive_exploration"),
        "pattern": "healthy_progress" if robots else "exploration_phase",
        "phase": phase,
        "mutation_rate": round(most - (most - least) * calm, 3),
    }


def _tree(
    state: Mapping[str, Any], system: str, user: str, rng: np.random.Generator, guess: bool
) -> dict[str, Any]:
    section = system.partition("## Examples")[2].partition("\n## ")[0]
    examples = _EXAMPLE.findall(section)
    target = _target(state, [name for name, _ in examples], rng, guess)
    matching = [tree for names, tree in examples if target in names.split(", ")]
    first = parse((matching or [tree for _, tree in examples])[0])
    sizes = _LIMITS.search(system)
    limits = Limits(int(sizes[1]), int(sizes[2])) if sizes else Limits(8, 50)
    ideas = [first]
    if traced := _TRACED.search(user):
        ideas.insert(0, _grafted(first, traced[1], limits))
    if "differs from all of them" in section:
        ideas = [tree for tree in ideas if tree not in [parse(text) for _, text in examples]]
    tree = (ideas or [_varied(first, rng)])[0]
    return {
        "rationale": f"Mock answer: {target} is lacking.",
        "target": target,
        "tree": to_text(tree),
    }


def _edits(system: str, user: str, rng: np.random.Generator) -> dict[str, Any]:
    """An edit that adds an example's first branch for the rarest behaviour to the first tree."""
    section = system.partition("## Examples")[2].partition("\n## ")[0] + user
    examples = [(names.split(", "), parse(text)) for names, text in _EXAMPLE.findall(section)]
    rarest = _URGENT.findall(user)
    fit = [tree for names, tree in examples if rarest and rarest[0] in names]
    tree = (fit or [tree for _, tree in examples])[rng.integers(max(1, len(fit)))]
    match = _PARENT.search(user)
    edit = {
        "kind": "front",
        "of": match[1] if match else "",
        "at": "",
        "branch": to_text(tree.children[0] if tree.children else tree),
        "reason": f"Mock answer: {rarest[0] if rarest else 'nothing'} is lacking.",
    }
    return {"reasoning": "Mock answer.", "edits": [edit]}


def _target(
    state: Mapping[str, Any], named: Sequence[str], rng: np.random.Generator, guess: bool
) -> str:
    """The rarest behaviour, unless none is rare."""
    rarest: list[str] = state["rarest_behaviours"]
    if guess:
        targets = [*rarest, *(t for names in named for t in names.split(", ") if t)]
        return targets[rng.integers(len(targets))]
    rare_below = 0.1 * state["population"]
    missing = [name for name in rarest if state["behaviour_counts"][name] < rare_below]
    return (missing or ["integration"])[0]


def _grafted(example: Node, traced: str, limits: Limits) -> Node:
    """The fittest tree with the example's branches before its own; the example if too large."""
    try:
        best = parse(traced)
    except TreeError:  # it was cut off
        return example
    if any(kind_of(tree).advance_status != FAILURE for tree in (example, best)):
        return example
    *urgent, last = example.children
    actions = _actions(*urgent)
    branches = [c for c in best.children if c.guard and not _actions(c) <= actions]
    grafted = selector(*urgent, *branches, last)
    return grafted if within(grafted, limits) else example


def _actions(*nodes: Node) -> set[str]:
    return {n.action for node in nodes for n in walk(node) if n.action}


def _varied(tree: Node, rng: np.random.Generator) -> Node:
    """The tree with other numbers in its conditions."""

    def other(match: re.Match[str]) -> str:
        return f"{match[1]} {round(int(match[2]) * rng.uniform(0.6, 1.6))}"

    return parse(_COMPARED.sub(other, to_text(tree)))
