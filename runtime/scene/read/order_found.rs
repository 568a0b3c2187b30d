//! Determines the order of the views from the pictures, and checks the stated order.

use crate::synthesis::parallax::Parallax;
use crate::{Order, SceneError};
use eyebox_base::error::Reason;
use eyebox_base::reason;

/// The order of the views that the pictures show.
#[derive(Debug, Clone, PartialEq)]
#[non_exhaustive]
pub enum OrderFound {
    /// The order of the names, as far as the pictures show it.
    AsNamed,
    /// The order of the names or its opposite along both axes, which exchanges near and far. Too little content covers
    /// other content.
    AsNamedOrReversed,
    /// The pictures show nothing, because nothing or too little moves.
    Unknown,
    /// The pictures show another order.
    Other {
        /// The orders that would read the views correctly, two if the pictures leave it open.
        orders: Vec<Order>,
        /// The evidence, for people.
        reason: Reason,
    },
}

/// Determines the order from the parallax of the views.
pub(crate) fn judge(found: &Parallax) -> OrderFound {
    let Some(transposed) = found.transposed else { return OrderFound::Unknown };
    let disagree = found.disagree == Some(true);
    // The comparison turned the axis that the names call rows.
    let turned = |rows: bool| Order { transpose: transposed, flip_rows: rows, flip_columns: !rows };
    let both = |flip: bool| Order { transpose: transposed, flip_rows: flip, flip_columns: flip };
    // Views along one axis alone cannot disagree.
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
        seen.push("columns and rows of views contradict each other, because along one of them near moves like far");
    } else if found.near_covers == Some(false) {
        seen.push("content that moves like far content covers content that moves like near content");
    }
    OrderFound::Other { orders, reason: Reason::new("moves-otherwise", seen.join(", and ")) }
}

/// Pixels by which the measured range may be outside the stated range, and pixels by which it clearly is outside.
const WITHIN: f64 = 0.25;
const OUTSIDE: f64 = 1.0;

/// Determines the order from disparities if occlusion shows nothing. The opposite order reverses the sign of the
/// `measured` disparities, and the `stated` range may include only one of the two.
pub(crate) fn by_depths(stated: [f64; 2], measured: [f64; 2]) -> OrderFound {
    let outside = |[low, high]: [f64; 2]| (stated[0] - low).max(high - stated[1]);
    match (outside(measured), outside([-measured[1], -measured[0]])) {
        (named, reversed) if named <= WITHIN && reversed > OUTSIDE => OrderFound::AsNamed,
        (named, reversed) if reversed <= WITHIN && named > OUTSIDE => OrderFound::Other {
            orders: vec![Order { transpose: false, flip_rows: true, flip_columns: true }],
            reason: reason!(
                "near-moves-as-far",
                "content that is near by the stated depths moves like far content, and far content moves like near \
                 content"
            ),
        },
        _ => OrderFound::AsNamedOrReversed,
    }
}

/// Logs what the pictures do not show about an order that nothing states.
pub(crate) fn say(folder: &str, found: &OrderFound) {
    match found {
        OrderFound::AsNamed | OrderFound::Other { .. } => {}
        OrderFound::AsNamedOrReversed => tracing::info!(
            "{folder}: near and far look the same in the pictures, so the names count (state the order \
             flip-rows,flip-columns if wrong)"
        ),
        OrderFound::Unknown => {
            tracing::info!("{folder}: the pictures do not show the order, so the names count (state it if wrong)")
        }
    }
}

/// Refuses views whose pictures clearly show an order other than their present one. `in_a_folder` is false for an
/// array.
pub(crate) fn check(scene: &str, found: &OrderFound, in_a_folder: bool) -> Result<(), SceneError> {
    let OrderFound::Other { orders, reason } = found else { return Ok(()) };
    let flags = orders.iter().map(|o| format!("`order` {o}")).collect::<Vec<_>>().join(" or ");
    let keys = in_a_folder.then(|| orders.iter().map(|o| o.keys()).collect::<Vec<_>>().join(", or "));
    Err(SceneError::Order { folder: scene.into(), reason: reason.clone(), flags, keys })
}

/// Returns the order that the pictures show, against the stated order or the order in which the views come. A stated
/// order stays, and a warning states the contradiction in the pictures.
pub(crate) fn found(name: &str, parallax: Option<&Parallax>, is_stated: bool) -> OrderFound {
    match parallax.map_or(OrderFound::Unknown, judge) {
        OrderFound::Other { reason, .. } if is_stated => {
            tracing::warn!("{name}: the pictures contradict the stated order of the views, because {reason}");
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
