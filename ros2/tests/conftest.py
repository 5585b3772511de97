"""The harness of the tests with peers of ROS 2: each test has a folder, a domain of Isotherm and one of ROS 2 of its
own, starts real processes in them, and leaves nothing behind.

ISOTHERM_BUILT is the folder with the programs isotherm and isotherm-ros2; target/debug unless given.
"""

import csv
import fcntl
import glob
import json
import math
import os
import queue
import signal
import subprocess
import sys
import tempfile
import threading
import time
from pathlib import Path

import pytest

ROOT = Path(__file__).resolve().parents[2]
HERE = Path(__file__).resolve().parent
BUILT = Path(os.environ.get("ISOTHERM_BUILT", ROOT / "target/debug"))
# Longest wait for an event: it bounds a test that fails.
LIMIT = 60.0


class Running:
    """A process whose lines are waited for."""

    def __init__(self, command, env, folder, stdin=None):
        self.name = " ".join(Path(part).name for part in command[:3])
        self.process = subprocess.Popen(
            command,
            env=env,
            cwd=folder,
            stdin=stdin,
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            bufsize=1,
        )
        self.lines = []
        self.new = queue.Queue()
        threading.Thread(target=self._read, daemon=True).start()

    def _read(self):
        for line in self.process.stdout:
            self.lines.append(line.rstrip("\n"))
            self.new.put(None)
        self.new.put(None)

    def wait_until(self, holds, what):
        """Waits until `holds()` is true, which is looked at after each line. `what` may be a function."""
        deadline = time.monotonic() + LIMIT
        while not holds():
            left = deadline - time.monotonic()
            if left <= 0 or self.process.poll() is not None and self.new.empty():
                shown = "\n".join(line[:200] for line in self.lines[-10:])
                what = what() if callable(what) else what
                pytest.fail(f"{self.name}: {what} did not come ({self.process.poll()}):\n{shown}")
            try:
                self.new.get(timeout=min(left, 0.5))
            except queue.Empty:
                pass

    def wait_for(self, text):
        self.wait_until(lambda: any(text in line for line in self.lines), repr(text))

    def messages(self):
        return [json.loads(line) for line in list(self.lines) if line.startswith("{")]

    def wait_for_messages(self, count):
        come = lambda: sum(line.startswith("{") for line in list(self.lines))  # noqa: E731
        self.wait_until(lambda: come() >= count, lambda: f"{count} messages, of which {come()} came,")
        return self.messages()

    def send(self, message):
        self.process.stdin.write(json.dumps(message) + "\n")
        self.process.stdin.flush()

    def log(self):
        return "\n".join(self.lines)

    def kill(self):
        self.process.kill()
        self.process.wait()

    def end(self, sent=signal.SIGTERM):
        self.process.send_signal(sent)
        return self.process.wait(timeout=LIMIT)


def fast_dds_objects():
    """Names of segments and ports of Fast DDS in shared memory, which stay behind when a peer is killed."""
    # Up to Jazzy their names begin with fastrtps.
    names = glob.glob("/dev/shm/fastdds_*") + glob.glob("/dev/shm/fastrtps_*")
    return {name.removesuffix("_el") for name in names}


def remove_if_unused(name):
    """Removes an object of Fast DDS whose lock no process holds any more."""
    try:
        with open(f"{name}_el") as lock:
            fcntl.flock(lock, fcntl.LOCK_EX | fcntl.LOCK_NB)
    except FileNotFoundError:
        pass
    except BlockingIOError:
        return
    folder, base = os.path.split(name)
    for path in (name, f"{folder}/sem.{base}_mutex", f"{name}_el"):
        Path(path).unlink(missing_ok=True)


