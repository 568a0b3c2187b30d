//! The order of the steps, and the faults of a controller.

use crate::plm::setup::SOURCE_TIME;
use crate::plm::table::{exposure_us, usual_leds};
use crate::plm::{Command, Controller, HardwareFault, Leds, Link, PLANES, PlmError, Simulated, State};
use eyebox_optics::VideoLink::{self, DisplayPort, Hdmi};
use eyebox_optics::{Edge, PlaneTrigger};
use std::time::Duration;

fn open(device: &Simulated) -> Controller {
    Controller::new(Box::new(device.clone())).unwrap()
}

fn always() -> bool {
    true
}

/// Takes a controller through all steps, and returns the exposure.
fn start(controller: &mut Controller, link: VideoLink, rate: f64) -> Result<u32, PlmError> {
    controller.prepare(link)?;
    controller.wait_for_source(SOURCE_TIME, &mut always)?;
    controller.begin(rate, &usual_leds())
}

#[test]
fn a_controller_is_started_polled_and_put_to_sleep() {
    for (link, receiver, rate) in [(DisplayPort, 2, 60.0), (Hdmi, 1, 30.0)] {
        let device = Simulated::new();
        device.set_faults(|faults| faults.rate_hz = rate);
        let mut controller = open(&device);
        let identity = controller.prepare(link).unwrap();
        assert_eq!((identity.board, &*identity.firmware), ("unknown", "SIMULATED DLPC900"));
        assert_eq!(identity.versions.application.to_string(), "6.1.3");
        assert_eq!((controller.state(), device.receiver(), device.is_running()), (State::Prepared, receiver, false));
        controller.wait_for_source(SOURCE_TIME, &mut always).unwrap();
        assert_eq!(controller.begin(rate, &usual_leds()).unwrap(), exposure_us(rate).unwrap());
        assert_eq!(controller.state(), State::Running);
        for _ in 0..5 {
            device.pass(Duration::from_secs(1));
            let condition = controller.poll().unwrap();
            assert!(condition.is_showing() && !condition.hardware.has_aborted(), "{condition:?}");
        }
        controller.sleep().unwrap();
        assert_eq!((controller.state(), device.receiver(), device.is_running()), (State::Asleep, 0, false));
        assert_eq!(device.lost_replies(), 0, "each reply is fetched before the next command");
    }
}

#[test]
fn lines_mark_planes_and_start_them() {
    for (marked, planes) in [(PlaneTrigger::Plane, PLANES), (PlaneTrigger::Frame, 1), (PlaneTrigger::Off, 0)] {
        let device = Simulated::new();
        let mut controller = open(&device);
        controller.set_triggers(marked, None);
        start(&mut controller, DisplayPort, 60.0).unwrap();
        let lit = device.lit_planes(!0);
        assert_eq!(lit.iter().filter(|plane| plane.trigger_out_2).count(), planes);
        assert_eq!(lit[0].trigger_out_2, planes > 0, "{marked:?}");
    }
    for (edge, level) in [(Edge::Rising, true), (Edge::Falling, false)] {
        let device = Simulated::new();
        device.set_faults(|faults| faults.trigger_in_2 = !level);
        let mut controller = open(&device);
        controller.set_triggers(PlaneTrigger::Plane, Some(edge));
        start(&mut controller, DisplayPort, 60.0).unwrap();
        assert_eq!((controller.state(), device.is_running()), (State::Running, false), "{edge:?}");
        device.set_faults(|faults| faults.trigger_in_2 = level);
        assert!(device.is_running());
        controller.sleep().unwrap();
    }
}

