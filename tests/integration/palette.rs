//! Tapes in the simulated box: the advice before a recording, and the result of the tracker.

use trocar::checks::evaluation::{Accuracy, Truth, TruthFrame, TruthTool, accuracy};
use trocar::motion::quality::{self, Concern, QualityCause, QualityInput, Severity};
use trocar::simulation::marks::{self, SimulatedMark};
use trocar::simulation::render::{Rendered, Renderer};
use trocar::simulation::tool::TapeDesign;
use trocar::simulation::{Scenario, Setup, Skill, World, truth};
use trocar::vision::blob::false_area::false_area;
use trocar::vision::frame::Frame;
use trocar::vision::segmentation::colour_table::ColourTable;
use trocar::vision::segmentation::knn::Knn;
use trocar::vision::segmentation::palette::advice::{self, rank_tapes};
use trocar::vision::segmentation::palette::confusion::Confusion;
use trocar::vision::segmentation::palette::{FalseArea, PaletteGrade, TapeVerdict, verdict, verdicts};
use trocar::vision::segmentation::samples::{ColourSamples, MarkedRectangle};
use trocar::vision::tracker::{CameraView, Marker, MotionSettings, ToolSpec, Tracker, TrackerSettings, Tracking};
use trocar::vision::trajectory::PathKind;

const FRAMES: usize = 24;
const FPS: f64 = 8.0;

fn setup(tapes: [TapeDesign; 2]) -> Setup {
    Setup { rig: 2, tapes, ..Setup::new(Scenario::Rectangle, Skill::INTERMEDIATE, 21) }
}

/// A scene with these tapes, rendered.
struct TapedBox {
    world: World,
    times_s: Vec<f64>,
    pictures: Vec<Rendered>,
    marks: Vec<SimulatedMark>,
}

impl TapedBox {
    fn with(tapes: [TapeDesign; 2]) -> Self {
        let world = World::new(&setup(tapes));
        let times_s: Vec<f64> = (0..FRAMES).map(|i| i as f64 / FPS).collect();
        let renderer = Renderer::new(&world);
        let pictures = times_s.iter().map(|time_s| renderer.render(*time_s)).collect();
        let marks = marks::mark_recording(&world, &times_s);
        Self { times_s, pictures, marks, world }
    }

    fn frame(&self, index: usize) -> Frame<'_> {
        self.pictures[index].frame(index as u64, self.times_s[index])
    }

    fn tools(&self) -> Vec<String> {
        self.world.tools.iter().map(|tool| tool.design.band.unwrap().tape.name.to_owned()).collect()
    }

    fn samples(&self) -> ColourSamples {
        let mut samples = ColourSamples::new(self.frame(0).encoding);
        self.marks.iter().for_each(|mark| samples.collect_stroke(&self.frame(mark.frame), &[rectangle(mark)]));
        samples
    }

    fn verdicts(&self) -> Vec<TapeVerdict> {
        let (samples, tools) = (self.samples(), self.tools());
        verdict::judge(&Confusion::of(&samples, &tools), &self.false_areas(&samples, &tools))
    }

    fn false_areas(&self, samples: &ColourSamples, tools: &[String]) -> Vec<FalseArea> {
        let table = ColourTable::new(Knn::new(samples, &samples.classes(tools)).unwrap(), self.frame(0).encoding);
        let mut found = Vec::new();
        for (index, tool) in tools.iter().enumerate() {
            for frame in 0..FRAMES {
                let own = self.marks.iter().filter(|mark| mark.frame == frame && mark.label == tool);
                let own: Vec<MarkedRectangle> = own.map(rectangle).collect();
                let own: Vec<&MarkedRectangle> = own.iter().collect();
                found.extend(false_area(&self.frame(frame), &table, index as u8 + 1, &own, 1));
            }
        }
        found
    }

    fn tracked(&self) -> Tracking {
        let tool = |tool: &trocar::simulation::tool::SimulatedTool| ToolSpec {
            name: tool.name.to_owned(),
            colour: tool.design.band.unwrap().tape.name.to_owned(),
            side: None,
            diameter_mm: tool.design.diameter_mm,
            marker: Marker::Band { length_mm: tool.design.band.map(|band| band.length_mm) },
        };
        let tools = self.world.tools.iter().map(tool).collect();
        let camera = self.world.rig.camera;
        let mut settings = TrackerSettings::new(camera, tools, self.samples());
        settings.view = Some(CameraView::Top);
        let mut tracker = Tracker::new(settings, camera.width, camera.height, self.frame(0).encoding).unwrap();
        for index in 0..FRAMES {
            tracker.observe(&self.frame(index));
        }
        tracker.finish()
    }

    fn accuracy(&self, tracking: &Tracking) -> Accuracy {
        let frame = |(index, time_s): (usize, &f64)| TruthFrame {
            frame: index as u64,
            time_s: *time_s,
            tools: truth::at(&self.world, *time_s).into_iter().map(TruthTool::from).collect(),
        };
        let truth = Truth { frames: self.times_s.iter().enumerate().map(frame).collect() };
        accuracy(&tracking.trajectory(PathKind::Smoothed), &truth).unwrap()
    }
}

