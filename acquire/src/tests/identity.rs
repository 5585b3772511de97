//! Who the device is: descriptions, and what becomes of another one's samples.

use super::profile;
use crate::description::{Description, SerialNumberSource};
use crate::dialogue::DialogueAnswer;
use crate::identity::{Recognition, Signature};
use crate::number::Value;
use crate::profiles::PROFILES;
use crate::tally::Tally;
use isotherm_client::device;
use isotherm_support::failure::Exit;

/// The text of a profile with these changes.
fn changed(name: &str, changes: &[(&str, &str)]) -> String {
    let text = PROFILES.iter().find(|(of, _)| *of == name).unwrap().1;
    changes.iter().fold(text.to_owned(), |text, (from, to)| {
        assert!(text.contains(from), "{from}");
        text.replace(from, to)
    })
}

const SERIAL: (&str, &str) = ("imu = \"imu-a\"", "imu = \"imu-a\"\nserial = \"0100061897\"");

fn vn100() -> Description {
    Description::from_toml(&changed("vn100", &[SERIAL])).unwrap()
}

fn faults(changes: &[(&str, &str)]) -> String {
    Description::from_toml(&changed("vn100", changes)).err().map(|faults| faults.to_string()).unwrap_or_default()
}

#[test]
fn profiles_say_how_devices_are_asked() {
    for name in ["stim300", "stim300-rate", "vn100", "mtdata2"] {
        let description = profile(name);
        let identity = description.identity.unwrap();
        assert!(matches!(identity.says, SerialNumberSource::Message(_)) && !identity.holds, "{name}");
        assert_eq!(identity.ask.iter().filter(|step| step.answer == DialogueAnswer::Message).count(), 1, "{name}");
        assert!(description.setup.is_empty(), "{name} changes the device unasked");
    }
    assert!(profile("kvh1750").identity.is_none());
}

#[test]
fn what_is_wrong_with_identity_and_set_up_is_named() {
    let ask = "ask = [{ send = \"$VNRRG,03*70\\r\\n\" }]";
    let message = "message = { begins = \"$VNRRG,03,\" }";
    let frame = "message = { begins = [256], length = 9, checksum = { algorithm = \"none\" }, serial = { at = 8, bytes = 4, as = \"f32\" } }";
    let serial = ("serial = \"/dev/ttyUSB0\"\nbaud = 921600", "udp = \"127.0.0.1:4000\"\npeer = \"127.0.0.1\"");
    let set_up = ("imu = \"imu-a\"", "imu = \"imu-a\"\nsetup = [{ sends = \"x\" }]");
    for (changes, expected) in [
        (&[(message, "")][..], "identity.message: missing; give how the device says who it is"),
        (&[(message, "field = \"time\"")], "identity.ask: is for a message"),
        (&[(ask, "field = \"time\"")], "identity.field: is given in addition to message; give one of them"),
        (&[(message, "field = \"tim\""), (ask, "")], "identity.field: tim is not a column"),
        (&[(ask, "ask = [{ send = [1], answer = [2] }]")], "identity.ask: has 0 steps without answer; give one"),
        (
            &[(ask, "ask = [{ send = 7 }]")],
            "identity.ask.1.send: is the integer 7, give a string in quotation marks, or",
        ),
        (&[(ask, "ask = [{ send = \"\" }]")], "identity.ask.1.send: has 0 bytes; give 1 to 256"),
        (&[(message, "message = { begins = \"a\", serial = {} }")], "identity.message.serial: is for a message with a"),
        (&[(message, "message = {}")], "identity.message.begins: missing"),
        (&[(message, frame)], "identity.message.begins: is of type array, give a string"),
        (&[(message, frame)], "identity.message.serial.as: is \"f32\"; give text, hex, u8"),
        (&[(message, &frame.replace("f32", "u32").replace("256", "1"))], "the 4 bytes are not within the 9"),
        (&[("[identity]", "[identity]\non_other = \"refuse\"")], "identity.on_other: is \"refuse\", give \"flag\" or"),
        (&[("[identity]", "[identity]\nasks = 1")], "identity.asks: unknown key"),
        (&[SERIAL, serial], "identity.ask: datagrams have nobody to whom it could be sent"),
        (&[set_up], "setup.1.sends: unknown key"),
        (&[set_up], "setup.1.send: missing; give what is sent"),
        (&[set_up, (ask, "")], "setup: is sent once the device has said who it is; give identity.ask"),
    ] {
        let found = faults(changes);
        assert!(found.contains(expected), "{expected}\n--\n{found}");
    }
    // Without a number nothing would be asked.
    assert_eq!(faults(&[serial]), "");
    let iio = changed("bmi270", &[("[iio]", "[identity]\nfield = \"x\"\n[iio]")]);
    let found = Description::from_toml(&iio).err().unwrap().to_string();
    assert!(found.contains("identity: is not for IIO; leave it out"), "{found}");
}

