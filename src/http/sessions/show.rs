//! A session in answers: builds it from the store's rows.

use serde::Serialize;
use serde_json::Value;
use utoipa::ToSchema;

use crate::domain::box_agent::messages::LastRecording;
use crate::domain::feature::{ComparisonSpace, NotEnoughReason, StoredFeatureKey};
use crate::domain::feed::arrival::Arrival;
use crate::domain::feed::early_end::EarlyEnd;
use crate::domain::files::quality::QualityDocument;
use crate::domain::hand::{Hand, ToolHands};
use crate::domain::problem::Problem;
use crate::domain::session::{
    BoxQuestion, FeatureError, FeatureRow, FeatureSpace, LiveFeature, RecordedAtSource, ResultClock, SessionStatus,
    Supervision, Versions,
};
use crate::domain::skill::SkillVerdict;
use crate::domain::standard::{Better, Judgement, SessionJudgement, StandardDefinition, Target, ValueToJudge};
use crate::domain::text::TrackerName;
use crate::domain::trainee::Handedness;
use crate::http::error::ProblemDocument;
use crate::http::show::{NamedReference, Time};
use crate::ids::{ExamId, ResultId, SessionId};
use crate::live::Interruption;
use crate::store;

/// The exam that a session is an attempt of. Such a session is never moved, cut, edited or erased alone.
#[derive(Debug, Serialize, ToSchema)]
pub struct SessionExam {
    id: ExamId,
    /// The number of the attempt.
    attempt: u32,
    /// True if the attempt was voided after a technical failure: the session counts nowhere.
    is_voided: bool,
}

/// One recording of one trainee doing one task in one box, with its status and results.
#[derive(Debug, Serialize, ToSchema)]
pub struct SessionResponse {
    id: SessionId,
    trainee: NamedReference,
    task: NamedReference,
    #[serde(rename = "box")]
    in_box: NamedReference,
    /// Name of the file that was sent.
    filename: String,
    /// When it was recorded.
    recorded_at: Time,
    /// Who says so: `claimed` by the sender, or the `arrival`, which the service knows.
    recorded_at_source: RecordedAtSource,
    /// False if that time rests only on a trainee's word or file. True if the service noted it, or if staff or the agent
    /// of the box stated it.
    date_known: bool,
    /// Whether a member of staff saw the attempt; `null`: from before this was recorded.
    supervision: Option<Supervision>,
    /// Name of the person who saw it, or who took the mark back; `null` without one, and if the account was deleted.
    supervised_by: Option<String>,
    /// When that was recorded.
    supervised_at: Option<Time>,
    /// The same recording under other trainees: one of them did not do it. `null` if there is none, and in lists.
    same_recording: Option<SameRecordingResponse>,
    /// When it had arrived completely; while it arrives, when it began to.
    created_at: Time,
    status: SessionStatus,
    /// Set while a recording with the status `receiving` has no sender. It ends by itself with the frames that arrived,
    /// or earlier by `POST /sessions/{id}/end`.
    interruption: Option<InterruptionResponse>,
    /// The exam that the session is an attempt of; `null` if it is none, and in lists.
    exam: Option<SessionExam>,
    /// Why a live recording ended before its sender meant it to; `null` if it did not, and in lists.
    early_end: Option<EarlyEnd>,
    /// True if the session was set aside and counts nowhere. `GET /sessions/{id}/edits` gives person, time and reason.
    set_aside: bool,
    /// True if it is an attempt of an exam that was declared void: it counts nowhere, and no standard judges it.
    voided: bool,
    /// `asked`: the recording may show another box; until staff say whether it does, the session counts nowhere and its
    /// lengths are not promised. Answer with an edit `this_box` or `other_box`. `this_box`, `other_box`: the answer.
    /// `null`: nothing speaks against the box.
    box_question: Option<BoxQuestion>,
    /// Share that is tracked, 0 to 1.
    progress: f64,
    /// Position in the queue, from 1; `null` if it does not wait there.
    queue_position: Option<i64>,
    source: SessionSource,
    /// Why the session waits or failed.
    error: Option<ProblemDocument>,
    /// True if tracking crashed or timed out too often, so it is not tried again on its own. Staff may retry it.
    quarantined: bool,
    /// False if the recording's file itself cannot be used, or if there is none: to score the session again gives the same
    /// result.
    retry_can_help: bool,
    video: VideoResponse,
    /// Names of the tools, in the trajectory's order.
    tools: Vec<String>,
    /// The tools in the trainee's hands.
    hands: ToolHands,
    /// True if the standard limits a feature of one hand, and which tool was in it is not known: the recording does not
    /// say it, or the trainee's preferred hand is unknown. The session can then be missed, but not passed.
    unknown_hand: bool,
    features: Vec<FeatureResponse>,
    /// Where to look at the features first; `null` while there is no result, and where its paths are short or state no
    /// errors.
    compare_in: Option<ComparisonSpace>,
    /// Features at the end of live tracking, if the session was tracked live. The causal filter computes them from all
    /// frames without later smoothing, so they differ from `features`.
    live_features: Option<Vec<LiveFeature>>,
    /// Always `null`: reserved for a rank in a reference cohort. `verdict` and the task's standards judge a session.
    score: Option<Value>,
    /// Whether the session met the task's standard: all its limits (`pass`), not all (`fail`), or too little is known
    /// (`unknown`). `null` while there is no result or no standard, and for a session that counts nowhere.
    judgement: Option<SessionJudgement>,
    /// Verdict of the task's model of skill, or why it gives none; `null` in lists, while there is no result, and for a
    /// session that may show another box.
    verdict: Option<SkillVerdict>,
    /// What was observed, predicted and missed, and whether the features are trustworthy: features of a refused session
    /// have no values. Results of earlier versions have fewer fields.
    #[schema(value_type = Option<QualityDocument>)]
    quality: Option<Value>,
    /// Versions of the program, calibration and colours that the result was computed with.
    versions: Option<Versions>,
    /// The versions of the box's camera and colours that the result was tracked with, with their times; `null` in lists,
    /// while there is no result, and where Trocar did not track the session.
    setup: Option<SetupResponse>,
    /// Id of this result, the session's latest. `GET /sessions/{id}/results` lists all.
    result: Option<ResultId>,
}

