//! The section `[lines]`.

use super::columns::Names;
use crate::lines::Line;
use isotherm_shared::document::Section;

/// The columns of a line, and the line but for the columns that are used.
pub(super) fn read(root: &Section<'_, '_>) -> Option<(Names, Line)> {
    let section = root.section("lines", "a section [lines]")?;
    let separators = [(Some(b','), ","), (Some(b';'), ";"), (Some(b'\t'), "tab"), (None, "space")];
    let separator = section.optional_choice("separator", &separators).unwrap_or(Some(b','));
    let names = match section.has("names") {
        true => section.strings("names", "the names of all columns, in their order")?,
        false => {
            section.ignore("names");
            Vec::new()
        }
    };
    let twice = (1..names.len()).find(|at| names[..*at].contains(&names[*at]));
    section.refuse("names", twice.map(|at| format!("has {} twice; give every column a name of its own", names[at])));
    let prefix = section.optional_string("prefix").unwrap_or_default().as_bytes().to_vec();
    let checksum = section.optional_bool("checksum").unwrap_or_default();
    section.finish();
    let count = (!names.is_empty()).then_some(names.len());
    let names = Names::of_lines(names.into_iter().map(str::to_owned).collect());
    Some((names, Line { separator, count, used: Vec::new(), prefix, checksum }))
}
