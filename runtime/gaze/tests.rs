//! The whole way, before a simulated eye whose truth is known.

use super::*;
use crate::trackers::simulated::{self, Doing, SimulatedSource, Truth};
use crate::trackers::{Event, Sample, Source};
use std::time::Duration;

/// From a sample's arrival to the light of the set that it steers, nanoseconds.
const TO_LIGHT_NS: u64 = 20_000_000;

struct Run {
    source: SimulatedSource,
    estimator: Estimator,
}

struct Look {
    stages: Stages,
    sample: Sample,
    predicted: PupilDistribution,
    /// At the time of light.
    truth: Truth,
}

impl Run {
    fn new(settings: simulated::Settings) -> Self {
        let source = SimulatedSource::starting(settings, false, 1_000_000_000).unwrap();
        Self { source, estimator: Estimator::new(Settings::default(), None).unwrap() }
    }

    fn next(&mut self) -> Look {
        let Ok(Event::Sample(sample, _)) = self.source.next(Duration::ZERO) else { panic!("a sample") };
        let stages = self.estimator.update(&sample);
        let light = sample.received_ns + TO_LIGHT_NS;
        Look { stages, sample, predicted: self.estimator.predict(light), truth: self.source.truth(light) }
    }

    /// Whether the eye was steady and open all the time.
    fn calm(&mut self, from: u64, to: u64) -> bool {
        (0..=20u64).all(|i| {
            let truth = self.source.truth(from + (to - from) * i / 20);
            truth.lid == 1.0 && !matches!(truth.doing, Doing::Saccade { .. })
        })
    }
}

fn off(a: [f64; 2], b: [f64; 2]) -> f64 {
    (a[0] - b[0]).hypot(a[1] - b[1])
}

/// Rates and delays of real trackers.
fn trackers() -> Vec<simulated::Settings> {
    let mut all = Vec::new();
    for rate_hz in [120.0, 500.0, 1000.0] {
        for delay in [5e-3, 15e-3, 30e-3] {
            all.push(simulated::Settings { rate_hz, delay, seed: all.len() as u64 + 1, ..simulated::Settings::default() });
        }
    }
    all
}

#[test]
fn measure() {
    for settings in trackers() {
        let name = format!("{} Hz {} ms", settings.rate_hz, settings.delay * 1e3);
        let n = (settings.rate_hz * 60.0) as usize;
        let mut run = Run::new(settings);
        let (mut fix, mut nf, mut pur, mut np) = (0.0, 0.0, 0.0, 0.0);
        let (mut out2, mut out3, mut all, mut promised2, mut promised3, mut elsewhere) = (0.0, 0.0, 0.0, 0.0, 0.0, 0.0);
        let (mut jumps, mut truthjumps, mut c2, mut c3) = (0, 0, 0.0, 0.0);
        let mut was = Phase::Unseen;
        let mut lastj = 0;
        for i in 0..n {
            let look = run.next();
            if let Doing::Saccade { began_ns, .. } = look.truth.doing { if began_ns != lastj { lastj = began_ns; truthjumps += 1; } }
            if look.stages.phase == Phase::Saccade && was != Phase::Saccade { jumps += 1; }
            was = look.stages.phase;
            if (i as f64) < 0.5 * run.source.about().rate_hz.unwrap() { continue; }
            let e = off(look.predicted.centre, look.truth.position);
            let (from, to) = (look.sample.time_ns - 100_000_000, look.predicted.time_ns);
            all += 1.0;
            let p = &look.predicted;
            out2 += f64::from(e > 2.0 * p.spread);
            out3 += f64::from(e > 3.0 * p.spread);
            promised2 += p.elsewhere + (1.0 - p.elsewhere) * (-2f64).exp();
            promised3 += p.elsewhere + (1.0 - p.elsewhere) * (-4.5f64).exp();
            elsewhere += p.elsewhere;
            if run.calm(from, to) {
                c2 += f64::from(e > 2.0 * p.spread);
                c3 += f64::from(e > 3.0 * p.spread);
                if look.truth.doing == Doing::Pursuit { pur += e * e; np += 1.0 } else { fix += e * e; nf += 1.0 }
            }
        }
        let nc = nf + np;
        println!("{name}: fix {:.3} pursuit {:.3} mm; out2 {:.3} promised {:.3}; out3 {:.3} promised {:.3} (elsewhere {:.3}); calm out2 {:.3} out3 {:.3}; jumps {jumps} of {truthjumps}",
            (fix / nf as f64).sqrt() * 1e3, (pur / np as f64).sqrt() * 1e3, out2 / all, promised2 / all, out3 / all, promised3 / all, elsewhere / all, c2 / nc, c3 / nc);
    }
}
