//! Parses the header of `.npy`, which is a Python dictionary of three literals.

/// Maximum number of axes of an array. It is more than any picture has, and bounds the work that a header can cause.
const MOST_AXES: usize = 8;

/// The information before the values.
pub(super) struct Header {
    /// NumPy's name of the element type, which has the byte order, the kind and the number of bytes.
    pub descr: String,
    /// True if the first axis is the fastest.
    pub fortran_order: bool,
    /// Length of each axis.
    pub shape: Vec<usize>,
}

impl Header {
    /// Parses the text of a header. Returns `None` if it is not such a dictionary.
    pub fn parse(text: &[u8]) -> Option<Self> {
        let mut text = Text(str::from_utf8(text).ok()?);
        let (mut descr, mut fortran_order, mut shape) = (None, None, None);
        text.sign('{')?;
        while text.sign('}').is_none() {
            let key = text.quoted()?;
            text.sign(':')?;
            match key {
                "descr" => descr = Some(text.quoted()?.to_string()),
                "fortran_order" => fortran_order = Some(text.boolean()?),
                "shape" => shape = Some(text.tuple()?),
                _ => return None,
            }
            if text.sign(',').is_none() {
                text.sign('}')?;
                break;
            }
        }
        text.0.trim().is_empty().then_some(())?;
        let descr = descr.filter(|d| d.is_ascii() && !d.is_empty())?;
        Some(Self { descr, fortran_order: fortran_order?, shape: shape? })
    }
}

struct Text<'a>(&'a str);

impl<'a> Text<'a> {
    fn sign(&mut self, sign: char) -> Option<()> {
        self.0 = self.0.trim_start().strip_prefix(sign)?;
        Some(())
    }

    fn quoted(&mut self) -> Option<&'a str> {
        let text = self.0.trim_start();
        let quote = text.chars().next().filter(|c| matches!(c, '\'' | '"'))?;
        let (inside, rest) = text[1..].split_once(quote)?;
        self.0 = rest;
        Some(inside)
    }

    fn boolean(&mut self) -> Option<bool> {
        let text = self.0.trim_start();
        let (value, rest) = match text.strip_prefix("True") {
            Some(rest) => (true, rest),
            None => (false, text.strip_prefix("False")?),
        };
        self.0 = rest;
        Some(value)
    }

    fn tuple(&mut self) -> Option<Vec<usize>> {
        self.sign('(')?;
        let mut axes = Vec::new();
        while self.sign(')').is_none() {
            let text = self.0.trim_start();
            let digits = text.len() - text.trim_start_matches(|c: char| c.is_ascii_digit()).len();
            axes.push(text[..digits].parse().ok()?);
            // Python 2 wrote long integers in this way.
            self.0 = text[digits..].strip_prefix('L').unwrap_or(&text[digits..]);
            if axes.len() > MOST_AXES {
                return None;
            }
            if self.sign(',').is_none() {
                self.sign(')')?;
                break;
            }
        }
        Some(axes)
    }
}
