//! Builds the runtime and the application, runs them with the layer, and takes their frames.

mod device;

pub use device::Shares;

use device::Taker;
use eyebox_live_input::{Content, Display, Frame, FrameInfo, Kind, Latest, Offer};
use std::io::{BufRead, BufReader, Read, Write};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::sync::{Arc, Mutex, OnceLock};
use std::thread::JoinHandle;
use std::time::{Duration, Instant};

/// Rows and columns of the display. A view of the application has as many.
const SIZE: [u32; 2] = [64, 96];
/// The tangent of the edges of a view, and the angle of a pixel that follows.
const TANGENT: &str = "tangent=0.48";
const ANGLE: f64 = 0.01;
/// The longest time of a run.
const PATIENCE: Duration = Duration::from_secs(300);

/// The programs in C, which are built once.
struct Programs {
    folder: tempfile::TempDir,
}

/// The environment of a run.
pub struct Setup {
    programs: &'static Programs,
    /// The runtime folder of live input.
    folder: tempfile::TempDir,
    variables: Vec<(&'static str, &'static str)>,
    layers: Vec<&'static str>,
    pub plan: Plan,
}

/// The displays of a run.
#[derive(Debug, Clone, Copy)]
pub struct Plan {
    /// The memory that displays share.
    pub shares: Shares,
    /// The time from the start of the application until the displays open.
    pub delay: Duration,
    /// The memory that the next displays share, which replace the first ones after twenty frames.
    pub then: Option<Shares>,
    /// True if frames pass through the host although the displays have a device.
    pub is_refused: bool,
}

/// A frame that arrived, from the host or from the device.
pub struct Picture {
    pub info: FrameInfo,
    /// The light of red, green and blue, as (row, column).
    pub channels: Vec<Vec<f32>>,
    pub dioptres: Vec<f32>,
}

/// The end of a run.
pub struct Ending {
    /// The exit code, or none for a signal.
    pub code: Option<i32>,
    pub output: String,
    pub errors: String,
    /// The answer of the display after the end.
    pub last: Latest,
}

fn cc(arguments: &[&str]) -> bool {
    let mut cc = Command::new("cc");
    let warnings = ["-Wall", "-Wextra", "-Wno-unused-parameter", "-Wno-missing-field-initializers", "-Werror"];
    let built = cc.args(["-std=gnu11", "-O1"]).args(warnings).args(arguments);
    built.current_dir(Path::new(env!("CARGO_MANIFEST_DIR")).join("tests")).status().is_ok_and(|status| status.success())
}

/// Builds the programs, or returns none if this machine has no loader of OpenXR. In CI it must have one.
fn programs() -> Option<&'static Programs> {
    static PROGRAMS: OnceLock<Option<Programs>> = OnceLock::new();
    let build = || {
        let folder = tempfile::tempdir().unwrap();
        let at = |name: &str| folder.path().join(name).display().to_string();
        std::fs::write(folder.path().join("probe.c"), "#include <openxr/openxr.h>\nint main(void) { return 0; }\n")
            .unwrap();
        if !cc(&[&at("probe.c"), "-o", &at("probe"), "-lopenxr_loader", "-lvulkan"]) {
            assert!(std::env::var_os("CI").is_none(), "no loader of OpenXR: run tools/setup.sh");
            eprintln!("no loader of OpenXR or of Vulkan, so the layer is not run (tools/setup.sh installs them)");
            return None;
        }
        let library = at("libnull.so");
        assert!(cc(&["-fPIC", "-shared", "-fvisibility=hidden", "runtime.c", "-o", &library, "-lvulkan", "-lm"]));
        assert!(cc(&["client.c", "-o", &at("client"), "-lopenxr_loader", "-lvulkan", "-lm", "-lpthread"]));
        let runtime = serde_json::json!({ "file_format_version": "1.0.0", "runtime": { "library_path": library } });
        std::fs::write(folder.path().join("runtime.json"), runtime.to_string()).unwrap();
        // Cargo places the library next to the tests.
        let mut manifest: serde_json::Value = serde_json::from_str(eyebox_openxr::MANIFEST).unwrap();
        let tests = std::env::current_exe().unwrap();
        let layer = tests.parent().unwrap().join("libeyebox_openxr.so");
        assert!(layer.is_file(), "{}", layer.display());
        manifest["api_layer"]["library_path"] = layer.display().to_string().into();
        std::fs::create_dir(folder.path().join("layers")).unwrap();
        std::fs::write(folder.path().join("layers/eyebox.json"), manifest.to_string()).unwrap();
        Some(Programs { folder })
    };
    PROGRAMS.get_or_init(build).as_ref()
}

