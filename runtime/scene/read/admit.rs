//! Admits light fields from arrays of a program, which have no file with settings.

use crate::formats::tone::{Tally, Tone};
use crate::light_field::light::FullScale;
use crate::{LightField, Order, Parallax, SceneError, read::order_found, read::standing};
use eyebox_optics::check_usual_view_pitch;
use rayon::prelude::*;
use std::path::Path;

impl LightField {
    /// Checks views that a program made itself, and applies the stated order. Rounding errors below 0 become black, and
    /// a few highlights above 1 become white, with a warning. The order as-named states a grid, whatever the pictures
    /// show.
    ///
    /// # Errors
    /// Returns the errors of [`check`](Self::check). [`SceneError::FullScale`] means that 1 is clearly not the full
    /// scale. [`SceneError::Optics`] means a view pitch in another unit. The pictures cause [`SceneError::Cameras`] if
    /// cameras are not in a grid, and [`SceneError::Order`] if they show another order and none is stated.
    pub fn admit(mut self, order: Option<Order>) -> Result<Self, SceneError> {
        self.check_shape()?;
        self.view_pitch.map_or(Ok(()), check_usual_view_pitch)?;
        let mut tally = Tally::default();
        for views in &mut self.planes {
            let one = |view: &mut Vec<f32>| {
                let mut tally = Tally::default();
                // The first value that is not a valid light value stays, and the check below refuses it.
                let _ = tally.shares(view);
                tally
            };
            tally = views.par_iter_mut().map(one).reduce(Tally::default, Tally::and).and(tally);
        }
        self.check()?;
        let name = if self.name.is_empty() { "the views".to_owned() } else { self.name.clone() };
        tally.judge(Path::new(&name), Tone::default(), FullScale::Array)?;
        let field = order.unwrap_or_default().apply(self);
        if let Some(found) = standing::refused(&field, order) {
            return Err(SceneError::Cameras { scene: name, found });
        }
        let parallax = Parallax::of(&field);
        order_found::check(&name, &order_found::found(&name, parallax.as_ref(), order.is_some()), false)?;
        Ok(field)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use eyebox_optics::Color;

    #[test]
    fn views_of_a_program_s_own_are_looked_at() {
        let field = LightField {
            name: String::new(),
            grid: [2, 1],
            height: 2,
            width: 3,
            colors: vec![Color::Red],
            planes: vec![vec![vec![0.5; 6]; 2]],
            view_pitch: None,
            disparity: None,
            depth: None,
            made: None,
        };
        field.clone().admit(None).unwrap();
        let says = |change: &dyn Fn(&mut LightField)| {
            let mut field = field.clone();
            change(&mut field);
            match field.admit(None).unwrap_err() {
                SceneError::Request { value, .. } => value,
                other => panic!("{other}"),
            }
        };
        let nan = says(&|f| f.planes[0][1][4] = f32::NAN);
        assert!(nan.starts_with("NaN") && ["red", "1"].iter().all(|part| nan.contains(part)), "{nan}");
        assert!(says(&|f| f.planes[0][1][4] = -0.1).starts_with("-0.1"));
        assert!(says(&|f| f.planes[0][1].truncate(5)).starts_with("1 "));
        assert_eq!([says(&|f| f.grid = [0, 1]), says(&|f| f.width = 0)], ["0 x 1", "2 x 0"]);
        assert_eq!(says(&|f| f.view_pitch = Some(0.0)), "0");
        assert!(says(&|f| f.colors.push(Color::Blue)).starts_with("1 "));
        let wrong = |change: &dyn Fn(&mut LightField)| {
            let mut field = field.clone();
            change(&mut field);
            field.admit(None)
        };
        assert!(matches!(wrong(&|f| f.view_pitch = Some(2.2)), Err(SceneError::Optics(_))));
        for full in [2.0, 100.0, 255.0, 1023.0, 65535.0] {
            let bright = wrong(&|f| f.planes.iter_mut().flatten().flatten().for_each(|v| *v *= full * 2.0));
            assert!(matches!(bright, Err(SceneError::FullScale { how: FullScale::Array, .. })), "{full}: {bright:?}");
        }
        let mut large = field.clone();
        (large.width, large.planes) = (300, vec![vec![vec![0.5; 600]; 2]]);
        (large.planes[0][1][4], large.planes[0][0][7]) = (30.0, -1e-6);
        let large = large.admit(None).unwrap();
        assert_eq!((large.planes[0][1][4], large.planes[0][0][7], large.planes[0][0][8]), (1.0, 0.0, 0.5));
    }

    /// Views that have nothing in common are refused from files and from arrays alike, unless the program states a
    /// grid.
    #[test]
    fn views_that_are_no_neighbors_are_refused_unless_a_grid_is_stated() {
        let mut random = fastrand::Rng::with_seed(3);
        let mut view = || (0..64 * 64).map(|_| random.f32()).collect::<Vec<_>>();
        let field = LightField {
            name: String::new(),
            grid: [2, 3],
            height: 64,
            width: 64,
            colors: vec![Color::Red],
            planes: vec![(0..6).map(|_| view()).collect()],
            view_pitch: None,
            disparity: None,
            depth: None,
            made: None,
        };
        for order in [None, Some(Order { flip_rows: true, ..Order::default() })] {
            let refused = field.clone().admit(order);
            assert!(matches!(refused, Err(SceneError::Cameras { .. })), "{order:?}");
        }
        assert_eq!(field.clone().admit(Some(Order::default())), Ok(field));
    }

    /// Arrays of views in another order are refused like files, and read in the order that the refusal names.
    #[test]
    fn views_in_another_order_are_refused_until_it_is_stated() {
        let display =
            eyebox_optics::Display { height: 96, width: 96, ..eyebox_optics::Display::preset("paper").unwrap() };
        let request = crate::Request { views: 5, ..crate::Request::new(&display, &[Color::Green]) };
        let field = crate::load("builtin:still-life?span=1.1", &request).unwrap();
        let right = LightField { made: None, depth: None, ..field };
        let right = right.admit(None).unwrap();
        for order in ["flip-rows", "flip-columns", "flip-rows,flip-columns", "transpose"] {
            let order: Order = order.parse().unwrap();
            let other = order.apply(right.clone());
            let Err(SceneError::Order { flags, keys: None, .. }) = other.clone().admit(None) else {
                panic!("{order} is taken");
            };
            assert!(flags.split(" or ").any(|flag| flag == format!("`order` {order}")), "{order}: {flags}");
            assert_eq!(other.admit(Some(order)).as_ref(), Ok(&right), "{order}");
        }
    }
}
