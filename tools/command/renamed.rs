//! Options that are settings now.

/// Options that became settings of a solve. The setting has the same name, but for `--speckle`.
const OF_SOLVES: [&str; 15] = [
    "diameters",
    "efficiency",
    "evenness",
    "first-phases",
    "full",
    "levels",
    "optimizer",
    "padding",
    "patches",
    "sequence",
    "speckle",
    "stft-filter",
    "stft-samples",
    "storage",
    "window",
];

/// Options that became settings of refinements. The setting has the same name, but for numbers of the strategy.
const OF_REFINEMENTS: [&str; 14] = [
    "adam-rate",
    "elsewhere",
    "gain",
    "momentum",
    "overlap-power",
    "pupils",
    "repeats",
    "restart",
    "seed",
    "settled-gain",
    "settling",
    "storage",
    "strategy",
    "window",
];

/// Returns the setting that replaces a former option of a command.
fn setting(command: &str, option: &str) -> Option<String> {
    let refines = ["refine", "live", "show", "study"].contains(&command);
    let name = option.replace('-', "_");
    if refines && OF_REFINEMENTS.contains(&option) {
        return Some(match option {
            "adam-rate" => "refine.strategy.rate".into(),
            "settled-gain" => "refine.strategy.settled".into(),
            "gain" | "momentum" | "overlap-power" | "settling" => format!("refine.strategy.{name}"),
            _ => format!("refine.{name}"),
        });
    }
    let is_known = OF_SOLVES.contains(&option);
    is_known.then(|| if option == "speckle" { "contrast".into() } else { name })
}

/// Returns what to write instead of a former option of a command, as a sentence.
pub fn option(command: &str, option: &str) -> Option<String> {
    setting(command, option).map(|setting| format!("it is a setting now: --set {setting}=VALUE"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox::low_level::error::ErrorData;
    use eyebox::low_level::produce::GivenSettings;

    /// A setting that does not exist would be a remedy that does not work.
    #[test]
    fn every_former_option_names_a_setting() {
        let solves = OF_SOLVES.map(|option| setting("solve", option));
        let refinements = OF_REFINEMENTS.map(|option| setting("refine", option));
        for setting in solves.into_iter().chain(refinements) {
            let setting = setting.expect("a setting");
            // A table with a key that nothing has is of no value, but its key is known.
            match GivenSettings::default().set(&format!("{setting}={{ nothing = 1 }}")) {
                Ok(()) => {}
                Err(error) => assert_eq!(ErrorData::of(&error).code, "job/value", "{setting}: {error}"),
            }
        }
        assert_eq!(setting("solve", "gain"), None);
        assert_eq!(setting("refine", "speckle").as_deref(), Some("contrast"));
    }
}
