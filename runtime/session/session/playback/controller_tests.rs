//! Tests the start, the checks and the end of the controller of a session.

use super::*;
use crate::optics::{ChannelOrder, DeviceKind, Display, VideoLink};
use crate::present::plm::Simulated;
use crate::session::frame_log::trace::Trace;

fn device() -> Device {
    Device::new(DeviceKind::Dlpc900, VideoLink::DisplayPort)
}

fn watch(simulated: &Simulated, hz: f64) -> (Watch, Notes) {
    let controller = Controller::new(Box::new(simulated.clone())).unwrap();
    let prepared = PreparedController::start(device(), Some(controller), plm::usual_leds()).unwrap();
    let notes = Notes::default();
    let rate = Rate::from_hz(hz).unwrap();
    (Watch::new(prepared, rate, notes.clone(), Trace::none().track("controller")).unwrap(), notes)
}

fn kinds(report: &ControllerReport) -> Vec<&'static str> {
    report.events.iter().map(|event| event.kind).collect()
}

#[test]
fn aborts_and_lost_pictures_are_counted_and_noted_once() {
    let simulated = Simulated::new();
    simulated.set_faults(|faults| faults.rate_hz = 60.1);
    let (mut watch, notes) = watch(&simulated, 60.0);
    assert_eq!(simulated.receiver(), 2, "the receiver is on before the display opens");
    let mut goes_on = || true;
    assert!(watch.step(&mut goes_on));
    for _ in 0..2 {
        simulated.pass(Duration::from_secs(1));
        assert!(watch.step(&mut goes_on));
    }
    simulated.set_faults(|faults| faults.picture = false);
    simulated.pass(Duration::from_secs(1));
    assert!(watch.step(&mut goes_on), "the picture is lost");
    assert!(watch.step(&mut goes_on), "there is no picture");
    simulated.set_faults(|faults| (faults.picture, faults.rate_hz) = (true, 60.0));
    assert!(watch.step(&mut goes_on) && simulated.is_running());
    simulated.pass(Duration::from_secs(1));
    assert!(watch.step(&mut goes_on));
    let (report, _) = watch.finish();
    assert_eq!(kinds(&report), ["running", "abort", "abort", "abort", "no-picture", "error", "running"]);
    assert_eq!((report.checks, report.aborts, report.lost_pictures, report.errors), (5, 3, 1, 1));
    assert!(report.exposure_us == Some(694) && report.asleep && simulated.receiver() == 0);
    let error = report.events[5].error.as_ref().expect("an error");
    assert_eq!(error.code, "no-source");
    let mut noted = 0;
    while notes.take().is_some() {
        noted += 1;
    }
    assert_eq!(noted, 5, "an abort is noted once in a row");
    assert_eq!(report.to_json()["aborts"], 3);
}

#[test]
fn a_controller_that_is_unplugged_ends_its_thread_alone() {
    let simulated = Simulated::new();
    let (mut watch, _) = watch(&simulated, 60.0);
    assert!(watch.step(&mut || true));
    simulated.set_faults(|faults| faults.unplugged = true);
    assert!(!watch.step(&mut || true));
    let (report, _) = watch.finish();
    assert!(!report.asleep && report.errors == 2);
    assert_eq!(report.events[1].error.as_ref().expect("an error").code, "link");
}

#[test]
fn the_end_does_not_wait_for_a_picture() {
    let simulated = Simulated::new();
    simulated.set_faults(|faults| faults.picture = false);
    let (mut watch, _) = watch(&simulated, 60.0);
    assert!(watch.step(&mut || false));
    let (report, _) = watch.finish();
    assert!(report.errors == 0 && report.asleep && report.exposure_us.is_none());
}

/// A plane has the source of the color that the encoder puts there, in any order of channels.
#[test]
fn lights_follow_the_encoder() {
    let all = [Color::Red, Color::Green, Color::Blue];
    let leds = |order: ChannelOrder, colors: &[Color], together| {
        let mut display = Display { height: 4, width: 4, ..Display::preset("planes24").unwrap() };
        display.encoding.channel_order = order;
        leds_of_planes(&Encoder::new(&display, colors, 24 / colors.len()).unwrap(), together).unwrap()
    };
    let by_eight = |eight: [Leds; 3]| -> [Leds; PLANES] { std::array::from_fn(|plane| eight[plane / 8]) };
    // Red's sub-frames are in the channel that is shown first. The controller shows green first.
    let first = leds(ChannelOrder::Grb, &all, false);
    assert_eq!(first, by_eight([Leds::RED, Leds::GREEN, Leds::BLUE]));
    assert_eq!(leds(ChannelOrder::Rgb, &all, false), by_eight([Leds::GREEN, Leds::RED, Leds::BLUE]));
    assert_eq!(leds(ChannelOrder::Rgb, &[Color::Blue], false), [Leds::BLUE; PLANES]);
    assert_eq!(leds(ChannelOrder::Rgb, &[Color::Blue], true), [Leds::ALL; PLANES]);
    // Gray video frames have no planes.
    let display = Display { height: 4, width: 4, ..Display::preset("planes8").unwrap() };
    let error = leds_of_planes(&Encoder::new(&display, &[Color::Green], 8).unwrap(), false).unwrap_err();
    assert_eq!(ErrorData::of(&error).code, "setting/device-packing");
}
