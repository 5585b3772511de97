# The native module. Users import `isotherm` only.

import os
from collections.abc import AsyncIterator, Callable, Iterator, Mapping, Sequence
from types import TracebackType
from typing import Any, Final, Literal, Self, final, overload

import numpy as np
import numpy.typing as npt

from ._curves import Curve as PublicCurve
from ._records import Records

_Bytes = npt.NDArray[np.uint8]
_Doubles = npt.NDArray[np.float64]
_Path = str | os.PathLike[str]
_Triple = tuple[float, float, float]
_Pulses = Sequence[int] | npt.NDArray[np.integer[Any]]
_Temperature = Sequence[float] | npt.NDArray[np.floating[Any]]
_Progress = Callable[[int, int], object] | None
_Lagged = tuple[int, float, float, float, int]

__all__ = [
    "FLAGS",
    "Acquisition",
    "Axis",
    "Batch",
    "Calibration",
    "Comparison",
    "Curve",
    "Exported",
    "Increment",
    "IncrementReader",
    "Loan",
    "Polynomial",
    "Stability",
    "Table",
    "Triad",
    "__version__",
    "batch",
    "calibrate_campaign",
    "calibrate_vehicle",
    "calibrate_warm_up",
    "compare",
    "convert",
    "device",
    "export_parameters",
    "export_vehicle",
    "import_parameters",
    "lengths",
    "noise",
    "noise_of_rates",
    "read_increments",
    "read_recording",
    "read_text",
    "regress",
    "replay",
    "restored",
    "screen",
    "time_warnings",
    "verify",
    "write_increments",
    "write_recording",
    "write_ros",
    "write_texts",
]

__version__: Final[str]
FLAGS: Final[list[tuple[int, str]]]

