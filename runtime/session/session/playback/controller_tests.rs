//! Tests the start, the checks and the end of the controller of a session.

use super::*;
use crate::optics::{ChannelOrder, DeviceKind, Display, VideoLink};
use crate::present::SECOND_NS;
use crate::present::plm::Simulated;
use crate::session::frame_log::trace::Trace;
use crate::session::scripted::Application;
use crate::session::stage::Scripted;
use crate::session::{Cost, PresentedFrame, Session, SessionOptions, soak_tests};
use crate::solve::SplitMix;

fn device() -> Device {
    Device::new(DeviceKind::Dlpc900, VideoLink::DisplayPort)
}

fn watch(simulated: &Simulated, hz: f64) -> (Watch, Notes) {
    let controller = Controller::new(Box::new(simulated.clone())).unwrap();
    let mut prepared = PreparedController::start(device(), Some(controller), plm::usual_leds()).unwrap();
    let again = simulated.clone();
    prepared.reopen = Box::new(move || Controller::new(Box::new(again.clone())));
    let notes = Notes::default();
    let rate = Rate::from_hz(hz).unwrap();
    (Watch::new(prepared, rate, notes.clone(), Trace::none().track("controller")).unwrap(), notes)
}

fn kinds(report: &ControllerReport) -> Vec<&'static str> {
    report.events.iter().map(|event| event.kind).collect()
}

/// Planes that a line has stopped are no lost picture.
#[test]
fn a_line_that_stops_the_planes_is_no_fault() {
    let simulated = Simulated::new();
    let controller = Controller::new(Box::new(simulated.clone())).unwrap();
    let mut device = device();
    device.trigger_in = Some(crate::optics::Edge::Rising);
    let prepared = PreparedController::start(device, Some(controller), plm::usual_leds()).unwrap();
    let rate = Rate::from_hz(60.0).unwrap();
    let mut watch = Watch::new(prepared, rate, Notes::default(), Trace::none().track("controller")).unwrap();
    let mut goes_on = || true;
    for is_high in [false, false, true, true, false] {
        simulated.set_faults(|faults| faults.trigger_in_2 = is_high);
        watch.step(&mut goes_on);
        watch.step(&mut goes_on);
    }
    let (report, _) = watch.finish();
    assert_eq!(kinds(&report), ["running", "trigger", "trigger", "trigger"]);
    assert_eq!((report.lost_pictures, report.errors, report.asleep), (0, 0, true));
    assert!(report.stopped >= 5, "{report:?}");
}

