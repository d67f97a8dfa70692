//! A backup that is restored on an empty folder answers every route that reads as the service itself did, and people who
//! were erased since the backup are absent.

use std::collections::{BTreeMap, BTreeSet};
use std::fs;
use std::path::Path;

use reqwest::StatusCode;
use serde_json::{Value, json};
use trocar::settings::Settings;
use trocar::time::{ManualClock, to_rfc3339};
use trocar::upkeep::complete_backups;

use super::centre::recording;
use super::documents::operations;
use crate::old_data::OldData;
use crate::process::program;
use crate::support::{Client, Service, poll, poll_until, read};

/// What routes need beside their address, so that they answer with data.
const QUERIES: [(&str, &str); 7] = [
    ("/trajectory", "?format=csv&kind=smoothed"),
    ("/trainees/{id}/progress", "?task=peg"),
    ("/groups/{id}/progress", "?task=peg"),
    ("/groups/{id}/course", "?course=peg"),
    ("/distribution", "?feature=duration"),
    ("/agreement", "?form=goals"),
    ("/correlations", "?form=goals"),
];

/// Routes that are not compared, and why: most belong to the running process, or to the time after the backup.
const NOT_COMPARED: [(&str, &str); 17] = [
    ("/metrics", "counters of the process"),
    ("/api/v1/service", "its disk, its settings and its backups"),
    ("/api/v1/audit", "entries since the backup are lost with the old disk"),
    ("/api/v1/audit-entries", "entries since the backup are lost with the old disk"),
    ("/api/v1/data.zip", "has the audit trail"),
    ("/api/v1/trainees/{id}/data.zip", "has the audit trail"),
    ("/api/v1/events", "a stream without an end"),
    ("/api/v1/boxes/{id}/feed", "a WebSocket"),
    ("/api/v1/boxes/{id}/agent-connection", "a WebSocket"),
    ("/api/v1/sessions/{id}/live", "a WebSocket"),
    ("/api/v1/certificate-checks/{code}", "no list names the codes; the certificates are compared"),
    ("/api/v1/waiting-recordings/{id}/preview.jpg", "these bytes have no picture"),
    ("/api/v1/me/pin", "only trainees have a PIN"),
    ("/api/v1/me/sign-ins", "signed-in browsers are left out of backups"),
    ("/api/v1/centre/logo", "the old data have no logo"),
    ("/api/v1/feedback", "only trainees have feedback"),
    ("/api/v1/tasks/{id}/models/{version}", "the old data have too few people for a model"),
];

/// Both services have the same address: xAPI statements contain it.
const PUBLIC_URL: Option<&str> = Some("https://skills.example");

/// Values that change from one request to the next.
const FREE: [&str; 3] = ["now", "sign_in", "last_used_at"];

#[tokio::test(flavor = "multi_thread")]
async fn a_restored_backup_answers_as_the_service_did_without_erased_people() {
    let OldData { folder, data, made_ms, password, .. } = OldData::newest();
    let targets = tempfile::tempdir().unwrap();
    let clock = ManualClock::at(made_ms);
    let at_data = |settings: &mut Settings| settings.data = data.clone();
    let service = Service::start_in(folder, clock.clone(), at_data).await;
    let client = service.sign_in("administrator", &password).await;
    client.make("/api/v1/trainees", json!({"name": "Erika Weg", "code": "erika"})).await;
    let path = "/api/v1/sessions?trainee=erika&task=peg&box=box-1&filename=clip.mp4";
    let request = client.request(reqwest::Method::POST, path).header("content-type", "video/mp4");
    read(request.body(recording(5_000, 9)).send().await.unwrap(), StatusCode::CREATED).await;
    store_what_the_old_data_lack(&client).await;
    let folder = service.stop().await;

    let with_backups = |settings: &mut Settings| {
        settings.data = data.clone();
        settings.http.public_url = PUBLIC_URL.map(str::to_owned);
        settings.backup.target = Some(targets.path().to_owned());
    };
    let service = Service::start_in(folder, clock.clone(), with_backups).await;
    let made = poll("a scheduled backup", async || Some(complete_backups(targets.path()).unwrap().pop()?.1)).await;
    let client = service.sign_in("administrator", &password).await;
    assert_eq!(client.delete("/api/v1/trainees/erika").await.status(), StatusCode::NO_CONTENT);
    let list = targets.path().join("erasures");
    poll_until("the list of erased people", || {
        clock.advance(std::time::Duration::from_secs(1));
        fs::read_to_string(&list).is_ok_and(|text| text.contains("trainee "))
    })
    .await;
    let before = answers(&client).await;
    drop(service.stop().await);

    let restored = tempfile::tempdir().unwrap();
    let data = restored.path().join("data");
    let mut command = program();
    command.args(["admin", "restore", "--erasures-until", &to_rfc3339(made_ms)]); // the service had its own clock
    let command = command.arg(&made).arg("--data").arg(&data).output().unwrap();
    assert!(command.status.success(), "{}", String::from_utf8_lossy(&command.stderr));
    let at_restored = |settings: &mut Settings| {
        settings.data = data.clone();
        settings.http.public_url = PUBLIC_URL.map(str::to_owned);
    };
    let service = Service::start_in(restored, clock, at_restored).await;
    let client = service.sign_in("administrator", &password).await;
    let after = answers(&client).await;

    let with_data = before.iter().filter(|(_, answer)| answer.status == StatusCode::OK);
    let compared: BTreeSet<&str> = with_data.map(|((route, _), _)| route.as_str()).collect();
    let excepted: BTreeSet<&str> = NOT_COMPARED.iter().map(|(route, _)| *route).collect();
    let routes = routes_that_read(&client).await;
    let routes: BTreeSet<&str> = routes.iter().map(String::as_str).collect();
    let expected: BTreeSet<&str> = routes.difference(&excepted).copied().collect();
    assert_eq!(
        compared, expected,
        "store something that a route can answer, or say in NOT_COMPARED why it is left out"
    );
    assert!(excepted.is_subset(&routes), "these exceptions are of no route: {:?}", excepted.difference(&routes));
    assert_eq!(before.keys().collect::<Vec<_>>(), after.keys().collect::<Vec<_>>());
    let different: Vec<_> = before.iter().filter(|(address, answer)| after[*address] != **answer).collect();
    assert!(different.is_empty(), "{different:#?}");
    assert!(!before.keys().any(|(_, path)| path.contains("erika")), "she was erased");
    assert_eq!(planted_bytes(&data, b"Erika Weg"), Vec::<String>::new());
    service.stop().await;
}

