//! Measures and encodes text in Helvetica, a font that all PDF readers have.

/// Widths of the characters from the space to the tilde, in thousandths of the size (Adobe's metrics of the font).
#[rustfmt::skip]
const PLAIN: [u16; 95] = [
    278, 278, 355, 556, 556, 889, 667, 191, 333, 333, 389, 584, 278, 333, 278, 278,
    556, 556, 556, 556, 556, 556, 556, 556, 556, 556, 278, 278, 584, 584, 584, 556,
    1015, 667, 667, 722, 722, 667, 611, 778, 722, 278, 500, 667, 556, 833, 722, 778,
    667, 778, 722, 667, 611, 722, 667, 944, 667, 667, 611, 278, 278, 278, 469, 556,
    333, 556, 556, 500, 556, 556, 278, 556, 556, 222, 222, 500, 222, 833, 556, 556,
    556, 556, 333, 500, 278, 556, 500, 722, 500, 500, 500, 334, 260, 334, 584,
];

/// The average width of bold letters relative to plain ones.
const BOLD: f64 = 1.07;

/// Returns the width of a text in sizes of the font. It is approximate for bold text.
pub(super) fn width(text: &str, bold: bool) -> f64 {
    let of = |c: char| (c as usize).checked_sub(32).and_then(|i| PLAIN.get(i)).map_or(556, |w| *w);
    text.chars().map(|c| f64::from(of(c)) / 1000.0).sum::<f64>() * if bold { BOLD } else { 1.0 }
}

/// Returns the bytes of a text in the encoding of Western PDF fonts. Characters that it lacks become question marks.
pub(super) fn win_ansi(text: &str) -> Vec<u8> {
    let byte = |c: char| match c {
        '\u{20}'..='\u{7e}' | '\u{a0}'..='\u{ff}' => c as u8,
        '\u{2026}' => 0x85,
        '\u{2018}' => 0x91,
        '\u{2019}' => 0x92,
        '\u{201c}' => 0x93,
        '\u{201d}' => 0x94,
        '\u{2013}' | '\u{2212}' => 0x96,
        '\u{2014}' => 0x97,
        _ => b'?',
    };
    text.chars().map(byte).collect()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn text_is_as_wide_as_its_letters_and_says_what_its_font_can() {
        assert!((width("Ai 1", false) - (0.667 + 0.222 + 0.278 + 0.556)).abs() < 1e-12);
        assert!(width("Ai 1", true) > width("Ai 1", false));
        assert_eq!(win_ansi("1 × 2 – \u{3b1}"), b"1 \xd7 2 \x96 ?");
    }
}
