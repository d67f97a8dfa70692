//! Exports: everything about a person or the centre in a ZIP file, and the command of a backup by hand.

use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::process::Command;

use reqwest::{StatusCode, header};
use serde_json::{Value, json};

use super::centre::{Centre, recording, session};
use super::ratings::goals;
use crate::planted::{NEW_YEAR_MS, Planter};
use crate::support::{Client, poll, problem};

const OF_ADA: &str = "/api/v1/trainees/ada/data.zip";

/// The files of an export.
pub async fn export(client: &Client, path: &str) -> BTreeMap<String, Vec<u8>> {
    let answer = client.get(path).await;
    assert_eq!(
        (answer.status(), &answer.headers()[header::CONTENT_TYPE]),
        (StatusCode::OK, &"application/zip".parse().unwrap())
    );
    let bytes = answer.bytes().await.unwrap();
    let mut archive = zip::ZipArchive::new(Cursor::new(bytes)).unwrap();
    let mut files = BTreeMap::new();
    for index in 0..archive.len() {
        let mut file = archive.by_index(index).unwrap();
        let (name, mut content) = (file.name().unwrap().into_owned(), Vec::new());
        file.read_to_end(&mut content).unwrap();
        files.insert(name, content);
    }
    files
}

fn json_of(files: &BTreeMap<String, Vec<u8>>, ends_with: &str) -> Value {
    let (_, content) = files.iter().find(|(name, _)| name.ends_with(ends_with)).unwrap();
    serde_json::from_slice(content).unwrap()
}

#[tokio::test(flavor = "multi_thread")]
async fn a_trainee_gets_all_that_is_stored_about_them_and_nothing_of_others() {
    let centre = Centre::open().await;
    let video = recording(70_000, 1); // more than one piece
    let id = session(&centre.trainee, "ada", video.clone()).await["id"].as_str().unwrap().to_owned();
    session(&centre.administrator, "bob", recording(100, 2)).await;
    let comment = json!({"from_s": 1.0, "text": "calm hands"});
    centre.trainee.make(&format!("/api/v1/sessions/{id}/comments"), comment).await;
    let without = export(&centre.trainee, "/api/v1/trainees/ada/data.zip").await;
    let with = export(&centre.trainee, "/api/v1/trainees/ada/data.zip?videos=true").await;
    assert_eq!(with.iter().find(|(name, _)| name.ends_with("video.mp4")).unwrap().1, &video);
    assert!(!without.keys().any(|name| name.contains("video.")), "{:?}", without.keys());
    assert_eq!(json_of(&without, "profile.json")["account"]["login"], "ada");
    assert_eq!(json_of(&without, "profile.json")["groups"], json!(["One"]));
    assert_eq!(without.keys().filter(|name| name.ends_with("session.json")).count(), 1);
    let folder = without.keys().find(|name| name.contains(&id)).unwrap().rsplit_once('/').unwrap().0.to_owned();
    assert_eq!(json_of(&without, &format!("{folder}/session.json"))["id"], json!(id));
    assert_eq!(json_of(&without, &format!("{folder}/comments.json"))["items"][0]["text"], "calm hands");
    let audit = json_of(&without, "audit.json");
    assert!(audit.as_array().unwrap().iter().any(|entry| entry["action"] == "create" && entry["noun"] == "session"));
    let all: Vec<u8> = without.into_values().flatten().collect();
    assert!(!all.windows(3).any(|part| part == b"bob"), "nothing of another trainee");
}

