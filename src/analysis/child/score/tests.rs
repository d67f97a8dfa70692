//! An honest score is kept unchanged; what no honest child sends is refused.

use nalgebra::{Point3, Vector3};

use super::*;
use crate::analysis::child::ChildWork;
use crate::analysis::output_validator::validate_records;
use crate::domain::session::FeatureError;
use crate::vision::covariance::PositionCovariance;
use crate::vision::trajectory::{SampleState, Trajectory};

/// Two tools on 80 frames.
fn paths() -> SessionPaths {
    let row = |place: usize| {
        let (frame, tool) = (place as u64 / 2, place % 2);
        let time_s = frame as f64 / 25.0;
        Sample {
            frame,
            time_s,
            tool,
            tip_mm: Point3::new(30.0 * (2.0 * time_s).sin(), 10.0 * tool as f64, 150.0),
            velocity_mm_s: Some(Vector3::new(60.0 * (2.0 * time_s).cos(), 0.0, 0.0)),
            axis: None,
            tip_px: None,
            covariance_mm2: Some(PositionCovariance::from_sigmas(0.1, 0.5)),
            state: SampleState::Observed,
        }
    };
    let tools = vec!["left".into(), "right".into()];
    let samples = (0..160).map(row).collect();
    paths_of_table(Trajectory { tools, samples, frame_times_s: Vec::new(), cuts: Vec::new() })
}

fn score() -> ScoreRows {
    score_imported(paths(), 80, &EditsInForce::default()).unwrap()
}

/// The records of an honest child, in their order.
fn records(ScoreRows { features, evidence, quality }: ScoreRows) -> [ScoringRecord; 3] {
    let evidence = serde_json::to_string(&evidence).unwrap();
    [ScoringRecord::Quality(quality.to_string()), ScoringRecord::Features(features), ScoringRecord::Evidence(evidence)]
}

fn validate(source: ScoreSource, records: impl IntoIterator<Item = ScoringRecord>) -> Result<ScoreOutput, String> {
    let tools = match source {
        ScoreSource::Table => Vec::new(),
        ScoreSource::ImportedPath { .. } | ScoreSource::TrackedPath { .. } => paths().tools,
    };
    let work = ChildWork::Score(ScoreWork { source, tools, edits: EditsInForce::default() });
    let records = records.into_iter().map(WorkRecord::Score).collect();
    validate_records(&work, records).map(|output| output.score)
}

fn of_path(records: impl IntoIterator<Item = ScoringRecord>) -> Result<ScoreOutput, String> {
    validate(ScoreSource::ImportedPath { frames: 80 }, records)
}

#[test]
fn an_honest_score_arrives_to_the_last_bit() {
    let (score, output) = (score(), of_path(records(score())).unwrap());
    assert!(score.features.iter().filter(|row| row.value.is_ok()).count() > 10);
    assert!(score.evidence.iter().any(|row| row.none.is_some()));
    assert_eq!(format!("{:?}", output.features.unwrap()), format!("{:?}", score.features));
    assert_eq!(format!("{:?}", output.evidence.unwrap()), format!("{:?}", score.evidence));
    assert_eq!(output.quality.unwrap().to_string(), score.quality.to_string());
    assert!(output.imported.is_none());
}

#[test]
fn an_honest_table_arrives_as_its_file_of_paths() {
    let paths = paths();
    let opening = ScoringRecord::Table { tools: paths.tools.clone(), rows: 160 };
    let rows = paths.smoothed.chunks(50).map(|rows| ScoringRecord::Rows(rows.to_vec()));
    let output = validate(ScoreSource::Table, [opening].into_iter().chain(rows).chain(records(score()))).unwrap();
    let imported = output.imported.unwrap();
    assert_eq!((imported.frames(), imported.duration_s()), (80, 79.0 / 25.0));
    assert_eq!(imported.into_file().0, paths.to_bytes().unwrap());
}

