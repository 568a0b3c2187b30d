//! Measures the gain of motion compensation for content that is still, moves or jumps (OPTICS 15).
//!
//! Each set has its own content frame and the same number of steps. The eye is the eye of the study, and it rests or
//! follows the content. The image at the eye is compared with the image of an eye that turns as it should, and with the
//! scene's target image integrated over the motion. With rolling updates, each video frame has its own decision. The
//! eye then sees the sub-frames that were lit in the time of a set until then. Each sub-frame is from the newest set at
//! its turn.

mod jumps;

use super::SeenColor;
use super::jump_start::JumpStart;
use super::results::StudySettings;
use eyebox::low_level::encode::{Lighting, LitTimes};
use eyebox::low_level::engine::{Engine, EngineError};
use eyebox::low_level::gaze::Estimator;
use eyebox::low_level::optics::Pupil;
use eyebox::low_level::reason;
use eyebox::low_level::session::{
    LiveColor, LiveRefiner, MotionCompensation, Policy, PupilEstimate, PupilSource, Samples, SessionError, SetTiming,
    lighting_of, shifted_problem, whole_eyebox,
};
use eyebox::low_level::solve::{Flow, Motion, StartTable};
use eyebox::low_level::trackers::simulated::{Doing, Eye, SimulatedSource};
use eyebox::low_level::trackers::{About, Event, Source, TrackerError};
use serde::Serialize;
use std::sync::Arc;
use std::time::Duration;

/// The motion of the content of a study.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum StudiedContent {
    /// The content is still.
    Still,
    /// The content moves to the right and reenters at the other edge of the picture.
    Moving,
    /// The content changes after every `jumps_every` sets, to the next slide or to the scene's mirror image at another
    /// place.
    Jumping,
}

/// The motion of an eye that looks at moving content.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum StudiedEye {
    /// The eye keeps its direction.
    Rests,
    /// The eye follows the content.
    Follows,
}

/// The settings of a study of content, without the eye.
#[derive(Debug, Clone)]
pub struct ContentSettings {
    /// The motions of the content, one after the other.
    pub contents: Vec<StudiedContent>,
    /// The number of sets per run.
    pub sets: u32,
    /// The number of steps of each color per set.
    pub steps: u32,
    /// The speed of moving content, in pixels per set.
    pub speed: u32,
    /// The number of sets between two jumps of jumping content.
    pub jumps_every: u32,
    /// The pictures to which content jumps, one after the other and then back to the scene. If there are none, it jumps
    /// to its mirror image.
    pub slides: Vec<Vec<LiveColor>>,
    /// The start of the refinement after a jump.
    pub start: JumpStart,
    /// The tables of first phases from [`start_tables`](eyebox::low_level::session::start_tables). Empty if no table is
    /// used.
    pub start_tables: Vec<Option<Arc<StartTable>>>,
    /// The times at which the sub-frames of each color are lit, for complete sets or for rolling updates.
    pub lighting: Lighting,
}

/// One way to show one content to one eye, with the scores of the images at the eye.
#[derive(Debug, Clone, Serialize)]
pub struct ContentRun {
    /// The motion of the content.
    pub content: StudiedContent,
    /// The motion of the eye.
    pub eye: StudiedEye,
    /// True if the hologram is refined for the position of the pupil. Otherwise it is refined for the whole eyebox,
    /// with the same number of steps.
    pub steered: bool,
    /// True if the sub-frames are refined with motion compensation.
    pub moments: bool,
    /// One sample per set, or per video frame of rolling updates.
    pub samples: Vec<ContentSample>,
}

/// The score of the light in the time of a set. This is one set, or the last sub-frames of rolling updates.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct ContentSample {
    /// The middle of the light, in seconds from the beginning.
    pub time_s: f64,
    /// The PSNR of the image at the eye, as the mean over the colors in dB.
    pub db: f64,
    /// The last video frame of a rolling update. 0 for complete sets.
    pub turn: u32,
    /// The number of sets since the content changed as a whole.
    pub since_jump: u32,
    /// True if the content has jumped with this set.
    pub jumped: bool,
    /// True if the eye is in a saccade.
    pub saccade: bool,
}

