//! Exports: everything about a person or the centre in a ZIP file, and the command of a backup by hand.

use std::collections::BTreeMap;
use std::io::{Cursor, Read};
use std::process::Command;

use reqwest::{StatusCode, header};
use serde_json::{Value, json};

use super::centre::{Centre, recording, session};
use crate::support::{Client, problem};

/// The files of an export.
async fn export(client: &Client, path: &str) -> BTreeMap<String, Vec<u8>> {
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
async fn an_administrator_exports_the_centre_and_the_audit_trail_says_so() {
    let centre = Centre::open().await;
    session(&centre.trainee, "ada", recording(100, 1)).await;
    let files = export(&centre.administrator, "/api/v1/data.zip").await;
    for (file, texts) in [
        ("accounts.json", ["ada", "omar"]),
        ("groups.json", ["One", "Two"]),
        ("tasks.json", ["Peg transfer", "standards"]),
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
