//! `explain`: meaning and remedy of the names that the programs print. Each text is next to its name, in the crate that
//! gives it.

use clap::Args;
use isotherm_files::print;
use isotherm_shared::status;
use isotherm_shared::wire::Flags;
use isotherm_support::failure::{EXIT_CODES, Exit, Failure};
use std::fmt::Write as _;

/// Columns of the text.
const WIDTH: usize = 100;
/// Columns of a line of the list.
const LINE: usize = 120;
/// This many similar names are printed for an unknown one.
const NEAR: usize = 6;

/// One name with its explanation.
#[derive(Clone, Debug)]
pub struct Topic {
    /// What has this name, as `flag`.
    pub kind: &'static str,
    /// The name.
    pub name: String,
    /// What else is to be known in a few words, such as a metric's type; may be empty.
    pub note: String,
    /// What it means, in sentences.
    pub meaning: String,
    /// What to do; may be empty.
    pub remedy: String,
}

impl Topic {
    /// A topic of texts that come from documentation: brackets there are escaped or links.
    #[must_use]
    pub fn new(kind: &'static str, name: impl Into<String>, note: String, meaning: &str, remedy: &str) -> Self {
        let meaning = meaning.replace("[`", "`").replace("`]", "`").replace('\\', "");
        Self { kind, name: name.into(), note, meaning: meaning.trim().to_owned(), remedy: remedy.to_owned() }
    }

    /// Whether this is what `query` asks for: the name in any case, the end of a field's path, or a series of a metric.
    fn is_called(&self, query: &str) -> bool {
        let query = query.split('{').next().unwrap_or_default();
        let series = ["_bucket", "_sum", "_count"].iter().find_map(|suffix| query.strip_suffix(suffix));
        let last = self.name.rsplit('.').next().unwrap_or_default();
        self.name.eq_ignore_ascii_case(query)
            || last.eq_ignore_ascii_case(query)
            || self.kind == "metric" && series.is_some_and(|query| self.name == query)
    }
}

/// What the service gives: flags, fields of the status and exit codes.
#[must_use]
pub fn topics() -> Vec<Topic> {
    let masks = [
        (Flags::INVALID, "a value is NaN: use the others"),
        (Flags::DEGRADED, "use what is finite, with less trust"),
        (Flags::LOST, "time is missing before it, or may be"),
        (Flags::INFORMATION, "nothing to do"),
    ];
    let names = ["INVALID", "DEGRADED", "LOST", "INFORMATION"];
    let flags = Flags::NAMES.into_iter().filter_map(|(bit, name)| {
        let [meaning, remedy] = Flags::text(bit)?;
        let mask = masks.iter().zip(names).find(|((mask, _), _)| mask.intersects(Flags(1 << bit)));
        let mask = mask.map(|((_, says), name)| format!(", mask {name}: {says}")).unwrap_or_default();
        Some(Topic::new("flag", name, format!("bit {bit}{mask}"), meaning, remedy))
    });
    let fields = status::fields().into_iter();
    let fields = fields.map(|(path, meaning)| Topic::new("status field", path, String::new(), meaning, ""));
    let codes = EXIT_CODES
        .iter()
        .map(|code| Topic::new("exit code", code.number.to_string(), code.short.to_owned(), code.meaning, code.remedy));
    flags.chain(fields).chain(codes).collect()
}

/// Explain a name that the programs print
///
/// Explains a flag, a field of the status or an exit code.
///
/// Without a name, all names are listed.
#[derive(Debug, Args)]
#[command(after_help = "Examples:\n  isotherm explain\n  isotherm explain late\n  isotherm explain 78")]
pub struct Explain {
    /// Explain this name, as it is printed
    name: Vec<String>,
}

impl Explain {
    /// Prints what the words name; without a word the list of all `topics`. Names may also stand between brackets, or
    /// be joined by `|` as flags are.
    ///
    /// # Errors
    /// If nothing has the name: exit code 64, and the message lists similar ones.
    pub fn run(self, topics: &[Topic]) -> Result<(), Failure> {
        let words = self.name;
        if words.is_empty() {
            return print(&list(topics));
        }
        let words = words.join(" ");
        let mut text = String::new();
        for query in words.split('|').map(|word| word.trim_matches(['[', ']', '`', ' '])) {
            let found: Vec<_> = topics.iter().filter(|topic| topic.is_called(query)).collect();
            if found.is_empty() {
                return Err(unknown(topics, query));
            }
            for topic in found {
                let note = if topic.note.is_empty() { String::new() } else { format!(" ({})", topic.note) };
                let gap = if text.is_empty() { "" } else { "\n" };
                let _ = writeln!(text, "{gap}{} {}{note}", topic.kind, topic.name);
                text.push_str(&wrap(&topic.meaning, WIDTH, "  ", "  "));
                if !topic.remedy.is_empty() {
                    text.push_str(&wrap(&topic.remedy, WIDTH, "  Remedy: ", "  "));
                }
            }
        }
        print(&text)
    }
}

