//! Lists of sessions: order, filters, counts; supervised attempts, claimed dates, and the same recording under two people.

use std::collections::BTreeMap;

use reqwest::{Method, StatusCode, header};
use serde_json::{Value, json};
use sqlx::Connection;
use sqlx::sqlite::SqliteConnection;
use trocar::domain::feature::FeatureKey;
use trocar::domain::hand::Hand;
use trocar::domain::session::{FeatureRow, FeatureSpace, SessionOutcome};
use trocar::domain::standard::MadeFrom;
use trocar::domain::trainee::Handedness;
use trocar::motion::PIPELINE_VERSION;
use trocar::motion::features::errors::NoErrorBar;
use trocar::random::Dice;
use trocar::time::to_rfc3339;

use super::centre::{Centre, recording, send, session};
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration, measured};
use crate::support::{Client, problem, read};

/// The tool of some results in the left hand, of some in the right one, of some in neither.
const HANDS_OF_SOME: &str = "
    UPDATE result SET left_tool = iif(rowid % 3 = 0, 'orange', NULL), right_tool = iif(rowid % 3 = 1, 'orange', NULL)";

const LIST: &str = "/api/v1/sessions?order=recorded";

/// All sessions of a list, read in pages of 7.
async fn all_of(client: &Client, list: &str) -> Vec<Value> {
    let (mut all, mut cursor) = (Vec::new(), String::new());
    loop {
        let page = client.read(&format!("{list}&limit=7{cursor}")).await;
        all.extend(page["items"].as_array().unwrap().iter().cloned());
        match page["next"].as_str() {
            Some(next) => cursor = format!("&cursor={next}"),
            None => return all,
        }
    }
}

fn text<'v>(of: &'v Value, field: &str) -> &'v str {
    of[field].as_str().unwrap()
}

fn ids(of: &[Value]) -> Vec<&str> {
    of.iter().map(|session| text(session, "id")).collect()
}

/// The outcome as the pages say it (`outcomeOf` in `static/parts/page/status.js`).
fn outcome(session: &Value) -> &str {
    match (text(session, "status"), session["box_question"].as_str(), session["quality"]["verdict"].as_str()) {
        _ if session["quarantined"] == true => "quarantined",
        ("done", Some("asked"), _) => "box_asked",
        ("done", Some("other_box"), _) => "other_box",
        ("done", _, Some("refused")) => "refused",
        ("done", ..) => match session["judgement"].as_str() {
            Some("pass") => "passed",
            Some("fail") => "missed",
            Some(_) => "undecided",
            None => "done",
        },
        (status, ..) => status,
    }
}

/// Each filter by outcome shows exactly the sessions with this outcome, newest recording first, and counts them.
async fn check_outcomes(client: &Client, all: &[Value]) -> BTreeMap<&'static str, usize> {
    let mut found = BTreeMap::new();
    for wanted in SessionOutcome::ALL {
        let with_care = |session: &Value| {
            session["quality"]["verdict"] == "usable_with_care"
                && ["passed", "missed", "undecided", "done"].contains(&outcome(session))
        };
        let matches = |session: &&Value| match wanted {
            SessionOutcome::UsableWithCare => with_care(session),
            _ => outcome(session) == wanted.name(),
        };
        let expected: Vec<Value> = all.iter().filter(matches).cloned().collect();
        let listed = all_of(client, &format!("{LIST}&outcome={wanted}")).await;
        assert_eq!(ids(&listed), ids(&expected), "{wanted}");
        let count = client.read(&format!("/api/v1/session-count?outcome={wanted}")).await;
        assert_eq!(count, json!({"matching": expected.len(), "all": all.len()}), "{wanted}");
        found.insert(wanted.name(), expected.len());
    }
    found
}

