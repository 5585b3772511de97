//! Attributes as real devices have them.
//!
//! Names, indices, types and scales are those of the kernel's documentation and drivers. What was recorded on a device
//! is said; the rest was not.

/// ADIS16505-2: name, scales of accelerometers and gyroscopes, frequency, trigger and `in_accel_x_raw` as recorded in
/// the kernel's `Documentation/iio/adis16475.rst`; the rest of the driver `adis16475`. Linux 5.11 and later: `buffer0`
/// next to the old folders, of which one channel stands here.
pub(super) const ADIS16505: &str = "
    name: adis16505-2
    in_accel_scale: 0.000000037
    in_anglvel_scale: 0.000000006
    in_deltavelocity_scale: 0.000000046
    in_temp0_scale: 100
    in_temp0_raw: 287
    in_accel_x_raw: -275924
    sampling_frequency: 2000.000000
    current_timestamp_clock: realtime
    trigger/current_trigger: adis16505-2-dev0
    buffer/enable: 0
    buffer/length: 2
    scan_elements/in_anglvel_x_en: 0
    scan_elements/in_anglvel_x_index: 0
    scan_elements/in_anglvel_x_type: be:s32/32>>0
    buffer0/enable: 0
    buffer0/length: 2
    buffer0/watermark: 1
    buffer0/in_anglvel_x_en: 0
    buffer0/in_anglvel_x_index: 0
    buffer0/in_anglvel_x_type: be:s32/32>>0
    buffer0/in_anglvel_y_en: 0
    buffer0/in_anglvel_y_index: 1
    buffer0/in_anglvel_y_type: be:s32/32>>0
    buffer0/in_anglvel_z_en: 0
    buffer0/in_anglvel_z_index: 2
    buffer0/in_anglvel_z_type: be:s32/32>>0
    buffer0/in_accel_x_en: 0
    buffer0/in_accel_x_index: 3
    buffer0/in_accel_x_type: be:s32/32>>0
    buffer0/in_accel_y_en: 0
    buffer0/in_accel_y_index: 4
    buffer0/in_accel_y_type: be:s32/32>>0
    buffer0/in_accel_z_en: 0
    buffer0/in_accel_z_index: 5
    buffer0/in_accel_z_type: be:s32/32>>0
    buffer0/in_temp0_en: 0
    buffer0/in_temp0_index: 6
    buffer0/in_temp0_type: be:s16/16>>0
    buffer0/in_deltavelocity_x_en: 0
    buffer0/in_deltavelocity_x_index: 10
    buffer0/in_deltavelocity_x_type: be:s32/32>>0
    buffer0/in_deltavelocity_y_en: 0
    buffer0/in_deltavelocity_y_index: 11
    buffer0/in_deltavelocity_y_type: be:s32/32>>0
    buffer0/in_deltavelocity_z_en: 0
    buffer0/in_deltavelocity_z_index: 12
    buffer0/in_deltavelocity_z_type: be:s32/32>>0
    buffer0/in_timestamp_en: 0
    buffer0/in_timestamp_index: 13
    buffer0/in_timestamp_type: le:s64/64>>0
";

/// MPU-6050 on a Raspberry Pi with Linux 5.10, so without `buffer0`: types and scale as `iio_info` printed them in
/// issue 9 of fpagliughi/rust-industrial-io; the rest of the driver `inv_mpu6050`.
pub(super) const MPU6050: &str = "
    name: mpu6050
    in_accel_scale: 0.000598
    in_anglvel_scale: 0.001064724
    in_temp_scale: 2.941176
    in_temp_offset: 12420
    sampling_frequency: 50
    sampling_frequency_available: 10 20 50 100 200 500
    current_timestamp_clock: realtime
    trigger/current_trigger: mpu6050-dev0
    buffer/enable: 0
    buffer/length: 2
    buffer/watermark: 1
    scan_elements/in_accel_x_en: 0
    scan_elements/in_accel_x_index: 0
    scan_elements/in_accel_x_type: be:s16/16>>0
    scan_elements/in_accel_y_en: 0
    scan_elements/in_accel_y_index: 1
    scan_elements/in_accel_y_type: be:s16/16>>0
    scan_elements/in_accel_z_en: 0
    scan_elements/in_accel_z_index: 2
    scan_elements/in_accel_z_type: be:s16/16>>0
    scan_elements/in_temp_en: 0
    scan_elements/in_temp_index: 3
    scan_elements/in_temp_type: be:s16/16>>0
    scan_elements/in_anglvel_x_en: 0
    scan_elements/in_anglvel_x_index: 4
    scan_elements/in_anglvel_x_type: be:s16/16>>0
    scan_elements/in_anglvel_y_en: 0
    scan_elements/in_anglvel_y_index: 5
    scan_elements/in_anglvel_y_type: be:s16/16>>0
    scan_elements/in_anglvel_z_en: 0
    scan_elements/in_anglvel_z_index: 6
    scan_elements/in_anglvel_z_type: be:s16/16>>0
    scan_elements/in_timestamp_en: 0
    scan_elements/in_timestamp_index: 7
    scan_elements/in_timestamp_type: le:s64/64>>0
";

