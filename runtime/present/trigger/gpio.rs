//! Gives and takes pulses over lines of a GPIO chip, through the character device of Linux.

use super::error::TriggerError;
use super::line::{TriggerInput, TriggerOutput};
use eyebox_optics::{TriggerIn, TriggerOut};

pub(super) fn open_output(chip: &str, line: u32, trigger: &TriggerOut) -> Result<Box<dyn TriggerOutput>, TriggerError> {
    system::open_output(chip, line, trigger)
}

pub(super) fn open_input(chip: &str, line: u32, trigger: &TriggerIn) -> Result<Box<dyn TriggerInput>, TriggerError> {
    system::open_input(chip, line, trigger)
}

#[cfg(all(target_os = "linux", feature = "triggers"))]
mod system {
    use super::super::line::{Given, Pulse};
    use super::{TriggerError, TriggerIn, TriggerInput, TriggerOut, TriggerOutput};
    use eyebox_optics::Edge;
    use gpiocdev::Request;
    use gpiocdev::line::{EdgeDetection, EventClock, Value};
    use std::time::Duration;

    struct GpioOutput {
        request: Request,
        port: String,
        width: Duration,
    }

    fn place(chip: &str, line: u32) -> String {
        format!("{chip}:{line}")
    }

    pub fn open_output(chip: &str, line: u32, trigger: &TriggerOut) -> Result<Box<dyn TriggerOutput>, TriggerError> {
        let port = place(chip, line);
        let request = Request::builder()
            .on_chip(chip)
            .with_consumer("eyebox")
            .with_line(line)
            .as_output(Value::Inactive)
            .request()
            .map_err(|error| TriggerError::open(&port, error))?;
        let width = Duration::from_nanos((trigger.width_us * 1e3) as u64);
        Ok(Box::new(GpioOutput { request, port, width }))
    }

    impl TriggerOutput for GpioOutput {
        fn pulse(&mut self, _number: u64) -> Result<Given, TriggerError> {
            let failed = |error| TriggerError::failed(&self.port, error);
            self.request.set_lone_value(Value::Active).map_err(failed)?;
            std::thread::sleep(self.width);
            self.request.set_lone_value(Value::Inactive).map_err(failed)?;
            Ok(Given::Sent)
        }
    }

    struct GpioInput {
        request: Request,
        port: String,
        /// The number of the last edge. The kernel counts edges that found no room, too.
        last: Option<u32>,
    }

    pub fn open_input(chip: &str, line: u32, trigger: &TriggerIn) -> Result<Box<dyn TriggerInput>, TriggerError> {
        let port = place(chip, line);
        let edges = match trigger.edge {
            Edge::Rising => EdgeDetection::RisingEdge,
            Edge::Falling => EdgeDetection::FallingEdge,
        };
        let request = Request::builder()
            .on_chip(chip)
            .with_consumer("eyebox")
            .with_line(line)
            .as_input()
            .with_edge_detection(edges)
            .with_event_clock(EventClock::Monotonic)
            .request()
            .map_err(|error| TriggerError::open(&port, error))?;
        Ok(Box::new(GpioInput { request, port, last: None }))
    }

    impl TriggerInput for GpioInput {
        fn wait(&mut self, patience: Duration, pulses: &mut Vec<Pulse>) -> Result<(), TriggerError> {
            let failed = |error| TriggerError::failed(&self.port, error);
            if !self.request.wait_edge_event(patience).map_err(failed)? {
                return Ok(());
            }
            let event = self.request.read_edge_event().map_err(failed)?;
            let lost_before = self.last.map_or(0, |last| event.line_seqno.wrapping_sub(last).wrapping_sub(1));
            self.last = Some(event.line_seqno);
            pulses.push(Pulse { at_ns: event.timestamp_ns, lost_before: u64::from(lost_before) });
            Ok(())
        }
    }
}

#[cfg(not(all(target_os = "linux", feature = "triggers")))]
mod system {
    use super::{TriggerError, TriggerIn, TriggerInput, TriggerOut, TriggerOutput};

    fn unsupported() -> TriggerError {
        let reason = match cfg!(target_os = "linux") {
            true => "this program was built without the feature `triggers`",
            false => "GPIO lines are supported on Linux. Use a serial port or UDP",
        };
        TriggerError::Unsupported { reason: reason.into() }
    }

    pub fn open_output(_: &str, _: u32, _: &TriggerOut) -> Result<Box<dyn TriggerOutput>, TriggerError> {
        Err(unsupported())
    }

    pub fn open_input(_: &str, _: u32, _: &TriggerIn) -> Result<Box<dyn TriggerInput>, TriggerError> {
        Err(unsupported())
    }
}
