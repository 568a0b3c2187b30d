//! Encodes each refined set and hands it over.

use super::Refining;
use crate::encode::PhaseSet;
use crate::optics::PupilDistribution;
use crate::present::Clock;
use crate::session::feeds::journal::Decision;
use crate::session::feeds::sets::{FinishedSet, SetBuffer};
use crate::session::frame_log::account::RepeatReason;
use crate::session::frame_log::error::SessionError;
use crate::session::frame_log::latency::Timestamps;
use crate::session::refinement::work_time::WorkTime;
use std::sync::Arc;
use std::time::Instant;

impl Refining {
    /// Encodes the current phases without showing them.
    pub(super) fn rehearse(&mut self) -> Result<(), SessionError> {
        let Some(mut buffer) = self.sender.buffer() else { return Ok(()) };
        let begun = Instant::now();
        let encoded = self.encode(&mut buffer);
        self.encoding = begun.elapsed();
        self.sender.give_back(buffer);
        encoded
    }

    fn encode(&mut self, buffer: &mut SetBuffer) -> Result<(), SessionError> {
        match (&mut self.device, self.refiner.phases_on_device()) {
            (Some(device), Some(phases)) => {
                device.encode_on_device(&phases)?;
                match &mut buffer.pictures {
                    Some(pictures) => device.draw(pictures)?,
                    None => device.download(buffer.frames.bytes_mut())?,
                }
            }
            _ => self.encoder.encode_into(&PhaseSet::trusted(&self.refiner.sent()?), &mut buffer.frames)?,
        }
        Ok(())
    }

    /// Encodes the current phases, refined for `aim`, and hands the set over.
    pub(super) fn hand_over(
        &mut self,
        timestamps: Timestamps,
        aim: Option<PupilDistribution>,
        steps: u32,
        time: &mut WorkTime,
    ) -> Result<(), SessionError> {
        let begun = Instant::now();
        self.sender.does(RepeatReason::EncodingTooLong);
        let Some(mut buffer) = self.sender.buffer() else { return Ok(()) };
        self.encode(&mut buffer)?;
        buffer.lit_by(self.refiner.sources());
        time.encoded();
        self.options.journal.iter().for_each(|journal| journal.keep(Decision::Set { number: self.number }));
        let handed_over_ns = self.options.clock.map_or_else(|| time.now_ns(), |clock| clock.now_ns());
        let timestamps = Timestamps { handed_over_ns, ..timestamps };
        let pupil = aim.map_or([0.0; 2], |aim| aim.centre);
        let focus = aim.map(|PupilDistribution { focus: [low, high], .. }| 0.5 * (low + high));
        let phases = match self.options.with_phases {
            true => Some(self.refiner.phases()?.iter().map(|p| Arc::new(p.to_vec())).collect()),
            false => None,
        };
        let scene = self.scene.as_ref();
        let seen = scene.filter(|_| self.options.with_phases).map(|scene| {
            let problems = scene.colors.iter().map(|color| color.problem.clone()).collect();
            (Arc::new(problems), scene.colors.iter().map(|color| color.exposure).collect())
        });
        self.sender.send(FinishedSet {
            number: self.number,
            buffer,
            timestamps,
            pupil,
            focus,
            steps,
            content: scene.map(|scene| scene.number).or(self.first_of_scenes()),
            moment: scene.map_or_else(|| self.first_of_scenes().map(|_| 0), |scene| scene.moment),
            arrived_ns: scene.and_then(|scene| scene.arrived_ns),
            supply: self.supply,
            estimated_db: self.refiner.estimated_db().filter(|_| steps > 0),
            phases,
            scene: seen,
            motion: if self.options.with_phases { self.refiner.motions() } else { Vec::new() },
        });
        self.options.track.span("encode", self.number, begun);
        self.number += 1;
        let took = begun.elapsed();
        self.encoding = if took > self.encoding { took } else { self.encoding.mul_f64(0.9) + took.mul_f64(0.1) };
        Ok(())
    }
}
