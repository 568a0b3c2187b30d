//! Tests the structure of the page by the data behind its drawings.

use super::page;
use eyebox::low_level::calibrate::{
    Calibration, Directions, Figures, Gain, Mend, PhaseSign, Report, ResidualMap, Verdict,
};
use eyebox::low_level::optics::{Color, Display, ModelTerms, Spread};

const TEXT: &str = "resolution = [64, 64]\npitch_um = 8.0\nfocal_length_mm = 400.0\nwavelengths_nm = { green = 520 }\n";

fn calibration(terms: ModelTerms, gain: Option<Gain>) -> Calibration {
    let mut display = Display::from_toml(TEXT, "test").expect("a display");
    display.model.insert(Color::Green.into(), terms);
    let figures = Figures::new(&display, Color::Green, &[]).expect("figures");
    let report = Report {
        directions: Directions { phase: PhaseSign::AsRequested, mirrored: true, turned_deg: 92.0 },
        quick: false,
        captures: 39,
        seconds: 1.0,
        parameters: Vec::new(),
        figures: Some(figures),
        confused: Vec::new(),
        unobservable: Vec::new(),
        gain,
        camera_rms_px: 0.1,
        camera_map: [0.0; 10],
        before: None,
        unexplained: None,
        noise: None,
        verdict: Verdict::Calibrated,
        calibrated: true,
        pictures: Vec::new(),
        map: ResidualMap { tile_px: 8, rows: 2, columns: 2, squares: vec![Some(1.0); 4] },
        warnings: Vec::new(),
    };
    Calibration { display, report, shown: Vec::new() }
}

#[test]
fn an_ideal_display_has_no_drawings_of_faults() {
    let html = page(&calibration(ModelTerms::default(), None), Color::Green);
    assert!(!html.contains("id=\"display\"") && !html.contains("id=\"mend\""), "{html}");
    assert_eq!(html.matches("<svg").count(), 0);
    assert_eq!(html.matches("data:image/png").count(), 1);
    assert!(html.contains("mirrored left to right and turned by 92.0 degrees clockwise"));
}

#[test]
fn every_fault_is_drawn_once_and_what_to_mend_comes_first() {
    let terms = ModelTerms {
        level: Some(eyebox::low_level::optics::Level::Even(1.05)),
        crosstalk: Some([Spread { q: 1.2, sigma: 2.0 }; 4]),
        source: Some([0.1, 0.0, -0.2, 0.0, -0.1]),
        undiffracted: Some(vec![[0.2, 0.1, 3.0, 900.0, 0.0]]),
        iris: Some([0.3, 0.1, 1.01]),
        wavefront: [(4, 0.1), (8, -0.2)].into(),
        ..ModelTerms::default()
    };
    let mend = |fault, costs_db| Mend { fault, costs_db, remedy: "turn it" };
    let gain = Gain {
        size: [64, 64],
        steps: 24,
        before_db: [20.0, 15.0],
        after_db: [25.0, 21.0],
        terms_db: [("level", 0.5), ("crosstalk", -0.1), ("wavefront", 2.0)].into(),
        mend: vec![mend("coma", 1.25), mend("level", 0.3)],
    };
    let html = page(&calibration(terms, Some(gain)), Color::Green);
    // The drawings are decibels, aberrations, beam, table, pupil plane and crosstalk. The maps are wavefront, beam and
    // residual.
    assert_eq!(html.matches("<svg").count(), 6, "{html}");
    assert_eq!(html.matches("data:image/png").count(), 3);
    assert!(!html.contains("NaN") && !html.contains("inf,"), "{html}");
    let place = |what: &str| html.find(what).unwrap_or_else(|| panic!("{what} is missing"));
    assert!(place("1.25 dB") < place("0.30 dB") && place("0.30 dB") < place("id=\"worth\""));
    // The terms are in their order, and the negative one is last.
    assert!(
        place("wavefront: 2.00 dB") < place("level: 0.50 dB") && place("level: 0.50 dB") < place("crosstalk: -0.10 dB")
    );
    assert!(html.contains("8 coma x: -0.2000") && html.contains("zero order: 5.00 %"));
}
