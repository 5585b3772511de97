//! `client/include/isotherm.h` has every function and flag of the library. `cargo run --manifest-path
//! client/c/header/Cargo.toml -- --check` checks that it is exactly what cbindgen generates from the code. That is not
//! a test here, because cbindgen's dependencies would cause a second build of the transport.
#![allow(clippy::unwrap_used, reason = "in a test the panic is the report")]

use isotherm_client::Flags;
use std::collections::BTreeSet;
use std::fs;

const HEADER: &str = include_str!("../../include/isotherm.h");

/// The names before an opening parenthesis that begin with `isotherm_`.
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
        let line = format!("#define ISOTHERM_FLAG_{} (UINT64_C(1) << {bit})\n", name.replace('-', "_").to_uppercase());
        assert!(HEADER.contains(&line), "{line}");
    }
    assert_eq!(HEADER.matches("#define ISOTHERM_FLAG_").count(), Flags::NAMES.len());
    assert!(HEADER.contains(&format!("#define ISOTHERM_VERSION \"{}\"\n", env!("CARGO_PKG_VERSION"))));
}
