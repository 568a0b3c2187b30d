//! Presents each video frame on two panels, one for each eye.

use super::link::Link;
use super::presenter::{Apart, Event, Feedback, Presenter};
use super::{Interference, PresentError};
use std::collections::VecDeque;

/// Two panels that show one video frame together. The picture holds the bytes of the left panel first and the
/// bytes of the right panel after them.
///
/// A panel that is lost leaves the other one showing. An error is returned only if both are lost.
pub struct TwoPanels {
    panels: [Panel; 2],
    /// The period of the video frames (ns).
    period_ns: i64,
    apart: Apart,
    notes: Vec<String>,
}

struct Panel {
    name: &'static str,
    presenter: Box<dyn Presenter>,
    is_lost: bool,
    /// The reported lights that are not compared yet.
    lights: VecDeque<Feedback>,
}

/// Lights that wait for the other panel.
const WAITING: usize = 64;

impl TwoPanels {
    /// Joins the panels of the left and the right eye, which show video frames of this period (ns).
    pub fn new(left: Box<dyn Presenter>, right: Box<dyn Presenter>, period_ns: i64) -> Self {
        let panel =
            |name, presenter| Panel { name, presenter, is_lost: false, lights: VecDeque::with_capacity(WAITING) };
        let panels = [panel("left", left), panel("right", right)];
        Self { panels, period_ns, apart: Apart::default(), notes: Vec::new() }
    }

    /// Calls both panels. A panel that fails is left out from now on.
    fn each(
        &mut self,
        mut call: impl FnMut(usize, &mut dyn Presenter) -> Result<(), PresentError>,
    ) -> Result<(), PresentError> {
        for at in [0, 1] {
            let panel = &mut self.panels[at];
            if panel.is_lost {
                continue;
            }
            let Err(error) = call(at, panel.presenter.as_mut()) else { continue };
            let (name, other) = (panel.name, 1 - at);
            panel.is_lost = true;
            if self.panels[other].is_lost {
                return Err(error);
            }
            self.notes.push(format!("the {name} panel is lost, and the other one continues ({error})"));
        }
        Ok(())
    }

    /// Compares the reported lights of both panels, one video frame after the other.
    fn compare(&mut self) {
        let [left, right] = &mut self.panels;
        while let (Some(l), Some(r)) = (left.lights.front(), right.lights.front()) {
            if l.id != r.id {
                let earlier = if l.id < r.id { &mut *left } else { &mut *right };
                earlier.lights.pop_front();
                continue;
            }
            let apart_ns = l.actual_display_time_ns.abs_diff(r.actual_display_time_ns);
            self.apart.video_frames += 1;
            self.apart.in_other_periods += u64::from(apart_ns > self.period_ns.unsigned_abs() / 2);
            self.apart.sum_ns = self.apart.sum_ns.saturating_add(apart_ns);
            self.apart.largest_ns = self.apart.largest_ns.max(apart_ns);
            left.lights.pop_front();
            right.lights.pop_front();
        }
    }
}

fn keep(lights: &mut VecDeque<Feedback>, light: Feedback) {
    if lights.len() == WAITING {
        lights.pop_front();
    }
    lights.push_back(light);
}

impl Presenter for TwoPanels {
    fn describe(&self) -> String {
        let [left, right] = &self.panels;
        format!("left {}, right {}", left.presenter.describe(), right.presenter.describe())
    }