/// The same recording, filed under other trainees as well.
#[derive(Debug, Serialize, ToSchema)]
pub struct SameRecordingResponse {
    /// The sessions of trainees that the caller sees; empty for trainees.
    sessions: Vec<SameSession>,
}

/// A session of another trainee with the same recording.
#[derive(Debug, Serialize, ToSchema)]
pub struct SameSession {
    id: SessionId,
    trainee: NamedReference,
    task: NamedReference,
    /// When it arrived.
    created_at: Time,
}

/// A recording whose sender is gone.
#[derive(Debug, Serialize, ToSchema)]
pub struct InterruptionResponse {
    /// Time of its latest frame, s; `null` if that is not known.
    recorded_s: Option<f64>,
    /// Time until it ends by itself, s.
    ends_in_s: f64,
}

/// Where a session's path comes from.
#[derive(Debug, Serialize, ToSchema)]
pub struct SessionSource {
    /// `recording`: tracked by Trocar. `import`: measured by another tracker; there is no video, and error bars exist
    /// only if the imported table states the errors.
    kind: &'static str,
    /// Name of the other tracker; `null` for a recording.
    tracker: Option<TrackerName>,
}

/// A recording.
#[derive(Debug, Serialize, ToSchema)]
pub struct VideoResponse {
    /// Size of the file, bytes; `null` while it arrives.
    bytes: Option<u64>,
    /// SHA-256 of the file, 64 hexadecimal digits; `null` while it arrives.
    sha256: Option<String>,
    media_type: String,
    /// When the file was deleted, because the centre keeps videos for a limited time. The session keeps its path and
    /// features, but cannot be tracked again. `null`: it is there, or still arriving.
    deleted_at: Option<Time>,
    /// Width of the measured picture, which is turned and mirrored for display, pixels; `null`, like the next four, until
    /// the video was decoded. Pixels are those that the file stores: if they are not square, players show the picture
    /// wider or higher.
    width: Option<u32>,
    /// Height of the measured picture, pixels.
    height: Option<u32>,
    /// Number of decoded frames.
    frames: Option<u64>,
    /// Time from the first frame to the last, s.
    duration_s: Option<f64>,
    /// How the times were computed from the file's time stamps; `null` for results of earlier versions. Times of the
    /// session are the file's times, counted from `starts_at_s` and multiplied by `factor`. Where a person corrected them, `GET /sessions/{id}/edits`
    /// gives name, date and reason.
    clock: Option<ResultClock>,
    /// True if the recorder states a capture rate of 1.8 to 3 times the frame rate and the times are those of the file: it
    /// may be slow motion, or a camera that captured fewer frames in the dark. A person who knows that it is slow motion
    /// gives the true frame rate with `retime`.
    may_be_slow_motion: bool,
    /// How fast a pushed stream arrived; `null` in lists, for other recordings, and for streams of less than 15 s.
    arrival: Option<Arrival>,
    /// True if a stream that was pushed live arrived at another pace than its time stamps say, and the times are those of
    /// the stamps. A person who knows its true duration or frame rate gives it with `retime`.
    may_run_at_wrong_pace: bool,
}

