//! Ratings, comments, evidence and advice, as raters, trainees and strangers see them.

use std::sync::Arc;

use reqwest::StatusCode;
use serde_json::{Value, json};
use trocar::domain::evidence::{EvidenceRow, StretchRow};
use trocar::domain::feature::StoredFeatureKey;
use trocar::domain::session::FeatureSpace;
use trocar::motion::PIPELINE_VERSION;
use trocar::store::{Store, StoreSettings};
use trocar::time::SystemClock;

use super::centre::{Centre, PASSWORD, recording, session};
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration};
use crate::support::{Client, problem, read};

const MISSING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";

pub(super) fn goals(mark: u8) -> Value {
    let items: serde_json::Map<String, Value> =
        ["depth_perception", "bimanual_dexterity", "efficiency", "tissue_handling", "autonomy"]
            .iter()
            .map(|item| ((*item).to_owned(), json!(mark)))
            .collect();
    json!({"form": "goals", "items": items})
}

/// A second instructor of a group, signed in.
async fn colleague(centre: &Centre, login: &str, group: &str) -> Client {
    let groups = centre.administrator.read("/api/v1/groups").await;
    let group = groups["items"].as_array().unwrap().iter().find(|row| row["name"] == group).unwrap()["id"].clone();
    let account = json!({"login": login, "name": login, "role": "instructor", "password": PASSWORD, "groups": [group]});
    centre.administrator.make("/api/v1/people", account).await;
    centre.service.sign_in(login, PASSWORD).await
}

async fn session_of_ada(centre: &Centre) -> String {
    let made = session(&centre.instructor, "ada", recording(100, 1)).await;
    format!("/api/v1/sessions/{}", made["id"].as_str().unwrap())
}

