//! A virtual desktop with a mouse and a keyboard, without a window manager.

use super::xvfb::{Part, Server};
use std::io::IoSlice;
use std::path::Path;
use std::time::{Duration, Instant};
use x11rb::connection::{Connection, RequestConnection};
use x11rb::protocol::xproto::{AtomEnum, ConfigureWindowAux, ConnectionExt, InputFocus, Window};
use x11rb::rust_connection::RustConnection;

/// The request of XTEST that sends an event. The numbers below are events of the core protocol.
const FAKE_INPUT: u8 = 2;
const KEY: u8 = 2;
const KEY_UP: u8 = 3;
const BUTTON: u8 = 4;
const BUTTON_UP: u8 = 5;
const MOTION: u8 = 6;

/// Virtual desktop on an X server with the extension XTEST.
pub struct Desk {
    server: Server,
    connection: RustConnection,
    root: Window,
    xtest: u8,
}

impl Desk {
    pub fn new(folder: &Path, size: [usize; 2]) -> Self {
        // A visible cursor would change the pixels.
        let server = Server::start(folder, size, &["-nocursor"]);
        let (connection, screen) = x11rb::connect(Some(&server.name)).expect("a connection");
        let root = connection.setup().roots[screen].root;
        let xtest = connection.extension_information("XTEST").expect("an answer").expect("XTEST").major_opcode;
        Self { server, connection, root, xtest }
    }

    /// Returns the name of the display in the form of `DISPLAY`.
    pub fn name(&self) -> &str {
        &self.server.name
    }

    /// Waits for a window whose title contains `title`, and returns it.
    pub fn window(&self, title: &str) -> Window {
        let since = Instant::now();
        loop {
            let tree = self.connection.query_tree(self.root).expect("sent").reply().expect("the windows");
            if let Some(found) = tree.children.into_iter().find(|w| self.title(*w).contains(title)) {
                return found;
            }
            assert!(since.elapsed() < Duration::from_secs(60), "no window with {title}");
            std::thread::sleep(Duration::from_millis(20));
        }
    }

    /// Returns the title of a window, which is empty if the window has none.
    pub fn title(&self, window: Window) -> String {
        let name = AtomEnum::WM_NAME;
        let answer = self.connection.get_property(false, window, name, AtomEnum::ANY, 0, 1024).expect("sent").reply();
        answer.map_or_else(|_| String::new(), |p| String::from_utf8_lossy(&p.value).into_owned())
    }

    /// Returns the pixels of a window on the screen.
    pub fn part(&self, window: Window) -> Part {
        let at = self.connection.get_geometry(window).expect("sent").reply().expect("its place");
        let (top, left) = (at.y.max(0) as usize, at.x.max(0) as usize);
        self.server.part([top, left], [at.height.into(), at.width.into()])
    }

    fn send(&self, kind: u8, detail: u8, at: [i16; 2]) {
        self.queue(kind, detail, at);
        self.connection.flush().expect("sent");
    }

    fn queue(&self, kind: u8, detail: u8, [y, x]: [i16; 2]) {
        let mut request = [0; 36];
        request[..2].copy_from_slice(&[self.xtest, FAKE_INPUT]);
        request[2..4].copy_from_slice(&9u16.to_ne_bytes());
        request[4..6].copy_from_slice(&[kind, detail]);
        request[12..16].copy_from_slice(&self.root.to_ne_bytes());
        request[24..26].copy_from_slice(&x.to_ne_bytes());
        request[26..28].copy_from_slice(&y.to_ne_bytes());
        self.connection.send_request_without_reply(&[IoSlice::new(&request)], Vec::new()).expect("sent");
    }

    /// Moves the mouse to a row and column of the window.
    pub fn point(&self, window: Window, [row, column]: [i16; 2]) {
        let at = self.connection.get_geometry(window).expect("sent").reply().expect("its place");
        self.send(MOTION, 0, [at.y + row, at.x + column]);
    }

    /// Turns the wheel by one notch.
    pub fn turn(&self, up: bool) {
        let button = if up { 4 } else { 5 };
        self.send(BUTTON, button, [0, 0]);
        self.send(BUTTON_UP, button, [0, 0]);
    }

    /// Presses the key of this keysym in a window. The keysym of a letter is its ASCII code.
    pub fn press(&self, window: Window, keysym: u32) {
        self.connection.set_input_focus(InputFocus::PARENT, window, x11rb::CURRENT_TIME).expect("sent");
        let setup = self.connection.setup();
        let (first, last) = (setup.min_keycode, setup.max_keycode);
        let map =
            self.connection.get_keyboard_mapping(first, last - first + 1).expect("sent").reply().expect("the keys");
        let per = usize::from(map.keysyms_per_keycode);
        let at = map.keysyms.chunks_exact(per).position(|k| k[0] == keysym).expect("such a key");
        // Both events are sent together, because a key that stays down on a slow machine repeats.
        self.queue(KEY, first + at as u8, [0, 0]);
        self.send(KEY_UP, first + at as u8, [0, 0]);
    }

    /// Sets the size of the window's content.
    pub fn resize(&self, window: Window, [height, width]: [u32; 2]) {
        let size = ConfigureWindowAux::new().width(width).height(height);
        self.connection.configure_window(window, &size).expect("sent");
        self.connection.flush().expect("sent");
    }
}
