"""Prompts: golden files of whole ones, and texts that follow from declarations."""

from __future__ import annotations

import re
from dataclasses import replace
from pathlib import Path

import pytest

from islandgp.bt.core.condition import OPERATORS
from islandgp.bt.core.kinds import ABORTS, KINDS
from islandgp.bt.core.language import parse
from islandgp.bt.core.vocabulary import Action, Vocabulary
from islandgp.domains.island.vocabulary import SCHEMA, VOCABULARY
from islandgp.errors import IslandError, SupervisionError
from islandgp.resources import resource
from islandgp.supervision.base import Pattern, Phase
from islandgp.supervision.llm.answers import (
    DecisionAnswer,
    Rejection,
    RejectionStage,
    proposal_model,
)
from islandgp.supervision.llm.message import Request
from islandgp.supervision.llm.prompts import SYNTAX, Prompt, load_prompt
from islandgp.supervision.llm.questions import Questions
from tests.goldens import check_golden
from tests.llm.samples import context, settings, state
from tests.samples import CLASSES


@pytest.fixture(scope="module")
def adviser() -> Questions:
    return Questions(settings(), context())


def prompt_text(request: Request) -> str:
    return f"# system\n\n{request.system}\n\n# user\n\n{request.turns[0]}\n"


def test_golden_rate_prompt(adviser: Questions) -> None:
    """The whole question for a mutation rate."""
    check_golden("prompt_mutation_rate.md", prompt_text(adviser.request("rate", state())))


def test_golden_prompt_of_phase_1(adviser: Questions) -> None:
    """The whole question for a tree while there is no robot of quality."""
    check_golden("prompt_tree_explore.md", prompt_text(adviser.request("tree", state())))


def test_golden_prompt_of_phase_2(adviser: Questions) -> None:
    """The whole question for a tree once there is one."""
    request = adviser.request("tree", state(complete=3, excellent=1))
    check_golden("prompt_tree_exploit.md", prompt_text(request))


def test_the_repair_prompt(adviser: Questions) -> None:
    """The whole repair turn, with the language's own error."""
    error = "tree:1:1: unknown action 'FlyHome'"
    assert adviser.repair(Rejection(RejectionStage.NAMES, error)) == (
        'That answer cannot be used. It failed at the stage "names":\n'
        "\n"
        "tree:1:1: unknown action 'FlyHome'\n"
        "\n"
        "Answer again with the whole, corrected JSON object and nothing else."
    )


def test_the_system_part_is_the_same_in_every_generation(adviser: Questions) -> None:
    """So that a server can keep it, and a transcript holds it once."""
    first, later = state(3), state(9)
    for part in adviser.parts:
        before, after = (adviser.request(part, at) for at in (first, later))
        assert before.system == after.system
        assert before.turns != after.turns


def test_every_phase_and_pattern_is_in_the_rate_prompt(adviser: Questions) -> None:
    """Tables 6 and 8 whole, with the ranges of the settings, and every field of the answer."""
    system = adviser.request("rate", state()).system
    for phase, (low, high) in settings().phases.items():
        row = next(line for line in system.splitlines() if line.startswith(f"| {phase} |"))
        assert row.endswith(f"| {low:.2f} to {high:.2f} |")
    assert len(Phase) == 7
    assert all(f"- {pattern}: " in system for pattern in Pattern)
    assert all(f'"{field}"' in system for field in DecisionAnswer.model_fields)


@pytest.mark.parametrize(
    ("at", "phase"),
    [
        (state(), "compact specialist"),
        (state(complete=5), "compact specialist"),
        (state(excellent=1), "several behaviours"),
        (state(ever=True), "several behaviours"),
    ],
)
def test_which_phase_it_is(adviser: Questions, at: object, phase: str) -> None:
    """Section 2.4.6: phase 2 begins with the first robot of the last milestone, and lasts."""
    assert phase in adviser.request("tree", at).system  # type: ignore[arg-type]


def test_every_target_is_in_the_tree_prompts(adviser: Questions) -> None:
    """Table 7 whole, and every field of the answer."""
    meanings = {
        name: f"shows {SCHEMA.counters[counter].meaning}"
        for name, counter in CLASSES.behaviours.items()
    }
    assert {*meanings, "rare", "integration", "exploration"} == set(CLASSES.targets)
    for at in (state(), state(excellent=1)):
        system = adviser.request("tree", at).system
        assert all(f"- {target}: " in system for target in CLASSES.targets)
        for target, meaning in meanings.items():
            assert f"- {target}: {meaning}" in system
        assert all(f'"{field}"' in system for field in proposal_model(CLASSES.targets).model_fields)


def test_the_language_is_the_declared_one(adviser: Questions) -> None:
    """Kinds of nodes, actions, keys, operators and abort rules are those of the declarations."""
    description = adviser.values["language"]
    for name, kind in KINDS.items():
        assert (f"`: {kind.meaning}\n" in description + "\n") is kind.paper, name
    for table in (VOCABULARY.actions, VOCABULARY.keys):
        for name, entry in table.items():  # type: ignore[attr-defined]
            assert f"- {name}: {entry.meaning}" in description
    assert f"abort {'|'.join(ABORTS)}" in description
    assert " ".join(OPERATORS) in description


