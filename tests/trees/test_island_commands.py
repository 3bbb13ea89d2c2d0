"""`islandgp play`, `replay` and `simplify`, as a user runs them, mostly on the island."""

from __future__ import annotations

import itertools
import json
import shutil
from math import sqrt
from pathlib import Path
from statistics import fmean, stdev

import pytest
import yaml

from islandgp.bt.core.language import parse, to_text
from islandgp.commands.tables import GAP, Column, numbers, parts
from islandgp.records.folder import RunFolder
from islandgp.resources import resource
from tests.records.listed import add_to_manifest
from tests.trees.shell import Cli
from tests.viewer.runs import closed_run

EXAMPLES = resource("grammar") / "examples"
GOOD = EXAMPLES / "all_rounder.bt"
SHORT = ("--set", "world.episode.length=20")


def test_play(islandgp: Cli) -> None:
    """A row per world, the mean of each component, and how often each tier was reached."""
    result = islandgp("play", GOOD, "--seeds", 3, *SHORT)
    assert result.code == 0
    rows = [line.split() for line in result.out.splitlines()]
    assert [row[0] for row in rows[1:4]] == ["0", "1", "2"]
    names = [row[0] for row in rows if row]
    for component in ("garbage", "battery", "humanoid", "delivery", "leftover", "fitness"):
        assert component in names
    assert "of 3 worlds: excellent" in result.out


def test_a_number_for_a_group_is_refused(islandgp: Cli) -> None:
    """`--set` has the messages of a run."""
    result = islandgp("play", GOOD, "--set", "gp=4")
    assert result.code == 2
    assert result.err.startswith(
        "islandgp: Config group override must be a string or a list. Got int"
    )


def test_a_run_folder_is_its_best_tree(islandgp: Cli, tmp_path: Path) -> None:
    """A folder with a best.bt can be given in place of a tree; a link there is refused."""
    (tmp_path / "best.bt").write_text("domain island\n\nPatrolWaypoint\n", encoding="utf-8")
    assert "1 node," in islandgp("check", str(tmp_path)).out
    linked = tmp_path / "linked"
    linked.mkdir()
    (linked / "best.bt").symlink_to(tmp_path / "best.bt")
    refused = islandgp("check", str(linked))
    assert refused.code == 2
    assert "link" in refused.err


def test_play_is_the_same_on_processes(islandgp: Cli) -> None:
    """Twelve worlds or more go to worker processes; the first three come out as before."""
    short_rows = json.loads(islandgp("play", GOOD, "--seeds", 3, "--json", *SHORT).out)
    long_rows = json.loads(
        islandgp(
            "play", GOOD, "--seeds", 12, "--json", *SHORT, "--set", "evaluator.policy.workers=2"
        ).out
    )
    assert long_rows[:3] == short_rows
    assert len(long_rows) == 12


def test_play_at_another_stage(islandgp: Cli) -> None:
    """--stage scores by another row of Table 2, in the same episode."""
    late = json.loads(islandgp("play", GOOD, "--seeds", 1, "--json", *SHORT).out)
    early = json.loads(islandgp("play", GOOD, "--seeds", 1, "--json", "--stage", 1, *SHORT).out)
    assert late[0]["counters"] == early[0]["counters"]
    points = [outcome[0]["components"]["leftover"] for outcome in (late, early)]
    assert points[0] == 2.5 * points[1]  # 2.0 and 0.8


@pytest.mark.parametrize(
    ("arguments", "message"),
    [
        (("--set", "world.robot.spee=3"), "did you mean world.robot.speed?"),
        (("--set", "world.robot.speed=fast"), "world.robot.speed='fast'"),
        (("--set", "speed"), "expected KEY=VALUE, found 'speed'"),
        (("--stage", "9"), "--stage: expected 1 to 4, found 9"),
        (
            ("--set", "evaluator.policy.episode_timeout=5"),
            "--set evaluator.policy.episode_timeout=5: expected a key that this command reads",
        ),
        (
            ("--set", "evaluator.policy={workers: 1, episode_timeout: 5}"),
            "found one without effect; leave it out. --timeout SECONDS limits an episode",
        ),
    ],
)
@pytest.mark.parametrize("name", ["play", "replay"])
def test_wrong_settings(islandgp: Cli, name: str, arguments: tuple[str, ...], message: str) -> None:
    """A wrong setting is one clear line and exit code 2."""
    result = islandgp(name, GOOD, *arguments)
    assert result.code == 2
    (line,) = result.err.splitlines()
    assert message in line


