"""A domain outside of the package, in this process: mistakes in it, and code that changes."""

from __future__ import annotations

import shutil
import sys
from collections.abc import Iterator
from pathlib import Path

import pytest
import yaml

from islandgp import plugin
from islandgp.bt.core.language import parse
from islandgp.bt.core.vocabulary import EMPTY_VOCABULARY
from islandgp.config.compose import only_job
from islandgp.domain import Schema
from islandgp.errors import DomainError, EvaluationError
from islandgp.resources import resource
from islandgp.running.app import main
from tests.domains.test_tutorial import EXAMPLE, ROOT
from tests.profiles import sweep
from tests.running.commands import TINY
from tests.trees.shell import shell

OWN = ("--config-dir", "conf", "domain=pick_place", "tracking=off")
SHORT_RUN = (*OWN, *TINY, "gp.validation=0", "evaluator=serial")


@pytest.fixture
def example(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> Iterator[Path]:
    """The working folder: a copy of the tutorial's example."""
    shutil.copytree(EXAMPLE, tmp_path, dirs_exist_ok=True)
    module = sys.modules.pop("pick_place", None)  # that of another test
    monkeypatch.chdir(tmp_path)
    monkeypatch.syspath_prepend(str(tmp_path))
    yield tmp_path
    sys.modules.pop("pick_place", None)
    if module is not None:
        sys.modules["pick_place"] = module


def test_a_domain_without_actions_is_refused(
    example: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """By a run, by `domain --check`, and wherever a schema is made: one line, exit code 2."""
    domain = example / "pick_place.py"
    text = domain.read_text(encoding="utf-8")
    head, _, rest = text.partition("        actions={")
    text = f"{head}        actions={{}},\n        keys={{{rest.partition('keys={')[2]}"
    domain.write_text(text, encoding="utf-8")
    assert main([*SHORT_RUN]) == 2
    expected = "Expected at least one action in the domain pick_place, found none;"
    errors = capsys.readouterr().err
    assert errors.startswith(f"islandgp: {expected}")
    assert errors.count("\n") == 1
    islandgp = shell(monkeypatch, capsys)
    result = islandgp("domain", "pick_place", "--check", "--config-dir", "conf")
    assert (result.code, result.out) == (2, "")
    assert expected in result.err
    assert "Traceback" not in result.err


@pytest.mark.parametrize("missing", ["action", "component"])
def test_a_schema_declares_what_evolution_needs(missing: str) -> None:
    """Actions for the leaves of trees, and components for their fitness."""
    from tests.domains.test_simulator import SCHEMA

    vocabulary = EMPTY_VOCABULARY if missing == "action" else SCHEMA.vocabulary
    components = {} if missing == "component" else SCHEMA.components
    with pytest.raises(
        DomainError, match=f"at least one {missing} in the domain {vocabulary.domain}"
    ):
        Schema(vocabulary, components, SCHEMA.events, "Counts.")


@pytest.mark.slow
def test_smoke_is_for_any_domain(example: Path, capsys: pytest.CaptureFixture[str]) -> None:
    """`experiment=smoke` sets nothing that only the island has."""
    arguments = (
        *OWN,
        "experiment=smoke",
        "supervisor=baseline",
        "evaluator=serial",
        "progress=off",
    )
    assert main(arguments) == 0
    assert "Best robot" in capsys.readouterr().out
    assert list((example / "runs" / "smoke").glob("baseline-seed0-*/summary.json"))


def test_another_reward_is_put_on_top_of_the_domains_file(
    example: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """`+rewards=NAME` changes the rows that it names; without the + the error names it."""
    (example / "conf/rewards").mkdir()
    rows = "events: {picked: {base: 12.5}, tick: {over: 0.5}}\n"
    (example / "conf/rewards/own.yaml").write_text(rows, encoding="utf-8")
    assert main([*SHORT_RUN, "rewards=own"]) == 2
    errors = capsys.readouterr().err
    assert errors.startswith("islandgp: Could not override 'rewards'.")
    assert "use +rewards=own" in errors
    assert main([*SHORT_RUN, "+rewards=own", "--cfg", "job"]) == 0
    rewards = yaml.safe_load(capsys.readouterr().out)["rewards"]
    assert rewards["events"]["picked"] == {"component": "progress", "base": 12.5}
    assert rewards["events"]["placed"] == {"component": "progress", "base": 200}


def test_an_added_tier_is_the_last(example: Path) -> None:
    """Of a file of the group `classes`."""
    (example / "conf/classes").mkdir()
    file = example / "conf/classes/own.yaml"
    file.write_text("tiers: {two: {at_least: {placed: 2}}}", encoding="utf-8")
    tiers = [*only_job(["domain=pick_place", "+classes=own"], "conf").settings.classes.tiers]
    assert tiers == ["finished", "placed_one", "two"]


@pytest.mark.usefixtures("example")
def test_the_experiment_of_the_example_can_be_composed() -> None:
    """It selects domain, search and budget by its name alone."""
    settings = only_job(["experiment=pick_place"], "conf").settings
    assert (settings.search.policy["shrinkage"], settings.budget.episodes) == (3, 3000)


@pytest.mark.parametrize("group", ["domain", "experiment"])
def test_a_file_without_its_package_is_one_line(
    example: Path, capsys: pytest.CaptureFixture[str], group: str
) -> None:
    """It names the file and the line to add, in place of a line for each key that it misplaces."""
    file = example / f"conf/{group}/pick_place.yaml"
    file.parent.mkdir(exist_ok=True)
    shipped = example / "conf/domain/pick_place.yaml"
    head, _, text = shipped.read_text(encoding="utf-8").partition("\n")
    assert head == "# @package _global_"
    file.write_text(text, encoding="utf-8")
    assert main([*OWN, *([] if group == "domain" else ["experiment=pick_place"])]) == 2
    assert capsys.readouterr().err == (
        f"islandgp: {group}=pick_place: expected `# @package _global_` as the first line of the"
        " file, found none; add it, so that its keys are those of the whole configuration.\n"
    )


def test_a_counter_may_be_measured(example: Path) -> None:
    """The page's second domain measures a distance, and its ticks take half a second."""
    page = (ROOT / "docs/own_domain.md").read_text(encoding="utf-8")
    code = page.partition("```python\nfrom dataclasses")[2].partition("```")[0]
    (example / "measured.py").write_text(f"from dataclasses{code}", encoding="utf-8")
    settings = only_job(["domain=pick_place", "domain.factory=measured:Measured"], "conf").settings
    domain = settings.make_domain()
    text = (example / "carry.bt").read_text(encoding="utf-8")
    outcome = domain.run_episode(parse(text, domain.schema.vocabulary), 0, {})
    assert outcome.counters["driven"] == 6.0 * outcome.counters["moved"] > 0
    assert outcome.seconds == 0.5 * outcome.counters["tick"]
    sys.modules.pop("measured", None)


@pytest.mark.usefixtures("example")
def test_a_domains_file_is_named(
    monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """`islandgp domain NAME`: a file to begin with, also where there is only a wheel."""
    islandgp = shell(monkeypatch, capsys)
    shipped = resource("conf") / "domain/cartpole.yaml"
    assert f"configured in {shipped}" in islandgp("domain", "cartpole").out
    own = islandgp("domain", "pick_place", "--config-dir", "conf").out
    assert own.startswith("Domain pick_place, configured in conf/domain/pick_place.yaml\n")
    refused = islandgp("domain", "cartpol")
    assert (refused.code, refused.out) == (2, "")
    assert "did you mean cartpole?" in refused.err


def test_a_domain_s_file_may_set_how_its_robots_evolve(
    example: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Its values of `gp` and `allocation` come after the defaults, and before the command line."""
    file = example / "conf/domain/pick_place.yaml"
    settings = "\ngp: {population: 12, generations: 7}\nallocation: {elites: 1}\n"
    file.write_text(file.read_text(encoding="utf-8") + settings, encoding="utf-8")
    assert main([*OWN, "gp.generations=9", "--cfg", "job"]) == 0
    config = yaml.safe_load(capsys.readouterr().out)
    assert (config["gp"]["population"], config["gp"]["generations"]) == (12, 9)
    assert config["allocation"]["elites"] == 1


def test_a_misspelt_key_of_a_domains_file_names_the_one_without_a_value(
    example: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    """Although no file of configuration has the right one."""
    file = example / "conf/domain/pick_place.yaml"
    text = file.read_text(encoding="utf-8")
    file.write_text(text.replace("failure:", "failur:"), encoding="utf-8")
    assert main([*OWN]) == 2
    assert capsys.readouterr().err.splitlines() == [
        "islandgp: world.failur: unknown key; did you mean world.failure?",
        "world.failure: expected a value, found none",
    ]


@pytest.mark.slow
def test_a_run_goes_on_with_the_code_of_its_domain_only(
    example: Path, monkeypatch: pytest.MonkeyPatch, capsys: pytest.CaptureFixture[str]
) -> None:
    """A changed module is refused like a changed configuration; resume=never takes it."""
    with monkeypatch.context() as patch:
        patch.setattr("islandgp.running.run.best_robot", _stop)
        assert main(SHORT_RUN) == 2
    domain = example / "pick_place.py"
    before = domain.read_bytes()
    domain.write_bytes(before + b"\n# changed\n")
    capsys.readouterr()
    assert main(SHORT_RUN) == 2
    errors = capsys.readouterr().err
    assert "found it changed:\n  domain.factory: the code of pick_place:PickPlace\n" in errors
    assert "Traceback" not in errors
    domain.write_bytes(before)
    assert main(SHORT_RUN) == 0
    domain.write_bytes(before + b"\n# changed\n")
    assert main(SHORT_RUN) == 2
    assert "Expected the configuration of the finished run" in capsys.readouterr().err
    assert main([*SHORT_RUN, "resume=never"]) == 0


def _stop(*_: object) -> None:
    """Ends a run before it is finished."""
    raise EvaluationError("stopped")


@sweep(
    ("body", "expected"),
    [
        ("return None", "wrong:hoist failed (TypeError: expected it to return something"),
        ("return 1 / 0", "wrong:hoist failed (ZeroDivisionError: division by zero, in {}, line 2)"),
    ],
    quick=1,
)
def test_the_fault_of_an_operator_is_its_authors(
    example: Path, body: str, expected: str, capsys: pytest.CaptureFixture[str]
) -> None:
    """A mutation from outside that fails is named, and what the run has is kept."""
    sys.modules.pop("wrong", None)
    plugin._user_function.cache_clear()
    (example / "wrong.py").write_text(f"def hoist(rng, tree, space, how):\n    {body}\n")
    (example / "conf/gp").mkdir()
    text = 'defaults: [paper, _self_]\nmutation: {operators: {"wrong:hoist": 2.5}}\n'
    (example / "conf/gp/own.yaml").write_text(text, encoding="utf-8")
    assert main([*SHORT_RUN, "search=paper", "gp=own"]) == 2
    assert f"islandgp: {expected.format(example / 'wrong.py')}" in capsys.readouterr().err
