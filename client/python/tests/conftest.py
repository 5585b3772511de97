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

REPOSITORY = Path(__file__).resolve().parents[3]
BINARY = Path(os.environ.get("ISOTHERM_BINARY", REPOSITORY / "target/debug/isotherm"))
TABLE = REPOSITORY / "tests/data/imu-a.toml"
RUN = REPOSITORY / "tests/data/run.csv"
CAMPAIGN = REPOSITORY / "examples/campaign/campaign.toml"
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

    def start(self, *command: str | Path) -> subprocess.Popen[str]:
        """Starts a process whose output the test reads; `end` kills it."""
        process = subprocess.Popen(command, stdout=subprocess.PIPE, text=True)
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
        for stream in [stream for process in self.processes for stream in (process.stdout, process.stderr) if stream]:
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
    monkeypatch.delenv("ISOTHERM_LOG", raising=False)
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


def wait_for(condition: Callable[[], bool], event: str) -> None:
    begun = time.monotonic()
    while not condition():
        if time.monotonic() - begun > TIMEOUT:
            raise AssertionError(f"waited in vain: {event}")
        time.sleep(0.01)


def same(got: isotherm.Records, right: isotherm.Records) -> bool:
    """Whether both are equal bit for bit, except for session and delivery."""
    names = ("sequence", "timestamp_ns", "interval_ns", "table")
    bits = [array["velocity_increment"].view(np.uint64) for array in (got, right)]
    flags = [array["flags"] & ((1 << 21) - 1) for array in (got, right)]
    return all((got[name] == right[name]).all() for name in names) and bool((bits[0] == bits[1]).all() and (flags[0] == flags[1]).all())


__all__ = ["BINARY", "CAMPAIGN", "EXAMPLES", "REPOSITORY", "RUN", "TABLE", "TIMEOUT", "DomainUnderTest", "Service", "same", "signal", "wait_for"]
