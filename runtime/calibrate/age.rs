//! Computes the age of a display's model.

use eyebox_optics::{Color, Display, ModelOf};
use jiff::Timestamp;
use jiff::civil::Date;
use jiff::tz::TimeZone;
use serde::Serialize;
use std::fmt;

/// Date of a model's calibration, and the time since then.
#[derive(Debug, Clone, PartialEq, Serialize)]
#[non_exhaustive]
pub struct ModelAge {
    /// Day of the calibration, as year-month-day.
    pub date: String,
    /// Days since then, if the date can be read and is not in the future.
    pub days: Option<i64>,
    /// Day on which drift was last fitted, or on which pictures last agreed with the model.
    pub updated: Option<String>,
    /// Days since `updated`, if the date can be read and is not in the future.
    pub days_since_update: Option<i64>,
    /// Temperature of the bench at the calibration, degrees Celsius, if it was given.
    pub temperature_c: Option<f64>,
}

impl ModelAge {
    /// Returns the age of the model of a color, or none if the model has no date.
    pub fn of(display: &Display, color: Color) -> Option<Self> {
        Self::at(display, color, day_now())
    }

    /// The age on the day `today`.
    fn at(display: &Display, color: Color, today: Date) -> Option<Self> {
        let of = |of: ModelOf| display.model.get(&of).filter(|terms| !terms.date.is_empty());
        let terms = of(color.into()).or_else(|| of(ModelOf::All))?;
        let since = |date: &str| {
            let days = today.since(day_of(date)?).ok()?.get_days();
            Some(i64::from(days)).filter(|days| *days >= 0)
        };
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

/// The current day in UTC.
fn day_now() -> Date {
    TimeZone::UTC.to_datetime(Timestamp::now()).date()
}

/// The current day as year-month-day.
pub(super) fn today() -> String {
    day_now().to_string()
}

fn day_of(date: &str) -> Option<Date> {
    Date::strptime("%Y-%m-%d", date).ok()
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_day_is_read_as_it_is_written() {
        assert_eq!(day_of(&today()).map(|day| day.to_string()), Some(today()));
        assert_eq!(day_of("2024-02-29").map(|day| day.to_string()).as_deref(), Some("2024-02-29"));
        for wrong in ["", "today", "2026-13-01", "2026-11", "2026-11-27-1", "20261127", "2026-11-32", "2026-02-29"] {
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
