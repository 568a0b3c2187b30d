//! Messages of the layer on standard error, each at most once in a session.

use std::sync::Mutex;

/// The subjects of messages.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Subject {
    Api,
    Depth,
    Device,
    DeviceFailed,
    Format,
    Layers,
    Near,
    NoLayers,
    OnlyQuads,
    Panic,
    Refused,
    Size,
    Space,
    Vulkan,
}

/// The subjects that were printed.
#[derive(Debug, Default)]
pub struct Notes(Mutex<Vec<Subject>>);

impl Notes {
    /// Prints a message if none of its subject was printed before.
    pub fn once(&self, subject: Subject, text: impl FnOnce() -> String) {
        let mut printed = self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner);
        if !printed.contains(&subject) {
            printed.push(subject);
            say(&text());
        }
    }

    /// Permits one more message of a subject, after its cause ended.
    pub fn again(&self, subject: Subject) {
        self.0.lock().unwrap_or_else(std::sync::PoisonError::into_inner).retain(|printed| *printed != subject);
    }
}

/// Prints a message of the layer.
pub fn say(text: &str) {
    eprintln!("eyebox openxr: {text}");
}
