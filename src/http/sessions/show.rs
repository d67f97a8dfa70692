//! A session as it is shown.

use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use crate::domain::feature::FeatureKey;
use crate::domain::files::quality::QualityDocument;
use crate::domain::problem;
use crate::domain::session::{FeatureError, FeatureRow, FeatureSpace, LiveFeature, SessionStatus, Versions};
use crate::domain::skill::SkillVerdict;
use crate::domain::standard::{Better, Judgement, ToJudge};
use crate::domain::text::TrackerName;
use crate::domain::trainee::Handedness;
use crate::http::error::ProblemDocument;
use crate::http::show::{Named, Time};
use crate::ids::{ResultId, SessionId};
use crate::store;

/// One recording of one trainee doing one task in one box, how it stands, and what came of it.
#[derive(Debug, Serialize, ToSchema)]
pub struct Session {
    id: SessionId,
    trainee: Named,
    task: Named,
    #[serde(rename = "box")]
    in_box: Named,
    /// The recording's name as it was sent.
    filename: String,
    recorded_at: Time,
    created_at: Time,
    status: SessionStatus,
    /// Has somebody set it aside, so that it counts in nothing? `GET /sessions/{id}/edits` says who, when and why.
    set_aside: bool,
    /// Share that is tracked, 0 to 1.
    progress: f64,
    /// Place in the queue, from 1, while it waits there.
    queue_position: Option<i64>,
    source: Source,
    /// Why it does not go on, or did not.
    error: Option<ProblemDocument>,
    /// Whoever tracked it died or fell silent too often; staff may try again.
    quarantined: bool,
    video: Video,
    /// Names of the tools, in the trajectory's order.
    tools: Vec<String>,
    features: Vec<Feature>,
    /// Features as they stood when the recording ended, where it was tracked while it arrived: by the causal filter over all
    /// that was seen, without the smoother's hindsight, so they differ from `features`.
    live_features: Option<Vec<LiveFeature>>,
    /// Place in a reference cohort, if a model scored it.
    score: Option<Value>,
    /// What the task's model of skill says of it, or why it says nothing; `null` in lists, and while there is no result.
    verdict: Option<SkillVerdict>,
    /// What was observed, predicted and missed, and whether the features may be believed: those of a refused session have
    /// no values. Results of earlier versions have fewer fields.
    #[schema(value_type = Option<QualityDocument>)]
    quality: Option<Value>,
    /// What the result was made with.
    versions: Option<Versions>,
    /// Which of the session's results this is: the latest counts, `GET /sessions/{id}/results` lists all.
    result: Option<ResultId>,
}

/// Where a session's path comes from.
#[derive(Debug, Serialize, ToSchema)]
pub struct Source {
    /// `recording`: tracked here. `import`: rows of another tracker, not measured by Trocar; there is no video, and error bars are
    /// those that the rows state, if they do.
    kind: &'static str,
    /// What that tracker is called; `null` of a recording.
    tracker: Option<TrackerName>,
}

/// A recording.
#[derive(Debug, Serialize, ToSchema)]
pub struct Video {
    /// Its length; `null` while it arrives.
    bytes: Option<u64>,
    /// Its fingerprint, 64 hexadecimal digits; `null` while it arrives.
    sha256: Option<String>,
    media_type: String,
    /// Width as displayed, pixels; known once it was decoded, like the following.
    width: Option<u32>,
    /// Height as displayed, pixels.
    height: Option<u32>,
    /// Decoded frames.
    frames: Option<u64>,
    /// From the first frame to the last, s.
    duration_s: Option<f64>,
}

/// One feature.
#[derive(Debug, Serialize, ToSchema)]
pub struct Feature {
    /// Stable name, such as `path_length`.
    name: String,
    /// Title for people.
    title: String,
    /// Under which head it stands: `time`, `speed`, `path`, `smoothness`, `movements`, `two_hands` or `view`; `null` where it is
    /// measured no more.
    family: Option<&'static str>,
    /// Unit of `value`; empty for a pure number.
    unit: String,
    /// The tool's marker; `null` for a feature of the whole session.
    tool: Option<String>,
    space: FeatureSpace,
    /// The value; `null` where there are too few observations, and then `not_enough` says of what.
    value: Option<f64>,
    not_enough: Option<String>,
    /// How far the value may be off; `null` where that is not known, and then `no_error` says why.
    error: Option<FeatureError>,
    no_error: Option<String>,
    /// The limit that the task's standard sets it; `null` without one.
    target: Option<Limit>,
    /// What the value is worth against it.
    judgement: Option<Judgement>,
}

