//! Faults that are injected on request: DIR/faults has one per line and is read again whenever it changes.
//!
//! A line is `WHAT[:DEVICE][@WHEN]`. WHAT names an [`InjectedFault`]. DEVICE is `chamber` or `table`; without
//! it both have the fault. DEVICE of `silent` is the name of an IMU; without it all IMUs have the fault. WHEN is `3`
//! for the third request, `3-5` for the third to the fifth, or `100s-200s` for simulated seconds; without it the fault
//! is permanent. Requests are counted from the last reading of the file.

use super::station::StationProcess;
use isotherm_files::Identity;
use isotherm_shared::names::ImuId;
use isotherm_support::failure::{shown, tell};
use std::fs;
use std::ops::RangeInclusive;
use std::path::{Path, PathBuf};
use std::str::FromStr;
use strum::{EnumString, VariantNames};

/// Name of the file with the faults, in a station's folder.
pub(crate) const FAULTS: &str = "faults";

/// A fault that can be injected. Its text is its name in a line.
#[derive(Clone, Copy, Debug, Eq, EnumString, PartialEq, VariantNames)]
#[strum(serialize_all = "kebab-case")]
pub enum InjectedFault {
    /// Bytes of the reply are overwritten.
    Garbled,
    /// The reply is sent after the time-out.
    Late,
    /// The reply is not sent.
    Missing,
    /// The reply is sent twice.
    Duplicated,
    /// The device sends digits without end. It goes on obeying; its replies are lost among the digits.
    Babble,
    /// The port exists, but takes nothing and sends nothing; what was sent meanwhile is lost.
    Dead,
    /// The request is refused, or not answered if the protocol has no refusal.
    Na,
    /// The device has an alarm: the chamber stops heating and cooling; the turntable stops, and its interlocks are at
    /// fault.
    Alarm,
    /// The port does not exist.
    PortLoss,
    /// The turntable oscillates.
    NoSettle,
    /// The chamber overshoots each set point.
    Overshoot,
    /// The chamber never reaches its set point.
    NeverThere,
    /// The IMU sends nothing.
    Silent,
}

/// When a fault is active.
#[derive(Clone, Debug, PartialEq)]
enum FaultSpan {
    Always,
    Requests(RangeInclusive<u64>),
    Seconds(RangeInclusive<f64>),
}

/// One line of the file.
#[derive(Clone, Debug, PartialEq)]
pub struct Injection {
    fault: InjectedFault,
    /// `None` for both devices, or for all IMUs.
    device: Option<StationProcess>,
    /// The IMU that is silent; `None` for all of them.
    imu: Option<ImuId>,
    when: FaultSpan,
}

impl FromStr for Injection {
    type Err = String;

    fn from_str(line: &str) -> Result<Self, String> {
        let (rest, when) = line.split_once('@').map_or((line, None), |(rest, when)| (rest, Some(when)));
        let (fault, device) = rest.split_once(':').map_or((rest, None), |(fault, device)| (fault, Some(device)));
        let fault = fault.parse::<InjectedFault>();
        let fault = fault.map_err(|_| format!("give one of {}", InjectedFault::VARIANTS.join(", ")))?;
        let expected = "after the @ give a request as 3, requests as 3-5, or seconds as 100s-200s";
        let when = when.map_or(Some(FaultSpan::Always), parse_when).ok_or(expected)?;
        if fault == InjectedFault::Silent {
            if matches!(when, FaultSpan::Requests(_)) {
                return Err("an IMU gets no requests; after the @ give seconds as 100s-200s".to_owned());
            }
            let imu = device.map(str::parse).transpose().map_err(|_| "after the colon give the name of an IMU")?;
            return Ok(Self { fault, device: Some(StationProcess::Imu), imu, when });
        }
        let device = match device {
            None => None,
            Some("chamber") => Some(StationProcess::Chamber),
            Some("table") => Some(StationProcess::Turntable),
            Some(_) => return Err("after the colon give chamber or table".to_owned()),
        };
        Ok(Self { fault, device, imu: None, when })
    }
}

fn parse_when(text: &str) -> Option<FaultSpan> {
    let (from, to) = text.split_once('-').unwrap_or((text, text));
    if let (Some(from), Some(to)) = (from.strip_suffix('s'), to.strip_suffix('s')) {
        let (from, to): (f64, f64) = (from.parse().ok()?, to.parse().ok()?);
        return (from <= to).then_some(FaultSpan::Seconds(from..=to));
    }
    let (from, to) = (from.parse().ok()?, to.parse().ok()?);
    (1 <= from && from <= to).then_some(FaultSpan::Requests(from..=to))
}

/// The faults of one device.
pub(crate) struct FaultSchedule {
    path: PathBuf,
    /// The version of the file that was read last.
    version: Option<Identity>,
    device: StationProcess,
    injections: Vec<Injection>,
    /// Requests since the file was read.
    requests: u64,
}

impl FaultSchedule {
    /// The faults of `device`, from the file in the station's folder.
    pub(crate) fn new(folder: &Path, device: StationProcess) -> Self {
        Self { path: folder.join(FAULTS), version: None, device, injections: Vec::new(), requests: 0 }
    }

