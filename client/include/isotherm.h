/*
 * Isotherm: an acquisition process in C, or a reader of increments.
 *
 *     isotherm_options options = {.serial = "SN 42"};
 *     isotherm_compensated_increment increments[512];
 *     isotherm_acquisition *acquisition;
 *     isotherm_raw_sample *sample;
 *     size_t count;
 *     isotherm_code code = isotherm_acquisition_connect("imu-a", &options, &acquisition);
 *     while (code == ISOTHERM_OK && (code = isotherm_loan(acquisition, &sample)) == ISOTHERM_OK) {
 *         latch(acquisition, sample);                        // your hardware: waits for the end of the control period, gives new
 *                                                            // temperature to isotherm_reading, and fills the sample in
 *         code = isotherm_exchange(acquisition, sample, 1000000, increments, 512, &count);
 *         for (size_t i = 0; code == ISOTHERM_OK && i < count; i++)
 *             navigate(&increments[i]);                      // each once, in the order of sending
 *     }
 *     fprintf(stderr, "%s\n", isotherm_error_message());
 *     isotherm_acquisition_close(acquisition);
 *
 * This loop loses no control period while the service stalls, is away for up to 16384 periods, or is replaced.
 *
 * Service and clients run as the same user and use the same domain. docs/c.md describes how to compile and link; examples/c has
 * complete programs; isotherm.hpp is the same for C++.
 *
 * Results. Functions return an isotherm_code: 0 is success, positive codes are part of normal operation, negative codes are errors.
 * The description of each function ends with its codes. All of them may also return ISOTHERM_ERROR_NULL for a pointer that must
 * not be NULL, ISOTHERM_ERROR_BUSY, ISOTHERM_ERROR_FORKED and ISOTHERM_ERROR_INTERNAL. isotherm_error_message() has phase, cause and
 * remedy. Outputs are written with ISOTHERM_OK only, with one exception: if a handle cannot be created, its output becomes NULL.
 *
 * Pointers. Strings end with 0 and are copied. A handle may be used until it is closed, a sample until it is sent or discarded.
 * All other pointers are used during the call only.
 *
 * Threads. Any thread may use and close a handle, but only one at a time: a second call at the same moment returns
 * ISOTHERM_ERROR_BUSY and does nothing. Any thread may fill in a sample on loan. Different handles are independent of each other, and
 * functions without a handle may be called at any time. No function may be called from a signal handler; one that uses a
 * handle which the interrupted thread is using returns ISOTHERM_ERROR_BUSY, and allocates nothing.
 *
 * Processes. A child made by fork() can neither use nor close its parent's handles (ISOTHERM_ERROR_FORKED). It must not access its
 * parent's samples, and it must connect again. A child made by the system call clone() with a copy of the memory gets the same code,
 * but cannot connect, since the C library does not know it. A child that shares the memory, as by vfork(), must call no function.
 * exec() closes all descriptors of the library but the socket of each wake-up event, which needs no special care.
 *
 * Real time. isotherm_loan, _fill, _exchange, _send, _keep, _send_kept, _receive and _discard allocate nothing, take no lock and make no system
 * call while service and readers stay the same. The exceptions are the system call that wakes a sleeping service, and the sleeps of a
 * call that waits. What may take long is done by a helper thread of each acquisition, under SCHED_OTHER and with all signals blocked:
 * looking for what cuts the acquisition off, joining again, and reading the status. A thread that waits in a call must not be cancelled by
 * pthread_cancel, which would end the process. Messages of ISOTHERM_ERROR_TRANSPORT and of functions that connect are allocated, all
 * others are static.
 *
 * Priority. The service's worker must stand above its clients, in priority or on a core of its own. Below a client that spins it gets
 * only what the scheduler leaves: the median round trip was 35 ms in place of 1.9 us.
 *
 * Timestamps. With a `timestamp_ns` of 0 time steps are not found, and what is missing between two sessions is not counted.
 *
 * Warnings. A program that is cut off from the service, as by somebody who tidies /dev/shm, joins it again by itself, and writes a line
 * that begins with "isotherm: warning:" to stderr, if that can be written at once.
 *
 * No function unwinds, exits or installs a signal handler. Generated from client/c/src by cbindgen; do not edit.
 */

#ifndef ISOTHERM_H
#define ISOTHERM_H

#include <stdbool.h>
#include <stddef.h>
#include <stdint.h>
#include <math.h>

/** The version of this header; isotherm_version() is the version of the library. */
#define ISOTHERM_VERSION "0.1.0"
#define ISOTHERM_VERSION_MAJOR 0
#define ISOTHERM_VERSION_MINOR 1
#define ISOTHERM_VERSION_PATCH 0
/** For #if: major, minor and patch, two digits each. */
#define ISOTHERM_VERSION_NUMBER (ISOTHERM_VERSION_MAJOR * 10000 + ISOTHERM_VERSION_MINOR * 100 + ISOTHERM_VERSION_PATCH)


/**
 * Longest control period that can be compensated: one hour. A longer one, or 0, is flagged ISOTHERM_FLAG_INTERVAL.
 */
#define ISOTHERM_MAX_INTERVAL_NS 3600000000000

/**
 * Maximum number of samples on loan from one acquisition.
 */
#define ISOTHERM_LOANS 4

/**
 * Control periods that wait at most for a service that is away, unless `kept` in isotherm_options says otherwise: 30 s
 * at 546 Hz. They take 4.1 MiB.
 */
#define ISOTHERM_MOST_KEPT 16384

/**
 * Head temperature of A1 below the bias range.
 */
#define ISOTHERM_FLAG_A1_HEAD_BELOW (UINT64_C(1) << 0)

/**
 * Head temperature of A2 below the bias range.
 */
#define ISOTHERM_FLAG_A2_HEAD_BELOW (UINT64_C(1) << 1)

/**
 * Head temperature of A3 below the bias range.
 */
#define ISOTHERM_FLAG_A3_HEAD_BELOW (UINT64_C(1) << 2)

/**
 * Head temperature of A1 above the bias range.
 */
#define ISOTHERM_FLAG_A1_HEAD_ABOVE (UINT64_C(1) << 3)

/**
 * Head temperature of A2 above the bias range.
 */
#define ISOTHERM_FLAG_A2_HEAD_ABOVE (UINT64_C(1) << 4)

/**
 * Head temperature of A3 above the bias range.
 */
#define ISOTHERM_FLAG_A3_HEAD_ABOVE (UINT64_C(1) << 5)

/**
 * Board temperature of A1 below the range of K+ or K-.
 */
#define ISOTHERM_FLAG_A1_BOARD_BELOW (UINT64_C(1) << 6)

/**
 * Board temperature of A2 below the range of K+ or K-.
 */
#define ISOTHERM_FLAG_A2_BOARD_BELOW (UINT64_C(1) << 7)

/**
 * Board temperature of A3 below the range of K+ or K-.
 */
#define ISOTHERM_FLAG_A3_BOARD_BELOW (UINT64_C(1) << 8)

/**
 * Board temperature of A1 above the range of K+ or K-.
 */
