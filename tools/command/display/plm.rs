//! Checks the controller of a phase light modulator with test pictures, and asks for what was seen.

use crate::Failure;
use crate::progress;
use crate::show::args::OutputTo;
use crate::show::controller_line;
use crate::talk::print_report;
use eyebox::low_level::optics::{Display, LevelOrder};
use eyebox::low_level::present::plm::{Identity, PLANES, plane_of_bit};
use eyebox::low_level::reason;
use eyebox::low_level::session::PatternOutput;
use serde_json::json;
use std::io;
use std::time::Duration;

/// The most levels that are shown. A PLM has 16.
const MOST_LEVELS: usize = 256;
/// The time from the light of a test picture to the question about it.
const SETTLE: Duration = Duration::from_millis(100);

/// Prints the identity of a controller.
pub fn print_identity(identity: &Identity) {
    let versions = &identity.versions;
    eprintln!(
        "controller {} ({}): application {}, API {}, configuration {}, sequence {}",
        identity.firmware,
        identity.board,
        versions.application,
        versions.api,
        versions.configuration,
        versions.sequence
    );
    if let Some(flips) = &identity.flips {
        let is = |flipped| if flipped { "flipped" } else { "not flipped" };
        eprintln!("the long axis is {}, the short axis is {}", is(flips.long_axis), is(flips.short_axis));
    }
}

/// The answers of a user, line by line.
struct Answers(io::Lines<io::StdinLock<'static>>);

impl Answers {
    /// Prints a question and returns the answer. It is `None` after the end of the answers.
    fn ask(&mut self, question: &str) -> Result<Option<String>, Failure> {
        if progress::interrupted() {
            return Err(Failure::Arguments(reason!("interrupted", "interrupted. The controller sleeps")));
        }
        eprintln!("{question}");
        match self.0.next() {
            Some(Ok(line)) => Ok(Some(line.trim().to_owned())),
            Some(Err(error)) => Err(Failure::Arguments(reason!("standard-input", "standard input: {error}"))),
            None => Ok(None),
        }
    }
}

/// Returns the name of a plane, such as G0.
fn name(plane: usize) -> String {
    let bit = plane_of_bit(plane);
    format!("{}{}", ['R', 'G', 'B'][bit / 8], bit % 8)
}

/// Shows each plane alone. Returns the planes that stay dark, and how many were answered.
fn planes(output: &mut PatternOutput, answers: &mut Answers) -> Result<(Vec<String>, usize), Failure> {
    let (mut dark, mut answered) = (Vec::new(), 0);
    for plane in 0..PLANES {
        output.show_plane(plane)?;
        let question = format!(
            "plane {} ({plane} of 0 to {}). Press Enter if it is lit, or type - if not",
            name(plane),
            PLANES - 1
        );
        let Some(answer) = answers.ask(&question)? else { break };
        answered += 1;
        if answer == "-" {
            dark.push(name(plane));
        }
    }
    Ok((dark, answered))
}

/// Shows each level next to level 0. Returns the levels from the smallest shift of the fringes to the largest, if each
/// was answered.
fn levels(output: &mut PatternOutput, count: usize, answers: &mut Answers) -> Result<Option<Vec<usize>>, Failure> {
    let mut shifts = Vec::new();
    for level in 0..count {
        output.show_level(level)?;
        let question =
            format!("level {level} of 0 to {}. Type the shift of the fringes in any unit, or Enter to skip", count - 1);
        let Some(answer) = answers.ask(&question)? else { break };
        if answer.is_empty() {
            continue;
        }
        let shift: f64 = answer.parse().ok().filter(|shift: &f64| shift.is_finite()).ok_or_else(|| {
            Failure::Arguments(reason!(
                "shift",
                "level {level}: '{answer}' is no number. Give the shift of the fringes"
            ))
        })?;
        shifts.push((level, shift));
    }
    if shifts.len() < count {
        return Ok(None);
    }
    shifts.sort_by(|a, b| a.1.total_cmp(&b.1));
    Ok(Some(shifts.into_iter().map(|(level, _)| level).collect()))
}

/// Returns the conclusion from the order of the levels in words.
fn in_words(order: &LevelOrder) -> String {
    match order {
        LevelOrder::Rising => "the levels rise, so cells and codes are right".into(),
        LevelOrder::Falling => "the levels fall. Change the sign of the shifts, or reverse phases_turns".into(),
        LevelOrder::UpsideDownCells => "the cells are upside down. Exchange the rows of cells, or change the flip of \
                                        the short axis"
            .into(),
        LevelOrder::MirroredCells => "the cells are swapped left to right. Exchange the columns of cells, or change \
                                      the flip of the long axis"
            .into(),
        LevelOrder::TurnedCells => "the cells are turned by 180 degrees. Turn cells, or change both flips".into(),
        LevelOrder::NotRising { levels } => {
            let levels: Vec<String> = levels.iter().map(usize::to_string).collect();
            format!(
                "the levels do not rise. Levels {} are out of place. Measure phases_turns of them again",
                levels.join(", ")
            )
        }
        _ => "the levels do not rise".into(),
    }
}

/// Starts the controller of a display, shows its planes and levels one after the other, and prints the conclusions.
pub fn check(display: &Display, to: &OutputTo, as_json: bool) -> Result<(), Failure> {
    let Some(device) = &display.device else {
        let name = &display.name;
        return Err(Failure::Arguments(reason!(
            "no-device",
            "{name}: --output is for a display with a controller. Add [device] to its file, or leave --output out"
        )));
    };
    if !device.simulated && !to.is_shown() {
        return Err(Failure::Arguments(reason!(
            "not-shown",
            "the controller needs a picture. Give --output window or --output direct"
        )));
    }
    let color = display.wavelengths.first().map(|w| w.color);
    let colors: Vec<_> = color.into_iter().collect();
    progress::catch_interrupt();
    let mut output = PatternOutput::open(&to.output(false), display, &colors, SETTLE)?;
    output.controller().into_iter().for_each(print_identity);
    let mut answers = Answers(io::stdin().lines());
    let (dark, lit) = planes(&mut output, &mut answers)?;
    let count = (display.levels as usize).min(MOST_LEVELS);
    let seen = levels(&mut output, count, &mut answers)?;
    let report = output.finish()?;
    let judge = |seen: &Vec<usize>| display.encoding.judge_levels(count, seen).map_err(Failure::Arguments);
    let order = seen.as_ref().map(judge).transpose()?;
    if let Some(report) = &report {
        eprintln!("{}", controller_line(report));
    }
    if as_json {
        let controller = report.map(|report| report.to_json());
        print_report(json!({
            "controller": controller, "planes_answered": lit, "dark_planes": dark, "levels_seen": seen, "levels": order,
        }));
        return Ok(());
    }
    match dark.is_empty() {
        true => println!("{lit} of {PLANES} planes were answered, and none is dark"),
        false => println!("dark planes: {}", dark.join(", ")),
    }
    println!("{}", order.as_ref().map_or("the levels were not answered".into(), in_words));
    Ok(())
}