#[test]
fn records_out_of_order_are_refused() {
    let table = || ScoringRecord::Table { tools: paths().tools, rows: 160 };
    let rows = |part: &[Sample]| ScoringRecord::Rows(part.to_vec());
    let [quality, features, evidence] = records(score());
    let all = paths().smoothed;
    assert!(of_path([features]).is_err(), "the verdict on them is unknown");
    assert!(of_path([table()]).is_err(), "the path is stored already");
    assert!(validate(ScoreSource::Table, [rows(&all)]).is_err(), "rows of no table");
    assert!(validate(ScoreSource::Table, [table(), rows(&all[..100]), quality]).is_err(), "rows are missing");
    assert!(validate(ScoreSource::Table, [table(), table()]).is_err());
    assert!(validate(ScoreSource::Table, [evidence]).is_err());
    for twice in 0..3 {
        let again = records(score()).into_iter().nth(twice);
        assert!(of_path(records(score()).into_iter().chain(again)).is_err(), "record {twice} came twice");
    }
}

#[test]
fn forged_features_are_refused() {
    fn first_value(rows: &mut [FeatureRow]) -> &mut FeatureRow {
        rows.iter_mut().find(|row| row.error.as_ref().is_some_and(Result::is_ok)).unwrap()
    }
    let bar = |change: fn(&mut FeatureError)| {
        move |rows: &mut Vec<FeatureRow>| {
            if let Some(Ok(error)) = &mut first_value(rows).error {
                change(error);
            }
        }
    };
    type FeatureForgery = Box<dyn Fn(&mut Vec<FeatureRow>)>;
    let forgeries: Vec<FeatureForgery> = vec![
        Box::new(|rows| rows[0].name = "wizardry".into()),
        Box::new(|rows| rows[0].title = "<script>".into()),
        Box::new(|rows| rows[0].unit = "parsec".into()),
        Box::new(|rows| rows[0].tool = Some("third hand".into())),
        Box::new(|rows| rows.push(rows[0].clone())),
        Box::new(|rows| *rows = vec![rows[0].clone(); 5000]),
        Box::new(|rows| first_value(rows).value = Ok(f64::NAN)),
        Box::new(|rows| first_value(rows).value = Err("a value with an error bar".into())),
        Box::new(|rows| first_value(rows).error = None),
        Box::new(|rows| first_value(rows).error = Some(Err("\x1b[31m".into()))),
        Box::new(|rows| first_value(rows).error = Some(Err("x".repeat(5000)))),
        Box::new(bar(|error| error.sigma = -1.0)),
        Box::new(bar(|error| error.low = error.high + 1.0)),
        Box::new(bar(|error| error.high = f64::INFINITY)),
    ];
    for (index, forge) in forgeries.iter().enumerate() {
        let mut forged = score();
        forge(&mut forged.features);
        assert!(of_path(records(forged)).is_err(), "forgery {index}");
    }
}

#[test]
fn forged_verdicts_and_stretches_are_refused() {
    type ScoreForgery = fn(&mut ScoreRows);
    let forgeries: [ScoreForgery; 12] = [
        |score| score.quality = serde_json::json!("valid"),
        |score| score.quality["verdict"] = "excellent".into(),
        |score| score.quality["verdict"] = "refused".into(), // its features have values
        |score| score.quality["reasons"] = serde_json::Value::Null,
        |score| score.quality["tools"][0]["tool"] = "third hand".into(),
        |score| score.quality["tools"] = serde_json::json!({}),
        |score| score.quality["note"] = "x".repeat(300_000).into(),
        |score| score.quality["note"] = "a\u{0}b".into(),
        |score| {
            let fulcrum = serde_json::json!({"at_mm": [1e300, 0.0, 0.0], "covariance_mm2": [1, 0, 0, 1, 0, 1]});
            score.quality["tools"][0]["fulcrum"] = fulcrum;
        },
        |score| score.evidence[0].of.feature = "wizardry".into(),
        |score| score.evidence[0].what = Some("x".repeat(100)),
        |score| {
            let stretch =
                crate::domain::evidence::StretchRow { from_s: 2.0, to_s: 1.0, amount: 1.0, share: None, cause: None };
            score.evidence[0].stretches = vec![stretch];
        },
    ];
    for (index, forge) in forgeries.into_iter().enumerate() {
        let mut forged = score();
        forge(&mut forged);
        assert!(of_path(records(forged)).is_err(), "forgery {index}");
    }
}
