//! Opens ordinary windows on the desktop, which are resizable and have a title, a cursor and a mouse.
//!
//! They can be open at the same time as a window that covers a monitor. A process has one event loop, so the
//! [`Desktop`] makes the windows. Their events arrive while the desktop is pumped.

use super::PresentError;
use super::surface::WindowHandle;
use super::system::handle_of;
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;
use winit::event::{ElementState, MouseButton, MouseScrollDelta, WindowEvent as SystemEvent};
use winit::keyboard::{Key, NamedKey};
use winit::window::{Window as SystemWindow, WindowId};

/// Pixels of a touch pad per notch of a wheel.
const NOTCH: f64 = 40.0;
/// The most pending events, so that memory does not grow if a program reads none.
const MOST: usize = 1024;

/// A key of the keyboard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WindowKey {
    /// A key that writes this character, including the space bar.
    Character(char),
    /// The Escape key alone.
    Escape,
    /// The Home key alone.
    Home,
    /// An arrow key, as (columns to the right, rows down).
    Arrow([i8; 2]),
}

/// An event of a window.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum WindowEvent {
    /// The window should close, or is gone.
    Close,
    /// The inside of the window has this number of rows and columns.
    Resized([usize; 2]),
    /// The window must be drawn again.
    Exposed,
    /// The mouse is at this row and column of the inside, in pixels.
    Pointer([f64; 2]),
    /// The left button of the mouse was pressed, or released.
    Button(bool),
    /// The wheel was turned by this number of notches. Up and away are positive.
    Wheel(f64),
    /// A key was pressed, or repeats.
    Key(WindowKey),
}

pub(super) type Queue = Rc<RefCell<VecDeque<WindowEvent>>>;

/// The side of the event loop of all windows.
#[derive(Default)]
pub(super) struct Windows(Vec<(WindowId, Queue)>);

impl Windows {
    /// Sends the events of this window to a queue from now on.
    pub(super) fn add(&mut self, id: WindowId, queue: Queue) {
        self.0.push((id, queue));
    }

    /// Handles the event if it belongs to one of the windows, and returns true in that case.
    pub(super) fn take(&mut self, id: WindowId, event: &SystemEvent) -> bool {
        let Some(at) = self.0.iter().position(|(window, _)| *window == id) else { return false };
        let queue = Rc::clone(&self.0[at].1);
        // This is the last event of the window.
        if matches!(event, SystemEvent::Destroyed) {
            self.0.swap_remove(at);
        }
        if let Some(event) = translated(event) {
            let mut queue = queue.borrow_mut();
            // Only the current position of a moving mouse matters.
            if matches!((queue.back(), event), (Some(WindowEvent::Pointer(_)), WindowEvent::Pointer(_))) {
                queue.pop_back();
            }
            if queue.len() < MOST {
                queue.push_back(event);
            }
        }
        true
    }
}

fn translated(event: &SystemEvent) -> Option<WindowEvent> {
    Some(match event {
        SystemEvent::CloseRequested | SystemEvent::Destroyed => WindowEvent::Close,
        SystemEvent::Resized(size) => WindowEvent::Resized([size.height as usize, size.width as usize]),
        SystemEvent::RedrawRequested => WindowEvent::Exposed,
        SystemEvent::CursorMoved { position, .. } => WindowEvent::Pointer([position.y, position.x]),
        SystemEvent::MouseInput { state, button: MouseButton::Left, .. } => {
            WindowEvent::Button(*state == ElementState::Pressed)
        }
        SystemEvent::MouseWheel { delta, .. } => WindowEvent::Wheel(match delta {
            MouseScrollDelta::LineDelta(_, rows) => f64::from(*rows),
            MouseScrollDelta::PixelDelta(pixels) => pixels.y / NOTCH,
        }),
        // A synthetic press reports a key that was down when the window received the focus. A key that is pressed at
        // that moment also sends its own press.
        SystemEvent::KeyboardInput { event, is_synthetic: false, .. } if event.state == ElementState::Pressed => {
            WindowEvent::Key(match &event.logical_key {
                Key::Named(NamedKey::Escape) => WindowKey::Escape,
                Key::Named(NamedKey::Home) => WindowKey::Home,
                Key::Named(NamedKey::Space) => WindowKey::Character(' '),
                Key::Named(NamedKey::ArrowLeft) => WindowKey::Arrow([-1, 0]),
                Key::Named(NamedKey::ArrowRight) => WindowKey::Arrow([1, 0]),
                Key::Named(NamedKey::ArrowUp) => WindowKey::Arrow([0, -1]),
                Key::Named(NamedKey::ArrowDown) => WindowKey::Arrow([0, 1]),
                Key::Character(text) => WindowKey::Character(text.chars().next()?),
                _ => return None,
            })
        }
        _ => return None,
    })
}

/// An ordinary window. It closes when it is dropped.
pub struct OrdinaryWindow {
    pub(super) window: Arc<SystemWindow>,
    pub(super) events: Queue,
}

impl OrdinaryWindow {
    /// Rows and columns of the inside. They are zero while the window is minimized.
    pub fn size(&self) -> [usize; 2] {
        [self.window.inner_size().height as usize, self.window.inner_size().width as usize]
    }

    /// Sets the title of the window.
    pub fn title(&self, title: &str) {
        self.window.set_title(title);
    }

    /// The next event that the desktop has received.
    pub fn event(&self) -> Option<WindowEvent> {
        let size = self.size();
        // A window that receives the focus also receives the position of the mouse, which may be outside.
        let outside = |event: &WindowEvent| match event {
            WindowEvent::Pointer(at) => !(0..2).all(|i| (0.0..size[i] as f64).contains(&at[i])),
            _ => false,
        };
        let mut events = self.events.borrow_mut();
        std::iter::from_fn(|| events.pop_front()).find(|event| !outside(event))
    }

    /// The handle from which Vulkan makes a surface. It is valid while the window lives.
    ///
    /// # Errors
    /// [`PresentError::Display`] on a system whose windows are not supported.
    pub fn handle(&self) -> Result<WindowHandle, PresentError> {
        handle_of(&self.window)
    }
}
