"""Acquisitions and readers against a running service."""

from __future__ import annotations

import ctypes
import gc
import json
import os
import platform
import selectors
import signal
import subprocess
import sys
import threading
import time
import warnings
from collections.abc import Callable

import isotherm
import numpy as np
import pandas as pd
import pytest
from conftest import TIMEOUT, WHOLE_RUN, WHOLE_TABLE, DomainUnderTest, same, wait_for


def fill(loan: isotherm.Loan, sample: isotherm.Records) -> None:
    loan.timestamp_ns, loan.interval_ns = int(sample["timestamp_ns"]), int(sample["interval_ns"])
    for triad, values in ((loan.accelerometers, sample["accelerometers"]), (loan.gyroscopes, sample["gyroscopes"])):
        triad.positive_pulses = values["positive_pulses"]
        triad.negative_pulses = tuple(values["negative_pulses"].tolist())
        triad.head_temperature = values["head_temperature"].tolist()
        triad.board_temperature = values["board_temperature"]


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
            acquisition.prepare()
            loan = acquisition.loan()
            fill(loan, recorded[index])
            assert loan.session == acquisition.session
            assert (loan.to_numpy()["accelerometers"]["positive_pulses"] == recorded[index]["accelerometers"]["positive_pulses"]).all()
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


SENSORS = ("A1", "A2", "A3", "G1", "G2", "G3")
TRIADS = ("accelerometers", "gyroscopes")


def heads(sample: isotherm.Records) -> list[float]:
    return [float(head) for triad in TRIADS for head in sample[triad]["head_temperature"]]


def test_a_whole_imu_equals_the_replay(domain: DomainUnderTest, whole_table: isotherm.Table, whole: isotherm.Records) -> None:
    domain.serve_whole()
    right = isotherm.replay(whole_table, whole)
    assert np.isfinite(right["angle_increment"]).all() and not (right["flags"] & isotherm.Flags.LAG_UNKNOWN).any()
    soaked = whole.copy()
    soaked["lag_ns"] = 240_000_000_000
    for triad in TRIADS:
        soaked[triad]["head_lagged"] = soaked[triad]["head_temperature"]
    assert not same(right, isotherm.replay(whole_table, soaked))
    with isotherm.Acquisition("imu-g", timeout=TIMEOUT, serial=" SN 42\n") as acquisition:
        assert acquisition.lag_ns == 240_000_000_000
        assert same(acquisition.run(whole, timeout=TIMEOUT), right)
        # The samples' own lagged temperature is sent as it is.
        assert same(acquisition.run(soaked, timeout=TIMEOUT), isotherm.replay(whole_table, soaked))
        # One by one, with readings as they come.
        acquisition.begin_session()
        acquisition.soaked()
        for index, sample in enumerate(whole):
            if index % 20 == 0:
                for name, head in zip(SENSORS, heads(sample), strict=True):
                    acquisition.reading(name, head, int(sample["timestamp_ns"]))
            loan = acquisition.loan()
            fill(loan, sample)
            assert (loan.lag_ns, loan.device) == (0, 0)
            increment = acquisition.compensate(loan, TIMEOUT)
            assert same(increment.to_numpy().reshape(1), right[index : index + 1])
            assert increment.angle_increment == tuple(right[index]["angle_increment"].tolist())
        assert "angle_increment" in repr(increment)


def test_every_peculiarity_of_a_sample(domain: DomainUnderTest, whole_table: isotherm.Table) -> None:
    """Against increments in IEEE double, of another hand than this code."""
    domain.serve_whole()
    recorded = isotherm.read_recording(WHOLE_RUN)
    right = pd.read_csv(WHOLE_RUN.with_suffix(".double.csv"), float_precision="round_trip")
    with isotherm.Acquisition("imu-g", timeout=TIMEOUT, serial="SN 42") as acquisition:
        for got in (acquisition.run(recorded, timeout=TIMEOUT), isotherm.replay(whole_table, recorded)):
            assert got["sequence"].tolist() == right["sequence"].tolist()
            for name, columns in (("velocity_increment", "a{}_dv"), ("angle_increment", "g{}_da")):
                exact = right[[columns.format(axis) for axis in (1, 2, 3)]].to_numpy()
                same_bits = got[name].view(np.uint64) == exact.view(np.uint64)
                assert (same_bits | (np.isnan(got[name]) & np.isnan(exact))).all()
            delivery = int(isotherm.Flags.LOST | isotherm.Flags.LATE)
            assert ["|".join(isotherm.flag_names(flags & ~delivery)) or "-" for flags in got["flags"].tolist()] == right["flags"].tolist()