/// All names by kind, each with its first sentence.
fn list(topics: &[Topic]) -> String {
    let mut text = String::new();
    let mut kind = "";
    for topic in topics {
        if topic.kind != kind {
            let gap = if text.is_empty() { "" } else { "\n" };
            let _ = writeln!(text, "{gap}{}", topic.kind.to_uppercase());
            kind = topic.kind;
        }
        let names = topics.iter().filter(|other| other.kind == kind).map(|other| other.name.len());
        let width = names.max().unwrap_or(0);
        let sentence = topic.meaning.split_inclusive(". ").next().unwrap_or_default().trim();
        let line = format!("  {:width$}  {sentence}", topic.name);
        let short: String = line.chars().take(LINE - 3).collect();
        let _ = if line.chars().count() > LINE { writeln!(text, "{short} ..") } else { writeln!(text, "{line}") };
    }
    text
}

fn unknown(topics: &[Topic], query: &str) -> Failure {
    let query = query.to_lowercase();
    let last = |topic: &Topic| topic.name.rsplit('.').next().unwrap_or_default().to_lowercase();
    let rank = |topic: &Topic| {
        let name = last(topic);
        let related = query.len() > 1 && (name.contains(&query) || query.contains(&name) && name.len() > 3);
        if related { 0 } else { distance(&name, &query) }
    };
    let mut near: Vec<_> = topics.iter().map(|topic| (rank(topic), &topic.name)).collect();
    near.retain(|(rank, _)| *rank <= query.len().div_ceil(3));
    near.sort_by_key(|(rank, _)| *rank);
    near.dedup_by_key(|(_, name)| *name);
    let near: Vec<_> = near.into_iter().take(NEAR).map(|(_, name)| name.as_str()).collect();
    let near = if near.is_empty() { String::new() } else { format!("near it are {}; ", near.join(", ")) };
    Failure::new(Exit::Usage, format!("nothing is called {query:?}; {near}`explain` without a name lists all"))
}

/// Least number of letters that are inserted, left out or replaced to come from one word to the other.
fn distance(one: &str, other: &str) -> usize {
    let other: Vec<_> = other.chars().collect();
    let mut row: Vec<_> = (0..=other.len()).collect();
    for (index, letter) in one.chars().enumerate() {
        let mut diagonal = index;
        row[0] = index + 1;
        for (column, wanted) in other.iter().enumerate() {
            let replaced = diagonal + usize::from(letter != *wanted);
            diagonal = row[column + 1];
            row[column + 1] = replaced.min(row[column] + 1).min(diagonal + 1);
        }
    }
    row[other.len()]
}

/// The text in lines of at most `width` columns. `first` begins the first line, `others` the others.
#[must_use]
pub fn wrap(text: &str, width: usize, first: &str, others: &str) -> String {
    let (mut lines, mut line) = (String::new(), first.to_owned());
    let mut empty = true;
    for word in text.split_whitespace() {
        if !empty && line.chars().count() + 1 + word.chars().count() > width {
            let _ = writeln!(lines, "{line}");
            others.clone_into(&mut line);
            empty = true;
        }
        let gap = if empty { "" } else { " " };
        let _ = write!(line, "{gap}{word}");
        empty = false;
    }
    let _ = writeln!(lines, "{line}");
    lines
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_are_found_as_they_are_printed() {
        let metric = |name| Topic::new("metric", name, String::new(), "What it is.", "");
        let of_exporter = ["isotherm_latency_seconds", "isotherm_flagged_total"].map(metric);
        let topics: Vec<_> = topics().into_iter().chain(of_exporter).collect();
        let kinds = |query: &str| {
            let found = topics.iter().filter(|topic| topic.is_called(query));
            found.map(|topic| topic.kind).collect::<Vec<_>>()
        };
        assert_eq!(kinds("LATE"), ["flag"]);
        assert_eq!(kinds("78"), ["exit code"]);
        assert_eq!(kinds("held_back_ms"), ["status field"]);
        assert_eq!(kinds("imus[].missing"), ["status field"]);
        assert_eq!(kinds("isotherm_latency_seconds_bucket"), ["metric"]);
        assert_eq!(kinds("isotherm_flagged_total{flag=\"late\"}"), ["metric"]);
        assert!(kinds("unheard-of").is_empty());
        for topic in &topics {
            assert!(topic.meaning.ends_with('.') && !topic.meaning.contains("\\["), "{topic:?}");
        }
    }

    #[test]
    fn an_unknown_name_tells_the_nearest() {
        let message = unknown(&topics(), "a2-hed-below").message;
        assert!(message.contains("near it are a2-head-below"), "{message}");
        assert!(unknown(&topics(), "telemetry-stalee").message.contains("telemetry-stale"));
        assert!(!unknown(&topics(), "xyzxyzxyz").message.contains("near it"));
        assert_eq!((distance("gap", "gap"), distance("gap", "tap"), distance("late", "plates")), (0, 1, 2));
    }

    #[test]
    fn lines_end_between_words() {
        assert_eq!(wrap("one two three", 9, "- ", "  "), "- one two\n  three\n");
    }
}
