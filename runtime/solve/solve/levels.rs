//! Phase levels that a solve is restricted to.

use crate::optics::Display;
use serde::{Deserialize, Serialize};

/// The phases in which a solve may end.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "Option<Stored>", into = "Option<Stored>")]
#[non_exhaustive]
pub enum Levels {
    /// Any phase is allowed.
    #[default]
    Any,
    /// The levels of the display. [`quality::ColorJob`](crate::quality::ColorJob) replaces this variant by them.
    Display,
    /// These 1 to 256 phases in radians, which a straight-through estimator optimizes for.
    Given(Vec<f64>),
}

/// The stored form, which is nothing, `true`, a number of evenly spaced levels, or the phases. Earlier versions wrote
/// `false` for nothing.
#[derive(Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected a number of levels, a list of phases in radians, or true for the levels of the display"
)]
enum Stored {
    Display(bool),
    Even(u16),
    Given(Vec<f64>),
}

impl From<Option<Stored>> for Levels {
    fn from(stored: Option<Stored>) -> Self {
        match stored {
            None | Some(Stored::Display(false)) => Self::Any,
            Some(Stored::Display(true)) => Self::Display,
            Some(Stored::Even(count)) => Self::Given(even_levels(count.into())),
            Some(Stored::Given(levels)) => Self::Given(levels),
        }
    }
}

impl From<Levels> for Option<Stored> {
    fn from(levels: Levels) -> Self {
        match levels {
            Levels::Any => None,
            Levels::Display => Some(Stored::Display(true)),
            Levels::Given(levels) => Some(Stored::Given(levels)),
        }
    }
}

impl Levels {
    /// Returns the levels of a display, or any phase if they are more than a solve distinguishes.
    pub fn of(display: &Display) -> Self {
        match display.levels as usize {
            n @ 1..=eyebox_kernels::quantise::MOST => Self::Given(even_levels(n)),
            _ => Self::Any,
        }
    }

    /// Returns the phases in radians, or `None` for any phase.
    pub fn given(&self) -> Option<&[f64]> {
        if let Self::Given(levels) = self { Some(levels) } else { None }
    }

    /// Returns the number of levels, or 0 for any phase.
    pub fn count(&self) -> usize {
        self.given().map_or(0, <[f64]>::len)
    }

    /// Returns the table for the kernel `quantise`, which is wrapped, ascending and filled up. `None` is any phase.
    pub fn table(&self) -> Option<Vec<f32>> {
        let mut table: Vec<f32> = self.given()?.iter().map(|l| eyebox_kernels::trig::wrap(*l as f32)).collect();
        table.sort_by(f32::total_cmp);
        table.resize(eyebox_kernels::quantise::MOST, f32::MAX);
        Some(table)
    }
}

/// Returns `n` levels evenly spaced over a turn from 0 on, which a linear SLM of `n` gray levels shows.
pub fn even_levels(n: usize) -> Vec<f64> {
    (0..n).map(|i| i as f64 * std::f64::consts::TAU / n as f64).collect()
}
