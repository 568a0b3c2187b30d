//! Describes the lines by which other apparatus follows a display, or a display follows it.

use eyebox_base::error::Reason;
use eyebox_base::reason;
use serde::{Deserialize, Serialize};

/// The rate of serial ports that most boxes for triggers use (baud).
const USUAL_BAUD: u32 = 115_200;
/// The usual time for which a line is active (us).
const USUAL_WIDTH_US: f64 = 500.0;

/// `[trigger_out]` of a display file, a pulse with the light of each set. It changes no hologram, and therefore no
/// digest of a display file has this table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct TriggerOut {
    /// Serial port, such as `"/dev/ttyUSB0"` or `"COM3"`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// Line of a GPIO chip, such as `"/dev/gpiochip0:17"` (Linux).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gpio: Option<String>,
    /// Address that receives one UDP datagram per pulse, such as `"127.0.0.1:9001"`.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub udp: Option<String>,
    /// Pulse of a serial port, `"byte"`, `"number"`, `"dtr"` or `"rts"`. The default is byte.
    #[serde(default)]
    pub signal: Signal,
    /// Byte of the signal `byte`. The default is 255.
    #[serde(default = "byte_default")]
    pub byte: u8,
    /// Rate of the serial port, 50 to 4000000 baud. The default is 115200.
    #[serde(default = "baud_default")]
    pub baud: u32,
    /// Sets with a pulse, `"set"` for all sets or `"content"` for sets with new content. The default is set.
    #[serde(default)]
    pub on: TriggerOn,
    /// Time from the light that the display reports to the pulse, -100000 to 100000 us. Give the rise time of the SLM.
    /// The default is 0.
    #[serde(default)]
    pub delay_us: f64,
    /// Time for which a line is active, 10 to 20000 us. The default is 500.
    #[serde(default = "width_default")]
    pub width_us: f64,
}

/// `[trigger_in]` of a display file. Each pulse advances a sequence by one hologram. It changes no hologram, and
/// therefore no digest of a display file has this table.
#[derive(Debug, Clone, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
#[non_exhaustive]
pub struct TriggerIn {
    /// Serial port, such as `"/dev/ttyUSB0"` or `"COM3"`. Each byte is a pulse.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub serial: Option<String>,
    /// Line of a GPIO chip, such as `"/dev/gpiochip0:27"` (Linux).
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub gpio: Option<String>,
    /// Address of this machine that receives UDP datagrams, such as `"127.0.0.1:9002"`. Each datagram is a pulse.
    #[serde(default, skip_serializing_if = "Option::is_none")]
    pub udp: Option<String>,
    /// Meaning of a byte, `"byte"` for any value or `"number"` for a count modulo 256, whose gaps are lost pulses. The
    /// default is byte.
    #[serde(default)]
    pub signal: Signal,
    /// Rate of the serial port, 50 to 4000000 baud. The default is 115200.
    #[serde(default = "baud_default")]
    pub baud: u32,
    /// Edge of a GPIO line that is a pulse, `"rising"` or `"falling"`. The default is rising.
    #[serde(default)]
    pub edge: Edge,
}

/// The pulse of a serial port or a datagram.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum Signal {
    /// A byte with a fixed value.
    #[default]
    Byte,
    /// A byte that counts pulses modulo 256.
    Number,
    /// The line DTR is active during a pulse.
    Dtr,
    /// The line RTS is active during a pulse.
    Rts,
}

/// The sets that have a pulse.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
#[non_exhaustive]
pub enum TriggerOn {
    /// Each multiplex set, also a repeated one.
    #[default]
    Set,
    /// Each set that shows new content.
    Content,
}

/// An edge of a line.
#[derive(Debug, Clone, Copy, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Edge {
    /// The line becomes active.
    #[default]
    Rising,
    /// The line becomes inactive.
    Falling,
}

