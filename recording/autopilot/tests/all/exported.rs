//! Export: form, values, and what the firmwares make of them.

use crate::common::{
    DEVICES, FULL_PARAMS, FULL_PARM, KINDS, import_options, imported, mixed, parsed, subtracted, table, temperatures,
};
use isotherm_autopilot::{
    Autopilot, ExportError, ExportOptions, ExportedParameters, Parameters, export, import, vehicle,
};
use isotherm_shared::table::CoefficientTable;
use isotherm_support::failure::Failure;

fn px4() -> ExportOptions {
    ExportOptions { device_id: Some(DEVICES), ..ExportOptions::new(Autopilot::Px4) }
}

fn ardupilot(at_c: Option<f64>) -> ExportOptions {
    ExportOptions { at_c, ..ExportOptions::new(Autopilot::ArduPilot) }
}

fn instance(instance: u8, options: ExportOptions) -> ExportOptions {
    ExportOptions { instance: Some(instance), ..options }
}

/// Exports a table, and compares what the firmware subtracts, by its own formula in float32, with what the kernel
/// subtracts, at 200 temperatures. Returns the largest difference.
fn agrees(table: &CoefficientTable, options: &ExportOptions) -> f64 {
    let ExportedParameters { text, difference, .. } = export(table, options).unwrap();
    let parameters = Parameters::read(&text, options.autopilot, options.instance).unwrap();
    let range @ [low, high] = table.content().axes[0].bias.range();
    // Without constants the curves are relative.
    let relative = options.autopilot == Autopilot::ArduPilot && options.at_c.is_none();
    let zero = if relative { subtracted(table, 35.0_f64.clamp(low, high)) } else { [[0.0; 3]; 2] };
    let all = temperatures(range);
    assert_eq!(all.len(), 200);
    let (mut largest, mut inside) = (0.0_f64, [0.0_f64; 2]);
    for temperature in all {
        let kernel = subtracted(table, temperature.into());
        for (index, kind) in KINDS.into_iter().enumerate() {
            let firmware = parameters.offset(kind, temperature).unwrap();
            for ((kernel, firmware), zero) in kernel[index].into_iter().zip(firmware).zip(zero[index]) {
                let found = (kernel - zero - f64::from(firmware)).abs();
                assert!(found <= 2e-6 + 1e-6 * kernel.abs(), "{kind:?} at {temperature}: {kernel} {firmware}");
                largest = largest.max(found);
                if (low..=high).contains(&f64::from(temperature)) {
                    inside[index] = inside[index].max(found);
                }
            }
        }
    }
    // What is stated is what is found; the temperatures are others.
    let stated = [difference.accelerometers, difference.gyroscopes.unwrap()];
    for (stated, found) in stated.into_iter().zip(inside) {
        assert!(stated > 0.0 && found < 2.0 * stated && found > stated / 4.0, "{stated} {found}");
    }
    largest
}

#[test]
fn the_firmwares_subtract_what_the_kernel_subtracts() {
    for (name, table) in [
        ("full.params", imported(FULL_PARAMS, Autopilot::Px4)),
        ("full.parm", imported(FULL_PARM, Autopilot::ArduPilot)),
        ("mixed", parsed(&mixed())),
    ] {
        let found =
            [px4(), instance(3, px4()), ardupilot(Some(25.0)), instance(5, ardupilot(Some(-10.0))), ardupilot(None)]
                .map(|options| agrees(&table, &options));
        println!("{name}: {found:?}");
    }
}

/// Name, value and type of each line that is no comment.
fn parameters(text: &str) -> Vec<(&str, f32, &str)> {
    let lines = text.lines().filter(|line| !line.starts_with('#'));
    let fields = lines.map(|line| match line.split('\t').collect::<Vec<_>>()[..] {
        ["1", "1", name, value, kind] => (name, value.parse().unwrap(), kind),
        _ => panic!("{line}"),
    });
    fields.collect()
}

#[test]
fn the_parameters_of_px4_come_back_as_they_were() {
    let exported = export(&imported(FULL_PARAMS, Autopilot::Px4), &px4()).unwrap();
    assert!(exported.lost.is_empty() && exported.notes.is_empty(), "{exported:?}");
    let head: String = FULL_PARAMS.split_inclusive('\n').take(3).collect();
    assert!(exported.text.starts_with(&head), "{}", exported.text);
    let of_instance = |(name, ..): &(&str, f32, &str)| name.starts_with("TC_A0_") || name.starts_with("TC_G0_");
    let before: Vec<_> = parameters(FULL_PARAMS).into_iter().filter(of_instance).collect();
    let (after, enabled): (Vec<_>, Vec<_>) = parameters(&exported.text).into_iter().partition(of_instance);
    // Same names, values, types and order; other instances are left unchanged.
    assert_eq!(after, before);
    assert_eq!(enabled, [("TC_A_ENABLE", 1.0, "6"), ("TC_G_ENABLE", 1.0, "6")]);
    // The digits that the float32 needs.
    for right in ["TC_A0_ID\t3014666\t6", "TC_A0_TMIN\t-17.603062\t9", "TC_A0_X0_0\t-8.825049e-05\t9"] {
        assert!(exported.text.contains(&format!("\n1\t1\t{right}\n")), "{right}\n{}", exported.text);
    }
    // Once more, and they are the same text.
    let again = export(&imported(&exported.text, Autopilot::Px4), &px4()).unwrap();
    assert_eq!(again.text, exported.text);
}

