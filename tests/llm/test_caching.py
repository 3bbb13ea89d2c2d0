"""System prompts that are too short for a model's cache are shared by its questions."""

from __future__ import annotations

from islandgp.supervision.llm.message import Request
from islandgp.supervision.llm.questions import heading, shared_prompts
from islandgp.supervision.llm.settings import LLMSettings
from tests.llm.test_supervisor import advise, answering, settings, supervisor

SMALL, LARGE = "claude-haiku-4-5-20251001", "claude-haiku-5-5"
RATE = Request(SMALL, "How to set a rate. " * 100, ("Which rate?",), 9, cache=True)
TREE = Request(SMALL, "How to write a tree. " * 1000, ("Which tree?",), 9, cache=True)
CACHED: LLMSettings = settings("cache=true")


def test_two_questions_share_a_prompt() -> None:
    """Both have the same system prompt, with the text of each under its heading."""
    shared = shared_prompts({"rate": RATE, "tree": TREE}, CACHED)
    assert len({request.system for request in shared.values()}) == 1
    for part, before in (("rate", RATE), ("tree", TREE)):
        assert f"{heading(part)}\n\n{before.system}" in shared[part].system
        assert shared[part].turns == (f"{heading(part)}\n\n{before.turns[0]}",)


def test_samples_share_one_section() -> None:
    """Several answers to the question for edits do not repeat its instructions."""
    shared = shared_prompts({"rate": RATE, "edits": TREE, "edits 2": TREE}, CACHED)
    assert shared["edits"] == shared["edits 2"]
    assert shared["rate"].system.count(TREE.system) == 1


def test_unchanged_requests() -> None:
    """Without a cache, alone, to several models, or with prompts that are long enough."""
    from dataclasses import replace

    one_model = {"rate": RATE, "tree": TREE}
    two_models = {"rate": RATE, "tree": replace(TREE, model=LARGE)}
    enough = {part: replace(request, model=LARGE) for part, request in one_model.items()}
    assert shared_prompts(one_model, settings()) == one_model
    for requests in ({"rate": RATE}, two_models, enough, {}):
        assert shared_prompts(requests, CACHED) == requests


def test_a_run_with_a_shared_prompt() -> None:
    """The supervisor asks both questions with it, and reads the answers as before."""
    llm, client = supervisor(answering(), "cache=true")
    llm.start()
    guidance = advise(llm)
    _, rate, tree = client.requests
    assert rate.system == tree.system
    assert {rate.turns[0].split("\n")[0], tree.turns[0].split("\n")[0]} == {
        heading("rate"),
        heading("tree"),
    }
    assert guidance.source == "llm"
