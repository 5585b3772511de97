"""Each test gets a domain and a folder of its own and starts real services in them. Nothing is left behind."""

from __future__ import annotations

import faulthandler
import hashlib
import json
import os
import shutil
import signal
import subprocess
import tempfile
import threading
import time
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import isotherm
import numpy as np
import pytest

REPOSITORY = Path(__file__).resolve().parents[2]
BINARY = Path(os.environ.get("ISOTHERM_BINARY", REPOSITORY / "target/debug/isotherm"))
TABLE = REPOSITORY / "tests/data/imu-a.toml"
# A table of format 2 for imu-g: gyroscopes, both alignments, g-sensitivity, transient terms with a lag of 240 s.
WHOLE_TABLE = REPOSITORY / "tests/data/imu-g.toml"
# A recording of it with every peculiarity that a sample can have.
WHOLE_RUN = REPOSITORY / "tests/data/run-g.csv"
RUN = REPOSITORY / "tests/data/run.csv"
# A table of format 3: readings at a nominal interval of 2.5 ms.
MEMS_TABLE = REPOSITORY / "examples/tables/imu-mems.toml"
CAMPAIGN = REPOSITORY / "examples/campaign/campaign.toml"
# A campaign of imu-g with turns.
WHOLE_CAMPAIGN = REPOSITORY / "calibration/fit/tests/data/gyro/campaign.toml"
EXAMPLES = REPOSITORY / "examples/python"
# Time limit of every wait [s]. It is generous: it only bounds a failing test.
TIMEOUT = 20.0
# Time limit of a test [s].
WATCHDOG = 200.0


class Service:
    """A running `isotherm serve`."""

    def __init__(self, process: subprocess.Popen[str]) -> None:
        self.process = process
        self.log: list[str] = []
        self.ready = threading.Event()
        self.reader = threading.Thread(target=self._read, daemon=True)
        self.reader.start()

    def _read(self) -> None:
        assert self.process.stderr is not None
        for line in self.process.stderr:
            self.log.append(line)
            if "ready" in line:
                self.ready.set()

    def wait_until_ready(self) -> Service:
        if not self.ready.wait(TIMEOUT):
            raise AssertionError("the service did not become ready:\n" + "".join(self.log))
        return self

    def pause(self) -> None:
        """Stops all its threads, and waits until they have stopped."""
        self.process.send_signal(signal.SIGSTOP)
        tasks = Path(f"/proc/{self.process.pid}/task")
        wait_for(lambda: all(" T " in (task / "stat").read_text() for task in tasks.iterdir()), "the service stops")

    def resume(self) -> None:
        self.process.send_signal(signal.SIGCONT)

    def kill(self) -> None:
        self.process.kill()
        self.process.wait()

    def stop(self) -> None:
        self.process.terminate()
        self.process.wait(TIMEOUT)


class DomainUnderTest:
    """The domain and the folder of one test, with the processes that it starts."""

    def __init__(self, folder: Path, name: str) -> None:
        self.folder, self.name = folder, name
        root = f"{folder}/{name}"
        self.prefix = f"isotherm_{hashlib.sha256(root.encode()).hexdigest()[:8]}_"
        self.services: list[Service] = []
        self.processes: list[subprocess.Popen[str]] = []

    def start(self, *command: str | Path, stdin: int | None = None, cwd: Path | None = None) -> subprocess.Popen[str]:
        """Starts a process whose output the test reads; `end` kills it."""
        process = subprocess.Popen(command, stdin=stdin, stdout=subprocess.PIPE, text=True, cwd=cwd)
        self.processes.append(process)
        return process

    def spawn(self, *arguments: str) -> Service:
        process = subprocess.Popen(
            [BINARY, "serve", *arguments], stdin=subprocess.DEVNULL, stdout=subprocess.DEVNULL, stderr=subprocess.PIPE, text=True
        )
        service = Service(process)
        self.processes.append(process)
        self.services.append(service)
        return service

    def serve(self, *arguments: str) -> Service:
        """Starts a service of imu-a and waits until it is ready."""
        table = self.folder / "imu-a.toml"
        if not table.exists():
            shutil.copy(TABLE, table)
        return self.spawn("--imu", f"imu-a={table}", *arguments).wait_until_ready()

    def serve_whole(self) -> Service:
        """Starts a service of imu-g and waits until it is ready."""
        table = self.folder / "imu-g.toml"
        shutil.copy(WHOLE_TABLE, table)
        return self.spawn("--imu", f"imu-g={table}").wait_until_ready()

    def isotherm(self, *arguments: str | Path) -> str:
        return subprocess.run([BINARY, *arguments], check=True, capture_output=True, text=True, timeout=WATCHDOG).stdout

    def status(self) -> Any:
        return json.loads(self.isotherm("status", "--json"))

    def shared_memory(self) -> list[Path]:
        return [path for path in Path("/dev/shm").iterdir() if path.name.startswith(self.prefix)]

    def end(self) -> None:
        for process in self.processes:
            process.kill()
            process.wait()
        for service in self.services:
            service.reader.join()
        for stream in [stream for process in self.processes for stream in (process.stdin, process.stdout, process.stderr) if stream]:
            stream.close()
        for path in self.shared_memory():
            path.unlink(missing_ok=True)
        shutil.rmtree(self.folder)


