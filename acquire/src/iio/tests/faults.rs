//! What goes wrong, with cause, remedy and exit code.

use isotherm_support::failure::{Exit, Failure};
use rustix::io::Errno;

use super::super::{IioError, IioFault};
use super::records::{ADIS16505, BMI270};
use super::tree::{Fake, SIX, settings};

fn expect(fault: &IioError, kind: IioFault, parts: &[&str]) {
    let text = fault.to_string();
    assert_eq!(fault.kind, kind, "{text}");
    for part in parts {
        assert!(text.contains(part), "{part:?} is not in: {text}");
    }
}

#[test]
fn a_missing_right_is_told_with_the_rule_that_gives_it() {
    let mut fake = Fake::with(&[ADIS16505]);
    fake.refuse("iio:device0/buffer0/in_anglvel_x_en", Errno::ACCESS);
    let fault = fake.fault(&settings("adis16505", SIX, ""));
    expect(
        &fault,
        IioFault::Permission,
        &["adis16505-2 (iio:device0): setting in_anglvel_x_en to 1", "may not", "udev rule in docs/iio.md"],
    );
    assert_eq!(Failure::from(fault).exit, Exit::Io);
}

#[test]
fn a_device_that_another_program_has_is_told() {
    let mut fake = Fake::with(&[ADIS16505]);
    fake.refuse("iio:device0/buffer0/enable", Errno::BUSY);
    let fault = fake.fault(&settings("adis16505", SIX, ""));
    expect(&fault, IioFault::Busy, &["setting enable to 1", "is busy", "another program uses this device"]);
    assert_eq!(Failure::from(fault).exit, Exit::Unavailable);
}

#[test]
fn a_driver_that_needs_a_trigger_is_told_with_those_there_are() {
    let mut fake = Fake::with(&[BMI270]);
    fake.refuse("iio:device0/buffer0/enable", Errno::INVAL);
    let fault = fake.fault(&settings("bmi270", SIX, ""));
    expect(&fault, IioFault::Description, &["no trigger is set", "there are none", "hrtimer", "docs/iio.md"]);
    assert_eq!(Failure::from(fault).exit, Exit::Config);
    fake.folder("trigger0", "name: imu-clock");
    fake.folder("trigger1", "name: bmi270-trig-1");
    let fault = fake.fault(&settings("bmi270", SIX, ""));
    expect(&fault, IioFault::Description, &["there are bmi270-trig-1, imu-clock", "`trigger` in [iio]"]);
    // With a trigger it is something else.
    fake.set("iio:device0/trigger/current_trigger", "imu-clock");
    let fault = fake.fault(&settings("bmi270", SIX, ""));
    expect(&fault, IioFault::Description, &["refuses these channels together", "dmesg"]);
}

#[test]
fn a_trigger_that_there_is_not_is_refused() {
    let fake = Fake::with(&[
        BMI270,
        "name: x\nbuffer0/enable: 0\nbuffer0/in_a_en: 0\nbuffer0/in_a_index: 0\n\
        buffer0/in_a_type: le:s16/16>>0",
    ]);
    fake.folder("trigger0", "name: imu-clock");
    let mut wanted = settings("bmi270", SIX, "");
    wanted.trigger = Some("imu-clok".to_owned());
    expect(&fake.fault(&wanted), IioFault::Description, &["setting the trigger imu-clok", "there are imu-clock"]);
    let mut wanted = settings("x", "a", "");
    wanted.trigger = Some("imu-clock".to_owned());
    expect(&fake.fault(&wanted), IioFault::Description, &["takes no trigger", "out of [iio]"]);
}

#[test]
fn a_node_that_is_not_there_is_told() {
    let fake = Fake::with(&[ADIS16505]);
    std::fs::remove_file(fake.root().join("dev/iio:device0")).unwrap();
    let fault = fake.fault(&settings("adis16505", SIX, ""));
    expect(&fault, IioFault::Gone, &["opening its node", "dev/iio:device0 is not there"]);
}

#[test]
fn a_driver_without_a_buffer_is_told() {
    let fake = Fake::with(&["name: old\nin_accel_x_raw: 5\nin_accel_scale: 0.1"]);
    let fault = fake.fault(&settings("old", "accel_x", ""));
    expect(&fault, IioFault::Description, &["old (iio:device0)", "has no buffer", "newer kernel"]);
}

#[test]
fn an_unknown_type_and_a_channel_that_stays_off_are_told() {
    let fake = Fake::with(&[BMI270]);
    fake.set("iio:device0/buffer0/in_accel_y_type", "le:f32/32>>0");
    expect(
        &fake.fault(&settings("bmi270", SIX, "")),
        IioFault::Description,
        &["scan element accel_y", "floating point"],
    );
    // One that is off has any type.
    assert!(fake.open(&settings("bmi270", "accel_x", "")).is_ok());
}

#[test]
fn scales_that_are_none_are_told() {
    for (scale, parts) in
        [("0.000000", "is 0"), ("fast", "is not a number"), ("inf", "is not a number"), ("", "is not a number")]
    {
        let fake = Fake::with(&[BMI270]);
        fake.set("iio:device0/in_accel_scale", scale);
        expect(&fake.fault(&settings("bmi270", SIX, "")), IioFault::Refused, &["in_accel_scale", parts]);
        assert_eq!(fake.get("iio:device0/buffer0/enable"), "0");
    }
}

#[test]
fn a_watermark_has_limits() {
    let fake = Fake::with(&[BMI270]);
    for watermark in [0, 16_385, u32::MAX] {
        let mut wanted = settings("bmi270", SIX, "");
        wanted.watermark = watermark;
        expect(&fake.fault(&wanted), IioFault::Description, &["setting the watermark", "not 1 to 16384"]);
    }
}

#[test]
fn attributes_with_any_bytes_are_survived() {
    let fake = Fake::with(&[BMI270]);
    let file = |name: &str| fake.tree.devices().join("iio:device0").join(name);
    std::fs::write(file("name"), b"\xff\xfe\x1b[2Jbmi").unwrap();
    std::fs::write(file("buffer0/in_accel_x_index"), b"\xff\xff").unwrap();
    std::fs::write(file("buffer0/in_accel_y_type"), vec![b'9'; 100_000]).unwrap();
    expect(&fake.fault(&settings("0", "accel_x", "")), IioFault::Description, &["IIO channel accel_x"]);
    let fault = fake.fault(&settings("0", "accel_y", ""));
    assert!(fault.to_string().len() < 10_000 && !Failure::from(fault).to_string().contains('\u{1b}'));
    assert_eq!(super::super::list(fake.root()).unwrap().len(), 1);
}
