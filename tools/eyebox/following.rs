//! `eyebox show --camera`: a camera looks at what is shown now and then, the display's model follows the bench, and the scene is solved
//! again for it.

use crate::live::{self, LiveOptions, SubjectOptions};
use crate::patterns::iris;
use crate::play::{ClockName, StreamArgs};
use crate::values::positive;
use crate::{Failure, common, progress};
use clap::Args;
use eyebox::calibrate::{Calibration, Follower, Following, ShowsPatterns};
use eyebox::engine::Engine;
use eyebox::files;
use eyebox::hologram::{NewestHologram, Sequence};
use eyebox::optics::{Color, Display};
use eyebox::session::{Output, PatternOutput};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, Sender, channel};
use std::thread;
use std::time::{Duration, Instant};

/// From when the dots lit up until they stand.
const SETTLE: Duration = Duration::from_millis(200);
/// Sets that were read and encoded before the hologram was replaced, one a second, are over by then.
const REPLACED: Duration = Duration::from_secs(15);
/// How often a thread that waits sees whether the show is over.
const PATIENCE: Duration = Duration::from_millis(20);

/// How the camera is followed.
#[derive(Args)]
pub struct FollowArgs {
    /// Take pictures of what is shown by this command, and let the display's model follow the bench: docs/calibrate.md
    #[arg(long, value_name = "COMMAND")]
    pub camera: Option<String>,
    /// Minutes from one picture to the next
    #[arg(long, default_value_t = 30.0, value_name = "MINUTES", value_parser = positive, requires = "camera")]
    pub camera_every: f64,
    /// Write the display file with the newest model
    #[arg(long, value_name = "OUT.toml", requires = "camera")]
    pub camera_model: Option<PathBuf>,
    /// Keep the pictures in this folder
    #[arg(long, value_name = "OUT_DIR", requires = "camera")]
    pub camera_keep: Option<PathBuf>,
    /// Place and diameter of an iris that does not move, mm
    #[arg(long, value_name = "X,Y,DIAMETER", value_parser = iris, allow_hyphen_values = true, requires = "camera")]
    pub iris: Option<[f64; 3]>,
}

/// What the thread with the camera sends to the one with the display.
enum Request {
    /// Show these phases before the show begins.
    Show(Vec<f32>),
    /// The show may begin.
    Begin,
}

/// Has patterns shown by the thread with the display, until the show begins: what is looked at from then on is on the screen already.
struct Proxy {
    requests: Sender<Request>,
    answers: Receiver<Result<(), String>>,
}

impl ShowsPatterns for Proxy {
    fn sub_frames(&self) -> usize {
        1
    }

    fn show(&mut self, _: Color, phases: &[f32]) -> Result<(), Box<dyn std::error::Error + Send + Sync>> {
        if self.requests.send(Request::Show(phases.to_vec())).is_err() {
            return Ok(());
        }
        Ok(self.answers.recv().unwrap_or_else(|_| Err("the display is gone".into()))?)
    }
}

/// A scene that is shown, and how.
#[derive(Clone, Copy)]
pub struct Shown<'a> {
    pub scene: &'a str,
    pub subject: &'a SubjectOptions,
    pub live: &'a LiveOptions,
    pub stream: &'a StreamArgs,
    pub follow: &'a FollowArgs,
    pub frames: usize,
}

/// Shows a scene without a tracker, and follows the bench by the camera's command.
pub fn show(
    args: Shown,
    camera: &str,
    play: impl FnOnce(Sequence, Display) -> Result<(), Failure>,
) -> Result<(), Failure> {
    let scene = args.scene;
    if args.stream.clock == Some(ClockName::Simulated) {
        return Err(Failure::Asked("--camera lives in real time: leave out --clock simulated".into()));
    }
    let model = args.follow.camera_model.as_deref();
    if let Some(file) = model {
        if file.extension().is_none_or(|e| e != "toml") {
            return Err(Failure::Asked(format!("{}: the name must end in .toml", file.display())));
        }
        files::check_place(file)?;
    }
    let mut display = common::display(&args.subject.display)?;
    args.subject.eye.replace(&mut display.prescription)?;
    let [color] = common::colors(&args.subject.display, &display)?[..] else {
        return Err(Failure::Asked("--camera follows one color: give --color".into()));
    };
    let mut engine = common::engine(&args.subject.engine)?;
    let (hologram, _) = live::solved_on(scene, args.subject, &display, Some(args.frames), engine.as_mut())?;
    drop(engine);
    let sequence = Sequence::single(Path::new(scene), hologram);
    let Some(newest) = sequence.newest() else { return Err(Failure::Asked(format!("{scene}: it is not in memory"))) };
    let output = args.live.shown.output(false, args.stream.sink());
    let over = AtomicBool::new(false);
    thread::scope(|scope| {
        let (requests, from_camera) = channel();
        let (to_camera, answers) = channel();
        let (watched, ended) = (&display, &over);
        let watcher = scope.spawn(move || {
            let bench = Watched { args, display: watched.clone(), color, newest, over: ended };
            bench.follow(camera, Proxy { requests, answers })
        });
        let begins = dots(&output, &display, color, from_camera, &to_camera);
        let shown = match begins {
            Ok(true) => play(sequence, display.clone()),
            Ok(false) => Ok(()),
            Err(failure) => Err(failure),
        };
        over.store(true, Ordering::SeqCst);
        drop(to_camera);
        let followed =
            watcher.join().unwrap_or_else(|_| Err(Failure::Asked("the thread with the camera ended".into())));
        shown.and(followed)
    })
}