impl Setup {
    /// Prepares a run, or returns none if this machine has no loader of OpenXR.
    pub fn new(name: &str) -> Option<Self> {
        let programs = programs()?;
        let folder = tempfile::Builder::new().prefix(name).tempdir().unwrap();
        let (variables, layers) = (Vec::new(), Vec::new());
        let plan = Plan { shares: Shares::Nothing, delay: Duration::ZERO, then: None, is_refused: false };
        Some(Self { programs, folder, variables, layers, plan })
    }

    /// Prepares runs with a display whose frames pass through the host, and with one that shares memory of its device.
    pub fn each(name: &str) -> Vec<Self> {
        let of = |shares| Some(Self::new(name)?.shares(shares));
        [Shares::Nothing, Shares::Memory].into_iter().filter_map(of).collect()
    }

    /// Prepares a run with displays that share this memory.
    pub fn shares(&self, shares: Shares) -> Self {
        self.planned(Plan { shares, ..self.plan })
    }

    /// Prepares a run with other displays.
    pub fn planned(&self, plan: Plan) -> Self {
        let Self { programs, variables, layers, .. } = self;
        let folder = tempfile::tempdir().unwrap();
        Self { programs, folder, variables: variables.clone(), layers: layers.clone(), plan }
    }

    /// Sets a variable of the environment.
    pub fn with(&self, name: &'static str, value: &'static str) -> Self {
        let variables = self.variables.iter().copied().chain([(name, value)]).collect();
        Self { folder: tempfile::tempdir().unwrap(), variables, layers: self.layers.clone(), ..*self }
    }

    /// Adds a layer between the layer and the runtime.
    pub fn below(self, layer: &'static str) -> Self {
        // Debian's layers are in a folder that the variable of the path would hide.
        if !Path::new("/usr/share/openxr/1/api_layers/explicit.d").is_dir() {
            eprintln!("no validation layer of OpenXR, so it is left out");
            return self;
        }
        Self { layers: vec![layer], ..self }
    }

    fn open(&self, name: &str) -> Display {
        let offer = Offer {
            size: SIZE,
            colors: [true; 3],
            kinds: vec![Kind::ColorAndDepth],
            views: [1, 1],
            layers: 1,
            slots: 3,
            pixel_angle: ANGLE,
            eyebox_mm: [10.0; 2],
        };
        Display::open_in(&self.folder.path().join("eyebox"), name, offer).unwrap()
    }

    /// Returns the application with its arguments.
    fn client(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(self.programs.folder.path().join("client"));
        command.args([TANGENT, "size=96x64", "start=line"]).args(arguments);
        command
    }

    fn start(&self, mut command: Command) -> Child {
        let at = |name: &str| self.programs.folder.path().join(name);
        let layers = ["XR_APILAYER_EYEBOX_live"].iter().chain(&self.layers).copied().collect::<Vec<_>>().join(":");
        let debian = "/usr/share/openxr/1/api_layers/explicit.d";
        command
            .env("XR_RUNTIME_JSON", at("runtime.json"))
            .env("XR_API_LAYER_PATH", format!("{}:{debian}", at("layers").display()))
            .env("XR_ENABLE_API_LAYERS", layers)
            .env("XDG_RUNTIME_DIR", self.folder.path())
            .env("EYEBOX_OPENXR_NAME", "pictures")
            .env("VK_INSTANCE_LAYERS", "VK_LAYER_KHRONOS_validation")
            .env("VK_LAYER_ENABLES", "VK_VALIDATION_FEATURE_ENABLE_SYNCHRONIZATION_VALIDATION_EXT")
            .env("NULL_RUNTIME_PERIOD_US", "2000")
            .envs(self.variables.iter().copied());
        command.stdin(Stdio::piped()).stdout(Stdio::piped()).stderr(Stdio::piped()).spawn().unwrap()
    }

