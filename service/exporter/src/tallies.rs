//! The metrics of acquisitions: `isotherm acquire` writes its tally into the domain's folder once a second.

use crate::metric::{Metric, MetricsText};
use isotherm_client::{Domain, ImuId, Note, boot, monotonic_ns};
use serde_json::Value;
use std::fs;

/// Only the time of an older tally is shown \[ns\]: its acquisition is stopped, or was killed.
const MAX_AGE_NS: u64 = 5_000_000_000;

/// Declares the metrics with one value for each acquisition, and where it is in the tally.
macro_rules! metrics {
    ($($kind:ident $name:literal $place:literal $help:literal;)+) => {
        const METRICS: &[(Metric, &str)] = &[$((
            Metric {
                kind: stringify!($kind),
                name: concat!("isotherm_acquire_", $name),
                labels: &["imu"],
                help: $help,
            },
            $place,
        )),+];
    };
}

metrics! {
    gauge "written_timestamp_seconds" "/written_unix_s" "Unix time when these values were written [s].";
    gauge "seconds" "/seconds" "How long the acquisition has run [s].";
    counter "bytes_total" "/bytes" "Bytes received.";
    counter "frames_total" "/frames" "Frames, lines or scans received whole.";
    counter "samples_total" "/samples" "Samples made from them.";
    counter "unhealthy_total" "/unhealthy" "Samples of a device whose status is not healthy.";
    counter "stale_temperature_total" "/stale" "Samples whose temperature is stale.";
    counter "repeated_total" "/repeated" "Frames with the number of the frame before.";
    counter "others_total" "/others" "Frames of items without those of the sensors.";
    counter "incomplete_total" "/incomplete" "Frames without all columns of the sensors.";
    counter "without_temperature_total" "/without_temperature" "Frames before the first temperature.";
    counter "out_of_range_total" "/out_of_range" "Frames with more pulses than a sample has.";
    counter "gaps_total" "/gaps" "Places where control periods are missing.";
    counter "missing_total" "/missing" "Control periods that are missing.";
    counter "ambiguous_total" "/ambiguous" "Gaps whose length is not certain.";
    counter "sessions_total" "/sessions" "Sessions.";
    counter "outages_total" "/outages" "Times that the device went away.";
    gauge "rate_hz" "/rate_hz" "Frames per second over the last seconds [Hz].";
    gauge "device_present" "/is_there" "Whether the device is there (1) or away (0).";
    gauge "last_frame_timestamp_seconds" "/last_frame_s"
        "When the last frame was seen [s since 1970]; 0 before the first.";
    counter "other_rate_total" "/other_rate" "Samples that are invalid for another rate.";
    counter "adopted_total" "/adopted" "Times that a rate other than the described one was adopted.";
    gauge "adopted_interval_seconds" "/adopted_interval_s"
        "Adopted interval of the device [s]; 0 while the described one is used.";
    counter "strangers_total" "/strangers" "Datagrams from senders other than the peer.";
    gauge "other_device" "/is_other" "1 if the device differs from the description.";
    counter "other_device_total" "/other_device" "Samples of another device.";
    counter "held_total" "/held" "Samples of another device that were not sent.";
    counter "unanswered_total" "/unanswered" "Requests and settings without an answer.";
    counter "power_ups_total" "/power_ups" "Times that the device reported a power-up.";
    counter "damaged_total" "/skipped/damaged" "Frames or lines that began and were damaged.";
    counter "sent_total" "/service/sent" "Samples sent to the service.";
    counter "answered_total" "/service/answered" "Samples answered by the service.";
    counter "dropped_total" "/service/dropped" "Samples that the service did not accept within half a minute.";
    counter "recorded_total" "/recorded" "Rows that were recorded.";
    counter "unanswered_samples_total" "/service/unanswered"
        "Samples sent and not answered when the way to the service failed.";
    counter "not_recorded_total" "/not_recorded" "Rows that could not be recorded.";
}

const SKIPPED: Metric = Metric {
    kind: "counter",
    name: "isotherm_acquire_skipped_bytes_total",
    labels: &["imu", "cause"],
    help: "Bytes outside any frame, by cause.",
};
/// Why bytes are no frame.
const CAUSES: [&str; 7] = ["noise", "length", "checksum", "unconfirmed", "items", "columns", "cut"];
/// When the tally was written \[s since 1970\].
const WRITTEN: &str = "/written_unix_s";

/// Every metric of acquisitions.
pub(crate) fn metrics() -> impl Iterator<Item = Metric> {
    METRICS.iter().map(|(metric, _)| *metric).chain([SKIPPED])
}

/// The tallies of a domain, each with its IMU, in the order of their names.
pub(crate) fn read(domain: &Domain) -> Vec<(ImuId, Value)> {
    let files = fs::read_dir(domain.root_path()).into_iter().flatten().flatten();
    let prefix = domain.prefix() + "tally-";
    let imu = |name: &str| ImuId::new(name.strip_prefix(&prefix)?.strip_suffix(".json")?);
    let mut imus: Vec<_> = files.filter_map(|file| imu(file.file_name().to_str()?)).collect();
    imus.sort();
    let tally = |imu: ImuId| {
        let text = Note::of_tally(domain, &imu).read()?;
        Some((imu, serde_json::from_slice(&text).ok()?))
    };
    imus.into_iter().filter_map(tally).collect()
}

