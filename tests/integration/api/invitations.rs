//! Invitations of trainees: accounts and links for their passwords, made with an enrolment or later, by staff who see
//! the trainee.

use std::time::Duration;

use reqwest::StatusCode;
use serde_json::{Value, json};
use trocar::time::ManualClock;

use super::centre::{Centre, PASSWORD, set_members};
use crate::support::{Client, Service, problem, read};

const ENROLMENTS: &str = "/api/v1/enrolments";
const INVITATIONS: &str = "/api/v1/invitations";
const ACCOUNTS: &str = "/api/v1/trainee-accounts";
const OWN: &str = "a password of one's own";
const DAY: Duration = Duration::from_secs(24 * 3600);

fn text(value: &Value) -> &str {
    value.as_str().unwrap()
}

async fn invite(by: &Client, trainees: &[&str], also_with_password: bool) -> Value {
    let rows: Vec<Value> = trainees.iter().map(|trainee| json!({"trainee": trainee})).collect();
    let body = json!({"invitations": rows, "also_with_password": also_with_password});
    read(by.post(INVITATIONS, body).await, StatusCode::OK).await
}

async fn use_link(service: &Service, secret: &str, new: &str) -> reqwest::Response {
    service.stranger().post("/api/v1/password-links/use", json!({"secret": secret, "new": new})).await
}

async fn assert_ended(service: &Service, secret: &str) {
    let open = service.stranger().post("/api/v1/password-links/open", json!({"secret": secret})).await;
    problem(open, 410, "gone").await;
    problem(use_link(service, secret, OWN).await, 410, "gone").await;
}

