//! The ramps of a campaign file: `[[ramp]]`, a recording each, made at rest while the temperature changes.

use crate::direction::direction;
use isotherm_shared::document::Section;
use isotherm_shared::wire::AXES;

/// One recording of raw samples: one stay of the IMU at rest, powered, that warms and cools.
#[derive(Clone, Debug, PartialEq)]
pub struct Ramp {
    /// Its file, relative to the campaign file.
    pub samples: String,
    /// Direction of the specific force along A1, A2, A3 during the stay, a unit vector, if it is stated.
    pub specific_force: Option<[f64; AXES]>,
}

impl Ramp {
    /// The `[[ramp]]` of a campaign file.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let force = self.specific_force.map_or_else(String::new, |[x, y, z]| {
            format!("specific_force = [{}, {}, {}]   # along A1, A2, A3, in local gravity\n", x + 0.0, y + 0.0, z + 0.0)
        });
        let samples = toml::Value::from(self.samples.as_str());
        format!("[[ramp]]\nsamples = {samples}\n{force}")
    }
}

/// Reads the ramps of a campaign file; `None` if one of them is wrong.
pub(crate) fn ramps(root: &Section<'_, '_>) -> Option<Vec<Ramp>> {
    let mut ramps: Vec<Ramp> = Vec::new();
    let mut complete = true;
    for section in root.list("ramp") {
        match ramp(&section) {
            Some(ramp) if ramps.iter().any(|other| other.samples == ramp.samples) => {
                let message = format!("{:?} is there twice; one recording is one [[ramp]]", ramp.samples);
                section.fault("samples", message);
            }
            Some(ramp) => ramps.push(ramp),
            None => complete = false,
        }
        section.finish();
    }
    complete.then_some(ramps)
}

fn ramp(section: &Section<'_, '_>) -> Option<Ramp> {
    const FILE: &str = "the recording of one stay that warms and cools, for example \"ramp-1.csv\"";
    let samples = section.string("samples", FILE);
    section.refuse("samples", samples.filter(|samples| samples.is_empty()).map(|_| format!("is empty, give {FILE}")));
    let specific_force = if section.has("specific_force") {
        Some(direction(section)?)
    } else {
        section.ignore("specific_force");
        None
    };
    Some(Ramp { samples: samples.filter(|samples| !samples.is_empty())?.to_owned(), specific_force })
}
