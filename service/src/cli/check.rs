use super::written;
#[cfg(feature = "campaign")]
use crate::campaign::plan::Plan;
use crate::config::Config;
use crate::failure::{Exit, Failure};
use crate::files::{Guard, Output, TableFileError, load_table, read_text};
use clap::Args;
#[cfg(feature = "tools")]
use isotherm_calibration::{calibrate::observable, campaign::Campaign};
use isotherm_shared::document::{Document, Fault, Faults, MAX_BYTES};
use isotherm_shared::table::{CoefficientTable, Seal};
use std::io::{self, Read as _, Write as _};
use std::path::{Path, PathBuf};

/// Validate coefficient tables, service configurations, campaign files and plans with the code that loads them
///
/// What a file is, its content tells. All faults of all files are reported, each with line and key.
#[derive(Debug, Args)]
#[command(
    after_help = "Examples:\n  isotherm check service.toml tables/*.toml\n  isotherm check --seal tables/imu-a.toml"
)]
pub struct Check {
    /// Write a table's digest into it, so that a later change or a half-written copy is noticed
    #[arg(long)]
    seal: bool,
    /// Take files that everybody may write; without this they are refused, as by the service
    #[arg(long)]
    allow_world_writable: bool,
    /// Tables, configurations, campaign files and plans; - is stdin
    #[arg(required = true, value_name = "FILE")]
    files: Vec<PathBuf>,
}

/// What kinds of files there are.
enum Kind {
    Table,
    Config,
    Campaign,
    #[cfg(feature = "campaign")]
    Plan,
}

impl Check {
    pub fn run(self) -> Result<(), Failure> {
        let mut failures = Vec::new();
        for path in &self.files {
            match check(path, self.seal, Guard::allowing(self.allow_world_writable)) {
                Ok(line) => written(None, writeln!(io::stdout(), "{}: {line}", path.display()))?,
                Err(failure) => failures.push(failure),
            }
        }
        // A wrong file weighs more than one that could not be read.
        let worst = failures.iter().map(|failure| failure.exit).max_by_key(|exit| *exit as u8);
        let messages: Vec<_> = failures.into_iter().map(|failure| failure.message).collect();
        worst.map_or(Ok(()), |exit| Err(Failure::new(exit, messages.join("\n"))))
    }
}

fn check(path: &Path, seal: bool, guard: Guard) -> Result<String, Failure> {
    let text = if path == Path::new("-") { read_stdin()? } else { read_text(path, guard)?.0 };
    let refuse = |faults| Failure::from(TableFileError::Refused { path: path.to_owned(), faults });
    match kind(&text).map_err(refuse)? {
        Kind::Table if seal && path == Path::new("-") => {
            Err(Failure::new(Exit::Usage, "only a file can be sealed; name it instead of -"))
        }
        Kind::Table => {
            let policy = if seal { Seal::Renewed } else { Seal::Checked };
            let table = CoefficientTable::from_toml_with(&text, None, policy).map_err(refuse)?;
            let sealed = if seal {
                write_digest(path, &text, &table)?;
                "sealed"
            } else if Document::parse(&text).is_ok_and(|document| document.has("digest")) {
                "seal intact"
            } else {
                "not sealed"
            };
            Ok(format!("table of {}, {}, {sealed}", table.content().imu, table.digest()))
        }
        Kind::Config if seal => Err(Failure::new(
            Exit::Config,
            format!("{}: a service configuration; only tables are sealed", path.display()),
        )),
        #[cfg(feature = "campaign")]
        Kind::Plan if seal => {
            Err(Failure::new(Exit::Config, format!("{}: a campaign plan; only tables are sealed", path.display())))
        }
        Kind::Campaign if seal => {
            Err(Failure::new(Exit::Config, format!("{}: a campaign; only tables are sealed", path.display())))
        }
        #[cfg(feature = "campaign")]
        Kind::Plan => {
            let plan = Plan::from_toml(&text, path.parent().unwrap_or(Path::new(""))).map_err(refuse)?;
            let (set_points, positions) = (plan.set_points_c.len(), plan.positions.len());
            Ok(format!("campaign plan of {}, {set_points} set points x {positions} positions", plan.imu))
        }
        #[cfg(feature = "tools")]
        Kind::Campaign => {
            let campaign = Campaign::from_toml(&text).map_err(refuse)?;
            let observable = observable(&campaign);
            observable.map_err(|error| Failure::new(Exit::Config, format!("{}: {error}", path.display())))?;
            Ok(format!("campaign of {}, {} positions that observe everything", campaign.imu, campaign.positions.len()))
        }
        #[cfg(not(feature = "tools"))]
        Kind::Campaign => {
            let message = "a campaign; this program is built without what reads one (feature \"tools\")";
            Err(Failure::new(Exit::Usage, format!("{}: {message}", path.display())))
        }
        Kind::Config => {
            let config = Config::from_toml(&text, path.parent().unwrap_or(Path::new(""))).map_err(refuse)?;
            let mut failures = Vec::new();
            for imu in &config.imus {
                if let Err(error) = load_table(&imu.table, Some(&imu.id), guard) {
                    failures.push(Failure::from(error));
                }
            }
            let Some(worst) = failures.iter().map(|failure| failure.exit).max_by_key(|exit| *exit as u8) else {
                return Ok(format!("service configuration of {} IMUs, their tables valid", config.imus.len()));
            };
            let messages: Vec<_> = failures.into_iter().map(|failure| failure.message).collect();
            Err(Failure::new(worst, messages.join("\n")))
        }
    }
}

