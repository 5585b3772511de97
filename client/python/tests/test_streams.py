"""Acquisitions and readers against a running service."""

from __future__ import annotations

import ctypes
import gc
import os
import platform
import signal
import sys
import threading
import time
import warnings
from collections.abc import Callable

import isotherm
import numpy as np
import pytest
from conftest import TIMEOUT, DomainUnderTest, same, wait_for


def fill(loan: isotherm.Loan, sample: isotherm.Records) -> None:
    loan.timestamp_ns, loan.interval_ns = int(sample["timestamp_ns"]), int(sample["interval_ns"])
    loan.positive_pulses = sample["positive_pulses"]
    loan.negative_pulses = tuple(sample["negative_pulses"].tolist())
    loan.head_temperature = sample["head_temperature"].tolist()
    loan.board_temperature = sample["board_temperature"]


def in_thread(work: Callable[[], object]) -> BaseException | None:
    """Runs `work` in a thread of its own and returns the exception that it raised."""
    raised: list[BaseException] = []

    def run() -> None:
        try:
            work()
        except BaseException as error:
            raised.append(error)

    thread = threading.Thread(target=run)
    thread.start()
    thread.join()
    return raised[0] if raised else None


def test_a_round_trip_equals_the_replay(domain: DomainUnderTest, table: isotherm.Table, recorded: isotherm.Records) -> None:
    domain.serve()
    right = isotherm.replay(table, recorded)
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition, isotherm.IncrementReader("imu-a") as reader:
        assert (acquisition.imu, acquisition.in_flight, acquisition.closed, reader.connected) == ("imu-a", 0, False, True)
        for index in range(100):
            loan = acquisition.loan()
            fill(loan, recorded[index])
            assert loan.session == acquisition.session
            assert (loan.to_numpy()["positive_pulses"] == recorded[index]["positive_pulses"]).all()
            increment = acquisition.compensate(loan, TIMEOUT)
            array = increment.to_numpy()
            assert array.dtype == isotherm.INCREMENT
            assert array["velocity_increment"].tobytes() == right[index]["velocity_increment"].tobytes()
            assert (increment.sequence, increment.table, increment.latency_ns > 0) == (index, table.id, True)
            assert increment.velocity_increment == tuple(array["velocity_increment"].tolist())
        read = [reader.receive(TIMEOUT) for _ in range(50)]
        rest = reader.read_available()
        assert [increment.sequence for increment in read if increment] == list(range(50))
        assert rest["sequence"].tolist() == list(range(50, 100))
        assert rest.dtype == isotherm.INCREMENT and (rest["session"] == acquisition.session).all()
        assert reader.read_available().shape == (0,)
    assert acquisition.closed and reader.closed


def test_a_whole_recording(domain: DomainUnderTest, table: isotherm.Table, recorded: isotherm.Records) -> None:
    domain.serve()
    right = isotherm.replay(table, recorded)
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        for window in (None, 1, 7):
            got = acquisition.run(recorded, window=window, timeout=TIMEOUT)
            assert got.dtype == isotherm.INCREMENT and got.shape == recorded.shape
            assert same(got, right) and (got["session"] == acquisition.session).all()
        assert acquisition.run(recorded[:0]).shape == (0,)
        assert same(acquisition.run(recorded[::2], timeout=TIMEOUT), right[::2])
        begun = time.monotonic()
        acquisition.run(recorded[:20], rate=100.0, timeout=TIMEOUT)
        assert time.monotonic() - begun > 0.18
        # Without a new session the sequences must continue those of the last run.
        acquisition.run(recorded[20:40], new_session=False, timeout=TIMEOUT)
        with pytest.raises(isotherm.IsothermError, match="sequence"):
            acquisition.run(recorded[:20], new_session=False, timeout=TIMEOUT)
        with pytest.raises(ValueError, match="sample 1: sequence"):
            acquisition.run(recorded[[5, 5]])
        with pytest.raises(ValueError, match="window"):
            acquisition.run(recorded, window=0)
        with pytest.raises(ValueError, match="rate"):
            acquisition.run(recorded, rate=0.0)


