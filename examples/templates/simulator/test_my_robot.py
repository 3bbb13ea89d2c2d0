"""The contract of a domain, and what the hand-written tree earns."""

from pathlib import Path

import islandgp
from islandgp.testing import check_domain

HERE = Path(__file__).parent


BY_HAND = (HERE / "by_hand.bt").read_text(encoding="utf-8")


def make_domain():
    """The domain as configured."""
    return islandgp.compose("domain=my_robot", config_dir=HERE / "conf").domain


def test_the_domain_keeps_its_promises():
    """Episodes are functions of tree and seed; keys stay in their ranges; and so on."""
    assert check_domain(make_domain, trees=[BY_HAND]).faults == {}


def test_the_hand_written_tree_works():
    """It delivers boxes in each of ten worlds, and its battery is never empty."""
    experiment = islandgp.compose("domain=my_robot", config_dir=HERE / "conf")
    tree = experiment.parse(BY_HAND)
    for outcome in experiment.evaluate(tree, worlds=range(10)):
        assert outcome.counters["delivered"] >= 5
        assert outcome.counters["empty"] == 0