/// The first plane that lights up is green's bit 0, and each plane has its own lights.
#[test]
fn planes_light_up_in_the_order_of_the_controller() {
    let device = Simulated::new();
    let mut controller = open(&device);
    let leds: [Leds; PLANES] = std::array::from_fn(|plane| if plane == 9 { Leds::ALL } else { Leds::BLUE });
    controller.prepare(DisplayPort).unwrap();
    controller.wait_for_source(SOURCE_TIME, &mut always).unwrap();
    assert!(device.lit_planes(!0).is_empty());
    controller.begin(60.0, &leds).unwrap();
    // Green 0 and 7, red 1, blue 2 of a pixel.
    let lit = device.lit_planes(1 << 8 | 1 << 15 | 1 << 1 | 1 << 18);
    let bits: Vec<usize> = lit.iter().enumerate().filter(|(_, plane)| plane.bit).map(|(i, _)| i).collect();
    assert_eq!(bits, [0, 7, 9, 18]);
    assert!(lit.len() == PLANES && lit.iter().all(|plane| plane.trigger_out_2 && plane.exposure_us == 694));
    assert!(lit.iter().enumerate().all(|(i, plane)| (plane.leds == Leds::ALL) == (i == 9)));
}

#[test]
fn a_rate_that_is_wrong_aborts_and_the_right_one_does_not() {
    for (given, aborts) in [(60.0, true), (60.1, false)] {
        let device = Simulated::new();
        device.set_faults(|faults| faults.rate_hz = 60.1);
        let mut controller = open(&device);
        start(&mut controller, DisplayPort, given).unwrap();
        device.pass(Duration::from_secs(1));
        let condition = controller.poll().unwrap();
        assert_eq!((condition.hardware.has_aborted(), condition.is_showing()), (aborts, true), "{given}");
    }
}

#[test]
fn a_controller_of_a_program_that_was_killed_starts_again() {
    let device = Simulated::new();
    let mut killed = open(&device);
    start(&mut killed, DisplayPort, 60.0).unwrap();
    std::mem::forget(killed);
    assert!(device.is_running());
    // An unread reply with the first sequence numbers is left in the device.
    let mut raw: Box<dyn Link> = Box::new(device.clone());
    raw.write(&crate::plm::report::read_request(Command::Mode.code(), 1)).unwrap();
    let mut again = open(&device);
    start(&mut again, Hdmi, 30.0).unwrap();
    assert!(device.is_running() && device.receiver() == 1);
    drop(again);
    assert!(!device.is_running() && device.receiver() == 0, "dropped, it sleeps");
}

#[test]
fn a_controller_without_a_picture_is_named() {
    let device = Simulated::new();
    device.set_faults(|faults| faults.picture = false);
    let mut controller = open(&device);
    let error = start(&mut controller, DisplayPort, 60.0).unwrap_err();
    assert!(matches!(error, PlmError::NoSource { waited_ms } if waited_ms >= 10_000), "{error}");
    let mut calls = 0;
    let mut goes_on = || {
        calls += 1;
        calls < 3
    };
    let error = controller.wait_for_source(SOURCE_TIME, &mut goes_on).unwrap_err();
    assert!(matches!(error, PlmError::NoSource { waited_ms } if waited_ms < 1000), "{error}");
    // Without a lock the controller refuses video patterns.
    let error = controller.begin(60.0, &usual_leds()).unwrap_err();
    assert!(matches!(error, PlmError::Refused { command: Command::Mode, error: 1, .. }), "{error}");
    assert!(!device.is_running() && controller.state() == State::Prepared);
}

#[test]
fn steps_out_of_order_are_refused() {
    let device = Simulated::new();
    let mut controller = open(&device);
    let refused = |error: PlmError| matches!(error, PlmError::Order { .. });
    assert!(refused(controller.begin(60.0, &usual_leds()).unwrap_err()));
    assert!(refused(controller.wait_for_source(SOURCE_TIME, &mut always).unwrap_err()));
    assert!(refused(controller.recover().unwrap_err()));
    start(&mut controller, DisplayPort, 60.0).unwrap();
    assert!(refused(controller.begin(60.0, &usual_leds()).unwrap_err()));
}

#[test]
fn a_lost_picture_is_recovered_without_the_receiver() {
    let device = Simulated::new();
    let mut controller = open(&device);
    start(&mut controller, DisplayPort, 60.0).unwrap();
    device.set_faults(|faults| faults.picture = false);
    device.pass(Duration::from_secs(1));
    assert!(!controller.poll().unwrap().is_showing());
    controller.recover().unwrap();
    device.set_faults(|faults| faults.picture = true);
    controller.wait_for_source(SOURCE_TIME, &mut always).unwrap();
    controller.begin(60.0, &usual_leds()).unwrap();
    assert!(controller.poll().unwrap().is_showing());
}

