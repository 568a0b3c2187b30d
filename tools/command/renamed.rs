//! Options that are settings now.

/// Options that became settings of a solve.
const OF_SOLVES: [(&str, &str); 15] = [
    ("diameters", "diameters"),
    ("efficiency", "efficiency"),
    ("evenness", "evenness"),
    ("first-phases", "first_phases"),
    ("full", "full"),
    ("levels", "levels"),
    ("optimizer", "optimizer"),
    ("padding", "padding"),
    ("patches", "patches"),
    ("sequence", "sequence"),
    ("speckle", "contrast"),
    ("stft-filter", "stft_filter"),
    ("stft-samples", "stft_samples"),
    ("storage", "storage"),
    ("window", "window"),
];

/// Options that became settings of refinements.
const OF_REFINEMENTS: [(&str, &str); 14] = [
    ("adam-rate", "strategy.rate"),
    ("elsewhere", "elsewhere"),
    ("gain", "strategy.gain"),
    ("momentum", "strategy.momentum"),
    ("overlap-power", "strategy.overlap_power"),
    ("pupils", "pupils"),
    ("repeats", "repeats"),
    ("restart", "restart"),
    ("seed", "seed"),
    ("settled-gain", "strategy.settled"),
    ("settling", "strategy.settling"),
    ("storage", "storage"),
    ("strategy", "strategy"),
    ("window", "window"),
];

/// Returns the setting that replaces a former option of a command, as a sentence.
pub fn option(command: &str, option: &str) -> Option<String> {
    let find = |all: &[(&str, &str)]| all.iter().find(|(old, _)| *old == option).map(|(_, new)| (*new).to_owned());
    let refines = ["refine", "live", "show", "study"].contains(&command);
    let of_refinement = if refines { find(&OF_REFINEMENTS).map(|new| format!("refine.{new}")) } else { None };
    let setting = of_refinement.or_else(|| find(&OF_SOLVES))?;
    Some(format!("it is a setting now: --set {setting}=VALUE"))
}
