"""The contract of a domain, and what the hand-written tree earns."""

from pathlib import Path

import islandgp
from islandgp.testing.domain_suite import DomainSuite

HERE = Path(__file__).parent


class TestContract(DomainSuite):
    """Episodes are functions of tree and seed; keys stay in their ranges; and so on."""

    texts = ((HERE / "by_hand.bt").read_text(encoding="utf-8"),)

    def make_domain(self):
        return islandgp.compose("domain=my_robot", config_dir=HERE / "conf").domain


def test_the_hand_written_tree_works():
    """It delivers boxes in each of ten worlds, and its battery is never empty."""
    experiment = islandgp.compose("domain=my_robot", config_dir=HERE / "conf")
    tree = experiment.parse((HERE / "by_hand.bt").read_text(encoding="utf-8"))
    for outcome in experiment.evaluate(tree, worlds=range(10)):
        assert outcome.counters["delivered"] >= 5
        assert outcome.counters["empty"] == 0
