//! A self-contained HTML document.
//!
//! The templates escape every text, because names of devices, files and campaigns come from outside. The document
//! contains its own stylesheet, and its content security policy forbids everything else: the document loads nothing and
//! runs nothing, so it can be archived and read on any device. It follows the reader's light or dark preference and
//! prints in the light palette.

use crate::plot::Plot;
use isotherm_support::finding::Finding;
use maud::{DOCTYPE, Markup, PreEscaped, Render, html};

const STYLE: &str = include_str!("style.css");

/// A cell with a longer text does not become narrow where the page is.
const LONG_TEXT: usize = 40;

/// The verdict of a note or a table cell.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
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
            Self::Text(text) | Self::Number(text) => html! { (text) },
            Self::Verdict(kind, text) => html! { (kind) (text) },
        }
    }
}

/// A column of a table: its title, and the cell of an item.
pub(crate) type Column<'a, T> = (&'a str, &'a dyn Fn(&T) -> Cell);

/// The first screen of a document that [`Page::finish`] made: its title and its first section, without contents.
#[must_use]
pub fn first_screen(document: &str) -> String {
    // No text of a document has a bare `<`, so these are its own tags.
    let (head, rest) = document.split_once("<nav").unwrap_or((document, ""));
    let after_contents = rest.split_once("</nav>").map_or("", |(_, main)| main);
    let mut headings = after_contents.match_indices("<h2").map(|(place, _)| place).skip(1);
    match headings.next() {
        Some(second) => format!("{head}{}</main></body></html>\n", &after_contents[..second]),
        None => format!("{head}{after_contents}"),
    }
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
        Self { title, subtitle, body: String::new(), headings: Vec::new(), tables: 0, reload_s: None, in_part: false }
    }

    /// Makes a browser reload the document every `seconds`.
    pub const fn reload_every(&mut self, seconds: u32) {
        self.reload_s = Some(seconds);
    }

    fn add(&mut self, part: &Markup) {
        self.body += &part.0;
        self.body.push('\n');
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
        self.headings.push(Heading { level, id, title: title.into() });
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) {
        self.add(&html! { p { (text) } });
    }

    /// Adds a box with a title and a text, which may be empty.
    pub fn note(&mut self, kind: NoteKind, title: &str, text: &str) {
        self.add(&html! {
            div class={ "note " (kind.class()) } role="note" {
                p.verdict { (kind) (title) }
                @if !text.is_empty() { p { (text) } }
            }
        });
    }

    /// Adds a note for each finding.
    pub(crate) fn findings(&mut self, findings: &[Finding]) {
        findings.iter().for_each(|finding| self.note(NoteKind::Warning, "Look at this", &finding.to_string()));
    }

    /// Adds a list of names and values.
    pub fn key_values<K: AsRef<str>, V: AsRef<str>>(&mut self, rows: &[(K, V)]) {
        self.add(&html! {
            dl { @for (key, value) in rows { div { dt { (key.as_ref()) } dd { (value.as_ref()) } } } }
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
                p.caption id=(id) { (caption) }
                div.scroll role="region" tabindex="0" aria-labelledby=(id) {
                    table aria-labelledby=(id) {
                        thead { tr {
                            @for (column, title) in header.iter().enumerate() {
                                th scope="col" class=[number(column).then_some("number")] { (column_title(title)) }
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
        self.table(caption, &header, &items.into_iter().map(row).collect::<Vec<_>>());
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
    pub fn finish(self) -> String {
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
    html! { figure { (svg) @if !caption.is_empty() { figcaption { (caption) } } } }
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
