//! The list of devices.

use super::super::list;
use super::records::{ADIS16505, BMI270};
use super::tree::Fake;

#[test]
fn a_list_has_what_a_description_needs() {
    let fake = Fake::with(&[ADIS16505, BMI270]);
    let devices = list(fake.root()).unwrap();
    assert_eq!(devices.iter().map(|device| device.name.as_str()).collect::<Vec<_>>(), ["adis16505-2", "bmi270"]);
    let adis = &devices[0];
    assert_eq!((adis.index, adis.trigger.as_deref()), (0, Some("adis16505-2-dev0")));
    assert_eq!(adis.channels[0].name, "anglvel_x");
    assert_eq!((adis.channels[0].scan.as_deref(), adis.channels[0].scale), (Some("be:s32/32>>0"), Some(0.000_000_006)));
    assert_eq!(adis.rates[0].now, "2000.000000");
    let temperature = devices[1].channels.iter().find(|channel| channel.name == "temp").unwrap();
    assert_eq!((temperature.scan.as_deref(), temperature.offset), (None, Some(11776.0)));
    assert_eq!(devices[1].rates.len(), 2);
    assert!(devices[1].rates[0].available.as_ref().unwrap().starts_with("0.781250 "));
    assert!(devices.iter().all(|device| device.channels.iter().all(|channel| channel.name != "timestamp")));
    assert!(serde_json::to_string(&devices).unwrap().contains("\"rates\""));
}

#[test]
fn a_kernel_without_iio_has_no_devices() {
    let root = tempfile::tempdir().unwrap();
    assert_eq!(list(root.path()).unwrap(), []);
}
