//! Certificates: issued once, never changed, marked when a session is, withdrawn, erased with the person; and what a
//! stranger learns.

use std::io::{Cursor, Read};
use std::path::Path;
use std::process::Output;

use reqwest::{Method, Response, StatusCode, header};
use serde_json::{Value, json};
use sqlx::sqlite::SqliteConnectOptions;
use sqlx::{ConnectOptions, Connection};
use trocar::settings::Settings;

use super::centre::Centre;
use crate::planted::{DAY_MS, NEW_YEAR_MS, Planter, duration};
use crate::process::program;
use crate::support::{Client, Service, problem, read};

const MISSING: &str = "0198c1f2-6a10-7d3e-9f00-5c3b8f1d2a44";
const OF_ADA: &str = "/api/v1/trainees/ada/certificates";

/// A centre whose trainee Ada has passed the task `peg` with two sessions.
async fn with_pass() -> (Centre, Planter) {
    with_pass_in(Centre::open().await).await
}

async fn with_pass_in(centre: Centre) -> (Centre, Planter) {
    let by = json!({"method": "fixed", "limit": 50.5, "unit": "s"});
    let standard = json!({"targets": [{"feature": "duration", "by": by}], "rule": {"in_a_row": 2, "then_more": 0}});
    centre.administrator.make("/api/v1/tasks/peg/standards", standard).await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    let ada = planter.trainee("ada").await;
    for day in 0..2 {
        planter.session(ada, NEW_YEAR_MS + day * DAY_MS, vec![duration(40.0, 1.0)]).await;
    }
    (centre, planter)
}

async fn issue(centre: &Centre, language: &str) -> Value {
    centre.instructor.make(OF_ADA, json!({"task": "peg", "language": language, "accept_local_address": true})).await
}

fn address(certificate: &Value) -> String {
    format!("/api/v1/certificates/{}", certificate["id"].as_str().unwrap())
}

fn check_of(certificate: &Value) -> String {
    format!("/api/v1/certificate-checks/{}", certificate["content"]["code"].as_str().unwrap())
}

async fn pdf(client: &Client, certificate: &Value) -> Vec<u8> {
    let answer = client.get(&format!("{}/pdf", address(certificate))).await;
    assert_eq!(answer.status(), StatusCode::OK);
    assert_eq!(answer.headers()[header::CONTENT_TYPE], "application/pdf");
    answer.bytes().await.unwrap().to_vec()
}

async fn send_file(client: &Client, file: Vec<u8>) -> Response {
    let request = client.request(Method::POST, "/api/v1/certificate-checks");
    request.header(header::CONTENT_TYPE, "application/pdf").body(file).send().await.unwrap()
}

async fn check_file(client: &Client, file: Vec<u8>) -> Value {
    read(send_file(client, file).await, StatusCode::OK).await
}

fn verify(file: &Path, how: &[&str]) -> Output {
    let mut command = program();
    command.arg("verify").arg(file).args(how).output().unwrap()
}

fn said(output: &Output) -> String {
    format!("{}{}", String::from_utf8_lossy(&output.stdout), String::from_utf8_lossy(&output.stderr))
}

async fn sessions_of_ada(centre: &Centre) -> Vec<String> {
    let progress = centre.administrator.read("/api/v1/trainees/ada/progress?task=peg").await;
    progress["sessions"].as_array().unwrap().iter().map(|step| step["id"].as_str().unwrap().to_owned()).collect()
}

