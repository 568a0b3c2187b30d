//! Shows a hologram on a display and refines it for a moving eye, as the program of a headset does.
//!
//! Run `cargo run --example display_loop`. The display is memory here, and the eye moves along a line. For a real
//! display use `Output::Window` or `Output::Direct`, and for a tracker `Tracking::open`.

use eyebox::encode::Encoder;
use eyebox::engine::{Backend, Choice};
use eyebox::gaze::Estimator;
use eyebox::gpu::Options;
use eyebox::optics::{Color, Display, Padding};
use eyebox::scene::{self, Request};
use eyebox::session::{Live, LiveColor, Output, Session, SessionEvent, SessionOptions, Tracking};
use eyebox::solve::{Flow, Problem, Settings, solve};
use std::time::Duration;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    // The scene is solved for the whole eyebox.
    let display = Display { height: 96, width: 112, ..Display::load("planes8")? };
    let field = scene::load("builtin:still-life", &Request::new(&display, &[Color::Green]))?;
    let problem = Problem::new(&field, Color::Green, &display, Padding::default())?;
    let settings = Settings { steps: 24, ..Settings::default() };
    let backend = Backend::open(Choice::Auto, &Options::default())?;
    let mut engine = backend.engine()?;
    let whole = solve(&problem, &settings, engine.as_mut(), &mut |_| Flow::Continue)?;

    // From now on, separate threads refine the hologram for the position of the eye.
    let encoder = Encoder::new(&display, &[Color::Green], settings.frames)?;
    let colors = vec![LiveColor { problem, phases: whole.phases, exposure: whole.exposure, laser: None }];
    let (eye, tracking) = Tracking::mouse(Estimator::new(Default::default(), None)?);
    let live = Live::new(colors, encoder, backend, tracking);
    let output = Output::Memory { simulated: false, sink: None };
    let session = Session::start(live, output, SessionOptions::default())?;
    println!("{}: {:.0} sets per second", session.about().presenter, session.about().sets_per_second());

    // This is the program's own loop. It sends the position of the pupil in meters, and receives the events of the
    // session.
    for moment in 0..200 {
        eye.push([f64::from(moment) * 2e-5, 0.0]);
        match session.event(Duration::from_millis(10)) {
            Some(SessionEvent::Note(note)) => println!("{note}"),
            Some(_) => break,
            None => {}
        }
    }
    let ended = session.stop();
    let live = ended.statistics.live.ok_or("the session was not live")?;
    println!("{} sets refined in {} steps", live.sets_new, live.steps);
    ended.result?;
    Ok(())
}
