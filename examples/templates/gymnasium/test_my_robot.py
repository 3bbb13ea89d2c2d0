"""The contract of a domain, and an episode of the hand-written tree."""

from pathlib import Path

import islandgp
from islandgp.testing import check_domain

HERE = Path(__file__).parent


def make_domain():
    """The domain as configured."""
    return islandgp.compose("domain=my_robot", config_dir=HERE / "conf").domain


def test_the_domain_keeps_its_promises():
    """Episodes are functions of tree and seed; keys stay in their ranges; and so on."""
    assert check_domain(make_domain, random_trees=5).faults == {}


def test_the_hand_written_tree_acts():
    """Its episode has at least one step."""
    experiment = islandgp.compose("domain=my_robot", config_dir=HERE / "conf")
    tree = experiment.parse((HERE / "by_hand.bt").read_text(encoding="utf-8"))
    [outcome] = experiment.evaluate(tree, worlds=[0])
    assert outcome.counters["steps"] >= 1