def test_a_session_that_changes_in_the_array(domain: DomainUnderTest, table: isotherm.Table, recorded: isotherm.Records) -> None:
    domain.serve()
    samples = np.concatenate([recorded[:50], recorded[:50]])
    samples["session"][50:] = 1
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        got = acquisition.run(samples, timeout=TIMEOUT)
        assert same(got, isotherm.replay(table, samples))
        assert len(set(got["session"].tolist())) == 2
        assert not (got["flags"] & isotherm.Flags.GAP).any()


def test_a_sent_sample_cannot_be_touched(domain: DomainUnderTest, recorded: isotherm.Records) -> None:
    domain.serve()
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        loan = acquisition.loan()
        fill(loan, recorded[0])
        copy = loan.to_numpy()
        assert not loan.sent
        acquisition.send(loan)
        assert loan.sent and repr(loan) == "Loan(sent)"
        # The copy owns its memory. No other object refers to the transport's memory.
        assert copy["interval_ns"] == recorded[0]["interval_ns"]
        uses: list[Callable[[], object]] = [
            lambda: loan.sequence,
            lambda: setattr(loan, "interval_ns", 1),
            lambda: setattr(loan, "positive_pulses", (1, 2, 3)),
            lambda: loan.head_temperature,
            lambda: loan.fill(recorded[0]),
            lambda: loan.merge(recorded[0]),
            lambda: loan.to_numpy(),
            lambda: acquisition.send(loan),
            lambda: acquisition.compensate(loan),
        ]
        for use in uses:
            with pytest.raises(isotherm.Closed, match="has been sent"):
                use()
        assert acquisition.receive(TIMEOUT) is not None
        left = acquisition.loan()
    for use in (lambda: left.sequence, lambda: acquisition.loan(), lambda: acquisition.receive(1.0), lambda: acquisition.run(recorded)):
        with pytest.raises(isotherm.Closed, match="closed"):
            use()
    acquisition.close()


def test_loans_are_few_and_come_back(domain: DomainUnderTest, recorded: isotherm.Records) -> None:
    domain.serve()
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        for _ in range(20):
            loans = [acquisition.loan() for _ in range(4)]
            del loans
        loans = [acquisition.loan() for _ in range(4)]
        with pytest.raises(isotherm.TransportError):
            more = [acquisition.loan() for _ in range(10)]
            del more
        del loans
        acquisition.loan().fill(recorded[0])


def test_a_full_queue_hands_the_sample_back(domain: DomainUnderTest, recorded: isotherm.Records) -> None:
    service = domain.serve()
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        service.pause()
        try:
            for index in range(acquisition.depth):
                acquisition.send(recorded[index])
            loan = acquisition.loan()
            fill(loan, recorded[acquisition.depth])
            with pytest.raises(isotherm.Full) as full:
                acquisition.send(loan)
            assert full.value.sample is loan and not loan.sent
            with pytest.raises(isotherm.Full) as full:
                acquisition.compensate(recorded[acquisition.depth])
            assert full.value.sample["sequence"] == acquisition.depth
            pulses, interval = loan.positive_pulses, loan.interval_ns
            later = recorded[acquisition.depth + 1]
            loan.merge(later)
            assert loan.positive_pulses == tuple((np.array(pulses) + later["positive_pulses"]).tolist())
            assert loan.interval_ns == interval + later["interval_ns"]
            assert loan.head_temperature == tuple(later["head_temperature"].tolist())
            before = loan.to_numpy()
            endless = later.copy()
            endless["interval_ns"] = 2**63
            with pytest.raises(OverflowError):
                loan.merge(endless)
            assert loan.to_numpy() == before
        finally:
            service.resume()
        sequences = [increment.sequence for _ in range(acquisition.depth) if (increment := acquisition.receive(TIMEOUT))]
        assert sequences == list(range(acquisition.depth))
        assert acquisition.compensate(loan, TIMEOUT).interval_ns == before["interval_ns"]