impl ContentRun {
    /// Returns mean, worst and best score of the sets outside saccades, in dB. It leaves out the first `from` sets
    /// after the beginning and after each jump. Returns `None` if there is no such set.
    pub fn summary(&self, from: u32) -> Option<[f64; 3]> {
        let all: Vec<f64> = self.settled(from).map(|s| s.db).collect();
        let worst = all.iter().copied().reduce(f64::min)?;
        let best = all.iter().copied().reduce(f64::max)?;
        Some([all.iter().sum::<f64>() / all.len() as f64, worst, best])
    }

    /// Averages these sets for each video frame with which a window of a rolling update ends. Returns the worst and the
    /// best of these means, in dB. Returns `None` if there is no such set.
    pub fn windows(&self, from: u32) -> Option<[f64; 2]> {
        let turns = self.settled(from).map(|s| s.turn).max()? + 1;
        let mean = |turn: u32| {
            let (sum, count) =
                self.settled(from).filter(|s| s.turn == turn).fold((0.0, 0), |(sum, n), s| (sum + s.db, n + 1));
            (count > 0).then(|| sum / f64::from(count))
        };
        let all = || (0..turns).filter_map(mean);
        Some([all().reduce(f64::min)?, all().reduce(f64::max)?])
    }

    fn settled(&self, from: u32) -> impl Iterator<Item = &ContentSample> {
        self.samples.iter().filter(move |s| !s.saccade && s.since_jump >= from)
    }
}

/// Shows `colors`, a still scene with its hologram for the whole eyebox, as each content of `settings` to each eye.
///
/// Each pair of content and eye is shown with and without refinement for the pupil, and with and without motion
/// compensation. The settings `study` have the eye and the times at which sets are lit. The observer receives the
/// completed share after each set, and may end the study.
///
/// # Errors
/// Returns [`SessionError::Setting`] for an invalid setting, and the errors of the engines.
pub fn study_content(
    colors: &[LiveColor],
    policy: &Policy,
    settings: &ContentSettings,
    study: &StudySettings,
    engine: &mut dyn FnMut() -> Result<Box<dyn Engine>, EngineError>,
    observe: &mut dyn FnMut(f64) -> Flow,
) -> Result<Vec<ContentRun>, SessionError> {
    let ContentSettings { sets, steps, jumps_every, .. } = *settings;
    if sets == 0 || steps == 0 || jumps_every == 0 || study.period_ns <= 0 || study.lead_ns < 0 {
        return Err(SessionError::Setting(reason!(
            "study",
            "a study of content needs at least one set, one step, a jump distance of one set and a positive period"
        )));
    }
    if let Some(slide) = settings.slides.iter().find(|slide| slide.len() != colors.len()) {
        let (has, wanted) = (slide.len(), colors.len());
        return Err(SessionError::Setting(reason!("slide-colors", "a slide has {has} colors, but the scene {wanted}")));
    }
    let lighting = lighting_of(settings.lighting.clone(), colors);
    let settings = &ContentSettings { lighting, ..settings.clone() };
    let eyes = |content: &StudiedContent| match content {
        StudiedContent::Moving => vec![StudiedEye::Rests, StudiedEye::Follows],
        _ => vec![StudiedEye::Rests],
    };
    let both = [false, true];
    let ways = |steered| both.map(|moments| (steered, moments));
    let runs: Vec<_> = settings
        .contents
        .iter()
        .flat_map(|content| eyes(content).into_iter().map(|eye| (*content, eye)))
        .flat_map(|(content, eye)| both.into_iter().flat_map(ways).map(move |way| (content, eye, way)))
        .collect();
    // No content restarts the refinement, because no hologram of another scene exists.
    let policy = Policy { restart: f64::INFINITY, ..*policy };
    let depth = 0.5 * (study.gaze.focus[0] + study.gaze.focus[1]);
    let seen = colors.iter().map(|color| SeenColor::new(color, &policy, depth, engine()?));
    let mut seen: Vec<SeenColor> = seen.collect::<Result<_, _>>()?;
    let frames = Frames { colors, settings };
    let mut all: Vec<ContentRun> = Vec::with_capacity(runs.len());
    for (i, (content, eye, (steered, moments))) in runs.iter().copied().enumerate() {
        let refiner = LiveRefiner::new(colors.to_vec(), policy, &mut *engine)?;
        let refiner = refiner.with_start_tables(settings.start_tables.clone());
        let mut run = ContentRun { content, eye, steered, moments, samples: Vec::new() };
        let mut showing = ContentDisplay::new(&frames, &run, refiner, study, depth)?;
        let decisions = u64::from(sets) * settings.lighting.turns() as u64;
        for decision in 0..decisions {
            run.samples.extend(showing.decide(decision, &mut seen)?);
            let share = (i as f64 + (decision + 1) as f64 / decisions as f64) / runs.len() as f64;
            if observe(share) == Flow::Stop {
                all.push(run);
                return Ok(all);
            }
        }
        all.push(run);
    }
    Ok(all)
}