/// A limit, and the standard that sets it.
#[derive(Debug, Serialize, ToSchema)]
pub struct Limit {
    /// The limit, in the feature's unit; keeping it exactly is enough.
    limit: f64,
    /// Which side of it is better.
    better: Better,
    /// Version of the task's standard.
    standard: i64,
}

impl Session {
    /// A session with its latest result, if there is one.
    pub fn of(session: store::Session, result: Option<store::SessionResult>) -> Self {
        let status = session.status();
        let facts = result.as_ref().map(|result| result.video);
        let video = Video {
            bytes: session.video_blob().map(|blob| blob.bytes),
            sha256: session.video.map(|hash| hash.to_string()),
            media_type: session.media_type.clone(),
            width: facts.and_then(|facts| facts.width),
            height: facts.and_then(|facts| facts.height),
            frames: facts.map(|facts| facts.frames),
            duration_s: facts.map(|facts| facts.duration_s),
        };
        let mut shown = Self {
            id: session.id,
            progress: progress(status, session.job_progress),
            queue_position: session.queue_position,
            source: Source {
                kind: if session.tracker.is_some() { "import" } else { "recording" },
                tracker: session.tracker.clone(),
            },
            error: session.problem().map(ProblemDocument::from),
            quarantined: session.is_quarantined(),
            trainee: named(session.trainee_id, session.trainee_name, session.trainee_code),
            task: named(session.task_id, session.task_name, session.task_code),
            in_box: named(session.box_id, session.box_name, session.box_code),
            filename: session.filename.into(),
            recorded_at: Time(session.recorded_at_ms),
            created_at: Time(session.created_at_ms),
            status,
            set_aside: session.is_set_aside,
            video,
            tools: Vec::new(),
            features: Vec::new(),
            live_features: None,
            score: None,
            verdict: None,
            quality: None,
            versions: None,
            result: None,
        };
        if let Some(result) = result {
            shown.add(result);
        }
        shown
    }

    /// The same with what was told live.
    pub fn with_live(self, live_features: Option<Vec<LiveFeature>>) -> Self {
        Self { live_features, ..self }
    }

    /// The same, judged by its task's standard.
    pub fn judged_by(mut self, standard: Option<&store::Standard>, handedness: Option<Handedness>) -> Self {
        if let (Some(standard), Some(versions)) = (standard, &self.versions) {
            self.features.iter_mut().for_each(|feature| feature.judge(standard, &versions.pipeline, handedness));
        }
        self
    }

    /// The same with what the task's model of skill says.
    pub fn with_verdict(self, verdict: Option<SkillVerdict>) -> Self {
        Self { verdict, ..self }
    }

    fn add(&mut self, result: store::SessionResult) {
        self.tools = result.tools;
        self.features = result.features.into_iter().map(Feature::from).collect();
        self.score = result.score;
        self.quality = Some(result.quality);
        self.versions = Some(result.versions);
        self.result = Some(result.id);
    }
}

/// Share that is tracked: what the job says, but all of it once it is done.
pub fn progress(status: SessionStatus, of_job: Option<f64>) -> f64 {
    if status == SessionStatus::Done { 1.0 } else { of_job.unwrap_or(0.0) }
}

fn named(id: impl ToString, name: impl Into<String>, code: impl Into<String>) -> Named {
    Named { id: id.to_string(), name: name.into(), code: code.into() }
}

impl From<FeatureRow> for Feature {
    fn from(row: FeatureRow) -> Self {
        let family = row.family();
        let (value, not_enough) = match row.value {
            Ok(value) => (Some(value), None),
            Err(reason) => (None, Some(reason)),
        };
        let (error, no_error) = row.error.transpose().map_or_else(|reason| (None, Some(reason)), |bar| (bar, None));
        Self {
            name: row.name,
            title: row.title,
            family,
            unit: row.unit,
            tool: row.tool,
            space: row.space,
            value,
            not_enough,
            error,
            no_error,
            target: None,
            judgement: None,
        }
    }
}

impl Feature {
    fn judge(&mut self, standard: &store::Standard, pipeline: &str, handedness: Option<Handedness>) {
        let key = FeatureKey { feature: self.name.clone(), tool: self.tool.clone(), space: self.space };
        let Some(target) = standard.definition.target(&key) else { return };
        let bar = self.error.map(|error| [error.low, error.high]);
        self.judgement = Some(target.judge(ToJudge { value: self.value, bar, pipeline, handedness }));
        self.target = Some(Limit { limit: target.limit, better: target.better, standard: standard.version });
    }
}

impl From<problem::Problem> for ProblemDocument {
    /// A problem that lies in the past, so its status is only what it would have been.
    fn from(problem: problem::Problem) -> Self {
        let problem::Problem { slug, title, detail } = problem;
        Self { kind: format!("/problems/{slug}"), title, status: 422, detail }
    }
}
