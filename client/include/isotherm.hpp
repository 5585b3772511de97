// Isotherm for C++17: isotherm.h with handles that close themselves, exceptions, durations and optionals.
//
//     isotherm::Acquisition acquisition("imu-a", {.serial = "SN 42"});     // from C++20 on; before, set the fields of an Options
//     while (const auto period = latch()) {                // your hardware: counts, temperature and times of a control period
//         acquisition.reading_of_all(period->temperature, period->end_ns);    // or reading() for each sensor that has its own
//         auto sample = acquisition.loan();                // in shared memory; stands for the period
//         sample->timestamp_ns = sample->telemetry_ns = period->end_ns;
//         sample->interval_ns = period->interval_ns;       // the measured gate length
//         sample->accelerometers = period->accelerometers; // pulses and temperature
//         sample->gyroscopes = period->gyroscopes;
//         for (const auto &increment : acquisition.exchange(sample, 1ms))
//             navigate(increment);                         // each once, in the order of sending; none is lost while the service is away
//     }
//
// Errors are thrown as isotherm::Error, with the code and message of isotherm.h. Results that are part of normal operation are
// returned: no increment yet, a full queue, no answer in time.
//
// With -fno-exceptions, or ISOTHERM_NO_EXCEPTIONS defined, nothing is thrown: what may fail returns a Result, and connect() takes
// the place of the constructors.
//
//     auto connected = isotherm::Acquisition::connect("imu-a");
//     if (!connected.ok())
//         return report(connected.error().what());
//     isotherm::Acquisition acquisition = std::move(connected).value();
//
// The rules for threads and processes are those of isotherm.h.
// Objects with a handle or a sample can be moved, but not copied. An object that has been moved from may be destroyed or assigned
// to; other calls throw Error with ISOTHERM_ERROR_NULL, or return 0 or false.
#ifndef ISOTHERM_HPP
#define ISOTHERM_HPP

#if __cplusplus < 201703L
#error "isotherm.hpp needs C++17: compile with -std=c++17 or later, or use isotherm.h"
#endif

#include "isotherm.h"

#include <array>
#include <chrono>
#include <cstdint>
#include <exception>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <type_traits>
#include <utility>

#if defined(__cpp_exceptions) && !defined(ISOTHERM_NO_EXCEPTIONS)
#define ISOTHERM_EXCEPTIONS 1
#else
#define ISOTHERM_EXCEPTIONS 0
#endif