/// The content frames that are made of one scene.
struct Frames<'a> {
    colors: &'a [LiveColor],
    settings: &'a ContentSettings,
}

/// The picture that a set shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Picture {
    /// The scene, moved right by `shift` pixels, or its mirror image.
    Scene { shift: usize, mirrored: bool },
    /// Another picture by its index.
    Slide(usize),
}

impl Picture {
    const STILL: Self = Self::Scene { shift: 0, mirrored: false };
}

impl Frames<'_> {
    fn of(&self, content: StudiedContent, set: u32) -> Picture {
        let ContentSettings { speed, jumps_every, ref slides, .. } = *self.settings;
        match content {
            StudiedContent::Still => Picture::STILL,
            StudiedContent::Moving => Picture::Scene { shift: speed as usize * set as usize, mirrored: false },
            StudiedContent::Jumping if slides.is_empty() => {
                let jumps = set / jumps_every;
                let width = self.colors.first().map_or(0, |c| c.problem.optics.width);
                Picture::Scene { shift: width / 5 * jumps as usize, mirrored: jumps % 2 == 1 }
            }
            StudiedContent::Jumping => {
                let slide = (set / jumps_every) as usize % (slides.len() + 1);
                slide.checked_sub(1).map_or(Picture::STILL, Picture::Slide)
            }
        }
    }

    fn scene(&self, picture: Picture) -> Vec<LiveColor> {
        let (shift, mirrored) = match picture {
            Picture::Scene { shift, mirrored } => (shift, mirrored),
            Picture::Slide(at) => return self.settings.slides[at].clone(),
        };
        let frame = |color: &LiveColor| LiveColor {
            problem: shifted_problem(&color.problem, shift, mirrored),
            phases: Vec::new(),
            exposure: color.exposure,
            laser: color.laser.clone(),
        };
        self.colors.iter().map(frame).collect()
    }
}

/// One way to show one content.
struct ContentDisplay<'a> {
    frames: &'a Frames<'a>,
    run: (StudiedContent, StudiedEye),
    refiner: LiveRefiner,
    study: &'a StudySettings,
    depth: f64,
    eye: Eye,
    watch: PupilSource,
    moments: MotionCompensation,
    scene: Vec<LiveColor>,
    /// The picture in `scene`.
    shown: Picture,
    /// The time that the picture shows.
    shows_ns: i64,
    jumped: u32,
    /// True if the content has jumped and the refinement has not started again yet.
    begins: bool,
    /// The phases of the newest set by color.
    newest: Vec<Vec<f32>>,
    /// The phases by color that were lit in the time of a set until now.
    lit: Vec<Vec<f32>>,
    /// The angular speed of an eye that follows the content, in radians per second.
    pursuit: f64,
}

