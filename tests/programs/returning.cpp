// Checks that the C++ wrapper returns errors where exceptions are switched off: returning IMU. Exits with 0 if it does.
#include "check.hpp"
#include <isotherm.hpp>

#ifdef __cpp_exceptions
#error "compile it with -fno-exceptions"
#endif

using namespace std::chrono_literals;
using isotherm::Acquisition, isotherm::IncrementReader;

template <class T>
static isotherm_code failed(const isotherm::Result<T> &result)
{
    if (result.ok())
        return ISOTHERM_OK;
    CHECK(result.error().what() != std::string());
    return result.error().code();
}

int main(int, char **words)
{
    const std::string imu = words[1];
    CHECK(failed(Acquisition::connect(imu, {"nobody-here", 0s})) == ISOTHERM_ERROR_NO_SERVICE);
    CHECK(failed(IncrementReader::connect("no name")) == ISOTHERM_ERROR_NAME);
    auto connected = Acquisition::connect(imu, {std::nullopt, 20s});
    CHECK(connected.ok());
    Acquisition acquisition = std::move(connected).value();
    CHECK(failed(Acquisition::connect(imu, {std::nullopt, 0s})) != ISOTHERM_OK);
    auto reader = IncrementReader::connect(imu, {std::nullopt, 20s});
    CHECK(reader.ok() && reader.value().is_connected());

    CHECK(failed(acquisition.begin_session()) == ISOTHERM_OK);
    auto loan = acquisition.loan();
    CHECK(loan.ok());
    auto sample = std::move(loan).value();
    sample->interval_ns = 1000;
    auto answer = acquisition.compensate(sample, 20s);
    CHECK(answer.ok() && answer.value() && !sample && answer.value()->interval_ns == 1000);
    CHECK(failed(acquisition.send(sample)) == ISOTHERM_ERROR_NULL);
    auto read = reader.value().receive(20s);
    CHECK(read.ok() && read.value() && read.value()->sequence == answer.value()->sequence);
    auto nothing = reader.value().receive();
    CHECK(nothing.ok() && !nothing.value());

    do {
        auto next = acquisition.loan();
        CHECK(next.ok());
        sample = std::move(next).value();
        sample->interval_ns = 1;
        auto sent = acquisition.send(sample);
        CHECK(sent.ok() && sent.value() == !sample);
    } while (!sample);
    CHECK(failed(acquisition.begin_session()) == ISOTHERM_ERROR_IN_FLIGHT);
    CHECK(failed(acquisition.cancel(sample)) == ISOTHERM_OK && !sample);
    CHECK(failed(acquisition.reading(6, 2.0, 1)) == ISOTHERM_ERROR_VALUE);
    while (acquisition.in_flight() > 0)
        CHECK(acquisition.receive(20s).ok());
    auto said = acquisition.close();
    CHECK(said.ok() && said.value().empty());
    CHECK(failed(acquisition.loan()) == ISOTHERM_ERROR_NULL);
    CHECK(failed(isotherm::Realtime{100000u}.apply()) == ISOTHERM_ERROR_REALTIME);
}