/// Concerns of the quality gate about the colours of a session.
fn colour_concerns(tracking: &Tracking) -> Vec<Concern> {
    let smoothed = tracking.trajectory(PathKind::Smoothed);
    let figures = quality::measure(&QualityInput::of_tracking(tracking, &smoothed, MotionSettings::default()));
    let concerns = quality::judge(&figures).concerns().to_vec();
    concerns
        .into_iter()
        .filter(|c| [QualityCause::ColourBackground, QualityCause::ColourPair].contains(&c.cause))
        .collect()
}

fn rectangle(mark: &SimulatedMark) -> MarkedRectangle {
    let [x, y, w, h] = [mark.x, mark.y, mark.w, mark.h].map(|n| n as usize);
    MarkedRectangle { label: mark.label.to_owned(), x, y, w, h }
}

#[test]
fn vivid_tapes_are_good() {
    let scene = TapedBox::with(["orange", "cyan"].map(|name| TapeDesign::named(name).unwrap()));
    let verdicts = scene.verdicts();
    assert!(verdicts.iter().all(|verdict| verdict.grade == PaletteGrade::Good), "{verdicts:?}");
    assert_eq!(colour_concerns(&scene.tracked()), []);
}

#[test]
fn a_session_with_two_tapes_of_nearly_one_colour_is_used_with_care() {
    let orange = TapeDesign::named("orange").unwrap();
    let redder = TapeDesign { name: "redder", colour: [0.86, 0.155, 0.012] };
    let concerns = colour_concerns(&TapedBox::with([orange, redder]).tracked());
    let found: Vec<_> = concerns.iter().map(|c| (c.cause, c.severity, c.tool.as_deref(), c.label.as_deref())).collect();
    let pair = |tool, other| (QualityCause::ColourPair, Severity::Care, Some(tool), Some(other));
    assert_eq!(found, [pair("orange", "redder"), pair("redder", "orange")]);
}

#[test]
fn purple_on_a_mat_with_red_blue_and_purple_is_graded_bad_before_it_is_tracked() {
    let purple = TapeDesign { name: "purple", colour: [0.2, 0.065, 0.25] }; // as printed on the mat
    let scene = TapedBox::with([purple, TapeDesign::named("orange").unwrap()]);
    let tracking = scene.tracked();
    let [concern] = &colour_concerns(&tracking)[..] else { panic!("{:?}", colour_concerns(&tracking)) };
    assert_eq!(concern.cause, QualityCause::ColourBackground, "{concern:?}");
    let tracked = scene.accuracy(&tracking);
    let is_right = |index: usize| tracked.tools[index].levels[0].errors.is_some_and(|e| e.three_d.rms < 3.0);
    assert!(is_right(1), "orange: {tracked:?}");
    assert!(is_right(0) || concern.severity == Severity::Refuse, "purple is followed rightly or refused: {tracked:?}");
    assert_eq!((concern.tool.as_deref(), concern.label.as_deref()), (Some("purple"), Some("background")));
    for verdicts in [scene.verdicts(), verdicts(&scene.samples(), &scene.tools())] {
        let grades: Vec<PaletteGrade> = verdicts.iter().map(|verdict| verdict.grade).collect();
        assert_eq!(grades, [PaletteGrade::Bad, PaletteGrade::Good], "{verdicts:?}");
    }
    let warning = scene.verdicts()[0].warning().unwrap();
    assert!(warning.contains("× the band") && warning.contains("hardly differs from `background`"), "{warning}");
}

#[test]
fn the_pair_advised_for_an_empty_box_is_good_in_it_and_the_last_tape_is_bad() {
    let mut world = World::new(&setup([TapeDesign::ALL[0], TapeDesign::ALL[1]]));
    world.tools.clear();
    let advice = rank_tapes(&Renderer::new(&world).render(0.0).frame(0, 0.0));
    let grades = |tapes: [advice::Tape; 2]| {
        let verdicts = TapedBox::with(tapes.map(tape_design)).verdicts();
        verdicts.into_iter().map(|verdict| verdict.grade).collect::<Vec<_>>()
    };
    assert_eq!(advice.pairs[0].grade, PaletteGrade::Good);
    assert_eq!(grades(advice.pairs[0].tapes), [PaletteGrade::Good; 2], "{:?}", advice.pairs[0]);
    let [first, .., last] = &advice.tapes[..] else { panic!("{advice:?}") };
    assert_eq!(last.grade, PaletteGrade::Bad);
    assert_eq!(grades([first.tape, last.tape]), [PaletteGrade::Good, PaletteGrade::Bad], "{last:?}");
}

/// The advised tape as a simulated tool's tape.
fn tape_design(tape: advice::Tape) -> TapeDesign {
    TapeDesign { name: tape.name, colour: tape.srgb.map(|c| (f32::from(c) / 255.0).powf(2.2)) }
}
