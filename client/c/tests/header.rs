//! `client/include/isotherm.h` has every function and flag of the library. That it is word for word what cbindgen makes of the code is
//! checked by `cargo run --manifest-path client/c/header/Cargo.toml -- --check`, which is no test since cbindgen would have the
//! whole transport built anew.
#![allow(clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_client::Flags;
use std::collections::BTreeSet;
use std::fs;

const HEADER: &str = include_str!("../../include/isotherm.h");

/// What stands right before a parenthesis and is ours.
fn functions(code: &str) -> BTreeSet<String> {
    let words = code.split('(').filter_map(|part| part.rsplit(|c: char| !c.is_alphanumeric() && c != '_').next());
    words.filter(|word| word.starts_with("isotherm_")).map(str::to_owned).collect()
}

#[test]
fn the_header_has_every_function() {
    let mut exported = BTreeSet::new();
    for source in fs::read_dir(concat!(env!("CARGO_MANIFEST_DIR"), "/src")).unwrap().flatten() {
        let text = fs::read_to_string(source.path()).unwrap();
        text.lines()
            .filter(|line| line.contains("extern \"C\" fn isotherm_"))
            .for_each(|line| exported.append(&mut functions(line)));
    }
    let code: Vec<_> = HEADER.lines().filter(|line| !line.starts_with([' ', '/', '#'])).collect();
    assert!(exported.len() > 20);
    assert_eq!(exported, functions(&code.join("\n")));
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
