//! How the samples of a campaign are laid out: rows with set point and position, a file for each position at each set
//! point, or a sheet of means.
//!
//! ```toml
//! [samples]
//! files = "T{set_point_c}_P{position}.csv"   # or means = "means.csv"
//! ```
//!
//! What the columns of such files are is stated separately, in the keys of a mapping; who opens the files reads them.

use isotherm_shared::document::Section;

/// Stands for the IMU's name in the names of a batch's files.
pub const IMU: &str = "{imu}";
/// Stands for the set point in the name of a file.
pub const SET_POINT: &str = "{set_point_c}";
/// Stands for the number of the position in the name of a file.
pub const POSITION: &str = "{position}";
/// The keys of `[samples]` that say what the columns are.
const COLUMNS: [&str; 7] = ["decimal", "header", "skip", "time", "accelerometer", "gyroscope", "temperature"];

/// How the samples of a campaign are laid out.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum SampleLayout {
    /// Rows with set point and position.
    #[default]
    Rows,
    /// A file for each position at each set point.
    ByPosition {
        /// Whether the numbers are rates over a gate: what passes between two rows need not be counted.
        rates: bool,
    },
    /// A sheet with one mean for each position at each set point.
    Means,
}

/// A name of files with a set point and a position in it.
///
/// ```
/// use isotherm_campaign::FilePattern;
///
/// let pattern = FilePattern::new("T{set_point_c}/P{position}.csv").expect("a pattern");
/// assert_eq!(pattern.read("T-20/P03.csv"), Some((-20.0, 3)));
/// assert_eq!(pattern.read("T+22,5/P12.csv"), Some((22.5, 12)));
/// assert_eq!(pattern.read("T20/P3 (copy).csv"), None);
/// assert!(FilePattern::new("T{set_point_c}.csv").is_err());
/// ```
#[derive(Clone, Debug, Eq, PartialEq)]
pub struct FilePattern {
    text: String,
    /// What stands before, between and behind the two numbers.
    parts: [String; 3],
    /// Whether the position comes first.
    position_first: bool,
}

impl FilePattern {
    /// Reads a pattern.
    ///
    /// # Errors
    /// What is wrong with it, and what would be right.
    pub fn new(text: &str) -> Result<Self, String> {
        let example = "for example \"T{set_point_c}_P{position}.csv\"";
        for place in [SET_POINT, POSITION] {
            match text.matches(place).count() {
                1 => {}
                0 => return Err(format!("has no {place}; give a name of all files, {example}")),
                _ => return Err(format!("has {place} more than once; give it once, {example}")),
            }
        }
        let [set_point, position] = [SET_POINT, POSITION].map(|place| text.find(place).unwrap_or_default());
        let position_first = position < set_point;
        let [first, second] = if position_first {
            [(position, POSITION), (set_point, SET_POINT)]
        } else {
            [(set_point, SET_POINT), (position, POSITION)]
        };
        let between = &text[first.0 + first.1.len()..second.0];
        if between.is_empty() {
            return Err(format!(
                "has both numbers side by side, which no name distinguishes; give a letter between them, {example}"
            ));
        }
        let parts = [&text[..first.0], between, &text[second.0 + second.1.len()..]].map(str::to_owned);
        if let Some(part) = parts.iter().find(|part| part.contains(['{', '}'])) {
            return Err(format!(
                "has {part:?}, whose braces are none of {SET_POINT}, {POSITION} and {{imu}}; leave them out"
            ));
        }
        Ok(Self { text: text.to_owned(), parts, position_first })
    }

    /// Set point \[degC\] and position of the file of this name; `None` if it is none of the files. Folders in the name
    /// end in `/`. Signs, zeros in front, decimal points and commas are read.
    #[must_use]
    pub fn read(&self, name: &str) -> Option<(f64, u32)> {
        let [before, between, behind] = &self.parts;
        let numbers = name.strip_prefix(before.as_str())?.strip_suffix(behind.as_str())?;
        // A comma or a point between the numbers may also be the decimal mark of one: the last that fits is taken.
        numbers.rmatch_indices(between.as_str()).find_map(|(at, _)| {
            let (first, second) = (&numbers[..at], &numbers[at + between.len()..]);
            let (set_point, position) = if self.position_first { (second, first) } else { (first, second) };
            Some((set_point_c(set_point)?, whole(position)?))
        })
    }

    /// The name of the file of a set point and a position, without zeros in front.
    #[must_use]
    pub fn name(&self, set_point_c: f64, position: u32) -> String {
        self.text.replace(SET_POINT, &set_point_c.to_string()).replace(POSITION, &position.to_string())
    }

    /// The folder that all files are in, and how many folders deep below it they are.
    #[must_use]
    pub fn folder(&self) -> (&str, usize) {
        let folder = self.parts[0].rfind('/').map_or("", |end| &self.parts[0][..=end]);
        (folder, self.text.matches('/').count() - folder.matches('/').count())
    }
}

/// A set point \[degC\] in a name.
fn set_point_c(text: &str) -> Option<f64> {
    let text = text.replace('\u{2212}', "-").replace(',', ".");
    let digits = text.strip_prefix(['+', '-']).unwrap_or(&text);
    let is_plain = digits.bytes().all(|byte| byte.is_ascii_digit() || byte == b'.');
    let ends_are_digits = [digits.bytes().next(), digits.bytes().next_back()]
        .into_iter()
        .all(|byte| byte.is_some_and(|byte| byte.is_ascii_digit()));
    // Adding 0 turns -0 into 0.
    text.parse::<f64>().ok().filter(|value| is_plain && ends_are_digits && value.is_finite()).map(|value| value + 0.0)
}