#[tokio::test(flavor = "multi_thread")]
async fn what_was_issued_stays_when_standard_score_and_names_change() {
    let (centre, planter) = with_pass().await;
    let made = issue(&centre, "en").await;
    let content = &made["content"];
    assert_eq!((&content["trainee"], &content["task"]), (&json!("ada"), &json!("Peg transfer")));
    assert_eq!((&content["issuer"], &content["basis"]), (&json!("ines"), &json!("rule")));
    assert_eq!(content["standard"]["limits"], json!(["Duration: at most 50.5 s"]));
    assert_eq!(content["standard"]["rule"], "2 passes in a row");
    assert_eq!(content["earned_on"], "2026-01-02");
    let numbers: Vec<&Value> = content["sessions"].as_array().unwrap().iter().map(|one| &one["number"]).collect();
    assert_eq!(numbers, [&json!(1), &json!(2)]);
    let german = issue(&centre, "de").await;
    assert_eq!(german["content"]["standard"]["limits"], json!(["Dauer: höchstens 50,5 s"]));
    let file = pdf(&centre.trainee, &made).await;
    assert!(file.starts_with(b"%PDF-1.7"));

    planter.standard(|standard| standard.targets[0].limit = 5.0).await;
    centre.administrator.patch("/api/v1/trainees/ada", json!({"name": "Ada Changed"})).await;
    centre.administrator.patch("/api/v1/tasks/peg", json!({"name": "Changed"})).await;
    centre.administrator.put("/api/v1/centre", json!({"name": "Changed"})).await;
    let again = centre.trainee.read(&address(&made)).await;
    assert_eq!((&again["content"], &again["state"]), (content, &json!("valid")));
    assert_eq!(pdf(&centre.trainee, &made).await, file);
    assert_eq!(centre.service.stranger().read(&check_of(&made)).await["content"], *content);
    let listed = centre.trainee.read("/api/v1/certificates").await;
    assert_eq!(listed["items"].as_array().unwrap().len(), 2);
    assert_eq!(centre.other_trainee.read("/api/v1/certificates").await["items"], json!([]));
    let audit = centre.administrator.read("/api/v1/audit-entries?limit=20").await;
    let issued =
        |entry: &&Value| entry["action"] == "issue" && entry["noun"] == "certificate" && entry["who"] == "ines";
    assert_eq!(audit["items"].as_array().unwrap().iter().filter(issued).count(), 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_certificate_needs_a_pass_a_printable_name_and_is_issued_once() {
    let (centre, _) = with_pass().await;
    let new = json!({"task": "peg", "language": "en", "accept_local_address": true});
    let of_bob = "/api/v1/trainees/bob/certificates";
    problem(centre.administrator.post(of_bob, new.clone()).await, 409, "conflict").await;
    problem(centre.instructor.post(of_bob, new.clone()).await, 404, "not-found").await;
    problem(centre.trainee.post(OF_ADA, new.clone()).await, 403, "forbidden").await;
    for body in [json!({}), json!({"task": "peg"}), json!({"task": "peg", "language": "fr"})] {
        problem(centre.instructor.post(OF_ADA, body).await, 422, "invalid").await;
    }
    let unknown = json!({"task": "nowhere", "language": "en", "accept_local_address": true});
    problem(centre.instructor.post(OF_ADA, unknown).await, 422, "unknown-reference").await;
    centre.administrator.patch("/api/v1/trainees/ada", json!({"name": "王小明"})).await;
    let refused = problem(centre.instructor.post(OF_ADA, new.clone()).await, 422, "invalid").await;
    assert_eq!(refused["errors"][0]["field"], "trainee", "{refused}");
    assert!(refused["detail"].as_str().unwrap().contains('王'), "{refused}");
    centre.administrator.patch("/api/v1/trainees/ada", json!({"name": "Αδα Ђорђевић"})).await;
    let made = issue(&centre, "en").await;
    let twice = problem(centre.instructor.post(OF_ADA, new.clone()).await, 409, "conflict").await;
    assert!(twice["detail"].as_str().unwrap().contains("issued already"), "{twice}");
    let why = json!({"reason": "Name was wrong."});
    read(centre.administrator.post(&format!("{}/withdraw", address(&made)), why).await, StatusCode::OK).await;
    issue(&centre, "en").await;
}

#[tokio::test(flavor = "multi_thread")]
async fn a_file_with_one_byte_changed_is_refused_by_page_and_command() {
    let (centre, _) = with_pass().await;
    let made = issue(&centre, "de").await;
    let file = pdf(&centre.instructor, &made).await;
    let stranger = centre.service.stranger();
    let checked = check_file(&stranger, file.clone()).await;
    assert_eq!((&checked["signature"], &checked["certificate"]["state"]), (&json!("genuine"), &json!("valid")));
    assert_eq!(checked["certificate"]["content"], made["content"]);
    for at in [12, file.len() / 2, file.len() - 300, file.len() - 100, file.len() - 1] {
        let mut changed = file.clone();
        changed[at] ^= 1;
        let checked = check_file(&stranger, changed).await;
        assert_ne!(checked["signature"], "genuine", "byte {at}");
        assert_eq!(checked["certificate"], Value::Null);
    }
    assert_eq!(check_file(&stranger, b"%PDF-1.7\n".to_vec()).await["signature"], "not_a_certificate");
    problem(send_file(&stranger, vec![0; 2 * 1024 * 1024 + 1]).await, 413, "too-large").await;
    problem(stranger.post("/api/v1/certificate-checks", json!({})).await, 415, "unsupported-media-type").await;

    let folder = tempfile::tempdir().unwrap();
    let path = folder.path().join("certificate.pdf");
    std::fs::write(&path, &file).unwrap();
    let keys = stranger.read("/api/v1/certificate-keys").await;
    let id = keys["items"][0]["id"].as_str().unwrap();
    let pem = stranger.get(&format!("/api/v1/certificate-keys/{id}")).await.text().await.unwrap();
    let key = folder.path().join("key.pem");
    std::fs::write(&key, pem).unwrap();
    let (key, server) = (key.to_str().unwrap(), format!("http://{}", centre.service.address()));
    let data = centre.service.data.path().to_str().unwrap();
    let valid = verify(&path, &["--server", &server]);
    assert_eq!(valid.status.code(), Some(0), "{}", said(&valid));
    for words in ["Genuine and valid.", "ada", "Peg transfer", "Dauer: höchstens 50,5 s"] {
        assert!(said(&valid).contains(words), "{words} is not in {}", said(&valid));
    }
    let genuine = verify(&path, &["--key", key]);
    assert_eq!(genuine.status.code(), Some(0), "{}", said(&genuine));
    assert!(said(&genuine).contains("known to the centre only"), "{}", said(&genuine));
    assert_eq!(verify(&path, &["--data", data]).status.code(), Some(0));

    let mut changed = file.clone();
    changed[1000] ^= 1;
    let bad = folder.path().join("changed.pdf");
    std::fs::write(&bad, changed).unwrap();
    for how in [["--key", key], ["--server", &server], ["--data", data]] {
        let refused = verify(&bad, &how);
        assert_eq!(refused.status.code(), Some(1), "{}", said(&refused));
        assert!(said(&refused).contains("CHANGED"), "{}", said(&refused));
        assert!(!said(&refused).contains("Peg transfer"), "nothing of a changed file is repeated");
    }
    let why = json!({"reason": "The wrong person was recorded."});
    read(centre.administrator.post(&format!("{}/withdraw", address(&made)), why).await, StatusCode::OK).await;
    for how in [["--server", &server], ["--data", data]] {
        let refused = verify(&path, &how);
        assert_eq!(refused.status.code(), Some(1));
        assert!(said(&refused).contains("WITHDRAWN on 20"), "{}", said(&refused));
        assert!(said(&refused).contains("The wrong person was recorded."));
    }
    assert_eq!(verify(&folder.path().join("missing.pdf"), &["--key", key]).status.code(), Some(2));
    assert_eq!(verify(&path, &["--key", path.to_str().unwrap()]).status.code(), Some(2));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_withdrawn_certificate_says_so_and_only_administrators_decide() {
    let (centre, _) = with_pass().await;
    let made = issue(&centre, "en").await;
    let (at, check) = (address(&made), check_of(&made));
    let why = json!({"reason": "Another person was recorded."});
    for client in [&centre.instructor, &centre.trainee] {
        problem(client.post(&format!("{at}/withdraw"), why.clone()).await, 403, "forbidden").await;
    }
    problem(centre.administrator.post(&format!("{at}/withdraw"), json!({"reason": " "})).await, 422, "invalid").await;
    problem(centre.administrator.post(&format!("{at}/reinstate"), why.clone()).await, 409, "conflict").await;
    problem(centre.instructor.post(&format!("{at}/keep"), why.clone()).await, 409, "conflict").await;
    let withdrawn = centre.administrator.post(&format!("{at}/withdraw"), why.clone()).await;
    assert_eq!(read(withdrawn, StatusCode::OK).await["state"], "withdrawn");
    problem(centre.administrator.post(&format!("{at}/withdraw"), why.clone()).await, 409, "conflict").await;
    let seen = centre.service.stranger().read(&check).await;
    assert_eq!((&seen["state"], &seen["reason"]), (&json!("withdrawn"), &json!("Another person was recorded.")));
    let file = pdf(&centre.trainee, &made).await;
    let checked = check_file(&centre.service.stranger(), file).await;
    assert_eq!((&checked["signature"], &checked["certificate"]["state"]), (&json!("genuine"), &json!("withdrawn")));
    let list = centre.administrator.read("/api/v1/certificates?state=withdrawn").await;
    assert_eq!(list["items"].as_array().unwrap().len(), 1);
    assert_eq!(centre.administrator.read("/api/v1/certificates?state=valid").await["items"], json!([]));
    let back = json!({"reason": "It was the right person."});
    let back = read(centre.administrator.post(&format!("{at}/reinstate"), back).await, StatusCode::OK).await;
    let events: Vec<&str> =
        back["events"].as_array().unwrap().iter().map(|one| one["event"].as_str().unwrap()).collect();
    assert_eq!(events, ["issued", "withdrawn", "reinstated"]);
    assert_eq!(centre.service.stranger().read(&check).await["reason"], Value::Null);
    let own = centre.trainee.read(&at).await;
    assert_eq!(own["events"][1]["reason"], "Another person was recorded.");
    assert_eq!((&own["events"][2]["reason"], &own["events"][2]["who"]), (&Value::Null, &Value::Null));
}

#[tokio::test(flavor = "multi_thread")]
async fn moved_edited_and_erased_sessions_put_their_certificates_under_review() {
    let (centre, planter) = with_pass().await;
    let made = issue(&centre, "en").await;
    let (at, check) = (address(&made), check_of(&made));
    let stranger = centre.service.stranger();
    let sessions = sessions_of_ada(&centre).await;
    let marks = async || {
        let seen = stranger.read(&check).await;
        let marks = seen["marks"].as_array().unwrap().iter();
        let marks: Vec<(String, u64)> =
            marks.map(|mark| (mark["event"].as_str().unwrap().to_owned(), mark["session"].as_u64().unwrap())).collect();
        (seen["state"].as_str().unwrap().to_owned(), marks)
    };
    let keep = async || {
        let kept = centre.instructor.post(&format!("{at}/keep"), json!({"reason": "Nothing that matters."})).await;
        assert_eq!(read(kept, StatusCode::OK).await["state"], "valid");
        assert_eq!(marks().await, ("valid".to_owned(), Vec::new()));
    };
    planter.move_session(&sessions[1], "bob", "peg").await;
    assert_eq!(marks().await, ("under_review".to_owned(), vec![("moved_to_person".to_owned(), 2)]));
    let shown = stranger.read(&check).await;
    assert!(!shown.to_string().contains("bob"), "{shown}");
    planter.move_session(&sessions[1], "ada", "peg").await;
    assert_eq!(marks().await.1.len(), 2, "moving it back does not decide");
    keep().await;
    planter.trim(sessions[0].parse().unwrap()).await;
    assert_eq!(marks().await, ("under_review".to_owned(), vec![("session_changed".to_owned(), 1)]));
    keep().await;
    let erased = centre.administrator.delete(&format!("/api/v1/sessions/{}", sessions[0])).await;
    assert_eq!(erased.status(), StatusCode::NO_CONTENT);
    assert_eq!(marks().await, ("under_review".to_owned(), vec![("session_erased".to_owned(), 1)]));
    let why = json!({"reason": "The session was erased."});
    read(centre.administrator.post(&format!("{at}/withdraw"), why).await, StatusCode::OK).await;
    planter.move_session(&sessions[1], "bob", "peg").await;
    assert_eq!(marks().await, ("withdrawn".to_owned(), Vec::new()), "a withdrawn certificate stays withdrawn");
    let events = centre.administrator.read(&at).await["events"].as_array().unwrap().len();
    assert_eq!(events, 9, "issued, two moves, kept, edited, kept, erased, withdrawn, moved");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_address_that_works_only_here_is_confirmed_before_a_certificate_keeps_it() {
    let (centre, _) = with_pass().await;
    let body = json!({"task": "peg", "language": "en"});
    let refused = problem(centre.instructor.post(OF_ADA, body.clone()).await, 409, "conflict").await;
    let local = refused["local_address"].as_str().unwrap();
    assert!(local.starts_with("http://127.0.0.1"), "{refused}");
    let detail = refused["detail"].as_str().unwrap();
    assert!(detail.contains("public_url") && detail.contains("only on this computer"), "{detail}");
    assert_eq!(centre.administrator.read("/api/v1/certificates").await["items"], json!([]));
    let host = |host: &str| centre.instructor.clone().with("host", host);
    let inside = problem(host("192.168.1.20:8080").post(OF_ADA, body.clone()).await, 409, "conflict").await;
    assert_eq!(inside["local_address"], "http://192.168.1.20:8080");
    let of_bob = "/api/v1/trainees/bob/certificates";
    problem(centre.instructor.post(of_bob, body.clone()).await, 404, "not-found").await;
    let made = host("skills.example").make(OF_ADA, body).await;
    assert!(made["content"]["address"].as_str().unwrap().starts_with("http://skills.example/verify/"), "{made}");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_address_in_the_settings_that_works_only_here_is_confirmed_too() {
    let local = |settings: &mut Settings| {
        settings.http.public_url = Some("http://trocar.local:8080/".to_owned());
    };
    let (centre, _) = with_pass_in(Centre::open_in(Service::start_with(local).await).await).await;
    let body = json!({"task": "peg", "language": "en"});
    let client = centre.instructor.clone().with("host", "skills.example");
    let refused = problem(client.post(OF_ADA, body).await, 409, "conflict").await;
    assert_eq!(refused["local_address"], "http://trocar.local:8080");
    let made = issue(&centre, "en").await;
    assert!(made["content"]["address"].as_str().unwrap().starts_with("http://trocar.local:8080/verify/"), "{made}");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_erased_person_leaves_no_trace_in_a_certificate_and_its_address_says_so() {
    let (centre, _) = with_pass().await;
    centre.administrator.patch("/api/v1/trainees/ada", json!({"name": "Planted Marker"})).await;
    let made = issue(&centre, "en").await;
    let (check, stranger) = (check_of(&made), centre.service.stranger());
    let file = pdf(&centre.administrator, &made).await;
    assert_eq!(centre.instructor.delete("/api/v1/trainees/ada?can_be_taken_back=true").await.status(), 204);
    let hidden = stranger.read(&check).await;
    assert_eq!((&hidden["state"], &hidden["content"]), (&json!("erased"), &Value::Null), "while the erasure waits");
    let waiting = centre.administrator.read("/api/v1/pending-erasures").await;
    assert_eq!(hidden["state_at"], waiting["items"][0]["requested_at"], "the day of the request");
    assert_ne!(hidden["state_at"], made["state_at"]);
    problem(centre.administrator.get(&address(&made)).await, 404, "not-found").await;
    assert_eq!(centre.administrator.read("/api/v1/certificates").await["items"], json!([]));
    assert_eq!(centre.administrator.delete("/api/v1/trainees/ada").await.status(), StatusCode::NO_CONTENT);
    let erased = stranger.read(&check).await;
    assert_eq!(
        (&erased["state"], &erased["content"], &erased["reason"]),
        (&json!("erased"), &Value::Null, &Value::Null)
    );
    assert_eq!(check_file(&stranger, file).await["certificate"]["state"], "erased");
    problem(centre.administrator.get(&address(&made)).await, 404, "not-found").await;
    let data = centre.service.stop().await;
    let database = std::fs::read(data.path().join("trocar.db")).unwrap();
    assert!(!database.windows(14).any(|bytes| bytes == b"Planted Marker"));
}

#[tokio::test(flavor = "multi_thread")]
async fn a_replaced_key_still_verifies_and_its_secret_is_gone() {
    let (centre, _) = with_pass().await;
    let stranger = centre.service.stranger();
    let old = issue(&centre, "en").await;
    let old_file = pdf(&centre.administrator, &old).await;
    let replaced = centre.administrator.make("/api/v1/certificate-keys", json!({})).await;
    let new = issue(&centre, "de").await;
    assert_eq!(new["content"]["key"], replaced["id"]);
    assert_ne!(old["content"]["key"], replaced["id"]);
    for (certificate, file) in [(&old, old_file), (&new, pdf(&centre.administrator, &new).await)] {
        let checked = check_file(&stranger, file).await;
        assert_eq!((&checked["signature"], &checked["key"]), (&json!("genuine"), &certificate["content"]["key"]));
    }
    let keys = stranger.read("/api/v1/certificate-keys").await;
    let retired: Vec<bool> =
        keys["items"].as_array().unwrap().iter().map(|key| key["retired_at"].is_string()).collect();
    assert_eq!(retired, [false, true]);
    let other = Service::start().await;
    let file = pdf(&centre.administrator, &new).await;
    assert_eq!(check_file(&other.stranger(), file).await["signature"], "unknown_key");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_check_of_the_data_folder_finds_a_certificate_that_was_changed() {
    let (centre, _) = with_pass().await;
    let made = issue(&centre, "en").await;
    let data = centre.service.stop().await;
    let check = || program().args(["admin", "check", "--data"]).arg(data.path()).output().unwrap();
    let said_of_it = |output: &Output| said(output).contains(made["id"].as_str().unwrap());
    assert!(!said_of_it(&check()), "{}", said(&check()));
    let options = SqliteConnectOptions::new().filename(data.path().join("trocar.db"));
    let mut database = options.connect().await.unwrap();
    let change = "UPDATE certificate SET pdf = CAST(replace(CAST(pdf AS TEXT), 'v1', 'v2') AS BLOB)";
    let refused = sqlx::query(change).execute(&mut database).await.unwrap_err();
    assert!(refused.to_string().contains("never changes"), "{refused}");
    sqlx::query("DROP TRIGGER certificate_stays").execute(&mut database).await.unwrap();
    sqlx::query(change).execute(&mut database).await.unwrap();
    database.close().await.unwrap();
    let found = check();
    assert!(said_of_it(&found), "{}", said(&found));
    assert_eq!(found.status.code(), Some(1));
}

#[tokio::test(flavor = "multi_thread")]
async fn an_unknown_code_gets_one_plain_answer_and_guessing_is_slowed() {
    let (centre, _) = with_pass().await;
    let made = issue(&centre, "en").await;
    let stranger = centre.service.stranger();
    let mut answers = Vec::new();
    for code in ["0a1b2c3d4e5f6g7h8j9kambncp", "x", MISSING] {
        let answer = stranger.get(&format!("/api/v1/certificate-checks/{code}")).await;
        answers.push(problem(answer, 404, "not-found").await);
    }
    assert!(answers.windows(2).all(|pair| pair[0] == pair[1]), "{answers:?}");
    let typed = made["content"]["code"].as_str().unwrap().to_uppercase();
    assert_eq!(stranger.read(&format!("/api/v1/certificate-checks/{typed}")).await["state"], "valid");
    let mut is_slowed = false;
    for _ in 0..100 {
        let answer = stranger.get("/api/v1/certificate-checks/0a1b2c3d4e5f6g7h8j9kambncp").await;
        is_slowed |= answer.status() == StatusCode::TOO_MANY_REQUESTS;
    }
    assert!(is_slowed);
    assert_eq!(stranger.read(&check_of(&made)).await["state"], "valid", "a known code is still answered");
}

#[tokio::test(flavor = "multi_thread")]
async fn the_export_of_a_person_has_the_signed_files() {
    let (centre, _) = with_pass().await;
    let made = issue(&centre, "en").await;
    let answer = centre.trainee.get("/api/v1/trainees/ada/data.zip").await;
    let mut archive = zip::ZipArchive::new(Cursor::new(answer.bytes().await.unwrap().to_vec())).unwrap();
    let names: Vec<String> = archive.file_names().map(|name| name.unwrap().into_owned()).collect();
    let name = names.iter().find(|name| name.starts_with("certificates/")).unwrap();
    let mut file = Vec::new();
    archive.by_name(name).unwrap().read_to_end(&mut file).unwrap();
    assert_eq!(file, pdf(&centre.trainee, &made).await);
    let mut json = String::new();
    archive.by_name("certificates.json").unwrap().read_to_string(&mut json).unwrap();
    let json: Value = serde_json::from_str(&json).unwrap();
    assert_eq!(json[0]["content"], made["content"]);
}
