"""Take the pictures of the MLflow pages. Needs Chromium and some minutes.

python docs/screenshots_ui.py [FOLDER]

FOLDER is one in which the sweep was run; without it the sweep is run first:
python -m islandgp supervisor=baseline,expert 'seed=range(5)' -m
"""

from __future__ import annotations

import base64
import subprocess
import sys
import tempfile
from pathlib import Path
from time import monotonic, sleep

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from islandgp.tracking.store import Store  # noqa: E402
from islandgp.tracking.sync import place_of_latest  # noqa: E402 -- from this checkout
from islandgp.tracking.ui import served  # noqa: E402
from tests.viewer.browser import Browser, chromium  # noqa: E402

SWEEP = ("supervisor=baseline,expert", "seed=range(5)", "-m")
PORT = 5077
SIZE = (1500, 940)
HIDE_PATH = """[...document.querySelectorAll("*")]
  .filter(e => !e.children.length && e.innerText?.includes("/mlartifacts/"))
  .forEach(e => { e.style.visibility = "hidden" })"""
"""The artifact's path on the machine that takes the picture."""


def main() -> None:
    """Writes docs/img/ui-*.png."""
    program = chromium()
    if program is None:
        raise SystemExit("Expected Chromium, found none; apt-get install chromium.")
    with tempfile.TemporaryDirectory() as scratch:
        if len(sys.argv) > 1:
            home = Path(sys.argv[1]).resolve()
        else:
            home = Path(scratch)
            command = [sys.executable, "-m", "islandgp", *SWEEP]
            subprocess.run(command, cwd=home, env={"PYTHONPATH": str(ROOT)}, check=True)
        place = place_of_latest(home / "runs")
        with (
            served(place, PORT) as pages,
            Browser(program, Path(scratch) / "profile", size=SIZE) as browser,
        ):
            server = pages.runs.partition("/#/")[0]
            shots = {
                "arms": (pages.arms, "tiers/complete"),
                **_runs(Store(place), server),
            }
            for name, (address, word) in shots.items():
                _shoot(browser, address, word, ROOT / f"docs/img/ui-{name}.png")


def _runs(store: Store, server: str) -> dict[str, tuple[str, str]]:
    """Addresses of a sweep's page, and of the pages of one of its runs, each with a word there."""
    ml = "workflowType=machine_learning"
    base = f"{server}/#/experiments/{store.experiment}/runs"
    runs = store.client.search_runs([store.experiment])
    parent = next(r.info.run_id for r in runs if r.data.tags.get("kind") == "sweep")
    return {
        "sweep": (f"{base}/{parent}?{ml}", "Description"),
    }


def _shoot(browser: Browser, address: str, word: str, file: Path) -> None:
    """Takes the picture when the page has drawn the word."""
    width, height = SIZE
    browser.call(
        "Emulation.setDeviceMetricsOverride",
        width=width,
        height=height,
        deviceScaleFactor=1,
        mobile=False,
    )
    browser.open(address)
    end = monotonic() + 300
    while word not in browser.run("document.body.innerText"):
        if monotonic() > end:
            raise SystemExit(f"Expected {word!r} on the page {address}, found none in 300 s.")
        sleep(1)
    sleep(3)  # it fetches and draws the rest by itself
    browser.run("document.querySelector('button[aria-label=Close]')?.click()")  # the assistant
    browser.run(HIDE_PATH)
    sleep(3)
    picture = browser.call("Page.captureScreenshot", format="png")["data"]
    file.parent.mkdir(exist_ok=True)
    file.write_bytes(base64.b64decode(picture))
    print(file)


if __name__ == "__main__":
    main()
