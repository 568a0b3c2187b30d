//! Maps the mouse and the keys of a preview window to changes of the pupil and of the picture.

use super::place::{Rect, focus_step, pupil_at};
use super::{Overlay, PreviewContent, RenderedView, Side};
use crate::optics::{Geometry, Optics, Pupil, dioptres};
use crate::present::{WindowEvent, WindowKey};

/// A request of the user that the owner of the window has to carry out.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Action {
    /// The user closes the preview.
    Close,
    /// The user saves the picture as a file.
    Save,
    /// The user pauses or resumes the sequence.
    Pause,
    /// The user moves by this number of holograms in the sequence.
    Step(i64),
}

/// The narrowest pupil (m).
const NARROWEST: f64 = 0.5e-3;
/// The change of the diameter with a press of a key (m).
const WIDER: f64 = 0.5e-3;
/// The movement of the pupil with a press of an arrow key (m).
const ASIDE: f64 = 0.25e-3;

/// The pupil and the kind of picture, as mouse and keys change them.
#[derive(Debug, Clone, PartialEq)]
pub struct Controls {
    /// The pupil of the simulated eye.
    pub pupil: Pupil,
    /// True for all sub-frames, false for the sub-frame of number `frame` alone.
    pub averaged: bool,
    /// The number of the sub-frame that is shown if `averaged` is false, from 0.
    pub frame: usize,
    /// The picture or pictures that are shown.
    pub side: Side,
    /// True if the help covers the picture.
    pub help: bool,
    /// True if the status line and the map of the eyebox are in the picture.
    pub line: bool,
    frames: usize,
    eyebox: f64,
    optics: Optics,
    scene: bool,
    sequence: bool,
}

impl Controls {
    /// Starts with this pupil. `scene` and `sequence` state if the preview has a scene and a sequence.
    pub fn new(showing: &PreviewContent, pupil: Pupil, scene: bool, sequence: bool) -> Self {
        let optics = showing.colors.iter().map(|c| c.optics).max_by(|a, b| a.wavelength.total_cmp(&b.wavelength));
        let optics = optics.unwrap_or(Optics {
            height: 1,
            width: 1,
            pitch: 8e-6,
            wavelength: 520e-9,
            focal_length: 0.4,
            geometry: Geometry::Relay,
            offset: Default::default(),
            mask_factor: 1,
        });
        Self {
            pupil,
            averaged: true,
            frame: 0,
            side: Side::Seen,
            help: false,
            line: false,
            frames: showing.frames,
            eyebox: showing.eyebox,
            optics,
            scene,
            sequence,
        }
    }

    /// Returns the number of the sub-frame that is shown alone, or `None` for all sub-frames.
    pub fn alone(&self) -> Option<usize> {
        (!self.averaged).then_some(self.frame)
    }

    /// Returns the number of pictures that are shown side by side.
    pub fn count(&self) -> usize {
        if self.side == Side::Both { 2 } else { 1 }
    }

    /// Applies an event of the window, whose pictures were at these places.
    pub fn take(&mut self, event: WindowEvent, pictures: &[Rect]) -> Option<Action> {
        match event {
            WindowEvent::Close => return Some(Action::Close),
            WindowEvent::Pointer(position) => [self.pupil.x, self.pupil.y] = pupil_at(position, pictures, self.eyebox),
            WindowEvent::Wheel(notches) if notches.is_finite() => {
                // A coarse wheel or a faulty touch pad sends large steps at once.
                self.pupil.depth += notches.clamp(-20.0, 20.0) * focus_step(&self.optics, &self.pupil);
            }
            WindowEvent::Key(key) => return self.key(key),
            _ => {}
        }
        None
    }

