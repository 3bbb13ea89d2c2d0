"""A policy that is fitted to past decisions, and checked on runs that were held back."""

from __future__ import annotations

import json
from dataclasses import replace
from pathlib import Path

import pytest

from islandgp.errors import StudyError, SupervisionError
from islandgp.records.folder import RunFolder
from islandgp.running.app import main
from islandgp.seeding import Stream, stream
from studies.distillation.__main__ import main as distill
from studies.distillation.fit import Case, Shape, distil, report_lines
from studies.distillation.policy import (
    Answer,
    Distilled,
    Policy,
    Question,
    decide,
    features,
    read_policy,
    rules,
)
from tests.llm.samples import context, state
from tests.studies.configured import CONF, studied

SMALL = ("gp.population=8", "gp.generations=8", "world.episode.length=20", "evaluator=serial")


def cases(runs: int = 4) -> list[Case]:
    """A teacher that goes by one number: below 5 a low rate and `rare`."""
    return [
        Case(run, {"x": float(i), "y": 1.0}, "rare" if i < 5 else "pickup", 0.1 if i < 5 else 0.4)
        for run in range(runs)
        for i in range(10)
    ]


def test_a_rule_of_one_question_is_found() -> None:
    """Exactly, also on runs that were held back; the noise field is not asked for."""
    policy = distil(cases(), "me", Shape())
    for rule in (policy.target, policy.rate):
        assert isinstance(rule, Question)
        assert (rule.feature, rule.at_most) == ("x", 4.5)
    assert policy.target == Question(
        feature="x",
        at_most=4.5,
        yes=Answer(answer="rare", cases=20),
        no=Answer(answer="pickup", cases=20),
    )
    report = policy.report
    assert (report["target_agreement"], report["rate_error"]) == (1.0, 0.0)
    assert (report["target_commonest"], report["rate_error_mean"]) == (0.5, pytest.approx(0.15))
    expected = ["x <= 4.5", "  0.100 (20 cases)", "x > 4.5", "  0.400 (20 cases)"]
    assert list(rules(policy.rate)) == expected
    assert "Targets: 100% of 40 agree" in "\n".join(report_lines(policy))


def test_agreement_is_that_of_runs_held_back() -> None:
    """A run whose teacher decides otherwise is not learnt by heart: all of its cases are wrong."""
    odd = [replace(case, target="pickup" if case.target == "rare" else "rare") for case in cases()]
    mixed = [case if case.run else other for case, other in zip(cases(), odd, strict=True)]
    report = distil(mixed, "me", Shape()).report
    assert (report["target_agreement"], report["target_agreement_least"]) == (0.75, 0.0)


def test_the_teacher_s_gaps_are_left_out() -> None:
    """Where it gave no tree or no rate there is nothing to learn."""
    with_gaps = [replace(c, target=None) if c.run == 2 else replace(c, rate=None) for c in cases()]
    report = distil(
        [*cases(2), *(replace(c, run=c.run + 2) for c in with_gaps)], "me", Shape()
    ).report
    assert (report["targets"], report["rates"]) == (20 + 30, 20 + 10)


def test_two_runs_with_targets_are_never_held_back_together() -> None:
    """Runs 0 and 5 of ten would be in the same of five folds."""
    late = [c if c.run in (0, 5) else replace(c, target=None) for c in cases(10)]
    report = distil(late, "me", Shape()).report
    assert (report["targets"], report["rates"], report["target_agreement"]) == (20, 100, 1.0)


def test_too_few_runs_are_report_lines() -> None:
    """One run cannot be held back and learnt from."""
    with pytest.raises(StudyError, match="at least two runs"):
        distil(cases(1), "me", Shape())
    with pytest.raises(StudyError, match="Expected rates"):
        distil([replace(c, rate=None) for c in cases()], "me", Shape())


def test_features_are_numbers_of_the_state() -> None:
    """Each has the name of a field, and how far a behaviour is ahead of the rarest."""
    values = features(state())
    assert values["fitness_max"] == 4000
    assert values["milestones_reached.complete"] == 0
    assert (values["ahead.pickup"], values["ahead.charging"]) == (14, 0)
    assert all(isinstance(value, float) for value in values.values())


