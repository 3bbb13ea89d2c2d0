"""`islandgp ros2` and servers in processes of their own, of which one is stopped or killed.

Each scenario measures one time and compares it with the limit that README.md states. For a
table of the times: `python -m pytest -m slow -rP plugins/ros2/tests/test_scenarios.py`.
"""

from __future__ import annotations

import json
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from itertools import count
from pathlib import Path

import pytest

pytest.importorskip("rclpy", reason="pip install 'islandgp-ros2[rclpy]'")
pytest.importorskip("test_msgs", reason="pip install ros-test-msgs")

from ros2_servers import BRAKES, BUSY, DEAF, HANGS, NEVER, REFUSES, SLOW, SUCCEEDS

pytestmark = [pytest.mark.slow, pytest.mark.process, pytest.mark.filterwarnings("default")]

DOMAINS = count(os.getpid() * 37)
FOLDER = Path(__file__).parent
ROOT = FOLDER.parents[2]
WORDS = {
    "Drive": SUCCEEDS, "Wait": HANGS, "Slow": SLOW, "Never": NEVER, "Stubborn": REFUSES,
    "Deaf": DEAF, "Busy": BUSY, "Brake": BRAKES,
}  # fmt: skip
MAP = "actions:\n" + "".join(
    f"  {prefix}{word}: {{action: {server}, type: test_msgs/action/Fibonacci,"
    f" goal: {{order: {order}}}}}\n"
    for word, order in WORDS.items()
    for prefix, server in (("", "/drive"), ("Arm", "/arm"))
)


class Bench:
    """Servers and nodes in processes, and what they wrote, with times."""

    def __init__(self, folder: Path) -> None:
        self.folder = folder
        self.events = folder / "events"
        self.events.touch()
        self._processes: list[subprocess.Popen[bytes]] = []
        (folder / "robot.yaml").write_text(MAP)
        domain = str(1 + next(DOMAINS) % 100)  # without other tests and what killed ones left
        paths = os.pathsep.join([str(ROOT), str(ROOT / "plugins/ros2")])
        self.environment = {
            **os.environ,
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "ROS_DOMAIN_ID": domain,
            "PYTHONPATH": paths,
        }

    def start(self, *arguments: object, output: str) -> subprocess.Popen[bytes]:
        """Starts a program of Python, which writes to a file of the folder."""
        with (self.folder / output).open("ab") as file:
            process = subprocess.Popen(
                [sys.executable, *map(str, arguments)],
                cwd=self.folder,
                env=self.environment,
                stdin=subprocess.PIPE,
                stdout=file,
                stderr=subprocess.STDOUT,
            )
        self._processes.append(process)
        return process

    def server(self, name: str = "/drive", threads: int = 4) -> subprocess.Popen[bytes]:
        """Starts an action server, and waits until it is ready."""
        count = len(self.times(f"{name} ready"))
        process = self.start(
            FOLDER / "ros2_servers.py", name, threads, self.events, output=name[1:]
        )
        self.until(lambda: len(self.times(f"{name} ready")) > count)
        return process

    def node(self, tree: str, *options: str) -> subprocess.Popen[bytes]:
        """Starts a tree."""
        (self.folder / "tree.bt").write_text(tree)
        arguments = ("ros2", "tree.bt", "--map", "robot.yaml", *options)
        return self.start("-c", "from islandgp.cli import main; main()", *arguments, output="node")

    def started(self, tree: str, event: str, *options: str) -> subprocess.Popen[bytes]:
        """Starts a tree, and waits for an event and 0.3 s more."""
        process = self.node(tree, *options)
        self.wait(event)
        time.sleep(0.3)
        return process

    def times(self, event: str) -> list[float]:
        """When an event occurred, s."""
        lines = [line.split(" ", 1) for line in self.events.read_text().splitlines()]
        return [float(at) for at, text in lines if text == event]

    def wait(self, event: str, count: int = 1, seconds: float = 60) -> float:
        """The time of the nth occurrence of an event."""
        self.until(lambda: len(self.times(event)) >= count, seconds)
        return self.times(event)[count - 1]

    def said(self, text: str) -> bool:
        """Whether a node wrote a text."""
        return text in self.output()

    def output(self) -> str:
        """What the nodes wrote."""
        return (self.folder / "node").read_text()

    def until(self, holds: Callable[[], bool], seconds: float = 60) -> float:
        """Waits until it holds; returns the time."""
        end = time.monotonic() + seconds
        while not holds():
            assert time.monotonic() < end, self.events.read_text() + self.output()
            time.sleep(0.01)
        return time.monotonic()

    def exit(self, process: subprocess.Popen[bytes], code: int) -> float:
        """Waits until a node has ended with a code; returns the time."""
        assert process.wait(30) == code, self.output()
        assert "Traceback" not in self.output()
        return time.monotonic()

    def close(self) -> None:
        """Kills all that still runs."""
        for process in self._processes:
            process.kill()
            process.communicate()