#[test]
fn the_parameters_of_ardupilot_come_back_as_they_were() {
    let exported = export(&imported(FULL_PARM, Autopilot::ArduPilot), &ardupilot(None)).unwrap();
    let pairs = |text: &str| -> Vec<(String, f32)> {
        let pair = |line: &str| line.split_once(' ').map(|(name, value)| (name.to_owned(), value.parse().unwrap()));
        text.lines().map(|line| pair(line).unwrap()).collect()
    };
    assert_eq!(pairs(&exported.text), pairs(FULL_PARM));
    assert!(exported.text.starts_with("INS_TCAL1_ENABLE 1\nINS_TCAL1_TMIN -17.6\nINS_TCAL1_TMAX 73.9\n"));
    // Nine decimals, as there; more where a small value needs them.
    let decimals = exported.text.lines().skip(3).map(|line| line.split_once('.').unwrap().1.len());
    assert!(decimals.clone().all(|decimals| (9..=11).contains(&decimals)), "{}", exported.text);
    assert!(decimals.filter(|decimals| *decimals == 9).count() >= 12, "{}", exported.text);
    let again = export(&imported(&exported.text, Autopilot::ArduPilot), &ardupilot(None)).unwrap();
    assert_eq!(again.text, exported.text);
}

#[test]
fn each_instance_has_its_names() {
    let table = parsed(&mixed());
    let names = |options: &ExportOptions| {
        let text = export(&table, options).unwrap().text;
        let name = |line: &str| line.split([' ', '\t']).find(|field| field.len() > 1).unwrap_or_default().to_owned();
        text.lines().filter(|line| !line.starts_with('#')).map(name).collect::<Vec<_>>()
    };
    for (number, first, caltemp, offsets) in [
        (1, "INS_TCAL1_ENABLE", ["INS_ACC1_CALTEMP", "INS_GYR1_CALTEMP"], ["INS_ACCOFFS_X", "INS_GYROFFS_X"]),
        (2, "INS_TCAL2_ENABLE", ["INS_ACC2_CALTEMP", "INS_GYR2_CALTEMP"], ["INS_ACC2OFFS_X", "INS_GYR2OFFS_X"]),
        (3, "INS_TCAL3_ENABLE", ["INS_ACC3_CALTEMP", "INS_GYR3_CALTEMP"], ["INS_ACC3OFFS_X", "INS_GYR3OFFS_X"]),
        (4, "INS4_TCAL_ENABLE", ["INS4_ACC_CALTEMP", "INS4_GYR_CALTEMP"], ["INS4_ACCOFFS_X", "INS4_GYROFFS_X"]),
        (5, "INS5_TCAL_ENABLE", ["INS5_ACC_CALTEMP", "INS5_GYR_CALTEMP"], ["INS5_ACCOFFS_X", "INS5_GYROFFS_X"]),
    ] {
        let found = names(&instance(number, ardupilot(Some(20.0))));
        assert_eq!(found.len(), 29);
        assert_eq!(found[0], first);
        assert_eq!([&found[21], &found[25]], caltemp);
        assert_eq!([&found[22], &found[26]], offsets);
        // Without a calibration temperature neither it nor the offsets are written.
        assert_eq!(names(&instance(number, ardupilot(None))), found[..21]);
    }
    for number in 0..=3 {
        let found = names(&instance(number, px4()));
        assert_eq!(found.len(), 34);
        assert!(found[1] == format!("TC_A{number}_ID") && found[33] == format!("TC_G{number}_X3_2"), "{found:?}");
    }
}

#[test]
fn a_table_without_gyroscopes_has_accelerometers_alone() {
    let text = mixed();
    let accelerometers = parsed(&text[..text.find("[[gyroscope]]").unwrap()]);
    let exported = export(&accelerometers, &px4()).unwrap();
    assert!(!exported.text.contains("TC_G") && exported.difference.gyroscopes.is_none());
    let back = import(&exported.text, &import_options(Autopilot::Px4)).unwrap();
    assert!(back.content().gyroscopes.is_none());
    let exported = export(&accelerometers, &ardupilot(Some(20.0))).unwrap();
    assert!(!exported.text.contains("GYR"), "{}", exported.text);
    let back = import(&exported.text, &import_options(Autopilot::ArduPilot)).unwrap();
    assert!(back.content().gyroscopes.is_none());
}