/// The place of a trigger.
#[derive(Debug, Clone, PartialEq, Eq)]
pub enum TriggerPort {
    /// The pulse uses a serial port.
    Serial {
        /// The file or the name of the port.
        path: String,
        /// The rate of the port in baud.
        baud: u32,
    },
    /// The pulse uses a line of a GPIO chip.
    Gpio {
        /// The file of the GPIO chip.
        chip: String,
        /// The number of the line on the chip.
        line: u32,
    },
    /// Datagrams to or at an address.
    Udp {
        /// The address with its port.
        address: String,
    },
}

fn byte_default() -> u8 {
    255
}

fn baud_default() -> u32 {
    USUAL_BAUD
}

fn width_default() -> f64 {
    USUAL_WIDTH_US
}

/// Returns the one place of a trigger that is given.
fn port(places: [Option<&String>; 3], baud: u32) -> Result<TriggerPort, Reason> {
    if !(50..=4_000_000).contains(&baud) {
        return Err(reason!("baud", "baud is {baud}, but it must be 50 to 4000000"));
    }
    match places {
        [Some(path), None, None] if !path.is_empty() => Ok(TriggerPort::Serial { path: path.clone(), baud }),
        [None, Some(place), None] => {
            let parts = place.rsplit_once(':').and_then(|(chip, line)| Some((chip, line.parse().ok()?)));
            let Some((chip, line)) = parts.filter(|(chip, _)| !chip.is_empty()) else {
                return Err(reason!(
                    "gpio",
                    "gpio is {place:?}, but it must have a chip and a line, such as \"/dev/gpiochip0:17\""
                ));
            };
            Ok(TriggerPort::Gpio { chip: chip.into(), line })
        }
        [None, None, Some(address)] => {
            let number = address.rsplit_once(':').and_then(|(host, port)| {
                let port: u16 = port.parse().ok()?;
                (!host.is_empty() && port > 0).then_some(port)
            });
            match number {
                Some(_) => Ok(TriggerPort::Udp { address: address.clone() }),
                None => Err(reason!(
                    "udp",
                    "udp is {address:?}, but it must have a host and a port, such as \"127.0.0.1:9001\""
                )),
            }
        }
        _ => Err(reason!("trigger-port", "it must have exactly one of serial, gpio and udp")),
    }
}

impl TriggerOut {
    /// Makes the trigger of a place with the usual settings.
    pub fn new(place: TriggerPort) -> Self {
        let [mut serial, mut gpio, mut udp] = [None, None, None];
        let mut baud = USUAL_BAUD;
        match place {
            TriggerPort::Serial { path, baud: given } => (serial, baud) = (Some(path), given),
            TriggerPort::Gpio { chip, line } => gpio = Some(format!("{chip}:{line}")),
            TriggerPort::Udp { address } => udp = Some(address),
        }
        Self {
            serial,
            gpio,
            udp,
            signal: Signal::default(),
            byte: byte_default(),
            baud,
            on: TriggerOn::default(),
            delay_us: 0.0,
            width_us: USUAL_WIDTH_US,
        }
    }

    /// Returns the place of the trigger.
    ///
    /// # Errors
    /// A reason if there is none or more than one, or if it has no such form.
    pub fn port(&self) -> Result<TriggerPort, Reason> {
        port([self.serial.as_ref(), self.gpio.as_ref(), self.udp.as_ref()], self.baud)
    }

    /// Checks the place and all values.
    ///
    /// # Errors
    /// The reason for the first wrong value.
    pub fn check(&self) -> Result<(), Reason> {
        let port = self.port()?;
        if matches!(self.signal, Signal::Dtr | Signal::Rts) && !matches!(port, TriggerPort::Serial { .. }) {
            return Err(reason!("signal", "the signals dtr and rts are lines of a serial port. Give serial"));
        }
        if !(-1e5..=1e5).contains(&self.delay_us) {
            return Err(reason!("delay", "delay_us is {}, but it must be -100000 to 100000", self.delay_us));
        }
        if !(10.0..=2e4).contains(&self.width_us) {
            return Err(reason!("width", "width_us is {}, but it must be 10 to 20000", self.width_us));
        }
        Ok(())
    }
}

