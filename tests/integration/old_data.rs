//! A data folder that an earlier release made opens, migrates and answers as before.
//!
//! `tests/fixtures/make_data_folder.py` made each folder with the program of its release. Migrations and stored documents
//! change only so that these folders stay readable.

use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

use reqwest::StatusCode;
use serde_json::Value;
use tempfile::TempDir;
use trocar::time::ManualClock;

use crate::process::program;
use crate::support::Service;

/// The folders that are kept, oldest first, and a time of the day on which each was made (Unix, ms): some answers, as a
/// box's light of today, depend on the date.
const RELEASES: [(&str, i64); 1] = [("data_pipeline_11", 1_795_719_600_000)];

/// What may change between releases: sentences for people, and the answer's own time.
const FREE: [&str; 12] = [
    "title",
    "detail",
    "finding",
    "advice",
    "why",
    "words",
    "anchors",
    "text",
    "now",
    "etag",
    "sign_in",
    "last_used_at",
];

/// Lists that a later release makes longer at the end: one entry for each form of ratings.
const GROWING: [&str; 1] = ["raters"];

/// What a later release changes on purpose: release, path of the value, old and new value.
const CHANGED: [(&str, &str, &str, &str); 1] =
    // Advice on tapes has a kind of its own.
    [("data_pipeline_11", "jobs/01a21932-2832-77e7-9de9-e2b613698be0 kind", "palette", "advise")];

/// A data folder of an earlier release, unpacked.
pub struct OldData {
    pub folder: TempDir,
    /// The data folder, inside `folder`.
    pub data: PathBuf,
    /// A time of the day on which it was made, Unix ms.
    pub made_ms: i64,
    /// The administrator's password.
    pub password: String,
    /// What the release answered, by path.
    answers: Value,
}

impl OldData {
    /// The newest one.
    pub fn newest() -> Self {
        let (release, made_ms) = RELEASES[RELEASES.len() - 1];
        Self::of(release, made_ms)
    }

    /// The oldest one.
    pub fn oldest() -> Self {
        let (release, made_ms) = RELEASES[0];
        Self::of(release, made_ms)
    }

    fn of(release: &str, made_ms: i64) -> Self {
        let archive = Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures").join(format!("{release}.tar.gz"));
        let folder = tempfile::tempdir().unwrap();
        let status = Command::new("tar").arg("-xzf").arg(&archive).arg("-C").arg(folder.path()).status().unwrap();
        assert!(status.success(), "tar -xzf {}", archive.display());
        let mut kept: Value = serde_json::from_slice(&fs::read(folder.path().join("answers.json")).unwrap()).unwrap();
        let password = kept["password"].as_str().unwrap().to_owned();
        Self { data: folder.path().join("data"), folder, made_ms, password, answers: kept["answers"].take() }
    }
}

#[tokio::test(flavor = "multi_thread")]
async fn an_old_data_folder_migrates_and_answers_as_before() {
    for (release, made_ms) in RELEASES {
        let OldData { folder, data, password, answers, .. } = OldData::of(release, made_ms);
        let service =
            Service::start_in(folder, ManualClock::at(made_ms), |settings| settings.data = data.clone()).await;
        let client = service.sign_in("administrator", &password).await;
        let mut differences = Vec::new();
        for (path, old) in answers.as_object().unwrap() {
            let answer = client.get(&format!("/api/v1/{path}")).await;
            assert_eq!(answer.status(), StatusCode::OK, "{release}: {path}");
            let text = answer.text().await.unwrap();
            let new = if old.is_string() { Value::String(text) } else { serde_json::from_str(&text).unwrap() };
            compare(path, old, &new, &mut differences);
        }
        let meant = CHANGED.iter().filter(|(of, ..)| *of == release);
        for line in meant.map(|(_, path, old, new)| format!("{path}: was \"{old}\", is \"{new}\"")) {
            let found = differences.iter().position(|difference| *difference == line);
            differences.remove(found.unwrap_or_else(|| panic!("{release}: not found: {line}")));
        }
        assert!(differences.is_empty(), "{release}: answers changed:\n{}", differences.join("\n"));

        let _folder = service.stop().await;
        let check = program().args(["admin", "check", "--data"]).arg(&data).output().unwrap();
        assert!(check.status.success(), "{release}: {}", String::from_utf8_lossy(&check.stdout));
    }
}

/// True if each line of a CSV table is the old line, or begins with its fields.
fn has_rows_of(old: &str, new: &str) -> bool {
    let begins_alike =
        |(old, new): (&str, &str)| new.strip_prefix(old).is_some_and(|rest| rest.is_empty() || rest.starts_with(','));
    old.starts_with("frame,")
        && old.lines().count() == new.lines().count()
        && old.lines().zip(new.lines()).all(begins_alike)
}

/// Everything that was in the old answer is in the new one, with the same value; new keys may come, and new columns at
/// the end of a CSV table.
fn compare(path: &str, old: &Value, new: &Value, differences: &mut Vec<String>) {
    match (old, new) {
        (Value::Object(old), Value::Object(new)) => {
            for (key, value) in old.iter().filter(|(key, _)| !FREE.contains(&key.as_str())) {
                compare(&format!("{path} {key}"), value, new.get(key).unwrap_or(&Value::Null), differences);
            }
        }
        (Value::Array(old), Value::Array(new))
            if old.len() == new.len()
                || old.len() < new.len() && path.rsplit(' ').next().is_some_and(|list| GROWING.contains(&list)) =>
        {
            for (index, (old, new)) in old.iter().zip(new).enumerate() {
                compare(&format!("{path} {index}"), old, new, differences);
            }
        }
        (Value::String(old), Value::String(new)) if has_rows_of(old, new) => {}
        _ if old == new => {}
        _ => {
            let short = |value: &Value| value.to_string().chars().take(200).collect::<String>();
            differences.push(format!("{path}: was {}, is {}", short(old), short(new)));
        }
    }
}
