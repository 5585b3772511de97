//! How a program of Isotherm fails: its exit code, and a message with phase, cause and remedy.
//!
//! Each crate converts its own errors into a [`Failure`] where it declares them, so that an error has the same exit
//! code in every program.
//!
//! ```
//! use isotherm_support::failure::{Exit, Failure};
//!
//! let failure = Failure::new(Exit::Config, "imu.toml:4: imu.gravity: is 98.015, give 9.7 to 9.9 m/s2");
//! assert_eq!(failure.exit as u8, 78);
//! assert_eq!(failure.to_string(), "imu.toml:4: imu.gravity: is 98.015, give 9.7 to 9.9 m/s2");
//! ```

mod printable;

pub use printable::{one_line, printable, quoted, quoted_path, shown, tell, tell_as_events, tell_plainly};

use std::io;
use std::path::{Path, PathBuf};

/// An exit code of the programs, for `--help` and `explain`.
#[derive(Clone, Copy, Debug)]
pub struct ExitCode {
    /// The code.
    pub number: u8,
    /// The meaning in a few words.
    pub short: &'static str,
    /// The meaning.
    pub meaning: &'static str,
    /// What to do.
    pub remedy: &'static str,
}

/// Declares the exit codes; the documentation of each is its meaning in [`EXIT_CODES`], too.
macro_rules! exit_codes {
    ($($(#[doc = $meaning:literal])+ $name:ident = $number:literal, $short:literal, $remedy:literal;)+) => {
        /// Exit codes of failures; those from 64 on are as in sysexits.h.
        #[derive(Clone, Copy, Debug, Eq, PartialEq)]
        pub enum Exit {
            $($(#[doc = $meaning])+ $name = $number,)+
        }

        /// Every exit code of every program.
        pub const EXIT_CODES: &[ExitCode] = &[
            ExitCode {
                number: 0,
                short: "done",
                meaning: "Done. Data are on stdout or in the file that was named, messages on stderr.",
                remedy: "",
            },
            $(ExitCode { number: $number, short: $short, meaning: concat!($($meaning),+), remedy: $remedy },)+
        ];
    };
}

exit_codes! {
    /// The command failed for another reason: another service or acquisition is running, a verdict is negative, or the
    /// command was interrupted.
    Failed = 1, "failed", "The message on stderr has cause and remedy.";
    /// The command line is wrong.
    Usage = 64, "usage", "`--help` of the command shows its options, with examples.";
    /// A recording or samples are wrong.
    Data = 65, "bad recording or samples",
        "The message has the line, or the name of the finding: `isotherm explain NAME`.";
    /// There is no service, stream or instrument.
    Unavailable = 69, "no service, stream or instrument",
        "`isotherm status` shows a domain's service; programs that work together have the same `--domain` and \
         `ISOTHERM_ROOT`.";
    /// A file, shared memory or a port cannot be opened, read or written.
    Io = 74, "a file cannot be read or written",
        "The message names what is needed: space, a permission, another path. `isotherm clean` removes the remains \
         of a domain.";
    /// Not finished in time: the service has not judged a table, another installation goes on, or what comes over a
    /// network is not as described. The next attempt may succeed.
    Temporary = 75, "not finished in time; run the same command again",
        "Run the same command again. The message has what is waited for; of a network, it has what came and what is \
         described. The units of systemd try again by themselves.";
    /// The domain belongs to another user, or other users can replace it.
    OtherUser = 77, "the domain is another user's",
        "Run as the service's user, or use a domain of your own: another `--domain`, or a folder in `ISOTHERM_ROOT`.";
    /// A configuration, table, campaign file or plan is wrong; a table changes too much, or a setting is not permitted.
    Config = 78, "bad configuration, table, campaign file or plan", "`isotherm check FILE` names all faults.";
}

/// Why a command failed: the message for the operator and the exit code.
#[derive(Debug, thiserror::Error)]
#[error("{message}")]
pub struct Failure {
    /// Exit code of the process.
    pub exit: Exit,
    /// Phase, cause and remedy; may have several lines.
    pub message: String,
    /// File, and line or row in it, of the cause, if it is in one; the message names them too.
    pub place: Option<(PathBuf, Option<u64>)>,
}

impl Failure {
    /// A failure with this exit code and message, as [`printable`] text.
    pub fn new(exit: Exit, message: impl Into<String>) -> Self {
        let message = message.into();
        Self { exit, message: printable(&message).into_owned(), place: None }
    }

    /// The failure with the file, and the line or row in it, of its cause.
    #[must_use]
    pub fn at(self, file: &Path, line: Option<u64>) -> Self {
        Self { place: Some((file.to_owned(), line)), ..self }
    }

    /// A file that could not be read or written; `phase` says what was being done, as in "writing".
    #[must_use]
    pub fn io(phase: &str, path: &Path, error: &io::Error) -> Self {
        let folder = path.parent().filter(|folder| error.kind() == io::ErrorKind::NotFound && is_absent(folder));
        let name = shown(path);
        let message = match folder {
            Some(folder) => {
                format!("{phase} {name}: there is no folder {}; make it, or name another", shown(folder))
            }
            None => format!("{phase} {name}: {error}"),
        };
        Self::new(Exit::Io, message).at(path, None)
    }

    /// Joins failures into one, with all messages and the highest exit code; `None` if there are none.
    ///
    /// ```
    /// use isotherm_support::failure::{Exit, Failure};
    ///
    /// let [data, io] = [(Exit::Data, "line 7: no number"), (Exit::Io, "disk full")];
    /// let both = Failure::all(vec![Failure::new(data.0, data.1), Failure::new(io.0, io.1)]);
    /// assert!(both.is_some_and(|both| both.exit == Exit::Io && both.message == "line 7: no number\ndisk full"));
    /// assert!(Failure::all(Vec::new()).is_none());
    /// ```
    #[must_use]
    pub fn all(failures: Vec<Self>) -> Option<Self> {
        let exit = failures.iter().map(|failure| failure.exit).max_by_key(|exit| *exit as u8)?;
        let messages: Vec<_> = failures.into_iter().map(|failure| failure.message).collect();
        Some(Self::new(exit, messages.join("\n")))
    }
}

fn is_absent(folder: &Path) -> bool {
    !folder.as_os_str().is_empty() && !folder.is_dir()
}
