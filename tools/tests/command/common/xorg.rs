//! An X server of Xorg with the dummy driver, whose outputs have modes, gamma ramps and properties.

use std::io::{BufRead, BufReader};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::{Duration, Instant};
use x11rb::connection::Connection;
use x11rb::protocol::randr::{ConnectionExt as _, Rotation};
use x11rb::protocol::xproto::{AtomEnum, ConnectionExt as _, ImageFormat, PropMode};
use x11rb::rust_connection::RustConnection;

/// The first output has the first mode.
const CONFIGURATION: &str = r#"
Section "Device"
  Identifier "device"
  Driver "dummy"
  VideoRam 64000
EndSection
Section "Monitor"
  Identifier "monitor"
  HorizSync 1.0-2000.0
  VertRefresh 1.0-1000.0
  Modeline "64x64" 11.0 64 100 120 428 64 70 80 428
  Modeline "96x80" 11.0 96 120 140 428 80 90 100 428
EndSection
Section "Screen"
  Identifier "screen"
  Device "device"
  Monitor "monitor"
  DefaultDepth 24
  SubSection "Display"
    Depth 24
    Virtual 400 220
    Modes "64x64" "96x80"
  EndSubSection
EndSection
"#;

/// Running server with a connection, which ends when the value is dropped.
pub struct Xorg {
    process: Child,
    /// Name of the display in the form of `DISPLAY`.
    pub name: String,
    pub connection: RustConnection,
    pub root: u32,
}

impl Xorg {
    /// Starts a server whose first output has 64 x 64 pixels.
    pub fn start(folder: &Path) -> Self {
        std::fs::write(folder.join("xorg.conf"), CONFIGURATION).expect("written");
        let mut process = Command::new("Xorg")
            .args(["-noreset", "-nolisten", "tcp", "-novtswitch", "-sharevts", "-nocursor", "-displayfd", "1"])
            .args(["-config", "xorg.conf", "-logfile", "xorg.log"])
            // A process that is not root may only name files below its folder.
            .current_dir(folder)
            .stdout(Stdio::piped())
            .stderr(Stdio::null())
            .spawn()
            .expect("Xorg, which tools/setup.sh installs");
        let mut number = String::new();
        BufReader::new(process.stdout.take().expect("its output")).read_line(&mut number).expect("its number");
        let name = format!(":{}", number.trim());
        let log = || std::fs::read_to_string(folder.join("xorg.log")).unwrap_or_default();
        let (connection, screen) = x11rb::connect(Some(&name)).unwrap_or_else(|e| panic!("{e}: {}", log()));
        let root = connection.setup().roots[screen].root;
        Self { process, name, connection, root }
    }

    /// Lights the second output with 80 x 96 pixels, to the right of the first.
    pub fn light_second(&self) {
        self.light_second_of(96);
    }

    /// Lights the second output with the mode of this width, to the right of the first.
    pub fn light_second_of(&self, width: u16) {
        let server = &self.connection;
        let resources = server.randr_get_screen_resources(self.root).expect("sent").reply().expect("resources");
        let mode = resources.modes.iter().find(|mode| mode.width == width).expect("the mode").id;
        let output = resources.outputs[1];
        let info = server.randr_get_output_info(output, 0).expect("sent").reply().expect("an output");
        server.randr_add_output_mode(output, mode).expect("sent").check().expect("a mode");
        server.randr_set_screen_size(self.root, 160, 80, 160, 80).expect("sent").check().expect("a size");
        let rotation = Rotation::ROTATE0;
        let set = server.randr_set_crtc_config(info.crtcs[0], 0, 0, 64, 0, mode, rotation, &[output]).expect("sent");
        set.reply().expect("it is lit");
    }

    /// Starts a window manager and waits until it manages the screen. Returns nothing if it is missing, or does not run
    /// by itself. Xfwm4 needs a session bus, for example.
    pub fn manage(&self, manager: &str, folder: &Path) -> Option<Child> {
        let mut command = Command::new(manager);
        if manager == "i3" {
            // Without a configuration, i3 asks for one in a window that takes the keyboard.
            let file = folder.join("i3.config");
            std::fs::write(&file, "font pango:monospace 8\n").expect("written");
            command.arg("-c").arg(file);
        }
        command.env("DISPLAY", &self.name).stdout(Stdio::null()).stderr(Stdio::null());
        let mut process = command.spawn().ok()?;
        let (check, since) = (self.atom("_NET_SUPPORTING_WM_CHECK"), Instant::now());
        let property = || {
            let any = AtomEnum::ANY;
            self.connection.get_property(false, self.root, check, any, 0, 1).expect("sent").reply().expect("a property")
        };
        while property().value.is_empty() {
            if since.elapsed() > Duration::from_secs(30) {
                let _ = process.kill();
                let _ = process.wait();
                return None;
            }
            std::thread::sleep(Duration::from_millis(20));
        }
        Some(process)
    }

