//! Refuses commands and options of earlier versions with the names that they have now.

use crate::args::TilesSettings;
use crate::eval::compare::args::CompareSettings;
use crate::eval::gaze::GazeSettings;
use crate::experiment::{Table, TableOf};
use crate::groups::CameraSettings;
use crate::jod::ViewingArgs;
use crate::show::args::ShowSettings;

/// Commands that have another name now.
const COMMANDS: [(&str, &str); 18] = [
    ("calibrate", "display calibrate"),
    ("devices", "device list"),
    ("displays", "display list"),
    ("evaluate", "eval compare"),
    ("export", "convert IN OUT"),
    ("film", "render --path"),
    ("import", "convert IN OUT"),
    ("inspect", "info"),
    ("live", "show --tracker"),
    ("monitors", "display monitors"),
    ("photograph", "render"),
    ("plan", "solve --dry-run"),
    ("play", "show"),
    ("score", "eval score"),
    ("study", "eval gaze"),
    ("tradeoff", "eval tune"),
    ("trackers", "tracker list"),
    ("view", "render"),
];

/// Options that have another name now, in every command.
const OPTIONS: [(&str, &str); 17] = [
    ("alone", "--what image"),
    ("budget", "--duration"),
    ("camera-keep", "--keep"),
    ("deadline", "--quality, such as --quality 20ms"),
    ("diameter", "--pupil-diameter"),
    ("dry", "--dry-run"),
    ("first", "--at"),
    ("latency", "--tracker-latency"),
    ("monitor", "--output window:MONITOR or direct:DISPLAY"),
    ("no-jod", "--jod none"),
    ("other-scene", "--force"),
    ("raw", "--output raw:FILE"),
    ("real-time", "--clock real"),
    ("save-to", "--out"),
    ("seconds", "--duration"),
    ("shared", "--output shared:FILE"),
    ("vulkan-from", "--engine vulkan-from:KERNEL"),
];

/// Tables of the settings that have former options as keys, by command.
const TABLES_OF: [(&str, &str); 6] = [
    ("eval gaze", "gaze"),
    ("show", "show"),
    ("eval compare", "compare"),
    ("", "camera"),
    ("", "tiles"),
    ("", "viewing"),
];
/// Former options that are keys with another name.
const OTHER_KEYS: [(&str, &str); 4] = [
    ("camera-every", "camera.every"),
    ("camera-timeout", "camera.timeout"),
    ("captures-max", "camera.pictures"),
    ("no-speckle", "compare.speckle"),
];

/// Returns all tables of the settings.
pub fn tables() -> [TableOf; 6] {
    [
        ("camera", CameraSettings::table),
        ("compare", CompareSettings::table),
        ("gaze", GazeSettings::table),
        ("show", ShowSettings::table),
        ("tiles", TilesSettings::table),
        ("viewing", ViewingArgs::table),
    ]
}

/// Returns the new name of an old command.
pub fn command(name: &str) -> Option<String> {
    let (_, now) = COMMANDS.iter().find(|(old, _)| *old == name)?;
    Some(format!("it is `eyebox {now}` now"))
}

/// Options that became settings of a solve. The setting has the same name, except for `--speckle`.
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

/// Options that became settings of refinements. The setting has the same name, except for numbers of the strategy.
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
    let refines = ["refine", "show", "eval gaze"].contains(&command);
    let name = option.replace('-', "_");
    if refines && OF_REFINEMENTS.contains(&option) {
        return Some(match option {
            "adam-rate" => "refine.strategy.rate".into(),
            "settled-gain" => "refine.strategy.settled".into(),
            "gain" | "momentum" | "overlap-power" | "settling" => format!("refine.strategy.{name}"),
            _ => format!("refine.{name}"),
        });
    }
    let has = |table: &str| {
        let found = tables().into_iter().find(|(known, _)| *known == table);
        found.is_some_and(|(_, table)| table().get_arguments().any(|key| key.get_id() == name.as_str()))
    };
    let of_command = TABLES_OF.into_iter().filter(|(of, _)| of.is_empty() || *of == command);
    if let Some((_, table)) = of_command.into_iter().find(|(_, table)| has(table)) {
        return Some(format!("{table}.{name}"));
    }
    if let Some((_, setting)) = OTHER_KEYS.iter().find(|(old, _)| *old == option) {
        return Some((*setting).to_owned());
    }
    let is_known = OF_SOLVES.contains(&option);
    is_known.then(|| if option == "speckle" { "contrast".into() } else { name })
}

/// Returns what to write instead of a former option of a command, as a sentence.
pub fn option(command: &str, option: &str) -> Option<String> {
    if let Some(setting) = setting(command, option) {
        return Some(format!("it is a setting now: --set {setting}=VALUE"));
    }
    let (_, now) = OPTIONS.iter().find(|(old, _)| *old == option)?;
    Some(format!("it is {now} now"))
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::Cli;
    use crate::headings;
    use clap::Command;
    use eyebox::low_level::error::ErrorData;
    use eyebox::low_level::produce::GivenSettings;

    #[test]
    fn a_former_option_names_its_key() {
        for (command, option, key) in [
            ("eval gaze", "fixation", "gaze.fixation"),
            ("eval gaze", "whole-sets", "gaze.whole_sets"),
            ("show", "whole-sets", "show.whole_sets"),
            ("show", "step-time", "show.step_time"),
            ("eval compare", "etendue", "compare.etendue"),
            ("solve", "iris", "camera.iris"),
            ("display calibrate", "captures-max", "camera.pictures"),
            ("bench", "passes", "tiles.passes"),
            ("eval score", "pixels-per-degree", "viewing.pixels_per_degree"),
        ] {
            assert_eq!(setting(command, option).as_deref(), Some(key), "{command} --{option}");
        }
        assert_eq!(setting("solve", "fixation"), None);
    }

    #[test]
    fn every_old_name_is_gone_and_its_new_name_exists() {
        let all = headings::command::<Cli>();
        let leaves = headings::leaves(&all);
        let has = |command: &Command, long: &str| command.get_opts().any(|option| option.get_long() == Some(long));
        for (old, now) in COMMANDS {
            assert!(all.find_subcommand(old).is_none(), "{old}");
            let (path, sub) = leaves.iter().find(|(path, _)| now.starts_with(path.as_str())).expect(now);
            let option = now[path.len()..].trim().strip_prefix("--");
            assert!(option.is_none_or(|long| has(sub, long)), "{now}");
        }
        for (_, setting) in OTHER_KEYS {
            let (table, key) = setting.split_once('.').expect("a table");
            let found = tables().into_iter().find(|(name, _)| *name == table).expect(table);
            assert!((found.1)().get_arguments().any(|option| option.get_id() == key), "{setting}");
        }
        for (old, now) in OPTIONS {
            assert!(!leaves.iter().any(|(_, sub)| has(sub, old)), "{old}");
            let long = now.trim_start_matches('-').split([' ', ',']).next().unwrap_or_default();
            assert!(leaves.iter().any(|(_, sub)| has(sub, long)), "{now}");
        }
    }

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