@pytest.fixture
def bench(tmp_path: Path) -> Iterator[Bench]:
    """An empty bench."""
    instance = Bench(tmp_path)
    yield instance
    instance.close()


def stopped(
    tree: str,
    event: str,
    code: int,
    *,
    by: signal.Signals = signal.SIGINT,
    ends: str = "",
    says: str = "",
    before: Callable[[subprocess.Popen[bytes]], None] = lambda _: None,
    count: int = 1,
) -> Callable[[Bench], float]:
    """A scenario: a signal after an event; seconds until the exit.

    `ends`: event of the server before the exit. `says`: text of the node. `before`: what happens to
    the server before the signal. `count`: signals, 0.3 s apart.
    """

    def scenario(bench: Bench) -> float:
        server = bench.server()
        node = bench.started(tree, event)
        before(server)
        start = time.monotonic()
        for _ in range(count):
            node.send_signal(by)
            time.sleep(0.3)
        end = bench.exit(node, code)
        assert not ends or bench.times(ends)
        assert bench.said(says)
        return end - start

    return scenario


def suspend(server: subprocess.Popen[bytes]) -> None:
    """Suspends a server, and waits until it has stopped."""
    server.send_signal(signal.SIGSTOP)
    os.waitid(os.P_PID, server.pid, os.WSTOPPED | os.WNOWAIT)


def server_lost(
    tree: str, event: str, how: signal.Signals, says: str, *, again: bool = False
) -> Callable[[Bench], float]:
    """A scenario: a signal to the server; seconds until the node says so.

    `again`: the server is started again; seconds from then on.
    """

    def scenario(bench: Bench) -> float:
        server = bench.server()
        bench.started(tree, event)
        start = time.monotonic()
        server.send_signal(how)
        if again:
            server.wait()
            bench.server()
            start = bench.times("/drive ready")[-1]
        return bench.until(lambda: bench.said(says)) - start

    return scenario


def once_ends(bench: Bench) -> float:
    """--once ends with a goal that is not accepted yet; seconds until the exit."""
    bench.server()
    node = bench.node("parallel success one { Drive Slow }", "--once")
    start = bench.wait("/drive goal 5")
    end = bench.exit(node, 0)
    assert bench.times("/drive ended 5")
    return end - start


def error_ends(bench: Bench) -> float:
    """A topic has another type while a goal is not accepted yet; seconds from error to exit."""
    key = "keys: {load: {topic: /load, type: std_msgs/msg/Float64, field: data, default: 0}}"
    (bench.folder / "robot.yaml").write_text(MAP + key)
    bench.server()
    node = bench.node("selector { when load > 5 { Drive } Slow }")
    bench.wait("/drive goal 5")
    publish(bench, "load")
    start = bench.until(lambda: bench.said("/load, std_msgs/msg/Bool"))
    end = bench.exit(node, 2)
    assert bench.said("/load, std_msgs/msg/Bool, found std_msgs/msg/Float64")
    assert bench.times("/drive ended 5")
    return end - start


def hangs_briefly(bench: Bench) -> float:
    """A server is suspended for 3 s; the goal goes on."""
    server = bench.server()
    bench.started("Wait", "/drive accepted 3")
    server.send_signal(signal.SIGSTOP)
    time.sleep(3)
    server.send_signal(signal.SIGCONT)
    time.sleep(3)
    assert not bench.said("failed")
    return 0


def node_hangs_briefly(bench: Bench) -> float:
    """The node is suspended for 8 s; the goal goes on."""
    bench.server()
    node = bench.started("Wait", "/drive accepted 3")
    node.send_signal(signal.SIGSTOP)
    time.sleep(8)
    node.send_signal(signal.SIGCONT)
    time.sleep(3)
    assert not bench.said("failed")
    return 0


def server_returns(bench: Bench) -> float:
    """A killed server starts again; seconds until it gets the next goal."""
    server = bench.server()
    bench.started("Wait", "/drive accepted 3")
    server.kill()
    server.wait()
    bench.server()
    return bench.wait("/drive accepted 3", 2) - bench.times("/drive ready")[-1]


