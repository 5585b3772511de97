// Checks that the C++ wrapper behaves as documented: wrapper IMU. Exits with 0 if it does.
#include "check.hpp"
#include <cmath>
#include <isotherm.hpp>
#include <poll.h>
#include <thread>
#include <type_traits>

using namespace std::chrono_literals;
using isotherm::Acquisition, isotherm::IncrementReader, isotherm::Sample;

template <class T>
constexpr bool only_moves = std::is_nothrow_move_constructible_v<T> && std::is_nothrow_move_assignable_v<T> &&
                            !std::is_copy_constructible_v<T> && !std::is_copy_assignable_v<T>;
static_assert(only_moves<Acquisition> && only_moves<IncrementReader> && only_moves<Sample>);

template <class Work>
static isotherm_code thrown(Work work)
{
    try {
        work();
    } catch (const isotherm::Error &error) {
        CHECK(error.what() != std::string());
        return error.code();
    }
    return ISOTHERM_OK;
}

static Acquisition connected(const std::string &imu)
{
    Acquisition acquisition(imu, {std::nullopt, 20s, "SN 42", 10.0});
    CHECK(acquisition.depth() > 1 && acquisition.lag_ns() == 10'000'000'000);
    return acquisition;
}

int main(int, char **words)
{
    const std::string imu = words[1];
    CHECK(thrown([&] { Acquisition(imu, {"nobody-here", 0s}); }) == ISOTHERM_ERROR_NO_SERVICE);
    CHECK(thrown([&] { Acquisition("no name"); }) == ISOTHERM_ERROR_NAME);
    CHECK(thrown([&] { Acquisition(imu, {std::nullopt, 20s, std::nullopt, 0.01}); }) == ISOTHERM_ERROR_VALUE);
    auto early = IncrementReader::unconnected(imu, {"nobody-here"});
    CHECK(!early.is_connected() && IncrementReader::unconnected(imu).is_connected());
    // The first acquisition is closed at the end of its scope, so a second one can connect.
    connected(imu);
    auto acquisition = connected(imu);
    IncrementReader reader(imu, {std::nullopt, 20s});
    CHECK(reader.is_connected() && !reader.receive());
    CHECK(thrown([&] { (void)early.descriptor(); }) == ISOTHERM_ERROR_NO_SERVICE);
    pollfd waiting{reader.descriptor(), POLLIN, 0};
    CHECK(!reader.receive() && reader.descriptor() == waiting.fd);
    while (!reader.heartbeat_age())
        std::this_thread::sleep_for(1ms);

    // A sample that is not sent is a lost period when it goes out of scope, unless it is cancelled.
    for (int i = 0; i < 10; i++) {
        auto cancelled = acquisition.loan();
        CHECK(cancelled->sequence == 0);
        acquisition.cancel(cancelled);
        CHECK(!cancelled);
    }
    for (unsigned i = 0; i < 10; i++)
        CHECK(acquisition.loan()->sequence == i);
    CHECK(acquisition.lost() == 10);
    acquisition.prepare();
    auto sample = acquisition.loan();
    sample->interval_ns = 1000;
    const auto answer = acquisition.compensate(sample, 20s);
    CHECK(answer && !answer.is_full() && !answer.is_late() && !sample && answer->interval_ns == 1000 && &answer.value() == &*answer);
    // The service signals that the increment is there.
    CHECK(poll(&waiting, 1, 20'000) == 1 && (waiting.revents & POLLIN));
    CHECK(reader.receive(20s)->sequence == answer->sequence && reader.repeats() == 0);
    // A sample cannot be sent twice.
    CHECK(thrown([&] { (void)acquisition.send(sample); }) == ISOTHERM_ERROR_NULL);

    do {
        sample = acquisition.loan();
        sample->interval_ns = 1;
    } while (acquisition.send(sample));
    CHECK(sample && acquisition.in_flight() == acquisition.depth());
    auto moved = std::move(sample);
    CHECK(moved && !sample && !acquisition.send(moved) && moved);
    isotherm::RawSample huge{};
    huge.interval_ns = ISOTHERM_MAX_INTERVAL_NS;
    moved->interval_ns = 1;
    auto next = acquisition.loan();
    next->interval_ns = 2;
    acquisition.merge(moved, next);
    CHECK(!next && moved->interval_ns == 3 && acquisition.loan()->sequence == moved->sequence + 1);
    moved->interval_ns = 1;
    CHECK(thrown([&] { isotherm::merge(*moved, huge); }) == ISOTHERM_ERROR_MERGE && moved->interval_ns == 1);
    CHECK(thrown([&] { acquisition.begin_session(); }) == ISOTHERM_ERROR_IN_FLIGHT);
    // What is kept goes first, and in order.
    acquisition.keep(moved);
    CHECK(!moved && acquisition.kept() == 1);
    auto after = acquisition.loan();
    after->interval_ns = 1;
    const auto number = after->sequence;
    while (!acquisition.send(after))
        CHECK(acquisition.receive(20s).has_value());
    CHECK(acquisition.kept() == 0);
    CHECK(thrown([&] { acquisition.keep(after); }) == ISOTHERM_ERROR_NULL);
    std::uint64_t last = 0;
    while (acquisition.in_flight() > 0)
        last = acquisition.receive(20s)->sequence;
    CHECK(last == number);
    // One call serves a period.
    auto period = acquisition.loan();
    period->interval_ns = 5;
    std::size_t count = 0;
    for (const auto &increment : acquisition.exchange(period, 20s)) {
        CHECK(increment.interval_ns == 5 && increment.sequence == number + 1);
        count++;
    }
    CHECK(count == 1 && !period && thrown([&] { (void)acquisition.exchange(period, 1s); }) == ISOTHERM_ERROR_NULL);
    const auto session = acquisition.session();
    acquisition.begin_session();
    CHECK(acquisition.session() != session && !acquisition.receive() && !acquisition.receive(-1s));

    // The lag is kept, and goes on in another acquisition.
    acquisition.reading(0, 2.0, 1'000'000'000);
    acquisition.reading(0, 3.0, 11'000'000'000);
    const auto kept = acquisition.lag();
    CHECK(kept.sensors[0].telemetry == 3.0 && kept.sensors[0].lagged > 2.0 && kept.sensors[0].lagged < 3.0);
    acquisition.begin_session();
    CHECK(!(acquisition.lag().sensors[0].lagged == kept.sensors[0].lagged));
    acquisition.restore_lag(kept);
    CHECK(isotherm::boot() != 0 && isotherm::boot() == isotherm_boot());
    CHECK(acquisition.lag().sensors[0].lagged == kept.sensors[0].lagged);
    CHECK(thrown([&] { acquisition.reading(6, 2.0, 1); }) == ISOTHERM_ERROR_VALUE);
    CHECK(isotherm::device("SN 42") == 0x46a7426ef29cc83b && isotherm::device("") == 0);

    // An increment becomes readings.
    // This acquisition has connected without a resolution, and the table is one of pulses.
    isotherm::RawSample read = ISOTHERM_RAW_SAMPLE_INIT;
    CHECK(thrown([&] { acquisition.fill(read, {1.0, -2.0, 0.0}); }) == ISOTHERM_ERROR_VALUE);
    isotherm::CompensatedIncrement half{};
    half.interval_ns = 500'000'000;
    half.velocity_increment[1] = half.angle_increment[2] = 1.0;
    CHECK(isotherm::specific_force(half) == (isotherm::Vector{0.0, 2.0, 0.0}));
    CHECK(isotherm::angular_rate(half) == (isotherm::Vector{0.0, 0.0, 2.0}));

    auto other = std::move(acquisition);
    CHECK(thrown([&] { (void)acquisition.loan(); }) == ISOTHERM_ERROR_NULL && other.depth() > 1);
    CHECK(isotherm::flags_text(ISOTHERM_FLAG_GAP | ISOTHERM_FLAG_LATE) == "gap|late" && isotherm::flags_text(0) == "-");
    CHECK(isotherm::flags_text(ISOTHERM_FLAG_G1_HEAD_BELOW) == "g1-head-below");
    CHECK(isotherm::version() == ISOTHERM_VERSION && isotherm::monotonic_ns() > 0);
    isotherm::Realtime{}.apply();
    isotherm::Realtime slack;
    slack.timer_slack = 1us;
    slack.apply();
    CHECK(thrown([] { isotherm::Realtime{100000u}.apply(); }) == ISOTHERM_ERROR_REALTIME);
}