/// Shows what is requested until the show may begin; whether it may.
fn dots(
    output: &Output,
    display: &Display,
    color: Color,
    requests: Receiver<Request>,
    answers: &Sender<Result<(), String>>,
) -> Result<bool, Failure> {
    let mut output = PatternOutput::open(output, display, &[color], SETTLE)?;
    for request in requests {
        match request {
            Request::Show(phases) => {
                let shown = output.show(color, &phases).map_err(|e| e.to_string());
                let _ = answers.send(shown);
            }
            Request::Begin => return Ok(true),
        }
    }
    Ok(false)
}

/// A bench that is followed.
struct Watched<'a> {
    args: Shown<'a>,
    display: Display,
    color: Color,
    newest: NewestHologram,
    over: &'a AtomicBool,
}

impl Watched<'_> {
    /// Follows it until the show is over. Once the show has begun, a camera that fails ends nothing but this.
    fn follow(mut self, camera: &str, mut proxy: Proxy) -> Result<(), Failure> {
        let follow = self.args.follow;
        let mut engine = common::engine(&self.args.subject.engine)?;
        let mut say = |line: &str| eprintln!("{line}");
        let following =
            Following { command: camera, keep: follow.camera_keep.as_deref(), limit: None, iris_mm: follow.iris };
        let begin = proxy.requests.clone();
        let mut follower = Follower::open(&self.display, self.color, &following, &mut proxy, &mut say)?;
        let _ = begin.send(Request::Begin);
        let every = Duration::from_secs_f64((follow.camera_every * 60.0).min(1e9));
        let mut wait = every;
        while self.waited(wait) {
            wait = every;
            let phases = self.newest.load().colors.swap_remove(0).phases;
            match follower.look(&phases) {
                Ok(None) => {}
                Ok(Some(calibrated)) => {
                    if self.taken_over(&calibrated, engine.as_mut())? {
                        wait = every.max(REPLACED);
                    }
                }
                Err(_) if progress::interrupted() => break,
                Err(error) if error.is_ended() => {
                    eprintln!("eyebox: {error}: the model does not follow any more");
                    return Ok(());
                }
                Err(error) => eprintln!("eyebox: {error}: the model stays as it is"),
            }
        }
        follower.close();
        Ok(())
    }

    /// Whether the show still goes on after this time.
    fn waited(&self, time: Duration) -> bool {
        let begun = Instant::now();
        while begun.elapsed() < time && !self.over.load(Ordering::SeqCst) {
            thread::sleep(PATIENCE.min(time));
        }
        !self.over.load(Ordering::SeqCst)
    }

    /// Writes the newest model, and solves the scene for it; whether another hologram is shown from now on.
    fn taken_over(&mut self, calibrated: &Calibration, engine: &mut dyn Engine) -> Result<bool, Failure> {
        let report = &calibrated.report;
        let left =
            report.unexplained.map_or_else(String::new, |share| format!(": {:.2} % is unexplained", 100.0 * share));
        if !report.calibrated {
            eprintln!("eyebox: the latest pictures are not explained{left}; the model stays as it is");
            return Ok(false);
        }
        let changed = calibrated.display.model(self.color) != self.display.model(self.color);
        self.display = calibrated.display.clone();
        if let Some(file) = &self.args.follow.camera_model {
            let text = self.display.to_toml();
            files::write_file(file, |to| to.write_all(text.as_bytes()))?;
        }
        if !changed {
            eprintln!("the bench is as its model{left}");
            return Ok(false);
        }
        let Shown { scene, subject, frames, .. } = self.args;
        let (hologram, _) = live::solved_on(scene, subject, &self.display, Some(frames), engine)?;
        let replaced = self.newest.replace(hologram).is_ok();
        eprintln!("the model followed the bench{left}; the scene was solved again for it");
        Ok(replaced)
    }
}
