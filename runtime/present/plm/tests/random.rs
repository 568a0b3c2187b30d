//! Random orders of calls and faults.

use crate::plm::setup::SOURCE_TIME;
use crate::plm::table::usual_leds;
use crate::plm::{Controller, Faults, PlmError, Simulated, State};
use eyebox_base::random::SplitMix;
use eyebox_optics::VideoLink;
use std::time::Duration;

struct Run {
    random: SplitMix,
    device: Simulated,
    controller: Controller,
}

impl Run {
    fn below(&mut self, count: u64) -> u64 {
        self.random.next() % count
    }

    fn link(&mut self) -> VideoLink {
        if self.below(2) == 0 { VideoLink::Hdmi } else { VideoLink::DisplayPort }
    }

    /// Runs one call. Some are out of order.
    fn call(&mut self) -> Result<(), PlmError> {
        match self.below(9) {
            0 | 1 => {
                let link = self.link();
                self.controller.prepare(link).map(drop)
            }
            2 => {
                let patience = self.below(3);
                self.controller.wait_for_source(SOURCE_TIME, &mut || patience > 0)
            }
            3 | 4 => {
                let rate = [24.0, 30.0, 60.0, 60.1, 480.0, f64::NAN][self.below(6) as usize];
                self.controller.begin(rate, &usual_leds()).map(drop)
            }
            5 => self.controller.poll().map(drop),
            6 => self.controller.recover(),
            7 => self.controller.sleep(),
            _ => {
                // The program is killed, and another one takes the device.
                let fresh = Controller::new(Box::new(self.device.clone()))?;
                std::mem::forget(std::mem::replace(&mut self.controller, fresh));
                Ok(())
            }
        }
    }

    fn change_faults(&mut self) {
        let (which, amount) = (self.below(12), self.below(4) as u32);
        self.device.set_faults(|faults| match which {
            0 => faults.unplugged = amount == 0,
            1 => faults.picture = amount > 0,
            2 => faults.rate_hz = [24.0, 30.0, 60.0, 60.1][amount as usize],
            3 => faults.drop_replies = amount,
            4 => faults.short_replies = (amount, 4 * amount as usize),
            5 => faults.wrong_sequence = amount,
            6 => faults.refuse = amount,
            7 => faults.hardware_bits = [0, 1, 8, 0x80][amount as usize],
            8 => faults.is_old = amount == 0,
            9 => faults.mode_is_stuck = amount == 0,
            10 => faults.never_starts = amount == 0,
            _ => *faults = Faults::default(),
        });
        let time = self.below(1500);
        self.device.pass(Duration::from_millis(time));
    }
}

/// After each call, the controller is in a state whose name says what the device does. After the faults are gone, it
/// starts and sleeps, whatever happened before.
#[test]
fn a_thousand_random_orders_end_in_a_named_state() {
    let (mut ran, mut failed) = (0, 0);
    for seed in 0..1000 {
        let device = Simulated::new();
        let controller = Controller::new(Box::new(device.clone())).unwrap();
        let mut run = Run { random: SplitMix(seed), device: device.clone(), controller };
        for _ in 0..12 {
            if run.below(3) == 0 {
                run.change_faults();
            }
            let result = run.call();
            failed += u32::from(result.is_err());
            match (run.controller.state(), result.is_ok()) {
                (State::Asleep, true) => assert!(!device.is_running() && device.receiver() == 0, "seed {seed}"),
                (State::Prepared, true) => assert!(!device.is_running(), "seed {seed}"),
                _ => {}
            }
        }
        device.set_faults(|faults| *faults = Faults::default());
        device.pass(Duration::from_secs(2));
        let link = run.link();
        run.controller.prepare(link).unwrap_or_else(|e| panic!("seed {seed}: {e}"));
        run.controller.wait_for_source(SOURCE_TIME, &mut || true).unwrap_or_else(|e| panic!("seed {seed}: {e}"));
        run.controller.begin(60.0, &usual_leds()).unwrap_or_else(|e| panic!("seed {seed}: {e}"));
        assert!(device.is_running() && run.controller.state() == State::Running, "seed {seed}");
        run.controller.sleep().unwrap();
        assert!(!device.is_running() && device.receiver() == 0, "seed {seed}");
        assert_eq!(run.controller.state(), State::Asleep, "seed {seed}");
        ran += 1;
    }
    // Faults and calls out of order occurred, and not only those.
    assert!(ran == 1000 && (1000..11_000).contains(&failed), "{failed} of 12000 calls failed");
}
