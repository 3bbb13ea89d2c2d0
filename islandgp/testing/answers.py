"""Scripted answers: a rule's, made from the state in the prompt. No model is behind them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any


def scripted_answer(request: Mapping[str, Any]) -> dict[str, Any]:
    """A sensible answer to a request of `supervisor=llm`, by a fixed rule.

    The rate falls with the number of robots of the first milestone; the tree is the prompt's own
    example for the behaviour that the state lists first as lacking.
    """
    user = str(request["messages"][0]["content"])
    found = re.search(r"```json\n(.*?)\n```", user, re.DOTALL)
    if found is None:  # the probe
        return {"greeting": "Hello."}
    state = json.loads(found[1])
    system = _text(request.get("system", ""))
    if '"rationale"' in system:
        return _scripted_tree(state, system)
    milestone = next(iter(state["milestones"])).removesuffix("_seen")
    good = state["tiers"][milestone]
    return {
        "mutation_rate": 0.45 if not good else max(0.15, 0.3 - 0.02 * good),
        "phase": "early_exploration" if not good else "refinement",
        "pattern": "healthy_progress" if good else "exploration_phase",
        "intervention": False,
        "risk": "None: this answer is scripted.",
        "reasoning": f"Scripted answer: {good} {milestone} robots now.",
    }


def _text(system: Any) -> str:
    """A system prompt's text, whether it came as one text or in blocks."""
    return system if isinstance(system, str) else "".join(str(block["text"]) for block in system)


def _scripted_tree(state: Mapping[str, Any], system: str) -> dict[str, Any]:
    lacking = state["behaviours"]["lacking"][0]
    missing = state["doing"][lacking] < 0.1 * state["parameters"]["population"]
    target = lacking if missing else "integration"
    shown = system.partition("## Examples")[2].partition("\n## ")[0]
    examples = re.findall(r"(?:For ([\w, ]+):\n\n)?```\n(.*?)\n```", shown, re.DOTALL)
    own = [tree for targets, tree in examples if target in targets.split(", ")]
    tree = (own or [tree for _, tree in examples])[0]
    return {"tree": tree, "target": target, "rationale": f"Scripted answer: an example, {target}."}