#define ISOTHERM_FLAG_A1_BOARD_ABOVE (UINT64_C(1) << 9)

/**
 * Board temperature of A2 above the range of K+ or K-.
 */
#define ISOTHERM_FLAG_A2_BOARD_ABOVE (UINT64_C(1) << 10)

/**
 * Board temperature of A3 above the range of K+ or K-.
 */
#define ISOTHERM_FLAG_A3_BOARD_ABOVE (UINT64_C(1) << 11)

/**
 * Temperature of A1 NaN or infinite; the increment is NaN under any policy.
 */
#define ISOTHERM_FLAG_A1_NOT_FINITE (UINT64_C(1) << 12)

/**
 * Temperature of A2 NaN or infinite; the increment is NaN under any policy.
 */
#define ISOTHERM_FLAG_A2_NOT_FINITE (UINT64_C(1) << 13)

/**
 * Temperature of A3 NaN or infinite; the increment is NaN under any policy.
 */
#define ISOTHERM_FLAG_A3_NOT_FINITE (UINT64_C(1) << 14)

/**
 * More pulses per second on A1 than the table's `max_rate`.
 */
#define ISOTHERM_FLAG_A1_RATE (UINT64_C(1) << 15)

/**
 * More pulses per second on A2 than the table's `max_rate`.
 */
#define ISOTHERM_FLAG_A2_RATE (UINT64_C(1) << 16)

/**
 * More pulses per second on A3 than the table's `max_rate`.
 */
#define ISOTHERM_FLAG_A3_RATE (UINT64_C(1) << 17)

/**
 * Interval 0 or over ISOTHERM_MAX_INTERVAL_NS; the increments are NaN.
 */
#define ISOTHERM_FLAG_INTERVAL (UINT64_C(1) << 18)

/**
 * The IMU is served without a table (`--allow-uncalibrated`); the increments are NaN.
 */
#define ISOTHERM_FLAG_NO_TABLE (UINT64_C(1) << 19)

/**
 * The temperature is older than the table's `max_age_s`, or as much newer than the end of the control period; or the
 * acquisition has marked it.
 */
#define ISOTHERM_FLAG_TELEMETRY_STALE (UINT64_C(1) << 20)

/**
 * A bias had to do without its transient term: the sample's time constant is not the table's, or the lag difference is
 * not finite or larger than the bias's range.
 */
#define ISOTHERM_FLAG_LAG_UNKNOWN (UINT64_C(1) << 21)

/**
 * The sample is of another device than the table's.
 */
#define ISOTHERM_FLAG_OTHER_DEVICE (UINT64_C(1) << 22)

/**
 * A velocity increment is NaN, so that an angle was computed without its g-sensitivity.
 */
#define ISOTHERM_FLAG_G_UNKNOWN (UINT64_C(1) << 23)

/**
 * Samples of this session are missing before this one.
 */
#define ISOTHERM_FLAG_GAP (UINT64_C(1) << 24)

/**
 * The latency was over the configured budget.
 */
#define ISOTHERM_FLAG_LATE (UINT64_C(1) << 25)

/**
 * No sequence is missing before this sample, and its `timestamp_ns` is not one `interval_ns` after that of the sample
 * before: the step differs from the interval by more than half of it. Time was lost, or the interval is wrong.
 */
#define ISOTHERM_FLAG_TIME_STEP (UINT64_C(1) << 26)

/**
 * The first sample of a session other than the one that was served last for this IMU, by this service or by the one
 * before it since boot. Time may be missing before it.
 */
#define ISOTHERM_FLAG_SESSION (UINT64_C(1) << 27)

/**
 * Head temperature of G1 below the bias range.
 */
#define ISOTHERM_FLAG_G1_HEAD_BELOW (UINT64_C(1) << 32)

/**
 * Head temperature of G2 below the bias range.
 */
#define ISOTHERM_FLAG_G2_HEAD_BELOW (UINT64_C(1) << 33)

/**
 * Head temperature of G3 below the bias range.
 */
#define ISOTHERM_FLAG_G3_HEAD_BELOW (UINT64_C(1) << 34)

/**
 * Head temperature of G1 above the bias range.
 */
#define ISOTHERM_FLAG_G1_HEAD_ABOVE (UINT64_C(1) << 35)

/**
 * Head temperature of G2 above the bias range.
 */
#define ISOTHERM_FLAG_G2_HEAD_ABOVE (UINT64_C(1) << 36)

/**
 * Head temperature of G3 above the bias range.
 */
#define ISOTHERM_FLAG_G3_HEAD_ABOVE (UINT64_C(1) << 37)

/**
 * Board temperature of G1 below the range of K+ or K-.
 */
#define ISOTHERM_FLAG_G1_BOARD_BELOW (UINT64_C(1) << 38)

/**
 * Board temperature of G2 below the range of K+ or K-.
 */
#define ISOTHERM_FLAG_G2_BOARD_BELOW (UINT64_C(1) << 39)

/**
 * Board temperature of G3 below the range of K+ or K-.
 */
#define ISOTHERM_FLAG_G3_BOARD_BELOW (UINT64_C(1) << 40)

/**
 * Board temperature of G1 above the range of K+ or K-.
 */
#define ISOTHERM_FLAG_G1_BOARD_ABOVE (UINT64_C(1) << 41)

/**
 * Board temperature of G2 above the range of K+ or K-.
 */
#define ISOTHERM_FLAG_G2_BOARD_ABOVE (UINT64_C(1) << 42)

/**
 * Board temperature of G3 above the range of K+ or K-.
 */
#define ISOTHERM_FLAG_G3_BOARD_ABOVE (UINT64_C(1) << 43)

/**
 * Temperature of G1 NaN or infinite; the increment is NaN under any policy.
 */
#define ISOTHERM_FLAG_G1_NOT_FINITE (UINT64_C(1) << 44)

/**
 * Temperature of G2 NaN or infinite; the increment is NaN under any policy.
 */
#define ISOTHERM_FLAG_G2_NOT_FINITE (UINT64_C(1) << 45)

/**
 * Temperature of G3 NaN or infinite; the increment is NaN under any policy.
 */
#define ISOTHERM_FLAG_G3_NOT_FINITE (UINT64_C(1) << 46)

/**
 * More pulses per second on G1 than the table's `max_rate`.
 */
#define ISOTHERM_FLAG_G1_RATE (UINT64_C(1) << 47)

/**
 * More pulses per second on G2 than the table's `max_rate`.
 */
#define ISOTHERM_FLAG_G2_RATE (UINT64_C(1) << 48)

/**
 * More pulses per second on G3 than the table's `max_rate`.
 */
#define ISOTHERM_FLAG_G3_RATE (UINT64_C(1) << 49)

/**
 * The table has a nominal interval, and the sample's is not within 1 % of 1 to 64 times that: the scale factors are of
 * another interval. The increment is computed.
 */
#define ISOTHERM_FLAG_INTERVAL_NOT_NOMINAL (UINT64_C(1) << 50)

/**
 * Mask: an increment could not be computed and is NaN, on one axis or on all. interval, no-table, not-finite.
 */
