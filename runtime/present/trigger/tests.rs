//! Tests pulses on pseudo-terminals, on UDP, and on a recorder of the lines of a serial port.

use super::line::Counter;
use super::serial::{SerialLine, SerialOutput};
use super::*;
use eyebox_optics::{Signal, TriggerIn};
use std::io::Error;
use std::net::UdpSocket;
use std::sync::mpsc::{Sender, channel};
use std::time::Duration;

const PATIENCE: Duration = Duration::from_secs(5);

fn output(port: TriggerPort, signal: Signal) -> TriggerOut {
    let mut trigger = TriggerOut::new(port);
    trigger.signal = signal;
    trigger
}

fn input(table: &str) -> TriggerIn {
    let text = format!(
        "resolution = [8, 8]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = {{ green = 520 }}\n\
         [trigger_in]\n{table}"
    );
    eyebox_optics::Display::from_toml(&text, "test").unwrap().trigger_in.unwrap()
}

/// Takes pulses until there are `count`.
fn taken(input: &mut dyn TriggerInput, count: usize) -> Vec<u64> {
    let mut pulses = Vec::new();
    for _ in 0..100 {
        if pulses.len() >= count {
            break;
        }
        input.wait(PATIENCE / 100, &mut pulses).unwrap();
    }
    pulses.iter().map(|pulse| pulse.lost_before).collect()
}

#[test]
fn gaps_in_numbers_are_lost_pulses() {
    let mut counter = Counter::default();
    let lost: Vec<u64> = [7, 8, 11, 255, 0, 1, 1].map(|number| counter.lost_before(number)).into();
    assert_eq!(lost, [0, 0, 2, 243, 0, 0, 255]);
}

#[test]
fn datagrams_are_pulses() {
    let receiver = UdpSocket::bind("127.0.0.1:0").unwrap();
    receiver.set_read_timeout(Some(PATIENCE)).unwrap();
    let place = || TriggerPort::Udp { address: receiver.local_addr().unwrap().to_string() };
    let mut bytes = [0; 8];
    let mut fixed = open_output(&output(place(), Signal::Byte)).unwrap();
    assert_eq!(fixed.pulse(3), Ok(Given::Sent));
    assert_eq!((receiver.recv(&mut bytes).unwrap(), bytes[0]), (1, 255));
    let mut counted = open_output(&output(place(), Signal::Number)).unwrap();
    assert_eq!(counted.pulse(258), Ok(Given::Sent));
    assert_eq!((receiver.recv(&mut bytes).unwrap(), bytes[0]), (1, 2));

    let free = UdpSocket::bind("127.0.0.1:0").unwrap().local_addr().unwrap().to_string();
    let mut input = open_input(&input(&format!("udp = \"{free}\"\nsignal = \"number\"\n"))).unwrap();
    for number in [4, 5, 9_u8] {
        receiver.send_to(&[number, 77], &free).unwrap();
    }
    assert_eq!(taken(&mut *input, 3), [0, 0, 3]);
}

#[test]
fn places_that_do_not_exist_are_refused() {
    let nowhere = TriggerPort::Serial { path: "/nowhere/tty".into(), baud: 9600 };
    let refused = open_output(&output(nowhere, Signal::Byte)).err().unwrap();
    let gpio = TriggerPort::Gpio { chip: "/nowhere/chip".into(), line: 3 };
    let no_chip = open_output(&output(gpio, Signal::Byte)).err().unwrap();
    if cfg!(feature = "triggers") {
        assert!(matches!(&refused, TriggerError::Open { port, .. } if port == "/nowhere/tty"), "{refused:?}");
    } else {
        assert!(matches!(refused, TriggerError::Unsupported { .. }));
    }
    if cfg!(all(target_os = "linux", feature = "triggers")) {
        assert!(matches!(&no_chip, TriggerError::Open { port, .. } if port == "/nowhere/chip:3"), "{no_chip:?}");
    } else {
        assert!(matches!(no_chip, TriggerError::Unsupported { .. }));
    }
}