@pytest.mark.parametrize("kind", SYNTAX)
def test_the_syntax_of_each_kind_is_read(kind: str) -> None:
    """With one of the words that it offers."""
    text = SYNTAX[kind].replace("NODE NODE ...", "PatrolWaypoint PatrolWaypoint")
    text = text.replace("NODE", "PatrolWaypoint").replace("NAME", "PatrolWaypoint")
    text = text.replace("CONDITION", "lap < 3").replace(" N ", " 3 ")
    tree = parse(re.sub(r"(\w+)(\|\w+)+", r"\1", text), VOCABULARY)
    assert tree.kind == kind


def test_examples_are_files_of_the_project(adviser: Questions) -> None:
    """Every example tree in a prompt is a file of grammar/examples, with its explanation."""
    files = [p.read_text(encoding="utf-8") for p in resource("grammar").glob("examples/*.bt")]
    for at in (state(), state(excellent=1)):
        system = adviser.request("tree", at).system
        blocks = re.findall(r"```\n(.*?)\n```", system, re.DOTALL)
        assert len(blocks) >= 4
        for block in blocks:
            assert any(file.strip().endswith(block) for file in files)
            parse(block, VOCABULARY)


def test_urgency_is_in_words(adviser: Questions) -> None:
    """Section 2.4.6: what nobody does is missing, what few do is rare."""
    assert (
        "- charging: 0 of 30 individuals do it: MISSING (charging attempts)\n"
        "- clearing: 2 of 30 individuals do it: rare (deliveries of something)\n"
        "- humanoid: 8 of 30 individuals do it: present (times that garbage was taken over)\n"
        "- pickup: 14 of 30 individuals do it: present (items picked up from the ground)\n"
    ) in adviser.request("tree", state()).turns[0]


def test_a_new_action_reaches_the_prompts() -> None:
    """One entry in the declaration is enough."""
    actions = {**VOCABULARY.actions, "FlyHome": Action("flies home")}
    vocabulary = Vocabulary(VOCABULARY.domain, actions, VOCABULARY.keys)
    run_context = replace(context(), schema=replace(SCHEMA, vocabulary=vocabulary))
    system = Questions(settings(), run_context).request("tree", state()).system
    assert "- FlyHome: flies home" in system


def test_a_missing_variable_is_named() -> None:
    """The error names the variable, the file, and the nearest variable."""
    known = {"language": "x", "state": "y"}
    for text, found in (
        ("a\nb {{langage}} c", "a known variable, found langage; did you mean language?"),
        ("{% if state %}", "a Jinja template that can be filled in, found line 1: "),
    ):
        with pytest.raises(SupervisionError) as excinfo:
            Prompt("mine", text, "u").variables(known)
        assert str(excinfo.value).startswith(f"prompts/mine.md: expected {found}")


def test_a_user_s_prompts(tmp_path: Path) -> None:
    """A user's folder replaces the project's; a fault in it is an error before the run starts."""
    for file in resource("prompts").glob("*.md"):
        (tmp_path / file.name).write_text(file.read_text(encoding="utf-8"), encoding="utf-8")
    prompt_file = tmp_path / "mutation_rate.md"
    prompt_file.write_text("# system\nBe wise.\n# user\n{{state}}", encoding="utf-8")
    llm_settings = settings(f"prompts={tmp_path}")
    assert Questions(llm_settings, context()).request("rate", state()).system == "Be wise."
    prompt_file.write_text("# user\n{{sate}}", encoding="utf-8")
    with pytest.raises(SupervisionError, match="did you mean state"):
        Questions(llm_settings, context())
    prompt_file.write_text("Just text.", encoding="utf-8")
    with pytest.raises(SupervisionError, match="# user"):
        load_prompt("mutation_rate", str(tmp_path))
    prompt_file.write_bytes("# user\nStra\xdfe".encode("latin-1"))
    with pytest.raises(IslandError, match=r"Expected UTF-8 text in .*save it as UTF-8"):
        load_prompt("mutation_rate", str(tmp_path))
    prompt_file.unlink()
    assert "Phases" in Questions(llm_settings, context()).prompts["mutation_rate"].system
    with pytest.raises(SupervisionError, match="found none"):
        Questions(settings("prompts=nowhere"), context())


def test_a_domain_may_name_its_robots() -> None:
    """`classes.agent` is in every place of the prompts that names a tier."""
    questions = Questions(settings(), context(None, "+classes.agent=Lander"))
    texts = [prompt_text(questions.request(part, state(complete=1))) for part in ("rate", "tree")]
    assert "Complete Lander: in one episode" in texts[0]
    assert "complete: Complete Landers" in texts[0]
    assert not any(re.search(r"\bRobots?\b", text) for text in texts)