    /// Runs the application, and gives each frame of a display to `check`.
    pub fn run(&self, name: &str, arguments: &[&str], mut check: impl FnMut(&Picture)) -> Ending {
        self.run_program(&[(name, self.plan.shares)], self.client(arguments), |_, picture, _| check(picture))
    }

    /// Runs the application with several displays, and gives each frame to `check`, with the index of its display.
    pub fn run_all(
        &self,
        displays: &[(&str, Shares)],
        arguments: &[&str],
        mut check: impl FnMut(usize, &Picture),
    ) -> Ending {
        self.run_program(displays, self.client(arguments), |index, picture, _| check(index, picture))
    }

    /// Runs a program, and gives each frame of the displays to `check`, with the running program.
    pub fn run_program(
        &self,
        displays: &[(&str, Shares)],
        command: Command,
        mut check: impl FnMut(usize, &Picture, &mut Child),
    ) -> Ending {
        let open = |shares: &[(&str, Shares)]| -> Vec<There> {
            shares.iter().map(|(name, shares)| There::new(self.open(name), *shares, self.plan.is_refused)).collect()
        };
        let mut there = if self.plan.delay.is_zero() { open(displays) } else { Vec::new() };
        let program = format!("{command:?}");
        let mut client = self.start(command);
        let output = Lines::read(client.stdout.take());
        let errors = Lines::read(client.stderr.take());
        let begun = Instant::now();
        let mut waits = program.contains("start=line");
        let mut seen = 0;
        let (code, last) = loop {
            let ended = client.try_wait().unwrap();
            // The application begins when the displays are there, or when there are none for it.
            let connected = times(&errors.text(), "takes frames of") >= displays.len() as u64;
            if waits && (connected || !self.plan.delay.is_zero() || begun.elapsed() > Duration::from_secs(3)) {
                waits = false;
                let _ = client.stdin.as_mut().unwrap().write_all(b"\n");
            }
            if there.is_empty() && begun.elapsed() >= self.plan.delay {
                there = open(displays);
            }
            for (index, one) in there.iter_mut().enumerate() {
                if let Some(picture) = one.next() {
                    check(index, &picture, &mut client);
                    seen += 1;
                }
            }
            if let Some(next) =
                self.plan.then.filter(|_| seen >= 20 && there.iter().all(|one| one.shares != self.plan.then.unwrap()))
            {
                drop(std::mem::take(&mut there));
                there = open(&displays.iter().map(|(name, _)| (*name, next)).collect::<Vec<_>>());
            }
            let is_gone = |one: &There| one.last == Latest::Gone && one.display.counts().applications > 0;
            let never = there.iter().all(|one| one.display.counts().applications == 0);
            match ended {
                Some(ended) if !there.is_empty() && there.iter().all(is_gone) => break (ended.code(), Latest::Gone),
                Some(ended) if never => break (ended.code(), Latest::Late),
                _ => {}
            }
            if begun.elapsed() > PATIENCE {
                client.kill().unwrap();
                panic!("{program} did not end");
            }
            there.first().map_or_else(|| true, |one| one.display.wait(Duration::from_millis(2)));
        };
        Ending { code, output: output.end(), errors: errors.end(), last }
    }

    /// Runs the application with a display whose frames are not checked.
    pub fn plain(&self, name: &str, arguments: &[&str]) -> Ending {
        self.run(name, arguments, |_| {})
    }
}

/// The lines that a program prints.
struct Lines {
    text: Arc<Mutex<String>>,
    thread: JoinHandle<()>,
}

