//! A self-contained HTML document.
//!
//! The templates escape every text, because names of devices, files and campaigns come from outside. The document
//! contains its own stylesheet, and its content security policy forbids everything else: the document loads nothing and
//! runs nothing, so it can be archived and read on any device. It follows the reader's light or dark preference and
//! prints in the light palette.

use crate::plot::Plot;
use crate::quantity::{printed, sentence};
use isotherm_support::finding::{Finding, Severity};
use maud::{DOCTYPE, Markup, PreEscaped, Render, html};

const STYLE: &str = include_str!("style.css");

/// A cell with a longer text does not become narrow where the page is.
const LONG_TEXT: usize = 40;

/// The verdict of a note or a table cell, the gravest last.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum NoteKind {
    /// No fault was found.
    Good,
    /// Usable, but to be checked.
    Warning,
    /// Not usable.
    Bad,
}

impl NoteKind {
    const fn class(self) -> &'static str {
        match self {
            Self::Good => "good",
            Self::Warning => "warning",
            Self::Bad => "bad",
        }
    }
}

/// The symbol of a verdict, for readers who cannot distinguish the colours.
impl Render for NoteKind {
    fn render(&self) -> Markup {
        let symbol = match self {
            Self::Good => "✓",
            Self::Warning => "!",
            Self::Bad => "✗",
        };
        html! { span.symbol aria-hidden="true" { (symbol) } " " }
    }
}

/// A table cell.
#[derive(Clone, Debug, PartialEq)]
pub enum Cell {
    /// Text, left-aligned.
    Text(String),
    /// A formatted number, right-aligned.
    Number(String),
    /// A verdict, with symbol and colour.
    Verdict(NoteKind, String),
}

impl Cell {
    /// A text cell.
    #[must_use]
    pub fn text(text: impl Into<String>) -> Self {
        Self::Text(text.into())
    }

    /// A number with fixed decimals; a dash if it is not finite.
    #[must_use]
    pub fn number(value: f64, decimals: usize) -> Self {
        Self::Number(if value.is_finite() { format!("{value:.decimals$}") } else { "–".into() })
    }

    /// A number that may be unknown; then a dash.
    pub(crate) fn known(value: Option<f64>, decimals: usize) -> Self {
        Self::number(value.unwrap_or(f64::NAN), decimals)
    }

    fn words(&self) -> &str {
        let (Self::Text(text) | Self::Number(text) | Self::Verdict(_, text)) = self;
        text
    }

    fn class(&self) -> Option<&'static str> {
        match self {
            Self::Text(text) => (text.len() > LONG_TEXT).then_some("long"),
            Self::Number(_) => Some("number"),
            Self::Verdict(kind, _) => Some(kind.class()),
        }
    }
}

impl Render for Cell {
    fn render(&self) -> Markup {
        match self {
            Self::Text(text) | Self::Number(text) => html! { (printed(text)) },
            Self::Verdict(kind, text) => html! { (kind) (printed(text)) },
        }
    }
}

/// A column of a table: its title, and the cell of an item.
pub(crate) type Column<'a, T> = (&'a str, &'a dyn Fn(&T) -> Cell);

/// Where the first section of a document ends that [`Page::finish`] made.
fn first_section_end(document: &str) -> usize {
    // No text of a document has a bare `<`, so these are its own tags.
    let second = document.match_indices("<h2").nth(1).map(|(place, _)| place);
    second.or_else(|| document.rfind("</main>")).unwrap_or(document.len())
}

/// The first screen of a document that [`Page::finish`] made: its title and its first section, without contents.
#[must_use]
pub fn first_screen(document: &str) -> String {
    let (head, rest) = document[..first_section_end(document)].split_once("<nav").unwrap_or((document, ""));
    match rest.split_once("</nav>") {
        Some((_, first)) => format!("{head}{first}</main></body></html>\n"),
        None => document.to_owned(),
    }
}

