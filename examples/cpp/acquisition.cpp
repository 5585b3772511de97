// An acquisition process: reads samples from a recording, makes one round trip for each, and prints the increments as CSV.
//
//     acquisition IMU RECORDING.csv
//
// Replace next_sample() and the test whether temperature is new by your hardware. The environment variable ISOTHERM_DOMAIN names the domain.
#include <array>
#include <cinttypes>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <isotherm.hpp>
#include <limits>
#include <sstream>

using namespace std::chrono_literals;

static isotherm::Triad &triad_of(isotherm::RawSample &sample, unsigned sensor)
{
    return sensor < 3 ? sample.accelerometers : sample.gyroscopes;
}

// Fills in a sample from the next row: sequence, timestamp, interval, and pulses and temperature of each sensor. False at the end.
static bool next_sample(std::istream &recording, unsigned sensors, isotherm::RawSample &sample)
{
    std::string line;
    if (!std::getline(recording, line))
        return false;
    std::istringstream row(line);
    char comma;
    row >> sample.sequence >> comma >> sample.timestamp_ns >> comma >> sample.interval_ns;
    for (unsigned sensor = 0; sensor < sensors; sensor++) {
        auto &triad = triad_of(sample, sensor);
        const unsigned axis = sensor % 3;
        row >> comma >> triad.positive_pulses[axis] >> comma >> triad.negative_pulses[axis] >> comma >> triad.head_temperature[axis] >>
            comma >> triad.board_temperature[axis];
    }
    if (!row)
        throw std::runtime_error("not a row of a recording: " + line);
    return true;
}

static void print(const double (&values)[3])
{
    std::printf("%.17g,%.17g,%.17g,", values[0], values[1], values[2]);
}

int main(int count, char **words)
try {
    if (count != 3) {
        std::cerr << "usage: " << words[0] << " IMU RECORDING.csv\n";
        return 64;
    }
    std::ifstream recording(words[2]);
    std::string header;
    if (!std::getline(recording, header))
        throw std::runtime_error(std::string(words[2]) + " cannot be read");
    const unsigned sensors = header.find("g1_positive") == std::string::npos ? 3 : ISOTHERM_SENSORS;

    isotherm::Options options;
    // The serial number of your unit: the service flags samples that are of another one than the table.
    if (const char *serial = std::getenv("SERIAL"))
        options.serial = serial;
    isotherm::Acquisition acquisition(words[1], options);
    acquisition.soaked();  // the recording begins soaked; of a device that is not, leave it out
    std::array<double, ISOTHERM_SENSORS> last;
    last.fill(std::numeric_limits<double>::quiet_NaN());
    std::printf("sequence,a1_dv,a2_dv,a3_dv,%stable,flags\n", sensors > 3 ? "g1_da,g2_da,g3_da," : "");
    for (;;) {
        auto sample = acquisition.loan();
        if (!next_sample(recording, sensors, *sample)) {
            acquisition.cancel(sample);
            return 0;
        }
        // A temperature that has been measured since the last sample; here one that has changed.
        for (unsigned sensor = 0; sensor < sensors; sensor++) {
            const double head = triad_of(*sample, sensor).head_temperature[sensor % 3];
            if (head != last[sensor])
                acquisition.reading(sensor, head, sample->timestamp_ns);
            last[sensor] = head;
        }
        const auto sequence = sample->sequence;
        auto answer = acquisition.compensate(sample, 10s);
        if (!answer) {
            std::cerr << "acquisition: sample " << sequence << " was not answered within 10 s\n";
            return 1;
        }
        std::printf("%" PRIu64 ",", answer->sequence);
        print(answer->velocity_increment);
        if (sensors > 3)
            print(answer->angle_increment);
        std::printf("%016" PRIx64 ",%s\n", answer->table, isotherm::flags_text(answer->flags).c_str());
    }
} catch (const std::exception &error) {
    std::cerr << "acquisition: " << error.what() << '\n';
    return 1;
}