/// What a session was tracked with. A recording is tracked with the versions that became valid last before it was recorded.
#[derive(Debug, Serialize, ToSchema)]
pub struct SetupResponse {
    calibration: UsedVersionResponse,
    palette: UsedVersionResponse,
}

/// A version of a box's camera or colours that a session was tracked with.
#[derive(Debug, Serialize, ToSchema)]
pub struct UsedVersionResponse {
    /// 1, 2, … within the box.
    version: i64,
    /// When it was made.
    created_at: Time,
    /// Since when it is valid: `created_at`, unless staff stated another time.
    valid_from: Time,
    /// True if the recording is more than a day older: the box had no version at that time. The lengths are right only if
    /// the box was the same then.
    is_later: bool,
    /// The version that the recording would be tracked with now; `null` if it is this one. `POST sessions/{id}/retry`
    /// tracks it again.
    valid_version: Option<i64>,
}

impl From<store::SessionSetup> for SetupResponse {
    fn from(store::SessionSetup { calibration, palette }: store::SessionSetup) -> Self {
        Self { calibration: calibration.into(), palette: palette.into() }
    }
}

impl From<store::UsedVersion> for UsedVersionResponse {
    fn from(used: store::UsedVersion) -> Self {
        let store::UsedVersion { version, is_later, valid_version, .. } = used;
        let (created_at, valid_from) = (Time(used.created_at_ms), Time(used.valid_from_ms));
        Self { version, created_at, valid_from, is_later, valid_version }
    }
}

/// One feature of a session.
#[derive(Debug, Serialize, ToSchema)]
pub struct FeatureResponse {
    /// Stable name, such as `path_length`.
    name: String,
    /// Title for people.
    title: String,
    /// Group of features: `time`, `speed`, `path`, `smoothness`, `movements`, `two_hands` or `view`; `null` if the
    /// feature is no longer measured.
    family: Option<&'static str>,
    /// Unit of `value`; `1` for shares, counts and ratios.
    unit: String,
    /// The tool's marker; `null` for a feature of the whole session.
    tool: Option<String>,
    /// The hand that held the tool, `left` or `right`; `null` if unknown, and for a feature of the whole session.
    in_hand: Option<Hand>,
    space: FeatureSpace,
    /// The value; `null` if there are too few observations.
    value: Option<f64>,
    /// Which observations are missing; `null` if there is a value.
    not_enough: Option<String>,
    /// The same by its code, for other languages; `null` if there is a value, or for the words of another program.
    not_enough_reason: Option<NotEnoughReason>,
    /// The error bar of the value; `null` if it is unknown.
    error: Option<FeatureError>,
    /// Why the error bar is unknown; `null` if there is one.
    no_error: Option<String>,
    /// The same by its code, for other languages: `not_computed`, `no_value`, `errors_not_stated`, `unsteady` or `at_least`.
    /// `null` if there is an error bar, or for the words of another program.
    no_error_reason: Option<&'static str>,
    /// True if the true value is at least this one: the recording shows only a part of the attempt.
    is_lower_bound: bool,
    /// True if depth decides the value: it is measured in space, and is no duration and no time of view. `null` if the
    /// feature is no longer measured.
    needs_depth: Option<bool>,
    /// Which values are better: `lower`, `higher` or `neither`, which describes the style. `null` if the feature is no
    /// longer measured.
    better: Option<&'static str>,
    /// False if the error bar is so wide that the value says nothing. `null` without a value or an error bar, and for a
    /// feature that is no longer measured. A value that the task's standard judges (`pass` or `fail`) says something.
    informative: Option<bool>,
    /// Why it says nothing: `as_large_as_value` (the error is as large as the value), `half_of_range` (the error bar
    /// covers more than half of all possible values) or `large_factor` (a logarithm: what it was taken of may be off by
    /// a factor of 2.7). `null` if it says something.
    too_uncertain: Option<&'static str>,
    /// The limit in the task's standard; `null`: none.
    target: Option<FeatureLimit>,
    /// Judgement of the value by this limit.
    judgement: Option<Judgement>,
}