class World:
    """The folder and the domains of one test."""

    count = 0

    def __init__(self, folder):
        World.count += 1
        self.folder = folder
        self.built = BUILT
        self.name = f"r{os.getpid()}-{World.count}"
        # The domains of ROS 2 that no other program on this machine is likely to have.
        self.ros_domain = 100 + (os.getpid() * 7 + World.count) % 100
        self.all = []
        self.objects = fast_dds_objects()
        self.env = dict(os.environ)
        for variable in ["ISOTHERM_LOG", "ISOTHERM_STATE", "ROS_LOCALHOST_ONLY", "CYCLONEDDS_URI"]:
            self.env.pop(variable, None)
        self.env |= {
            "ISOTHERM_DOMAIN": self.name,
            "ISOTHERM_ROOT": str(folder),
            "ROS_DOMAIN_ID": str(self.ros_domain),
            "ROS_AUTOMATIC_DISCOVERY_RANGE": "LOCALHOST",
            "RMW_IMPLEMENTATION": "rmw_fastrtps_cpp",
            "ROS_LOG_DIR": str(folder / "log"),
            "CYCLONEDDS_URI": "<CycloneDDS><Domain><General><Interfaces><NetworkInterface address='127.0.0.1'/>"
            "</Interfaces><AllowMulticast>false</AllowMulticast></General><Discovery><ParticipantIndex>auto"
            "</ParticipantIndex><Peers><Peer address='127.0.0.1'/></Peers></Discovery></Domain></CycloneDDS>",
        }

    def start(self, command, **more):
        running = Running([str(part) for part in command], self.env, self.folder, **more)
        self.all.append(running)
        return running

    def write(self, name, text):
        path = self.folder / name
        path.write_text(text)
        return path

    def serve(self, *arguments):
        service = self.start([BUILT / "isotherm", "serve", *arguments])
        service.wait_for("ready")
        return service

    def node(self, *arguments):
        node = self.start([BUILT / "isotherm-ros2", *arguments])
        node.wait_for("node of ROS 2")
        return node

    def isotherm(self, *arguments):
        return self.run("isotherm", *arguments)

    def run(self, program, *arguments):
        done = subprocess.run(
            [BUILT / program, *map(str, arguments)], env=self.env, cwd=self.folder, text=True, capture_output=True, timeout=300
        )
        assert done.returncode == 0, f"{arguments}: {done.returncode}\n{done.stderr}"
        return done.stdout

    def peer(self, kind, *arguments):
        is_publisher = arguments[0] == "publish"
        stdin = subprocess.PIPE if is_publisher else None
        return self.start([sys.executable, HERE / f"peer_{kind}.py", *arguments], stdin=stdin)

    def status(self):
        return json.loads(self.isotherm("status", "--json"))

    def close(self):
        """Ends what runs, and removes what was killed has left in shared memory."""
        left = [running for running in self.all if running.process.poll() is None]
        for running in left:
            if running.process.stdin:
                running.process.stdin.close()
            running.process.terminate()
        for running in left:
            try:
                running.process.wait(timeout=10)
            except subprocess.TimeoutExpired:
                running.kill()
        self.isotherm("clean")
        for name in fast_dds_objects() - self.objects:
            remove_if_unused(name)


@pytest.fixture
def world():
    # Short: the names of sockets are below it.
    with tempfile.TemporaryDirectory(prefix="iso-") as folder:
        world = World(Path(folder))
        try:
            yield world
        finally:
            world.close()


def rows(text):
    """The rows of increments as numbers: sequence, timestamp, interval, increments."""
    found = []
    for row in csv.DictReader(text.splitlines()):
        interval = int(row["interval_ns"])
        found.append(
            {
                "sequence": int(row["sequence"]),
                "timestamp_ns": int(row["timestamp_ns"]),
                "force": [float(row[f"a{axis}_dv"]) / (interval / 1e9) for axis in (1, 2, 3)],
            }
        )
    return found


def same(found, expected):
    """Whether numbers are the same, NaN included."""
    return len(found) == len(expected) and all(
        a == b or math.isnan(a) and math.isnan(b) or math.isclose(a, b, rel_tol=1e-14) for a, b in zip(found, expected)
    )
