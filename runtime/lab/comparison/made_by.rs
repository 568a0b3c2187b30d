//! Makes names of result files from names of scenes and methods.

/// Returns a name of lower-case letters, digits and dashes.
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
