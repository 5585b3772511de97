use super::*;
use isotherm_client::monotonic_ns;
use isotherm_instruments::RealTime;
use isotherm_shared::wire::{RawSample, Triad};
use std::path::Path;
use std::sync::Arc;

const SECOND: u64 = 1_000_000_000;
const DWELL: CampaignStep = CampaignStep::Dwell { visit: 0, position: 0 };

/// The streams of three IMUs with dwells of 30 s, without a service: samples come by [`Bench::feed`].
pub(crate) struct Bench {
    pub plan: &'static Plan,
    pub streams: Streams<'static>,
    begun_ns: u64,
}

impl Bench {
    pub(crate) fn new(folder: &Path) -> Self {
        let text = include_str!("../../../../examples/plan-batch.toml").replace("time_s = 300\n", "time_s = 30\n");
        // These streams have no temperature.
        let text: String = text
            .lines()
            .filter(|line| !line.starts_with("temperature_per_h"))
            .map(|line| format!("{line}\n"))
            .collect();
        let plan = Plan::from_toml(&text.replace("\"batch-campaign\"", "\".\""), folder).unwrap();
        let plan: &'static Plan = Box::leak(Box::new(plan));
        let (clock, history) = (LaboratoryClock::new(Arc::new(RealTime), 1.0), History::default());
        let all = plan.each().iter().map(|plan| ImuStream::new(plan, &history, clock.clone(), 0.0).unwrap());
        let streams = Streams { all: all.collect(), clock, domain: "default".to_owned() };
        Self { plan, streams, begun_ns: monotonic_ns() }
    }

    /// Samples of 1 s of an IMU, that end within these seconds after the begin.
    pub(crate) fn feed(&mut self, imu: usize, session: u64, seconds: std::ops::Range<u64>) {
        for second in seconds {
            let end_ns = 1000 * SECOND + second * SECOND;
            let sample = RawSample {
                session,
                sequence: second,
                timestamp_ns: end_ns,
                interval_ns: SECOND,
                sent_ns: self.begun_ns + second * SECOND,
                telemetry_ns: end_ns,
                accelerometers: Triad::default(),
                ..RawSample::default()
            };
            assert!(self.streams.all[imu].recorder.take(&sample, sample.sent_ns + 1000).unwrap(), "{second}");
        }
    }
}

fn spoiler(streams: &Streams<'_>, is_last_attempt: bool) -> Option<usize> {
    streams.spoiler(is_last_attempt).map(|failed| failed.imu)
}

fn numbers(failed: &[FailedImu]) -> Vec<usize> {
    failed.iter().map(|failed| failed.imu).collect()
}

#[test]
fn a_unit_is_complete_when_every_imu_that_is_in_has_it() {
    let folder = tempfile::tempdir().unwrap();
    let mut bench = Bench::new(folder.path());
    bench.streams.begin(DWELL).unwrap();
    for imu in 0..2 {
        bench.feed(imu, 7, 1..40);
    }
    bench.feed(2, 7, 1..15);
    assert!(!bench.streams.complete() && bench.streams.collected_s() == 10.0);
    let slow = bench.streams.slow(DWELL, "few", f64::INFINITY);
    assert_eq!((numbers(&slow), slow[0].reason.as_str()), (vec![2], "few"));
    let silent = bench.streams.slow(DWELL, "few", -1.0);
    assert!(silent[0].reason.starts_with("no usable sample of "), "{}", silent[0].reason);
    let plan = bench.streams.drop_imu(2);
    assert_eq!((plan.imu.as_str(), bench.streams.has_others()), ("imu-c", true));
    assert!(bench.streams.complete());
    let kept = bench.streams.keep(DWELL, 0).unwrap().unwrap();
    let files: Vec<_> = kept.each().map(|kept| (kept.file.as_str(), kept.rows)).collect();
    assert_eq!(files, [("imu-a.csv", 3), ("imu-b.csv", 3)]);
    // Nothing of the unit stays of the one that was dropped, and the next unit follows the first in each file.
    assert_eq!(std::fs::metadata(folder.path().join("imu-c.csv")).unwrap().len(), 0);
    let next = CampaignStep::Dwell { visit: 0, position: 1 };
    bench.streams.begin(next).unwrap();
    let from = bench.streams.present().map(|stream| stream.kept_bytes).collect::<Vec<_>>();
    assert_eq!(from, [kept.to, kept.others[0].to]);
    // All are slow: it is nobody's fault.
    assert_eq!(numbers(&bench.streams.slow(next, "few", f64::INFINITY)), NONE);
    // The last one stays.
    bench.streams.drop_imu(0);
    assert!(!bench.streams.has_others());
}

