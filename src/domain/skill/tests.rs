//! A stored model reads back unchanged and gives the same verdicts; features of the box are not used.

use std::sync::LazyLock;

use super::*;
use crate::domain::session::FeatureSpace;
use crate::motion::features::path::{DEPTH_TRAVELLED, PATH_LENGTH};
use crate::motion::features::two_hands::HANDEDNESS;
use crate::motion::features::{self, Family};
use crate::statistics::interval::ConfidenceInterval;
use crate::statistics::skill::{CANDIDATES, LabelledSession};

fn reading(feature: &str, tool: Option<&str>, value: Option<f64>, half: f64) -> Reading {
    let bar = value.map(|value| [value - half, value + half]);
    Reading {
        feature: features::find(feature).unwrap(),
        tool: tool.map(str::to_owned),
        space: FeatureSpace::Space3d,
        value,
        bar,
    }
}

#[test]
fn features_of_the_box_are_not_used() {
    let offered = verdict_features();
    assert!(offered.len() > 20, "{offered:?}");
    for feature in &offered {
        assert_ne!(feature.family, Family::View, "{feature}");
    }
    assert!(!offered.contains(&&DEPTH_TRAVELLED) && !offered.contains(&&HANDEDNESS));
    let image = Reading { space: FeatureSpace::Image, ..reading("path_length", Some("orange"), Some(1.0), 0.1) };
    assert_eq!(Readings::of([image, reading("lost_share", Some("orange"), Some(0.5), 0.1)]), Readings::default());
}

#[test]
fn a_feature_of_tools_is_their_mean_if_all_of_them_have_it() {
    let both = [
        reading("path_length", Some("orange"), Some(100.0), 4.0),
        reading("path_length", Some("cyan"), Some(50.0), 2.0),
    ];
    let mean = Readings::of(both.clone()).get(&PATH_LENGTH).unwrap();
    assert_eq!((mean.value, mean.bar), (75.0, Some(ConfidenceInterval { low: 72.0, high: 78.0 })));
    let turned = Readings::of([both[1].clone(), both[0].clone()]).get(&PATH_LENGTH).unwrap();
    assert_eq!(turned, mean, "whichever hand has which tape");
    let one = Readings::of([both[0].clone(), reading("path_length", Some("cyan"), None, 0.0)]);
    assert_eq!(one.get(&PATH_LENGTH), None);
    assert_eq!(most_common_tool_count([2, 1, 2, 1, 2]), 2);
}

/// Twenty-four people who differ in their duration alone.
fn data() -> (SkillDataset, Vec<Readings>) {
    let mut dice = crate::random::Dice::new(5, "people");
    let sessions: Vec<(usize, Readings)> = (0..48)
        .map(|n| {
            let seconds = 40.0 + 30.0 * f64::from(2 - n as u32 / 2 % 3) + 4.0 * dice.gauss();
            let path = 900.0 + 50.0 * dice.gauss();
            let values = [
                reading("duration", None, Some(seconds), 0.2),
                reading("path_length", Some("orange"), Some(path), 1.0),
            ];
            (n / 2, Readings::of(values))
        })
        .collect();
    let features = verdict_features();
    let sample = |(person, readings): &(usize, Readings)| LabelledSession {
        person: *person,
        level: skill::SkillLevel::ALL[person % 3],
        values: readings.values(&features),
    };
    let data = SkillDataset::of(&features, &sessions.iter().map(sample).collect::<Vec<_>>()).unwrap();
    (data, sessions.into_iter().map(|(_, readings)| readings).collect())
}

/// A model trained on these people, once for all tests.
fn file() -> ModelFile {
    static MADE: LazyLock<ModelFile> =
        LazyLock::new(|| ModelFile::train(&data().0, (None, "8".to_owned(), 1), |_, _| ()).unwrap());
    MADE.clone()
}

#[test]
fn a_stored_model_reads_back_and_gives_the_same_verdicts() {
    let (_, sessions) = data();
    let file = file();
    let text = serde_json::to_string(&file).unwrap();
    let read = ModelFile::parse(&text).unwrap();
    assert_eq!(read, file);
    assert!(file.report.knows && file.report.accuracy.low > 0.5, "{:?}", file.report);
    let verdicts: Vec<SkillVerdict> = sessions.iter().map(|session| read.model.judge(session, 1)).collect();
    let first = verdicts.iter().find(|verdict| verdict.level == Some(Level::Expert)).unwrap();
    assert_eq!(first.carried[0].feature, "duration", "{first:?}");
    assert_eq!(read.model.judge(&sessions[0], 2).reason.unwrap().name, NoLevelReasonName::OtherTools);
}

#[test]
fn every_kind_of_model_can_be_stored_and_a_broken_file_is_refused() {
    let file = file();
    let n = file.model.features.len();
    let rows: Vec<Vec<f64>> =
        (0..24).map(|row| (0..n).map(|f| f64::from(row as u32 % 5) + f as f64).collect()).collect();
    let levels = (0..24).map(|row| skill::SkillLevel::ALL[row % 3]).collect();
    let table = crate::statistics::skill::TrainingTable { rows, levels, weights: vec![1.0; 24] };
    for learner in CANDIDATES {
        let scorer: ScorerDefinition = learner.fit(&table).unwrap().into();
        let kept = ModelFile { model: ModelDefinition { scorer, ..file.model.clone() }, ..file.clone() };
        assert_eq!(ModelFile::parse(&serde_json::to_string(&kept).unwrap()).unwrap(), kept, "{}", learner.name());
    }
    type Broken = (&'static str, fn(&mut ModelFile));
    let broken: [Broken; 5] = [
        ("form", |file| file.form = 2),
        ("a weight too many", |file| {
            file.model.scorer = ScorerDefinition::Neighbours {
                k: 1,
                rows: vec![vec![0.0; 99]],
                levels: vec![Level::Expert],
                counts: [1.0; 3],
            }
        }),
        ("no spread", |file| file.model.features[0].deviation = 0.0),
        ("no temperature", |file| file.model.temperature = 0.0),
        ("no features", |file| file.model.features.clear()),
    ];
    for (what, spoil) in broken {
        let mut spoiled = file.clone();
        spoil(&mut spoiled);
        assert!(ModelFile::parse(&serde_json::to_string(&spoiled).unwrap()).is_err(), "{what}");
    }
    assert!(ModelFile::parse("{}").is_err() && ModelFile::parse("[").is_err());
}
