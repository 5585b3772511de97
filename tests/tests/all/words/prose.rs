//! Words and phrases that the prose of Isotherm does without: in the Markdown pages, in comments, and in the texts that
//! the programs print. What stands between back quotes, in code blocks and in the strings of tests is not prose.

use super::files;

/// A word that is not used, and what is used in its place.
const WORDS: &[(&str, &str)] = &[
    ("tell", "report, print, show or distinguish"),
    ("tells", "reports, prints, shows or distinguishes"),
    ("told", "reported, printed, shown or distinguished"),
    ("telling", "reporting, printing, showing or distinguishing"),
    ("alone", "only, or by itself"),
    ("beside", "next to, in addition to or compared with"),
    ("besides", "also, in addition to or apart from"),
    ("mend", "fix or correct"),
    ("mending", "fixing or correcting"),
];

/// `else` behind one of these ends a clause as it does in any English text.
const BEFORE_ELSE: &[&str] = &[
    "nothing",
    "something",
    "anything",
    "everything",
    "nobody",
    "anybody",
    "everybody",
    "one",
    "what",
    "who",
    "where",
];

/// Words behind a fronted "Of", as in "Of several IMUs, the first is read".
const BEHIND_OF: &[&str] = &["several", "two", "three", "another", "those"];

/// Units that are written in ASCII only by programs and in files, with what a page writes.
const UNITS: &[(&str, &str)] = &[("ug0", "µg"), ("mg0", "mg")];

/// Consecutive lines of prose as one text, and the number of the first. A line feed stands between lines.
struct Paragraph {
    first: usize,
    text: String,
    /// A text of a program: it may have two points between numbers, or in an example.
    is_string: bool,
}

/// Collects lines into paragraphs.
#[derive(Default)]
struct Paragraphs {
    found: Vec<Paragraph>,
    is_open: bool,
    is_code: bool,
}

impl Paragraphs {
    /// A line of Markdown, also one of a comment.
    fn add(&mut self, number: usize, line: &str) {
        let words = line.trim();
        if words.starts_with("```") {
            self.is_code = !self.is_code;
            self.is_open = false;
            return;
        }
        if self.is_code || words.is_empty() || line.starts_with("    ") {
            self.is_open = false;
            return;
        }
        let begins = ["|", "#", "- ", "* ", "> "].iter().any(|mark| words.starts_with(mark));
        match self.found.last_mut().filter(|_| self.is_open && !begins) {
            Some(paragraph) => {
                paragraph.text.push('\n');
                paragraph.text += words;
            }
            None => self.found.push(Paragraph { first: number, text: words.to_owned(), is_string: false }),
        }
        self.is_open = !words.starts_with(['|', '#']);
    }

    /// The next line is not of this paragraph.
    fn close(&mut self) {
        (self.is_open, self.is_code) = (false, false);
    }
}

/// Comment lines that begin with one of the marks.
fn comments(text: &str, marks: &[&str]) -> Vec<Paragraph> {
    let mut paragraphs = Paragraphs::default();
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim_start();
        match marks.iter().find_map(|mark| line.strip_prefix(mark)) {
            Some(words) => paragraphs.add(number, words.strip_prefix(' ').unwrap_or(words)),
            None => paragraphs.close(),
        }
    }
    paragraphs.found
}

/// The string literals of a Rust file that have words, each a paragraph.
fn strings(text: &str) -> Vec<Paragraph> {
    let mut found = Vec::new();
    let (mut rest, mut line) = (text, 1);
    let mut before = ' ';
    while let Some(letter) = rest.chars().next() {
        let skipped = if rest.starts_with("//") {
            rest.find('\n').unwrap_or(rest.len())
        } else if letter == '\'' {
            // A character, or the begin of a lifetime.
            let end = if rest[1..].starts_with('\\') { rest[3..].find('\'').map(|end| end + 4) } else { None };
            end.unwrap_or_else(|| {
                rest.char_indices().nth(2).filter(|(_, end)| *end == '\'').map_or(1, |(at, _)| at + 1)
            })
        } else if letter == 'r' && !before.is_alphanumeric() && rest[1..].trim_start_matches('#').starts_with('"') {
            let marks = rest[1..].find('"').unwrap_or(0);
            let end = format!("\"{}", "#".repeat(marks));
            rest[marks + 2..].find(&end).map_or(rest.len(), |at| marks + 2 + at + end.len())
        } else if letter == '"' {
            let mut is_escaped = false;
            let ends = |(_, letter): &(usize, char)| {
                let ends = *letter == '"' && !is_escaped;
                is_escaped = *letter == '\\' && !is_escaped;
                ends
            };
            let end = rest[1..].char_indices().find(ends).map_or(rest.len(), |(at, _)| at + 1);
            let words = rest.get(1..end).unwrap_or_default();
            if words.matches(' ').count() > 1 {
                let lines: Vec<_> = words.lines().map(|line| line.trim().trim_end_matches('\\')).collect();
                found.push(Paragraph { first: line, text: lines.join("\n").replace("\\n", "\n"), is_string: true });
            }
            end + 1
        } else {
            letter.len_utf8()
        };
        let (done, left) = rest.split_at(skipped.min(rest.len()));
        line += done.matches('\n').count();
        before = letter;
        rest = left;
    }
    found
}