impl<'a> ContentDisplay<'a> {
    fn new(
        frames: &'a Frames<'a>,
        run: &ContentRun,
        refiner: LiveRefiner,
        study: &'a StudySettings,
        depth: f64,
    ) -> Result<Self, SessionError> {
        let ContentSettings { speed, lighting, .. } = frames.settings;
        let first = frames
            .colors
            .first()
            .ok_or_else(|| SessionError::Setting(reason!("no-color", "the scene has no color")))?;
        let pixel = first.problem.pixel();
        let pursuit = match run.eye {
            StudiedEye::Follows => f64::from(*speed) * pixel / (study.period_ns as f64 * 1e-9),
            StudiedEye::Rests => 0.0,
        };
        let source = SimulatedSource::starting(study.eye.clone(), false, 0)?;
        let source = Pursuing { source, speed: pursuit * study.eye.radius };
        let estimator = Estimator::new(study.gaze.clone(), None)?;
        let watch = match run.steered {
            true => PupilSource::Samples(Box::new(Samples::new(Box::new(source), estimator, Arc::default()))),
            false => PupilSource::Nobody(whole_eyebox(first.problem.eyebox, [depth; 2])),
        };
        let moments = match run.moments {
            true => MotionCompensation::of(lighting.clone(), study.period_ns, pixel),
            false => MotionCompensation::default(),
        };
        let phases: Vec<Vec<f32>> = frames.colors.iter().map(|color| color.phases.clone()).collect();
        Ok(Self {
            frames,
            run: (run.content, run.eye),
            refiner,
            study,
            depth,
            eye: Eye::new(study.eye.clone(), 0),
            watch,
            moments,
            scene: frames.scene(Picture::STILL),
            shown: Picture::STILL,
            shows_ns: 0,
            jumped: 0,
            begins: false,
            newest: phases.clone(),
            lit: phases,
            pursuit,
        })
    }

    /// Refines for a set, or for a video frame of a rolling update, and scores the light in the time of a set until
    /// then.
    fn decide(&mut self, decision: u64, seen: &mut [SeenColor]) -> Result<Option<ContentSample>, SessionError> {
        let StudySettings { period_ns, lead_ns, light_after_ns, .. } = *self.study;
        let ContentSettings { lighting, steps, .. } = self.frames.settings;
        let turns = lighting.turns() as u64;
        let (set, turn) = ((decision / turns) as u32, (decision % turns) as usize);
        let frame_ns = period_ns / turns as i64;
        let set_ns = i64::from(set + 1) * period_ns;
        let start_ns = set_ns + turn as i64 * frame_ns;
        let light_ns = start_ns + light_after_ns / turns as i64;
        // Steps begin one period before the set is handed over.
        let now_ns = start_ns - lead_ns.min(SetTiming::usual_lead_ns(frame_ns)) - frame_ns;
        if turn == 0 {
            self.next_frame(set, set_ns + light_after_ns)?;
        }
        let at = |time_ns: i64| u64::try_from(time_ns).unwrap_or(0);
        // The first video frame of a set always has a step, because it starts the content after a jump.
        let share = |decisions: u64| (decisions * u64::from(*steps)).div_ceil(turns);
        let rounds = share(decision + 1) - share(decision);
        if rounds > 0 {
            let expected: PupilEstimate = self.watch.expect(at(now_ns), at(light_ns))?;
            self.refiner.aim(expected.pupil)?;
            self.refiner.moves(&self.moments.motion(light_ns, &expected), self.moments.times(turn))?;
            if let Some(look) = self.moments.find_shifts(light_ns, turn)
                && let Some((pixels, lighting)) = self.moments.shifts()
            {
                let (moved, _) = self.refiner.shift_phases(pixels, lighting, look)?;
                self.moments.carried(moved);
            }
            self.begin()?;
            for _ in 0..rounds {
                self.refiner.round_while(|_, _| true)?;
            }
            self.refiner.settle()?;
            for (newest, phases) in self.newest.iter_mut().zip(self.refiner.phases()?.iter()) {
                newest.copy_from_slice(phases);
            }
        }
        for (i, (lit, newest)) in self.lit.iter_mut().zip(&self.newest).enumerate() {
            let sub_frames = lighting.turn_of(i);
            let pixels = newest.len() / sub_frames.len().max(1);
            for (frame, _) in sub_frames.iter().enumerate().filter(|(_, is)| **is == turn) {
                lit[frame * pixels..][..pixels].copy_from_slice(&newest[frame * pixels..][..pixels]);
            }
        }
        let middle_ns = light_ns - (period_ns - frame_ns) / 2;
        let truth = self.eye.at(at(middle_ns));
        let [x, y] = truth.position;
        let x = x + self.pursuit * self.study.eye.radius * middle_ns as f64 * 1e-9;
        let pupil = Pupil { x, y, diameter: truth.diameter, depth: self.depth };
        let db = self.seen(pupil, (turn, middle_ns), seen)?;
        let saccade = matches!(truth.doing, Doing::Saccade { .. });
        let (time_s, since_jump, jumped) = (middle_ns as f64 * 1e-9, set - self.jumped, set > 0 && self.jumped == set);
        // A black target image has no PSNR.
        Ok(db.map(|db| ContentSample { time_s, db, turn: turn as u32, since_jump, jumped, saccade }))
    }