const OURS: &[u8] = b"$VNRRG,03,0100061897*5C\r\n";
const THEIRS: &[u8] = b"$VNRRG,03,0100061999*53\r\n";

/// Opens the port of a device, and hears this after the question.
fn answer(recognition: &mut Recognition, tally: &mut Tally, answer: &[u8]) -> Result<usize, String> {
    let mut asked = Vec::new();
    let mut write = |bytes: &[u8]| {
        asked.extend_from_slice(bytes);
        bytes.len()
    };
    recognition.begin();
    assert_eq!(recognition.hear(b"a frame", tally, &mut write).unwrap(), 7, "it came before the question");
    let used = recognition.hear(&[answer, b"a frame"].concat(), tally, &mut write);
    assert_eq!(asked, b"$VNRRG,03*70\r\n");
    used.map_err(|failure| failure.to_string())
}

#[test]
fn another_device_is_refused_only_before_the_first_sample() {
    let mut tally = Tally::default();
    let refused = answer(&mut Recognition::new(&vn100(), false), &mut tally, THEIRS).unwrap_err();
    assert!(refused.contains("says that it is 0100061999, and the description is of 0100061897"), "{refused}");
    // A restart in flight.
    let mut restarted = Recognition::new(&vn100(), true);
    assert_eq!(answer(&mut restarted, &mut tally, THEIRS), Ok(THEIRS.len() - 1));
    assert_eq!((restarted.signature(), tally.is_other), (Signature::Other(device("0100061999")), true));
    // The right one comes back.
    assert_eq!(answer(&mut restarted, &mut tally, OURS), Ok(OURS.len() - 1));
    assert_eq!(restarted.signature(), Signature::Own);
    assert_eq!((tally.is_other, tally.power_ups), (false, 0));
    // One that says so unasked was just powered.
    assert_eq!(restarted.hear(OURS, &mut tally, &mut |_| 0).unwrap(), 0);
    assert_eq!(tally.power_ups, 1);
}

#[test]
fn another_device_in_a_network_may_be_another_sender() {
    let udp = "udp = \"0.0.0.0:4000\"\npeer = \"any\"";
    let line = "serial = \"/dev/ttyUSB0\"\nbaud = 921600";
    let tail = "message = { begins = \"$VNRRG,03,\" }";
    for (source, exit) in [(line, Exit::Config), ("tcp = \"a:1\"", Exit::Temporary), (udp, Exit::Temporary)] {
        let ask = ("ask = [{ send = \"$VNRRG,03*70\\r\\n\" }]", "");
        let text = changed("vn100", &[SERIAL, (line, source), ask, (tail, "field = \"time\"")]);
        let description = Description::from_toml(&text).unwrap();
        let row: Vec<_> = description.columns().iter().map(|_| Value { number: 7.0, whole: Some(7) }).collect();
        let refused = Recognition::new(&description, false).see(&row, &mut Tally::default()).unwrap_err();
        assert_eq!(refused.exit, exit, "{source}: {refused}");
        // Once a sample was sent, nothing ends it.
        assert!(Recognition::new(&description, true).see(&row, &mut Tally::default()).is_ok());
    }
}

#[test]
fn samples_of_another_device_are_held_if_so_described() {
    let text = changed("vn100", &[SERIAL, ("[identity]", "[identity]\non_other = \"hold\"")]);
    let description = Description::from_toml(&text.replace("0100061897", "0100061998")).unwrap();
    let (mut tally, mut recognition) = (Tally::default(), Recognition::new(&description, true));
    answer(&mut recognition, &mut tally, OURS).unwrap();
    assert_eq!(recognition.signature(), Signature::Held);
}
