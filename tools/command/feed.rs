//! `eyebox feed` sends frames of scenes to a display that shows live content.

use crate::Failure;
use crate::common;
use crate::groups::DisplayArgs;
use crate::signals;
use crate::talk::print_report;
use crate::values::{MM, rate};
use clap::Args;
#[cfg(target_os = "linux")]
use eyebox::low_level::gpu::SlotWriter as Writer;
use eyebox::low_level::present::Rate;
use eyebox::low_level::reason;
use eyebox::low_level::scene::{self, Request, Stage, ViewGrid};
use eyebox_live_input::{Application, Content, FrameInfo, Kind, LiveError, Offer, Sample, Transfer, Wanted};
use serde::Serialize;
use std::time::{Duration, Instant};

/// The arguments of `eyebox feed`.
#[derive(Args)]
pub struct Feed {
    /// Scenes that follow each other (built-in ones, light-field folders, or one folder of such folders)
    #[arg(required = true, value_name = "SCENE")]
    pub scenes: Vec<String>,
    /// Name of the display, which takes frames as live:NAME
    #[arg(help_heading = "Display", long)]
    pub name: String,
    /// Holograms per second, one for each frame of a scene
    #[arg(help_heading = "Time", long, value_name = "HZ", value_parser = rate, default_value = "30")]
    pub rate: Rate,
    /// Parameter of the built-in scene that goes from one value to the other and back. camera=-2..2 moves the camera.
    /// shift=-0.3..0.3 moves the fruit of the still lifes or the pattern of builtin:plane. depth=-1..1 moves
    /// builtin:plane in depth
    #[arg(help_heading = "Scene", long, value_name = "KEY=A..B", value_parser = path)]
    pub r#move: Option<ParameterPath>,
    /// Frames from one end of the path to the other
    #[arg(help_heading = "Steps", long, value_name = "N", default_value_t = 16, value_parser = clap::value_parser!(u32).range(2..=1000))]
    pub move_frames: u32,
    /// Send the views of built-in scenes around the pupil that the display requests
    #[arg(help_heading = "Scene", long)]
    pub per_pupil: bool,
    /// Keep the frames on the display's device, if it has one, so that they do not pass through the host
    #[arg(help_heading = "Scene", long)]
    pub on_device: bool,
    /// Number of frames [default: until the display ends]
    #[arg(help_heading = "Quality", long, value_name = "N")]
    pub count: Option<u64>,
    #[command(flatten)]
    pub display: DisplayArgs,
    /// One JSON object on standard output
    #[arg(help_heading = "Output", long)]
    pub json: bool,
}

/// A parameter and its two end values.
#[derive(Debug, Clone, PartialEq)]
pub struct ParameterPath {
    key: String,
    ends: [f64; 2],
}

/// Other systems have no writer.
#[cfg(not(target_os = "linux"))]
type Writer = std::convert::Infallible;

/// Time limit for an answer of the display.
#[cfg(target_os = "linux")]
const ANSWER: Duration = Duration::from_secs(10);
/// Limit of the memory of frames, bytes. All frames are made before the first is sent.
const MOST: u64 = 4 << 30;

fn path(text: &str) -> Result<ParameterPath, String> {
    let read = || {
        let (key, ends) = text.split_once('=')?;
        let (a, b) = ends.split_once("..")?;
        // The other parameters are shares of the picture.
        let is_length = ["camera", "depth"].contains(&key);
        let number = |text: &str| if is_length { MM.read(text).ok() } else { text.parse().ok() };
        let ends = [number(a)?, number(b)?];
        (!key.is_empty() && ends.iter().all(|v: &f64| v.is_finite())).then(|| ParameterPath { key: key.into(), ends })
    };
    read().ok_or_else(|| "a path is KEY=A..B, such as camera=-2..2".into())
}

/// The counts of requests and frames.
#[derive(Default, Serialize)]
struct Account {
    /// Requests that were received.
    asked: u64,
    /// Frames that were sent.
    given: u64,
    /// Frames that stayed on a device.
    on_device: u64,
    /// Frames that were sent more than one period late.
    late: u64,
    /// Seconds from the first frame to the last.
    seconds: f64,
    /// The reason for the end.
    ended: &'static str,
}

/// Sends frames to a display.
pub fn run(args: &Feed) -> Result<(), Failure> {
    signals::catch_interrupt();
    let sources = sources(args)?;
    let mut application = Application::connect(&args.name).map_err(Failure::Live)?;
    let frames = load(args, &sources, application.offer())?;
    let writer = if args.on_device { device_of(&mut application)? } else { None };
    let account = give(args, &mut application, &frames, writer)?;
    if args.json {
        let report = serde_json::to_value(&account).map_err(|e| Failure::Arguments(reason!("json", "no JSON: {e}")))?;
        print_report(report);
    } else {
        let Account { asked, given, on_device, late, seconds, ended } = account;
        let stayed = if args.on_device { format!(", {on_device} on the device") } else { String::new() };
        println!("{given} frames in {seconds:.1} s{stayed}, {late} of them late; {asked} requests; {ended}");
    }
    Ok(())
}