impl TriggerIn {
    /// Returns the place of the trigger.
    ///
    /// # Errors
    /// A reason if there is none or more than one, or if it has no such form.
    pub fn port(&self) -> Result<TriggerPort, Reason> {
        port([self.serial.as_ref(), self.gpio.as_ref(), self.udp.as_ref()], self.baud)
    }

    /// Checks the place and all values.
    ///
    /// # Errors
    /// The reason for the first wrong value.
    pub fn check(&self) -> Result<(), Reason> {
        self.port()?;
        if matches!(self.signal, Signal::Dtr | Signal::Rts) {
            return Err(reason!(
                "signal",
                "signal is a line of the port, but a pulse arrives as a byte. Give byte or number"
            ));
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Display;
    use eyebox_base::error::ErrorData;

    const BENCH: &str =
        "resolution = [8, 8]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";

    #[test]
    fn a_display_file_names_its_triggers() {
        let read = |table: &str| Display::from_toml(&format!("{BENCH}{table}"), "b");
        let display = read(
            "[trigger_out]\nserial = \"/dev/ttyUSB0\"\nsignal = \"dtr\"\ndelay_us = 350.5\n\
             [trigger_in]\ngpio = \"/dev/gpiochip0:27\"\nedge = \"falling\"\n",
        )
        .unwrap();
        let out = display.trigger_out.clone().unwrap();
        assert_eq!(out.port(), Ok(TriggerPort::Serial { path: "/dev/ttyUSB0".into(), baud: 115_200 }));
        assert_eq!((out.signal, out.on, out.delay_us, out.width_us), (Signal::Dtr, TriggerOn::Set, 350.5, 500.0));
        let input = display.trigger_in.clone().unwrap();
        assert_eq!(input.port(), Ok(TriggerPort::Gpio { chip: "/dev/gpiochip0".into(), line: 27 }));
        assert_eq!(input.edge, Edge::Falling);
        assert_eq!(Display::from_toml(&display.to_toml(), "b").unwrap(), display);
        assert!(!read("").unwrap().to_toml().contains("trigger"));
        let udp = TriggerOut::new(TriggerPort::Udp { address: "[::1]:9001".into() });
        assert_eq!(udp.port(), Ok(TriggerPort::Udp { address: "[::1]:9001".into() }));
    }

    #[test]
    fn what_is_wrong_in_a_trigger_is_named() {
        for (wrong, code) in [
            ("[trigger_out]\n", "trigger-port"),
            ("[trigger_out]\nserial = \"a\"\nudp = \"h:1\"\n", "trigger-port"),
            ("[trigger_out]\nserial = \"\"\n", "trigger-port"),
            ("[trigger_out]\nserial = \"a\"\nbaud = 1\n", "baud"),
            ("[trigger_out]\ngpio = \"17\"\n", "gpio"),
            ("[trigger_out]\ngpio = \"chip:-1\"\n", "gpio"),
            ("[trigger_out]\nudp = \"9001\"\n", "udp"),
            ("[trigger_out]\nudp = \"h:0\"\n", "udp"),
            ("[trigger_out]\nudp = \"h:1\"\nsignal = \"rts\"\n", "signal"),
            ("[trigger_out]\nserial = \"a\"\ndelay_us = nan\n", "delay"),
            ("[trigger_out]\nserial = \"a\"\nwidth_us = 1\n", "width"),
            ("[trigger_in]\nserial = \"a\"\nsignal = \"dtr\"\n", "signal"),
            ("[trigger_in]\n", "trigger-port"),
            ("[trigger_out]\nserial = \"a\"\nbyte = 256\n", "toml"),
            ("[trigger_in]\nserial = \"a\"\nedge = \"up\"\n", "toml"),
        ] {
            let error = Display::from_toml(&format!("{BENCH}{wrong}"), "b").unwrap_err();
            assert_eq!(ErrorData::of(&error).code, format!("display-file/{code}"), "{wrong}");
        }
    }
}