@final
class Acquisition:
    """The one acquisition process of an IMU. Only the thread that created it may use it.

    Waits up to `timeout` seconds for the service of `domain` (without a name that of ISOTHERM_DOMAIN, otherwise
    "default").

    `serial` is the serial number of the device whose samples it sends. `lag` says which time constant their lagged
    temperature has: "service" that of the table in force, a number [s], or None: the library keeps no lag then. `kept`
    is how many control periods wait at most for a service that has no room or is away; each takes 256 bytes.
    `resolution` is what one pulse over the nominal interval of the table stands for [m/s2, rad/s], such as (1e-6,
    1e-7), if the samples are readings: then `fill` makes their pulses. Raises IsothermError if those are not the
    table's.

    >>> samples = isotherm.read_recording("run.csv")
    >>> with isotherm.Acquisition("imu-a", timeout=5.0) as acquisition:
    ...     increments = acquisition.run(samples[:5])
    >>> increments["sequence"] == samples["sequence"][:5]
    array([ True,  True,  True,  True,  True])
    """

    def __new__(
        cls,
        imu: str,
        domain: str | None = None,
        timeout: float = 5.0,
        *,
        serial: str | None = None,
        lag: Literal["service"] | float | None = "service",
        kept: int = 16384,
        resolution: tuple[float, float] | None = None,
    ) -> Self: ...
    @property
    def imu(self) -> str:
        """The IMU."""
    @property
    def session(self) -> int:
        """The session of all samples; a new random number for each connection."""
    @property
    def depth(self) -> int:
        """The most samples that can be unanswered at once."""
    @property
    def in_flight(self) -> int:
        """Samples that have been sent and whose answers have not been received."""
    @property
    def closed(self) -> bool:
        """Whether it has been closed."""
    @property
    def lost(self) -> int:
        """Control periods that have a sequence and are gone, in all sessions: loans that were dropped, are still on loan,
        or failed, and periods for which the waiting line had no room. What waits is not lost: `kept`.
        """
    @property
    def dropped_answers(self) -> int:
        """Late answers that were dropped because `depth` of them waited for `receive` already."""
    def close(self) -> tuple[int, int]:
        """Leaves the streams. Loans that have not been sent become invalid. A second call does nothing.

        Returns `lost`, and how many samples are unanswered; if either is not 0 it is logged ("isotherm") and kept in
        the service's status.
        """
    def __enter__(self) -> Self: ...
    def __exit__(self, exception: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None, /) -> None: ...
    def fill(self, sample: Loan, specific_force: _Temperature, angular_rate: _Temperature | None = None) -> None:
        """Writes the pulses of a sample of readings: three of `specific_force` [m/s2], and of `angular_rate` [rad/s], each
        the mean over the interval of the sample. Without `angular_rate` the gyroscopes become absent: no pulses, and
        temperature NaN. What rounding leaves is carried to the next sample, so that nothing is lost over time.

        The pulses are those of the table in force, with the `resolution` of the acquisition, whatever your own interval
        is: the increment is right at any rate. An `interval_ns` of 0, as a loan has, becomes the nominal one. While no
        table is known, or its pulses stand for something else, samples are invalid: they are sent with temperatures of
        NaN, and a line on stderr says why.

        Raises ValueError with the name of the sensor, and changes nothing, for a reading that is not finite or over
        2**32 - 1 pulses.
        """
    def begin_session(self) -> None:
        """Begins a new session: the next sample may have any sequence. What the temperatures have been is not known then,
        unless the lag is restored, or the IMU said to be soaked, after this.

        Raises IsothermError if samples are unanswered or kept.
        """
    def reading(self, name: str, temperature: float, time_ns: int) -> None:
        """Takes a new reading of the head temperature of a sensor, A1 to G3, measured at `time_ns` on the acquisition's
        clock.

        Call it once for each new measurement, not for each sample. Every sample that is sent later carries the lagged
        temperature.
        """
    def reading_of_all(self, temperature: float, time_ns: int) -> None:
        """Takes a new reading of one head temperature that all sensors share, as of an IMU with one thermometer: as
        `reading` once for each of the six.
        """
    @property
    def lag_ns(self) -> int:
        """The time constant that samples are sent with [ns]; 0 while there is none."""
    def lag_state(self) -> list[_Lagged | None]:
        """The state of the lag, which `json` can keep: for each sensor None, or time, temperature and lagged temperature
        of its last reading, the share of an unknown start, and the number of the machine's start that the time is of.
        """
    def restore_lag(self, state: Sequence[Sequence[float] | None]) -> None:
        """Goes on with a state of `lag_state`, on the same clock, as if the temperature had gone straight on in the pause.

        A sensor that is None, or whose next reading is earlier than the kept one, is unknown as after `forget_lag`. So
        are all of a state that was kept before the machine was started anew. If your clock goes on over that, set the
        last number of each sensor to 0.
        """
    def forget_lag(self) -> None:
        """Informs the library that what the temperatures have been is not known, as is so already when the acquisition
        connects, and when it begins a session.

        Increments are flagged LAG_UNKNOWN, and computed without the transient terms, until the readings span three time
        constants.
        """
    def soaked(self) -> None:
        """Informs the library that the IMU is soaked: its temperatures have been those of the next readings for three time
        constants.

        Only what has just been powered, or has stood long enough, is. If it is not, the lagged temperature is wrong by
        the difference, which decays with the time constant, and no flag shows it.
        """
    def prepare(self) -> None:
        """Goes through the motions of sending a sample and receiving its increment, so that the next sample finds its way
        warm.

        Nobody else sees anything of it. Call it while you wait for the end of a control period, some tens of
        microseconds before it.
        """
    def loan(self) -> Loan:
        """Loans a sample in shared memory, to be filled in; session and sequence are set already, and every temperature is
        NaN. At most 4 at once.

        It stands for a control period. Its sequence is one above the highest that was loaned or sent; if it is not
        sent, the service flags the gap. `Loan.cancel` gives back one that stands for none.
        """
    def exchange(self, sample: Loan | Records | np.void, timeout: float) -> Records:
        """Serves a control period: sends all that waits, then `sample`, waits up to `timeout` seconds for its increment,
        and returns all increments that have arrived, each once and in the order of sending, as an array of INCREMENT.

        What the service has no room for waits in the memory of this process (`kept`), and a later call sends it. So a
        loop of only this call loses no control period while the service stalls, is away for as many periods as may be
        kept, or is replaced: fewer increments come then, or none, and later more than one. Give a time-out that is
        shorter than the control period. Raises SequenceError if the sequence is not above the last one sent or kept.
        """
    def send(self, sample: Loan | Records | np.void) -> None:
        """Sends a sample: a loan, or a record of RAW_SAMPLE, which is copied and keeps its sequence. Never waits.

        Raises Full, with the sample, if `depth` samples are unanswered, or samples are kept, which go first, or the
        service's queue may still be full of samples that were sent again after restarts. `keep` it then.
        """
    def keep(self, sample: Loan | Records | np.void) -> None:
        """Keeps a control period for which the service has no room: it waits in memory of this process, and is sent before
        all that comes later. `exchange` does this by itself.

        Beyond the number that the acquisition was given, the oldest is dropped and counts as `lost`: a gap for every
        reader. Raises SequenceError if the sequence is not above the last one sent or kept.
        """
    def send_kept(self) -> None:
        """Sends what is kept, oldest first, as far as the service takes it now; after an outage no faster than readers and
        recorders take it.

        Never waits. Every sending call begins with it.
        """
    @property
    def kept(self) -> int:
        """Control periods that wait: they are kept, and not sent yet."""
    def receive(self, timeout: float = 0.0) -> Increment | None:
        """The answer to the oldest unanswered sample, or None if it does not come within `timeout` seconds.

        First come the late answers that `compensate` has kept aside.
        """
    def compensate(self, sample: Loan | Records | np.void, timeout: float = 1.0) -> Increment:
        """The round trip of one sample: sends it and waits for its increment. Raises Full or Timeout.

        After Timeout the increment may come late: it is kept aside for `receive`, at most `depth` of them, and comes
        after later ones. Where order matters, use `exchange`.
        """
    def run(
        self,
        samples: object,
        *,
        window: int | None = None,
        timeout: float = 15.0,
        rate: float | None = None,
        new_session: bool = True,
    ) -> Records:
        """Sends an array of RAW_SAMPLE, or a data frame, and returns the increments in the same order, as `isotherm feed`
        does.

        At most `window` samples are in flight; `rate` is in samples per second. Raises Timeout if no answer comes for
        `timeout` seconds. If no sample has a `lag_ns`, their temperature is followed: a value that differs from the
        last one is a reading. With `new_session` the run is a session of its own; without it, its sequences must rise
        above those sent before.
        """