    /// Sets the content frame of a set. The frame is for the middle of its light.
    fn next_frame(&mut self, set: u32, shows_ns: i64) -> Result<(), SessionError> {
        let wanted = self.frames.of(self.run.0, set);
        if set > 0 && wanted == self.shown {
            return Ok(());
        }
        let jumps = set > 0 && self.run.0 == StudiedContent::Jumping;
        self.jumped = if jumps { set } else { self.jumped };
        self.begins = jumps;
        (self.scene, self.shown, self.shows_ns) = (self.frames.scene(wanted), wanted, shows_ns);
        self.moments.follow(&self.scene, shows_ns);
        self.refiner.follow(&self.scene)?;
        Ok(())
    }

    /// Scores the light in the time of a set that has this middle and ends with this turn.
    fn seen(&mut self, pupil: Pupil, at: (usize, i64), seen: &mut [SeenColor]) -> Result<Option<f64>, SessionError> {
        let (turn, middle_ns) = at;
        let ContentSettings { lighting, speed, .. } = self.frames.settings;
        let first = self.frames.colors.first().map_or(1.0, |c| c.problem.pixel());
        let before = 0.5 - 0.5 / lighting.turns() as f64;
        let mut lit = Vec::new();
        for (i, (color, phases)) in seen.iter_mut().zip(&self.lit).enumerate() {
            let LiveColor { problem, exposure, .. } = &self.scene[i];
            let velocity = [f64::from(*speed) * first / problem.pixel(), 0.0];
            let is = |does| if does { velocity } else { [0.0; 2] };
            let LitTimes { first, lit: [middle, length] } = lighting.times(turn + 1)[i];
            let motion = Motion {
                content: is(self.run.0 == StudiedContent::Moving),
                at: (self.shows_ns - middle_ns) as f64 / self.study.period_ns as f64,
                eye: Some(is(self.run.1 == StudiedEye::Follows)),
                lit: [middle - before, length],
                first,
                ..Motion::default()
            };
            color.seen.restart(phases)?;
            color.seen.follow(problem.clone(), *exposure)?;
            let sums = color.seen.look_through(&[motion.seen_through(pupil, self.frames.colors[i].frames())])?;
            lit.extend(sums.iter().filter_map(|s| s.quality(color.exposure)));
        }
        Ok((!lit.is_empty()).then(|| lit.iter().sum::<f64>() / lit.len() as f64))
    }
}

/// An eye before its tracker that also turns to the right.
struct Pursuing {
    source: SimulatedSource,
    /// The speed of its pupil, in meters per second.
    speed: f64,
}

impl Source for Pursuing {
    fn about(&self) -> About {
        self.source.about()
    }

    fn next(&mut self, timeout: Duration) -> Result<Event, TrackerError> {
        let mut event = self.source.next(timeout)?;
        if let Event::Sample(sample, _) = &mut event {
            let moved = self.speed * sample.time_ns as f64 * 1e-9;
            for reading in [&mut sample.left, &mut sample.right].into_iter().flatten() {
                reading.position[0] += moved;
            }
        }
        Ok(event)
    }
}
