"""Takes the pictures of the replay page: docs/img/replay.png and the animated docs/img/replay.gif.

python docs/screenshot.py    # needs Chromium
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

from islandgp.commands.options import DomainOptions  # noqa: E402 -- from here
from islandgp.commands.setting import tree_task  # noqa: E402
from islandgp.viewer.page import page  # noqa: E402
from islandgp.viewer.recording import record  # noqa: E402
from tests.viewer.browser import Browser, chromium  # noqa: E402

IMAGES = ROOT / "docs" / "img"
WORLD, STAGE = 3, 3
WIDTH, HEIGHT, SHARPNESS = 1600, 950, 1.5
SECOND = 242.0  # of the picture
FIRST, LAST, STEP = 200, 260, 1.5  # seconds of the animation's frames
FRAME_MS, FRAME_WIDTH, COLOURS = 150, 800, 256


def replay_of(file: Path, target: Path, title: str) -> None:
    """Writes the replay page of a tree's episode."""
    task = tree_task(str(file), DomainOptions())
    recording = record(task.tree, task.problem, seed=WORLD, stage=STAGE)
    target.write_text(page(recording, title=title))


def frame(browser: Browser, page_file: Path, second: float) -> Image.Image:
    """The page at a second of the episode."""
    browser.open(f"file://{page_file}#t={second}")
    data = browser.call("Page.captureScreenshot", format="png")["data"]
    return Image.open(BytesIO(base64.b64decode(data))).convert("RGB")


def reduced(picture: Image.Image, colours: int) -> Image.Image:
    """The picture with a palette."""
    return picture.quantize(colours, method=Image.Quantize.MEDIANCUT, dither=Image.Dither.NONE)


def main() -> None:
    """Writes both pictures."""
    program = chromium()
    if program is None:
        raise SystemExit("Expected Chromium, found none; apt-get install chromium.")
    with tempfile.TemporaryDirectory() as folder:
        by_hand, evolved = Path(folder) / "by_hand.html", Path(folder) / "evolved.html"
        replay_of(ROOT / "grammar" / "examples" / "all_rounder.bt", by_hand, "All-rounder")
        replay_of(IMAGES / "evolved.bt", evolved, "The best robot of the default run")
        with Browser(program, Path(folder) / "profile", size=(WIDTH, HEIGHT)) as browser:
            size = {"width": WIDTH, "height": HEIGHT, "mobile": False}
            browser.call("Emulation.setDeviceMetricsOverride", deviceScaleFactor=SHARPNESS, **size)
            reduced(frame(browser, by_hand, SECOND), 256).save(IMAGES / "replay.png", optimize=True)
            browser.call("Emulation.setDeviceMetricsOverride", deviceScaleFactor=1, **size)
            seconds = [FIRST + STEP * i for i in range(int((LAST - FIRST) / STEP))]
            frames = [frame(browser, evolved, second) for second in seconds]
    small = (FRAME_WIDTH, FRAME_WIDTH * HEIGHT // WIDTH)
    palette = reduced(frames[0].resize(small), COLOURS)
    images = [f.resize(small).quantize(palette=palette, dither=Image.Dither.NONE) for f in frames]
    images[0].save(
        IMAGES / "replay.gif",
        save_all=True,
        append_images=images[1:],
        duration=FRAME_MS,
        loop=0,
        optimize=True,
    )


if __name__ == "__main__":
    main()
