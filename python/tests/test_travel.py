"""Errors and results go from process to process, are copied and compared."""

from __future__ import annotations

import asyncio
import copy
import functools
import multiprocessing
import os
import pickle
import select
import subprocess
import tempfile
from collections.abc import Callable, Iterator
from concurrent.futures import ProcessPoolExecutor
from pathlib import Path
from typing import Any

import isotherm
import numpy as np
import pytest
from conftest import BINARY, CAMPAIGN, REPOSITORY, RUN, TABLE, TIMEOUT, WHOLE_CAMPAIGN, WHOLE_TABLE, DomainUnderTest

TUMBLE = REPOSITORY / "calibration/fit/tests/data/any_lab/xsens/recording.csv"
WARM_UP = REPOSITORY / "recording/formats/tests/data/autopilots/heating.BIN"
RAMPS = REPOSITORY / "recording/formats/tests/data/autopilots/drift.ulg"


def an_exception(kind: type[isotherm.IsothermError]) -> isotherm.IsothermError:
    arguments: dict[str, tuple[Any, ...]] = {
        "Full": (np.zeros(1, isotherm.RAW_SAMPLE)[0],),
        "Timeout": (np.zeros(3, isotherm.INCREMENT),),
        "TableError": ([(3, "bias", "is missing")],),
        "RecordingFault": (7,),
        "CalibrationError": ([("fault", 4, "[soak]: too short")],),
    }
    return kind("what, and the remedy", *arguments.get(kind.__name__, ()))


EXCEPTIONS = [value for value in vars(isotherm).values() if isinstance(value, type) and issubclass(value, isotherm.IsothermError)]


def tumble() -> isotherm.Calibration:
    campaign = {"imu": "imu-x", "gravity_local": 9.81, "gravity_reference": 9.81, "temperature_unit": "degC"}
    return isotherm.calibrate_tumble(campaign, TUMBLE, temperature_range=(0.0, 50.0))


def stability() -> isotherm.Stability:
    with tempfile.TemporaryDirectory() as folder:
        subprocess.run([BINARY, "simulate", "run", "-o", folder, "--interval", "1"], check=True, capture_output=True, timeout=200)
        still = isotherm.read_recording(f"{folder}/run.csv")
    return isotherm.verify(isotherm.calibrate_turntable(CAMPAIGN).table, still, attitude=(0.6, -0.48, 0.64))


def two_tables() -> tuple[isotherm.Table, isotherm.Table]:
    text = TABLE.read_text()
    return isotherm.Table.parse(text), isotherm.Table.parse(text.replace('"imu-a"', '"imu-b"'))


RESULTS: dict[str, Callable[[], Any]] = {
    "table": lambda: isotherm.Table.load(WHOLE_TABLE),
    "accelerometer": lambda: isotherm.Table.load(WHOLE_TABLE).axes[1],
    "gyroscope": lambda: isotherm.Table.load(WHOLE_TABLE).gyroscopes[2],  # type: ignore[index]
    "polynomial": lambda: isotherm.Table.load(TABLE).axes[0].bias,
    "own polynomial": lambda: isotherm.Polynomial([1.5, 2.0]),
    "turntable": lambda: isotherm.calibrate_turntable(CAMPAIGN),
    "turns": lambda: isotherm.calibrate_turntable(WHOLE_CAMPAIGN),
    "tumble": tumble,
    "warm-up": lambda: isotherm.calibrate_warm_up(WARM_UP, "imu-b", lag="none"),
    "vehicle": lambda: isotherm.calibrate_vehicle(WARM_UP, "imu-b", lag="none"),
    "stability": stability,
    "comparison": lambda: isotherm.compare(*two_tables(), other_device=True),
    "batch": lambda: isotherm.batch(two_tables()),
    "exported": lambda: isotherm.export_parameters(isotherm.calibrate_warm_up(WARM_UP, "imu-b", lag="none").table, to="ardupilot"),
    "flags": lambda: isotherm.Flags.LOST | isotherm.Flags.LATE,
    "noise": lambda: isotherm.noise(np.random.default_rng(1).normal(size=2000), interval=0.01),
    "lengths": lambda: isotherm.lengths(tumble().table, isotherm.read_recording(TUMBLE)),
}
@functools.cache
def made(name: str) -> Any:
    """The result of a name."""
    return RESULTS[name]()


# What changes, and so has no hash.
CHANGES = ("vehicle", "noise", "lengths")


@pytest.fixture(scope="module", params=RESULTS)
def result(request: pytest.FixtureRequest) -> Any:
    return request.param, made(request.param)


def same(value: Any) -> Any:
    return value