    fn key(&mut self, key: WindowKey) -> Option<Action> {
        let reach = self.eyebox / 2.0;
        match key {
            WindowKey::Escape | WindowKey::Character('q') => return Some(Action::Close),
            WindowKey::Home => (self.pupil.x, self.pupil.y) = (0.0, 0.0),
            WindowKey::Arrow([x, y]) => {
                self.pupil.x = (self.pupil.x + ASIDE * f64::from(x)).clamp(-reach, reach);
                self.pupil.y = (self.pupil.y + ASIDE * f64::from(y)).clamp(-reach, reach);
            }
            WindowKey::Character(c) => match c {
                '+' | '=' => self.widen(WIDER),
                '-' | '_' => self.widen(-WIDER),
                '0' => self.pupil.depth = 0.0,
                'a' => self.averaged = !self.averaged,
                'n' => self.frame = (self.frame + 1) % self.frames.max(1),
                'p' if self.scene => {
                    self.side = match self.side {
                        Side::Seen => Side::Both,
                        Side::Both => Side::Photograph,
                        Side::Photograph => Side::Seen,
                    };
                }
                'h' | '?' => self.help = !self.help,
                'i' => self.line = !self.line,
                's' => return Some(Action::Save),
                ' ' if self.sequence => return Some(Action::Pause),
                '.' if self.sequence => return Some(Action::Step(1)),
                ',' if self.sequence => return Some(Action::Step(-1)),
                _ => {}
            },
        }
        None
    }

    fn widen(&mut self, by: f64) {
        let widest = self.eyebox.max(NARROWEST);
        self.pupil.diameter = (self.pupil.diameter + by).clamp(NARROWEST, widest);
    }

    /// Describes a picture in one line.
    pub fn describe(&self, seen: &RenderedView) -> String {
        let [x, y, d, z] = seen.look.pupil.to_mm();
        let light = match seen.look.frame {
            Some(f) => format!("sub-frame {} of {}", f + 1, self.frames),
            None => format!("{} sub-frame{}", self.frames, if self.frames == 1 { "" } else { "s" }),
        };
        let psnr = seen.psnr_db.map_or(String::new(), |db| format!(", {db:.1} dB"));
        let focus = dioptres(seen.look.pupil.depth, self.optics.focal_length);
        let what = match seen.look.side {
            Side::Seen => "",
            Side::Both => ", next to the target image",
            Side::Photograph => ", the target image",
        };
        format!(
            "pupil {x:+.2}, {y:+.2} mm, {d:.1} mm wide, focus {z:+.2} mm ({focus:+.3} D), {light}{psnr}, {:.0} ms{what}",
            seen.milliseconds
        )
    }

    /// Returns the overlay of the picture.
    pub fn overlay(&self, seen: Option<&RenderedView>) -> Overlay {
        let line = seen.filter(|_| self.line);
        Overlay {
            help: if self.help { self.help_lines() } else { Vec::new() },
            line: line.map(|seen| self.describe(seen)),
            map: line.map(|seen| {
                let p = seen.look.pupil;
                [p.x / self.eyebox, p.y / self.eyebox, p.diameter / self.eyebox]
            }),
        }
    }

    fn help_lines(&self) -> Vec<String> {
        let mut lines = vec![
            "mouse    the pupil in the eyebox",
            "arrows   the pupil by 0.25 mm",
            "home     the pupil in the middle",
            "wheel    focus",
            "0        focus on the SLM",
            "+ -      pupil diameter",
            "a        average sub-frames, or one",
            "n        the next sub-frame alone",
        ];
        if self.scene {
            lines.push("p        target image too, or alone");
        }
        if self.sequence {
            lines.extend(["space    pause", ", .      one hologram back, on"]);
        }
        lines.extend(["i        line and map", "s        save as PNG", "h        this help", "escape   close"]);
        lines.into_iter().map(String::from).collect()
    }
}

#[cfg(test)]
mod tests {
    use super::super::{Look, Picture, PreviewColor};
    use super::*;
    use crate::optics::Padding;
    use std::sync::Arc;

    fn controls(scene: bool, sequence: bool) -> Controls {
        let optics = Optics::new(36, 64, 8e-6, 440e-9, 0.4).unwrap();
        let phases = Arc::new(vec![0.0; 8 * 36 * 64]);
        let color = PreviewColor {
            color: None,
            optics,
            exposure: 1.0,
            share: 1.0,
            model: None,
            eye: None,
            modes: [].into(),
            powers: [].into(),
            map: None,
            phases,
        };
        let (eyebox, padding) = (optics.eyebox(), Padding::default());
        let showing = PreviewContent {
            frames: 8,
            padding,
            colors: vec![color],
            eyebox,
            tiles: None,
            scene: None,
            motion: Vec::new(),
            obstruction: None,
        };
        Controls::new(&showing, Pupil::from_mm([0.0, 0.0, 4.0, 0.0]), scene, sequence)
    }

