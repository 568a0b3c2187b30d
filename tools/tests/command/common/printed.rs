//! Names and numbers in printed text. Its wording is free, because no test compares sentences.

/// Text that a command printed, or the title of a window.
pub trait Printed {
    /// Returns all numbers in their order.
    fn numbers(&self) -> Vec<f64>;

    /// Returns the number in front of a unit, such as `dB` or `%`. Panics if there is none.
    fn number(&self, unit: &str) -> f64;

    /// Returns whether the text has all of these words, which spaces separate. Numbers compare by value, other words
    /// letter by letter.
    fn has(&self, words: &str) -> bool;

    /// Returns the number of lines that [have](Self::has) these words.
    fn lines_with(&self, words: &str) -> usize;

    /// Returns whether the text has these numbers one after another, with no other number between them.
    fn has_sequence(&self, sequence: &[f64]) -> bool {
        self.numbers().windows(sequence.len()).any(|numbers| numbers.iter().zip(sequence).all(|(a, b)| equal(*a, *b)))
    }
}

impl Printed for str {
    fn numbers(&self) -> Vec<f64> {
        places(self).into_iter().map(|(number, _)| number).collect()
    }

    #[track_caller]
    fn number(&self, unit: &str) -> f64 {
        let found = places(self).into_iter().find(|(_, end)| {
            let rest = self[*end..].trim_start_matches(' ');
            rest.strip_prefix(unit).is_some_and(|rest| !rest.starts_with(char::is_alphanumeric))
        });
        found.unwrap_or_else(|| panic!("no number in {unit}: {self}")).0
    }

    fn has(&self, words: &str) -> bool {
        words.split(' ').all(|word| match word.parse::<f64>() {
            Ok(wanted) if !word.starts_with(char::is_alphabetic) => self.numbers().iter().any(|n| equal(*n, wanted)),
            _ => self.match_indices(word).any(|(at, _)| {
                let around = [self[..at].chars().next_back(), self[at + word.len()..].chars().next()];
                let inside = [word.chars().next(), word.chars().next_back()];
                let goes_on = |(a, b): (Option<char>, Option<char>)| {
                    a.is_some_and(char::is_alphanumeric) && b.is_some_and(char::is_alphanumeric)
                };
                !around.into_iter().zip(inside).any(goes_on)
            }),
        })
    }

    fn lines_with(&self, words: &str) -> usize {
        self.lines().filter(|line| line.has(words)).count()
    }
}

fn equal(a: f64, b: f64) -> bool {
    (a - b).abs() <= 1e-9 * a.abs().max(b.abs())
}

/// Returns each number of a text with the position of its end.
fn places(text: &str) -> Vec<(f64, usize)> {
    let bytes = text.as_bytes();
    let digits = |from: usize| from + bytes[from..].iter().take_while(|b| b.is_ascii_digit()).count();
    let (mut all, mut at) = (Vec::new(), 0);
    while at < bytes.len() {
        if !bytes[at].is_ascii_digit() {
            at += 1;
            continue;
        }
        // A dash after a letter or a digit is a hyphen.
        let is_negative = at > 0 && bytes[at - 1] == b'-' && (at < 2 || !bytes[at - 2].is_ascii_alphanumeric());
        let start = at - usize::from(is_negative);
        at = digits(at);
        if bytes.get(at) == Some(&b'.') && bytes.get(at + 1).is_some_and(u8::is_ascii_digit) {
            at = digits(at + 1);
        }
        if bytes.get(at) == Some(&b'e') {
            let from = at + 1 + usize::from(matches!(bytes.get(at + 1), Some(b'-' | b'+')));
            if bytes.get(from).is_some_and(u8::is_ascii_digit) {
                at = digits(from);
            }
        }
        all.push((text[start..at].parse().expect("a number"), at));
    }
    all
}

#[test]
fn numbers_and_names_are_found_in_a_text() {
    let text = "wrote v-1.png: -1.50 mm, 2x3 at 1e-6 dB (--ideal), 520.0nm.";
    assert_eq!(text.numbers(), [1.0, -1.5, 2.0, 3.0, 1e-6, 520.0]);
    assert_eq!([text.number("mm"), text.number("dB"), text.number("nm")], [-1.5, 1e-6, 520.0]);
    assert!(text.has("-1.5 520 v-1.png --ideal") && text.has_sequence(&[2.0, 3.0]) && !text.has_sequence(&[3.0, 2.0]));
    assert!(!text.has("1.5") && !text.has("52") && !text.has("--idea") && !text.has("png 7"));
    assert_eq!(["a 1\nb 1", "c"].map(|text| text.lines_with("1")), [2, 0]);
}
