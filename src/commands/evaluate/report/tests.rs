//! The page has figures with units and every picture, and escapes hostile names.

use nalgebra::{Point3, Vector3};

use super::*;
use crate::checks::evaluation::{self, TruthFrame, TruthTool};
use crate::vision::covariance::PositionCovariance;
use crate::vision::trajectory::{Sample, SampleState, Trajectory};

const HOSTILE: &str = "</style><script>alert(\"1\")</script>'onload='";

/// One tool on a curve for four seconds, hidden for a while, and its track, which is 1 mm too deep.
fn scene(name: &str) -> (Trajectory, Truth) {
    let tip = |i: u32| Point3::new(f64::from(i), 20.0 * (0.1 * f64::from(i)).sin(), 180.0);
    let visible = |i: u32| if (40..60).contains(&i) { 0.0 } else { 1.0 };
    let tool = |i| TruthTool { tool: name.to_owned(), tip_mm: tip(i), axis: None, tip_px: None, visible: visible(i) };
    let frame = |i| TruthFrame { frame: u64::from(i), time_s: 0.04 * f64::from(i), tools: vec![tool(i)] };
    let row = |i| Sample {
        frame: u64::from(i),
        time_s: 0.04 * f64::from(i),
        tool: 0,
        tip_mm: tip(i) + Vector3::z(),
        velocity_mm_s: None,
        axis: None,
        tip_px: None,
        covariance_mm2: Some(PositionCovariance::from_sigmas(0.2, 1.0)),
        state: if i % 7 == 0 { SampleState::Predicted } else { SampleState::Observed },
    };
    let rows = (0..100).filter(|i| !(10..14).contains(i) && (*i < 45 || *i >= 60)).map(row);
    let track = Trajectory {
        tools: vec![name.to_owned()],
        samples: rows.collect(),
        frame_times_s: Vec::new(),
        cuts: Vec::new(),
    };
    (track, Truth { frames: (0..100).map(frame).collect() })
}

fn page(name: &str) -> String {
    let (track, truth) = scene(name);
    let result = evaluation::accuracy(&track, &truth).unwrap();
    accuracy(name, &result, &evaluation::pair_with_truth(&track, &truth).unwrap(), &truth).unwrap()
}

#[test]
fn the_page_of_a_track_shows_its_figures_and_every_picture() {
    let page = page("orange");
    for part in [
        "1.00 mm",
        "95.0 %",
        "when orange was seen",
        "errors of orange",
        "normalised errors of orange",
        "path of orange",
    ] {
        assert!(page.contains(part), "{part}");
    }
    for counted in ["missing 4", "false 5", "observed "] {
        assert!(page.contains(counted), "{counted}");
    }
    assert!(page.contains("--tool: var(--tool-orange)"));
}

#[test]
fn a_tools_name_is_shown_escaped() {
    let page = page(HOSTILE);
    assert!(!page.contains("<script"), "{page:.3000}");
    assert!(page.contains("aria-label=\"when &lt;/style&gt;"), "in an attribute, too: {page:.3000}");
    assert_eq!(page.matches("</style>").count(), 1);
    assert!(page.contains("&lt;/style&gt;&lt;script&gt;alert(&quot;1&quot;)"));
}

#[test]
fn a_page_asks_for_nothing_from_elsewhere_and_holds_no_script() {
    let page = page("<img src=//evil.example/x onerror=alert(1)>").replace("xmlns=\"http://www.w3.org/2000/svg\"", "");
    assert!(page.starts_with("<!DOCTYPE html><html lang=\"en\"><head><meta charset=\"utf-8\">"), "{page:.200}");
    for asks in ["<script", "<img", "<link", "src=\"", "url(", "@import", "http://", "https://"] {
        assert!(!page.contains(asks), "{asks}");
    }
}

#[test]
fn a_track_in_which_nothing_was_found_has_a_page() {
    let (mut track, truth) = scene("orange");
    track.samples.clear();
    let result = evaluation::accuracy(&track, &truth).unwrap();
    let page = accuracy("nothing", &result, &[], &truth).unwrap();
    assert!(page.contains("missing 80") && page.contains("The track states no errors."));
}

#[test]
fn the_page_of_slides_shows_each_of_them() {
    let slide = |n: u32| (0..50).map(|i| Point3::new(f64::from(i), 0.1 * f64::from(n), 180.0)).collect::<Vec<_>>();
    let paths: Vec<_> = (0..5).map(slide).collect();
    let page = repeatability("five", &evaluation::repeatability(&paths).unwrap(), &paths).unwrap();
    assert!(page.contains("0.20 mm") && page.contains("slide 5") && page.contains("in depth, mm"), "{page:.3000}");
}