#[test]
fn aborts_and_lost_pictures_are_counted_and_noted_once() {
    let simulated = Simulated::new();
    simulated.set_faults(|faults| faults.rate_hz = 60.1);
    let (mut watch, notes) = watch(&simulated, 60.0);
    assert_eq!(simulated.receiver(), 2, "the receiver is on before the display opens");
    let mut goes_on = || true;
    watch.step(&mut goes_on);
    for _ in 0..2 {
        simulated.pass(Duration::from_secs(1));
        watch.step(&mut goes_on);
    }
    simulated.set_faults(|faults| faults.picture = false);
    simulated.pass(Duration::from_secs(1));
    watch.step(&mut goes_on); // the picture is lost
    watch.step(&mut goes_on); // there is no picture
    simulated.set_faults(|faults| (faults.picture, faults.rate_hz) = (true, 60.0));
    watch.step(&mut goes_on);
    assert!(simulated.is_running());
    simulated.pass(Duration::from_secs(1));
    watch.step(&mut goes_on);
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
fn a_controller_that_is_unplugged_is_set_up_again_when_it_returns() {
    let simulated = Simulated::new();
    let (mut watch, notes) = watch(&simulated, 60.0);
    watch.step(&mut || true);
    simulated.set_faults(|faults| faults.unplugged = true);
    watch.step(&mut || true);
    assert!(watch.is_lost && !watch.is_running());
    watch.step(&mut || true);
    assert_eq!((watch.report.errors, watch.report.reconnections), (1, 0));
    simulated.set_faults(|faults| faults.unplugged = false);
    watch.step(&mut || true);
    assert!(!watch.is_lost && watch.is_running() && simulated.is_running());
    simulated.set_faults(|faults| faults.unplugged = true);
    watch.step(&mut || true);
    let (report, _) = watch.finish();
    assert_eq!(kinds(&report), ["running", "error", "connected", "running", "error"]);
    assert_eq!((report.errors, report.reconnections, report.asleep), (2, 1, false));
    assert_eq!(report.events[1].error.as_ref().expect("an error").code, "link");
    assert!(std::iter::from_fn(|| notes.take()).count() >= 4);
}

#[test]
fn the_end_does_not_wait_for_a_picture() {
    let simulated = Simulated::new();
    simulated.set_faults(|faults| faults.picture = false);
    let (mut watch, _) = watch(&simulated, 60.0);
    watch.step(&mut || false);
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

/// A session is shown by a controller that loses its picture, its USB cable, replies and video frames, while the
/// tracker blinks and the application stalls. The picture comes back by itself, and each plane is counted.
#[test]
fn a_session_on_a_controller_with_faults_accounts_for_every_plane() {
    const RATE: u32 = 60;
    let seconds = if soak_tests::is_full() { 600.0 } else { 24.0 };
    let simulated = Simulated::new();
    let (mut watch, _) = watch(&simulated, f64::from(RATE));
    let stage = Scripted::new("planes8", 16, 3);
    let mut app = Application::new(&stage, 30, [51_300_000, i64::MAX]);
    app.stalls = (1..200).map(|i| [12 * i, 12 * i + 2].map(|s| s * SECOND_NS / 4)).collect();
    let cost = Cost::Fixed { step: Duration::from_millis(3), encode: Duration::from_micros(500) };
    let live = stage.live(app, cost, 7);
    let mut noise = SplitMix(23);
    // The video frames in all, with planes and without, and the planes.
    let mut counts = [0_u64; 4];
    let faulty_until = seconds - 8.0;
    let (told, tell) = std::sync::mpsc::channel();
    let observer = move |frame: &PresentedFrame<'_>| {
        let now_s = frame.predicted_display_time_ns as f64 * 1e-9;
        let behind = Duration::from_secs_f64(now_s.max(0.0)).saturating_sub(simulated.elapsed());
        simulated.pass(behind);
        if counts[0].is_multiple_of(u64::from(RATE)) {
            // One of five faults, or none.
            let fault = if now_s < faulty_until { (8.0 * noise.unit()) as usize } else { 7 };
            let [cable, picture, rate, reply, sequence] = std::array::from_fn(|i| fault == i);
            simulated.set_faults(|faults| {
                (faults.unplugged, faults.picture) = (cable, !picture);
                faults.rate_hz = if rate { 61.0 } else { f64::from(RATE) };
                (faults.drop_replies, faults.wrong_sequence) = (u32::from(reply), u32::from(sequence));
            });
            watch.step(&mut || true);
        }
        let planes = simulated.lit_planes(!0).len() as u64;
        let now = [1, u64::from(planes > 0), u64::from(planes == 0), planes];
        counts.iter_mut().zip(now).for_each(|(count, now)| *count += now);
        let _ = told.send((counts, watch.is_running() && simulated.is_running(), watch.report.clone()));
    };
    let options = SessionOptions {
        display_rate: Some(Rate::new(RATE, 1).unwrap()),
        duration: Some(Duration::from_secs_f64(seconds)),
        observer: Some(Box::new(observer)),
        ..SessionOptions::default()
    };
    let session = Session::start(live, Output::Memory { simulated: true, sink: None }, options).unwrap();
    let ([frames, lit, dark, planes], shows, report) = tell.iter().last().unwrap();
    let ended = session.stop();
    ended.result.unwrap();
    let account = ended.statistics.report.account;
    println!("{lit} video frames lit, {dark} dark, {report:?}");
    assert_eq!((frames, account.missed_presents), (account.video_frames, 0));
    assert_eq!((lit + dark, planes), (frames, lit * PLANES as u64));
    let live = ended.statistics.live.unwrap();
    let content = account.video_frames - account.idle_sets;
    assert_eq!(live.sub_frames.iter().sum::<u64>(), 8 * content, "each sub-frame is lit for the first time or again");
    assert!(shows, "the picture came back");
    assert!(report.lost_pictures > 0 && report.reconnections > 0 && report.aborts > 0 && report.errors > 0);
}
