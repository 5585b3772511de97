// An acquisition whose IMU delivers readings, as every MEMS does: m/s2 and rad/s become a sample, and its increment becomes m/s2 and
// rad/s again, compensated.
//
//     mems IMU [SAMPLES]
//
// Replace read_imu() by your driver. The resolution is that of the table, here of examples/tables/imu-mems.toml; the interval is your own. The pace of
// an IMU, and what to do when the service is away: paced.cpp. The environment variable ISOTHERM_DOMAIN names the domain.
#include <algorithm>
#include <cstdio>
#include <iostream>
#include <isotherm.hpp>

using namespace std::chrono_literals;

constexpr std::chrono::nanoseconds INTERVAL = 2500us;

struct Reading {
    isotherm::Vector specific_force, angular_rate;  // m/s2, rad/s
    double temperature;                             // degC
};

static Reading read_imu(unsigned sample)
{
    const double turn = sample / 7.0;
    return {{0.1234567, -0.2345678 - turn, 9.8012345}, {0.01234567, -turn, 0.00001234}, 31.25};
}

static void run(isotherm::Acquisition &acquisition, unsigned samples)
{
    for (unsigned number = 0; number < samples; number++) {
        const auto reading = read_imu(number);
        auto sample = acquisition.loan();
        sample->timestamp_ns = static_cast<std::uint64_t>((number + 1) * INTERVAL.count());
        sample->interval_ns = static_cast<std::uint64_t>(INTERVAL.count());
        try {
            acquisition.fill(*sample, reading.specific_force, reading.angular_rate);
        } catch (const isotherm::Error &error) {
            std::cerr << error.what() << '\n';  // the sample is destroyed, a gap for every reader
            continue;
        }
        for (auto *triad : {&sample->accelerometers, &sample->gyroscopes}) {
            std::fill_n(triad->head_temperature, 3, reading.temperature);
            std::fill_n(triad->board_temperature, 3, reading.temperature);
        }
        const auto answer = acquisition.compensate(sample, 20s);
        const auto &increment = answer.value();
        const auto [x, y, z] = isotherm::specific_force(increment);
        const auto [p, q, r] = isotherm::angular_rate(increment);
        std::printf("%llu: %.9f %.9f %.9f m/s2, %.9f %.9f %.9f rad/s\n", static_cast<unsigned long long>(increment.sequence), x, y, z, p, q,
                    r);
    }
}

int main(int count, char **words)
try {
    if (count != 2 && count != 3) {
        std::cerr << "usage: " << words[0] << " IMU [SAMPLES]\n";
        return 64;
    }
    isotherm::Options options;
    options.accelerometer_resolution = 1e-6;  // m/s2
    options.gyroscope_resolution = 1e-7;      // rad/s
    isotherm::Acquisition acquisition(words[1], options);
    run(acquisition, count == 3 ? static_cast<unsigned>(std::stoul(words[2])) : 8);
    return 0;
} catch (const std::exception &error) {
    std::cerr << "mems: " << error.what() << '\n';
    return 1;
}
