//! `trocar score --reference`: how far each tool deviates from the path of an exemplary performance.

use std::path::{Path, PathBuf};

use anyhow::anyhow;
use serde_json::{Value, json};

use super::significant;
use crate::commands::table::TextTable;
use crate::commands::{CommandFailure, read_trajectory};
use crate::motion::assessment::motions;
use crate::motion::features::motion::Motion;
use crate::motion::features::reference::{Deviation, deviation};
use crate::motion::features::{FeatureSettings, NotEnough};
use crate::vision::trajectory::Trajectory;

/// The path of an exemplary performance.
pub struct Reference {
    path: PathBuf,
    tools: Vec<String>,
    motions: Vec<Result<Motion, NotEnough>>,
}

/// Deviation of each tool that both trajectories have.
pub struct Deviations {
    reference: PathBuf,
    tools: Vec<(String, Result<Deviation, NotEnough>)>,
}

impl Reference {
    /// Reads the reference. Refuses a trajectory without a usable tool.
    pub fn read(path: &Path, settings: &FeatureSettings) -> Result<Self, CommandFailure> {
        let trajectory = read_trajectory(path)?;
        let motions = motions(&trajectory, settings);
        match motions.iter().find_map(|motion| motion.as_ref().err()).filter(|_| motions.iter().all(Result::is_err)) {
            Some(reason) => Err(CommandFailure::Input(anyhow!("{}: {reason}; use another reference", path.display()))),
            None => Ok(Self { path: path.to_owned(), tools: trajectory.tools, motions }),
        }
    }

    /// Deviations of a trajectory's tools from the reference's tools of the same names.
    pub fn deviations(
        &self,
        path: &Path,
        track: &Trajectory,
        settings: &FeatureSettings,
    ) -> Result<Deviations, CommandFailure> {
        let known = |name: &String| self.tools.iter().position(|tool| tool == name);
        let of_tool = |(name, motion): (&String, Result<Motion, NotEnough>)| {
            let reference = &self.motions[known(name)?];
            let strays = reference.as_ref().map_err(|reason| *reason).and_then(|r| deviation(&motion?, r, settings));
            Some((name.clone(), strays))
        };
        let tools: Vec<_> = track.tools.iter().zip(motions(track, settings)).filter_map(of_tool).collect();
        if tools.is_empty() {
            let (have, wanted) = (track.tools.join(", "), self.tools.join(", "));
            let (path, reference) = (path.display(), self.path.display());
            let what = anyhow!("{path} has the tools {have}, its reference {reference} {wanted}: name them alike");
            return Err(CommandFailure::Input(what));
        }
        Ok(Deviations { reference: self.path.clone(), tools })
    }
}

impl Deviations {
    /// The part of a session's JSON.
    pub fn json(&self) -> Value {
        let of_tool = |(tool, strays): &(String, Result<Deviation, NotEnough>)| {
            json!({
                "tool": tool,
                "unit": "mm",
                "mean": strays.ok().map(|strays| strays.mean_mm),
                "largest": strays.ok().map(|strays| strays.largest_mm),
                "not_enough": strays.err().map(|reason| reason.to_string()),
            })
        };
        json!({
            "file": self.reference.display().to_string(),
            "tools": self.tools.iter().map(of_tool).collect::<Vec<_>>(),
        })
    }

    /// The table below the features.
    pub fn text(&self) -> String {
        let head = ["tool", "mean (DTW)", "largest (Fréchet)", "unit"].map(str::to_owned);
        let mut table = TextTable::new(head);
        for (tool, strays) in &self.tools {
            let cell =
                |of: fn(&Deviation) -> f64| strays.as_ref().map_or("–".to_owned(), |strays| significant(of(strays)));
            table.add_row([tool.clone(), cell(|s| s.mean_mm), cell(|s| s.largest_mm), "mm".to_owned()]);
        }
        let why = self.tools.iter().filter_map(|(tool, strays)| Some(format!("  – {tool}: {}\n", strays.err()?)));
        let head = format!("  strays from {}:\n", self.reference.display());
        head + &table.to_text() + &why.collect::<String>()
    }
}
