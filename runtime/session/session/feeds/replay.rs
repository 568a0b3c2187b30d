//! Replays a recorded session on a simulated clock, with the same sets lit in the same order.

use crate::encode::{Encoder, Lighting, PhaseSet};
use crate::session::content::scenes::FrameFreshness;
use crate::session::feeds::journal::{Decision, RecordedSession, motion_of, pupil_of};
use crate::session::feeds::sets::{FinishedSet, LiveSource, SetMaker, SetSender, set_channel};
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::latency::Timestamps;
use crate::session::playback::scheduler::Target;
use crate::session::refinement::field::LiveColor;
use crate::session::refinement::live_refiner::LiveRefiner;
use eyebox_base::reason;

pub(crate) struct Replay {
    kept: RecordedSession,
    colors: Vec<LiveColor>,
    refiner: LiveRefiner,
    encoder: Encoder,
    /// The times at which the sub-frames of each color are lit.
    lighting: Lighting,
    sender: SetSender,
    /// The set that was handed over last, and the scene of the next sets.
    newest: Option<u64>,
    content: Option<u64>,
    steps: u32,
}

impl Replay {
    /// Starts from the content that the session started with. Sets are made when they are requested.
    pub(crate) fn start(
        kept: RecordedSession,
        colors: Vec<LiveColor>,
        refiner: LiveRefiner,
        encoder: Encoder,
        lighting: Lighting,
    ) -> Result<LiveSource, SessionError> {
        let (sender, mut source) = set_channel(&encoder.frames(), 1, || Ok::<_, SessionError>(None))?;
        let (newest, content, steps) = (None, None, 0);
        let replay = Self { kept, colors, refiner, encoder, lighting, sender, newest, content, steps };
        source.make = Some(Box::new(replay));
        Ok(source)
    }

    /// Makes the set that was lit next in the recorded session.
    fn light_next(&mut self) -> Result<(), SessionError> {
        let Some(wanted) = self.kept.lit.next() else {
            self.sender.end();
            return Ok(());
        };
        while self.newest.is_none_or(|newest| newest < wanted) {
            let Some(decision) = self.kept.decisions.next() else {
                return Err(reason!("set-not-kept", "set {wanted}: the session journal lacks its decisions").into());
            };
            match decision {
                Decision::Scene { number, anew, colors } => {
                    if anew {
                        self.refiner.forget_aim();
                    }
                    let scene = self.kept.scene(number, &colors, &self.colors)?;
                    self.refiner.follow(&scene)?;
                    self.content = Some(number);
                }
                Decision::Steps { pupil, motion, turn, steps } => {
                    self.refiner.aim(pupil_of(pupil))?;
                    self.refiner.moves(&motion.map(motion_of).unwrap_or_default(), self.lighting.times(turn))?;
                    let mut left = steps;
                    self.refiner.round_while(|_, _| {
                        let more = left > 0;
                        left = left.saturating_sub(1);
                        more
                    })?;
                    self.steps += steps;
                }
                Decision::Carry { pixels, look } => {
                    self.refiner.shift_phases(pixels.turns(), &self.lighting, look)?;
                }
                Decision::Fit {} => drop(self.refiner.fit()?),
                Decision::Whole {} => self.refiner.show_whole()?,
                Decision::Set { number } => {
                    self.newest = Some(number);
                    if number >= wanted {
                        self.hand_over(number)?;
                    }
                }
                Decision::Lit { .. } => {}
            }
        }
        Ok(())
    }

    fn hand_over(&mut self, number: u64) -> Result<(), SessionError> {
        let Some(mut buffer) = self.sender.buffer() else { return Ok(()) };
        self.refiner.settle()?;
        self.encoder.encode_into(&PhaseSet::trusted(&self.refiner.sent()?), &mut buffer.frames)?;
        buffer.lit_by(self.refiner.sources());
        self.sender.send(FinishedSet {
            number,
            buffer,
            timestamps: Timestamps::default(),
            pupil: [0.0; 2],
            focus: None,
            steps: std::mem::take(&mut self.steps),
            content: self.content,
            moment: None,
            arrived_ns: None,
            supply: FrameFreshness::Same,
            estimated_db: None,
            phases: None,
            scene: None,
            motion: Vec::new(),
        });
        Ok(())
    }
}

impl SetMaker for Replay {
    fn can_make(&mut self, _target: Target) -> bool {
        true
    }

    fn make(&mut self, _target: Target) -> Result<(), SessionError> {
        self.light_next()
    }
}