impl Lines {
    fn read(pipe: Option<impl Read + Send + 'static>) -> Self {
        let text = Arc::new(Mutex::new(String::new()));
        let (pipe, its) = (BufReader::new(pipe.unwrap()), text.clone());
        let thread = std::thread::spawn(move || {
            for line in pipe.lines() {
                its.lock().unwrap().extend([line.unwrap().as_str(), "\n"]);
            }
        });
        Self { text, thread }
    }

    /// Returns the lines until now.
    fn text(&self) -> String {
        self.text.lock().unwrap().clone()
    }

    /// Returns all lines, after the end of the program.
    fn end(self) -> String {
        self.thread.join().unwrap();
        self.text.lock().unwrap().clone()
    }
}

/// A display with its device.
struct There {
    display: Display,
    frame: Frame,
    taker: Taker,
    shares: Shares,
    is_refused: bool,
    last: Latest,
}

impl There {
    fn new(display: Display, shares: Shares, is_refused: bool) -> Self {
        let (frame, taker) = (display.frame(), Taker::new(shares, display.offer().clone()));
        Self { display, frame, taker, shares, is_refused, last: Latest::Gone }
    }

    /// Returns a new frame, if there is one.
    fn next(&mut self) -> Option<Picture> {
        self.last = self.display.latest_to(&mut self.frame, &mut self.taker);
        if let Latest::Refused(fault) = self.last {
            panic!("{fault}");
        }
        if self.last != Latest::New {
            return None;
        }
        let expected = self.shares == Shares::Memory && !self.is_refused;
        assert_eq!(self.frame.info().on_device, expected, "{:?}", self.shares);
        let frame = &self.frame;
        let of_host = || Picture {
            info: *frame.info(),
            channels: (0..3).map(|channel| frame.channel(channel).to_vec()).collect(),
            dioptres: frame.dioptres().to_vec(),
        };
        Some(if frame.is_taken() { self.taker.taken.take().expect("a frame on the device") } else { of_host() })
    }
}

/// Returns the number of lines with this text.
pub fn times(errors: &str, text: &str) -> u64 {
    errors.lines().filter(|line| line.contains(text)).count() as u64
}

/// Returns the numbers of the layer's last line: frames, sent, replaced, without a display, not copied, empty, and
/// copies left out.
pub fn counts(errors: &str) -> [u64; 7] {
    let line = errors.lines().find(|line| line.contains(" sent, ")).unwrap_or_else(|| panic!("no counts: {errors}"));
    let words = line.split(|c: char| !(c.is_ascii_digit() || c == '.'));
    let numbers: Vec<u64> = words.filter_map(|word| word.parse().ok()).collect();
    numbers[..7].try_into().unwrap()
}

/// Returns the memory (KiB) of the application after a quarter of its frames and at the end.
pub fn memory(line: &str) -> [u64; 2] {
    let numbers: Vec<u64> = line.split_whitespace().filter_map(|word| word.parse().ok()).collect();
    [numbers[1], numbers[2]]
}

/// Returns the level of a color of a pixel, from 0 to 255.
fn level(light: f32, srgb: bool) -> f32 {
    let v = if !srgb {
        light
    } else if light <= 0.003_130_8 {
        light * 12.92
    } else {
        1.055 * light.powf(1.0 / 2.4) - 0.055
    };
    v * 255.0
}

/// Returns the number of the frame, which its first pixel has.
pub fn number(frame: &Picture) -> u32 {
    let part = |channel: usize| level(frame.channels[channel][0], true).round() as u32;
    part(0) + 256 * part(1)
}

/// The formulas of the application's pictures.
pub struct Wanted {
    srgb: bool,
    /// 1 / m of depth 0 and of depth 1.
    dioptres: [f64; 2],
    /// Frames that arrived, and the number of the newest one.
    pub frames: u64,
    pub newest: u32,
}

