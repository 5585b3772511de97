//! The campaign file that the files of a folder, or a sheet of means, would have: `isotherm calibrate turntable
//! --propose`. What they do not say is `"?"` there, or a comment.

mod columns;
mod names;
mod text;

use crate::samples::names_in;
use columns::PositionMeans;
use isotherm_campaign::FilePattern;
use isotherm_files::source;
use isotherm_recording_formats::convert::{LookedColumn, LookedTable};
use isotherm_support::failure::{Exit, Failure, shown};
use names::NamePattern;
use std::path::Path;
use text::{ProposedCampaign, TimeColumns};

/// How many folders below the one that is named files may be.
const DEPTH: usize = 2;
/// Files that are looked at: those of a campaign of thirty set points.
const MOST_FILES: usize = 1000;
/// Names that are shown.
const SHOWN: usize = 3;
/// Words of the columns of a sheet.
const OF_SET_POINT: [&str; 6] = ["set_point", "setpoint", "set point", "soll", "t_set", "chamber"];
const OF_POSITION: [&str; 4] = ["pos", "att", "lage", "orient"];

/// The text of the campaign file that the files in `folder`, or the sheet of means of that name, would have. Names in
/// it are relative to `beside`, the folder of the campaign file.
///
/// # Errors
/// If no file can be read as a table of numbers, or if nothing shows set point and position.
pub fn propose(folder: &Path, beside: &Path) -> Result<String, Failure> {
    if folder.is_file() {
        return of_sheet(folder, beside);
    }
    let mut names = Vec::new();
    for depth in 0..=DEPTH {
        names.extend(names_in(folder, depth)?);
    }
    let refused = |message: String| Failure::new(Exit::Data, format!("{}: {message}", shown(folder)));
    let found = NamePattern::of(&names).map_err(refused)?;
    let pattern = FilePattern::new(&found.pattern).map_err(refused)?;
    let (mut means, mut first, mut unlike) = (Vec::new(), None, Vec::new());
    for name in &names {
        let Some((set_point_c, position)) = pattern.read(name).filter(|_| means.len() < MOST_FILES) else { continue };
        let table = LookedTable::of(&source(folder.join(name)))?;
        let columns = table.columns.iter().map(LookedColumn::mean).collect();
        let of_first: &LookedTable = first.get_or_insert_with(|| table.clone());
        if of_first.columns.iter().map(|it| &it.name).ne(table.columns.iter().map(|it| &it.name)) {
            unlike.push(name.clone());
            continue;
        }
        means.push(PositionMeans { set_point_c, position, columns });
    }
    let Some(table) = first else { return Err(refused("no file is called as the others are".to_owned())) };
    let mut remarks: Vec<String> = found.guess.map(str::to_owned).into_iter().collect();
    remarks.extend(told("are called otherwise, and are not read", &found.others));
    remarks.extend(told("have other columns than the first", &unlike));
    let line = format!("files = {}", text::quoted(&format!("{}{}", relative(folder, beside), found.pattern)));
    let times = TimeColumns::of(&table);
    Ok(ProposedCampaign::of(table, times, means, &[]).campaign(&[line], &remarks))
}

/// The campaign file of a sheet of means.
fn of_sheet(sheet: &Path, beside: &Path) -> Result<String, Failure> {
    let table = LookedTable::of(&source(sheet))?;
    let find = |words: &[&str], is: &dyn Fn(&LookedColumn) -> bool| {
        let named = |column: &&LookedColumn| {
            let name = column.name.to_lowercase();
            column.is_numeric() && words.iter().any(|word| name.starts_with(word))
        };
        let all = || table.columns.iter().enumerate();
        all().find(|(_, column)| named(column)).or_else(|| all().find(|(_, column)| is(column))).map(|(index, _)| index)
    };
    let counts = |column: &LookedColumn| {
        let mut values = column.values.clone();
        values.sort_by(f64::total_cmp);
        values.dedup();
        values.len() > 3
            && values.len() < column.values.len()
            && values[0] <= 1.0
            && values.windows(2).all(|pair| pair[1] - pair[0] == 1.0)
    };
    let position = find(&OF_POSITION, &counts);
    // A set point stays the same while the position changes.
    let repeats = |column: &LookedColumn| {
        let changes = column.values.windows(2).filter(|pair| pair[0] != pair[1]).count();
        column.is_numeric() && changes > 0 && changes * 3 < column.values.len() && !counts(column)
    };
    let set_point = find(&OF_SET_POINT, &repeats);
    let Some((set_point, position)) = set_point.zip(position).filter(|(a, b)| a != b) else {
        let message = "no columns of set point and position are seen in the sheet; give them in a campaign file \
                       by hand: docs/calibrate.md#means";
        return Err(Failure::new(Exit::Data, format!("{}: {message}", shown(sheet))).at(sheet, None));
    };
    let rows = table.columns[position].values.len();
    let row = |row: usize| PositionMeans {
        set_point_c: table.columns[set_point].values[row],
        position: table.columns[position].values[row] as u32,
        columns: table.columns.iter().map(|column| column.values[row]).collect(),
    };
    let means: Vec<_> = (0..rows).map(row).collect();
    let name = sheet.file_name().unwrap_or_default().to_string_lossy();
    let folder = sheet.parent().unwrap_or(Path::new(""));
    let of = |index: usize| text::quoted(&table.columns[index].name);
    let lines = [
        format!("means = {}", text::quoted(&format!("{}{name}", relative(folder, beside)))),
        format!("set_point_c = {}", of(set_point)),
        format!("position = {}", of(position)),
    ];
    Ok(ProposedCampaign::of(table, TimeColumns::default(), means, &[set_point, position]).campaign(&lines, &[]))
}

/// What is said of some names.
fn told(what: &str, names: &[String]) -> Option<String> {
    let few = names.iter().take(SHOWN).map(String::as_str).collect::<Vec<_>>().join(", ");
    let more = if names.len() > SHOWN { ", .." } else { "" };
    (!names.is_empty()).then(|| format!("{} files {what}: {few}{more}", names.len()))
}

/// A folder as seen from another one, with a `/` at its end.
fn relative(folder: &Path, beside: &Path) -> String {
    let own = |path: &Path| if path.as_os_str().is_empty() { Path::new(".").to_owned() } else { path.to_owned() };
    let [folder, beside] = [folder, beside].map(|path| own(path).canonicalize().unwrap_or_else(|_| own(path)));
    let path = folder.strip_prefix(&beside).unwrap_or(&folder);
    if path.as_os_str().is_empty() { String::new() } else { format!("{}/", path.display()) }
}