def test_no_answer_in_time(domain: DomainUnderTest, recorded: isotherm.Records) -> None:
    service = domain.serve()
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        assert acquisition.receive() is None and acquisition.receive(0.01) is None
        service.pause()
        with pytest.raises(isotherm.Timeout) as late:
            acquisition.compensate(recorded[0], 0.05)
        assert isinstance(late.value, TimeoutError) and late.value.increments is None
        with pytest.raises(isotherm.IsothermError, match="unanswered"):
            acquisition.begin_session()
        with pytest.raises(isotherm.Timeout) as late:
            acquisition.run(recorded, timeout=0.05)
        assert late.value.increments is not None and late.value.increments.shape == (0,)
        service.resume()
        # A late answer to an abandoned sample is not taken for an answer to a later sample.
        got = acquisition.run(recorded[:100], timeout=TIMEOUT)
        assert got["sequence"].tolist() == recorded["sequence"][:100].tolist()


def test_a_killed_service_loses_nothing(domain: DomainUnderTest, table: isotherm.Table, recorded: isotherm.Records) -> None:
    first = domain.serve()
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition, isotherm.IncrementReader("imu-a") as reader:
        half = len(recorded) // 2
        # The rate is so low that the run is still in progress when the service is killed.
        killer = threading.Timer(0.3, first.kill)
        killer.start()
        successor = threading.Timer(0.6, domain.serve)
        successor.start()
        got = acquisition.run(recorded[:half], rate=2000.0, timeout=TIMEOUT)
        killer.join()
        successor.join()
        assert same(got, isotherm.replay(table, recorded[:half]))
        assert first.process.poll() == -signal.SIGKILL
        rest = acquisition.run(recorded[half:], new_session=False, timeout=TIMEOUT)
        assert same(rest, isotherm.replay(table, recorded[half:]))
        assert reader.receive(TIMEOUT) is not None


def test_a_reader_may_come_first_and_stays(domain: DomainUnderTest, recorded: isotherm.Records) -> None:
    reader = isotherm.IncrementReader("imu-a", timeout=None)
    assert not reader.connected and reader.receive() is None and reader.read_available().shape == (0,)
    service = domain.serve()
    wait_for(lambda: reader.receive() is None and reader.connected, "the reader connects")
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        acquisition.run(recorded[:10], timeout=TIMEOUT)
        sequences = []
        for increment in reader:
            sequences.append(increment.sequence)
            if len(sequences) == 10:
                break
        assert sequences == recorded["sequence"][:10].tolist() and reader.repeats == 0
        acquisition.run(recorded[:10], timeout=TIMEOUT)
        assert len(reader.read_available(3)) == 3
        service.stop()
    reader.close()
    assert list(reader) == []
    with pytest.raises(isotherm.Closed):
        reader.receive()


def test_the_exception_says_why_connecting_failed(domain: DomainUnderTest) -> None:
    for connect in (isotherm.Acquisition, isotherm.IncrementReader):
        with pytest.raises(isotherm.NoService, match="isotherm serve"):
            connect("imu-a", timeout=0.1)
    domain.serve()
    for connect in (isotherm.Acquisition, isotherm.IncrementReader):
        with pytest.raises(isotherm.NoSuchImu, match="does not serve IMU imu-z"):
            connect("imu-z", timeout=0.1)
        with pytest.raises(isotherm.NoService):
            connect("imu-a", domain="elsewhere", timeout=0.1)
        with pytest.raises(ValueError, match="no valid name"):
            connect("IMU A")
        with pytest.raises(ValueError, match="domain"):
            connect("imu-a", domain="a/b")
        for timeout in (-1.0, float("nan")):
            with pytest.raises(ValueError, match="timeout"):
                connect("imu-a", timeout=timeout)
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT):
        with pytest.raises(isotherm.Occupied, match=str(os.getpid())):
            isotherm.Acquisition("imu-a", timeout=0.1)
    # The only place of an acquisition is free again.
    isotherm.Acquisition("imu-a", timeout=TIMEOUT).close()


