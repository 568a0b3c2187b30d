//! Reads the numbers in file names, and groups them into the lines of a grid.

use std::collections::BTreeMap;

/// A number as it is in a name.
#[derive(Debug, Clone, PartialEq)]
pub(crate) struct Number {
    pub value: f64,
    /// Digits before the decimal point, without the sign.
    pub digits: usize,
    /// True if a plus sign precedes it.
    pub plus: bool,
    /// True if it has no decimal point.
    pub whole: bool,
    /// Byte range of the number in the name.
    pub place: std::ops::Range<usize>,
}

/// A file name, split into its numbers and the text around them.
#[derive(Debug, Clone)]
pub(crate) struct Name<'a> {
    pub name: &'a str,
    /// The texts around the numbers, one more than there are numbers.
    pub texts: Vec<String>,
    pub numbers: Vec<Number>,
    /// The file extension in lower case.
    pub end: String,
}

/// Names with more numbers than this are not views.
const NUMBERS: usize = 12;

impl<'a> Name<'a> {
    /// Reads the numbers of a name, which are runs of digits. If `signed` is true, a number may have a decimal point
    /// between digits, and a sign that does not follow a digit. The sign may follow a letter only if the number has a
    /// decimal point. Returns `None` if there is no number, or if one is too long.
    pub fn read(name: &'a str, signed: bool) -> Option<Self> {
        let (stem, end) = name.rsplit_once('.')?;
        let bytes = stem.as_bytes();
        let digit = |i: usize| bytes.get(i).is_some_and(u8::is_ascii_digit);
        let behind_digits = |i: usize| (i..).find(|i| !digit(*i)).unwrap_or(i);
        let (mut texts, mut numbers, mut start, mut i) = (Vec::new(), Vec::new(), 0, 0);
        while i < bytes.len() {
            let alone = i == 0 || !(bytes[i - 1].is_ascii_alphanumeric() || bytes[i - 1] >= 0x80);
            let after = behind_digits(i + 1);
            // A sign follows a letter only before a number with a decimal point: view-3 is 3, y-4.5 is -4.5.
            let decimal = bytes.get(after) == Some(&b'.') && digit(after + 1) && i > 0 && !digit(i - 1);
            let sign = signed && matches!(bytes[i], b'-' | b'+') && digit(i + 1) && (alone || decimal);
            if !sign && !digit(i) {
                i += 1;
                continue;
            }
            let from = i;
            i = behind_digits(i + usize::from(sign));
            let digits = i - from - usize::from(sign);
            let point = signed && bytes.get(i) == Some(&b'.') && digit(i + 1);
            if point {
                i = behind_digits(i + 1);
            }
            // Above this number of digits, float64 does not distinguish whole numbers.
            if digits > 15 || numbers.len() == NUMBERS {
                return None;
            }
            texts.push(stem[start..from].to_owned());
            numbers.push(Number {
                value: stem[from..i].parse().ok()?,
                digits,
                plus: bytes[from] == b'+',
                whole: !point,
                place: from..i,
            });
            start = i;
        }
        texts.push(stem[start..].to_owned());
        (!numbers.is_empty()).then(|| Self { name, texts, numbers, end: end.to_ascii_lowercase() })
    }

    /// Returns true if the numbers of both names are all equal.
    pub fn same(&self, other: &Self) -> bool {
        self.numbers.iter().zip(&other.numbers).all(|(a, b)| a.value == b.value)
    }

    /// Returns a pattern for the names that have the same number `k`, with any values of the other numbers that are
    /// `changing`.
    pub fn with_same(&self, k: usize, changing: &[usize]) -> String {
        let mut pattern = String::new();
        for (i, number) in self.numbers[..=k].iter().enumerate() {
            pattern += &self.texts[i];
            pattern += if i < k && changing.contains(&i) { "*" } else { &self.name[number.place.clone()] };
        }
        let is_last = k + 1 == self.numbers.len();
        pattern + &self.name[self.numbers[k].place.end..][..self.texts[k + 1].len()] + if is_last { ".*" } else { "*" }
    }

    /// Returns the name with these values for these numbers, written in the format of `family`. Other numbers that
    /// change become a star.
    pub fn with(&self, fields: &[usize], values: &[f64], family: &[Name]) -> String {
        let mut name = self.texts[0].clone();
        for (k, number) in self.numbers.iter().enumerate() {
            let digits = family.iter().map(|n| n.numbers[k].digits).min().unwrap_or(1);
            match fields.iter().position(|f| *f == k) {
                Some(i) if values[i] < 0.0 => name += &format!("-{:0digits$}", -values[i]),
                Some(i) => {
                    let plus = if family.iter().any(|n| n.numbers[k].plus) { "+" } else { "" };
                    name += &format!("{plus}{:0digits$}", values[i]);
                }
                None if family.iter().any(|n| n.numbers[k].value != number.value) => name.push('*'),
                None => name += &format!("{:0width$}", number.value, width = number.digits),
            }
            name += &self.texts[k + 1];
        }
        format!("{name}.{}", self.name.rsplit_once('.').map_or("", |(_, end)| end))
    }
}