def test_the_lag_and_its_state(domain: DomainUnderTest, whole: isotherm.Records) -> None:
    domain.serve_whole()
    for lag, lag_ns in (("service", 240_000_000_000), (10.0, 10_000_000_000), (1, 1_000_000_000), (None, 0)):
        with isotherm.Acquisition("imu-g", timeout=TIMEOUT, lag=lag) as acquisition:  # type: ignore[arg-type]
            assert acquisition.lag_ns == lag_ns
            assert acquisition.lag_state() == [None] * 6
    for wrong in (0.0, 86_401.0, float("nan"), "none", [1.0]):
        with pytest.raises(ValueError, match="lag|time constant"):
            isotherm.Acquisition("imu-g", timeout=TIMEOUT, lag=wrong)  # type: ignore[arg-type]
    with isotherm.Acquisition("imu-g", timeout=TIMEOUT, lag=10.0) as acquisition:
        acquisition.reading("A1", 2.0, 1_000_000_000)
        acquisition.reading("A1", float("nan"), 2_000_000_000)
        acquisition.reading("A1", 2.5, 2_000_000_000)
        state = acquisition.lag_state()
        assert state[0] is not None and state[0][:2] == (2_000_000_000, 2.5) and 2.0 < state[0][2] < 2.1
        assert state[1:] == [None] * 5
        acquisition.begin_session()
        assert acquisition.lag_state() == [None] * 6
        acquisition.restore_lag(json.loads(json.dumps(state)))
        assert acquisition.lag_state() == state
        # As it was kept before it had the start of the machine.
        acquisition.restore_lag([reading and reading[:4] for reading in state])
        assert acquisition.lag_state() == state
        # Of the time before the machine was started anew.
        acquisition.restore_lag([reading and (*reading[:4], reading[4] ^ 1) for reading in state])
        assert acquisition.lag_state() == [None] * 6
        acquisition.restore_lag(state)
        for name in ("A4", "a1", ""):
            with pytest.raises(ValueError, match="not a sensor"):
                acquisition.reading(name, 2.0, 1)
        for kept in ([None] * 5, [(1, 2.0)] + [None] * 5, [(-1, 2.0, 2.0)] + [None] * 5, None, [3.0] * 6):
            with pytest.raises((ValueError, TypeError, OverflowError)):
                acquisition.restore_lag(kept)  # type: ignore[arg-type]
        assert acquisition.lag_state() == state
        assert isotherm.Flags.LAG_UNKNOWN & acquisition.compensate(whole[0], TIMEOUT).flags
    # One reading of all sensors. A loan has no temperature until it is filled in.
    with isotherm.Acquisition("imu-g", timeout=TIMEOUT) as acquisition:
        acquisition.soaked()
        acquisition.reading_of_all(2.5, 1_000_000_000)
        assert [reading and reading[:3] for reading in acquisition.lag_state()] == [(1_000_000_000, 2.5, 2.5)] * 6
        loan = acquisition.loan()
        loan.interval_ns = 50_000_000
        for triad in (loan.accelerometers, loan.gyroscopes):
            assert np.isnan([triad.head_temperature, triad.board_temperature]).all()
        increment = acquisition.compensate(loan, TIMEOUT)
        assert np.isnan(increment.velocity_increment).all() and "a1-not-finite" in isotherm.flag_names(increment.flags)
    assert isotherm.device("SN 42") == 0x46A7426EF29CC83B and isotherm.device(" ") == 0


