//! How a text begins: lines of a program, the names of the columns, their units, and the first rows.

mod units;

use super::calendar;
use super::refused::BY_PYTHON;
use isotherm_recording::RecordingError;
use isotherm_recording::csv::{Checksum, Rows, Separator, looks_like_number};
use std::io::{BufRead as _, BufReader, Cursor, Read};
use units::is_unit;

/// Bytes that are looked at.
const BYTES: u64 = 1 << 16;
/// Lines among which the header, or the first row, is searched.
const SEARCHED: usize = 100;
/// Lines that are looked at: those that are searched, and some rows.
const LINES: usize = SEARCHED + 20;
/// Fewest numbers of a row: three accelerometers.
pub(super) const FEWEST: usize = 3;

/// The first lines of a text that are not blank.
pub(super) struct TextOpening {
    lines: Vec<OpeningLine>,
    checksums: Checksums,
}

struct OpeningLine {
    number: u64,
    text: Vec<u8>,
}

/// What the ends of the rows are.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub(super) enum Checksums {
    #[default]
    None,
    /// Checksums that fit their rows.
    Checked,
    /// Checksums of another kind.
    Unknown,
}

/// A table in a text.
#[derive(Debug)]
pub(super) struct Table {
    pub(super) separator: Separator,
    pub(super) header: Option<ColumnNames>,
    /// Number of columns.
    pub(super) width: usize,
    /// Line of the first row.
    pub(super) first: u64,
    pub(super) checksums: Checksums,
}

/// The names of the columns.
#[derive(Debug)]
pub(super) struct ColumnNames {
    /// Its line.
    pub(super) line: u64,
    /// Its last line: that of the units, if they have one of their own.
    last: u64,
    /// With the units.
    pub(super) names: Vec<String>,
    /// Other spellings of all names: without the units of the second line, or with the sign of a comment.
    others: Vec<Vec<String>>,
}

/// The rows of a table, of which none has been read.
pub(super) fn rows_of(source: Box<dyn Read>, table: &Table, skip: u64) -> Result<Rows<Box<dyn Read>>, RecordingError> {
    let mut rows = Rows::starting_at(source, skip);
    rows.skip_lines(table.begin() - 1 - skip)?;
    rows.separate_by(table.separator)?;
    if table.checksums != Checksums::None {
        rows.cut_checksums();
    }
    Ok(rows)
}

impl TextOpening {
    /// Looks at the first lines behind `skip` lines of `source`. Returns what is there, and all that is behind those
    /// lines, again from its beginning.
    ///
    /// # Errors
    /// If the source cannot be read, or has fewer lines.
    pub(super) fn read(source: Box<dyn Read>, skip: u64) -> Result<(Self, Box<dyn Read>), RecordingError> {
        let mut source = BufReader::with_capacity(BYTES as usize, source);
        for line in 0..skip {
            if source.skip_until(b'\n')? == 0 {
                let message = format!("the text ends here; {skip} lines were to be skipped");
                return Err(RecordingError::Data { line: line + 1, message });
            }
        }
        let mut beginning = Vec::new();
        let is_all = (&mut source).take(BYTES).read_to_end(&mut beginning)? < BYTES as usize;
        let opening = Self::of(&beginning, skip, is_all);
        Ok((opening, Box::new(Cursor::new(beginning).chain(source))))
    }

    fn of(beginning: &[u8], skip: u64, is_all: bool) -> Self {
        let text = match beginning.iter().rposition(|byte| *byte == b'\n') {
            Some(end) if !is_all => &beginning[..end],
            _ => beginning,
        };
        let text = if skip == 0 { text.strip_prefix("\u{feff}".as_bytes()).unwrap_or(text) } else { text };
        let lines = text.split(|byte| *byte == b'\n').zip(skip + 1..);
        let lines = lines.filter(|(line, _)| !line.trim_ascii().is_empty()).take(LINES);
        let mut lines: Vec<_> = lines.map(|(text, number)| OpeningLine { number, text: text.to_vec() }).collect();
        let checksums = Checksums::of(&lines);
        if checksums != Checksums::None {
            for line in &mut lines {
                let end = Checksum::of(&line.text).map_or(line.text.len(), |checksum| checksum.at);
                line.text.truncate(end);
            }
        }
        Self { lines, checksums }
    }