/// A feature near a limit: with its error bar, as a lower bound, without an error, or without a value.
fn random_feature(random: &mut Dice, name: &str, unit: &str, tool: Option<&str>, limit: f64) -> FeatureRow {
    let value = limit * (40 + random.pick(21)) as f64 / 50.0;
    let half = limit * random.pick(9) as f64 / 50.0;
    let row = measured(name, unit, tool, FeatureSpace::Space3d, value, half);
    match random.pick(6) {
        0 => FeatureRow { error: Some(Err(NoErrorBar::AtLeast.to_string())), ..row },
        1 => FeatureRow { error: None, ..row },
        2 => FeatureRow { value: Err("too few".to_owned()), error: None, ..row },
        _ => row,
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn each_outcome_is_found_as_the_service_judges_it() {
    let centre = Centre::open().await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let (trainee, mut random) = (planter.trainee("ada").await, Dice::new(46, "session lists"));
    for number in 0..60 {
        let at_ms = NEW_YEAR_MS + random.pick(100) as i64 * DAY_MS + number * 1000;
        let features = vec![
            random_feature(&mut random, "duration", "s", None, 50.0),
            random_feature(&mut random, "path_length", "mm", Some("orange"), 50.0),
            random_feature(&mut random, "economy_of_area", "1", Some("orange"), 0.5),
        ];
        let verdict = ["valid", "usable_with_care", "refused"][random.pick(3)];
        let pipeline = if number % 10 == 9 { "of before" } else { PIPELINE_VERSION };
        planter.result(trainee, at_ms, features, (pipeline, verdict)).await;
    }
    session(&centre.trainee, "ada", recording(100, 1)).await;
    let waiting = all_of(&centre.instructor, LIST).await.remove(0);
    for aside in all_of(&centre.instructor, LIST).await.iter().skip(1).step_by(9) {
        let path = format!("/api/v1/sessions/{}/edits", text(aside, "id"));
        centre.instructor.make(&path, json!({"kind": "set_aside", "why": "Interrupted."})).await;
    }
    let all = all_of(&centre.instructor, LIST).await;
    assert_eq!((all.len(), outcome(&all[0]), &all[0]["id"]), (61, "queued", &waiting["id"]));
    let times: Vec<(&str, &str)> = all.iter().map(|one| (text(one, "recorded_at"), text(one, "id"))).collect();
    assert!(times.is_sorted_by(|before, after| before > after), "{times:?}");
    let without_standard = check_outcomes(&centre.instructor, &all).await;
    assert_eq!(without_standard["passed"] + without_standard["missed"] + without_standard["undecided"], 0);

    let fixed = |feature: &str, tool: Value, unit: &str, limit: f64| json!({"feature": feature, "tool": tool, "by": {"method": "fixed", "limit": limit, "unit": unit}});
    let (short, path) = (fixed("duration", Value::Null, "s", 50.0), fixed("path_length", json!("orange"), "mm", 50.0));
    for targets in
        [json!([short]), json!([short, path]), json!([fixed("economy_of_area", json!("orange"), "1", 0.5), path])]
    {
        let standard = json!({"targets": targets, "rule": {"in_a_row": 1, "then_more": 0}, "valid_from": "beginning"});
        centre.administrator.make("/api/v1/tasks/peg/standards", standard).await;
        let all = all_of(&centre.instructor, LIST).await;
        let found = check_outcomes(&centre.instructor, &all).await;
        for outcome in ["missed", "undecided", "refused", "usable_with_care", "done", "queued"] {
            assert!(found[outcome] > 0, "{outcome}: {found:?}");
        }
    }
    check_hands_and_versions(&centre, &planter, short).await;
}

/// The same for limits of a hand, for limits that were computed from people, which judge only values of their program
/// version and hand, and for a version that judges later recordings only.
async fn check_hands_and_versions(centre: &Centre, planter: &Planter, short: Value) {
    let database = centre.service.data.path().join("trocar.db");
    let mut raw = SqliteConnection::connect(database.to_str().unwrap()).await.unwrap();
    sqlx::query(HANDS_OF_SOME).execute(&mut raw).await.unwrap();
    let check = async || check_outcomes(&centre.instructor, &all_of(&centre.instructor, LIST).await).await;
    // A preferred hand cannot be taken back, so the sessions without one come first.
    for preferred in [Value::Null, json!("left"), json!("right")] {
        let changed = centre.administrator.patch("/api/v1/trainees/ada", json!({"handedness": preferred})).await;
        assert!(changed.status().is_success(), "{preferred}");
        for hand in [Hand::Left, Hand::Right, Hand::Dominant, Hand::Other] {
            planter
                .standard(|standard| {
                    standard.targets.retain(|target| target.of.feature.name == "path_length");
                    for target in &mut standard.targets {
                        target.of.in_hand = Some(hand);
                        target.of.tool = None;
                    }
                })
                .await;
            let found = check().await;
            let is_known = !preferred.is_null() || matches!(hand, Hand::Left | Hand::Right);
            assert_eq!(found["passed"] + found["missed"] > 0, is_known, "{hand} {preferred}: {found:?}");
        }
    }
    // Two limits for the tool in one hand: ada prefers the right one now.
    planter
        .standard(|standard| {
            let mut stricter = standard.targets[0].clone();
            stricter.limit *= 0.5;
            (standard.targets[0].of.in_hand, stricter.of.in_hand) = (Some(Hand::Right), Some(Hand::Dominant));
            standard.targets.push(stricter);
        })
        .await;
    check().await;
    planter.standard(|standard| drop(standard.targets.pop())).await;
    for handedness in [None, Some(Handedness::Left)] {
        planter
            .standard(|standard| {
                for target in &mut standard.targets {
                    target.of = FeatureKey::of_tool(target.of.feature, Some("orange".to_owned()), target.of.space);
                    let pipeline = PIPELINE_VERSION.to_owned();
                    target.made_from = Some(MadeFrom { pipeline, fingerprint: None, handedness });
                }
            })
            .await;
        let found = check().await;
        assert_eq!(found["passed"] + found["missed"] > 0, handedness.is_none(), "{found:?}");
    }
    let before = check().await;
    let later = json!({"targets": [short], "rule": {"in_a_row": 1, "then_more": 0}});
    centre.administrator.make("/api/v1/tasks/peg/standards", later).await;
    assert_eq!(check().await, before, "a new version judges none of the earlier recordings");
}

#[tokio::test(flavor = "multi_thread")]
async fn sessions_are_found_by_words_dates_and_place() {
    let centre = Centre::open().await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let renamed = centre.administrator.patch("/api/v1/trainees/ada", json!({"name": "Özlem MÜLLER"})).await;
    assert!(renamed.status().is_success());
    let (ada, bob) = (planter.trainee("ada").await, planter.trainee("bob").await);
    // Recorded on days 2, 0, 1, as they arrive.
    for (trainee, day) in [(ada, 2), (ada, 0), (bob, 1)] {
        planter.session(trainee, NEW_YEAR_MS + day * DAY_MS, vec![duration(10.0, 1.0)]).await;
    }
    let days = async |client: &Client, filter: &str| -> Vec<i64> {
        let listed = all_of(client, &format!("/api/v1/sessions?{filter}")).await;
        let day = |one: &Value| (0..9).find(|day| text(one, "recorded_at") == to_rfc3339(NEW_YEAR_MS + day * DAY_MS));
        let days: Vec<i64> = listed.iter().map(|one| day(one).unwrap()).collect();
        let filter: Vec<&str> = filter.split('&').filter(|part| !part.starts_with("order=")).collect();
        let count = client.read(&format!("/api/v1/session-count?{}", filter.join("&"))).await;
        assert_eq!(count["matching"], json!(days.len()), "{filter:?}");
        days
    };
    let everyone = &centre.administrator;
    assert_eq!(days(everyone, "order=recorded").await, [2, 1, 0]);
    assert_eq!(days(everyone, "order=arrival").await, [1, 0, 2]);
    assert_eq!(days(everyone, "").await, [1, 0, 2], "programs that read the newest arrivals go on working");
    for (search, wanted) in [
        ("müller", vec![2, 0]),
        ("ÖZLEM", vec![2, 0]),
        ("özlem peg", vec![2, 0]),
        ("bob", vec![1]),
        ("CLIP.MP4", vec![2, 1, 0]),
        ("box-1 transfer", vec![2, 1, 0]),
        ("özlem bob", vec![]),
        ("%", vec![]),
        ("100%25_", vec![]),
    ] {
        assert_eq!(days(everyone, &format!("order=recorded&search={search}")).await, wanted, "{search}");
    }
    let (first, second) = (to_rfc3339(NEW_YEAR_MS), to_rfc3339(NEW_YEAR_MS + DAY_MS));
    for order in ["recorded", "arrival"] {
        let between = format!("order={order}&recorded_from={first}&recorded_before={second}");
        assert_eq!(days(everyone, &between).await, [0]);
        assert_eq!(days(everyone, &format!("order={order}&recorded_from={second}&trainee=ada")).await, [2]);
        assert_eq!(days(everyone, &format!("order={order}&box=box-1&task=peg&status=done&trainee=bob")).await, [1]);
    }
    assert_eq!(days(&centre.trainee, "order=recorded").await, [2, 0], "a trainee counts own sessions only");
    assert_eq!(centre.other_instructor.read("/api/v1/session-count").await, json!({"matching": 1, "all": 1}));

    let cursor = everyone.read("/api/v1/sessions?order=recorded&limit=1").await["next"].clone();
    let cursor = cursor.as_str().unwrap();
    let refused = problem(everyone.get(&format!("/api/v1/sessions?cursor={cursor}")).await, 422, "invalid").await;
    assert_eq!(refused["errors"][0]["field"], "cursor", "a cursor belongs to its order");
    for field in ["recorded_from", "recorded_before"] {
        let answer = everyone.get(&format!("/api/v1/sessions?{field}=yesterday")).await;
        assert_eq!(problem(answer, 422, "invalid").await["errors"][0]["field"], field);
    }
    for bad in ["outcome=good", "order=name", "search=", "search=a+b+c+d+e+f+g+h+i"] {
        let answer = everyone.get(&format!("/api/v1/sessions?{bad}")).await;
        problem(answer, 400, "bad-request").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn attempts_that_staff_saw_and_dates_that_trainees_claim_are_marked() {
    let centre = Centre::open().await;
    let stated = async |client: &Client, trainee: &str, salt: u64| {
        let path = format!(
            "/api/v1/sessions?trainee={trainee}&task=peg&box=box-1&filename=clip.mp4&recorded_at=2026-01-05T10:00:00Z"
        );
        let request = client.request(Method::POST, &path).header(header::CONTENT_TYPE, "video/mp4");
        read(request.body(recording(100, salt)).send().await.unwrap(), StatusCode::CREATED).await
    };
    let own = stated(&centre.trainee, "ada", 1).await;
    assert_eq!((&own["supervision"], &own["date_known"]), (&json!("none"), &json!(false)), "a trainee's word");
    let arrived = session(&centre.trainee, "ada", recording(100, 2)).await;
    assert_eq!(
        (&arrived["supervision"], &arrived["date_known"]),
        (&json!("none"), &json!(true)),
        "the service's clock"
    );
    let by_staff = stated(&centre.instructor, "ada", 4).await;
    assert_eq!((&by_staff["supervision"], &by_staff["date_known"]), (&json!("sent_by_staff"), &json!(true)));
    assert_eq!((&by_staff["supervised_by"], &by_staff["supervised_at"]), (&json!("ines"), &by_staff["created_at"]));

    let at = format!("/api/v1/sessions/{}", text(&own, "id"));
    let supervision = format!("{at}/supervision");
    problem(centre.trainee.put(&supervision, json!({"supervised": true})).await, 403, "forbidden").await;
    problem(centre.other_instructor.put(&supervision, json!({"supervised": true})).await, 404, "not-found").await;
    problem(centre.instructor.put(&supervision, json!({"supervised": "yes"})).await, 422, "invalid").await;
    let marked = read(centre.instructor.put(&supervision, json!({"supervised": true})).await, StatusCode::OK).await;
    assert_eq!((&marked["supervision"], &marked["supervised_by"]), (&json!("marked"), &json!("ines")));
    assert_eq!(marked["date_known"], false, "who saw an attempt may not know when it was recorded");
    let again = read(centre.administrator.put(&supervision, json!({"supervised": true})).await, StatusCode::OK).await;
    assert_eq!(again["supervised_by"], "ines", "the first mark stays");
    let progress = centre.trainee.read("/api/v1/trainees/ada/progress?task=peg").await;
    let step = progress["sessions"].as_array().unwrap().iter().find(|step| step["id"] == own["id"]).unwrap();
    assert_eq!((&step["supervision"], &step["date_known"]), (&json!("marked"), &json!(false)));
    let undone = read(centre.administrator.put(&supervision, json!({"supervised": false})).await, StatusCode::OK).await;
    assert_eq!(undone["supervision"], "none");
    let audit = centre.administrator.read("/api/v1/audit-entries?limit=3").await;
    let actions: Vec<&str> = audit["items"].as_array().unwrap().iter().map(|entry| text(entry, "action")).collect();
    assert_eq!(actions[..2], ["unsupervise", "supervise"], "{audit}");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_same_recording_under_two_people_is_named_to_staff() {
    let centre = Centre::open().await;
    let of_ada = session(&centre.trainee, "ada", recording(100, 7)).await;
    let at = |session: &Value| format!("/api/v1/sessions/{}", text(session, "id"));
    assert_eq!(centre.administrator.read(&at(&of_ada)).await["same_recording"], Value::Null);
    let of_bob = session(&centre.other_trainee, "bob", recording(100, 7)).await;
    for (this, other, code) in [(&of_ada, &of_bob, "bob"), (&of_bob, &of_ada, "ada")] {
        let same = centre.administrator.read(&at(this)).await["same_recording"].clone();
        assert_eq!((&same["sessions"][0]["id"], &same["sessions"][0]["trainee"]["code"]), (&other["id"], &json!(code)));
        assert_eq!(same["sessions"].as_array().unwrap().len(), 1);
    }
    for (client, own) in [
        (&centre.trainee, &of_ada),
        (&centre.other_trainee, &of_bob),
        (&centre.instructor, &of_ada),
        (&centre.other_instructor, &of_bob),
    ] {
        let same = client.read(&at(own)).await["same_recording"].clone();
        assert_eq!(same, json!({"sessions": []}), "there is one, of a person that the caller may not know");
    }
    // The same trainee's other task is no other person.
    centre.administrator.make("/api/v1/tasks", json!({"name": "Knots", "code": "knots"})).await;
    let erased = centre.administrator.delete(&at(&of_bob)).await;
    assert_eq!(erased.status(), StatusCode::NO_CONTENT);
    let path = "/api/v1/sessions?trainee=ada&task=knots&box=box-1&filename=clip.mp4";
    let request = centre.administrator.request(Method::POST, path).header(header::CONTENT_TYPE, "video/mp4");
    read(request.body(recording(100, 7)).send().await.unwrap(), StatusCode::CREATED).await;
    assert_eq!(centre.administrator.read(&at(&of_ada)).await["same_recording"], Value::Null);
    assert_eq!(send(&centre.trainee, "ada", recording(100, 7)).await.status(), StatusCode::CONFLICT);
}