/// Writes all metrics of acquisitions.
pub(crate) fn render(text: &mut MetricsText, tallies: &[(ImuId, Value)]) {
    let (now_ns, boot) = (monotonic_ns(), boot());
    let is_recent = |tally: &Value| is_recent(tally, now_ns, boot);
    for (metric, place) in METRICS {
        text.family(*metric);
        for (imu, tally) in tallies.iter().filter(|(_, tally)| *place == WRITTEN || is_recent(tally)) {
            if let Some(value) = number(tally, place) {
                text.sample(metric.name, &[("imu", imu.as_str())], value);
            }
        }
    }
    text.family(SKIPPED);
    for (imu, tally) in tallies.iter().filter(|(_, tally)| is_recent(tally)) {
        for cause in CAUSES {
            if let Some(bytes) = number(tally, &format!("/skipped/{cause}")) {
                text.sample(SKIPPED.name, &[("imu", imu.as_str()), ("cause", cause)], bytes);
            }
        }
    }
}

/// Whether a tally was written a short time before this one \[ns\] of the machine's start `boot`. The clock of day does
/// not show that, since it may be set at any time.
fn is_recent(tally: &Value, now_ns: u64, boot: u64) -> bool {
    let of = |place| tally.get(place).and_then(Value::as_u64);
    let age_ns = of("written_ns").and_then(|written_ns| now_ns.checked_sub(written_ns));
    of("boot") == Some(boot) && age_ns.is_some_and(|age_ns| age_ns < MAX_AGE_NS)
}

/// The number at a place of a tally; of yes and no, 1 and 0.
fn number(tally: &Value, place: &str) -> Option<f64> {
    let value = tally.pointer(place)?;
    value.as_f64().or_else(|| value.as_bool().map(|yes| f64::from(u8::from(yes))))
}

#[cfg(test)]
mod tests {
    use super::*;
    use isotherm_client::unix_s;
    use serde_json::json;

    #[test]
    fn of_a_tally_that_is_not_written_any_more_only_the_time_is_shown() {
        let imus = ["imu-a", "imu-b", "imu-c", "imu-d"].map(|imu| imu.parse::<ImuId>().unwrap());
        let tally = |written_unix_s: f64, boot: u64, ago_ns: u64| {
            json!({ "written_unix_s": written_unix_s, "boot": boot, "written_ns": monotonic_ns().saturating_sub(ago_ns),
                "is_there": true, "frames": 7, "rate_hz": null, "service": { "sent": 5 },
                "skipped": { "noise": 3, "damaged": 1 } })
        };
        // The clock of day may be set at any time, and says nothing about the age: a new tally, an old one, and one of
        // before the machine was started.
        let now = unix_s();
        let new = tally(now - 7200.0, boot(), 0);
        let old =
            [tally(now + 7200.0, boot(), 6_000_000_000), tally(now, boot() ^ 1, 0), json!({ "written_unix_s": now })];
        let mut text = MetricsText::default();
        render(&mut text, &imus.into_iter().zip([new].into_iter().chain(old)).collect::<Vec<_>>());
        let samples = |imu: &str| {
            let of_imu = format!("imu=\"{imu}\"");
            let lines = text.0.lines().filter(|line| line.contains(&of_imu) && !line.contains("_written_"));
            lines.map(|line| line.trim_start_matches("isotherm_acquire_")).collect::<Vec<_>>()
        };
        let expected = [
            "frames_total{imu=\"imu-a\"} 7",
            "device_present{imu=\"imu-a\"} 1",
            "damaged_total{imu=\"imu-a\"} 1",
            "sent_total{imu=\"imu-a\"} 5",
            "skipped_bytes_total{imu=\"imu-a\",cause=\"noise\"} 3",
        ];
        assert_eq!(samples("imu-a"), expected);
        for imu in ["imu-b", "imu-c", "imu-d"] {
            assert!(samples(imu).is_empty(), "{imu}");
        }
        assert_eq!(text.0.matches("isotherm_acquire_written_timestamp_seconds{").count(), 4);
    }

    #[test]
    fn only_tallies_of_this_user_and_domain_are_read() {
        let folder = tempfile::tempdir().unwrap();
        let root = folder.path().join("root");
        fs::create_dir(&root).unwrap();
        let domain = Domain::new("tallies", root.to_str().unwrap()).unwrap();
        for (imu, text) in [("imu-b", "{\"frames\":1}"), ("imu-a", "{}"), ("imu-c", "{"), ("imu-d", "\u{ff}")] {
            Note::of_tally(&domain, &imu.parse().unwrap()).write(text.as_bytes()).unwrap();
        }
        let prefix = domain.prefix();
        for other in ["tally-Not An IMU.json", "tally-imu-e.json.17", "acquired-imu-f.json"] {
            fs::write(root.join(format!("{prefix}{other}")), "{}").unwrap();
        }
        std::os::unix::fs::symlink("/etc/passwd", root.join(format!("{prefix}tally-imu-g.json"))).unwrap();
        let names: Vec<_> = read(&domain).into_iter().map(|(imu, _)| imu.to_string()).collect();
        assert_eq!(names, ["imu-a", "imu-b"]);
    }
}
