"""Answers that are none: one line that names the supervisor and what was expected, exit code 2."""

from __future__ import annotations

from pathlib import Path
from typing import Any

import numpy as np
import pytest

from islandgp.bt.core.language import parse
from islandgp.bt.core.node import Node, leaf
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import SupervisionError
from islandgp.running.app import main
from islandgp.supervision.base import Guidance, Phase
from islandgp.supervision.guidance import ask
from tests.evolution.runs import plan, run
from tests.llm.samples import answering, supervisor
from tests.profiles import sweep
from tests.running.commands import TINY, fake
from tests.running.supervisors import Answers
from tests.samples import snapshot, state

TREE = parse("PatrolWaypoint")
MINE = "Expected tests.running.supervisors:Answers.advise to return"

WRONG: list[tuple[Any, str]] = [
    # an answer, and the error line for it
    (None, "a Guidance, found None"),
    (0.3, "a Guidance, found 0.3"),
    (
        Guidance(5, None, "x"),
        "a Guidance, found mutation_rate=5: input should be less than or equal to 1; correct it.",
    ),
    (Guidance(-0.1, None, "x"), "a Guidance, found mutation_rate=-0.1: input should be"),
    (Guidance(float("nan"), None, "x"), "a Guidance, found mutation_rate=nan: input should be"),
    (Guidance(True, None, "x"), "a Guidance, found mutation_rate=True: input should be"),
    (Guidance("0.3", None, "x"), "a Guidance, found mutation_rate='0.3': input should be"),  # type: ignore[arg-type]
    (
        Guidance(None, "PatrolWaypoint", "x"),  # type: ignore[arg-type]
        "a Guidance, found tree='PatrolWaypoint': expected a tree of the language",
    ),
    (Guidance(None, Node("leap"), "x"), "a Guidance, found tree=Node("),
    (
        Guidance(None, leaf("Fly"), "x"),
        "a Guidance whose tree is of the domain island",
    ),
    (Guidance(None, Node("inverter", (), (TREE, TREE)), "x"), "a Guidance, found tree=Node("),
    (Guidance(None, None, ""), "a Guidance, found source='': string should have at least 1"),
    (Guidance(None, None, 7), "a Guidance, found source=7: input should be"),  # type: ignore[arg-type]
    (
        Guidance(None, None, "x", phase="lunch"),  # type: ignore[arg-type]
        "a Guidance, found phase='lunch': input should be 'early_exploration'",
    ),
    (Guidance(None, None, "x", pattern=["stagnation"]), "a Guidance, found pattern=['stagnation']"),  # type: ignore[arg-type]
    (Guidance(None, None, "x", target=3), "a Guidance, found target=3: input should be"),  # type: ignore[arg-type]
    (
        Guidance(None, None, "x", target="flying"),
        "a Guidance whose target is None or one of pickup, humanoid, charging, clearing, rare,",
    ),
    (Guidance(None, None, "x", intervention=1), "a Guidance, found intervention=1: input should"),  # type: ignore[arg-type]
    (Guidance(None, None, "x", reasoning=None), "a Guidance, found reasoning=None: input should"),  # type: ignore[arg-type]
    (Guidance(None, None, "x", risk="\ud800"), "a Guidance, found risk='\\ud800': 'utf-8' codec"),
    (Guidance(None, None, "x", notes={"n": 1}), "a Guidance, found notes.n=1: input should be"),  # type: ignore[dict-item]
]

RIGHT = [
    Guidance(None, None, "x"),
    Guidance(0, TREE, "x"),
    Guidance(1.0, None, "x", Phase.REFINEMENT, notes={"a": "b"}),
    Guidance(np.float64(0.3), None, "x", target="rare", intervention=True),
    Guidance(np.float32(0.25), None, "x"),  # type: ignore[arg-type]
    Guidance(None, None, "x", phase="refinement"),  # type: ignore[arg-type]
    Guidance(0.5, parse("sequence { " * 30 + "PatrolWaypoint" + " }" * 30), "too deep"),
]


def guidance_of(answer: Any) -> Guidance:
    """The answer of a supervisor that gives just that."""
    return ask(Answers(answer), state([snapshot(0)]), np.random.default_rng(0), VOCABULARY)


@pytest.mark.parametrize(("answer", "line"), WRONG)
def test_a_wrong_answer_is_reported(answer: Any, line: str) -> None:
    """One line: whose it is, the field, what was expected, what was found."""
    with pytest.raises(SupervisionError) as excinfo:
        guidance_of(answer)
    assert str(excinfo.value).startswith(f"{MINE} {line}")
    assert "\n" not in str(excinfo.value)
    assert len(str(excinfo.value)) < 300


@pytest.mark.parametrize("answer", RIGHT)
def test_a_right_answer_stays_as_it_is(answer: Guidance) -> None:
    """Numbers of NumPy become Python's; a tree over the limits is refused later, in the record."""
    guidance = guidance_of(answer)
    assert guidance == answer
    assert type(guidance.mutation_rate) in (float, type(None))


def test_a_wrong_answer_ends_a_run() -> None:
    """None is no guidance."""
    with pytest.raises(SupervisionError, match="a Guidance, found None"):
        run(plan(), Answers(None))


def test_a_tree_of_another_domain_ends_a_run() -> None:
    """A run gives its supervisor the vocabulary and enforces it."""
    answer = Guidance(None, parse("sequence { Fly Land }"), "x")
    with pytest.raises(SupervisionError, match=r"of the domain island, found 'sequence \{ Fly"):
        run(plan(), Answers(answer))


def test_a_fallback_is_checked_alike() -> None:
    """The expert of a language model may be another class, which is checked as any other."""
    llm, _ = supervisor(answering(rate="", tree=""))
    llm.fallback = Answers(None)
    with pytest.raises(SupervisionError, match="a Guidance, found None"):
        llm.advise(state([snapshot(0)]), np.random.default_rng(0))


@sweep("arguments", [(), ("seed=3", "-m")], quick=1)
def test_the_command_reports_it_in_one_line(
    arguments: tuple[str, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    capsys: pytest.CaptureFixture[str],
) -> None:
    """Exit code 2 for a run, 1 for a sweep, whose report names it; no traceback."""
    monkeypatch.chdir(tmp_path)
    supervisor = ["supervisor=baseline", "supervisor.factory=tests.running.supervisors:TooMuch"]
    assert main([*TINY, "tracking=off", *fake("Instant"), *supervisor, *arguments]) == (
        1 if arguments else 2
    )
    errors = capsys.readouterr().err
    assert "Traceback" not in errors
    assert (
        "Expected tests.running.supervisors:TooMuch.advise to return a Guidance, found mutation"
        in errors
    )
