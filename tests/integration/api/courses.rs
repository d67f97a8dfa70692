//! Course plans and people's progress in them, as a client sees them.

use reqwest::{Method, StatusCode};
use serde_json::{Value, json};

use super::centre::Centre;
use crate::planted::{DAY_MS, Planter, duration};
use crate::support::{Client, problem, read};
use trocar::time::{Clock, Day, SystemClock};

const COURSES: &str = "/api/v1/courses";

async fn set_standard_of_50_s(centre: &Centre) {
    let by = json!({"method": "fixed", "limit": 50.0, "unit": "s"});
    let body = json!({"targets": [{"feature": "duration", "by": by}], "rule": {"in_a_row": 2}});
    centre.administrator.make("/api/v1/tasks/peg/standards", body).await;
}

async fn group(centre: &Centre, name: &str) -> String {
    let groups = centre.administrator.read("/api/v1/groups").await;
    let found = groups["items"].as_array().unwrap().iter().find(|group| group["name"] == name).unwrap();
    found["id"].as_str().unwrap().to_owned()
}

async fn put(client: &Client, path: &str, body: Value) -> reqwest::Response {
    client.request(Method::PUT, path).json(&body).send().await.unwrap()
}

fn basics() -> Value {
    json!({"name": "Basics", "steps": [{"task": "peg", "sessions": 2, "within_days": 30}, {"task": "peg", "within_days": 3}]})
}