    /// The first row of numbers that the next one is like, and the names above it. This is how every text is split into
    /// columns.
    pub(super) fn table(&self) -> Option<Table> {
        let of = |is_right: fn(&[String]) -> bool| {
            (0..self.lines.len().min(SEARCHED)).find_map(|at| {
                let mut tables = Separator::ALL.into_iter().filter_map(|other| self.rows_from(at, other, is_right));
                let first = tables.next()?;
                // Tabs may be blanks of any number: then they separate as many fields, and the names as well.
                let named = tables.find(|table| table.width == first.width && table.header.is_some());
                Some(named.filter(|_| first.header.is_none()).unwrap_or(first))
            })
        };
        // A date as 31/12/2026 is no number, and none and more.
        let table = of(|fields| fields.iter().all(|field| is_whole(field))).or_else(|| of(|_| true))?;
        // The row that is found has a good one behind it; those before it may not have.
        let is_like = |fields: Vec<String>| fields.len() == table.width && is_row(&fields);
        let first = match &table.header {
            Some(_) => None,
            None => self.lines.iter().find(|line| is_like(line.fields(table.separator))),
        };
        Some(Table { first: first.map_or(table.first, |line| line.number), ..table })
    }

    /// As [`table`](Self::table).
    ///
    /// # Errors
    /// If there is none.
    pub(super) fn table_of_numbers(&self) -> Result<Table, RecordingError> {
        self.table().ok_or_else(|| {
            let splits = |at: usize| self.splits_numbers(at, &self.lines[at].fields(Separator::Comma));
            let reason = match (0..self.lines.len()).any(splits) {
                true => {
                    "the rows have more fields than there are names: commas separate them, and are decimal marks as \
                     well; write decimal points"
                        .to_owned()
                }
                false => format!("no two rows with {FEWEST} numbers or more; this is not a table of numbers"),
            };
            RecordingError::Data { line: self.last(), message: format!("{reason}; or {BY_PYTHON}") }
        })
    }

    /// The table that a mapping of these names reads. If [`table`](Self::table) has other names, it is what stands
    /// below these names.
    pub(super) fn with_names(&self, wanted: &[&str]) -> Option<Table> {
        let has_all = |header: &ColumnNames| wanted.iter().all(|name| header.has(name));
        let below = |at: usize, separator: Separator| {
            let header = Some(self.header(at, separator)).filter(has_all)?;
            let (width, first) = (header.names.len(), header.last + 1);
            Some(Table { separator, header: Some(header), width, first, checksums: self.checksums })
        };
        let table = self.table().filter(|table| table.header.as_ref().is_some_and(has_all));
        let searched = 0..self.lines.len().min(SEARCHED);
        table.or_else(|| searched.into_iter().find_map(|at| Separator::ALL.into_iter().find_map(|of| below(at, of))))
    }

    /// The table that a mapping of columns with these numbers, from 1, reads.
    pub(super) fn with_numbers(&self, wanted: &[usize]) -> Option<Table> {
        let table = self.table().filter(|table| wanted.iter().all(|number| *number <= table.width));
        table.map(|table| Table { header: None, ..table })
    }

    /// The text as a table whose first row has as many columns as possible.
    pub(super) fn widest(&self) -> Option<Table> {
        let first = self.lines.first()?;
        let widths = Separator::ALL.map(|separator| (first.fields(separator).len(), separator));
        let (width, separator) = widths.into_iter().rev().max_by_key(|(width, _)| *width)?;
        Some(Table { separator, header: None, width, first: first.number, checksums: self.checksums })
    }

    /// The fields of the first line.
    pub(super) fn first_fields(&self, separator: Separator) -> (u64, Vec<String>) {
        self.lines.first().map_or((1, Vec::new()), |line| (line.number, line.fields(separator)))
    }

    /// The lines before this one.
    pub(super) fn before(&self, line: u64) -> Vec<Vec<u8>> {
        let before = self.lines.iter().take_while(|other| other.number < line);
        before.map(|line| line.text.trim_ascii().to_vec()).collect()
    }

    /// The last line that was looked at.
    pub(super) fn last(&self) -> u64 {
        self.lines.last().map_or(1, |line| line.number)
    }

    /// Whether the row in this line begins as a comment does.
    pub(super) fn is_comment(&self, line: u64) -> bool {
        self.lines.iter().any(|other| other.number == line && uncommented(&other.text).is_some())
    }

