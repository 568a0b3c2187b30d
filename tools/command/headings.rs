//! Options under headings, so that forty of them can be read: one table for all commands.

use clap::{Command, CommandFactory};

/// Each heading with its options; `COMMAND.OPTION` is for one command alone, and wins.
const HEADINGS: &[(&str, &[&str])] = &[
    (
        "Scene",
        &[
            "scene",
            "depth_map",
            "near",
            "order",
            "view_pitch",
            "views",
            "depth",
            "other_scene",
            "reference",
            "hologram",
            "methods",
            "photographs",
            "unfinished",
            "path",
            "per_pupil",
            "on_device",
        ],
    ),
    (
        "Display",
        &[
            "display",
            "size",
            "color",
            "force",
            "output",
            "monitor",
            "display_rate",
            "display_latency",
            "sources_out",
            "validation",
            "ask",
            "ideal",
            "model_terms",
            "name",
        ],
    ),
    (
        "Quality",
        &[
            "quality",
            "deadline",
            "frames",
            "speckle",
            "joint_color",
            "coherence",
            "etendue",
            "sources",
            "efficiency",
            "method",
            "loss",
            "gaze",
            "stft_filter",
            "stft_samples",
            "evenness",
            "patches",
            "levels",
            "storage",
            "padding",
            "full",
            "window",
            "budget",
            "check",
            "no_store",
            "no_speckle",
            "jod",
            "no_jod",
            "luminance",
            "black",
            "pixels_per_degree",
            "sub_frame_rate",
        ],
    ),
    (
        "Pupils",
        &[
            "pupil",
            "pupils",
            "pupil_diameter",
            "diameters",
            "sequence",
            "elsewhere",
            "repeats",
            "spread",
            "diameter",
            "obstructed",
        ],
    ),
    (
        "Steps",
        &[
            "steps",
            "seconds",
            "psnr",
            "first_phases",
            "optimizer",
            "strategy",
            "gain",
            "settled_gain",
            "settling",
            "momentum",
            "overlap_power",
            "adam_rate",
            "restart",
            "unsteered",
            "whole_sets",
            "moments",
            "passes",
            "memory",
            "picture",
            "warm_start",
            "seed",
        ],
    ),
    (
        "Eye",
        &[
            "tracker",
            "tracker_latency",
            "tracker_rate",
            "tracker_delay",
            "tracker_noise",
            "device_file",
            "calibration",
            "eye",
            "eye_seed",
            "focus",
            "fixation",
            "pursuit",
            "blinks",
            "step_time",
            "encode_time",
            "study.rate",
            "content",
            "sets",
            "steps_per_set",
            "moves",
            "jumps_every",
            "jumps_from",
            "jumps_to",
            "prescription",
            "vertex_distance",
            "eye_file",
        ],
    ),
    (
        "Time",
        &[
            "rate",
            "speed",
            "looped",
            "follow",
            "first",
            "duration",
            "start_at",
            "sync",
            "mark",
            "keep_phase",
            "ahead",
            "clock",
        ],
    ),
    (
        "Samples",
        &[
            "watch",
            "latency",
            "real_time",
            "trackers.rate",
            "trackers.pupil",
            "trackers.duration",
            "trackers.focal_length",
            "describe",
        ],
    ),
    (
        "Camera",
        &[
            "camera",
            "camera_steps",
            "camera_keep",
            "camera_every",
            "camera_model",
            "captures",
            "captures_max",
            "keep",
            "camera_timeout",
            "quick",
            "iris",
            "settle",
            "register",
            "temperature",
        ],
    ),
    ("Calibration", &["calibrate", "targets", "trackers.calibration", "trackers.eye"]),
    ("Window", &["preview.window", "zoom", "save_to", "live.view", "show.view"]),
    ("Bare phases", &["phase_unit", "pitch", "wavelength", "focal_length", "geometry", "exposure"]),
    ("Video frames", &["encoded", "as_shown"]),
    ("Engine", &["engine", "device", "vulkan_from", "rounds", "beside", "dry", "time_again"]),
    (
        "Output",
        &[
            "out",
            "json",
            "timings",
            "stats",
            "record",
            "trace",
            "raw",
            "shared",
            "at",
            "journal",
            "replay",
            "report",
            "overwrite",
            "jod_maps",
            "alone",
            "binning",
        ],
    ),
];

/// Above options that are in no row.
const OTHERS: &str = "More";

/// Commands with fewer options than this show them in one list.
const MANY: usize = 10;

fn heading(command: &str, option: &str) -> &'static str {
    let own = format!("{command}.{option}");
    let of = |name: &str| HEADINGS.iter().find(|(_, options)| options.contains(&name)).map(|h| h.0);
    of(&own).or_else(|| of(option)).unwrap_or(OTHERS)
}

/// The command line of `C`, its options under headings.
pub fn command<C: CommandFactory>() -> Command {
    C::command().mut_subcommands(|sub| {
        let name = sub.get_name().to_owned();
        // A negative number is the value of its option, which refuses it: no unknown option.
        let takes_none = |option: &clap::Arg| {
            option.is_positional() || option.is_allow_hyphen_values_set() || !option.get_action().takes_values()
        };
        let sub = sub.mut_args(|option| if takes_none(&option) { option } else { option.allow_negative_numbers(true) });
        if sub.get_opts().count() < MANY {
            return sub;
        }
        sub.mut_args(|option| match option.is_positional() {
            true => option,
            false => {
                let heading = heading(&name, option.get_id().as_str());
                option.help_heading(heading)
            }
        })
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::commands::Cli;

    #[test]
    fn every_option_of_a_command_with_many_has_a_heading_and_every_row_an_option() {
        let command = command::<Cli>();
        let mut known = Vec::new();
        for sub in command.get_subcommands() {
            for option in sub.get_opts() {
                known.extend([option.get_id().to_string(), format!("{}.{}", sub.get_name(), option.get_id())]);
                let many = sub.get_opts().count() >= MANY;
                assert_eq!(
                    option.get_help_heading().is_some(),
                    many,
                    "--{} of {}: a row of HEADINGS",
                    option.get_id(),
                    sub.get_name()
                );
                let missing = option.get_help_heading() == Some(OTHERS);
                assert!(!missing, "--{} of {} is in no row of HEADINGS", option.get_id(), sub.get_name());
            }
        }
        for option in HEADINGS.iter().flat_map(|h| h.1) {
            assert!(known.iter().any(|k| k == option), "{option}: no command has it");
        }
    }
}
