//! When advice is given, and when it is not.

use super::*;
use crate::domain::evidence::{AbsenceCause, NoEvidence};
use crate::domain::standard::{Basis, ChartDesign};
use crate::motion::features::{self, Direction, FEATURES};

fn key(feature: &str, tool: Option<&str>) -> FeatureKey {
    let feature = features::find(feature).unwrap();
    let space = feature.spaces[0].into();
    FeatureKey::of_tool(feature, tool.map(str::to_owned), space)
}

fn target(feature: &str, tool: Option<&str>, better: Better, limit: f64) -> Target {
    let (title, unit) = (feature.to_owned(), "1".to_owned());
    Target {
        of: key(feature, tool),
        title,
        unit,
        better,
        limit,
        low: None,
        high: None,
        basis: Basis::Fixed,
        made_from: None,
    }
}

fn row(feature: &str, tool: Option<&str>, value: f64, half: f64) -> FeatureRow {
    let FeatureKey { tool, space, .. } = key(feature, tool);
    let error = FeatureError { as_measured: value, sigma: half / 2.0, low: value - half, high: value + half };
    let (name, title, unit) = (feature.to_owned(), feature.to_owned(), "1".to_owned());
    FeatureRow { name, title, unit, tool, space, value: Ok(value), error: Some(Ok(error)) }
}

fn seen(feature: &str, tool: Option<&str>, cause: Option<AbsenceCause>) -> EvidenceRow {
    let stretch = StretchRow { from_s: 61.25, to_s: 64.0, amount: 2.75, share: None, cause };
    let (what, unit) = (Some("rest".to_owned()), Some("s".to_owned()));
    EvidenceRow {
        of: StoredFeatureKey::from(&row(feature, tool, 0.0, 0.0)),
        what,
        unit,
        stretches: vec![stretch],
        none: None,
    }
}

fn advice_for(targets: Vec<Target>, features: &[FeatureRow], evidence: &[EvidenceRow]) -> Vec<Advice> {
    let definition = StandardDefinition { targets, rule: None, charts: ChartDesign::default() };
    advise(&definition, MeasuredSession { features, evidence, pipeline: "9", handedness: None })
}

#[test]
fn advice_names_feature_value_limit_and_seconds() {
    let got = advice_for(
        vec![target("idle_share", Some("left"), Better::Lower, 0.3)],
        &[row("idle_share", Some("left"), 0.42, 0.05)],
        &[seen("idle_share", Some("left"), None)],
    );
    assert_eq!(got.len(), 1);
    assert_eq!((got[0].rule, got[0].limit, got[0].stretches[0].from_s), ("rest_less", 0.3, 61.25));
    let words = &got[0].sentence;
    for part in ["idle_share of left is 0.420 (0.370 to 0.470)", "at most 0.300", "1:01.3 to 1:04.0"] {
        assert!(words.contains(part), "{words}");
    }
}

#[test]
fn no_advice_where_the_error_covers_the_limit_or_is_unknown_or_nothing_was_measured() {
    let ask = |row: FeatureRow| {
        advice_for(
            vec![target("idle_share", Some("left"), Better::Lower, 0.3)],
            &[row],
            &[seen("idle_share", Some("left"), None)],
        )
    };
    assert_eq!(ask(row("idle_share", Some("left"), 0.42, 0.05)).len(), 1);
    assert!(ask(row("idle_share", Some("left"), 0.42, 0.12)).is_empty(), "the limit lies on the bar's end");
    assert!(ask(row("idle_share", Some("left"), 0.42, 0.2)).is_empty());
    assert!(ask(row("idle_share", Some("left"), 0.2, 0.01)).is_empty(), "it keeps the limit");
    let unknown = FeatureRow { error: Some(Err("not stated".into())), ..row("idle_share", Some("left"), 0.42, 0.0) };
    assert!(ask(unknown).is_empty());
    let refused = FeatureRow { value: Err("refused".into()), ..row("idle_share", Some("left"), 0.42, 0.0) };
    assert!(ask(refused).is_empty());
}

#[test]
fn no_advice_without_stretches_that_the_hand_caused() {
    let targets = || vec![target("left_view_share", Some("left"), Better::Lower, 0.1)];
    let features = [row("left_view_share", Some("left"), 0.4, 0.01)];
    let ask = |cause| advice_for(targets(), &features, &[seen("left_view_share", Some("left"), cause)]);
    assert_eq!(ask(Some(AbsenceCause::LeftView)).len(), 1);
    assert!(
        ask(Some(AbsenceCause::Lost)).is_empty() && ask(Some(AbsenceCause::Hidden)).is_empty() && ask(None).is_empty()
    );
    let reason = NoEvidence { reason: "nothing_stands_out".into(), detail: String::new() };
    let none = EvidenceRow { stretches: vec![], none: Some(reason), ..seen("left_view_share", Some("left"), None) };
    assert!(advice_for(targets(), &features, &[none]).is_empty());
    assert!(advice_for(targets(), &features, &[]).is_empty());
}

#[test]
fn at_most_three_the_farthest_first_and_a_rule_once_for_each_tool() {
    let names = ["idle_share", "long_pause_share", "path_length", "jitter", "movements", "spread"];
    let values = [0.9, 0.8, 150.0, 140.0, 130.0, 120.0];
    let limits = [0.1, 0.1, 100.0, 100.0, 100.0, 100.0];
    let left = Some("left");
    let targets: Vec<Target> =
        names.iter().zip(limits).map(|(name, limit)| target(name, left, Better::Lower, limit)).collect();
    let features: Vec<FeatureRow> =
        names.iter().zip(values).map(|(name, value)| row(name, left, value, 0.01)).collect();
    let evidence: Vec<EvidenceRow> = names.iter().map(|name| seen(name, left, None)).collect();
    let got: Vec<String> =
        advice_for(targets, &features, &evidence).into_iter().map(|advice| advice.of.feature.name.to_owned()).collect();
    assert_eq!(got, ["idle_share", "path_length", "jitter"], "of the two that say the same only the farther one");
}

#[test]
fn each_habit_has_one_rule_and_a_worse_side_and_tracker_losses_have_none() {
    for feature in FEATURES.iter().filter(|feature| feature.habit.is_some()) {
        let covers = |better| RULES.iter().filter(|rule| rule.covers(feature, better)).count();
        let [lower, higher] = [Better::Lower, Better::Higher].map(covers);
        let expected = if feature.direction == Direction::Higher { (0, 1) } else { (1, 0) };
        assert_eq!((lower, higher), expected, "{feature}");
        // A share of one hand alone has no better side until a standard sets one.
        assert!(feature.direction != Direction::Neither || feature.name == "one_hand_share", "{feature}");
    }
    for name in ["lost_share", "hidden_share", "not_seen_share"] {
        assert_eq!(features::find(name).unwrap().habit, None, "the tracker may have caused it");
    }
    for rule in RULES {
        assert!(FEATURES.iter().any(|feature| feature.habit == Some(rule.habit)), "{}", rule.habit.name());
    }
}
