//! `eyebox show live:NAME` shows frames of an application in another process.

use super::args::{Ask, ShowSettings};
use super::content::{Show, display_for, refined};
use super::tracked::Stage;
use crate::subject::{Steered, SubjectOptions};
use crate::{Failure, common};
use eyebox::low_level::optics::Display;
use eyebox::low_level::reason;
use eyebox::low_level::session::{Cost, LiveInput, LiveKind};

/// Shows frames of an application in another process. `listening` runs when the application may connect.
pub(super) fn show(
    args: &Show,
    settings: ShowSettings,
    name: &str,
    listening: impl FnOnce() -> Result<(), Failure>,
) -> Result<(), Failure> {
    let cost = match &args.replay {
        // The decisions of a journal are not timed again.
        Some(_) if args.live.tracker.tracker.is_none() => Some(Cost::Measured),
        Some(_) => {
            return Err(Failure::Arguments(reason!(
                "replay-with-tracker",
                "the journal of --replay contains its samples. Leave out --tracker"
            )));
        }
        None => in_real_time(args, &settings, name)?,
    };
    let stage = Stage::open(&args.subject, &args.live)?;
    let (mut steered, display) = dark(args, &args.subject, name, &stage)?;
    if args.replay.is_none() {
        steered.scenes = Some(Box::new(input(args, &settings, name, (&steered, &display), &stage)?));
        if args.live.tracker().is_none() && args.subject.options.depth.is_none() {
            eprintln!(
                "note: without a tracker, eyes are assumed to focus at 0 mm. Give --depth for content at other depths"
            );
        }
        eprintln!("live:{name} waits for an application");
        listening()?;
    }
    super::content::show(args, settings, steered, cost, stage)
}

/// Opens live:NAME-left and live:NAME-right for the displays of two eyes.
pub(super) fn of_two_eyes(
    args: &Show,
    settings: &ShowSettings,
    name: &str,
    subjects: &[SubjectOptions; 2],
    stage: &Stage,
) -> Result<[Steered; 2], Failure> {
    in_real_time(args, settings, name)?;
    let [of_left, of_right] = ["left", "right"].map(|eye| format!("{name}-{eye}"));
    let (mut left, left_display) = dark(args, &subjects[0], &of_left, stage)?;
    let (mut right, right_display) = dark(args, &subjects[1], &of_right, stage)?;
    let left_input = input(args, settings, &of_left, (&left, &left_display), stage)?;
    let mut right_input = input(args, settings, &of_right, (&right, &right_display), stage)?;
    right_input.expose_like(&left_input);
    left.scenes = Some(Box::new(left_input));
    right.scenes = Some(Box::new(right_input));
    eprintln!("live:{of_left} and live:{of_right} wait for an application");
    Ok([left, right])
}

/// Refuses a simulated clock.
fn in_real_time(args: &Show, settings: &ShowSettings, name: &str) -> Result<Option<Cost>, Failure> {
    match refined(args, settings)? {
        None => Ok(None),
        Some(_) => {
            let line = "an application needs real time. Leave out --clock simulated";
            Err(Failure::Arguments(reason!("live", "live:{name}: {line}")))
        }
    }
}

/// Returns darkness until the first frame arrives, and its display.
fn dark(args: &Show, subject: &SubjectOptions, name: &str, stage: &Stage) -> Result<(Steered, Display), Failure> {
    let display = display_for(subject, None)?;
    let colors = common::colors(&subject.display, &display)?;
    let seed = subject.experiment.refinement()?.seed;
    let (name, engine) = (format!("live:{name}"), stage.engines.open()?);
    let steered = Steered::dark(&name, &display, colors, (args.frames()?, seed), engine.as_ref())?;
    Ok((steered, display))
}

/// Opens the input of an application.
fn input(
    args: &Show,
    settings: &ShowSettings,
    name: &str,
    (steered, display): (&Steered, &Display),
    stage: &Stage,
) -> Result<LiveInput, Failure> {
    let views = args.subject.options.views.unwrap_or(5).clamp(1, 64) as u32;
    let kind = match settings.ask {
        Ask::Views => LiveKind::Views,
        Ask::Depth => LiveKind::ColorAndDepth,
        Ask::Layers => LiveKind::Layers,
    };
    let mut input = LiveInput::open(name, display, &steered.colors, views, kind)?;
    // A journal is shown again to the bit, on any engine. The host decodes its frames for that.
    if args.journal.is_none()
        && let Some(reason) = input.decode_with(stage.engines.backend())?
    {
        tracing::info!("views pass through the host: {reason}");
    }
    Ok(input)
}