/// A position in a name.
fn whole(text: &str) -> Option<u32> {
    text.bytes().all(|byte| byte.is_ascii_digit()).then(|| text.parse().ok())?
}

/// Files and layout of `samples`; `None` if something is wrong.
pub(crate) fn samples(root: &Section<'_, '_>, gravity_only: bool) -> Option<(Vec<String>, SampleLayout)> {
    const KEY: &str = "samples";
    if root.unchecked(KEY).is_none() {
        let files = root.strings(
            KEY,
            "the file of the samples, for example \"samples.csv\", or a list of files, or a section [samples]",
        )?;
        return Some((files.into_iter().map(str::to_owned).collect(), SampleLayout::Rows));
    }
    let section = root.optional_section(KEY)?;
    COLUMNS.into_iter().chain(["set_point_c", "position"]).for_each(|key| section.ignore(key));
    let found = layout(&section);
    if gravity_only {
        root.fault(KEY, "a section is for positions, and this method has none; give the recordings, samples = [..]");
    }
    section.finish();
    found.filter(|_| !gravity_only)
}

fn layout(section: &Section<'_, '_>) -> Option<(Vec<String>, SampleLayout)> {
    section.ignore("files");
    section.ignore("means");
    if section.has("files") == section.has("means") {
        let message = "give either files, a name with {set_point_c} and {position} in it, or means, a sheet of means";
        section.fault("", message);
        return None;
    }
    if section.has("means") {
        let sheet = section.string("means", "the sheet of the means, for example \"means.csv\"")?;
        for key in ["set_point_c", "position", "accelerometer"].into_iter().filter(|key| !section.has(key)) {
            section.fault(
                key,
                match key {
                    "accelerometer" => {
                        "missing; give a section [samples.accelerometer] with the columns of the means".to_owned()
                    }
                    _ => format!("missing; give the column of the sheet, for example {key} = \"{key}\""),
                },
            );
        }
        return Some((vec![sheet.to_owned()], SampleLayout::Means));
    }
    section.forbid(
        &["set_point_c", "position"],
        "is a column of means, and here the names of the files say it; leave it out",
    );
    let patterns = section.strings("files", "a name of all files, for example \"T{set_point_c}_P{position}.csv\"")?;
    let wrong = patterns.iter().find_map(|pattern| {
        // The name of an IMU may be anything.
        let fault = FilePattern::new(&pattern.replace(IMU, "imu")).err()?;
        Some(format!("{pattern:?} {fault}"))
    });
    let is_right = wrong.is_none();
    section.refuse("files", wrong);
    let rates = section.unchecked("accelerometer").is_some_and(|section| section.is_text("kind", "rate"));
    let patterns = patterns.into_iter().map(str::to_owned).collect();
    is_right.then_some((patterns, SampleLayout::ByPosition { rates }))
}

#[cfg(test)]
mod tests {
    use super::FilePattern;

    #[test]
    fn numbers_in_names_are_read_in_all_their_spellings() {
        let pattern = |text: &str| FilePattern::new(text).unwrap();
        let usual = pattern("T{set_point_c}_P{position}.csv");
        for (name, found) in [
            ("T-20_P03.csv", Some((-20.0, 3))),
            ("T\u{2212}20_P003.csv", Some((-20.0, 3))),
            ("T+05_P0.csv", Some((5.0, 0))),
            ("T22.5_P12.csv", Some((22.5, 12))),
            ("T22,5_P12.csv", Some((22.5, 12))),
            ("T-0_P1.csv", Some((0.0, 1))),
            ("T_P1.csv", None),
            ("T20_P.csv", None),
            ("T20_P1.5.csv", None),
            ("T20_P-1.csv", None),
            ("T20_P1.txt", None),
            ("xT20_P1.csv", None),
            ("T2e1_P1.csv", None),
            ("Tinf_P1.csv", None),
            ("T20._P1.csv", None),
            ("T20_P99999999999.csv", None),
        ] {
            assert_eq!(usual.read(name), found, "{name}");
        }
        assert!(usual.read("T-0_P1.csv").unwrap().0.is_sign_positive());
        assert_eq!(pattern("{position}-{set_point_c}").read("3--20"), Some((-20.0, 3)));
        assert_eq!(pattern("{set_point_c}.{position}").read("20.5.3"), Some((20.5, 3)));
        assert_eq!(pattern("a/b{set_point_c}/c/{position}/x").folder(), ("a/", 3));
        assert_eq!(usual.folder(), ("", 0));
        assert_eq!(usual.name(-22.5, 3), "T-22.5_P3.csv");
    }

    #[test]
    fn a_pattern_that_tells_no_files_apart_is_refused() {
        let refused = |text: &str| FilePattern::new(text).unwrap_err();
        assert!(refused("T{set_point_c}.csv").starts_with("has no {position}"));
        assert!(refused("P{position}.csv").starts_with("has no {set_point_c}"));
        assert!(refused("{set_point_c}{position}").contains("side by side"));
        assert!(refused("{position}_{position}_{set_point_c}").contains("more than once"));
        assert!(refused("{set_point_c}_{position}_{run}").contains("braces"));
    }
}
