//! How the views of a folder stand against what their names say: stated, or asked of the pictures.

use crate::synthesis::parallax::Parallax;
use crate::{LightField, SceneError};
use serde::{Deserialize, Serialize};
use std::{fmt, str::FromStr};

/// How the views really stand, where their names tell it otherwise. First the names' rows and columns are exchanged, then rows
/// and columns are reversed. As text: `as-named`, or what is done, with commas: `transpose,flip-rows`.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(try_from = "String", into = "String")]
pub struct Order {
    /// What the names call the row is the column.
    pub transpose: bool,
    /// The first row is the lowest: it looks from the largest y.
    pub flip_rows: bool,
    /// The first column is the rightmost: it looks from the largest x.
    pub flip_columns: bool,
}

impl Order {
    fn parts(self) -> impl Iterator<Item = &'static str> {
        let parts = [(self.transpose, "transpose"), (self.flip_rows, "flip-rows"), (self.flip_columns, "flip-columns")];
        parts.into_iter().filter(|(done, _)| *done).map(|(_, name)| name)
    }

    /// The keys of `lightfield.toml`.
    fn keys(self) -> String {
        self.parts().map(|name| format!("`{} = true`", name.replace('-', "_"))).collect::<Vec<_>>().join(" and ")
    }

    /// For each place of the ordered grid, row by row, the view of the named one; and rows and columns of the ordered.
    pub(crate) fn places(self, [rows, columns]: [usize; 2]) -> ([usize; 2], Vec<usize>) {
        let [high, wide] = if self.transpose { [columns, rows] } else { [rows, columns] };
        let named = |i: usize| {
            let (r, c) = (i / wide, i % wide);
            let r = if self.flip_rows { high - 1 - r } else { r };
            let c = if self.flip_columns { wide - 1 - c } else { c };
            if self.transpose { c * columns + r } else { r * columns + c }
        };
        ([high, wide], (0..high * wide).map(named).collect())
    }

    /// The same views in this order.
    pub(crate) fn apply(self, mut field: LightField) -> LightField {
        let (grid, places) = self.places(field.grid);
        for views in &mut field.planes {
            *views = places.iter().map(|&i| std::mem::take(&mut views[i])).collect();
        }
        LightField { grid, ..field }
    }
}

impl fmt::Display for Order {
    fn fmt(&self, f: &mut fmt::Formatter) -> fmt::Result {
        let parts: Vec<_> = self.parts().collect();
        f.write_str(&if parts.is_empty() { "as-named".into() } else { parts.join(",") })
    }
}

impl FromStr for Order {
    type Err = String;

    fn from_str(text: &str) -> Result<Self, String> {
        let mut order = Self::default();
        for part in text.split(',').filter(|_| text != "as-named") {
            match part.trim() {
                "transpose" => order.transpose = true,
                "flip-rows" => order.flip_rows = true,
                "flip-columns" => order.flip_columns = true,
                _ => return Err("expected as-named, or transpose, flip-rows, flip-columns with commas between".into()),
            }
        }
        Ok(order)
    }
}

impl TryFrom<String> for Order {
    type Error = String;

    fn try_from(text: String) -> Result<Self, String> {
        text.parse()
    }
}

impl From<Order> for String {
    fn from(order: Order) -> Self {
        order.to_string()
    }
}

/// What the pictures say of the order.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum OrderFound {
    /// It is that of the names, as far as the pictures tell.
    AsNamed,
    /// It is that of the names or its opposite along both axes, which exchanges near and far: too little covers anything.
    AsNamedOrReversed,
    /// They show nothing: nothing moves, or too little.
    Unknown,
    /// It is another.
    Other {
        /// What would read the views right; two where the pictures leave it open.
        orders: Vec<Order>,
        /// What is seen, for people.
        reason: String,
    },
}

/// From what the views show.
pub(crate) fn judge(found: &Parallax) -> OrderFound {
    let Some(transposed) = found.transposed else { return OrderFound::Unknown };
    let disagree = found.disagree == Some(true);
    // The axis that the comparison turned is the one the names call rows.
    let turned = |rows: bool| Order { transpose: transposed, flip_rows: rows, flip_columns: !rows };
    let both = |flip: bool| Order { transpose: transposed, flip_rows: flip, flip_columns: flip };
    // Views of one axis alone have nothing that could disagree.
    let untold = found.disagree.is_none() && found.apart.iter().all(|a| a.is_finite());
    if untold && !transposed {
        return OrderFound::Unknown;
    }
    let orders = match (disagree, found.near_covers) {
        _ if untold => vec![both(false), turned(true)],
        (true, Some(near)) => vec![turned(near != transposed)],
        (true, None) => vec![turned(true), turned(false)],
        (false, Some(false)) => vec![both(true)],
        (false, _) => vec![both(false)],
    };
    if orders[0] == Order::default() {
        return if found.near_covers.is_some() { OrderFound::AsNamed } else { OrderFound::AsNamedOrReversed };
    }
    let mut seen = Vec::new();
    if transposed {
        seen.push("from column to column content moves along the pictures' columns of pixels, not along their rows");
    }
    if disagree {
        seen.push("columns and rows of views contradict each other: along one of them near content moves as far content should");
    } else if found.near_covers == Some(false) {
        seen.push("what moves as far content should covers what moves as near content should");
    }
    OrderFound::Other { orders, reason: seen.join("; ") }
}