/// A recording without a name, a certificate, and an exam.
async fn store_what_the_old_data_lack(client: &Client) {
    let request = client.request(reqwest::Method::POST, "/api/v1/waiting-recordings?filename=clip.mp4");
    let request = request.header("content-type", "video/mp4").body(recording(5_000, 8));
    read(request.send().await.unwrap(), StatusCode::CREATED).await;
    let by = json!({"method": "fixed", "limit": 5000.0, "unit": "s"});
    let standard =
        json!({"targets": [{"feature": "duration", "by": by}], "rule": {"in_a_row": 1}, "valid_from": "beginning"});
    client.make("/api/v1/tasks/peg/standards", standard).await;
    let sessions = client.read("/api/v1/sessions?task=peg&outcome=passed").await;
    let trainee = sessions["items"][0]["trainee"]["id"].as_str().expect("a session that met the standard");
    let path = format!("/api/v1/trainees/{trainee}/certificates");
    client.make(&path, json!({"task": "peg", "language": "en", "accept_local_address": true})).await;
    client.make("/api/v1/exams", json!({"trainee": trainee, "task": "peg", "box": "box-1", "attempts": 1})).await;
}

/// What a client can compare of an answer.
#[derive(Debug, PartialEq)]
struct ComparedAnswer {
    status: StatusCode,
    kind: Option<String>,
    body: Result<Value, Vec<u8>>,
}

/// Every route that reads, as the service describes it.
async fn routes_that_read(client: &Client) -> Vec<String> {
    let document = client.read("/api/v1/openapi.json").await;
    let read = operations(&document).into_iter().filter(|(_, method, _)| method == "get");
    read.map(|(path, ..)| path).collect()
}

/// The answers of every route that reads, by route and address, for everything that the lists name.
async fn answers(client: &Client) -> BTreeMap<(String, String), ComparedAnswer> {
    let mut found = BTreeMap::new();
    for route in routes_that_read(client).await {
        if NOT_COMPARED.iter().any(|(left_out, _)| *left_out == route) {
            continue;
        }
        let query = QUERIES.iter().find(|(end, _)| route.ends_with(end)).map_or("", |(_, query)| query);
        for path in addresses(client, &route).await {
            let answer = client.get(&format!("{path}{query}")).await;
            let (status, kind) = (answer.status(), answer.headers().get("content-type").cloned());
            let bytes = answer.bytes().await.unwrap().to_vec();
            let body = serde_json::from_slice(&bytes).map(without_free).map_err(|_| bytes);
            let kind = kind.map(|kind| kind.to_str().unwrap().to_owned());
            found.insert((route.clone(), path), ComparedAnswer { status, kind, body });
        }
    }
    found
}

/// The addresses of a route: each parameter takes the keys of the list before it.
async fn addresses(client: &Client, route: &str) -> BTreeSet<String> {
    let mut paths = BTreeSet::from([String::new()]);
    for part in route.split('/').skip(1) {
        let mut longer = BTreeSet::new();
        for path in paths {
            if part.starts_with('{') {
                longer.extend(keys(client, &path, part).await.into_iter().map(|key| format!("{path}/{key}")));
            } else {
                longer.insert(format!("{path}/{part}"));
            }
        }
        paths = longer;
    }
    paths
}

/// The keys of a list's items: codes where they have one.
async fn keys(client: &Client, list: &str, parameter: &str) -> Vec<String> {
    let answer = client.get(&format!("{list}?limit=20")).await;
    if answer.status() != StatusCode::OK {
        return Vec::new();
    }
    let list: Value = answer.json().await.unwrap();
    let items = list["items"].as_array().or(list.as_array()).cloned().unwrap_or_default();
    let own = parameter.trim_matches(['{', '}']);
    let key = |item: &Value| {
        let value = [own, "code", "id"].iter().map(|key| &item[*key]).find(|value| !value.is_null())?;
        Some(value.as_str().map_or_else(|| value.to_string(), str::to_owned))
    };
    items.iter().filter_map(key).collect()
}

fn without_free(mut value: Value) -> Value {
    match &mut value {
        Value::Object(fields) => {
            fields.retain(|key, _| !FREE.contains(&key.as_str()));
            fields.values_mut().for_each(|value| *value = without_free(value.take()));
        }
        Value::Array(items) => items.iter_mut().for_each(|value| *value = without_free(value.take())),
        _ => {}
    }
    value
}

/// The files that hold these bytes.
fn planted_bytes(folder: &Path, bytes: &[u8]) -> Vec<String> {
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            found.extend(planted_bytes(&path, bytes));
        } else if fs::read(&path).unwrap().windows(bytes.len()).any(|window| window == bytes) {
            found.push(path.display().to_string());
        }
    }
    found
}