def raises(error: Exception) -> None:
    raise error


def shown(value: Any) -> Any:
    """What a result shows, which must not need what made it."""
    names = [name for name in dir(value) if not name.startswith("_")]
    plain = (str, int, float, tuple, list, dict, type(None))
    return [str(value), *(getattr(value, name) for name in names if isinstance(getattr(value, name), plain))]


def test_every_exception_is_pickled_copied_and_compared() -> None:
    assert len(EXCEPTIONS) == 16
    for kind in EXCEPTIONS:
        error = an_exception(kind)
        error.add_note("of a user")
        copies = [pickle.loads(pickle.dumps(error, protocol)) for protocol in range(2, 6)]
        for other in [*copies, copy.copy(error), copy.deepcopy(error)]:
            assert type(other) is kind and str(other) == "what, and the remedy" and vars(other).keys() == vars(error).keys()
            assert other == error and hash(other) == hash(error)
        assert error != kind("another") and error != ValueError("what, and the remedy")


def test_exceptions_of_the_library_are_pickled(tmp_path: Path) -> None:
    with pytest.raises(isotherm.TableError) as of_table:
        isotherm.Table.parse("format = 1\n")
    assert of_table.value.faults and pickle.loads(pickle.dumps(of_table.value)) == of_table.value
    (tmp_path / "bad.csv").write_text("sequence\nx\n")
    with pytest.raises(isotherm.RecordingFault) as of_recording:
        isotherm.read_recording(tmp_path / "bad.csv")
    other = pickle.loads(pickle.dumps(of_recording.value))
    assert other == of_recording.value and other.line == of_recording.value.line


def test_every_result_is_pickled_copied_and_compared(result: Any) -> None:
    name, value = result
    copies = [pickle.loads(pickle.dumps(value, protocol)) for protocol in range(2, 6)]
    for other in [*copies, copy.copy(value), copy.deepcopy(value)]:
        assert type(other) is type(value) and other == value and not other != value
        np.testing.assert_equal(shown(other), shown(value))
        if name not in CHANGES:
            assert hash(other) == hash(value)
    assert value != "another"


def test_a_calibration_in_another_process_is_whole(tmp_path: Path) -> None:
    for name in ("turns", "tumble", "warm-up"):
        calibration = made(name)
        other = pickle.loads(pickle.dumps(calibration))
        for each, folder in ((calibration, tmp_path / "a"), (other, tmp_path / "b")):
            folder.mkdir(exist_ok=True)
            each.save(folder / f"{name}.toml", report=folder / f"{name}.html")
        for suffix in ("toml", "html"):
            assert (tmp_path / "a" / f"{name}.{suffix}").read_bytes() == (tmp_path / "b" / f"{name}.{suffix}").read_bytes()
        assert other.orders == calibration.orders and other.provenance == calibration.provenance
        np.testing.assert_array_equal(other.residuals, calibration.residuals)
        np.testing.assert_array_equal(other.gyroscope_residuals, calibration.gyroscope_residuals)


def test_a_verification_in_another_process_judges() -> None:
    here = made("stability")
    other = pickle.loads(pickle.dumps(here))
    assert other.judge("bias=20ug0,factor=2") == here.judge("bias=20ug0,factor=2")
    assert (other.windows.tobytes(), other.verdict) == (here.windows.tobytes(), here.verdict)


@pytest.mark.parametrize("method", ["spawn", "fork", "forkserver"])
@pytest.mark.filterwarnings("ignore:.*fork:DeprecationWarning")
def test_all_go_through_pools(method: str) -> None:
    context = multiprocessing.get_context(method)
    errors, values = [an_exception(kind) for kind in EXCEPTIONS], {name: made(name) for name in RESULTS}
    with ProcessPoolExecutor(1, mp_context=context) as executor:
        failed = [executor.submit(raises, error) for error in errors]
        found = [executor.submit(same, value) for value in values.values()]
        assert [future.exception(TIMEOUT * 2) for future in failed] == errors
        assert [future.result(TIMEOUT * 2) for future in found] == list(values.values())
    with context.Pool(1) as pool:
        for error in errors:
            with pytest.raises(type(error)) as raised:
                pool.apply_async(raises, (error,)).get(TIMEOUT * 2)
            assert raised.value == error
        assert pool.map_async(same, values.values()).get(TIMEOUT * 2) == list(values.values())


@pytest.fixture
def cluster() -> Iterator[Any]:
    import distributed

    with distributed.LocalCluster(1, threads_per_worker=1, dashboard_address=None) as cluster, distributed.Client(cluster) as client:
        yield client