/// Pixels by which what is measured may lie outside of what is stated, and by which it clearly does.
const WITHIN: f64 = 0.25;
const OUTSIDE: f64 = 1.0;

/// Where what covers what tells nothing, from disparities: the opposite order turns the `measured` ones round, and the `stated` ones
/// may have room for one of both alone.
pub(crate) fn by_depths(stated: [f64; 2], measured: [f64; 2]) -> OrderFound {
    let outside = |[low, high]: [f64; 2]| (stated[0] - low).max(high - stated[1]);
    match (outside(measured), outside([-measured[1], -measured[0]])) {
        (named, reversed) if named <= WITHIN && reversed > OUTSIDE => OrderFound::AsNamed,
        (named, reversed) if reversed <= WITHIN && named > OUTSIDE => OrderFound::Other {
            orders: vec![Order { transpose: false, flip_rows: true, flip_columns: true }],
            reason:
                "what should be near by the depths that are stated moves as far content does, and the other way round"
                    .into(),
        },
        _ => OrderFound::AsNamedOrReversed,
    }
}

/// Says what the pictures do not tell of an order that nothing states.
pub(crate) fn say(folder: &str, found: &OrderFound) {
    match found {
        OrderFound::AsNamed | OrderFound::Other { .. } => {}
        OrderFound::AsNamedOrReversed => tracing::info!(
            "{folder}: the pictures do not tell near from far: the views stand as named (state the order flip-rows,flip-columns if not)"
        ),
        OrderFound::Unknown => {
            tracing::info!("{folder}: the pictures do not tell the order: as named (state the order if not)")
        }
    }
}

/// Refuses views whose pictures clearly show another order than that in which they come: `in_a_folder`, or in an array.
pub(crate) fn check(scene: &str, found: &OrderFound, in_a_folder: bool) -> Result<(), SceneError> {
    let OrderFound::Other { orders, reason } = found else { return Ok(()) };
    let flags = orders.iter().map(|o| format!("`order` {o}")).collect::<Vec<_>>().join(" or ");
    let keys = in_a_folder.then(|| orders.iter().map(|o| o.keys()).collect::<Vec<_>>().join(", or "));
    Err(SceneError::Order { folder: scene.into(), reason: reason.clone(), flags, keys })
}

/// What the pictures say of the order that is stated, or in which they come. A stated one stays: a warning says where the pictures
/// contradict it.
pub(crate) fn found(name: &str, parallax: Option<&Parallax>, is_stated: bool) -> OrderFound {
    match parallax.map_or(OrderFound::Unknown, judge) {
        OrderFound::Other { reason, .. } if is_stated => {
            tracing::warn!("{name}: the order of the views is as stated, though in it {reason}");
            OrderFound::Unknown
        }
        found => found,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn orders_are_read_and_written() {
        for text in ["as-named", "transpose", "flip-rows", "transpose,flip-columns", "flip-rows,flip-columns"] {
            assert_eq!(text.parse::<Order>().unwrap().to_string(), text);
        }
        assert!("flip".parse::<Order>().is_err() && "".parse::<Order>().is_err());
    }

    #[test]
    fn views_are_exchanged_then_reversed() {
        let at = |text: &str| text.parse::<Order>().unwrap().places([2, 3]);
        assert_eq!(at("as-named"), ([2, 3], vec![0, 1, 2, 3, 4, 5]));
        assert_eq!(at("flip-rows"), ([2, 3], vec![3, 4, 5, 0, 1, 2]));
        assert_eq!(at("flip-columns"), ([2, 3], vec![2, 1, 0, 5, 4, 3]));
        assert_eq!(at("transpose"), ([3, 2], vec![0, 3, 1, 4, 2, 5]));
        assert_eq!(at("transpose,flip-rows"), ([3, 2], vec![2, 5, 1, 4, 0, 3]));
    }
}