@final
class Loan:
    """A raw sample in shared memory, which is yours until it is sent. Every later use raises Closed.

    >>> with isotherm.Acquisition("imu-a") as acquisition:
    ...     sample = acquisition.loan()
    ...     sample.timestamp_ns = sample.interval_ns = 2_500_000
    ...     sample.accelerometers.positive_pulses = (140, 0, 150)
    ...     increment = acquisition.compensate(sample)
    ...     print(sample.sent, increment.interval_ns)
    True 2500000
    """

    @property
    def session(self) -> int:
        """The session of the sample: that of the acquisition."""
    @property
    def sequence(self) -> int:
        """Raise it if samples were lost before they could be sent; the service then flags the gap."""
    @sequence.setter
    def sequence(self, value: int) -> None: ...
    @property
    def timestamp_ns(self) -> int:
        """End of the control period on the acquisition's clock [ns]."""
    @timestamp_ns.setter
    def timestamp_ns(self, value: int) -> None: ...
    @property
    def interval_ns(self) -> int:
        """Control period, the measured gate length [ns], 1 to 3 600 000 000 000."""
    @interval_ns.setter
    def interval_ns(self, value: int) -> None: ...
    @property
    def telemetry_ns(self) -> int:
        """When the temperatures were read, on the acquisition's clock [ns]; 0 = unknown. The highest bit marks stale ones."""
    @telemetry_ns.setter
    def telemetry_ns(self, value: int) -> None: ...
    @property
    def lag_ns(self) -> int:
        """Time constant of the lagged temperature [ns]. 0 until it is sent, unless you fill it in."""
    @lag_ns.setter
    def lag_ns(self, value: int) -> None: ...
    @property
    def device(self) -> int:
        """Which unit this is: `device` of its serial number. 0 until it is sent, unless you fill it in."""
    @device.setter
    def device(self, value: int) -> None: ...
    @property
    def accelerometers(self) -> Triad:
        """A1, A2, A3."""
    @property
    def gyroscopes(self) -> Triad:
        """G1, G2, G3; where the IMU has none, no pulses and temperature NaN (or 0)."""
    @property
    def sent(self) -> bool:
        """Whether it has been sent."""
    def fill(self, sample: Records | np.void) -> None:
        """Copies all fields except the session from a record of RAW_SAMPLE, the sequence included."""
    def cancel(self) -> None:
        """Gives the loan back, as it stands for no control period: takes its sequence back, if it is the last loan's."""
    def merge(self, later: Loan | Records | np.void) -> None:
        """Adds the next control period: pulses and intervals are summed, timestamp and temperature become the later ones.

        A loan that is merged is cancelled. Raises OverflowError, and changes nothing, if a sum overflows. If the sum is
        dropped, that is one sequence, whatever it holds. For devices that sum by themselves.
        """
    def to_numpy(self) -> Records:
        """A copy, as an array without dimensions."""

@final
class Triad:
    """The accelerometers or the gyroscopes of a loan: three values each. It is part of the loan, and ends with it.

    >>> with isotherm.Acquisition("imu-a") as acquisition:
    ...     sample = acquisition.loan()
    ...     triad = sample.accelerometers
    ...     triad.positive_pulses = (140, 0, 150)
    ...     print(triad.positive_pulses)
    ...     sample.cancel()
    (140, 0, 150)
    """

    @property
    def positive_pulses(self) -> tuple[int, int, int]:
        """Pulses of the positive channels in the period."""
    @positive_pulses.setter
    def positive_pulses(self, values: _Pulses) -> None: ...
    @property
    def negative_pulses(self) -> tuple[int, int, int]:
        """Pulses of the negative channels in the period, counted upwards from 0."""
    @negative_pulses.setter
    def negative_pulses(self, values: _Pulses) -> None: ...
    @property
    def head_temperature(self) -> _Triple:
        """Temperature of the sensing elements, in the table's unit."""
    @head_temperature.setter
    def head_temperature(self, values: _Temperature) -> None: ...
    @property
    def board_temperature(self) -> _Triple:
        """Temperature of the converter boards, in the table's unit."""
    @board_temperature.setter
    def board_temperature(self, values: _Temperature) -> None: ...
    @property
    def head_lagged(self) -> _Triple:
        """The head temperature behind its lag. It is filled in when the sample is sent, if `lag_ns` is 0 then."""
    @head_lagged.setter
    def head_lagged(self, values: _Temperature) -> None: ...