#define ISOTHERM_MASK_INVALID (((((((ISOTHERM_FLAG_INTERVAL | ISOTHERM_FLAG_NO_TABLE) | ISOTHERM_FLAG_A1_NOT_FINITE) | ISOTHERM_FLAG_A2_NOT_FINITE) | ISOTHERM_FLAG_A3_NOT_FINITE) | ISOTHERM_FLAG_G1_NOT_FINITE) | ISOTHERM_FLAG_G2_NOT_FINITE) | ISOTHERM_FLAG_G3_NOT_FINITE)

/**
 * Mask: computed, outside of what the calibration covers or without a part of it; the ranges give NaN where the
 * table's policy is `reject`. Ranges, rate, telemetry-stale, lag-unknown, other-device, g-unknown,
 * interval-not-nominal.
 */
#define ISOTHERM_MASK_DEGRADED ((1002750317137919 | ISOTHERM_FLAG_G_UNKNOWN) | ISOTHERM_FLAG_INTERVAL_NOT_NOMINAL)

/**
 * Mask: time is missing before this increment, or may be. gap, time-step, session.
 */
#define ISOTHERM_MASK_LOST ((ISOTHERM_FLAG_GAP | ISOTHERM_FLAG_TIME_STEP) | ISOTHERM_FLAG_SESSION)

/**
 * Mask: says nothing against the increment. late.
 */
#define ISOTHERM_MASK_INFORMATION ISOTHERM_FLAG_LATE

/**
 * Number of sensors: A1, A2, A3, G1, G2, G3 have the numbers 0 to 5.
 */
#define ISOTHERM_SENSORS 6

/**
 * For isotherm_options: the time constant of the table in force. It is 0, so that it is the default.
 *
 * It is read from the status of the service when the acquisition connects, and again when an increment is flagged
 * ISOTHERM_FLAG_LAG_UNKNOWN: if the table has another one after a reload, a few samples are flagged, until the next
 * readings. Connecting waits for the status beyond its time-out, 0.1 s or less, and 1 s for a service that hangs.
 */
#define ISOTHERM_LAG_SERVICE 0.0

/**
 * For isotherm_options: the library keeps no lag. `lag_ns` and `head_lagged` are sent as the application fills them
 * in.
 */
#define ISOTHERM_LAG_NONE (-1.0)

/**
 * For connecting: do not wait for the service.
 */
#define ISOTHERM_NO_WAIT UINT64_MAX

/**
 * Result of a call: 0 is success, positive codes are part of normal operation, negative codes are errors. The numbers
 * never change; later versions may add codes.
 */
enum isotherm_code
#if defined(__cplusplus) || __STDC_VERSION__ >= 202311L
  : int32_t
#endif // defined(__cplusplus) || __STDC_VERSION__ >= 202311L
 {
    /**
     * Success.
     */
    ISOTHERM_OK = 0,
    /**
     * There is no increment now, or none came in time. Nothing has been written.
     */
    ISOTHERM_NONE = 1,
    /**
     * As many samples are unanswered as the service's queue holds, or others are kept, which go first and for which
     * there is no room either. The sample has not been sent and is still yours: keep it with isotherm_keep, wait and
     * send it again, or discard it, which is a gap.
     */
    ISOTHERM_FULL = 2,
    /**
     * The sample was sent, but its increment did not come in time. It stays in flight: it is sent again when a new
     * service has started, and its late increment is kept for isotherm_receive.
     */
    ISOTHERM_TIMEOUT = 3,
    /**
     * The acquisition is closed. Control periods were lost, or samples were unanswered: the message has their numbers,
     * and the service keeps them in its status.
     */
    ISOTHERM_LOST = 4,
    /**
     * A pointer is NULL that must not be NULL.
     */
    ISOTHERM_ERROR_NULL = -1,
    /**
     * The name of an IMU or a domain is not 1 to 32 of a-z 0-9 - _, or the domain's folder (ISOTHERM_ROOT) cannot be
     * used.
     */
    ISOTHERM_ERROR_NAME = -2,
    /**
     * No service runs in the domain.
     */
    ISOTHERM_ERROR_NO_SERVICE = -3,
    /**
     * The service does not serve this IMU.
     */
    ISOTHERM_ERROR_NO_SUCH_IMU = -4,
    /**
     * Another process, or another handle, is this IMU's acquisition.
     */
    ISOTHERM_ERROR_OCCUPIED = -5,
    /**
     * All reader places of the IMU are taken.
     */
    ISOTHERM_ERROR_NO_ROOM = -6,
    /**
     * The domain belongs to another user, or others could put something into its place.
     */
    ISOTHERM_ERROR_PERMISSION = -7,
    /**
     * Shared memory, disk space or the file descriptors of the process are exhausted.
     */
    ISOTHERM_ERROR_EXHAUSTED = -8,
    /**
     * The transport failed; the message has the phase and the cause. A sample that was being sent is lost, and the
     * service will flag the gap.
     */
    ISOTHERM_ERROR_TRANSPORT = -9,
    /**
     * The sample is not on loan from this acquisition: it has been sent or discarded, or was never loaned from it.
     */
    ISOTHERM_ERROR_NOT_ON_LOAN = -10,
    /**
     * ISOTHERM_LOANS samples are on loan already.
     */
    ISOTHERM_ERROR_LOANS = -11,
    /**
     * The sequence is not above the last one sent or kept in this session. The sample is still yours.
     */
    ISOTHERM_ERROR_SEQUENCE = -12,
    /**
     * Samples of the old session are unanswered, or kept.
     */
    ISOTHERM_ERROR_IN_FLIGHT = -13,
    /**
     * The two samples cannot be summed: a channel's pulses exceed 32 bits, or the interval one hour, or both are the
     * same sample. Neither has changed.
     */
    ISOTHERM_ERROR_MERGE = -14,
    /**
     * The operating system refused a real-time setting; the message has the setting, the cause and a remedy.
     */
    ISOTHERM_ERROR_REALTIME = -15,
    /**
     * Another call uses this handle at this moment, in another thread or interrupted by a signal handler. Nothing has
     * been done.
     */
    ISOTHERM_ERROR_BUSY = -16,
    /**
     * The handle belongs to the process that this one was forked from. Nothing has been done.
     */
    ISOTHERM_ERROR_FORKED = -17,
    /**
     * A fault of this library, in this call or in an earlier one with the same handle. The handle can only be closed
     * now. Please report the fault, with the text on stderr.
     */
    ISOTHERM_ERROR_INTERNAL = -18,
    /**
     * A value that cannot be: the number of a sensor, a time constant, a serial number that is not UTF-8, the size of
     * isotherm_options, or a reading, a resolution or an interval that cannot become pulses.
     */
    ISOTHERM_ERROR_VALUE = -19,
    /**
     * A process of another version of Isotherm has made the streams.
     */
    ISOTHERM_ERROR_OTHER_VERSION = -20,
};
#ifndef __cplusplus
#if __STDC_VERSION__ >= 202311L
typedef enum isotherm_code isotherm_code;
#else
typedef int32_t isotherm_code;
#endif // __STDC_VERSION__ >= 202311L
#endif // __cplusplus