/// BMI270, of the driver `bmi270`: rates of its own for accelerometers and gyroscopes, a temperature outside the scan,
/// no trigger of its own.
pub(super) const BMI270: &str = "
    name: bmi270
    in_accel_scale: 0.000598
    in_accel_sampling_frequency: 100.000000
    in_accel_sampling_frequency_available: 0.781250 1.562500 3.125000 6.250000 12.500000 25.000000 50.000000 \
     100.000000 200.000000 400.000000 800.000000 1600.000000
    in_anglvel_scale: 0.001065
    in_anglvel_sampling_frequency: 200.000000
    in_anglvel_sampling_frequency_available: 25.000000 50.000000 100.000000 200.000000 400.000000 800.000000 \
     1600.000000 3200.000000
    in_temp_raw: 1024
    in_temp_scale: 1.953125
    in_temp_offset: 11776
    current_timestamp_clock: realtime
    trigger/current_trigger:
    buffer0/enable: 0
    buffer0/length: 2
    buffer0/watermark: 1
    buffer0/in_accel_x_en: 0
    buffer0/in_accel_x_index: 0
    buffer0/in_accel_x_type: le:s16/16>>0
    buffer0/in_accel_y_en: 0
    buffer0/in_accel_y_index: 1
    buffer0/in_accel_y_type: le:s16/16>>0
    buffer0/in_accel_z_en: 0
    buffer0/in_accel_z_index: 2
    buffer0/in_accel_z_type: le:s16/16>>0
    buffer0/in_anglvel_x_en: 0
    buffer0/in_anglvel_x_index: 3
    buffer0/in_anglvel_x_type: le:s16/16>>0
    buffer0/in_anglvel_y_en: 0
    buffer0/in_anglvel_y_index: 4
    buffer0/in_anglvel_y_type: le:s16/16>>0
    buffer0/in_anglvel_z_en: 0
    buffer0/in_anglvel_z_index: 5
    buffer0/in_anglvel_z_type: le:s16/16>>0
    buffer0/in_timestamp_en: 0
    buffer0/in_timestamp_index: 6
    buffer0/in_timestamp_type: le:s64/64>>0
";

/// The accelerometers of an LSM6DSOX, of the driver `st_lsm6dsx`, which makes two devices of a chip, and in older
/// kernels gives each axis a scale. The label is an example.
pub(super) const LSM6DSOX_ACCEL: &str = "
    name: lsm6dsox_accel
    label: imu-left
    in_accel_x_scale: 0.000598
    in_accel_y_scale: 0.000598
    in_accel_z_scale: 0.000598
    sampling_frequency: 26.000
    sampling_frequency_available: 12.500 26.000 52.000 104.000 208.000 416.000 833.000
    current_timestamp_clock: realtime
    buffer0/enable: 0
    buffer0/length: 2
    buffer0/watermark: 1
    buffer0/in_accel_x_en: 0
    buffer0/in_accel_x_index: 0
    buffer0/in_accel_x_type: le:s16/16>>0
    buffer0/in_accel_y_en: 0
    buffer0/in_accel_y_index: 1
    buffer0/in_accel_y_type: le:s16/16>>0
    buffer0/in_accel_z_en: 0
    buffer0/in_accel_z_index: 2
    buffer0/in_accel_z_type: le:s16/16>>0
    buffer0/in_timestamp_en: 0
    buffer0/in_timestamp_index: 3
    buffer0/in_timestamp_type: le:s64/64>>0
";

/// Its gyroscopes.
pub(super) const LSM6DSOX_GYRO: &str = "
    name: lsm6dsox_gyro
    in_anglvel_x_scale: 0.000153
    in_anglvel_y_scale: 0.000153
    in_anglvel_z_scale: 0.000153
    sampling_frequency: 26.000
    sampling_frequency_available: 12.500 26.000 52.000 104.000 208.000 416.000 833.000
    current_timestamp_clock: realtime
    buffer0/enable: 0
    buffer0/length: 2
    buffer0/watermark: 1
    buffer0/in_anglvel_x_en: 0
    buffer0/in_anglvel_x_index: 0
    buffer0/in_anglvel_x_type: le:s16/16>>0
    buffer0/in_anglvel_y_en: 0
    buffer0/in_anglvel_y_index: 1
    buffer0/in_anglvel_y_type: le:s16/16>>0
    buffer0/in_anglvel_z_en: 0
    buffer0/in_anglvel_z_index: 2
    buffer0/in_anglvel_z_type: le:s16/16>>0
    buffer0/in_timestamp_en: 0
    buffer0/in_timestamp_index: 3
    buffer0/in_timestamp_type: le:s64/64>>0
";

/// 13 scans of an ADIS16505-2 as `hexdump` printed them in the kernel's `Documentation/iio/adis16475.rst`: temperature,
/// two bytes of padding, delta velocities.
pub(super) const ADIS16505_SCANS: &str = "
    01 1f 00 00 ff ff fe ef 00 00 47 bf 00 03 35 55
    01 1f 00 00 ff ff ff d9 00 00 46 f1 00 03 35 35
    01 1f 00 00 ff ff fe fc 00 00 46 cb 00 03 35 7b
    01 1f 00 00 ff ff fe 41 00 00 47 0d 00 03 35 8b
    01 1f 00 00 ff ff fe 37 00 00 46 b4 00 03 35 90
    01 1d 00 00 ff ff fe 5a 00 00 45 d7 00 03 36 08
    01 1b 00 00 ff ff fe fb 00 00 45 e7 00 03 36 60
    01 1a 00 00 ff ff ff 17 00 00 46 bc 00 03 36 de
    01 1a 00 00 ff ff fe 59 00 00 46 d7 00 03 37 b8
    01 1a 00 00 ff ff fe ae 00 00 46 95 00 03 37 ba
    01 1a 00 00 ff ff fe c5 00 00 46 63 00 03 37 9f
    01 1a 00 00 ff ff fe 55 00 00 46 89 00 03 37 c1
    01 1a 00 00 ff ff fe 31 00 00 46 aa 00 03 37 f7
";

/// The bytes of a text of hexadecimal numbers.
pub(super) fn bytes(text: &str) -> Vec<u8> {
    text.split_whitespace().map(|byte| u8::from_str_radix(byte, 16).unwrap()).collect()
}
