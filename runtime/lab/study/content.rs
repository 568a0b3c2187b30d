//! What moments gain: content that stands still, moves or jumps, set by set, for an eye that rests or follows it.
//!
//! Every set has its own content frame and as many steps; the eye is the study's, before its tracker. What is seen is judged by
//! what an eye sees that turns as it should (OPTICS 15), against the scene's photograph integrated over the motion. Where sets
//! roll, every video frame is decided on, and what is seen is the sub-frames that were lit in a set's time until then, each from
//! the set that was the newest when its turn came.

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

/// What the content of a study does.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum StudiedContent {
    /// It stands still.
    Still,
    /// It moves to the right, round the edges of the picture.
    Moving,
    /// Every so many sets it is another: the next slide, or the scene's mirror image somewhere else.
    Jumping,
}

/// What an eye does with content that moves.
#[derive(Debug, Clone, Copy, PartialEq, Eq, Serialize)]
#[serde(rename_all = "lowercase")]
pub enum StudiedEye {
    /// It looks where it looked.
    Rests,
    /// It follows the content.
    Follows,
}

/// What is studied, beside the eye.
#[derive(Debug, Clone)]
pub struct ContentSettings {
    /// What content does, one after the other.
    pub contents: Vec<StudiedContent>,
    /// So many sets.
    pub sets: u32,
    /// So many steps of every colour for each.
    pub steps: u32,
    /// Content that moves does so by so many pixels a set.
    pub speed: u32,
    /// Content that jumps does so every so many sets.
    pub jumps_every: u32,
    /// Pictures that content jumps to, one after the other and then back to the scene. If there are none, it jumps to its mirror image.
    pub slides: Vec<Vec<LiveColor>>,
    /// What is begun with after a jump.
    pub start: JumpStart,
    /// The tables, as [`start_tables`](eyebox::low_level::session::start_tables) gives them; empty where none is used.
    pub start_tables: Vec<Option<Arc<StartTable>>>,
    /// When the sub-frames of each colour are lit: of sets that are shown whole, or that roll.
    pub lighting: Lighting,
}

/// One way to show one content to one eye, and what it sees.
#[derive(Debug, Clone, Serialize)]
pub struct ContentRun {
    /// What the content does.
    pub content: StudiedContent,
    /// What the eye does.
    pub eye: StudiedEye,
    /// Whether the hologram is refined for where the pupil is; else for all of the eyebox, with as many steps.
    pub steered: bool,
    /// Whether its sub-frames are refined for their moments.
    pub moments: bool,
    /// Set by set; where sets roll, video frame by video frame.
    pub samples: Vec<ContentSample>,
}

/// What was lit in a set's time: one set, or, where sets roll, the sub-frames that came last.
#[derive(Debug, Clone, Copy, Serialize)]
pub struct ContentSample {
    /// The middle of its light, seconds from the beginning.
    pub time_s: f64,
    /// PSNR of what the eye sees, mean over the colours, dB.
    pub db: f64,
    /// Of sets that roll, the video frame that came last; else 0.
    pub turn: u32,
    /// Sets since the content changed as a whole.
    pub since_jump: u32,
    /// Whether the content has jumped with this set.
    pub jumped: bool,
    /// Whether the eye is in a saccade.
    pub saccade: bool,
}

impl ContentRun {
    /// Mean, worst and best of the sets outside saccades, from `from` sets after the beginning and after every jump, dB; none where
    /// there is no such set.
    pub fn summary(&self, from: u32) -> Option<[f64; 3]> {
        let all: Vec<f64> = self.settled(from).map(|s| s.db).collect();
        let worst = all.iter().copied().reduce(f64::min)?;
        let best = all.iter().copied().reduce(f64::max)?;
        Some([all.iter().sum::<f64>() / all.len() as f64, worst, best])
    }

    /// The same sets, and of sets that roll the windows that end with each of their video frames: the means of these, worst and
    /// best, dB. None where there is no such set.
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

/// Shows `colors`, a scene that stands still with its hologram for the whole eyebox, as each content of `settings`, to each eye,
/// with and without steering and moments. `study` has the eye and when sets are lit; `observe` is told after every set which share is
/// done, and may end the study.
///
/// # Errors
/// [`SessionError::Setting`] for what cannot be; those of the engines.
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
            "a study of content has a set, a step and a period at least"
        )));
    }
    if let Some(slide) = settings.slides.iter().find(|slide| slide.len() != colors.len()) {
        let (has, wanted) = (slide.len(), colors.len());
        return Err(SessionError::Setting(reason!("slide-colors", "a slide has {has} colors, and the scene {wanted}")));
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
    // What had been refined is of no other scene's hologram: it goes on.
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

/// The frames of content that is made of one scene.
struct Frames<'a> {
    colors: &'a [LiveColor],
    settings: &'a ContentSettings,
}

/// Which frame a set shows.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
enum Picture {
    /// The scene, so many pixels to the right, or its mirror image.
    Scene { shift: usize, mirrored: bool },
    /// Another picture.
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
    /// Which frame that is, and the moment that it shows.
    shown: Picture,
    shows_ns: i64,
    jumped: u32,
    /// It has jumped, and nothing was begun with yet.
    begins: bool,
    /// The newest set, colour by colour, and what was lit in a set's time until now.
    newest: Vec<Vec<f32>>,
    lit: Vec<Vec<f32>>,
    /// How the eye turns that follows the content, radians a second.
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
        let first =
            frames.colors.first().ok_or_else(|| SessionError::Setting(reason!("no-color", "there is no colour")))?;
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

    /// Refines for a set, or for a video frame of sets that roll, and sees what was lit in a set's time until then.
    fn decide(&mut self, decision: u64, seen: &mut [SeenColor]) -> Result<Option<ContentSample>, SessionError> {
        let StudySettings { period_ns, lead_ns, light_after_ns, .. } = *self.study;
        let ContentSettings { lighting, steps, .. } = self.frames.settings;
        let turns = lighting.turns() as u64;
        let (set, turn) = ((decision / turns) as u32, (decision % turns) as usize);
        let frame_ns = period_ns / turns as i64;
        let set_ns = i64::from(set + 1) * period_ns;
        let start_ns = set_ns + turn as i64 * frame_ns;
        let light_ns = start_ns + light_after_ns / turns as i64;
        // Steps begin a period before it is handed over.
        let now_ns = start_ns - lead_ns.min(SetTiming::usual_lead_ns(frame_ns)) - frame_ns;
        if turn == 0 {
            self.next_frame(set, set_ns + light_after_ns)?;
        }
        let at = |time_ns: i64| u64::try_from(time_ns).unwrap_or(0);
        // The first video frame of a set has a step, however few there are: with it begins what content has jumped to.
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
        // A black photograph has no PSNR.
        Ok(db.map(|db| ContentSample { time_s, db, turn: turn as u32, since_jump, jumped, saccade }))
    }

    /// The content frame of a set, which shows the middle of its light.
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

    /// What was lit in a set's time that had its middle then, and ended with this turn.
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

/// An eye before its tracker that turns to the right besides.
struct Pursuing {
    source: SimulatedSource,
    /// Of its pupil, metres a second.
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
