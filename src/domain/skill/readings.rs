//! The features that a verdict may use, and a session's values of them.
//!
//! A verdict is about a person. Features that depend on the box are therefore excluded: features in the picture, along
//! the camera's axes, and of the field of view. A feature of tools counts as the mean over the session's tools: one
//! marker may be in one person's dominant hand and in another person's other hand, so that a single tool's value would
//! reflect hands and tapes.

use std::collections::{BTreeMap, HashMap};

use crate::domain::feature::{FeatureKey, depends_on_camera};
use crate::domain::session::FeatureSpace;
use crate::motion::features::{FEATURES, Feature, two_hands};
use crate::statistics::interval::{ConfidenceInterval, MeasuredValue};

/// One value of a session's result.
#[derive(Clone, Debug, PartialEq)]
pub struct Reading {
    /// The feature.
    pub feature: &'static Feature,
    /// The tool's marker; `None` for the whole session.
    pub tool: Option<String>,
    /// The space that it was measured in.
    pub space: FeatureSpace,
    /// The value; `None` where too little was seen.
    pub value: Option<f64>,
    /// 95 % interval of the true value; `None` where unknown.
    pub bar: Option<[f64; 2]>,
}

/// A session's values of the features that a verdict may use.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Readings(HashMap<&'static Feature, Option<MeasuredValue>>);

/// The features that a verdict may use.
pub fn verdict_features() -> Vec<&'static Feature> {
    FEATURES.iter().copied().filter(|feature| is_for_verdicts(feature)).collect()
}

fn is_for_verdicts(feature: &'static Feature) -> bool {
    let space = FeatureSpace::Space3d;
    feature.spaces.iter().any(|measured| FeatureSpace::from(*measured) == space)
        && !depends_on_camera(&FeatureKey::of_session(feature, space))
        && !two_hands::SHARES_OF_A_PAIR.contains(&feature)
}

impl Readings {
    /// The readings of a result: the session's own value, else the mean over its tools if every tool has a value.
    pub fn of(values: impl IntoIterator<Item = Reading>) -> Self {
        let mut own: HashMap<&'static Feature, Option<MeasuredValue>> = HashMap::new();
        let mut of_tools: HashMap<&'static Feature, Vec<Option<MeasuredValue>>> = HashMap::new();
        for reading in values {
            if reading.space != FeatureSpace::Space3d || !is_for_verdicts(reading.feature) {
                continue;
            }
            let bar = reading.bar.map(|[low, high]| ConfidenceInterval { low, high });
            let measured = reading.value.map(|value| MeasuredValue { value, bar });
            match reading.tool {
                None => drop(own.insert(reading.feature, measured)),
                Some(_) => of_tools.entry(reading.feature).or_default().push(measured),
            }
        }
        for (feature, tools) in of_tools {
            own.entry(feature).or_insert_with(|| mean_over_tools(&tools));
        }
        Self(own)
    }

    /// The value of a feature, if it was measured.
    pub fn get(&self, feature: &'static Feature) -> Option<MeasuredValue> {
        self.0.get(feature).copied().flatten()
    }

    /// The values of these features.
    pub fn values(&self, features: &[&'static Feature]) -> Vec<Option<MeasuredValue>> {
        features.iter().map(|feature| self.get(feature)).collect()
    }
}

/// The mean over all tools. Their errors may be correlated, so the bar is the mean of the bars.
fn mean_over_tools(tools: &[Option<MeasuredValue>]) -> Option<MeasuredValue> {
    let all: Option<Vec<MeasuredValue>> = tools.iter().copied().collect();
    let all = all.filter(|all| !all.is_empty())?;
    let mean = |of: &dyn Fn(&MeasuredValue) -> Option<f64>| -> Option<f64> {
        let values: Option<Vec<f64>> = all.iter().map(of).collect();
        values.map(|values| values.iter().sum::<f64>() / all.len() as f64)
    };
    let low = mean(&|of| of.bar.map(|bar| bar.low));
    let high = mean(&|of| of.bar.map(|bar| bar.high));
    let bar = low.zip(high).map(|(low, high)| ConfidenceInterval { low, high });
    mean(&|of| Some(of.value)).map(|value| MeasuredValue { value, bar })
}

/// The most common number of tools; of equally common numbers, the larger.
pub fn most_common_tool_count(tools: impl IntoIterator<Item = usize>) -> usize {
    let mut times: BTreeMap<usize, usize> = BTreeMap::new();
    tools.into_iter().for_each(|tools| *times.entry(tools).or_default() += 1);
    times.into_iter().max_by_key(|(tools, times)| (*times, *tools)).map_or(0, |(tools, _)| tools)
}
