//! Random mixtures of bad stamps: rows keep their true times, or are left out and counted.
#![allow(clippy::print_stdout, reason = "a study prints its figures")]

use isotherm_recording_formats::convert::{Conversion, Settings};
use isotherm_shared::wire::RawSample;
use std::fmt::Write as _;
use std::io::Cursor;
use std::path::Path;

const MAPPING: &str = "format = 1\n[time]\ncolumn = \"t\"\nunit = \"ns\"\n[accelerometer]\n\
     columns = [\"x\", \"y\", \"z\"]\nkind = \"reading\"\n[temperature]\nconstant = 25\n";

struct Random(u64);

impl Random {
    fn next(&mut self) -> u64 {
        self.0 = self.0.wrapping_add(0x9e37_79b9_7f4a_7c15);
        let mixed = (self.0 ^ (self.0 >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
        let mixed = (mixed ^ (mixed >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
        mixed ^ (mixed >> 31)
    }

    fn below(&mut self, end: usize) -> usize {
        (self.next() % end.max(1) as u64) as usize
    }

    /// From 0 to 1.
    fn part(&mut self) -> f64 {
        self.next() as f64 / u64::MAX as f64
    }
}

/// The true number of a row and its stamp \[ns\].
type Row = (usize, u64);

/// A series: the times of its rows, what a logger made of them, the period \[ns\] and the number of copies.
struct Series {
    times: Vec<u64>,
    rows: Vec<Row>,
    bad: Vec<usize>,
    period: f64,
    copies: usize,
}

/// Rows at a rate from 1 to 1000 Hz, with jitter up to 10 % and gaps, of which up to 1 % have a bad stamp.
fn series(random: &mut Random) -> Series {
    let period = 1e9 / libm::pow(10_f64, 3.0 * random.part());
    let (jitter, lossy) = (0.1 * random.part(), random.below(3));
    let count = 500 + random.below(2500);
    let mut clock = [5e9, 3.6e12, 1.7e18][random.below(3)];
    let mut times = Vec::new();
    for _ in 0..count {
        clock += period;
        match (lossy, random.below(200)) {
            (1, 0) => clock += period * (1 + random.below(3)) as f64,
            (2, 0) => clock += period * 60.0 * random.part(),
            _ => {}
        }
        times.push((clock + period * jitter * (2.0 * random.part() - 1.0)) as u64);
    }
    let mut rows: Vec<Row> = times.iter().copied().enumerate().collect();
    let (mut bad, mut used, mut copies) = (Vec::new(), Vec::new(), 0);
    let mut budget = 1 + random.below(count / 100);
    let mut kinds: Vec<_> = (0..budget).map(|_| random.below(7)).collect();
    // Copies come last, so that they stay copies.
    kinds.sort_unstable();
    for kind in kinds {
        if budget == 0 {
            break;
        }
        // The last rows have nothing behind them that would show that they are ahead.
        let at = 3 + random.below(rows.len() - 20);
        let far = (period * 1.5 * libm::pow(10_f64, 6.0 * random.part())) as u64;
        // A row with two faults at once, or whose stamp another one took, has no place that a reader could name.
        let is_used = |(number, _): &Row| used.contains(number) || kind == 4 && bad.contains(number);
        if kind < 5 && rows[at - 1..at + 5].iter().any(is_used) {
            continue;
        }
        match kind {
            0 => used.extend([rows[at - 1].0, rows[at].0]),
            4 => used.extend([rows[at].0, rows[at + 1].0]),
            _ => {}
        }
        let cost = match kind {
            0 => {
                rows[at].1 = rows[at - 1].1;
                bad.push(rows[at].0);
                1
            }
            1 => {
                rows[at].1 = rows[at - 1].1.saturating_sub(far).max(1);
                bad.push(rows[at].0);
                1
            }
            2 => {
                let few = (1 + random.below(5)).min(budget);
                let ahead = rows[at + few].1.saturating_sub(rows[at].1) + far;
                for row in &mut rows[at..at + few] {
                    row.1 += ahead;
                    bad.push(row.0);
                }
                few
            }
            3 => {
                rows[at].1 = 0;
                bad.push(rows[at].0);
                1
            }
            4 => {
                rows.swap(at, at + 1);
                1
            }
            5 => {
                let row = rows[at];
                rows.insert(at, row);
                copies += 1;
                1
            }
            _ => {
                let from = at.saturating_sub(2 + random.below(90));
                let block = rows[from..at].to_vec();
                copies += block.len();
                rows.splice(at..at, block);
                1
            }
        };
        budget -= cost;
    }
    Series { times, rows, bad, period, copies }
}

fn convert(rows: &[Row]) -> Result<(Vec<RawSample>, String), String> {
    let mut text = "t,x,y,z\n".to_owned();
    for (number, stamp) in rows {
        // The number identifies the row, and rows with bad stamps from the rows next to them.
        writeln!(text, "{stamp},{number},{},7", number * 7919 % 1000).unwrap();
    }
    let mapping = Some((Path::new("m.toml"), MAPPING));
    let conversion = Conversion::of_text(Path::new("in.csv"), Cursor::new(text), mapping, &Settings::default());
    let mut conversion = conversion.map_err(|failure| failure.message)?;
    let samples = (&mut conversion).collect::<Result<Vec<_>, _>>().map_err(|failure| failure.message)?;
    let findings = conversion.findings().into_iter().map(|finding| finding.tagged(|line| line.to_string()));
    Ok((samples, findings.collect::<Vec<_>>().join("\n")))
}

/// The number before these words.
fn count(told: &str, words: &str) -> usize {
    let before = told.split(words).next().filter(|before| before.len() < told.len());
    let number = before.and_then(|before| before.trim_end().rsplit([' ', ';', ',']).next()?.parse().ok());
    number.unwrap_or(0)
}

#[test]
fn rows_have_their_true_times_or_are_left_out_and_counted() {
    let (mut bad_rows, mut right_rows, mut lost_right) = (0, 0, 0);
    for seed in 0..600 {
        let Series { times, rows, bad, period, copies } = series(&mut Random(seed));
        let (samples, told) = convert(&rows).unwrap_or_else(|message| panic!("{seed}: {message}"));
        let mut seen = vec![0; times.len()];
        for sample in &samples {
            let number = sample.accelerometers.positive_pulses[0] as usize;
            seen[number] += 1;
            let off = (sample.timestamp_ns as f64 - times[number] as f64).abs();
            assert!(off <= 0.5 * period, "{seed}: row {number} is off by {} periods\n{told}", off / period);
            if !bad.contains(&number) {
                assert_eq!(sample.timestamp_ns, times[number], "{seed}: the right row {number} was moved\n{told}");
            }
            assert_eq!(sample.session, 0, "{seed}\n{told}");
        }
        assert!(seen.iter().all(|seen| *seen <= 1), "{seed}: a row is there twice\n{told}");
        lost_right += (0..times.len()).filter(|number| seen[*number] == 0 && !bad.contains(number)).count();
        let twice = count(&told, &format!(" of {} rows repeat", rows.len()));
        let lost = count(&told, " row has a stamp") + count(&told, " rows have stamps");
        assert_eq!(twice, copies, "{seed}\n{told}");
        assert_eq!(samples.len() + twice + lost, rows.len(), "{seed}\n{told}");
        bad_rows += bad.len();
        right_rows += times.len() - bad.len();
    }
    let share = lost_right as f64 / right_rows as f64;
    println!("{bad_rows} bad rows; of {right_rows} right ones {lost_right} are left out, {:.4} %", share * 100.0);
    assert!(bad_rows > 4000 && share <= 0.02, "{bad_rows} {share}");
}

#[test]
fn any_stamps_are_converted_or_refused() {
    for seed in 0..300 {
        let random = &mut Random(seed);
        let (count, kind) = (random.below(600), random.below(6));
        let mut stamp = random.next() >> random.below(64);
        let rows: Vec<_> = (0..count)
            .map(|number| {
                stamp = match kind {
                    0 => random.next() >> random.below(64),
                    1 => random.next() % 50,
                    2 => stamp.wrapping_add(random.next() % 3),
                    3 => stamp.wrapping_sub(1_000_000),
                    4 => [0, u64::MAX, stamp, stamp.wrapping_add(5_000_000)][random.below(4)],
                    _ => stamp.wrapping_add(5_000_000) % (1 << (10 + seed % 50)),
                };
                (number, stamp)
            })
            .collect();
        let converted = convert(&rows);
        assert!(kind > 0 || count < 100 || converted.is_err(), "{seed}: stamps without any order");
        if let Ok((samples, _)) = converted {
            let rises = samples.windows(2).all(|pair| {
                let [earlier, later] = [pair[0], pair[1]].map(|sample| (sample.session, sample.timestamp_ns));
                earlier < later
            });
            assert!(rises && samples.len() <= rows.len(), "{seed}");
        }
    }
}
