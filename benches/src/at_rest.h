/* The sample that the benches in C send, as `sample` of lib.rs. */
#include <isotherm.h>

#define TEMPERATURE \
    .head_temperature = {2.4, 2.41, 2.42}, .board_temperature = {2.5, 2.51, 2.52}, .head_lagged = {2.38, 2.39, 2.4}

static const isotherm_raw_sample at_rest = {
    .interval_ns = 2500000,
    .lag_ns = 240000000000,
    .accelerometers = {.positive_pulses = {140, 0, 150}, .negative_pulses = {0, 110, 0}, TEMPERATURE},
    .gyroscopes = {.positive_pulses = {20, 0, 3}, .negative_pulses = {0, 17, 4}, TEMPERATURE},
};
