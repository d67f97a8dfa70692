//! Sessions as xAPI statements, for learning record stores. The statements are valid in xAPI 1.0.3 and 2.0: they name
//! no version, because the store sets it.
//!
//! | part | here |
//! |---|---|
//! | actor | the trainee's account: id at the service's address; no name and no code (it may derive from a name) |
//! | verb | `passed` or `failed` where the task's standard could judge the session, otherwise `completed` |
//! | object | the task, by its address |
//! | result | completion, success where it was judged, duration; features with their error bars as an extension |
//! | timestamp | time of the recording |
//!
//! Unknown values are absent: a session without a judgement has no `success`, a session without a model's score no
//! `score`.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};
use utoipa::ToSchema;

use super::session::{FeatureRow, Versions};
use super::standard::SessionJudgement;

/// A session's result: the input of a statement.
#[derive(Clone, Debug)]
pub struct ScoredSession<'s> {
    /// The service's address, without a slash at its end.
    pub home: &'s str,
    /// The session's id.
    pub session: String,
    /// The result's id.
    pub result: String,
    /// The trainee's id.
    pub trainee: &'s str,
    /// The task's id and name.
    pub task: (String, &'s str),
    /// Time of the recording, RFC 3339.
    pub recorded_at: String,
    /// From the first frame to the last, s.
    pub duration_s: f64,
    /// The quality gate's verdict, if there is one.
    pub verdict: Option<&'s str>,
    /// The tracker that measured the session, if not Trocar.
    pub tracker: Option<&'s str>,
    /// Versions that the numbers depend on.
    pub versions: &'s Versions,
    /// The measured features.
    pub features: &'s [FeatureRow],
    /// The version of the standard that judged the session, and its judgement.
    pub judged: Option<(i64, SessionJudgement)>,
}

/// An xAPI statement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Statement {
    /// A UUID; the same result under the same standard always has the same id.
    pub id: String,
    /// The trainee.
    pub actor: StatementActor,
    /// Passed, failed or completed.
    pub verb: Verb,
    /// The task.
    pub object: Activity,
    /// Success, duration and features.
    pub result: StatementOutcome,
    /// The program and the session.
    pub context: Context,
    /// Time of the recording, RFC 3339.
    pub timestamp: String,
}

/// The actor of a statement: a trainee.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "camelCase")]
pub struct StatementActor {
    /// `Agent`.
    pub object_type: String,
    /// The account that identifies the trainee.
    pub account: Account,
}

/// An account of a system.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "camelCase")]
pub struct Account {
    /// The system's address.
    pub home_page: String,
    /// The account's name in that system.
    pub name: String,
}

/// The verb of a statement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Verb {
    /// Its IRI.
    pub id: String,
    /// For people, by language.
    #[schema(value_type = Object)]
    pub display: Map<String, Value>,
}

/// The object of a statement: a task.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "camelCase")]
pub struct Activity {
    /// `Activity`.
    pub object_type: String,
    /// Its IRI.
    pub id: String,
    /// The task's type and name.
    #[schema(value_type = Object)]
    pub definition: Map<String, Value>,
}

/// The result part of a statement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StatementOutcome {
    /// Always true: the task was done.
    pub completion: bool,
    /// Whether the session met the standard; absent where unknown.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub success: Option<bool>,
    /// ISO 8601, to a hundredth of a second.
    pub duration: String,
    /// Features with error bars, the quality gate's verdict and versions, by IRI.
    #[schema(value_type = Object)]
    pub extensions: Map<String, Value>,
}

/// The context of a statement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Context {
    /// The program.
    pub platform: String,
    /// The session's address, by IRI.
    #[schema(value_type = Object)]
    pub extensions: Map<String, Value>,
}

/// A page of statements, in the form that learning record stores use.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StatementResult {
    /// The statements, the newest session first.
    pub statements: Vec<Statement>,
    /// Address of the next page; empty on the last.
    pub more: String,
}

