//! The brightness of the picture, compared with the time after the box's calibration or last self-test.
//!
//! It is the mean luma of the whole picture: simple, and the same for every box. A mat, a hand and the camera's automatic
//! exposure change it too, so only a large and lasting change says something. The reference is the median of the
//! agent's first minute after the calibration or the self-test. It is kept in the spool's folder.

use std::collections::VecDeque;
use std::fs;
use std::path::{Path, PathBuf};
use std::time::Duration;

use serde::{Deserialize, Serialize};
use tokio::time::{MissedTickBehavior, interval};

use super::Standby;
use crate::domain::box_agent::state::LightState;
use crate::media::mean_luma;

/// How often a picture is measured.
const INTERVAL: Duration = Duration::from_secs(2);
/// Pictures whose median is the level: ten seconds, so that a passing hand does not count.
const MAX_RECENT: usize = 5;
/// Pictures whose median is the reference: a minute.
const REFERENCE_PICTURES: usize = 30;
/// Lowest level that is compared, codes: below, the picture is black and a ratio means nothing.
const MIN_LEVEL: f64 = 2.0;

/// A level to compare with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
struct LightReference {
    /// What the server calls it.
    name: String,
    /// Median of the mean luma, 0 to 255.
    level: f64,
}

/// Measures the light from the brightness of pictures.
#[derive(Debug)]
struct LightMeter {
    path: PathBuf,
    reference: Option<LightReference>,
    recent: VecDeque<f64>,
    /// Levels for the next reference, and its name.
    collected: (String, Vec<f64>),
}

impl LightMeter {
    fn open(folder: &Path) -> Self {
        let path = folder.join("light.json");
        let reference = fs::read(&path).ok().and_then(|bytes| serde_json::from_slice(&bytes).ok());
        Self { path, reference, recent: VecDeque::new(), collected: Default::default() }
    }

    /// Adds the brightness of a picture. `name`: what the server compares with, if it has said so.
    fn add(&mut self, level: f64, name: Option<&str>) -> LightState {
        if self.recent.len() == MAX_RECENT {
            self.recent.pop_front();
        }
        self.recent.push_back(level);
        if let Some(name) = name
            && self.reference.as_ref().is_none_or(|reference| reference.name != name)
        {
            self.collect(level, name);
        }
        let level = median(self.recent.iter().copied());
        let compared = self.reference.as_ref().filter(|of| name.is_none_or(|name| of.name == name));
        LightState { level, ratio: compared.map(|of| level / of.level.max(MIN_LEVEL)) }
    }

    fn collect(&mut self, level: f64, name: &str) {
        if self.collected.0 != name {
            self.collected = (name.to_owned(), Vec::new());
        }
        self.collected.1.push(level);
        if self.collected.1.len() < REFERENCE_PICTURES {
            return;
        }
        let (name, levels) = std::mem::take(&mut self.collected);
        let reference = LightReference { name, level: median(levels) };
        let written = serde_json::to_vec(&reference).map_err(std::io::Error::from).and_then(|bytes| {
            let new = self.path.with_extension("new");
            fs::write(&new, bytes)?;
            fs::rename(new, &self.path)
        });
        if let Err(error) = written {
            tracing::warn!(%error, "the light's reference cannot be stored; after a restart another one is taken");
        }
        self.reference = Some(reference);
    }
}

fn median(values: impl IntoIterator<Item = f64>) -> f64 {
    let mut sorted: Vec<f64> = values.into_iter().collect();
    sorted.sort_by(f64::total_cmp);
    sorted.get(sorted.len() / 2).copied().unwrap_or_default()
}

/// Measures the light for as long as the agent stands by. During a recording nothing is measured: tools are in the picture.
pub(super) async fn watch(standby: Standby) {
    let mut meter = LightMeter::open(&standby.parts().spool);
    let mut ticks = interval(INTERVAL);
    ticks.set_missed_tick_behavior(MissedTickBehavior::Delay);
    loop {
        ticks.tick().await;
        if standby.running().is_some() {
            continue;
        }
        let Some((info, frame)) = standby.parts().camera.take_key_frame() else { continue };
        let measured = tokio::task::spawn_blocking(move || mean_luma(info.codec, info.size, &frame)).await;
        let level = match measured {
            Ok(Ok(Some(level))) => level,
            Ok(Ok(None)) => continue, // a key frame that cannot be decoded alone
            Ok(Err(error)) => {
                tracing::debug!(%error, "brightness of a picture not measured");
                continue;
            }
            Err(_) => continue, // a panic is logged where it happened
        };
        let name = standby.facts().light_reference.clone();
        let light = meter.add(level, name.as_deref());
        standby.parts().camera.set_light(light);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_light_is_compared_with_the_first_minute_after_the_calibration_also_after_a_restart() {
        let folder = tempfile::tempdir().unwrap();
        let mut meter = LightMeter::open(folder.path());
        for _ in 1..REFERENCE_PICTURES {
            assert_eq!(meter.add(100.0, Some("one")).ratio, None);
        }
        assert_eq!(meter.add(100.0, Some("one")).ratio, Some(1.0));
        let mut meter = LightMeter::open(folder.path());
        assert_eq!(meter.add(50.0, Some("one")), LightState { level: 50.0, ratio: Some(0.5) });
        assert_eq!(meter.add(50.0, None).ratio, Some(0.5), "without a server the last reference counts");
        assert_eq!(meter.add(50.0, Some("two")).ratio, None, "calibrated again");
        (2..REFERENCE_PICTURES).for_each(|_| assert!(meter.add(50.0, Some("two")).ratio.is_none()));
        assert_eq!(meter.add(50.0, Some("two")).ratio, Some(1.0));
    }

    #[test]
    fn a_passing_hand_does_not_change_the_level() {
        let folder = tempfile::tempdir().unwrap();
        let mut meter = LightMeter::open(folder.path());
        (0..4).for_each(|_| assert_eq!(meter.add(100.0, None).ratio, None));
        assert_eq!(meter.add(20.0, None).level, 100.0);
        assert_eq!(meter.add(20.0, None).level, 100.0);
        assert_eq!(meter.add(20.0, None).level, 20.0);
    }
}