@final
class Increment:
    """One increment.

    >>> samples = isotherm.read_recording("run.csv")
    >>> with isotherm.Acquisition("imu-a") as acquisition:
    ...     increment = acquisition.compensate(samples[0])
    >>> increment.sequence == int(samples[0]["sequence"]), bool(increment.flags & isotherm.Flags.INVALID)
    (True, False)
    """

    @property
    def session(self) -> int:
        """The session of the acquisition that sent the sample."""
    @property
    def sequence(self) -> int:
        """The number of the sample in its session."""
    @property
    def timestamp_ns(self) -> int:
        """End of the control period on the acquisition's clock [ns]."""
    @property
    def interval_ns(self) -> int:
        """Control period [ns]."""
    @property
    def velocity_increment(self) -> _Triple:
        """Along A1, A2, A3 [m/s]; NaN where it could not be computed."""
    @property
    def angle_increment(self) -> _Triple:
        """About G1, G2, G3 [rad]; NaN where it could not be computed, and where the table has no gyroscopes."""
    @property
    def specific_force(self) -> _Triple:
        """The mean over the interval [m/s2]; NaN where the velocity increment is NaN, and for an interval of 0."""
    @property
    def angular_rate(self) -> _Triple:
        """The mean over the interval [rad/s]; NaN where the angle increment is NaN, and for an interval of 0. Earth's rate
        is in it.
        """
    @property
    def table(self) -> int:
        """The `Table.id` of the table that was used; 0 without one."""
    @property
    def flags(self) -> int:
        """The bits of `Flags`."""
    @property
    def latency_ns(self) -> int:
        """Time from sending the sample to just before publishing [ns]."""
    def to_numpy(self) -> Records:
        """The same values as an array without dimensions."""

@final
class IncrementReader:
    """Reads the increments of one IMU as they are published. Only the thread that created it may use it.

    Waits up to `timeout` seconds for the service. With None it does not wait: it connects at once if the service is
    there, and otherwise in a later call. What is published before it is `connected` is not received.

    >>> with isotherm.IncrementReader("imu-a") as reader, isotherm.Acquisition("imu-a") as acquisition:
    ...     sent = acquisition.run(isotherm.read_recording("run.csv")[:3])
    ...     print(len(reader.read_available()), reader.receive(timeout=0.1))
    3 None
    """

    def __new__(cls, imu: str, domain: str | None = None, timeout: float | None = 5.0) -> Self: ...
    @property
    def imu(self) -> str:
        """The IMU."""
    @property
    def connected(self) -> bool:
        """Whether the stream has been found. Stays true when the service stops."""
    @property
    def repeats(self) -> int:
        """Increments that came again after a resend and were not returned."""
    @property
    def lost_before(self) -> int | None:
        """The control periods that are missing right before the increment that was returned last. None if that is unknown:
        where time steps, between sessions of different clocks, and before the first one. After `read_available` it is
        of the last one of the array.
        """
    def fileno(self) -> int:
        """A descriptor for `select`, `selectors` and `asyncio`: readable when increments may have come. Then call
        `receive` until it returns None, or `read_available`. Wait for at most some 0.1 s at once. Raises NoService
        while the reader is not connected.
        """
    def heartbeat_age(self, timeout: float = 2.0) -> float:
        """How long ago the service was last seen at work for this IMU [s]: under 0.3 while it lives.

        The first call waits for the service's status, up to about 1 s. Raises NoService if no service was seen at work
        within `timeout` seconds.
        """
    @property
    def closed(self) -> bool:
        """Whether it has been closed."""
    def close(self) -> None:
        """Leaves the stream. A second call does nothing."""
    def __enter__(self) -> Self: ...
    def __exit__(self, exception: type[BaseException] | None, value: BaseException | None, traceback: TracebackType | None, /) -> None: ...
    def receive(self, timeout: float = 0.0) -> Increment | None:
        """The next increment, or None if none comes within `timeout` seconds."""
    def read_available(self, limit: int | None = None) -> Records:
        """All increments that have come and were not read yet, at most `limit`; an empty array if there is none."""
    def __iter__(self) -> Iterator[Increment]:
        """Yields every increment when it comes; ends when the reader is closed."""
    def __aiter__(self) -> AsyncIterator[Increment]:
        """Yields every increment when it comes, in `async for`; ends when the reader is closed. The event loop sleeps meanwhile."""
    def __next__(self) -> Increment: ...