/// Opens a writer of frames on the display's device. If the display has no device to share, prints a note and returns
/// None.
#[cfg(target_os = "linux")]
fn device_of(application: &mut Application) -> Result<Option<Writer>, Failure> {
    use eyebox::low_level::gpu::{DeviceIds, Gpu, Options, SharedLayout};

    let host = |reason: &str| {
        eprintln!("note: frames pass through the host: {reason}");
        Ok(None)
    };
    let Some(its) = application.device() else {
        return host("the display has no device whose memory it shares");
    };
    let ids = DeviceIds { device: its.device, driver: its.driver };
    let gpu = match Gpu::open_same(ids, &Options::default()) {
        Ok(gpu) => gpu,
        Err(error) => return host(&error.to_string()),
    };
    let Some((memory, fd)) = application.share(ANSWER).map_err(Failure::Live)? else {
        return host("the display's device has no memory left to share");
    };
    let layout = SharedLayout {
        memory_bytes: memory.memory_bytes,
        buffer_bytes: memory.buffer_bytes,
        memory_type: memory.memory_type,
        usage: memory.usage,
    };
    Ok(Some(Writer::new(&gpu, fd, &layout, memory.slot_stride)?))
}

#[cfg(not(target_os = "linux"))]
fn device_of(_application: &mut Application) -> Result<Option<Writer>, Failure> {
    Ok(None)
}

/// Returns the scenes, one per frame. They begin again after the last.
fn sources(args: &Feed) -> Result<Vec<String>, Failure> {
    let one = || args.scenes.first().filter(|_| args.scenes.len() == 1);
    if let Some(ParameterPath { key, ends: [a, b] }) = &args.r#move {
        let built_in = one().filter(|s| s.starts_with("builtin:"));
        let scene = built_in.ok_or_else(|| {
            Failure::Arguments(reason!("path-of-many", "--move moves one built-in scene. Give one alone"))
        })?;
        let mark = if scene.contains('?') { '&' } else { '?' };
        let at = |step: u32| a + (b - a) * f64::from(step) / f64::from(args.move_frames - 1);
        let there_and_back = (0..args.move_frames).chain((1..args.move_frames - 1).rev());
        return Ok(there_and_back.map(|step| format!("{scene}{mark}{key}={}", at(step))).collect());
    }
    match one() {
        Some(one) => Ok(scene::sequence(one, &[])?.unwrap_or_else(|| args.scenes.clone())),
        None => Ok(args.scenes.clone()),
    }
}

/// A frame that is ready to be sent.
enum Ready {
    /// The views of the scene, which are the same for every pupil.
    Made { info: Box<FrameInfo>, samples: Vec<u8> },
    /// A built-in scene, whose views are rendered for each request.
    Stage(Vec<Stage>),
}

fn load(args: &Feed, sources: &[String], offer: &Offer) -> Result<Vec<Ready>, Failure> {
    let asked = |reason: String| Failure::Arguments(reason!("live", "live:{}: {reason}", args.name));
    if !offer.kinds.contains(&Kind::Views) {
        return Err(asked("the display takes no views, and scenes are views".into()));
    }
    let size = args.display.size.unwrap_or(offer.size.map(|n| n as usize));
    let display =
        common::display_of_size(args.display.display.as_deref().unwrap_or("paper"), Some(size), args.display.force)?;
    let wanted = [
        eyebox::low_level::optics::Color::Red,
        eyebox::low_level::optics::Color::Green,
        eyebox::low_level::optics::Color::Blue,
    ];
    let colors: Vec<_> = wanted.into_iter().zip(offer.colors).filter(|(_, is)| *is).map(|(color, _)| color).collect();
    colors.iter().try_for_each(|color| display.optics(*color).map(drop))?;
    let views = offer.views[0].min(offer.views[1]) as usize;
    let bytes = sources.len() as u64 * (offer.pixels() * offer.channels() * views * views * 4) as u64;
    if bytes > MOST {
        return Err(asked(format!(
            "{} frames take {} MiB, of 4096. Give fewer scenes or --move-frames",
            sources.len(),
            bytes >> 20
        )));
    }
    if args.per_pupil {
        let [rows, columns] = size;
        if rows != columns {
            return Err(asked(format!(
                "--per-pupil renders square pictures, and the display takes {rows} x {columns}"
            )));
        }
        let stage = |source: &String| {
            let Some(name) = source.strip_prefix("builtin:") else {
                return Err(asked(format!("--per-pupil is for built-in scenes, and {source} is none")));
            };
            let stages = colors.iter().map(|color| Stage::new(name, &display, *color, rows));
            Ok(Ready::Stage(stages.collect::<Result<_, _>>()?))
        };
        return sources.iter().map(stage).collect();
    }
    let request = Request { views, ..Request::new(&display, &colors) };
    let ready = |source: &String| {
        let field = scene::load(source, &request)?;
        if [field.height, field.width] != offer.size.map(|n| n as usize) {
            let [rows, columns] = offer.size;
            let found = format!("{} x {}", field.height, field.width);
            return Err(asked(format!("the display takes {rows} x {columns}, but {source} is {found}. Set --size")));
        }
        let grid = field.grid.map(|n| n as u32);
        let content = Content::Views { grid, pitch_mm: field.cell(&display) * 1e3 };
        let info = Box::new(FrameInfo::new(content, Sample::F32, Transfer::Linear));
        Ok(Ready::Made { info, samples: interleaved(&field.planes) })
    };
    sources.iter().map(ready).collect()
}