impl Wanted {
    /// Takes the form of the color and the distances as the application takes them.
    pub fn new(color: &str, distances: [&str; 2]) -> Self {
        let srgb = ["color=srgb", "color=bgra"].contains(&color);
        let meters = distances.map(|text| text.split_once('=').unwrap().1.parse::<f64>().unwrap());
        Self { srgb, dioptres: meters.map(|m| 1.0 / m), frames: 0, newest: 0 }
    }

    /// Compares a frame of an eye, pixel by pixel.
    pub fn check(&mut self, frame: &Picture, eye: u32) {
        assert_eq!(frame.info.content, Content::ColorAndDepth);
        let level = |channel: usize, at: usize| level(frame.channels[channel][at], self.srgb);
        let number = level(0, 0).round() as u32 + 256 * level(1, 0).round() as u32;
        assert!(number > self.newest, "frame {number} after {}", self.newest);
        assert_eq!(level(2, 0).round() as u32, 100 + eye, "the eye");
        (self.newest, self.frames) = (number, self.frames + 1);
        let [near, far] = self.dioptres;
        for at in 1..(SIZE[0] * SIZE[1]) as usize {
            let (x, y) = (at as u32 % SIZE[1], at as u32 / SIZE[1]);
            let wanted = [x * 5 + number, y * 7 + 2 * number + 64 * eye, x * 3 + y * 11 + 3 * number].map(|v| v % 256);
            for (channel, wanted) in wanted.into_iter().enumerate() {
                let found = level(channel, at);
                assert!((found - wanted as f32).abs() < 1.0, "frame {number}, {x}, {y}: {found}, not {wanted}");
            }
            let depth = f64::from((x * 997 + y * 131 + number * 17 + eye * 7001) & 0xffff) / 65_535.0;
            let (wanted, found) = (near + depth * (far - near), f64::from(frame.dioptres[at]));
            let step = (far - near).abs() / 65_535.0;
            assert!((found - wanted).abs() < step, "frame {number}, {x}, {y}: {found} D, not {wanted}");
        }
    }
}

/// Checks the panel of 0.8 m at 2 m before the left eye, or the cylinder of 0.4 radians around it. The panel takes 40
/// of the pixels along each axis, and the cylinder about as many.
pub fn check_panel(frame: &Picture, shown: &str) {
    let at = |x: u32, y: u32| (y * SIZE[1] + x) as usize;
    let behind = shown.contains("projection");
    let [middle_x, middle_y] = [SIZE[1] / 2, SIZE[0] / 2];
    let inside = [[0, 0], [17, 17], [-17, 17], [-17, -17]];
    for [dx, dy] in inside {
        let at = at(middle_x.wrapping_add_signed(dx), middle_y.wrapping_add_signed(dy));
        // The distance along the axis of a cylinder around the eye is the radius times the cosine.
        let cosine =
            if shown.contains("cylinder") { 1.0 / (1.0 + (f64::from(dx) + 0.5).powi(2) * 1e-4).sqrt() } else { 1.0 };
        let (found, wanted) = (f64::from(frame.dioptres[at]), 0.5 / cosine);
        assert!((found - wanted).abs() < 1e-3, "{shown}, {dx}, {dy}: {found} D, not {wanted}");
    }
    for [dx, dy] in [[24, 0], [-24, 0], [0, 24], [0, -24]] {
        let at = at(middle_x.wrapping_add_signed(dx), middle_y.wrapping_add_signed(dy));
        let dark = (0..3).all(|channel| frame.channels[channel][at] == 0.0) && frame.dioptres[at] == 0.0;
        assert!(behind || dark, "{shown}, {dx}, {dy}: there is something outside of the panel");
        assert!(!behind || frame.dioptres[at] != 0.5, "{shown}, {dx}, {dy}: the panel is too large");
    }
    // The panel has 16 x 16 texels, with the number of the frame in the first one, at the upper left.
    let corner = at(middle_x - 20, middle_y - 20);
    let blue = level(frame.channels[2][corner], false).round() as u32;
    assert!(blue == 100 || shown.contains("cylinder"), "{shown}: {blue} in the first texel");
}