/// The document with files that a reader can save from its first section, each a name and a text. A browser that shows
/// the document in a frame without rights, as a notebook does, saves nothing.
#[must_use]
pub fn with_files(document: &str, files: &[(&str, &str)]) -> String {
    let encoded = |text: &str| -> String {
        let byte = |byte: u8| match byte {
            b'0'..=b'9' | b'A'..=b'Z' | b'a'..=b'z' | b'-' | b'_' | b'.' => char::from(byte).to_string(),
            _ => format!("%{byte:02X}"),
        };
        text.bytes().map(byte).collect()
    };
    let links = html! {
        @if !files.is_empty() {
            p.files { "Save the parameters: " @for (name, text) in files {
                a download=(name) href={ "data:text/plain;charset=utf-8," (encoded(text)) } { (name) } " "
            } }
        }
    };
    let (first, rest) = document.split_at(first_section_end(document));
    format!("{first}{}{rest}", links.into_string())
}

/// A document as a part of another page, as a notebook shows it: in a frame of its own, so that neither style changes
/// the other, and without any right.
#[must_use]
pub fn framed(document: &str) -> String {
    let frame = html! {
        iframe srcdoc=(document) sandbox="" style="width:100%;height:32em;border:0;resize:vertical" {}
    };
    frame.into_string()
}

/// A document that is built by appending to it.
#[derive(Clone, Debug)]
pub struct Page {
    title: String,
    subtitle: String,
    body: String,
    headings: Vec<Heading>,
    tables: usize,
    /// Notes without anything between them.
    notes: Vec<(NoteKind, Markup)>,
    reload_s: Option<u32>,
    /// Whether further headings are below that of a part.
    in_part: bool,
}

#[derive(Clone, Debug)]
struct Heading {
    level: u8,
    id: String,
    title: String,
}

impl Page {
    /// An empty document.
    #[must_use]
    pub fn new(title: &str, subtitle: &str) -> Self {
        let [title, subtitle] = [title, subtitle].map(String::from);
        Self {
            title,
            subtitle,
            body: String::new(),
            headings: Vec::new(),
            tables: 0,
            notes: Vec::new(),
            reload_s: None,
            in_part: false,
        }
    }

    /// Makes a browser reload the document every `seconds`.
    pub const fn reload_every(&mut self, seconds: u32) {
        self.reload_s = Some(seconds);
    }

    fn add(&mut self, part: &Markup) {
        self.flush_notes();
        self.body += &part.0;
        self.body.push('\n');
    }

    /// The gravest of the notes first.
    fn flush_notes(&mut self) {
        self.notes.sort_by_key(|(kind, _)| core::cmp::Reverse(*kind));
        for (_, note) in self.notes.drain(..) {
            self.body += &note.0;
            self.body.push('\n');
        }
    }

    /// Begins a part, with a heading of level 2. Further headings are below it, until the next part begins.
    pub fn begin_part(&mut self, id: &str, title: &str) {
        self.in_part = false;
        self.heading(2, id, title);
        self.in_part = true;
    }

    /// Adds a heading of level 2 or 3, which the table of contents links to by `id`. Characters that an
    /// identifier must not contain are replaced, and a repeated identifier gets a number.
    pub fn heading(&mut self, level: u8, id: &str, title: &str) {
        let level = (level + u8::from(self.in_part)).clamp(2, 3);
        let title = printed(title);
        let valid = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
        let base: String = format!("s-{}", id.chars().map(valid).collect::<String>());
        let mut id = base.clone();
        let mut count = 1;
        while self.headings.iter().any(|heading| heading.id == id) {
            count += 1;
            id = format!("{base}-{count}");
        }
        self.add(&match level {
            2 => html! { h2 id=(id) { (title) } },
            _ => html! { h3 id=(id) { (title) } },
        });
        self.headings.push(Heading { level, id, title });
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) {
        self.add(&html! { p { (printed(text)) } });
    }