DOMAINS: list[DomainUnderTest] = []
# A copy of the original stderr, because pytest captures that of a test.
STDERR = 2


def pytest_configure() -> None:
    global STDERR
    STDERR = os.dup(2)


@pytest.fixture(autouse=True)
def watchdog() -> Iterator[None]:
    """A test that hangs prints its stack, kills its processes, and ends."""

    def abort() -> None:
        faulthandler.dump_traceback(file=STDERR)
        for domain in DOMAINS:
            domain.end()
        os._exit(1)

    timer = threading.Timer(WATCHDOG, abort)
    timer.daemon = True
    timer.start()
    # For the case that `abort` cannot run because something holds the GIL.
    faulthandler.dump_traceback_later(WATCHDOG + TIMEOUT, exit=True, file=STDERR)
    yield
    timer.cancel()
    faulthandler.cancel_dump_traceback_later()


@pytest.fixture
def domain(monkeypatch: pytest.MonkeyPatch, request: pytest.FixtureRequest) -> Iterator[DomainUnderTest]:
    folder = Path(tempfile.mkdtemp(prefix="iso-"))
    domain = DomainUnderTest(folder, f"p{os.getpid()}")
    DOMAINS.append(domain)
    monkeypatch.setenv("ISOTHERM_ROOT", str(folder))
    monkeypatch.setenv("ISOTHERM_DOMAIN", domain.name)
    for variable in ("ISOTHERM_LOG", "ISOTHERM_STATE", "STATE_DIRECTORY"):
        monkeypatch.delenv(variable, raising=False)
    try:
        yield domain
    finally:
        DOMAINS.remove(domain)
        domain.end()


@pytest.fixture(scope="session")
def table() -> isotherm.Table:
    return isotherm.Table.load(TABLE)


@pytest.fixture(scope="session")
def recorded() -> isotherm.Records:
    recorded = isotherm.read_recording(RUN)
    recorded.flags.writeable = False
    return recorded


@pytest.fixture(scope="session")
def whole_table() -> isotherm.Table:
    return isotherm.Table.load(WHOLE_TABLE)


@pytest.fixture(scope="session")
def whole() -> isotherm.Records:
    """Samples of a whole IMU that heats up and turns, 50 ms each. The temperature is measured in every 20th sample."""
    count, random = 400, np.random.default_rng(7)
    samples = np.zeros(count, isotherm.RAW_SAMPLE)
    samples["sequence"] = np.arange(count)
    samples["timestamp_ns"] = 50_000_000 * np.arange(1, count + 1)
    samples["interval_ns"] = 50_000_000
    temperature = (1.2 + 0.004 * (np.arange(count) // 20))[:, None] + np.array([0.0, 0.01, 0.02])
    for name, offset, pulses in (("accelerometers", 0.0, 5000), ("gyroscopes", 0.2, 40_000)):
        samples[name]["positive_pulses"] = random.integers(0, pulses, (count, 3))
        samples[name]["negative_pulses"] = random.integers(0, 100, (count, 3))
        samples[name]["head_temperature"] = temperature + offset
        samples[name]["board_temperature"] = temperature + offset - 0.01
    samples.flags.writeable = False
    return samples


def wait_for(condition: Callable[[], bool], event: str) -> None:
    begun = time.monotonic()
    while not condition():
        if time.monotonic() - begun > TIMEOUT:
            raise AssertionError(f"waited in vain: {event}")
        time.sleep(0.01)


def same(got: isotherm.Records, right: isotherm.Records) -> bool:
    """Whether both are equal bit for bit, except for session and delivery."""
    names = ("sequence", "timestamp_ns", "interval_ns", "table")
    if not all((got[name] == right[name]).all() for name in names):
        return False
    for name in ("velocity_increment", "angle_increment"):
        if not (got[name].view(np.uint64) == right[name].view(np.uint64)).all():
            return False
    delivery = np.uint64(isotherm.Flags.LOST | isotherm.Flags.LATE)
    return bool((got["flags"] & ~delivery == right["flags"] & ~delivery).all())


__all__ = [
    "BINARY",
    "CAMPAIGN",
    "EXAMPLES",
    "MEMS_TABLE",
    "REPOSITORY",
    "RUN",
    "TABLE",
    "TIMEOUT",
    "WHOLE_RUN",
    "WHOLE_TABLE",
    "DomainUnderTest",
    "Service",
    "same",
    "signal",
    "wait_for",
]