    fn press(c: &mut Controls, keys: &str) -> Vec<Action> {
        keys.chars().filter_map(|k| c.take(WindowEvent::Key(WindowKey::Character(k)), &[])).collect()
    }

    #[test]
    fn keys_do_what_the_help_says() {
        let mut c = controls(true, true);
        assert_eq!(
            press(&mut c, "s .,q"),
            [Action::Save, Action::Pause, Action::Step(1), Action::Step(-1), Action::Close]
        );
        assert_eq!(c.take(WindowEvent::Key(WindowKey::Escape), &[]), Some(Action::Close));
        assert_eq!(c.take(WindowEvent::Close, &[]), Some(Action::Close));
        press(&mut c, "++-a");
        assert_eq!((c.pupil.to_mm()[2].round(), c.alone()), (5.0, Some(0)));
        press(&mut c, "nn");
        assert_eq!(c.alone(), Some(2));
        press(&mut c, "nnnnnn");
        assert_eq!(c.alone(), Some(0));
        press(&mut c, "a");
        assert_eq!(c.alone(), None);
        let sides: Vec<Side> = (0..3)
            .map(|_| {
                press(&mut c, "p");
                c.side
            })
            .collect();
        assert_eq!(sides, [Side::Both, Side::Photograph, Side::Seen]);
        press(&mut c, &"-".repeat(50));
        assert!((c.pupil.diameter - NARROWEST).abs() < 1e-12);
        press(&mut c, &"+".repeat(500));
        assert!((c.pupil.diameter - 22e-3).abs() < 1e-9);
        press(&mut c, "h");
        let help = c.overlay(None).help;
        assert!(help.iter().any(|l| l.starts_with("p ")) && help.iter().any(|l| l.starts_with("space")));
        // Without a scene and a sequence, their keys do nothing and the help does not list them.
        let mut c = controls(false, false);
        assert!(press(&mut c, "p .,").is_empty() && c.side == Side::Seen);
        press(&mut c, "h");
        assert!(!c.overlay(None).help.iter().any(|l| l.starts_with("p ") || l.starts_with("space")));
    }

    #[test]
    fn mouse_wheel_and_arrows_move_the_pupil_within_the_eyebox() {
        let mut c = controls(false, false);
        let places = super::super::places([36, 64], [36, 64], 1);
        c.take(WindowEvent::Pointer([18.0, 48.0]), &places);
        assert!((c.pupil.x - 5.5e-3).abs() < 1e-9 && c.pupil.y.abs() < 1e-9);
        c.take(WindowEvent::Wheel(2.0), &places);
        assert!((c.pupil.depth - 0.4e-3).abs() < 1e-9, "{:?}", c.pupil);
        c.take(WindowEvent::Wheel(f64::NAN), &places);
        assert!(c.pupil.depth.is_finite());
        press(&mut c, "0");
        for _ in 0..100 {
            c.take(WindowEvent::Key(WindowKey::Arrow([1, -1])), &places);
        }
        assert_eq!(c.pupil.depth, 0.0);
        assert!((c.pupil.x - 11e-3).abs() < 1e-9 && (c.pupil.y + 11e-3).abs() < 1e-9);
        c.take(WindowEvent::Key(WindowKey::Home), &places);
        assert_eq!((c.pupil.x, c.pupil.y), (0.0, 0.0));
    }

    #[test]
    fn the_line_says_what_is_seen_and_not_what_is_asked() {
        let mut c = controls(true, false);
        let look = Look { pupil: Pupil::from_mm([1.0, -2.0, 4.0, 1.5]), frame: None, side: Side::Both, within: [1, 1] };
        let picture = Picture::black([1, 1]);
        let seen = RenderedView {
            look,
            content: 0,
            planes: Vec::new(),
            exposures: Vec::new(),
            wanted: Vec::new(),
            seen: picture,
            photograph: None,
            psnr_db: Some(31.25),
            milliseconds: 12.4,
            whole: true,
        };
        press(&mut c, "ia");
        let line = c.overlay(Some(&seen)).line.expect("a line");
        for part in ["+1.00, -2.00 mm", "4.0 mm wide", "+1.50 mm (+0.009 D)", "8 sub-frames", "31.2 dB", "12 ms"] {
            assert!(line.contains(part), "{line}: {part}");
        }
        assert!(c.overlay(Some(&seen)).map.is_some_and(|m| (m[2] - 4.0 / 22.0).abs() < 1e-9));
    }
}
