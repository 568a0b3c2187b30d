//! Gives and takes pulses as UDP datagrams of one byte.

use super::error::TriggerError;
use super::line::{Counter, Given, Pulse, TriggerInput, TriggerOutput};
use eyebox_base::steady;
use eyebox_optics::{Signal, TriggerIn, TriggerOut};
use std::io::ErrorKind;
use std::net::{ToSocketAddrs, UdpSocket};
use std::time::Duration;

struct UdpOutput {
    socket: UdpSocket,
    address: String,
    byte: Option<u8>,
}

pub(super) fn open_output(address: &str, trigger: &TriggerOut) -> Result<Box<dyn TriggerOutput>, TriggerError> {
    let failed = |error: std::io::Error| TriggerError::open(address, error);
    let to = address.to_socket_addrs().map_err(failed)?.next();
    let to = to.ok_or_else(|| TriggerError::open(address, "the host has no address"))?;
    let from = if to.is_ipv4() { "0.0.0.0:0" } else { "[::]:0" };
    let socket = UdpSocket::bind(from).map_err(failed)?;
    socket.connect(to).map_err(failed)?;
    socket.set_nonblocking(true).map_err(failed)?;
    let byte = (trigger.signal == Signal::Byte).then_some(trigger.byte);
    Ok(Box::new(UdpOutput { socket, address: address.into(), byte }))
}

impl TriggerOutput for UdpOutput {
    fn pulse(&mut self, number: u64) -> Result<Given, TriggerError> {
        let byte = [self.byte.unwrap_or(number as u8)];
        // Without a receiver, the system reports the refusal of an earlier datagram, and does not send this one.
        let sent = match self.socket.send(&byte) {
            Err(error) if error.kind() == ErrorKind::ConnectionRefused => self.socket.send(&byte),
            sent => sent,
        };
        match sent {
            Ok(_) => Ok(Given::Sent),
            Err(error) if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::ConnectionRefused) => {
                Ok(Given::Full)
            }
            Err(error) => Err(TriggerError::failed(&self.address, error)),
        }
    }
}

struct UdpInput {
    socket: UdpSocket,
    address: String,
    counter: Option<Counter>,
}

pub(super) fn open_input(address: &str, trigger: &TriggerIn) -> Result<Box<dyn TriggerInput>, TriggerError> {
    let socket = UdpSocket::bind(address).map_err(|error| TriggerError::open(address, error))?;
    let counter = (trigger.signal == Signal::Number).then(Counter::default);
    Ok(Box::new(UdpInput { socket, address: address.into(), counter }))
}

impl TriggerInput for UdpInput {
    fn wait(&mut self, patience: Duration, pulses: &mut Vec<Pulse>) -> Result<(), TriggerError> {
        let patience = patience.max(Duration::from_millis(1));
        self.socket.set_read_timeout(Some(patience)).map_err(|error| TriggerError::failed(&self.address, error))?;
        let mut bytes = [0; 2048];
        match self.socket.recv(&mut bytes) {
            Ok(length) => {
                let number = bytes[..length].first().copied().unwrap_or(0);
                let lost_before = self.counter.as_mut().map_or(0, |counter| counter.lost_before(number));
                pulses.push(Pulse { at_ns: steady::now_ns(), lost_before });
                Ok(())
            }
            Err(error)
                if matches!(error.kind(), ErrorKind::WouldBlock | ErrorKind::TimedOut | ErrorKind::Interrupted) =>
            {
                Ok(())
            }
            Err(error) => Err(TriggerError::failed(&self.address, error)),
        }
    }
}