fn read_stdin() -> Result<String, Failure> {
    let mut text = String::new();
    let read = io::stdin().take(MAX_BYTES + 1).read_to_string(&mut text);
    read.map_err(|error| Failure::io("reading", Path::new("stdin"), &error))?;
    if text.len() as u64 > MAX_BYTES {
        return Err(Failure::new(
            Exit::Config,
            format!("stdin: over {MAX_BYTES} bytes; no table or configuration is that large"),
        ));
    }
    Ok(text)
}

/// A table has `[[axis]]` and `[imu]`, a configuration `[[imu]]`, a campaign `[[position]]`, a campaign's plan `[chamber]`.
fn kind(text: &str) -> Result<Kind, Faults> {
    let document = Document::parse(text)?;
    let has = |keys: &[&str]| keys.iter().any(|key| document.has(key));
    #[cfg(feature = "campaign")]
    if Plan::is_meant(&document) {
        return Ok(Kind::Plan);
    }
    if has(&["position", "samples", "gravity_reference"]) {
        Ok(Kind::Campaign)
    } else if document.is_list("imu") || has(&["wait", "latency", "realtime", "metrics"]) {
        Ok(Kind::Config)
    } else if has(&["axis", "imu", "temperature", "alignment", "format", "digest"]) {
        Ok(Kind::Table)
    } else {
        let message = "neither a coefficient table, which has [[axis]], nor a service configuration, which has [[imu]], nor a \
                       campaign, which has [[position]], nor a campaign plan, which has [chamber]";
        Err(Faults(vec![Fault { line: 1, key: String::new(), message: message.to_owned() }]))
    }
}

/// Sets `digest` and leaves every other byte as the user wrote it.
fn write_digest(path: &Path, text: &str, table: &CoefficientTable) -> Result<(), Failure> {
    let sealed = with_digest(text, &format!("\"{}\"", table.digest()));
    // Read back before anything is replaced: the result must be the same table, with a seal that holds.
    let sealed = sealed.filter(|sealed| CoefficientTable::from_toml(sealed, None).as_ref() == Ok(table));
    let sealed = sealed.ok_or_else(|| {
        let message = format!(
            "{}: cannot be sealed as it is laid out; put digest = {:?} below format by hand",
            path.display(),
            table.digest().to_string()
        );
        Failure::new(Exit::Failed, message)
    })?;
    let failed = |error: io::Error| Failure::io("writing", path, &error);
    let mut output = Output::create(Some(path)).map_err(failed)?;
    output.write_all(sealed.as_bytes()).and_then(|()| output.finish()).map_err(failed)
}

/// The text with another digest, or with one in a line of its own below `format`.
fn with_digest(text: &str, digest: &str) -> Option<String> {
    let document = Document::parse(text).ok()?;
    if let Some(span) = document.span("digest") {
        return Some(format!("{}{digest}{}", text.get(..span.start)?, text.get(span.end..)?));
    }
    let format = document.span("format")?;
    let end = format.end + text.get(format.end..)?.find('\n').map_or(text.len() - format.end, |newline| newline + 1);
    let (above, below) = text.split_at_checked(end)?;
    let newline = if above.ends_with("\r\n") { "\r\n" } else { "\n" };
    let gap = if above.ends_with('\n') { "" } else { newline };
    Some(format!("{above}{gap}digest = {digest}{newline}{below}"))
}

#[cfg(test)]
mod tests {
    use super::with_digest;

    #[test]
    fn the_digest_is_set_and_nothing_else_touched() {
        for (before, after) in [
            ("# c\nformat = 1 # f\n\n[imu]\n", "# c\nformat = 1 # f\ndigest = NEW\n\n[imu]\n"),
            ("format = 1\r\n[imu]\r\n", "format = 1\r\ndigest = NEW\r\n[imu]\r\n"),
            ("# above\n\n\"digest\" = \"x\"   # why\nformat = 1", "# above\n\n\"digest\" = NEW   # why\nformat = 1"),
            ("digest = 5\nformat = 1\n", "digest = NEW\nformat = 1\n"),
            ("format = 1", "format = 1\ndigest = NEW\n"),
        ] {
            assert_eq!(with_digest(before, "NEW").as_deref(), Some(after));
        }
    }
}
