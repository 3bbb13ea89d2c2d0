"""The contract of a domain, and an episode of the hand-written tree."""

from pathlib import Path

import islandgp
from islandgp.testing.domain_suite import DomainSuite

HERE = Path(__file__).parent


class TestContract(DomainSuite):
    """Episodes are functions of tree and seed; keys stay in their ranges; and so on."""

    random_trees = grown_trees = 5

    def make_domain(self):
        return islandgp.compose("domain=my_robot", config_dir=HERE / "conf").domain


def test_the_hand_written_tree_acts():
    """Its episode has at least one step."""
    experiment = islandgp.compose("domain=my_robot", config_dir=HERE / "conf")
    tree = experiment.parse((HERE / "by_hand.bt").read_text(encoding="utf-8"))
    [outcome] = experiment.evaluate(tree, worlds=[0])
    assert outcome.counters["steps"] >= 1
