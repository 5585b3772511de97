//! Sets the environment variables from which the crate reads commit, profile and target.

use std::env;
use std::path::Path;
use std::process::Command;

fn main() {
    println!("cargo::rerun-if-env-changed=ISOTHERM_COMMIT");
    // A build from an archive has no repository: there ISOTHERM_COMMIT names the commit.
    let commit = env::var("ISOTHERM_COMMIT").ok().or_else(commit).unwrap_or_else(|| "unknown".to_owned());
    println!("cargo::rustc-env=ISOTHERM_COMMIT={commit}");

    // PROFILE is debug or release only; the name of the build folder is the profile's own name.
    let out = env::var("OUT_DIR").unwrap_or_default();
    let folder = Path::new(&out).ancestors().nth(3).and_then(Path::file_name).unwrap_or_default();
    let (profile, target) = (folder.to_string_lossy(), env::var("TARGET").unwrap_or_default());
    println!("cargo::rustc-env=ISOTHERM_BUILT={profile}, {target}");
}

/// The commit of the working tree of this package, with its date.
fn commit() -> Option<String> {
    // A commit or a checkout changes one of these files.
    for name in ["HEAD", "logs/HEAD"] {
        if let Some(file) = git(&["rev-parse", "--git-path", name]).filter(|file| Path::new(file).exists()) {
            println!("cargo::rerun-if-changed={file}");
        }
    }
    let commit = git(&["rev-parse", "--short=12", "HEAD"])?;
    let date = git(&["show", "--no-patch", "--format=%cs", "HEAD"])?;
    Some(format!("{commit} ({date})"))
}

fn git(arguments: &[&str]) -> Option<String> {
    let output = Command::new("git").args(arguments).output().ok().filter(|output| output.status.success())?;
    String::from_utf8(output.stdout).ok().map(|text| text.trim().to_owned()).filter(|text| !text.is_empty())
}