/// A feature's limit, and the standard that sets it.
#[derive(Debug, Serialize, ToSchema)]
pub struct FeatureLimit {
    /// The limit, in the feature's unit; a value equal to it passes.
    limit: f64,
    /// Whether smaller or larger values are better.
    better: Better,
    /// The hand that the standard limits; `null` for a limit of a tool or of the whole session.
    in_hand: Option<Hand>,
    /// Version of the task's standard: that of the day on which the recording arrived.
    standard: i64,
}

impl SessionResponse {
    /// Builds the answer from a session and its latest result, if there is one.
    pub fn of(session: store::SessionRecord, result: Option<store::SessionResult>) -> Self {
        let status = session.status();
        let facts = result.as_ref().map(|result| result.video);
        let video = VideoResponse {
            bytes: session.video_blob().map(|blob| blob.bytes),
            sha256: session.video.map(|hash| hash.to_string()),
            media_type: session.media_type.clone(),
            deleted_at: session.video_dropped_at_ms.map(Time),
            width: facts.and_then(|facts| facts.width),
            height: facts.and_then(|facts| facts.height),
            frames: facts.map(|facts| facts.frames),
            duration_s: facts.map(|facts| facts.duration_s),
            clock: facts.and_then(|facts| facts.clock),
            may_be_slow_motion: facts.and_then(|facts| facts.clock).is_some_and(|clock| clock.may_be_slow_motion()),
            arrival: None,
            may_run_at_wrong_pace: false,
        };
        let problem = session.problem();
        let mut shown = Self {
            id: session.id,
            retry_can_help: session.tracker.is_none()
                && session.video_dropped_at_ms.is_none()
                && !problem.as_ref().is_some_and(Problem::is_of_file),
            progress: progress(status, session.job_progress),
            queue_position: session.queue_position,
            source: SessionSource {
                kind: if session.tracker.is_some() { "import" } else { "recording" },
                tracker: session.tracker.clone(),
            },
            error: problem.map(ProblemDocument::from),
            quarantined: session.is_quarantined(),
            trainee: named(session.trainee_id, session.trainee_name, session.trainee_code),
            task: named(session.task_id, session.task_name, session.task_code),
            in_box: named(session.box_id, session.box_name, session.box_code),
            filename: session.filename.into(),
            recorded_at: Time(session.recorded_at_ms),
            recorded_at_source: session.recorded_at_source,
            date_known: session.date_known,
            supervision: session.supervision,
            supervised_by: session.supervisor.map(String::from),
            supervised_at: session.supervised_at_ms.map(Time),
            same_recording: None,
            created_at: Time(session.created_at_ms),
            status,
            interruption: None,
            exam: None,
            early_end: None,
            set_aside: session.is_set_aside,
            voided: session.is_voided,
            box_question: session.box_question,
            video,
            tools: Vec::new(),
            hands: ToolHands::default(),
            unknown_hand: false,
            features: Vec::new(),
            compare_in: None,
            live_features: None,
            score: None,
            judgement: None,
            verdict: None,
            quality: None,
            versions: None,
            setup: None,
            result: None,
        };
        if let Some(result) = result {
            shown.add_result(result);
        }
        shown
    }

