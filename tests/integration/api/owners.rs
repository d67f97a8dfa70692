//! Which groups own boxes, tasks and course plans, as clients see and set it.

use reqwest::StatusCode;
use serde_json::{Value, json};

use super::centre::Centre;
use crate::support::{Client, Service, problem, read};

/// Ids of groups one and two.
async fn groups(centre: &Centre) -> [Value; 2] {
    let listed = centre.administrator.read("/api/v1/groups").await["items"].clone();
    [listed[0]["id"].clone(), listed[1]["id"].clone()]
}

/// What a caller sees of the owners of a thing.
async fn seen(client: &Client, path: &str) -> (Value, bool) {
    let thing = client.read(path).await;
    (thing["groups"].clone(), thing["may_change"].as_bool().unwrap())
}

#[tokio::test(flavor = "multi_thread")]
async fn each_role_sees_its_own_groups_among_the_owners_and_whether_it_may_change() {
    let centre = Centre::open().await;
    let [one, two] = groups(&centre).await;
    let plan = json!({"name": "Basics", "steps": [{"task": "peg", "sessions": 1}]});
    let plan = centre.instructor.make("/api/v1/courses", plan).await;
    assert_eq!((&plan["groups"], &plan["may_change"]), (&json!([one]), &json!(true)));
    let plan = format!("/api/v1/courses/{}", plan["id"].as_str().unwrap());
    for noun in ["boxes", "tasks"] {
        let made = centre.instructor.make(&format!("/api/v1/{noun}"), json!({"name": "New", "code": "new"})).await;
        assert_eq!((&made["groups"], &made["may_change"]), (&json!([one]), &json!(true)), "{noun}");
    }
    for path in ["/api/v1/boxes/new", "/api/v1/tasks/new", &plan] {
        assert_eq!(seen(&centre.administrator, path).await, (json!([one]), true), "{path}");
        assert_eq!(seen(&centre.other_instructor, path).await, (json!([]), false), "{path}");
        assert_eq!(seen(&centre.trainee, path).await, (json!([]), false), "{path}");
        assert_eq!(seen(&centre.instructor, path).await, (json!([one]), true), "{path}");
    }
    let refused = problem(centre.other_instructor.delete("/api/v1/boxes/new").await, 403, "forbidden").await;
    let detail = refused["detail"].as_str().unwrap();
    assert!(detail.contains("administrators and the instructors of its groups"), "it says who may: {detail}");

    let give = |client: &Client, to: Value| {
        client.request(reqwest::Method::PATCH, "/api/v1/boxes/new").json(&json!({"groups": to}))
    };
    let unknown = give(&centre.instructor, json!([two])).send().await.unwrap();
    assert_eq!(problem(unknown, 422, "unknown-reference").await["field"], "groups");
    problem(give(&centre.instructor, json!([])).send().await.unwrap(), 409, "conflict").await;
    let shared = read(give(&centre.administrator, json!([one, two])).send().await.unwrap(), StatusCode::OK).await;
    assert_eq!(shared["groups"].as_array().unwrap().len(), 2);
    assert_eq!(seen(&centre.other_instructor, "/api/v1/boxes/new").await, (json!([two]), true));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_settings_widen_what_instructors_may_do() {
    let service = Service::start_with(|settings| {
        settings.rights.instructors_edit_all = true;
        settings.rights.instructors_erase_shared = true;
    });
    let centre = Centre::open_in(service.await).await;
    centre.administrator.make("/api/v1/tasks", json!({"name": "Knots", "code": "knots"})).await;
    assert_eq!(seen(&centre.instructor, "/api/v1/tasks/knots").await, (json!([]), true));
    let changed = centre.instructor.patch("/api/v1/tasks/knots", json!({"name": "Suturing"})).await;
    assert_eq!(read(changed, StatusCode::OK).await["name"], "Suturing");

    let ada = centre.administrator.read("/api/v1/trainees/ada").await["id"].clone();
    let [_, two] = groups(&centre).await;
    let path = format!("/api/v1/groups/{}/members", two.as_str().unwrap());
    centre.administrator.put(&path, json!({"trainees": [ada]})).await;
    assert_eq!(centre.instructor.read("/api/v1/trainees/ada").await["may_erase"], true);
    assert_eq!(centre.instructor.delete("/api/v1/trainees/ada").await.status(), StatusCode::NO_CONTENT);
}