#[test]
fn replies_that_are_lost_late_short_or_of_others_are_survived_or_named() {
    let prepared = |change: &dyn Fn(&mut crate::plm::Faults)| {
        let device = Simulated::new();
        let mut controller = open(&device);
        controller.prepare(DisplayPort).unwrap();
        device.set_faults(change);
        (controller.poll(), device)
    };
    // A read is repeated twice.
    assert!(prepared(&|faults| faults.drop_replies = 2).0.is_ok());
    assert!(prepared(&|faults| faults.wrong_sequence = 2).0.is_ok());
    let (lost, _) = prepared(&|faults| faults.drop_replies = 3);
    let command = Command::HardwareStatus;
    assert_eq!(lost, Err(PlmError::NoReply { command, waited_ms: 3000 }));
    // Without a whole header it is no reply, and without data it is a short one.
    let (short, _) = prepared(&|faults| faults.short_replies = (9, 3));
    assert_eq!(short, Err(PlmError::NoReply { command, waited_ms: 3000 }));
    let (empty, _) = prepared(&|faults| faults.short_replies = (1, 4));
    assert_eq!(empty, Err(PlmError::ShortReply { command, bytes: 0, needed: 1 }));
    let (refused, _) = prepared(&|faults| faults.refuse = 1);
    assert_eq!(refused, Err(PlmError::Refused { command, error: 1, text: "refused".into() }));
    let (gone, _) = prepared(&|faults| faults.unplugged = true);
    assert!(matches!(gone, Err(PlmError::Link { .. })));
}

#[test]
fn faults_of_the_hardware_and_of_steps_have_their_own_errors() {
    let started = |rate: f64, change: &dyn Fn(&mut crate::plm::Faults)| {
        let device = Simulated::new();
        device.set_faults(change);
        start(&mut open(&device), DisplayPort, rate)
    };
    let fault = HardwareFault::ResetController;
    assert_eq!(started(60.0, &|f| f.hardware_bits = 4), Err(PlmError::Hardware { fault, status: 5 }));
    let error = started(60.0, &|f| f.mode_is_stuck = true).unwrap_err();
    assert!(matches!(error, PlmError::Mode { wanted: 0, mode: 1, waited_ms } if waited_ms >= 5000), "{error}");
    let error = started(60.0, &|f| f.never_starts = true).unwrap_err();
    assert!(matches!(error, PlmError::NotStarted { status: 8, waited_ms } if waited_ms >= 2000), "{error}");
    let error = started(500.0, &|_| ()).unwrap_err();
    assert_eq!(error, PlmError::Exposure { exposure_us: 83, least_us: 105, rate_hz: 500.0 });
    // Old firmware states no least exposure, and has no gamma.
    assert_eq!(started(60.0, &|f| f.is_old = true), Ok(694));
}

/// A device that answers everything with the same bytes, or with nothing.
struct Odd(Vec<u8>, Duration);

impl Link for Odd {
    fn write(&mut self, _: &[u8; 64]) -> Result<(), PlmError> {
        Ok(())
    }

    fn read(&mut self, report: &mut [u8; 64], timeout: Duration) -> Result<usize, PlmError> {
        self.1 += timeout.max(Duration::from_millis(1));
        report[..self.0.len()].copy_from_slice(&self.0);
        Ok(self.0.len())
    }

    fn close(&mut self) {}

    fn now(&self) -> Duration {
        self.1
    }
}

#[test]
fn devices_that_talk_nonsense_are_refused_without_a_panic() {
    for bytes in [&[][..], &[0xFF], &[0xFF; 64], &[0; 64], &[0xC0, 1, 0xFF, 0xFF, 0, 0], &[0xE0; 64]] {
        let odd = Odd(bytes.to_vec(), Duration::ZERO);
        let mut controller = Controller::new(Box::new(odd)).unwrap();
        let error = controller.prepare(DisplayPort).unwrap_err();
        assert!(matches!(error, PlmError::NoReply { .. } | PlmError::ShortReply { .. }), "{bytes:?}: {error}");
        assert!(controller.poll().is_err() && controller.flips().is_err() && controller.sleep().is_err());
    }
}
