//! Two files, of accelerometers and of gyroscopes, that are named as pieces.

use super::input::Input;
use super::piece::{Piece, RowKind};
use isotherm_recording::{Progress, SequenceRule};
use isotherm_support::failure::{Exit, Failure, shown};
use isotherm_support::source::DataSource;
use std::path::Path;

/// In names of files of accelerometers.
const ACCELEROMETERS: [&str; 1] = ["acc"];
/// In names of files of gyroscopes.
const GYROSCOPES: [&str; 3] = ["gyr", "omega", "angular"];
/// Files that begin within this time of each other are of the same time \[ns\].
const SAME_TIME_NS: u64 = 10_000_000_000;

/// The files of an IMU's sensors.
pub(super) struct FilePair {
    pub(super) accelerometers: DataSource,
    gyroscopes: DataSource,
}

impl FilePair {
    pub(super) fn note(&self) -> String {
        let [accelerometers, gyroscopes] =
            [&self.accelerometers, &self.gyroscopes].map(|source| shown(source.name()).to_string());
        format!(
            "{accelerometers} has the accelerometers and {gyroscopes} the gyroscopes, by their names: they are joined by \
             time"
        )
    }

    /// How the file of the accelerometers is read.
    pub(super) fn input(self, mut input: Input) -> Input {
        if let Some(foreign) = &mut input.foreign {
            foreign.settings.gyroscope_file = Some(self.gyroscopes);
        }
        input
    }
}

/// The two files, if there are two texts whose names say so, and the first lacks the mapping's gyroscopes.
///
/// # Errors
/// If the mapping has no gyroscopes, and the file of the gyroscopes would be taken for one of accelerometers; if a file
/// of gyroscopes is given together with several files.
pub(super) fn find(sources: &[DataSource], kind: RowKind, input: &Input) -> Result<Option<FilePair>, Failure> {
    let Some(foreign) = input.foreign.as_ref().filter(|_| kind == RowKind::Sample) else { return Ok(None) };
    let usage = |message: String| Err(Failure::new(Exit::Usage, message));
    if foreign.settings.gyroscope_file.is_some() {
        return match sources {
            [_] => Ok(None),
            _ => {
                usage("--gyroscope-file goes with one file of accelerometers; convert each pair separately".to_owned())
            }
        };
    }
    let [one, other] = sources else { return Ok(None) };
    let (accelerometers, gyroscopes) = match (named(one.name(), other.name()), named(other.name(), one.name())) {
        (true, false) => (one, other),
        (false, true) => (other, one),
        _ => return Ok(None),
    };
    let open = |source: &DataSource| Piece::open(source, kind, input, &Progress::default(), None);
    match foreign.maps_gyroscopes() {
        Some(true) if open(accelerometers).is_err() => {
            Ok(Some(FilePair { accelerometers: accelerometers.clone(), gyroscopes: gyroscopes.clone() }))
        }
        Some(false) => {
            let begin = |source: &DataSource| {
                let row = open(source).ok()?.next(SequenceRule::default()).ok()??;
                Some(row.sample.timestamp_ns)
            };
            // A file of gyroscopes may lack the temperature of the mapping.
            let is_same_time = |a: u64| begin(gyroscopes).is_none_or(|b| a.abs_diff(b) <= SAME_TIME_NS);
            if !gyroscopes.is_file() || !begin(accelerometers).is_some_and(is_same_time) {
                return Ok(None);
            }
            let [accelerometers, gyroscopes] =
                [accelerometers, gyroscopes].map(|source| shown(source.name()).to_string());
            usage(format!(
                "{gyroscopes} has the gyroscopes of {accelerometers}, by its name, and the mapping has \
                 none: give [gyroscope] with its columns, or name only one of the files"
            ))
        }
        // A layout of accelerometers is recognised, and the same of gyroscopes is refused.
        None if foreign.named().is_none() => {
            let is_layout = open(accelerometers).is_ok_and(|piece| piece.source.conversion().is_some());
            let pair = || FilePair { accelerometers: accelerometers.clone(), gyroscopes: gyroscopes.clone() };
            Ok((is_layout && open(gyroscopes).is_err()).then(pair))
        }
        _ => Ok(None),
    }
}

/// Whether the first path is named after accelerometers, and the other one after gyroscopes.
fn named(accelerometers: &Path, gyroscopes: &Path) -> bool {
    let says = |path: &Path, words: &[&str]| {
        let name = path.file_name().map(|name| name.to_string_lossy().to_lowercase()).unwrap_or_default();
        words.iter().any(|word| name.contains(word))
    };
    let is = |path: &Path, words: &[&str], others: &[&str]| says(path, words) && !says(path, others);
    is(accelerometers, &ACCELEROMETERS, &GYROSCOPES) && is(gyroscopes, &GYROSCOPES, &ACCELEROMETERS)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_tell_the_sensors() {
        for (a, g) in [
            ("acc.mat", "gyr.mat"),
            ("log_sensor_accel_0.csv", "log_sensor_gyro_0.csv"),
            ("Accelerometer.csv", "Gyroscope.csv"),
            ("run/accelerations.txt", "run/omega.txt"),
            ("linear_acceleration.csv", "angular_velocity.csv"),
        ] {
            assert!(named(Path::new(a), Path::new(g)) && !named(Path::new(g), Path::new(a)), "{a} {g}");
        }
        for (a, g) in
            [("a.csv", "g.csv"), ("acc_1.csv", "acc_2.csv"), ("acc_gyr.csv", "gyr.csv"), ("gyro/acc.csv", "b")]
        {
            assert!(!named(Path::new(a), Path::new(g)), "{a} {g}");
        }
    }
}
