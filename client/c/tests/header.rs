//! `client/include/isotherm.h` has every function and flag of the library. That it is word for word what cbindgen makes of the code is
//! checked by `cargo run --manifest-path client/c/header/Cargo.toml -- --check`, which is no test since cbindgen would have the
//! whole transport built anew.
#![allow(clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_client::Flags;
use std::collections::BTreeSet;
use std::fs;

const HEADER: &str = include_str!("../../include/isotherm.h");

/// The words behind `mark`, up to a parenthesis.
fn functions(text: &str, mark: &str) -> BTreeSet<String> {
    let parts = text.split(mark).skip(1);
    parts.filter_map(|part| part.split_once('(')).map(|(name, _)| format!("isotherm_{name}")).collect()
}

#[test]
fn the_header_has_every_function() {
    let mut exported = BTreeSet::new();
    for source in fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/src")).unwrap().flatten() {
        exported.append(&mut functions(&fs::read_to_string(source.path()).unwrap(), "extern \"C\" fn isotherm_"));
    }
    let code: String =
        HEADER.lines().filter(|line| !line.starts_with([' ', '/', '#'])).map(|l| format!("{l}\n")).collect();
    let mut declared = functions(&code, " isotherm_");
    declared.extend(functions(&code, " *isotherm_"));
    assert!(exported.len() > 20);
    assert_eq!(exported, declared);
}

#[test]
fn the_header_has_every_flag_and_this_version() {
    for (bit, name) in Flags::NAMES {
        let line = format!("#define ISOTHERM_FLAG_{} (1 << {bit})\n", name.replace('-', "_").to_uppercase());
        assert!(HEADER.contains(&line), "{line}");
    }
    assert_eq!(HEADER.matches("#define ISOTHERM_FLAG_").count(), Flags::NAMES.len());
    assert!(HEADER.contains(&format!("#define ISOTHERM_VERSION \"{}\"\n", env!("CARGO_PKG_VERSION"))));
}