/// Returns views that are stored color by color as float32 bytes in the order (view, row, column, color).
fn interleaved(planes: &[Vec<Vec<f32>>]) -> Vec<u8> {
    let views = planes.first().map_or(0, Vec::len);
    let pixels = planes.first().and_then(|views| views.first()).map_or(0, Vec::len);
    let places = (0..views).flat_map(|view| (0..pixels).map(move |pixel| (view, pixel)));
    places.flat_map(|(view, pixel)| planes.iter().flat_map(move |c| c[view][pixel].to_le_bytes())).collect()
}

/// Renders the requested views.
fn around(stages: &[Stage], wanted: &Wanted) -> (FrameInfo, Vec<u8>) {
    let [rows, columns] = wanted.views;
    let grid = ViewGrid { rows: rows as usize, columns: columns as usize, cell: wanted.pitch_mm * 1e-3 };
    let [x, y] = wanted.center_mm.map(|mm| mm * 1e-3);
    let beside = |(dx, dy): (f64, f64)| (x + dx, y + dy);
    let places: Vec<(f64, f64)> = (0..grid.rows * grid.columns).map(|view| beside(grid.position(view))).collect();
    let planes: Vec<Vec<Vec<f32>>> = stages.iter().map(|stage| stage.views(&places)).collect();
    let content = Content::Views { grid: wanted.views, pitch_mm: wanted.pitch_mm };
    let info = FrameInfo { center_mm: wanted.center_mm, ..FrameInfo::new(content, Sample::F32, Transfer::Linear) };
    (info, interleaved(&planes))
}

/// Sends a frame on the device. The device keeps it at `place` unless it `changes`.
#[cfg(target_os = "linux")]
fn give_there(
    application: &mut Application,
    writer: &mut Writer,
    (info, samples): (&mut FrameInfo, &[u8]),
    place: &mut Option<usize>,
    changes: bool,
) -> Result<(), Failure> {
    let number = match *place {
        Some(number) if !changes => number,
        before => writer.keep(before, samples)?,
    };
    *place = Some(number);
    info.on_device = true;
    let slot = application.begin(info).map_err(Failure::Live)?;
    writer.write(slot.index(), number)?;
    slot.publish();
    Ok(())
}

#[cfg(not(target_os = "linux"))]
fn give_there(
    _application: &mut Application,
    writer: &mut Writer,
    _frame: (&mut FrameInfo, &[u8]),
    _place: &mut Option<usize>,
    _changes: bool,
) -> Result<(), Failure> {
    match *writer {}
}

fn give(
    args: &Feed,
    application: &mut Application,
    frames: &[Ready],
    mut writer: Option<Writer>,
) -> Result<Account, Failure> {
    // The places of frames on the device, by the number of the frame. Frames that are rendered again share one place.
    let mut kept: Vec<Option<usize>> = vec![None; frames.len().max(1)];
    let start = Instant::now();
    let mut account = Account { ended: "all given", ..Account::default() };
    while args.count.is_none_or(|most| account.given < most) {
        if signals::interrupted() {
            account.ended = "interrupted";
            break;
        }
        let due = Duration::from_secs_f64(account.given as f64 / args.rate.hz());
        let left = due.saturating_sub(start.elapsed());
        match application.wait(left.min(Duration::from_millis(100))) {
            Ok(asked) => account.asked += u64::from(asked),
            Err(LiveError::Gone) => {
                account.ended = "the display is gone";
                break;
            }
            Err(error) => return Err(Failure::Live(error)),
        }
        if start.elapsed() < due {
            continue;
        }
        account.late += u64::from((start.elapsed() - due).as_secs_f64() > 1.0 / args.rate.hz());
        let request = application.request();
        let (mut info, made);
        let at = (account.given % frames.len() as u64) as usize;
        let samples = match (&frames[at], &request) {
            (Ready::Made { info: its, samples }, _) => {
                info = **its;
                samples
            }
            // The display has sent no request yet.
            (Ready::Stage(_), None) => {
                std::thread::sleep(Duration::from_millis(1));
                continue;
            }
            (Ready::Stage(stages), Some(request)) => {
                (info, made) = around(stages, &request.wanted);
                &made
            }
        };
        if let Some(request) = request {
            (info.request, info.content_time_ns) = (request.number, request.lit_ns);
        }
        match &mut writer {
            Some(writer) => {
                let changes = matches!(frames[at], Ready::Stage(_));
                let place = &mut kept[if changes { 0 } else { at }];
                give_there(application, writer, (&mut info, samples), place, changes)?;
                account.on_device += 1;
            }
            None => drop(application.send(&info, samples, &[]).map_err(Failure::Live)?),
        }
        account.given += 1;
        account.seconds = start.elapsed().as_secs_f64();
    }
    Ok(account)
}