    pub fn atom(&self, name: &str) -> u32 {
        self.connection.intern_atom(false, name.as_bytes()).expect("sent").reply().expect("an atom").atom
    }

    fn first(&self) -> (u32, u32) {
        let resources =
            self.connection.randr_get_screen_resources_current(self.root).expect("sent").reply().expect("resources");
        (resources.outputs[0], resources.crtcs[0])
    }

    /// Gives the first output a property with a name as its value.
    pub fn set_text(&self, name: &str, value: &str) {
        let (name, value) = (self.atom(name), self.atom(value));
        self.set(name, AtomEnum::ATOM.into(), value);
    }

    /// Gives the first output a property with a number.
    pub fn set_number(&self, name: &str, value: u32) {
        let name = self.atom(name);
        self.set(name, AtomEnum::INTEGER.into(), value);
    }

    fn set(&self, name: u32, kind: u32, value: u32) {
        let (output, replace) = (self.first().0, PropMode::REPLACE);
        let bytes = value.to_ne_bytes();
        let set = self.connection.randr_change_output_property(output, name, kind, 32, replace, 1, &bytes);
        set.expect("sent").check().expect("a property");
    }

    /// Loads a ramp into the first output that multiplies red, green and blue.
    pub fn load_ramp(&self, shares: [f64; 3]) {
        let crtc = self.first().1;
        let size = self.connection.randr_get_crtc_gamma_size(crtc).expect("sent").reply().expect("a size").size;
        let last = f64::from(size) - 1.0;
        let [red, green, blue] = shares.map(|share| -> Vec<u16> {
            (0..size).map(|i| (share * 65535.0 * f64::from(i) / last).round() as u16).collect()
        });
        self.connection.randr_set_crtc_gamma(crtc, &red, &green, &blue).expect("sent").check().expect("a ramp");
    }

    /// Returns the largest values of the ramp, as shares.
    pub fn ramp(&self) -> [f64; 3] {
        let crtc = self.first().1;
        let ramp = self.connection.randr_get_crtc_gamma(crtc).expect("sent").reply().expect("a ramp");
        // The dummy driver keeps the high byte alone.
        [ramp.red, ramp.green, ramp.blue].map(|c| f64::from(c[c.len() - 1] >> 8) / 255.0)
    }

    /// Waits until the ramp has these shares, within a level of 8 bits.
    pub fn wait_for_ramp(&self, shares: [f64; 3]) {
        let since = Instant::now();
        let is = |ramp: [f64; 3]| ramp.iter().zip(shares).all(|(a, b)| (a - b).abs() < 1.0 / 255.0);
        while !is(self.ramp()) {
            assert!(since.elapsed() < Duration::from_secs(60), "the ramp is {:?}, not {shares:?}", self.ramp());
            std::thread::sleep(Duration::from_millis(5));
        }
    }

    /// Returns the pixels of a part of the screen as (row, column, channel), red first.
    pub fn grab(&self, [left, top]: [i16; 2], [height, width]: [u16; 2]) -> Vec<u8> {
        let image = self.connection.get_image(ImageFormat::Z_PIXMAP, self.root, left, top, width, height, !0);
        let data = image.expect("sent").reply().expect("an image").data;
        data.chunks_exact(4).flat_map(|p| [p[2], p[1], p[0]]).collect()
    }

    /// Returns the visible windows with their (left, top) and (rows, columns).
    pub fn windows(&self) -> Vec<(u32, [i16; 2], [u16; 2])> {
        let server = &self.connection;
        let tree = server.query_tree(self.root).expect("sent").reply().expect("windows");
        let visible = |window: u32| {
            let attributes = server.get_window_attributes(window).ok()?.reply().ok()?;
            let place = server.get_geometry(window).ok()?.reply().ok()?;
            let is_visible = attributes.map_state == x11rb::protocol::xproto::MapState::VIEWABLE;
            is_visible.then_some((window, [place.x, place.y], [place.height, place.width]))
        };
        tree.children.into_iter().filter_map(visible).collect()
    }

    /// Waits for a visible window that covers more than a pixel.
    pub fn wait_for_window(&self) -> (u32, [i16; 2], [u16; 2]) {
        let since = Instant::now();
        loop {
            if let Some(found) = self.windows().into_iter().find(|(_, _, [rows, _])| *rows > 1) {
                return found;
            }
            assert!(since.elapsed() < Duration::from_secs(60), "no window came");
            std::thread::sleep(Duration::from_millis(5));
        }
    }
}

impl Drop for Xorg {
    fn drop(&mut self) {
        // Unlike a kill, this removes the lock file of the server.
        let _ = Command::new("kill").arg(self.process.id().to_string()).status();
        let _ = self.process.wait();
    }
}