def service_returns(bench: Bench) -> float:
    """The killed server of a key starts again; seconds until the key has a value."""
    keys = (
        "keys: {near: {service: /near, type: std_srvs/srv/SetBool, every: 0.2, max_age: 1,"
        " default: false}}"
    )
    (bench.folder / "robot.yaml").write_text(MAP + keys)
    server = bench.server()
    bench.started("selector { when near { Drive } Wait }", "/drive accepted 3")
    server.kill()
    server.wait()
    bench.until(lambda: bench.said("waiting for a value of near"))
    bench.server()
    return bench.wait("/drive accepted 3", 2) - bench.times("/drive ready")[-1]


def busy_server(bench: Bench) -> float:
    """A server with one thread only gives feedback for 7 s; seconds until the success."""
    bench.server(threads=1)
    node = bench.node("Busy", "--once")
    start = bench.wait("/drive accepted 9")
    return bench.exit(node, 0) - start


def node_killed(tree: str, order: int, event: str) -> Callable[[Bench], float]:
    """A scenario: a killed node starts again; seconds until its goal of before is cancelled."""

    def scenario(bench: Bench) -> float:
        bench.server()
        bench.started(tree, event).kill()
        time.sleep(2)
        assert not bench.times(f"/drive ended {order}")
        (bench.folder / "node").write_text("")
        start = time.monotonic()
        bench.node("Drive")
        return bench.wait(f"/drive ended {order}") - start

    return scenario


def order(tree: str, cancel: str, goal: str) -> Callable[[Bench], float]:
    """A scenario: a key changes what runs; seconds from the cancellation to the goal, > 0."""

    def scenario(bench: Bench) -> float:
        keys = "keys: {low: {topic: /low, type: std_msgs/msg/Bool, field: data, default: false}}"
        (bench.folder / "robot.yaml").write_text(MAP + keys)
        bench.server()
        bench.server("/arm")
        bench.started(tree, cancel.replace("cancel", "accepted"))
        publish(bench, "low")
        return bench.wait(goal) - bench.wait(cancel)

    return scenario


def publish(bench: Bench, topic: str) -> None:
    """Publishes `true` on a topic, latched, once; the publisher stays."""
    code = (
        "import sys, rclpy; from std_msgs.msg import Bool; from rclpy.qos import *; rclpy.init();"
        f"node = rclpy.create_node('{topic}_publisher');"
        "keeps = QoSProfile(depth=1, durability=DurabilityPolicy.TRANSIENT_LOCAL);"
        f"node.create_publisher(Bool, '/{topic}', keeps).publish(Bool(data=True));"
        "sys.stdin.read()"
    )
    bench.start("-c", code, output=topic)


def latched(bench: Bench) -> float:
    """A value was published before the node started; seconds from its first tick to the goal."""
    keys = "keys: {low: {topic: /low, type: std_msgs/msg/Bool, field: data}}"
    (bench.folder / "robot.yaml").write_text(MAP + keys)
    bench.server()
    publish(bench, "low")
    time.sleep(1.5)
    bench.node("when low { Wait }")
    start = bench.until(lambda: bench.said("waiting for a value of low"))
    return bench.wait("/drive accepted 3") - start


def resources(bench: Bench) -> float:
    """Two actions use the base; the second fails, with a message."""
    declare(bench)
    bench.server()
    bench.server("/arm")
    node = bench.node("parallel { Wait ArmWait }", "--once", "--vocabulary", "robot.json")
    end = bench.exit(node, 1)
    assert bench.said("ArmWait: failed, /arm: not sent, because of Wait, which uses base")
    assert not bench.times("/arm goal 3")
    return time.monotonic() - end


def handover(bench: Bench) -> float:
    """An action that uses the base waits until a cancelled one has ended; seconds of it."""
    declare(bench)
    bench.server()
    bench.server("/arm")
    tree = "sequence { force_success { timeout 4 { Brake } } ArmDrive }"
    bench.node(tree, "--once", "--vocabulary", "robot.json")
    goal = bench.wait("/arm goal 1")
    assert goal > bench.wait("/drive ended 10")
    return goal - bench.wait("/drive cancel 10")


def declare(bench: Bench) -> None:
    """Writes a vocabulary whose actions all use the base."""
    names = [f"{prefix}{word}" for prefix in ("", "Arm") for word in WORDS]
    vocabulary = {"domain": "bot", "actions": {name: {"uses": ["base"]} for name in names}}
    (bench.folder / "robot.json").write_text(json.dumps(vocabulary))