#[tokio::test(flavor = "multi_thread")]
async fn each_role_exports_what_it_sees() {
    let centre = Centre::open().await;
    for client in [&centre.administrator, &centre.instructor, &centre.trainee] {
        assert!(export(client, "/api/v1/trainees/ada/data.zip").await.contains_key("profile.json"));
    }
    for client in [&centre.other_instructor, &centre.other_trainee] {
        problem(client.get("/api/v1/trainees/ada/data.zip").await, 404, "not-found").await;
    }
    problem(centre.agent.get("/api/v1/trainees/ada/data.zip").await, 403, "forbidden").await;
    for client in [&centre.instructor, &centre.trainee, &centre.agent] {
        problem(client.get("/api/v1/data.zip").await, 403, "forbidden").await;
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_instructors_export_names_neither_the_account_nor_groups_of_others() {
    let centre = Centre::open().await;
    let groups = centre.administrator.read("/api/v1/groups").await;
    let two = groups["items"].as_array().unwrap().iter().find(|group| group["name"] == "Two").unwrap();
    let ada = centre.administrator.read("/api/v1/trainees/ada").await["id"].clone();
    let path = format!("/api/v1/groups/{}/members", two["id"].as_str().unwrap());
    let put = centre.administrator.put(&path, json!({"instructors": [], "trainees": [ada]})).await;
    assert!(put.status().is_success(), "{}", put.text().await.unwrap());
    let files = export(&centre.instructor, OF_ADA).await;
    let profile = json_of(&files, "profile.json");
    assert_eq!(
        (&profile["account"], &profile["sign_ins"], &profile["groups"]),
        (&Value::Null, &json!([]), &json!(["One"]))
    );
    assert!(!files.contains_key("audit.json"));
    for client in [&centre.trainee, &centre.administrator] {
        let files = export(client, OF_ADA).await;
        let profile = json_of(&files, "profile.json");
        assert_eq!((&profile["account"]["login"], &profile["groups"]), (&json!("ada"), &json!(["One", "Two"])));
        assert!(files.contains_key("audit.json"));
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_administrators_export_keeps_their_rating_blind_and_a_trainees_has_all() {
    let centre = Centre::open().await;
    let id = session(&centre.trainee, "ada", recording(100, 1)).await["id"].clone();
    let path = format!("/api/v1/sessions/{}/ratings", id.as_str().unwrap());
    centre.instructor.make(&path, goals(4)).await;
    let ratings = async |client: &Client, address: &str| {
        json_of(&export(client, address).await, "ratings.json")["items"].as_array().unwrap().len()
    };
    assert_eq!(ratings(&centre.administrator, OF_ADA).await, 0);
    assert_eq!(ratings(&centre.administrator, "/api/v1/data.zip").await, 0);
    assert_eq!(ratings(&centre.trainee, OF_ADA).await, 1);
    assert_eq!(centre.administrator.make(&path, goals(2)).await["blind"], json!(true));
    assert_eq!(ratings(&centre.administrator, OF_ADA).await, 2);
}

#[tokio::test(flavor = "multi_thread")]
async fn a_client_that_does_not_read_keeps_no_other_from_exporting() {
    let centre = Centre::open().await;
    let with_videos = format!("{OF_ADA}?videos=true");
    session(&centre.trainee, "ada", recording(16 << 20, 1)).await; // more than the buffers of a connection
    let unread = centre.trainee.get(&with_videos).await;
    assert_eq!(unread.status(), StatusCode::OK);
    for _ in 0..3 {
        let refused = centre.trainee.get(OF_ADA).await;
        assert!(refused.headers().contains_key(header::RETRY_AFTER));
        problem(refused, 429, "too-many").await;
    }
    export(&centre.other_trainee, "/api/v1/trainees/bob/data.zip").await;
    export(&centre.instructor, OF_ADA).await;
    let audit = centre.administrator.read("/api/v1/audit-entries").await;
    let exports = audit["items"].as_array().unwrap().iter().filter(|entry| entry["action"] == "export").count();
    assert_eq!(exports, 3, "the refused ones are not in the audit trail");
    drop(unread);
    poll("an export after the first is gone", async || {
        (centre.trainee.get(OF_ADA).await.status() == StatusCode::OK).then_some(())
    })
    .await;
}

#[tokio::test(flavor = "multi_thread")]
async fn stored_files_that_cannot_be_read_withhold_no_others() {
    let centre = Centre::open().await;
    let planter = Planter::open(&centre.service.data.path().join("trocar.db")).await;
    planter.session(planter.trainee("ada").await, NEW_YEAR_MS, vec![]).await; // its video and path are not stored
    session(&centre.trainee, "ada", recording(100, 1)).await;
    let files = export(&centre.trainee, &format!("{OF_ADA}?videos=true")).await;
    let count = |file: &str| files.keys().filter(|name| name.ends_with(file)).count();
    assert_eq!((count("/session.json"), count("/ratings.json")), (2, 2));
    assert_eq!((count("/path.error.txt"), count("/path.csv"), count("/video.mp4")), (1, 0, 1));
    assert_eq!(count("/video.error.txt"), 1, "the export says that a video is lost");
    assert!(files.contains_key("audit.json"), "what follows is there, too");
}

#[tokio::test(flavor = "multi_thread")]
async fn an_administrator_exports_the_centre_and_the_audit_trail_says_so() {
    let centre = Centre::open().await;
    session(&centre.trainee, "ada", recording(100, 1)).await;
    let ada = centre.administrator.read("/api/v1/trainees/ada").await["id"].clone();
    centre.administrator.make("/api/v1/cohorts", json!({"name": "Experts", "members": [ada]})).await;
    let plan = json!({"name": "Basics", "steps": [{"task": "peg", "sessions": 1}]});
    centre.administrator.make("/api/v1/courses", plan).await;
    let files = export(&centre.administrator, "/api/v1/data.zip").await;
    assert!(!files.contains_key("trainees/ada/audit.json"), "audit.json has all");
    for file in files.keys().filter(|name| !name.contains('/')) {
        let readme = String::from_utf8(files["README.txt"].clone()).unwrap();
        assert!(file == "README.txt" || readme.contains(file), "{file} is not in {readme}");
    }
    for (file, texts) in [
        ("accounts.json", ["ada", "omar"]),
        ("groups.json", ["One", "Two"]),
        ("tasks.json", ["Peg transfer", "standards"]),
        ("courses.json", ["Basics", "Peg transfer"]),
        ("cohorts.json", ["Experts", ada.as_str().unwrap()]),
        ("boxes.json", ["Box 1", "calibration"]),
        ("audit.json", ["create", "session"]),
        ("trainees/ada/profile.json", ["ada", "account"]),
        ("trainees/bob/profile.json", ["bob", "account"]),
    ] {
        let content = String::from_utf8(files[file].clone()).unwrap();
        assert!(texts.iter().all(|text| content.contains(text)), "{file}: {content}");
        assert!(!content.contains("argon2"), "{file}");
        serde_json::from_str::<Value>(&content).unwrap();
    }
    assert!(files.keys().any(|name| name.starts_with("trainees/ada/sessions/") && name.ends_with("/session.json")));
    let audit = centre.administrator.read("/api/v1/audit-entries").await;
    assert_eq!((&audit["items"][0]["action"], &audit["items"][0]["noun"]), (&json!("export"), &json!("centre")));
}

#[tokio::test(flavor = "multi_thread")]
async fn the_printed_command_makes_a_backup() {
    let centre = Centre::open().await;
    session(&centre.trainee, "ada", recording(100, 1)).await;
    let command = centre.administrator.read("/api/v1/service").await["backup_command"].as_str().unwrap().to_owned();
    let target = command.rsplit(' ').next().unwrap().to_owned();
    let run = Command::new("/bin/sh").args(["-c", &command]).current_dir("/").env_clear().output().unwrap();
    let made = std::path::Path::new(&target).join("BACKUP").exists();
    let _ = std::fs::remove_dir_all(&target);
    assert!(run.status.success() && made, "{command}: {}", String::from_utf8_lossy(&run.stderr));
}
