// An acquisition at the pace of its hardware: 400 readings a second, each sent when its control period ends.
//
//     paced IMU [PERIODS [CORE PRIORITY]]
//
// Start with this program. It loses no control period while the service is away or replaced, and says so where one is lost all the same.
// Replace wait_for_period() and read_imu() by your hardware, and use() by your navigation. The resolution is that of the table,
// here of examples/tables/imu-mems.toml. An IMU that counts pulses writes them, and the measured gate length, into the sample itself. CORE
// and PRIORITY (SCHED_FIFO, 1 to 99) are for a machine that has a core to spare; they need rights, see docs/operate.md. The environment
// variable ISOTHERM_DOMAIN names the domain.
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
// Temperature is measured every 40th period: ten times a second.
constexpr unsigned TEMPERATURE_PERIODS = 40;
// prepare() takes some ten microseconds in cold caches.
constexpr auto PREPARE = 100us;

struct Reading {
    isotherm::Vector specific_force;  // m/s2, the mean over the period
    isotherm::Vector angular_rate;    // rad/s, the mean over the period
    double temperature;               // degC
};

Reading read_imu(unsigned period)
{
    const double turn = period % 100;
    return {{0.1 + 1e-4 * turn, -0.3, 9.80665}, {0.01, 1e-5 * turn - 0.02, 7.292e-5}, 31.25 + 1e-6 * period};
}

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
            try {
                latch(*sample, period, end);
            } catch (const isotherm::Error &error) {
                if (error.code() != ISOTHERM_ERROR_VALUE)
                    throw;
                std::cerr << error.what() << '\n';  // the sample is dropped, a gap for every reader
                continue;
            }
            // While the service has no room, or is away, the sample waits, and a later call sends it.
            for (const auto &increment : acquisition_.exchange(sample, TIMEOUT))
                use(increment);
        }
        // The last periods: wait for a service that is away, 20 s.
        for (int turn = 0; turn < 20 && (acquisition_.kept() > 0 || acquisition_.in_flight() > 0); turn++)
            while (const auto increment = acquisition_.receive(1s))
                use(*increment);
        const auto lost = acquisition_.lost() + acquisition_.kept();
        if (const auto words = acquisition_.close(); !words.empty())
            std::cerr << "paced: " << words << '\n';
        std::printf("%u periods: %u increments, %llu lost\n", periods, increments_, static_cast<unsigned long long>(lost));
        std::printf("velocity %.9f %.9f %.9f m/s\n", velocity_[0], velocity_[1], velocity_[2]);
        std::printf("angle %.9f %.9f %.9f rad\n", angle_[0], angle_[1], angle_[2]);
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

    // What the hardware has measured. Temperature that is not set is NaN, every other field 0.
    void latch(isotherm::RawSample &sample, unsigned period, Clock::time_point end)
    {
        const auto reading = read_imu(period);
        sample.timestamp_ns = static_cast<std::uint64_t>(std::chrono::nanoseconds(end.time_since_epoch()).count());
        sample.interval_ns = static_cast<std::uint64_t>(std::chrono::nanoseconds(PERIOD).count());
        if (period % TEMPERATURE_PERIODS == 0) {
            // A new measurement. The library keeps its lag; a value that is only repeated is not given again.
            temperature_ = reading.temperature;
            measured_ = sample.timestamp_ns;
            acquisition_.reading_of_all(temperature_, measured_);
        }
        sample.telemetry_ns = measured_;
        acquisition_.fill(sample, reading.specific_force, reading.angular_rate);
        for (auto *triad : {&sample.accelerometers, &sample.gyroscopes})
            for (unsigned axis = 0; axis < 3; axis++)
                triad->head_temperature[axis] = triad->board_temperature[axis] = temperature_;
    }

    // Navigation: a value counts if it is finite, whatever the flags say.
    void use(const isotherm::CompensatedIncrement &increment)
    {
        increments_++;
        if ((increment.flags & ISOTHERM_MASK_LOST) != 0)
            std::cerr << increment.sequence << ": time is missing before this increment\n";
        if ((increment.flags & (ISOTHERM_MASK_INVALID | ISOTHERM_MASK_DEGRADED)) != 0)
            std::cerr << increment.sequence << ": " << isotherm::flags_text(increment.flags) << '\n';
        for (unsigned axis = 0; axis < 3; axis++) {
            if (std::isfinite(increment.velocity_increment[axis]))
                velocity_[axis] += increment.velocity_increment[axis];
            if (std::isfinite(increment.angle_increment[axis]))
                angle_[axis] += increment.angle_increment[axis];
        }
    }

    isotherm::Acquisition acquisition_;
    double temperature_ = 0, velocity_[3] = {}, angle_[3] = {};
    std::uint64_t measured_ = 0;
    unsigned increments_ = 0;
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
    options.accelerometer_resolution = 1e-6;  // m/s2
    options.gyroscope_resolution = 1e-7;      // rad/s
    if (const char *serial = std::getenv("SERIAL"))
        options.serial = serial;
    Paced(words[1], options).run(count > 2 ? static_cast<unsigned>(std::stoul(words[2])) : 4000);
    return 0;
} catch (const std::exception &error) {
    std::cerr << "paced: " << error.what() << '\n';
    return 1;
}