def test_all_go_through_dask(cluster: Any) -> None:
    errors, values = [an_exception(kind) for kind in EXCEPTIONS], {name: made(name) for name in RESULTS}
    cluster.run(lambda folder: __import__("sys").path.append(folder), str(Path(__file__).parent))
    failed = [cluster.submit(raises, error, pure=False) for error in errors]
    found = [cluster.submit(same, value, pure=False) for value in values.values()]
    assert [future.exception(TIMEOUT * 2) for future in failed] == errors
    assert [future.result(TIMEOUT * 2) for future in found] == list(values.values())


def test_one_bad_file_fails_one_job(tmp_path: Path) -> None:
    bad = tmp_path / "bad.csv"
    bad.write_text("sequence\nx\n")
    with ProcessPoolExecutor(2, mp_context=multiprocessing.get_context("spawn")) as executor:
        jobs = [executor.submit(isotherm.read_recording, path) for path in (RUN, bad, RUN)]
        assert isinstance(jobs[1].exception(TIMEOUT), isotherm.RecordingFault)
        assert jobs[0].result(TIMEOUT).tobytes() == jobs[2].result(TIMEOUT).tobytes() == isotherm.read_recording(RUN).tobytes()


def test_what_belongs_to_a_process_says_what_to_do(domain: DomainUnderTest) -> None:
    domain.serve()
    with isotherm.IncrementReader("imu-a", timeout=TIMEOUT) as reader, isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
        loan = acquisition.loan()
        for value in (reader, acquisition, loan, loan.accelerometers):
            for attempt in (pickle.dumps, copy.copy, copy.deepcopy):
                with pytest.raises(TypeError, match=f"{type(value).__name__} belongs to this process and cannot be pickled or copied: .*give "):
                    attempt(value)
        full = isotherm.Full("no room", loan)
        assert pickle.loads(pickle.dumps(full)).sample["sequence"] == loan.sequence
        increment = acquisition.compensate(loan, TIMEOUT)
        assert pickle.loads(pickle.dumps(increment)) == copy.copy(increment) == increment
        assert hash(copy.copy(increment)) == hash(increment)
        assert copy.copy(full).sample is None


def test_a_reader_gives_increments_to_async_for(domain: DomainUnderTest, recorded: isotherm.Records) -> None:
    domain.serve()

    async def read() -> list[int]:
        with isotherm.IncrementReader("imu-a", timeout=TIMEOUT) as reader, isotherm.Acquisition("imu-a", timeout=TIMEOUT) as acquisition:
            assert reader.heartbeat_age() < TIMEOUT
            got: list[int] = []

            async def consume() -> None:
                async for increment in reader:
                    got.append(increment.sequence)
                    if len(got) == 20:
                        reader.close()

            task = asyncio.create_task(consume())
            for sample in recorded[:20]:
                acquisition.compensate(sample, TIMEOUT)
                await asyncio.sleep(0)
            await asyncio.wait_for(task, TIMEOUT)
            return got

    assert asyncio.run(read()) == recorded["sequence"][:20].tolist()


def test_the_heartbeat_of_a_dead_service(domain: DomainUnderTest) -> None:
    service = domain.serve()
    with isotherm.IncrementReader("imu-a", timeout=TIMEOUT) as reader:
        service.kill()
        with pytest.raises(isotherm.NoService, match="seen at work"):
            reader.heartbeat_age(timeout=0.5)


def test_async_for_sleeps_until_the_descriptor_is_readable(monkeypatch: pytest.MonkeyPatch) -> None:
    from isotherm import _asynchronous

    monkeypatch.setattr(_asynchronous, "LOOK", 10 * TIMEOUT)
    read_end, write_end = os.pipe()

    class Fake:
        """Five increments, each when its byte has come."""

        closed, asked, left = False, 0, 5

        def fileno(self) -> int:
            return read_end

        def receive(self) -> int | None:
            self.asked += 1
            if not select.select([read_end], [], [], 0)[0]:
                return None
            self.left -= 1
            self.closed = not self.left
            return os.read(read_end, 1)[0]

    async def read() -> list[Any]:
        loop, got = asyncio.get_running_loop(), []
        loop.call_soon(os.write, write_end, b"\0")
        async for value in _asynchronous.increments(fake):  # type: ignore[arg-type]
            got.append(value)
            loop.call_soon(os.write, write_end, bytes([len(got)]))
        return got

    fake = Fake()
    try:
        assert asyncio.run(asyncio.wait_for(read(), TIMEOUT)) == [0, 1, 2, 3, 4]
    finally:
        os.close(read_end)
        os.close(write_end)
    # It asks before it sleeps and after it was woken, and at no other time.
    assert fake.asked == 10
