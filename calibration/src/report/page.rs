//! A self-contained HTML document.
//!
//! Every text is escaped here: names of devices, files and campaigns come from outside. The document carries its own
//! stylesheet, and its content security policy forbids everything else: it loads nothing and runs nothing, so it can
//! be archived and read on any device. It follows the reader's light or dark preference and prints in the light
//! palette.

use std::borrow::Cow;

const STYLE: &str = include_str!("style.css");

/// What a note or a table cell says about its subject.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum NoteKind {
    /// As it should be.
    Good,
    /// Usable, but look at it.
    Warning,
    /// Not usable.
    Bad,
}

impl NoteKind {
    /// CSS class and symbol: colour alone says nothing to some readers.
    fn parts(self) -> (&'static str, char) {
        match self {
            Self::Good => ("good", '✓'),
            Self::Warning => ("warning", '!'),
            Self::Bad => ("bad", '✗'),
        }
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

    /// A number with fixed decimals; a dash for what is not finite.
    #[must_use]
    pub fn number(value: f64, decimals: usize) -> Self {
        Self::Number(if value.is_finite() { format!("{value:.decimals$}") } else { "–".into() })
    }
}

/// A document to append to.
#[derive(Clone, Debug)]
pub struct Page {
    title: String,
    subtitle: String,
    body: String,
    /// Level, identifier and title of the headings so far.
    headings: Vec<(u8, String, String)>,
    tables: usize,
    reload_s: Option<u32>,
}

impl Page {
    /// An empty document.
    #[must_use]
    pub fn new(title: &str, subtitle: &str) -> Self {
        let [title, subtitle] = [title, subtitle].map(String::from);
        Self { title, subtitle, body: String::new(), headings: Vec::new(), tables: 0, reload_s: None }
    }

    /// Has a browser load the document again after so many seconds.
    pub const fn reload_every(&mut self, seconds: u32) {
        self.reload_s = Some(seconds);
    }

    /// Adds a heading of level 2 or 3, which the table of contents links to by `id`. What an identifier cannot hold is
    /// replaced, and one that is taken gets a number.
    pub fn heading(&mut self, level: u8, id: &str, title: &str) {
        let level = level.clamp(2, 3);
        let valid = |c: char| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' };
        let base: String = format!("s-{}", id.chars().map(valid).collect::<String>());
        let mut id = base.clone();
        let mut count = 1;
        while self.headings.iter().any(|heading| heading.1 == id) {
            count += 1;
            id = format!("{base}-{count}");
        }
        self.body += &format!("<h{level} id=\"{id}\">{}</h{level}>\n", escape(title));
        self.headings.push((level, id, title.into()));
    }

    /// Adds a paragraph.
    pub fn paragraph(&mut self, text: &str) {
        self.body += &format!("<p>{}</p>\n", escape(text));
    }

    /// Adds a box with a title and a text, which may be empty.
    pub fn note(&mut self, kind: NoteKind, title: &str, text: &str) {
        let (class, symbol) = kind.parts();
        let text = if text.is_empty() { String::new() } else { format!("<p>{}</p>", escape(text)) };
        self.body += &format!(
            "<div class=\"note {class}\" role=\"note\"><p class=\"verdict\">\
             <span class=\"symbol\" aria-hidden=\"true\">{symbol}</span> {}</p>{text}</div>\n",
            escape(title)
        );
    }

    /// Adds a list of names and values.
    pub fn key_values<K: AsRef<str>, V: AsRef<str>>(&mut self, rows: &[(K, V)]) {
        self.body += "<dl>\n";
        for (key, value) in rows {
            self.body += &format!("<div><dt>{}</dt><dd>{}</dd></div>\n", escape(key.as_ref()), escape(value.as_ref()));
        }
        self.body += "</dl>\n";
    }

    /// Adds a table; the first cell of a row is its header. A table wider than the page scrolls by itself.
    pub fn table(&mut self, caption: &str, header: &[&str], rows: &[Vec<Cell>]) {
        self.tables += 1;
        let number = |column: usize| rows.first().is_some_and(|row| matches!(row.get(column), Some(Cell::Number(_))));
        // The caption is outside of what scrolls.
        self.body += &format!(
            "<div class=\"table\"><p class=\"caption\" id=\"t-{0}\">{1}</p>\n<div class=\"scroll\" role=\"region\" \
             tabindex=\"0\" aria-labelledby=\"t-{0}\"><table aria-labelledby=\"t-{0}\">\n<thead><tr>",
            self.tables,
            escape(caption)
        );
        for (column, title) in header.iter().enumerate() {
            let class = if number(column) { " class=\"number\"" } else { "" };
            // The unit stays on one line.
            let title = match title.rsplit_once(" / ") {
                Some((name, unit)) => format!("{} <span class=\"unit\">/ {}</span>", escape(name), escape(unit)),
                None => escape(title).into_owned(),
            };
            self.body += &format!("<th scope=\"col\"{class}>{title}</th>");
        }
        self.body += "</tr></thead>\n<tbody>\n";
        for row in rows {
            self.body += "<tr>";
            for column in 0..row.len().max(header.len()) {
                self.cell(row.get(column), column == 0);
            }
            self.body += "</tr>\n";
        }
        self.body += "</tbody></table></div></div>\n";
    }

