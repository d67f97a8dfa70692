//! A model as a file: made by `trocar model`, read by `trocar score --model`.

use serde::{Deserialize, Serialize};

use super::{ModelDefinition, ModelReport, NoLevelReasonName, Readings, SkillVerdict, fingerprint};
use crate::domain::text::{Invalid, count_of};
use crate::motion::features;
use crate::statistics::skill::{NoModel, SkillDataset, train};

/// Version of the file format that this program writes and reads.
const FILE_FORMAT: u32 = 1;

/// A model as a file, with everything that a verdict depends on.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ModelFile {
    /// Version of the file format: 1.
    pub form: u32,
    /// The task.
    pub task: Option<String>,
    /// Version of the program that measured the sessions.
    pub pipeline: String,
    /// SHA-256 of the sessions that it was trained on.
    pub fingerprint: String,
    /// How well it does on held-out people.
    pub report: ModelReport,
    /// The model.
    pub model: ModelDefinition,
}

impl ModelFile {
    /// Trains a model on sessions that version `pipeline` measured with `tools` tools. `on_progress` is called with the
    /// number of repetitions done and the total.
    pub fn train(
        data: &SkillDataset,
        (task, pipeline, tools): (Option<String>, String, usize),
        on_progress: impl FnMut(usize, usize),
    ) -> Result<Self, NoModel> {
        let (fingerprint, seed) = fingerprint(data);
        let trained = train(data, seed, on_progress)?;
        let report = ModelReport::of(trained.report, trained.model.has_skill);
        let model = ModelDefinition::of(trained.model, tools);
        Ok(Self { form: FILE_FORMAT, task, pipeline, fingerprint, report, model })
    }

    /// Reads a file's text.
    pub fn parse(text: &str) -> Result<Self, Invalid> {
        let file: Self = serde_json::from_str(text).map_err(|why| Invalid::new("model", why.to_string()))?;
        if file.form != FILE_FORMAT {
            return Err(Invalid::new("form", format!("is {}; this program reads {FILE_FORMAT}", file.form)));
        }
        file.model.clone().model()?;
        Ok(file)
    }
}

impl ModelDefinition {
    /// The model's verdict on a session with these values, which must be measured by the model's own program version.
    pub fn judge(&self, readings: &Readings, tools: usize) -> SkillVerdict {
        if tools != self.tools {
            let tools = count_of(tools as u64, "tool");
            let detail = format!("the session has {tools}; the model's training sessions had {}", self.tools);
            return SkillVerdict::without_level(NoLevelReasonName::OtherTools, detail);
        }
        match self.clone().model() {
            Ok(model) => model.judge(|name| features::find(name).ok().and_then(|feature| readings.get(feature))).into(),
            Err(why) => SkillVerdict::without_level(NoLevelReasonName::NoModel, why.to_string()),
        }
    }
}
