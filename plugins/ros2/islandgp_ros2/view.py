"""`--view`: the replay page of the last minute of a running tree, on this computer only."""

from __future__ import annotations

from collections import deque
from collections.abc import Collection, Iterator
from contextlib import contextmanager
from http import HTTPStatus
from http.server import BaseHTTPRequestHandler, ThreadingHTTPServer
from math import isfinite, nan
from pathlib import Path
from threading import Thread
from typing import Final

from islandgp.binding import NodeStatus, RobotTree
from islandgp.bt.core.vocabulary import Action, Key, Vocabulary
from islandgp.domain import Outcome, Schema
from islandgp.errors import ConfigError
from islandgp.viewer.page import page
from islandgp.viewer.recording import FAILED, IDLE, RUNS, STOPPED, SUCCEEDED, Recording

MINUTE_S: Final = 60.0
MAX_TICKS: Final = 1500  # of the page; above 25 Hz they are less than a minute
_CODES: Final = {
    None: IDLE,
    NodeStatus.FAILURE: FAILED,
    NodeStatus.SUCCESS: SUCCEEDED,
    NodeStatus.RUNNING: RUNS,
    NodeStatus.ABORTED: STOPPED,
}
_STYLE: Final = """<style>
#fitness { position: absolute; left: -9999px; width: 400px; height: 200px } #score { display: none }
.no-scene main { grid-template: minmax(0, 1fr) auto / 1fr; grid-template-areas: "mind" "board" }
</style><script>player.seek(episode.ticks)</script></body>"""
_LIVE: Final = Path(__file__).with_name("live.html").read_text(encoding="utf-8")


class LastMinute:
    """The states of a tree in the last minute."""

    def __init__(self, robot_tree: RobotTree, step_s: float) -> None:
        """Starts with the state of a tree, which is ticked every `step_s` seconds."""
        self._tree, self._step_s = robot_tree.tree, step_s
        most = max(1, min(MAX_TICKS, round(MINUTE_S / step_s)))
        self._ticks: deque[tuple[bytes, tuple[float, ...]]] = deque(maxlen=most)
        self.add(robot_tree, False)

    def add(self, robot_tree: RobotTree, is_ticked: bool) -> None:
        """Adds the present state. Those of another tree are removed.

        `is_ticked`: False while the tree waits for the values of its keys.
        """
        if robot_tree.tree is not self._tree:
            self._ticks.clear()
            self._tree = robot_tree.tree
        codes = bytes(_CODES[status] for status in robot_tree.statuses)
        board = robot_tree.board.values() if is_ticked else [nan] * len(robot_tree.board)
        self._ticks.append((codes, tuple(board)))

    def page(self) -> str:
        """The replay page, at its end."""
        tree, ticks = self._tree, [*self._ticks]
        codes, boards = zip(*ticks, strict=True)
        keys = {
            name: tree.vocabulary.keys.get(name) or _key(values)
            for name, values in zip(tree.keys(), zip(*boards, strict=True), strict=True)
        }
        words = Vocabulary(
            tree.vocabulary.domain, {name: Action("") for name in tree.actions()}, keys
        )
        recording = Recording(
            tree=tree.node,
            schema=Schema(words, {"none": "no points"}, {}, task=""),
            seed=0,
            stage=0,
            step_s=self._step_s,
            ticks=len(ticks),
            statuses=tuple(map(bytes, zip(*codes, strict=True))),
            boards=boards,
            credits=(),
            scenes=(),
            frames=(),
            outcome=Outcome({"none": 0.0}, {}, len(ticks) * self._step_s, ()),
        )
        return page(recording, title=tree.name).replace("</body>", _STYLE)


def _key(values: Collection[float]) -> Key:
    """The declaration of a key with these values: a flag, or a number of their range."""
    known = {value for value in values if isfinite(value)}
    low, high = min(known, default=0.0), max(known, default=1.0)
    return Key(flag=known <= {0, 1}, low=low, high=high if high > low else low + 1)


@contextmanager
def viewed(minute: LastMinute, port: int) -> Iterator[None]:
    """Context manager: serves the page on a port of the loopback interface.

    Raises:
        ConfigError: the port is in use.
    """

    hosts = {f"{name}:{port}" for name in ("127.0.0.1", "localhost")}
    pages = {"/": lambda: _LIVE, "/minute": minute.page}

    class Handler(BaseHTTPRequestHandler):
        def do_GET(self) -> None:
            if self.path not in pages or self.headers["Host"] not in hosts:  # a page of a website
                return self.send_error(HTTPStatus.NOT_FOUND)
            content = pages[self.path]().encode()
            self.send_response(HTTPStatus.OK)
            self.send_header("Content-Type", "text/html; charset=utf-8")
            self.send_header("Content-Length", str(len(content)))
            self.end_headers()
            self.wfile.write(content)
            return None

        def log_message(self, *_: object) -> None:
            """Writes nothing."""

    try:
        server = ThreadingHTTPServer(("127.0.0.1", port), Handler)
    except OSError as error:
        raise ConfigError(
            f"Expected a free port as --view, found {port} ({error.strerror}); name another one"
        ) from None
    Thread(target=server.serve_forever, args=(0.1,), daemon=True).start()
    try:
        yield
    finally:
        server.shutdown()
        server.server_close()