/// The statement of a session's result.
pub fn statement(scored: &ScoredSession<'_>) -> Statement {
    let verb = match scored.judged {
        Some((_, SessionJudgement::Pass)) => "passed",
        Some((_, SessionJudgement::Fail)) => "failed",
        _ => "completed",
    };
    let (task, name) = (&scored.task.0, scored.task.1);
    Statement {
        id: statement_id(&[
            scored.result.as_str(),
            verb,
            &scored.judged.map(|(version, _)| version.to_string()).unwrap_or_default(),
        ]),
        actor: StatementActor {
            object_type: "Agent".to_owned(),
            account: Account { home_page: scored.home.to_owned(), name: scored.trainee.to_owned() },
        },
        verb: Verb { id: format!("http://adlnet.gov/expapi/verbs/{verb}"), display: english_text(verb) },
        object: Activity {
            object_type: "Activity".to_owned(),
            id: format!("{}/api/v1/tasks/{task}", scored.home),
            definition: object(json!({
                "type": "http://adlnet.gov/expapi/activities/simulation",
                "name": english_text(name),
            })),
        },
        result: StatementOutcome {
            completion: true,
            success: match scored.judged {
                Some((_, SessionJudgement::Pass)) => Some(true),
                Some((_, SessionJudgement::Fail)) => Some(false),
                _ => None,
            },
            duration: iso_duration(scored.duration_s),
            extensions: extensions(scored),
        },
        context: Context {
            platform: "Trocar".to_owned(),
            extensions: extension(
                scored,
                "session",
                json!(format!("{}/api/v1/sessions/{}", scored.home, scored.session)),
            ),
        },
        timestamp: scored.recorded_at.clone(),
    }
}

fn extensions(scored: &ScoredSession<'_>) -> Map<String, Value> {
    let mut extensions = extension(scored, "features", scored.features.iter().map(feature).collect());
    extensions.extend(extension(scored, "versions", without_nulls(json!(scored.versions))));
    extensions.extend(scored.verdict.into_iter().flat_map(|verdict| extension(scored, "verdict", json!(verdict))));
    extensions.extend(scored.tracker.into_iter().flat_map(|tracker| extension(scored, "tracker", json!(tracker))));
    extensions.extend(scored.judged.into_iter().flat_map(|(version, _)| extension(scored, "standard", json!(version))));
    extensions
}

fn extension(scored: &ScoredSession<'_>, name: &str, value: Value) -> Map<String, Value> {
    Map::from_iter([(format!("{}/xapi/{name}", scored.home), value)])
}

fn feature(row: &FeatureRow) -> Value {
    let bar = row.error.as_ref().and_then(|error| error.as_ref().ok());
    without_nulls(json!({
        "name": row.name,
        "tool": row.tool,
        "space": row.space.name(),
        "unit": row.unit,
        "value": row.value.as_ref().ok(),
        "low": bar.map(|bar| bar.low),
        "high": bar.map(|bar| bar.high),
        "is_lower_bound": row.is_lower_bound().then_some(true),
        "not_enough": row.value.as_ref().err(),
    }))
}

/// The object without its nulls.
fn without_nulls(value: Value) -> Value {
    Value::Object(object(value).into_iter().filter(|(_, value)| !value.is_null()).collect())
}

fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(map) => map,
        _ => Map::new(),
    }
}

fn english_text(text: &str) -> Map<String, Value> {
    Map::from_iter([("en".to_owned(), text.into())])
}

/// ISO 8601, to a hundredth of a second: xAPI stores compare no finer.
fn iso_duration(seconds: f64) -> String {
    format!("PT{:.2}S", seconds.max(0.0))
}