    fn cell(&mut self, cell: Option<&Cell>, first: bool) {
        let (class, symbol, text) = match cell {
            None => ("", None, ""),
            Some(Cell::Text(text)) => ("", None, text.as_str()),
            Some(Cell::Number(text)) => ("number", None, text.as_str()),
            Some(Cell::Verdict(kind, text)) => (kind.parts().0, Some(kind.parts().1), text.as_str()),
        };
        let (start, end) = if first { ("th scope=\"row\"", "th") } else { ("td", "td") };
        let class = if class.is_empty() { String::new() } else { format!(" class=\"{class}\"") };
        let symbol =
            symbol.map_or(String::new(), |s| format!("<span class=\"symbol\" aria-hidden=\"true\">{s}</span> "));
        self.body += &format!("<{start}{class}>{symbol}{}</{end}>", escape(text));
    }

    /// Adds a figure. `svg` is markup of [`Plot::svg`](super::plot::Plot::svg), taken as it is.
    pub fn figure(&mut self, svg: &str, caption: &str) {
        let caption =
            if caption.is_empty() { String::new() } else { format!("<figcaption>{}</figcaption>", escape(caption)) };
        self.body += &format!("<figure>{svg}{caption}</figure>\n");
    }

    /// Adds figures, each with its caption, side by side as far as the width allows.
    pub fn figures<S: AsRef<str>, C: AsRef<str>>(&mut self, figures: &[(S, C)]) {
        self.body += "<div class=\"figures\">\n";
        for (svg, caption) in figures {
            self.figure(svg.as_ref(), caption.as_ref());
        }
        self.body += "</div>\n";
    }

    /// The document.
    #[must_use]
    pub fn finish(self) -> String {
        let title = escape(&self.title);
        let subtitle = match self.subtitle.as_str() {
            "" => String::new(),
            text => format!("<p class=\"subtitle\">{}</p>", escape(text)),
        };
        let mut contents = String::new();
        for (level, id, title) in &self.headings {
            contents += &format!("<li class=\"level{level}\"><a href=\"#{id}\">{}</a></li>\n", escape(title));
        }
        if !contents.is_empty() {
            contents = format!("<nav aria-label=\"Contents\"><p>Contents</p><ul>\n{contents}</ul></nav>\n");
        }
        let reload = self
            .reload_s
            .map_or(String::new(), |seconds| format!("<meta http-equiv=\"refresh\" content=\"{seconds}\">\n"));
        format!(
            "<!DOCTYPE html>\n<html lang=\"en\">\n<head>\n<meta charset=\"utf-8\">\n{reload}\
             <meta http-equiv=\"Content-Security-Policy\" content=\"default-src 'none'; style-src 'unsafe-inline'\">\n\
             <meta name=\"viewport\" content=\"width=device-width, initial-scale=1\">\n\
             <meta name=\"color-scheme\" content=\"light dark\">\n\
             <title>{title}</title>\n<style>\n{STYLE}</style>\n</head>\n<body>\n\
             <header><h1>{title}</h1>{subtitle}</header>\n{contents}<main>\n{}</main>\n</body>\n</html>\n",
            self.body
        )
    }
}

/// Text as content of an element or of a quoted attribute. Control characters, and those that reverse the direction of
/// the text after them, become a replacement character.
pub(super) fn escape(text: &str) -> Cow<'_, str> {
    let harmless = |c: char| !(hidden(c) || matches!(c, '&' | '<' | '>' | '"' | '\''));
    if text.chars().all(harmless) {
        return Cow::Borrowed(text);
    }
    let mut out = String::with_capacity(text.len() + 16);
    for c in text.chars() {
        match c {
            '&' => out.push_str("&amp;"),
            '<' => out.push_str("&lt;"),
            '>' => out.push_str("&gt;"),
            '"' => out.push_str("&quot;"),
            '\'' => out.push_str("&#39;"),
            c if hidden(c) => out.push(char::REPLACEMENT_CHARACTER),
            c => out.push(c),
        }
    }
    Cow::Owned(out)
}

fn hidden(c: char) -> bool {
    c.is_control() && !matches!(c, '\n' | '\t')
        || matches!(c, '\u{200e}' | '\u{200f}' | '\u{202a}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
        || matches!(c, '\u{fffe}' | '\u{ffff}')
}

#[cfg(test)]
pub(super) mod tests {
    use super::*;

    /// Fails unless every tag is closed in order and no text holds a bare `<`, `>` or `&`.
    pub(in crate::report) fn assert_well_formed(markup: &str) {
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
        page.figures(&[("<svg></svg>", text)]);
        page.finish()
    }

    #[test]
    fn hostile_text_stays_text() {
        assert_eq!(escape("<a href=\"b\">'&"), "&lt;a href=&quot;b&quot;&gt;&#39;&amp;");
        assert_eq!(escape("a\u{1b}b\u{202e}c\nd\te"), "a\u{fffd}b\u{fffd}c\nd\te");
        assert!(matches!(escape("Bias / 1e-6 g0, 25 °C"), Cow::Borrowed(_)));
        let page = filled(EVIL);
        assert_well_formed(&page);
        for bad in ["<script", "<img", "\u{0}", "\u{202e}"] {
            assert!(!page.contains(bad), "{bad:?}");
        }
        assert_eq!(page.matches('<').count(), filled("harmless").matches('<').count());
        assert_eq!(page.matches("&lt;script&gt;").count(), 20, "every text is there");
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
    }
}