    /// The table whose first row is this line.
    fn rows_from(&self, at: usize, separator: Separator, is_right: fn(&[String]) -> bool) -> Option<Table> {
        let fields = self.lines[at].fields(separator);
        if !is_row(&fields) || !is_right(&fields) {
            return None;
        }
        let header = self.header_above(at, separator, fields.len());
        if header.is_none() && separator == Separator::Comma && self.splits_numbers(at, &fields) {
            return None;
        }
        let next = self.lines[at + 1..].iter().find(|line| uncommented(&line.text).is_none());
        let is_followed = header.is_some() || next.is_some_and(|next| is_alike(&fields, &next.fields(separator)));
        let (width, first) = (fields.len(), self.lines[at].number);
        is_followed.then_some(Table { separator, header, width, first, checksums: self.checksums })
    }

    /// Whether the commas that separate these fields of a row are decimal marks, too: there are half as many names
    /// above it, or more, but not as many.
    fn splits_numbers(&self, at: usize, fields: &[String]) -> bool {
        let names = (0..at).map(|index| self.header(index, Separator::Comma).names);
        let mut names = names.filter(|names| is_row(fields) && is_names(names));
        names.any(|names| (names.len() + 1..=2 * names.len()).contains(&fields.len()))
    }

    /// The names of as many columns, above a row: in the nearest line that fits, if there is one without numbers, as
    /// those of a row with a damaged field.
    fn header_above(&self, at: usize, separator: Separator, width: usize) -> Option<ColumnNames> {
        let nearest = |has_numbers: bool| {
            (0..at).rev().find_map(|index| {
                let is_comment = uncommented(&self.lines[index].text).is_some();
                // A sentence has as many words as there are columns, now and then.
                let is_right = |other: &Separator| *other == separator || is_comment || *other != Separator::Spaces;
                Separator::ALL.into_iter().filter(is_right).find_map(|separator| {
                    let is_it = |names: &[String]| is_names(names) && is_row(names) == has_numbers;
                    let of = |index: usize| Some(self.header(index, separator)).filter(|header| is_it(&header.names));
                    let header = of(index).filter(|header| header.names.len() == width)?;
                    let above = index.checked_sub(1).and_then(of).filter(|above| above.last == header.line);
                    Some(above.unwrap_or(header))
                })
            })
        };
        nearest(false).or_else(|| nearest(true))
    }

    /// A line as the names of the columns, and as those of their units the next one.
    fn header(&self, at: usize, separator: Separator) -> ColumnNames {
        let line = &self.lines[at];
        let as_it_is = line.fields(separator);
        let mut others = Vec::new();
        let mut names = match uncommented(&line.text) {
            Some(text) => {
                let names = fields(text, separator);
                if as_it_is.len() == names.len() {
                    others.push(as_it_is);
                }
                names
            }
            None => as_it_is,
        };
        let units = self.lines.get(at + 1).map(|next| (next.number, next.content(separator)));
        // That of the last column may be missing.
        let fits = |count: usize| count == names.len() || count + 1 == names.len();
        let units = units.filter(|(_, units)| fits(units.len()) && are_units(units));
        let mut last = line.number;
        if let Some((number, units)) = units.filter(|(_, units)| units != &names) {
            last = number;
            others.insert(0, names.clone());
            for (name, unit) in names.iter_mut().zip(units) {
                let unit = unit.trim_matches(['[', ']', '(', ')', '{', '}', ' ']);
                if !unit.is_empty() && unit != "-" {
                    *name = format!("{name} [{unit}]");
                }
            }
        }
        ColumnNames { line: line.number, last, names, others }
    }
}

impl Table {
    /// The line before which nothing is read: that of the first row, or the one below the header.
    pub(super) fn begin(&self) -> u64 {
        self.header.as_ref().map_or(self.first, |header| header.last + 1)
    }

    /// The line of the header, or of the first row of a text that has none.
    pub(super) fn line(&self) -> u64 {
        self.header.as_ref().map_or(self.first, |header| header.line)
    }
}

impl ColumnNames {
    /// Whether a column has this name.
    pub(super) fn has(&self, name: &str) -> bool {
        self.spellings().any(|names| names.iter().any(|other| other == name))
    }