    /// Counts a request.
    pub(crate) fn count_request(&mut self) {
        self.reload_if_changed();
        self.requests += 1;
    }

    /// The faults that are active at `now_s`, for the latest request.
    pub(crate) fn active(&mut self, now_s: f64) -> Vec<InjectedFault> {
        self.reload_if_changed();
        self.injected(now_s).map(|injection| injection.fault).collect()
    }

    /// Whether `imu` is silent at `now_s`, as the file was last read.
    pub(crate) fn is_silent(&self, now_s: f64, imu: &ImuId) -> bool {
        let of_imu = |injection: &Injection| injection.imu.as_ref().is_none_or(|silent| silent == imu);
        self.injected(now_s).any(|injection| injection.fault == InjectedFault::Silent && of_imu(injection))
    }

    fn injected(&self, now_s: f64) -> impl Iterator<Item = &Injection> {
        let mine =
            self.injections.iter().filter(|injection| injection.device.is_none_or(|device| device == self.device));
        mine.filter(move |injection| match &injection.when {
            FaultSpan::Always => true,
            FaultSpan::Requests(range) => range.contains(&self.requests),
            FaultSpan::Seconds(range) => range.contains(&now_s),
        })
    }

    /// Reads the file again if it has changed. An invalid line is reported and ignored, so that the station goes on.
    pub(crate) fn reload_if_changed(&mut self) {
        let version = Identity::of(&self.path);
        if version != self.version {
            self.version = version;
            let text = fs::read_to_string(&self.path).unwrap_or_default();
            self.injections.clear();
            for (number, line) in (1..).zip(text.lines()).filter(|(_, line)| !line.trim().is_empty()) {
                match line.trim().parse() {
                    Ok(injection) => self.injections.push(injection),
                    // Both devices read the file, one reports.
                    Err(wrong) if self.device == StationProcess::Chamber => {
                        let path = shown(&self.path);
                        tell("isotherm", format_args!("the simulated station: {path}:{number}: {line:?}: {wrong}"));
                    }
                    Err(_) => {}
                }
            }
            self.requests = 0;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_line_has_fault_device_and_time() {
        let parse = |line: &str| line.parse::<Injection>();
        let (fault, device) = (InjectedFault::Late, Some(StationProcess::Turntable));
        let imu = None;
        assert_eq!(
            parse("late:table@3-5"),
            Ok(Injection { fault, device, imu: imu.clone(), when: FaultSpan::Requests(3..=5) })
        );
        assert_eq!(
            parse("late:table@7"),
            Ok(Injection { fault, device, imu: imu.clone(), when: FaultSpan::Requests(7..=7) })
        );
        let when = FaultSpan::Seconds(100.0..=2e3);
        assert_eq!(
            parse("port-loss@100s-2000s"),
            Ok(Injection { fault: InjectedFault::PortLoss, device: None, imu, when: when.clone() })
        );
        let (fault, device) = (InjectedFault::Silent, Some(StationProcess::Imu));
        let imu = ImuId::new("imu-b");
        assert_eq!(parse("silent:imu-b@100s-2000s"), Ok(Injection { fault, device, imu, when }));
        for wrong in [
            "silent:no name",
            "silent@3",
            "",
            "lost",
            "late:imu",
            "late@0",
            "late@5-3",
            "late@1s-2",
            "late@",
            "late:table@x",
        ] {
            assert!(parse(wrong).is_err(), "{wrong}");
        }
    }

    #[test]
    fn one_imu_or_all_of_them_are_silent() {
        let folder = tempfile::tempdir().unwrap();
        let mut faults = FaultSchedule::new(folder.path(), StationProcess::Imu);
        let imus = ["imu-a", "imu-b"].map(|name| ImuId::new(name).unwrap());
        for (line, expected) in [
            ("silent:imu-b", [false, true]),
            ("silent", [true, true]),
            ("silent:imu-a@6s-7s", [false, false]),
            ("late", [false, false]),
        ] {
            fs::write(folder.path().join(FAULTS), line).unwrap();
            faults.version = None;
            faults.reload_if_changed();
            assert_eq!(imus.each_ref().map(|imu| faults.is_silent(5.0, imu)), expected, "{line}");
        }
        let mut chamber = FaultSchedule::new(folder.path(), StationProcess::Chamber);
        fs::write(folder.path().join(FAULTS), "silent").unwrap();
        assert_eq!(chamber.active(5.0), []);
    }

    #[test]
    fn requests_count_from_when_the_file_was_read() {
        let folder = tempfile::tempdir().unwrap();
        let mut faults = FaultSchedule::new(folder.path(), StationProcess::Chamber);
        faults.count_request();
        assert_eq!(faults.active(0.0), []);
        fs::write(folder.path().join(FAULTS), "late@2\nna:table\nalarm:chamber@5s-6s\nnonsense\n").unwrap();
        faults.count_request();
        assert_eq!(faults.active(5.5), [InjectedFault::Alarm]);
        faults.count_request();
        assert_eq!(faults.active(0.0), [InjectedFault::Late]);
        fs::remove_file(folder.path().join(FAULTS)).unwrap();
        assert_eq!(faults.active(5.5), []);
    }
}