#[test]
fn options_that_cannot_be_are_refused() {
    let table_of_all = parsed(&mixed());
    for (options, cause) in [
        (instance(4, px4()), "the instance is 4; PX4 has 0 to 3"),
        (instance(0, ardupilot(None)), "the instance is 0; ArduPilot has 1 to 5"),
        (ExportOptions::new(Autopilot::Px4), "--device-id ID"),
        (ExportOptions { device_id: Some([0, 5]), ..px4() }, "from 1 to 2147483647"),
        (ExportOptions { device_id: Some([5, 1 << 31]), ..px4() }, "from 1 to 2147483647"),
        (ExportOptions { device_id: Some(DEVICES), ..ardupilot(None) }, "ArduPilot needs no device number"),
        (ExportOptions { at_c: Some(20.0), ..px4() }, "PX4 has the constants at every temperature"),
        (ardupilot(Some(70.5)), "is 70.5 degC, give one of the range, -30 to 70"),
        (ardupilot(Some(f64::NAN)), "is NaN degC"),
    ] {
        let error = export(&table_of_all, &options).unwrap_err();
        assert!(error.to_string().contains(cause), "{error}");
        assert_eq!(Failure::from(error).exit as u8, 64);
    }
    let constant = "unit = \"mg0\", range = [-30.0, 70.0], c0 = 12.0";
    let rate = "unit = \"deg/h\", range = [-30.0, 70.0], c0 = 12.0";
    let constants = parsed(&table([constant; 3], [rate; 3]));
    assert_eq!(export(&constants, &ardupilot(None)), Err(ExportError::Constants));
    let exported = export(&constants, &ardupilot(Some(20.0))).unwrap();
    assert!(exported.text.contains("INS_ACC1_CALTEMP 20.0\nINS_ACCOFFS_X 0.117618"), "{}", exported.text);
}

#[test]
fn what_the_parameters_do_not_say_is_said() {
    let mixed = mixed();
    let said = |text: &str, options: &ExportOptions| export(&parsed(text), options).unwrap().notes;
    let constants = said(&mixed, &ardupilot(None));
    assert!(constants[0].contains("rad/s at 35 degC, are not written"), "{constants:?}");
    let offsets = said(&mixed, &ardupilot(Some(20.0)));
    assert!(offsets[0].contains("INS_GYR_CAL"), "{offsets:?}");
    let policy = said(&mixed.replace("\"clamp\"", "\"reject\""), &px4());
    assert_eq!(policy, ["outside of the range the table has the policy \"reject\"; PX4 clamps"]);
    let scales = said(&mixed.replacen("9e4", "9.009e4", 2).replacen("--", "-", 1), &px4());
    assert!(scales[0].contains("scale factors of A1, A2, A3 differ by"), "{scales:?}");
}

/// The lines of PX4's parameters of all IMUs are in one file, and each comes back; what enables all at once is there if
/// all have parameters.
#[test]
fn the_parameters_of_a_vehicle_are_one_file() {
    let table = parsed(&mixed());
    let without = parsed(mixed().split("[[gyroscope]]").next().unwrap());
    let all = |options: &dyn Fn(u8) -> ExportOptions| [0, 1, 2].map(|number| export(&table, &options(number)).unwrap());
    let of_px4 = all(&|number| instance(number, px4()));
    let [a, b, c] = &of_px4;
    let joint = vehicle(Autopilot::Px4, &[("x-0", Some(a)), ("x-1", Some(b)), ("x-2", Some(c))]);
    assert!(joint.notes.is_empty() && joint.text.matches("ENABLE\t1\t6\n").count() == 2, "{}", joint.text);
    assert_eq!(joint.text.lines().count(), 3 + 2 + 3 * 32);
    for number in 0..3 {
        let read = |text: &str| Parameters::read(text, Autopilot::Px4, Some(number)).unwrap();
        assert_eq!(read(&joint.text), read(&of_px4[usize::from(number)].text));
    }
    assert_eq!((joint.difference, joint.range), (a.difference, a.range));
    // One that has none, and one without gyroscopes.
    let alone = vehicle(Autopilot::Px4, &[("x-0", Some(a)), ("x-1", None)]);
    assert!(!alone.text.contains("ENABLE") && alone.notes.len() == 2, "{:?}", alone.notes);
    assert!(alone.notes[0].starts_with("TC_A_ENABLE is left out") && alone.notes[0].contains("x-1 has no parameters"));
    let half = export(&without, &instance(1, px4())).unwrap();
    let joint = vehicle(Autopilot::Px4, &[("x-0", Some(a)), ("x-1", Some(&half))]);
    assert!(joint.text.contains("TC_A_ENABLE\t1\t6\n") && !joint.text.contains("TC_G_ENABLE"), "{}", joint.text);
    assert!(joint.notes.len() == 1 && joint.notes[0].starts_with("TC_G_ENABLE is left out"), "{:?}", joint.notes);
    // Nobody has gyroscopes: there is nothing to enable.
    let none = vehicle(Autopilot::Px4, &[("x-1", Some(&half))]);
    assert_eq!((none.text.as_str(), none.notes.len()), (half.text.as_str(), 0));
    let [a, b, _] = all(&|number| instance(number + 1, ardupilot(None)));
    let joint = vehicle(Autopilot::ArduPilot, &[("x-0", Some(&a)), ("x-1", Some(&b)), ("x-2", None)]);
    assert!(joint.text == a.text + &b.text && joint.notes.is_empty());
}