def test_a_tree_of_a_run_is_played_in_the_runs_own_world(islandgp: Cli, tmp_path: Path) -> None:
    """As with --run; --set changes its settings, and names of no run and of a class are refused."""
    run = closed_run(tmp_path / "run").path
    tree, config = tmp_path / "tree.bt", run / "config.yaml"
    shutil.copy(run / "best.bt", tree)

    def written(**changes: object) -> None:
        config.write_text(yaml.safe_dump({**RunFolder(run).configuration(), **changes}))
        add_to_manifest(run, "config.yaml")

    def rows(*arguments: object) -> str:
        return islandgp("play", *arguments, "--seeds", 1, "--json").out

    world = RunFolder(run).configuration()["world"]
    world["episode"]["length"] = 20
    written(world=world)
    assert rows(run) == rows(tree, "--run", run) == rows(tree, *SHORT)
    longer = ("--set", "world.episode.length=300")
    assert rows(run, *longer) == rows(tree, *longer) != rows(run)
    refused = islandgp("play", tree, "--run", tmp_path)
    assert (refused.code, "found none; give a run's own folder" in refused.err) == (2, True)
    written(domain={"factory": "strange:Island"})
    stranger = islandgp("play", run)
    assert (stranger.code, "which only the run names" in stranger.err) == (2, True)


def test_replay_refuses_settings_without_effect(islandgp: Cli) -> None:
    """Its one episode needs no evaluator."""
    result = islandgp("replay", GOOD, "--set", "evaluator.policy.workers=2")
    assert (result.code, "found one without effect" in result.err) == (2, True)


def test_wrong_tree(islandgp: Cli) -> None:
    """What is no tree is reported as by `check`."""
    result = islandgp("play", "-", stdin="selector { PatrolWaypont }")
    assert result.code == 2
    assert "Did you mean PatrolWaypoint?" in result.err


def test_numbers_of_any_size_can_be_read() -> None:
    """Whole numbers stay whole, small ones keep three digits, large ones get commas."""
    assert numbers([39000.4, -12.0]) == ["39,000", "-12"]
    assert numbers([1.0, 2000.0]) == ["1", "2,000"]
    assert numbers([0.125, -0.5]) == ["0.125", "-0.500"]
    assert numbers([0.0, 0.0]) == ["0", "0"]


@pytest.mark.parametrize("width", [5, 24, 40, 80])
def test_a_wide_table_comes_in_parts(width: int) -> None:
    """Each part has the first column and is as wide as there is room for; no column is lost."""
    columns: list[Column] = [("world", ("0", "1"))]
    columns += [("x" * n, ("1", "22")) for n in range(1, 20)]
    groups = parts(columns, width)
    assert [column for part in groups for column in part[1:]] == columns[1:]
    assert {part[0] for part in groups} == {columns[0]}

    def width_of(part: list[Column]) -> int:
        return sum(max(map(len, (head, *cells))) + GAP for head, cells in part) - GAP

    assert all(width_of(part) <= width or len(part) == 2 for part in groups)
    for part, following in itertools.pairwise(groups):
        assert width_of([*part, following[1]]) > width


@pytest.mark.parametrize("width", [40, 80])
def test_play_fits_a_narrow_terminal(
    islandgp: Cli, monkeypatch: pytest.MonkeyPatch, width: int
) -> None:
    """All columns are printed, in parts, and nothing is cut off."""
    monkeypatch.setattr("islandgp.commands.tables.UNLIMITED_WIDTH", width)
    result = islandgp("play", GOOD, "--seeds", 2, *SHORT)
    assert result.code == 0
    assert max(map(len, result.out.splitlines())) <= width
    assert "\N{HORIZONTAL ELLIPSIS}" not in result.out
    headings = ("pickups", "inactive", "battery", "laps", "ended by", "class", "best tier")
    for heading in (*headings, "most"):
        assert heading in result.out


@pytest.mark.parametrize("width", [40, 1000])
def test_play_of_several_fits_a_narrow_terminal(
    islandgp: Cli, monkeypatch: pytest.MonkeyPatch, tmp_path: Path, width: int
) -> None:
    """A long name is folded, and every letter of it is printed."""
    file = tmp_path / "a folder" / f"{'long' * 20}.bt"
    file.parent.mkdir()
    file.write_text("PatrolWaypoint", encoding="utf-8")
    monkeypatch.setattr("islandgp.commands.tables.UNLIMITED_WIDTH", width)
    result = islandgp("play", GOOD, file, "--seeds", 2, *SHORT)
    assert result.code == 0
    assert max(map(len, result.out.splitlines())) <= width
    assert "\N{HORIZONTAL ELLIPSIS}" not in result.out
    if width == 1000:
        assert str(file) in result.out
    for heading in ("fitness (95 %)", "difference (95 %)", "better in"):
        assert heading in result.out
    assert "0 of 2" in result.out