/**
 * The one acquisition process of an IMU. It sends raw samples and receives their increments, each once and in the
 * order of sending.
 */
typedef struct isotherm_acquisition isotherm_acquisition;

/**
 * Reads the increments of one IMU as they are published: for navigation and loggers. Each (session, sequence) is
 * returned once. A reader cannot disturb other processes. If it sleeps for more than 512 increments, the oldest are
 * overwritten, which is a gap in `sequence`.
 */
typedef struct isotherm_reader isotherm_reader;

/**
 * How an acquisition reaches the service, and what it reports to it. A field that is 0 or NULL has its default, so
 * begin with `isotherm_options options = {0};`.
 */
typedef struct {
    /**
     * sizeof(isotherm_options), or 0. A later version may add fields at the end: it reads only those that the size
     * has, and with 0 those of this version.
     */
    uint64_t size;
    /**
     * Name of the service's domain. If it is NULL, the environment variable ISOTHERM_DOMAIN names the domain,
     * otherwise it is "default".
     */
    const char *domain;
    /**
     * How long connecting may take [ns]. This includes waiting for a service that has not started yet. 0 is the
     * default, 5 s; ISOTHERM_NO_WAIT does not wait.
     */
    uint64_t timeout_ns;
    /**
     * Serial number of the device, in UTF-8; NULL if it is not known. The service flags samples of another device than
     * the table's. Outer blanks do not count.
     */
    const char *serial;
    /**
     * Time constant of the lagged temperature [s], 0.1 to 86400, or ISOTHERM_LAG_SERVICE or ISOTHERM_LAG_NONE.
     */
    double lag_s;
    /**
     * How many control periods wait at most for a service that has no room or is away, 1 to 2^20; 0 is the default,
     * ISOTHERM_MOST_KEPT. Each takes 256 bytes, which are allocated when the acquisition connects.
     */
    uint64_t kept;
    /**
     * What one pulse of an accelerometer over the nominal interval of the table stands for [m/s2], 1e-15 to 1e6, such
     * as 1e-6, if the samples are readings: then isotherm_fill makes their pulses. 0: they have pulses of their own.
     */
    double accelerometer_resolution;
    /**
     * The same of a gyroscope [rad/s], such as 1e-7, also if there is none.
     */
    double gyroscope_resolution;
} isotherm_options;

/**
 * What three sensors of one kind, accelerometers or gyroscopes, have measured in a control period.
 */
typedef struct {
    /**
     * Pulses of the positive channel in Ts (N+).
     */
    uint32_t positive_pulses[3];
    /**
     * Pulses of the negative channel in Ts (N-), counted upwards from 0 like the positive ones.
     */
    uint32_t negative_pulses[3];
    /**
     * Temperature of the sensing element, in the table's unit; it drives the bias.
     */
    double head_temperature[3];
    /**
     * Temperature of the converter board, in the table's unit; it drives both scale factors.
     */
    double board_temperature[3];
    /**
     * The head temperature behind a first-order lag of `lag_ns` of the sample, in the table's unit; unused if that is
     * 0.
     */
    double head_lagged[3];
} isotherm_triad;

/**
 * One control period as the acquisition saw it: the pulses of both channels and the latest temperature.
 */
typedef struct {
    /**
     * Random number that the acquisition chooses each time it starts; a resent sample keeps it.
     */
    uint64_t session;
    /**
     * Rises by one with each sample of a session; the first may be any number.
     */
    uint64_t sequence;
    /**
     * End of the control period on the acquisition's clock [ns]; 0 = not given: then no time step is found, and
     * what is missing between two sessions is not counted.
     */
    uint64_t timestamp_ns;
    /**
     * Control period Ts, the measured gate length [ns], 1 to ISOTHERM_MAX_INTERVAL_NS.
     */
    uint64_t interval_ns;
    /**
     * `CLOCK_MONOTONIC` when the sample was sent [ns]; 0 = unknown.
     */
    uint64_t sent_ns;
    /**
     * When the temperatures were read, on the clock of `timestamp_ns` [ns]; 0 = unknown. The highest bit,
     * 1 << 63, is no part of the time: it marks temperature that the acquisition holds for stale.
     */
    uint64_t telemetry_ns;
    /**
     * Time constant of the lagged temperature [ns]; 0 = there is none.
     */
    uint64_t lag_ns;
    /**
     * Which unit this is: isotherm_device() of its serial number; 0 = unknown.
     */
    uint64_t device;
    /**
     * A1, A2, A3.
     */
    isotherm_triad accelerometers;
    /**
     * G1, G2, G3; where the IMU has none, no pulses and temperature NaN (or 0).
     */
    isotherm_triad gyroscopes;
} isotherm_raw_sample;

/**
 * The compensated answer to one isotherm_raw_sample.
 */
typedef struct {
    /**
     * Copied from the raw sample.
     */
    uint64_t session;
    /**
     * Copied from the raw sample.
     */
    uint64_t sequence;
    /**
     * Copied from the raw sample [ns].
     */
    uint64_t timestamp_ns;
    /**
     * Copied from the raw sample [ns].
     */
    uint64_t interval_ns;
    /**
     * Velocity increment over Ts [m/s]; NaN where it could not be computed, never a guess.
     */
    double velocity_increment[3];
    /**
     * Angle increment over Ts [rad]; NaN where it could not be computed, and where the table has no gyroscopes.
     */
    double angle_increment[3];
    /**
     * Which coefficients were used: the first 8 bytes of the table's digest, big-endian; 0 without a table.
     */
    uint64_t table;
    /**
     * ISOTHERM_FLAG_.., joined by |; isotherm_flags_text names them.
     */
    uint64_t flags;
    /**
     * Time from the raw sample's `sent_ns` to just before publishing [ns]. If `sent_ns` is unknown, the time counts
     * from when the service found the sample.
     */
    uint64_t latency_ns;
} isotherm_compensated_increment;

/**
 * The state of one sensor's lag: its last reading, and the lagged temperature at that time.
 */
typedef struct {
    /**
     * When the temperature was measured, on the acquisition's clock [ns].
     */
    uint64_t time_ns;
    /**
     * Head temperature, in the table's unit.
     */
    double telemetry;
    /**
     * Lagged temperature, in the table's unit; NaN before the first reading.
     */
    double lagged;
    /**
     * The share of the lagged temperature that rests on an unknown start, 0 to 1; 0 where the sensor was soaked.
     * Over 0.05 samples are sent without it.
     */
    double unknown;
} isotherm_lagged_reading;

/**
 * The state of an acquisition's lag. It may be saved as its bytes: it has no padding, and every bit pattern is valid.
 */
typedef struct {
    /**
     * A1, A2, A3, G1, G2, G3.
     */
    isotherm_lagged_reading sensors[ISOTHERM_SENSORS];
} isotherm_lag;