@final
class Table:
    """A valid coefficient table. `str()` gives the text of its file, without provenance. Two are equal if their digests
    are.

    >>> table = isotherm.Table.load("imu-a.toml")
    >>> table.imu, table.temperature_unit, [axis.name for axis in table.axes]
    ('imu-a', 'V', ['A1', 'A2', 'A3'])
    """

    @staticmethod
    def load(path: _Path) -> Table:
        """staticmethod(function) -> method

        Convert a function to be a static method.

        A static method does not receive an implicit first argument.
        To declare a static method, use this idiom:

             class C:
                 @staticmethod
                 def f(arg1, arg2, argN):
                     ...

        It can be called either on the class (e.g. C.f()) or on an instance
        (e.g. C().f()). Both the class and the instance are ignored, and
        neither is passed implicitly as the first argument to the method.

        Static methods in Python are similar to those found in Java or C++.
        For a more advanced concept, see the classmethod builtin.
        """
    @staticmethod
    def parse(text: str) -> Table:
        """staticmethod(function) -> method

        Convert a function to be a static method.

        A static method does not receive an implicit first argument.
        To declare a static method, use this idiom:

             class C:
                 @staticmethod
                 def f(arg1, arg2, argN):
                     ...

        It can be called either on the class (e.g. C.f()) or on an instance
        (e.g. C().f()). Both the class and the instance are ignored, and
        neither is passed implicitly as the first argument to the method.

        Static methods in Python are similar to those found in Java or C++.
        For a more advanced concept, see the classmethod builtin.
        """
    @property
    def imu(self) -> str:
        """The IMU that it is of."""
    @property
    def serial(self) -> str | None:
        """The serial number of the device, if it names one."""
    @property
    def gravity(self) -> float:
        """The value of 1 g0 [m/s2]."""
    @property
    def gravity_local(self) -> float | None:
        """Local gravity where the table was measured [m/s2], of its provenance. It is not part of the digest."""
    @property
    def temperature_unit(self) -> str:
        """The unit of all its temperatures, for example V or degC."""
    @property
    def out_of_range(self) -> str:
        """clamp, extrapolate or reject."""
    @property
    def max_age_s(self) -> float | None:
        """How old temperatures may be before increments are flagged TELEMETRY_STALE [s]; None for no limit."""
    @property
    def digest(self) -> str:
        """`sha256:` and 64 hexadecimal digits."""
    @property
    def id(self) -> int:
        """The first 8 bytes of the digest; every increment carries this number."""
    @property
    def axes(self) -> tuple[Axis, Axis, Axis]:
        """A1, A2, A3."""
    @property
    def alignment(self) -> list[list[float]] | None:
        """Body-frame increment = matrix * sensor increment."""
    @property
    def gyroscopes(self) -> tuple[Axis, Axis, Axis] | None:
        """G1, G2, G3, or None."""
    @property
    def gyroscope_alignment(self) -> list[list[float]] | None:
        """Body-frame angle increment = matrix * sensor increment."""
    @property
    def lag_s(self) -> float | None:
        """Time constant of the lagged temperature [s]."""
    @property
    def nominal_interval_s(self) -> float | None:
        """The control period that the scale factors are of [s]; None if they are of none."""
    @property
    def device(self) -> int:
        """The number of the device that it belongs to: `device(serial)`; 0 without a serial number."""
    def save(self, path: _Path) -> None:
        """Writes the table file, sealed by its digest, with the provenance of the text that it was read from."""
    @property
    def curves(self) -> dict[tuple[str, str], PublicCurve]:
        """The curves by sensor and quantity, as curves["A1", "bias"], with the errors that the provenance has."""
    def html(self) -> str:
        """The table as a page of HTML, with its curves."""
    def _repr_html_(self) -> str: ...
    def plot(self, *, axes: Any = None) -> Any:
        """Draws the curves with their bands: a row of axes for each sensor. Needs matplotlib; returns the axes."""
    def __eq__(self, other: object, /) -> bool: ...
    def __hash__(self) -> int: ...

@final
class Curve:
    """A curve of a table or calibration, as numbers."""

    @property
    def sensor(self) -> str: ...
    @property
    def quantity(self) -> str: ...
    @property
    def unit(self) -> str: ...
    @property
    def temperature_unit(self) -> str: ...
    @property
    def range(self) -> tuple[float, float]: ...
    @property
    def order(self) -> int: ...
    @property
    def points(self) -> list[list[float]]: ...
    def evaluate(self, temperature: _Doubles, whole: bool) -> tuple[_Doubles, _Doubles]: ...

@final
class Axis:
    """The coefficients of one accelerometer or gyroscope. Two are equal by name and coefficients, whatever table they are
    of.

    >>> axis = isotherm.Table.load("imu-a.toml").axes[0]
    >>> axis.name, axis.bias.unit, axis.positive_scale_factor.unit
    ('A1', 'ug0', 'pulse/(s*g0)')
    """

    @property
    def name(self) -> str:
        """A1, A2, A3, G1, G2 or G3."""
    @property
    def bias(self) -> Polynomial:
        """Bias against head temperature."""
    @property
    def transient(self) -> float:
        """What the bias has in addition for each unit of (lagged - present) head temperature, in `bias.unit`; 0 for none."""
    @property
    def positive_scale_factor(self) -> Polynomial:
        """K+ against board temperature."""
    @property
    def negative_scale_factor(self) -> Polynomial:
        """K- against board temperature, negative."""
    @property
    def max_rate(self) -> float | None:
        """Plausibility limit [pulse/s]."""
    @property
    def g_sensitivity(self) -> _Triple | None:
        """Of a gyroscope: what it indicates for specific force along each of the IMU's axes [deg/h/g0]."""