    fn timed_by(&self) -> &'static str {
        self.panels[0].presenter.timed_by()
    }

    fn upload(&mut self, picture: &[u8]) -> Result<(), PresentError> {
        let (left, right) = picture.split_at(picture.len() / 2);
        self.each(|at, panel| panel.upload([left, right][at]))
    }

    fn present(&mut self, id: u64, desired_present_time_ns: i64) -> Result<(), PresentError> {
        self.each(|_, panel| panel.present(id, desired_present_time_ns))
    }

    fn feedback(&mut self) -> Option<Feedback> {
        let mut reported = None;
        // The player follows the left panel, or the one that is not lost.
        let followed = usize::from(self.panels[0].is_lost);
        for (at, panel) in self.panels.iter_mut().enumerate() {
            if at == followed {
                reported = panel.presenter.feedback();
                reported.into_iter().for_each(|light| keep(&mut panel.lights, light));
            } else {
                while let Some(light) = panel.presenter.feedback() {
                    keep(&mut panel.lights, light);
                }
            }
        }
        self.compare();
        reported
    }

    fn finish(&mut self) -> Result<(), PresentError> {
        self.each(|_, panel| panel.finish())
    }

    fn link(&self) -> Option<&Link> {
        self.panels[0].presenter.link()
    }

    fn links(&self) -> Vec<&Link> {
        self.panels.iter().flat_map(|panel| panel.presenter.links()).collect()
    }

    fn panel_notes(&mut self) -> Vec<String> {
        std::mem::take(&mut self.notes)
    }

    fn apart(&self) -> Option<Apart> {
        Some(self.apart)
    }

    fn interference(&mut self) -> Vec<Interference> {
        self.panels.iter_mut().flat_map(|panel| panel.presenter.interference()).collect()
    }

    fn event(&mut self) -> Option<Event> {
        self.panels.iter_mut().find_map(|panel| panel.presenter.event())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{Clock, Offscreen, Rate, SimulatedClock};
    use eyebox_base::reason;
    use std::cell::RefCell;
    use std::rc::Rc;

    /// A panel that stores its pictures, fails at one of them, and reports its lights late.
    struct Fake {
        pictures: Pictures,
        fails_at: Option<usize>,
        late_ns: i64,
        lights: VecDeque<Feedback>,
    }

    type Pictures = Rc<RefCell<Vec<Vec<u8>>>>;

    impl Fake {
        fn boxed(fails_at: Option<usize>, late_ns: i64) -> (Box<dyn Presenter>, Pictures) {
            let pictures = Pictures::default();
            let fake = Self { pictures: Rc::clone(&pictures), fails_at, late_ns, lights: VecDeque::new() };
            (Box::new(fake), pictures)
        }
    }

    impl Presenter for Fake {
        fn describe(&self) -> String {
            "a fake".into()
        }

        fn upload(&mut self, picture: &[u8]) -> Result<(), PresentError> {
            if self.fails_at == Some(self.pictures.borrow().len()) {
                return Err(PresentError::display("a fake", reason!("gone", "it is gone")));
            }
            self.pictures.borrow_mut().push(picture.to_vec());
            Ok(())
        }

        fn present(&mut self, id: u64, desired_ns: i64) -> Result<(), PresentError> {
            self.lights.push_back(Feedback { id, actual_display_time_ns: desired_ns + self.late_ns });
            Ok(())
        }

        fn feedback(&mut self) -> Option<Feedback> {
            self.lights.pop_front()
        }
    }

    fn show(panels: &mut TwoPanels, count: u64) -> Result<Vec<u64>, PresentError> {
        let mut lit = Vec::new();
        for id in 0..count {
            panels.upload(&[id as u8, 1, id as u8, 2])?;
            panels.present(id, 1_000 * id as i64)?;
            while let Some(light) = panels.feedback() {
                lit.push(light.id);
            }
        }
        Ok(lit)
    }

    #[test]
    fn each_panel_takes_its_half_and_the_lights_are_compared() {
        let ((left, of_left), (right, of_right)) = (Fake::boxed(None, 0), Fake::boxed(None, 300));
        let mut panels = TwoPanels::new(left, right, 1_000);
        assert_eq!(show(&mut panels, 3).unwrap(), [0, 1, 2]);
        assert_eq!(*of_left.borrow(), [[0, 1], [1, 1], [2, 1]]);
        assert_eq!(*of_right.borrow(), [[0, 2], [1, 2], [2, 2]]);
        let apart = panels.apart().unwrap();
        assert_eq!((apart.video_frames, apart.in_other_periods, apart.largest_ns), (3, 0, 300));
        let ((left, _), (right, _)) = (Fake::boxed(None, 0), Fake::boxed(None, -600));
        let mut late = TwoPanels::new(left, right, 1_000);
        show(&mut late, 5).unwrap();
        assert_eq!(late.apart().unwrap().in_other_periods, 5);
    }

    #[test]
    fn a_lost_panel_leaves_the_other_one_until_both_are_lost() {
        for lost in [0, 1] {
            let fails = |at: usize| if at == lost { Some(2) } else { Some(4) };
            let ((left, of_left), (right, of_right)) = (Fake::boxed(fails(0), 0), Fake::boxed(fails(1), 0));
            let mut panels = TwoPanels::new(left, right, 1_000);
            assert_eq!(show(&mut panels, 4).unwrap(), [0, 1, 2, 3], "the lights of the remaining panel");
            let counts = [of_left.borrow().len(), of_right.borrow().len()];
            assert_eq!((counts[lost], counts[1 - lost]), (2, 4));
            let notes = panels.panel_notes();
            assert!(notes.len() == 1 && notes[0].contains(["left", "right"][lost]), "{notes:?}");
            assert!(panels.panel_notes().is_empty());
            assert!(matches!(show(&mut panels, 1), Err(PresentError::Display { .. })));
        }
    }

    #[test]
    fn panels_in_memory_light_up_at_the_same_time() {
        let clock: Rc<dyn Clock> = Rc::new(SimulatedClock::default());
        let rate = Rate::new(60, 1).unwrap();
        let memory = || Box::new(Offscreen::new(Rc::clone(&clock), rate, 2));
        let mut panels = TwoPanels::new(memory(), memory(), rate.period_ns());
        for id in 0..60 {
            panels.upload(&[1, 2, 3, 4]).unwrap();
            panels.present(id, clock.now_ns()).unwrap();
            while panels.feedback().is_some() {}
        }
        panels.finish().unwrap();
        let apart = panels.apart().unwrap();
        assert!(apart.video_frames > 50 && apart.largest_ns == 0, "{apart:?}");
    }
}
