//! How old the model of a display is.

use crate::optics::{Color, Display, ModelOf};
use serde::Serialize;
use std::fmt;
use std::time::SystemTime;

/// When a model was fitted, and how long ago that is.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ModelAge {
    /// Day of the calibration, as year-month-day.
    pub date: String,
    /// Days since then, if the date can be read and is not in the future.
    pub days: Option<i64>,
    /// Day on which drift was last fitted, or on which pictures last agreed with the model.
    pub updated: Option<String>,
    /// Days since then.
    pub days_since_update: Option<i64>,
    /// Temperature of the bench when the numbers were fitted, degrees Celsius, if it was stated.
    pub temperature_c: Option<f64>,
}

impl ModelAge {
    /// Of the model of a color; none without a date.
    pub fn of(display: &Display, color: Color) -> Option<Self> {
        Self::at(display, color, day_now())
    }

    /// The same on a day, counted from 1970-01-01.
    fn at(display: &Display, color: Color, today: i64) -> Option<Self> {
        let of = |of: ModelOf| display.model.get(&of).filter(|terms| !terms.date.is_empty());
        let terms = of(color.into()).or_else(|| of(ModelOf::All))?;
        let since = |date: &str| Some(today - day_of(date)?).filter(|days| *days >= 0);
        let updated = Some(terms.updated.clone()).filter(|day| !day.is_empty());
        Some(Self {
            date: terms.date.clone(),
            days: since(&terms.date),
            days_since_update: updated.as_deref().and_then(since),
            updated,
            temperature_c: terms.temperature_c,
        })
    }
}

impl fmt::Display for ModelAge {
    fn fmt(&self, to: &mut fmt::Formatter<'_>) -> fmt::Result {
        let ago = |days: Option<i64>| match days {
            None => String::new(),
            Some(0) => " (today)".into(),
            Some(1) => " (yesterday)".into(),
            Some(days) => format!(" ({days} days ago)"),
        };
        write!(to, "calibrated {}{}", self.date, ago(self.days))?;
        if let Some(updated) = &self.updated {
            write!(to, ", checked for drift {updated}{}", ago(self.days_since_update))?;
        }
        if let Some(celsius) = self.temperature_c {
            write!(to, ", at {celsius} degrees Celsius")?;
        }
        Ok(())
    }
}

/// Days since 1970-01-01.
fn day_now() -> i64 {
    let seconds = SystemTime::now().duration_since(SystemTime::UNIX_EPOCH).map_or(0, |d| d.as_secs());
    (seconds / 86_400) as i64
}

/// Today as year-month-day.
pub(super) fn today() -> String {
    date_of(day_now())
}

/// A day as year-month-day (Hinnant's civil calendar).
fn date_of(day: i64) -> String {
    let days = day + 719_468;
    let era = days.div_euclid(146_097);
    let day = days.rem_euclid(146_097);
    let year = (day - day / 1460 + day / 36_524 - day / 146_096) / 365;
    let of_year = day - (365 * year + year / 4 - year / 100);
    let month = (5 * of_year + 2) / 153;
    let (d, m) = (of_year - (153 * month + 2) / 5 + 1, if month < 10 { month + 3 } else { month - 9 });
    format!("{:04}-{m:02}-{d:02}", year + era * 400 + i64::from(m <= 2))
}

/// The inverse; none of what is no date.
fn day_of(date: &str) -> Option<i64> {
    let parts: Vec<i64> = date.split('-').map(|part| part.parse().ok()).collect::<Option<_>>()?;
    let &[year, month, day] = &parts[..] else { return None };
    if !(1970..=9999).contains(&year) || !(1..=12).contains(&month) || !(1..=31).contains(&day) {
        return None;
    }
    let years = if month <= 2 { year - 1 } else { year };
    let era = years.div_euclid(400);
    let year_of_era = years.rem_euclid(400);
    let day_of_year = (153 * ((month + 9) % 12) + 2) / 5 + day - 1;
    let day_of_era = year_of_era * 365 + year_of_era / 4 - year_of_era / 100 + day_of_year;
    Some(era * 146_097 + day_of_era - 719_468)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn dates_and_days_are_each_other_s_inverse() {
        for day in (0..60_000).step_by(17) {
            assert_eq!(day_of(&date_of(day)), Some(day), "{}", date_of(day));
        }
        assert_eq!((date_of(0), day_of("2024-02-29")), ("1970-01-01".into(), Some(19_782)));
        for wrong in ["", "today", "2026-13-01", "2026-11", "2026-11-27-1", "20261127", "2026-11-32"] {
            assert_eq!(day_of(wrong), None, "{wrong}");
        }
    }

    #[test]
    fn a_model_tells_its_age_and_nothing_of_a_date_that_is_none() {
        let age = |section: &str| {
            let text = format!(
                "resolution = [8, 8]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = {{ green = 520 }}\n{section}"
            );
            let display = Display::from_toml(&text, "test").expect("a display");
            ModelAge::at(&display, Color::Green, day_of("2026-11-27").expect("a day"))
        };
        assert_eq!(age(""), None);
        assert_eq!(age("[model.green]\nlag = 0.1\n"), None);
        let whole =
            age("[model.green]\nlag = 0.1\ndate = \"2026-11-20\"\nupdated = \"2026-11-26\"\ntemperature_c = 24.5\n");
        let whole = whole.expect("an age");
        assert_eq!((whole.days, whole.days_since_update, whole.temperature_c), (Some(7), Some(1), Some(24.5)));
        let said = whole.to_string();
        assert!(said.contains("7 days ago") && said.contains("2026-11-26") && said.contains("24.5"), "{said}");
        // The section of all colors counts if the color has none.
        assert_eq!(age("[model.all]\nlag = 0.1\ndate = \"2026-11-27\"\n").and_then(|age| age.days), Some(0));
        for date in ["some day", "2027-01-01"] {
            let odd = age(&format!("[model.green]\nlag = 0.1\ndate = \"{date}\"\n")).expect("an age");
            assert_eq!((odd.days, &odd.date[..]), (None, date));
        }
    }
}
