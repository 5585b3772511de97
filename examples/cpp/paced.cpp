// An acquisition at the pace of its hardware: 400 samples a second, each sent when its control period ends.
//
//     paced IMU [PERIODS [CORE PRIORITY]]
//
// Start with this program. It loses no control period while the service is replaced, and says so where one is lost all the same. Replace
// wait_for_period() and latch() by your hardware, and use() by your navigation. CORE and PRIORITY (SCHED_FIFO, 1 to 99) are for a machine
// that has a core to spare; they need rights, see docs/operate.md. The environment variable ISOTHERM_DOMAIN names the domain.
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <iostream>
#include <isotherm.hpp>
#include <thread>

using namespace std::chrono_literals;
using Clock = std::chrono::steady_clock;

constexpr auto PERIOD = 2500us;
// An increment that takes longer is late. It leaves time for the rest of the period.
constexpr auto TIMEOUT = 1ms;
// Telemetry is measured every 40th period: ten times a second.
constexpr unsigned TELEMETRY_PERIODS = 40;
// prepare() takes some ten microseconds in cold caches.
constexpr auto PREPARE = 100us;

class Paced {
public:
    Paced(const std::string &imu, const isotherm::Options &options) : acquisition_(imu, options) {}

    void run(unsigned periods)
    {
        const auto began = Clock::now();
        for (unsigned period = 0; period < periods; period++) {
            const auto end = began + (period + 1) * PERIOD;
            wait_for_period(end);
            auto sample = acquisition_.loan();
            latch(*sample, period, end);
            add(std::move(sample));
            exchange();
        }
        // The last periods: wait for a service that is away, 20 s.
        for (int turn = 0; turn < 20'000 && (waiting_ || acquisition_.in_flight() > 0); turn++) {
            if (waiting_)
                exchange();
            std::this_thread::sleep_for(1ms);
            take_late();
        }
        const auto lost = acquisition_.lost();
        if (const auto words = acquisition_.close(); !words.empty())
            std::cerr << "paced: " << words << '\n';
        std::printf("%u periods: %u answered in time, %u late, %u merged, %llu lost\n", periods, answered_, late_, merged_,
                    static_cast<unsigned long long>(lost));
        std::printf("velocity %.9g %.9g %.9g m/s\n", velocity_[0], velocity_[1], velocity_[2]);
    }

private:
    // Waits for the end of a period. While it waits it warms the way of the sample.
    void wait_for_period(Clock::time_point end)
    {
        std::this_thread::sleep_until(end - PREPARE);
        if (Clock::now() < end)
            acquisition_.prepare();
        std::this_thread::sleep_until(end);
    }

    // What the hardware has counted and measured. Every field that is not set is 0.
    void latch(isotherm::RawSample &sample, unsigned period, Clock::time_point end)
    {
        sample.timestamp_ns = static_cast<std::uint64_t>(std::chrono::nanoseconds(end.time_since_epoch()).count());
        if (period % TELEMETRY_PERIODS == 0) {
            // A new measurement. The library keeps its lag; a value that is only repeated is not given again.
            head_ = 2.5 + 1e-6 * period;
            measured_ = sample.timestamp_ns;
            for (unsigned sensor = 0; sensor < 3; sensor++)
                acquisition_.reading(sensor, head_, measured_);
        }
        sample.interval_ns = std::chrono::nanoseconds(PERIOD).count();  // the measured gate length
        sample.telemetry_ns = measured_;
        for (unsigned axis = 0; axis < 3; axis++) {
            sample.accelerometers.positive_pulses[axis] = 140 + axis;
            sample.accelerometers.head_temperature[axis] = sample.accelerometers.board_temperature[axis] = head_;
        }
    }

    // Adds a period to the one that waits, or gives up the one that waits.
    void add(isotherm::Sample sample)
    {
        if (waiting_) {
            try {
                acquisition_.merge(*waiting_, sample);
                merged_++;
                return;
            } catch (const isotherm::Error &error) {
                // A sum does not fit: over an hour without a service. The sample that waits is dropped, which is a gap for every reader.
                if (error.code() != ISOTHERM_ERROR_MERGE)
                    throw;
            }
        }
        waiting_ = std::move(sample);
    }

    // Sends what waits and takes all increments that are there. A full queue leaves the sample to the next period.
    void exchange()
    {
        const auto answer = acquisition_.compensate(*waiting_, TIMEOUT);
        if (answer) {
            answered_++;
            use(*answer);
        }
        if (!answer.is_full())
            waiting_.reset();  // sent; after a time-out its increment comes from receive()
        take_late();
    }

    void take_late()
    {
        while (const auto increment = acquisition_.receive()) {
            late_++;
            use(*increment);
        }
    }

    // Navigation: a value counts if it is finite, whatever the flags say.
    void use(const isotherm::CompensatedIncrement &increment)
    {
        if ((increment.flags & ISOTHERM_MASK_LOST) != 0)
            std::cerr << increment.sequence << ": time is missing before this increment\n";
        if ((increment.flags & (ISOTHERM_MASK_INVALID | ISOTHERM_MASK_DEGRADED)) != 0)
            std::cerr << increment.sequence << ": " << isotherm::flags_text(increment.flags) << '\n';
        for (unsigned axis = 0; axis < 3; axis++)
            if (std::isfinite(increment.velocity_increment[axis]))
                velocity_[axis] += increment.velocity_increment[axis];
    }

    isotherm::Acquisition acquisition_;
    std::optional<isotherm::Sample> waiting_;
    double head_ = 0, velocity_[3] = {};
    std::uint64_t measured_ = 0;
    unsigned answered_ = 0, late_ = 0, merged_ = 0;
};

int main(int count, char **words)
try {
    if (count != 2 && count != 3 && count != 5) {
        std::cerr << "usage: " << words[0] << " IMU [PERIODS [CORE PRIORITY]]\n";
        return 64;
    }
    // Before connecting, so that all memory is resident. Without arguments only sleeps become exact, which needs no right.
    isotherm::Realtime realtime;
    realtime.timer_slack = 1ns;
    if (count > 3) {
        realtime.core = std::stoul(words[3]);
        realtime.priority = std::stoi(words[4]);
        realtime.lock_memory = true;
    }
    realtime.apply();
    isotherm::Options options;
    if (const char *serial = std::getenv("SERIAL"))
        options.serial = serial;
    Paced(words[1], options).run(count > 2 ? static_cast<unsigned>(std::stoul(words[2])) : 4000);
    return 0;
} catch (const std::exception &error) {
    std::cerr << "paced: " << error.what() << '\n';
    return 1;
}