/// A version 4 UUID that depends only on the parts. Our own ids are version 7, which readers written for RFC 4122
/// refuse, and a statement with different content needs a different id.
fn statement_id(parts: &[&str]) -> String {
    let digest = Sha256::digest(parts.join("\n").as_bytes());
    let mut bytes = [0; 16];
    bytes.copy_from_slice(&digest[..16]);
    uuid::Builder::from_random_bytes(bytes).into_uuid().hyphenated().to_string()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::domain::session::{FeatureError, FeatureSpace};

    fn features() -> Vec<FeatureRow> {
        let row = |value: Result<f64, &str>| FeatureRow {
            name: "duration".to_owned(),
            title: "Duration".to_owned(),
            unit: "s".to_owned(),
            tool: None,
            space: FeatureSpace::Space3d,
            value: value.map_err(str::to_owned),
            error: value.ok().map(|at| Ok(FeatureError { sigma: 0.1, low: at - 0.2, high: at + 0.2, as_measured: at })),
        };
        vec![row(Ok(61.25)), row(Err("too few"))]
    }

    fn of(judged: Option<(i64, SessionJudgement)>) -> Value {
        let versions =
            Versions { pipeline: "8".into(), tracked_with: None, calibration: None, palette: None, model: None };
        let features = features();
        let scored = ScoredSession {
            home: "https://skills.example",
            session: "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44".to_owned(),
            result: "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a45".to_owned(),
            trainee: "t-17",
            task: ("0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a46".to_owned(), "Peg transfer"),
            recorded_at: "2026-11-21T20:14:00.000Z".to_owned(),
            duration_s: 61.256,
            verdict: Some("valid"),
            tracker: None,
            versions: &versions,
            features: &features,
            judged,
        };
        serde_json::to_value(statement(&scored)).unwrap()
    }

    /// Checks those rules of sections 2.4 and 4 of the specification's part 2 that our statements could break.
    fn assert_conforms(statement: &Value) {
        let keys = |value: &Value| value.as_object().unwrap().keys().cloned().collect::<Vec<_>>();
        let allowed = ["id", "actor", "verb", "object", "result", "context", "timestamp"];
        assert!(keys(statement).iter().all(|key| allowed.contains(&key.as_str())), "{statement}");
        let id = uuid::Uuid::parse_str(statement["id"].as_str().unwrap()).unwrap();
        assert_eq!((id.get_version_num(), id.get_variant()), (4, uuid::Variant::RFC4122));
        assert_eq!(keys(&statement["actor"]), ["account", "objectType"], "one identifier and no more");
        assert_eq!(statement["actor"]["objectType"], "Agent");
        assert_eq!(keys(&statement["actor"]["account"]), ["homePage", "name"]);
        let is_iri = |text: &str| text.starts_with("http") && text.contains("://") && !text.contains(' ');
        for iri in [&statement["verb"]["id"], &statement["object"]["id"], &statement["actor"]["account"]["homePage"]] {
            assert!(is_iri(iri.as_str().unwrap()), "{iri}");
        }
        assert_eq!(keys(&statement["verb"]), ["display", "id"]);
        assert_eq!(statement["object"]["objectType"], "Activity");
        let allowed = ["completion", "success", "duration", "extensions", "score", "response"];
        assert!(keys(&statement["result"]).iter().all(|key| allowed.contains(&key.as_str())));
        for extensions in [&statement["result"]["extensions"], &statement["context"]["extensions"]] {
            assert!(keys(extensions).iter().all(|key| is_iri(key)), "{extensions}");
        }
        assert_eq!(nulls(&statement["actor"]) + nulls(&statement["result"]) + nulls(&statement["object"]), 0);
        let time = statement["timestamp"].as_str().unwrap();
        assert!(crate::time::from_rfc3339(time).is_some() && time.ends_with('Z'));
    }

    fn nulls(value: &Value) -> usize {
        match value {
            Value::Null => 1,
            Value::Object(map) => map.values().map(nulls).sum(),
            Value::Array(items) => items.iter().map(nulls).sum(),
            _ => 0,
        }
    }

    #[test]
    fn every_statement_conforms_and_holds_only_known_values() {
        for (judged, verb, success) in [
            (None, "completed", None),
            (Some((3, SessionJudgement::Unknown)), "completed", None),
            (Some((3, SessionJudgement::Pass)), "passed", Some(true)),
            (Some((3, SessionJudgement::Fail)), "failed", Some(false)),
        ] {
            let statement = of(judged);
            assert_conforms(&statement);
            assert_eq!(statement["verb"]["id"], format!("http://adlnet.gov/expapi/verbs/{verb}"));
            assert_eq!(statement["result"].get("success").and_then(Value::as_bool), success);
            assert_eq!(statement["result"].get("score"), None, "no model scored it");
            assert_eq!(statement["result"]["duration"], "PT61.26S");
        }
    }

    #[test]
    fn a_missing_value_is_absent_and_has_a_reason() {
        let statement = of(None);
        let features = &statement["result"]["extensions"]["https://skills.example/xapi/features"];
        assert_eq!((&features[0]["value"], &features[0]["high"]), (&json!(61.25), &json!(61.45)));
        assert_eq!((features[1].get("value"), &features[1]["not_enough"]), (None, &json!("too few")));
    }

    #[test]
    fn statements_have_the_same_id_only_if_they_are_equal() {
        let [pass, fail, none] =
            [Some((3, SessionJudgement::Pass)), Some((3, SessionJudgement::Fail)), None].map(|j| of(j)["id"].clone());
        assert_eq!(pass, of(Some((3, SessionJudgement::Pass)))["id"]);
        assert!(pass != fail && pass != none && fail != none);
    }
}