def test_a_reload_with_another_time_constant(domain: DomainUnderTest, whole: isotherm.Records) -> None:
    domain.serve_whole()
    text = WHOLE_TABLE.read_text().replace("time_constant_s = 240.0", "time_constant_s = 60.0")
    with isotherm.Acquisition("imu-g", timeout=TIMEOUT) as acquisition:
        sequence, flags = 0, []

        def send() -> bool:
            nonlocal sequence
            sample = whole[sequence % 400].copy()
            sample["sequence"] = sequence
            for name, head in zip(SENSORS, heads(sample), strict=True):
                acquisition.reading(name, head, 50_000_000 * (sequence + 1))
            sequence += 1
            increment = acquisition.compensate(sample, TIMEOUT)
            flags.append(bool(increment.flags & isotherm.Flags.LAG_UNKNOWN))
            return increment.table == isotherm.Table.parse(text).id and not flags[-1]

        acquisition.soaked()
        assert not send() and not flags[-1]
        staged = domain.folder / "staged.toml"
        staged.write_text(text)
        staged.rename(domain.folder / "imu-g.toml")
        wait_for(send, "the time constant of the new table")
        assert acquisition.lag_ns == 60_000_000_000 and any(flags)


# Sends the samples from BEGIN to END, one reading of each sensor in 20 samples. START says what it knows of the lag.
ACQUISITION = """
import json, os, sys, numpy as np, isotherm
samples, (begin, end), start = np.load("samples.npy"), map(int, sys.argv[1:3]), sys.argv[3]
with isotherm.Acquisition("imu-g", timeout=20.0) as acquisition:
    if start == "state":
        with open("lag.json") as file:
            acquisition.restore_lag(json.load(file))
    elif start == "soaked":
        acquisition.soaked()
    for sample in samples[begin:end]:
        if sample["sequence"] % 20 == 0:
            heads = [head for triad in ("accelerometers", "gyroscopes") for head in sample[triad]["head_temperature"]]
            for name, head in zip(("A1", "A2", "A3", "G1", "G2", "G3"), heads):
                acquisition.reading(name, head, int(sample["timestamp_ns"]))
            with open("lag.json.new", "w") as file:
                json.dump(acquisition.lag_state(), file)
            os.rename("lag.json.new", "lag.json")
        acquisition.send(sample)
        while acquisition.in_flight > 50 or acquisition.in_flight and sample["sequence"] == end - 1:
            if acquisition.receive(20.0) is None:
                sys.exit("no answer")
    print("done", flush=True)
    sys.stdin.read()
"""


def run_and_kill(domain: DomainUnderTest, begin: int, end: int, start: str) -> None:
    """Runs an acquisition process, and kills it while it waits for more."""
    child = domain.start(sys.executable, "-c", ACQUISITION, str(begin), str(end), start, stdin=subprocess.PIPE, cwd=domain.folder)
    assert child.stdout is not None and child.stdout.readline() == "done\n"
    child.kill()
    child.wait()


def test_a_killed_process_hands_its_lag_over(domain: DomainUnderTest, whole_table: isotherm.Table, whole: isotherm.Records) -> None:
    domain.serve_whole()
    right = isotherm.replay(whole_table, whole)
    np.save(domain.folder / "samples.npy", whole)
    with isotherm.IncrementReader("imu-g", timeout=TIMEOUT) as reader:
        for begin in range(0, 400, 100):
            run_and_kill(domain, begin, begin + 100, "state" if begin else "soaked")
            assert same(reader.read_available(), right[begin : begin + 100])


