//! Phase levels of an SLM that a solve keeps to.

use crate::optics::Display;
use serde::{Deserialize, Serialize};

/// Which phases a solve may end in.
#[derive(Debug, Clone, Default, PartialEq, Serialize, Deserialize)]
#[serde(from = "Option<Stored>", into = "Option<Stored>")]
#[non_exhaustive]
pub enum Levels {
    /// Any.
    #[default]
    Any,
    /// Those of the display, whatever it is; [`quality::ColorJob`](crate::quality::ColorJob) puts them in.
    Display,
    /// These, radians, 1 to 256 of them: what is optimised for, straight-through.
    Given(Vec<f64>),
}

/// As files have it: nothing, `true`, how many evenly spaced ones, or the phases. `false` is what earlier versions wrote for nothing.
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
    /// Those that a display shows; any where they are more than a solve tells apart.
    pub fn of(display: &Display) -> Self {
        match display.levels as usize {
            n @ 1..=eyebox_kernels::quantise::MOST => Self::Given(even_levels(n)),
            _ => Self::Any,
        }
    }

    /// The phases, radians; nothing where any will do.
    pub fn given(&self) -> Option<&[f64]> {
        if let Self::Given(levels) = self { Some(levels) } else { None }
    }

    /// How many; 0 where any phase will do.
    pub fn count(&self) -> usize {
        self.given().map_or(0, <[f64]>::len)
    }

    /// As the kernel `quantise` takes them: wrapped, ascending, filled up. Nothing where any phase will do.
    pub fn table(&self) -> Option<Vec<f32>> {
        let mut table: Vec<f32> = self.given()?.iter().map(|l| eyebox_kernels::trig::wrap(*l as f32)).collect();
        table.sort_by(f32::total_cmp);
        table.resize(eyebox_kernels::quantise::MOST, f32::MAX);
        Some(table)
    }
}

/// `n` levels evenly spaced over a turn, the first at 0: what a linear SLM of `n` grey levels shows.
pub fn even_levels(n: usize) -> Vec<f64> {
    (0..n).map(|i| i as f64 * std::f64::consts::TAU / n as f64).collect()
}
