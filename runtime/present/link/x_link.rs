//! Checks the link of an X server to an output, sets it right for a session, and puts it back.

use super::report::{Link, LinkCheck, LinkPart, LinkState, LinkSystem};
use super::x_output::XOutput;
use super::x_power::Power;
use super::x_ramp::Ramp;
use super::x_record::owner;
use crate::interference::Interference;
use x11rb::connection::{Connection as _, RequestConnection as _};
use x11rb::protocol::randr;
use x11rb::protocol::xproto::{AtomEnum, ConnectionExt as _, PropMode};
use x11rb::rust_connection::RustConnection;
use x11rb::wrapper::ConnectionExt as _;

/// The link to an output, over a connection of its own.
pub(in super::super) struct XLink {
    server: RustConnection,
    root: u32,
    output: Option<(XOutput, Ramp)>,
    power: Power,
    /// The selection whose owner is the compositor.
    compositor: Option<u32>,
    /// The window of a session, and the owner of its records.
    session: Option<(u32, Option<u32>)>,
    recovered: bool,
    /// True for a server inside a Wayland compositor, whose outputs are not real.
    is_inside_wayland: bool,
}

impl XLink {
    /// Connects to the X server of the environment, and puts back what a killed session left. Returns nothing if there
    /// is no server.
    pub(in super::super) fn open(monitor: &str) -> Option<Self> {
        let (server, screen) = RustConnection::connect(None).ok()?;
        let root = server.setup().roots.get(screen)?.root;
        let has = |name| server.extension_information(name).ok().flatten().is_some();
        let has_randr = has(randr::X11_EXTENSION_NAME);
        let is_inside_wayland = has("XWAYLAND") || monitor.starts_with("XWAYLAND");
        let output = if has_randr { XOutput::find(&server, root, monitor).ok().flatten() } else { None };
        let ramp = |output: XOutput| Some((Ramp::new(&server, root, &output.name, output.crtc)?, output));
        let mut output = output.and_then(ramp).map(|(ramp, output)| (output, ramp));
        let mut power = Power::new(&server, root);
        let recovered = [output.as_mut().is_some_and(|(_, ramp)| ramp.recover(&server)), power.recover(&server)];
        let compositor = atom(&server, &format!("_NET_WM_CM_S{screen}"));
        let recovered = recovered.contains(&true);
        Some(Self { server, root, output, power, compositor, session: None, recovered, is_inside_wayland })
    }

    /// Begins to set the link right for a session that shows in this window.
    pub(in super::super) fn begin(&mut self, window: u32) {
        self.power.suspend(&self.server);
        self.session = Some((window, owner(&self.server, self.root).ok()));
        self.set_on_window("_NET_WM_BYPASS_COMPOSITOR", 1);
    }

    /// Checks all parts. During a session, it also sets them right.
    pub(in super::super) fn check(&mut self) -> Link {
        if self.is_inside_wayland {
            let name = self.output.as_ref().map(|(output, _)| output.name.clone());
            return Link::unknown(LinkSystem::Wayland, name);
        }
        let owner = self.session.and_then(|(_, owner)| owner);
        let mut checks = Vec::new();
        let mut name = None;
        if let Some((output, ramp)) = &mut self.output {
            name = Some(output.name.clone());
            checks.push(ramp.check(&self.server, owner));
            checks.extend(output.check(&self.server, self.root).unwrap_or_default());
        }
        checks.push(self.check_refresh());
        checks.push(self.check_compositor());
        checks.push(self.power.check_saver(&self.server));
        checks.push(self.power.check_power(&self.server, owner));
        Link { system: LinkSystem::X11, output: name, checks, recovered: self.recovered }
    }

    /// Puts back what this session changed.
    pub(in super::super) fn put_back(&mut self) {
        if let Some((_, ramp)) = &mut self.output {
            ramp.put_back(&self.server);
        }
        self.power.put_back(&self.server);
    }

    fn check_compositor(&self) -> LinkCheck {
        let part = LinkPart::Compositor;
        let owner = || self.server.get_selection_owner(self.compositor?).ok()?.reply().ok();
        match owner() {
            None => LinkCheck::new(part, LinkState::Unknown),
            Some(reply) if reply.owner == x11rb::NONE => LinkCheck::new(part, LinkState::Right),
            Some(_) => LinkCheck::judged(part, Some(Interference::Compositor)),
        }
    }

    /// Mesa requests variable refresh for a window with this property, which changes the times of video frames.
    fn check_refresh(&self) -> LinkCheck {
        const NAME: &str = "_VARIABLE_REFRESH";
        let part = LinkPart::VariableRefresh;
        let Some((window, _)) = self.session else {
            let can = self.output.as_ref().is_some_and(|(output, _)| output.can_vary(&self.server));
            return LinkCheck::new(part, if can { LinkState::SetWhileShown } else { LinkState::Right });
        };
        let property = || {
            let name = atom(&self.server, NAME)?;
            let reply = self.server.get_property(false, window, name, AtomEnum::CARDINAL, 0, 1).ok()?;
            reply.reply().ok()?.value32()?.next()
        };
        match property() {
            Some(0) => LinkCheck::new(part, LinkState::SetRight),
            Some(_) => {
                self.set_on_window(NAME, 0);
                LinkCheck::new(part, LinkState::SetRight)
            }
            None => LinkCheck::new(part, LinkState::Right),
        }
    }

    fn set_on_window(&self, name: &str, value: u32) {
        if let (Some((window, _)), Some(name)) = (self.session, atom(&self.server, name)) {
            let set = self.server.change_property32(PropMode::REPLACE, window, name, AtomEnum::CARDINAL, &[value]);
            // The window may be gone.
            let _ = set.map(|cookie| cookie.check());
        }
    }
}

fn atom(server: &RustConnection, name: &str) -> Option<u32> {
    Some(server.intern_atom(false, name.as_bytes()).ok()?.reply().ok()?.atom)
}