def test_wrong_samples_are_refused(domain: DomainUnderTest, recorded: isotherm.Records) -> None:
    domain.serve()
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        loan = acquisition.loan()
        with pytest.raises(OverflowError):
            loan.interval_ns = -1
        with pytest.raises(OverflowError):
            loan.positive_pulses = (1, 2, 2**32)
        for values in ((1, 2), (1, 2, 3, 4), ()):
            with pytest.raises(ValueError, match="three values"):
                loan.negative_pulses = values
        for wrong in (("a", 1.0, 2.0), 3.0, None):
            with pytest.raises(TypeError):
                loan.head_temperature = wrong  # type: ignore[assignment]
        with pytest.raises(AttributeError):
            loan.session = 3  # type: ignore[misc]
        for wrong in (3, None, np.zeros(1), np.zeros(1, isotherm.INCREMENT), b"", "x"):
            with pytest.raises(TypeError):
                acquisition.send(wrong)  # type: ignore[arg-type]
        for count in (0, 2):
            with pytest.raises(ValueError, match="one sample"):
                acquisition.send(recorded[:count])
        acquisition.send(recorded[1])
        with pytest.raises(isotherm.SequenceError):
            acquisition.send(recorded[1])
        old = acquisition.loan()
        old.sequence = 0
        with pytest.raises(isotherm.SequenceError):
            acquisition.send(old)
        old.sequence = 7
        acquisition.send(old)
        answers = [acquisition.receive(TIMEOUT) for _ in range(2)]
        assert [bool(answer and answer.flags & isotherm.Flags.GAP) for answer in answers] == [False, True]


def test_not_a_number_and_foreign_layouts(domain: DomainUnderTest, table: isotherm.Table, recorded: isotherm.Records) -> None:
    domain.serve()
    hot = recorded[:3].copy()
    hot["head_temperature"][1, 0] = np.nan
    foreign = hot.astype(hot.dtype.newbyteorder())
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        for samples in (hot, foreign, foreign[::-1][::-1], np.concatenate([hot, hot])[:3]):
            got = acquisition.run(samples, timeout=TIMEOUT)
            assert same(got, isotherm.replay(table, hot))
            assert isotherm.flag_names(int(got["flags"][1]) & 0x1FFFFF) == ["a1-not-finite"]
            assert np.isnan(got["velocity_increment"][1, 0]) and np.isfinite(got["velocity_increment"][1, 1:]).all()
        acquisition.begin_session()
        assert np.isnan(acquisition.compensate(foreign[1], TIMEOUT).velocity_increment[0])


def test_another_thread_gets_an_exception(domain: DomainUnderTest, recorded: isotherm.Records) -> None:
    domain.serve()
    acquisition = isotherm.Acquisition("imu-a", timeout=TIMEOUT)
    reader = isotherm.IncrementReader("imu-a")
    loan = acquisition.loan()
    uses: list[Callable[[], object]] = [
        lambda: acquisition.compensate(recorded[0]),
        lambda: acquisition.loan(),
        lambda: acquisition.close(),
        lambda: acquisition.run(recorded),
        lambda: loan.sequence,
        lambda: acquisition.send(loan),
        lambda: reader.receive(),
        lambda: reader.read_available(),
        lambda: next(reader),
    ]
    for use in uses:
        assert isinstance(in_thread(use), isotherm.WrongThread)
    assert acquisition.compensate(loan, TIMEOUT).sequence == 0
    # An acquisition that another thread creates works in that thread.
    acquisition.close()

    def work() -> None:
        with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as mine:
            mine.run(recorded[:10], timeout=TIMEOUT)

    assert in_thread(work) is None
    # A reader that its thread does not close stays until the process ends, and a warning says so.
    kept: list[isotherm.IncrementReader] = []
    assert in_thread(lambda: kept.append(isotherm.IncrementReader("imu-a", timeout=TIMEOUT))) is None
    with warnings.catch_warnings(record=True) as caught:
        warnings.simplefilter("always")
        kept.clear()
        gc.collect()
    categories = [warning.category for warning in caught if "dropped by another thread" in str(warning.message)]
    assert categories == [ResourceWarning]
    reader.close()