/// The account of a trainee, as this caller sees it in the list.
async fn account(by: &Client, code: &str) -> Option<Value> {
    let listed = by.read(ACCOUNTS).await;
    listed["items"].as_array().unwrap().iter().find(|one| one["code"] == code).cloned()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_list_makes_its_groups_and_accounts_in_one_step() {
    let centre = Centre::open().await;
    let rows = json!([
        {"name": "Cleo Novak", "group": "Course A"},
        {"name": "Dan Okoye", "code": "dan", "group": "Course A", "login": "Dan@Clinic.example"},
        {"name": "Eve", "group": "One"},
    ]);
    let options = json!({"rows": rows, "only_check": true, "make_groups": true, "invite": true});
    let checked = read(centre.instructor.post(ENROLMENTS, options).await, StatusCode::OK).await;
    let expected = json!({"enrolled": [], "problems": [], "new_groups": ["Course A"], "invitations": []});
    assert_eq!(checked, expected);
    let refused = centre.instructor.post(ENROLMENTS, json!({"rows": rows, "invite": true})).await;
    problem(refused, 422, "invalid").await;
    assert!(account(&centre.instructor, "dan").await.is_none(), "a check and a refusal change nothing");

    let options = json!({"rows": rows, "make_groups": true, "invite": true});
    let done = read(centre.instructor.post(ENROLMENTS, options).await, StatusCode::OK).await;
    assert_eq!(done["new_groups"], json!(["Course A"]));
    let invitations = done["invitations"].as_array().unwrap();
    let logins: Vec<&str> = invitations.iter().map(|one| text(&one["login"])).collect();
    assert_eq!(logins, ["cleo-novak", "dan@clinic.example", "eve"]);
    for (invitation, trainee) in invitations.iter().zip(done["enrolled"].as_array().unwrap()) {
        assert_eq!((&invitation["trainee"], &invitation["name"]), (&trainee["id"], &trainee["name"]));
    }
    let groups = centre.instructor.read("/api/v1/groups").await;
    let made = groups["items"].as_array().unwrap().iter().find(|one| one["name"] == "Course A").unwrap();
    assert_eq!((made["trainees"].as_array().unwrap().len(), made["instructors"].as_array().unwrap().len()), (2, 1));
    assert!(!centre.other_instructor.read("/api/v1/groups").await.to_string().contains("Course A"));

    let secret = text(&invitations[0]["secret"]);
    let person = read(use_link(&centre.service, secret, OWN).await, StatusCode::OK).await;
    assert_eq!((&person["login"], &person["role"]), (&json!("cleo-novak"), &json!("trainee")));
    assert_ended(&centre.service, secret).await;
    let cleo = centre.service.sign_in("cleo-novak", OWN).await;
    assert_eq!(cleo.read("/api/v1/me").await["trainee"], done["enrolled"][0]["id"]);
    assert_eq!(account(&centre.instructor, "cleo-novak").await.unwrap()["password"], "own");
    let dan = account(&centre.instructor, "dan").await.unwrap();
    assert_eq!((&dan["password"], &dan["link_expires_at"]), (&json!("missing"), &invitations[1]["expires_at"]));

    let audit = centre.administrator.read("/api/v1/audit-entries?limit=200").await;
    let by_ines = audit["items"].as_array().unwrap().iter().filter(|entry| entry["who"] == "ines");
    let mut changes: Vec<String> =
        by_ines.map(|entry| format!("{} {}", text(&entry["action"]), text(&entry["noun"]))).collect();
    changes.sort();
    let times = |what: &str, n: usize| vec![what.to_owned(); n];
    let expected = [
        times("create group", 1),
        times("create password_link", 3),
        times("create person", 3),
        times("create trainee", 3),
    ];
    assert_eq!(changes, expected.concat());
    let lists = [audit, centre.administrator.read("/api/v1/password-links").await];
    assert!(lists.iter().all(|list| invitations.iter().all(|one| !list.to_string().contains(text(&one["secret"])))));
}

#[tokio::test(flavor = "multi_thread")]
async fn rows_that_cannot_be_invited_or_grouped_are_all_named() {
    let centre = Centre::open().await;
    let rows = json!([
        {"name": "Cleo", "login": "ines"},
        {"name": "Dan", "group": "Two"},
        {"name": "Eve", "group": "x".repeat(121)},
        {"name": "Flo", "login": "flo"},
        {"name": "Gus", "login": "FLO"},
        {"name": "Hal", "login": "h a l"},
    ]);
    let check = json!({"rows": rows, "only_check": true, "make_groups": true, "invite": true});
    let checked = read(centre.instructor.post(ENROLMENTS, check).await, StatusCode::OK).await;
    let problems: Vec<String> = checked["problems"]
        .as_array()
        .unwrap()
        .iter()
        .map(|one| format!("{} {}", one["row"], text(&one["field"])))
        .collect();
    assert_eq!(problems, ["1 login", "2 group", "3 group", "5 login", "6 login"]);
    assert!(text(&checked["problems"][1]["message"]).contains("other instructors"), "{checked}");
    // An administrator sees group two, so it is no new group.
    let check = json!({"rows": [{"name": "Dan", "group": "Two"}], "only_check": true, "make_groups": true});
    let checked = read(centre.administrator.post(ENROLMENTS, check).await, StatusCode::OK).await;
    assert_eq!((&checked["problems"], &checked["new_groups"]), (&json!([]), &json!([])));
}

#[tokio::test(flavor = "multi_thread")]
async fn an_instructor_invites_their_own_trainees_and_no_account_of_staff() {
    let centre = Centre::open().await;
    let (instructor, administrator) = (&centre.instructor, &centre.administrator);
    instructor.make("/api/v1/trainees", json!({"name": "Cleo"})).await;
    let people = administrator.read("/api/v1/people").await;
    for person in people["items"].as_array().unwrap() {
        let id = text(&person["id"]);
        let body = json!({"invitations": [{"trainee": "cleo"}, {"trainee": id}], "also_with_password": true});
        problem(instructor.post(INVITATIONS, body.clone()).await, 422, "unknown-reference").await;
        problem(administrator.post(INVITATIONS, body).await, 422, "unknown-reference").await;
        problem(instructor.post("/api/v1/password-links", json!({"person": id})).await, 403, "forbidden").await;
        problem(
            instructor.patch(&format!("/api/v1/people/{id}"), json!({"role": "instructor"})).await,
            403,
            "forbidden",
        )
        .await;
    }
    let of_others = json!({"invitations": [{"trainee": "cleo"}, {"trainee": "bob"}], "also_with_password": true});
    problem(instructor.post(INVITATIONS, of_others).await, 422, "unknown-reference").await;
    assert_eq!(account(instructor, "cleo").await.unwrap()["person"], Value::Null, "all are made, or none");
    assert!(account(instructor, "bob").await.is_none());
    for role in ["administrator", "instructor", "trainee"] {
        let person = json!({"login": "mine", "name": "Mine", "role": role, "password": PASSWORD});
        problem(instructor.post("/api/v1/people", person).await, 403, "forbidden").await;
    }
    problem(centre.trainee.post(INVITATIONS, json!({"invitations": [{"trainee": "ada"}]})).await, 403, "forbidden")
        .await;
    let made = invite(instructor, &["cleo"], false).await;
    let person =
        read(use_link(&centre.service, text(&made["invitations"][0]["secret"]), OWN).await, StatusCode::OK).await;
    assert_eq!((&person["login"], &person["role"]), (&json!("cleo"), &json!("trainee")));
    let waiting = "/api/v1/trainees/cleo?can_be_taken_back=true";
    assert_eq!(instructor.delete(waiting).await.status(), StatusCode::NO_CONTENT);
    let erased = json!({"invitations": [{"trainee": "cleo"}], "also_with_password": true});
    problem(administrator.post(INVITATIONS, erased).await, 422, "unknown-reference").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_chosen_password_is_left_alone_unless_the_request_says_otherwise() {
    let centre = Centre::open().await;
    let made = invite(&centre.instructor, &["ada"], false).await;
    assert_eq!(made, json!({"invitations": [], "left_out": 1}));
    let made = invite(&centre.instructor, &["ada"], true).await;
    let secret = text(&made["invitations"][0]["secret"]).to_owned();
    centre.trainee.read("/api/v1/me").await; // until the link is used, nothing has changed
    let newer = invite(&centre.instructor, &["ada"], true).await;
    assert_ended(&centre.service, &secret).await;
    read(use_link(&centre.service, text(&newer["invitations"][0]["secret"]), OWN).await, StatusCode::OK).await;
    problem(centre.trainee.get("/api/v1/me").await, 401, "not-signed-in").await;
    centre.service.sign_in("ada", OWN).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_login_is_chosen_or_made_from_the_code_and_never_taken_from_another_account() {
    let centre = Centre::open().await;
    for (name, code) in [("Ines of the ward", "ines"), ("Cleo", "cleo"), ("Dan", "dan")] {
        centre.instructor.make("/api/v1/trainees", json!({"name": name, "code": code})).await;
    }
    let send = async |rows: Value| centre.instructor.post(INVITATIONS, json!({"invitations": rows})).await;
    for (rows, field) in [
        (json!([{"trainee": "dan"}, {"trainee": "cleo", "login": "omar"}]), "invitations[1].login"),
        (json!([{"trainee": "dan", "login": "c"}, {"trainee": "cleo", "login": "C"}]), "invitations[1].login"),
        (json!([{"trainee": "ada", "login": "ada-2"}]), "invitations[0].login"),
        (json!([{"trainee": "cleo", "login": "c leo"}]), "invitations[0].login"),
        (json!([]), "invitations"),
    ] {
        let refused = problem(send(rows).await, 422, "invalid").await;
        assert_eq!(refused["errors"][0]["field"], field, "{refused}");
    }
    let made = read(
        send(json!([{"trainee": "ines"}, {"trainee": "cleo", "login": "ines-2"}, {"trainee": "dan"}])).await,
        StatusCode::OK,
    )
    .await;
    let logins: Vec<&str> = made["invitations"].as_array().unwrap().iter().map(|one| text(&one["login"])).collect();
    assert_eq!(logins, ["ines-3", "ines-2", "dan"], "the instructor is `ines`, and given logins come first");
}

#[tokio::test(flavor = "multi_thread")]
async fn a_link_ends_when_its_maker_no_longer_sees_the_trainee() {
    let centre = Centre::open().await;
    let made = invite(&centre.instructor, &["ada"], true).await;
    let secret = text(&made["invitations"][0]["secret"]).to_owned();
    let people = centre.administrator.read("/api/v1/people").await;
    let ines = people["items"].as_array().unwrap().iter().find(|one| one["login"] == "ines").unwrap()["id"].clone();
    let renamed = centre.administrator.patch(&format!("/api/v1/people/{}", text(&ines)), json!({"name": "Inés"})).await;
    read(renamed, StatusCode::OK).await;
    let opened = centre.service.stranger().post("/api/v1/password-links/open", json!({"secret": secret})).await;
    assert_eq!(read(opened, StatusCode::OK).await["login"], "ada", "another name is no reason");
    set_members(&centre, "One", &["omar"], &["ada"]).await;
    assert_ended(&centre.service, &secret).await;
    assert_eq!(account(&centre.other_instructor, "ada").await.unwrap()["link_expires_at"], Value::Null);
    assert!(account(&centre.instructor, "ada").await.is_none());
    let made = invite(&centre.administrator, &["ada"], true).await;
    read(use_link(&centre.service, text(&made["invitations"][0]["secret"]), OWN).await, StatusCode::OK).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_first_link_is_valid_for_14_days_and_one_for_another_password_for_a_day() {
    let clock = ManualClock::at(1_800_000_000_000);
    let service = Service::start_with_clock(clock.clone()).await;
    let administrator = service.administrator().await;
    for name in ["Cleo", "Dan"] {
        administrator.make("/api/v1/trainees", json!({"name": name})).await;
    }
    let first = invite(&administrator, &["cleo", "dan"], false).await;
    read(use_link(&service, text(&first["invitations"][0]["secret"]), OWN).await, StatusCode::OK).await;
    let other = invite(&administrator, &["cleo"], true).await;
    clock.advance(DAY);
    assert_ended(&service, text(&other["invitations"][0]["secret"])).await;
    clock.advance(13 * DAY - Duration::from_secs(1));
    let secret = text(&first["invitations"][1]["secret"]);
    let opened = service.stranger().post("/api/v1/password-links/open", json!({"secret": secret})).await;
    read(opened, StatusCode::OK).await;
    clock.advance(Duration::from_secs(1));
    assert_ended(&service, secret).await;
}

#[tokio::test(flavor = "multi_thread")]
async fn an_instructor_makes_a_group_and_teaches_it() {
    let centre = Centre::open().await;
    let person = json!({"login": "nora", "name": "Nora", "role": "instructor", "password": PASSWORD});
    let made = centre.administrator.make("/api/v1/people", person).await;
    let nora = centre.service.sign_in("nora", PASSWORD).await;
    let refused = problem(nora.post("/api/v1/trainees", json!({"name": "Cleo"})).await, 409, "conflict").await;
    assert!(text(&refused["detail"]).contains("make one first"), "{refused}");
    let group = nora.make("/api/v1/groups", json!({"name": "Evening"})).await;
    assert_eq!((&group["instructors"], &group["trainees"]), (&json!([made["id"]]), &json!([])));
    nora.make("/api/v1/trainees", json!({"name": "Cleo"})).await;
    assert_eq!(account(&nora, "cleo").await.unwrap()["login"], Value::Null);
    assert!(account(&nora, "ada").await.is_none(), "a group of one's own shows no trainees of others");
    problem(nora.post("/api/v1/groups", json!({"name": "One"})).await, 409, "taken").await;
    let address = format!("/api/v1/groups/{}/members", text(&group["id"]));
    problem(nora.put(&address, json!({})).await, 403, "forbidden").await;
}
