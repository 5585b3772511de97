//! The pattern that the names of files have in common, with set point and position in each.

use isotherm_campaign::{POSITION, SET_POINT};
use std::collections::BTreeMap;

/// A name: what stands between its numbers, and the numbers.
#[derive(Clone, Debug, PartialEq)]
struct Name {
    words: Vec<String>,
    numbers: Vec<String>,
}

/// What names have in common.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct NamePattern {
    pub pattern: String,
    /// What was guessed, or nothing.
    pub guess: Option<&'static str>,
    /// Names that do not fit it.
    pub others: Vec<String>,
}

/// Words before a set point, and before a position.
const OF_SET_POINT: [&str; 9] = ["t", "temp", "temperature", "temperatur", "c", "degc", "sp", "set", "tset"];
const OF_POSITION: [&str; 9] = ["p", "pos", "position", "att", "attitude", "n", "nr", "lage", "pose"];

impl NamePattern {
    /// The pattern of most names.
    ///
    /// # Errors
    /// Why there is none.
    pub(super) fn of(names: &[String]) -> Result<Self, String> {
        let mut groups: BTreeMap<Vec<String>, Vec<(usize, Name)>> = BTreeMap::new();
        for (index, name) in names.iter().enumerate() {
            let read = read(name);
            groups.entry(read.words.clone()).or_default().push((index, read));
        }
        let (words, group) = groups.into_iter().max_by_key(|(_, group)| group.len()).ok_or("there are no files")?;
        let slots = 0..words.len() - 1;
        let values = |slot: usize| -> Vec<f64> {
            let mut values: Vec<f64> = group.iter().map(|(_, name)| value(&name.numbers[slot])).collect();
            values.sort_by(f64::total_cmp);
            values.dedup();
            values
        };
        let varying: Vec<usize> = slots.filter(|slot| values(*slot).len() > 1).collect();
        let &[first, second] = varying.as_slice() else {
            return Err(format!(
                "{} files have names as {}, in which {} numbers vary; two are wanted, the set point and the \
                 position, as in T-20_P03.csv",
                group.len(),
                names[group[0].0],
                varying.len()
            ));
        };
        let (set_point, guess) = set_point(&words, [first, second], &values, &group);
        let mut pattern = words[0].clone();
        for slot in 0..words.len() - 1 {
            pattern += match slot {
                _ if slot == set_point => SET_POINT,
                _ if slot == first || slot == second => POSITION,
                _ => &group[0].1.numbers[slot],
            };
            pattern += &words[slot + 1];
        }
        let fitting: Vec<usize> = group.iter().map(|(index, _)| *index).collect();
        let others = (0..names.len()).filter(|index| !fitting.contains(index)).map(|index| names[index].clone());
        Ok(Self { pattern, guess, others: others.collect() })
    }
}

/// Which of two numbers is the set point, and whether that is a guess.
fn set_point(
    words: &[String],
    [first, second]: [usize; 2],
    values: &dyn Fn(usize) -> Vec<f64>,
    group: &[(usize, Name)],
) -> (usize, Option<&'static str>) {
    let word = |slot: usize| {
        let letters: Vec<char> = words[slot].chars().rev().take_while(|letter| letter.is_alphabetic()).collect();
        letters.into_iter().rev().collect::<String>().to_lowercase()
    };
    let [of_first, of_second] = [word(first), word(second)];
    let is = |words: &[&str], word: &str| words.contains(&word);
    if is(&OF_SET_POINT, &of_first) && !is(&OF_SET_POINT, &of_second) || is(&OF_POSITION, &of_second) {
        return (first, None);
    }
    if is(&OF_SET_POINT, &of_second) || is(&OF_POSITION, &of_first) {
        return (second, None);
    }
    let is_plain =
        |slot: usize| group.iter().all(|(_, name)| name.numbers[slot].bytes().all(|byte| byte.is_ascii_digit()));
    let counts = |slot: usize| {
        let values = values(slot);
        values[0] <= 1.0 && values.windows(2).all(|pair| pair[1] - pair[0] == 1.0)
    };
    // The number of a position has no sign, and no decimals.
    let may_count = match [first, second].map(is_plain) {
        [true, true] => [first, second].map(counts),
        plain => plain,
    };
    match may_count.into() {
        (false, true) => (first, None),
        (true, false) => (second, None),
        _ => (first, Some("which number is the set point is a guess: exchange the two if it is not")),
    }
}

fn value(number: &str) -> f64 {
    number.replace('\u{2212}', "-").replace(',', ".").parse().unwrap_or(f64::NAN)
}

/// The numbers of a name. A sign belongs to a number unless a digit or a letter that is no unit is by itself before it.
fn read(name: &str) -> Name {
    let letters: Vec<char> = name.chars().collect();
    let (mut words, mut numbers) = (vec![String::new()], Vec::new());
    let is_digit = |at: usize| letters.get(at).is_some_and(char::is_ascii_digit);
    let mut at = 0;
    while at < letters.len() {
        let is_sign =
            ['+', '-', '\u{2212}'].contains(&letters[at]) && is_digit(at + 1) && (at == 0 || !is_digit(at - 1));
        if !is_digit(at) && !is_sign {
            words.last_mut().into_iter().for_each(|word| word.push(letters[at]));
            at += 1;
            continue;
        }
        let begin = at;
        at += 1;
        while is_digit(at) {
            at += 1;
        }
        if letters.get(at).is_some_and(|mark| ['.', ','].contains(mark)) && is_digit(at + 1) {
            at += 1;
            while is_digit(at) {
                at += 1;
            }
        }
        numbers.push(letters[begin..at].iter().collect());
        words.push(String::new());
    }
    Name { words, numbers }
}

#[cfg(test)]
mod tests {
    use super::NamePattern;

    fn pattern(names: &[&str]) -> Result<String, String> {
        NamePattern::of(&names.iter().map(|name| (*name).to_owned()).collect::<Vec<_>>()).map(|names| names.pattern)
    }

    #[test]
    fn the_pattern_of_names_is_found() {
        for (names, expected) in [
            (&["T-20_P03.csv", "T-20_P12.csv", "T+45_P03.csv"][..], "T{set_point_c}_P{position}.csv"),
            (&["pos3/T20.csv", "pos3/T22,5.csv", "pos4/T20.csv"], "pos{position}/T{set_point_c}.csv"),
            (&["run7_3_-20.csv", "run7_4_-20.csv", "run7_3_60.csv"], "run7_{position}_{set_point_c}.csv"),
            (&["readme.txt", "a_60_1.dat", "a_20_1.dat", "a_60_2.dat"], "a_{set_point_c}_{position}.dat"),
        ] {
            assert_eq!(pattern(names).as_deref(), Ok(expected));
        }
        assert!(pattern(&["P1.csv", "P2.csv"]).unwrap_err().contains("1 numbers vary"));
        assert!(pattern(&["T20_P1_5.csv", "T30_P2_6.csv"]).unwrap_err().contains("3 numbers vary"));
    }
}
