//! What results are kept under, and what decides them beside the settings.

use crate::optics::Display;
use serde_json::json;

/// What results are of beside an ideal display and a perfect eye.
pub(super) fn beyond_ideal(display: &Display) -> impl Iterator<Item = (&'static str, serde_json::Value)> {
    let model = (!display.model.is_empty()).then(|| ("model", json!(display.model)));
    let source = (!display.source.is_empty()).then(|| ("source", json!(display.source)));
    let picture = (!display.picture.is_empty()).then(|| ("picture", json!(display.picture)));
    let eye = display.prescription.as_ref().map(|eye| ("prescription", json!(eye)));
    let mask = display.mask.as_ref().map(|mask| ("mask", json!(mask)));
    let sources = (!display.sources.is_empty())
        .then(|| ("sources", json!([json!(display.sources.each), json!(format!("{:?}", display.sources.lit))])));
    model.into_iter().chain(source).chain(mask).chain(sources).chain(picture).chain(eye)
}

/// A name of letters, digits and dashes.
pub(super) fn slug(text: &str) -> String {
    let plain: String =
        text.chars().map(|c| if c.is_ascii_alphanumeric() { c.to_ascii_lowercase() } else { '-' }).collect();
    let words: Vec<&str> = plain.split('-').filter(|w| !w.is_empty()).collect();
    if words.is_empty() { "unnamed".into() } else { words.join("-") }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_become_files() {
        assert_eq!(slug("builtin:plane?depth=2"), "builtin-plane-depth-2");
        assert_eq!(slug("../../Ünsäfe/"), "ns-fe");
        assert_eq!(slug("…"), "unnamed");
    }
}