STOP, KILL, TERM = signal.SIGSTOP, signal.SIGKILL, signal.SIGTERM
KILLED = "Wait: failed, /drive: no answer for 5 s"
RUNS, SLOWLY = ("Wait", "/drive accepted 3"), ("Slow", "/drive goal 5")
LATE = "Never may still run: /drive has neither accepted nor rejected the goal"
GUARD = "selector { when low { ArmDrive } Wait }"
REACTIVE = "reactive_selector { when low abort none { ArmDrive } Wait }"
PARALLEL = """parallel failure all {
  selector { when low { ArmDrive } ArmWait }
  when not low abort self { Wait }
}"""
SAME = "selector { when low { Drive } Brake }"

SCENARIOS: dict[str, tuple[Callable[[Bench], float], float]] = {
    # Of the node's end: s until the exit.
    "Ctrl-C while a goal runs": (stopped(*RUNS, 130, ends="/drive ended 3"), 3),
    "SIGTERM while a goal runs": (stopped(*RUNS, 130, by=TERM, ends="/drive ended 3"), 3),
    "Ctrl-C before the acceptance": (stopped(*SLOWLY, 130, ends="/drive ended 5"), 3),
    "SIGTERM before the acceptance": (stopped(*SLOWLY, 130, by=TERM, ends="/drive ended 5"), 3),
    "Ctrl-C, three times, before the acceptance": (
        stopped(*SLOWLY, 130, ends="/drive ended 5", count=3),
        3,
    ),
    "--once before the acceptance": (once_ends, 3.5),
    "an error before the acceptance": (error_ends, 4),
    "Ctrl-C; the goal is never accepted": (stopped("Never", "/drive goal 6", 4, says=LATE), 7),
    "Ctrl-C; the server refuses": (
        stopped("Stubborn", "/drive accepted 7", 4, says="/drive refuses to cancel the goal"),
        7,
    ),
    "Ctrl-C; the server goes on": (
        stopped("Deaf", "/drive accepted 8", 4, says="/drive accepted the cancellation, and the"),
        7,
    ),
    "Ctrl-C; the server is suspended": (
        stopped(*RUNS, 4, says="/drive has not answered", before=suspend),
        7,
    ),
    "Ctrl-C; the server was killed": (
        stopped(*RUNS, 4, says="/drive has not answered", before=lambda s: s.kill()),
        7,
    ),
    # Of the server's end: s until the action fails.
    "kill -9 of the server while a goal runs": (server_lost(*RUNS, KILL, KILLED), 5.5),
    "kill -9 of the server before the acceptance": (
        server_lost(*SLOWLY, KILL, "Slow: failed, /drive: no answer for 5 s"),
        5.5,
    ),
    "SIGTERM of the server while a goal runs": (server_lost(*RUNS, TERM, KILLED), 5.5),
    "the server is suspended": (server_lost(*RUNS, STOP, KILLED), 5.5),
    "kill -9 of the server, which starts again": (
        server_lost(*RUNS, KILL, "was started again and does not know the goal", again=True),
        5,
    ),
    "the next goal at a server that started again": (server_returns, 6),
    "kill -9 of a key's service, which starts again": (service_returns, 6.5),
    # The goal goes on.
    "the server is suspended for 3 s": (hangs_briefly, 0.1),
    "the node is suspended for 8 s": (node_hangs_briefly, 0.1),
    "the server's only thread gives feedback for 7 s": (busy_server, 8.5),
    # Of a killed node's start: s until its goal is cancelled.
    "kill -9 of the node while a goal runs": (node_killed("Wait", 3, "/drive accepted 3"), 5),
    "kill -9 of the node before the acceptance": (node_killed("Slow", 5, "/drive goal 5"), 5),
    # s between the cancellation of one goal and the other goal.
    "a guard interrupts": (order(GUARD, "/drive cancel 3", "/arm goal 1"), 0.5),
    "a reactive node interrupts": (order(REACTIVE, "/drive cancel 3", "/arm goal 1"), 0.5),
    "a parallel's earlier child starts": (order(PARALLEL, "/drive cancel 3", "/arm goal 1"), 0.5),
    "both goals are at one server": (order(SAME, "/drive cancel 10", "/drive goal 1"), 1.5),
    "both goals use one resource": (handover, 1.5),
    "an action whose resource is in use": (resources, 1),
    # s from the first tick.
    "a latched value from before the start": (latched, 2.5),
}
"""The scenario and its most seconds, by name."""


@pytest.mark.parametrize("name", SCENARIOS)
def test_scenario(bench: Bench, name: str) -> None:
    """Nothing runs on, and each time is within its limit."""
    scenario, most = SCENARIOS[name]
    seconds = scenario(bench)
    assert 0 <= seconds <= most
    print(f"| {name} | {most:g} | {seconds:.1f} |")
