// An acquisition process: reads samples from a recording, makes one round trip for each, and prints the increments as CSV.
//
//     acquisition IMU RECORDING.csv
//
// Replace next_sample() by your hardware. The environment variable ISOTHERM_DOMAIN names the domain.
#include <cinttypes>
#include <cstdio>
#include <fstream>
#include <iostream>
#include <isotherm.hpp>
#include <sstream>

using namespace std::chrono_literals;

// Fills in a sample from the next row: sequence, timestamp, interval, and pulses and telemetry of each axis. False at the end.
static bool next_sample(std::istream &recording, isotherm::RawSample &sample)
{
    std::string line;
    if (!std::getline(recording, line))
        return false;
    std::istringstream row(line);
    char comma;
    row >> sample.sequence >> comma >> sample.timestamp_ns >> comma >> sample.interval_ns;
    for (int axis = 0; axis < 3; axis++)
        row >> comma >> sample.positive_pulses[axis] >> comma >> sample.negative_pulses[axis] >> comma >> sample.head_temperature[axis] >>
            comma >> sample.board_temperature[axis];
    if (!row)
        throw std::runtime_error("not a row of a recording: " + line);
    return true;
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

    isotherm::Acquisition acquisition(words[1]);
    std::puts("sequence,a1_dv,a2_dv,a3_dv,table,flags");
    for (;;) {
        auto sample = acquisition.loan();
        if (!next_sample(recording, *sample))
            return 0;
        const auto sequence = sample->sequence;
        auto answer = acquisition.compensate(sample, 10s);
        if (!answer) {
            std::cerr << "acquisition: sample " << sequence << " was not answered within 10 s\n";
            return 1;
        }
        const double *dv = answer->velocity_increment;
        std::printf("%" PRIu64 ",%.17g,%.17g,%.17g,%016" PRIx64 ",%s\n", answer->sequence, dv[0], dv[1], dv[2], answer->table,
                    isotherm::flags_text(answer->flags).c_str());
    }
} catch (const std::exception &error) {
    std::cerr << "acquisition: " << error.what() << '\n';
    return 1;
}
