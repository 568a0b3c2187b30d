//! What the pictures show of the order of the views, and what follows from it.

use crate::synthesis::parallax::Parallax;
use crate::{Order, SceneError};
use eyebox_base::error::Reason;
use eyebox_base::reason;

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
        reason: Reason,
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
    OrderFound::Other { orders, reason: Reason::new("moves-otherwise", seen.join("; ")) }
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
            reason: reason!(
                "near-moves-as-far",
                "what should be near by the depths that are stated moves as far content does, and the other way round"
            ),
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
