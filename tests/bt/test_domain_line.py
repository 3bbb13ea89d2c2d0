"""`domain NAME` at the beginning of a tree file."""

from __future__ import annotations

import time

import pytest
from hypothesis import given
from hypothesis import strategies as st

from islandgp.bt.core.format import format_text
from islandgp.bt.core.language import domain_of, domain_place, parse, to_text
from islandgp.bt.core.node import Node
from islandgp.commands.files import TreeText
from islandgp.commands.options import DomainOptions
from islandgp.commands.setting import vocabulary_of
from islandgp.domains.island.vocabulary import VOCABULARY
from islandgp.errors import DomainError, TreeError
from tests.profiles import examples
from tests.strategies import nodes

TREE = "selector { PatrolWaypoint PickupGarbage }"


@pytest.mark.parametrize(
    "head",
    [
        "domain island\n",
        "domain island ",
        "# a tree\n\n  domain\tisland # the paper's\n",
        "domain # of\n# which world?\nisland\n",
        "\ufeffdomain island\r\n",
        "domain island subtree a = PatrolWaypoint\n",
        "domain#\nisland\n",
    ],
)
def test_a_file_may_say_its_domain(head: str) -> None:
    """The line changes nothing about the tree, wherever comments and line ends are."""
    assert parse(head + TREE, VOCABULARY) == parse(head + TREE) == parse(TREE)
    assert domain_of(head + TREE) == "island"


@pytest.mark.parametrize(
    "text", ["", TREE, f"# domain island\n{TREE}", "domain", "domains island", "domain 3 x", "# a"]
)
def test_comments_name_no_domain(text: str) -> None:
    """Neither a comment nor half a line names a domain."""
    assert domain_of(text) == ""


def test_another_domain_is_refused() -> None:
    """The message shows the line, and what would do."""
    with pytest.raises(DomainError) as excinfo:
        parse(f"# fast\ndomain maze\n{TREE}", VOCABULARY, name="my.bt")
    assert str(excinfo.value) == (
        "my.bt:2:8: the tree is for the domain 'maze', not for 'island'\n"
        "    domain maze\n"
        "           ^\n"
        "Expected domain island, or a command with domain=maze."
    )


def test_another_domain_is_reported_before_its_names() -> None:
    """The names of another domain are not reported as unknown."""
    with pytest.raises(DomainError, match="is for the domain 'maze'"):
        parse("domain maze when wall { Turn }", VOCABULARY)


@pytest.mark.parametrize(
    ("text", "column", "message"),
    [
        ("domain", 7, "a name"),
        ("domain 3 PatrolWaypoint", 8, "a name"),
        ("domain { PatrolWaypoint }", 8, "a name"),
        ("domain island", 14, "too early"),
        ("PatrolWaypoint domain island", 16, "unexpected 'domain'"),
        ("domian island PatrolWaypoint", 1, "'domian'"),
    ],
)
@pytest.mark.parametrize("with_vocabulary", [True, False])
def test_a_wrong_line(text: str, column: int, message: str, with_vocabulary: bool) -> None:
    """Each mistake is found where it is, with the domain's words and without."""
    with pytest.raises(TreeError) as excinfo:
        parse(text, VOCABULARY if with_vocabulary else None)
    if with_vocabulary or "domian" not in text:
        assert excinfo.value.column == column
        assert message in str(excinfo.value)


@pytest.mark.parametrize(
    ("text", "formatted"),
    [
        ("domain   island PatrolWaypoint", "domain island\n\nPatrolWaypoint\n"),
        (
            "# a\n\n# b\ndomain island # c\n# d\nPatrolWaypoint # e\n# f",
            "# a\n\n# b\ndomain island  # c\n\n# d\nPatrolWaypoint  # e\n# f\n",
        ),
        (
            "domain # which?\nisland\nsubtree a = PatrolWaypoint use a",
            "# which?\ndomain island\n\nsubtree a = PatrolWaypoint\n\nuse a\n",
        ),
        ("\n\ndomain island\n\n\n\nPatrolWaypoint", "domain island\n\nPatrolWaypoint\n"),
    ],
)
def test_fmt_keeps_it(text: str, formatted: str) -> None:
    """With its comments, and a blank line below."""
    assert format_text(text) == formatted
    assert format_text(formatted) == formatted


GAPS = st.sampled_from(["", "# x\n", "\n\n", "\n# x\n\n# y\n"])


@examples(max_examples=60, deadline=None)
@given(nodes(), GAPS, GAPS, st.sampled_from(["", "#z"]))
def test_fmt_of_any_tree(node: Node, above: str, below: str, behind: str) -> None:
    """The domain, the tree and each comment are there afterwards, and stay as they are."""
    text = f"{above}domain island {behind}\n{below}{to_text(node)}"
    formatted = format_text(text)
    assert domain_of(formatted) == "island"
    assert parse(formatted) == parse(text)
    assert formatted.count("#") == text.count("#")
    assert format_text(formatted) == formatted


@pytest.mark.parametrize("text", [" " * 99_999, "#" * 99_999, "# \n" * 33_000, "\n" * 99_999])
def test_hostile_text(text: str) -> None:
    """However long the gap is, the answer comes at once."""
    start = time.process_time()
    assert domain_of(text) == domain_of("domain" + text) == ""
    assert time.process_time() - start < 1


@pytest.mark.parametrize(
    ("text", "place"),
    [
        ("domain mars PatrolWaypoint", "a.bt:1:8"),
        ("# mine\r\n\r\n  domain  mars\r\n PatrolWaypoint", "a.bt:3:11"),
        ("PatrolWaypoint", "a.bt:1:1"),
    ],
)
def test_where_the_line_is(text: str, place: str) -> None:
    """Messages about a domain that is not configured begin with it."""
    assert "a.bt:{}:{}".format(*domain_place(text)) == place
    if domain_of(text):
        with pytest.raises(DomainError, match=f"^{place}: unknown domain 'mars'"):
            vocabulary_of(TreeText(text, "a.bt", None), DomainOptions((), None))