/// The prose of a file.
fn prose(name: &str, text: &str) -> Vec<Paragraph> {
    let is_test = name.split('/').any(|part| ["tests", "benches", "tests.rs"].contains(&part));
    match name.rsplit('.').next() {
        Some("md") => {
            let mut paragraphs = Paragraphs::default();
            (1..).zip(text.lines()).for_each(|(number, line)| paragraphs.add(number, line));
            paragraphs.found
        }
        Some("rs") => {
            let mut found = comments(text, &["///", "//!", "//"]);
            if !is_test {
                found.extend(strings(text));
            }
            found
        }
        Some("toml" | "py" | "yaml") => comments(text, &["#"]),
        _ => Vec::new(),
    }
}

/// The text with a low line in place of every letter between back quotes.
fn without_code(text: &str) -> String {
    let mut is_code = false;
    let blank = |letter: char| {
        is_code ^= letter == '`';
        if is_code && letter != '\n' { '_' } else { letter }
    };
    text.chars().map(blank).collect()
}

/// What is wrong with a paragraph: the place in it, and why.
fn faults(text: &str, is_page: bool) -> Vec<(usize, String)> {
    let mut found = Vec::new();
    let is_part = |letter: char| letter.is_alphanumeric() || "_-'".contains(letter);
    let mut before = String::new();
    let mut end_before = 0;
    let mut at = 0;
    while let Some(start) = text[at..].find(is_part).map(|start| at + start) {
        let end = text[start..].find(|letter| !is_part(letter)).map_or(text.len(), |end| start + end);
        let word = text[start..end].to_lowercase();
        let between = text[end_before..start].trim();
        let next = text[end..].trim_start_matches('`').trim_start();
        let begins =
            before.is_empty() || between.ends_with(['.', ';', ':', ',', '(']) || ["and", "or"].contains(&&*before);
        let is_cut = text[end..].starts_with(['.', ';', ':', ',', ')']) || text[end..].trim().is_empty();
        let mut add = |why: &str| found.push((start, format!("{word}: {why}")));
        if let Some((_, right)) = WORDS.iter().find(|(wrong, _)| *wrong == word) {
            add(&format!("{right} is right"));
        }
        if word == "else" && (begins || is_cut) && !BEFORE_ELSE.iter().any(|word| before.ends_with(word)) {
            add("a clause has otherwise");
        }
        if word == "who" && before == "for" {
            add("for those who, or another beginning");
        }
        if text[start..].starts_with("Of ") {
            let behind = next.split(|letter| !is_part(letter)).next().unwrap_or_default();
            let ends_sentence = between.ends_with('.') && !between.ends_with("..");
            if ends_sentence && behind != "course" || before.is_empty() && BEHIND_OF.contains(&behind) {
                add("a sentence begins with its subject or with if");
            }
        }
        if let Some((_, right)) = UNITS.iter().find(|(wrong, _)| is_page && *wrong == word) {
            add(&format!("a page has {right}"));
        }
        (before, end_before, at) = (word, end, end);
    }
    found
}

/// Two points that leave something out, or stand between two numbers.
fn points(text: &str) -> Vec<(usize, String)> {
    let is_wrong = |at: &usize| {
        let (before, behind) = (text[..*at].chars().next_back(), text[at + 2..].chars().next());
        let is_near = |letter: Option<char>, others: &str| letter.is_some_and(|letter| others.contains(letter));
        let is_apart = |letter: Option<char>| letter.is_none_or(char::is_whitespace);
        !is_near(before, ".") && !is_near(behind, "./=_") && (is_apart(before) || is_apart(behind))
    };
    let places = text.match_indices("..").map(|(at, _)| at).filter(is_wrong);
    places.map(|at| (at, "..: … or another sentence".to_owned())).collect()
}

/// The words at which a line of Markdown is wrong.
fn wrong(line: &str) -> Vec<String> {
    let plain = without_code(line);
    let found = faults(&plain, true).into_iter().chain(points(&plain));
    found.map(|(_, why)| why.split(": ").next().unwrap().to_owned()).collect()
}

#[test]
fn what_is_wrong_is_found_and_what_is_right_is_not() {
    for (line, words) in [
        ("No flag tells it, and `tell` is a function; `--beside` alone is an option.", vec!["tells", "alone"]),
        ("Nothing else is read. If set, else 5. It is 1, else 0.", vec!["else", "else"]),
        ("Of several IMUs the first is read. Of course it is. Of a log, one.", vec!["of", "of"]),
        ("For who reads it: 20 ug0, `20ug0`, 0 .. 5 V, `0..5`, tests/../lib.rs, a ..", vec!["who", "ug0", "..", ".."]),
        ("The option beside-leaves-less and a stand-alone program are names, and something else.", vec![]),
    ] {
        assert_eq!(wrong(line), words, "{line}");
    }
    let code =
        "let a = '\"'; // \" a comment\nlet b = r#\"raw \"one two three\"\"#; let c = \"is told \\\n    at once\";";
    let found = strings(code);
    assert_eq!(found.len(), 1, "{}", found.len());
    assert_eq!((found[0].first, &*found[0].text), (2, "is told \nat once"));
}

#[test]
fn prose_is_natural_english() {
    let mut found = Vec::new();
    let mut count = 0;
    for (name, text) in files() {
        let is_page = name.ends_with(".md");
        for paragraph in prose(&name, &text) {
            count += 1;
            let plain = without_code(&paragraph.text);
            let mut all = faults(&plain, is_page);
            if !paragraph.is_string {
                all.extend(points(&plain));
            }
            for (at, why) in all {
                let line = paragraph.first + plain[..at].matches('\n').count();
                let near: String = plain[at..].chars().take(50).collect();
                found.push(format!("{name}:{line}: {why}: {}", near.replace('\n', " ")));
            }
        }
    }
    assert!(count > 10_000, "{count}");
    assert!(found.is_empty(), "{} places\n{}", found.len(), found.join("\n"));
}