/// Records the lines, which pseudo-terminals do not have.
struct Recorder(Sender<(bool, bool)>);

impl SerialLine for Recorder {
    fn write(&mut self, _byte: u8) -> Result<(), Error> {
        Err(Error::other("only lines are expected"))
    }

    fn set_line(&mut self, is_rts: bool, is_active: bool) -> Result<(), Error> {
        self.0.send((is_rts, is_active)).map_err(Error::other)
    }

    fn read(&mut self, _bytes: &mut [u8], _patience: Duration) -> Result<usize, Error> {
        Ok(0)
    }
}

#[test]
fn a_line_is_active_during_a_pulse() {
    for (signal, is_rts) in [(Signal::Dtr, false), (Signal::Rts, true)] {
        let (send, receive) = channel();
        let place = TriggerPort::Serial { path: "recorder".into(), baud: 9600 };
        let mut out = SerialOutput::new(Box::new(Recorder(send)), "recorder", &output(place, signal));
        assert_eq!(out.pulse(0), Ok(Given::Sent));
        assert_eq!(receive.try_iter().collect::<Vec<_>>(), [(is_rts, true), (is_rts, false)]);
        drop(receive);
        assert!(matches!(out.pulse(1), Err(TriggerError::Failed { port, .. }) if port == "recorder"));
    }
    let mut gone = SerialPulses::new(Box::new(Recorder(channel().0)), "recorder", &input("serial = \"recorder\"\n"));
    assert!(matches!(gone.wait(PATIENCE, &mut Vec::new()), Err(TriggerError::Failed { .. })));
}

#[cfg(all(target_os = "linux", feature = "triggers"))]
mod pseudo_terminals {
    use super::*;
    use serial2::SerialPort;

    /// Returns one end, and the file of the other end.
    fn pair() -> (SerialPort, String) {
        let (mut near, far) = SerialPort::pair().unwrap();
        near.set_read_timeout(PATIENCE).unwrap();
        near.set_write_timeout(PATIENCE).unwrap();
        let at = std::os::fd::AsRawFd::as_raw_fd(&far);
        let path = std::fs::read_link(format!("/proc/self/fd/{at}")).unwrap();
        (near, path.display().to_string())
    }

    #[test]
    fn bytes_arrive_in_order_and_a_reader_that_stops_blocks_nobody() {
        let (near, path) = pair();
        let place = TriggerPort::Serial { path, baud: 115_200 };
        let mut out = open_output(&output(place, Signal::Number)).unwrap();
        for number in 0..300 {
            assert_eq!(out.pulse(number), Ok(Given::Sent));
        }
        let mut bytes = [0; 300];
        near.read_exact(&mut bytes).unwrap();
        assert!(bytes.iter().enumerate().all(|(i, byte)| *byte == i as u8));
        // The terminal has room for some thousand bytes that nobody reads.
        let full = (0..200_000).find(|number| out.pulse(*number) == Ok(Given::Full));
        assert!(full.is_some());
        drop(near);
        assert!(matches!(out.pulse(0), Err(TriggerError::Failed { .. })));
    }

    #[test]
    fn each_byte_is_a_pulse() {
        let (near, path) = pair();
        let mut any = open_input(&input(&format!("serial = \"{path}\"\n"))).unwrap();
        near.write_all(&[1, 1, 9]).unwrap();
        assert_eq!(taken(&mut *any, 3), [0, 0, 0]);
        drop(any);
        let mut counted = open_input(&input(&format!("serial = \"{path}\"\nsignal = \"number\"\n"))).unwrap();
        near.write_all(&[254, 255, 2]).unwrap();
        assert_eq!(taken(&mut *counted, 3), [0, 0, 2]);
        drop(near);
        let mut pulses = Vec::new();
        assert!(matches!(counted.wait(PATIENCE, &mut pulses), Err(TriggerError::Failed { .. })));
    }
}
