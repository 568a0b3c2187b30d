//! Gives and takes pulses over a serial port, as bytes or by its lines DTR and RTS.
//!
//! A pseudo-terminal has no such lines, so they are behind [`SerialLine`].

use super::error::TriggerError;
use super::line::{Counter, Given, Pulse, TriggerInput, TriggerOutput};
use eyebox_base::steady;
use eyebox_optics::{Signal, TriggerIn, TriggerOut};
use std::io::{Error, ErrorKind};
use std::time::Duration;

/// A serial port as triggers use it.
pub trait SerialLine: Send {
    /// Writes a byte without waiting. [`ErrorKind::TimedOut`] and [`ErrorKind::WouldBlock`] mean that there is no room.
    fn write(&mut self, byte: u8) -> Result<(), Error>;

    /// Switches DTR, or RTS if `is_rts` is true.
    fn set_line(&mut self, is_rts: bool, is_active: bool) -> Result<(), Error>;

    /// Waits for bytes up to `patience`, and returns how many there are. 0 bytes mean that the port is gone.
    fn read(&mut self, bytes: &mut [u8], patience: Duration) -> Result<usize, Error>;
}

fn is_quiet(error: &Error) -> bool {
    matches!(error.kind(), ErrorKind::TimedOut | ErrorKind::WouldBlock | ErrorKind::Interrupted)
}

/// Gives pulses over a [`SerialLine`].
pub struct SerialOutput {
    line: Box<dyn SerialLine>,
    port: String,
    signal: Signal,
    byte: u8,
    width: Duration,
}

impl SerialOutput {
    /// Makes the output of an open port with this name.
    pub fn new(line: Box<dyn SerialLine>, port: &str, trigger: &TriggerOut) -> Self {
        let width = Duration::from_nanos((trigger.width_us * 1e3) as u64);
        Self { line, port: port.into(), signal: trigger.signal, byte: trigger.byte, width }
    }
}

impl TriggerOutput for SerialOutput {
    fn pulse(&mut self, number: u64) -> Result<Given, TriggerError> {
        let failed = |error: Error| TriggerError::failed(&self.port, error);
        let written = match self.signal {
            Signal::Dtr | Signal::Rts => {
                let is_rts = self.signal == Signal::Rts;
                self.line.set_line(is_rts, true).map_err(failed)?;
                std::thread::sleep(self.width);
                self.line.set_line(is_rts, false)
            }
            Signal::Number => self.line.write(number as u8),
            _ => self.line.write(self.byte),
        };
        match written {
            Ok(()) => Ok(Given::Sent),
            Err(error) if is_quiet(&error) => Ok(Given::Full),
            Err(error) => Err(failed(error)),
        }
    }
}

/// Takes the bytes of a [`SerialLine`] as pulses.
pub struct SerialPulses {
    line: Box<dyn SerialLine>,
    port: String,
    counter: Option<Counter>,
}

impl SerialPulses {
    /// Makes the input of an open port with this name.
    pub fn new(line: Box<dyn SerialLine>, port: &str, trigger: &TriggerIn) -> Self {
        let counter = (trigger.signal == Signal::Number).then(Counter::default);
        Self { line, port: port.into(), counter }
    }
}

impl TriggerInput for SerialPulses {
    fn wait(&mut self, patience: Duration, pulses: &mut Vec<Pulse>) -> Result<(), TriggerError> {
        let mut bytes = [0; 64];
        match self.line.read(&mut bytes, patience) {
            Ok(0) => Err(TriggerError::failed(&self.port, "the port is gone")),
            Ok(length) => {
                let at_ns = steady::now_ns();
                for number in &bytes[..length.min(64)] {
                    let lost_before = self.counter.as_mut().map_or(0, |counter| counter.lost_before(*number));
                    pulses.push(Pulse { at_ns, lost_before });
                }
                Ok(())
            }
            Err(error) if is_quiet(&error) => Ok(()),
            Err(error) => Err(TriggerError::failed(&self.port, error)),
        }
    }
}

pub(super) fn open_output(path: &str, baud: u32, trigger: &TriggerOut) -> Result<Box<dyn TriggerOutput>, TriggerError> {
    let mut line = system::open(path, baud)?;
    if matches!(trigger.signal, Signal::Dtr | Signal::Rts) {
        // The system activates both lines when it opens a port.
        let is_rts = trigger.signal == Signal::Rts;
        line.set_line(is_rts, false).map_err(|error| TriggerError::open(path, error))?;
    }
    Ok(Box::new(SerialOutput::new(line, path, trigger)))
}

pub(super) fn open_input(path: &str, baud: u32, trigger: &TriggerIn) -> Result<Box<dyn TriggerInput>, TriggerError> {
    Ok(Box::new(SerialPulses::new(system::open(path, baud)?, path, trigger)))
}

#[cfg(feature = "triggers")]
mod system {
    use super::{SerialLine, TriggerError};
    use serial2::{FlowControl, SerialPort, Settings};
    use std::io::Error;
    use std::time::Duration;

    pub fn open(path: &str, baud: u32) -> Result<Box<dyn SerialLine>, TriggerError> {
        let settings = |mut settings: Settings| {
            settings.set_raw();
            settings.set_baud_rate(baud)?;
            // The lines are for pulses.
            settings.set_flow_control(FlowControl::None);
            Ok(settings)
        };
        let mut port = SerialPort::open(path, settings).map_err(|error| TriggerError::open(path, error))?;
        port.set_write_timeout(Duration::ZERO).map_err(|error| TriggerError::open(path, error))?;
        // Bytes from before this program are no pulses. Pseudo-terminals may refuse this.
        let _ = port.discard_input_buffer();
        Ok(Box::new(port))
    }

    impl SerialLine for SerialPort {
        fn write(&mut self, byte: u8) -> Result<(), Error> {
            SerialPort::write(self, &[byte]).map(drop)
        }

        fn set_line(&mut self, is_rts: bool, is_active: bool) -> Result<(), Error> {
            if is_rts { self.set_rts(is_active) } else { self.set_dtr(is_active) }
        }

        fn read(&mut self, bytes: &mut [u8], patience: Duration) -> Result<usize, Error> {
            self.set_read_timeout(patience.max(Duration::from_millis(1)))?;
            SerialPort::read(self, bytes)
        }
    }
}

#[cfg(not(feature = "triggers"))]
mod system {
    use super::{SerialLine, TriggerError};

    pub fn open(_path: &str, _baud: u32) -> Result<Box<dyn SerialLine>, TriggerError> {
        Err(TriggerError::Unsupported { reason: "this program was built without the feature `triggers`".into() })
    }
}