    /// Adds the features of live tracking.
    pub fn with_live(self, live_features: Option<Vec<LiveFeature>>) -> Self {
        Self { live_features, ..self }
    }

    /// Adds why a live recording ended early.
    pub fn with_early_end(self, early_end: Option<EarlyEnd>) -> Self {
        Self { early_end, ..self }
    }

    /// Adds the exam that it is an attempt of.
    pub fn with_exam(mut self, exam: Option<store::ExamOfSession>) -> Self {
        self.exam = exam.map(|exam| SessionExam { id: exam.exam_id, attempt: exam.number, is_voided: exam.is_voided });
        self
    }

    /// Adds what is known of a recording whose sender is gone.
    pub fn with_interruption(mut self, known: Option<Interruption>) -> Self {
        self.interruption =
            known.map(|Interruption { recorded_s, ends_in_s }| InterruptionResponse { recorded_s, ends_in_s });
        self
    }

    /// Adds the versions of camera and colours.
    pub fn with_setup(self, setup: Option<store::SessionSetup>) -> Self {
        Self { setup: setup.map(SetupResponse::from), ..self }
    }

    /// Adds the same recording under other trainees. A trainee learns that there is one, and no other trainee's name.
    pub fn with_same_recordings(self, found: store::SameRecordings, by_staff: bool) -> Self {
        let shown = |same: store::SameRecording| SameSession {
            id: same.session,
            trainee: named(same.trainee_id, same.trainee_name, same.trainee_code),
            task: named(same.task_id, same.task_name, same.task_code),
            created_at: Time(same.created_at_ms),
        };
        let sessions = || found.seen.into_iter().filter(|_| by_staff).map(shown).collect();
        Self { same_recording: found.exist.then(|| SameRecordingResponse { sessions: sessions() }), ..self }
    }

    /// Adds how fast a pushed stream arrived.
    pub fn with_arrival(mut self, arrival: Option<Arrival>) -> Self {
        let is_by_stamps = self.video.clock.is_some_and(|clock| clock.is_by_stamps());
        self.video.may_run_at_wrong_pace = is_by_stamps && arrival.is_some_and(|arrival| arrival.contradicts_stamps());
        self.video.arrival = arrival;
        self
    }

    /// Judges the features and the session by the task's standard, unless the session may show another box. One that was
    /// set aside, or refused, counts nowhere, so only its features are judged.
    pub fn judged_by(mut self, standard: Option<&store::StandardRecord>, handedness: Option<Handedness>) -> Self {
        let standard = standard.filter(|_| self.box_question.is_none_or(BoxQuestion::counts));
        if let (Some(standard), Some(versions)) = (standard, &self.versions) {
            let definition = standard.definition.in_session(&self.hands, handedness);
            for feature in &mut self.features {
                feature.judge(standard, &definition, &versions.pipeline, handedness);
            }
            self.unknown_hand = standard.definition.has_unknown_hand(&self.hands, handedness);
            let by_target = |target: &Target| {
                let feature = self.features.iter().find(|feature| feature.key() == target.of);
                feature.map_or(Judgement::NotMeasured, |feature| {
                    feature.judgement_by(target, &versions.pipeline, handedness)
                })
            };
            let is_refused = self.quality.as_ref().is_some_and(|quality| quality["verdict"] == "refused");
            self.judgement = (!self.set_aside && !self.voided && !is_refused).then(|| definition.judge_all(by_target));
        }
        self
    }

    /// What the screen of a box shows of the session.
    pub fn as_last_recording(&self) -> LastRecording {
        LastRecording {
            session: self.id,
            task: self.task.name.clone(),
            status: self.status.name().to_owned(),
            judgement: self.judgement.map(|judgement| judgement.name().to_owned()),
            quality: self.quality.as_ref().and_then(|quality| quality["verdict"].as_str().map(str::to_owned)),
        }
    }