def clone() -> int:
    """A child with a copy of the memory, made behind the back of Python and the C library."""
    number = {"x86_64": 56, "aarch64": 220}[platform.machine()]
    return int(ctypes.PyDLL(None).syscall(number, int(signal.SIGCHLD), 0, 0, 0, 0))


@pytest.mark.parametrize("make", [os.fork, clone])
def test_a_forked_child_leaves_its_parents_streams_alone(
    domain: DomainUnderTest, recorded: isotherm.Records, make: Callable[[], int]
) -> None:
    domain.serve()
    acquisition = isotherm.Acquisition("imu-a", timeout=TIMEOUT)
    with warnings.catch_warnings():
        warnings.simplefilter("ignore", DeprecationWarning)
        child = make()
    if child == 0:
        code = 1
        try:
            try:
                acquisition.compensate(recorded[0], 1.0)
            except isotherm.WrongThread:
                code = 0
            del acquisition
            gc.collect()
        finally:
            os._exit(code)
    assert os.waitpid(child, 0)[1] == 0
    assert acquisition.compensate(recorded[0], TIMEOUT).sequence == recorded["sequence"][0]
    acquisition.close()


def test_waiting_lets_other_threads_run(domain: DomainUnderTest) -> None:
    domain.serve()
    turns = 0
    done = threading.Event()

    def count() -> None:
        nonlocal turns
        while not done.is_set():
            turns += 1
            time.sleep(0)

    thread = threading.Thread(target=count)
    with isotherm.IncrementReader("imu-a", timeout=TIMEOUT) as reader:
        thread.start()
        wait_for(lambda: turns > 0, "the thread runs")
        before = turns
        assert reader.receive(0.5) is None
        during = turns - before
        done.set()
        thread.join()
    assert during > 10, during


@pytest.mark.parametrize("wait", ["reader.receive(1e9)", "next(reader)", "acquisition.receive(1e9)", "acquisition.run(samples, rate=0.01)"])
def test_ctrl_c_ends_a_wait(domain: DomainUnderTest, wait: str) -> None:
    domain.serve()
    program = f"""
import signal, numpy as np, isotherm
# A shell starts its background jobs with this ignored.
signal.signal(signal.SIGINT, signal.default_int_handler)
acquisition, reader = isotherm.Acquisition("imu-a", timeout={TIMEOUT}), isotherm.IncrementReader("imu-a", timeout={TIMEOUT})
samples = np.zeros(3, isotherm.RAW_SAMPLE)
samples["sequence"] = range(3)
try:
    print("waiting", flush=True)
    {wait}
except KeyboardInterrupt:
    print("interrupted", flush=True)
"""
    child = domain.start(sys.executable, "-c", program)
    assert child.stdout is not None
    assert child.stdout.readline() == "waiting\n"
    child.send_signal(signal.SIGINT)
    assert child.stdout.read() == "interrupted\n"
    assert child.wait(TIMEOUT) == 0


def test_connecting_can_be_interrupted(domain: DomainUnderTest) -> None:
    program = "import signal, isotherm\nsignal.signal(signal.SIGINT, signal.default_int_handler)\ntry:\n    print('waiting', flush=True)\n    isotherm.Acquisition('imu-a', timeout=1e9)\nexcept KeyboardInterrupt: print('interrupted')"
    child = domain.start(sys.executable, "-c", program)
    assert child.stdout is not None
    assert child.stdout.readline() == "waiting\n"
    time.sleep(0.3)
    child.send_signal(signal.SIGINT)
    assert child.stdout.read() == "interrupted\n"
    assert child.wait(TIMEOUT) == 0


def test_nothing_is_left_in_shared_memory(domain: DomainUnderTest, recorded: isotherm.Records) -> None:
    service = domain.serve()
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition, isotherm.IncrementReader("imu-a"):
        acquisition.run(recorded[:10], timeout=TIMEOUT)
        assert domain.status()["imus"][0]["acquisition_connected"]
    wait_for(lambda: not domain.status()["imus"][0]["acquisition_connected"], "the acquisition is gone")
    service.stop()
    assert [path.name for path in domain.shared_memory() if "global_mgmt" not in path.name] == []
