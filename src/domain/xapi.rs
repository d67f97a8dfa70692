//! Sessions as xAPI statements, for learning record stores. What is written holds for versions 1.0.3 and 2.0 alike: it names no
//! version, which is the store's to set.
//!
//! | part | here |
//! |---|---|
//! | actor | the trainee's account: their id, at the service's address; no name, and no code, which may be made of one |
//! | verb | `passed` or `failed` where the task's standard could judge the session, else `completed` |
//! | object | the task, by its address |
//! | result | completion, success where it was judged, duration; features with their error bars as an extension |
//! | timestamp | when it was recorded |
//!
//! What is not known is absent: a session that nobody can judge has no `success`, and one without a model's score no `score`.

use serde::{Deserialize, Serialize};
use serde_json::{Map, Value, json};
use sha2::{Digest, Sha256};
use utoipa::ToSchema;

use super::session::{FeatureRow, Versions};
use super::standard::SessionJudgement;

/// What a statement is made of.
#[derive(Clone, Debug)]
pub struct Scored<'s> {
    /// The service's address, without a slash at its end.
    pub home: &'s str,
    /// Of the session.
    pub session: String,
    /// Of its result.
    pub result: String,
    /// The trainee's id.
    pub trainee: &'s str,
    /// The task's id and name.
    pub task: (String, &'s str),
    /// When it was recorded, RFC 3339.
    pub recorded_at: String,
    /// From the first frame to the last, s.
    pub duration_s: f64,
    /// The gate's verdict, where it gave one.
    pub verdict: Option<&'s str>,
    /// Who measured it, if not Trocar.
    pub tracker: Option<&'s str>,
    /// What made the numbers.
    pub versions: &'s Versions,
    /// What was measured.
    pub features: &'s [FeatureRow],
    /// The version of the standard that judged it, and what it said.
    pub judged: Option<(i64, SessionJudgement)>,
}

/// An xAPI statement.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Statement {
    /// A UUID; the same result under the same standard has the same.
    pub id: String,
    /// Who.
    pub actor: Actor,
    /// Did what.
    pub verb: Verb,
    /// Of what.
    pub object: Activity,
    /// How.
    pub result: Outcome,
    /// Where, and with what.
    pub context: Context,
    /// When it was recorded, RFC 3339.
    pub timestamp: String,
}

/// Who did it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "camelCase")]
pub struct Actor {
    /// `Agent`.
    pub object_type: String,
    /// By which they are known.
    pub account: Account,
}

/// An account of a system.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "camelCase")]
pub struct Account {
    /// The system's address.
    pub home_page: String,
    /// What they are called there.
    pub name: String,
}

/// What was done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Verb {
    /// Its IRI.
    pub id: String,
    /// For people, by language.
    #[schema(value_type = Object)]
    pub display: Map<String, Value>,
}

/// What it was done with.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
#[serde(rename_all = "camelCase")]
pub struct Activity {
    /// `Activity`.
    pub object_type: String,
    /// Its IRI.
    pub id: String,
    /// Type and name.
    #[schema(value_type = Object)]
    pub definition: Map<String, Value>,
}

/// What came of it.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Outcome {
    /// It was done.
    pub completion: bool,
    /// Was the standard kept? Absent where that is not known.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub success: Option<bool>,
    /// ISO 8601, to a hundredth of a second.
    pub duration: String,
    /// Features with error bars, the gate's verdict and versions, by IRI.
    #[schema(value_type = Object)]
    pub extensions: Map<String, Value>,
}

/// Where it was done.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct Context {
    /// The program.
    pub platform: String,
    /// The session's address, by IRI.
    #[schema(value_type = Object)]
    pub extensions: Map<String, Value>,
}

/// Statements by the page, as a learning record store gives them.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize, ToSchema)]
pub struct StatementResult {
    /// The statements, the newest session first.
    pub statements: Vec<Statement>,
    /// Address of the next page; empty on the last.
    pub more: String,
}

