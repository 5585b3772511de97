//! Checks the language of the Markdown pages and of the documentation comments in Rust, which are the help texts, too.
//!
//! `cargo run --manifest-path tests/language/Cargo.toml [-- FILE...]` prints a line for everything that Harper finds,
//! and ends with 1 if there is anything. `words.txt` has the words that its dictionary lacks.

use harper_core::linting::{Lint, LintGroup, LintKind, Linter};
use harper_core::spell::{FstDictionary, MergedDictionary, MutableDictionary};
use harper_core::{Dialect, Document, WordMetadata};
use std::path::Path;
use std::process::{Command, ExitCode};
use std::sync::Arc;

const ROOT: &str = concat!(env!("CARGO_MANIFEST_DIR"), "/../..");

/// The words of the project, one per line.
const WORDS: &str = include_str!("../words.txt");

/// Rules that are off, because they find more here that is right than that is wrong.
const OFF: &[&str] = &[
    // Style that is settled otherwise: British lists have no comma before the last "and", text is ASCII where it can
    // be, units and stdin are written as the programs write them, and "and also" stresses.
    "AvoidAndAlso",
    "CondenseAllThe",
    "Dashes",
    "EllipsisLength",
    "ExpandMinimum",
    "ExpandStandardInput",
    "ExpandStandardOutput",
    "ExpandTimeShorthands",
    "OxfordComma",
    // A paragraph may begin with the name of an option or of a program.
    "SentenceCapitalization",
    // Derivations and lists of conditions.
    "LongSentences",
    // Symbols are taken for words: a and A for the article, i for the pronoun, s for an ending. Numbers with commas and
    // options with dashes are taken for sentences.
    "AnA",
    "CapitalizePersonalPronouns",
    "CommaFixes",
    "MergeWords",
    "Spaces",
    "UnclosedQuotes",
    // Words that also stand next to each other as two: over all rows, to and fro, any where, a new one after "it".
    "Anywhere",
    "CompoundNouns",
    "ForNoun",
    "Overall",
    "PhrasalVerbAsCompoundNoun",
    "PronounKnew",
    // Relative clauses and possessives without a noun, as in "samples of another device than the table's are refused".
    "AdjectiveOfA",
    "ForAWhile",
    "InflectedVerbAfterTo",
    "LetsConfusion",
    "Whereas",
];

/// Files that are not checked: the history of the project, and comments of tests.
const NOT_CHECKED: &[&str] = &["CHANGELOG.md", "/tests/", "tests.rs", "/benches/"];

/// A piece of prose and the number of its first line.
struct Passage {
    first: usize,
    text: String,
}

/// The prose of a file: a page is one passage; in Rust every block of documentation comments is one.
fn passages(name: &str, text: &str) -> Vec<Passage> {
    if name.ends_with(".md") {
        return vec![Passage { first: 1, text: text.to_owned() }];
    }
    let mut found: Vec<Passage> = Vec::new();
    let mut is_open = false;
    for (number, line) in (1..).zip(text.lines()) {
        let line = line.trim_start();
        let Some(words) = line.strip_prefix("///").or_else(|| line.strip_prefix("//!")) else {
            is_open = false;
            continue;
        };
        if !is_open {
            found.push(Passage { first: number, text: String::new() });
            is_open = true;
        }
        let passage = found.last_mut().expect("one is open");
        passage.text += words.strip_prefix(' ').unwrap_or(words);
        passage.text.push('\n');
    }
    found
}

/// Whether a word that the dictionary lacks is a name, a unit or a symbol: short, or with a digit, a sign or a capital
/// letter in it.
fn is_name(word: &str) -> bool {
    let word = word.trim_end_matches(['.', '\'']).trim_end_matches("'s");
    word.chars().count() < 3
        || word.chars().skip(1).any(|letter| letter.is_uppercase() || !letter.is_alphabetic() && letter != '\'')
}

fn main() -> ExitCode {
    let mut names: Vec<String> = std::env::args().skip(1).collect();
    if names.is_empty() {
        let listed = Command::new("git").args(["-C", ROOT, "ls-files", "*.md", "*.rs"]).output().expect("git runs");
        names = String::from_utf8_lossy(&listed.stdout).lines().map(str::to_owned).collect();
        names.retain(|name| !NOT_CHECKED.iter().any(|part| format!("/{name}").contains(part)));
    }
    let mut own = MutableDictionary::new();
    for word in WORDS.lines().filter(|line| !line.is_empty()) {
        own.append_word_str(word, WordMetadata::default());
    }
    let mut dictionary = MergedDictionary::new();
    dictionary.add_dictionary(FstDictionary::curated());
    dictionary.add_dictionary(Arc::new(own));
    let dictionary = Arc::new(dictionary);
    let mut linter = LintGroup::new_curated(dictionary.clone(), Dialect::British);
    for rule in OFF {
        linter.config.set_rule_enabled(*rule, false);
    }
    let mut count = 0;
    for name in names {
        let Ok(text) = std::fs::read_to_string(Path::new(ROOT).join(&name)) else { continue };
        for passage in passages(&name, &text) {
            let document = Document::new_markdown_default(&passage.text, &dictionary);
            let source = document.get_source();
            let words = |lint: &Lint| source[lint.span.start..lint.span.end].iter().collect::<String>();
            let is_wrong = |lint: &Lint| lint.lint_kind != LintKind::Spelling || !is_name(&words(lint));
            for lint in linter.lint(&document).iter().filter(|lint| is_wrong(lint)) {
                let line = passage.first + source[..lint.span.start].iter().filter(|letter| **letter == '\n').count();
                println!("{name}:{line}: \"{}\": {}", words(lint).replace('\n', " "), lint.message);
                count += 1;
            }
        }
    }
    eprintln!("{count} places");
    if count == 0 { ExitCode::SUCCESS } else { ExitCode::FAILURE }
}