def test_replay(islandgp: Cli, tmp_path: Path) -> None:
    """The page of one world, under the name of the file; the same again, to the byte."""
    a, b = tmp_path / "a.html", tmp_path / "b.html"
    assert islandgp("replay", GOOD, "--seed", 4, "-o", a, *SHORT).code == 0
    assert islandgp("replay", GOOD, "--seed", 4, "-o", b, *SHORT).code == 0
    assert a.read_bytes() == b.read_bytes()
    assert "<title>all_rounder</title>" in a.read_text()


def test_empty_island(islandgp: Cli, tmp_path: Path) -> None:
    """A world without garbage and humanoids, and an episode of one tick, are worlds like others."""
    empty = ("world.garbage.initial=0", "world.garbage.most=0", "world.humanoids.count=0")
    options = [word for key in (*empty, "world.episode.length=0.1") for word in ("--set", key)]
    for command in (("play", "--seeds", 1), ("replay", "-o", tmp_path / "t.html")):
        assert islandgp(*command, *options, "-", stdin="PatrolWaypoint").code == 0


def test_simplify(islandgp: Cli, tmp_path: Path) -> None:
    """The shorter tree is printed or written, and --explain gives the reasons."""
    text = "selector { sequence { MoveToGarbage } inverter { inverter { PatrolWaypoint } } }"
    result = islandgp("simplify", "-", "--explain", stdin=text)
    assert result.out == to_text(parse("selector { MoveToGarbage PatrolWaypoint }"))
    assert "double inverter" in result.err
    assert "6 nodes before, 3 after; 2 changes" in result.err
    condition = "when lap > 1 and lap > 0 { PatrolWaypoint }"
    assert islandgp("simplify", "-", "--explain", stdin=condition).err == (
        "when lap > 1 and lap > 0 is equivalent to a shorter one: lap > 1\n"
        "2 nodes before, 2 after; 1 change\n"
    )
    islandgp("simplify", "-", "-o", tmp_path / "t.bt", stdin=text)
    assert (tmp_path / "t.bt").read_text() == result.out


def test_play_several(islandgp: Cli) -> None:
    """Trees are compared in the same worlds by their paired differences to the first."""
    compared = islandgp("play", GOOD, "-", "--seeds", 3, "--json", *SHORT, stdin="PatrolWaypoint")
    good, patrol = json.loads(compared.out)
    one = islandgp("play", GOOD, "--seeds", 3, "--json", *SHORT).out
    other = islandgp("play", "-", "--seeds", 3, "--json", *SHORT, stdin="PatrolWaypoint")
    pairs = [
        b["fitness"] - a["fitness"]
        for a, b in zip(json.loads(one), json.loads(other.out), strict=True)
    ]
    half = 4.302653 * stdev(pairs) / sqrt(3)  # Student's t with 2 degrees of freedom
    assert patrol["difference"] == pytest.approx(fmean(pairs))
    assert patrol["difference_high"] == pytest.approx(fmean(pairs) + half)
    assert (good["difference"], good["difference_low"]) == (0, 0)
    assert good["counters.laps"] == pytest.approx(
        fmean(w["counters"]["laps"] for w in json.loads(one))
    )
    tiers = ("excellent", "complete", "full_service", "balanced_elite")
    assert [good[f"reached.{tier}"] for tier in tiers] == [0, 0, 0, 0]
    limit = ("--set", "constraints={distance: {at_most: 0}}")
    result = islandgp("play", GOOD, "-", "--seeds", 3, *SHORT, *limit, stdin="PatrolWaypoint")
    for heading in ("Balanced Elite", "constraints kept", "battery %"):
        assert heading in result.out
    assert "Constraints: distance at most 0." in result.out
    assert [line.split()[0] for line in result.out.splitlines()[:3]] == [
        "tree",
        str(GOOD),
        "<stdin>",
    ]


def test_one_world_has_no_interval(islandgp: Cli) -> None:
    """Its ends are null in JSON, and a dash for people; so is the deviation."""
    arguments = ("play", GOOD, GOOD, "--seeds", 1, *SHORT)
    first, second = json.loads(islandgp(*arguments, "--json").out)
    assert (second["difference"], second["difference_low"], second["difference_high"]) == (
        *(0, None, None),
    )
    assert (first["points_low"], first["points_high"]) == (None, None)
    output = islandgp(*arguments).out
    assert f"{first['points']:,.0f} (- to -)" in output
    single_output = islandgp("play", GOOD, "--seeds", 1, *SHORT).out
    assert "Tiers, of 1 world:" in single_output
    (row,) = (line.split() for line in single_output.splitlines() if line.startswith("fitness"))
    assert row[2] == "-"