#ifdef __cplusplus
extern "C" {
#endif // __cplusplus

/**
 * Connects as the acquisition of an IMU, waiting for the service if necessary.
 *
 * `imu` is the IMU's name. If `options` is NULL, all have their defaults. The handle is written to
 * `*acquisition`; NULL is written if the call fails. Close the handle with isotherm_acquisition_close.
 *
 * ISOTHERM_OK, ISOTHERM_ERROR_NAME, .._NO_SERVICE, .._NO_SUCH_IMU, .._OCCUPIED, .._NO_ROOM, .._PERMISSION,
 * .._EXHAUSTED, .._TRANSPORT, .._VALUE for a serial number that is not UTF-8, a `lag_s` that is no time constant, a
 * resolution whose pulses are not those of the table, or another `size`.
 */
isotherm_code isotherm_acquisition_connect(const char *imu,
                                           const isotherm_options *options,
                                           isotherm_acquisition **acquisition);

/**
 * Leaves the streams and frees the handle, with all samples that are on loan from it, which count as lost. NULL is
 * allowed.
 *
 * ISOTHERM_OK; ISOTHERM_LOST if control periods were not sent (isotherm_lost) or samples are unanswered
 * (isotherm_in_flight): the handle is closed all the same. After ISOTHERM_ERROR_BUSY and ISOTHERM_ERROR_FORKED the
 * handle is still open.
 */
isotherm_code isotherm_acquisition_close(isotherm_acquisition *acquisition);

/**
 * Loans a sample in shared memory, to be filled in; sending does not copy it. `*sample` is yours until it is sent or
 * discarded, or until the handle is closed. At most ISOTHERM_LOANS samples may be on loan at once.
 *
 * `session` and `sequence` are set already, every head and board temperature is NaN, all other fields are 0. Set them,
 * except `sent_ns`, `device` and what isotherm_reading is for: `lag_ns` and `head_lagged`. A temperature that is not
 * set gives NaN for its sensor, flagged ISOTHERM_FLAG_A1_NOT_FINITE and so on. `sequence` is one above the highest
 * that was loaned or sent in the session: a sample that is discarded leaves its sequence out, and the service flags
 * the gap. If periods were lost before they could be loaned, raise `sequence` by their number.
 *
 * ISOTHERM_OK, ISOTHERM_ERROR_LOANS, ISOTHERM_ERROR_TRANSPORT.
 */
isotherm_code isotherm_loan(isotherm_acquisition *acquisition, isotherm_raw_sample **sample);

/**
 * Gives a sample back without sending it: its control period is lost. Its sequence is left out, so that the service
 * flags the gap.
 *
 * ISOTHERM_OK, ISOTHERM_ERROR_NOT_ON_LOAN.
 */
isotherm_code isotherm_discard(isotherm_acquisition *acquisition, isotherm_raw_sample *sample);

/**
 * Gives a sample back that stands for no control period, as at the end of a recording, and takes its sequence back.
 * Only that of the last loan: the sequence of an earlier one stays left out.
 *
 * ISOTHERM_OK, ISOTHERM_ERROR_NOT_ON_LOAN.
 */
isotherm_code isotherm_cancel(isotherm_acquisition *acquisition, isotherm_raw_sample *sample);

/**
 * Adds the next control period to a sample: pulses and intervals are summed, timestamp, temperature and device become
 * the later ones, session, sequence and `sent_ns` stay. An `interval_ns` of 0, which is not known, stays 0, and the
 * sum is flagged ISOTHERM_FLAG_INTERVAL. If `later` is on loan from this acquisition, its loan is cancelled, as by
 * isotherm_cancel: its pointer must not be used any more. Otherwise, it does not change. Either may be a sample of
 * your own; `acquisition` may be NULL if both are.
 *
 * The increments are linear in pulses and interval, so no velocity and no angle is lost if the temperature is the same
 * in both periods. If the sum is dropped, that is one sequence, whatever it holds. This is for devices that sum by
 * themselves: periods for which the service has no room wait as they are (isotherm_exchange, isotherm_keep).
 *
 * ISOTHERM_OK; ISOTHERM_ERROR_MERGE, after which neither has changed, and a loan is still yours.
 */
isotherm_code isotherm_merge(isotherm_acquisition *acquisition,
                             isotherm_raw_sample *sample,
                             const isotherm_raw_sample *later);

/**
 * Serves a control period: sends all that waits, oldest first, then `sample`, waits up to `timeout_ns` for its
 * increment, and writes **all** increments that have arrived to `increments`, each once and in the order of sending.
 * `*count` is how many. At most `capacity` are written; the others come with the next call.
 *
 * What the service has no room for waits in the memory of this process (isotherm_kept), and a later call sends it: 256
 * samples at once, then 16 in a millisecond, which readers and recorders can take. So a loop of only this call loses
 * no control period while the service stalls, is away for as many periods as may be kept, or is replaced. Then fewer
 * increments come, or none, which is no error, and later more than one.
 *
 * Give a time-out that is shorter than the control period; 0 does not wait. `increments` may be NULL if `capacity` is
 * 0.
 *
 * After ISOTHERM_OK the sample's pointer must not be used any more. After ISOTHERM_ERROR_SEQUENCE and
 * ISOTHERM_ERROR_FORKED the sample is still yours.
 *
 * ISOTHERM_OK, ISOTHERM_ERROR_NOT_ON_LOAN, ISOTHERM_ERROR_SEQUENCE.
 */
isotherm_code isotherm_exchange(isotherm_acquisition *acquisition,
                                isotherm_raw_sample *sample,
                                uint64_t timeout_ns,
                                isotherm_compensated_increment *increments,
                                size_t capacity,
                                size_t *count);

/**
 * Sends a sample and wakes the service, after all that is kept. Never waits, and the transport never copies the
 * sample. `device` is set, and `lag_ns` with the lagged temperature, where they are 0.
 *
 * After ISOTHERM_OK and ISOTHERM_ERROR_TRANSPORT the sample's pointer must not be used any more.
 * After ISOTHERM_FULL and ISOTHERM_ERROR_SEQUENCE the sample is still yours.
 *
 * ISOTHERM_OK, ISOTHERM_FULL, ISOTHERM_ERROR_NOT_ON_LOAN, ISOTHERM_ERROR_SEQUENCE, ISOTHERM_ERROR_TRANSPORT.
 */
isotherm_code isotherm_send(isotherm_acquisition *acquisition, isotherm_raw_sample *sample);

/**
 * Keeps a control period that isotherm_send or isotherm_compensate has handed back (ISOTHERM_FULL), or any other: it
 * waits in memory of this process, as it is, and is sent before all that comes later. The loan is free again. Nothing
 * is allocated. isotherm_exchange does this by itself.
 *
 * At most `kept` of isotherm_options periods wait. Beyond that the oldest is dropped and counts as lost
 * (isotherm_lost): a gap for every reader. `sent_ns` and the lagged temperature are those of the time of this call.
 *
 * After ISOTHERM_OK the sample's pointer must not be used any more. After ISOTHERM_ERROR_SEQUENCE, for a sequence that
 * is not above the last one sent or kept, the sample is still yours.
 *
 * ISOTHERM_OK, ISOTHERM_ERROR_NOT_ON_LOAN, ISOTHERM_ERROR_SEQUENCE.
 */
isotherm_code isotherm_keep(isotherm_acquisition *acquisition, isotherm_raw_sample *sample);

/**
 * Sends what is kept, oldest first, as far as the service takes it now: until isotherm_depth samples are unanswered,
 * and after an outage no faster than readers and recorders take it (256 samples at once, then 16 in a millisecond).
 * Never waits. Every sending call begins with it. Without anything kept it does nothing.
 *
 * ISOTHERM_OK, also if some or all go on to wait: isotherm_kept shows it. ISOTHERM_ERROR_TRANSPORT: the period that
 * was being sent counts as unanswered, and will be sent again.
 */
isotherm_code isotherm_send_kept(isotherm_acquisition *acquisition);

/**
 * Control periods that wait: they are kept, and not sent yet. 0 for a handle that cannot be used.
 */
uint64_t isotherm_kept(const isotherm_acquisition *acquisition);

/**
 * Goes through the motions of sending a sample and receiving its increment, so that the next sample finds its way
 * warm. Nobody else sees anything of it. Call it while you wait for the end of a control period, some tens of
 * microseconds before it; it takes about a microsecond, in cold caches some ten.
 *
 * ISOTHERM_OK.
 */
isotherm_code isotherm_prepare(isotherm_acquisition *acquisition);

/**
 * The increment of the oldest unanswered sample, if it has come. Does not wait. First come the late increments that
 * isotherm_compensate has kept aside.
 *
 * While samples are unanswered it also checks, about every 5 ms, whether the service has been replaced. If so, it
 * sends the unanswered samples again. So call it repeatedly while you wait.
 *
 * ISOTHERM_OK, ISOTHERM_NONE, ISOTHERM_ERROR_TRANSPORT.
 */
isotherm_code isotherm_receive(isotherm_acquisition *acquisition, isotherm_compensated_increment *increment);

/**
 * As isotherm_receive, but waits up to `timeout_ns`: it spins for the first 100 us, then sleeps for short times, and
 * sends what is kept.
 */
isotherm_code isotherm_receive_timeout(isotherm_acquisition *acquisition,
                                       uint64_t timeout_ns,
                                       isotherm_compensated_increment *increment);

/**
 * The round trip of one sample, for programs that send one now and then: sends it and waits up to `timeout_ns` for its
 * increment, which comes before those of earlier samples whose time-out has passed. These are kept aside for
 * isotherm_receive: at most isotherm_depth, then the oldest is dropped. They count neither as in flight nor for a full
 * queue. A time-out of 0 does not wait. Where order matters, as for angles, use isotherm_exchange.
 *
 * After ISOTHERM_FULL and ISOTHERM_ERROR_SEQUENCE the sample is still yours. After ISOTHERM_OK, ISOTHERM_TIMEOUT and
 * ISOTHERM_ERROR_TRANSPORT its pointer must not be used any more.
 *
 * ISOTHERM_OK, ISOTHERM_FULL, ISOTHERM_TIMEOUT, ISOTHERM_ERROR_NOT_ON_LOAN, ISOTHERM_ERROR_SEQUENCE,
 * ISOTHERM_ERROR_TRANSPORT.
 */
isotherm_code isotherm_compensate(isotherm_acquisition *acquisition,
                                  isotherm_raw_sample *sample,
                                  uint64_t timeout_ns,
                                  isotherm_compensated_increment *increment);

/**
 * The most samples that can be unanswered at once. 0 for a handle that cannot be used.
 */
size_t isotherm_depth(const isotherm_acquisition *acquisition);

/**
 * Samples that have been sent and whose increments have not been received. 0 for a handle that cannot be used.
 */
size_t isotherm_in_flight(const isotherm_acquisition *acquisition);

/**
 * Control periods, of all sessions of this connection, that have a sequence and are gone: samples that were discarded
 * or are still on loan, sequences that were left out, periods for which the waiting line had no room, and samples
 * whose sending has failed. What waits is not lost: isotherm_kept. 0 for a handle that cannot be used.
 */
uint64_t isotherm_lost(const isotherm_acquisition *acquisition);

/**
 * Late increments that were dropped because isotherm_depth of them waited for isotherm_receive already. 0 for a handle
 * that cannot be used.
 */
uint64_t isotherm_dropped_answers(const isotherm_acquisition *acquisition);

/**
 * The session of all samples; a new random number for each connection. 0 for a handle that cannot be used.
 */
uint64_t isotherm_session(const isotherm_acquisition *acquisition);

/**
 * Begins a new session: the next sample may have any sequence. What the temperatures have been is not known then,
 * unless isotherm_restore_lag or isotherm_soaked follows.
 *
 * It fails while samples are unanswered or kept. If the device resets meanwhile, with a clock or counter that begins
 * anew, go on with isotherm_send_kept and isotherm_receive until isotherm_in_flight and isotherm_kept are 0, hold the
 * new samples back until then, and begin the session for the first of them. If the service does not come back, close
 * the handle, which reports what is lost, and connect again: that begins a session too.
 *
 * ISOTHERM_OK, ISOTHERM_ERROR_IN_FLIGHT if samples are unanswered or kept.
 */
isotherm_code isotherm_begin_session(isotherm_acquisition *acquisition);

/**
 * The message of this thread's last call that returned neither ISOTHERM_OK nor ISOTHERM_NONE: phase, cause and remedy,
 * in UTF-8. Empty if there was no such call; never NULL. Valid until the thread's next such call or its end: copy it
 * if you keep it.
 */
const char *isotherm_error_message(void);

/**
 * Takes a new reading of a sensor's head temperature, in the table's unit, measured at `time_ns` on your clock. Every
 * sample that is sent later carries the lagged temperature of all readings so far, in `lag_ns` and `head_lagged`.
 *
 * `sensor` is 0 to 5 for A1, A2, A3, G1, G2, G3. Call it for every sensor that the IMU has, and once for each new
 * measurement, not for each sample. A value that is not finite, or has the time of the last reading, is no reading.
 * With ISOTHERM_LAG_SERVICE neither is one that no thermometer gives: far outside the ranges of the table in force, or
 * a step that is too fast. docs/temperature-in-motion.md has the formula and the limits.
 *
 * If the service has taken a table with another time constant, with ISOTHERM_LAG_SERVICE, this call has the helper
 * thread of the acquisition read the status, and a later call takes it.
 *
 * ISOTHERM_OK, ISOTHERM_ERROR_VALUE for another `sensor`.
 */
isotherm_code isotherm_reading(isotherm_acquisition *acquisition, uint32_t sensor, double telemetry, uint64_t time_ns);

/**
 * Takes a new reading of one head temperature that all sensors share, as of an IMU with one thermometer: as
 * isotherm_reading once for each of the six. Gyroscopes that the IMU does not have stay absent.
 *
 * ISOTHERM_OK.
 */
isotherm_code isotherm_reading_of_all(isotherm_acquisition *acquisition, double temperature, uint64_t time_ns);

/**
 * The time constant that samples are sent with [ns]; 0 while there is none, and for a handle that cannot be used.
 */
uint64_t isotherm_lag_ns(const isotherm_acquisition *acquisition);

/**
 * Writes the state of the lag to `*lag`. Save it after each reading if a successor of this process shall go on with
 * it, together with isotherm_boot().
 *
 * ISOTHERM_OK.
 */
isotherm_code isotherm_save_lag(const isotherm_acquisition *acquisition, isotherm_lag *lag);

/**
 * Goes on with a state that was saved, on the same clock, as if the temperature had gone straight on in the pause. A
 * sensor whose temperature or lagged temperature is not finite, or whose next reading is earlier than the saved one,
 * which is then of another clock, is unknown as after isotherm_forget_lag.
 *
 * Call isotherm_forget_lag in its place if the state was saved with another isotherm_boot(), unless your clock goes on
 * when the machine is started anew.
 *
 * ISOTHERM_OK.
 */
isotherm_code isotherm_restore_lag(isotherm_acquisition *acquisition, const isotherm_lag *lag);

/**
 * Informs the library that what the temperatures have been is not known. That is so already when the acquisition
 * connects, and when it begins a session. Increments are flagged ISOTHERM_FLAG_LAG_UNKNOWN, and computed without the
 * transient terms, until the readings span three time constants.
 *
 * ISOTHERM_OK.
 */
isotherm_code isotherm_forget_lag(isotherm_acquisition *acquisition);

/**
 * Informs the library that the IMU is soaked: its temperatures have been those of the next readings for three time
 * constants. Only what has just been powered, or has stood long enough, is. If it is not, the lagged temperature is
 * wrong by the difference, which decays with the time constant, and no flag shows it.
 *
 * ISOTHERM_OK.
 */
isotherm_code isotherm_soaked(isotherm_acquisition *acquisition);

/**
 * Creates a reader that connects at once if the service is there, and otherwise in a later call, as soon as it is;
 * does not wait for it. `domain` is as in isotherm_options. Close the handle with isotherm_reader_close.
 *
 * If isotherm_reader_is_connected is true then, nothing is missed that is published from now on. If it is false, what
 * is published before the call that connects it is not received. What prevents it from ever connecting is the error of
 * the next call.
 *
 * ISOTHERM_OK, ISOTHERM_ERROR_NAME.
 */
isotherm_code isotherm_reader_new(const char *imu, const char *domain, isotherm_reader **reader);

/**
 * Creates a connected reader, waiting up to `timeout_ns` for the service if necessary: 0 is the default, 5 s;
 * ISOTHERM_NO_WAIT does not wait. `domain` is as in isotherm_options. Close the handle with isotherm_reader_close.
 *
 * ISOTHERM_OK, ISOTHERM_ERROR_NAME, .._NO_SERVICE, .._NO_SUCH_IMU, .._NO_ROOM, .._PERMISSION, .._EXHAUSTED,
 * .._TRANSPORT.
 */
isotherm_code isotherm_reader_connect(const char *imu,
                                      const char *domain,
                                      uint64_t timeout_ns,
                                      isotherm_reader **reader);

/**
 * Leaves the stream and frees the handle. NULL is allowed.
 *
 * ISOTHERM_OK. After ISOTHERM_ERROR_BUSY and ISOTHERM_ERROR_FORKED the handle is still open.
 */
isotherm_code isotherm_reader_close(isotherm_reader *reader);

/**
 * The next increment, if there is one now. Does not wait. The reader stays connected across restarts of service and
 * acquisition.
 *
 * ISOTHERM_OK, ISOTHERM_NONE (also while there is no service yet), ISOTHERM_ERROR_NO_ROOM, ISOTHERM_ERROR_PERMISSION,
 * ISOTHERM_ERROR_EXHAUSTED, ISOTHERM_ERROR_TRANSPORT.
 */
isotherm_code isotherm_reader_receive(isotherm_reader *reader, isotherm_compensated_increment *increment);

/**
 * As isotherm_reader_receive, but waits up to `timeout_ns`: sleeps until the service signals that increments are
 * there. For the least delay call isotherm_reader_receive in a loop.
 */
isotherm_code isotherm_reader_receive_timeout(isotherm_reader *reader,
                                              uint64_t timeout_ns,
                                              isotherm_compensated_increment *increment);

/**
 * A descriptor for poll, epoll and the like: readable when increments may have come. Then call isotherm_reader_receive
 * until it returns ISOTHERM_NONE, which makes it unreadable, at most 5 ms later where the notification came late. Wait
 * for at most some 100 ms at once, and call isotherm_reader_receive after that too: a notification can be lost. It
 * belongs to the reader, which closes it, and stays the same as long as the reader.
 *
 * ISOTHERM_OK, ISOTHERM_ERROR_NO_SERVICE (also while the reader is not connected), ISOTHERM_ERROR_TRANSPORT.
 */
isotherm_code isotherm_reader_descriptor(isotherm_reader *reader, int *descriptor);

/**
 * How long ago the service was last seen at work for this IMU [ns]: under 300 000 000 while it lives and is on time.
 * The first call of a reader may give up to a second more.
 *
 * ISOTHERM_OK, ISOTHERM_NONE (no service was seen yet), ISOTHERM_ERROR_OTHER_VERSION, ISOTHERM_ERROR_TRANSPORT, and
 * the errors of isotherm_reader_receive.
 */
isotherm_code isotherm_reader_heartbeat_age(isotherm_reader *reader, uint64_t *age_ns);

/**
 * Whether the stream has been found. Stays true when the service stops. False for a handle that cannot be used.
 */
bool isotherm_reader_is_connected(const isotherm_reader *reader);

/**
 * Increments that came again after a resend and were not returned. 0 for a handle that cannot be used.
 */
uint64_t isotherm_reader_repeats(const isotherm_reader *reader);

/**
 * The control periods that are missing right before the increment that was received last: holes in `sequence`, also
 * those of a reader that was too slow, and the time between two sessions of the same clock. -1 if that is unknown:
 * where time steps, between sessions whose timestamps are of different clocks, are 0, or do not agree with the
 * reader's clock to within 0.25 s, before the first increment of the reader, and for a handle that cannot be used.
 */
int64_t isotherm_reader_lost_before(const isotherm_reader *reader);

/**
 * Writes the pulses of a sample of an acquisition that has connected with the resolutions of isotherm_options: three
 * of `specific_force` [m/s2] along A1, A2, A3, and three of `angular_rate` [rad/s] about G1, G2, G3, each the mean
 * over the interval of the sample. `angular_rate` is NULL for an IMU without gyroscopes: they become absent, with
 * temperature NaN.
 *
 * The pulses are those of the table in force, whatever your own interval is, so the increment is right at any rate.
 * What rounding leaves is carried to the next sample: all pulses together differ from the integral of all readings by
 * half a pulse at most. An `interval_ns` of 0 in the sample becomes the nominal interval of the table. All other
 * fields stay. Nothing is allocated, unless it fails.
 *
 * While no table is known, or its pulses stand for something else, samples are invalid: they are sent with
 * temperatures of NaN, so that their increments are NaN and flagged, and a line on stderr says why.
 *
 * ISOTHERM_OK, ISOTHERM_ERROR_VALUE for a reading that is not finite or over 2^32 - 1 pulses, whose sensor the message
 * names, and for an interval or a resolution out of its range. Nothing has been changed then.
 */
isotherm_code isotherm_fill(isotherm_acquisition *acquisition,
                            isotherm_raw_sample *sample,
                            const double *specific_force,
                            const double *angular_rate);

/**
 * Writes the mean specific force over an increment's interval to three of `specific_force` [m/s2]: NaN where the
 * increment is NaN, and for an interval of 0.
 *
 * ISOTHERM_OK.
 */
isotherm_code isotherm_increment_specific_force(const isotherm_compensated_increment *increment,
                                                double *specific_force);

/**
 * Writes the mean angular rate over an increment's interval to three of `angular_rate` [rad/s]: NaN where the
 * increment is NaN, as of a table without gyroscopes, and for an interval of 0. Earth's rate is in it.
 *
 * ISOTHERM_OK.
 */
isotherm_code isotherm_increment_angular_rate(const isotherm_compensated_increment *increment, double *angular_rate);

/**
 * The version of the library. ISOTHERM_VERSION is the version of the header.
 */
const char *isotherm_version(void);

/**
 * CLOCK_MONOTONIC [ns], the clock of `sent_ns`.
 */
uint64_t isotherm_monotonic_ns(void);

/**
 * The number of the machine's present start, with which CLOCK_MONOTONIC began; 0 if the kernel does not report it.
 * Save it with isotherm_save_lag: times of another start are of another clock.
 */
uint64_t isotherm_boot(void);

/**
 * Applies real-time settings to the calling thread. Call it in the thread that sends and receives, before it connects.
 *
 * `core`: the core that the thread is bound to; -1: no change. `priority`: SCHED_FIFO priority, 1 to 99; 0: no change.
 * `lock_memory`: keeps all memory of the process resident, including memory that it gets later. `timer_slack_ns`: how
 * much later than requested a sleep may end [ns]; 0: no change (the default of the kernel is 50 000).
 *
 * ISOTHERM_OK, ISOTHERM_ERROR_REALTIME for the first setting that fails. The settings before it, in this order, are in
 * force.
 */
isotherm_code isotherm_realtime(int32_t core, int32_t priority, bool lock_memory, uint64_t timer_slack_ns);

/**
 * The number of the device with this serial number, which every sample carries in `device`: the first 8 bytes of the
 * SHA-256 of its UTF-8, big-endian, without outer blanks. 0, unknown, for NULL, for blanks, and for text that is not
 * UTF-8.
 */
uint64_t isotherm_device(const char *serial);

/**
 * Writes the names of `flags` as text: the names joined by `|`, lowest bit first, or `-` if there is none; bits
 * without a name are left out. At most `size` bytes are written to `text`, including the 0 at the end. Returns the
 * length of the whole text without that 0; if it is not less than `size`, the text has been cut off. 1024 bytes are
 * always enough. `text` may be NULL if `size` is 0.
 */
size_t isotherm_flags_text(uint64_t flags, char *text, size_t size);

#ifdef __cplusplus
}  // extern "C"
#endif  // __cplusplus

