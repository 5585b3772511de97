//! `explain`: meaning and remedy of every name that the program prints; as a page, all findings.

use clap::{Args, ValueEnum};
use isotherm_command::explain::{Explain, Topic, topics, wrap};
use isotherm_files::print_data;
use isotherm_support::failure::Failure;
use isotherm_support::finding::name::{Explanation, Rank, SUBJECTS, explanations};

/// Columns of a page.
const PAGE_WIDTH: usize = 118;

/// Explain a name that the program prints
///
/// Explains a finding, a flag, a metric, a field of the status, an exit code or a state of `top`.
///
/// Without a name, all names are listed.
#[derive(Debug, Args)]
#[command(after_help = "Examples:
  isotherm explain
  isotherm explain position-off
  isotherm explain late
  isotherm explain --markdown findings > docs/findings.md")]
pub struct ExplainName {
    #[command(flatten)]
    names: Explain,
    /// Print a page of the documentation
    #[arg(long, value_name = "PAGE", conflicts_with = "name")]
    markdown: Option<Page>,
}

/// A page that is printed.
#[derive(Clone, Copy, Debug, ValueEnum)]
enum Page {
    Findings,
}

impl ExplainName {
    pub(crate) fn run(self, others: Vec<Topic>) -> Result<(), Failure> {
        if let Some(Page::Findings) = self.markdown {
            return print_data(&findings_page());
        }
        let finding = |Explanation { name, rank, meaning, remedy }: &Explanation| {
            Topic::new("finding", *name, rank.words().to_owned(), meaning, remedy)
        };
        let all: Vec<_> = explanations().map(finding).chain(topics()).chain(others).collect();
        self.names.run(&all)
    }
}

fn findings_page() -> String {
    let paragraph = |text: &str| wrap(text, PAGE_WIDTH, "", "");
    let mut page = "# Findings\n\n".to_owned();
    page += &paragraph(
        "`calibrate` and an automatic campaign refuse data with the faults on this page. These commands, `verify`, \
         `noise`, `compare` and `convert` also print the warnings. `isotherm explain NAME` prints one entry; \
         `isotherm explain --markdown findings` prints this page.",
    );
    page.push('\n');
    page += &paragraph(
        "A **fault** is a value that valid data cannot have. With one fault no table is made, and the exit code is \
         65. Anything merely unusual is a **warning**. `--accept NAME,NAME` makes the table in spite of faults: they \
         are then warnings, and the provenance lists their names. `--strict` makes every warning a fault. The other \
         commands also have both options. A fault with * leaves nothing to fit and cannot be accepted. At most ten \
         lines are printed, faults before warnings; `-v` prints all.",
    );
    for subject in SUBJECTS {
        page += &format!("\n## {}\n\n", subject.title);
        if !subject.introduction.is_empty() {
            page += &paragraph(subject.introduction);
            page.push('\n');
        }
        for Explanation { name, rank, meaning, remedy } in subject.names {
            let rank = if *rank == Rank::Final { " *, fault".to_owned() } else { format!(", {}", rank.words()) };
            let text = format!("`{name}`{rank}. {meaning} **{remedy}**", meaning = meaning.trim());
            page += &wrap(&linked(&text), PAGE_WIDTH, "- ", "  ");
        }
    }
    page
}

/// The text with links to other pages in place of their paths.
fn linked(text: &str) -> String {
    let link = |word: &str| {
        let Some(path) = word.strip_prefix("docs/") else { return word.to_owned() };
        let end = path.find(".md").map_or(path.len(), |end| end + 3);
        let page = path.trim_end_matches(['.', '*']);
        format!("[{}]({page}){}", &path[..end], &path[page.len()..])
    };
    text.split(' ').map(link).collect::<Vec<_>>().join(" ")
}
