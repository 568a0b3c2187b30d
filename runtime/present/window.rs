//! Ordinary windows on the same desktop as the one that covers a monitor: resizable, with a title, a cursor and a mouse.
//!
//! A process has one event loop, so they are made by the [`Desktop`] and their events come while it is pumped, by
//! whoever pumps it.

use super::PresentError;
use super::surface::WindowHandle;
use super::system::handle_of;
use std::cell::RefCell;
use std::collections::VecDeque;
use std::rc::Rc;
use std::sync::Arc;
use winit::event::{ElementState, MouseScrollDelta, WindowEvent as SystemEvent};
use winit::keyboard::{Key, NamedKey};
use winit::window::{Window as SystemWindow, WindowId};

/// Pixels of a touch pad that are a notch of a wheel.
const NOTCH: f64 = 40.0;
/// Events that wait at most: a program that takes none does not grow.
const MOST: usize = 1024;

/// A key of the keyboard.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum WindowKey {
    /// What it writes, the space bar included.
    Character(char),
    /// Escape.
    Escape,
    /// The beginning.
    Home,
    /// An arrow: columns to the right, rows down.
    Arrow([i8; 2]),
}

/// What happened to a window.
#[derive(Debug, Clone, Copy, PartialEq)]
#[non_exhaustive]
pub enum WindowEvent {
    /// It is to be closed, or is gone.
    Close,
    /// Its inside has so many rows and columns.
    Resized([usize; 2]),
    /// What it shows has to be shown again.
    Exposed,
    /// The mouse is at this row and column of its inside, in pixels.
    Pointer([f64; 2]),
    /// The wheel was turned by so many notches, up and away being positive.
    Wheel(f64),
    /// A key was pressed, or repeats.
    Key(WindowKey),
}

pub(super) type Queue = Rc<RefCell<VecDeque<WindowEvent>>>;

/// The event loop's side of all windows.
#[derive(Default)]
pub(super) struct Windows(Vec<(WindowId, Queue)>);

impl Windows {
    /// Events of this window go into a queue from now on.
    pub(super) fn add(&mut self, id: WindowId, queue: Queue) {
        self.0.push((id, queue));
    }

    /// Whether the event was a window's.
    pub(super) fn take(&mut self, id: WindowId, event: &SystemEvent) -> bool {
        let Some(at) = self.0.iter().position(|(window, _)| *window == id) else { return false };
        let queue = Rc::clone(&self.0[at].1);
        // The last that comes from it.
        if matches!(event, SystemEvent::Destroyed) {
            self.0.swap_remove(at);
        }
        if let Some(event) = translated(event) {
            let mut queue = queue.borrow_mut();
            // Of a mouse that moves only where it is now matters.
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
        SystemEvent::MouseWheel { delta, .. } => WindowEvent::Wheel(match delta {
            MouseScrollDelta::LineDelta(_, rows) => f64::from(*rows),
            MouseScrollDelta::PixelDelta(pixels) => pixels.y / NOTCH,
        }),
        // A synthetic press tells of a key that was down when the window got the keyboard; where that key is pressed just
        // then, its own press comes as well.
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
    /// Rows and columns of its inside; zero where it is minimised.
    pub fn size(&self) -> [usize; 2] {
        [self.window.inner_size().height as usize, self.window.inner_size().width as usize]
    }

    /// Writes another title.
    pub fn title(&self, title: &str) {
        self.window.set_title(title);
    }

    /// The next thing that happened, as far as the desktop was pumped.
    pub fn event(&self) -> Option<WindowEvent> {
        let size = self.size();
        // A window that gets the keyboard is told where the mouse is, which may be anywhere.
        let outside = |event: &WindowEvent| match event {
            WindowEvent::Pointer(at) => !(0..2).all(|i| (0.0..size[i] as f64).contains(&at[i])),
            _ => false,
        };
        let mut events = self.events.borrow_mut();
        std::iter::from_fn(|| events.pop_front()).find(|event| !outside(event))
    }

    /// What Vulkan makes a surface of. It is good for as long as the window lives.
    ///
    /// # Errors
    /// [`PresentError::Display`] on a system whose windows are not known here.
    pub fn handle(&self) -> Result<WindowHandle, PresentError> {
        handle_of(&self.window)
    }
}