/// The statement of a session's result.
pub fn statement(of: &Scored<'_>) -> Statement {
    let verb = match of.judged {
        Some((_, SessionJudgement::Pass)) => "passed",
        Some((_, SessionJudgement::Fail)) => "failed",
        _ => "completed",
    };
    let (task, name) = (&of.task.0, of.task.1);
    Statement {
        id: id_of(&[of.result.as_str(), verb, &of.judged.map(|(version, _)| version.to_string()).unwrap_or_default()]),
        actor: Actor {
            object_type: "Agent".to_owned(),
            account: Account { home_page: of.home.to_owned(), name: of.trainee.to_owned() },
        },
        verb: Verb { id: format!("http://adlnet.gov/expapi/verbs/{verb}"), display: in_english(verb) },
        object: Activity {
            object_type: "Activity".to_owned(),
            id: format!("{}/api/v1/tasks/{task}", of.home),
            definition: object(json!({
                "type": "http://adlnet.gov/expapi/activities/simulation",
                "name": in_english(name),
            })),
        },
        result: Outcome {
            completion: true,
            success: match of.judged {
                Some((_, SessionJudgement::Pass)) => Some(true),
                Some((_, SessionJudgement::Fail)) => Some(false),
                _ => None,
            },
            duration: duration(of.duration_s),
            extensions: extensions(of),
        },
        context: Context {
            platform: "Trocar".to_owned(),
            extensions: one(of, "session", json!(format!("{}/api/v1/sessions/{}", of.home, of.session))),
        },
        timestamp: of.recorded_at.clone(),
    }
}

fn extensions(of: &Scored<'_>) -> Map<String, Value> {
    let mut extensions = one(of, "features", of.features.iter().map(feature).collect());
    extensions.extend(one(of, "versions", known(json!(of.versions))));
    extensions.extend(of.verdict.into_iter().flat_map(|verdict| one(of, "verdict", json!(verdict))));
    extensions.extend(of.tracker.into_iter().flat_map(|tracker| one(of, "tracker", json!(tracker))));
    extensions.extend(of.judged.into_iter().flat_map(|(version, _)| one(of, "standard", json!(version))));
    extensions
}

fn one(of: &Scored<'_>, name: &str, value: Value) -> Map<String, Value> {
    Map::from_iter([(format!("{}/xapi/{name}", of.home), value)])
}

fn feature(row: &FeatureRow) -> Value {
    let bar = row.error.as_ref().and_then(|error| error.as_ref().ok());
    known(json!({
        "name": row.name,
        "tool": row.tool,
        "space": row.space.name(),
        "unit": row.unit,
        "value": row.value.as_ref().ok(),
        "low": bar.map(|bar| bar.low),
        "high": bar.map(|bar| bar.high),
        "not_enough": row.value.as_ref().err(),
    }))
}

/// Without what is not known.
fn known(value: Value) -> Value {
    Value::Object(object(value).into_iter().filter(|(_, value)| !value.is_null()).collect())
}

fn object(value: Value) -> Map<String, Value> {
    match value {
        Value::Object(map) => map,
        _ => Map::new(),
    }
}

fn in_english(text: &str) -> Map<String, Value> {
    Map::from_iter([("en".to_owned(), text.into())])
}

/// ISO 8601, to a hundredth of a second: finer is not compared.
fn duration(seconds: f64) -> String {
    format!("PT{:.2}S", seconds.max(0.0))
}

/// A UUID of version 4 that depends on the parts alone. Our own ids are of version 7, which readers written for RFC 4122 refuse;
/// and a statement must not keep its id when it says something else.
fn id_of(parts: &[&str]) -> String {
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
        let scored = Scored {
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

    /// What sections 2.4 and 4 of the specification's part 2 ask of a statement, as far as one of ours can break it.
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
    fn every_statement_keeps_the_rules_and_says_only_what_is_known() {
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
    fn a_value_that_is_not_there_is_absent_with_the_reason() {
        let statement = of(None);
        let features = &statement["result"]["extensions"]["https://skills.example/xapi/features"];
        assert_eq!((&features[0]["value"], &features[0]["high"]), (&json!(61.25), &json!(61.45)));
        assert_eq!((features[1].get("value"), &features[1]["not_enough"]), (None, &json!("too few")));
    }

    #[test]
    fn what_says_something_else_has_another_id_and_the_same_has_the_same() {
        let [pass, fail, none] =
            [Some((3, SessionJudgement::Pass)), Some((3, SessionJudgement::Fail)), None].map(|j| of(j)["id"].clone());
        assert_eq!(pass, of(Some((3, SessionJudgement::Pass)))["id"]);
        assert!(pass != fail && pass != none && fail != none);
    }
}
