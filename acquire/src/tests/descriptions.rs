//! Descriptions: what is wrong is named with line and key.

use super::profile;
use crate::description::{Description, Kind, Peer, Port, Udp};
use crate::profiles::PROFILES;
use crate::timeline::Counter;
use std::path::Path;

#[test]
fn every_profile_is_right_and_says_where_it_comes_from() {
    for (name, text) in PROFILES {
        profile(name);
        let comment: String = text.lines().take_while(|line| line.starts_with('#')).collect();
        assert!(comment.contains("Source: "), "{name} names no source");
    }
    let stim = profile("stim300");
    assert_eq!(stim.timing.counter.map(|(_, counter)| counter), Some(Counter { bits: 8, step: 2 }));
    let Kind::Iio(settings) = &profile("bmi270").kind else { panic!("bmi270 is no IIO device") };
    assert_eq!((settings.columns.len(), settings.temperature.len()), (6, 1));
}

#[test]
fn every_profile_of_a_stream_has_a_nominal_table() {
    for (name, _) in PROFILES {
        let description = profile(name);
        if !matches!(description.kind, Kind::Iio(_)) {
            let table = description.nominal(Path::new("/"));
            assert!(table.is_ok_and(|table| table.content().gyroscopes.is_some()), "{name}");
        }
    }
    // 2^-22 m/s a count.
    let table = profile("stim300").nominal(Path::new("/")).unwrap().to_toml();
    assert!(table.contains("unit = \"pulse/(s*g0)\", range = [-40.0, 85.0], c0 = 41132071.3216"), "{table}");
}

#[test]
fn a_file_of_its_bytes_takes_the_place_of_a_serial_line() {
    let file = tempfile::NamedTempFile::new().unwrap();
    let mut description = profile("stim300");
    description.set_device(Path::new("/dev/null")).unwrap();
    assert!(description.summary().contains("/dev/null at 921600 Bd"), "{}", description.summary());
    description.set_device(file.path()).unwrap();
    let Kind::Frames(port, _) = &description.kind else { panic!("no frames") };
    assert_eq!(*port, Port::File { path: file.path().to_owned(), pace: false });
}

fn faults(text: &str) -> String {
    Description::from_toml(text).err().map(|faults| faults.to_string()).unwrap_or_default()
}

#[test]
fn all_faults_are_named_with_line_and_key() {
    let text = PROFILES.iter().find(|(name, _)| *name == "stim300").unwrap().1;
    let comment = text.lines().take_while(|line| line.starts_with('#')).count();
    let wrong = text
        .lines()
        .skip(comment)
        .collect::<Vec<_>>()
        .join("\n")
        .replace("format = 1", "format = 2")
        .replace("921600", "9")
        .replace("interval_s = 0.001", "interval_s = 0")
        .replace("unit = \"us\"", "unit = \"min\"")
        .replace("sync = [0xA5]", "sync = [0xA5, 256]")
        .replace("at = -4, pad = 4", "at = -400, pad = 0")
        .replace("name = \"gx\"\nat = 1", "name = \"gx\"\nat = 41")
        .replace("type = \"u16\"", "type = \"u17\"")
        .replace("\"ay\", \"az\"]", "\"ay\", \"aq\"]")
        + "\n[lines]\nseparator = \"|\"\n";
    let found = faults(&wrong);
    for expected in [
        "line 1: format: is the integer 2",
        "source.baud: is the integer 9",
        "timing.interval_s: give a number of seconds from 0.000001 to 3600",
        "timing.latency.unit: is \"min\"",
        "frame.sync: ",
        "frame.checksum.at: ",
        "frame.checksum.pad: ",
        "field.1.at: is 41, and the 3 bytes are not within the 42",
        ".type: is \"u17\"",
        "lines: unknown key",
    ] {
        assert!(found.contains(expected), "{expected}\n--\n{found}");
    }
    assert_eq!(found.lines().count(), 10, "{found}");
    let found = faults(&text.replace("step = 2", "step = 3"));
    assert!(found.contains("timing.counter.step: give a step that divides"), "{found}");
    let found = faults(&text.replace("\"ay\", \"az\"]", "\"ay\", \"aq\"]"));
    assert!(found.contains("accelerometer.columns: aq is not a column; there are gx"), "{found}");
}

#[test]
fn what_is_missing_or_there_twice_is_named() {
    let found = faults("format = 1\n");
    assert!(found.contains("imu: missing") && found.contains("source: missing; give a section [source]"), "{found}");
    let two = "format = 1\nimu = \"a\"\n[source]\nkind = \"lines\"\nserial = \"/dev/x\"\ntcp = \"h\"\nfile = \"-\"\nbaud = 1200\n\
               [timing]\ninterval_s = 0.1\ncounter = { column = 9 }\n[lines]\n[accelerometer]\ncolumns = [1, 2, 3]\nkind = \"reading\"\n\
               [temperature]\nconstant = 20\n";
    let found = faults(two);
    assert!(found.contains("line 3: source: has 3 sources; give one of serial, tcp, udp and file"), "{found}");
    assert!(found.contains("timing.counter.bits: missing"), "{found}");
    assert!(found.contains("accelerometer.resolution: missing"), "{found}");
    let udp = faults(
        &two.replace("serial = \"/dev/x\"\ntcp = \"h\"\nfile = \"-\"\nbaud = 1200", "udp = \"4000\"\npace = true"),
    );
    assert!(udp.contains("source.udp: is \"4000\", give host and port"), "{udp}");
    assert!(udp.contains("source.pace: is for a file"), "{udp}");
    assert!(udp.contains("source.peer: missing; give the address of the device"), "{udp}");
}

#[test]
fn a_source_of_datagrams_names_its_sender() {
    let serial = "serial = \"/dev/ttyUSB0\"\nbaud = 921600";
    let text = PROFILES.iter().find(|(name, _)| *name == "kvh1750").unwrap().1;
    let peer = |keys: &str| {
        assert!(text.contains(serial));
        let description = Description::from_toml(&text.replace(serial, &format!("udp = \"0.0.0.0:4000\"\n{keys}")));
        let port = description.map_err(|faults| faults.to_string())?.port().cloned();
        let Some(Port::Udp(Udp { peer, .. })) = port else { panic!("{port:?}") };
        Ok::<_, String>(peer)
    };
    let ip = "192.168.1.10".parse().unwrap();
    assert_eq!(peer("peer = \"192.168.1.10\""), Ok(Some(Peer { ip, port: None })));
    assert_eq!(peer("peer = \"192.168.1.10:4000\""), Ok(Some(Peer { ip, port: Some(4000) })));
    assert_eq!(peer("peer = \"any\""), Ok(None));
    for (keys, said) in [("", "source.peer: missing"), ("peer = \"\"", "is \"\""), ("peer = \"imu.local\"", "\"any\"")]
    {
        let found = peer(keys).unwrap_err();
        assert!(found.contains(said) && found.lines().count() == 1, "{keys}: {found}");
    }
}