@final
class Polynomial:
    """A polynomial of temperature. A call evaluates it as the service does, inside its range or outside: a number gives a
    number, an array of any shape an array of that shape.

    `coefficients`, 1 to 8, are those of (temperature - `center`) / `scale`, c0 first; `range` is where it is
    calibrated, everywhere unless given; `unit` is that of its value. Raises ValueError for what cannot be. Two are
    equal if all of these are.

    >>> line = isotherm.Polynomial([1.5, 2.0], unit="mg0")
    >>> line(2.0), line(np.array([0.0, 1.0]))
    (5.5, array([1.5, 3.5]))
    """

    def __new__(
        cls,
        coefficients: Sequence[float] | _Doubles,
        *,
        center: float = 0.0,
        scale: float = 1.0,
        range: tuple[float, float] | None = None,
        unit: str = "",
    ) -> Self: ...
    @property
    def unit(self) -> str:
        """The unit of its value."""
    @property
    def coefficients(self) -> _Doubles:
        """The coefficients of (temperature - center) / scale, c0 first."""
    @property
    def center(self) -> float:
        """The temperature that is subtracted first."""
    @property
    def scale(self) -> float:
        """What the difference from `center` is divided by."""
    @property
    def range(self) -> tuple[float, float]:
        """Lower and upper end of the calibrated temperature."""
    @overload
    def __call__(self, temperature: float) -> float: ...
    @overload
    def __call__(self, temperature: npt.NDArray[Any]) -> _Doubles: ...

@final
class Stability:
    """Stability of an output by axis. The figures are of (mean of a window - specific force) [g0], over all windows that
    count.

    >>> table = isotherm.calibrate_turntable("campaign/campaign.toml").table
    >>> stability = isotherm.verify(table, isotherm.read_recording("still.csv"), attitude=(0.6, -0.48, 0.64))
    >>> [(bound, met) for bound, met, message in stability.judge("bias=100ug0,factor=5")]
    [('factor', True), ('bias', True)]
    """

    @property
    def sd_before(self) -> _Triple:
        """Standard deviation with the coefficients frozen at mid temperature."""
    @property
    def rms_before(self) -> _Triple:
        """Root mean square with the coefficients frozen at mid temperature."""
    @property
    def sd_after(self) -> _Triple:
        """Standard deviation of the full model."""
    @property
    def rms_after(self) -> _Triple:
        """Root mean square of the full model."""
    @property
    def factor(self) -> _Triple:
        """Ratio of the standard deviations, before / after."""
    @property
    def specific_force(self) -> _Triple:
        """The specific force, which is subtracted from the outputs [g0]."""
    @property
    def stated(self) -> bool:
        """Whether the attitude was given; otherwise it is the median of the output."""
    @property
    def left_out(self) -> int:
        """Samples without a valid interval."""
    @property
    def warning(self) -> str | None:
        """Why nothing can be claimed: the length of the output is far from gravity, or over 1 % of the windows are left
        out. Otherwise, None.
        """
    @property
    def findings(self) -> list[tuple[str, str]]:
        """What `isotherm verify` prints: severity and the rest of the line, without the recording."""
    @property
    def time_warning(self) -> str | None:
        """Where time is lost without a hole in `sequence`, or the intervals are wrong; otherwise None. `verdict["losses"]`
        has the counts.
        """
    @property
    def verdict(self) -> dict[str, Any]:
        """The errors that the run allows to be claimed: the document of `isotherm verify --json`, without a requirement.

        Each of `axes` and `length` has `constant_g0`, `variation_g0` and `worst_g0`, and `level` the same in `_rad`,
        each with `value` and `interval`, the half width of the 95 % interval. What cannot be judged is None: every
        constant error but that of the length if the attitude is not stated, and the length if local gravity is unknown.
        `covered` says which part of the table's range the run covers, the largest hole in it, and which channels the
        run drives. `gyroscopes`, where the table or the samples have any, has the same in `_deg_h`, and
        `random_walk_deg_sqrt_h`; or `not_judged`.
        """
    @property
    def windows(self) -> Records:
        """All windows, as WINDOW."""
    def judge(self, require: float | str) -> list[tuple[str, bool, str]]:
        """Judges each bound of `require`: (bound, whether the run shows that it is met, the judgement in words).

        `require` is as that of the command, for example "bias=20ug0,scale=50ppm,level=5arcsec,rate=0.1deg/h"; a number
        is the least factor of stability.
        """
    def check(self, require: float | str) -> None:
        """Raises StabilityError where `isotherm verify --require` ends with exit code 1.

        That is, if nothing can be claimed (see `warning`), if the run has fewer than 12 windows, or if a bound of
        `require` is not met. The message has a line for each reason; the last one has the remedies.
        """
    def html(self, *, require: float | str | None = None) -> str:
        """The report as HTML, with the judgement of what is required."""
    def _repr_html_(self) -> str: ...
    def plot(self, *, axes: Any = None) -> Any:
        """Draws the errors before and after compensation over time, for each axis. Needs matplotlib; returns the axes."""
    def report(self, path: _Path, *, require: float | str | None = None) -> None:
        """Writes the report (HTML), with the judgement of what is required."""