#[test]
fn who_spoils_a_unit_as_often_as_the_plan_attempts_it_is_named() {
    let folder = tempfile::tempdir().unwrap();
    let mut bench = Bench::new(folder.path());
    for attempt in 0..5 {
        assert_eq!(spoiler(&bench.streams, true), None);
        bench.streams.begin(DWELL).unwrap();
        let begin = 1 + 10 * attempt;
        bench.feed(0, 7, begin..begin + 10);
        // Its acquisition starts anew in every attempt.
        bench.feed(1, 10 + 2 * attempt, begin..begin + 5);
        assert_eq!(bench.streams.spoiled(), None);
        bench.feed(1, 11 + 2 * attempt, begin + 5..begin + 10);
        assert_eq!(bench.streams.spoiled().as_deref(), Some("imu-b: the acquisition was restarted"));
        if attempt < 4 {
            assert_eq!(spoiler(&bench.streams, false), None, "{attempt}");
            assert_eq!(spoiler(&bench.streams, true), Some(1), "{attempt}");
            bench.streams.discard();
        }
    }
    let failed = bench.streams.spoiler(false).unwrap();
    assert_eq!((failed.imu, failed.reason.as_str()), (1, "the acquisition was restarted; attempts spoiled: 5"));
    bench.streams.drop_imu(1);
    assert_eq!((bench.streams.spoiled(), spoiler(&bench.streams, true)), (None, None));
}

const NONE: [usize; 0] = [];

/// Streams with a sample each second within these spans \[s\].
fn silent_at(now: f64, others_s: f64, spans: &[&[[u32; 2]]]) -> Vec<usize> {
    let flow = |spans: &&[[u32; 2]]| {
        let mut flow = Flow::default();
        let times = spans.iter().flat_map(|[from, to]| *from..*to).map(f64::from);
        times.filter(|at| *at <= now).for_each(|at| flow.add(at, 60.0));
        flow
    };
    let flows: Vec<_> = spans.iter().map(flow).enumerate().collect();
    Flow::silent(&flows, now, 60.0, others_s)
}

#[test]
fn a_stream_has_stopped_only_while_another_one_flows() {
    let one_stops: [&[[u32; 2]]; 3] = [&[[0, 1000]], &[[0, 100]], &[[0, 1000]]];
    assert_eq!(silent_at(159.0, 60.0, &one_stops), NONE);
    assert_eq!(silent_at(160.0, 60.0, &one_stops), [1]);
    // All stop, one a little later than the others.
    let all_stop: [&[[u32; 2]]; 3] = [&[[0, 100]], &[[0, 100]], &[[0, 120]]];
    for now in [150.0, 160.0, 170.0, 200.0, 1000.0] {
        assert_eq!(silent_at(now, 60.0, &all_stop), NONE, "{now}");
    }
    // One comes back before the others: they have the same time again.
    let back: [&[[u32; 2]]; 3] = [&[[0, 100], [500, 1000]], &[[0, 100], [540, 1000]], &[[0, 100]]];
    assert_eq!(silent_at(539.0, 60.0, &back), NONE);
    assert_eq!(silent_at(560.0, 60.0, &back), NONE);
    assert_eq!(silent_at(561.0, 60.0, &back), [2]);
    assert_eq!(silent_at(510.0, 0.0, &back), [1, 2], "the pause is over");
    // One that has never sent.
    assert_eq!(silent_at(161.0, 60.0, &[&[[0, 1000]], &[]]), [1]);
    assert_eq!(silent_at(161.0, 60.0, &[&[], &[]]), NONE);
}