def test_a_killed_process_that_hands_nothing_over(domain: DomainUnderTest, whole: isotherm.Records) -> None:
    """It is flagged for three time constants, unless it says that the IMU is soaked."""
    text = WHOLE_TABLE.read_text().replace("time_constant_s = 240.0", "time_constant_s = 1.0")
    table = domain.folder / "imu-g.toml"
    table.write_text(text)
    domain.spawn("--imu", f"imu-g={table}").wait_until_ready()
    np.save(domain.folder / "samples.npy", whole)
    right = isotherm.replay(isotherm.Table.parse(text), whole)
    soaked = isotherm.replay(isotherm.Table.parse(text), whole[100:200])
    lag_unknown = np.uint64(isotherm.Flags.LAG_UNKNOWN)
    with isotherm.IncrementReader("imu-g", timeout=TIMEOUT) as reader:
        run_and_kill(domain, 0, 100, "soaked")
        assert same(reader.read_available(), right[:100])
        run_and_kill(domain, 100, 200, "unknown")
        got = reader.read_available()
        # The temperatures are read each second: for the fourth time with the 60th sample.
        assert ((got["flags"] & lag_unknown) != 0).tolist() == [True] * 60 + [False] * 40
        # Then the unknown start has a share of 5 % left in the lag, which is that of a soaked one.
        assert same(got[60:], soaked[60:]) and not same(got[:60], soaked[:60])
        run_and_kill(domain, 100, 200, "soaked")
        assert same(reader.read_available(), soaked)
    assert domain.status()["imus"][0]["flagged"]["lag-unknown"] == 60


def test_a_killed_service_changes_no_lag(domain: DomainUnderTest, whole_table: isotherm.Table, whole: isotherm.Records) -> None:
    service = domain.serve_whole()
    with isotherm.Acquisition("imu-g", timeout=TIMEOUT) as acquisition:
        acquisition.soaked()
        got = []
        for index, sample in enumerate(whole):
            if index % 20 == 0:
                for name, head in zip(SENSORS, heads(sample), strict=True):
                    acquisition.reading(name, head, int(sample["timestamp_ns"]))
            if index % 100 == 50:
                service.pause()
            if index % 100 == 80:
                assert acquisition.in_flight == 30
                service.kill()
                service = domain.serve_whole()
            acquisition.send(sample)
            while index % 100 not in range(50, 80) and acquisition.in_flight:
                increment = acquisition.receive(TIMEOUT)
                assert increment is not None
                got.append(increment.to_numpy())
    assert same(np.array(got, isotherm.INCREMENT), isotherm.replay(whole_table, whole))


def test_samples_of_another_device_are_flagged(domain: DomainUnderTest, whole: isotherm.Records) -> None:
    table = domain.folder / "imu-g.toml"
    table.write_text(WHOLE_TABLE.read_text().replace("gravity =", 'serial = "SN 42"\ngravity ='))
    assert isotherm.Table.load(table).device == isotherm.device("SN 42")
    domain.spawn("--imu", f"imu-g={table}").wait_until_ready()
    for serial, other in (("SN 42", False), ("SN 43", True), (None, False), (" ", False)):
        with isotherm.Acquisition("imu-g", timeout=TIMEOUT, serial=serial) as acquisition:
            increment = acquisition.compensate(whole[0], TIMEOUT)
            assert bool(increment.flags & isotherm.Flags.OTHER_DEVICE) == other, serial
            assert bool(acquisition.run(whole[:3])["flags"][2] & np.uint64(isotherm.Flags.OTHER_DEVICE)) == other