@pytest.mark.slow
def test_the_policy_plays(tmp_path: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """A run of it follows its rules; the same command again makes the same policy."""
    runs, folder = tmp_path / "my runs", tmp_path / "the policy"
    common = ["--config-dir", str(CONF), *SMALL, "tracking=off", "progress=off"]
    expert = ["supervisor=expert", "search=paper", f"runs='{runs}'", "seed=range(3)", "-m"]
    assert main([*common, *expert]) == 0
    for out in (folder, tmp_path / "b"):
        distill([str(runs), "-o", str(out), "--cases", "2"])
    assert "Teacher: expert, 3 runs" in capsys.readouterr().out
    assert (tmp_path / "b/policy.json").read_bytes() == (folder / "policy.json").read_bytes()
    played = tmp_path / "played"
    play = ["supervisor=distilled", f"supervisor.policy.folder='{folder}'", f"runs='{played}'"]
    assert main([*common, *play, "search=paper", "seed=7"]) == 0
    run = RunFolder(next(played.rglob("generations.jsonl")).parent)
    answers = [record.guidance for record in run.generations()][:-1]
    assert {g.source for g in answers if g} == {"distilled"}
    targets = {str(a.answer) for a in _answers(read_policy(folder).target)}
    assert {g.target for g in answers if g} <= targets
    with pytest.raises(SystemExit) as end:
        distill([str(runs), str(played), "-o", str(tmp_path / "c")])
    assert end.value.code == 2
    assert "found those of distilled, expert" in capsys.readouterr().err
    assert not (tmp_path / "c").exists()


def test_a_folder_without_runs_is_refused(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Exit code 2, one line, and no file."""
    with pytest.raises(SystemExit) as end:
        distill([str(tmp_path), "-o", str(tmp_path / "out")])
    assert (end.value.code, len(capsys.readouterr().err.splitlines())) == (2, 1)
    assert not (tmp_path / "out").exists()


def _answers(rule: object) -> list[Answer]:
    if isinstance(rule, Answer):
        return [rule]
    assert isinstance(rule, Question)
    return [*_answers(rule.yes), *_answers(rule.no)]


def test_advice_follows_the_policy() -> None:
    """Rate and target of the rules, a tree of the library for it."""
    rule = Question(
        feature="tiers.complete",
        at_most=0.5,
        yes=Answer(answer="charging", cases=1),
        no=Answer(answer="integration", cases=1),
    )
    policy = Policy(
        format=1, teacher="me", target=rule, rate=Answer(answer=0.23, cases=2), report={}
    )
    settings = studied("supervisor=distilled").supervisor.settings()
    run_context = context()
    supervisor = Distilled(policy, _expert(settings, run_context))
    for at, target in ((state(), "charging"), (state(complete=2), "integration")):
        guidance = supervisor.advise(at, stream(0, Stream.SUPERVISION))
        assert (guidance.mutation_rate, guidance.target, guidance.source) == (
            0.23,
            target,
            "distilled",
        )
        assert guidance.tree in run_context.library().trees.values()
    assert decide(rule, features(state(complete=1))) == "integration"


def _expert(settings: object, run_context: object) -> object:
    from islandgp.supervision.expert import Expert

    return Expert.make(settings, run_context)  # type: ignore[arg-type] # its settings are the expert's


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"target": {"answer": "dance", "cases": 1}}, "Expected targets of this experiment"),
        ({"rate": {"answer": "much", "cases": 1}}, "Expected rates that are numbers"),
        (
            {"rate": {"feature": "moon", "at_most": 1, "yes": {}, "no": {}}},
            "Expected a policy in",
        ),
        (
            {
                "rate": {
                    "feature": "moon",
                    "at_most": 1,
                    "yes": {"answer": 0.1, "cases": 1},
                    "no": {"answer": 0.2, "cases": 1},
                }
            },
            "the feature 'moon'",
        ),
        (
            {
                "rate": {
                    "feature": "history[].best",
                    "at_most": 1,
                    "yes": {"answer": 0.1, "cases": 1},
                    "no": {"answer": 0.2, "cases": 1},
                }
            },
            r"the feature 'history\[\].best'",
        ),
        ({"format": 2}, "found another file"),
        ("[" * 100_000, "found another file"),
        ("", "found another file"),
    ],
)
def test_policies_that_do_not_fit_are_report_lines(
    tmp_path: Path, change: object, message: str
) -> None:
    """In one line, before anything runs."""
    good = {
        "format": 1,
        "teacher": "me",
        "target": {"answer": "rare", "cases": 1},
        "rate": {"answer": 0.2, "cases": 1},
        "report": {},
    }
    text = change if isinstance(change, str) else json.dumps({**good, **change})  # type: ignore[dict-item] # a mapping
    (tmp_path / "policy.json").write_text(text, encoding="utf-8")
    settings = studied("supervisor=distilled", f"supervisor.policy.folder={tmp_path}")
    with pytest.raises(SupervisionError, match=message):
        Distilled.check(settings.supervisor.settings(), context())


def test_a_missing_policy_is_report_lines(tmp_path: Path) -> None:
    """With the command that makes one."""
    for folder in ("null", str(tmp_path)):
        settings = studied("supervisor=distilled", f"supervisor.policy.folder={folder}")
        with pytest.raises(SupervisionError, match="python -m studies"):
            Distilled.check(settings.supervisor.settings(), context())