@final
class Calibration:
    @property
    def table(self) -> Table: ...
    @property
    def text(self) -> str: ...
    @property
    def accuracy(self) -> str: ...
    @property
    def gyroscope_accuracy(self) -> str | None: ...
    @property
    def summary(self) -> dict[str, Any]: ...
    @property
    def findings(self) -> list[tuple[str, int | None, str]]: ...
    def orders(self) -> str: ...
    def residuals(self) -> _Doubles: ...
    def dwells(self) -> list[tuple[float, int, int, int, float]]: ...
    def gyroscope_residuals(self) -> _Doubles: ...
    def gyroscope_runs(self) -> list[tuple[float, int, int, int, float]]: ...
    def html(self) -> str: ...
    def curves(self) -> list[Curve]: ...

@final
class Comparison:
    """What has changed between tables. `str()` gives the text of `isotherm compare`.

    >>> table = isotherm.Table.load("imu-a.toml")
    >>> isotherm.compare(table, table).changed
    []
    """

    @property
    def summary(self) -> dict[str, Any]:
        """The document of `isotherm compare --json`, without a requirement: curves, alignments, lines over the dates, and
        notes.
        """
    @property
    def changed(self) -> list[str]:
        """What has changed by more than the errors, for example ["A1 bias"]."""
    def judge(self, require: str) -> list[tuple[str, str, str]]:
        """Judges each bound of `require`: (curve or triad, "within", "undecided" or "beyond", the judgement in words).

        `require` is as that of the command, for example "bias=20ug0,scale=50ppm,alignment=20urad,rate=0.05deg/h".
        """
    def check(self, require: str) -> None:
        """Raises ComparisonError where `isotherm compare --require` ends with exit code 1: a difference is not within its
        bound.
        """
    def html(self, *, require: str | None = None) -> str:
        """The report as HTML, with the judgement of what is required."""
    def _repr_html_(self) -> str: ...
    def plot(self, *, axes: Any = None) -> Any:
        """Draws the difference of each curve, new less old, with its band. Needs matplotlib; returns the axes."""
    def report(self, path: _Path, *, require: str | None = None) -> None:
        """Writes the report (HTML), with the judgement of what is required."""

@final
class Batch:
    """The statistics of a batch of tables. `str()` gives them as text.

    >>> isotherm.batch(["imu-a.toml", "imu-b.toml"]).devices
    ['imu-a', 'imu-b']
    """

    @property
    def summary(self) -> dict[str, Any]:
        """The statistics, as `isotherm calibrate turntable --batch --json` prints them: each quantity with its unit,
        median, standard deviation and range.
        """
    @property
    def devices(self) -> list[str]:
        """The IMUs, in the order of the values."""
    @property
    def stand_outs(self) -> list[tuple[str, str, float]] | None:
        """(IMU, quantity, t) of each value that stands out from the others; None under five devices."""
    def html(self) -> str:
        """The report as HTML."""
    def _repr_html_(self) -> str: ...
    def plot(self, *, ax: Any = None) -> Any:
        """Draws how far each device is from the others, by quantity. Needs matplotlib; returns the axes."""
    def report(self, path: _Path) -> None:
        """Writes the report (HTML)."""

def compare(named: Sequence[tuple[str, Table]], other_device: bool) -> Comparison: ...
def batch(named: Sequence[tuple[str, Table]]) -> Batch: ...
def device(serial: str) -> int:
    """The number of the device with this serial number, which every sample carries; 0 for blanks.

    >>> isotherm.device(""), isotherm.device("SN 42") == isotherm.device("SN 43")
    (0, False)
    """

@final
class Exported:
    """The parameters of a table. `str()` gives the text.

    >>> table = isotherm.calibrate_warm_up("warm-up.BIN", "imu-c", lag="none").table
    >>> isotherm.export_parameters(table, to="ardupilot").text.splitlines()[-1]
    'INS_TCAL1_GYR3_Z 0.010818368'
    """

    @property
    def text(self) -> str:
        """The text of a .params or .parm file."""
    @property
    def lost(self) -> list[tuple[str, list[str], float | None, float | None]]:
        """What was left out: name, sensors, the size of accelerometers [m/s2] and of gyroscopes [rad/s], if any has it."""
    @property
    def difference(self) -> tuple[float, float | None]:
        """Largest difference over the range between what the firmware subtracts, in float32, and the written biases [m/s2;
        rad/s].
        """
    @property
    def notes(self) -> list[str]:
        """What you should also know."""