def test_a_sent_sample_cannot_be_touched(domain: DomainUnderTest, recorded: isotherm.Records) -> None:
    domain.serve()
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        loan = acquisition.loan()
        fill(loan, recorded[0])
        copy, gyroscopes = loan.to_numpy(), loan.gyroscopes
        assert not loan.sent
        acquisition.send(loan)
        assert loan.sent and repr(loan) == "Loan(sent)"
        # The copy owns its memory. No other object refers to the transport's memory.
        assert copy["interval_ns"] == recorded[0]["interval_ns"]
        uses: list[Callable[[], object]] = [
            lambda: loan.sequence,
            lambda: setattr(loan, "interval_ns", 1),
            lambda: setattr(loan.accelerometers, "positive_pulses", (1, 2, 3)),
            lambda: loan.accelerometers.head_temperature,
            lambda: loan.lag_ns,
            lambda: setattr(gyroscopes, "head_lagged", (1.0, 2.0, 3.0)),
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


def test_a_dropped_loan_is_a_gap_and_a_cancelled_one_is_none(domain: DomainUnderTest, recorded: isotherm.Records) -> None:
    domain.serve()
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        first, dropped = acquisition.loan(), acquisition.loan()
        assert (first.sequence, dropped.sequence) == (0, 1)
        assert not acquisition.compensate(first, TIMEOUT).flags & isotherm.Flags.LOST
        del dropped
        assert acquisition.lost == 1
        cancelled = acquisition.loan()
        cancelled.cancel()
        with pytest.raises(isotherm.Closed):
            cancelled.cancel()
        kept, later = acquisition.loan(), acquisition.loan()
        kept.interval_ns, later.interval_ns = 1000, 500
        with pytest.raises(ValueError, match="itself"):
            kept.merge(kept)
        kept.merge(later)
        assert later.sent and (kept.sequence, kept.interval_ns) == (2, 1500)
        assert isotherm.flag_names(acquisition.compensate(kept, TIMEOUT).flags & isotherm.Flags.LOST) == ["gap"]
        assert acquisition.loan().sequence == 3
        # A record keeps its number, sent or handed back, and takes none.
        record = recorded[0].copy()
        record["sequence"] = 10
        assert acquisition.compensate(record, TIMEOUT).sequence == 10
        with pytest.raises(isotherm.SequenceError):
            acquisition.send(record)
        last = acquisition.loan()
        assert last.sequence == 11
        last.cancel()
        assert acquisition.close() == (8, 0) and acquisition.close() == (0, 0)


def test_late_answers_are_kept(domain: DomainUnderTest, recorded: isotherm.Records, caplog: pytest.LogCaptureFixture) -> None:
    service = domain.serve()
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        service.pause()
        for index in (0, 1):
            with pytest.raises(isotherm.Timeout):
                acquisition.compensate(recorded[index], 0.0 if index else 0.01)
        service.resume()
        assert acquisition.compensate(recorded[2], TIMEOUT).sequence == 2
        assert acquisition.in_flight == 0 and acquisition.dropped_answers == 0
        assert [late.sequence for late in iter(acquisition.receive, None)] == [0, 1]
        # A run gives the answers to its own samples only.
        service.pause()
        with pytest.raises(isotherm.Timeout):
            acquisition.compensate(recorded[3], 0.0)
        service.resume()
        assert acquisition.compensate(recorded[4], TIMEOUT).sequence == 4
        assert acquisition.run(recorded[5:20], timeout=TIMEOUT, new_session=False)["sequence"].tolist() == list(range(5, 20))
        service.pause()
        acquisition.send(recorded[30])
        assert acquisition.close() == (10, 1)
        assert "10 control periods that were not sent, and 1 unanswered samples" in caplog.text
        service.resume()


def test_one_call_serves_a_period(domain: DomainUnderTest, recorded: isotherm.Records) -> None:
    service = domain.serve()
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT, kept=100) as acquisition:
        assert acquisition.exchange(recorded[0], TIMEOUT)["sequence"].tolist() == [0]
        service.pause()
        count = acquisition.depth + 50
        for index in range(1, 1 + count):
            loan = acquisition.loan()
            fill(loan, recorded[index])
            assert len(acquisition.exchange(loan, 0.0)) == 0 and loan.sent
        assert (acquisition.kept, acquisition.lost) == (50, 0)
        service.resume()
        arrived = acquisition.exchange(recorded[1 + count], TIMEOUT)
        assert arrived["sequence"].tolist() == list(range(1, 2 + count)), "all of them, in the order of sending"
        with pytest.raises(isotherm.SequenceError):
            acquisition.exchange(recorded[0], TIMEOUT)
        assert acquisition.close() == (0, 0)
    with pytest.raises(ValueError, match="kept is 0"):
        isotherm.Acquisition("imu-a", kept=0)


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
            pulses, interval = loan.accelerometers.positive_pulses, loan.interval_ns
            later = recorded[acquisition.depth + 1]
            loan.merge(later)
            assert loan.accelerometers.positive_pulses == tuple((np.array(pulses) + later["accelerometers"]["positive_pulses"]).tolist())
            assert loan.interval_ns == interval + later["interval_ns"]
            assert loan.accelerometers.head_temperature == tuple(later["accelerometers"]["head_temperature"].tolist())
            before = loan.to_numpy()
            endless = later.copy()
            endless["interval_ns"] = 2**63
            with pytest.raises(OverflowError):
                loan.merge(endless)
            assert loan.to_numpy().tobytes() == before.tobytes()
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


