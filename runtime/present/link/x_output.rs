//! Reads the mode, rotation, transform and properties of an output of an X server.

use super::properties::{Properties, Value};
use super::range::Timing;
use super::report::{LinkCheck, LinkPart, LinkState};
use crate::interference::Interference;
use x11rb::errors::ReplyError;
use x11rb::protocol::randr::{ConnectionExt as _, GetOutputInfoReply, GetScreenResourcesCurrentReply, Rotation};
use x11rb::protocol::render::Transform;
use x11rb::protocol::xproto::{AtomEnum, ConnectionExt as _};
use x11rb::rust_connection::RustConnection;

/// The longest property that is read, in units of 4 bytes. An EDID has up to 256 blocks, of which the first ones count.
const LONGEST: u32 = 256;
/// The number 1 with 16 bits after the point.
const ONE: i32 = 1 << 16;

/// True if a transform changes nothing.
fn is_identity(t: &Transform) -> bool {
    let rows = [
        [t.matrix11, t.matrix12, t.matrix13],
        [t.matrix21, t.matrix22, t.matrix23],
        [t.matrix31, t.matrix32, t.matrix33],
    ];
    rows == [[ONE, 0, 0], [0, ONE, 0], [0, 0, ONE]]
}

/// An output of an X server that is lit.
pub(super) struct XOutput {
    pub(super) name: String,
    output: u32,
    pub(super) crtc: u32,
}

impl XOutput {
    /// Finds the output with this name.
    pub(super) fn find(server: &RustConnection, root: u32, name: &str) -> Result<Option<Self>, ReplyError> {
        let resources = server.randr_get_screen_resources_current(root)?.reply()?;
        for output in resources.outputs {
            let info = server.randr_get_output_info(output, resources.config_timestamp)?.reply()?;
            if info.crtc != 0 && info.name == name.as_bytes() {
                return Ok(Some(Self { name: name.into(), output, crtc: info.crtc }));
            }
        }
        Ok(None)
    }

    /// Checks everything but the ramp.
    pub(super) fn check(&self, server: &RustConnection, root: u32) -> Result<Vec<LinkCheck>, ReplyError> {
        let resources = server.randr_get_screen_resources_current(root)?.reply()?;
        let time = resources.config_timestamp;
        let info = server.randr_get_output_info(self.output, time)?.reply()?;
        let crtc = server.randr_get_crtc_info(self.crtc, time)?.reply()?;
        let transform = server.randr_get_crtc_transform(self.crtc)?.reply()?.current_transform;
        let mode = timing(&resources, crtc.mode);
        let panel = preferred(&resources, &info);
        let output = || self.name.clone();
        let size = mode.zip(panel).filter(|(mode, panel)| mode.size != panel.size);
        let wrong_size = size.map(|(mode, panel)| {
            let (mode, panel) = (mode.size, panel.size);
            Interference::ModeSize { output: output(), mode, panel }
        });
        let is_scaled = wrong_size.is_some();
        let size = match (mode, panel) {
            (Some(_), Some(_)) => LinkCheck::judged(LinkPart::ModeSize, wrong_size),
            _ => LinkCheck::new(LinkPart::ModeSize, LinkState::Unknown),
        };
        let distorts = !is_identity(&transform);
        let transform =
            LinkCheck::judged(LinkPart::Transform, distorts.then(|| Interference::Transform { output: output() }));
        let mut checks = vec![size, transform, rotation(&self.name, crtc.rotation)];
        let properties = Properties { output: &self.name, all: self.properties(server)? };
        checks.extend(properties.judge(mode, is_scaled));
        Ok(checks)
    }

    /// True if the panel can change its rate, so that a driver may use it.
    pub(super) fn can_vary(&self, server: &RustConnection) -> bool {
        let all = self.properties(server).unwrap_or_default();
        Properties { output: &self.name, all }.numbers("vrr_capable") == Some(&[1])
    }

    fn properties(&self, server: &RustConnection) -> Result<Vec<(String, Value)>, ReplyError> {
        let atoms = server.randr_list_output_properties(self.output)?.reply()?.atoms;
        let mut all = Vec::with_capacity(atoms.len());
        for atom in atoms {
            let property = server
                .randr_get_output_property(self.output, atom, AtomEnum::ANY, 0, LONGEST, false, false)?
                .reply()?;
            let words = || property.data.chunks_exact(4).map(|w| u32::from_ne_bytes([w[0], w[1], w[2], w[3]]));
            let value = match property.format {
                32 if property.type_ == u32::from(AtomEnum::ATOM) => match words().next() {
                    Some(atom) => Value::Text(name(server, atom)?),
                    None => continue,
                },
                32 => Value::Numbers(words().collect()),
                8 => Value::Bytes(property.data),
                _ => continue,
            };
            all.push((name(server, atom)?, value));
        }
        Ok(all)
    }
}

fn name(server: &RustConnection, atom: u32) -> Result<String, ReplyError> {
    Ok(String::from_utf8_lossy(&server.get_atom_name(atom)?.reply()?.name).into_owned())
}

fn timing(resources: &GetScreenResourcesCurrentReply, mode: u32) -> Option<Timing> {
    let mode = resources.modes.iter().find(|m| m.id == mode)?;
    Some(Timing { size: [mode.height.into(), mode.width.into()], total: [mode.vtotal.into(), mode.htotal.into()] })
}

/// The preferred mode of an output, which has the size of its panel.
fn preferred(resources: &GetScreenResourcesCurrentReply, info: &GetOutputInfoReply) -> Option<Timing> {
    (info.num_preferred > 0).then(|| timing(resources, *info.modes.first()?)).flatten()
}

fn rotation(output: &str, rotation: Rotation) -> LinkCheck {
    let bits = u16::from(rotation);
    let is = |rotation: Rotation| bits & u16::from(rotation) != 0;
    let degrees = match () {
        () if is(Rotation::ROTATE90) => 90,
        () if is(Rotation::ROTATE180) => 180,
        () if is(Rotation::ROTATE270) => 270,
        () => 0,
    };
    let mirrored = is(Rotation::REFLECT_X) || is(Rotation::REFLECT_Y);
    let turned = degrees != 0 || mirrored;
    let found = turned.then(|| Interference::Rotation { output: output.into(), degrees, mirrored });
    LinkCheck::judged(LinkPart::Rotation, found)
}