/* The payloads in shared memory have the same layout in every language. */
#ifdef __cplusplus
#define ISOTHERM_ASSERT(condition) static_assert(condition, #condition)
#else
#define ISOTHERM_ASSERT(condition) _Static_assert(condition, #condition)
#endif
ISOTHERM_ASSERT(sizeof(isotherm_triad) == 96);
ISOTHERM_ASSERT(offsetof(isotherm_triad, positive_pulses) == 0);
ISOTHERM_ASSERT(offsetof(isotherm_triad, negative_pulses) == 12);
ISOTHERM_ASSERT(offsetof(isotherm_triad, head_temperature) == 24);
ISOTHERM_ASSERT(offsetof(isotherm_triad, board_temperature) == 48);
ISOTHERM_ASSERT(offsetof(isotherm_triad, head_lagged) == 72);
ISOTHERM_ASSERT(sizeof(isotherm_raw_sample) == 256);
ISOTHERM_ASSERT(offsetof(isotherm_raw_sample, session) == 0);
ISOTHERM_ASSERT(offsetof(isotherm_raw_sample, sequence) == 8);
ISOTHERM_ASSERT(offsetof(isotherm_raw_sample, timestamp_ns) == 16);
ISOTHERM_ASSERT(offsetof(isotherm_raw_sample, interval_ns) == 24);
ISOTHERM_ASSERT(offsetof(isotherm_raw_sample, sent_ns) == 32);
ISOTHERM_ASSERT(offsetof(isotherm_raw_sample, telemetry_ns) == 40);
ISOTHERM_ASSERT(offsetof(isotherm_raw_sample, lag_ns) == 48);
ISOTHERM_ASSERT(offsetof(isotherm_raw_sample, device) == 56);
ISOTHERM_ASSERT(offsetof(isotherm_raw_sample, accelerometers) == 64);
ISOTHERM_ASSERT(offsetof(isotherm_raw_sample, gyroscopes) == 160);
ISOTHERM_ASSERT(sizeof(isotherm_compensated_increment) == 104);
ISOTHERM_ASSERT(offsetof(isotherm_compensated_increment, session) == 0);
ISOTHERM_ASSERT(offsetof(isotherm_compensated_increment, sequence) == 8);
ISOTHERM_ASSERT(offsetof(isotherm_compensated_increment, timestamp_ns) == 16);
ISOTHERM_ASSERT(offsetof(isotherm_compensated_increment, interval_ns) == 24);
ISOTHERM_ASSERT(offsetof(isotherm_compensated_increment, velocity_increment) == 32);
ISOTHERM_ASSERT(offsetof(isotherm_compensated_increment, angle_increment) == 56);
ISOTHERM_ASSERT(offsetof(isotherm_compensated_increment, table) == 80);
ISOTHERM_ASSERT(offsetof(isotherm_compensated_increment, flags) == 88);
ISOTHERM_ASSERT(offsetof(isotherm_compensated_increment, latency_ns) == 96);
ISOTHERM_ASSERT(sizeof(isotherm_lagged_reading) == 32 && sizeof(isotherm_lag) == 192);
#undef ISOTHERM_ASSERT

/**
 * A sample of your own, as isotherm_loan gives it: all 0, but every head and board temperature NaN. A temperature that you forget
 * gives NaN and a flag, and so do the gyroscopes of a table for an IMU without them. A zeroed sample has temperature 0, which is a
 * reading for the accelerometers. For C and C++.
 */
#define ISOTHERM_RAW_SAMPLE_INIT \
    {0, 0, 0, 0, 0, 0, 0, 0, {{0, 0, 0}, {0, 0, 0}, {NAN, NAN, NAN}, {NAN, NAN, NAN}, {0, 0, 0}}, \
     {{0, 0, 0}, {0, 0, 0}, {NAN, NAN, NAN}, {NAN, NAN, NAN}, {0, 0, 0}}}

#endif /* ISOTHERM_H */