/// Treats a minus or plus between a letter and a number as its sign if other names have another sign or none in that
/// place. Next to x10, x-20 is -20. If every name has the same character, it separates.
pub(crate) fn take_signs(names: &mut [Name]) {
    const SIGNS: [char; 2] = ['-', '+'];
    let is_after_letter = |text: &str| text.strip_suffix(SIGNS).is_some_and(|rest| rest.ends_with(char::is_alphabetic));
    let bare = |text: &String| if is_after_letter(text) { text[..text.len() - 1].to_owned() } else { text.clone() };
    let mut alike: BTreeMap<Vec<String>, Vec<usize>> = BTreeMap::new();
    for (i, name) in names.iter().enumerate() {
        alike.entry(name.texts.iter().map(bare).collect()).or_default().push(i);
    }
    for (texts, group) in alike {
        for slot in 0..texts.len() - 1 {
            let sign =
                |i: &usize| names[*i].texts[slot].chars().last().filter(|_| is_after_letter(&names[*i].texts[slot]));
            let first = sign(&group[0]);
            if group.iter().all(|i| sign(i) == first) {
                continue;
            }
            for &i in &group {
                let Name { texts, numbers, .. } = &mut names[i];
                let number = &mut numbers[slot];
                if is_after_letter(&texts[slot]) {
                    number.plus = texts[slot].pop() == Some('+');
                    number.value = if number.plus { number.value } else { -number.value };
                    number.place.start -= 1;
                }
            }
        }
    }
}

/// Returns true if the words before two numbers show that the first is the column: x and y, c and r, column and row, u
/// and v, s and t.
pub(crate) fn is_column_first(name: &Name, first: usize, second: usize) -> bool {
    let word = |k: usize| {
        let text = name.texts[k].trim_end_matches(|c: char| !c.is_alphabetic()).to_lowercase();
        let start = text.char_indices().rev().take_while(|(_, c)| c.is_alphabetic()).last().map_or(0, |(i, _)| i);
        text[start..].to_owned()
    };
    let pairs = [("x", "y"), ("c", "r"), ("col", "row"), ("column", "row"), ("cols", "rows"), ("u", "v"), ("s", "t")];
    pairs.contains(&(word(first).as_str(), word(second).as_str()))
}

/// Returns the distinct values in ascending order, and for each value its index among them. Measured coordinates
/// scatter around their line, so values that are closer than a third of the widest distance are one line.
pub(crate) fn lines(values: &[f64], whole: bool) -> (Vec<f64>, Vec<usize>) {
    let mut sorted = values.to_vec();
    sorted.sort_by(f64::total_cmp);
    sorted.dedup();
    let widest = sorted.windows(2).map(|w| w[1] - w[0]).fold(0.0, f64::max);
    let apart = if whole { 0.0 } else { widest / 3.0 };
    let mut groups: Vec<Vec<f64>> = Vec::new();
    for value in sorted {
        match groups.last_mut() {
            Some(group) if value - group[group.len() - 1] <= apart => group.push(value),
            _ => groups.push(vec![value]),
        }
    }
    let place = |v: &f64| groups.partition_point(|g| g[g.len() - 1] < *v);
    let at = values.iter().map(place).collect();
    (groups.iter().map(|g| g.iter().sum::<f64>() / g.len() as f64).collect(), at)
}

/// Returns the step between whole numbers in ascending order, which is the largest number that divides all differences.
/// It returns `None` if there are fewer than two numbers.
pub(crate) fn stride(numbers: &[f64]) -> Option<f64> {
    let divisor = |mut a: u64, mut b: u64| {
        while b > 0 {
            (a, b) = (b, a % b);
        }
        a
    };
    let step = numbers.windows(2).fold(0, |step, w| divisor(step, (w[1] - w[0]) as u64)) as f64;
    (step >= 1.0 && numbers.len() > 1).then_some(step)
}

/// Returns true if values in ascending order have no common step, which means that at least half of the values would be
/// missing.
pub(crate) fn is_uneven(lines: &[f64], whole: bool) -> bool {
    let least = lines.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
    let step = if whole { stride(lines).unwrap_or(1.0) } else { least };
    let all = match lines {
        [first, .., last] => (last - first) / step + 1.0,
        _ => 1.0,
    };
    all >= 2.0 * lines.len() as f64
}

/// Returns the first missing value among evenly spaced ones. Coordinates may deviate by half a step.
pub(crate) fn gap(lines: &[f64], whole: bool) -> Option<f64> {
    let least = lines.windows(2).map(|w| w[1] - w[0]).fold(f64::INFINITY, f64::min);
    let step = if whole { stride(lines).unwrap_or(least) } else { least };
    let most = if whole { step } else { 1.5 * step };
    lines.windows(2).find(|w| w[1] - w[0] > most).map(|w| w[0] + step)
}
