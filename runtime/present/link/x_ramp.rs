//! Loads a linear gamma ramp into an output of an X server, and puts back the ramp that was there.

use super::report::{LinkCheck, LinkPart, LinkState};
use super::x_record::Record;
use crate::interference::Interference;
use x11rb::protocol::randr::ConnectionExt as _;
use x11rb::rust_connection::RustConnection;

/// A ramp with the channels red, green and blue.
type Channels = [Vec<u16>; 3];

/// The gamma ramp of an output.
pub(super) struct Ramp {
    output: String,
    crtc: u32,
    record: Record,
    /// True if this session loaded a linear ramp, whose record exists.
    is_set: bool,
}

impl Ramp {
    pub(super) fn new(server: &RustConnection, root: u32, output: &str, crtc: u32) -> Option<Self> {
        let record = Record::new(server, root, &format!("_EYEBOX_GAMMA_{output}"))?;
        Some(Self { output: output.into(), crtc, record, is_set: false })
    }

    /// Puts back the ramp that a killed session left, and returns true if there was one.
    pub(super) fn recover(&mut self, server: &RustConnection) -> bool {
        let Some(left) = self.record.left(server) else { return false };
        self.load_recorded(server, &left);
        true
    }

    /// Checks the ramp, and loads a linear one if an owner for the record is given.
    pub(super) fn check(&mut self, server: &RustConnection, owner: Option<u32>) -> LinkCheck {
        let part = LinkPart::GammaRamp;
        let Some(ramp) = read(server, self.crtc).filter(|ramp| ramp[0].len() > 1) else {
            return LinkCheck::new(part, LinkState::Unknown);
        };
        let levels = ramp.iter().map(|channel| change(channel)).max().unwrap_or_default();
        let output = self.output.clone();
        let found = |corrected| Interference::GammaRamp { output, levels, corrected };
        match (levels, owner) {
            (0, _) => LinkCheck::new(part, if self.is_set { LinkState::SetRight } else { LinkState::Right }),
            (_, None) => LinkCheck::set(part, LinkState::SetWhileShown, found(false)),
            (_, Some(owner)) => match self.set_linear(server, owner, &ramp) {
                Some(()) => LinkCheck::set(part, LinkState::SetRight, found(true)),
                None => LinkCheck::judged(part, Some(found(false))),
            },
        }
    }

    fn set_linear(&mut self, server: &RustConnection, owner: u32, was: &Channels) -> Option<()> {
        self.record.write(server, owner, &was.concat())?;
        self.is_set = true;
        let linear = linear(was[0].len());
        write(server, self.crtc, &[linear.clone(), linear.clone(), linear])
    }

    /// Puts back the ramp that was there before this session, unless another program has loaded one since.
    pub(super) fn put_back(&mut self, server: &RustConnection) {
        if let Some(was) = self.record.read(server).filter(|_| self.is_set) {
            self.load_recorded(server, &was);
        }
        self.is_set = false;
    }

    /// Loads a recorded ramp over a linear one, and removes the record.
    fn load_recorded(&self, server: &RustConnection, recorded: &[u16]) {
        if let Some(now) = read(server, self.crtc)
            && now.iter().all(|channel| change(channel) == 0)
            && recorded.len() == 3 * now[0].len()
        {
            let size = now[0].len();
            let channel = |i: usize| recorded[i * size..(i + 1) * size].to_vec();
            let _ = write(server, self.crtc, &[channel(0), channel(1), channel(2)]);
        }
        self.record.remove(server);
    }
}

fn read(server: &RustConnection, crtc: u32) -> Option<Channels> {
    let ramp = server.randr_get_crtc_gamma(crtc).ok()?.reply().ok()?;
    let same = ramp.red.len() == ramp.green.len() && ramp.red.len() == ramp.blue.len();
    same.then_some([ramp.red, ramp.green, ramp.blue])
}

fn write(server: &RustConnection, crtc: u32, [red, green, blue]: &Channels) -> Option<()> {
    server.randr_set_crtc_gamma(crtc, red, green, blue).ok()?.check().ok()
}

/// A ramp that changes nothing.
fn linear(count: usize) -> Vec<u16> {
    let last = count.saturating_sub(1).max(1) as f64;
    (0..count).map(|i| (65535.0 * i as f64 / last).round() as u16).collect()
}

/// Returns the largest change by a ramp, in whole levels of 8 bits. A ramp of zeros was never set (Xvfb). On some
/// servers (Xorg's dummy), a ramp without a change has only the high byte. That is less than a level.
fn change(ramp: &[u16]) -> u32 {
    if ramp.len() < 2 || ramp.iter().all(|value| *value == 0) {
        return 0;
    }
    let off = |(value, line): (&u16, u16)| (f64::from(*value) - f64::from(line)).abs() / 257.0;
    ramp.iter().zip(linear(ramp.len())).map(off).fold(0.0, f64::max) as u32
}

#[cfg(test)]
mod tests {
    use super::change;

    #[test]
    fn a_ramp_changes_levels_by_its_distance_from_a_line() {
        let ramp = |n: usize, of: fn(f64) -> f64| -> Vec<u16> {
            (0..n).map(|i| (65535.0 * of(i as f64 / (n as f64 - 1.0))).round() as u16).collect()
        };
        for n in [2, 256, 1024, 4096] {
            assert_eq!(change(&ramp(n, |x| x)), 0, "{n} entries");
        }
        assert_eq!(change(&(0..256).map(|i| i << 8).collect::<Vec<u16>>()), 0);
        assert_eq!(change(&ramp(256, |x| 0.8 * x)), 51);
        assert_eq!(change(&ramp(256, |x| 1.0 - x)), 255);
        // sRGB's 2.2 against a line gives 0.283 at 0.518.
        assert_eq!(change(&ramp(1024, |x| x.powf(2.2))), 72);
        assert_eq!((change(&[0; 256]), change(&[]), change(&[9])), (0, 0, 0));
    }
}
