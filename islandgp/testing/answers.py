"""Scripted answers: a rule's, made from the state in the prompt. No model is behind them."""

from __future__ import annotations

import json
import re
from collections.abc import Mapping
from typing import Any

from islandgp.resources import resource


def scripted_answer(request: Mapping[str, Any]) -> dict[str, Any]:
    """A sensible answer to a request of `supervisor=llm`, by a fixed rule.

    The rate falls with the number of Complete Robots; the tree is the example for
    the behaviour that the state lists first as lacking.
    """
    user = str(request["messages"][0]["content"])
    found = re.search(r"```json\n(.*?)\n```", user, re.DOTALL)
    if found is None:  # the probe
        return {"greeting": "Hello."}
    state = json.loads(found[1])
    if '"rationale"' in str(request.get("system")):
        return _scripted_tree(state)
    complete = state["tiers"]["complete"]
    phase = "early_exploration" if not complete else "refinement"
    return {
        "mutation_rate": 0.45 if not complete else max(0.15, 0.3 - 0.02 * complete),
        "phase": phase,
        "pattern": "healthy_progress" if complete else "exploration_phase",
        "intervention": False,
        "risk": "None: this answer is scripted.",
        "reasoning": f"Scripted answer: {complete} Complete Robots now.",
    }


def _scripted_tree(state: Mapping[str, Any]) -> dict[str, Any]:
    lacking = state["behaviours"]["lacking"][0]
    missing = state["doing"][lacking] < 0.1 * state["parameters"]["population"]
    target = lacking if missing else "integration"
    name = {
        "pickup": "pickup_specialist",
        "humanoid": "humanoid_focused",
        "charging": "charging_focused",
        "clearing": "clearing_focused",
        "integration": "all_rounder",
    }[target]
    text = (resource("grammar") / "examples" / f"{name}.bt").read_text(encoding="utf-8")
    return {"tree": text, "target": target, "rationale": f"Scripted answer: example {name}."}