/// The date `days` days ago.
fn days_ago(days: i64) -> String {
    Day::of(SystemClock.now_ms() - days * DAY_MS).to_string()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_plan_is_made_read_changed_and_deleted() {
    let centre = Centre::open().await;
    set_standard_of_50_s(&centre).await;
    let made = centre.instructor.make(COURSES, basics()).await;
    let path = format!("{COURSES}/{}", made["id"].as_str().unwrap());
    assert_eq!(centre.trainee.read(&path).await["steps"], made["steps"]);
    assert_eq!((&made["steps"][0]["task"]["code"], &made["steps"][1]["sessions"]), (&json!("peg"), &Value::Null));
    let fewer = json!({"name": "Fewer", "steps": [{"task": made["steps"][0]["task"]["id"], "sessions": 1}]});
    problem(put(&centre.other_instructor, &path, fewer.clone()).await, 403, "forbidden").await;
    let changed = read(put(&centre.instructor, &path, fewer).await, StatusCode::OK).await;
    assert_eq!((&changed["name"], changed["steps"].as_array().unwrap().len()), (&json!("Fewer"), 1));
    assert_eq!(centre.instructor.read(COURSES).await["items"], json!([changed]));
    let last = centre.administrator.read("/api/v1/audit-entries?limit=1").await["items"][0].clone();
    assert_eq!((&last["who"], &last["action"], &last["called"]), (&json!("ines"), &json!("change"), &json!("Fewer")));
    assert_eq!(centre.instructor.delete(&path).await.status(), StatusCode::NO_CONTENT);
    problem(centre.instructor.get(&path).await, 404, "not-found").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_invalid_plan_is_refused_with_the_reason() {
    let centre = Centre::open().await;
    let make = async |steps: Value| centre.instructor.post(COURSES, json!({"name": "A", "steps": steps})).await;
    problem(make(json!([])).await, 422, "invalid").await;
    problem(make(json!([{"task": "peg", "sessions": 0}])).await, 422, "invalid").await;
    problem(make(json!([{"task": "none", "sessions": 1}])).await, 422, "unknown-reference").await;
    let refused = problem(make(json!([{"task": "peg"}])).await, 409, "conflict").await;
    assert!(refused["detail"].as_str().unwrap().contains("has no standard to pass yet: set one"), "{refused}");
    let made = read(make(json!([{"task": "peg", "sessions": 1}])).await, StatusCode::CREATED).await;
    problem(make(json!([{"task": "peg", "sessions": 2}])).await, 409, "taken").await;
    // A task or a plan that is in use cannot be deleted.
    let refused = problem(centre.administrator.delete("/api/v1/tasks/peg").await, 409, "in-use").await;
    assert!(refused["detail"].as_str().unwrap().contains("course plans"), "{refused}");
    let following = json!({"course": made["id"], "begins": "2026-01-05"});
    let path = format!("/api/v1/groups/{}/course", group(&centre, "One").await);
    for begins in ["2026-02-30", "5.1.2026", ""] {
        let wrong = put(&centre.instructor, &path, json!({"course": made["id"], "begins": begins})).await;
        problem(wrong, 422, "invalid").await;
    }
    for begins in ["9999-12-31", "0001-01-01", &days_ago(3_660), &days_ago(-3_660)] {
        let wrong = put(&centre.instructor, &path, json!({"course": made["id"], "begins": begins})).await;
        let refused = problem(wrong, 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], "begins", "{begins}: {refused}");
        assert!(refused["detail"].as_str().unwrap().contains("within ten years of today"), "{refused}");
    }
    read(put(&centre.instructor, &path, following).await, StatusCode::OK).await;
    let plan = format!("{COURSES}/{}", made["id"].as_str().unwrap());
    problem(centre.instructor.delete(&plan).await, 409, "in-use").await;
    assert_eq!(centre.instructor.delete(&path).await.status(), StatusCode::NO_CONTENT);
    problem(centre.instructor.delete(&path).await, 404, "not-found").await;
    assert_eq!(centre.instructor.delete(&plan).await.status(), StatusCode::NO_CONTENT);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_groups_table_and_a_trainees_own_view_show_the_same_progress() {
    let centre = Centre::open().await;
    set_standard_of_50_s(&centre).await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let course = centre.instructor.make(COURSES, basics()).await;
    let path = format!("/api/v1/groups/{}/course", group(&centre, "One").await);
    problem(centre.instructor.get(&path).await, 404, "not-found").await;
    let begins = days_ago(5);
    let following = json!({"course": course["id"], "begins": begins});
    let empty = read(put(&centre.instructor, &path, following).await, StatusCode::OK).await;
    assert_eq!((&empty["course"]["begins"], &empty["rows"][0]["next"]), (&json!(begins), &json!(1)));
    assert_eq!((&empty["steps"][0]["due"], &empty["steps"][1]["due"]), (&json!(days_ago(-25)), &json!(days_ago(2))));
    let groups = centre.instructor.read("/api/v1/groups").await;
    assert_eq!(groups["items"][0]["course"], empty["course"]);

    let ada = planter.trainee("ada").await;
    for (days, seconds) in [(4, 60.0), (3, 40.0), (2, 90.0)] {
        planter.session(ada, SystemClock.now_ms() - days * DAY_MS, vec![duration(seconds, 1.0)]).await;
    }
    let table = centre.instructor.read(&path).await;
    let row = &table["rows"][0];
    assert_eq!((&table["trainees"][0]["code"], &row["next"]), (&json!("ada"), &json!(2)));
    let sessions = centre.trainee.read("/api/v1/trainees/ada/progress?task=peg").await["sessions"].clone();
    let second = json!({"session": sessions[1]["id"], "at": sessions[1]["recorded_at"]});
    assert_eq!((&row["steps"][0]["state"], &row["steps"][0]["passed"]), (&json!("passed"), &second));
    let step = &row["steps"][1];
    assert_eq!((&step["state"], &step["sessions"], &step["missing"]), (&json!("in_work"), &json!(3), &json!(2)));
    assert_eq!((&step["overdue"], &row["steps"][0]["overdue"]), (&json!(true), &json!(false)));

    let own = centre.trainee.read("/api/v1/trainees/ada/courses").await["items"][0].clone();
    let own_steps: Vec<&Value> = own["steps"].as_array().unwrap().iter().map(|step| &step["progress"]).collect();
    assert_eq!(own_steps, row["steps"].as_array().unwrap().iter().collect::<Vec<_>>());
    assert_eq!((&own["next"], &own["course"], &own["group"]), (&json!(2), &table["course"], &Value::Null));
    let staff = centre.instructor.read("/api/v1/trainees/ada/courses").await;
    assert_eq!(staff["items"][0]["group"]["name"], "One");
}

#[tokio::test(flavor = "multi_thread")]
async fn courses_are_limited_to_people_in_the_callers_scope() {
    let centre = Centre::open().await;
    let course =
        centre.administrator.make(COURSES, json!({"name": "A", "steps": [{"task": "peg", "sessions": 1}]})).await;
    let following = json!({"course": course["id"], "begins": days_ago(0)});
    let one = format!("/api/v1/groups/{}/course", group(&centre, "One").await);
    problem(put(&centre.other_instructor, &one, following.clone()).await, 404, "not-found").await;
    problem(put(&centre.trainee, &one, following.clone()).await, 403, "forbidden").await;
    let nothing = json!({"course": "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44", "begins": days_ago(0)});
    problem(put(&centre.instructor, &one, nothing).await, 422, "unknown-reference").await;
    read(put(&centre.instructor, &one, following).await, StatusCode::OK).await;
    for (client, status, name) in [
        (&centre.other_instructor, 404, "not-found"),
        (&centre.trainee, 403, "forbidden"),
        (&centre.agent, 403, "forbidden"),
    ] {
        problem(client.get(&one).await, status, name).await;
        problem(client.delete(&one).await, status, name).await;
    }
    let own = "/api/v1/trainees/ada/courses";
    for client in [&centre.administrator, &centre.instructor, &centre.trainee] {
        assert_eq!(client.read(own).await["items"].as_array().unwrap().len(), 1);
    }
    for client in [&centre.other_instructor, &centre.other_trainee] {
        problem(client.get(own).await, 404, "not-found").await;
        assert_eq!(client.read("/api/v1/trainees/bob/courses").await["items"], json!([]));
    }
    problem(centre.agent.get(COURSES).await, 403, "forbidden").await;
    problem(centre.trainee.post(COURSES, json!({"name": "Mine", "steps": []})).await, 403, "forbidden").await;
    problem(centre.trainee.delete(&format!("{COURSES}/{}", course["id"].as_str().unwrap())).await, 403, "forbidden")
        .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_erased_trainee_leaves_every_course() {
    let centre = Centre::open().await;
    let course =
        centre.administrator.make(COURSES, json!({"name": "A", "steps": [{"task": "peg", "sessions": 1}]})).await;
    let path = format!("/api/v1/groups/{}/course", group(&centre, "One").await);
    put(&centre.instructor, &path, json!({"course": course["id"], "begins": days_ago(1)})).await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    planter.session(planter.trainee("ada").await, SystemClock.now_ms(), vec![duration(40.0, 1.0)]).await;
    assert_eq!(centre.instructor.read(&path).await["rows"][0]["steps"][0]["state"], "passed");
    assert_eq!(centre.instructor.delete("/api/v1/trainees/ada").await.status(), StatusCode::NO_CONTENT);
    let remaining = centre.instructor.read(&path).await;
    assert_eq!((&remaining["trainees"], &remaining["rows"]), (&json!([]), &json!([])));
}