def test_a_reader_waits_with_a_selector_and_knows_whether_the_service_lives(
    domain: DomainUnderTest, recorded: isotherm.Records
) -> None:
    with isotherm.IncrementReader("imu-a", timeout=None) as early:
        with pytest.raises(isotherm.NoService, match="seen at work"):
            early.heartbeat_age(timeout=0.0)
        with pytest.raises(isotherm.NoService):
            early.fileno()
    service = domain.serve()
    with isotherm.IncrementReader("imu-a", timeout=TIMEOUT) as reader, isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        selector = selectors.DefaultSelector()
        selector.register(reader, selectors.EVENT_READ)
        told: list[int] = []

        def is_told() -> bool:
            """Whether the service signals an increment; it does from when it has seen that somebody waits."""
            loan = acquisition.loan()
            fill(loan, recorded[0])
            acquisition.compensate(loan, TIMEOUT)
            is_readable = bool(selector.select(0.001))
            told.extend(reader.read_available()["sequence"].tolist())
            return is_readable

        wait_for(is_told, "the service's notification")

        def is_quiet() -> bool:
            told.extend(reader.read_available()["sequence"].tolist())
            return not selector.select(0.05)

        wait_for(is_quiet, "the last notification is seen")
        assert told == list(range(len(told)))
        for _ in range(10):
            loan = acquisition.loan()
            fill(loan, recorded[0])
            sequence = acquisition.compensate(loan, TIMEOUT).sequence
            assert selector.select(TIMEOUT)
            assert reader.read_available()["sequence"].tolist() == [sequence]
        wait_for(lambda: reader.heartbeat_age() < 0.5, "a heartbeat")
        service.kill()
        wait_for(lambda: reader.heartbeat_age() > 2.0, "no heartbeat")


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
        with pytest.raises(ValueError, match="not a valid name"):
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
        with pytest.raises(ValueError, match="whole numbers"):
            loan.accelerometers.positive_pulses = (1, 2, 2**32)
        for values in ((1, 2), (1, 2, 3, 4), ()):
            with pytest.raises(ValueError, match="three whole numbers"):
                loan.accelerometers.negative_pulses = values
        for wrong in (("a", 1.0, 2.0), 3.0, None):
            with pytest.raises(TypeError):
                loan.accelerometers.head_temperature = wrong  # type: ignore[assignment]
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
    hot["accelerometers"]["head_temperature"][1, 0] = np.nan
    foreign = hot.astype(hot.dtype.newbyteorder())
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        for samples in (hot, foreign, foreign[::-1][::-1], np.concatenate([hot, hot])[:3]):
            got = acquisition.run(samples, timeout=TIMEOUT)
            assert same(got, isotherm.replay(table, hot))
            assert isotherm.flag_names(int(got["flags"][1]) & ~int(isotherm.Flags.GAP | isotherm.Flags.LATE)) == ["a1-not-finite"]
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


def test_an_array_may_be_changed_while_a_call_works_with_it(
    domain: DomainUnderTest, recorded: isotherm.Records, table: isotherm.Table
) -> None:
    domain.serve()
    samples = recorded[:100].copy()
    changed = threading.Event()

    def change() -> None:
        with isotherm.IncrementReader("imu-a", timeout=TIMEOUT) as reader:
            ready.set()
            assert reader.receive(TIMEOUT) is not None
            samples.view(np.uint8)[:] = 0
            changed.set()

    ready = threading.Event()
    thread = threading.Thread(target=change)
    thread.start()
    assert ready.wait(TIMEOUT)
    with isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        # Half a second: the array changes after the first of the samples.
        got = acquisition.run(samples, rate=200.0, timeout=TIMEOUT)
    thread.join()
    assert changed.is_set() and not samples.view(np.uint8).any()
    assert same(got, isotherm.replay(table, recorded[:100]))


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
