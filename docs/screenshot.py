"""Takes the picture of the replay page for the README anew. Needs Chromium.

python docs/screenshot.py
"""

from __future__ import annotations

import base64
import sys
import tempfile
from io import BytesIO
from pathlib import Path

from PIL import Image  # matplotlib brings it

ROOT = Path(__file__).resolve().parent.parent
sys.path.insert(0, str(ROOT))

from islandgp.commands.setting import Chosen, tree_in_domain  # noqa: E402 -- from this checkout
from islandgp.viewer.page import page  # noqa: E402
from islandgp.viewer.recording import record  # noqa: E402
from tests.viewer.browser import Browser, chromium  # noqa: E402

TREE, WORLD, STAGE, SECOND = "all_rounder", 3, 3, 242.0
WIDTH, HEIGHT, SHARPNESS = 1600, 950, 1.5


def main() -> None:
    """Writes docs/img/replay.png."""
    program = chromium()
    if program is None:
        raise SystemExit("Expected Chromium, found none; apt-get install chromium.")
    file = ROOT / "grammar" / "examples" / f"{TREE}.bt"
    tree, _, setting = tree_in_domain(str(file), Chosen((), None))
    with tempfile.TemporaryDirectory() as folder:
        written = Path(folder) / "replay.html"
        episode = record(tree, setting, seed=WORLD, stage=STAGE)
        written.write_text(page(episode, title="All-rounder"))
        with Browser(program, Path(folder) / "profile", size=(WIDTH, HEIGHT)) as browser:
            browser.call(
                "Emulation.setDeviceMetricsOverride",
                width=WIDTH,
                height=HEIGHT,
                deviceScaleFactor=SHARPNESS,
                mobile=False,
            )
            browser.open(f"file://{written}#t={SECOND}")
            taken = browser.call("Page.captureScreenshot", format="png")["data"]
    picture = Image.open(BytesIO(base64.b64decode(taken))).convert("RGB")
    small = picture.quantize(256, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)
    small.save(ROOT / "docs" / "img" / "replay.png", optimize=True)


if __name__ == "__main__":
    main()