    /// Adds the verdict of the task's model of skill.
    pub fn with_verdict(self, verdict: Option<SkillVerdict>) -> Self {
        Self { verdict, ..self }
    }

    fn add_result(&mut self, result: store::SessionResult) {
        self.tools = result.tools;
        self.compare_in = ComparisonSpace::of_session(&result.features);
        self.features = result.features.into_iter().map(FeatureResponse::from).collect();
        for feature in &mut self.features {
            feature.in_hand = feature.tool.as_ref().and_then(|tool| result.hands.side_of(tool));
        }
        self.hands = result.hands;
        self.score = result.score;
        self.quality = Some(result.quality);
        self.versions = Some(result.versions);
        self.result = Some(result.id);
    }
}

/// Share that is tracked: the job's progress, or 1 once the session is done.
pub fn progress(status: SessionStatus, of_job: Option<f64>) -> f64 {
    if status == SessionStatus::Done { 1.0 } else { of_job.unwrap_or(0.0) }
}

fn named(id: impl ToString, name: impl Into<String>, code: impl Into<String>) -> NamedReference {
    NamedReference { id: id.to_string(), name: name.into(), code: code.into() }
}

impl From<FeatureRow> for FeatureResponse {
    fn from(row: FeatureRow) -> Self {
        let (family, is_lower_bound, needs_depth) = (row.family(), row.is_lower_bound(), row.needs_depth());
        let (better, informative, no_error_reason) = (row.better(), row.informative(), row.no_error_reason());
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
            in_hand: None,
            space: row.space,
            value,
            not_enough_reason: not_enough.as_deref().and_then(NotEnoughReason::of),
            not_enough,
            error,
            no_error_reason,
            no_error,
            is_lower_bound,
            needs_depth,
            better,
            informative: informative.map(|known| known.is_ok()),
            too_uncertain: informative.and_then(Result::err),
            target: None,
            judgement: None,
        }
    }
}

impl FeatureResponse {
    fn key(&self) -> StoredFeatureKey {
        StoredFeatureKey { feature: self.name.clone(), tool: self.tool.clone(), space: self.space }
    }

    /// The judgement of the value by a target.
    fn judgement_by(&self, target: &Target, pipeline: &str, handedness: Option<Handedness>) -> Judgement {
        let bar = self.error.map(|error| [error.low, error.high]);
        let (value, is_lower_bound) = (self.value, self.is_lower_bound);
        target.judge(ValueToJudge { value, bar, is_lower_bound, pipeline, handedness })
    }

    /// Judges the value by its target in `definition`, which is the standard with the session's tools for its hands. Of
    /// several, such as one for the left and one for the dominant hand, the one is shown that was missed.
    fn judge(
        &mut self,
        standard: &store::StandardRecord,
        definition: &StandardDefinition,
        pipeline: &str,
        handedness: Option<Handedness>,
    ) {
        let key = self.key();
        let targets = definition.targets.iter().zip(&standard.definition.targets);
        let judged = targets.filter(|(target, _)| key == target.of).map(|(target, stated)| {
            let judgement = self.judgement_by(target, pipeline, handedness);
            let rank = match judgement {
                Judgement::Fail => 0,
                Judgement::Pass => 2,
                _ => 1,
            };
            (rank, judgement, target, stated)
        });
        let Some((_, judgement, target, stated)) = judged.min_by_key(|(rank, ..)| *rank) else { return };
        // The whole bar lies on one side of the limit: the value says what the standard asks.
        if matches!(judgement, Judgement::Pass | Judgement::Fail) && self.informative.is_some() {
            (self.informative, self.too_uncertain) = (Some(true), None);
        }
        self.judgement = Some(judgement);
        let (limit, better, in_hand) = (target.limit, target.better, stated.of.in_hand);
        self.target = Some(FeatureLimit { limit, better, in_hand, standard: standard.version });
    }
}

impl From<Problem> for ProblemDocument {
    /// A stored problem of a job. It never was an answer, so its status is always 422.
    fn from(problem: Problem) -> Self {
        let Problem { slug, title, detail } = problem;
        Self { kind: format!("/problems/{slug}"), title, status: 422, detail, errors: Vec::new() }
    }
}