    /// The column of this name, from 0.
    ///
    /// # Errors
    /// If it is there twice.
    pub(super) fn column(&self, name: &str) -> Result<Option<usize>, String> {
        for names in self.spellings() {
            let mut found = (0..names.len()).filter(|index| names[*index] == name);
            match (found.next(), found.next()) {
                (Some(_), Some(_)) => return Err(format!("the column {name} is there twice")),
                (Some(index), None) => return Ok(Some(index)),
                _ => {}
            }
        }
        Ok(None)
    }

    /// All names, in each of their spellings.
    fn spellings(&self) -> impl Iterator<Item = &Vec<String>> {
        std::iter::once(&self.names).chain(&self.others)
    }
}

impl OpeningLine {
    /// The fields, without an empty one behind a separator at the end.
    fn fields(&self, separator: Separator) -> Vec<String> {
        fields(&self.text, separator)
    }

    /// The same, without the sign of a comment.
    fn content(&self, separator: Separator) -> Vec<String> {
        fields(uncommented(&self.text).unwrap_or(&self.text), separator)
    }
}

impl Checksums {
    /// That of most rows: the first one may be damaged.
    fn of(lines: &[OpeningLine]) -> Self {
        let all: Vec<_> = lines.iter().filter_map(|line| Checksum::of(&line.text)).collect();
        let fitting = all.iter().filter(|checksum| checksum.stated == checksum.computed).count();
        match () {
            () if 2 * all.len() <= lines.len() => Self::None,
            () if 2 * fitting > all.len() => Self::Checked,
            () => Self::Unknown,
        }
    }
}

/// The fields of a line, without an empty one behind a separator at the end. None if they are not known.
fn fields(line: &[u8], separator: Separator) -> Vec<String> {
    let mut row = Rows::new(line);
    let read = row.next_row().and_then(|is_there| if is_there { row.separate_by(separator) } else { Ok(()) });
    let mut fields: Vec<_> = if read.is_ok() { row.names().collect() } else { Vec::new() };
    if fields.len() > 1 && fields.last().is_some_and(String::is_empty) {
        fields.pop();
    }
    fields
}

/// What a comment says; `None` if the line is none.
pub(super) fn uncommented(line: &[u8]) -> Option<&[u8]> {
    let line = line.trim_ascii();
    let signs: &[u8] = match line {
        [b'#', ..] => b"#",
        [b'%', ..] => b"%",
        [b'/', b'/', ..] => b"/",
        _ => return None,
    };
    let begin = line.iter().position(|byte| !signs.contains(byte)).unwrap_or(line.len());
    Some(line[begin..].trim_ascii())
}

/// Whether a field is a number, a time or a date.
pub(super) fn is_value(field: &str) -> bool {
    looks_like_number(field) || calendar::time_ns(field).is_some() || calendar::is_date(field)
}

/// Whether a field is a value, or none and does not begin as one, as with a separator that is not the right one.
fn is_whole(field: &str) -> bool {
    let begins_as_number = field.starts_with(|letter: char| letter.is_ascii_digit() || "+-.".contains(letter));
    is_value(field) || !begins_as_number && !field.contains([';', '\t'])
}

/// Whether these can be the fields of a row of numbers.
fn is_row(fields: &[String]) -> bool {
    fields.iter().filter(|field| looks_like_number(field)).count() >= FEWEST
}

/// Whether two rows have values in the same columns, where neither lacks one.
fn is_alike(one: &[String], other: &[String]) -> bool {
    let is_alike =
        |(one, other): (&String, &String)| one.is_empty() || other.is_empty() || is_value(one) == is_value(other);
    one.len() == other.len() && one.iter().zip(other).all(is_alike)
}

/// Whether these can be the names of columns: a name has a letter. Three numbers or more among them are names only next
/// to words, as in `t,1,2,3`; otherwise it is a row with a damaged field.
fn is_names(fields: &[String]) -> bool {
    let mut others = fields.iter().filter(|field| !is_value(field)).peekable();
    let has_letter = |field: &String| field.chars().any(char::is_alphabetic);
    let is_word = |field: &String| field.chars().all(|letter| letter.is_alphabetic() || letter == '_');
    others.peek().is_some() && others.clone().any(has_letter) && (!is_row(fields) || others.all(is_word))
}

/// Whether these are units of columns.
fn are_units(fields: &[String]) -> bool {
    fields.iter().any(|field| is_unit(field)) && fields.iter().all(|field| field.is_empty() || is_unit(field))
}
