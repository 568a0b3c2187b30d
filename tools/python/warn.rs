//! Warnings of the library as warnings of Python. This module collects them, and `eyebox/_arguments.py` issues them
//! when a call returns.

use pyo3::prelude::*;
use std::fmt::{Debug, Write};
use std::sync::{Mutex, Once, PoisonError};
use tracing::field::{Field, Visit};
use tracing::{Event, Level, Metadata, Subscriber, span};

/// The highest number of warnings that are kept until Python takes them.
const MOST: usize = 100;

static WARNINGS: Mutex<Vec<String>> = Mutex::new(Vec::new());

/// Begins to collect warnings, unless another subscriber does. Calls of the library do this, and not the import of the
/// package, because the command prints its events itself.
pub(crate) fn listen() {
    static ONCE: Once = Once::new();
    // Another module of the process may have set a subscriber. The warnings then go to that subscriber.
    ONCE.call_once(|| drop(tracing::subscriber::set_global_default(Collector)));
}

/// Returns the warnings since the last call.
#[pyfunction]
pub(crate) fn take_warnings() -> Vec<String> {
    std::mem::take(&mut WARNINGS.lock().unwrap_or_else(PoisonError::into_inner))
}

struct Collector;

/// The message of an event.
#[derive(Default)]
struct Message(String);

impl Visit for Message {
    fn record_debug(&mut self, field: &Field, value: &dyn Debug) {
        if field.name() == "message" {
            // A write to a `String` never fails.
            let _ = write!(self.0, "{value:?}");
        }
    }
}

impl Subscriber for Collector {
    fn enabled(&self, metadata: &Metadata<'_>) -> bool {
        *metadata.level() <= Level::WARN && metadata.is_event()
    }

    fn new_span(&self, _: &span::Attributes<'_>) -> span::Id {
        span::Id::from_u64(1)
    }

    fn record(&self, _: &span::Id, _: &span::Record<'_>) {}

    fn record_follows_from(&self, _: &span::Id, _: &span::Id) {}

    fn event(&self, event: &Event<'_>) {
        let mut message = Message::default();
        event.record(&mut message);
        let mut warnings = WARNINGS.lock().unwrap_or_else(PoisonError::into_inner);
        if warnings.len() < MOST {
            warnings.push(message.0);
        }
    }

    fn enter(&self, _: &span::Id) {}

    fn exit(&self, _: &span::Id) {}
}