def export_parameters(
    table: Table,
    *,
    to: str,
    instance: int | None = None,
    device_id: int | tuple[int, int] | None = None,
    at: float | None = None,
    drop: Sequence[str] = ...,
) -> Exported:
    """The biases of a table in degC as parameters of an autopilot, as `isotherm export` writes them.

    `to` is "px4" or "ardupilot", `instance` the number of the IMU there: 0 to 3 of PX4, 1 to 5 of ArduPilot. PX4 needs
    the device number, or those of accelerometers and gyroscopes. Without them they are those of the log that made the
    table. With `at` [degC] ArduPilot's constants are written too: CALTEMP, and as OFFS the biases at that temperature.
    `drop` names what is left out: scale-temperature, negative-scale, alignment, lag, g-sensitivity, order, ranges.

    Raises TableError if the table has what parameters cannot say and is not dropped, with the size of what would be
    lost; ValueError for other arguments.

    >>> table = isotherm.calibrate_warm_up("warm-up.BIN", "imu-c", lag="none").table
    >>> print(isotherm.export_parameters(table, to="ardupilot").text.splitlines()[0])
    INS_TCAL1_ENABLE 1
    """

def import_parameters(
    text: str,
    autopilot: str,
    *,
    imu: str,
    interval: float,
    instance: int | None = None,
    gravity: float = 9.80665,
) -> Table:
    """The table of an autopilot's parameters ("px4", "ardupilot"), as `isotherm import` makes it: that of readings in m/s2
    and rad/s at the nominal `interval` [s], with the biases that the firmware subtracts. ArduPilot's are 0 at 35 degC
    unless the text has CALTEMP and OFFS.

    Raises TableError with all faults of the text.

    >>> table = isotherm.calibrate_warm_up("warm-up.BIN", "imu-c", lag="none").table
    >>> parameters = isotherm.export_parameters(table, to="ardupilot").text
    >>> isotherm.import_parameters(parameters, "ardupilot", imu="imu-d", interval=0.0025).imu
    'imu-d'
    """

def read_text(path: _Path) -> str: ...
def restored(kind: str, state: bytes) -> Any: ...
def screen(html: str) -> str: ...
def replay(table: Table, samples: _Bytes, progress: _Progress) -> _Bytes: ...
def time_warnings(table: Table, samples: _Bytes) -> list[str]: ...
def read_recording(paths: Sequence[_Path], imu: str | None, part: tuple[str | None, str | None]) -> tuple[_Bytes, list[str]]: ...
def read_increments(path: _Path, imu: str | None) -> tuple[_Bytes, list[str]]: ...
def write_recording(path: _Path, samples: _Bytes, imu: str) -> None: ...
def write_increments(path: _Path, increments: _Bytes, delivery: bool, imu: str) -> None: ...
def convert(
    source: _Path | bytes,
    first_row: int | None,
    mapping: tuple[_Path, str] | None,
    temperature: float | None,
    interval_ns: int | None,
    origin: tuple[str | None, str | None, str | None, _Path | None, str],
    session: int,
    instance: int | None,
    part: tuple[str | None, str | None],
    table: Table | None,
) -> tuple[_Bytes, list[str]]: ...
def write_texts(texts: list[tuple[_Path, str]]) -> None: ...
def write_ros(path: _Path, table: Table, increments: _Bytes, samples: _Bytes | None, table_file: _Path) -> None: ...
def regress(
    x: _Doubles,
    y: _Doubles,
    weights: _Doubles | None,
    linear: list[tuple[str, _Doubles]],
    max_order: int | None,
    min_effect: float | None,
) -> str: ...
def verify(
    table: Table,
    samples: _Bytes,
    window: float,
    attitude: Sequence[float] | None,
    angles: Sequence[float] | None,
    gravity_local: float | None,
    other_device: bool,
    accept: list[str],
    recording: str,
    progress: _Progress,
) -> Stability: ...
def noise(
    samples: _Bytes, table: Table | None, part: tuple[float, float], recording: str, progress: _Progress
) -> tuple[str, str, str | None, list[list[float]]]: ...
def noise_of_rates(rates: _Doubles, interval_s: float, temperature: _Doubles | None) -> tuple[str, str, list[float]]: ...
def calibrate_campaign(
    text: str,
    path: _Path,
    imu: str | None,
    recordings: Sequence[_Path | _Bytes] | None,
    is_tumble: bool,
    options: Mapping[str, Any],
    progress: _Progress,
) -> Calibration: ...
def calibrate_warm_up(
    recordings: Sequence[_Path | _Bytes],
    imu: str,
    nominal: Table | None,
    gravity: float | None,
    options: Mapping[str, Any],
    progress: _Progress,
) -> Calibration: ...
def calibrate_vehicle(
    logs: Sequence[_Path],
    imu: str,
    nominal: Mapping[int, Table],
    gravity: float | None,
    options: Mapping[str, Any],
    progress: _Progress,
) -> list[tuple[int, Calibration | None, Exception | None]]: ...
def export_vehicle(imus: Sequence[tuple[str, Table | None]], to: str, at: float | None, drop: Sequence[str]) -> Exported: ...
def lengths(
    table: Table,
    samples: _Bytes,
    window: float | None,
    gravity_local: float | None,
    other_device: bool,
    require: str | None,
    recording: str,
    progress: _Progress,
) -> tuple[dict[str, Any], str]: ...
