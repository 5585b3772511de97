//! Generates `client/include/isotherm.h` from the code of the C interface; with `--check` only checks that it is up to
//! date.
//!
//!     cargo run --manifest-path client/c/header/Cargo.toml [-- --check]

use std::error::Error;
use std::fs;
use std::path::Path;
use std::process::ExitCode;

/// Source files of the interface, relative to `client/c`.
const SOURCES: [&str; 9] = [
    "../../shared/src/wire.rs",
    "src/acquisition.rs",
    "src/code.rs",
    "src/flags.rs",
    "src/lag.rs",
    "src/reader.rs",
    "src/readings.rs",
    "src/thread.rs",
    "src/values.rs",
];

/// Replacements in the generated text: notation of rustdoc, and the layout of the file's beginning and end.
const REPLACEMENTS: [(&str, &str); 13] = [
    ("\\[", "["),
    ("\\]", "]"),
    ("1..=[`MAX_INTERVAL_NS`]", "1 to ISOTHERM_MAX_INTERVAL_NS"),
    ("[`Flags::INTERVAL`]", "ISOTHERM_FLAG_INTERVAL"),
    ("[`RawSample::lag_ns`]", "`lag_ns` of the sample"),
    ("[`RawSample`]", "isotherm_raw_sample"),
    ("[`device`] of its serial number", "isotherm_device() of its serial number"),
    ("[AXES]", "[3]"),
    ("ISOTHERM_LAG_NONE -1.0", "ISOTHERM_LAG_NONE (-1.0)"),
    // A shift of an int by 32 bits and more is undefined.
    ("(1 << ", "(UINT64_C(1) << "),
    ("See [`Flags`].", "ISOTHERM_FLAG_.., joined by |; isotherm_flags_text names them."),
    // The introduction is one comment, directly before the include guard.
    ("*/\n\n\n#ifndef", "*/\n\n#ifndef"),
    ("#endif  /* ISOTHERM_H */\n\n", ""),
];

fn main() -> Result<ExitCode, Box<dyn Error>> {
    let interface = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let header = interface.join("../include/isotherm.h");
    let generated = generate(&interface)?;
    if !std::env::args().any(|word| word == "--check") {
        fs::write(header, generated)?;
    } else if fs::read_to_string(header)? != generated {
        eprintln!(
            "client/include/isotherm.h is not what the code says; generate it again: cargo run --manifest-path \
             client/c/header/Cargo.toml"
        );
        return Ok(ExitCode::FAILURE);
    }
    Ok(ExitCode::SUCCESS)
}

fn generate(interface: &Path) -> Result<String, Box<dyn Error>> {
    let mut config = cbindgen::Config::from_file(interface.join("header/cbindgen.toml"))?;
    let version = version(&fs::read_to_string(interface.join("../../Cargo.toml"))?)?;
    let mut text = config.after_includes.take().ok_or("no text after the includes")?.replace("@VERSION@", &version);
    for (place, number) in ["@MAJOR@", "@MINOR@", "@PATCH@"].into_iter().zip(version.split('.')) {
        text = text.replace(place, number);
    }
    config.after_includes = Some(text);
    let mut builder = cbindgen::Builder::new().with_config(config);
    for source in SOURCES {
        builder = builder.with_src(interface.join(source));
    }
    let mut text = Vec::new();
    builder.generate()?.write(&mut text);
    Ok(REPLACEMENTS.iter().fold(String::from_utf8(text)?, |text, (rust, c)| text.replace(rust, c)))
}

/// The first version in the workspace's manifest, which is the workspace's.
fn version(manifest: &str) -> Result<String, &'static str> {
    let line = manifest.lines().find_map(|line| line.strip_prefix("version = \"")).ok_or("no version")?;
    Ok(line.trim_end_matches('"').to_owned())
}