    /// Adds a box with a title and a text, which may be empty. If boxes follow each other, the gravest is the
    /// first.
    pub fn note(&mut self, kind: NoteKind, title: &str, text: &str) {
        let note = html! {
            div class={ "note " (kind.class()) } role="note" {
                p.verdict { (kind) (printed(title)) }
                @for line in text.lines() { p { (printed(line)) } }
            }
        };
        self.notes.push((kind, note));
    }

    /// Adds a note for the findings of each name. `place` is what stands in front of the text of one.
    pub(crate) fn findings(&mut self, findings: &[Finding], place: impl Fn(&Finding) -> String) {
        let mut names: Vec<_> = findings.iter().map(|it| (it.severity, it.name)).collect();
        names.dedup();
        for (index, &(severity, name)) in names.iter().enumerate() {
            if names[..index].contains(&(severity, name)) {
                continue;
            }
            let (kind, title) = match severity {
                Severity::Fault => (NoteKind::Bad, "Fault"),
                Severity::Warning => (NoteKind::Warning, "Warning"),
            };
            let same = findings.iter().filter(|it| (it.severity, it.name) == (severity, name));
            let lines: Vec<_> = same.map(|finding| sentence(&format!("{}{finding}", place(finding)))).collect();
            self.note(kind, &format!("{title} [{name}]"), &lines.join("\n"));
        }
    }

    /// Adds a list of names and values.
    pub fn key_values<K: AsRef<str>, V: AsRef<str>>(&mut self, rows: &[(K, V)]) {
        self.add(&html! {
            dl { @for (key, value) in rows { div { dt { (printed(key.as_ref())) } dd { (printed(value.as_ref())) } } } }
        });
    }

    /// Adds a table; the first cell of a row is its header. A table wider than the page scrolls on its own, and has a
    /// shadow at each edge behind which there is more.
    pub fn table(&mut self, caption: &str, header: &[&str], rows: &[Vec<Cell>]) {
        self.tables += 1;
        let id = format!("t-{}", self.tables);
        let number = |column: usize| rows.first().is_some_and(|row| matches!(row.get(column), Some(Cell::Number(_))));
        let columns = |row: &[Cell]| 1..row.len().max(header.len());
        // The caption stays in place when the table scrolls.
        self.add(&html! {
            div.table {
                p.caption id=(id) { (printed(caption)) }
                div.scroll role="region" tabindex="0" aria-labelledby=(id) {
                    table aria-labelledby=(id) {
                        thead { tr {
                            @for (column, title) in header.iter().enumerate() {
                                th scope="col" class=[number(column).then_some("number")] { (column_title(&printed(title))) }
                            }
                        } }
                        tbody { @for row in rows { tr {
                            th scope="row" class=[row.first().and_then(Cell::class)] { (row.first().map_or_else(|| html! {}, Cell::render)) }
                            @for cell in columns(row).map(|column| row.get(column)) {
                                td class=[cell.and_then(Cell::class)] { @if let Some(cell) = cell { (cell) } }
                            }
                        } } }
                    }
                }
            }
        });
    }

