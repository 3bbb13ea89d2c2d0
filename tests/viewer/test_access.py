"""The replay page for those who see little or nothing: names, contrast, and axe where it is."""

from __future__ import annotations

import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import pytest

from islandgp.viewer.page import page
from tests.running.commands import ROOT
from tests.viewer.browser import Browser
from tests.viewer.episodes import small

AXE = ROOT / "build/axe/node_modules/axe-core/axe.min.js"
THEMES = ("light", "dark")
# Each text of the page that is shown, with its colour and what it is drawn upon: in a picture
# the shape before it, elsewhere the first ground that is not transparent.
TEXTS = """
(() => {
  const walker = document.createTreeWalker(document.body, NodeFilter.SHOW_TEXT), found = [];
  const clear = colour => /, 0\\)$/.test(colour);
  for (let node = walker.nextNode(); node; node = walker.nextNode()) {
    const element = node.parentElement, style = getComputedStyle(element);
    if (!node.textContent.trim() || !element.getClientRects().length) continue;
    if (style.visibility === "hidden" || element.closest("script, style, option")) continue;
    const drawn = element.closest("svg") && element.parentElement.querySelector("path, circle");
    let ground = element;
    while (ground && clear(getComputedStyle(ground).backgroundColor)) ground = ground.parentElement;
    found.push([node.textContent.trim(), drawn ? style.fill : style.color,
      drawn ? getComputedStyle(drawn).fill : getComputedStyle(ground).backgroundColor]);
  }
  return found;
})()
"""


@pytest.fixture(params=THEMES)
def theme(browser: Browser, request: pytest.FixtureRequest) -> Iterator[str]:
    """What the user's system prefers; afterwards it is as before."""
    wish = {"name": "prefers-color-scheme", "value": request.param}
    browser.call("Emulation.setEmulatedMedia", features=[wish])
    yield request.param
    browser.call("Emulation.setEmulatedMedia", features=[])


def test_controls_have_names_for_screen_readers(browser: Browser, file: Path) -> None:
    """Every canvas, picture of a tree, button and choice has a name, and the time is a slider."""
    browser.open(f"file://{file}#t=123.4")
    for role, name in (("img", "The world"), ("img", "Fitness"), ("img", "Behaviour tree")):
        names = browser.run(
            f"[...document.querySelectorAll('[role={role}]')].map(e => e.ariaLabel)"
        )
        assert any(label.startswith(name) for label in names), name
    unnamed = browser.run(
        "[...document.querySelectorAll('canvas, button, select')].filter(e =>"
        " !e.getAttribute('aria-label') && !/[a-z]/.test(e.textContent)).length"
    )
    assert unnamed == 0
    slider = "document.querySelector('[role=slider]')"
    assert browser.run(f"{slider}.getAttribute('aria-valuetext')") == "123.4 s"
    assert browser.run(f"{slider}.getAttribute('aria-valuenow')") == "1234"


def luminance(colour: str) -> float:
    """Relative luminance, as WCAG defines it."""
    parts = [int(colour[i : i + 2], 16) / 255 for i in (1, 3, 5)]
    red, green, blue = (c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts)
    return 0.2126 * red + 0.7152 * green + 0.0722 * blue


def contrast(one: str, other: str) -> float:
    """From 1 to 21."""
    low, high = sorted(map(luminance, (one, other)))
    return (high + 0.05) / (low + 0.05)


@pytest.mark.parametrize("theme", [0, 1], ids=["light", "dark"])
def test_contrast(theme: int) -> None:
    """Text has a contrast of 4.5 to its background, lines and bars one of 3 (WCAG AA)."""
    style = page(small(), title="t").split("<style>")[1]
    block = re.findall(r":root[^{]*\{(.*?)\n *\}", style, re.DOTALL)[theme]
    paint = dict(re.findall(r"--([\w-]+): (#[0-9a-f]{6})", block))
    texts = [(ink, ground) for ink in ("ink", "soft") for ground in ("paper", "panel")]
    texts += [("quiet-ink", "quiet"), ("good-edge", "panel")]
    texts += [("ink", lit) for lit in ("run", "good", "bad", "cut")]
    texts += [("panel", f"{lit}-edge") for lit in ("run", "good", "bad", "cut")]
    for ink, ground in texts:
        assert contrast(paint[ink], paint[ground]) >= 4.5, (ink, ground)
    for line in ("plain", "run-edge", *(f"part-{i}" for i in range(8))):
        assert contrast(paint[line], paint["panel"]) >= 3, line


def faint(browser: Browser) -> list[Any]:
    """The texts that have a contrast below 4.5 (WCAG AA) to their background."""
    texts = browser.run(TEXTS)
    assert len(texts) > 50
    hexed = [
        (text, *("#" + "".join(f"{int(n):02x}" for n in re.findall(r"\d+", c)) for c in pair))
        for text, *pair in texts
    ]
    return [(text, ink, ground) for text, ink, ground in hexed if contrast(ink, ground) < 4.5]


def test_every_text_can_be_read(browser: Browser, file: Path, theme: str) -> None:
    """As the browser computes it, with nodes lit and not lit; a text that is faint is found."""
    browser.open(f"file://{file}#t=96.6")
    assert faint(browser) == []
    grey = "#777777"
    browser.run(f"document.getElementById('facts').style.color = '{grey}'")
    assert [ink for _, ink, _ in faint(browser)] == [grey], theme


@pytest.mark.slow
@pytest.mark.skipif(not AXE.exists(), reason="run make axe first")
def test_axe(browser: Browser, file: Path, theme: str, sized: Callable[[int, int], None]) -> None:
    """axe-core finds no fault on large and small screens."""
    script = AXE.read_text(encoding="utf-8")
    for width, height in ((1500, 900), (800, 600), (400, 800)):
        sized(width, height)
        browser.open(f"file://{file}#t=96.6")
        browser.run(f"{script};1")
        report = browser.run("axe.run().then(r => [r.passes.length, r.violations.map(v => v.id)])")
        assert report[0] > 20, theme
        assert report[1] == [], (theme, width)