fn count(list: &Value) -> usize {
    list["items"].as_array().unwrap().len()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_rater_is_blind_until_they_have_rated_and_the_trainee_sees_all() {
    let centre = Centre::open().await;
    let (at, second) = (session_of_ada(&centre).await, colleague(&centre, "iris", "One").await);
    let forms = centre.trainee.read("/api/v1/rating-forms").await;
    assert_eq!(forms["items"][1]["items"].as_array().unwrap().len(), 5);
    let (ratings, comments) = (format!("{at}/ratings"), format!("{at}/comments"));

    let first = centre.instructor.make(&ratings, goals(4)).await;
    assert_eq!((&first["total"], &first["own"], &first["blind"]), (&json!(20), &json!(true), &json!(true)));
    centre.instructor.make(&comments, json!({"from_s": 3.5, "text": "Marks: 4"})).await;
    centre.trainee.make(&comments, json!({"from_s": 1.0, "to_s": 2.0, "text": "I was lost here."})).await;

    // The second rater and the administrator see how many people have rated, but not the ratings.
    for client in [&second, &centre.administrator] {
        let seen = client.read(&ratings).await;
        assert_eq!((count(&seen), &seen["raters"][1]), (0, &json!({"form": "goals", "raters": 1})));
        let seen = client.read(&comments).await;
        assert_eq!((count(&seen), &seen["hidden"]), (1, &json!(1)), "only the trainee's own");
    }
    let given = second.make(&ratings, goals(2)).await;
    assert_eq!(given["blind"], true);
    assert_eq!((count(&second.read(&ratings).await), count(&second.read(&comments).await)), (2, 2));
    let again = second.make(&ratings, goals(4)).await;
    assert_eq!(again["blind"], false, "by now they could have read the other rating");
    assert_eq!(count(&second.read(&ratings).await), 2, "the latest rating of each rater");
    assert_eq!(count(&centre.administrator.read(&ratings).await), 0);

    let own = centre.trainee.read(&ratings).await;
    assert_eq!(count(&own), 2);
    assert!(own["items"].as_array().unwrap().iter().all(|rating| rating["own"] == false));
    assert_eq!(count(&centre.trainee.read(&comments).await), 2);
    problem(centre.trainee.post(&ratings, goals(5)).await, 403, "forbidden").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_rating_says_which_items_do_not_apply_and_has_a_remark() {
    let centre = Centre::open().await;
    let at = format!("{}/ratings", session_of_ada(&centre).await);
    let mut osats = json!({"form": "osats", "does_not_apply": ["use_of_assistants", "respect_for_tissue"],
                           "remark": "Calm.\nKeep the left tip in view.", "items": {"respect_for_tissue": null}});
    for item in ["time_and_motion", "instrument_handling", "knowledge_of_instruments", "flow", "knowledge_of_procedure"]
    {
        osats["items"][item] = json!(4);
    }
    osats["items"]["flow"] = json!(5);
    let given = centre.instructor.make(&at, osats.clone()).await;
    assert_eq!(given["applicable_total"], json!({"sum": 21, "out_of": 25, "items": 5}));
    assert_eq!((&given["total"], &given["remark"]), (&Value::Null, &osats["remark"]));
    let assistants =
        given["items"].as_array().unwrap().iter().find(|item| item["item"] == "use_of_assistants").unwrap();
    assert_eq!(assistants, &json!({"item": "use_of_assistants", "mark": null, "does_not_apply": true}));
    assert_eq!(centre.trainee.read(&at).await["items"][0]["remark"], osats["remark"], "the trainee reads it");
    assert_eq!(count(&centre.administrator.read(&at).await), 0, "other raters do not, before their own rating");
    let with = |key: &str, value: Value| {
        let mut body = osats.clone();
        body[key] = value;
        body
    };
    let mut marked = osats.clone();
    marked["items"]["use_of_assistants"] = json!(3);
    for (wrong, field) in [
        (marked, "does_not_apply"),
        (with("does_not_apply", json!(["charm"])), "does_not_apply"),
        (with("remark", json!("x".repeat(2001))), "remark"),
        (with("remark", json!(" ")), "remark"),
    ] {
        let refused = problem(centre.instructor.post(&at, wrong).await, 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], field, "{refused}");
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn a_task_is_rated_on_the_forms_that_it_uses() {
    let centre = Centre::open().await;
    let at = format!("{}/ratings", session_of_ada(&centre).await);
    let task = centre.instructor.read("/api/v1/tasks/peg").await;
    assert_eq!(task["rating_forms"], json!(["osats", "goals", "box_trainer"]), "all, unless it names some");
    let forms = centre.instructor.read("/api/v1/rating-forms").await;
    let own = &forms["items"][2];
    assert_eq!((&own["form"], &own["is_published"]), (&json!("box_trainer"), &json!(false)));
    assert!(own["items"].as_array().unwrap().iter().all(|item| item["source"].is_string()), "{own}");
    let choose = async |forms: Value| {
        let changed = centre.administrator.patch("/api/v1/tasks/peg", json!({"rating_forms": forms})).await;
        read(changed, StatusCode::OK).await["rating_forms"].clone()
    };
    assert_eq!(choose(json!(["box_trainer", "box_trainer"])).await, json!(["box_trainer"]));
    let refused = problem(centre.instructor.post(&at, goals(3)).await, 422, "invalid").await;
    assert_eq!(refused["errors"][0]["field"], "form");
    let marks =
        own["items"].as_array().unwrap().iter().map(|item| (item["name"].as_str().unwrap().to_owned(), json!(3)));
    let items: serde_json::Map<String, Value> = marks.collect();
    let given = centre.instructor.make(&at, json!({"form": "box_trainer", "items": items})).await;
    assert_eq!((&given["total"], &given["applicable_total"]["out_of"]), (&json!(18), &json!(30)));
    assert_eq!(choose(json!([])).await, task["rating_forms"]);
    centre.instructor.make(&at, goals(3)).await;
    let answer = centre.instructor.read("/api/v1/tasks/peg/agreement?form=box_trainer").await;
    let items = answer["items"].as_array().unwrap().len();
    assert_eq!((items, &answer["other_items"], &answer["withheld"]["reason"]), (6, &json!(0), &json!("too_few")));
    let made = centre.instructor.make("/api/v1/tasks", json!({"name": "Knots", "rating_forms": ["goals"]})).await;
    assert_eq!(made["rating_forms"], json!(["goals"]));
}

#[tokio::test(flavor = "multi_thread")]
async fn people_without_access_to_a_session_can_neither_read_nor_comment_on_it() {
    let centre = Centre::open().await;
    let at = session_of_ada(&centre).await;
    let made = centre.instructor.make(&format!("{at}/comments"), json!({"from_s": 3.5, "text": "Here."})).await;
    let comment = format!("{at}/comments/{}", made["id"].as_str().unwrap());
    for client in [&centre.other_instructor, &centre.other_trainee] {
        for part in ["ratings", "comments", "evidence", "advice"] {
            problem(client.get(&format!("{at}/{part}")).await, 404, "not-found").await;
            problem(client.get(&format!("/api/v1/sessions/{MISSING}/{part}")).await, 404, "not-found").await;
        }
        problem(client.post(&format!("{at}/comments"), json!({"from_s": 1, "text": "x"})).await, 404, "not-found")
            .await;
        problem(client.delete(&comment).await, 404, "not-found").await;
    }
    problem(centre.other_instructor.post(&format!("{at}/ratings"), goals(1)).await, 404, "not-found").await;
    problem(centre.agent.get(&format!("{at}/comments")).await, 403, "forbidden").await;
    for part in ["agreement", "correlations"] {
        let path = format!("/api/v1/tasks/peg/{part}?form=goals");
        problem(centre.trainee.get(&path).await, 403, "forbidden").await;
        centre.instructor.read(&path).await;
        problem(centre.instructor.get(&format!("/api/v1/tasks/peg/{part}?form=charm")).await, 400, "bad-request").await;
    }
    // Only the author may withdraw a comment of staff, and only once; not even the administrator may.
    problem(centre.administrator.delete(&comment).await, 404, "not-found").await;
    problem(centre.trainee.delete(&comment).await, 404, "not-found").await;
    assert_eq!(centre.instructor.delete(&comment).await.status(), StatusCode::NO_CONTENT);
    problem(centre.instructor.delete(&comment).await, 404, "not-found").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trainees_comment_is_deleted_by_its_author_the_own_instructors_and_administrators() {
    let centre = Centre::open().await;
    let comments = format!("{}/comments", session_of_ada(&centre).await);
    for client in [&centre.trainee, &centre.instructor, &centre.administrator] {
        let made = centre.trainee.make(&comments, json!({"from_s": 1, "text": "Here."})).await;
        assert_eq!((&made["own"], &made["may_delete"]), (&json!(true), &json!(true)));
        let comment = format!("{comments}/{}", made["id"].as_str().unwrap());
        problem(centre.other_instructor.delete(&comment).await, 404, "not-found").await;
        problem(centre.other_trainee.delete(&comment).await, 404, "not-found").await;
        let listed = client.read(&comments).await;
        assert_eq!(listed["items"][0]["may_delete"], true, "{listed}");
        assert_eq!(client.delete(&comment).await.status(), StatusCode::NO_CONTENT);
        problem(client.delete(&comment).await, 404, "not-found").await;
    }
    centre.instructor.make(&comments, json!({"from_s": 1, "text": "Here."})).await;
    let listed = centre.trainee.read(&comments).await;
    assert_eq!((&listed["items"][0]["own"], &listed["items"][0]["may_delete"]), (&json!(false), &json!(false)));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trainee_cannot_use_up_the_comments_of_a_session() {
    let centre = Centre::open().await;
    let comments = format!("{}/comments", session_of_ada(&centre).await);
    let comment = || json!({"from_s": 1, "text": "Here."});
    for _ in 0..100 {
        centre.trainee.make(&comments, comment()).await;
    }
    let refused = problem(centre.trainee.post(&comments, comment()).await, 409, "conflict").await;
    assert!(refused["detail"].as_str().unwrap().contains("withdraw one"), "{refused}");
    centre.instructor.make(&comments, comment()).await;
    centre.administrator.make(&comments, comment()).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn hostile_text_is_stored_unchanged_and_invalid_ratings_and_comments_are_refused() {
    let centre = Centre::open().await;
    let at = session_of_ada(&centre).await;
    let hostile = "<img src=x onerror=alert(1)>\n'); DROP TABLE comment; -- \u{202e}\u{1F600}";
    let made = centre.instructor.make(&format!("{at}/comments"), json!({"from_s": 2, "text": hostile})).await;
    assert_eq!(made["text"], hostile, "kept as it was typed, and sent as JSON");
    for bad in [
        json!({"from_s": -1, "text": "x"}),
        json!({"from_s": 5, "to_s": 4, "text": "x"}),
        json!({"from_s": 1e9, "text": "x"}),
        json!({"from_s": "soon", "text": "x"}),
        json!({"from_s": 1, "text": ""}),
        json!({"from_s": 1, "text": "x".repeat(2001)}),
        json!({"from_s": 1, "text": "a\u{0}b"}),
        json!({"from_s": 1, "text": "x", "person_id": MISSING}),
    ] {
        problem(centre.instructor.post(&format!("{at}/comments"), bad).await, 422, "invalid").await;
    }
    let mut lacking = goals(3);
    lacking["items"].as_object_mut().unwrap().remove("autonomy");
    let mut more = goals(3);
    more["items"]["<b>charm</b>"] = json!(5);
    for bad in [lacking, more, goals(0), goals(6), json!({"form": "charm", "items": {}}), json!({"form": "goals"})] {
        problem(centre.instructor.post(&format!("{at}/ratings"), bad).await, 422, "invalid").await;
    }
    for _ in 0..20 {
        centre.instructor.make(&format!("{at}/ratings"), goals(3)).await;
    }
    let refused = problem(centre.instructor.post(&format!("{at}/ratings"), goals(3)).await, 409, "conflict").await;
    assert!(refused["detail"].as_str().unwrap().contains("20 times"), "{refused}");
}

#[tokio::test(flavor = "multi_thread")]
async fn comments_and_ratings_are_erased_with_the_trainee_and_outlive_their_author() {
    let centre = Centre::open().await;
    let (at, second) = (session_of_ada(&centre).await, colleague(&centre, "iris", "One").await);
    second.make(&format!("{at}/ratings"), goals(3)).await;
    second.make(&format!("{at}/comments"), json!({"from_s": 2, "text": "PLANTED-MARKER"})).await;
    let people = centre.administrator.read("/api/v1/people").await;
    let iris =
        people["items"].as_array().unwrap().iter().find(|person| person["login"] == "iris").unwrap()["id"].clone();
    let gone = centre.administrator.delete(&format!("/api/v1/people/{}", iris.as_str().unwrap())).await;
    assert_eq!(gone.status(), StatusCode::NO_CONTENT);
    let (ratings, comments) =
        (centre.trainee.read(&format!("{at}/ratings")).await, centre.trainee.read(&format!("{at}/comments")).await);
    assert_eq!((&ratings["items"][0]["who"], &comments["items"][0]["who"]), (&Value::Null, &Value::Null));
    assert_eq!(centre.instructor.delete("/api/v1/trainees/ada").await.status(), StatusCode::NO_CONTENT);
    problem(centre.instructor.get(&format!("{at}/comments")).await, 404, "not-found").await;
    let database = centre.service.data.path().join("trocar.db");
    let settings = StoreSettings::default();
    let store = Store::open(&database, &settings, Arc::new(SystemClock)).await.unwrap();
    assert!(store.check().await.unwrap().is_empty());
}

fn key(feature: &str) -> StoredFeatureKey {
    StoredFeatureKey { feature: feature.to_owned(), tool: None, space: FeatureSpace::Space3d }
}

async fn advice_of_newest(centre: &Centre) -> Value {
    let list = centre.trainee.read("/api/v1/sessions").await;
    let newest = list["items"].as_array().unwrap().iter().map(|row| row["id"].as_str().unwrap()).max().unwrap();
    centre.trainee.read(&format!("/api/v1/sessions/{newest}/advice")).await
}

#[tokio::test(flavor = "multi_thread")]
async fn evidence_is_sent_as_stored_and_advice_only_if_the_limit_is_surely_missed() {
    let centre = Centre::open().await;
    let mut planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let ada = planter.trainee("ada").await;
    let stretch = StretchRow { from_s: 41.2, to_s: 47.9, amount: 6.7, share: Some(0.06), cause: None };
    planter.evidence = vec![EvidenceRow {
        of: key("duration"),
        what: Some("all_at_rest".to_owned()),
        unit: Some("s".to_owned()),
        stretches: vec![stretch],
        none: None,
    }];
    planter.session(ada, NEW_YEAR_MS, vec![duration(110.0, 4.0)]).await;
    let list = centre.trainee.read("/api/v1/sessions").await;
    let at = format!("/api/v1/sessions/{}", list["items"][0]["id"].as_str().unwrap());
    let evidence = centre.trainee.read(&format!("{at}/evidence")).await;
    assert_eq!(evidence["features"][0]["stretches"][0]["from_s"], 41.2, "{evidence}");
    let advice = format!("{at}/advice");
    assert_eq!(centre.trainee.read(&advice).await["none"]["reason"], "no_standard");

    let standard = |limit: f64| {
        let target = json!({"feature": "duration", "by": {"method": "fixed", "limit": limit, "unit": "s"}});
        json!({"targets": [target], "valid_from": "beginning"})
    };
    for (limit, sure) in [(100.0, true), (107.0, false), (130.0, false)] {
        centre.instructor.make("/api/v1/tasks/peg/standards", standard(limit)).await;
        let answer = centre.trainee.read(&advice).await;
        assert_eq!(count(&answer), usize::from(sure), "{answer}");
        if sure {
            let item = &answer["items"][0];
            assert_eq!(
                (&item["rule"], &item["limit"], &item["stretches"][0]["to_s"]),
                (&json!("rest_less"), &json!(100.0), &json!(47.9))
            );
            assert!(item["sentence"].as_str().unwrap().contains("0:41.2 to 0:47.9"), "{item}");
        } else {
            assert_eq!(answer["none"]["reason"], "nothing_sure");
        }
    }
    // A missed limit without stretches to show is not reported as kept.
    let steady = json!({"targets": [{"feature": "duration", "by": {"method": "fixed", "limit": 20.0, "unit": "s"}}]});
    centre.instructor.make("/api/v1/tasks/peg/standards", steady).await;
    planter.evidence[0].stretches.clear();
    planter.result(ada, NEW_YEAR_MS + DAY_MS / 2, vec![duration(110.0, 4.0)], (PIPELINE_VERSION, "valid")).await;
    let answer = advice_of_newest(&centre).await;
    assert_eq!(answer["none"]["reason"], "no_seconds", "{answer}");
    // A refused session gets no advice, even though its features miss the limit.
    let refused = (PIPELINE_VERSION, "refused");
    planter.result(ada, NEW_YEAR_MS + DAY_MS, vec![duration(110.0, 4.0)], refused).await;
    let answer = advice_of_newest(&centre).await;
    assert_eq!(answer["none"]["reason"], "refused", "{answer}");
    let waiting = session_of_ada(&centre).await;
    assert_eq!(centre.trainee.read(&format!("{waiting}/advice")).await["none"]["reason"], "not_scored");
    assert_eq!(centre.trainee.read(&format!("{waiting}/evidence")).await["features"], Value::Null);
}

#[tokio::test(flavor = "multi_thread")]
async fn agreement_and_correlations_use_only_people_in_the_callers_scope() {
    let centre = Centre::open().await;
    let second = colleague(&centre, "iris", "One").await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let group = centre.administrator.read("/api/v1/groups").await["items"].as_array().unwrap()[0].clone();
    for number in 0..11u8 {
        let code = format!("t{number}");
        let new = json!({"name": code, "code": code, "group": group["id"]});
        centre.administrator.make("/api/v1/trainees", new).await;
        let trainee = planter.trainee(&code).await;
        let bend = if number % 3 == 0 { 12.0 } else { 0.0 };
        planter.session(trainee, NEW_YEAR_MS, vec![duration(150.0 - 9.0 * f64::from(number) + bend, 2.0)]).await;
        let list = centre.administrator.read(&format!("/api/v1/sessions?trainee={code}")).await;
        let at = format!("/api/v1/sessions/{}/ratings", list["items"][0]["id"].as_str().unwrap());
        let [mut one, mut two] = [goals(1 + number / 3), goals(1 + (number + 1) / 3)];
        one["items"]["efficiency"] = json!(1 + number % 5);
        two["items"]["efficiency"] = json!(1 + number % 5);
        centre.instructor.make(&at, one).await;
        second.make(&at, two).await;
    }
    let answer = centre.instructor.read("/api/v1/tasks/peg/agreement?form=goals").await;
    assert_eq!((&answer["people"], &answer["raters"]), (&json!(11), &json!(2)), "{answer}");
    assert!(answer["single"]["value"].as_f64().unwrap() > 0.8, "{answer}");
    assert!(answer["mean"]["value"].as_f64() > answer["single"]["value"].as_f64(), "{answer}");
    let answer = centre.instructor.read("/api/v1/tasks/peg/correlations?form=goals").await;
    assert_eq!((&answer["people"], &answer["items"][0]["feature"]), (&json!(11), &json!("duration")), "{answer}");
    assert!(
        answer["items"][0]["rho"]["value"].as_f64().unwrap() < -0.7 && answer["items"][0]["found"] == true,
        "{answer}"
    );
    // The instructor of another group sees none of these people.
    for part in ["agreement", "correlations"] {
        let answer = centre.other_instructor.read(&format!("/api/v1/tasks/peg/{part}?form=goals")).await;
        assert_eq!((&answer["people"], &answer["withheld"]["reason"]), (&json!(0), &json!("too_few")), "{answer}");
    }
    let none = read(centre.instructor.get("/api/v1/tasks/peg/agreement?form=osats").await, StatusCode::OK).await;
    assert_eq!(none["withheld"]["reason"], "too_few");
}