    /// Adds a table with a row for each of `items`.
    pub(crate) fn columns<T>(&mut self, caption: &str, items: impl IntoIterator<Item = T>, columns: &[Column<'_, T>]) {
        let header: Vec<_> = columns.iter().map(|(title, _)| *title).collect();
        let row = |item: T| columns.iter().map(|(_, cell)| cell(&item)).collect();
        self.compact_table(caption, &header, items.into_iter().map(row).collect());
    }

    /// Adds a table without the columns that say nothing: of one that is the same in every row, and is not empty, the
    /// caption has the value.
    pub(crate) fn compact_table(&mut self, caption: &str, header: &[&str], mut rows: Vec<Vec<Cell>>) {
        let (mut caption, mut header) = (caption.to_owned(), header.to_vec());
        for column in (1..header.len()).rev() {
            let cell = |row: &Vec<Cell>| row.get(column).map_or_else(String::new, |cell| cell.words().to_owned());
            let Some(first) = rows.first().map(cell) else { break };
            let is_empty = matches!(first.as_str(), "" | "-" | "–");
            if !rows.iter().all(|row| cell(row) == first) || rows.len() < 3 && !is_empty {
                continue;
            }
            let title = header.remove(column);
            if !is_empty {
                let title = if title.is_empty() { String::new() } else { format!("{title}: ") };
                caption = format!("{caption}; {title}{first} in every row");
            }
            for row in rows.iter_mut().filter(|row| row.len() > column) {
                row.remove(column);
            }
        }
        self.table(&caption, &header, &rows);
    }

    /// Adds figures without captions, side by side as far as the width allows.
    pub(crate) fn plots(&mut self, plots: &[Plot]) {
        self.figures(&plots.iter().map(|plot| (plot.svg(), "")).collect::<Vec<_>>());
    }

    /// As [`plots`](Self::plots), three in a row.
    pub(crate) fn rows_of_plots(&mut self, plots: &[Plot]) {
        plots.chunks(3).for_each(|row| self.plots(row));
    }

    /// Adds a figure, as [`Plot::svg`](super::plot::Plot::svg) draws it.
    pub fn figure(&mut self, svg: &Markup, caption: &str) {
        self.add(&figure(svg, caption));
    }

    /// Adds figures, each with its caption, side by side as far as the width allows.
    pub fn figures<C: AsRef<str>>(&mut self, figures: &[(Markup, C)]) {
        self.add(&html! {
            div.figures.three[figures.len().is_multiple_of(3)] {
                @for (svg, caption) in figures { (figure(svg, caption.as_ref())) }
            }
        });
    }

    /// The document as HTML. Control characters and characters that change the direction of text become U+FFFD.
    #[must_use]
    pub fn finish(mut self) -> String {
        self.flush_notes();
        let document = html! {
            (DOCTYPE)
            html lang="en" {
                head {
                    meta charset="utf-8";
                    @if let Some(seconds) = self.reload_s { meta http-equiv="refresh" content=(seconds); }
                    meta http-equiv="Content-Security-Policy" content="default-src 'none'; style-src 'unsafe-inline'";
                    meta name="viewport" content="width=device-width, initial-scale=1";
                    meta name="color-scheme" content="light dark";
                    title { (self.title) }
                    style { (PreEscaped(STYLE)) }
                }
                body {
                    header {
                        h1 { (self.title) }
                        @if !self.subtitle.is_empty() { p.subtitle { (self.subtitle) } }
                    }
                    @if !self.headings.is_empty() {
                        nav aria-label="Contents" {
                            p { "Contents" }
                            ul { @for Heading { level, id, title } in &self.headings {
                                li class={ "level" (level) } { a href={ "#" (id) } { (title) } }
                            } }
                        }
                    }
                    main { (PreEscaped(self.body)) }
                }
            }
        };
        document.into_string().replace(is_hidden, "\u{fffd}") + "\n"
    }
}

/// The title of a column; its unit stays on one line.
fn column_title(title: &str) -> Markup {
    match title.rsplit_once(" / ") {
        Some((name, unit)) => html! { (name) " " span.unit { "/ " (unit) } },
        None => html! { (title) },
    }
}

fn figure(svg: &Markup, caption: &str) -> Markup {
    html! { figure { (svg) @if !caption.is_empty() { figcaption { (printed(caption)) } } } }
}

fn is_hidden(c: char) -> bool {
    c.is_control() && !matches!(c, '\n' | '\t')
        || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
        || matches!(c, '\u{fffe}' | '\u{ffff}')
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;
    use crate::plot::Style;

    /// Fails unless every tag is closed in order and no text holds a bare `<`, `>` or `&`.
    pub(crate) fn assert_well_formed(markup: &str) {
        let mut open = Vec::new();
        let mut parts = markup.split('<');
        assert!(!parts.next().unwrap().contains('>'));
        for part in parts {
            let (tag, text) = part.split_once('>').unwrap_or_else(|| panic!("unclosed tag <{part}"));
            let name = tag.split([' ', '\n']).next().unwrap();
            assert!(name == "style" || !text.contains('>'), "bare > after <{tag}>: {text}");
            assert_eq!(tag.matches('"').count() % 2, 0, "<{tag}>");
            match name.strip_prefix('/') {
                Some(name) => assert_eq!(open.pop(), Some(name), "</{name}>"),
                None if tag.ends_with('/') || matches!(name, "!DOCTYPE" | "meta") => {}
                None => open.push(name),
            }
            if open.last() != Some(&"style") {
                for entity in format!("{tag}{text}").split('&').skip(1) {
                    let known = ["amp;", "lt;", "gt;", "quot;", "#39;"].iter().any(|known| entity.starts_with(known));
                    assert!(known, "bare & before {entity}");
                }
            }
        }
        assert!(open.is_empty(), "not closed: {open:?}");
    }

    const EVIL: &str = "</title></style><script>alert('1')</script><img src=\"x\" onerror=\"y\">&\u{0}\u{202e}";

    fn filled(text: &str) -> String {
        let mut page = Page::new(text, text);
        page.heading(2, text, text);
        page.heading(9, text, text);
        page.paragraph(text);
        page.note(NoteKind::Warning, text, text);
        page.key_values(&[(text, text)]);
        let cells = vec![Cell::text(text), Cell::Number(text.into()), Cell::Verdict(NoteKind::Bad, text.into())];
        page.table(text, &[text; 3], &[cells, vec![]]);
        let plot = Plot::new(text, text, text).series(text, Style::Both, [(0.0, 1.0)]).marker(0.5, text);
        page.figures(&[(plot.series(text, Style::Line, []).svg(), text)]);
        page.finish()
    }

    #[test]
    fn hostile_text_stays_text() {
        let page = filled(EVIL);
        assert_well_formed(&page);
        for bad in ["<script", "<img", "\u{0}", "\u{202e}"] {
            assert!(!page.contains(bad), "{bad:?}");
        }
        assert_eq!(page.matches('<').count(), filled("harmless").matches('<').count());
        assert_eq!(page.matches("&lt;script&gt;").count(), 31, "every text is there");
    }

    #[test]
    fn the_first_screen_is_the_first_section_and_a_frame_holds_it_as_text() {
        let mut page = Page::new("t<1>", "from \"x\"");
        page.heading(2, "result", "Result");
        page.paragraph("first & foremost </iframe><h2>");
        page.heading(2, "more", "More");
        page.paragraph("second");
        let first = first_screen(&page.finish());
        assert_well_formed(&first.replace("<!DOCTYPE html>", ""));
        assert!(first.contains("foremost") && !first.contains("second") && !first.contains("<nav"));
        let frame = framed(&first);
        assert_eq!((frame.matches('<').count(), frame.matches("<iframe").count()), (2, 1));
        let alone = Page::new("t", "").finish();
        assert_eq!(first_screen(&alone), alone);
    }

    #[test]
    fn files_are_saved_from_the_first_section_and_stay_text() {
        let mut page = Page::new("t", "");
        page.heading(2, "result", "Result");
        page.heading(2, "more", "More");
        let page = page.finish();
        let with = with_files(&page, &[(EVIL, "A 1\n<script>é\"")]);
        assert_well_formed(&with.replace("<!DOCTYPE html>", ""));
        let link = "href=\"data:text/plain;charset=utf-8,A%201%0A%3Cscript%3E%C3%A9%22\"";
        assert!(first_screen(&with).contains(link), "{with}");
        assert_eq!(with_files(&page, &[]), page);
    }

    #[test]
    fn of_boxes_the_gravest_is_the_first() {
        let mut page = Page::new("t", "");
        page.note(NoteKind::Good, "good", "");
        let warning = Finding::warning("level", "w".to_owned());
        page.findings(&[warning.clone(), Finding::fault("interval", "f".to_owned()), warning], |_| {
            "line 1: ".to_owned()
        });
        page.paragraph("after");
        page.note(NoteKind::Bad, "last", "");
        let page = page.finish();
        let places = ["[interval]", "[level]", "good</p>", "<p>after", "last</p>"].map(|text| page.find(text));
        assert_eq!((page.matches("[level]").count(), page.matches("<p>Line 1: w.</p>").count()), (1, 2));
        assert!(places.iter().all(Option::is_some) && places.is_sorted(), "{places:?} {page}");
    }

    #[test]
    fn columns_that_say_nothing_are_not_there() {
        let table = |rows: &[[&str; 4]]| {
            let mut page = Page::new("t", "");
            let rows = rows.iter().map(|row| row.iter().map(|text| Cell::text(*text)).collect()).collect();
            page.compact_table("Caption", &["axis", "unit", "none", "value"], rows);
            page.finish()
        };
        let page = table(&[["x", "V", "-", "1"], ["y", "V", "-", "2"], ["z", "V", "-", "1"]]);
        assert!(page.contains("Caption; unit: V in every row</p>") && !page.contains(">none<"), "{page}");
        assert_eq!((page.matches("<th").count() - 1, page.matches("<td").count()), (2 + 3, 3));
        let page = table(&[["x", "V", "-", "1"], ["y", "V", "-", "2"]]);
        assert!(page.contains("<th scope=\"col\">unit") && !page.contains("in every row"), "{page}");
    }

    #[test]
    fn nothing_is_loaded() {
        let page = filled("x");
        for bad in ["http:", "https:", "url(", "@import", "src=", "<link", "<script"] {
            assert!(!page.contains(bad), "{bad}");
        }
    }

    #[test]
    fn headings_have_their_own_identifiers() {
        let mut page = Page::new("t", "");
        for title in ["One", "Two", "Three"] {
            page.heading(2, "axis x", title);
        }
        let page = page.finish();
        for id in ["s-axis-x", "s-axis-x-2", "s-axis-x-3"] {
            assert_eq!(page.matches(&format!("id=\"{id}\"")).count(), 1);
            assert_eq!(page.matches(&format!("href=\"#{id}\"")).count(), 1);
        }
        assert!(!page.contains("subtitle\">"));
        assert!(!Page::new("t", "").finish().contains("<nav"));
    }

    #[test]
    fn table_cells_align_and_short_rows_are_filled() {
        let mut page = Page::new("t", "");
        let row = vec![Cell::text("x"), Cell::number(-1.25, 3), Cell::Verdict(NoteKind::Good, "yes".into())];
        page.table("Caption", &["axis", "bias / <g0>", "ok"], &[row, vec![Cell::text("y"), Cell::number(f64::NAN, 3)]]);
        let page = page.finish();
        let unit = "<span class=\"unit\">/ &lt;g0&gt;</span>";
        assert!(
            page.contains(&format!("<th scope=\"col\">axis</th><th scope=\"col\" class=\"number\">bias {unit}</th>"))
        );
        assert!(page.contains("<th scope=\"row\">x</th><td class=\"number\">-1.250</td><td class=\"good\">"));
        assert!(page.contains("<th scope=\"row\">y</th><td class=\"number\">–</td><td></td></tr>"));
        let mut page = Page::new("t", "");
        page.table("Caption", &["axis", "cause"], &[vec![Cell::text("x"), Cell::text("a cause ".repeat(9))]]);
        assert!(page.finish().contains("<td class=\"long\">a cause "));
    }
}
