//! Represents rates exactly, because 59.94 Hz is 60000 / 1001 and must not drift in ten minutes.

use super::PresentError;
use eyebox_base::quantity::HZ;
use std::fmt;

/// Nanoseconds in a second.
pub const SECOND_NS: i64 = 1_000_000_000;

/// Events per second, as a fraction.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub struct Rate {
    numerator: u32,
    denominator: u32,
}

impl Rate {
    /// The rate `numerator / denominator` in hertz.
    ///
    /// # Errors
    /// [`PresentError::Rate`] unless it is 0.001 to 100000 Hz.
    pub fn new(numerator: u32, denominator: u32) -> Result<Self, PresentError> {
        let wrong = || PresentError::Rate { value: format!("{numerator}/{denominator}") };
        let (n, d) = (u64::from(numerator), u64::from(denominator));
        if d == 0 || n > 100_000 * d || 1000 * n < d {
            return Err(wrong());
        }
        let common = gcd(numerator, denominator);
        Ok(Self { numerator: numerator / common, denominator: denominator / common })
    }

    /// Reads a rate from text such as `60`, `60Hz`, `23.976`, `60000/1001`. The rates of television (23.976, 29.97,
    /// 59.94, 119.88) become their exact fractions, such as 24000 / 1001.
    ///
    /// # Errors
    /// [`PresentError::Rate`] if the text is no rate.
    pub fn parse(text: &str) -> Result<Self, PresentError> {
        let wrong = || PresentError::Rate { value: text.into() };
        if let Some((n, d)) = text.split_once('/') {
            return Self::new(n.trim().parse().map_err(|_| wrong())?, d.trim().parse().map_err(|_| wrong())?);
        }
        let hz = HZ.read(text).map_err(|_| wrong())?;
        Self::from_hz(hz).map_err(|_| wrong())
    }

    /// The most probable fraction for a rate in hertz. It is a whole number, a rate of television, or thousandths.
    ///
    /// # Errors
    /// [`PresentError::Rate`] unless it is 0.001 to 100000 Hz.
    pub fn from_hz(hz: f64) -> Result<Self, PresentError> {
        if !(0.001..=100_000.0).contains(&hz) {
            return Err(PresentError::Rate { value: hz.to_string() });
        }
        let television = (hz * 1.001).round();
        if (television / 1.001 - hz).abs() < 0.005 && (hz - hz.round()).abs() > 0.005 {
            return Self::new(television as u32 * 1000, 1001);
        }
        Self::new((hz * 1000.0).round() as u32, 1000)
    }

    /// The rate in hertz.
    pub fn hz(self) -> f64 {
        f64::from(self.numerator) / f64::from(self.denominator)
    }

    /// The numerator and the denominator.
    pub fn fraction(self) -> [u32; 2] {
        [self.numerator, self.denominator]
    }

    /// One period, to the nearest nanosecond.
    pub fn period_ns(self) -> i64 {
        let (n, d) = (i64::from(self.numerator), i64::from(self.denominator));
        (2 * d * SECOND_NS + n) / (2 * n)
    }

    /// Duration of `count` periods in nanoseconds, rounded down and limited to the range of i64.
    pub fn time_of_ns(self, count: i64) -> i64 {
        let time = i128::from(count) * i128::from(self.denominator) * i128::from(SECOND_NS);
        saturate(time.div_euclid(i128::from(self.numerator)))
    }

    /// The same rate, faster by the factor `times`.
    ///
    /// # Errors
    /// [`PresentError::Rate`] beyond the range.
    pub fn times(self, times: u32) -> Result<Self, PresentError> {
        let wrong = || PresentError::Rate { value: format!("{times} times {self}") };
        Self::new(self.numerator.checked_mul(times).ok_or_else(wrong)?, self.denominator)
    }

    /// The rate of one in `parts` of its events.
    ///
    /// # Errors
    /// [`PresentError::Rate`] beyond the range.
    pub fn over(self, parts: u32) -> Result<Self, PresentError> {
        let wrong = || PresentError::Rate { value: format!("{self} / {parts}") };
        Self::new(self.numerator, self.denominator.checked_mul(parts).ok_or_else(wrong)?)
    }
}

impl fmt::Display for Rate {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        if self.denominator == 1 { write!(f, "{}", self.numerator) } else { write!(f, "{:.3}", self.hz()) }
    }
}

fn gcd(a: u32, b: u32) -> u32 {
    if b == 0 { a.max(1) } else { gcd(b, a % b) }
}

pub(super) fn saturate(value: i128) -> i64 {
    value.clamp(i128::from(i64::MIN), i128::from(i64::MAX)) as i64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn rates_are_what_they_stand_for() {
        let of = |text| Rate::parse(text).unwrap().fraction();
        assert_eq!(
            (of("60"), of("59.94"), of("23.976"), of("29.97")),
            ([60, 1], [60000, 1001], [24000, 1001], [30000, 1001])
        );
        assert_eq!((of("72"), of("62.5"), of("60000/1001"), of("0.5")), ([72, 1], [125, 2], [60000, 1001], [1, 2]));
        assert_eq!((of("60 Hz"), of("0.06kHz")), ([60, 1], [60, 1]));
        for bad in ["", "0", "-1", "NaN", "inf", "1e9", "1/0", "0/1", "x", "60 mm", "1/99999999999"] {
            assert!(Rate::parse(bad).is_err(), "{bad}");
        }
        let ntsc = Rate::parse("59.94").unwrap();
        assert_eq!((ntsc.time_of_ns(60_000), ntsc.period_ns()), (1_001_000_000_000, 16_683_333));
        assert_eq!(ntsc.times(24).unwrap().over(24).unwrap(), ntsc);
    }

    proptest! {
        #[test]
        fn any_text_is_a_rate_or_an_error(text in ".{0,20}", n in any::<u32>(), d in any::<u32>(), count in any::<i64>()) {
            let _ = Rate::parse(&text);
            if let Ok(rate) = Rate::new(n, d) {
                prop_assert!(rate.time_of_ns(count) <= rate.time_of_ns(count.saturating_add(1)));
                prop_assert!(rate.period_ns() >= 10_000);
            }
        }
    }
}
