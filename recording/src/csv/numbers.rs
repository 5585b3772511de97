//! Numbers as programs of several countries write them: what separates the columns, and the decimal mark.

use std::borrow::Cow;

/// What separates the fields of a row.
#[derive(Clone, Copy, Debug, Default, Eq, PartialEq)]
pub enum Separator {
    /// `,`
    #[default]
    Comma,
    /// `;`
    Semicolon,
    /// A tab.
    Tab,
    /// Any number of spaces and tabs, also before the first and after the last field.
    Spaces,
}

impl Separator {
    /// Every separator, in the order in which they are tried.
    pub const ALL: [Self; 4] = [Self::Comma, Self::Semicolon, Self::Tab, Self::Spaces];

    /// Its name, for messages.
    #[must_use]
    pub const fn name(self) -> &'static str {
        match self {
            Self::Comma => "commas",
            Self::Semicolon => "semicolons",
            Self::Tab => "tabs",
            Self::Spaces => "spaces",
        }
    }

    pub(super) const fn byte(self) -> u8 {
        match self {
            Self::Comma => b',',
            Self::Semicolon => b';',
            Self::Tab => b'\t',
            Self::Spaces => b' ',
        }
    }
}

/// The decimal mark of the numbers of a text, as found out number by number: a point, or a comma where no comma
/// separates the columns or the number is in quotation marks.
///
/// A comma before exactly three digits may be a thousands separator too: "1,234" is 1.234 or 1234. Where semicolons
/// separate the columns it is taken for the decimal mark, for which they are there. Elsewhere another number must show
/// it, such as "1,5".
#[derive(Clone, Debug)]
pub struct DecimalMark {
    separator: Separator,
    /// The first line with a decimal point, and the first with a comma.
    point: Option<u64>,
    comma: Option<u64>,
    /// The first number with a comma, while none has shown yet that it is the decimal mark.
    unclear: Option<(u64, String)>,
    clear: bool,
}

impl DecimalMark {
    /// The mark of a text whose columns are separated by `separator`; nothing is known of it yet.
    #[must_use]
    pub const fn new(separator: Separator) -> Self {
        Self { separator, point: None, comma: None, unclear: None, clear: matches!(separator, Separator::Semicolon) }
    }

    /// What separates the columns.
    #[must_use]
    pub const fn separator(&self) -> Separator {
        self.separator
    }

    /// A number of this line, with a decimal point in any case.
    ///
    /// # Errors
    /// If the number has several marks, or if decimal points and commas are mixed; the text says what to give.
    pub fn with_point<'a>(&mut self, line: u64, number: &'a str) -> Result<Cow<'a, str>, String> {
        let Some((whole, decimals)) = number.split_once(',') else {
            if number.contains('.') {
                if let Some(comma) = self.comma {
                    return Err(mixed("comma", comma));
                }
                self.point.get_or_insert(line);
            }
            return Ok(Cow::Borrowed(number));
        };
        if decimals.contains([',', '.']) || whole.contains('.') {
            return Err("a number without thousands separators".to_owned());
        }
        if let Some(point) = self.point {
            return Err(mixed("point", point));
        }
        self.comma.get_or_insert(line);
        if may_be_thousands(whole, decimals) {
            if !self.clear && self.unclear.is_none() {
                self.unclear = Some((line, number.to_owned()));
            }
        } else {
            self.clear = true;
        }
        Ok(Cow::Owned(format!("{whole}.{decimals}")))
    }

    /// Whether there were decimal commas, after the last number.
    ///
    /// # Errors
    /// If every comma may be a thousands separator, with the first line that has one.
    pub fn has_commas(&self) -> Result<bool, (u64, String)> {
        match &self.unclear {
            Some((line, number)) if !self.clear => {
                let thousands = number.replace(',', "");
                let point = number.replace(',', ".");
                Err((
                    *line,
                    format!(
                        "{number} is {point} or {thousands}: every comma in these numbers stands before three digits, as a \
                         thousands separator does; write decimal points, or separate the columns with semicolons: then it is \
                         the decimal mark"
                    ),
                ))
            }
            _ => Ok(self.comma.is_some()),
        }
    }
}

/// Whether a field can be a number, with any decimal mark.
#[must_use]
pub fn looks_like_number(field: &str) -> bool {
    field.replacen(',', ".", 1).parse::<f64>().is_ok()
}

fn mixed(mark: &str, line: u64) -> String {
    format!("a number with a decimal {mark} as in line {line}, or the other decimal mark throughout")
}

/// Whether `whole,decimals` can be a whole number with a thousands separator.
fn may_be_thousands(whole: &str, decimals: &str) -> bool {
    let whole = whole.trim_start_matches(['-', '+']);
    let all_digits = |text: &str| text.bytes().all(|byte| byte.is_ascii_digit());
    (1..=3).contains(&whole.len())
        && !whole.starts_with('0')
        && decimals.len() == 3
        && all_digits(whole)
        && all_digits(decimals)
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The numbers with points, or the message; then whether there are decimal commas, or the line and message.
    fn read(separator: Separator, numbers: &[&str]) -> Result<(Vec<String>, bool), String> {
        let mut mark = DecimalMark::new(separator);
        let read = |(line, number): (u64, &&str)| mark.with_point(line, number).map(Cow::into_owned);
        let numbers = (2..).zip(numbers).map(read).collect::<Result<Vec<_>, _>>()?;
        mark.has_commas().map(|has| (numbers, has)).map_err(|(line, message)| format!("{line}: {message}"))
    }

    #[test]
    fn a_comma_is_the_decimal_mark_where_a_number_shows_it() {
        let clear =
            [&["1,5", "-2,25", "3"][..], &["0,123"], &["1,234", "-1,2345"], &["1,234E-3"], &["1234,567"], &[",250"]];
        for numbers in clear {
            let points: Vec<_> = numbers.iter().map(|number| number.replace(',', ".")).collect();
            for separator in [Separator::Comma, Separator::Tab, Separator::Spaces, Separator::Semicolon] {
                assert_eq!(read(separator, numbers), Ok((points.clone(), true)), "{separator:?}");
            }
        }
        let points = ["1.5", "-2.25E-3", "NaN", "7"];
        assert_eq!(read(Separator::Tab, &points), Ok((points.map(str::to_owned).to_vec(), false)));
    }

    #[test]
    fn commas_that_may_be_thousands_separators_are_refused() {
        for separator in [Separator::Comma, Separator::Tab, Separator::Spaces] {
            let message = read(separator, &["7", "1,234", "-12,000"]).unwrap_err();
            assert!(message.starts_with("3: 1,234 is 1.234 or 1234: "), "{message}");
        }
        assert_eq!(read(Separator::Semicolon, &["1,234"]), Ok((vec!["1.234".to_owned()], true)));
        for number in ["1,234,567", "1.234,5", "1,234.5"] {
            assert_eq!(read(Separator::Semicolon, &[number]).unwrap_err(), "a number without thousands separators");
        }
    }

    #[test]
    fn two_decimal_marks_in_a_text_are_refused() {
        for (numbers, right) in [(["1,5", "2.5"], "comma"), (["1.5", "2,5"], "point")] {
            let message = read(Separator::Semicolon, &numbers).unwrap_err();
            assert!(message.contains(&format!("decimal {right} as in line 2")), "{message}");
        }
    }
}
