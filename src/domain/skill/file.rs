//! A model as a file: made by `trocar model`, read by `trocar score --model`.

use serde::{Deserialize, Serialize};

use super::{Definition, Readings, ReasonName, Report, SkillVerdict, fingerprint};
use crate::domain::text::Invalid;
use crate::pipeline::score::skill::{Dataset, NoModel, train};

/// The form that this program writes and reads.
const FORM: u32 = 1;

/// A model as a file, with all that a verdict depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    /// Form of the file: 1.
    pub form: u32,
    /// The exercise.
    pub task: Option<String>,
    /// Version of the program that measured the sessions.
    pub pipeline: String,
    /// SHA-256 of the sessions that it was made of.
    pub fingerprint: String,
    /// How well it does on people left out.
    pub report: Report,
    /// The model.
    pub model: Definition,
}

impl ModelFile {
    /// Makes a model of sessions that were measured by this version with so many tools. `told`: repetitions done, and in all.
    pub fn make(
        data: &Dataset,
        (task, pipeline, tools): (Option<String>, String, usize),
        told: impl FnMut(usize, usize),
    ) -> Result<Self, NoModel> {
        let (fingerprint, seed) = fingerprint(data);
        let trained = train(data, seed, told)?;
        let report = Report::of(trained.report, trained.model.knows);
        let model = Definition::of(trained.model, tools);
        Ok(Self { form: FORM, task, pipeline, fingerprint, report, model })
    }

    /// Reads a file's text.
    pub fn parse(text: &str) -> Result<Self, Invalid> {
        let file: Self = serde_json::from_str(text).map_err(|why| Invalid::new("model", why.to_string()))?;
        if file.form != FORM {
            return Err(Invalid::new("form", format!("is {}; this program reads {FORM}", file.form)));
        }
        file.model.clone().model()?;
        Ok(file)
    }
}

impl Definition {
    /// What it says of a session with these values, measured by the same version of the program as its own.
    pub fn judge(&self, readings: &Readings, tools: usize) -> SkillVerdict {
        if tools != self.tools {
            let detail = format!("the session has {tools} tools, the sessions of the model {}", self.tools);
            return SkillVerdict::without(ReasonName::OtherTools, detail);
        }
        match self.clone().model() {
            Ok(model) => model.judge(|feature| readings.get(feature)).into(),
            Err(why) => SkillVerdict::without(ReasonName::NoModel, why.to_string()),
        }
    }
}