namespace isotherm {

// Parts of one program may be compiled in different ways.
#if ISOTHERM_EXCEPTIONS
inline namespace throwing {
#else
inline namespace returning {
#endif

using Triad = isotherm_triad;
using RawSample = isotherm_raw_sample;
using CompensatedIncrement = isotherm_compensated_increment;
using Lag = isotherm_lag;
/// Three values: of A1, A2, A3 or G1, G2, G3.
using Vector = std::array<double, 3>;

/// An error: a code, usually negative, and its message.
class Error : public std::runtime_error {
public:
    Error(isotherm_code code, const std::string &message) : std::runtime_error(message), code_(code) {}

    isotherm_code code() const noexcept { return code_; }

private:
    isotherm_code code_;
};

#if ISOTHERM_EXCEPTIONS

/// What a function returns that may fail: it throws Error then.
template <class T>
using Result = T;

namespace detail {

/// What `make` makes of a code that is no error.
template <class T, class Make>
Result<T> result(isotherm_code code, Make make)
{
    if (code < 0)
        throw Error(code, isotherm_error_message());
    return make(code);
}

}  // namespace detail

#else

/// What a function returns that may fail: a value or an Error.
template <class T>
class [[nodiscard]] Result {
public:
    Result(T value) : value_(std::move(value)) {}
    Result(Error error) : error_(std::move(error)) {}

    /// Whether there is a value. (A Result has no conversion to bool, because a value may be false.)
    bool ok() const noexcept { return value_.has_value(); }
    /// The value; ends the program if there is none.
    T &value() & noexcept { return value_ ? *value_ : (std::terminate(), *value_); }
    T &&value() && noexcept { return std::move(value()); }
    /// The error; ends the program if there is none.
    const Error &error() const noexcept { return error_ ? *error_ : (std::terminate(), *error_); }

private:
    std::optional<T> value_;
    std::optional<Error> error_;
};

/// What a function returns that may fail and gives nothing.
template <>
class [[nodiscard]] Result<void> {
public:
    Result() = default;
    Result(Error error) : error_(std::move(error)) {}

    bool ok() const noexcept { return !error_.has_value(); }
    /// The error; ends the program if there is none.
    const Error &error() const noexcept { return error_ ? *error_ : (std::terminate(), *error_); }

private:
    std::optional<Error> error_;
};

namespace detail {

/// What `make` makes of a code that is no error.
template <class T, class Make>
Result<T> result(isotherm_code code, Make make)
{
    if (code < 0)
        return Error(code, isotherm_error_message());
    if constexpr (std::is_void_v<T>) {
        make(code);
        return {};
    } else {
        return make(code);
    }
}

}  // namespace detail

#endif

namespace detail {

inline Result<void> done(isotherm_code code)
{
    return result<void>(code, [](isotherm_code) {});
}

/// A time-out for connecting.
inline std::uint64_t patience(std::chrono::nanoseconds time) noexcept
{
    return time.count() > 0 ? static_cast<std::uint64_t>(time.count()) : ISOTHERM_NO_WAIT;
}

inline std::uint64_t count(std::chrono::nanoseconds time) noexcept
{
    return time.count() > 0 ? static_cast<std::uint64_t>(time.count()) : 0;
}

inline Result<std::optional<CompensatedIncrement>> some(isotherm_code code, const CompensatedIncrement &increment)
{
    return result<std::optional<CompensatedIncrement>>(
        code, [&](isotherm_code done) { return done == ISOTHERM_OK ? std::optional(increment) : std::nullopt; });
}

}  // namespace detail

/// How to reach a service, and what an acquisition reports to it. Readers use domain and time-out.
struct Options {
    /// The name of its domain. If it is not set, the environment variable ISOTHERM_DOMAIN names the domain, else it is "default".
    std::optional<std::string> domain = std::nullopt;
    /// How long connecting may take. This includes waiting for a service that has not started yet. 0 does not wait.
    std::chrono::nanoseconds timeout = std::chrono::seconds(5);
    /// Serial number of the device whose samples an acquisition sends, in UTF-8. The service flags samples of another device than the table's.
    std::optional<std::string> serial = std::nullopt;
    /// Time constant of the lagged temperature of an acquisition [s], 0.1 to 86400, or ISOTHERM_LAG_SERVICE or ISOTHERM_LAG_NONE.
    double lag_s = ISOTHERM_LAG_SERVICE;
    /// How many control periods of an acquisition wait at most for a service that has no room or is away, 1 to 2^20. Each takes 256 bytes.
    std::uint64_t kept = ISOTHERM_MOST_KEPT;
    /// What one pulse over the nominal interval of the table stands for [m/s2 and rad/s], such as 1e-6 and 1e-7, if the samples are readings:
    /// then Acquisition::fill makes their pulses. 0: they have pulses of their own.
    double accelerometer_resolution = 0, gyroscope_resolution = 0;

    const char *domain_or_null() const noexcept { return domain ? domain->c_str() : nullptr; }
};

/// A raw sample in shared memory, which is yours until it is sent. It stands for a control period: when this object is destroyed with a
/// sample that was not sent, the period is lost, and the service flags the gap. Acquisition::cancel gives back one that stands for none.
/// Destroy it before its acquisition. It is empty after the sample has been sent, kept, merged into another one, or cancelled.
class Sample {
public:
    Sample(Sample &&other) noexcept : acquisition_(other.acquisition_), raw_(std::exchange(other.raw_, nullptr)) {}
    Sample &operator=(Sample &&other) noexcept
    {
        std::swap(acquisition_, other.acquisition_);
        std::swap(raw_, other.raw_);
        return *this;
    }
    ~Sample()
    {
        if (raw_ != nullptr)
            isotherm_discard(acquisition_, raw_);
    }

    /// Whether it has a sample.
    explicit operator bool() const noexcept { return raw_ != nullptr; }
    RawSample &operator*() const noexcept { return *raw_; }
    RawSample *operator->() const noexcept { return raw_; }

private:
    friend class Acquisition;
    Sample(isotherm_acquisition *acquisition, RawSample *raw) noexcept : acquisition_(acquisition), raw_(raw) {}

    isotherm_acquisition *acquisition_;
    RawSample *raw_;
};

/// The increment of a round trip, or why there is none.
class Answer {
public:
    /// Whether there is an increment.
    explicit operator bool() const noexcept { return code_ == ISOTHERM_OK; }
    /// The service has no room, or samples that are kept go first; the sample has not been sent.
    bool is_full() const noexcept { return code_ == ISOTHERM_FULL; }
    /// The sample was sent, but its increment did not come in time. It is kept for a later receive().
    bool is_late() const noexcept { return code_ == ISOTHERM_TIMEOUT; }

    /// The increment; all fields are 0 if there is none.
    const CompensatedIncrement &operator*() const noexcept { return increment_; }
    const CompensatedIncrement *operator->() const noexcept { return &increment_; }
#if ISOTHERM_EXCEPTIONS
    /// The increment; throws Error (ISOTHERM_FULL, ISOTHERM_TIMEOUT) if there is none.
    const CompensatedIncrement &value() const
    {
        if (code_ != ISOTHERM_OK)
            throw Error(code_, is_full() ? "the service's queue is full, or samples that are kept go first; keep this one too" : "no answer from the service in time");
        return increment_;
    }
#endif

private:
    friend class Acquisition;
    isotherm_code code_ = ISOTHERM_OK;
    CompensatedIncrement increment_{};
};

/// Increments that have arrived: a range. It is valid until the next call of its acquisition.
class Increments {
public:
    const CompensatedIncrement *begin() const noexcept { return begin_; }
    const CompensatedIncrement *end() const noexcept { return begin_ + size_; }
    std::size_t size() const noexcept { return size_; }
    bool empty() const noexcept { return size_ == 0; }

private:
    friend class Acquisition;
    Increments(const CompensatedIncrement *begin, std::size_t size) noexcept : begin_(begin), size_(size) {}

    const CompensatedIncrement *begin_;
    std::size_t size_;
};

/// The one acquisition process of an IMU.
class Acquisition {
public:
    /// Connects, waiting for the service if necessary.
    [[nodiscard]] static Result<Acquisition> connect(const std::string &imu, const Options &options = {})
    {
        isotherm_acquisition *handle = nullptr;
        const char *serial = options.serial ? options.serial->c_str() : nullptr;
        const isotherm_options given = {sizeof(isotherm_options), options.domain_or_null(), detail::patience(options.timeout), serial,
                                        options.lag_s, options.kept, options.accelerometer_resolution, options.gyroscope_resolution};
        return detail::result<Acquisition>(isotherm_acquisition_connect(imu.c_str(), &given, &handle),
                                           [&](isotherm_code) { return Acquisition(handle); });
    }
#if ISOTHERM_EXCEPTIONS
    /// The same.
    explicit Acquisition(const std::string &imu, const Options &options = {}) : Acquisition(connect(imu, options)) {}
#endif

    /// Takes a new reading of a sensor's head temperature, measured at `time_ns` on your clock. `sensor` is 0 to 5 for A1, A2, A3, G1, G2, G3.
    /// Call it once for each new measurement of every sensor, not for each sample. Not part of the sending path.
    Result<void> reading(std::uint32_t sensor, double telemetry, std::uint64_t time_ns)
    {
        return detail::done(isotherm_reading(handle_.get(), sensor, telemetry, time_ns));
    }

    /// Takes a new reading of one head temperature that all sensors share, as of an IMU with one thermometer.
    Result<void> reading_of_all(double temperature, std::uint64_t time_ns)
    {
        return detail::done(isotherm_reading_of_all(handle_.get(), temperature, time_ns));
    }

    /// The time constant that samples are sent with [ns]; 0 while there is none.
    std::uint64_t lag_ns() const noexcept { return isotherm_lag_ns(handle_.get()); }

    /// The state of the lag. Save it after each reading if a successor of this process shall go on with it, together with boot().
    [[nodiscard]] Result<Lag> lag() const
    {
        Lag lag;
        return detail::result<Lag>(isotherm_save_lag(handle_.get(), &lag), [&](isotherm_code) { return lag; });
    }

    /// Goes on with a state that was saved, on the same clock. Call forget_lag() in its place if it was saved with another boot().
    Result<void> restore_lag(const Lag &saved) { return detail::done(isotherm_restore_lag(handle_.get(), &saved)); }

    /// Tells that what the temperatures have been is not known, as is so already when the acquisition connects, and when it begins a session.
    /// Increments are flagged ISOTHERM_FLAG_LAG_UNKNOWN until the readings span three time constants.
    Result<void> forget_lag() { return detail::done(isotherm_forget_lag(handle_.get())); }

    /// Tells that the IMU is soaked: its temperatures have been those of the next readings for three time constants.
    Result<void> soaked() { return detail::done(isotherm_soaked(handle_.get())); }

    /// Goes through the motions of sending a sample and receiving its increment, so that the next sample finds its way warm. Call it while you
    /// wait for the end of a control period, some tens of microseconds before it.
    Result<void> prepare() { return detail::done(isotherm_prepare(handle_.get())); }

    /// Loans a sample to fill in. `session` and `sequence` are set already: one above the highest that was loaned or sent. Every temperature is
    /// NaN until you set it.
    [[nodiscard]] Result<Sample> loan()
    {
        RawSample *raw = nullptr;
        return detail::result<Sample>(isotherm_loan(handle_.get(), &raw), [&](isotherm_code) { return Sample(handle_.get(), raw); });
    }

    /// Writes the pulses of a sample of readings: `specific_force` [m/s2], and `angular_rate` [rad/s] unless the IMU has no gyroscopes, each
    /// the mean over the interval of the sample. The pulses are those of the table in force, with the resolution of the options; an
    /// `interval_ns` of 0 becomes the nominal one. Throws Error (ISOTHERM_ERROR_VALUE), and changes nothing, for a reading that is not finite
    /// or over 2^32 - 1 pulses. See isotherm_fill.
    Result<void> fill(RawSample &sample, const Vector &specific_force, const std::optional<Vector> &angular_rate = std::nullopt)
    {
        return detail::done(
            isotherm_fill(handle_.get(), &sample, specific_force.data(), angular_rate ? angular_rate->data() : nullptr));
    }

    /// Serves a control period: sends all that waits, then the sample, waits up to `timeout` for its increment, and returns all increments that
    /// have arrived, each once and in the order of sending. `sample` is empty then. See isotherm_exchange.
    [[nodiscard]] Result<Increments> exchange(Sample &sample, std::chrono::nanoseconds timeout)
    {
        std::size_t count = 0;
        const auto code = isotherm_exchange(handle_.get(), sample.raw_, detail::count(timeout), exchanged_.get(), EXCHANGED, &count);
        return detail::result<Increments>(sent(sample, code), [&](isotherm_code) { return Increments(exchanged_.get(), count); });
    }

    /// Sends a sample; `sample` is empty then. Returns false if the service has no room: the sample is still yours, to be kept.
    [[nodiscard]] Result<bool> send(Sample &sample)
    {
        return detail::result<bool>(sent(sample, isotherm_send(handle_.get(), sample.raw_)),
                                    [](isotherm_code code) { return code == ISOTHERM_OK; });
    }

    /// Keeps a control period for which the service has no room; `sample` is empty then. It waits in memory of this process, and is sent before
    /// all that comes later. exchange() does this by itself. See isotherm_keep.
    Result<void> keep(Sample &sample)
    {
        return detail::result<void>(isotherm_keep(handle_.get(), sample.raw_), [&](isotherm_code) { sample.raw_ = nullptr; });
    }

    /// Sends what is kept, oldest first, as far as the service takes it now; never waits. Every sending call begins with it.
    Result<void> send_kept() { return detail::done(isotherm_send_kept(handle_.get())); }

    /// Control periods that wait: they are kept, and not sent yet.
    std::uint64_t kept() const noexcept { return isotherm_kept(handle_.get()); }

    /// Gives a sample back that stands for no control period, as at the end of a recording. `sample` is empty then.
    Result<void> cancel(Sample &sample)
    {
        return detail::result<void>(isotherm_cancel(handle_.get(), sample.raw_), [&](isotherm_code) { sample.raw_ = nullptr; });
    }

    /// Adds the next control period to a sample and cancels its loan; `later` is empty then. Throws Error (ISOTHERM_ERROR_MERGE) if a sum
    /// overflows or both are the same sample; neither has changed then. For devices that sum by themselves.
    Result<void> merge(Sample &sample, Sample &later)
    {
        return detail::result<void>(isotherm_merge(handle_.get(), sample.raw_, later.raw_), [&](isotherm_code) { later.raw_ = nullptr; });
    }

    /// The increment of the oldest unanswered sample, if it has come. First come the late ones that compensate() has kept aside.
    [[nodiscard]] Result<std::optional<CompensatedIncrement>> receive()
    {
        CompensatedIncrement increment;
        return detail::some(isotherm_receive(handle_.get(), &increment), increment);
    }

    /// The same, but waits up to `timeout`, and sends what is kept.
    [[nodiscard]] Result<std::optional<CompensatedIncrement>> receive(std::chrono::nanoseconds timeout)
    {
        CompensatedIncrement increment;
        return detail::some(isotherm_receive_timeout(handle_.get(), detail::count(timeout), &increment), increment);
    }

    /// The round trip of one sample: sends it and waits for its increment. `sample` is empty then, unless the service has no room. Late
    /// increments of earlier samples are kept aside for receive(), and come after it: where order matters, use exchange().
    [[nodiscard]] Result<Answer> compensate(Sample &sample, std::chrono::nanoseconds timeout)
    {
        Answer answer;
        const auto code = sent(sample, isotherm_compensate(handle_.get(), sample.raw_, detail::count(timeout), &answer.increment_));
        return detail::result<Answer>(code, [&](isotherm_code sent_code) {
            answer.code_ = sent_code;
            return answer;
        });
    }

    /// The most samples that can be unanswered at once.
    std::size_t depth() const noexcept { return isotherm_depth(handle_.get()); }
    /// Samples that have been sent and whose increments have not been received.
    std::size_t in_flight() const noexcept { return isotherm_in_flight(handle_.get()); }
    /// Control periods that have a sequence and are gone, in all sessions of this connection. What waits is not lost: kept().
    std::uint64_t lost() const noexcept { return isotherm_lost(handle_.get()); }
    /// Late increments that were dropped because depth() of them waited for receive() already.
    std::uint64_t dropped_answers() const noexcept { return isotherm_dropped_answers(handle_.get()); }
    /// Leaves the streams. Returns what was lost, in words; empty if nothing was. The destructor does the same, without the words.
    Result<std::string> close()
    {
        return detail::result<std::string>(isotherm_acquisition_close(handle_.get()), [&](isotherm_code code) {
            handle_.release();
            return std::string(code == ISOTHERM_LOST ? isotherm_error_message() : "");
        });
    }
    /// The session of all samples; a new random number for each connection.
    std::uint64_t session() const noexcept { return isotherm_session(handle_.get()); }
    /// Begins a new session: the next sample may have any sequence. What the temperatures have been is not known then, unless the lag is
    /// restored, or the IMU said to be soaked, after this. Throws if samples are unanswered.
    Result<void> begin_session() { return detail::done(isotherm_begin_session(handle_.get())); }

private:
    explicit Acquisition(isotherm_acquisition *handle) : handle_(handle), exchanged_(new CompensatedIncrement[EXCHANGED]) {}

    /// Increments that exchange() returns at once, at most.
    static constexpr std::size_t EXCHANGED = 512;

    /// Empties `sample` unless it is still the caller's.
    static isotherm_code sent(Sample &sample, isotherm_code code) noexcept
    {
        if (code == ISOTHERM_OK || code == ISOTHERM_TIMEOUT || code == ISOTHERM_ERROR_TRANSPORT || code == ISOTHERM_ERROR_NOT_ON_LOAN)
            sample.raw_ = nullptr;
        return code;
    }

    struct Close {
        void operator()(isotherm_acquisition *handle) const noexcept { isotherm_acquisition_close(handle); }
    };
    std::unique_ptr<isotherm_acquisition, Close> handle_;
    std::unique_ptr<CompensatedIncrement[]> exchanged_;
};

/// Reads the increments of one IMU as they are published.
class IncrementReader {
public:
    /// Connects, waiting for the service if necessary.
    [[nodiscard]] static Result<IncrementReader> connect(const std::string &imu, const Options &options = {})
    {
        isotherm_reader *handle = nullptr;
        return detail::result<IncrementReader>(
            isotherm_reader_connect(imu.c_str(), options.domain_or_null(), detail::patience(options.timeout), &handle),
            [&](isotherm_code) { return IncrementReader(handle); });
    }
#if ISOTHERM_EXCEPTIONS
    /// The same.
    explicit IncrementReader(const std::string &imu, const Options &options = {}) : IncrementReader(connect(imu, options)) {}
#endif

    /// A reader that connects at once if the service is there, and else in a later call; does not wait for it. What is published before it is
    /// connected, as is_connected() shows, is not received.
    [[nodiscard]] static Result<IncrementReader> unconnected(const std::string &imu, const Options &options = {})
    {
        isotherm_reader *handle = nullptr;
        return detail::result<IncrementReader>(isotherm_reader_new(imu.c_str(), options.domain_or_null(), &handle),
                                               [&](isotherm_code) { return IncrementReader(handle); });
    }

    /// The next increment, if there is one now.
    [[nodiscard]] Result<std::optional<CompensatedIncrement>> receive()
    {
        CompensatedIncrement increment;
        return detail::some(isotherm_reader_receive(handle_.get(), &increment), increment);
    }

    /// The same, but waits up to `timeout`.
    [[nodiscard]] Result<std::optional<CompensatedIncrement>> receive(std::chrono::nanoseconds timeout)
    {
        CompensatedIncrement increment;
        return detail::some(isotherm_reader_receive_timeout(handle_.get(), detail::count(timeout), &increment), increment);
    }

    /// For poll, epoll and the like: readable when increments may have come. Then call receive() until it returns nothing. Wait for at most
    /// some 100 ms at once. The reader closes it.
    [[nodiscard]] Result<int> descriptor()
    {
        int descriptor = -1;
        return detail::result<int>(isotherm_reader_descriptor(handle_.get(), &descriptor), [&](isotherm_code) { return descriptor; });
    }

    /// How long ago the service was last seen at work for this IMU: under 0.3 s while it lives. Nothing if no service was seen yet.
    [[nodiscard]] Result<std::optional<std::chrono::nanoseconds>> heartbeat_age()
    {
        std::uint64_t age_ns = 0;
        return detail::result<std::optional<std::chrono::nanoseconds>>(
            isotherm_reader_heartbeat_age(handle_.get(), &age_ns),
            [&](isotherm_code code) { return code == ISOTHERM_NONE ? std::nullopt : std::optional(std::chrono::nanoseconds(age_ns)); });
    }

    /// Whether the stream has been found. Stays true when the service stops.
    bool is_connected() const noexcept { return isotherm_reader_is_connected(handle_.get()); }
    /// Increments that came again after a resend and were not returned.
    std::uint64_t repeats() const noexcept { return isotherm_reader_repeats(handle_.get()); }
    /// The control periods that are missing right before the increment that was received last. Nothing if that is unknown: where time
    /// steps, between sessions of different clocks, and before the first one.
    std::optional<std::uint64_t> lost_before() const noexcept
    {
        const std::int64_t lost = isotherm_reader_lost_before(handle_.get());
        return lost < 0 ? std::nullopt : std::optional(static_cast<std::uint64_t>(lost));
    }

private:
    explicit IncrementReader(isotherm_reader *handle) noexcept : handle_(handle) {}

    struct Close {
        void operator()(isotherm_reader *handle) const noexcept { isotherm_reader_close(handle); }
    };
    std::unique_ptr<isotherm_reader, Close> handle_;
};

/// The mean specific force over an increment's interval [m/s2]; NaN where the increment is NaN.
inline Result<Vector> specific_force(const CompensatedIncrement &increment)
{
    Vector force;
    return detail::result<Vector>(isotherm_increment_specific_force(&increment, force.data()), [&](isotherm_code) { return force; });
}

/// The mean angular rate over an increment's interval [rad/s]; NaN where the increment is NaN.
inline Result<Vector> angular_rate(const CompensatedIncrement &increment)
{
    Vector rate;
    return detail::result<Vector>(isotherm_increment_angular_rate(&increment, rate.data()), [&](isotherm_code) { return rate; });
}

/// Adds the next control period, which is not on loan, to a sample. Throws Error (ISOTHERM_ERROR_MERGE) if a sum overflows; neither
/// sample has changed then.
inline Result<void> merge(RawSample &sample, const RawSample &later) { return detail::done(isotherm_merge(nullptr, &sample, &later)); }

/// The names of flags joined by `|`, or `-`.
inline std::string flags_text(std::uint64_t flags)
{
    std::string text(isotherm_flags_text(flags, nullptr, 0), '\0');
    isotherm_flags_text(flags, text.data(), text.size() + 1);
    return text;
}

/// The number of the device with this serial number, which every sample carries in `device`.
inline std::uint64_t device(const std::string &serial) noexcept { return isotherm_device(serial.c_str()); }

/// Real-time settings of the calling thread. A setting that is not given stays unchanged.
struct Realtime {
    /// The core that the thread is bound to.
    std::optional<unsigned> core = std::nullopt;
    /// SCHED_FIFO priority, 1 to 99.
    std::optional<int> priority = std::nullopt;
    /// Keeps all memory of the process resident, including memory that it gets later.
    bool lock_memory = false;
    /// How much later than requested a sleep may end.
    std::optional<std::chrono::nanoseconds> timer_slack = std::nullopt;

    /// Throws Error (ISOTHERM_ERROR_REALTIME) for the first setting that fails. The settings before it, in this order, are in
    /// force.
    Result<void> apply() const
    {
        return detail::done(isotherm_realtime(core ? static_cast<std::int32_t>(*core) : -1, priority.value_or(0), lock_memory,
                                              detail::count(timer_slack.value_or(std::chrono::nanoseconds(0)))));
    }
};

/// CLOCK_MONOTONIC [ns].
inline std::uint64_t monotonic_ns() noexcept { return isotherm_monotonic_ns(); }

/// The number of the machine's present start, with which CLOCK_MONOTONIC began; 0 if the kernel does not report it.
inline std::uint64_t boot() noexcept { return isotherm_boot(); }

/// The version of the library.
inline std::string version() { return isotherm_version(); }

}  // namespace throwing or returning

}  // namespace isotherm

#endif
